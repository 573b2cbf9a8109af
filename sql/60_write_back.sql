-- Write-back: one transaction replaces the conflicts of every pair with a dirty member, records the run and deletes the
-- covered marks. After a crash either nothing of it happened or all.

CREATE OR REPLACE FUNCTION _conflict_region(
    p_a_kind smallint, p_a_id bigint, p_b_kind smallint, p_b_id bigint, p_periods tstzmultirange, p_earth text
) RETURNS geometry
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT
-- Planning for each pair anew takes ten times as long as doing it.
SET plan_cache_mode = force_generic_plan AS $$
DECLARE
    v_turn_m double precision := 2 * pi() * _radius_m(p_earth);
    v_region geometry;
BEGIN
    IF p_a_kind = 0 AND p_b_kind = 0 THEN
        SELECT ST_Union(ST_Intersection(ST_Translate(a.shape, a.turn * v_turn_m, 0),
                                        ST_Translate(b.shape, b.turn * v_turn_m, 0)))
            INTO v_region
            FROM piece a JOIN piece b ON b.hull && a.hull
            WHERE a.object_kind = p_a_kind AND a.object_id = p_a_id AND b.object_kind = p_b_kind AND b.object_id = p_b_id
              AND (a.turn = 0 OR b.turn = 0);
    END IF;
    IF v_region IS NULL OR ST_IsEmpty(v_region) THEN
        -- Hulls are padded: polygons that are only nearer than the separation meet in them.
        SELECT ST_Union(ST_Intersection(a.hull, b.hull))
            INTO v_region
            FROM piece a JOIN piece b ON b.hull && a.hull AND b.span && a.span
            WHERE a.object_kind = p_a_kind AND a.object_id = p_a_id AND b.object_kind = p_b_kind AND b.object_id = p_b_id
              AND (a.turn = 0 OR b.turn = 0) AND p_periods && (a.span * b.span);
    END IF;
    v_region := _from_plane(v_region, p_earth);
    RETURN _wrapped(v_region);
END
$$;
COMMENT ON FUNCTION _conflict_region(smallint, bigint, smallint, bigint, tstzmultirange, text) IS
'Where two objects interfere, longitude and latitude: two areas, the intersection of their footprints; else a superset, '
'the intersection of what they sweep while in conflict. Computed from the current pieces.';

CREATE OR REPLACE FUNCTION _begin_write() RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _require_snapshot();
    DROP TABLE IF EXISTS pg_temp.found, pg_temp.found_period;
    CREATE TEMPORARY TABLE found (
        nr bigint, a_kind smallint, a_id bigint, a_version bigint, b_kind smallint, b_id bigint, b_version bigint,
        verdict smallint, lon_deg double precision, lat_deg double precision, time_error_s double precision
    ) ON COMMIT DROP;
    CREATE TEMPORARY TABLE found_period (nr bigint, first_at timestamptz, last_at timestamptz) ON COMMIT DROP;
END
$$;
COMMENT ON FUNCTION _begin_write() IS
'Creates the temporary tables found and found_period for the results of a detection. Infinite instants stand for '
'unbounded, NaN for no first contact.';

