-- Rows of attached tables become objects of their scene, in sets. If a set fails, it is halved until the failing row is
-- found, so that errors are reported for single rows.

CREATE OR REPLACE FUNCTION conflictdb_internal._begin_attached() RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET client_min_messages = warning AS $$
BEGIN
    -- Kept in the session, empty: a worker uses them many times a minute.
    CREATE TEMPORARY TABLE IF NOT EXISTS staged_attached (LIKE attached_plan) ON COMMIT DELETE ROWS;
    CREATE INDEX IF NOT EXISTS staged_attached_btree ON pg_temp.staged_attached (identity);
    CREATE TEMPORARY TABLE IF NOT EXISTS attached_item (
        identity text COLLATE "C", hash bigint, rows bigint, key text COLLATE "C", reason text, is_taken boolean,
        former_id bigint, object_id bigint, n bigint
    ) ON COMMIT DELETE ROWS;
    DELETE FROM pg_temp.staged_attached;
    DELETE FROM pg_temp.attached_item;
END
$$;
COMMENT ON FUNCTION _begin_attached() IS
'Creates or empties the temporary tables staged_attached (rows read) and attached_item (one row per object).';

CREATE OR REPLACE FUNCTION conflictdb_internal._lon_lat(p_who text, p_field text, p_geometry geometry) RETURNS geometry
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_placed geometry;
BEGIN
    IF p_geometry IS NULL OR ST_SRID(p_geometry) = 4326 THEN
        RETURN p_geometry;
    END IF;
    IF ST_SRID(p_geometry) = 0 THEN
        FOUND := _raise('ZC001', p_who, p_field, 'has no SRID', 'attached_srid',
                        'ST_SetSRID(COLUMN, 4326) in the map says that it is longitude and latitude on WGS84.');
    END IF;
    v_placed := ST_Transform(p_geometry, 4326);
    IF ST_XMax(v_placed) - ST_XMin(v_placed) > 180 AND GeometryType(v_placed) LIKE '%POLYGON%' THEN
        -- ST_Transform wraps longitudes at 180. The midpoint of a side that jumps tells a cut polygon from a wide one.
        IF EXISTS (
            SELECT FROM (SELECT ST_X(a.geom) AS lon, lead(ST_X(a.geom)) OVER w AS next,
                                ST_X(ST_Transform(ST_Centroid(ST_MakeLine(b.geom, lead(b.geom) OVER w)), 4326))
                                    AS middle
                         FROM ST_DumpPoints(v_placed) a JOIN ST_DumpPoints(p_geometry) b USING (path)
                         WINDOW w AS (PARTITION BY b.path[1:cardinality(b.path) - 1] ORDER BY b.path)) s
            WHERE abs(s.next - s.lon) > 180 AND (s.middle < least(s.lon, s.next) OR s.middle > greatest(s.lon, s.next)
                  OR abs(s.middle - (s.lon + s.next) / 2) > 90)) THEN
            RETURN ST_ShiftLongitude(v_placed);
        END IF;
    END IF;
    RETURN v_placed;
END
$$;
COMMENT ON FUNCTION _lon_lat(text, text, geometry) IS
'Transforms a geometry to longitude and latitude (degrees, SRID 4326). A polygon cut at longitude 180 is made whole: '
'longitudes from 0 to 360.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attached_footprint(p_who text, p_shape geometry) RETURNS geometry
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF (GeometryType(p_shape) IN ('POLYGON', 'MULTIPOLYGON')) IS FALSE THEN
        FOUND := _raise('ZC001', p_who, 'footprint', format('must be a Polygon or MultiPolygon; got %s',
                        GeometryType(p_shape)), 'footprint_polygon');
    END IF;
    RETURN ST_Multi(_lon_lat(p_who, 'footprint', ST_Force2D(p_shape)));
END
$$;
COMMENT ON FUNCTION _attached_footprint(text, geometry) IS 'The footprint of an area, given in any SRID.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attached_span(
    p_who text, p_span tstzrange, p_start timestamptz, p_end timestamptz
)
RETURNS tstzrange
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF p_end <= p_start THEN
        FOUND := _raise('ZC003', p_who, 'end', format('must be later than start (%s); got %s', p_start, p_end),
                        'span_not_empty');
    END IF;
    RETURN coalesce(p_span, tstzrange(p_start, p_end));
