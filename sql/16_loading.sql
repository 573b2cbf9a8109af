-- Bulk loading: the store COPYs objects into temporary tables; `_load` applies them to the scene, `_add_staged` adds
-- the rest of the new ones, in the same transaction. Unchanged rows keep their version and get no mark.

CREATE OR REPLACE FUNCTION conflictdb_internal._begin_load() RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET client_min_messages = warning AS $$
BEGIN
    CREATE TEMPORARY TABLE IF NOT EXISTS staged_area (
        key text COLLATE "C", name text, footprint geometry, span_start timestamptz, span_end timestamptz,
        floor_m double precision, ceiling_m double precision, properties jsonb, class text, owner text,
        activations tstzmultirange, schedule jsonb
    ) ON COMMIT DROP;
    CREATE TEMPORARY TABLE IF NOT EXISTS staged_track (
        key text COLLATE "C", name text, path geometry, outline geometry,
        floor_m double precision, ceiling_m double precision, floors text, ceilings text, properties jsonb,
        grow_mps double precision, outlines geometry, class text, owner text, tolerances jsonb,
        departures timestamptz[], schedule jsonb
    ) ON COMMIT DROP;
    TRUNCATE pg_temp.staged_area, pg_temp.staged_track;
END
$$;
COMMENT ON FUNCTION _begin_load() IS
'Creates the temporary tables staged_area and staged_track, empty, for this transaction. '
'Infinite heights (metres) and instants mean unbounded.';

