-- One detection of a scene at a time: whoever detects holds the scene's row of scene_lock until its transaction ends.
--
-- A row lock, and no advisory lock: that anybody may take who can connect. Rows of scene_lock only workers can lock.

CREATE OR REPLACE FUNCTION _lift_limits(p_lock_timeout_s double precision) RETURNS void
LANGUAGE plpgsql VOLATILE CALLED ON NULL INPUT SET search_path FROM CURRENT AS $$
DECLARE
    v_name text;
BEGIN
    FOREACH v_name IN ARRAY
        ARRAY['statement_timeout', 'idle_in_transaction_session_timeout', 'transaction_timeout'] LOOP
        -- Before version 17 there is no limit of whole transactions.
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
            NULL; -- This system cannot tell: before version 15 all but Linux.
        END;
    END IF;
END
$$;
COMMENT ON FUNCTION _lift_limits(double precision) IS
'Lifts the limits of time that a role or database sets, until the transaction ends: a detection takes as long as it '
'takes. It waits for a lock no longer than the given seconds; null and 0 are for ever. If the '
'client is gone, a statement that is under way ends within a second.';

CREATE OR REPLACE FUNCTION _add_scene_lock(p_scene_id bigint) RETURNS boolean
LANGUAGE sql VOLATILE STRICT
BEGIN ATOMIC
    -- Not without looking first: an insertion waits for whoever changes the row.
    WITH added AS (
        INSERT INTO scene_lock (scene_id)
            SELECT p_scene_id WHERE NOT EXISTS (SELECT FROM scene_lock l WHERE l.scene_id = p_scene_id)
            ON CONFLICT DO NOTHING RETURNING scene_id
    )
    SELECT EXISTS (SELECT FROM added);
END;
COMMENT ON FUNCTION _add_scene_lock(bigint) IS
'Makes sure that a scene has a lock; returns whether it had none. In a transaction of its own: what is not committed '
'shows no holder.';

CREATE OR REPLACE FUNCTION _take_scene(p_scene_id bigint, p_wait_s double precision) RETURNS bigint
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
'Takes the lock of a scene until the transaction ends; returns how often it was taken. Null if there is none, or if '
'somebody holds it and it is not to be waited for; lock_not_available if somebody holds it for longer than the given '
'seconds; '
'serialization_failure if somebody has given it back since the transaction''s snapshot, which is then too old.';

CREATE OR REPLACE FUNCTION _scene_holders(p_scene_id bigint)
RETURNS TABLE (pid integer, application text, role text, since timestamptz)
LANGUAGE plpgsql VOLATILE STRICT SECURITY DEFINER SET search_path = conflictdb, pg_temp AS $$
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
'Who holds the lock of a scene, or of the whole table, and since when its transaction lasts. Runs as its owner, who '
'may see more of other sessions than a worker. Restricted to sessions that hold the lock of the scene given.';

CREATE OR REPLACE FUNCTION _after_scene_removal() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, pg_temp AS $$
BEGIN
    -- Not by foreign keys either, which would cost every conflict and piece more than it costs to write.
    DELETE FROM conflict c WHERE c.scene_id = OLD.scene_id;
    DELETE FROM conflict_event e WHERE e.scene_id = OLD.scene_id;
    DELETE FROM piece p WHERE p.scene_id = OLD.scene_id;
    -- Not by a foreign key: who removes a scene would wait for its detection, and the detection then for the removal.
    DELETE FROM scene_lock l
        USING (SELECT x.scene_id FROM scene_lock x WHERE x.scene_id = OLD.scene_id FOR UPDATE SKIP LOCKED) free
        WHERE l.scene_id = free.scene_id;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_scene_removal() IS
'Trigger: removes conflicts, their history and pieces of a removed scene, and its lock, unless it is held. A lock that '
'stays behind does no harm: numbers of scenes do not come again. Runs as its owner: editors cannot touch these. '
'Restricted to the scene that was removed.';

CREATE OR REPLACE TRIGGER scene_removed AFTER DELETE ON scene
    FOR EACH ROW EXECUTE FUNCTION _after_scene_removal();
