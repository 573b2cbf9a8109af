-- The map of an attachment: an expression of the table's columns for each field of an object.
--
-- The server parses each expression as the only column of a view over the table alone, and writes it out with all names
-- qualified. The definition of that view shows whether it is one expression of the columns of one row.

CREATE OR REPLACE FUNCTION conflictdb_internal._map_fields(p_kind smallint) RETURNS TABLE (field text, attribute text)
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT v.field, v.attribute
    -- attribute: column of attached_plan. Field "where" selects rows and has none.
    FROM (VALUES (NULL, 'where', NULL), (NULL, 'key', 'key'),
                 (0, 'footprint', 'shape'), (0, 'span', 'span'), (0, 'start', 'starts_at'), (0, 'end', 'ends_at'),
                 (1, 'path', 'shape'), (1, 'times', 'times'), (1, 'position', 'shape'), (1, 'time', 'at'),
                 -- Waypoints do not use floors_m; it holds their order.
                 (1, 'order', 'floors_m'), (1, 'fore_m', 'fore_m'), (1, 'aft_m', 'aft_m'), (1, 'port_m', 'port_m'),
                 (1, 'starboard_m', 'starboard_m'),
                 /* plan columns: (KIND, 'NAME', 'NAME') but footprint = but active_span = but path = */
                 (1, 'outline', 'outline'), (NULL, 'floor_m', 'floor_m'), (NULL, 'ceiling_m', 'ceiling_m'),
                 (NULL, 'name', 'name'), (NULL, 'properties', 'properties'), (1, 'grow_mps', 'grow_mps'),
                 (1, 'outlines', 'outlines'), (1, 'floors_m', 'floors_m'), (1, 'ceilings_m', 'ceilings_m'),
                 (NULL, 'class', 'class'), (NULL, 'owner', 'owner'), (1, 'tolerances', 'tolerances'),
                 (0, 'activations', 'activations'), (1, 'departures', 'departures'), (NULL, 'schedule', 'schedule')
                 /* end */
                 ) v (kind, field, attribute)
    WHERE coalesce(v.kind, p_kind) = p_kind;
END;
COMMENT ON FUNCTION _map_fields(smallint) IS
'Fields that the map of an attachment may contain (0 area, 1 track), and their columns in attached_plan; null for '
'where, which selects rows.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_map(p_who text, p_kind smallint, p_map jsonb) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_field text;
    v_ways text;
