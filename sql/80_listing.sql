-- Rows for Python (store/listing.py, attached.py, stored_objects.py).

CREATE OR REPLACE FUNCTION conflictdb_internal._names(p_scene text, p_keys text[])
RETURNS TABLE (key text, name text)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT a.key, a.name FROM _seen_areas(_scene_or_branch(p_scene)) a
    WHERE a.key = ANY (p_keys) AND a.name IS NOT NULL
    UNION ALL
    SELECT t.key, t.name FROM _seen_tracks(_scene_or_branch(p_scene)) t
    WHERE t.key = ANY (p_keys) AND t.name IS NOT NULL;
END;
COMMENT ON FUNCTION _names(text, text[]) IS 'Names of the objects of a scene that have one, by key.';

CREATE OR REPLACE FUNCTION conflictdb_internal._counted_conflicts() RETURNS TABLE (
    scene text, verdict text, is_acknowledged boolean, conflicts bigint
)
LANGUAGE sql STABLE
BEGIN ATOMIC
    SELECT c.scene, c.verdict, c.acknowledged_by IS NOT NULL, count(*) FROM conflicts c GROUP BY 1, 2, 3
    UNION ALL
    SELECT c.scene, c.verdict, c.acknowledged_by IS NOT NULL, count(*) FROM live_conflicts c GROUP BY 1, 2, 3;
END;
COMMENT ON FUNCTION _counted_conflicts() IS
'Numbers of conflicts, and of alarms (must, may, now), of all scenes by verdict, and whether they are acknowledged.';

CREATE OR REPLACE FUNCTION conflictdb_internal._conflicts_known_at(p_scene text, p_instant timestamptz)
RETURNS TABLE (
    a_key text, a_kind text, b_key text, b_kind text, periods bytea, verdict text, method text,
    time_error_s double precision, run_id bigint, found_at timestamptz, closest_at timestamptz,
    closest_m double precision, closest_error_m double precision, conflict_id bigint, acknowledged_by text,
    acknowledged_at timestamptz, acknowledged_for text, acknowledged_until timestamptz
)
LANGUAGE sql STABLE
BEGIN ATOMIC
    SELECT c.a_key, c.a_kind, c.b_key, c.b_kind, multirange_send(c.periods), c.verdict, r.method, c.time_error_s,
           c.run_id, c.opened_at, c.closest_at, c.closest_m, c.closest_error_m, c.conflict_id, c.acknowledged_by,
           c.acknowledged_at, c.acknowledged_for, c.acknowledged_until
    FROM conflicts_known_at(p_scene, p_instant) c JOIN run r ON r.run_id = c.run_id
    ORDER BY lower(c.periods) NULLS FIRST, c.a_key, c.b_key;
END;
COMMENT ON FUNCTION _conflicts_known_at(text, timestamptz) IS
'As conflicts_known_at, earliest first, with periods in binary.';

