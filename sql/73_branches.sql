-- Making, comparing, merging and dropping branches. How they store and read objects: 10_branches.sql.

CREATE OR REPLACE FUNCTION create_branch(
    p_scene text, p_name text, p_proposal_id bigint DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_parent_id bigint := _scene_id(p_scene);
    v_branch_id bigint;
BEGIN
    IF p_proposal_id IS NOT NULL THEN
        IF (_proposal(p_proposal_id)).scene_id <> v_parent_id THEN
            FOUND := _raise('ZC011', format('proposal %s', p_proposal_id), 'id',
                            format('is not of scene %L', p_scene), 'proposal_known',
                            'The view proposals has those that are.');
        END IF;
        PERFORM _check_unchanged(p_proposal_id);
    END IF;
    BEGIN
        -- Without RETURNING: row-level security shows the row to later statements only.
        INSERT INTO scene (name, parent_scene_id) VALUES (p_name, v_parent_id);
    EXCEPTION
        WHEN unique_violation THEN
            PERFORM _refuse_taken(p_name);
    END;
    v_branch_id := _scene_or_branch(p_name);
    IF p_proposal_id IS NOT NULL THEN
        INSERT INTO track (
            scene_id, key,
            /* track columns: NAME */
            path, outline, floor_m, ceiling_m, name, properties, grow_mps, outlines, floors_m, ceilings_m, class, owner,
            tolerances, departures, schedule
            /* end */
        ) SELECT
            v_branch_id, t.key,
            /* track columns: WRITTEN(t) but path = m.path but tolerances = _windows_later(t.tolerances, m.delay_s) */
            m.path, t.outline, t.floor_m, t.ceiling_m, t.name, t.properties, t.grow_mps, t.outlines, t.floors_m,
            t.ceilings_m, t.class, t.owner, _windows_later(t.tolerances, m.delay_s),
            CASE WHEN t.schedule IS NULL THEN t.departures END, t.schedule
            /* end */
            FROM proposal_move m JOIN track t ON t.track_id = m.track_id AND t.scene_id = m.scene_id
            WHERE m.proposal_id = p_proposal_id;
        INSERT INTO area (
            scene_id, key,
            /* area columns: NAME */
            footprint, active_span, floor_m, ceiling_m, name, properties, class, owner, activations, schedule
            /* end */
        ) SELECT
            v_branch_id, a.key,
            /* area columns: WRITTEN(a) but footprint = m.footprint but active_span = s.span
               but activations = s.spans */
            m.footprint, s.span, a.floor_m, a.ceiling_m, a.name, a.properties, a.class, a.owner, s.spans, a.schedule
            /* end */
            FROM proposal_move m JOIN area a ON a.area_id = m.area_id AND a.scene_id = m.scene_id
            CROSS JOIN LATERAL (SELECT _span_later(m.planned_span, m.delay_s) AS span,
                                       _spans_later(m.planned_activations, m.delay_s) AS spans) s
            WHERE m.proposal_id = p_proposal_id;
    END IF;
    RETURN v_branch_id;
END
$$;
COMMENT ON FUNCTION create_branch(text, text, bigint) IS
'Makes a branch of a scene, which belongs to the current role; returns its id. A branch has the objects, settings and '
'rules of the scene; edits of its objects stay in the branch, until merge_branch takes them over. It stores its edits '
'only. Objects that it has not edited follow the scene. p_proposal_id: a proposal of the scene, whose moves are the '
'first edits of the branch. Raises ZC020 for a branch of a branch, ZC007 if the name is taken, ZC018 for a proposal '
'that is out of date.';

CREATE OR REPLACE FUNCTION conflictdb_internal._branch_to_change(p_branch text) RETURNS bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_branch_id bigint := _scene_or_branch_to_change(p_branch);
BEGIN
    IF _parent_of(v_branch_id) IS NULL THEN
        FOUND := _raise('ZC020', format('scene %L', p_branch), 'name', 'is no branch', 'scene_branch',
                        'create_branch(scene, name) makes one.');
    END IF;
    RETURN v_branch_id;
END
$$;
COMMENT ON FUNCTION _branch_to_change(text) IS
'Returns the id of a branch that the current role may change; raises ZC020 for a scene that is no branch.';

CREATE OR REPLACE FUNCTION drop_branch(p_branch text) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _branch_to_change(p_branch);
    PERFORM remove_scene(p_branch);
END
$$;
COMMENT ON FUNCTION drop_branch(text) IS
'Removes a branch with its edits; its parent stays. Raises ZC020 for a scene that is no branch.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_same_area(p_a area, p_b area) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Bytes: a dump names no schema for the equality of geometries, and could not be restored.
    SELECT (
        /* area columns: BYTES((p_a)) */
        (p_a).footprint::bytea, (p_a).active_span, (p_a).floor_m, (p_a).ceiling_m, (p_a).name, (p_a).properties,
        (p_a).class, (p_a).owner, CASE WHEN (p_a).schedule IS NULL THEN (p_a).activations END, (p_a).schedule
        /* end */
    ) IS NOT DISTINCT FROM (
        /* area columns: BYTES((p_b)) */
        (p_b).footprint::bytea, (p_b).active_span, (p_b).floor_m, (p_b).ceiling_m, (p_b).name, (p_b).properties,
        (p_b).class, (p_b).owner, CASE WHEN (p_b).schedule IS NULL THEN (p_b).activations END, (p_b).schedule
        /* end */
    );
END;
COMMENT ON FUNCTION _is_same_area(area, area) IS
'Whether two areas are equal but for scene, key, id, version and the expansion of a schedule.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_same_track(p_a track, p_b track) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT (
        /* track columns: BYTES((p_a)) */
        (p_a).path::bytea, (p_a).outline::bytea, (p_a).floor_m, (p_a).ceiling_m, (p_a).name, (p_a).properties,
        (p_a).grow_mps, (p_a).outlines::bytea, (p_a).floors_m, (p_a).ceilings_m, (p_a).class, (p_a).owner,
        (p_a).tolerances, CASE WHEN (p_a).schedule IS NULL THEN (p_a).departures END, (p_a).schedule
        /* end */
    ) IS NOT DISTINCT FROM (
        /* track columns: BYTES((p_b)) */
        (p_b).path::bytea, (p_b).outline::bytea, (p_b).floor_m, (p_b).ceiling_m, (p_b).name, (p_b).properties,
        (p_b).grow_mps, (p_b).outlines::bytea, (p_b).floors_m, (p_b).ceilings_m, (p_b).class, (p_b).owner,
        (p_b).tolerances, CASE WHEN (p_b).schedule IS NULL THEN (p_b).departures END, (p_b).schedule
        /* end */
    );
