-- Admission: plans are put only if they conflict with nobody. One admission of a scene at a time, so that of two that
-- exclude each other exactly one is admitted. Statements that put objects directly wait for nobody; an admission sees
-- what they have committed, detected or not.

CREATE OR REPLACE FUNCTION conflictdb_internal._check_ends(p_scene_id bigint, p_keys text[]) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_days double precision := _limit('max_days_ahead');
    v_late record;
BEGIN
    IF v_days IS NULL THEN
        RETURN;
    END IF;
    -- A schedule may go on without end.
    SELECT p.* INTO v_late
        FROM (SELECT a.key, 'area' AS kind, CASE WHEN a.schedule IS NULL THEN upper(a.active_span) END AS finish
              FROM area a WHERE a.scene_id = p_scene_id AND a.key = ANY (p_keys)
              UNION ALL
              SELECT t.key, 'track',
                     CASE WHEN t.schedule IS NULL
                          THEN to_timestamp(ST_M(ST_EndPoint(t.path)))
                               + coalesce(t.departures[cardinality(t.departures)]
                                          - to_timestamp(ST_M(ST_StartPoint(t.path))), interval '0') END
              FROM track t WHERE t.scene_id = p_scene_id AND t.key = ANY (p_keys)) p
        WHERE (p.finish <= now() + v_days * interval '1 day') IS NOT TRUE LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC003', format('%s %L', v_late.kind, v_late.key), 'end',
                        format('must be at most %s days from now; got %s', v_days,
                               coalesce(v_late.finish::text, 'no end')), 'end_within_limit',
                        'conflictdb.max_days_ahead is the limit.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_ends(bigint, text[]) IS
'Raises ZC003 for an object, by its key, that ends later than the limit max_days_ahead.';

CREATE OR REPLACE FUNCTION conflictdb_internal._admission_marker() RETURNS integer
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT 1633968489; -- Arbitrary number.
END;
COMMENT ON FUNCTION _admission_marker() IS 'First key of the advisory locks that name who admits plans to a scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._begin_admission(
    p_scene text, p_wait_s double precision, p_keys text[], p_owner text, OUT scene_id bigint, OUT settings jsonb,
    OUT max_vertices integer, OUT max_waypoints integer, OUT max_days_ahead double precision, OUT replaced jsonb
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
DECLARE
    v_scene_id bigint := _scene_to_change(p_scene);
    v_named_id bigint;
    v_lock_timeout text := current_setting('lock_timeout');
BEGIN
    IF p_wait_s IS NOT NULL THEN
        PERFORM set_config('lock_timeout', greatest(1, ceil(1000 * p_wait_s))::integer::text, true);
    END IF;
    LOOP
        -- A row lock, as for detections: only roles that may change the scene can take it.
        INSERT INTO admission_lock AS l (scene_id, taken) VALUES (v_scene_id, 1)
            -- Any number changes, also one that an editor chose.
            ON CONFLICT (scene_id) DO UPDATE SET taken = l.taken # 1;
        -- Plans are put by the scene's name: it may have passed to another scene during the wait, and stays from here.
        PERFORM FROM scene s WHERE s.scene_id = v_scene_id FOR KEY SHARE;
        v_named_id := _scene_to_change(p_scene);
        EXIT WHEN v_named_id = v_scene_id;
        v_scene_id := v_named_id;
    END LOOP;
    PERFORM set_config('lock_timeout', v_lock_timeout, true);
    -- Names the holder (_admission_holders), also one in a savepoint. Excludes nobody and waits for nobody.
    PERFORM pg_try_advisory_xact_lock_shared(_admission_marker(), (v_scene_id % 2147483647)::integer);
    scene_id := v_scene_id;
    settings := _scene_settings(v_scene_id);
    max_vertices := _limit('max_vertices');
    max_waypoints := _limit('max_waypoints');
    max_days_ahead := _limit('max_days_ahead');
    replaced := coalesce((SELECT jsonb_agg(jsonb_build_array(r.kind, r.id, r.key, r.name, r.owner))
                          FROM _replaced_objects(v_scene_id, p_keys, p_owner) r), '[]');