CREATE OR REPLACE FUNCTION conflictdb_internal._conflict_events(
    p_scene text, p_key text, p_other_key text, p_after bigint, p_most bigint, p_since timestamptz
) RETURNS TABLE (
    event bigint, kind text, at timestamptz, run_id bigint, conflict_id bigint, a_key text, a_kind text, b_key text,
    b_kind text, periods bytea, verdict text, time_error_s double precision, closest_at timestamptz,
    closest_m double precision, closest_error_m double precision, opened_at timestamptz, closed_at timestamptz,
    proposal_id bigint
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _scene_id(p_scene);
    RETURN QUERY
        SELECT e.event, e.kind, e.at, e.run_id, e.conflict_id, e.a_key, e.a_kind, e.b_key, e.b_kind,
               multirange_send(e.periods), e.verdict, e.time_error_s, e.closest_at, e.closest_m, e.closest_error_m,
               e.opened_at, e.closed_at, e.proposal_id
        FROM conflict_events e
        WHERE e.scene = p_scene AND e.event > p_after AND (p_since IS NULL OR e.at >= p_since)
          AND (p_key IS NULL OR p_key IN (e.a_key, e.b_key))
          AND (p_other_key IS NULL OR p_other_key IN (e.a_key, e.b_key))
        ORDER BY e.event LIMIT p_most;
END
$$;
COMMENT ON FUNCTION _conflict_events(text, text, text, bigint, bigint, timestamptz) IS
'Events of a scene after p_after and from p_since on (of one object, or of two), at most p_most, in order; periods in '
'binary.';

CREATE OR REPLACE FUNCTION conflictdb_internal._approaches(p_scene text, p_only_near boolean, p_keys text[])
RETURNS TABLE (
    a_key text, a_kind text, b_key text, b_kind text, closest_at timestamptz, closest_m double precision,
    closest_error_m double precision, a_lon_deg double precision, a_lat_deg double precision,
    b_lon_deg double precision, b_lat_deg double precision, verdict text, is_current boolean, run_id bigint,
    found_at timestamptz, scene_is_current boolean, method text, time_error_s double precision, a_name text,
    b_name text, a_id bigint, a_version bigint, b_id bigint, b_version bigint
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _scene_or_branch(p_scene);
    RETURN QUERY
        SELECT c.a_key, c.a_kind, c.b_key, c.b_kind, c.closest_at, c.closest_m, c.closest_error_m, ST_X(c.a_point),
               ST_Y(c.a_point), ST_X(c.b_point), ST_Y(c.b_point), c.verdict, c.is_current, c.run_id, c.found_at,
               c.scene_is_current, c.method, c.time_error_s, c.a_name, c.b_name, k.a_id, k.a_version, k.b_id,
               k.b_version
        FROM approaches c
        LEFT JOIN conflict k ON p_only_near AND k.scene_id = ANY ((SELECT _layers(_scene_or_branch(p_scene)))::bigint[])
                                AND k.verdict = 'near'
                                AND k.a_key = c.a_key AND (k.a_kind = 1) = (c.a_kind = 'track')
                                AND k.b_key = c.b_key AND (k.b_kind = 1) = (c.b_kind = 'track')
        WHERE c.scene = p_scene AND (NOT p_only_near OR c.verdict = 'near')
          AND (p_keys IS NULL OR c.a_key = ANY (p_keys) AND c.b_key = ANY (p_keys))
        ORDER BY c.closest_at NULLS FIRST, c.a_key, c.b_key;
END
$$;
COMMENT ON FUNCTION _approaches(text, boolean, text[]) IS
'Closest approaches of a scene, earliest first; p_only_near: only pairs without conflict, with ids and versions of the '
'objects; p_keys: only among these objects.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scenes() RETURNS TABLE (
    scene_id bigint, settings jsonb, areas bigint, tracks bigint, pending bigint, conflicts bigint,
    run_id bigint, finished_at timestamptz, error text, is_current boolean, branch_of text
)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT s.scene_id, _scene_settings(s.scene_id),
           (SELECT count(*) FROM _seen_areas(s.scene_id) a), (SELECT count(*) FROM _seen_tracks(s.scene_id) t),
           v.pending,
           (SELECT count(*) FROM _layer l JOIN conflict c ON c.scene_id = l.scene_id
            WHERE l.seen_by = s.scene_id AND c.verdict <> 'near'
              AND (c.scene_id = s.scene_id
                   OR NOT _is_edited(s.scene_id, c.a_key) AND NOT _is_edited(s.scene_id, c.b_key))),
           v.last_run_id, v.last_run_at, v.last_error, v.is_current, _parent_name(s.scene_id)
    FROM scene s JOIN scenes v ON v.scene = s.name
    ORDER BY s.name;
END;
COMMENT ON FUNCTION _scenes() IS
'All scenes with their settings, numbers of objects, of pending objects and of conflicts, their last run and parent.';

CREATE OR REPLACE FUNCTION conflictdb_internal._runs(p_scene text, p_limit integer) RETURNS SETOF run
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT r.* FROM run r WHERE r.scene_id = _scene_or_branch(p_scene) ORDER BY r.run_id DESC LIMIT p_limit;
END;
COMMENT ON FUNCTION _runs(text, integer) IS 'The last p_limit runs of a scene, newest first.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene(p_scene_id bigint) RETURNS TABLE (settings jsonb)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT _scene_settings(s.scene_id) FROM scene s WHERE s.scene_id = p_scene_id;
END;
COMMENT ON FUNCTION _scene(bigint) IS 'Name and settings of a scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_named(p_scene text) RETURNS TABLE (settings jsonb)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT _scene_settings(s.scene_id) FROM scene s WHERE s.name = p_scene;
END;
COMMENT ON FUNCTION _scene_named(text) IS 'Name and settings of a scene; no row for an unknown name.';

CREATE OR REPLACE FUNCTION conflictdb_internal._waiting_scenes() RETURNS TABLE (scene text, waited_s double precision)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    -- greatest(0, …): the clock may have been set back since the change.
    SELECT s.name, greatest(0, extract(epoch FROM clock_timestamp() - min(p.at)))
    FROM (SELECT m.scene_id, m.changed_at AS at, m.change_id AS n FROM change m
          UNION ALL
          -- An attached table that could not be read is retried after a minute.
          SELECT a.scene_id,
                 coalesce(q.changed_at, CASE WHEN _is_compared(a) THEN now() ELSE a.compared_at + a.every END), 0
          FROM attachment a LEFT JOIN attached_change q USING (attachment_id)
          WHERE CASE WHEN _has_just_failed(a) OR NOT _is_mine(a.attachment_id) THEN false
                     ELSE q.attachment_id IS NOT NULL OR _is_due(a) OR _is_moved(a) END
          UNION ALL
          SELECT b.scene_id, now(), 0 FROM scene b WHERE b.parent_scene_id IS NOT NULL AND _is_behind_parent(b.scene_id)
              AND EXISTS (SELECT FROM scene p WHERE p.scene_id = b.parent_scene_id)
          UNION ALL
          SELECT h.scene_id, now(), 0 FROM scene h WHERE _is_behind_horizon(h.expanded, h.horizon_days)
          UNION ALL
          SELECT b.scene_id, now(), 0 FROM scene b JOIN scene p ON p.scene_id = b.parent_scene_id
              WHERE NOT p.expanded <@ b.expanded
          UNION ALL
          SELECT w.scene_id, now(), 0 FROM area w WHERE w.schedule IS NOT NULL AND w.activations IS NULL
          UNION ALL
          SELECT w.scene_id, now(), 0 FROM track w WHERE w.schedule IS NOT NULL AND w.departures IS NULL) p
    JOIN scene s USING (scene_id)
    -- Branches last: one edit of their parent marks all of them.
    GROUP BY s.name, s.parent_scene_id ORDER BY s.parent_scene_id IS NOT NULL, min(p.at), min(p.n);
END;
COMMENT ON FUNCTION _waiting_scenes() IS
'Scenes that wait for detection, for schedules to be expanded further, or for tables that the current role attached, '
'with seconds of waiting; the longest waiting first, branches last.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attachments(p_scene text) RETURNS SETOF attachments
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _scene_id(p_scene) WHERE p_scene IS NOT NULL;
    RETURN QUERY SELECT v.* FROM attachments v WHERE v.scene = coalesce(p_scene, v.scene)
        ORDER BY v.scene, v."table", v.attachment_id;
END
$$;
COMMENT ON FUNCTION _attachments(text) IS 'Tables attached to a scene; null: to any scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._unmapped(p_scene text) RETURNS SETOF unmapped
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _scene_id(p_scene);
    RETURN QUERY SELECT v.* FROM unmapped v WHERE v.scene = p_scene ORDER BY v."table", v.identity;
END
$$;
COMMENT ON FUNCTION _unmapped(text) IS
'Rows of attached tables of a scene whose current values do not make an object.';
