-- The audit: who put, changed, renamed or deleted which plan, rule or scene, when, by which session. Statement triggers
-- append rows to `edit`, and only wait for what every INSERT waits for. Workers seal them in batches (seal_edits).

CREATE OR REPLACE FUNCTION conflictdb_internal._note_edits() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    -- Keys in a row of edit.
    c_most CONSTANT integer := 10000;
    v_kind text := TG_TABLE_NAME;
BEGIN
    IF current_setting('row_security') = 'off' AND _is_restoring() THEN
        RETURN NULL;
    END IF;
    IF TG_OP <> 'UPDATE' THEN
        INSERT INTO edit (scene_id, scene, kind, action, keys)
            SELECT c.scene_id, coalesce(s.name, _former_name(c.scene_id)), v_kind,
                   CASE TG_OP WHEN 'INSERT' THEN 'put' ELSE 'delete' END, c.keys
            FROM (SELECT n.scene_id, array_agg(n.key) AS keys
                  FROM (SELECT r.scene_id, r.key, row_number() OVER () / c_most AS chunk FROM changed_rows r) n
                  GROUP BY n.scene_id, n.chunk) c LEFT JOIN scene s USING (scene_id);
    ELSIF NOT EXISTS (SELECT FROM old_rows) THEN
        RETURN NULL; -- INSERT ... ON CONFLICT DO UPDATE calls both triggers.
    ELSIF v_kind = 'area' THEN
        -- An expanded schedule is no edit. Bytes are compared, because operators of PostGIS are not on the search path.
        INSERT INTO edit (scene_id, scene, kind, action, keys, former_keys)
            SELECT c.scene_id, coalesce(s.name, _former_name(c.scene_id)), v_kind, c.action, c.keys,
                   CASE c.action WHEN 'rename' THEN c.former_keys END
            FROM (SELECT u.scene_id, u.action, array_agg(u.key) AS keys, array_agg(u.former_key) AS former_keys
                  FROM (SELECT n.scene_id, n.key, o.key AS former_key, row_number() OVER () / c_most AS chunk,
                               CASE WHEN o.key = n.key THEN 'change' ELSE 'rename' END AS action
                        FROM new_rows n JOIN old_rows o ON o.area_id = n.area_id
                        WHERE ROW(
                            n.key,
                            /* area columns: WRITTEN(n) */
                            n.footprint, n.active_span, n.floor_m, n.ceiling_m, n.name, n.properties, n.class, n.owner,
                            CASE WHEN n.schedule IS NULL THEN n.activations END, n.schedule
                            /* end */
                        )::record *<> ROW(
                            o.key,
                            /* area columns: WRITTEN(o) */
                            o.footprint, o.active_span, o.floor_m, o.ceiling_m, o.name, o.properties, o.class, o.owner,
                            CASE WHEN o.schedule IS NULL THEN o.activations END, o.schedule
                            /* end */
                        )::record) u
                  GROUP BY u.scene_id, u.action, u.chunk) c LEFT JOIN scene s USING (scene_id);
    ELSE
        INSERT INTO edit (scene_id, scene, kind, action, keys, former_keys)
            SELECT c.scene_id, coalesce(s.name, _former_name(c.scene_id)), v_kind, c.action, c.keys,
                   CASE c.action WHEN 'rename' THEN c.former_keys END
            FROM (SELECT u.scene_id, u.action, array_agg(u.key) AS keys, array_agg(u.former_key) AS former_keys
                  FROM (SELECT n.scene_id, n.key, o.key AS former_key, row_number() OVER () / c_most AS chunk,
                               CASE WHEN o.key = n.key THEN 'change' ELSE 'rename' END AS action
                        FROM new_rows n JOIN old_rows o ON o.track_id = n.track_id
                        WHERE ROW(
                            n.key,
                            /* track columns: WRITTEN(n) */
                            n.path, n.outline, n.floor_m, n.ceiling_m, n.name, n.properties, n.grow_mps, n.outlines,
                            n.floors_m, n.ceilings_m, n.class, n.owner, n.tolerances,
                            CASE WHEN n.schedule IS NULL THEN n.departures END, n.schedule
                            /* end */
                        )::record *<> ROW(
                            o.key,
                            /* track columns: WRITTEN(o) */
                            o.path, o.outline, o.floor_m, o.ceiling_m, o.name, o.properties, o.grow_mps, o.outlines,
                            o.floors_m, o.ceilings_m, o.class, o.owner, o.tolerances,
                            CASE WHEN o.schedule IS NULL THEN o.departures END, o.schedule
                            /* end */
                        )::record) u
                  GROUP BY u.scene_id, u.action, u.chunk) c LEFT JOIN scene s USING (scene_id);
    END IF;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _note_edits() IS
