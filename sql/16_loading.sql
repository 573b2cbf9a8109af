-- Bulk loading: the store COPYs objects into temporary tables; `_load` applies them to the scene, `_add_staged` adds
-- the rest of the new ones, in the same transaction. Unchanged rows keep their version and get no mark.

CREATE OR REPLACE FUNCTION conflictdb_internal._begin_load() RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET client_min_messages = warning AS $$
BEGIN
    CREATE TEMPORARY TABLE IF NOT EXISTS staged_area (
        key text COLLATE "C",
        /* area columns: TEMPORARY */
        footprint geometry, span_start timestamptz, span_end timestamptz, floor_m double precision,
        ceiling_m double precision, name text, properties jsonb, class text, owner text, activations tstzmultirange,
        schedule jsonb
        /* end */
    ) ON COMMIT DROP;
    CREATE TEMPORARY TABLE IF NOT EXISTS staged_track (
        key text COLLATE "C",
        /* track columns: TEMPORARY */
        path geometry, outline geometry, floor_m double precision, ceiling_m double precision, name text,
        properties jsonb, grow_mps double precision, outlines geometry, floors_m text, ceilings_m text, class text,
        owner text, tolerances jsonb, departures timestamptz[], schedule jsonb
        /* end */
    ) ON COMMIT DROP;
    TRUNCATE pg_temp.staged_area, pg_temp.staged_track;
END
$$;
COMMENT ON FUNCTION _begin_load() IS
'Creates the temporary tables staged_area and staged_track, empty, for this transaction. '
'Infinite instants mean unbounded, a number NaN none.';

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
    INSERT INTO area (
        scene_id, key,
        /* area columns: NAME */
        footprint, active_span, floor_m, ceiling_m, name, properties, class, owner, activations, schedule
        /* end */
    ) SELECT
        p_scene_id, s.key,
        /* area columns: STAGED(s) */
        ST_SetSRID(s.footprint, 4326), tstzrange(nullif(s.span_start, '-infinity'), nullif(s.span_end, 'infinity')),
        nullif(s.floor_m, 'NaN'), nullif(s.ceiling_m, 'NaN'), s.name, s.properties, s.class, s.owner, s.activations,
        s.schedule
        /* end */
        FROM pg_temp.staged_area s WHERE s.ctid >= v_first AND s.ctid < v_end
        -- In the order given: objects are listed by id.
        ORDER BY s.ctid;
    GET DIAGNOSTICS added = ROW_COUNT;
    INSERT INTO track (
        scene_id, key,
        /* track columns: NAME */
        path, outline, floor_m, ceiling_m, name, properties, grow_mps, outlines, floors_m, ceilings_m, class, owner,
        tolerances, departures, schedule
        /* end */
    ) SELECT
        p_scene_id, s.key,
        /* track columns: STAGED(s) */
        ST_SetSRID(s.path, 4326), s.outline, nullif(s.floor_m, 'NaN'), nullif(s.ceiling_m, 'NaN'), s.name, s.properties,
        nullif(s.grow_mps, 'NaN'), s.outlines, s.floors_m::double precision[], s.ceilings_m::double precision[],
        s.class, s.owner, s.tolerances, s.departures, s.schedule
        /* end */
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
    v_same bigint := 0;
    v_changed bigint := 0;
