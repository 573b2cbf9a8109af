-- Conflicts open, change and close; each of these is an event. The detection that finds an event writes it in its own
-- transaction (60_write_back.sql). Events are the history of conflicts, and an outbox to poll: within a scene they
-- become visible in the order of their ids.

CREATE OR REPLACE FUNCTION conflictdb_internal._widened(
    p_periods tstzmultirange, p_by_s double precision
) RETURNS tstzmultirange
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    -- Any periods and any number: acknowledgements hold what their editors wrote, and an error here would be one of the
    -- view conflicts. Near the ends of time there is no earlier or later instant.
    SELECT coalesce((SELECT range_agg(tstzrange(
                         CASE WHEN lower(r) < '4713-01-01 BC' THEN '-infinity' ELSE lower(r) - w.by END,
                         CASE WHEN upper(r) > '294276-01-01' THEN 'infinity' ELSE upper(r) + w.by END, '[]'))
                     FROM unnest(p_periods) r), '{}'::tstzmultirange)
    -- The microsecond allows for rounding outward.
    FROM (SELECT make_interval(secs => greatest(0, least(p_by_s + 1e-6, 86400))) AS by) w;
END;
COMMENT ON FUNCTION _widened(tstzmultirange, double precision) IS
'Returns periods widened on both sides by p_by_s seconds (at least 0, at most a day) plus a microsecond.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_alike(
    p_some tstzmultirange, p_others tstzmultirange, p_within_s double precision
)
RETURNS boolean
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN p_some = p_others
           OR p_some <@ _widened(p_others, p_within_s) AND p_others <@ _widened(p_some, p_within_s);
END
$$;
COMMENT ON FUNCTION _is_alike(tstzmultirange, tstzmultirange, double precision) IS
'Whether two multiranges agree within p_within_s seconds (at most a day) plus a microsecond: each lies in the other, '
'widened by that.';

CREATE OR REPLACE FUNCTION conflictdb_internal._has_grown(
    p_periods tstzmultirange, p_verdict text, p_time_error_s double precision, p_closest_m double precision,
    p_closest_error_m double precision, p_known_periods tstzmultirange, p_known_verdict text,
    p_known_time_error_s double precision, p_known_closest_m double precision, p_known_closest_error_m double precision,
    p_tolerance_m double precision
) RETURNS boolean
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_worse CONSTANT text[] := ARRAY['grazing', 'unresolved', 'conflict'];
    c_far_m CONSTANT double precision := 1e9; -- beyond all distances on Earth
BEGIN
    RETURN array_position(c_worse, p_verdict) > array_position(c_worse, p_known_verdict)
           OR NOT p_periods <@ _widened(p_known_periods, p_time_error_s + p_known_time_error_s)
           OR coalesce(p_closest_m + p_closest_error_m + p_tolerance_m
                       -- A difference of any two numbers may be out of range.
                       < CASE WHEN p_known_closest_m BETWEEN -c_far_m AND c_far_m AND p_known_closest_error_m >= 0
                         THEN p_known_closest_m - p_known_closest_error_m END, false);
END
$$;
COMMENT ON FUNCTION _has_grown(
    tstzmultirange, text, double precision, double precision, double precision, tstzmultirange, text, double precision,
    double precision, double precision, double precision) IS
'Whether a conflict exceeds what was known: times outside its periods, a worse verdict (grazing, unresolved, '
'conflict), or closer by more than the tolerance. '
'Differences count only beyond both error bounds (seconds, metres).';