'Trigger, once per statement: appends the edited areas or tracks to edit. Runs as its owner: nobody else writes edits. '
'Restricted to the rows that the statement changed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._note_rule_edits() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF _is_restoring() THEN
        RETURN NULL;
    END IF;
    IF TG_OP = 'UPDATE' THEN
        -- A rule that moves is an edit of both scenes.
        INSERT INTO edit (scene_id, scene, kind, action, keys, former_keys)
            SELECT c.scene_id, coalesce(s.name, _former_name(c.scene_id)), 'rule', c.action, ARRAY[c.key],
                   CASE c.action WHEN 'rename' THEN ARRAY[u.former_key] END
            FROM (SELECT n.rule_id, n.scene_id, o.scene_id AS former_scene_id,
                         coalesce(n.a_class, 'any') || ' / ' || coalesce(n.b_class, 'any') AS key,
                         coalesce(o.a_class, 'any') || ' / ' || coalesce(o.b_class, 'any') AS former_key
                  FROM changed_rows n JOIN old_rows o USING (rule_id) WHERE n *<> o) u
            CROSS JOIN LATERAL (VALUES
                (u.scene_id, CASE WHEN u.scene_id <> u.former_scene_id THEN 'put'
                                  WHEN u.key <> u.former_key THEN 'rename' ELSE 'change' END, u.key),
                (CASE WHEN u.scene_id <> u.former_scene_id THEN u.former_scene_id END, 'delete', u.former_key)
            ) c (scene_id, action, key)
            LEFT JOIN scene s ON s.scene_id = c.scene_id
            WHERE c.scene_id IS NOT NULL ORDER BY u.rule_id;
    ELSE
        INSERT INTO edit (scene_id, scene, kind, action, keys)
            SELECT r.scene_id, coalesce(s.name, _former_name(r.scene_id)), 'rule',
                   CASE TG_OP WHEN 'INSERT' THEN 'put' ELSE 'delete' END,
                   ARRAY[coalesce(r.a_class, 'any') || ' / ' || coalesce(r.b_class, 'any')]
            FROM changed_rows r LEFT JOIN scene s USING (scene_id) ORDER BY r.rule_id;
    END IF;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _note_rule_edits() IS
'Trigger, once per statement: appends the edited separation rules to edit. Runs as its owner: nobody else writes '
'edits. Restricted to the rows that the statement changed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._note_branch_edits() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF _is_restoring() THEN
        RETURN NULL;
    END IF;
    -- A key that the branch has put is an edit of its own object.
    INSERT INTO edit (scene_id, scene, kind, action, keys)
        SELECT n.scene_id, s.name, CASE n.object_kind WHEN 0 THEN 'area' ELSE 'track' END,
               'delete', array_agg(n.key ORDER BY n.key)
        FROM new_rows n JOIN scene s USING (scene_id)
        WHERE n.object_id IS NOT NULL AND NOT EXISTS (SELECT FROM object_key k
                                                      WHERE k.scene_id = n.scene_id AND k.key = n.key)
        GROUP BY n.scene_id, s.name, n.object_kind;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _note_branch_edits() IS
