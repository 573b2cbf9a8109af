-- Probes with times: which objects a plan would conflict with, and when, to the scene's tolerance. Workers run stages 3
-- and 4, so a request is a row that must be committed first. The role that asked and workers see request and reply.

CREATE OR REPLACE FUNCTION conflictdb_internal._instant_of(p_us bigint) RETURNS timestamptz
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- In two steps, because microseconds may have more digits than a double.
    SELECT CASE WHEN abs(p_us::numeric) < 9e18 THEN
        to_timestamp(0) + p_us / 1000000 * interval '1 second' + p_us % 1000000 * interval '1 microsecond' END;
END;
COMMENT ON FUNCTION _instant_of(bigint) IS
'Converts microseconds since 1970 to an instant; null (unbounded) from 9e18 on.';

CREATE OR REPLACE FUNCTION conflictdb_internal._pieces_meeting(
    p_scene_id bigint, p_most_compared bigint, p_key text, p_hulls bytea[], p_starts_us bigint[], p_ends_us bigint[],
    p_inclusive boolean[], p_floors_m double precision[], p_ceilings_m double precision[], p_turns integer[]
) RETURNS TABLE (n bigint, piece_id bigint, pieces integer, object_number bigint, part integer)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT
-- Forces the index join, as in _candidates.
SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off SET enable_seqscan = off
SET jit = off AS $$
BEGIN
    RETURN QUERY
        WITH near AS MATERIALIZED (
            SELECT q.n, q.hull, q.span, p.piece_id, p.pieces, p.object_kind, p.object_id
            FROM (SELECT u.n, u.floor_m, u.ceiling_m, u.turn,
                         ST_GeomFromWKB(u.wkb, (SELECT _plane_srid(_plane(s.motion, s.earth, s.centre_lon,
                                                                          s.centre_lat))
                                                FROM scene s WHERE s.scene_id = p_scene_id)) AS hull,
                         tstzrange(_instant_of(u.start_us), _instant_of(u.end_us),
                                   CASE WHEN u.is_inclusive THEN '[]' ELSE '[)' END) AS span
                  FROM unnest(p_hulls, p_starts_us, p_ends_us, p_inclusive, p_floors_m, p_ceilings_m, p_turns)
                       WITH ORDINALITY u (wkb, start_us, end_us, is_inclusive, floor_m, ceiling_m, turn, n)
                  OFFSET 0) q
            JOIN piece p ON p.hull && q.hull AND p.span && q.span AND p.scene_id = p_scene_id
            WHERE p.floor_m < q.ceiling_m AND q.floor_m < p.ceiling_m AND (p.turn = 0 OR q.turn = 0)
              AND NOT EXISTS (SELECT FROM area a
                              WHERE p.object_kind = 0 AND a.area_id = p.object_id AND a.key = p_key)
              AND NOT EXISTS (SELECT FROM track t
                              WHERE p.object_kind = 1 AND t.track_id = p.object_id AND t.key = p_key)
        )
        SELECT m.n - 1, m.piece_id, m.pieces, _object_number(m.object_kind, m.object_id), u.part
        FROM near m
        CROSS JOIN (SELECT coalesce(sum(c.pieces), 0) <= p_most_compared AS is_few FROM near c) f
        LEFT JOIN LATERAL (SELECT u.part FROM piece p
                           CROSS JOIN LATERAL _pieces_of(p.part, p.hull, p.span, p.shape, p.parts, p.hulls, p.shapes,
                                                         p.cuts) u
                           WHERE f.is_few AND p.piece_id = m.piece_id AND u.hull && m.hull AND u.span && m.span
                             AND _boxes_meet(u.hull, m.hull) AND _hulls_meet(u.hull, m.hull) OFFSET 0) u ON true
        WHERE NOT f.is_few OR u.part IS NOT NULL;
END
$$;
COMMENT ON FUNCTION _pieces_meeting(bigint, bigint, text, bytea[], bigint[], bigint[], boolean[], double precision[],
                                    double precision[], integer[]) IS