CREATE OR REPLACE FUNCTION conflictdb_internal._proposal_of_pair(
    p_scene_id bigint, p_a_kind smallint, p_a_key text, p_b_kind smallint, p_b_key text
) RETURNS bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM proposal p WHERE p.scene_id = p_scene_id AND p.applied_at IS NOT NULL) THEN
        RETURN NULL;
    END IF;
    RETURN greatest((SELECT max(m.proposal_id)
            FROM area a
            JOIN proposal_move m ON m.scene_id = a.scene_id AND m.area_id = a.area_id
            JOIN proposal p ON p.proposal_id = m.proposal_id AND p.applied_at IS NOT NULL
                -- A detection that expands a schedule makes another version.
                AND (m.version_after = a.version
                     OR a.schedule IS NOT NULL AND m.delay_s = 0 AND a.version > m.version_after
                     AND a.footprint::bytea
                         = CASE WHEN p.undone_at IS NULL THEN m.footprint ELSE m.planned_footprint END::bytea)
            JOIN change c ON c.scene_id = a.scene_id AND c.object_kind = 0 AND c.object_id = a.area_id
                             AND c.version = a.version
            WHERE a.scene_id = p_scene_id
              AND (p_a_kind = 0 AND a.key = p_a_key OR p_b_kind = 0 AND a.key = p_b_key)),
           (SELECT max(m.proposal_id)
            FROM track t
            JOIN proposal_move m ON m.scene_id = t.scene_id AND m.track_id = t.track_id
            JOIN proposal p ON p.proposal_id = m.proposal_id AND p.applied_at IS NOT NULL
                -- A track of an attached table, whose rows have been read since.
                AND coalesce(m.version_after = t.version,
                             t.path::bytea = CASE WHEN p.undone_at IS NULL THEN m.path ELSE m.planned END::bytea
                             AND t.version <> m.version)
            JOIN change c ON c.scene_id = t.scene_id AND c.object_kind = 1 AND c.object_id = t.track_id
                             AND c.version = t.version
            WHERE t.scene_id = p_scene_id
              AND (p_a_kind = 1 AND t.key = p_a_key OR p_b_kind = 1 AND t.key = p_b_key)));
END
$$;
COMMENT ON FUNCTION _proposal_of_pair(bigint, smallint, text, smallint, text) IS
'The proposal that moved one of two objects, if that change waits for this detection; else null.';

CREATE OR REPLACE FUNCTION conflictdb_internal._renew_acknowledgements(
    p_scene_id bigint, p_first_event bigint
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM acknowledgement k WHERE k.scene_id = p_scene_id AND k.ended_at IS NULL) THEN
        RETURN;
    END IF;
    INSERT INTO acknowledgement (scene_id, conflict_id, acknowledged_by, acknowledged_at, reason, until, a_key, b_key,
                                 periods, verdict, time_error_s, closest_m, closest_error_m, given_name)
        SELECT k.scene_id, c.conflict_id, k.acknowledged_by, k.acknowledged_at, k.reason, k.until, k.a_key, k.b_key,
               k.periods, k.verdict, k.time_error_s, k.closest_m, k.closest_error_m, k.given_name
        -- The last one of the pair: a withdrawn one does not return.
        FROM (SELECT DISTINCT ON (n.a_key, n.b_key) n.* FROM acknowledgement n WHERE n.scene_id = p_scene_id
              ORDER BY n.a_key, n.b_key, n.acknowledgement_id DESC) k
        JOIN conflict_event e ON e.scene_id = p_scene_id AND e.conflict_event_id >= p_first_event
                                 AND e.kind = 'opened' AND e.a_key = k.a_key AND e.b_key = k.b_key
        JOIN conflict c ON c.scene_id = p_scene_id AND c.a_key = e.a_key AND c.b_key = e.b_key
                           AND c.conflict_id = e.conflict_id
        JOIN scene s ON s.scene_id = p_scene_id
        WHERE k.ended_at IS NULL AND k.conflict_id <> c.conflict_id AND coalesce(k.until > now(), true)
              AND _is_alike(c.periods, k.periods, c.time_error_s + k.time_error_s)
              AND NOT _has_grown(c.periods, c.verdict, c.time_error_s, c.closest_m, c.closest_error_m, k.periods,
                                 k.verdict, k.time_error_s, k.closest_m, k.closest_error_m, s.tolerance_m)
        ON CONFLICT (conflict_id) WHERE ended_at IS NULL DO NOTHING;
END
$$;
COMMENT ON FUNCTION _renew_acknowledgements(bigint, bigint) IS
'Acknowledges conflicts that opened, from this event on, as their pair was acknowledged before, if their periods are '
'the same again, and nothing is worse.';

