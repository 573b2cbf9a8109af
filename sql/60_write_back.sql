-- Write-back: one transaction replaces the conflicts of every pair with a changed member, records the run and deletes
-- the covered marks.

CREATE OR REPLACE FUNCTION conflictdb_internal._next_owner(
    p_kind smallint, p_id bigint, p_version bigint
) RETURNS bigint
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(CASE p_kind WHEN 0 THEN (SELECT a.first_version FROM area a
                                             WHERE a.area_id = p_id AND a.first_version > p_version)
                                ELSE (SELECT t.first_version FROM track t
                                      WHERE t.track_id = p_id AND t.first_version > p_version) END,
                    9223372036854775807);
END;
COMMENT ON FUNCTION _next_owner(smallint, bigint, bigint) IS
'Returns first_version of the current object with this id if it is greater than p_version, so that p_version belongs '
'to a former object; else the largest bigint.';

CREATE OR REPLACE FUNCTION conflictdb_internal._pieces_before(
    p_scene_id bigint, p_kind smallint, p_id bigint, p_until bigint
) RETURNS SETOF piece
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT o.* FROM piece o
    WHERE o.object_kind = p_kind AND o.object_id = p_id
      AND o.scene_id + 0 = ANY ((SELECT _layers(p_scene_id))::bigint[]) AND o.version < p_until;
END;
COMMENT ON FUNCTION _pieces_before(bigint, smallint, bigint, bigint) IS
'Rows of pieces of an object of a scene with versions below p_until. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._grown(p_part geometry) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Sides of 2 km leave straight ones in degrees by centimetres, far less than 10 m of the plane. A part around
    -- the earth has longer sides, whose bends grow with the square.
    SELECT ST_Segmentize(ST_Buffer(p_part, 10 * (s.side_m / 2000) ^ 2, 'join=mitre mitre_limit=2'), s.side_m)
    FROM (SELECT greatest(2000, ST_Length(ST_Boundary(p_part)) / 5000) AS side_m) s;
END;
COMMENT ON FUNCTION _grown(geometry) IS
'Extends part of a region (metres in the scene''s plane) so that its projection to longitude and latitude contains it.';

CREATE OR REPLACE FUNCTION conflictdb_internal._conflict_region(
    p_scene_id bigint, p_a_kind smallint, p_a_id bigint, p_a_version bigint, p_b_kind smallint, p_b_id bigint,
    p_b_version bigint, p_periods tstzmultirange, p_plane text
) RETURNS geometry
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT
-- Planning takes ten times as long as running: plan once.
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0 AS $$
DECLARE
    v_turn_m double precision := 2 * pi() * _radius_m(p_plane);
    -- Pieces from these versions on belong to other objects.
    v_a_until bigint := _next_owner(p_a_kind, p_a_id, p_a_version);
    v_b_until bigint := _next_owner(p_b_kind, p_b_id, p_b_version);
    v_within_s double precision := _longest_time_s(p_scene_id);
    v_region geometry;
BEGIN
    -- Parts may lie on both sides of the antimeridian, so each is projected to longitude and latitude separately.
    -- OFFSET 0: compute each step once.
    IF p_a_kind = 0 AND p_b_kind = 0 THEN
        SELECT ST_Union(d.part ORDER BY d.nr)
            INTO v_region
            FROM (SELECT _part_from_plane(_grown(m.part), p_plane) AS part, m.nr
                  FROM (SELECT ST_Intersection(ST_Translate(a.shape, o.turn * v_turn_m, 0),
                                               ST_Translate(b.shape, p.turn * v_turn_m, 0)) AS part,
                               (a.part, o.turn, b.part, p.turn) AS nr
                        FROM _pieces_before(p_scene_id, p_a_kind, p_a_id, v_a_until) o
                        JOIN _pieces_before(p_scene_id, p_b_kind, p_b_id, v_b_until) p
                            ON _pieces_may_meet(o, p, v_within_s, NULL)
                        CROSS JOIN LATERAL _pieces_of((o.*)::piece) a
                        JOIN LATERAL _pieces_of((p.*)::piece) b ON _pieces_may_meet(a, b, v_within_s, NULL)
                        OFFSET 0) m
                  WHERE NOT ST_IsEmpty(m.part) OFFSET 0) d;
    END IF;
    IF v_region IS NULL THEN
        -- Hulls are padded, so they also meet if the polygons are only within the separation.
        SELECT ST_Union(d.part ORDER BY d.nr)
            INTO v_region
            FROM (SELECT _part_from_plane(_grown(m.part), p_plane) AS part, m.nr
                  FROM (SELECT ST_Intersection(a.hull, b.hull) AS part, (a.part, o.turn, b.part, p.turn) AS nr
                        FROM _pieces_before(p_scene_id, p_a_kind, p_a_id, v_a_until) o
                        JOIN _pieces_before(p_scene_id, p_b_kind, p_b_id, v_b_until) p
                            ON _pieces_may_meet(o, p, v_within_s, NULL)
                        CROSS JOIN LATERAL _pieces_of((o.*)::piece) a
                        JOIN LATERAL _pieces_of((p.*)::piece) b ON _pieces_may_meet(a, b, v_within_s, NULL)
                        WHERE p_periods && _shared_span(a.span, b.span, v_within_s)
                        OFFSET 0) m
                  WHERE NOT ST_IsEmpty(m.part) OFFSET 0) d;
    END IF;
    RETURN v_region;