END
$$;
COMMENT ON FUNCTION _begin_admission(text, double precision, text[], text) IS
'Takes the lock of admissions of a scene until the transaction ends; returns the scene''s id, settings and rules, '
'limits of plans, and the objects that have one of some keys or an owner, as of _replaced_objects. '
'Waits at most p_wait_s seconds (null: lock_timeout), then raises lock_not_available. A transaction with an older '
'snapshot than the last admission gets serialization_failure.';

CREATE OR REPLACE FUNCTION conflictdb_internal._admission_holders(p_scene_id bigint)
RETURNS TABLE (pid integer, application text, role text, since timestamptz)
LANGUAGE plpgsql VOLATILE STRICT SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN QUERY
    SELECT a.pid, a.application_name, coalesce(a.usename, '')::text, a.xact_start
    FROM pg_catalog.pg_stat_activity a
    WHERE a.pid <> pg_backend_pid()
      AND EXISTS (SELECT FROM pg_catalog.pg_locks l
                  WHERE l.locktype = 'advisory' AND l.granted AND l.pid = a.pid AND l.objsubid = 2
                    AND l.classid::bigint = _admission_marker() AND l.objid::bigint = p_scene_id % 2147483647
                    AND l.database = (SELECT d.oid FROM pg_catalog.pg_database d
                                      WHERE d.datname = current_database()))
    ORDER BY a.xact_start, a.pid;
END
$$;
COMMENT ON FUNCTION _admission_holders(bigint) IS
'Sessions that hold the lock of admissions of a scene, and the start of their transactions. Runs as its owner, who may '
'see more of other sessions. Restricted to sessions that hold the lock of the given scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._replaced_objects(p_scene_id bigint, p_keys text[], p_owner text)
RETURNS TABLE (kind smallint, id bigint, key text, name text, owner text)
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE ROWS 10 SET search_path FROM CURRENT
-- Planning takes longer than the rest: once per session, for many objects.
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET jit = off AS $$
BEGIN
    RETURN QUERY
        SELECT 0::smallint, a.area_id, a.key, a.name, a.owner FROM area a
        WHERE a.scene_id = p_scene_id AND a.key = ANY (p_keys)
        UNION
        SELECT 0::smallint, a.area_id, a.key, a.name, a.owner FROM area a
        WHERE a.scene_id = p_scene_id AND a.owner = p_owner
        UNION
        SELECT 1::smallint, t.track_id, t.key, t.name, t.owner FROM track t
        WHERE t.scene_id = p_scene_id AND t.key = ANY (p_keys)
        UNION
        SELECT 1::smallint, t.track_id, t.key, t.name, t.owner FROM track t
        WHERE t.scene_id = p_scene_id AND t.owner = p_owner;
END
$$;
COMMENT ON FUNCTION _replaced_objects(bigint, text[], text) IS
'Objects of a scene that have one of some keys, or an owner (null: none).';

CREATE OR REPLACE FUNCTION conflictdb_internal._objects_near(
    p_scene_id bigint, p_wanted_m double precision, p_from_us bigint, p_until_us bigint, p_kinds smallint[],
    p_numbers bigint[], p_turns integer[], p_hulls bytea[], p_starts_us bigint[], p_ends_us bigint[],
    p_inclusive boolean[], p_floors_m double precision[], p_ceilings_m double precision[]
) RETURNS TABLE (kind smallint, id bigint, key text, name text, owner text, is_stale boolean)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT
SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off SET enable_seqscan = off
-- Only plain scans mark entries of an index that nobody needs: detections leave one for each object they have seen.
SET enable_bitmapscan = off SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET jit = off AS $$
DECLARE
    v_allowed jsonb := _allowed_types(p_scene_id);
    v_is_beyond boolean := coalesce((
        SELECT _instant_of(p_from_us) < lower(s.expanded) OR _instant_of(p_until_us) > upper(s.expanded)
        FROM scene s WHERE s.scene_id = p_scene_id), false);