'Trigger, once per statement: appends the objects of its parent that a branch removes to edit. Runs as its owner: '
'nobody else writes edits. Restricted to the rows that the statement changed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._note_scene_edit() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene scene := CASE TG_OP WHEN 'DELETE' THEN OLD ELSE NEW END;
BEGIN
    IF NOT _is_restoring() THEN
        INSERT INTO edit (scene_id, scene, kind, action, keys, former_keys)
            VALUES (v_scene.scene_id, v_scene.name, 'scene',
                    CASE WHEN TG_OP = 'INSERT' THEN 'put' WHEN TG_OP = 'DELETE' THEN 'delete'
                         WHEN OLD.name <> NEW.name THEN 'rename' ELSE 'change' END, ARRAY[v_scene.name],
                    CASE WHEN TG_OP = 'UPDATE' AND OLD.name <> NEW.name THEN ARRAY[OLD.name] END);
    END IF;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _note_scene_edit() IS
'Trigger: appends the edit of a scene to edit. Runs as its owner: nobody else writes edits. Restricted to that scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_restoring() RETURNS boolean
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    -- pg_restore and scripts of pg_dump set it first. A dump brings its own edits.
    RETURN current_setting('row_security') = 'off'
           AND pg_has_role(session_user, (SELECT c.relowner FROM pg_catalog.pg_class c
                                          WHERE c.oid = 'edit'::regclass), 'USAGE');
END
$$;
COMMENT ON FUNCTION _is_restoring() IS
'Whether this is the restore of a dump: row_security is off, and the login may act as the owner of schema conflictdb.';

CREATE OR REPLACE FUNCTION conflictdb_internal._former_name(p_scene_id bigint) RETURNS text
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN (SELECT e.scene FROM edit e WHERE e.scene_id = p_scene_id ORDER BY e.edit_id DESC LIMIT 1);
END
$$;
COMMENT ON FUNCTION _former_name(bigint) IS
'Last name of a scene that the audit knows, null: none. The objects of a deleted scene are deleted after it.';

CREATE OR REPLACE TRIGGER area_edits_inserted AFTER INSERT ON area REFERENCING NEW TABLE AS changed_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE OR REPLACE TRIGGER area_edits_updated AFTER UPDATE ON area
    REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE OR REPLACE TRIGGER area_edits_deleted AFTER DELETE ON area REFERENCING OLD TABLE AS changed_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE OR REPLACE TRIGGER track_edits_inserted AFTER INSERT ON track REFERENCING NEW TABLE AS changed_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE OR REPLACE TRIGGER track_edits_updated AFTER UPDATE ON track
    REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE OR REPLACE TRIGGER track_edits_deleted AFTER DELETE ON track REFERENCING OLD TABLE AS changed_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE OR REPLACE TRIGGER rule_edits_inserted AFTER INSERT ON rule REFERENCING NEW TABLE AS changed_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _note_rule_edits();
CREATE OR REPLACE TRIGGER rule_edits_updated AFTER UPDATE ON rule
    REFERENCING OLD TABLE AS old_rows NEW TABLE AS changed_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_rule_edits();
CREATE OR REPLACE TRIGGER rule_edits_deleted AFTER DELETE ON rule REFERENCING OLD TABLE AS changed_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _note_rule_edits();
CREATE OR REPLACE TRIGGER branch_edit_edits_inserted AFTER INSERT ON branch_edit REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _note_branch_edits();
CREATE OR REPLACE TRIGGER scene_edits_inserted AFTER INSERT OR DELETE ON scene
    FOR EACH ROW EXECUTE FUNCTION _note_scene_edit();
CREATE OR REPLACE TRIGGER scene_edits_updated AFTER UPDATE ON scene
    FOR EACH ROW
    -- How far schedules are expanded is no edit.
    WHEN ((_settings_of(OLD), OLD.owner, OLD.history_kept) IS DISTINCT FROM
          (_settings_of(NEW), NEW.owner, NEW.history_kept))
    EXECUTE FUNCTION _note_scene_edit();