END
$$;
COMMENT ON FUNCTION _attached_span(text, tstzrange, timestamptz, timestamptz) IS
'The active span of an area, from a span or from start and end, [start, end); null is unbounded.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attached_path(
    p_who text, p_shape geometry, p_times timestamptz[], p_has_times boolean
)
RETURNS geometry
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_path geometry := CASE WHEN p_has_times THEN ST_Force2D(p_shape) ELSE ST_Force3DM(p_shape) END;
BEGIN
    IF ST_GeometryType(p_shape) <> 'ST_LineString' OR NOT p_has_times AND ST_Zmflag(p_shape) NOT IN (1, 3) THEN
        FOUND := _raise('ZC001', p_who, 'path',
                        format('must be a %s; got %s', CASE WHEN p_has_times THEN 'LineString' ELSE 'LineStringM' END,
                               GeometryType(p_shape)), 'path_linestring_m',
                        'M is Unix seconds; or give times, an array of one instant for each waypoint.');
    END IF;
    IF p_has_times AND (p_times IS NULL OR array_position(p_times, NULL) IS NOT NULL) THEN
        FOUND := _raise('ZC002', p_who, 'times', 'must not be null', 'path_time_per_waypoint');
    END IF;
    v_path := _lon_lat(p_who, 'path', v_path);
    RETURN CASE WHEN p_has_times THEN track_path(v_path, p_times) ELSE v_path END;
END
$$;
COMMENT ON FUNCTION _attached_path(text, geometry, timestamptz[], boolean) IS
'The path of a track, given in any SRID, with times as M (Unix seconds) or in an array.';

CREATE OR REPLACE FUNCTION conflictdb_internal._order_reason(p_identity text) RETURNS text
LANGUAGE plpgsql STABLE STRICT SET search_path FROM CURRENT AS $$
DECLARE
    v_bad record;
BEGIN
    SELECT w.* INTO v_bad FROM (
        SELECT s.floors_m[1] AS place, lag(s.floors_m[1]) OVER o AS place_before, s.at, lag(s.at) OVER o AS at_before
        FROM pg_temp.staged_attached s WHERE s.identity = p_identity AND NOT s.is_asked
        WINDOW o AS (ORDER BY s.floors_m[1], s.at)) w
        WHERE w.place IS NULL OR w.place = w.place_before OR w.at <= w.at_before ORDER BY w.place NULLS FIRST LIMIT 1;
    RETURN CASE WHEN NOT FOUND THEN NULL
                WHEN v_bad.place IS NULL THEN 'order: is null in a row'
                WHEN v_bad.place = v_bad.place_before THEN format('order: %s is given twice', v_bad.place)
                ELSE format('time: must increase along order: waypoint %s is at %s, waypoint %s before it at %s',
                            v_bad.place, v_bad.at, v_bad.place_before, v_bad.at_before) END;
END
$$;
COMMENT ON FUNCTION _order_reason(text) IS
'Why the staged rows of a track cannot be ordered (order null or repeated, time not increasing); null if they can.';