END;
COMMENT ON FUNCTION _is_same_track(track, track) IS
'Whether two tracks are equal but for scene, key, id, version and the expansion of a schedule.';

CREATE OR REPLACE FUNCTION branch_objects(p_branch text) RETURNS TABLE (change text, key text, kind text, name text)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_branch_id bigint := _scene_or_branch(p_branch);
    v_parent_id bigint := _parent_of(v_branch_id);
BEGIN
    IF v_parent_id IS NULL THEN
        PERFORM _branch_to_change(p_branch);
    END IF;
    RETURN QUERY
        SELECT CASE WHEN num_nonnulls(a.area_id, t.track_id) = 0 THEN 'removed'
                    WHEN num_nonnulls(pa.area_id, pt.track_id) = 0 THEN 'added' ELSE 'changed' END, e.key,
               CASE WHEN coalesce(a.area_id, CASE WHEN t.track_id IS NULL THEN pa.area_id END) IS NULL
                    THEN 'track' ELSE 'area' END,
               CASE WHEN num_nonnulls(a.area_id, t.track_id) > 0 THEN coalesce(a.name, t.name)
                    ELSE coalesce(pa.name, pt.name) END
        FROM branch_edit e
        LEFT JOIN area a ON a.scene_id = v_branch_id AND a.key = e.key
        LEFT JOIN track t ON t.scene_id = v_branch_id AND t.key = e.key
        LEFT JOIN area pa ON pa.scene_id = v_parent_id AND pa.key = e.key
        LEFT JOIN track pt ON pt.scene_id = v_parent_id AND pt.key = e.key
        WHERE e.scene_id = v_branch_id AND num_nonnulls(a.area_id, t.track_id, pa.area_id, pt.track_id) > 0
          AND NOT (num_nonnulls(a.area_id, pa.area_id) = 2 AND _is_same_area(a, pa)
                   OR num_nonnulls(t.track_id, pt.track_id) = 2 AND _is_same_track(t, pt))
        ORDER BY e.key;