-- Seals. Numbers of edits become visible in another order than they are given, so a batch lists its numbers, and takes
-- all edits that it sees and that no batch has. Numbers up to settled_id are not looked at again: they were given to
-- transactions that have ended.

CREATE OR REPLACE FUNCTION conflictdb_internal._digest_of_edit(p_edit edit) RETURNS bytea
LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN sha256(convert_to(jsonb_build_array(
        p_edit.edit_id, p_edit.transaction_id::text, (extract(epoch FROM p_edit.edited_at) * 1000000)::bigint,
        p_edit.scene_id, p_edit.scene, p_edit.kind, p_edit.action, p_edit.keys, p_edit.former_keys, p_edit.role,
        p_edit.login, p_edit.pid, p_edit.application, p_edit.client)::text, 'UTF8'));
END
$$;
COMMENT ON FUNCTION _digest_of_edit(edit) IS 'SHA-256 of a row of edit: of a JSON array of its values, in UTF-8.';

CREATE OR REPLACE FUNCTION conflictdb_internal._digest_of_batch(
    p_former_digest bytea, p_edit_ids int8multirange, OUT edits bigint, OUT digest bytea
)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp SET jit = off AS $$
BEGIN
    SELECT count(*), sha256(p_former_digest || coalesce(string_agg(_digest_of_edit(e), '' ORDER BY e.edit_id), ''))
        INTO edits, digest
        FROM unnest(p_edit_ids) r
        CROSS JOIN LATERAL (SELECT x.* FROM edit x WHERE x.edit_id >= lower(r) AND x.edit_id < upper(r) OFFSET 0) e;
END
$$;
COMMENT ON FUNCTION _digest_of_batch(bytea, int8multirange) IS
'Number of stored edits of a batch, and the SHA-256 of the digest of the batch before and of its edits in order.';

CREATE OR REPLACE FUNCTION conflictdb_internal._oldest_editor(p_snapshot pg_snapshot) RETURNS xid8
LANGUAGE plpgsql VOLATILE STRICT SET search_path = conflictdb, conflictdb_internal, pg_temp SET jit = off AS $$
DECLARE
    v_oldest xid8;
BEGIN
    -- Locks are read once, so that those of a transaction are of one moment. A transaction without any has ended since
    -- the snapshot, and may have edited. Whoever has a number of an edit keeps the lock on the table until it ends.
    WITH lock AS MATERIALIZED (
        SELECT l.virtualtransaction AS holder, l.transactionid,
               l.locktype = 'relation' AND l.relation = 'edit'::regclass
               AND l.database = (SELECT d.oid FROM pg_catalog.pg_database d WHERE d.datname = current_database())
               AS is_editing
        FROM pg_catalog.pg_locks l WHERE l.granted AND (l.locktype = 'relation' OR l.mode = 'ExclusiveLock')
    ), idle AS (
        SELECT l.holder FROM lock l GROUP BY l.holder HAVING NOT bool_or(l.is_editing)
    )
    SELECT x INTO v_oldest
        FROM pg_snapshot_xip(p_snapshot) x
        WHERE x::xid NOT IN (SELECT l.transactionid FROM lock l JOIN idle i ON i.holder = l.holder
                             WHERE l.transactionid IS NOT NULL)
        ORDER BY x LIMIT 1;
    RETURN coalesce(v_oldest, pg_snapshot_xmax(p_snapshot));
END
$$;
COMMENT ON FUNCTION _oldest_editor(pg_snapshot) IS
'The oldest transaction that was open in a snapshot and may have edited objects of this database; if there is none, '
'the first one after the snapshot. Transactions of other databases do not count.';

CREATE OR REPLACE FUNCTION conflictdb_internal._seal_batch(p_most integer, OUT edits bigint)
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp
SET jit = off AS $$
DECLARE
    v_last edit_seal;
    v_given bigint;
    v_next xid8;
    v_oldest xid8;
    v_ids int8multirange;
    v_batch record;
    v_settled bigint;