CREATE OR REPLACE FUNCTION _write_run(
    p_scene_id bigint, p_run jsonb, OUT run_id bigint, OUT opened bigint, OUT changed bigint, OUT closed bigint
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
DECLARE
    v_scene scene%ROWTYPE;
    v_start timestamptz := clock_timestamp();
    v_run_id bigint;
BEGIN
    SELECT * INTO STRICT v_scene FROM scene s WHERE s.scene_id = p_scene_id;
    DROP TABLE IF EXISTS pg_temp.dirty_object, pg_temp.result;
    CREATE TEMPORARY TABLE dirty_object ON COMMIT DROP AS
        SELECT DISTINCT c.object_kind, c.object_id FROM change c WHERE c.scene_id = p_scene_id AND c.is_covered;
    ANALYZE pg_temp.dirty_object;
    ANALYZE pg_temp.found;
    ANALYZE pg_temp.found_period;
    -- The area first, else the smaller key. An object that was removed meanwhile has a mark of its own and drops out.
    CREATE TEMPORARY TABLE result ON COMMIT DROP AS
        SELECT CASE WHEN o.swap THEN m.b_kind ELSE m.a_kind END AS a_kind,
               CASE WHEN o.swap THEN m.b_id ELSE m.a_id END AS a_id,
               CASE WHEN o.swap THEN m.b_version ELSE m.a_version END AS a_version,
               CASE WHEN o.swap THEN m.b_key ELSE m.a_key END AS a_key,
               CASE WHEN o.swap THEN m.a_kind ELSE m.b_kind END AS b_kind,
               CASE WHEN o.swap THEN m.a_id ELSE m.b_id END AS b_id,
               CASE WHEN o.swap THEN m.a_version ELSE m.b_version END AS b_version,
               CASE WHEN o.swap THEN m.a_key ELSE m.b_key END AS b_key,
               p.periods, m.verdict, m.first_contact_point, m.time_error_s
        FROM (SELECT f.*, coalesce(aa.key, ta.key) AS a_key, coalesce(ab.key, tb.key) AS b_key,
                     (ARRAY['conflict', 'grazing', 'unresolved'])[f.verdict + 1] AS verdict_name,
                     CASE WHEN f.lon_deg = 'NaN' THEN NULL ELSE _wrapped(ST_SetSRID(ST_MakePoint(f.lon_deg, f.lat_deg), 4326))
                     END AS first_contact_point
              FROM pg_temp.found f
              LEFT JOIN area aa ON f.a_kind = 0 AND aa.area_id = f.a_id AND aa.scene_id = p_scene_id
              LEFT JOIN track ta ON f.a_kind = 1 AND ta.track_id = f.a_id AND ta.scene_id = p_scene_id
              LEFT JOIN area ab ON f.b_kind = 0 AND ab.area_id = f.b_id AND ab.scene_id = p_scene_id
              LEFT JOIN track tb ON f.b_kind = 1 AND tb.track_id = f.b_id AND tb.scene_id = p_scene_id) f
        CROSS JOIN LATERAL (SELECT f.nr, f.a_kind, f.a_id, f.a_version, f.a_key, f.b_kind, f.b_id, f.b_version, f.b_key,
                                   f.verdict_name AS verdict, f.first_contact_point, f.time_error_s) m
        CROSS JOIN LATERAL (SELECT (m.b_kind, m.b_key) < (m.a_kind, m.a_key) AS swap) o
        JOIN (SELECT t.nr, range_agg(tstzrange(nullif(t.first_at, '-infinity'), nullif(t.last_at, 'infinity'), '[]'))
                  AS periods
              FROM pg_temp.found_period t GROUP BY t.nr) p ON p.nr = m.nr
        WHERE m.a_key IS NOT NULL AND m.b_key IS NOT NULL;
    ANALYZE pg_temp.result;

    -- The run's number is drawn by hand: its row is written last, when all counts are known.
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

    DELETE FROM conflict c
        WHERE c.scene_id = p_scene_id
          AND (EXISTS (SELECT FROM pg_temp.dirty_object d WHERE d.object_kind = c.a_kind AND d.object_id = c.a_id)
               OR EXISTS (SELECT FROM pg_temp.dirty_object d WHERE d.object_kind = c.b_kind AND d.object_id = c.b_id))
          AND NOT EXISTS (SELECT FROM pg_temp.result n
                          WHERE n.a_kind = c.a_kind AND n.a_id = c.a_id AND n.b_kind = c.b_kind AND n.b_id = c.b_id);
    GET DIAGNOSTICS closed = ROW_COUNT;

    SELECT count(*) INTO changed
        FROM pg_temp.result n JOIN conflict c USING (a_kind, a_id, b_kind, b_id)
        WHERE (n.periods, n.verdict) IS DISTINCT FROM (c.periods, c.verdict);

    WITH written AS (
        INSERT INTO conflict AS c (scene_id, run_id, a_kind, a_id, a_version, a_key, b_kind, b_id, b_version, b_key,
                                   periods, verdict, region, first_contact_point, method, time_error_s, found_at)
        SELECT p_scene_id, v_run_id, n.a_kind, n.a_id, n.a_version, n.a_key, n.b_kind, n.b_id, n.b_version, n.b_key,
               n.periods, n.verdict,
               CASE WHEN n.a_kind = 0 AND n.b_kind = 0
                    THEN _conflict_region(n.a_kind, n.a_id, n.b_kind, n.b_id, n.periods, v_scene.earth) END,
               n.first_contact_point, p_run ->> 'method', n.time_error_s, clock_timestamp()
        FROM pg_temp.result n
        ON CONFLICT (a_kind, a_id, b_kind, b_id) DO UPDATE
            SET run_id = excluded.run_id, a_version = excluded.a_version, a_key = excluded.a_key,
                b_version = excluded.b_version, b_key = excluded.b_key, periods = excluded.periods,
                verdict = excluded.verdict, region = excluded.region,
                first_contact_point = excluded.first_contact_point, method = excluded.method,
                time_error_s = excluded.time_error_s
        RETURNING c.found_at
    )
    SELECT count(*) FILTER (WHERE w.found_at >= v_start) INTO opened FROM written w;

    DELETE FROM change c WHERE c.scene_id = p_scene_id AND c.is_covered;

    UPDATE run r SET finished_at = clock_timestamp(), opened = _write_run.opened, changed = _write_run.changed,
                     closed = _write_run.closed,
                     conflicts = (SELECT count(*) FROM conflict c WHERE c.scene_id = p_scene_id),
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
'Replaces the conflicts of pairs with a dirty member by the found ones, records the run (p_run: columns of run), deletes '
'the covered marks, notifies channel conflictdb. A conflict that stays keeps the instant it was first found.';

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
