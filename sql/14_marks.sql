-- Marks: every change of an object inserts a row into `change`, in the same transaction. The marks are the queue.
--
--   inserted (is_covered = false) --pieces recomputed--> covered (true) --conflicts replaced--> deleted
--                                    transaction 1                         transaction 2
--
-- Writers only insert marks, and a detection touches only marks it saw. So neither waits for or fails the other.

CREATE OR REPLACE FUNCTION conflictdb_internal._notify(p_channel text, p_payload text) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
        -- PREPARE TRANSACTION fails after NOTIFY, and COMMIT fails if the queue is full: a user's write must not fail.
        -- Workers poll for marks as well, more often if writers do not notify (store.writers_notify).
    IF current_setting('max_prepared_transactions') = '0' AND pg_notification_queue_usage() < 0.5 THEN
        PERFORM pg_notify(p_channel, p_payload);
    END IF;
END
$$;
COMMENT ON FUNCTION _notify(text, text) IS
'Notifies a channel at commit. Does nothing if the server allows prepared transactions or the queue is half full.';

CREATE OR REPLACE FUNCTION conflictdb_internal._wake_workers() RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    -- Arbitrary number.
    c_lock CONSTANT bigint := 7165063221046263924;
BEGIN
    -- PostgreSQL commits notifying transactions one at a time. So only one of several concurrent writers notifies;
    -- workers find the other changes by polling (EVERY_S in conflictdb.jobs.worker).
    IF pg_try_advisory_xact_lock(c_lock) THEN
        PERFORM _notify('conflictdb_request', '');
    END IF;
END
$$;
COMMENT ON FUNCTION _wake_workers() IS
'Wakes the workers at commit, unless a concurrent transaction already does.';

CREATE OR REPLACE FUNCTION conflictdb_internal._were_objects(p_kind smallint, p_ids bigint[], p_versions bigint[])
RETURNS boolean
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_hashjoin = off SET enable_mergejoin = off SET enable_seqscan = off
SET jit = off AS $$
BEGIN
    RETURN EXISTS (SELECT FROM unnest(p_ids, p_versions) n (id, version)
                   JOIN piece p ON p.object_kind = p_kind AND p.object_id = n.id AND p.version >= n.version)
        OR EXISTS (SELECT FROM unnest(p_ids, p_versions) n (id, version)
                   JOIN conflict c ON c.a_kind = p_kind AND c.a_id = n.id AND c.a_version >= n.version)
        OR EXISTS (SELECT FROM unnest(p_ids, p_versions) n (id, version)
                   JOIN conflict c ON c.b_kind = p_kind AND c.b_id = n.id AND c.b_version >= n.version);
END
$$;
COMMENT ON FUNCTION _were_objects(smallint, bigint[], bigint[]) IS
'Whether pieces or conflicts are of former objects with one of some ids, at its version or later. For few ids.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_object_change() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    -- To plan takes longer than to look up this number of rows, so their plan is cached.
    c_few CONSTANT integer := 100;
    v_kind smallint := TG_ARGV[0];
    v_id text := TG_ARGV[1];
    v_renamed text;
    v_wanted bigint;
    v_claimed bigint;
    v_taken text;
    v_marked bigint;
    v_is_former boolean;