BEGIN
    edits := 0;
    BEGIN
        LOCK TABLE edit_seal IN SHARE ROW EXCLUSIVE MODE NOWAIT;
    EXCEPTION WHEN lock_not_available THEN
        RETURN; -- Another session seals.
    END;
    SELECT s.* INTO v_last FROM edit_seal s ORDER BY s.seal_id DESC LIMIT 1;
    -- Whoever was given a number up to v_given has a transaction id already, so it is less than the one that this
    -- transaction gets now.
    IF pg_current_xact_id_if_assigned() IS NULL THEN
        v_given := coalesce(pg_sequence_last_value(pg_get_serial_sequence('edit', 'edit_id')::regclass), 0);
        v_next := pg_current_xact_id();
    END IF;
    IF v_last IS NULL THEN
        INSERT INTO edit_seal (seal_id, edit_ids, edits, digest, given_id, next_transaction, settled_id)
            VALUES (0, '{}', 0, sha256(''), 0, pg_current_xact_id(), 0) RETURNING * INTO v_last;
    END IF;
    v_oldest := _oldest_editor(pg_current_snapshot());
    v_ids := (SELECT range_agg(int8range(c.edit_id, c.edit_id + 1))
              FROM (SELECT e.edit_id FROM edit e
                    WHERE e.edit_id > v_last.settled_id
                      AND NOT e.edit_id <@ coalesce((SELECT range_agg(r) FROM edit_seal s, unnest(s.edit_ids) r
                                                     WHERE upper(s.edit_ids) > v_last.settled_id), '{}')
                    ORDER BY e.edit_id LIMIT p_most) c);
    IF v_ids IS NULL THEN
        RETURN;
    END IF;
    SELECT d.* INTO v_batch FROM _digest_of_batch(v_last.digest, v_ids) d;
    edits := v_batch.edits;
    -- Not of a batch that may have left edits for the next.
    v_settled := CASE WHEN edits < p_most THEN
        (SELECT max(s.given_id) FROM edit_seal s WHERE s.next_transaction <= v_oldest) END;
    INSERT INTO edit_seal (seal_id, edit_ids, edits, digest, given_id, next_transaction, settled_id)
        VALUES (v_last.seal_id + 1, v_ids, edits, v_batch.digest, coalesce(v_given, v_last.given_id),
                coalesce(v_next, v_last.next_transaction), greatest(v_settled, v_last.settled_id));
END
$$;
COMMENT ON FUNCTION _seal_batch(integer) IS
'Seals at most p_most edits, if no other session does; returns their number. Runs as its owner: nobody else writes '
'seals. Restricted to edits that have none.';

CREATE OR REPLACE FUNCTION seal_edits() RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    c_most CONSTANT integer := 10000;
    v_total bigint := 0;
    v_edits bigint;
BEGIN
    LOOP
        v_edits := _seal_batch(c_most);
        v_total := v_total + v_edits;
        EXIT WHEN v_edits < c_most;
    END LOOP;
    RETURN v_total;
END
$$;
COMMENT ON FUNCTION seal_edits() IS
'Seals edits (table edit) in batches, each with the digest of its edits and of the batch before; returns their number. '
'Workers do this every minute.';

CREATE OR REPLACE FUNCTION verify_edits(
    OUT anchor bigint, OUT batches bigint, OUT edits bigint, OUT unsealed bigint, OUT first_wrong bigint,
    OUT reason text, OUT last_batch bigint, OUT last_digest text
)
-- STABLE: all its queries see one state, so edits that are pruned meanwhile are not missing.
LANGUAGE plpgsql STABLE SET search_path = conflictdb, conflictdb_internal, pg_temp SET jit = off AS $$
DECLARE
    v_seal edit_seal;
    v_former edit_seal;
    v_batch record;
    v_ids int8multirange := coalesce((SELECT range_agg(r) FROM edit_seal s, unnest(s.edit_ids) r), '{}');