'Stages 1 and 2 for pieces that are not stored: pairs of a given piece (n, from 0) and a piece (row and part) of the '
'scene, which overlap in time and height and whose hulls meet. If more than p_most_compared pairs of pieces are to be '
'compared, stage 1 only: pairs of a given piece and a row, without part. Skips the object p_key.';

CREATE OR REPLACE FUNCTION conflictdb_internal._keys_of(p_scene_id bigint, p_kinds smallint[], p_ids bigint[])
RETURNS TABLE (kind smallint, id bigint, key text, name text)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT u.kind, u.id, coalesce(a.key, t.key), coalesce(a.name, t.name)
    FROM unnest(p_kinds, p_ids) u (kind, id)
    LEFT JOIN area a ON u.kind = 0 AND a.area_id = u.id AND a.scene_id + 0 = p_scene_id
    LEFT JOIN track t ON u.kind = 1 AND t.track_id = u.id AND t.scene_id + 0 = p_scene_id
    WHERE coalesce(a.key, t.key) IS NOT NULL;
END;
COMMENT ON FUNCTION _keys_of(bigint, smallint[], bigint[]) IS 'Keys and names of objects of a scene, by kind and id.';

CREATE OR REPLACE FUNCTION conflictdb_internal._prune_probes() RETURNS void
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    DELETE FROM probe_request p WHERE p.asked_at < now() - interval '1 hour';
END
$$;
COMMENT ON FUNCTION _prune_probes() IS
'Deletes old requests and their replies. Runs as its owner: the right to delete rows would include locking the table. '
'Restricted to requests older than an hour.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_area_probe(
    p_footprint geometry, p_active_span tstzrange, p_floor_m double precision, p_ceiling_m double precision
) RETURNS void
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'what is asked about';
BEGIN
    PERFORM _check_place(p_footprint, p_active_span, p_floor_m, p_ceiling_m);
    IF GeometryType(p_footprint) NOT IN ('POLYGON', 'MULTIPOLYGON') THEN
        FOUND := _raise('ZC001', c_who, 'footprint', format('must be a Polygon or MultiPolygon; got %s',
                        GeometryType(p_footprint)), 'footprint_polygon');
    END IF;
    -- Infinite instants cannot be converted to microseconds.
    IF lower(p_active_span) = 'infinity' OR upper(p_active_span) = '-infinity' THEN
        FOUND := _raise('ZC003', c_who, 'span', 'must not start at infinity or end at -infinity', 'span_finite');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_area_probe(geometry, tstzrange, double precision, double precision) IS
'Raises an error (class ZC) for an area that a worker could not probe.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_track_probe(
    p_scene_id bigint, p_path geometry, p_outline geometry, p_floor_m double precision, p_ceiling_m double precision,
    p_grow_mps double precision
) RETURNS void
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'what is asked about';
BEGIN
    IF p_path IS NULL OR GeometryType(p_path) <> 'LINESTRINGM' OR ST_IsEmpty(p_path) THEN
        FOUND := _raise('ZC001', c_who, 'path', format('must be a LineStringM with Unix seconds for M; got %s',
                        coalesce(GeometryType(p_path), 'null')), 'path_trajectory', 'track_path() makes one.');
    END IF;
    IF ST_SRID(p_path) <> 4326 THEN
        FOUND := _raise('ZC001', c_who, 'path', format('must have SRID 4326; got %s', ST_SRID(p_path)), 'path_srid');
    END IF;
    IF p_outline IS NULL OR GeometryType(p_outline) <> 'POLYGON' OR ST_IsEmpty(p_outline) THEN
        FOUND := _raise('ZC006', c_who, 'outline', format('must be a Polygon in metres; got %s',
                        coalesce(GeometryType(p_outline), 'null')), 'outline_polygon',
                        'rectangle_outline() makes one.');
    END IF;
    PERFORM _check_size(c_who, 'path', ST_NPoints(p_path), 'max_waypoints');
    PERFORM _check_size(c_who, 'outline', ST_NPoints(p_outline), 'max_vertices');
    -- The worker checks the rest; it cannot receive times that are not finite.
    IF NOT ST_Length(ST_SwapOrdinates(p_path, 'xm')) < 'infinity' OR NOT ST_Length(p_path) < 'infinity' THEN
        FOUND := _raise('ZC001', c_who, 'path', 'coordinates and times must be finite numbers', 'coordinates_finite');
    END IF;
    PERFORM _check_coordinates(c_who, 'path', p_path, p_scene_id);
    PERFORM _check_times(c_who, p_path);
    PERFORM _check_speed(c_who, p_path);
    PERFORM _check_heights(c_who, p_floor_m, p_ceiling_m);