CREATE OR REPLACE FUNCTION conflictdb_internal._add_staged(
    p_scene_id bigint, p_first_page bigint, OUT added bigint, OUT next_page bigint
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET jit = off AS $$
DECLARE
    -- Some thousand rows: the client shows the progress after each part.
    c_pages CONSTANT bigint := 500;
    v_first tid := format('(%s,0)', p_first_page);
    v_end tid := format('(%s,0)', p_first_page + c_pages);
    v_max_speed_kn text := current_setting('conflictdb.max_speed_kn', true);
    v_rows bigint;
BEGIN
    -- conflictdb.model has already checked speeds, under the limit of this load.
    PERFORM set_config('conflictdb.max_speed_kn', 'infinity', true);
    INSERT INTO area (scene_id, key, name, footprint, active_span, floor_m, ceiling_m, properties, class, owner,
                      activations, schedule)
        SELECT p_scene_id, s.key, s.name, ST_SetSRID(s.footprint, 4326),
               tstzrange(nullif(s.span_start, '-infinity'), nullif(s.span_end, 'infinity')),
               nullif(s.floor_m, '-infinity'), nullif(s.ceiling_m, 'infinity'), s.properties, s.class, s.owner,
               s.activations, s.schedule
        FROM pg_temp.staged_area s WHERE s.ctid >= v_first AND s.ctid < v_end
        -- In the order given: objects are listed by id.
        ORDER BY s.ctid;
    GET DIAGNOSTICS added = ROW_COUNT;
    INSERT INTO track (scene_id, key, name, path, outline, floor_m, ceiling_m, floors_m, ceilings_m, properties,
                       grow_mps, outlines, class, owner, tolerances, departures, schedule)
        SELECT p_scene_id, s.key, s.name, ST_SetSRID(s.path, 4326), s.outline,
               nullif(s.floor_m, '-infinity'), nullif(s.ceiling_m, 'infinity'), s.floors::double precision[],
               s.ceilings::double precision[], s.properties, s.grow_mps, s.outlines, s.class, s.owner,
               s.tolerances, s.departures, s.schedule
        FROM pg_temp.staged_track s WHERE s.ctid >= v_first AND s.ctid < v_end
        ORDER BY s.ctid;
    GET DIAGNOSTICS v_rows = ROW_COUNT;
    added := added + v_rows;
    PERFORM set_config('conflictdb.max_speed_kn', coalesce(v_max_speed_kn, ''), true);
    IF greatest(pg_relation_size('pg_temp.staged_area'), pg_relation_size('pg_temp.staged_track'))
       > (p_first_page + c_pages) * current_setting('block_size')::integer THEN
        next_page := p_first_page + c_pages;
    END IF;
END
$$;
COMMENT ON FUNCTION _add_staged(bigint, bigint) IS
'Adds a part of the staged objects, those in some pages of the staged tables, to a scene; returns their number and the '
'first page of the next part, null after the last.';

CREATE OR REPLACE FUNCTION conflictdb_internal._load(
    p_name text, p_settings jsonb, p_merge boolean,
    OUT added bigint, OUT updated bigint, OUT removed bigint, OUT unchanged bigint, OUT scene_id bigint,
    OUT stored bigint, OUT next_page bigint
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
SET jit = off AS $$
DECLARE
    v_max_speed_kn text := current_setting('conflictdb.max_speed_kn', true);
    v_scene_id bigint := _set_scene(p_name, p_settings);
    v_rows bigint;
    v_key text;
    v_total bigint;
BEGIN
    IF NOT p_merge AND _parent_of(v_scene_id) IS NOT NULL THEN
        PERFORM _scene_id(p_name);
    END IF;
    -- conflictdb.model has already checked speeds, under the limit of this load.
    PERFORM set_config('conflictdb.max_speed_kn', 'infinity', true);
    -- Serialise loads of one scene.
    PERFORM FROM scene s WHERE s.scene_id = v_scene_id FOR NO KEY UPDATE;
    ANALYZE pg_temp.staged_area;
    ANALYZE pg_temp.staged_track;
    SELECT k.key INTO v_key
        FROM (SELECT a.key FROM pg_temp.staged_area a UNION ALL SELECT t.key FROM pg_temp.staged_track t) k
        GROUP BY k.key HAVING count(*) > 1 ORDER BY k.key LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC007', format('object %L', v_key), 'key', 'is given twice', 'object_key_unique');
    END IF;
    SELECT (SELECT count(*) FROM pg_temp.staged_area) + (SELECT count(*) FROM pg_temp.staged_track) INTO v_total;

    -- Delete first: a key may pass from an area to a track.
    DELETE FROM area a WHERE a.scene_id = v_scene_id
        AND CASE WHEN p_merge THEN EXISTS (SELECT FROM pg_temp.staged_track n WHERE n.key = a.key)
                 ELSE NOT EXISTS (SELECT FROM pg_temp.staged_area n WHERE n.key = a.key) END;
    GET DIAGNOSTICS removed = ROW_COUNT;
    DELETE FROM track t WHERE t.scene_id = v_scene_id
        AND CASE WHEN p_merge THEN EXISTS (SELECT FROM pg_temp.staged_area n WHERE n.key = t.key)
                 ELSE NOT EXISTS (SELECT FROM pg_temp.staged_track n WHERE n.key = t.key) END;
    GET DIAGNOSTICS v_rows = ROW_COUNT;
    removed := removed + v_rows;

    UPDATE area a SET name = n.name, footprint = n.footprint, active_span = n.active_span, floor_m = n.floor_m,
                      ceiling_m = n.ceiling_m, properties = n.properties, class = n.class, owner = n.owner,
                      activations = n.activations, schedule = n.schedule
        FROM (SELECT s.key, s.name, ST_SetSRID(s.footprint, 4326) AS footprint,
                     tstzrange(nullif(s.span_start, '-infinity'), nullif(s.span_end, 'infinity')) AS active_span,
                     nullif(s.floor_m, '-infinity') AS floor_m, nullif(s.ceiling_m, 'infinity') AS ceiling_m,
                     s.properties, s.class, s.owner, s.activations, s.schedule FROM pg_temp.staged_area s) n
        WHERE a.scene_id = v_scene_id AND a.key = n.key
          AND (a.name, a.footprint, a.active_span, a.floor_m, a.ceiling_m, a.properties, a.class, a.owner,
               CASE WHEN a.schedule IS NULL THEN a.activations END, a.schedule)
              IS DISTINCT FROM
              (n.name, n.footprint, n.active_span, n.floor_m, n.ceiling_m, n.properties, n.class, n.owner,
               n.activations, n.schedule);
    GET DIAGNOSTICS updated = ROW_COUNT;
    UPDATE track t SET name = n.name, path = n.path, outline = n.outline, floor_m = n.floor_m,
                       ceiling_m = n.ceiling_m, floors_m = n.floors_m, ceilings_m = n.ceilings_m,
                       properties = n.properties, grow_mps = n.grow_mps, outlines = n.outlines, class = n.class,
                       owner = n.owner, tolerances = n.tolerances, departures = n.departures, schedule = n.schedule
        FROM (SELECT s.key, s.name, ST_SetSRID(s.path, 4326) AS path, s.outline,
                     nullif(s.floor_m, '-infinity') AS floor_m, nullif(s.ceiling_m, 'infinity') AS ceiling_m,
                     s.floors::double precision[] AS floors_m, s.ceilings::double precision[] AS ceilings_m,
                     s.properties, s.grow_mps, s.outlines, s.class, s.owner, s.tolerances, s.departures, s.schedule
              FROM pg_temp.staged_track s) n
        WHERE t.scene_id = v_scene_id AND t.key = n.key
          AND (t.name, t.path, t.outline, t.floor_m, t.ceiling_m, t.floors_m, t.ceilings_m, t.properties, t.grow_mps,
               t.outlines, t.class, t.owner, t.tolerances,
               CASE WHEN t.schedule IS NULL THEN t.departures END, t.schedule)
              IS DISTINCT FROM
              (n.name, n.path, n.outline, n.floor_m, n.ceiling_m, n.floors_m, n.ceilings_m, n.properties, n.grow_mps,
               n.outlines, n.class, n.owner, n.tolerances, n.departures, n.schedule);
    GET DIAGNOSTICS v_rows = ROW_COUNT;
    updated := updated + v_rows;

    -- What remains is new.
    DELETE FROM pg_temp.staged_area n USING area a WHERE a.scene_id = v_scene_id AND a.key = n.key;
    GET DIAGNOSTICS unchanged = ROW_COUNT;
    DELETE FROM pg_temp.staged_track n USING track t WHERE t.scene_id = v_scene_id AND t.key = n.key;
    GET DIAGNOSTICS v_rows = ROW_COUNT;
    added := v_total - unchanged - v_rows;
    unchanged := unchanged + v_rows - updated;
    scene_id := v_scene_id;
    SELECT s.added, s.next_page INTO stored, next_page FROM _add_staged(v_scene_id, 0) s;
    PERFORM set_config('conflictdb.max_speed_kn', coalesce(v_max_speed_kn, ''), true);
    SET CONSTRAINTS scene_holds_objects IMMEDIATE;
    SET CONSTRAINTS scene_holds_objects DEFERRED;
END
$$;
COMMENT ON FUNCTION _load(text, jsonb, boolean) IS
'Applies the staged tables to a scene; returns numbers of objects. Without p_merge, deletes objects not staged. Of the '
'objects to add, only the first part is stored yet; _add_staged(scene_id, next_page) stores the next.';

-- Reading objects back, bit for bit. WKB is little-endian on every machine; infinite means unbounded.

CREATE OR REPLACE FUNCTION conflictdb_internal._read_areas(
    p_scene_id bigint, p_keys text[], OUT area_id bigint, OUT version bigint, OUT span_start timestamptz,
    OUT span_end timestamptz, OUT floor_m double precision, OUT ceiling_m double precision, OUT has_name boolean,
    OUT footprint bytea, OUT spans bytea, OUT key text, OUT name text, OUT properties text, OUT class text,
    OUT owner text, OUT schedule text
) RETURNS SETOF record
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT a.area_id, a.version, coalesce(lower(a.active_span), '-infinity'),
           coalesce(upper(a.active_span), 'infinity'), coalesce(a.floor_m, '-infinity'),
           coalesce(a.ceiling_m, 'infinity'), a.name IS NOT NULL,
           ST_AsBinary(a.footprint, 'NDR'),
           coalesce(CASE WHEN a.schedule_error IS NULL THEN array_send(_ends_of(a.activations)) END, ''), a.key,
           coalesce(a.name, ''), a.properties::text, coalesce(a.class, ''), coalesce(a.owner, ''),
           coalesce(a.schedule::text, '')
    FROM _seen_areas(p_scene_id) a WHERE p_keys IS NULL OR a.key = ANY (p_keys)
    ORDER BY a.area_id;
END;
COMMENT ON FUNCTION _read_areas(bigint, text[]) IS
'Areas of a scene, all or those with the given keys; without nulls, for COPY. Heights in metres; empty: no class, no '
'owner, no schedule, one span only, a schedule that is not understood.';

CREATE OR REPLACE FUNCTION conflictdb_internal._read_tracks(
    p_scene_id bigint, p_keys text[], OUT track_id bigint, OUT version bigint, OUT floor_m double precision,
    OUT ceiling_m double precision, OUT has_name boolean, OUT grow_mps double precision, OUT path bytea,
    OUT outline bytea, OUT outlines bytea, OUT floors bytea, OUT ceilings bytea, OUT departures bytea, OUT key text,
    OUT name text, OUT properties text, OUT class text, OUT owner text, OUT schedule text,
    OUT tolerances text
) RETURNS SETOF record
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT t.track_id, t.version, coalesce(t.floor_m, '-infinity'), coalesce(t.ceiling_m, 'infinity'),
           t.name IS NOT NULL, t.grow_mps, ST_AsBinary(t.path, 'NDR'), ST_AsBinary(t.outline, 'NDR'),
           coalesce(ST_AsBinary(t.outlines, 'NDR'), ''), coalesce(array_send(t.floors_m), ''),
           coalesce(array_send(t.ceilings_m), ''),
           coalesce(CASE WHEN t.schedule_error IS NULL THEN array_send(t.departures) END, ''), t.key,
           coalesce(t.name, ''), t.properties::text, coalesce(t.class, ''), coalesce(t.owner, ''),
           coalesce(t.schedule::text, ''), coalesce(t.tolerances::text, '')
    FROM _seen_tracks(p_scene_id) t WHERE p_keys IS NULL OR t.key = ANY (p_keys)
    ORDER BY t.track_id;
END;
COMMENT ON FUNCTION _read_tracks(bigint, text[]) IS
'Tracks of a scene, all or those with the given keys; without nulls, for COPY. Empty: outlines if not per waypoint; '
'floors and ceilings (array_send, metres) if not per leg; class, owner, departures (also of a schedule that is not '
'understood), schedule and tolerances if there is none.';