BEGIN
    RETURN QUERY
        WITH given AS MATERIALIZED (
            SELECT g AS piece
            FROM _given_pieces(p_scene_id, p_kinds, p_numbers, p_turns, p_hulls, p_starts_us, p_ends_us, p_inclusive,
                               p_floors_m, p_ceilings_m) g
        ), uncut AS MATERIALIZED (
            SELECT u AS piece
            FROM (SELECT range_merge(range_agg((g.piece).span)) AS span FROM given g) w
            CROSS JOIN LATERAL _uncut_pieces(p_scene_id, p_wanted_m, v_is_beyond, w.span) u
        ), near AS (
            SELECT p.object_kind, p.object_id
            FROM given g JOIN piece p ON _pieces_may_meet(g.piece, p, 0, v_allowed) AND p.scene_id = p_scene_id
            UNION
            SELECT (u.piece).object_kind, (u.piece).object_id
            FROM given g JOIN uncut u ON _pieces_may_meet(g.piece, u.piece, 0, v_allowed)
        )
        SELECT 0::smallint, a.area_id, a.key, a.name, a.owner,
               a.schedule IS NOT NULL AND (v_is_beyond OR a.activations IS NULL)
        FROM near n JOIN area a ON a.area_id = n.object_id AND a.scene_id + 0 = p_scene_id WHERE n.object_kind = 0
        UNION ALL
        SELECT 1::smallint, t.track_id, t.key, t.name, t.owner,
               t.schedule IS NOT NULL AND (v_is_beyond OR t.departures IS NULL)
        FROM near n JOIN track t ON t.track_id = n.object_id AND t.scene_id + 0 = p_scene_id WHERE n.object_kind = 1;
END
$$;
COMMENT ON FUNCTION _objects_near IS
'Objects of a scene that given pieces (_given_pieces) may meet, by the pieces of the last detection, or by rough '
'pieces if they changed since. If schedules are not expanded from p_from_us until p_until_us (microseconds; 9e18 and '
'more: no limit), also objects with a schedule that may ever be there. p_wanted_m: as of _rough_padding_m. is_stale: '
'the schedule must be expanded for that time.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scheduled_near(
    p_scene_id bigint, p_kinds smallint[], p_numbers bigint[], p_turns integer[], p_hulls bytea[], p_starts_us bigint[],
    p_ends_us bigint[], p_inclusive boolean[], p_floors_m double precision[], p_ceilings_m double precision[]
) RETURNS TABLE (key text)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_allowed jsonb := _allowed_types(p_scene_id);
BEGIN
    RETURN QUERY
        WITH uncut AS MATERIALIZED (
            SELECT u AS piece FROM _uncut_pieces(p_scene_id, _wanted_m(p_scene_id), true, '(,)') u
        ), near AS (
            SELECT DISTINCT (u.piece).object_kind, (u.piece).object_id
            FROM _given_pieces(p_scene_id, p_kinds, p_numbers, p_turns, p_hulls, p_starts_us, p_ends_us, p_inclusive,
                               p_floors_m, p_ceilings_m) g
            JOIN uncut u ON _pieces_may_meet(g, u.piece, 0, v_allowed)
        )
        SELECT k.key FROM near n
        CROSS JOIN LATERAL _keys_of(p_scene_id, ARRAY[n.object_kind], ARRAY[n.object_id]) k;
END
$$;
COMMENT ON FUNCTION _scheduled_near IS
'Keys of the objects of a scene that given pieces (_given_pieces) may meet at some time, by rough pieces: of those '
'with a schedule, and those that changed since the last detection.';

CREATE OR REPLACE FUNCTION conflictdb_internal._span_of(p_text text) RETURNS tstzrange
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_parts text[] := regexp_match(p_text, '^\s*([[(])\s*"?([^",]*?)"?\s*,\s*"?([^",]*?)"?\s*([])])\s*$');
    v_ends timestamptz[];
BEGIN
    IF v_parts IS NULL THEN
        RAISE EXCEPTION 'span: %: must be [start, end), with an empty end where it is unbounded',
            quote_literal(left(p_text, 100)) USING ERRCODE = 'ZC003';
    END IF;
    -- A cast of the whole would read instants without offset in the time zone of the session, and 'now'.
    SELECT array_agg(CASE WHEN e ~ '^-?infinity$' THEN e::timestamptz WHEN e <> '' THEN instant(e) END ORDER BY n)
        INTO v_ends FROM unnest(v_parts[2:3]) WITH ORDINALITY u (e, n);
    RETURN tstzrange(v_ends[1], v_ends[2], v_parts[1] || v_parts[4]);
END
$$;
COMMENT ON FUNCTION _span_of(text) IS
'Parses the text of a tstzrange whose instants have an offset (instant); raises ZC003 for any other text.';

