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
'superset, the intersection of what they sweep while in conflict. Computed from their current pieces.';

CREATE OR REPLACE FUNCTION _begin_write() RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET client_min_messages = warning AS $$
BEGIN
    PERFORM _require_snapshot();
    DROP TABLE IF EXISTS pg_temp.found, pg_temp.found_period;
    CREATE TEMPORARY TABLE found (
        nr bigint, a_kind smallint, a_id bigint, a_version bigint, b_kind smallint, b_id bigint, b_version bigint,
        verdict text, lon_deg double precision, lat_deg double precision, time_error_s double precision,
        closest_at timestamptz, closest_m double precision, closest_error_m double precision,
        a_lon_deg double precision, a_lat_deg double precision, b_lon_deg double precision, b_lat_deg double precision
    ) ON COMMIT DROP;
    CREATE TEMPORARY TABLE found_period (nr bigint, first_at timestamptz, last_at timestamptz) ON COMMIT DROP;
END
$$;
COMMENT ON FUNCTION _begin_write() IS
'Creates the temporary tables found and found_period for the results of a detection. Infinite instants stand for '
'unbounded, NaN for no first contact; -infinity and NaN for no closest approach. Pairs only near have no period.';

CREATE OR REPLACE FUNCTION _write_run(
    p_scene_id bigint, p_run jsonb, OUT run_id bigint, OUT opened bigint, OUT changed bigint, OUT closed bigint
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET client_min_messages = warning AS $$
#variable_conflict use_column
DECLARE
    v_scene scene%ROWTYPE;
    v_start timestamptz := clock_timestamp();
    v_turn_m double precision;
    v_plane text;
    v_run_id bigint;
BEGIN
    SELECT * INTO STRICT v_scene FROM scene s WHERE s.scene_id = p_scene_id;
    v_plane := _plane(v_scene.motion, v_scene.earth, v_scene.centre_lon, v_scene.centre_lat);
    v_turn_m := 2 * pi() * _radius_m(v_plane);
    DROP TABLE IF EXISTS pg_temp.dirty_object, pg_temp.old, pg_temp.result, pg_temp.static_region;
    ANALYZE pg_temp.found;
    ANALYZE pg_temp.found_period;
    -- The area first, else the smaller key. An object that was removed meanwhile has a mark of its own and drops out.
    CREATE TEMPORARY TABLE result ON COMMIT DROP AS
        -- Not by scene: of a scene that is new the planner expects few objects, and would compare all with all.
        WITH member AS (
            SELECT 0::smallint AS kind, a.area_id AS id, a.key, a.scene_id, a.first_version FROM area a
            WHERE a.area_id IN (SELECT f.a_id FROM pg_temp.found f WHERE f.a_kind = 0
                                UNION ALL SELECT f.b_id FROM pg_temp.found f WHERE f.b_kind = 0)
            UNION ALL
            SELECT 1::smallint, t.track_id, t.key, t.scene_id, t.first_version FROM track t
            WHERE t.track_id IN (SELECT f.a_id FROM pg_temp.found f WHERE f.a_kind = 1
                                 UNION ALL SELECT f.b_id FROM pg_temp.found f WHERE f.b_kind = 1)
        ), period AS (
            SELECT t.nr, range_agg(tstzrange(nullif(t.first_at, '-infinity'), nullif(t.last_at, 'infinity'), '[]'))
                AS periods
            FROM pg_temp.found_period t GROUP BY t.nr
        ), ordered AS (
            SELECT f.*, p.periods, a.key AS a_key, b.key AS b_key,
                   a.first_version AS a_first_version, b.first_version AS b_first_version,
                   (b.kind, b.key) < (a.kind, a.key) AS is_swapped,
                   CASE WHEN f.lon_deg <> 'NaN' THEN ST_SetSRID(ST_MakePoint(f.lon_deg, f.lat_deg), 4326) END
                       AS first_point,
                   CASE WHEN f.a_lon_deg <> 'NaN' THEN ST_SetSRID(ST_MakePoint(f.a_lon_deg, f.a_lat_deg), 4326) END
                       AS a_point,
                   CASE WHEN f.b_lon_deg <> 'NaN' THEN ST_SetSRID(ST_MakePoint(f.b_lon_deg, f.b_lat_deg), 4326) END
                       AS b_point
            FROM pg_temp.found f
            LEFT JOIN period p USING (nr)
            -- A number may be that of another object by now: then this one was removed.
            JOIN member a ON a.kind = f.a_kind AND a.id = f.a_id AND a.first_version <= f.a_version
            JOIN member b ON b.kind = f.b_kind AND b.id = f.b_id AND b.first_version <= f.b_version
            WHERE a.scene_id + 0 = p_scene_id AND b.scene_id + 0 = p_scene_id
        )
        SELECT o.a_kind, o.a_id, o.a_version, o.a_first_version, o.a_key,
               o.b_kind, o.b_id, o.b_version, o.b_first_version, o.b_key,
               coalesce(o.periods, '{}') AS periods, o.verdict,
               _wrapped(o.first_point) AS first_contact_point, o.time_error_s,
               nullif(o.closest_at, '-infinity') AS closest_at, nullif(o.closest_m, 'NaN') AS closest_m,
               nullif(o.closest_error_m, 'NaN') AS closest_error_m, _wrapped(o.a_point) AS closest_a_point,
               _wrapped(o.b_point) AS closest_b_point
        FROM ordered o WHERE NOT o.is_swapped
        UNION ALL
        SELECT o.b_kind, o.b_id, o.b_version, o.b_first_version, o.b_key,
               o.a_kind, o.a_id, o.a_version, o.a_first_version, o.a_key,
               coalesce(o.periods, '{}'), o.verdict, _wrapped(o.first_point), o.time_error_s,
               nullif(o.closest_at, '-infinity'), nullif(o.closest_m, 'NaN'), nullif(o.closest_error_m, 'NaN'),
               _wrapped(o.b_point), _wrapped(o.a_point)
        FROM ordered o WHERE o.is_swapped;
    ANALYZE pg_temp.result;

    CREATE TEMPORARY TABLE dirty_object ON COMMIT DROP AS
        SELECT DISTINCT c.scene_id, c.object_kind, c.object_id FROM change c
        WHERE c.scene_id = p_scene_id AND c.is_covered;
    ANALYZE pg_temp.dirty_object;
    CREATE TEMPORARY TABLE old ON COMMIT DROP AS
        SELECT c.*, EXISTS (SELECT FROM pg_temp.result n
                            WHERE (n.a_kind, n.a_id, n.b_kind, n.b_id) = (c.a_kind, c.a_id, c.b_kind, c.b_id)
                              AND n.a_first_version <= c.a_version AND n.b_first_version <= c.b_version) AS stays
        FROM (SELECT c.conflict_id, c.a_kind, c.a_id, c.a_version, c.b_kind, c.b_id, c.b_version, c.periods, c.verdict
              FROM pg_temp.dirty_object d
              JOIN conflict c ON c.a_kind = d.object_kind AND c.a_id = d.object_id AND c.scene_id + 0 = d.scene_id
              UNION
              SELECT c.conflict_id, c.a_kind, c.a_id, c.a_version, c.b_kind, c.b_id, c.b_version, c.periods, c.verdict
              FROM pg_temp.dirty_object d
              JOIN conflict c ON c.b_kind = d.object_kind AND c.b_id = d.object_id AND c.scene_id + 0 = d.scene_id) c;
    ANALYZE pg_temp.old;

    -- Where areas interfere stays the same until they change: computed once, for all of them together.
    CREATE TEMPORARY TABLE static_region ON COMMIT DROP AS
        SELECT d.a_id, d.b_id,
               CASE WHEN count(*) = 1 THEN (array_agg(_wrapped(d.part)))[1]
                    ELSE ST_Union(_wrapped(d.part) ORDER BY d.nr) END AS region
        FROM (SELECT m.a_id, m.b_id, m.nr, _from_plane(m.part, v_plane) AS part
              FROM (SELECT r.a_id, r.b_id, (a.part, a.turn, b.part, b.turn) AS nr,
                           ST_Intersection(ST_Translate(a.shape, a.turn * v_turn_m, 0),
                                           ST_Translate(b.shape, b.turn * v_turn_m, 0)) AS part
                    FROM pg_temp.result r
                    JOIN piece a ON a.object_kind = 0 AND a.object_id = r.a_id AND a.scene_id + 0 = p_scene_id
                    JOIN piece b ON b.object_kind = 0 AND b.object_id = r.b_id AND b.scene_id + 0 = p_scene_id
                                AND b.hull && a.hull
                    WHERE r.a_kind = 0 AND r.b_kind = 0 AND r.verdict <> 'near' AND (a.turn = 0 OR b.turn = 0)
                    OFFSET 0) m
              WHERE NOT ST_IsEmpty(m.part) OFFSET 0) d
        GROUP BY d.a_id, d.b_id;
    ANALYZE pg_temp.static_region;

    -- Counts that the writing below finds out are filled in at the end.
    INSERT INTO run (scene_id, started_at, finished_at, method, settings, objects, candidate_pairs,
                     intersecting_pairs, window_pairs, solved_pairs, conflicts, unresolved, pieces_s, stage1_s,
                     stage2_s, stage3_s, stage4_s)
        SELECT p_scene_id, r.started_at, clock_timestamp(), r.method, r.settings,
               (SELECT count(*) FROM area a WHERE a.scene_id = p_scene_id)
               + (SELECT count(*) FROM track t WHERE t.scene_id = p_scene_id),
               r.candidate_pairs, r.intersecting_pairs, r.window_pairs, r.solved_pairs, 0, r.unresolved,
               r.pieces_s, r.stage1_s, r.stage2_s, r.stage3_s, r.stage4_s
        FROM jsonb_populate_record(NULL::run, p_run) r
        RETURNING run.run_id INTO v_run_id;

    DELETE FROM conflict c USING pg_temp.old o
        WHERE c.conflict_id = o.conflict_id AND NOT o.stays;

    -- Pairs that are only near are no conflicts: they open, change and close none.
    SELECT count(*) FILTER (WHERE n.is_conflict AND o.is_conflict IS NOT TRUE),
           count(*) FILTER (WHERE o.is_conflict AND n.is_conflict IS NOT TRUE)
        INTO opened, closed
        FROM (SELECT n.*, true AS stays, n.verdict <> 'near' AS is_conflict FROM pg_temp.result n) n
        FULL JOIN (SELECT o.*, o.verdict <> 'near' AS is_conflict FROM pg_temp.old o) o
            USING (a_kind, a_id, b_kind, b_id, stays);

    SELECT count(*) INTO changed
        FROM pg_temp.result n JOIN pg_temp.old o USING (a_kind, a_id, b_kind, b_id)
        WHERE o.stays AND n.verdict <> 'near' AND o.verdict <> 'near'
          AND (n.periods, n.verdict) IS DISTINCT FROM (o.periods, o.verdict);

    INSERT INTO conflict AS c (scene_id, run_id, a_kind, a_id, a_version, a_key, b_kind, b_id, b_version, b_key,
                               periods, verdict, region, first_contact_point, method, time_error_s, found_at,
                               closest_at, closest_m, closest_error_m, closest_a_point, closest_b_point)
        SELECT p_scene_id, v_run_id, n.a_kind, n.a_id, n.a_version, n.a_key, n.b_kind, n.b_id, n.b_version, n.b_key,
               n.periods, n.verdict, s.region, n.first_contact_point, p_run ->> 'method', n.time_error_s,
               clock_timestamp(), n.closest_at, n.closest_m, n.closest_error_m, n.closest_a_point, n.closest_b_point
        FROM pg_temp.result n
        LEFT JOIN pg_temp.static_region s ON n.a_kind = 0 AND n.b_kind = 0 AND s.a_id = n.a_id AND s.b_id = n.b_id
        ON CONFLICT (a_kind, a_id, b_kind, b_id, scene_id) DO UPDATE
            SET run_id = excluded.run_id, a_version = excluded.a_version, a_key = excluded.a_key,
                b_version = excluded.b_version, b_key = excluded.b_key, periods = excluded.periods,
                verdict = excluded.verdict, region = excluded.region,
                first_contact_point = excluded.first_contact_point, method = excluded.method,
                time_error_s = excluded.time_error_s, closest_at = excluded.closest_at,
                closest_m = excluded.closest_m, closest_error_m = excluded.closest_error_m,
                closest_a_point = excluded.closest_a_point, closest_b_point = excluded.closest_b_point,
                found_at = CASE WHEN (c.verdict = 'near') = (excluded.verdict = 'near') THEN c.found_at
                                ELSE excluded.found_at END;

    DELETE FROM change c WHERE c.scene_id = p_scene_id AND c.is_covered;

    UPDATE run r SET finished_at = clock_timestamp(), opened = _write_run.opened, changed = _write_run.changed,
                     closed = _write_run.closed,
                     conflicts = (SELECT count(*) FROM conflict c
                                  WHERE c.scene_id = p_scene_id AND c.verdict <> 'near'),
                     unresolved = (SELECT count(*) FROM conflict c
                                   WHERE c.scene_id = p_scene_id AND c.verdict = 'unresolved'),
                     write_s = coalesce((p_run ->> 'write_s')::double precision, 0)
                               + extract(epoch FROM clock_timestamp() - v_start)
        WHERE r.run_id = v_run_id;
    run_id := v_run_id;
    PERFORM pg_notify('conflictdb', jsonb_build_object('scene', v_scene.name, 'run', v_run_id, 'opened', opened,
                                                       'changed', changed, 'closed', closed)::text);
END
$$;
COMMENT ON FUNCTION _write_run(bigint, jsonb) IS
'Replaces the conflicts of pairs with a dirty member by the found ones, records the run (p_run: columns of run), '
'deletes the covered marks, notifies channel conflictdb. A conflict that stays keeps the instant it was first found. '
'Pairs that are only near are kept beside them, and not counted.';

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