END
$$;
COMMENT ON FUNCTION _conflict_region(
    bigint, smallint, bigint, bigint, smallint, bigint, bigint, tstzmultirange, text) IS
'Region of a conflict, longitude and latitude in degrees, a superset. Two areas: intersection of their footprints, and '
'some metres. Otherwise: intersection of the hulls swept during the periods. Used if detection did not compute the '
'region: great circles next to a pole, objects that could not be cut, pairs that could not be solved. Null if nothing '
'intersects.';

CREATE OR REPLACE FUNCTION conflictdb_internal._covering(p_region geometry, p_place geometry) RETURNS geometry
LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_way_deg CONSTANT double precision := 1e-9;  -- half the width of the connection: 0.1 mm
    v_way geometry;
BEGIN
    IF p_region IS NULL OR p_place IS NULL OR ST_Covers(p_region, p_place) THEN
        RETURN p_region;
    END IF;
    v_way := ST_Union(ST_Buffer(ST_ShortestLine(p_region, p_place), c_way_deg, 1), ST_Buffer(p_place, c_way_deg, 1));
    RETURN ST_Union(p_region, ST_Intersection(v_way, ST_MakeEnvelope(-180, -90, 180, 90, 4326)));
END
$$;
COMMENT ON FUNCTION _covering(geometry, geometry) IS
'Returns the region extended to cover a place, which may lie outside by curvature of sides or by rounding (degrees).';

