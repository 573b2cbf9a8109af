-- Write-back: one transaction replaces the conflicts of every pair with a dirty member, records the run and deletes the
-- covered marks. After a crash either nothing of it happened or all.

CREATE OR REPLACE FUNCTION _next_owner(p_kind smallint, p_id bigint, p_version bigint) RETURNS bigint
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(CASE p_kind WHEN 0 THEN (SELECT a.first_version FROM area a
                                             WHERE a.area_id = p_id AND a.first_version > p_version)
                                ELSE (SELECT t.first_version FROM track t
                                      WHERE t.track_id = p_id AND t.first_version > p_version) END,
                    9223372036854775807);
END;
COMMENT ON FUNCTION _next_owner(smallint, bigint, bigint) IS
'First version of the object that has a number now, if the one that a version is of had it before; else the largest '
'number.';

CREATE OR REPLACE FUNCTION _conflict_region(
    p_scene_id bigint, p_a_kind smallint, p_a_id bigint, p_a_version bigint, p_b_kind smallint, p_b_id bigint,
    p_b_version bigint, p_periods tstzmultirange, p_plane text
) RETURNS geometry
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT
-- Planning for each pair anew takes ten times as long as doing it.
SET plan_cache_mode = force_generic_plan AS $$
DECLARE
    v_turn_m double precision := 2 * pi() * _radius_m(p_plane);
    -- Pieces from these versions on are those of other objects.
    v_a_until bigint := _next_owner(p_a_kind, p_a_id, p_a_version);
    v_b_until bigint := _next_owner(p_b_kind, p_b_id, p_b_version);
    v_region geometry;
BEGIN
    -- Parts may lie on both sides of the seam: each is brought to longitude and latitude by itself. OFFSET 0 lets each
    -- step be computed once.
    IF p_a_kind = 0 AND p_b_kind = 0 THEN
        SELECT ST_Union(d.part ORDER BY d.nr)
            INTO v_region
            FROM (SELECT _part_from_plane(m.part, p_plane) AS part, m.nr
                  FROM (SELECT ST_Intersection(ST_Translate(a.shape, a.turn * v_turn_m, 0),
                                               ST_Translate(b.shape, b.turn * v_turn_m, 0)) AS part,
                               (a.part, a.turn, b.part, b.turn) AS nr
                        FROM piece a JOIN piece b ON b.hull && a.hull
                        WHERE a.object_kind = p_a_kind AND a.object_id = p_a_id
                          AND b.object_kind = p_b_kind AND b.object_id = p_b_id AND (a.turn = 0 OR b.turn = 0)
                          AND a.scene_id + 0 = p_scene_id AND a.version < v_a_until
                          AND b.scene_id + 0 = p_scene_id AND b.version < v_b_until
                        OFFSET 0) m
                  WHERE NOT ST_IsEmpty(m.part) OFFSET 0) d;
    END IF;
    IF v_region IS NULL THEN
        -- Hulls are padded: polygons that are only nearer than the separation meet in them.
        SELECT ST_Union(d.part ORDER BY d.nr)
            INTO v_region
            FROM (SELECT _part_from_plane(m.part, p_plane) AS part, m.nr
                  FROM (SELECT ST_Intersection(a.hull, b.hull) AS part, (a.part, a.turn, b.part, b.turn) AS nr
                        FROM piece a JOIN piece b ON b.hull && a.hull AND b.span && a.span
                        WHERE a.object_kind = p_a_kind AND a.object_id = p_a_id
                          AND b.object_kind = p_b_kind AND b.object_id = p_b_id AND (a.turn = 0 OR b.turn = 0)
                          AND a.scene_id + 0 = p_scene_id AND a.version < v_a_until
                          AND b.scene_id + 0 = p_scene_id AND b.version < v_b_until
                          AND p_periods && (a.span * b.span)
                        OFFSET 0) m
                  WHERE NOT ST_IsEmpty(m.part) OFFSET 0) d;
    END IF;
    RETURN v_region;
END
$$;
COMMENT ON FUNCTION _conflict_region(
    bigint, smallint, bigint, bigint, smallint, bigint, bigint, tstzmultirange, text) IS