BEGIN
    batches := 0;
    edits := 0;
    FOR v_seal IN SELECT s.* FROM edit_seal s ORDER BY s.seal_id LOOP
        IF v_former IS NULL THEN
            anchor := v_seal.seal_id;
        ELSIF first_wrong IS NULL THEN
            SELECT d.* INTO v_batch FROM _digest_of_batch(v_former.digest, v_seal.edit_ids) d;
            reason := CASE WHEN v_seal.seal_id <> v_former.seal_id + 1
                           THEN format('batch %s is missing', v_former.seal_id + 1)
                           WHEN v_batch.edits <> v_seal.edits
                           THEN format('it had %s edits, and has %s', v_seal.edits, v_batch.edits)
                           WHEN v_batch.digest <> v_seal.digest THEN 'an edit, or the seal, differs' END;
            IF reason IS NOT NULL THEN
                first_wrong := v_seal.seal_id;
            ELSE
                batches := batches + 1;
                edits := edits + v_batch.edits;
            END IF;
        END IF;
        v_former := v_seal;
    END LOOP;
    last_batch := v_former.seal_id;
    last_digest := encode(v_former.digest, 'hex');
    unsealed := (SELECT count(*) FROM edit e WHERE NOT e.edit_id <@ v_ids);
    IF first_wrong IS NULL AND EXISTS (SELECT FROM edit e
                                       WHERE e.edit_id <= v_former.settled_id AND NOT e.edit_id <@ v_ids) THEN
        first_wrong := (SELECT min(s.seal_id) FROM edit_seal s
                        WHERE s.settled_id >= (SELECT min(e.edit_id) FROM edit e WHERE NOT e.edit_id <@ v_ids));
        reason := 'an edit was added behind it';
    END IF;
END
$$;
COMMENT ON FUNCTION verify_edits() IS
'Verifies the seals of edits: number of the batch that is the anchor (its edits are pruned, or it is the first), of '
'batches and edits that are as sealed, of edits without a seal, the first batch that is wrong and why (null: none), '
'number and digest (hex) of the last batch. For workers and the owner of schema conflictdb, who see all edits.';

CREATE OR REPLACE FUNCTION prune_edits(p_kept interval) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_anchor bigint;
    v_removed bigint;
BEGIN
    IF (p_kept >= interval '0') IS NOT TRUE THEN
        FOUND := _raise('ZC009', 'edits', 'kept', format('must be 0 or longer; got %s', quote_nullable(p_kept)),
                        'history_kept_positive');
    END IF;
    LOCK TABLE edit_seal IN SHARE ROW EXCLUSIVE MODE;
    -- No seal is older; more would leave the calendar.
    v_anchor := (SELECT max(s.seal_id) FROM edit_seal s WHERE s.sealed_at <= now() - least(p_kept, '1000 years'));
    DELETE FROM edit e USING (SELECT r FROM edit_seal s, unnest(s.edit_ids) r WHERE s.seal_id <= v_anchor) b
        WHERE e.edit_id >= lower(b.r) AND e.edit_id < upper(b.r);
    GET DIAGNOSTICS v_removed = ROW_COUNT;
    DELETE FROM edit_seal s WHERE s.seal_id < v_anchor;
    IF v_removed > 0 THEN
        INSERT INTO edit (scene_id, kind, action, keys) VALUES (0, 'audit', 'delete', ARRAY['batch ' || v_anchor]);
    END IF;
    RETURN v_removed;
END
$$;
COMMENT ON FUNCTION prune_edits(interval) IS
'Deletes edits that were sealed longer ago than p_kept; returns their number. The seal of the last deleted batch stays '
'as the anchor of the next, and the deletion is an edit itself. Only the owner of schema conflictdb may call this.';

CREATE OR REPLACE VIEW edits WITH (security_invoker = true) AS
SELECT e.edit_id AS edit, e.edited_at AS at, e.scene, e.kind, e.action, k.key, k.former_key, e.role, e.login,
       e.application, e.client, e.pid, e.transaction_id
