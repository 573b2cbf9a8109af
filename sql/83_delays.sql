-- Departures of a track that are in conflict: looked up where a detection has stored them (62_differences.sql), else
-- computed by a worker, with the requests and replies of probes.

CREATE OR REPLACE FUNCTION conflictdb_internal._check_horizon(
    p_key text, p_horizon interval, p_now timestamptz
) RETURNS void
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
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
END
$$;
COMMENT ON FUNCTION _check_horizon(text, interval, timestamptz) IS
'Raises ZC003 for a horizon that is negative or too long, or an infinite p_now.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_track(p_scene_id bigint, p_key text) RETURNS void
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM track t WHERE t.scene_id = p_scene_id AND t.key = p_key) THEN
        FOUND := _raise('ZC011', format('track %s', quote_nullable(p_key)), 'key',
                        format('is not a track of scene %L',
                               (SELECT s.name FROM scene s WHERE s.scene_id = p_scene_id)),
                        'object_known');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_track(bigint, text) IS 'Raises ZC011 for an unknown track.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_delays_request(
    p_scene_id bigint, p_key text, p_horizon interval, p_now timestamptz
) RETURNS void
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _check_horizon(p_key, p_horizon, p_now);
    PERFORM _check_track(p_scene_id, p_key);
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
BEGIN
    PERFORM _check_delays_request(v_scene_id, p_key, p_horizon, p_now);
    RETURN _request(v_scene_id, 'delays', NULL, jsonb_build_object(
        'key', p_key, 'horizon_s', extract(epoch FROM p_horizon),
        'now_us', (extract(epoch FROM p_now) * 1000000)::bigint));
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
    PERFORM _await_answer(p_probe_id, p_timeout, 'delays');
    SELECT p.answer INTO v_delays FROM probe_request p WHERE p.probe_id = p_probe_id;
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

-- Without a worker.

CREATE OR REPLACE FUNCTION conflictdb_internal._first_stop(
    p_path geometry, p_departures timestamptz[], OUT starts_us bigint, OUT leaves_us bigint
)
LANGUAGE plpgsql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_first geometry := ST_StartPoint(p_path);
    v_stands integer := 1;
BEGIN
    -- As conflictdb.earth.geodesy.is_standing.
    WHILE v_stands < ST_NPoints(p_path)
          AND NOT _is_moving(v_first, ST_PointN(p_path, v_stands + 1), 'great_circle', 'wgs84') LOOP
        v_stands := v_stands + 1;
    END LOOP;
    -- All voyages are delayed together: by what the first one may be.
    starts_us := coalesce(round(extract(epoch FROM p_departures[1]) * 1000000)::bigint, round(ST_M(v_first) * 1e6));
    leaves_us := starts_us + round(ST_M(ST_PointN(p_path, v_stands)) * 1e6)::bigint
                 - round(ST_M(v_first) * 1e6)::bigint;
END
$$;
COMMENT ON FUNCTION _first_stop(geometry, timestamptz[]) IS
'When the first voyage of a track begins, and leaves its first waypoint, microseconds; later if its first leg stands '
'still.';

CREATE OR REPLACE FUNCTION conflictdb_internal._leeway(
    p_starts_us bigint, p_leaves_us bigint, p_horizon_us bigint, p_now_us bigint,
    OUT waits boolean, OUT has_departed boolean, OUT first_us bigint, OUT last_us bigint
)
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT p_leaves_us > p_starts_us, d.has_departed,
           CASE WHEN d.has_departed THEN 0
                ELSE greatest(-p_horizon_us, p_now_us - CASE WHEN p_now_us <= p_starts_us THEN p_starts_us
                                                             ELSE p_leaves_us END) END,
           CASE WHEN d.has_departed THEN 0 ELSE p_horizon_us END
    FROM (SELECT coalesce(p_leaves_us < p_now_us, false) AS has_departed) d;
END;
COMMENT ON FUNCTION _leeway(bigint, bigint, bigint, bigint) IS
'The delays of a track that are possible, microseconds, if nothing departs before p_now_us (null: no limit); whether '
'its first leg stands still, and whether it has left its first waypoint (stages.delays.Leeway).';

CREATE OR REPLACE FUNCTION conflictdb_internal._stored_horizon_us(p_scene_id bigint) RETURNS bigint
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT round(s.delays_within_s * 1e6)::bigint FROM scene s
    WHERE s.scene_id = p_scene_id AND s.delays_within_s > 0 AND _is_current(p_scene_id);
END;
COMMENT ON FUNCTION _stored_horizon_us(bigint) IS
'Up to which delay, microseconds, the stored differences of a scene are complete; null: they are not.';