BEGIN
    IF NOT p_merge AND _parent_of(v_scene_id) IS NOT NULL THEN
        PERFORM _scene_id(p_name);
    END IF;
    -- conflictdb.model has already checked speeds, under the limit of this load.
    PERFORM set_config('conflictdb.max_speed_kn', 'infinity', true);
    -- Serialise loads of one scene.
    PERFORM FROM scene s WHERE s.scene_id = v_scene_id FOR NO KEY UPDATE;
    ANALYZE pg_temp.staged_area (key);
    ANALYZE pg_temp.staged_track (key);
    SELECT k.key INTO v_key
        FROM (SELECT a.key FROM pg_temp.staged_area a UNION ALL SELECT t.key FROM pg_temp.staged_track t) k
        GROUP BY k.key HAVING count(*) > 1 ORDER BY k.key LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC007', format('object %L', v_key), 'key', 'is given twice', 'object_key_unique');
    END IF;
    SELECT (SELECT count(*) FROM pg_temp.staged_area) + (SELECT count(*) FROM pg_temp.staged_track) INTO v_total;

    -- Delete first: a key may pass from an area to a track.
    IF p_merge THEN
        -- By the staged keys: a merge of few objects reads few of the scene's.
        DELETE FROM area a USING pg_temp.staged_track n WHERE a.scene_id = v_scene_id AND a.key = n.key;
        GET DIAGNOSTICS removed = ROW_COUNT;
        DELETE FROM track t USING pg_temp.staged_area n WHERE t.scene_id = v_scene_id AND t.key = n.key;
    ELSE
        -- By a table of hashes: for a scene that statistics do not know, NOT EXISTS compares all keys with all.
        DELETE FROM area a WHERE a.scene_id = v_scene_id
            AND (EXISTS (SELECT FROM pg_temp.staged_area n WHERE n.key = a.key)) IS FALSE;
        GET DIAGNOSTICS removed = ROW_COUNT;
        DELETE FROM track t WHERE t.scene_id = v_scene_id
            AND (EXISTS (SELECT FROM pg_temp.staged_track n WHERE n.key = t.key)) IS FALSE;
    END IF;
    GET DIAGNOSTICS v_rows = ROW_COUNT;
    removed := removed + v_rows;

    UPDATE area a SET
        /* area columns: NAME = n.NAME */
        footprint = n.footprint, active_span = n.active_span, floor_m = n.floor_m, ceiling_m = n.ceiling_m,
        name = n.name, properties = n.properties, class = n.class, owner = n.owner, activations = n.activations,
        schedule = n.schedule
        /* end */
        FROM (
            SELECT
                s.key,
                /* area columns: STAGED(s) AS NAME */
                ST_SetSRID(s.footprint, 4326) AS footprint,
                tstzrange(nullif(s.span_start, '-infinity'), nullif(s.span_end, 'infinity')) AS active_span,
                nullif(s.floor_m, 'NaN') AS floor_m, nullif(s.ceiling_m, 'NaN') AS ceiling_m, s.name AS name,
                s.properties AS properties, s.class AS class, s.owner AS owner, s.activations AS activations,
                s.schedule AS schedule
                /* end */
            FROM pg_temp.staged_area s
        ) n
        WHERE a.scene_id = v_scene_id AND a.key = n.key AND (
            /* area columns: WRITTEN(a) */
            a.footprint, a.active_span, a.floor_m, a.ceiling_m, a.name, a.properties, a.class, a.owner,
            CASE WHEN a.schedule IS NULL THEN a.activations END, a.schedule
            /* end */
        ) IS DISTINCT FROM (
            /* area columns: n.NAME */
            n.footprint, n.active_span, n.floor_m, n.ceiling_m, n.name, n.properties, n.class, n.owner, n.activations,
            n.schedule
            /* end */
        );
    GET DIAGNOSTICS updated = ROW_COUNT;
    UPDATE track t SET
        /* track columns: NAME = n.NAME */
        path = n.path, outline = n.outline, floor_m = n.floor_m, ceiling_m = n.ceiling_m, name = n.name,
        properties = n.properties, grow_mps = n.grow_mps, outlines = n.outlines, floors_m = n.floors_m,
        ceilings_m = n.ceilings_m, class = n.class, owner = n.owner, tolerances = n.tolerances,
        departures = n.departures, schedule = n.schedule
        /* end */
        FROM (
            SELECT
                s.key,
                /* track columns: STAGED(s) AS NAME */
                ST_SetSRID(s.path, 4326) AS path, s.outline AS outline, nullif(s.floor_m, 'NaN') AS floor_m,
                nullif(s.ceiling_m, 'NaN') AS ceiling_m, s.name AS name, s.properties AS properties,
                nullif(s.grow_mps, 'NaN') AS grow_mps, s.outlines AS outlines,
                s.floors_m::double precision[] AS floors_m, s.ceilings_m::double precision[] AS ceilings_m,
                s.class AS class, s.owner AS owner, s.tolerances AS tolerances, s.departures AS departures,
                s.schedule AS schedule
                /* end */
            FROM pg_temp.staged_track s
        ) n
        WHERE t.scene_id = v_scene_id AND t.key = n.key AND (
            /* track columns: WRITTEN(t) */
            t.path, t.outline, t.floor_m, t.ceiling_m, t.name, t.properties, t.grow_mps, t.outlines, t.floors_m,
            t.ceilings_m, t.class, t.owner, t.tolerances, CASE WHEN t.schedule IS NULL THEN t.departures END, t.schedule
            /* end */
        ) IS DISTINCT FROM (
            /* track columns: n.NAME */
            n.path, n.outline, n.floor_m, n.ceiling_m, n.name, n.properties, n.grow_mps, n.outlines, n.floors_m,
            n.ceilings_m, n.class, n.owner, n.tolerances, n.departures, n.schedule
            /* end */
        );
    GET DIAGNOSTICS v_rows = ROW_COUNT;
    updated := updated + v_rows;

    -- What remains is new.
    DELETE FROM pg_temp.staged_area n USING area a WHERE a.scene_id = v_scene_id AND a.key = n.key;
    GET DIAGNOSTICS unchanged = ROW_COUNT;
    DELETE FROM pg_temp.staged_track n USING track t WHERE t.scene_id = v_scene_id AND t.key = n.key;
    GET DIAGNOSTICS v_rows = ROW_COUNT;
    added := v_total - unchanged - v_rows;
    unchanged := unchanged + v_rows - updated;
    IF _parent_of(v_scene_id) IS NOT NULL THEN
        -- Of the parent's objects that the branch shows: the same ones need no edit, others are changed by it.
        WITH staged AS MATERIALIZED (
            SELECT s.key FROM pg_temp.staged_area s UNION ALL SELECT s.key FROM pg_temp.staged_track s
        ), seen_area AS MATERIALIZED (
            SELECT a.* FROM _seen_areas(v_scene_id) a WHERE a.key IN (SELECT k.key FROM staged k)
        ), seen_track AS MATERIALIZED (
            SELECT t.* FROM _seen_tracks(v_scene_id) t WHERE t.key IN (SELECT k.key FROM staged k)
        ), same_area AS (
            DELETE FROM pg_temp.staged_area s USING seen_area a WHERE a.key = s.key AND (
                /* area columns: WRITTEN(a) */
                a.footprint, a.active_span, a.floor_m, a.ceiling_m, a.name, a.properties, a.class, a.owner,
                CASE WHEN a.schedule IS NULL THEN a.activations END, a.schedule
                /* end */
            ) IS NOT DISTINCT FROM (
                /* area columns: STAGED(s) */
                ST_SetSRID(s.footprint, 4326),
                tstzrange(nullif(s.span_start, '-infinity'), nullif(s.span_end, 'infinity')), nullif(s.floor_m, 'NaN'),
                nullif(s.ceiling_m, 'NaN'), s.name, s.properties, s.class, s.owner, s.activations, s.schedule
                /* end */
            )
            RETURNING s.key
        ), same_track AS (
            DELETE FROM pg_temp.staged_track s USING seen_track t WHERE t.key = s.key AND (
                /* track columns: WRITTEN(t) */
                t.path, t.outline, t.floor_m, t.ceiling_m, t.name, t.properties, t.grow_mps, t.outlines, t.floors_m,
                t.ceilings_m, t.class, t.owner, t.tolerances, CASE WHEN t.schedule IS NULL THEN t.departures END,
                t.schedule
                /* end */
            ) IS NOT DISTINCT FROM (
                /* track columns: STAGED(s) */
                ST_SetSRID(s.path, 4326), s.outline, nullif(s.floor_m, 'NaN'), nullif(s.ceiling_m, 'NaN'), s.name,
                s.properties, nullif(s.grow_mps, 'NaN'), s.outlines, s.floors_m::double precision[],
                s.ceilings_m::double precision[], s.class, s.owner, s.tolerances, s.departures, s.schedule
                /* end */
            )
            RETURNING s.key
        )
        SELECT (SELECT count(*) FROM same_area) + (SELECT count(*) FROM same_track),
               (SELECT count(*) FROM seen_area) + (SELECT count(*) FROM seen_track)
            INTO v_same, v_changed;
        v_changed := v_changed - v_same;
        added := added - v_same - v_changed;
        updated := updated + v_changed;
        unchanged := unchanged + v_same;
    END IF;
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
    OUT span_end timestamptz,
    /* area numbers: OUT NAME double precision, */
    OUT floor_m double precision, OUT ceiling_m double precision,
    /* end */
    /* area bytes: OUT NAME bytea, */
    OUT footprint bytea, OUT activations bytea,
    /* end */
    OUT key text, OUT properties text,
    /* area strings: OUT NAME text */
    OUT name text, OUT class text, OUT owner text, OUT schedule text
    /* end */
) RETURNS SETOF record
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT a.area_id, a.version, coalesce(lower(a.active_span), '-infinity'),
           coalesce(upper(a.active_span), 'infinity'),
           /* area numbers: SENT(a), */
           coalesce(a.floor_m, 'NaN'), coalesce(a.ceiling_m, 'NaN'),
           /* end */
           /* area bytes: SENT(a), */
           ST_AsBinary(a.footprint, 'NDR'),
           coalesce(CASE WHEN a.schedule_error IS NULL THEN array_send(_ends_of(a.activations)) END, ''),
           /* end */
           a.key, a.properties::text,
           /* area strings: SENT(a) */
           coalesce(to_jsonb(a.name)::text, ''), coalesce(a.class, ''), coalesce(a.owner, ''),
           coalesce(a.schedule::text, '')
           /* end */
    FROM _seen_areas(p_scene_id) a WHERE p_keys IS NULL OR a.key = ANY (p_keys)
    ORDER BY a.area_id;