FROM edit e CROSS JOIN LATERAL unnest(e.keys, e.former_keys) k (key, former_key);

COMMENT ON VIEW edits IS
'Edits of plans, rules and scenes, a row for each key: who, when, in which session. Of scenes that the role may read.';
COMMENT ON COLUMN edits.edit IS 'Number; equal for what one statement did to objects of one kind.';
COMMENT ON COLUMN edits.at IS 'When the statement had changed its rows.';
COMMENT ON COLUMN edits.scene IS 'Name of the scene then.';
COMMENT ON COLUMN edits.kind IS 'area, track, rule, scene; audit: edits were pruned.';
COMMENT ON COLUMN edits.action IS 'put (new), change, rename, delete.';
COMMENT ON COLUMN edits.key IS 'Key; of a rule its two sides, of a scene its name.';
COMMENT ON COLUMN edits.former_key IS 'Key before a rename; else null.';
COMMENT ON COLUMN edits.role IS 'Role that acted, also by SET ROLE.';
COMMENT ON COLUMN edits.login IS 'Role that logged in.';
COMMENT ON COLUMN edits.application IS 'Name that the session gave itself.';
COMMENT ON COLUMN edits.client IS 'Address of the client; null: a socket of the server''s machine.';
COMMENT ON COLUMN edits.pid IS 'Process of the session, as in the log of the server.';
COMMENT ON COLUMN edits.transaction_id IS 'Transaction.';

COMMENT ON TABLE edit IS
'Edits of plans, rules and scenes, one row per statement, scene and kind. Triggers append; nobody but the owner of '
'schema conflictdb can change rows. The view edits lists them by key.';
COMMENT ON COLUMN edit.edit_id IS 'Number.';
COMMENT ON COLUMN edit.transaction_id IS 'Transaction.';
COMMENT ON COLUMN edit.edited_at IS 'When the statement had changed its rows.';
COMMENT ON COLUMN edit.scene_id IS 'Scene; 0: none.';
COMMENT ON COLUMN edit.scene IS 'Its name then; null: unknown.';
COMMENT ON COLUMN edit.kind IS 'area, track, rule, scene; audit: edits were pruned.';
COMMENT ON COLUMN edit.action IS 'put (new), change, rename, delete.';
COMMENT ON COLUMN edit.keys IS 'Keys; of rules their sides, of scenes their names.';
COMMENT ON COLUMN edit.former_keys IS 'Keys before a rename, in the same order; else null.';
COMMENT ON COLUMN edit.role IS 'Role that acted, also by SET ROLE.';
COMMENT ON COLUMN edit.login IS 'Role that logged in.';
COMMENT ON COLUMN edit.pid IS 'Process of the session.';
COMMENT ON COLUMN edit.application IS 'Name that the session gave itself.';
COMMENT ON COLUMN edit.client IS 'Address of the client; null: a socket of the server''s machine.';
COMMENT ON TABLE edit_seal IS 'Batches of edits, each with a digest that includes the batch before.';
COMMENT ON COLUMN edit_seal.seal_id IS 'Number of the batch, without gaps; the least is the anchor, without edits.';
COMMENT ON COLUMN edit_seal.edit_ids IS 'Numbers of its edits.';
COMMENT ON COLUMN edit_seal.edits IS 'How many edits it has.';
COMMENT ON COLUMN edit_seal.digest IS 'SHA-256 of the digest of the batch before, and of those of its edits in order.';
COMMENT ON COLUMN edit_seal.sealed_at IS 'When it was sealed.';
COMMENT ON COLUMN edit_seal.given_id IS 'Greatest number of an edit that was given before.';
COMMENT ON COLUMN edit_seal.next_transaction IS 'Numbers up to given_id were given to earlier transactions.';
COMMENT ON COLUMN edit_seal.settled_id IS 'All edits up to this number are in this batch or one before.';