END
$$;
COMMENT ON FUNCTION _check_track_probe(bigint, geometry, geometry, double precision, double precision,
                                       double precision) IS
'Raises an error (class ZC) for a track that a worker could not probe.';

-- Readers may insert requests directly, so every row is checked.

CREATE OR REPLACE FUNCTION conflictdb_internal._before_probe_request() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'what is asked about';
    -- Per role: more would delay others and fill the table.
    c_most_waiting CONSTANT integer := 1000;
BEGIN
    IF num_nonnulls(NEW.answered_at, NEW.is_current, NEW.error, NEW.delays, NEW.admission) > 0
       OR NEW.failures <> 0 THEN
        FOUND := _raise('ZC013', c_who, 'answered_at', 'can be set by workers only', 'probe_unanswered');
    END IF;
    NEW.asked_at := now();
    IF NEW.plans IS NOT NULL THEN
        -- A worker puts them.
        IF NOT _may_admit(NEW.asked_by, NEW.scene_id) THEN
            FOUND := _raise('42501', c_who, 'plans', format('role %I may not change this scene', NEW.asked_by),
                            'admission_permitted', 'GRANT conflictdb_editor, or share the scene for writing.');
        END IF;
        PERFORM _check_plans(NEW.plans), _check_word(c_who, 'owner', NEW.owner);
    ELSIF NEW.horizon IS NOT NULL THEN
        PERFORM _check_delays_request(NEW.scene_id, NEW.key, NEW.horizon, lower(NEW.active_span));
        NEW.active_span := tstzrange(lower(NEW.active_span), NULL);
    ELSIF NEW.object_kind = 0 THEN
        PERFORM _check_area_probe(NEW.footprint, NEW.active_span, NEW.floor_m, NEW.ceiling_m);
        NEW.active_span := _half_open(coalesce(NEW.active_span, tstzrange(NULL, NULL)),
                                      _is_closed(NEW.scene_id));
        NEW.active_span := tstzrange(nullif(lower(NEW.active_span), '-infinity'),
                                     nullif(upper(NEW.active_span), 'infinity'));
    ELSE
        PERFORM _check_track_probe(NEW.scene_id, NEW.path, NEW.outline, NEW.floor_m, NEW.ceiling_m, NEW.grow_mps);
    END IF;
    IF (SELECT count(*) FROM (SELECT FROM probe_request p WHERE p.asked_by = NEW.asked_by AND p.answered_at IS NULL
                              LIMIT c_most_waiting) w) >= c_most_waiting THEN
        FOUND := _raise('ZC017', c_who, 'probe_request',
                        format('%s questions of role %I wait already', c_most_waiting, NEW.asked_by),
                        'probe_request_few', 'Is a worker running? Wait for its answers.');
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _before_probe_request() IS
'Trigger: checks a request; refuses it if 1,000 requests of the same role are waiting.';
CREATE OR REPLACE TRIGGER probe_request_checked BEFORE INSERT ON probe_request
    FOR EACH ROW EXECUTE FUNCTION _before_probe_request();
ALTER TABLE probe_request ENABLE ALWAYS TRIGGER probe_request_checked;