'Where two objects interfere, longitude and latitude: two areas, the intersection of their footprints; else a '
'superset, the intersection of what they sweep while in conflict. From their current pieces, where a detection did '
'not find it out: great circles, and what could not be cut or solved.';

CREATE OR REPLACE FUNCTION _begin_write() RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET client_min_messages = warning AS $$
BEGIN
    PERFORM _require_snapshot();
    DROP TABLE IF EXISTS pg_temp.found;
    CREATE TEMPORARY TABLE found (
        a_kind smallint, a_id bigint, a_version bigint, b_kind smallint, b_id bigint, b_version bigint,
        periods tstzmultirange, verdict text, region geometry, first_contact_point geometry,
        time_error_s double precision, closest_at timestamptz, closest_m double precision,
        closest_error_m double precision, closest_a_point geometry, closest_b_point geometry
    ) ON COMMIT DROP;
END
$$;
COMMENT ON FUNCTION _begin_write() IS
'Creates the temporary table found for the results of a detection: columns of the table conflict, each pair once, a '
'being the object of the smaller kind and number.';

CREATE OR REPLACE FUNCTION _write_run(
    p_scene_id bigint, p_run jsonb, OUT run_id bigint, OUT opened bigint, OUT changed bigint, OUT closed bigint,
    OUT conflicts bigint, OUT unresolved bigint
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
DECLARE
    -- Beyond so many changed objects, reading all conflicts of the scene costs less than looking up those of each.
    c_few CONSTANT integer := 1000;
    v_start timestamptz := clock_timestamp();
    v_method text := p_run ->> 'method';
    v_scene_name text;
    v_plane text;
    v_run_id bigint;
    v_last run%ROWTYPE;
    v_kinds smallint[];
    v_ids bigint[];
    v_is_many boolean;
    v_is_as_before boolean;
    v_more bigint;
    v_more_unresolved bigint;
BEGIN
    SELECT s.name, _plane(s.motion, s.earth, s.centre_lon, s.centre_lat) INTO STRICT v_scene_name, v_plane
        FROM scene s WHERE s.scene_id = p_scene_id;
    SELECT r.* INTO v_last FROM run r WHERE r.scene_id = p_scene_id AND r.error IS NULL ORDER BY r.run_id DESC LIMIT 1;
    SELECT bool_and(v_last.settings -> s.name IS NOT DISTINCT FROM p_run -> 'settings' -> s.name) INTO v_is_as_before
        FROM unnest(ARRAY['motion', 'earth', 'centre', 'tolerance_m', 'separation_m', 'nearest_m']) s (name);
    -- First: its reference to the scene keeps that from being removed meanwhile, which conflicts do without. Counts
    -- that the writing below finds out are filled in at the end.
    INSERT INTO run (scene_id, started_at, finished_at, method, settings, objects, candidate_pairs,
                     intersecting_pairs, window_pairs, solved_pairs, conflicts, unresolved, pieces_s, stage1_s,
                     stage2_s, stage3_s, stage4_s)
        SELECT p_scene_id, r.started_at, clock_timestamp(), v_method, r.settings,
               (SELECT count(*) FROM area a WHERE a.scene_id = p_scene_id)
               + (SELECT count(*) FROM track t WHERE t.scene_id = p_scene_id),
               r.candidate_pairs, r.intersecting_pairs, r.window_pairs, r.solved_pairs, 0, r.unresolved,
               r.pieces_s, r.stage1_s, r.stage2_s, r.stage3_s, r.stage4_s
        FROM jsonb_populate_record(NULL::run, p_run) r
        RETURNING run.run_id INTO v_run_id;
    SELECT array_agg(d.object_kind), array_agg(d.object_id) INTO v_kinds, v_ids
        FROM (SELECT DISTINCT m.object_kind, m.object_id FROM change m
              WHERE m.scene_id = p_scene_id AND m.is_covered) d;
    v_is_many := cardinality(v_ids) > c_few;

    WITH dirty AS (
        SELECT d.kind, d.id FROM unnest(v_kinds, v_ids) d (kind, id)
    ), known AS (
        SELECT c.ctid AS place, c.* FROM conflict c
        WHERE v_is_many AND c.scene_id = p_scene_id
          -- Looked up in the index where there are more than a table of hashes may hold.
          AND (EXISTS (SELECT FROM change m WHERE m.scene_id = p_scene_id AND m.is_covered
                       AND m.object_kind = c.a_kind AND m.object_id = c.a_id)
               OR EXISTS (SELECT FROM change m WHERE m.scene_id = p_scene_id AND m.is_covered
                          AND m.object_kind = c.b_kind AND m.object_id = c.b_id))
        UNION ALL
        SELECT c.ctid, c.* FROM dirty d JOIN conflict c ON c.a_kind = d.kind AND c.a_id = d.id
        WHERE NOT v_is_many AND c.scene_id + 0 = p_scene_id
        UNION ALL
        SELECT c.ctid, c.* FROM dirty d JOIN conflict c ON c.b_kind = d.kind AND c.b_id = d.id
        WHERE NOT v_is_many AND c.scene_id + 0 = p_scene_id
          AND (c.a_kind, c.a_id) NOT IN (SELECT n.kind, n.id FROM dirty n)
    ), old AS (
        -- As found is: the smaller kind and number first, which the smaller key need not have.
        SELECT k.place, k.periods, k.verdict, k.region, k.first_contact_point, k.time_error_s, k.closest_at,
               k.closest_m, k.closest_error_m, k.method, k.found_at,
               CASE WHEN t.is_turned THEN k.b_kind ELSE k.a_kind END AS a_kind,
               CASE WHEN t.is_turned THEN k.b_id ELSE k.a_id END AS a_id,
               CASE WHEN t.is_turned THEN k.b_version ELSE k.a_version END AS a_version,
               CASE WHEN t.is_turned THEN k.a_kind ELSE k.b_kind END AS b_kind,
               CASE WHEN t.is_turned THEN k.a_id ELSE k.b_id END AS b_id,
               CASE WHEN t.is_turned THEN k.a_version ELSE k.b_version END AS b_version,
               CASE WHEN t.is_turned THEN k.closest_b_point ELSE k.closest_a_point END AS closest_a_point,
               CASE WHEN t.is_turned THEN k.closest_a_point ELSE k.closest_b_point END AS closest_b_point
        FROM known k CROSS JOIN LATERAL (SELECT (k.b_kind, k.b_id) < (k.a_kind, k.a_id) AS is_turned) t
    ), difference AS (
        -- Versions too: where they are the same, the objects are, and their keys.
        SELECT f.*, o.place, o.found_at, o.periods AS old_periods, o.verdict AS old_verdict,
               o.a_version AS old_a_version, o.b_version AS old_b_version
        FROM pg_temp.found f FULL JOIN old o USING (a_kind, a_id, b_kind, b_id)
        WHERE f.verdict IS NULL OR o.place IS NULL
           -- Where that is not known it follows from the rest, and from the settings.
           OR (f.a_version, f.b_version, f.periods, f.verdict,
               CASE WHEN v_is_as_before THEN coalesce(f.region, o.region) ELSE f.region END, f.first_contact_point,
               f.time_error_s, f.closest_at, f.closest_m, f.closest_error_m, f.closest_a_point, f.closest_b_point,
               v_method)
              IS DISTINCT FROM
              (o.a_version, o.b_version, o.periods, o.verdict, o.region, o.first_contact_point,
               o.time_error_s, o.closest_at, o.closest_m, o.closest_error_m, o.closest_a_point, o.closest_b_point,
               o.method)
    ), placed AS MATERIALIZED (
        -- The area first, else the smaller key. An object that was removed meanwhile has a mark of its own, and its
        -- pairs drop out; its number may be that of another object by now.
        SELECT d.*, m.a_key, m.b_key, m.is_found, (d.b_kind, m.b_key) < (d.a_kind, m.a_key) AS is_turned,
               d.place IS NOT NULL AND m.is_found AND m.a_first_version <= d.old_a_version
                   AND m.b_first_version <= d.old_b_version AS stays
        FROM difference d
        LEFT JOIN area aa ON d.a_kind = 0 AND aa.area_id = d.a_id
        LEFT JOIN track ta ON d.a_kind = 1 AND ta.track_id = d.a_id
        LEFT JOIN area ab ON d.b_kind = 0 AND ab.area_id = d.b_id
        LEFT JOIN track tb ON d.b_kind = 1 AND tb.track_id = d.b_id
        CROSS JOIN LATERAL (
            SELECT coalesce(aa.key, ta.key) AS a_key, coalesce(ab.key, tb.key) AS b_key,
                   coalesce(aa.first_version, ta.first_version) AS a_first_version,
                   coalesce(ab.first_version, tb.first_version) AS b_first_version,
                   (coalesce(aa.scene_id, ta.scene_id) = p_scene_id AND coalesce(ab.scene_id, tb.scene_id) = p_scene_id
                    AND coalesce(aa.first_version, ta.first_version) <= d.a_version
                    AND coalesce(ab.first_version, tb.first_version) <= d.b_version) IS TRUE AS is_found
        ) m
    ), removed AS (
        DELETE FROM conflict c USING placed p WHERE c.ctid = p.place AND NOT p.is_found
    ), ordered AS NOT MATERIALIZED (
        SELECT p.place, p.stays, p.periods, p.verdict, p.region, p.first_contact_point, p.time_error_s, p.closest_at,
               p.closest_m, p.closest_error_m,
               CASE WHEN p.is_turned THEN p.b_kind ELSE p.a_kind END AS a_kind,
               CASE WHEN p.is_turned THEN p.b_id ELSE p.a_id END AS a_id,
               CASE WHEN p.is_turned THEN p.b_version ELSE p.a_version END AS a_version,
               CASE WHEN p.is_turned THEN p.b_key ELSE p.a_key END AS a_key,
               CASE WHEN p.is_turned THEN p.a_kind ELSE p.b_kind END AS b_kind,
               CASE WHEN p.is_turned THEN p.a_id ELSE p.b_id END AS b_id,
               CASE WHEN p.is_turned THEN p.a_version ELSE p.b_version END AS b_version,
               CASE WHEN p.is_turned THEN p.a_key ELSE p.b_key END AS b_key,
               CASE WHEN p.is_turned THEN p.closest_b_point ELSE p.closest_a_point END AS closest_a_point,
               CASE WHEN p.is_turned THEN p.closest_a_point ELSE p.closest_b_point END AS closest_b_point,
               -- Whether it is a conflict, or only near, is what was first found.
               CASE WHEN p.stays AND (p.old_verdict = 'near') = (p.verdict = 'near') THEN p.found_at
                    ELSE v_start END AS found_at
        FROM placed p WHERE p.is_found
    ), located AS NOT MATERIALIZED (
        -- By the order of the keys: not even the order of its vertices depends on numbers.
        SELECT o.*, CASE WHEN o.region IS NULL AND o.verdict <> 'near' THEN
                        _conflict_region(p_scene_id, o.a_kind, o.a_id, o.a_version, o.b_kind, o.b_id, o.b_version,
                                         o.periods, v_plane)
                    ELSE o.region END AS known_region
        FROM ordered o
    ), rewritten AS (
        UPDATE conflict c
            SET run_id = v_run_id, a_kind = o.a_kind, a_id = o.a_id, a_version = o.a_version, a_key = o.a_key,
                b_kind = o.b_kind, b_id = o.b_id, b_version = o.b_version, b_key = o.b_key, periods = o.periods,
                verdict = o.verdict, region = o.known_region, first_contact_point = o.first_contact_point,
                method = v_method, time_error_s = o.time_error_s, closest_at = o.closest_at, closest_m = o.closest_m,
                closest_error_m = o.closest_error_m, closest_a_point = o.closest_a_point,
                closest_b_point = o.closest_b_point, found_at = o.found_at
            FROM located o WHERE c.ctid = o.place
    ), added AS (
        INSERT INTO conflict (scene_id, run_id, a_kind, a_id, a_version, a_key, b_kind, b_id, b_version, b_key,
                              periods, verdict, region, first_contact_point, method, time_error_s, found_at, closest_at,
                              closest_m, closest_error_m, closest_a_point, closest_b_point)
            SELECT p_scene_id, v_run_id, o.a_kind, o.a_id, o.a_version, o.a_key, o.b_kind, o.b_id, o.b_version,
                   o.b_key, o.periods, o.verdict, o.known_region, o.first_contact_point, v_method, o.time_error_s,
                   o.found_at, o.closest_at, o.closest_m, o.closest_error_m, o.closest_a_point, o.closest_b_point
            FROM located o WHERE o.place IS NULL
    )
    -- Pairs that are only near are no conflicts: they open, change and close none.
    SELECT count(*) FILTER (WHERE n.is_now AND NOT (p.stays AND n.was)),
           count(*) FILTER (WHERE n.was AND NOT (p.stays AND n.is_now)),
           count(*) FILTER (WHERE p.stays AND n.was AND n.is_now
                              AND (p.periods, p.verdict) IS DISTINCT FROM (p.old_periods, p.old_verdict)),
           count(*) FILTER (WHERE n.is_now) - count(*) FILTER (WHERE n.was),
           count(*) FILTER (WHERE p.is_found AND p.verdict = 'unresolved')
               - count(*) FILTER (WHERE p.old_verdict = 'unresolved')
        INTO opened, closed, changed, v_more, v_more_unresolved
        FROM placed p
        CROSS JOIN LATERAL (SELECT p.is_found AND p.verdict <> 'near' AS is_now,
                                   p.place IS NOT NULL AND p.old_verdict <> 'near' AS was) n;

    DELETE FROM change m WHERE m.scene_id = p_scene_id AND m.is_covered;

    -- All conflicts of the scene are counted only where so many changed that it does not matter.
    IF v_is_many OR v_last.run_id IS NULL THEN
        SELECT count(*), count(*) FILTER (WHERE c.verdict = 'unresolved') INTO v_more, v_more_unresolved
            FROM conflict c WHERE c.scene_id = p_scene_id AND c.verdict <> 'near';
        v_last.conflicts := 0;
        v_last.unresolved := 0;
    END IF;
    conflicts := v_last.conflicts + v_more;
    unresolved := v_last.unresolved + v_more_unresolved;
    UPDATE run r SET finished_at = clock_timestamp(), opened = _write_run.opened, changed = _write_run.changed,
                     closed = _write_run.closed, conflicts = _write_run.conflicts,
                     unresolved = _write_run.unresolved,
                     write_s = coalesce((p_run ->> 'write_s')::double precision, 0)
                               + extract(epoch FROM clock_timestamp() - v_start)
        WHERE r.run_id = v_run_id;
    run_id := v_run_id;
    PERFORM pg_notify('conflictdb', jsonb_build_object('scene', v_scene_name, 'run', v_run_id, 'opened', opened,
                                                       'changed', changed, 'closed', closed)::text);
END
$$;
COMMENT ON FUNCTION _write_run(bigint, jsonb) IS
'Replaces the conflicts of pairs with a dirty member by the found ones, records the run (p_run: columns of run), '
'deletes the covered marks, notifies channel conflictdb. A row that would be the same is left as it is, with the run '
'that wrote it; a conflict that stays keeps the instant it was first found. Pairs that are only near are kept beside '
'them, and not counted.';

CREATE OR REPLACE FUNCTION _record_failure(p_scene_id bigint, p_run jsonb, p_error text) RETURNS bigint
LANGUAGE sql VOLATILE
BEGIN ATOMIC
    INSERT INTO run (scene_id, started_at, finished_at, method, settings, objects, candidate_pairs, intersecting_pairs,
                     window_pairs, solved_pairs, pieces_s, stage1_s, stage2_s, stage3_s, stage4_s, error)
        SELECT p_scene_id, r.started_at, clock_timestamp(), r.method, r.settings,
               (SELECT count(*) FROM area a WHERE a.scene_id = p_scene_id)
               + (SELECT count(*) FROM track t WHERE t.scene_id = p_scene_id),
               r.candidate_pairs, r.intersecting_pairs, r.window_pairs, r.solved_pairs,
               r.pieces_s, r.stage1_s, r.stage2_s, r.stage3_s, r.stage4_s, p_error
        FROM jsonb_populate_record(NULL::run, p_run) r
        RETURNING run_id;
END;
COMMENT ON FUNCTION _record_failure(bigint, jsonb, text) IS
'Records a detection that failed; conflicts and marks stay as they were. Returns the run.';