CREATE OR REPLACE FUNCTION conflictdb_internal._staged_tracks(
    p_is_waypoints boolean, p_has_times boolean, p_first bigint, p_last bigint
)
RETURNS TABLE (
    object_id bigint, key text,
    /* track columns: NAME TYPE */
    path geometry, outline geometry, floor_m double precision, ceiling_m double precision, name text, properties jsonb,
    grow_mps double precision, outlines geometry, floors_m double precision[], ceilings_m double precision[],
    class text, owner text, tolerances jsonb, departures timestamptz[], schedule jsonb
    /* end */
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    IF NOT p_is_waypoints THEN
        RETURN QUERY
        SELECT
            coalesce(i.object_id, i.former_id), i.key::text,
            /* track columns: TAKEN(s)
               but path = _attached_path(format('track %L', i.key), s.shape, s.times, p_has_times)
               but outline = coalesce(ST_Force2D(s.outline),
                                      rectangle_outline(s.fore_m, s.aft_m, s.port_m, s.starboard_m))
               but outlines = ST_Force2D(s.outlines) */
            _attached_path(format('track %L', i.key), s.shape, s.times, p_has_times),
            coalesce(ST_Force2D(s.outline), rectangle_outline(s.fore_m, s.aft_m, s.port_m, s.starboard_m)), s.floor_m,
            s.ceiling_m, s.name, coalesce(s.properties, '{}'), coalesce(s.grow_mps, 0), ST_Force2D(s.outlines),
            s.floors_m, s.ceilings_m, s.class, s.owner, nullif(s.tolerances, 'null'), s.departures,
            nullif(s.schedule, 'null')
            /* end */
        FROM pg_temp.attached_item i JOIN pg_temp.staged_attached s ON s.identity = i.identity AND NOT s.is_asked
        WHERE i.n BETWEEN p_first AND p_last;
        RETURN;
    END IF;
    RETURN QUERY
    WITH waypoint AS (
        SELECT i.n, coalesce(i.object_id, i.former_id) AS object_id, i.key, s.at, s.shape,
               -- Those of the first waypoint are the track's.
               /* track columns: s.NAME, but path = but outline = but outlines = but floor_m = but ceiling_m =
                  but floors_m = but ceilings_m = */
               s.name, s.properties, s.grow_mps, s.class, s.owner, s.tolerances, s.departures, s.schedule,
               /* end */
               coalesce(ST_Force2D(s.outline), rectangle_outline(s.fore_m, s.aft_m, s.port_m, s.starboard_m))
                   AS outline,
               -- A leg has the lower floor and the higher ceiling of its two waypoints; null: no limit.
               nullif(least(coalesce(s.floor_m, '-infinity'), coalesce(lead(s.floor_m) OVER w, '-infinity')),
                      '-infinity') AS floor_m,
               nullif(greatest(coalesce(s.ceiling_m, 'infinity'), coalesce(lead(s.ceiling_m) OVER w, 'infinity')),
                      'infinity') AS ceiling_m,
               lead(s.at) OVER w IS NULL AS is_last
        FROM pg_temp.attached_item i JOIN pg_temp.staged_attached s ON s.identity = i.identity AND NOT s.is_asked
        WHERE i.n BETWEEN p_first AND p_last
        WINDOW w AS (PARTITION BY i.n ORDER BY s.at)
    ), whole AS (
        SELECT w.n, w.object_id, w.key,
               /* track columns: (array_agg(w.NAME ORDER BY w.at))[1] AS NAME, but path = but outline = but outlines =
                  but floor_m = but ceiling_m = but floors_m = but ceilings_m =
                  but departures = (array_agg(to_jsonb(w.departures) ORDER BY w.at))[1] AS departures, */
               (array_agg(w.name ORDER BY w.at))[1] AS name, (array_agg(w.properties ORDER BY w.at))[1] AS properties,
               (array_agg(w.grow_mps ORDER BY w.at))[1] AS grow_mps, (array_agg(w.class ORDER BY w.at))[1] AS class,
               (array_agg(w.owner ORDER BY w.at))[1] AS owner, (array_agg(w.tolerances ORDER BY w.at))[1] AS tolerances,
               (array_agg(to_jsonb(w.departures) ORDER BY w.at))[1] AS departures,
               (array_agg(w.schedule ORDER BY w.at))[1] AS schedule,
               /* end */
               ST_MakeLine(ST_Force2D(w.shape) ORDER BY w.at) AS shape, array_agg(w.at ORDER BY w.at) AS times,
               bool_and(ST_GeometryType(w.shape) = 'ST_Point' AND NOT ST_IsEmpty(w.shape)) AS is_of_points,
               array_agg(w.outline ORDER BY w.at) AS outlines, bool_and(w.outline IS NOT NULL) AS has_outlines,
               count(DISTINCT ST_AsBinary(w.outline)) > 1 AS is_changing,
               array_agg(w.floor_m ORDER BY w.at) FILTER (WHERE NOT w.is_last) AS floors_m,
               array_agg(w.ceiling_m ORDER BY w.at) FILTER (WHERE NOT w.is_last) AS ceilings_m
        FROM waypoint w GROUP BY w.n, w.object_id, w.key
    )
    SELECT
        w.object_id, w.key::text,
        /* track columns: TAKEN(w)
           but path = _attached_path(format('track %L', w.key), CASE WHEN w.is_of_points THEN w.shape END, w.times,
                                     true)
           but outline = CASE WHEN w.has_outlines THEN w.outlines[1] END
           but outlines = CASE WHEN w.has_outlines AND w.is_changing THEN ST_Collect(w.outlines) END
           but floor_m = CASE WHEN NOT f.differ THEN w.floors_m[1] END
           but ceiling_m = CASE WHEN NOT c.differ THEN w.ceilings_m[1] END
           but floors_m = CASE WHEN f.differ THEN w.floors_m END
           but ceilings_m = CASE WHEN c.differ THEN w.ceilings_m END
           but departures = (SELECT array_agg(d::timestamptz ORDER BY n)
                             FROM jsonb_array_elements_text(w.departures) WITH ORDINALITY e (d, n)) */
        _attached_path(format('track %L', w.key), CASE WHEN w.is_of_points THEN w.shape END, w.times, true),
        CASE WHEN w.has_outlines THEN w.outlines[1] END, CASE WHEN NOT f.differ THEN w.floors_m[1] END,
        CASE WHEN NOT c.differ THEN w.ceilings_m[1] END, w.name, coalesce(w.properties, '{}'), coalesce(w.grow_mps, 0),
        CASE WHEN w.has_outlines AND w.is_changing THEN ST_Collect(w.outlines) END,
        CASE WHEN f.differ THEN w.floors_m END, CASE WHEN c.differ THEN w.ceilings_m END, w.class, w.owner,
        nullif(w.tolerances, 'null'),
        (SELECT array_agg(d::timestamptz ORDER BY n) FROM jsonb_array_elements_text(w.departures) WITH ORDINALITY e (d,
            n)), nullif(w.schedule, 'null')
        /* end */
    FROM whole w
    CROSS JOIN LATERAL (SELECT coalesce(bool_or(x IS DISTINCT FROM w.floors_m[1]), false) AS differ
                        FROM unnest(w.floors_m) x) f
    CROSS JOIN LATERAL (SELECT coalesce(bool_or(x IS DISTINCT FROM w.ceilings_m[1]), false) AS differ
                        FROM unnest(w.ceilings_m) x) c;
END
$$;
COMMENT ON FUNCTION _staged_tracks(boolean, boolean, bigint, bigint) IS
'Tracks of the staged rows p_first to p_last. With one row per waypoint, name, properties, class, owner, tolerances, '
'departures, schedule and growth are those of the first row; differing outlines change along the legs; a leg has the '
'lower floor and the higher ceiling of its ends.';

CREATE OR REPLACE FUNCTION conflictdb_internal._identity_json(
    p_columns text[], p_types oid[], p_identity text
) RETURNS jsonb
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT jsonb_object_agg(c.name, CASE
        WHEN c.type IN ('smallint'::regtype, 'integer'::regtype, 'bigint'::regtype, 'real'::regtype,
                        'double precision'::regtype, 'numeric'::regtype) THEN to_jsonb(c.value::numeric)
        WHEN c.type = 'boolean'::regtype THEN to_jsonb(c.value::boolean)
        ELSE to_jsonb(c.value) END)
    FROM unnest(p_columns, p_types, p_identity::text[]) c (name, type, value);
END;
COMMENT ON FUNCTION _identity_json(text[], oid[], text) IS
'Values of the identity columns of an attached row by name: numbers and truth values as such, all others as text.';

CREATE OR REPLACE FUNCTION conflictdb_internal._put_attached(
    p_attachment attachment, p_first bigint, p_last bigint
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_is_closed boolean := _is_closed(p_attachment.scene_id);
    v_types oid[] := ARRAY(
        SELECT coalesce(nullif(y.typbasetype, 0), y.oid)
        FROM unnest(p_attachment.identity_columns) WITH ORDINALITY c (name, n)
        LEFT JOIN pg_catalog.pg_attribute a
            ON a.attrelid = _attached_root(p_attachment) AND a.attname = c.name AND NOT a.attisdropped
        LEFT JOIN pg_catalog.pg_type y ON y.oid = a.atttypid ORDER BY c.n);
BEGIN
    IF p_attachment.object_kind = 0 THEN
        UPDATE area a SET key = i.key FROM pg_temp.attached_item i
            WHERE i.n BETWEEN p_first AND p_last AND a.area_id = i.former_id AND a.scene_id = p_attachment.scene_id;
        WITH new AS (
            SELECT
                coalesce(i.object_id, i.former_id) AS object_id, i.key,
                /* area columns: TAKEN(s) AS NAME
                   but footprint = _attached_footprint(format('area %L', i.key), s.shape) AS footprint
                   but active_span = coalesce(CASE WHEN NOT isempty(s.activations)
                                                   THEN range_merge(s.activations) END,
                       _attached_span(format('area %L', i.key), s.span, s.starts_at, s.ends_at)) AS active_span
                   but activations = _half_open(s.activations, v_is_closed) AS activations */
                _attached_footprint(format('area %L', i.key), s.shape) AS footprint,
                coalesce(CASE WHEN NOT isempty(s.activations) THEN range_merge(s.activations) END,
                    _attached_span(format('area %L', i.key), s.span, s.starts_at, s.ends_at)) AS active_span,
                s.floor_m AS floor_m, s.ceiling_m AS ceiling_m, s.name AS name,
                coalesce(s.properties, '{}') AS properties, s.class AS class, s.owner AS owner,
                _half_open(s.activations, v_is_closed) AS activations, nullif(s.schedule, 'null') AS schedule
                /* end */
            FROM pg_temp.attached_item i JOIN pg_temp.staged_attached s ON s.identity = i.identity AND NOT s.is_asked
            WHERE i.n BETWEEN p_first AND p_last
        ), changed AS (
            UPDATE area a SET
                /* area columns: NAME = n.NAME */
                footprint = n.footprint, active_span = n.active_span, floor_m = n.floor_m, ceiling_m = n.ceiling_m,
                name = n.name, properties = n.properties, class = n.class, owner = n.owner, activations = n.activations,
                schedule = n.schedule
                /* end */
            FROM new n
            WHERE a.area_id = n.object_id AND a.scene_id = p_attachment.scene_id AND (
                /* area columns: WRITTEN(a) */
                a.footprint, a.active_span, a.floor_m, a.ceiling_m, a.name, a.properties, a.class, a.owner,
                CASE WHEN a.schedule IS NULL THEN a.activations END, a.schedule
                /* end */
            ) IS DISTINCT FROM (
                /* area columns: n.NAME but active_span = _half_open(n.active_span, v_is_closed) */
                n.footprint, _half_open(n.active_span, v_is_closed), n.floor_m, n.ceiling_m, n.name, n.properties,
                n.class, n.owner, n.activations, n.schedule
                /* end */
            )
        )
        INSERT INTO area (
            scene_id, key,
            /* area columns: NAME */
            footprint, active_span, floor_m, ceiling_m, name, properties, class, owner, activations, schedule
            /* end */
        ) SELECT
            p_attachment.scene_id, n.key,
            /* area columns: n.NAME */
            n.footprint, n.active_span, n.floor_m, n.ceiling_m, n.name, n.properties, n.class, n.owner, n.activations,
            n.schedule
            /* end */
            FROM new n WHERE n.object_id IS NULL;
    ELSE
        UPDATE track t SET key = i.key FROM pg_temp.attached_item i
            WHERE i.n BETWEEN p_first AND p_last AND t.track_id = i.former_id AND t.scene_id = p_attachment.scene_id;
        WITH new AS (
            SELECT n.* FROM _staged_tracks(p_attachment.map ? 'position', p_attachment.map ? 'times', p_first, p_last) n
        ), changed AS (
            UPDATE track t SET
                /* track columns: NAME = n.NAME */
                path = n.path, outline = n.outline, floor_m = n.floor_m, ceiling_m = n.ceiling_m, name = n.name,
                properties = n.properties, grow_mps = n.grow_mps, outlines = n.outlines, floors_m = n.floors_m,
                ceilings_m = n.ceilings_m, class = n.class, owner = n.owner, tolerances = n.tolerances,
                departures = n.departures, schedule = n.schedule
                /* end */
            FROM new n
            WHERE t.track_id = n.object_id AND t.scene_id = p_attachment.scene_id AND (
                /* track columns: WRITTEN(t) */
                t.path, t.outline, t.floor_m, t.ceiling_m, t.name, t.properties, t.grow_mps, t.outlines, t.floors_m,
                t.ceilings_m, t.class, t.owner, t.tolerances, CASE WHEN t.schedule IS NULL THEN t.departures END,
                t.schedule
                /* end */
            ) IS DISTINCT FROM (
                /* track columns: n.NAME */
                n.path, n.outline, n.floor_m, n.ceiling_m, n.name, n.properties, n.grow_mps, n.outlines, n.floors_m,
                n.ceilings_m, n.class, n.owner, n.tolerances, n.departures, n.schedule
                /* end */
            )
        )
        INSERT INTO track (
            scene_id, key,
            /* track columns: NAME */
            path, outline, floor_m, ceiling_m, name, properties, grow_mps, outlines, floors_m, ceilings_m, class, owner,
            tolerances, departures, schedule
            /* end */
        ) SELECT
            p_attachment.scene_id, n.key,
            /* track columns: n.NAME */
            n.path, n.outline, n.floor_m, n.ceiling_m, n.name, n.properties, n.grow_mps, n.outlines, n.floors_m,
            n.ceilings_m, n.class, n.owner, n.tolerances, n.departures, n.schedule
            /* end */
            FROM new n WHERE n.object_id IS NULL;
    END IF;
    INSERT INTO attached_object AS o (attachment_id, identity, hash, key, object_id, version, identity_json)
        SELECT p_attachment.attachment_id, i.identity, i.hash, i.key, coalesce(a.area_id, t.track_id),
               coalesce(a.version, t.version),
               _identity_json(p_attachment.identity_columns, v_types, i.identity)
        FROM pg_temp.attached_item i
        LEFT JOIN area a ON p_attachment.object_kind = 0 AND a.scene_id = p_attachment.scene_id AND a.key = i.key
        LEFT JOIN track t ON p_attachment.object_kind = 1 AND t.scene_id = p_attachment.scene_id AND t.key = i.key
        WHERE i.n BETWEEN p_first AND p_last
        ON CONFLICT (attachment_id, identity) DO UPDATE
            SET hash = excluded.hash, key = excluded.key, object_id = excluded.object_id, version = excluded.version,
                identity_json = excluded.identity_json, reason = NULL, is_taken = false, since = excluded.since;
END
$$;
COMMENT ON FUNCTION _put_attached(attachment, bigint, bigint) IS
'Creates or updates the objects of items p_first to p_last, all or none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._put_attached_by_halves(
    p_attachment attachment, p_items bigint
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_ranges int8range[] := ARRAY[int8range(1, p_items, '[]')];
    v_first bigint;
    v_last bigint;
    v_reason text;
BEGIN
    WHILE cardinality(v_ranges) > 0 LOOP
        v_first := lower(v_ranges[cardinality(v_ranges)]);
        v_last := upper(v_ranges[cardinality(v_ranges)]) - 1;
        v_ranges := v_ranges[:cardinality(v_ranges) - 1];
        BEGIN
            PERFORM _put_attached(p_attachment, v_first, v_last);
        EXCEPTION WHEN OTHERS THEN
            -- Errors of the session or server (locks, resources) are not errors of a row.
            IF SQLSTATE ~ '^(40|53|55|57|58)' THEN
                RAISE;
            END IF;
            v_reason := SQLERRM;
            IF v_first = v_last THEN
                UPDATE pg_temp.attached_item i SET reason = v_reason WHERE i.n = v_first;
            ELSE
                v_ranges := v_ranges || int8range((v_first + v_last) / 2 + 1, v_last, '[]')
                            || int8range(v_first, (v_first + v_last) / 2, '[]');
            END IF;
        END;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _put_attached_by_halves(attachment, bigint) IS
'Creates or updates the objects of all items, halving sets that fail; records the reason of each item that fails.';

CREATE OR REPLACE FUNCTION conflictdb_internal._take_over_attached(
    p_attachment attachment, p_change_ids bigint[], OUT mapped bigint, OUT removed bigint, OUT unmapped bigint
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
SET enable_nestloop = on SET jit = off AS $$
DECLARE
    -- Above this number of rows, no nested loops: for a new scene the planner expects few rows.
    c_few CONSTANT bigint := 1000;
    c_too_long CONSTANT text := 'key: its columns must hold at most 1000 bytes';
BEGIN
    mapped := 0; removed := 0; unmapped := 0;
    -- Serialise with loads of the scene.
    PERFORM FROM scene s WHERE s.scene_id = p_attachment.scene_id FOR NO KEY UPDATE;
    UPDATE pg_temp.staged_attached s SET identity = _short_identity(s.identity), error = c_too_long
        WHERE octet_length(s.identity) > 1000;
    ANALYZE pg_temp.staged_attached;
    IF (SELECT count(*) FROM pg_temp.staged_attached) > c_few THEN
        PERFORM set_config('enable_nestloop', 'off', true);
    END IF;
    INSERT INTO pg_temp.attached_item (identity, hash, rows, key, reason, is_taken, former_id)
        SELECT s.identity, s.hash, s.rows, s.key,
               CASE WHEN s.rows = 0 THEN NULL
                    WHEN s.error IS NOT NULL THEN s.error
                    WHEN s.is_keyless THEN 'key: is null'
                    WHEN NOT p_attachment.map ? 'position' AND s.rows > 1
                        THEN format('key: %s rows of the table have it', s.rows)
                    WHEN p_attachment.map ? 'position' AND s.is_timeless THEN 'time: is null in a row'
                    WHEN p_attachment.map ? 'order' THEN _order_reason(s.identity) END,
               false, o.object_id
        FROM (SELECT x.identity, _combined_hash(sum(x.hash)) AS hash, count(*) FILTER (WHERE NOT x.is_asked) AS rows,
                     min(x.key) AS key, min(x.error) AS error, bool_or(x.key IS NULL AND NOT x.is_asked) AS is_keyless,
                     bool_or(x.at IS NULL AND NOT x.is_asked) AS is_timeless
              FROM pg_temp.staged_attached x GROUP BY x.identity) s
        LEFT JOIN attached_object o ON o.attachment_id = p_attachment.attachment_id AND o.identity = s.identity;
    ANALYZE pg_temp.attached_item;

    -- A row with the key of a row that is gone is the same object, as after a map with other columns of the key.
    WITH heir AS (
        SELECT DISTINCT ON (o.key) o.key, g.identity AS gone, i.identity, g.former_id
        FROM pg_temp.attached_item g
        JOIN attached_object o ON o.attachment_id = p_attachment.attachment_id AND o.identity = g.identity
        JOIN pg_temp.attached_item i ON i.key = o.key AND i.rows > 0 AND i.reason IS NULL AND i.former_id IS NULL
        WHERE g.rows = 0 AND g.former_id IS NOT NULL
        ORDER BY o.key, i.identity
    )
    UPDATE pg_temp.attached_item i SET former_id = CASE WHEN i.identity = h.identity THEN h.former_id END
        FROM heir h WHERE i.identity IN (h.identity, h.gone);

    -- Removed rows first, because other rows may now use their keys.
    DELETE FROM area a USING pg_temp.attached_item i
        WHERE p_attachment.object_kind = 0 AND i.rows = 0 AND a.area_id = i.former_id
              AND a.scene_id = p_attachment.scene_id;
    GET DIAGNOSTICS removed = ROW_COUNT;
    IF p_attachment.object_kind = 1 THEN
        DELETE FROM track t USING pg_temp.attached_item i WHERE i.rows = 0 AND t.track_id = i.former_id
            AND t.scene_id = p_attachment.scene_id;
        GET DIAGNOSTICS removed = ROW_COUNT;
    END IF;
    DELETE FROM attached_object o USING pg_temp.attached_item i
        WHERE o.attachment_id = p_attachment.attachment_id AND o.identity = i.identity AND i.rows = 0;
    DELETE FROM pg_temp.attached_item i WHERE i.rows = 0;

    -- An existing object with the key is either this row's own, or the key is taken.
    UPDATE pg_temp.attached_item i SET object_id = i.former_id, former_id = NULL
        WHERE EXISTS (SELECT FROM area a WHERE p_attachment.object_kind = 0 AND a.area_id = i.former_id
                      AND a.scene_id = p_attachment.scene_id AND a.key = i.key)
           OR EXISTS (SELECT FROM track t WHERE p_attachment.object_kind = 1 AND t.track_id = i.former_id
                      AND t.scene_id = p_attachment.scene_id AND t.key = i.key);
    -- A row whose key changed renames its object; not if another row has the former key now.
    DELETE FROM area a USING pg_temp.attached_item i
        WHERE p_attachment.object_kind = 0 AND a.area_id = i.former_id AND a.scene_id = p_attachment.scene_id
              AND i.reason IS NULL AND EXISTS (SELECT FROM pg_temp.attached_item x WHERE x.key = a.key);
    DELETE FROM track t USING pg_temp.attached_item i
        WHERE p_attachment.object_kind = 1 AND t.track_id = i.former_id AND t.scene_id = p_attachment.scene_id
              AND i.reason IS NULL AND EXISTS (SELECT FROM pg_temp.attached_item x WHERE x.key = t.key);
    UPDATE pg_temp.attached_item i SET former_id = NULL
        WHERE i.former_id IS NOT NULL
          AND NOT EXISTS (SELECT FROM area a WHERE p_attachment.object_kind = 0 AND a.area_id = i.former_id
                          AND a.scene_id = p_attachment.scene_id)
          AND NOT EXISTS (SELECT FROM track t WHERE p_attachment.object_kind = 1 AND t.track_id = i.former_id
                          AND t.scene_id = p_attachment.scene_id);
    UPDATE pg_temp.attached_item i
        SET is_taken = true, reason = 'key: is taken by an object of the scene that is not attached'
        WHERE i.reason IS NULL AND i.object_id IS NULL
          AND EXISTS (SELECT FROM object_key k WHERE k.scene_id = p_attachment.scene_id AND k.key = i.key);
    IF FOUND THEN
        UPDATE pg_temp.attached_item i SET reason = 'key: is taken by a row of ' || h.holder
            FROM (SELECT o.key, min(_attached_name(a)) AS holder
                  FROM attached_object o JOIN attachment a USING (attachment_id)
                  WHERE a.scene_id = p_attachment.scene_id AND o.object_id IS NOT NULL GROUP BY o.key) h
            WHERE i.is_taken AND i.key = h.key;
    END IF;
    UPDATE pg_temp.attached_item i SET is_taken = true, reason = 'key: another row of the table has it too'
        FROM (SELECT x.identity, row_number() OVER (PARTITION BY x.key ORDER BY x.object_id IS NULL, x.identity) AS n
              FROM pg_temp.attached_item x WHERE x.reason IS NULL) d
        WHERE i.identity = d.identity AND d.n > 1;

    UPDATE pg_temp.attached_item i SET n = d.n
        FROM (SELECT x.identity, row_number() OVER (ORDER BY x.identity) AS n FROM pg_temp.attached_item x
              WHERE x.reason IS NULL) d
        WHERE i.identity = d.identity;
    SELECT count(i.n) INTO mapped FROM pg_temp.attached_item i;
    IF mapped > 0 THEN
        PERFORM _put_attached_by_halves(p_attachment, mapped);
    END IF;
    INSERT INTO attached_object AS o (attachment_id, identity, hash, key, reason, is_taken)
        SELECT p_attachment.attachment_id, i.identity, i.hash, left(i.key, 1000), i.reason, i.is_taken
        FROM pg_temp.attached_item i WHERE i.reason IS NOT NULL
        ON CONFLICT (attachment_id, identity) DO UPDATE
            SET hash = excluded.hash, key = excluded.key, reason = excluded.reason, is_taken = excluded.is_taken,
                since = CASE WHEN o.reason IS NULL THEN excluded.since ELSE o.since END;
    GET DIAGNOSTICS unmapped = ROW_COUNT;
    SELECT mapped - count(*) INTO mapped FROM pg_temp.attached_item i WHERE i.n IS NOT NULL AND i.reason IS NOT NULL;
    DELETE FROM attached_change q
        WHERE q.attached_change_id = ANY (p_change_ids) AND q.attachment_id = p_attachment.attachment_id;
END
$$;
COMMENT ON FUNCTION _take_over_attached(attachment, bigint[]) IS
'Applies the staged rows of an attachment to the objects of its scene; returns numbers of objects created, updated or '
'unchanged, of objects removed, and of rows that cannot be mapped.';

-- Rows that cannot be mapped are retried after a change of the scene's plane.

CREATE OR REPLACE FUNCTION conflictdb_internal._after_scene_resettled() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    INSERT INTO attached_change (attachment_id, identities)
        SELECT o.attachment_id, array_agg(o.identity) FROM attached_object o JOIN attachment a USING (attachment_id)
        WHERE a.scene_id = NEW.scene_id AND o.reason IS NOT NULL AND o.identity ~ '^\{.*\}$'
        GROUP BY o.attachment_id;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_scene_resettled() IS
'Trigger: after a change of motion, earth or centre, retries rows of attached tables that could not be mapped. Runs as '
'its owner: editors of the scene need no rights on attachments. Restricted to attachments of the changed scene.';

CREATE OR REPLACE TRIGGER scene_resettled AFTER UPDATE ON scene
    FOR EACH ROW
    WHEN ((OLD.motion, OLD.earth, OLD.centre_lon, OLD.centre_lat)
          IS DISTINCT FROM (NEW.motion, NEW.earth, NEW.centre_lon, NEW.centre_lat))
    EXECUTE FUNCTION _after_scene_resettled();
ALTER TABLE scene ENABLE ALWAYS TRIGGER scene_resettled;