CREATE OR REPLACE FUNCTION conflictdb_internal._known_delays(
    p_scene_id bigint, p_key text, p_horizon_us bigint, p_now_us bigint
) RETURNS TABLE (
    key text, least_later_s double precision, least_earlier_s double precision, blocked_by text[], forbidden jsonb,
    waits boolean, has_departed boolean, earliest_s double precision, latest_s double precision
)
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT
-- With extra_float_digits, numbers keep all digits.
SET extra_float_digits = 1 SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET jit = off AS $$
#variable_conflict use_column
DECLARE
    v_within int8range := int8range(-p_horizon_us, p_horizon_us, '[]');
    v_beyond int8range := int8range(-p_horizon_us - 1, p_horizon_us + 1, '[]');
    v_tracks bigint[];
BEGIN
    -- A condition for both would read all tracks.
    IF p_key IS NULL THEN
        v_tracks := ARRAY(SELECT t.track_id FROM track t WHERE t.scene_id = p_scene_id);
    ELSE
        v_tracks := ARRAY(SELECT t.track_id FROM track t WHERE t.scene_id = p_scene_id AND t.key = p_key);
    END IF;
    RETURN QUERY
    SELECT t.key,
           CASE WHEN n.low_us IS NULL THEN 0 WHEN n.high_us < l.last_us THEN (n.high_us + 1) / 1e6::float END,
           CASE WHEN n.low_us IS NULL THEN 0 WHEN n.low_us > l.first_us THEN (1 - n.low_us) / 1e6::float END,
           ARRAY(SELECT coalesce(a.key, o.key)
                 FROM difference d
                 LEFT JOIN area a ON d.other_kind = 0 AND a.area_id = d.other_id
                 LEFT JOIN track o ON d.other_kind = 1 AND o.track_id = d.other_id
                 WHERE d.scene_id = p_scene_id AND d.track_id = t.track_id
                   AND d.forbidden_us @> int8range(l.first_us, l.last_us, '[]')
                 ORDER BY 1),
           coalesce(f.forbidden, '[]'), l.waits, l.has_departed, l.first_us / 1e6::float, l.last_us / 1e6::float
    FROM unnest(v_tracks) m
    JOIN track t ON t.track_id = m
    CROSS JOIN LATERAL _first_stop(t.path, t.departures) s
    CROSS JOIN LATERAL _leeway(s.starts_us, s.leaves_us, p_horizon_us, p_now_us) l
    CROSS JOIN LATERAL (SELECT range_agg(r * v_within) AS forbidden
                        FROM difference d CROSS JOIN unnest(d.forbidden_us) r
                        WHERE d.scene_id = p_scene_id AND d.track_id = t.track_id OFFSET 0) u
    CROSS JOIN LATERAL (SELECT range_agg(r * v_beyond) AS proven
                        FROM difference d CROSS JOIN unnest(d.proven_us) r
                        WHERE d.scene_id = p_scene_id AND d.track_id = t.track_id OFFSET 0) v
    LEFT JOIN LATERAL (SELECT lower(r) AS low_us, upper(r) - 1 AS high_us
                       FROM unnest(u.forbidden) r WHERE r @> 0::bigint) n ON true
    CROSS JOIN LATERAL (
        SELECT jsonb_agg(jsonb_build_object(
                   'from_s', i.low_us / 1e6::float, 'to_s', i.high_us / 1e6::float,
                   'from_error_s', (coalesce(p.low_us, i.high_us) - i.low_us) / 1e6::float,
                   'to_error_s', (i.high_us - coalesce(p.high_us, i.low_us)) / 1e6::float,
                   'is_proven', p.parts = 1, 'by', to_jsonb(b.keys)) ORDER BY i.low_us) AS forbidden
        FROM (SELECT lower(r) AS low_us, upper(r) - 1 AS high_us, r AS span FROM unnest(u.forbidden) r) i
        -- At the end of a proven interval two objects may share only the last instant of one of them.
        CROSS JOIN LATERAL (SELECT min(lower(r) + 1) AS low_us, max(upper(r) - 2) AS high_us, count(*) AS parts
                            FROM unnest(v.proven) r
                            WHERE upper(r) - lower(r) > 2 AND lower(r) + 1 BETWEEN i.low_us AND i.high_us) p
        CROSS JOIN LATERAL (SELECT ARRAY(SELECT coalesce(a.key, o.key)
                                         FROM difference d
                                         LEFT JOIN area a ON d.other_kind = 0 AND a.area_id = d.other_id
                                         LEFT JOIN track o ON d.other_kind = 1 AND o.track_id = d.other_id
                                         WHERE d.scene_id = p_scene_id AND d.track_id = t.track_id
                                           AND d.forbidden_us && i.span
                                         ORDER BY 1) AS keys) b) f
    ORDER BY t.key;
END
$$;
COMMENT ON FUNCTION _known_delays(bigint, text, bigint, bigint) IS
'delays_of, of a scene by id and with times in microseconds, from stored differences that are complete.';