CREATE OR REPLACE FUNCTION request_probe(
    p_scene text, p_footprint geometry, p_active_span tstzrange DEFAULT NULL,
    p_floor_m double precision DEFAULT NULL, p_ceiling_m double precision DEFAULT NULL, p_key text DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_probe_id bigint;
BEGIN
    PERFORM _check_area_probe(p_footprint, p_active_span, p_floor_m, p_ceiling_m);
    PERFORM _prune_probes();
    INSERT INTO probe_request (scene_id, object_kind, key, footprint, active_span, floor_m, ceiling_m)
        VALUES (v_scene_id, 0, p_key, ST_Multi(ST_Force2D(p_footprint)), p_active_span, p_floor_m, p_ceiling_m)
        RETURNING probe_id INTO v_probe_id;
    PERFORM _wake_workers();
    RETURN v_probe_id;
END
$$;
COMMENT ON FUNCTION request_probe(text, geometry, tstzrange, double precision, double precision, text) IS
'Asks the workers which objects an area (longitude and latitude, SRID 4326; [start, end); heights in metres; null: '
'unbounded) would conflict with, and when, to the scene''s tolerance; returns an id for wait_for_probe, to be called '
'after commit. p_key: object that the area would replace, which is ignored.';

CREATE OR REPLACE FUNCTION request_track_probe(
    p_scene text, p_path geometry, p_outline geometry, p_floor_m double precision DEFAULT NULL,
    p_ceiling_m double precision DEFAULT NULL, p_grow_mps double precision DEFAULT 0, p_key text DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_probe_id bigint;
BEGIN
    PERFORM _check_track_probe(v_scene_id, p_path, p_outline, p_floor_m, p_ceiling_m, p_grow_mps);
    PERFORM _prune_probes();
    INSERT INTO probe_request (scene_id, object_kind, key, path, outline, floor_m, ceiling_m, grow_mps)
        VALUES (v_scene_id, 1, p_key, p_path, ST_Force2D(p_outline), p_floor_m, p_ceiling_m, coalesce(p_grow_mps, 0))
        RETURNING probe_id INTO v_probe_id;
    PERFORM _wake_workers();
    RETURN v_probe_id;
END
$$;
COMMENT ON FUNCTION request_track_probe(text, geometry, geometry, double precision, double precision,
                                        double precision, text) IS
'Asks the workers which objects a track (path and outline as in put_track; heights in metres; null: unbounded) would '
'conflict with, and when, to the scene''s tolerance; returns an id for wait_for_probe, to be called after commit. '
'p_key: object that the track would replace, which is ignored.';

CREATE OR REPLACE FUNCTION conflictdb_internal._await_answer(
    p_probe_id bigint, p_timeout interval, p_is_delays boolean
) RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    c_pause_s CONSTANT double precision := 0.02;
    v_until timestamptz := clock_timestamp() + p_timeout;
    v_who text := format('probe %s', coalesce(p_probe_id::text, 'null'));
    v_request record;
BEGIN
    LOOP
        SELECT p.answered_at, p.asked_at, p.error, p.is_current INTO v_request
            FROM probe_request p WHERE p.probe_id = p_probe_id AND (p.horizon IS NOT NULL) = p_is_delays;
        IF NOT FOUND THEN
            FOUND := _raise('ZC011', v_who, 'probe_id', 'is not a request of this kind and role within the last hour',
                            'probe_known');
        END IF;
        EXIT WHEN v_request.answered_at IS NOT NULL;
        IF current_setting('transaction_isolation') <> 'read committed' THEN
            FOUND := _raise('ZC013', v_who, 'transaction',
                            format('is %s: it sees one state of the database until it ends, and would wait in vain',
                                   upper(current_setting('transaction_isolation'))),
                            'wait_sees_others', 'Wait in a transaction that is READ COMMITTED.');
        END IF;
        IF pg_current_xact_id_if_assigned() IS NOT NULL AND v_request.asked_at = now() THEN
            FOUND := _raise('ZC013', v_who, 'transaction', 'has asked, which no worker sees until it is committed',
                            'wait_sees_committed', 'Commit first.');
        END IF;
        IF clock_timestamp() >= v_until THEN
            FOUND := _raise('ZC015', v_who, 'answered_at', format('is not answered after %s', p_timeout),
                            'probe_answered_in_time', 'Is a worker running, and not at work on a large detection?');
        END IF;
        PERFORM pg_sleep(least(c_pause_s, extract(epoch FROM v_until - clock_timestamp())));
    END LOOP;
    IF v_request.error IS NOT NULL THEN
        FOUND := _raise('ZC016', v_who, 'plan', v_request.error, 'probe_can_be_answered');
    END IF;
    RETURN v_request.is_current;
END
$$;
COMMENT ON FUNCTION _await_answer(bigint, interval, boolean) IS
'Waits until a worker has replied to a request, for a probe or for delays; returns whether the scene was current then. '
'Raises ZC015 after p_timeout (null: waits without limit), ZC016 with the reason of an invalid plan, and ZC013 in a '
'transaction that cannot see the reply.';

CREATE OR REPLACE FUNCTION wait_for_probe(p_probe_id bigint, p_timeout interval DEFAULT interval '1 minute')
RETURNS TABLE (
    key text, kind text, verdict text, periods tstzmultirange, first_contact timestamptz, last_contact timestamptz,
    time_error_s double precision, first_contact_point geometry, closest_at timestamptz, closest_m double precision,
    closest_error_m double precision, lacking_s double precision, certainty text
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    IF EXISTS (SELECT FROM probe_request p WHERE p.probe_id = p_probe_id AND p.plans IS NOT NULL) THEN
        FOUND := _raise('ZC011', format('probe %s', p_probe_id), 'probe_id', 'is an admission', 'probe_known',
                        'Use wait_for_admission.');
    END IF;
    IF NOT _await_answer(p_probe_id, p_timeout, false) THEN
        RAISE NOTICE 'probe %: the scene was not current: changes of attached tables may be missing', p_probe_id;
    END IF;
    PERFORM _warn_if_beyond_horizon(s.name, CASE p.object_kind WHEN 0 THEN p.active_span ELSE _at_sea(p.path, NULL) END)
        FROM probe_request p JOIN scene s USING (scene_id) WHERE p.probe_id = p_probe_id;
    RETURN QUERY
        SELECT r.key, CASE r.object_kind WHEN 0 THEN 'area' ELSE 'track' END, r.verdict, r.periods, lower(r.periods),
               upper(r.periods), r.time_error_s, r.first_contact_point, r.closest_at, r.closest_m, r.closest_error_m,
               r.lacking_s, r.certainty
        FROM probe_reply r WHERE r.probe_id = p_probe_id ORDER BY lower(r.periods) NULLS FIRST, r.key;
END
$$;
COMMENT ON FUNCTION wait_for_probe(bigint, interval) IS
'Waits for the reply to a probe; returns the objects that the plan would conflict with, with columns as in the view '
'conflicts. Raises ZC015 after p_timeout (null: waits without limit), ZC016 with the reason for an invalid plan, and '
'ZC013 in a transaction that cannot see the reply. Replies are kept for an hour, for the role that asked.';

-- For Python.

CREATE OR REPLACE FUNCTION conflictdb_internal._request_probe(
    p_scene text, p_key text, p_kind integer, p_footprint bytea, p_start_us bigint, p_end_us bigint, p_path bytea,
    p_outline bytea, p_floor_m double precision, p_ceiling_m double precision, p_grow_mps double precision
) RETURNS bigint
LANGUAGE sql VOLATILE CALLED ON NULL INPUT
BEGIN ATOMIC
    SELECT CASE p_kind
        WHEN 0 THEN request_probe(p_scene, ST_GeomFromWKB(p_footprint, 4326),
                                  tstzrange(_instant_of(p_start_us), _instant_of(p_end_us)), p_floor_m, p_ceiling_m,
                                  p_key)
        ELSE request_track_probe(p_scene, ST_GeomFromWKB(p_path, 4326), ST_GeomFromWKB(p_outline), p_floor_m,
                                 p_ceiling_m, p_grow_mps, p_key) END;
END;
COMMENT ON FUNCTION _request_probe(text, text, integer, bytea, bigint, bigint, bytea, bytea, double precision,
                                   double precision, double precision) IS
'request_probe (kind 0) or request_track_probe (kind 1): geometries as WKB, instants in microseconds since 1970.';

CREATE OR REPLACE FUNCTION conflictdb_internal._wait_for_probe(p_probe_id bigint, p_timeout interval)
RETURNS TABLE (
    key text, name text, kind text, verdict text, periods bytea, time_error_s double precision,
    lon_deg double precision, lat_deg double precision, closest_at timestamptz, closest_m double precision,
    closest_error_m double precision, lacking_s double precision, certainty text
)
LANGUAGE sql VOLATILE
BEGIN ATOMIC
    SELECT w.key, coalesce(a.name, t.name), w.kind, w.verdict, multirange_send(w.periods), w.time_error_s,
           ST_X(w.first_contact_point), ST_Y(w.first_contact_point), w.closest_at, w.closest_m, w.closest_error_m,
           w.lacking_s, w.certainty
    FROM wait_for_probe(p_probe_id, p_timeout) w
    LEFT JOIN probe_request p ON p.probe_id = p_probe_id
    LEFT JOIN area a ON w.kind = 'area' AND a.scene_id = p.scene_id AND a.key = w.key
    LEFT JOIN track t ON w.kind = 'track' AND t.scene_id = p.scene_id AND t.key = w.key;
END;
COMMENT ON FUNCTION _wait_for_probe(bigint, interval) IS
'As wait_for_probe, with the names of the objects and with periods in binary.';

CREATE OR REPLACE FUNCTION conflictdb_internal._request_probes(
    p_scene text, p_keys text[], p_kinds integer[], p_footprints bytea[], p_starts_us bigint[], p_ends_us bigint[],
    p_paths bytea[], p_outlines bytea[], p_floors_m double precision[], p_ceilings_m double precision[],
    p_grow_mps double precision[]
) RETURNS bigint[]
LANGUAGE sql VOLATILE STRICT
BEGIN ATOMIC
    SELECT array_agg(_request_probe(p_scene, u.key, u.kind, u.footprint, u.start_us, u.end_us, u.path, u.outline,
                                    u.floor_m, u.ceiling_m, u.grow_mps) ORDER BY u.n)
    FROM unnest(p_keys, p_kinds, p_footprints, p_starts_us, p_ends_us, p_paths, p_outlines, p_floors_m, p_ceilings_m,
                p_grow_mps) WITH ORDINALITY
         u (key, kind, footprint, start_us, end_us, path, outline, floor_m, ceiling_m, grow_mps, n);
END;
COMMENT ON FUNCTION _request_probes(text, text[], integer[], bytea[], bigint[], bigint[], bytea[], bytea[],
                                    double precision[], double precision[], double precision[]) IS
'Requests as _request_probe for several plans; returns their ids.';

CREATE OR REPLACE FUNCTION conflictdb_internal._wait_for_probes(p_probe_ids bigint[], p_timeout interval)
RETURNS TABLE (
    n bigint, key text, name text, kind text, verdict text, periods bytea, time_error_s double precision,
    lon_deg double precision, lat_deg double precision, closest_at timestamptz, closest_m double precision,
    closest_error_m double precision, lacking_s double precision, certainty text
)
LANGUAGE plpgsql VOLATILE STRICT SET search_path FROM CURRENT AS $$
DECLARE
    v_until timestamptz := clock_timestamp() + p_timeout;
BEGIN
    FOR v_number IN 1 .. cardinality(p_probe_ids) LOOP
        RETURN QUERY
            SELECT v_number - 1::bigint, w.*
            FROM _wait_for_probe(p_probe_ids[v_number], greatest(v_until - clock_timestamp(), interval '1 ms')) w;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _wait_for_probes(bigint[], interval) IS
'As _wait_for_probe, for several requests within one timeout; n: place of the request, from 0.';

-- For workers.

CREATE OR REPLACE FUNCTION conflictdb_internal._next_probe(p_passed_over bigint[])
RETURNS TABLE (probe_id bigint, scene_id bigint)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN QUERY
        SELECT p.probe_id, p.scene_id FROM probe_request p
        WHERE p.answered_at IS NULL AND p.probe_id <> ALL (p_passed_over)
        -- Failed requests last; then the scene and the role that have waited longest for a reply.
        ORDER BY p.failures,
                 (SELECT max(q.answered_at) FROM probe_request q WHERE q.scene_id = p.scene_id) NULLS FIRST,
                 (SELECT max(q.answered_at) FROM probe_request q WHERE q.asked_by = p.asked_by) NULLS FIRST, p.probe_id
        LIMIT 1 FOR UPDATE SKIP LOCKED;
END
$$;
COMMENT ON FUNCTION _next_probe(bigint[]) IS
'The next request that no other session works on, without some, locked until the transaction ends; no row if there is '
'none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._probe_request(
    p_probe_id bigint, OUT object_kind smallint, OUT key text, OUT footprint bytea,
    OUT start_us bigint, OUT end_us bigint, OUT path bytea, OUT outline bytea, OUT grow_mps double precision,
    OUT floor_m double precision, OUT ceiling_m double precision, OUT horizon_s double precision, OUT scene text
)
LANGUAGE sql STABLE STRICT
BEGIN ATOMIC
    SELECT p.object_kind, p.key, ST_AsBinary(p.footprint, 'NDR'),
           (extract(epoch FROM lower(p.active_span)) * 1000000)::bigint,
           (extract(epoch FROM upper(p.active_span)) * 1000000)::bigint, ST_AsBinary(p.path, 'NDR'),
           ST_AsBinary(p.outline, 'NDR'), p.grow_mps, p.floor_m, p.ceiling_m, extract(epoch FROM p.horizon), s.name
    FROM probe_request p JOIN scene s USING (scene_id) WHERE p.probe_id = p_probe_id;
END;
COMMENT ON FUNCTION _probe_request(bigint) IS 'A request: geometries as WKB, instants in microseconds since 1970.';

CREATE OR REPLACE FUNCTION conflictdb_internal._probe_failed(p_probe_id bigint, p_error text) RETURNS void
LANGUAGE sql VOLATILE STRICT
BEGIN ATOMIC
    UPDATE probe_request p SET failures = p.failures + 1,
        (answered_at, is_current, error) = (
            SELECT clock_timestamp(), false, 'could not be answered in three attempts: ' || p_error
            WHERE p.failures >= 2)
    WHERE p.probe_id = p_probe_id;
END;
COMMENT ON FUNCTION _probe_failed(bigint, text) IS
'Records a failed attempt to reply to a request; after the third, the error becomes the reply.';

CREATE OR REPLACE FUNCTION conflictdb_internal._answer_probe(
    p_probe_id bigint, p_error text, p_found jsonb, p_delays jsonb
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    INSERT INTO probe_reply (probe_id, object_kind, key, verdict, periods, time_error_s, first_contact_point,
                             closest_at, closest_m, closest_error_m, lacking_s, certainty)
        SELECT p_probe_id, f.kind, f.key, f.verdict,
               (SELECT coalesce(range_agg(tstzrange((d ->> 0)::timestamptz, (d ->> 1)::timestamptz, '[]')),
                                '{}') FROM jsonb_array_elements(f.periods) d),
               f.time_error_s, ST_SetSRID(ST_MakePoint(f.lon_deg, f.lat_deg), 4326), f.closest_at, f.closest_m,
               f.closest_error_m, f.lacking_s, f.certainty
        FROM jsonb_to_recordset(p_found) f (
            kind smallint, key text, verdict text, periods jsonb, time_error_s double precision,
            lon_deg double precision, lat_deg double precision, closest_at timestamptz, closest_m double precision,
            closest_error_m double precision, lacking_s double precision, certainty text);
    UPDATE probe_request p SET answered_at = clock_timestamp(), is_current = _is_current(p.scene_id), error = p_error,
                               delays = p_delays
        WHERE p.probe_id = p_probe_id;
    PERFORM _prune_probes();
END
$$;
COMMENT ON FUNCTION _answer_probe(bigint, text, jsonb, jsonb) IS
'Writes the reply to a request: the objects found, delays, or the reason why there is none; deletes requests older '
'than an hour.';

-- Visible to the role that asked, while it may read the scene, and to workers.
ALTER TABLE probe_request ENABLE ROW LEVEL SECURITY;
ALTER TABLE probe_reply ENABLE ROW LEVEL SECURITY;
DROP POLICY IF EXISTS probe_request_own ON probe_request;
CREATE POLICY probe_request_own ON probe_request TO conflictdb_reader
    USING (asked_by = current_user AND scene_id IN (SELECT s.scene_id FROM scene s))
    WITH CHECK (asked_by = current_user AND scene_id IN (SELECT s.scene_id FROM scene s));
DROP POLICY IF EXISTS probe_request_worker ON probe_request;
CREATE POLICY probe_request_worker ON probe_request TO conflictdb_worker USING (true) WITH CHECK (true);
DROP POLICY IF EXISTS probe_reply_own ON probe_reply;
CREATE POLICY probe_reply_own ON probe_reply FOR SELECT TO conflictdb_reader
    USING (EXISTS (SELECT FROM probe_request p WHERE p.probe_id = probe_reply.probe_id AND p.asked_by = current_user));
DROP POLICY IF EXISTS probe_reply_worker ON probe_reply;
CREATE POLICY probe_reply_worker ON probe_reply TO conflictdb_worker USING (true) WITH CHECK (true);

COMMENT ON TABLE probe_request IS
'Requests to the workers: about a plan (request_probe, request_track_probe), the departures of a track '
'(request_delays), or to admit plans (admit). Visible to the role that asked and to workers; deleted after an hour.';
COMMENT ON COLUMN probe_request.probe_id IS 'Id of the request.';
COMMENT ON COLUMN probe_request.scene_id IS 'Scene.';
COMMENT ON COLUMN probe_request.asked_by IS 'Role that asked.';
COMMENT ON COLUMN probe_request.asked_at IS 'Start of its transaction.';
COMMENT ON COLUMN probe_request.object_kind IS 'Kind of the plan: 0 area, 1 track.';
COMMENT ON COLUMN probe_request.key IS
'Object that the plan would replace, which is ignored; null: none. With a horizon: the track.';
COMMENT ON COLUMN probe_request.footprint IS 'Area: longitude and latitude, degrees; null for a track.';
COMMENT ON COLUMN probe_request.active_span IS
'Area: when it is active, [start, end). Delays: begins with p_now of request_delays. Null for other tracks.';
COMMENT ON COLUMN probe_request.path IS 'Track: waypoints, M is Unix seconds; null for an area.';
COMMENT ON COLUMN probe_request.outline IS 'Track: haven, metres to starboard and ahead; null for an area.';
COMMENT ON COLUMN probe_request.grow_mps IS 'Track: outward speed of the haven''s sides, metres per second.';
COMMENT ON COLUMN probe_request.floor_m IS 'Lowest height, metres above the vertical datum, inclusive; null: no limit.';
COMMENT ON COLUMN probe_request.ceiling_m IS
'Highest height, metres above the vertical datum, exclusive; null: no limit.';
COMMENT ON COLUMN probe_request.horizon IS 'Delays: up to how much later or earlier; null for a probe.';
COMMENT ON COLUMN probe_request.delays IS
'Delays: the reply, as `conflictdb delays --format json` prints it; null for a probe, or while it waits.';
COMMENT ON COLUMN probe_request.answered_at IS 'When a worker replied; null while it waits.';
COMMENT ON COLUMN probe_request.is_current IS
'Whether the scene was current at that time; null while it waits.';
COMMENT ON COLUMN probe_request.failures IS 'Number of failed attempts; the third one is reported as an error.';
COMMENT ON COLUMN probe_request.error IS 'Why there is no reply; null if there is one, or while it waits.';

COMMENT ON TABLE probe_reply IS
'Replies to probes: one row per object that the plan would conflict with or come near.';
COMMENT ON COLUMN probe_reply.probe_id IS 'Request.';
COMMENT ON COLUMN probe_reply.object_kind IS 'Kind of the object: 0 area, 1 track.';
COMMENT ON COLUMN probe_reply.key IS 'Key of the object.';
COMMENT ON COLUMN probe_reply.verdict IS
'conflict, grazing or unresolved, as in the view conflicts; near: no conflict, within nearest_m.';
COMMENT ON COLUMN probe_reply.periods IS
'When they conflict; bounds inclusive, rounded outward to the microsecond; empty if only near.';
