-- Departures of a track that are in conflict: requests to workers, and the differences that a detection has stored
-- (62_differences.sql), from which core.delays answers.

CREATE OR REPLACE FUNCTION conflictdb_internal._longest_horizon_s() RETURNS integer
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    -- 115 days: longer than a plan of this kind, and short enough for a worker.
    SELECT 10000000;
END;
COMMENT ON FUNCTION _longest_horizon_s() IS 'How much later or earlier a question about departures looks, seconds.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_delays_request(
    p_scene_id bigint, p_key text, p_horizon interval, p_now timestamptz
) RETURNS void
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_who text := format('object %s', quote_nullable(p_key));
BEGIN
    IF extract(epoch FROM p_horizon) BETWEEN 0 AND _longest_horizon_s() IS NOT TRUE THEN
        FOUND := _raise('ZC003', v_who, 'horizon', format('must be an interval from 0 to %s s; got %s',
                        _longest_horizon_s(), coalesce(p_horizon::text, 'null')), 'horizon_finite');
    END IF;
    IF NOT (p_now >= '0001-01-01 00:00+00' AND p_now < '10000-01-01 00:00+00') THEN
        FOUND := _raise('ZC003', v_who, 'now', format('must be an instant in the years 1 to 9999, or null; got %s',
                        p_now), 'now_finite');
    END IF;
    IF NOT EXISTS (SELECT FROM track t WHERE t.scene_id = p_scene_id AND t.key = p_key)
       AND NOT EXISTS (SELECT FROM area a WHERE a.scene_id = p_scene_id AND a.key = p_key) THEN
        FOUND := _raise('ZC011', v_who, 'key', format('is not a track or an area of scene %L', (
                            SELECT s.name FROM scene s WHERE s.scene_id = p_scene_id)), 'object_known');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_delays_request(bigint, text, interval, timestamptz) IS
'Raises an error (class ZC) for an unknown object, a horizon that is negative or too long, or a p_now that no plan '
'reaches.';

CREATE OR REPLACE FUNCTION request_delays(
    p_scene text, p_key text, p_horizon interval DEFAULT interval '2 hours', p_now timestamptz DEFAULT NULL,
    p_margin interval DEFAULT interval '0', p_margin_m double precision DEFAULT 0, p_from timestamptz DEFAULT NULL,
    p_to timestamptz DEFAULT NULL, p_best integer DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_options jsonb;
BEGIN
    PERFORM _check_delays_request(v_scene_id, p_key, p_horizon, p_now);
    v_options := jsonb_build_object(
        'key', p_key, 'horizon_s', extract(epoch FROM p_horizon),
        'now_us', (extract(epoch FROM p_now) * 1000000)::bigint,
        'margin_s', extract(epoch FROM coalesce(p_margin, interval '0')));
    -- Infinity and NaN are no numbers of JSON: as texts they are refused.
    v_options := v_options || jsonb_build_object(
        'margin_m', coalesce(p_margin_m, 0), 'best', p_best,
        'from_us', CASE WHEN isfinite(p_from) THEN to_jsonb(trunc(extract(epoch FROM p_from) * 1000000))
                        ELSE to_jsonb(p_from::text) END,
        'to_us', CASE WHEN isfinite(p_to) THEN to_jsonb(trunc(extract(epoch FROM p_to) * 1000000))
                      ELSE to_jsonb(p_to::text) END);
    RETURN _request(v_scene_id, 'delays', NULL, v_options);
END
$$;
COMMENT ON FUNCTION request_delays(
    text, text, interval, timestamptz, interval, double precision, timestamptz, timestamptz, integer) IS
'Asks the workers when a track or an area could depart instead, up to p_horizon later or earlier, and not before '
'p_now; returns an id for wait_for_delays, to be called after commit. An area departs when it is first active. '
'p_margin, p_margin_m: wanted on top of the required separations in time and in distance, metres. p_from, p_to, '
'p_best: return the free windows of departures between these instants, at most p_best, nearest to the plan first.';

CREATE OR REPLACE FUNCTION wait_for_delays(
    p_probe_id bigint, p_timeout interval DEFAULT interval '1 minute',
    OUT key text, OUT least_later_s double precision, OUT least_earlier_s double precision, OUT blocked_by text[],
    OUT forbidden jsonb, OUT waits boolean, OUT has_departed boolean, OUT earliest_s double precision,
    OUT latest_s double precision, OUT departs_at timestamptz, OUT margin_s double precision,
    OUT margin_m double precision, OUT slots jsonb, OUT closed jsonb
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
           (v_delays ->> 'earliest_s')::double precision, (v_delays ->> 'latest_s')::double precision,
           (v_delays ->> 'departs_at')::timestamptz, (v_delays ->> 'margin_s')::double precision,
           (v_delays ->> 'margin_m')::double precision, nullif(v_delays -> 'slots', 'null'),
           nullif(v_delays -> 'closed', 'null')
        INTO key, least_later_s, least_earlier_s, blocked_by, forbidden, waits, has_departed, earliest_s, latest_s,
             departs_at, margin_s, margin_m, slots, closed;
END
$$;
COMMENT ON FUNCTION wait_for_delays(bigint, interval) IS
'Waits for the reply of a worker to request_delays, computed from the objects as they are stored. least_later_s, '
'least_earlier_s: seconds that the plan must depart later, or earlier, at least to meet nothing; 0 without a '
'conflict, null if no possible delay is enough. blocked_by: objects that forbid every possible delay. forbidden: '
'departures in conflict, a list of {"from_s", "to_s", "from_error_s", "to_error_s", "is_proven", "by"}: seconds of '
'delay, negative for earlier, and keys. waits: whether its first leg stands still, so that it occupies its first '
'waypoint until it departs. has_departed: whether it did before p_now. earliest_s, latest_s: the possible delays. '
'departs_at: the planned departure. margin_s, margin_m: of the request; departures that come nearer are forbidden, '
'too. slots: the free windows asked for, best first, a list of {"from_s", "to_s", "from_at", "to_at"}. closed: what '
'closes the other departures, a list of these with "by" and "opened_by": they are free if each of these areas ends '
'at its "ends_at", or starts at its "starts_at"; empty if that is not enough. Errors and lifetime are those of '
'wait_for_probe.';

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

CREATE OR REPLACE FUNCTION conflictdb_internal._stored_horizon_us(p_scene_id bigint) RETURNS bigint
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT round(s.delays_within_s * 1e6)::bigint FROM scene s
    WHERE s.scene_id = p_scene_id AND s.delays_within_s > 0 AND _is_current(p_scene_id);
END;
COMMENT ON FUNCTION _stored_horizon_us(bigint) IS
'Up to which delay, microseconds, the stored differences of a scene are complete; null: they are not.';

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