CREATE OR REPLACE FUNCTION conflictdb_internal._known_conflicts_of(
    p_scene_id bigint, p_kinds smallint[], p_ids bigint[],
    OUT a_kinds bytea, OUT a_ids bytea, OUT b_kinds bytea, OUT b_ids bytea, OUT digests bytea, OUT places bytea
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
-- Uses the indexes, whatever the statistics; planned once per session.
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET enable_sort = off SET jit = off AS $$
BEGIN
    SELECT array_send(coalesce(array_agg(k.a_kind), '{}')), array_send(coalesce(array_agg(k.a_id), '{}')),
           array_send(coalesce(array_agg(k.b_kind), '{}')), array_send(coalesce(array_agg(k.b_id), '{}')),
           array_send(coalesce(array_agg(k.digest), '{}')), array_send(coalesce(array_agg(k.place), '{}'))
        INTO a_kinds, a_ids, b_kinds, b_ids, digests, places
        -- OFFSET 0 forces an index lookup per object.
        FROM (SELECT o.* FROM unnest(p_kinds, p_ids) d (kind, id)
              CROSS JOIN LATERAL (SELECT c.a_kind, c.a_id, c.b_kind, c.b_id, c.digest, c.ctid AS place FROM conflict c
                                  WHERE c.a_kind = d.kind AND c.a_id = d.id AND c.scene_id + 0 = p_scene_id
                                  OFFSET 0) o
              UNION ALL
              -- This order is offered by one index only. Without it the planner may choose the other, which has these
              -- columns last and would be scanned as a whole.
              SELECT o.* FROM unnest(p_kinds, p_ids) d (kind, id)
              CROSS JOIN LATERAL (SELECT c.a_kind, c.a_id, c.b_kind, c.b_id, c.digest, c.ctid FROM conflict c
                                  WHERE c.b_kind = d.kind AND c.b_id BETWEEN d.id AND d.id
                                    AND c.scene_id + 0 = p_scene_id
                                  ORDER BY c.b_id OFFSET 0) o) k;
END
$$;
COMMENT ON FUNCTION _known_conflicts_of(bigint, smallint[], bigint[]) IS
'Conflicts of the given objects of a scene, with the columns of _known_conflicts.';

CREATE OR REPLACE FUNCTION conflictdb_internal._known_conflicts_among(
    p_scene_id bigint, p_is_all boolean,
    OUT a_kinds bytea, OUT a_ids bytea, OUT b_kinds bytea, OUT b_ids bytea, OUT digests bytea, OUT places bytea
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
-- Reads in storage order, whatever the statistics. A nested loop would compare each conflict with all marks.
SET enable_seqscan = off SET enable_indexscan = off SET enable_nestloop = off SET jit = off AS $$
BEGIN
    WITH marked AS MATERIALIZED (
        SELECT m.object_kind, m.object_id, bool_or(m.with_number IS NULL) AS for_all,
               array_agg(DISTINCT m.with_number) AS with
        FROM change m WHERE NOT p_is_all AND m.scene_id = p_scene_id AND m.is_covered
        GROUP BY m.object_kind, m.object_id
    )
    SELECT array_send(coalesce(array_agg(k.a_kind), '{}')), array_send(coalesce(array_agg(k.a_id), '{}')),
           array_send(coalesce(array_agg(k.b_kind), '{}')), array_send(coalesce(array_agg(k.b_id), '{}')),
           array_send(coalesce(array_agg(k.digest), '{}')), array_send(coalesce(array_agg(k.place), '{}'))
        INTO a_kinds, a_ids, b_kinds, b_ids, digests, places
        FROM (SELECT c.a_kind, c.a_id, c.b_kind, c.b_id, c.digest, c.ctid AS place FROM conflict c
              WHERE p_is_all AND c.scene_id = p_scene_id
              UNION ALL
              SELECT c.a_kind, c.a_id, c.b_kind, c.b_id, c.digest, c.ctid FROM conflict c
              LEFT JOIN marked a ON a.object_kind = c.a_kind AND a.object_id = c.a_id
              LEFT JOIN marked b ON b.object_kind = c.b_kind AND b.object_id = c.b_id
              WHERE NOT p_is_all AND c.scene_id = p_scene_id
                -- The class of a removed object does not matter: it has a mark for all of its pairs.
                AND (a.for_all OR b.for_all
                     OR _is_with(c.b_kind, CASE WHEN a.with IS NOT NULL THEN _class_number(c.b_kind, c.b_id) END,
                                 a.with)
                     OR _is_with(c.a_kind, CASE WHEN b.with IS NOT NULL THEN _class_number(c.a_kind, c.a_id) END,
                                 b.with))) k;
END
$$;
COMMENT ON FUNCTION _known_conflicts_among(bigint, boolean) IS
'All conflicts of a scene, or those of pairs that marks concern; with the columns of _known_conflicts.';

CREATE OR REPLACE FUNCTION conflictdb_internal._known_conflicts(
    p_scene_id bigint, p_numbers bigint[],
    OUT a_kinds bytea, OUT a_ids bytea, OUT b_kinds bytea, OUT b_ids bytea, OUT digests bytea, OUT places bytea
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    -- Above this number of changed objects, reading all conflicts of the scene costs less than lookups.
    c_few CONSTANT integer := 1000;
    v_kinds smallint[];
    v_ids bigint[];
BEGIN
    PERFORM _require_snapshot();
    IF p_numbers IS NULL THEN
        SELECT coalesce(array_agg(d.object_kind), '{}'), coalesce(array_agg(d.object_id), '{}') INTO v_kinds, v_ids
            FROM (SELECT DISTINCT m.object_kind, m.object_id FROM change m
                  WHERE m.scene_id = p_scene_id AND m.is_covered LIMIT c_few + 1) d;
    ELSE
        SELECT coalesce(array_agg((n >> 62)::smallint), '{}'), coalesce(array_agg(n & ((1::bigint << 62) - 1)), '{}')
            INTO v_kinds, v_ids FROM unnest(p_numbers) n;
    END IF;
    IF p_numbers IS NOT NULL OR cardinality(v_ids) <= c_few
       AND NOT EXISTS (SELECT FROM change m
                       WHERE m.scene_id = p_scene_id AND m.is_covered AND m.with_number IS NOT NULL)
    THEN
        SELECT k.* INTO a_kinds, a_ids, b_kinds, b_ids, digests, places
            FROM _known_conflicts_of(p_scene_id, v_kinds, v_ids) k;
    ELSE
        SELECT k.* INTO a_kinds, a_ids, b_kinds, b_ids, digests, places
            FROM _known_conflicts_among(p_scene_id, _is_all_dirty(p_scene_id)) k;
    END IF;
END
$$;
COMMENT ON FUNCTION _known_conflicts(bigint, bigint[]) IS
'Stored conflicts of a scene that the detection replaces because a member changed, with the places (ctid) of their '
'rows. p_numbers: changed members; null: those with a covered mark. Each column as an array (array_send). A pair may '
'occur twice.';

CREATE OR REPLACE FUNCTION conflictdb_internal._count_conflicts(
    p_scene_id bigint, OUT conflicts bigint, OUT unresolved bigint
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
-- In storage order.
SET enable_seqscan = off SET enable_indexscan = off SET jit = off AS $$
BEGIN
    SELECT count(*), count(*) FILTER (WHERE c.verdict = 'unresolved') INTO conflicts, unresolved
        FROM conflict c WHERE c.scene_id = p_scene_id AND c.verdict <> 'near';
    IF _parent_of(p_scene_id) IS NOT NULL THEN
        SELECT _count_conflicts.conflicts + n.conflicts - n.gone,
               _count_conflicts.unresolved + n.unresolved - n.gone_unresolved
            INTO conflicts, unresolved FROM _count_inherited(p_scene_id) n;
    END IF;
END
$$;
COMMENT ON FUNCTION _count_conflicts(bigint) IS
'Number of conflicts of a scene, and of unresolved ones among them; of a branch, with those of its parent.';

CREATE OR REPLACE FUNCTION conflictdb_internal._count_inherited(
    p_scene_id bigint, OUT conflicts bigint, OUT unresolved bigint, OUT gone bigint, OUT gone_unresolved bigint
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_parent_id bigint := _parent_of(p_scene_id);
BEGIN
    -- Its last run has counted them.
    SELECT r.conflicts, r.unresolved INTO conflicts, unresolved
        FROM run r WHERE r.scene_id = v_parent_id AND r.error IS NULL ORDER BY r.run_id DESC LIMIT 1;
    conflicts := coalesce(conflicts, 0);
    unresolved := coalesce(unresolved, 0);
    -- DISTINCT: a pair of two edited objects is found from both. OFFSET 0 forces lookups.
    SELECT count(*), count(*) FILTER (WHERE g.verdict = 'unresolved') INTO gone, gone_unresolved
        FROM (SELECT DISTINCT c.conflict_id, c.verdict FROM branch_edit e
              CROSS JOIN LATERAL (SELECT c.conflict_id, c.verdict FROM conflict c
                                  WHERE c.scene_id = v_parent_id AND c.a_key = e.key
                                  UNION ALL
                                  SELECT c.conflict_id, c.verdict FROM conflict c
                                  WHERE c.scene_id = v_parent_id AND c.b_key = e.key OFFSET 0) c
              WHERE e.scene_id = p_scene_id AND c.verdict <> 'near') g;
END
$$;
COMMENT ON FUNCTION _count_inherited(bigint) IS
'Numbers of conflicts, and of unresolved ones, of the parent of a branch, and of those that its edits hide.';

CREATE OR REPLACE FUNCTION conflictdb_internal._count_objects(p_scene_id bigint) RETURNS bigint
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_parent_id bigint := _parent_of(p_scene_id);
    v_own bigint := (SELECT count(*) FROM area a WHERE a.scene_id = p_scene_id)
                    + (SELECT count(*) FROM track t WHERE t.scene_id = p_scene_id);
BEGIN
    IF v_parent_id IS NULL THEN
        RETURN v_own;
    END IF;
    -- Its last run has counted them, unless it waits for another.
    RETURN v_own + coalesce(CASE WHEN _is_current(v_parent_id)
                                 THEN (SELECT r.objects FROM run r WHERE r.scene_id = v_parent_id AND r.error IS NULL
                                       ORDER BY r.run_id DESC LIMIT 1) END, _count_objects(v_parent_id))
           - cardinality(_hidden_numbers(p_scene_id));
END
$$;
COMMENT ON FUNCTION _count_objects(bigint) IS 'Number of objects of a scene; of a branch, with those of its parent.';

CREATE OR REPLACE FUNCTION conflictdb_internal._begin_run(p_scene_id bigint, p_run jsonb) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_run_id bigint;
BEGIN
    -- The run's foreign key keeps the scene from being removed; conflicts have none.
    INSERT INTO run (scene_id, started_at, finished_at, method, settings, objects, conflicts, unresolved, opened,
                     changed, closed)
        SELECT p_scene_id, r.started_at, clock_timestamp(), r.method, r.settings,
               -- For few changes the caller gives the difference: counting would take longer.
               coalesce(CASE WHEN _parent_of(p_scene_id) IS NULL
                             THEN last.objects + (p_run ->> 'more_objects')::bigint END,
                        _count_objects(p_scene_id)),
               coalesce(last.conflicts, 0), coalesce(last.unresolved, 0), 0, 0, 0
        FROM jsonb_populate_record(NULL::run, p_run) r
        LEFT JOIN LATERAL (SELECT o.objects, o.conflicts, o.unresolved FROM run o
                           WHERE o.scene_id = p_scene_id AND o.error IS NULL ORDER BY o.run_id DESC LIMIT 1) last
            ON true
        RETURNING run_id INTO v_run_id;
    RETURN v_run_id;
END
$$;
COMMENT ON FUNCTION _begin_run(bigint, jsonb) IS
'Records a run that starts to write, with the counts of the previous run; returns its id. p_run: columns of run, and '
'more_objects: change in the number of objects since the previous run, if known.';

CREATE OR REPLACE FUNCTION conflictdb_internal._compared_early(p_scene_id bigint) RETURNS bigint[]
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_expanded tstzrange := _expanded(p_scene_id);
BEGIN
    -- Schedules that are not expanded at all get marks of their own.
    IF v_expanded IS NULL THEN
        RETURN '{}';
    END IF;
    RETURN ARRAY(SELECT DISTINCT t.track_id FROM change c
                 CROSS JOIN LATERAL (SELECT t.* FROM track t WHERE t.track_id = c.object_id OFFSET 0) t
                 WHERE c.scene_id = p_scene_id AND c.is_covered AND c.object_kind = 1 AND t.scene_id = c.scene_id
                   AND t.schedule IS NULL
                   AND NOT _under_way(t.path, t.departures, t.tolerances, _schedules_within_s(p_scene_id))
                           <@ v_expanded);
END
$$;
COMMENT ON FUNCTION _compared_early(bigint) IS
'The tracks that a detection has compared with schedules that are not expanded far enough for them.';

CREATE OR REPLACE FUNCTION conflictdb_internal._write_run(
    p_scene_id bigint, p_run_id bigint, p_run jsonb, p_is_last boolean,
    p_a_kind smallint[], p_a_id bigint[], p_a_version bigint[], p_b_kind smallint[], p_b_id bigint[],
    p_b_version bigint[], p_place tid[], p_digest bigint[], p_verdict text[], p_periods tstzmultirange[],
    p_region bytea[], p_first_contact_point bytea[], p_time_error_s double precision[], p_closest_at timestamptz[],
    p_closest_m double precision[], p_closest_error_m double precision[], p_closest_a_point bytea[],
    p_closest_b_point bytea[], p_lacking_s double precision[], p_certainty text[],
    OUT run_id bigint, OUT opened bigint, OUT changed bigint, OUT closed bigint, OUT conflicts bigint,
    OUT unresolved bigint
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- Planned once per session, which takes longer than writing a few rows. The plan must not depend on statistics: lookups
-- are forced below, all other joins are hash joins.
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET enable_nestloop = off SET jit = off AS $$
#variable_conflict use_column
DECLARE
    v_early bigint[];
    -- Above this number of marks, counting all conflicts of the scene is cheap by comparison.
    c_few CONSTANT integer := 1000;
    v_start timestamptz := clock_timestamp();
    v_method text := p_run ->> 'method';
    v_scene_name text;
    v_plane text;
    v_has_delays boolean;
    v_has_regions boolean := v_method <> 'screen' AND p_run #>> '{settings,regions}' IS DISTINCT FROM 'off';
    v_is_first boolean;
    v_marks bigint;
    v_at timestamptz;
    v_opened bigint;
    v_changed bigint;
    v_closed bigint;
    v_unresolved bigint;
    v_first_event bigint;
    v_layers bigint[] := _layers(p_scene_id);
BEGIN
    -- Any user may listen to notifications, so protected scenes are not named.
    SELECT CASE WHEN NOT _is_protected() THEN s.name END, _plane(s.motion, s.earth, s.centre_lon, s.centre_lat),
           s.delays_within_s > 0
        INTO STRICT v_scene_name, v_plane, v_has_delays
        FROM scene s WHERE s.scene_id = p_scene_id;
    run_id := coalesce(p_run_id, _begin_run(p_scene_id, p_run));
    -- Start of writing: the same for all parts of a run.
    SELECT r.finished_at INTO v_at FROM run r WHERE r.run_id = _write_run.run_id;

    -- Starting the statement takes longer than writing a row: skip it if there is none.
    IF cardinality(p_digest) > 0 THEN
WITH member AS MATERIALIZED (
        -- One lookup per object; OFFSET 0 and "+ 0" force it to be by id.
        SELECT d.kind, d.id, n.key, n.first_version
        FROM (SELECT unnest(p_a_kind) AS kind, unnest(p_a_id) AS id
              UNION SELECT unnest(p_b_kind), unnest(p_b_id)) d
        CROSS JOIN LATERAL (SELECT o.key, o.first_version FROM area o
                            WHERE d.kind = 0 AND o.area_id = d.id AND o.scene_id + 0 = ANY (v_layers)
                            UNION ALL
                            SELECT o.key, o.first_version FROM track o
                            WHERE d.kind = 1 AND o.track_id = d.id AND o.scene_id + 0 = ANY (v_layers) OFFSET 0) n
    ), placed AS MATERIALIZED (
        -- Decide for each pair whether its conflict opens, changes or closes. Pairs that are only near are not
        -- conflicts. Pairs of an object that was removed meanwhile are dropped: it has a mark of its own, and its id
        -- may belong to another object by now.
        SELECT d.place, d.digest, d.periods, d.verdict, d.old_verdict, d.time_error_s, d.closest_at, d.closest_m,
               d.closest_error_m, d.lacking_s, d.certainty, d.is_found, e.is_now AND NOT (d.stays AND e.was) AS opens,
               e.was AND NOT (d.stays AND e.is_now) AS closes, g.changes,
               -- The area first, else the smaller key.
               CASE WHEN d.is_turned THEN d.b_kind ELSE d.a_kind END AS a_kind,
               CASE WHEN d.is_turned THEN d.b_id ELSE d.a_id END AS a_id,
               CASE WHEN d.is_turned THEN d.b_version ELSE d.a_version END AS a_version,
               CASE WHEN d.is_turned THEN d.b_key ELSE d.a_key END AS a_key,
               CASE WHEN d.is_turned THEN d.a_kind ELSE d.b_kind END AS b_kind,
               CASE WHEN d.is_turned THEN d.a_id ELSE d.b_id END AS b_id,
               CASE WHEN d.is_turned THEN d.a_version ELSE d.b_version END AS b_version,
               CASE WHEN d.is_turned THEN d.a_key ELSE d.b_key END AS b_key,
               ST_GeomFromEWKB(d.region) AS region, ST_GeomFromEWKB(d.first_contact_point) AS first_contact_point,
               ST_GeomFromEWKB(CASE WHEN d.is_turned THEN d.closest_b_point ELSE d.closest_a_point END)
                   AS closest_a_point,
               ST_GeomFromEWKB(CASE WHEN d.is_turned THEN d.closest_a_point ELSE d.closest_b_point END)
                   AS closest_b_point,
               CASE WHEN k.keeps THEN d.conflict_id WHEN d.is_found THEN nextval('conflict_seq') END AS conflict_id,
               CASE WHEN k.keeps THEN d.found_at ELSE v_at END AS found_at,
               CASE WHEN g.changes THEN v_at WHEN k.keeps THEN d.changed_at END AS changed_at,
               CASE WHEN k.keeps AND NOT g.changes THEN nullif(d.told_periods, d.periods) END AS told_periods
        FROM (SELECT f.*, o.found_at, o.conflict_id, o.changed_at, o.time_error_s AS old_time_error_s,
                     coalesce(o.told_periods, o.periods) AS told_periods, o.verdict AS old_verdict, a.key AS a_key,
                     b.key AS b_key, CASE WHEN i.was_turned THEN o.b_key ELSE o.a_key END AS old_a_key,
                     CASE WHEN i.was_turned THEN o.a_key ELSE o.b_key END AS old_b_key, i.is_found,
                     (f.b_kind, b.key) < (f.a_kind, a.key) AS is_turned,
                     f.place IS NOT NULL AND i.is_found
                     AND a.first_version <= CASE WHEN i.was_turned THEN o.b_version ELSE o.a_version END
                     AND b.first_version <= CASE WHEN i.was_turned THEN o.a_version ELSE o.b_version END AS stays
              FROM unnest(p_a_kind, p_a_id, p_a_version, p_b_kind, p_b_id, p_b_version, p_place, p_digest,
                          p_verdict, p_periods, p_region, p_first_contact_point, p_time_error_s, p_closest_at,
                          p_closest_m, p_closest_error_m, p_closest_a_point, p_closest_b_point, p_lacking_s,
                          p_certainty)
                   f (a_kind, a_id, a_version, b_kind, b_id, b_version, place, digest, verdict, periods, region,
                      first_contact_point, time_error_s, closest_at, closest_m, closest_error_m, closest_a_point,
                      closest_b_point, lacking_s, certainty)
              -- One lookup per row, by its place.
              LEFT JOIN LATERAL (SELECT c.* FROM conflict c
                                 WHERE c.ctid = f.place AND c.scene_id + 0 = p_scene_id OFFSET 0) o ON true
              LEFT JOIN member a ON a.kind = f.a_kind AND a.id = f.a_id AND a.first_version <= f.a_version
              LEFT JOIN member b ON b.kind = f.b_kind AND b.id = f.b_id AND b.first_version <= f.b_version
              CROSS JOIN LATERAL (SELECT num_nulls(f.verdict, a.key, b.key) = 0 AS is_found,
                                         (o.b_kind, o.b_id) < (o.a_kind, o.a_id) AS was_turned) i
              OFFSET 0) d
        CROSS JOIN LATERAL (SELECT d.is_found AND d.verdict <> 'near' AS is_now,
                                   d.place IS NOT NULL AND d.old_verdict <> 'near' AS was) e
        -- conflict_id and found_at are kept unless the pair changed between conflict and near.
        CROSS JOIN LATERAL (SELECT d.stays AND (d.old_verdict = 'near') = (d.verdict = 'near') AS keeps) k
        -- Compared with the last event, so that many small changes add up.
        CROSS JOIN LATERAL (SELECT CASE WHEN d.stays AND e.was AND e.is_now THEN
                d.verdict <> d.old_verdict OR (d.a_key, d.b_key) IS DISTINCT FROM (d.old_a_key, d.old_b_key)
                OR NOT _is_alike(d.periods, d.told_periods, d.time_error_s + d.old_time_error_s)
                ELSE false END AS changes OFFSET 0) g
    ), ended AS (
        -- With the last known values.
        INSERT INTO conflict_event (scene_id, run_id, conflict_id, kind, at, opened_at, a_kind, a_key, b_kind, b_key,
                                    periods, verdict, time_error_s, closest_at, closest_m, closest_error_m,
                                    proposal_id)
            SELECT p_scene_id, _write_run.run_id, o.conflict_id, 'closed', v_at, o.found_at, o.a_kind, o.a_key,
                   o.b_kind, o.b_key, o.periods, o.verdict, o.time_error_s, o.closest_at, o.closest_m,
                   o.closest_error_m, _proposal_of_pair(p_scene_id, o.a_kind, o.a_key, o.b_kind, o.b_key)
            FROM (SELECT p.place FROM placed p WHERE p.closes OFFSET 0) p
            CROSS JOIN LATERAL (SELECT c.* FROM conflict c WHERE c.ctid = p.place OFFSET 0) o
            RETURNING conflict_event_id
    ), removed AS (
        DELETE FROM conflict c
            WHERE c.ctid = ANY (ARRAY(SELECT p.place FROM placed p WHERE NOT p.is_found AND p.place IS NOT NULL))
    ), begun AS (
        INSERT INTO conflict_event (scene_id, run_id, conflict_id, kind, at, opened_at, a_kind, a_key, b_kind, b_key,
                                    periods, verdict, time_error_s, closest_at, closest_m, closest_error_m,
                                    proposal_id)
            SELECT p_scene_id, _write_run.run_id, o.conflict_id, CASE WHEN o.opens THEN 'opened' ELSE 'changed' END,
                   v_at, o.found_at, o.a_kind, o.a_key, o.b_kind, o.b_key, o.periods, o.verdict, o.time_error_s,
                   o.closest_at, o.closest_m, o.closest_error_m,
                   _proposal_of_pair(p_scene_id, o.a_kind, o.a_key, o.b_kind, o.b_key)
            FROM placed o WHERE o.opens OR o.changes
            RETURNING conflict_event_id
    ), located AS NOT MATERIALIZED (
        -- In the order of keys, so that the order of vertices is reproducible.
        SELECT o.*, CASE WHEN o.region IS NULL AND o.verdict <> 'near' AND v_has_regions THEN
                        _covering(_conflict_region(p_scene_id, o.a_kind, o.a_id, o.a_version, o.b_kind, o.b_id,
                                                   o.b_version, o.periods, v_plane), o.first_contact_point)
                    ELSE o.region END AS known_region
        FROM placed o WHERE o.is_found
    ), rewritten AS (
        UPDATE conflict c
            SET run_id = _write_run.run_id, a_kind = o.a_kind, a_id = o.a_id, a_version = o.a_version,
                a_key = o.a_key, b_kind = o.b_kind, b_id = o.b_id, b_version = o.b_version, b_key = o.b_key,
                periods = o.periods, verdict = o.verdict, region = o.known_region,
                first_contact_point = o.first_contact_point, method = v_method, time_error_s = o.time_error_s,
                closest_at = o.closest_at, closest_m = o.closest_m, closest_error_m = o.closest_error_m,
                closest_a_point = o.closest_a_point, closest_b_point = o.closest_b_point, found_at = o.found_at,
                digest = o.digest, conflict_id = o.conflict_id, changed_at = o.changed_at,
                told_periods = o.told_periods, lacking_s = o.lacking_s, certainty = o.certainty
            FROM located o
            WHERE c.ctid = o.place AND c.ctid = ANY (p_place)
              -- A rule or setting that changes the digest alone (0: not known) writes nothing. Rows that stay where
              -- they are let the table shrink again after a rule that made many conflicts.
              AND (c.digest = 0
                   OR (c.a_kind, c.a_id, c.a_version, c.a_key, c.b_kind, c.b_id, c.b_version, c.b_key, c.periods,
                       c.verdict, c.region, c.first_contact_point, c.method, c.time_error_s, c.closest_at, c.closest_m,
                       c.closest_error_m, c.closest_a_point, c.closest_b_point, c.found_at, c.conflict_id, c.changed_at,
                       c.told_periods, c.lacking_s, c.certainty)
                      IS DISTINCT FROM
                      (o.a_kind, o.a_id, o.a_version, o.a_key, o.b_kind, o.b_id, o.b_version, o.b_key, o.periods,
                       o.verdict, o.known_region, o.first_contact_point, v_method, o.time_error_s, o.closest_at,
                       o.closest_m, o.closest_error_m, o.closest_a_point, o.closest_b_point, o.found_at, o.conflict_id,
                       o.changed_at, o.told_periods, o.lacking_s, o.certainty))
    ), added AS (
        INSERT INTO conflict (scene_id, run_id, a_kind, a_id, a_version, a_key, b_kind, b_id, b_version, b_key,
                              periods, verdict, region, first_contact_point, method, time_error_s, found_at, closest_at,
                              closest_m, closest_error_m, closest_a_point, closest_b_point, digest, conflict_id,
                              lacking_s, certainty)
            SELECT p_scene_id, _write_run.run_id, o.a_kind, o.a_id, o.a_version, o.a_key, o.b_kind, o.b_id,
                   o.b_version, o.b_key, o.periods, o.verdict, o.known_region, o.first_contact_point, v_method,
                   o.time_error_s, o.found_at, o.closest_at, o.closest_m, o.closest_error_m, o.closest_a_point,
                   o.closest_b_point, o.digest, o.conflict_id, o.lacking_s, o.certainty
            FROM located o WHERE o.place IS NULL
    )
    SELECT count(*) FILTER (WHERE p.opens), count(*) FILTER (WHERE p.changes), count(*) FILTER (WHERE p.closes),
           count(*) FILTER (WHERE p.is_found AND p.verdict = 'unresolved')
               - count(*) FILTER (WHERE p.old_verdict = 'unresolved'),
           least((SELECT min(e.conflict_event_id) FROM ended e), (SELECT min(e.conflict_event_id) FROM begun e))
        INTO v_opened, v_changed, v_closed, v_unresolved, v_first_event FROM placed p;
    UPDATE run r SET opened = r.opened + v_opened, changed = r.changed + v_changed, closed = r.closed + v_closed,
                     conflicts = r.conflicts + v_opened - v_closed, unresolved = r.unresolved + v_unresolved
        WHERE r.run_id = _write_run.run_id;
    END IF;
    IF v_opened > 0 THEN
        PERFORM _renew_acknowledgements(p_scene_id, v_first_event);
    END IF;
    IF v_first_event IS NOT NULL THEN
        PERFORM _notify_events(p_scene_id, v_scene_name, run_id, v_first_event);
    END IF;
    IF NOT p_is_last THEN
        RETURN;
    END IF;

    SELECT NOT EXISTS (SELECT FROM run r WHERE r.scene_id = p_scene_id AND r.error IS NULL
                       AND r.run_id < _write_run.run_id) INTO v_is_first;
    -- Whoever detects its parent marks only the objects that it sees (below); and voyages of marks expand schedules.
    v_early := _compared_early(p_scene_id);
    DELETE FROM change m WHERE m.scene_id = p_scene_id AND m.is_covered;
    GET DIAGNOSTICS v_marks = ROW_COUNT;
    IF EXISTS (SELECT FROM change c WHERE c.scene_id = _parent_of(p_scene_id)) THEN
        PERFORM _mark_all(p_scene_id);
    ELSE
        INSERT INTO change (scene_id, object_kind, object_id, version)
            SELECT p_scene_id, 1, e.track_id, nextval('version_seq') FROM unnest(v_early) e (track_id);
    END IF;
    IF NOT v_has_delays THEN
        DELETE FROM difference d WHERE d.scene_id = p_scene_id;
    END IF;
    IF v_marks > 0 THEN
        -- Its branches compare their objects with the changed ones.
        PERFORM _mark_all(b.scene_id) FROM scene b WHERE b.parent_scene_id = p_scene_id;
    END IF;
    IF v_is_first OR v_marks > c_few OR cardinality(v_layers) > 1 THEN
        SELECT n.conflicts, n.unresolved INTO conflicts, unresolved FROM _count_conflicts(p_scene_id) n;
    END IF;
    UPDATE run r SET finished_at = clock_timestamp(), settings = n.settings, candidate_pairs = n.candidate_pairs,
                     intersecting_pairs = n.intersecting_pairs, window_pairs = n.window_pairs,
                     solved_pairs = n.solved_pairs, pieces_s = n.pieces_s, stage1_s = n.stage1_s,
                     stage2_s = n.stage2_s, stage3_s = n.stage3_s, stage4_s = n.stage4_s,
                     conflicts = coalesce(_write_run.conflicts, r.conflicts),
                     unresolved = coalesce(_write_run.unresolved, r.unresolved),
                     write_s = coalesce(n.write_s, 0) + extract(epoch FROM clock_timestamp() - v_start)
        FROM jsonb_populate_record(NULL::run, p_run) n
        WHERE r.run_id = _write_run.run_id
        RETURNING r.opened, r.changed, r.closed, r.conflicts, r.unresolved
        INTO opened, changed, closed, conflicts, unresolved;
    PERFORM pg_notify('conflictdb', jsonb_build_object('scene', v_scene_name, 'run', run_id, 'opened', opened,
                                                       'changed', changed, 'closed', closed)::text);
    PERFORM _prune_sometimes(p_scene_id);
END
$$;
COMMENT ON FUNCTION _write_run(
    bigint, bigint, jsonb, boolean, smallint[], bigint[], bigint[], smallint[], bigint[], bigint[], tid[], bigint[],
    text[], tstzmultirange[], bytea[], bytea[], double precision[], timestamptz[], double precision[],
    double precision[], bytea[], bytea[], double precision[], text[]) IS
'Writes some of the pairs whose result differs from the stored one; each pair once, the smaller kind and id first. '
'p_place: place of the stored row (_known_conflicts), null if there is none; a null verdict deletes the row. p_run_id '
'null: starts a run (p_run: columns of run). p_is_last: completes the run, deletes covered marks, notifies channel '
'conflictdb. A conflict that stays keeps its id and opening time. A conflict that opens, closes, or changes by more '
'than its time error makes an event (conflict_event); each call notifies of its events. Counts are returned with '
'p_is_last.';

-- Results computed outside the database are written by the same routines.

CREATE OR REPLACE FUNCTION conflictdb_internal._cover(
    p_scene_id bigint, p_kinds smallint[], p_ids bigint[]
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
SET enable_nestloop = off SET jit = off AS $$
BEGIN
    PERFORM _require_snapshot();
    UPDATE change c SET is_covered = false
        WHERE c.scene_id = p_scene_id AND c.is_covered
          AND NOT EXISTS (SELECT FROM unnest(p_kinds, p_ids) d (kind, id)
                          WHERE d.kind = c.object_kind AND d.id = c.object_id);
    -- If one of the given objects had a mark, its pairs with objects that were not given are unknown. Mark all other
    -- objects, so that these pairs are detected later.
    IF EXISTS (SELECT FROM change c JOIN unnest(p_kinds, p_ids) d (kind, id)
                   ON d.kind = c.object_kind AND d.id = c.object_id
               WHERE c.scene_id = p_scene_id) THEN
        INSERT INTO change (scene_id, object_kind, object_id, version)
            SELECT p_scene_id, o.object_kind, o.object_id, nextval('version_seq')
            FROM (SELECT 0::smallint AS object_kind, a.area_id AS object_id FROM area a WHERE a.scene_id = p_scene_id
                  UNION ALL
                  SELECT 1::smallint, t.track_id FROM track t WHERE t.scene_id = p_scene_id) o
            WHERE NOT EXISTS (SELECT FROM unnest(p_kinds, p_ids) d (kind, id)
                              WHERE d.kind = o.object_kind AND d.id = o.object_id)
              AND NOT EXISTS (SELECT FROM change c WHERE c.scene_id = p_scene_id
                              AND c.object_kind = o.object_kind AND c.object_id = o.object_id);
    END IF;
    INSERT INTO change (scene_id, object_kind, object_id, version, is_covered)
        SELECT p_scene_id, d.kind, d.id, nextval('version_seq'), true FROM unnest(p_kinds, p_ids) d (kind, id)
        WHERE NOT EXISTS (SELECT FROM change c WHERE c.scene_id = p_scene_id AND c.is_covered
                          AND c.object_kind = d.kind AND c.object_id = d.id);
END
$$;
COMMENT ON FUNCTION _cover(bigint, smallint[], bigint[]) IS
'Prepares the write-back of results for exactly these objects of a scene: covers their marks, adding missing ones, and '
'uncovers all others. If one of them had a mark, its pairs with other objects are unknown: all other objects are then '
'marked and stay pending.';

CREATE OR REPLACE FUNCTION conflictdb_internal._record_failure(
    p_scene_id bigint, p_run jsonb, p_error text
) RETURNS bigint
LANGUAGE sql VOLATILE
BEGIN ATOMIC
    INSERT INTO run (scene_id, started_at, finished_at, method, settings, objects, candidate_pairs, intersecting_pairs,
                     window_pairs, solved_pairs, pieces_s, stage1_s, stage2_s, stage3_s, stage4_s, error)
        SELECT p_scene_id, r.started_at, clock_timestamp(), r.method, r.settings,
               _count_objects(p_scene_id), r.candidate_pairs, r.intersecting_pairs, r.window_pairs, r.solved_pairs,
               r.pieces_s, r.stage1_s, r.stage2_s, r.stage3_s, r.stage4_s, p_error
        FROM jsonb_populate_record(NULL::run, p_run) r
        RETURNING run_id;
END;
COMMENT ON FUNCTION _record_failure(bigint, jsonb, text) IS
'Records a failed detection; conflicts and marks stay unchanged. Returns the id of the run.';