BEGIN
    IF TG_OP IN ('UPDATE', 'DELETE') THEN
        -- INSERT ... ON CONFLICT DO UPDATE calls both triggers.
        IF NOT EXISTS (SELECT FROM old_rows) THEN
            RETURN NULL;
        END IF;
        EXECUTE format('DELETE FROM object_key k USING old_rows o WHERE k.scene_id = o.scene_id AND k.key = o.key'
                       || CASE TG_OP WHEN 'UPDATE' THEN ' AND NOT EXISTS (SELECT FROM new_rows n WHERE n.%1$I = o.%1$I '
                                                        'AND n.key = o.key)' ELSE '' END, v_id);
    ELSIF NOT EXISTS (SELECT FROM new_rows) THEN
        RETURN NULL; -- A load that only updates waits for no lock of the pieces.
    END IF;
    IF TG_OP = 'DELETE' THEN
        -- If the scene was removed, its marks are removed too.
        EXECUTE format('INSERT INTO change (scene_id, object_kind, object_id, version) '
                       'SELECT o.scene_id, $1, o.%I, nextval(''version_seq'') FROM old_rows o '
                       'JOIN scene s ON s.scene_id = o.scene_id', v_id) USING v_kind;
        GET DIAGNOSTICS v_marked = ROW_COUNT;
    ELSE
        IF TG_OP = 'INSERT' THEN
            -- A restore may have set the sequences back: then a former object had the same id, and versions as high.
            SELECT count(*) INTO v_wanted FROM new_rows;
            IF v_wanted <= c_few THEN
                EXECUTE format('SELECT _were_objects($1, array_agg(n.%I), array_agg(n.version)) FROM new_rows n', v_id)
                    INTO v_is_former USING v_kind;
            ELSE
                EXECUTE format('SELECT EXISTS (SELECT FROM new_rows n JOIN piece p ON p.object_kind = $1 '
                               'AND p.object_id = n.%1$I AND p.version >= n.version) '
                               'OR EXISTS (SELECT FROM new_rows n JOIN conflict c ON c.a_kind = $1 AND c.a_id = n.%1$I '
                               'AND c.a_version >= n.version) '
                               'OR EXISTS (SELECT FROM new_rows n JOIN conflict c ON c.b_kind = $1 AND c.b_id = n.%1$I '
                               'AND c.b_version >= n.version)', v_id) INTO v_is_former USING v_kind;
            END IF;
            IF v_is_former THEN
                EXECUTE format('UPDATE %I o SET version = n.version, first_version = n.version '
                               'FROM (SELECT r.%2$I, _first_version($1, r.%2$I) AS version FROM new_rows r OFFSET 0) n '
                               'WHERE n.%2$I = o.%2$I', TG_TABLE_NAME, v_id) USING v_kind;
            END IF;
        END IF;
        v_renamed := '';
        IF TG_OP = 'INSERT' THEN
            INSERT INTO object_key (scene_id, key, object_kind) SELECT n.scene_id, n.key, v_kind FROM new_rows n
                ON CONFLICT DO NOTHING;
        ELSE
            v_renamed := format('JOIN old_rows o ON o.%1$I = n.%1$I AND o.key <> n.key', v_id);
            EXECUTE format('SELECT count(*) FROM new_rows n %s', v_renamed) INTO v_wanted;
            EXECUTE format('INSERT INTO object_key (scene_id, key, object_kind) SELECT n.scene_id, n.key, $1 '
                           'FROM new_rows n %s ON CONFLICT DO NOTHING', v_renamed) USING v_kind;
        END IF;
        GET DIAGNOSTICS v_claimed = ROW_COUNT;
        IF v_claimed < v_wanted THEN
            EXECUTE 'SELECT n.key FROM new_rows n JOIN object_key k ON k.scene_id = n.scene_id AND k.key = n.key '
                    'WHERE k.object_kind <> $1 ORDER BY n.key LIMIT 1' INTO v_taken USING v_kind;
            -- A key held by an object of the same kind is this object's own, inserted earlier by a restore.
            IF v_taken IS NOT NULL THEN
                FOUND := _raise('ZC007', format('%s %L', TG_TABLE_NAME, v_taken), 'key',
                                'is taken by another object of the scene', 'object_key_unique');
            END IF;
        END IF;
        -- A branch no longer reads these keys from its parent.
        IF EXISTS (SELECT FROM scene s WHERE s.parent_scene_id IS NOT NULL) THEN
            EXECUTE format('INSERT INTO branch_edit (scene_id, key) SELECT n.scene_id, n.key FROM new_rows n '
                           'JOIN scene b ON b.scene_id = n.scene_id AND b.parent_scene_id IS NOT NULL %s '
                           'WHERE NOT _is_edited(n.scene_id, n.key) ORDER BY n.key ON CONFLICT DO NOTHING', v_renamed);
        END IF;
        EXECUTE format('INSERT INTO change (scene_id, object_kind, object_id, version) '
                       'SELECT n.scene_id, $1, n.%1$I, n.version FROM new_rows n'
                       || CASE TG_OP WHEN 'UPDATE' THEN ' JOIN old_rows o ON o.%1$I = n.%1$I AND o.version <> n.version'
                                     ELSE '' END, v_id) USING v_kind;
        GET DIAGNOSTICS v_marked = ROW_COUNT;
    END IF;
    IF v_marked > 0 THEN
        PERFORM _wake_workers();
    END IF;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_object_change() IS