BEGIN
    IF jsonb_typeof(p_map) IS DISTINCT FROM 'object' THEN
        FOUND := _raise('ZC009', p_who, 'map', 'must be a JSON object of fields and expressions', 'map_object',
                        'Such as {"key": "id", "footprint": "shape"}.');
    END IF;
    SELECT m.key INTO v_field FROM jsonb_each(p_map) m WHERE m.key NOT IN (SELECT f.field FROM _map_fields(p_kind) f)
        ORDER BY m.key LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC009', p_who, v_field,
                        format('is no field of %s; known: %s', CASE p_kind WHEN 0 THEN 'an area' ELSE 'a track' END,
                               (SELECT string_agg(f.field, ', ') FROM _map_fields(p_kind) f)), 'map_field_known');
    END IF;
    SELECT m.key INTO v_field FROM jsonb_each(p_map) m
        WHERE jsonb_typeof(m.value) <> 'string' OR btrim(m.value #>> '{}') = '' ORDER BY m.key LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC009', p_who, v_field, 'must be the name of a column or an SQL expression', 'map_expression');
    END IF;
    IF NOT p_map ? 'key' THEN
        FOUND := _raise('ZC009', p_who, 'key', 'is missing: it identifies the object of a row', 'map_key');
    END IF;
    v_ways := CASE
        WHEN p_kind = 0 AND NOT p_map ? 'footprint' THEN 'footprint'
        WHEN p_kind = 1 AND NOT (p_map ? 'path' OR p_map ?& '{position,time}')
            THEN 'path (a LineStringM, or a LineString and times), or position and time (a row for each waypoint)' END;
    IF v_ways IS NOT NULL THEN
        FOUND := _raise('ZC009', p_who, 'map', 'must give ' || v_ways, 'map_shape');
    END IF;
    IF p_map ?| '{position,time}' AND p_map ?| '{path,times,outlines,floors_m,ceilings_m}' THEN
        FOUND := _raise('ZC009', p_who, 'map', 'must not mix fields of single waypoints and of whole paths',
                        'map_one_shape', 'With a row for each waypoint, outline and heights may differ by row.');
    END IF;
    IF p_map ? 'order' AND NOT p_map ? 'position' THEN
        FOUND := _raise('ZC009', p_who, 'order', 'is of waypoints one by one: it needs position and time',
                        'map_order_of_waypoints', 'The points of a path have an order.');
    END IF;
    IF p_map ? 'span' AND p_map ?| '{start,end}' THEN
        FOUND := _raise('ZC009', p_who, 'span', 'must not be given together with start or end', 'map_one_span');
    END IF;
    IF p_map ? 'activations' AND p_map ?| '{span,start,end,schedule}' THEN
        FOUND := _raise('ZC009', p_who, 'activations', 'must not be given together with span, start, end or schedule',
                        'map_one_span');
    END IF;
    IF p_map ?& '{departures,schedule}' THEN
        FOUND := _raise('ZC009', p_who, 'departures', 'must not be given together with schedule',
                        'map_departures_once');
    END IF;
    IF p_map ? 'tolerances' AND p_map ?| '{departures,schedule}' THEN
        FOUND := _raise('ZC009', p_who, 'tolerances', 'must not be given for a voyage that is repeated',
                        'map_tolerances_of_one_voyage', 'Attach such voyages as a row each.');
    END IF;
    IF p_kind = 1 AND NOT (p_map ?| '{outline,outlines}' OR p_map ?& '{fore_m,aft_m,port_m,starboard_m}') THEN
        FOUND := _raise('ZC009', p_who, 'map',
                        'must give outline, outlines, or all of fore_m, aft_m, port_m, starboard_m', 'map_haven',
                        'Constants are accepted: fore_m=50. Sizes of 0 give a point.');
    END IF;
    IF p_map ?| '{outline,outlines}' AND p_map ?| '{fore_m,aft_m,port_m,starboard_m}' THEN
        FOUND := _raise('ZC009', p_who, 'map', 'gives the haven twice, as an outline and as sizes', 'map_one_haven');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_map(text, smallint, jsonb) IS
'Raises ZC009 for a map with unknown, missing or contradictory fields.';

CREATE OR REPLACE FUNCTION conflictdb_internal._cast_to(p_type oid, p_wanted oid) RETURNS boolean
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Only casts that keep the meaning. A timestamp without time zone is not an instant.
    SELECT CASE
        WHEN p_type = p_wanted OR p_wanted = 'text'::regtype THEN true
        WHEN p_wanted = 'geometry'::regtype THEN p_type = 'geography'::regtype
        WHEN p_wanted = 'jsonb'::regtype THEN p_type = 'json'::regtype
        WHEN p_wanted = 'double precision'::regtype
            THEN p_type IN ('smallint'::regtype, 'integer'::regtype, 'bigint'::regtype, 'real'::regtype,
                            'numeric'::regtype)
        WHEN p_wanted = 'double precision[]'::regtype
            THEN p_type IN ('smallint[]'::regtype, 'integer[]'::regtype, 'bigint[]'::regtype, 'real[]'::regtype,
                            'numeric[]'::regtype)
        ELSE false END;
END;
COMMENT ON FUNCTION _cast_to(oid, oid) IS 'Whether values of a type may be cast to the type of a field.';

CREATE OR REPLACE FUNCTION instant(p_text text) RETURNS timestamptz
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    -- The offset makes it independent of the session's settings.
    IF p_text !~ '^\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)? ?(Z|[+-]\d\d(:?\d\d)?)$' THEN
        RAISE EXCEPTION 'instant: %: must be ISO 8601 with an offset, such as 2026-03-01T06:00:00Z',
            quote_literal(left(p_text, 100)) USING ERRCODE = 'ZC003';
    END IF;
    RETURN p_text::timestamptz;
END
$$;
COMMENT ON FUNCTION instant(text) IS
'Parses an instant in ISO 8601 with an offset (2026-03-01T06:00:00Z); raises ZC003 for any other text. For maps of '
'attached tables, in which casts of text to instants are refused.';

CREATE OR REPLACE FUNCTION conflictdb_internal._depends_on_settings_alone(
    p_name name, p_types oidvector
) RETURNS boolean
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- The function that evaluates the map fixes these settings (42_attach.sql): time zone, date and number styles.
    SELECT p_name::text IN ('concat', 'concat_ws', 'format', 'to_char', 'to_timestamp', 'to_date', 'to_number',
                            'date_trunc', 'date_part', 'extract', 'make_timestamptz', 'array_to_string', 'to_json',
                            'to_jsonb', 'row_to_json', 'array_to_json', 'json_build_object', 'json_build_array',
                            'jsonb_build_object', 'jsonb_build_array', 'quote_nullable', 'quote_literal', 'textanycat',
                            'anytextcat')
           OR p_name::text ~ '^(timestamp|timestamptz|date|time|timetz|interval)(_|$)'
              AND NOT 'cstring'::regtype = ANY (p_types::oid[]);
END;
COMMENT ON FUNCTION _depends_on_settings_alone(name, oidvector) IS
'Whether a STABLE function of PostgreSQL depends only on its arguments and on settings that are fixed for maps.';

CREATE OR REPLACE FUNCTION conflictdb_internal._map_expression(
    p_who text, p_field text, p_relation regclass, p_text text, p_wanted oid,
    OUT expression text, OUT columns smallint[]
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- Names that no column has, as a column's own name would be written out without AS.
    c_longest CONSTANT text := (SELECT repeat('_', max(length(a.attname))) FROM pg_catalog.pg_attribute a
                                WHERE a.attrelid = p_relation AND a.attname ~ '^conflictdb_(value|one)_*$');
    c_value CONSTANT text := 'conflictdb_value' || coalesce(c_longest, '');
    c_from CONSTANT text := format('FROM %s AS t, generate_series(1, 1) AS conflictdb_one%s', p_relation, c_longest);
    c_probe CONSTANT text := format('conflictdb_attached.probe_%s', pg_backend_pid());
    v_path text := current_setting('search_path');
    v_text text := p_text;
    v_cursor refcursor;
    v_tree text;
    v_type oid;
    v_rule text;
    v_around text;
    v_where text;
BEGIN
    IF EXISTS (SELECT FROM pg_catalog.pg_attribute a
               WHERE a.attrelid = p_relation AND a.attname = p_text AND a.attnum > 0 AND NOT a.attisdropped) THEN
        v_text := format('t.%I', p_text); -- a column by its name, whatever characters it has
    END IF;
    v_text := format(E'SELECT (%s\n) AS %I %s', v_text, c_value, c_from);
    BEGIN
        -- OPEN accepts only a single query; nothing is fetched.
        OPEN v_cursor NO SCROLL FOR EXECUTE v_text;
        CLOSE v_cursor;
        EXECUTE format('CREATE VIEW %s AS SELECT 1 AS %I %s', c_probe, c_value, c_from);
        PERFORM set_config('search_path', '', true);
        v_around := pg_get_viewdef(c_probe::regclass);
        PERFORM set_config('search_path', v_path, true);
        EXECUTE format('DROP VIEW %s', c_probe);
        EXECUTE format('CREATE VIEW %s AS %s', c_probe, v_text);
    EXCEPTION WHEN OTHERS THEN
        IF SQLSTATE !~ '^(42|22|0A|2F|34|54|P0)' THEN
            RAISE;
        END IF;
        FOUND := _raise('ZC009', p_who, p_field, format('%s cannot be used: %s', quote_literal(p_text), SQLERRM),
                        'map_expression',
                        'Use an expression of the columns of one row. Quote names that are not plain identifiers; '
                        'qualify functions outside of pg_catalog, PostGIS and conflictdb with their schema.');
    END;
    SELECT r.ev_action::text INTO v_tree FROM pg_catalog.pg_rewrite r WHERE r.ev_class = c_probe::regclass;
    v_rule := CASE
        WHEN (SELECT count(*) FROM regexp_matches(v_tree, '\{QUERY :', 'g')) <> 1
            OR (SELECT c.relnatts FROM pg_catalog.pg_class c WHERE c.oid = c_probe::regclass) <> 1
            THEN 'must be one expression without subqueries'
        WHEN v_tree ~ ':(hasAggs|hasWindowFuncs|hasTargetSRFs) true' OR v_tree !~ ':groupClause <> '
            THEN 'must be an expression of one row, without aggregates, window functions and functions that return sets'
        WHEN v_tree ~ ':varattno -' THEN 'must not use system columns, which change without the row'
        WHEN v_tree ~ '\{SQLVALUEFUNCTION ' OR EXISTS (
            SELECT FROM regexp_matches(v_tree, ':(?:funcid|opfuncid) (\d+)', 'g') f
            JOIN pg_catalog.pg_proc p ON p.oid = f[1]::oid
            WHERE p.provolatile = 'v' OR p.provolatile = 's' AND p.pronamespace = 'pg_catalog'::regnamespace
                  AND NOT _depends_on_settings_alone(p.proname, p.proargtypes))
            THEN 'must depend only on the row, not on a volatile function, the time, a setting or the user'
        -- 'now', 'today' and 'tomorrow' are valid instants.
        WHEN v_tree ~ '\{COERCEVIAIO ' AND EXISTS (
            SELECT FROM regexp_matches(v_tree, ':resulttype (\d+)', 'g') f
            JOIN pg_catalog.pg_type y ON y.oid = f[1]::oid
            LEFT JOIN pg_catalog.pg_range g ON y.oid IN (g.rngtypid, g.rngmultitypid)
            LEFT JOIN pg_catalog.pg_type u ON u.oid IN (y.typelem, g.rngsubtype)
            WHERE 'D' IN (y.typcategory, u.typcategory))
            THEN 'must not read an instant from text by a cast, for ''now'' is one too: conflictdb.instant(TEXT) reads '
                 'ISO 8601 with an offset' END;
    SELECT format_type(a.atttypid, a.atttypmod), coalesce(nullif(y.typbasetype, 0), y.oid) INTO v_where, v_type
        FROM pg_catalog.pg_attribute a JOIN pg_catalog.pg_type y ON y.oid = a.atttypid
        WHERE a.attrelid = c_probe::regclass AND a.attnum = 1;
    IF v_rule IS NULL AND NOT _cast_to(v_type, p_wanted) THEN
        v_rule := format('must be of type %s; got %s', format_type(p_wanted, -1), v_where);
    END IF;
    IF v_rule IS NOT NULL THEN
        FOUND := _raise('ZC009', p_who, p_field, format('%s %s', quote_literal(p_text), v_rule), 'map_expression',
            CASE WHEN v_type IS NULL OR _cast_to(v_type, p_wanted) THEN ''
                 WHEN p_wanted = 'geometry'::regtype THEN 'ST_GeomFromText, ST_GeomFromGeoJSON or ST_Point make one.'
                 WHEN p_wanted = 'timestamptz'::regtype THEN
                     'COLUMN AT TIME ZONE ''UTC'' converts a time without zone, to_timestamp(COLUMN) Unix seconds.'
                 WHEN p_wanted = 'tstzrange'::regtype THEN
                     'Or give start and end. tstzrange(lower(COLUMN) AT TIME ZONE ''UTC'', …) says which instants.'
                 ELSE '' END);
    END IF;
    PERFORM set_config('search_path', '', true);
    -- The text around the expression is the same in both view definitions.
    expression := format('(%s)::%s',
        substr(pg_get_viewdef(c_probe::regclass), strpos(v_around, '1'),
               length(pg_get_viewdef(c_probe::regclass)) - length(v_around) + 1),
        format_type(p_wanted, -1));
    PERFORM set_config('search_path', v_path, true);
    columns := ARRAY(SELECT DISTINCT c[1]::smallint FROM regexp_matches(v_tree, ':varattno (-?\d+)', 'g') c ORDER BY 1);
    EXECUTE format('DROP VIEW %s', c_probe);
END
$$;
COMMENT ON FUNCTION _map_expression(text, text, regclass, text, oid) IS
'Returns an expression of the columns of a table (alias t) with all names qualified, cast to p_wanted, and the numbers '
'of its columns (0: whole row). Raises ZC009 unless it is a non-volatile expression of one row.';