CREATE OR REPLACE FUNCTION conflictdb_internal._spans_of(p_text text) RETURNS tstzmultirange
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_spans tstzrange[];
BEGIN
    IF p_text !~ '^\s*\{\s*([[(][^][()]*[])](\s*,\s*[[(][^][()]*[])])*)?\s*\}\s*$' THEN
        RAISE EXCEPTION 'spans: %: must be {[start, end), [start, end), ...}', quote_literal(left(p_text, 100))
            USING ERRCODE = 'ZC003';
    END IF;
    SELECT array_agg(_span_of(m[1])) INTO v_spans FROM regexp_matches(p_text, '[[(][^][()]*[])]', 'g') m;
    -- A multirange would lose it.
    IF 'empty' = ANY (v_spans) THEN
        RAISE EXCEPTION 'spans: %: each must end after it starts', quote_literal(left(p_text, 100))
            USING ERRCODE = 'ZC003';
    END IF;
    RETURN coalesce((SELECT range_agg(s) FROM unnest(v_spans) s), '{}');
END
$$;
COMMENT ON FUNCTION _spans_of(text) IS
'Parses the text of a tstzmultirange whose instants have an offset (_span_of); raises ZC003 for any other text.';

CREATE OR REPLACE FUNCTION conflictdb_internal._instants_of(p_instants jsonb) RETURNS timestamptz[]
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF jsonb_typeof(p_instants) = 'null' THEN
        RETURN NULL;
    END IF;
    IF jsonb_typeof(p_instants) <> 'array' THEN
        RAISE EXCEPTION 'instants: %: must be a JSON array', quote_literal(left(p_instants::text, 100))
            USING ERRCODE = 'ZC003';
    END IF;
    RETURN ARRAY(SELECT instant(coalesce(e #>> '{}', 'null'))
                 FROM jsonb_array_elements(p_instants) WITH ORDINALITY u (e, n) ORDER BY n);
END
$$;
COMMENT ON FUNCTION _instants_of(jsonb) IS
'Parses a JSON array of instants with an offset (instant); null for null. Raises ZC003 for anything else.';

CREATE OR REPLACE FUNCTION conflictdb_internal._plans_of(p_plans jsonb) RETURNS TABLE (
    key text, times timestamptz[],
    /* plan columns: NAME TYPE */
    footprint geometry, active_span tstzrange, path geometry, outline geometry, floor_m double precision,
    ceiling_m double precision, name text, properties jsonb, grow_mps double precision, outlines geometry,
    floors_m double precision[], ceilings_m double precision[], class text, owner text, tolerances jsonb,
    activations tstzmultirange, departures timestamptz[], schedule jsonb
    /* end */
)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
DECLARE
    v_given jsonb;
    v_who text;
BEGIN
    FOR v_given IN SELECT g FROM jsonb_array_elements(p_plans) g LOOP
        v_who := format('plan %L', v_given ->> 'key');
        BEGIN
            SELECT
                p.key, _instants_of(p.times),
                /* plan columns: p.NAME but active_span = _span_of(p.active_span)
                   but activations = _spans_of(p.activations) but departures = _instants_of(p.departures) */
                p.footprint, _span_of(p.active_span), p.path, p.outline, p.floor_m, p.ceiling_m, p.name, p.properties,
                p.grow_mps, p.outlines, p.floors_m, p.ceilings_m, p.class, p.owner, p.tolerances,
                _spans_of(p.activations), _instants_of(p.departures), p.schedule
                /* end */
                INTO
                key, times,
                /* plan columns: NAME */
                footprint, active_span, path, outline, floor_m, ceiling_m, name, properties, grow_mps, outlines,
                floors_m, ceilings_m, class, owner, tolerances, activations, departures, schedule
                /* end */
                FROM jsonb_to_record(v_given) p (
                    key text, times jsonb,
                    /* plan columns: NAME TYPE but active_span = active_span text
                       but activations = activations text but departures = departures jsonb */
                    footprint geometry, active_span text, path geometry, outline geometry, floor_m double precision,
                    ceiling_m double precision, name text, properties jsonb, grow_mps double precision,
                    outlines geometry, floors_m double precision[], ceilings_m double precision[], class text,
                    owner text, tolerances jsonb, activations text, departures jsonb, schedule jsonb
                    /* end */
                );
        EXCEPTION WHEN OTHERS THEN
            FOUND := _raise('ZC016', v_who, 'plan', format('cannot be read: %s', left(SQLERRM, 200)), 'plan_readable');
        END;
        -- Texts of geometries need no SRID.
        IF ST_SRID(footprint) = 0 THEN
            footprint := ST_SetSRID(footprint, 4326);
        END IF;
        IF ST_SRID(path) = 0 THEN
            path := ST_SetSRID(path, 4326);
        END IF;
        IF ST_SRID(footprint) <> 4326 OR ST_SRID(path) <> 4326 THEN
            FOUND := _raise('ZC001', v_who, 'footprint', format('must have SRID 4326; got %s',
                            coalesce(ST_SRID(footprint), ST_SRID(path))), 'footprint_srid');
        END IF;
        IF GeometryType(footprint) NOT IN ('POLYGON', 'MULTIPOLYGON') THEN
            FOUND := _raise('ZC001', v_who, 'footprint', format('must be a Polygon or MultiPolygon; got %s',
                            GeometryType(footprint)), 'footprint_polygon');
        END IF;
        IF num_nonnulls(activations, coalesce(schedule::text, active_span::text)) = 2
           AND footprint IS NOT NULL THEN
            FOUND := _raise('ZC003', v_who, 'activations',
                            'must not be given together with active_span or schedule', 'activations_once');
        END IF;
        IF times IS NOT NULL THEN
            path := _timed_path(v_who, path, times);
        ELSIF ST_Zmflag(path) IN (0, 2) THEN
            FOUND := _raise('ZC002', v_who, 'times', 'is missing: a path without M needs a time for each waypoint',
                            'path_time_per_waypoint',
                            'Give "times": ["2026-03-01T06:00:00Z", ...], or a LineStringM whose M is Unix seconds.');
        END IF;
        outline := ST_SetSRID(outline, 0);
        outlines := ST_SetSRID(outlines, 0);
        RETURN NEXT;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _plans_of(jsonb) IS
'Plans as rows, from a JSON array of objects with the parameters of put_area or put_track; geometries as GeoJSON or '
'text, times make a track_path, instants have an offset. Raises ZC016, with the plan''s key, for what cannot be read.';

CREATE OR REPLACE FUNCTION conflictdb_internal._put_plans(
    p_scene text, p_removed text[], p_plans jsonb, p_are_checked boolean, p_known text[]
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_max_speed_kn text := current_setting('conflictdb.max_speed_kn', true);
    v_scene_id bigint := _scene_to_change(p_scene);
    v_plan record;
    v_new text[];
    v_taken text;
BEGIN
    IF p_are_checked THEN
        PERFORM set_config('conflictdb.max_speed_kn', 'infinity', true);
    END IF;
    PERFORM remove_object(p_scene, k) FROM unnest(p_removed) k;
    -- One statement for all areas, whose triggers run once; otherwise as put_area.
    INSERT INTO area AS a (
        scene_id, key,
        /* area columns: NAME */
        footprint, active_span, floor_m, ceiling_m, name, properties, class, owner, activations, schedule
        /* end */
    ) SELECT
        v_scene_id, p.key,
        /* area columns: p.NAME but footprint = ST_Multi(ST_Force2D(p.footprint))
           but active_span = coalesce(p.active_span,
                                      CASE WHEN NOT isempty(p.activations) THEN range_merge(p.activations) END) */
        ST_Multi(ST_Force2D(p.footprint)),
        coalesce(p.active_span, CASE WHEN NOT isempty(p.activations) THEN range_merge(p.activations) END), p.floor_m,
        p.ceiling_m, p.name, p.properties, p.class, p.owner, p.activations, p.schedule
        /* end */
        FROM _plans_of((SELECT jsonb_agg(g) FROM jsonb_array_elements(p_plans) g
                        WHERE g ->> 'footprint' IS NOT NULL)) p
        ON CONFLICT (scene_id, key) DO UPDATE SET
        /* area columns: NAME = excluded.NAME */
        footprint = excluded.footprint, active_span = excluded.active_span, floor_m = excluded.floor_m,
        ceiling_m = excluded.ceiling_m, name = excluded.name, properties = excluded.properties, class = excluded.class,
        owner = excluded.owner, activations = excluded.activations, schedule = excluded.schedule
        /* end */
        WHERE (
            /* area columns: WRITTEN(a) */
            a.footprint, a.active_span, a.floor_m, a.ceiling_m, a.name, a.properties, a.class, a.owner,
            CASE WHEN a.schedule IS NULL THEN a.activations END, a.schedule
            /* end */
        ) IS DISTINCT FROM (
            /* area columns: excluded.NAME */
            excluded.footprint, excluded.active_span, excluded.floor_m, excluded.ceiling_m, excluded.name,
            excluded.properties, excluded.class, excluded.owner, excluded.activations, excluded.schedule
            /* end */
        );
    FOR v_plan IN SELECT p.* FROM _plans_of((SELECT jsonb_agg(g) FROM jsonb_array_elements(p_plans) g
                                             WHERE g ->> 'footprint' IS NULL)) p LOOP
        PERFORM put_track(
            p_scene, v_plan.key,
            /* track columns: p_NAME => v_plan.NAME */
            p_path => v_plan.path, p_outline => v_plan.outline, p_floor_m => v_plan.floor_m,
            p_ceiling_m => v_plan.ceiling_m, p_name => v_plan.name, p_properties => v_plan.properties,
            p_grow_mps => v_plan.grow_mps, p_outlines => v_plan.outlines, p_floors_m => v_plan.floors_m,
            p_ceilings_m => v_plan.ceilings_m, p_class => v_plan.class, p_owner => v_plan.owner,
            p_tolerances => v_plan.tolerances, p_departures => v_plan.departures, p_schedule => v_plan.schedule
            /* end */
        );
    END LOOP;
    PERFORM set_config('conflictdb.max_speed_kn', coalesce(v_max_speed_kn, ''), true);
    -- An object that was put after p_known was read, by a statement that waits for no admission: it was updated above.
    v_new := ARRAY(SELECT g ->> 'key' FROM jsonb_array_elements(p_plans) g WHERE g ->> 'key' <> ALL (p_known));
    SELECT o.key INTO v_taken
        FROM (SELECT a.key FROM area a
              WHERE a.scene_id = v_scene_id AND a.key = ANY (v_new) AND a.version <> a.first_version
              UNION ALL
              SELECT t.key FROM track t
              WHERE t.scene_id = v_scene_id AND t.key = ANY (v_new) AND t.version <> t.first_version) o LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC007', format('plan %L', v_taken), 'key', 'belongs to an object of the scene',
                        'plan_key_taken', 'It was put just now; choose another key, or replace it.');
    END IF;
END
$$;
COMMENT ON FUNCTION _put_plans(text, text[], jsonb, boolean, text[]) IS
'Removes objects by key, then puts plans (_plans_of). p_are_checked: conflictdb.model has checked speeds, under the '
'limit of each plan. p_known: keys of the objects that plans may replace; raises ZC007 for others.';

CREATE OR REPLACE FUNCTION conflictdb_internal._need_schedules(p_scene_id bigint, p_keys text[]) RETURNS boolean
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_expanded tstzrange := (SELECT s.expanded FROM scene s WHERE s.scene_id = p_scene_id);
    v_within_s double precision := _longest_time_s(p_scene_id);
BEGIN
    RETURN EXISTS (
        SELECT FROM (SELECT a.schedule, _widened(a.active_span, v_within_s) AS span FROM area a
                     WHERE a.scene_id = p_scene_id AND a.key = ANY (p_keys)
                     UNION ALL
                     SELECT t.schedule, _under_way(t.path, t.departures, t.tolerances, v_within_s) FROM track t
                     WHERE t.scene_id = p_scene_id AND t.key = ANY (p_keys)) p
        -- Expanded until an instant: without it.
        WHERE p.schedule IS NOT NULL OR lower(p.span) < lower(v_expanded) OR upper(p.span) >= upper(v_expanded)
              OR lower(p.span) >= upper(v_expanded) OR upper(p.span) <= lower(v_expanded));
END
$$;
COMMENT ON FUNCTION _need_schedules(bigint, text[]) IS
'Whether objects of a scene, by their keys, have schedules, or may meet others when no schedule is expanded.';
