-- Writing many new pairs: detection COPYs complete rows into conflict and conflict_event. These functions provide ids
-- and keys before, and update the run after.
--
--   _begin_new_rows, COPY to conflict and to conflict_event, _end_new_rows; once per part

CREATE OR REPLACE FUNCTION conflictdb_internal._begin_new_rows(
    p_scene_id bigint, p_run_id bigint, p_run jsonb, p_count integer, p_numbers bigint[],
    OUT run_id bigint, OUT at_us bigint, OUT scene text, OUT conflict_ids bytea, OUT event_ids bytea, OUT keys text[],
    OUT first_versions bigint[]
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
SET enable_seqscan = off SET jit = off AS $$
#variable_conflict use_column
DECLARE
    v_layers bigint[] := _layers(p_scene_id);
BEGIN
    -- COPY cannot write to a table whose row-level security applies to the caller (93_row_security.sql).
    IF row_security_active('conflict') OR row_security_active('conflict_event') THEN
        RETURN;
    END IF;
    run_id := coalesce(p_run_id, _begin_run(p_scene_id, p_run));
    SELECT (extract(epoch FROM r.finished_at) * 1000000)::bigint INTO at_us
        FROM run r WHERE r.run_id = _begin_new_rows.run_id;
    -- Any user may listen to notifications, so protected scenes are not named.
    SELECT s.name INTO scene FROM scene s WHERE s.scene_id = p_scene_id AND NOT _is_protected();
    SELECT array_send(array_agg(n.conflict_id)), array_send(array_agg(n.event_id)) INTO conflict_ids, event_ids
        FROM (SELECT nextval('conflict_seq') AS conflict_id, nextval('conflict_event_conflict_event_id_seq') AS event_id
              FROM generate_series(1, p_count)) n;
    -- OFFSET 0 and "+ 0" force lookups by id.
    SELECT array_agg(o.key ORDER BY n.nr), array_agg(o.first_version ORDER BY n.nr) INTO keys, first_versions
        FROM unnest(p_numbers) WITH ORDINALITY n (number, nr)
        LEFT JOIN LATERAL (SELECT a.key, a.first_version FROM area a
                           WHERE n.number < 1::bigint << 62 AND a.area_id = n.number
                             AND a.scene_id + 0 = ANY (v_layers)
                           UNION ALL
                           SELECT t.key, t.first_version FROM track t
                           WHERE n.number >= 1::bigint << 62 AND t.track_id = n.number & ((1::bigint << 62) - 1)
                             AND t.scene_id + 0 = ANY (v_layers) OFFSET 0) o ON true;
END
$$;
COMMENT ON FUNCTION _begin_new_rows(bigint, bigint, jsonb, integer, bigint[]) IS
'Returns values for p_count new rows of conflict: the run (a new one if p_run_id is null; p_run: see _begin_run), the '
'start of its writing (microseconds since 1970), the name of the scene (null if scenes are protected), ids of '
'conflicts and events (array_send), and key and first version of the objects p_numbers (_object_number; null if not in '
'the scene). All null if row-level security prevents COPY.';

CREATE OR REPLACE FUNCTION conflictdb_internal._end_new_rows(
    p_run_id bigint, p_opened bigint, p_unresolved bigint, p_notifications text[]
) RETURNS void
LANGUAGE sql VOLATILE
BEGIN ATOMIC
    UPDATE run r SET opened = r.opened + p_opened, conflicts = r.conflicts + p_opened,
                     unresolved = r.unresolved + p_unresolved
        WHERE r.run_id = p_run_id;
    SELECT pg_notify('conflictdb_event', n) FROM unnest(p_notifications) n;
END;
COMMENT ON FUNCTION _end_new_rows(bigint, bigint, bigint, text[]) IS
'Adds copied conflicts to the counts of their run, and sends the notifications.';
