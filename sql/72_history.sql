-- History of conflicts and acknowledgements.

CREATE OR REPLACE VIEW conflict_events WITH (security_invoker = true) AS
SELECT s.name AS scene, e.conflict_event_id AS event, e.kind, e.at, e.run_id, e.conflict_id,
       e.a_key, CASE e.a_kind WHEN 0 THEN 'area' ELSE 'track' END AS a_kind,
       e.b_key, CASE e.b_kind WHEN 0 THEN 'area' ELSE 'track' END AS b_kind,
       e.periods, e.verdict, e.time_error_s, e.closest_at, e.closest_m, e.closest_error_m, e.opened_at,
       CASE e.kind WHEN 'closed' THEN e.at END AS closed_at, e.proposal_id
FROM scene s JOIN conflict_event e USING (scene_id);

COMMENT ON VIEW conflict_events IS
'History of conflicts, one row per event. Also an outbox to poll, scene by scene: WHERE scene = … AND event > the '
'last one read. Removing a scene removes its events.';
COMMENT ON COLUMN conflict_events.scene IS 'Name of the scene.';
COMMENT ON COLUMN conflict_events.event IS
'Id. Within a scene, events become visible in order of their ids; ids may be skipped.';
COMMENT ON COLUMN conflict_events.kind IS
'opened; changed: another verdict or key, or periods that differ by more than their error; closed.';
COMMENT ON COLUMN conflict_events.at IS 'When the detection wrote it; it became visible when the run ended.';
COMMENT ON COLUMN conflict_events.run_id IS 'Run that found it.';
COMMENT ON COLUMN conflict_events.conflict_id IS
'Id of the conflict, the same from opening to closing. A pair that conflicts again gets a new one.';
COMMENT ON COLUMN conflict_events.a_key IS 'Key of the first object.';
COMMENT ON COLUMN conflict_events.a_kind IS 'area or track.';
COMMENT ON COLUMN conflict_events.b_key IS 'Key of the second object.';
COMMENT ON COLUMN conflict_events.b_kind IS 'area or track.';
COMMENT ON COLUMN conflict_events.periods IS 'When they conflict; for closed: the last known periods.';
COMMENT ON COLUMN conflict_events.verdict IS 'As in the view conflicts; for closed: the last known verdict.';
COMMENT ON COLUMN conflict_events.time_error_s IS 'Error bound of every period''s start and end, seconds.';
COMMENT ON COLUMN conflict_events.closest_at IS
'Closest approach: its time; null if not computed, or for areas that are always active.';
COMMENT ON COLUMN conflict_events.closest_m IS 'Closest approach: least distance, metres; null if not computed.';
COMMENT ON COLUMN conflict_events.closest_error_m IS
'Closest approach: error bound of closest_m, metres; null if not computed.';
COMMENT ON COLUMN conflict_events.opened_at IS 'When the conflict opened.';
COMMENT ON COLUMN conflict_events.closed_at IS 'When it closed; null for other events.';
COMMENT ON COLUMN conflict_events.proposal_id IS
'The proposal whose application, or its undoing, caused the event (see proposals); else null.';

CREATE OR REPLACE FUNCTION conflict_history(p_scene text, p_key text, p_other_key text DEFAULT NULL)
RETURNS SETOF conflict_events
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _scene_id(p_scene);
    RETURN QUERY
        SELECT e.* FROM conflict_events e
        WHERE e.scene = p_scene AND p_key IN (e.a_key, e.b_key)
          AND (p_other_key IS NULL OR (e.a_key, e.b_key) IN ((p_key, p_other_key), (p_other_key, p_key)))
        ORDER BY e.event;
END
$$;
COMMENT ON FUNCTION conflict_history(text, text, text) IS
'Events of the conflicts of an object, or of a pair of objects, oldest first, as far as history is kept. Includes '
'removed objects.';