'Trigger, once per statement: marks changed objects, keeps keys unique in their scene, wakes workers. '
'Arguments: kind (0 area, 1 track) and name of the id column. Runs as its owner: editors cannot write marks. '
'Restricted to the rows that the statement changed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._mark_all(p_scene_id bigint) RETURNS bigint
LANGUAGE sql VOLATILE PARALLEL UNSAFE
BEGIN ATOMIC
    WITH marked AS (
        INSERT INTO change (scene_id, object_kind, object_id, version)
        SELECT p_scene_id, 0, a.area_id, nextval('version_seq') FROM area a WHERE a.scene_id = p_scene_id
        UNION ALL
        SELECT p_scene_id, 1, t.track_id, nextval('version_seq') FROM track t WHERE t.scene_id = p_scene_id
        RETURNING change_id
    )
    SELECT count(*) FROM marked;
END;
COMMENT ON FUNCTION _mark_all(bigint) IS 'Marks every object of a scene as changed; returns their number.';

CREATE OR REPLACE FUNCTION conflictdb_internal._cover_all(p_scene_id bigint) RETURNS void
LANGUAGE sql VOLATILE PARALLEL UNSAFE
BEGIN ATOMIC
    UPDATE change c SET is_covered = true WHERE c.scene_id = p_scene_id AND NOT c.is_covered;
    -- All objects of a new scene have marks.
    INSERT INTO change (scene_id, object_kind, object_id, version, is_covered)
        SELECT p_scene_id, o.object_kind, o.object_id, nextval('version_seq'), true
        FROM (SELECT 0 AS object_kind, a.area_id AS object_id FROM area a WHERE a.scene_id = p_scene_id
              UNION ALL SELECT 1, t.track_id FROM track t WHERE t.scene_id = p_scene_id
              EXCEPT
              SELECT c.object_kind, c.object_id FROM change c
              WHERE c.scene_id = p_scene_id AND c.is_covered AND c.with_number IS NULL) o;
END;
COMMENT ON FUNCTION _cover_all(bigint) IS
'Marks each unmarked object of a scene as changed and covers all marks. For a full detection, which computes all '
'pieces in the same transaction.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_scene_change() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    PERFORM _mark_all(NEW.scene_id);
    -- Its branches follow (_as_branch).
    PERFORM _settle_branches(NEW.scene_id, false);
    PERFORM _wake_workers();
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_scene_change() IS
'Trigger: marks every object of a scene whose settings changed, as pieces and conflicts depend on them. Restricted to '
'the scene that changed.';

-- Replicated changes (logical replication, or a restore under session_replication_role = replica) fire no ordinary
-- triggers, no foreign keys and, in logical replication, no statement triggers. The following row triggers fire for
-- them only.

CREATE OR REPLACE FUNCTION conflictdb_internal._after_replicated_object() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_kind smallint := TG_ARGV[0];
    v_row jsonb := to_jsonb(CASE TG_OP WHEN 'DELETE' THEN OLD ELSE NEW END);
BEGIN
    IF TG_OP <> 'INSERT' THEN
        DELETE FROM object_key k WHERE k.scene_id = OLD.scene_id AND k.key = OLD.key AND k.object_kind = v_kind;
    END IF;
    IF TG_OP <> 'DELETE' THEN
        INSERT INTO object_key (scene_id, key, object_kind) VALUES (NEW.scene_id, NEW.key, v_kind)
            ON CONFLICT DO NOTHING;
    END IF;
    INSERT INTO change (scene_id, object_kind, object_id, version)
        VALUES ((v_row ->> 'scene_id')::bigint, v_kind, (v_row ->> TG_ARGV[1])::bigint, nextval('version_seq'));
    PERFORM _wake_workers();
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_replicated_object() IS
'Trigger, once per replicated row: does the same as _after_object_change. Restricted to that row.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_replicated_removal() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    DELETE FROM conflict c WHERE c.scene_id = OLD.scene_id;
    DELETE FROM difference d WHERE d.scene_id = OLD.scene_id;
    DELETE FROM conflict_event e WHERE e.scene_id = OLD.scene_id;
    DELETE FROM acknowledgement k WHERE k.scene_id = OLD.scene_id;
    DELETE FROM proposal_move m WHERE m.scene_id = OLD.scene_id;
    DELETE FROM proposal_left l WHERE l.scene_id = OLD.scene_id;
    DELETE FROM proposal p WHERE p.scene_id = OLD.scene_id;
    DELETE FROM history h WHERE h.scene_id = OLD.scene_id;
    DELETE FROM run r WHERE r.scene_id = OLD.scene_id;
    DELETE FROM piece p WHERE p.scene_id = OLD.scene_id;
    DELETE FROM change m WHERE m.scene_id = OLD.scene_id;
    DELETE FROM object_key k WHERE k.scene_id = OLD.scene_id;
    DELETE FROM branch_edit e WHERE e.scene_id = OLD.scene_id;
    DELETE FROM scene_lock l WHERE l.scene_id = OLD.scene_id;
    DELETE FROM admission_lock l WHERE l.scene_id = OLD.scene_id;
    DELETE FROM position p WHERE p.scene_id = OLD.scene_id;
    DELETE FROM live_state l WHERE l.scene_id = OLD.scene_id;
    DELETE FROM live_conflict c WHERE c.scene_id = OLD.scene_id;
    DELETE FROM live_event e WHERE e.scene_id = OLD.scene_id;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_replicated_removal() IS
