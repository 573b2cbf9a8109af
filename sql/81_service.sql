-- The server's part of `conflictdb status`.
--
-- Workers stamp worker_stamp: application_name alone would count sessions that a pooler keeps, and miss workers between
-- their transactions.

CREATE OR REPLACE FUNCTION conflictdb_internal._stamp_worker(p_worker_id uuid, p_pid integer) RETURNS void
LANGUAGE plpgsql VOLATILE CALLED ON NULL INPUT SET search_path FROM CURRENT AS $$
BEGIN
    DELETE FROM worker_stamp w
        USING (SELECT x.worker_id FROM worker_stamp x
               WHERE x.worker_id <> p_worker_id
                 AND CASE WHEN x.pid IS NULL THEN x.seen_at < clock_timestamp() - interval '1 hour'
                     ELSE NOT EXISTS (SELECT FROM pg_catalog.pg_stat_activity a WHERE a.pid = x.pid) END
               FOR UPDATE SKIP LOCKED) gone
        WHERE w.worker_id = gone.worker_id;
    INSERT INTO worker_stamp (worker_id, pid, seen_at) VALUES (p_worker_id, p_pid, clock_timestamp())
        ON CONFLICT (worker_id) DO UPDATE SET pid = excluded.pid, seen_at = excluded.seen_at;
END
$$;
COMMENT ON FUNCTION _stamp_worker(uuid, integer) IS
'Records a worker. p_pid: its session; null if a pooler gives it one for each transaction: then it must stamp again '
'within 30 seconds, unless it is in a transaction. Deletes stamps of workers that are gone.';

CREATE OR REPLACE FUNCTION conflictdb_internal._remove_stamp(p_worker_id uuid) RETURNS void
LANGUAGE sql VOLATILE STRICT
BEGIN ATOMIC
    DELETE FROM worker_stamp w WHERE w.worker_id = p_worker_id;
END;
COMMENT ON FUNCTION _remove_stamp(uuid) IS 'Records that a worker ends.';

CREATE OR REPLACE FUNCTION conflictdb_internal._worker_count() RETURNS bigint
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    -- Every role sees names and virtual transactions of all sessions, but no more.
    WITH named AS (
        SELECT a.pid, EXISTS (SELECT FROM worker_stamp w WHERE w.pid = a.pid) AS is_own,
               EXISTS (SELECT FROM pg_catalog.pg_locks l
                       WHERE l.locktype = 'virtualxid' AND l.pid = a.pid AND l.granted) AS is_busy
        FROM pg_catalog.pg_stat_activity a
        WHERE a.datname = current_database() AND a.application_name = 'conflictdb worker'
    )
    SELECT (SELECT count(*) FROM named n WHERE n.is_own)
           -- A transaction of a pooled session is its worker's, and may last longer than a stamp.
           + greatest((SELECT count(*) FROM worker_stamp w
                       WHERE w.pid IS NULL AND w.seen_at > clock_timestamp() - interval '30 s'),
                      (SELECT count(*) FROM named n WHERE n.is_busy AND NOT n.is_own));
END;
COMMENT ON FUNCTION _worker_count() IS
'Number of workers connected to this database. A worker that is killed behind a pooler counts for 30 seconds more.';

CREATE OR REPLACE FUNCTION conflictdb_internal._service(OUT postgis_version text, OUT worker_count bigint)
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    SELECT PostGIS_Lib_Version(), _worker_count();
END;
COMMENT ON FUNCTION _service() IS
'Version of PostGIS, and number of workers connected to this database.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_alarms() RETURNS TABLE (
    scene text, is_current boolean, waiting_since timestamptz, unmapped bigint, last_error text, tables jsonb
)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT s.name, _is_current(s.scene_id),
           (SELECT min(w.at) FROM (
                SELECT c.changed_at AS at FROM change c WHERE c.scene_id = s.scene_id
                UNION ALL
                SELECT q.changed_at FROM attachment a JOIN attached_change q USING (attachment_id)
                WHERE a.scene_id = s.scene_id
                UNION ALL
                SELECT a.compared_at + a.every FROM attachment a
                WHERE a.scene_id = s.scene_id AND NOT _is_compared(a)) w),
           (SELECT count(*) FROM attachment a JOIN attached_object o USING (attachment_id)
            WHERE a.scene_id = s.scene_id AND o.reason IS NOT NULL),
           (SELECT r.error FROM run r WHERE r.scene_id = s.scene_id ORDER BY r.run_id DESC LIMIT 1),
           (SELECT jsonb_object_agg(_attached_name(a), coalesce(a.error, _attachment_remark(a)))
            FROM attachment a WHERE a.scene_id = s.scene_id)
    FROM scene s ORDER BY s.name;
END;
COMMENT ON FUNCTION _scene_alarms() IS
'For each scene: whether it is current, since when changes wait (also those of attached tables of other roles), the '
'number of rows that cannot be mapped, why its last detection failed, and for each attached table why it cannot be '
'read or followed (null: it can).';

COMMENT ON TABLE worker_stamp IS 'Workers that are, or were lately, connected. Only workers write it.';
COMMENT ON COLUMN worker_stamp.worker_id IS 'Random id of the process.';
COMMENT ON COLUMN worker_stamp.pid IS
'Its session on the server; null if a pooler gives it one for each transaction.';
COMMENT ON COLUMN worker_stamp.seen_at IS 'When it wrote the row; every few seconds if pid is null.';
