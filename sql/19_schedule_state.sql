-- Whether the schedules of a scene wait to be expanded (23_schedules.sql).

CREATE OR REPLACE FUNCTION conflictdb_internal._is_behind_horizon(
    p_expanded tstzrange, p_horizon_days double precision
) RETURNS boolean
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT upper(p_expanded) < now() + 0.9 * p_horizon_days * interval '1 day';
END;
COMMENT ON FUNCTION _is_behind_horizon(tstzrange, double precision) IS
'Whether a tenth of the horizon has passed since the schedules of a scene were expanded; null: it has none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_parent_wider(p_branch scene) RETURNS boolean
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_expanded tstzrange := (SELECT p.expanded FROM scene p WHERE p.scene_id = p_branch.parent_scene_id);
BEGIN
    RETURN CASE WHEN v_expanded IS NOT NULL THEN NOT v_expanded <@ p_branch.expanded
                -- Without schedules it does not say how far its voyages reach, and its marks are gone.
                ELSE EXISTS (SELECT FROM change c WHERE c.scene_id = p_branch.scene_id)
                     AND EXISTS (SELECT FROM track t
                                 WHERE t.scene_id = p_branch.parent_scene_id AND t.schedule IS NULL
                                   AND NOT _under_way(t.path, t.departures, t.tolerances,
                                                     _schedules_within_s(p_branch.scene_id)) <@ p_branch.expanded)
                END;
END
$$;
COMMENT ON FUNCTION _is_parent_wider(scene) IS
'Whether the schedules of a branch are not expanded as far as those of its parent, or as its parent''s voyages reach. '
'Voyages are compared only while the branch waits for a detection: the parent''s marks all objects of the branch.';

CREATE OR REPLACE FUNCTION conflictdb_internal._schedules_wait(p_scene_id bigint) RETURNS boolean
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_scene scene%ROWTYPE;
BEGIN
    SELECT * INTO v_scene FROM scene s WHERE s.scene_id = p_scene_id;
    -- Activations that were written with a schedule are no expansion.
    IF EXISTS (SELECT FROM area a WHERE a.scene_id = p_scene_id AND a.schedule IS NOT NULL
                                    AND (a.activations IS NULL OR v_scene.expanded IS NULL))
       OR EXISTS (SELECT FROM track t WHERE t.scene_id = p_scene_id AND t.schedule IS NOT NULL
                                        AND (t.departures IS NULL OR v_scene.expanded IS NULL)) THEN
        RETURN true;
    END IF;
    RETURN v_scene.expanded IS NOT NULL
           AND (_is_behind_horizon(v_scene.expanded, v_scene.horizon_days)
                OR v_scene.parent_scene_id IS NOT NULL AND _is_parent_wider(v_scene)
                -- Voyages that changed may leave the time for which schedules are expanded.
                OR EXISTS (SELECT FROM change c
                           CROSS JOIN LATERAL (SELECT t.* FROM track t WHERE t.track_id = c.object_id OFFSET 0) t
                           -- Voyages of branches, too, meet the schedules of their parent.
                           WHERE c.scene_id IN (SELECT l.seen_by FROM _layer l WHERE l.scene_id = p_scene_id)
                             AND c.object_kind = 1 AND t.scene_id = c.scene_id
                             AND t.schedule IS NULL
                             AND NOT _under_way(t.path, t.departures, t.tolerances, _schedules_within_s(p_scene_id))
                                     <@ v_scene.expanded));
END
$$;
COMMENT ON FUNCTION _schedules_wait(bigint) IS
'Whether schedules of a scene are not expanded yet, or not far enough.';

CREATE OR REPLACE FUNCTION conflictdb_internal._expanded(p_scene_id bigint) RETURNS tstzrange
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(p.expanded * s.expanded, p.expanded, s.expanded)
    FROM scene s LEFT JOIN scene p ON p.scene_id = s.parent_scene_id WHERE s.scene_id = p_scene_id;
END;
COMMENT ON FUNCTION _expanded(bigint) IS
'How far the schedules of a scene are expanded; of a branch, its own and its parent''s. Null: it has none.';