CREATE OR REPLACE FUNCTION conflicts_known_at(p_scene text, p_instant timestamptz)
RETURNS TABLE (
    conflict_id bigint, a_key text, a_kind text, b_key text, b_kind text, periods tstzmultirange, verdict text,
    time_error_s double precision, closest_at timestamptz, closest_m double precision,
    closest_error_m double precision, opened_at timestamptz, run_id bigint, acknowledged_by text,
    acknowledged_at timestamptz, acknowledged_for text, acknowledged_until timestamptz
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_first_run_id bigint := (SELECT h.first_run_id FROM history h WHERE h.scene_id = v_scene_id);
    v_run_id bigint := (SELECT r.run_id FROM run r
                        WHERE r.scene_id = v_scene_id AND r.error IS NULL AND r.finished_at <= p_instant
                        ORDER BY r.run_id DESC LIMIT 1);
BEGIN
    IF p_instant IS NULL THEN
        FOUND := _raise('ZC003', format('scene %L', p_scene), 'instant', 'must not be null', 'instant_given');
    END IF;
    IF v_run_id IS NULL AND v_first_run_id IS NULL THEN
        FOUND := _raise('ZC003', format('scene %L', p_scene), 'instant', coalesce(
            (SELECT format('is before the first detection of the scene, which ended at %s; got %s', min(r.finished_at),
                           p_instant)
             FROM run r WHERE r.scene_id = v_scene_id AND r.error IS NULL HAVING count(*) > 0),
            'asks for conflicts of a scene that was never detected'), 'history_reaches_instant',
            'Before a detection, conflicts are unknown; there may be some.');
    END IF;
    IF coalesce(v_run_id, 0) < v_first_run_id THEN
        FOUND := _raise('ZC003', format('scene %L', p_scene), 'instant', format(
            'is before what is kept of its history, which begins at %s; got %s',
            (SELECT r.finished_at FROM run r WHERE r.run_id = v_first_run_id), p_instant), 'history_reaches_instant',
            'scene.history_kept, or else the setting conflictdb.history_kept, says how long history is kept.');
    END IF;
    RETURN QUERY
        SELECT e.conflict_id, e.a_key, CASE e.a_kind WHEN 0 THEN 'area' ELSE 'track' END,
               e.b_key, CASE e.b_kind WHEN 0 THEN 'area' ELSE 'track' END, e.periods, e.verdict, e.time_error_s,
               e.closest_at, e.closest_m, e.closest_error_m, e.opened_at, e.run_id,
               n.acknowledged_by, n.acknowledged_at, n.reason, n.until
        FROM (SELECT DISTINCT ON (x.conflict_id) x.* FROM conflict_event x
              WHERE x.scene_id = v_scene_id AND x.run_id <= v_run_id
              ORDER BY x.conflict_id, x.conflict_event_id DESC) e
        LEFT JOIN LATERAL (
            SELECT _acknowledger(k.acknowledged_by, k.given_name) AS acknowledged_by, k.acknowledged_at, k.reason,
                   k.until
            FROM acknowledgement k JOIN scene s USING (scene_id)
            WHERE k.scene_id = v_scene_id AND k.conflict_id = e.conflict_id AND k.acknowledged_at <= p_instant
              AND coalesce(k.ended_at > p_instant, true) AND coalesce(k.until > p_instant, true)
              AND NOT _has_grown(e.periods, e.verdict, e.time_error_s, e.closest_m, e.closest_error_m, k.periods,
                                 k.verdict, k.time_error_s, k.closest_m, k.closest_error_m, s.tolerance_m)
            ORDER BY k.acknowledgement_id DESC LIMIT 1) n ON true
        WHERE e.kind <> 'closed'
        ORDER BY lower(e.periods) NULLS FIRST, e.a_key, e.b_key;
END
$$;
COMMENT ON FUNCTION conflicts_known_at(text, timestamptz) IS
'Conflicts of a scene as known at an instant: found by the last detection before it, with acknowledgements in force '
'then. periods is when they conflict; WHERE periods @> instant selects one. Raises ZC003 for an instant before the '
'first detection or before the history that is kept.';