'Trigger: deletes derived rows of a scene whose removal was replicated, in place of foreign keys. Restricted to the '
'scene that was removed.';

CREATE OR REPLACE TRIGGER area_replicated AFTER INSERT OR UPDATE OR DELETE ON area
    FOR EACH ROW EXECUTE FUNCTION _after_replicated_object(0, area_id);
ALTER TABLE area ENABLE REPLICA TRIGGER area_replicated;
CREATE OR REPLACE TRIGGER track_replicated AFTER INSERT OR UPDATE OR DELETE ON track
    FOR EACH ROW EXECUTE FUNCTION _after_replicated_object(1, track_id);
ALTER TABLE track ENABLE REPLICA TRIGGER track_replicated;
CREATE OR REPLACE TRIGGER scene_replicated AFTER DELETE ON scene
    FOR EACH ROW EXECUTE FUNCTION _after_replicated_removal();
ALTER TABLE scene ENABLE REPLICA TRIGGER scene_replicated;

-- A dump contains the keys that restored rows also insert through these triggers.

CREATE OR REPLACE FUNCTION conflictdb_internal._keep_restored_key() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN CASE WHEN EXISTS (SELECT FROM object_key k WHERE k.scene_id = NEW.scene_id AND k.key = NEW.key
                             AND k.object_kind = NEW.object_kind) THEN NULL ELSE NEW END;
END
$$;
COMMENT ON FUNCTION _keep_restored_key() IS 'Trigger: skips a restored key that its object has already inserted.';
CREATE OR REPLACE TRIGGER object_key_restored BEFORE INSERT ON object_key
    FOR EACH ROW WHEN (pg_trigger_depth() = 0) EXECUTE FUNCTION _keep_restored_key();
ALTER TABLE object_key ENABLE ALWAYS TRIGGER object_key_restored;

CREATE OR REPLACE TRIGGER scene_changed AFTER UPDATE ON scene
    FOR EACH ROW
    -- The horizon marks what its expansion changes.
    WHEN (_settings_of(OLD) - '{name,horizon_days}'::text[] IS DISTINCT FROM
          _settings_of(NEW) - '{name,horizon_days}'::text[])
    EXECUTE FUNCTION _after_scene_change();
ALTER TABLE scene ENABLE ALWAYS TRIGGER scene_changed;

CREATE OR REPLACE TRIGGER area_inserted AFTER INSERT ON area REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(0, area_id);
CREATE OR REPLACE TRIGGER area_updated AFTER UPDATE ON area REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(0, area_id);
CREATE OR REPLACE TRIGGER area_deleted AFTER DELETE ON area REFERENCING OLD TABLE AS old_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(0, area_id);
CREATE OR REPLACE TRIGGER track_inserted AFTER INSERT ON track REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(1, track_id);
CREATE OR REPLACE TRIGGER track_updated AFTER UPDATE ON track REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(1, track_id);
CREATE OR REPLACE TRIGGER track_deleted AFTER DELETE ON track REFERENCING OLD TABLE AS old_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(1, track_id);

CREATE OR REPLACE FUNCTION conflictdb_internal._refuse_truncate() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    RAISE EXCEPTION 'table % cannot be truncated: removed objects must leave marks', TG_TABLE_NAME
        USING ERRCODE = 'feature_not_supported', HINT = 'Use DELETE.';
END
$$;
COMMENT ON FUNCTION _refuse_truncate() IS 'Trigger: TRUNCATE would remove objects without marking them.';
CREATE OR REPLACE TRIGGER area_not_truncated BEFORE TRUNCATE ON area
    FOR EACH STATEMENT EXECUTE FUNCTION _refuse_truncate();
CREATE OR REPLACE TRIGGER track_not_truncated BEFORE TRUNCATE ON track
    FOR EACH STATEMENT EXECUTE FUNCTION _refuse_truncate();
ALTER TABLE area ENABLE ALWAYS TRIGGER area_not_truncated;
ALTER TABLE track ENABLE ALWAYS TRIGGER track_not_truncated;