CREATE OR REPLACE FUNCTION conflictdb_internal._stored_differences(
    p_scene_id bigint, p_key text, p_horizon_us bigint, OUT key text, OUT starts_us bigint, OUT leaves_us bigint,
    OUT others text[], OUT low_us bigint[], OUT high_us bigint[], OUT is_proven boolean[]
) RETURNS SETOF record
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET jit = off AS $$
#variable_conflict use_column
DECLARE
    v_tracks bigint[];
BEGIN
    IF (p_horizon_us <= _stored_horizon_us(p_scene_id)) IS NOT TRUE THEN
        RETURN NEXT;  -- nulls
        RETURN;
    END IF;
    -- A condition for both would read all tracks.
    IF p_key IS NULL THEN
        v_tracks := ARRAY(SELECT t.track_id FROM track t WHERE t.scene_id = p_scene_id);
    ELSE
        v_tracks := ARRAY(SELECT t.track_id FROM track t WHERE t.scene_id = p_scene_id AND t.key = p_key);
    END IF;
    RETURN QUERY
    SELECT t.key, s.starts_us, s.leaves_us, i.others, i.low_us, i.high_us, i.is_proven
    FROM unnest(v_tracks) m
    JOIN track t ON t.track_id = m
    CROSS JOIN LATERAL _first_stop(t.path, t.departures) s
    CROSS JOIN LATERAL (
        SELECT coalesce(array_agg(coalesce(a.key, o.key)), '{}') AS others, coalesce(array_agg(r.low), '{}') AS low_us,
               coalesce(array_agg(r.high), '{}') AS high_us, coalesce(array_agg(r.is_proven), '{}') AS is_proven
        FROM difference d
        LEFT JOIN area a ON d.other_kind = 0 AND a.area_id = d.other_id
        LEFT JOIN track o ON d.other_kind = 1 AND o.track_id = d.other_id
        CROSS JOIN LATERAL (
            SELECT lower(f) AS low, upper(f) - 1 AS high, false AS is_proven FROM unnest(d.forbidden_us) f
            UNION ALL SELECT lower(f), upper(f) - 1, true FROM unnest(d.proven_us) f) r
        WHERE d.scene_id = p_scene_id AND d.track_id = t.track_id OFFSET 0) i
    ORDER BY t.key;
END
$$;
COMMENT ON FUNCTION _stored_differences(bigint, text, bigint) IS
'Stored differences of a track, or of each, as closed intervals, forbidden or proven, with the key of the other '
'object; when it begins, and leaves its first waypoint. A row of nulls: they are not complete, or not within this '
'horizon.';

CREATE OR REPLACE FUNCTION delays_of(
    p_scene text, p_key text DEFAULT NULL, p_horizon interval DEFAULT NULL, p_now timestamptz DEFAULT NULL
) RETURNS TABLE (
    key text, least_later_s double precision, least_earlier_s double precision, blocked_by text[], forbidden jsonb,
    waits boolean, has_departed boolean, earliest_s double precision, latest_s double precision
)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_who text := format('scene %L', p_scene);
    v_within_s double precision := (SELECT s.delays_within_s FROM scene s WHERE s.scene_id = v_scene_id);
    v_stored_us bigint := _stored_horizon_us(v_scene_id);
    v_horizon_us bigint;
BEGIN
    IF v_within_s = 0 THEN
        FOUND := _raise('ZC009', v_who, 'delays_within_s', 'is 0: no delays are stored', 'delays_stored',
                        format('Set it and detect: SELECT conflictdb.create_scene(%L, p_delays_within_s => 7200)',
                               p_scene));
    END IF;
    PERFORM _check_horizon(p_key, coalesce(p_horizon, interval '0'), p_now);
    v_horizon_us := coalesce(round(extract(epoch FROM p_horizon) * 1000000)::bigint, v_stored_us);
    IF v_horizon_us > round(v_within_s * 1e6) THEN
        FOUND := _raise('ZC003', v_who, 'horizon', format('must be at most delays_within_s, %s s; got %s', v_within_s,
                        p_horizon), 'horizon_stored', 'request_delays asks a worker.');
    END IF;
    IF v_stored_us IS NULL THEN
        FOUND := _raise('ZC014', v_who, 'is_current', format('is not current: %s',
                        (SELECT s.remark FROM _scene_state(p_scene) s)), 'scene_current_in_time',
                        'wait_until_current waits for a detection, request_delays asks a worker.');
    END IF;
    IF p_key IS NOT NULL THEN
        PERFORM _check_track(v_scene_id, p_key);
    END IF;
    RETURN QUERY SELECT k.* FROM _known_delays(v_scene_id, p_key, v_horizon_us,
                                               round(extract(epoch FROM p_now) * 1000000)::bigint) k;
END
$$;
COMMENT ON FUNCTION delays_of(text, text, interval, timestamptz) IS
'When a track of a current scene with delays_within_s could depart instead, up to p_horizon later or earlier (null: '
'delays_within_s), and not before p_now; columns of wait_for_delays. p_key null: each track. Needs no worker. Raises '
'ZC009 for a scene that stores no delays, ZC014 for one that is not current.';