END;
COMMENT ON FUNCTION _read_areas(bigint, text[]) IS
'Areas of a scene, all or those with the given keys; without nulls, for COPY. Heights in metres, NaN: none; names are '
'JSON; empty: no name, no class, no owner, no schedule, one span only, a schedule that is not understood.';

CREATE OR REPLACE FUNCTION conflictdb_internal._read_tracks(
    p_scene_id bigint, p_keys text[], OUT track_id bigint, OUT version bigint,
    /* track numbers: OUT NAME double precision, */
    OUT floor_m double precision, OUT ceiling_m double precision, OUT grow_mps double precision,
    /* end */
    /* track bytes: OUT NAME bytea, */
    OUT path bytea, OUT outline bytea, OUT outlines bytea, OUT floors_m bytea, OUT ceilings_m bytea,
    OUT departures bytea,
    /* end */
    OUT key text, OUT properties text,
    /* track strings: OUT NAME text */
    OUT name text, OUT class text, OUT owner text, OUT tolerances text, OUT schedule text
    /* end */
) RETURNS SETOF record
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT t.track_id, t.version,
           /* track numbers: SENT(t), */
           coalesce(t.floor_m, 'NaN'), coalesce(t.ceiling_m, 'NaN'), coalesce(t.grow_mps, 'NaN'),
           /* end */
           /* track bytes: SENT(t), */
           ST_AsBinary(t.path, 'NDR'), ST_AsBinary(t.outline, 'NDR'), coalesce(ST_AsBinary(t.outlines, 'NDR'), ''),
           coalesce(array_send(t.floors_m), ''), coalesce(array_send(t.ceilings_m), ''),
           coalesce(CASE WHEN t.schedule_error IS NULL THEN array_send(t.departures) END, ''),
           /* end */
           t.key, t.properties::text,
           /* track strings: SENT(t) */
           coalesce(to_jsonb(t.name)::text, ''), coalesce(t.class, ''), coalesce(t.owner, ''),
           coalesce(t.tolerances::text, ''), coalesce(t.schedule::text, '')
           /* end */
    FROM _seen_tracks(p_scene_id) t WHERE p_keys IS NULL OR t.key = ANY (p_keys)
    ORDER BY t.track_id;
END;
COMMENT ON FUNCTION _read_tracks(bigint, text[]) IS
'Tracks of a scene, all or those with the given keys; without nulls, for COPY. Numbers NaN: none; names are JSON. '
'Empty: outlines if not per waypoint; floors_m and ceilings_m (array_send) if not per leg; departures (also of a '
'schedule that is not understood), and texts and documents if there is none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._sampled_keys(p_scene_id bigint, p_most integer) RETURNS text[]
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(array_agg(s.key), '{}')
    FROM ((SELECT a.key FROM _seen_areas(p_scene_id) a ORDER BY hashtext(a.key) LIMIT p_most)
          UNION ALL
          (SELECT t.key FROM _seen_tracks(p_scene_id) t ORDER BY hashtext(t.key) LIMIT p_most)) s;
END;
COMMENT ON FUNCTION _sampled_keys(bigint, integer) IS
'Keys of at most p_most areas and p_most tracks of a scene, spread over all keys; the same at each call.';