CREATE OR REPLACE FUNCTION conflictdb_internal._notify_events(
    p_scene_id bigint, p_scene text, p_run_id bigint, p_first bigint
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- A payload must be shorter than 8,000 bytes. Longer events are sent as their id alone.
    c_most CONSTANT integer := 7900;
    c_longest CONSTANT integer := 1000;
    v_head text := jsonb_build_object('scene', p_scene, 'run', p_run_id, 'kind', 'changed', 'events', '[]'::jsonb);
    v_room integer := greatest(c_most - c_longest - octet_length(v_head), 1);
BEGIN
    -- Built as text: jsonb values would cost as much as the events themselves.
    PERFORM pg_notify('conflictdb_event',
                      left(jsonb_build_object('scene', p_scene, 'run', p_run_id, 'kind', n.kind)::text, -1)
                      || ', "events": [' || n.events || ']}')
        FROM (SELECT t.kind, string_agg(t.event, ', ' ORDER BY t.number) AS events
              FROM (SELECT e.kind, e.conflict_event_id AS number, s.event,
                           -- Chunks of v_room bytes; events are separated by ", ".
                           (sum(octet_length(s.event) + 2)
                               OVER (PARTITION BY e.kind ORDER BY e.conflict_event_id)) / v_room AS chunk
                    FROM conflict_event e
                    CROSS JOIN LATERAL (SELECT '[' || e.conflict_event_id || ', ' || to_json(e.a_key) || ', '
                                               || to_json(e.b_key) || ']' AS whole OFFSET 0) w
                    CROSS JOIN LATERAL (SELECT CASE WHEN p_scene IS NULL OR octet_length(w.whole) > c_longest - 2
                                                    THEN '[' || e.conflict_event_id || ']'
                                                    ELSE w.whole END AS event OFFSET 0) s
                    WHERE e.scene_id = p_scene_id AND e.conflict_event_id >= p_first) t
              GROUP BY t.kind, t.chunk
              ORDER BY min(t.number)) n;
END
$$;
COMMENT ON FUNCTION _notify_events(bigint, text, bigint, bigint) IS
'Notifies channel conflictdb_event of a run''s events from p_first on: scene, run, kind, and for each event its id and '
'both keys, in as many notifications as needed. Very long keys are omitted; so are all keys and the scene if p_scene '
'is null (protected scenes).';

CREATE OR REPLACE FUNCTION conflictdb_internal._history_kept(p_scene_id bigint) RETURNS interval
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_default CONSTANT interval := '30 days';
    -- The range of instants.
    c_ever CONSTANT interval := '6000 years';
    v_kept interval := (SELECT s.history_kept FROM scene s WHERE s.scene_id = p_scene_id);
    v_setting text := nullif(current_setting('conflictdb.history_kept', true), '');
BEGIN
    IF v_kept IS NULL AND v_setting IS NOT NULL THEN
        BEGIN
            v_kept := v_setting;
        EXCEPTION WHEN data_exception THEN
            v_kept := '-1 s';
        END;
        IF v_kept < interval '0' THEN
            -- Detection must not fail because of it.
            RAISE WARNING 'conflictdb.history_kept: must be an interval, such as 30 days; got %; taken as %',
                          quote_literal(v_setting), c_default;
            v_kept := NULL;
        END IF;
    END IF;
    RETURN least(coalesce(v_kept, c_default), c_ever);
END
$$;
COMMENT ON FUNCTION _history_kept(bigint) IS
'How long the history of a scene is kept: scene.history_kept, else the setting conflictdb.history_kept of the database '
'or role, else 30 days.';

CREATE OR REPLACE FUNCTION conflictdb_internal._prune(p_scene_id bigint, p_kept interval) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- Reads what is old, by index, whatever the statistics; a nested loop would compare each run with each event.
SET enable_nestloop = off SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_until timestamptz := now() - p_kept;
    v_run_id bigint := (SELECT r.run_id FROM run r
                        WHERE r.scene_id = p_scene_id AND r.error IS NULL AND r.finished_at <= v_until
                        ORDER BY r.run_id DESC LIMIT 1);
    v_removed bigint := 0;
BEGIN
    DELETE FROM live_event e WHERE e.scene_id = p_scene_id AND e.at <= v_until;
    IF v_run_id IS NOT NULL THEN
        -- Keep the last event of each conflict that was open then: it describes its state since.
        WITH removed AS (
            DELETE FROM conflict_event e
                WHERE e.ctid = ANY (ARRAY(
                    SELECT o.place
                    FROM (SELECT x.ctid AS place, x.kind,
                                 lead(x.kind) OVER (PARTITION BY x.conflict_id ORDER BY x.conflict_event_id)
                                     AS next_kind
                          FROM conflict_event x
                          WHERE x.scene_id = p_scene_id AND x.at <= v_until AND x.run_id <= v_run_id) o
                    WHERE o.next_kind IS NOT NULL OR o.kind = 'closed'))
                RETURNING e.conflict_id, e.kind
        ), forgotten AS (
            DELETE FROM acknowledgement k USING removed r
                WHERE k.scene_id = p_scene_id AND k.conflict_id = r.conflict_id AND r.kind = 'closed'
        )
        SELECT count(*) INTO v_removed FROM removed;
        DELETE FROM acknowledgement k WHERE k.scene_id = p_scene_id AND k.ended_at <= v_until;
        DELETE FROM proposal p WHERE p.scene_id = p_scene_id AND p.made_at <= v_until;
        DELETE FROM run r
            WHERE r.scene_id = p_scene_id AND r.run_id < v_run_id
              AND NOT EXISTS (SELECT FROM conflict c WHERE c.scene_id = p_scene_id AND c.run_id = r.run_id)
              AND NOT EXISTS (SELECT FROM conflict_event e
                              WHERE e.scene_id = p_scene_id AND e.at <= v_until AND e.run_id = r.run_id);
    END IF;
    INSERT INTO history AS h (scene_id, first_run_id, pruned_at) VALUES (p_scene_id, v_run_id, now())
        ON CONFLICT (scene_id) DO UPDATE
            SET first_run_id = greatest(h.first_run_id, excluded.first_run_id), pruned_at = excluded.pruned_at;
    RETURN v_removed;
END
$$;
COMMENT ON FUNCTION _prune(bigint, interval) IS
'Deletes events, also of alarms, ended acknowledgements, proposals and runs of a scene older than p_kept, but the last '
'event of each '
'conflict that was open then; returns the number of deleted events. The caller holds the lock of the scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._prune_sometimes(p_scene_id bigint) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    -- At most hourly, because it reads all old events and all conflicts of the scene.
    IF NOT EXISTS (SELECT FROM history h
                   WHERE h.scene_id = p_scene_id AND h.pruned_at > now() - interval '1 hour') THEN
        PERFORM _prune(p_scene_id, _history_kept(p_scene_id));
    END IF;
END
$$;
COMMENT ON FUNCTION _prune_sometimes(bigint) IS
'Prunes the history of a scene as _history_kept says, unless that was done within the last hour.';

CREATE OR REPLACE FUNCTION prune_history(p_scene text, p_kept interval DEFAULT NULL) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
BEGIN
    IF p_kept < interval '0' THEN
        FOUND := _raise('ZC009', format('scene %L', p_scene), 'kept',
                        format('must be 0 or longer; got %s', p_kept), 'history_kept_positive');
    END IF;
    -- Takes the lock like a detection; a detection that waits for it starts again.
    UPDATE scene_lock l SET taken = l.taken + 1 WHERE l.scene_id = v_scene_id;
    RETURN _prune(v_scene_id, least(coalesce(p_kept, _history_kept(v_scene_id)), interval '6000 years'));
END
$$;
COMMENT ON FUNCTION prune_history(text, interval) IS
'Deletes history of a scene older than p_kept (null: scene.history_kept, else the setting conflictdb.history_kept, '
'else 30 days); returns the number of deleted events. Detections do this hourly. Waits for a running detection of the '
'scene.';
