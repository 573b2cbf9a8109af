-- Departures of a track that are in conflict, computed by a worker: requests and replies are those of probes.

CREATE OR REPLACE FUNCTION conflictdb_internal._check_delays_request(
    p_scene_id bigint, p_key text, p_horizon interval, p_now timestamptz
) RETURNS void
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    -- 115 days: longer than a plan of this kind, and short enough for a worker.
    c_longest_s CONSTANT double precision := 1e7;
BEGIN
    IF extract(epoch FROM p_horizon) BETWEEN 0 AND c_longest_s IS NOT TRUE THEN
        FOUND := _raise('ZC003', format('track %s', quote_nullable(p_key)), 'horizon',
                        format('must be an interval from 0 to %s s; got %s', c_longest_s,
                               coalesce(p_horizon::text, 'null')), 'horizon_finite');
    END IF;
    IF NOT isfinite(p_now) THEN
        FOUND := _raise('ZC003', format('track %s', quote_nullable(p_key)), 'now',
                        format('must be an instant, or null; got %s', p_now), 'now_finite');
    END IF;
    IF NOT EXISTS (SELECT FROM track t WHERE t.scene_id = p_scene_id AND t.key = p_key) THEN
        FOUND := _raise('ZC011', format('track %s', quote_nullable(p_key)), 'key',
                        format('is not a track of scene %L',
                               (SELECT s.name FROM scene s WHERE s.scene_id = p_scene_id)),
                        'object_known');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_delays_request(bigint, text, interval, timestamptz) IS
'Raises an error (class ZC) for an unknown track, a horizon that is negative or too long, or an infinite p_now.';

CREATE OR REPLACE FUNCTION request_delays(
    p_scene text, p_key text, p_horizon interval DEFAULT interval '2 hours', p_now timestamptz DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_probe_id bigint;
BEGIN
    PERFORM _check_delays_request(v_scene_id, p_key, p_horizon, p_now);
    PERFORM _prune_probes();
    INSERT INTO probe_request (scene_id, object_kind, key, horizon, active_span)
        VALUES (v_scene_id, 1, p_key, p_horizon, tstzrange(p_now, NULL)) RETURNING probe_id INTO v_probe_id;
    PERFORM _wake_workers();
    RETURN v_probe_id;
END
$$;
COMMENT ON FUNCTION request_delays(text, text, interval, timestamptz) IS
'Asks the workers when a track could depart instead, up to p_horizon later or earlier, and not before p_now; returns '
'an id for wait_for_delays, to be called after commit.';

CREATE OR REPLACE FUNCTION wait_for_delays(
    p_probe_id bigint, p_timeout interval DEFAULT interval '1 minute',
    OUT key text, OUT least_later_s double precision, OUT least_earlier_s double precision, OUT blocked_by text[],
    OUT forbidden jsonb, OUT waits boolean, OUT has_departed boolean, OUT earliest_s double precision,
    OUT latest_s double precision
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_delays jsonb;
BEGIN
    PERFORM _await_answer(p_probe_id, p_timeout, true);
    SELECT p.delays INTO v_delays FROM probe_request p WHERE p.probe_id = p_probe_id;
    SELECT v_delays ->> 'key', (v_delays ->> 'least_later_s')::double precision,
           (v_delays ->> 'least_earlier_s')::double precision,
           ARRAY(SELECT jsonb_array_elements_text(v_delays -> 'blocked_by')), v_delays -> 'forbidden',
           (v_delays ->> 'waits')::boolean, (v_delays ->> 'has_departed')::boolean,
           (v_delays ->> 'earliest_s')::double precision, (v_delays ->> 'latest_s')::double precision
        INTO key, least_later_s, least_earlier_s, blocked_by, forbidden, waits, has_departed, earliest_s, latest_s;
END
$$;
COMMENT ON FUNCTION wait_for_delays(bigint, interval) IS
'Waits for the reply of a worker to request_delays, computed from the objects as they are stored. least_later_s, '
'least_earlier_s: seconds that the track must depart later, or earlier, at least to meet nothing; 0 without a '
'conflict, null if no possible delay is enough. blocked_by: objects that forbid every possible delay. forbidden: '
'departures in conflict, a list of {"from_s", "to_s", "from_error_s", "to_error_s", "is_proven", "by"}: seconds of '
'delay, negative for earlier, and keys. waits: whether its first leg stands still, so that it occupies its first '
'waypoint until it departs. has_departed: whether it did before p_now. earliest_s, latest_s: the possible delays. '
'Errors and lifetime are those of wait_for_probe.';