END
$$;
COMMENT ON FUNCTION branch_objects(text) IS
'Objects in which a branch differs from its parent, by key: added, changed or removed. Raises ZC020 for a scene that '
'is no branch.';

CREATE OR REPLACE FUNCTION branch_conflicts(p_branch text) RETURNS TABLE (
    change text, a_key text, a_kind text, b_key text, b_kind text, verdict text, periods tstzmultirange,
    verdict_before text, periods_before tstzmultirange
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_branch_id bigint := _scene_or_branch(p_branch);
    v_parent_id bigint := _parent_of(v_branch_id);
BEGIN
    IF v_parent_id IS NULL THEN
        PERFORM _branch_to_change(p_branch);
    END IF;
    IF NOT _is_current(v_branch_id) THEN
        FOUND := _raise('ZC018', format('branch %L', p_branch), 'conflicts', format('are not known: %s',
                        (SELECT s.remark FROM _scene_state(p_branch) s)), 'branch_current', 'Detect it first.');
    END IF;
    RETURN QUERY
        WITH own AS (
            SELECT c.*, least(c.a_key, c.b_key) AS low, greatest(c.a_key, c.b_key) AS high
            FROM conflict c WHERE c.scene_id = v_branch_id AND c.verdict <> 'near'
        ), former AS (
            SELECT DISTINCT ON (c.conflict_id) c.*, least(c.a_key, c.b_key) AS low, greatest(c.a_key, c.b_key) AS high
            FROM branch_edit e
            CROSS JOIN LATERAL (SELECT c.* FROM conflict c WHERE c.scene_id = v_parent_id AND c.a_key = e.key
                                UNION ALL
                                SELECT c.* FROM conflict c WHERE c.scene_id = v_parent_id AND c.b_key = e.key
                                OFFSET 0) c
            WHERE e.scene_id = v_branch_id AND c.verdict <> 'near'
        )
        SELECT CASE WHEN n.conflict_id IS NULL THEN 'gone' WHEN f.conflict_id IS NULL THEN 'new' ELSE 'changed' END,
               coalesce(n.a_key, f.a_key), CASE coalesce(n.a_kind, f.a_kind) WHEN 0 THEN 'area' ELSE 'track' END,
               coalesce(n.b_key, f.b_key), CASE coalesce(n.b_kind, f.b_kind) WHEN 0 THEN 'area' ELSE 'track' END,
               n.verdict, n.periods, f.verdict, f.periods
        FROM own n FULL JOIN former f ON f.low = n.low AND f.high = n.high
        WHERE num_nulls(n.conflict_id, f.conflict_id) = 1 OR n.verdict <> f.verdict
           OR NOT _is_alike(n.periods, f.periods, n.time_error_s + f.time_error_s)
        ORDER BY 1, 2, 4;
END
$$;
COMMENT ON FUNCTION branch_conflicts(text) IS
'Conflicts in which a branch differs from its parent: gone, new, or changed (another verdict, or periods that differ '
'by more than their errors). Raises ZC018 if the branch or its parent waits for a detection, ZC020 for a scene that is '
'no branch.';

CREATE OR REPLACE FUNCTION merge_branch(p_branch text) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET jit = off AS $$
DECLARE
    v_branch_id bigint := _branch_to_change(p_branch);
    v_parent_id bigint := _parent_of(v_branch_id);
    v_parent text := (SELECT s.name FROM scene s WHERE s.scene_id = v_parent_id);
    v_keys text;
    v_changed bigint;
BEGIN
    PERFORM _check_may_change(v_parent_id, v_parent);
    -- Edits of the branch, and other merges, wait. Those that leave no mark do not read the row of the scene.
    PERFORM FROM scene s WHERE s.scene_id = v_branch_id FOR UPDATE;
    IF NOT FOUND THEN
        -- Another session has merged or dropped it.
        PERFORM _scene_or_branch(p_branch);
    END IF;
    PERFORM FROM area a JOIN branch_edit e ON e.key = a.key
        WHERE e.scene_id = v_branch_id AND a.scene_id IN (v_parent_id, v_branch_id) ORDER BY a.area_id FOR UPDATE OF a;
    PERFORM FROM track t JOIN branch_edit e ON e.key = t.key
        WHERE e.scene_id = v_branch_id AND t.scene_id IN (v_parent_id, v_branch_id) ORDER BY t.track_id FOR UPDATE OF t;
    SELECT string_agg(quote_literal(e.key), ', ' ORDER BY e.key) INTO v_keys
        FROM branch_edit e CROSS JOIN LATERAL _object_with(v_parent_id, e.key) o
        CROSS JOIN LATERAL _object_with(v_branch_id, e.key) n
        WHERE e.scene_id = v_branch_id
          AND (o.object_id, o.object_kind, o.version) IS DISTINCT FROM (e.object_id, e.object_kind, e.version)
          AND num_nonnulls(o.object_id, n.object_id) > 0;
    IF v_keys IS NOT NULL THEN
        FOUND := _raise('ZC018', format('branch %L', p_branch), 'objects',
                        format('were changed in %L too, since the branch edited them: %s', v_parent, v_keys),
                        'branch_alone', 'Edit them in the scene, and remove them from a new branch''s edits.');
    END IF;
    SELECT string_agg(quote_literal(e.key), ', ' ORDER BY e.key) INTO v_keys
        FROM branch_edit e JOIN attached_object o ON o.key = e.key JOIN attachment a USING (attachment_id)
        WHERE e.scene_id = v_branch_id AND a.scene_id = v_parent_id;
    IF v_keys IS NOT NULL THEN
        FOUND := _raise('ZC008', format('branch %L', p_branch), 'objects',
                        format('come from a table attached to %L: %s', v_parent, v_keys), 'object_own',
                        'Change the rows of the table.');
    END IF;

    SELECT count(*) INTO v_changed FROM branch_objects(p_branch);
    DELETE FROM area a USING branch_edit e
        WHERE e.scene_id = v_branch_id AND a.scene_id = v_parent_id AND a.key = e.key
          AND NOT EXISTS (SELECT FROM area n WHERE n.scene_id = v_branch_id AND n.key = a.key);
    DELETE FROM track t USING branch_edit e
        WHERE e.scene_id = v_branch_id AND t.scene_id = v_parent_id AND t.key = e.key
          AND NOT EXISTS (SELECT FROM track n WHERE n.scene_id = v_branch_id AND n.key = t.key);
    -- The next detection expands schedules.
    UPDATE area a SET
        /* area columns: NAME = WRITTEN(n) */
        footprint = n.footprint, active_span = n.active_span, floor_m = n.floor_m, ceiling_m = n.ceiling_m,
        name = n.name, properties = n.properties, class = n.class, owner = n.owner,
        activations = CASE WHEN n.schedule IS NULL THEN n.activations END, schedule = n.schedule
        /* end */
        FROM area n
        WHERE n.scene_id = v_branch_id AND a.scene_id = v_parent_id AND a.key = n.key AND NOT _is_same_area(a, n);
    UPDATE track t SET
        /* track columns: NAME = WRITTEN(n) */
        path = n.path, outline = n.outline, floor_m = n.floor_m, ceiling_m = n.ceiling_m, name = n.name,
        properties = n.properties, grow_mps = n.grow_mps, outlines = n.outlines, floors_m = n.floors_m,
        ceilings_m = n.ceilings_m, class = n.class, owner = n.owner, tolerances = n.tolerances,
        departures = CASE WHEN n.schedule IS NULL THEN n.departures END, schedule = n.schedule
        /* end */
        FROM track n
        WHERE n.scene_id = v_branch_id AND t.scene_id = v_parent_id AND t.key = n.key AND NOT _is_same_track(t, n);
    INSERT INTO area (
        scene_id, key,
        /* area columns: NAME */
        footprint, active_span, floor_m, ceiling_m, name, properties, class, owner, activations, schedule
        /* end */
    ) SELECT
        v_parent_id, n.key,
        /* area columns: WRITTEN(n) */
        n.footprint, n.active_span, n.floor_m, n.ceiling_m, n.name, n.properties, n.class, n.owner,
        CASE WHEN n.schedule IS NULL THEN n.activations END, n.schedule
        /* end */
        FROM area n WHERE n.scene_id = v_branch_id
          AND NOT EXISTS (SELECT FROM area a WHERE a.scene_id = v_parent_id AND a.key = n.key);
    INSERT INTO track (
        scene_id, key,
        /* track columns: NAME */
        path, outline, floor_m, ceiling_m, name, properties, grow_mps, outlines, floors_m, ceilings_m, class, owner,
        tolerances, departures, schedule
        /* end */
    ) SELECT
        v_parent_id, n.key,
        /* track columns: WRITTEN(n) */
        n.path, n.outline, n.floor_m, n.ceiling_m, n.name, n.properties, n.grow_mps, n.outlines, n.floors_m,
        n.ceilings_m, n.class, n.owner, n.tolerances, CASE WHEN n.schedule IS NULL THEN n.departures END, n.schedule
        /* end */
        FROM track n WHERE n.scene_id = v_branch_id
          AND NOT EXISTS (SELECT FROM track t WHERE t.scene_id = v_parent_id AND t.key = n.key);
    PERFORM remove_scene(p_branch);
    RETURN v_changed;
END
$$;
COMMENT ON FUNCTION merge_branch(text) IS
'Takes the edits of a branch over into its parent and removes the branch; returns how many objects changed. All or '
'none. Raises ZC018, with their keys, if objects were changed on both sides, ZC008 for objects of an attached table, '
'ZC020 for a scene that is no branch.';

CREATE OR REPLACE FUNCTION conflictdb_internal._period_ends(p_periods tstzmultirange) RETURNS timestamptz[]
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT array_agg(e.at ORDER BY p.nth, e.nth)
    FROM unnest(p_periods) WITH ORDINALITY p (span, nth)
    CROSS JOIN LATERAL (VALUES (1, lower(p.span)), (2, upper(p.span))) e (nth, at);
END;
COMMENT ON FUNCTION _period_ends(tstzmultirange) IS 'Starts and ends of periods in turn; null where unbounded.';

CREATE OR REPLACE FUNCTION conflictdb_internal._branch_conflicts(p_branch text) RETURNS TABLE (
    change text, a_key text, b_key text, verdict text, verdict_before text,
    ends timestamptz[], ends_before timestamptz[]
)
LANGUAGE sql STABLE STRICT
BEGIN ATOMIC
    SELECT c.change, c.a_key, c.b_key, c.verdict, c.verdict_before, _period_ends(c.periods),
           _period_ends(c.periods_before)
    FROM branch_conflicts(p_branch) c;
END;
COMMENT ON FUNCTION _branch_conflicts(text) IS
'As branch_conflicts; periods are starts and ends in turn, null where unbounded.';
