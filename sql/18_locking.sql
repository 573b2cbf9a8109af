-- One detection of a scene at a time: a detection holds the scene's row of scene_lock until its transaction ends.
--
-- A row lock instead of an advisory lock: any user can take advisory locks; only workers can lock rows of scene_lock.

CREATE OR REPLACE FUNCTION conflictdb_internal._lift_limits(p_lock_timeout_s double precision) RETURNS void
LANGUAGE plpgsql VOLATILE CALLED ON NULL INPUT SET search_path FROM CURRENT AS $$
DECLARE
    v_name text;
BEGIN
    FOREACH v_name IN ARRAY
        ARRAY['statement_timeout', 'idle_in_transaction_session_timeout', 'transaction_timeout'] LOOP
        -- transaction_timeout exists from PostgreSQL 17 on.
        IF current_setting(v_name, true) <> '0' THEN
            PERFORM set_config(v_name, '0', true);
        END IF;
    END LOOP;
    PERFORM set_config('lock_timeout', least(ceil(1000 * coalesce(p_lock_timeout_s, 0)), 2147483647)::integer::text,
                       true);
    IF current_setting('client_connection_check_interval') <> '1s' THEN
        BEGIN
            PERFORM set_config('client_connection_check_interval', '1s', true);
        EXCEPTION WHEN invalid_parameter_value THEN
            NULL; -- Not supported by this platform: before version 15 by all but Linux.
        END;
    END IF;
END
$$;
COMMENT ON FUNCTION _lift_limits(double precision) IS
'Removes time limits of the role or database until the transaction ends, as detections may take long. Sets '
'lock_timeout to p_lock_timeout_s, seconds; null or 0: no limit (in _take_scene 0 means do not wait). If the client '
'disconnects, a running statement ends within a second.';

CREATE OR REPLACE FUNCTION conflictdb_internal._add_scene_lock(p_scene_id bigint) RETURNS boolean
LANGUAGE sql VOLATILE STRICT
BEGIN ATOMIC
    -- Check first: an INSERT would wait for a transaction that changes the row.
    WITH added AS (
        INSERT INTO scene_lock (scene_id)
            SELECT p_scene_id WHERE NOT EXISTS (SELECT FROM scene_lock l WHERE l.scene_id = p_scene_id)
            ON CONFLICT DO NOTHING RETURNING scene_id
    )
    SELECT EXISTS (SELECT FROM added);
END;
COMMENT ON FUNCTION _add_scene_lock(bigint) IS
'Creates the lock of a scene if it is missing; returns whether it was. Call it in a transaction of its own: '
'_scene_holders sees committed locks only.';

CREATE OR REPLACE FUNCTION conflictdb_internal._take_scene(p_scene_id bigint, p_wait_s double precision) RETURNS bigint
LANGUAGE plpgsql VOLATILE STRICT SET search_path FROM CURRENT AS $$
DECLARE
    v_lock_timeout text := current_setting('lock_timeout');
    v_taken bigint;
BEGIN
    PERFORM _require_snapshot();
    PERFORM set_config('lock_timeout', greatest(1, ceil(1000 * p_wait_s))::integer::text, true);
    IF p_wait_s = 0 THEN
        PERFORM FROM scene_lock l WHERE l.scene_id = p_scene_id FOR UPDATE SKIP LOCKED;
        IF NOT FOUND THEN
            RETURN NULL;
        END IF;
    END IF;
    UPDATE scene_lock l SET taken = l.taken + 1 WHERE l.scene_id = p_scene_id RETURNING l.taken INTO v_taken;
    PERFORM set_config('lock_timeout', v_lock_timeout, true);
    RETURN v_taken;
END
$$;
COMMENT ON FUNCTION _take_scene(bigint, double precision) IS
'Takes the lock of a scene until the transaction ends; returns the new value of scene_lock.taken. Waits at most '
'p_wait_s seconds, then raises lock_not_available; 0: does not wait, and returns null if the lock is held. Returns '
'null if there is no lock. Raises serialization_failure if another transaction released the lock after this one''s '
'snapshot.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_holders(p_scene_id bigint)
RETURNS TABLE (pid integer, application text, role text, since timestamptz)
LANGUAGE plpgsql VOLATILE STRICT SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN QUERY
    SELECT a.pid, a.application_name, coalesce(a.usename, '')::text, a.xact_start
    FROM pg_catalog.pg_stat_activity a
    WHERE a.pid <> pg_backend_pid()
      AND (EXISTS (SELECT FROM scene_lock s
                   JOIN pg_catalog.pg_locks l ON l.locktype = 'transactionid' AND l.transactionid = s.xmax
                   WHERE s.scene_id = p_scene_id AND l.pid = a.pid AND l.granted)
           OR EXISTS (SELECT FROM pg_catalog.pg_locks l
                      WHERE l.relation = 'scene_lock'::regclass AND l.granted AND l.pid = a.pid
                        AND l.database = (SELECT d.oid FROM pg_catalog.pg_database d
                                          WHERE d.datname = current_database())
                        AND l.mode IN ('ShareLock', 'ShareRowExclusiveLock', 'ExclusiveLock', 'AccessExclusiveLock')))
    ORDER BY a.xact_start, a.pid;
END
$$;
COMMENT ON FUNCTION _scene_holders(bigint) IS
'Sessions that hold the lock of a scene, or of the whole table, and the start of their transactions. Runs as its '
'owner, who may see more of other sessions than a worker. Restricted to sessions that hold the lock of the given '
'scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_scene_removal() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    -- No foreign keys: they would cost more than writing a conflict or piece, or let readers lock the scene.
    DELETE FROM change m WHERE m.scene_id = OLD.scene_id;
    DELETE FROM probe_request p
        USING (SELECT x.probe_id FROM probe_request x WHERE x.scene_id = OLD.scene_id FOR UPDATE SKIP LOCKED) free
        WHERE p.probe_id = free.probe_id;
    PERFORM _settle_branches(OLD.scene_id, true);
    DELETE FROM conflict c WHERE c.scene_id = OLD.scene_id;
    DELETE FROM difference d WHERE d.scene_id = OLD.scene_id;
    DELETE FROM conflict_event e WHERE e.scene_id = OLD.scene_id;
    DELETE FROM piece p WHERE p.scene_id = OLD.scene_id;
    -- No foreign key: removal would wait for a running detection, and the detection then for the removal.
    DELETE FROM scene_lock l
        USING (SELECT x.scene_id FROM scene_lock x WHERE x.scene_id = OLD.scene_id FOR UPDATE SKIP LOCKED) free
        WHERE l.scene_id = free.scene_id;
    DELETE FROM admission_lock l
        USING (SELECT x.scene_id FROM admission_lock x WHERE x.scene_id = OLD.scene_id FOR UPDATE SKIP LOCKED) free
        WHERE l.scene_id = free.scene_id;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_scene_removal() IS
'Trigger: deletes marks, requests, branches, conflicts, differences, events, pieces and locks of a removed scene. '
'Skips a branch, request or lock that is held, which is harmless, as scene ids are never reused. Runs as its owner: '
'editors cannot write these tables. Restricted to the scene that was removed.';

CREATE OR REPLACE TRIGGER scene_removed AFTER DELETE ON scene
    FOR EACH ROW EXECUTE FUNCTION _after_scene_removal();
