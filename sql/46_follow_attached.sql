-- Following attached tables: changed rows become objects, in one transaction per table.

CREATE OR REPLACE FUNCTION conflictdb_internal._rewatch_attached(p_attachment_id bigint) RETURNS text
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- Writers queue behind a session that waits for a table. It tries again soon.
SET lock_timeout = '100ms' AS $$
DECLARE
    v_attachment attachment%ROWTYPE;
    v_root oid;
    v_problems text[];
    v_who text;
BEGIN
    SELECT a.* INTO v_attachment FROM attachment a WHERE a.attachment_id = p_attachment_id
        FOR NO KEY UPDATE SKIP LOCKED;
    IF NOT FOUND OR NOT _is_mine(p_attachment_id) THEN
        RETURN NULL;
    END IF;
    v_root := _attached_root(v_attachment);
    v_problems := _attached_problems(v_attachment);
    v_who := format('attachment of %s', _attached_name(v_attachment));
    IF NOT v_problems && '{moved,parts,unwatched}' THEN
        RETURN NULL;
    END IF;
    PERFORM _hold_attached(v_who, v_root, v_attachment.has_triggers);
    PERFORM _check_attachable(v_who, v_root, v_attachment.has_triggers);
    IF 'moved' = ANY (v_problems) THEN
        PERFORM _create_attached_rows(v_who, p_attachment_id, v_attachment.object_kind, v_root, v_attachment.map);
        UPDATE attachment a
            SET (table_schema, table_name) = (SELECT n.nspname, c.relname FROM pg_catalog.pg_class c
                                              JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace
                                              WHERE c.oid = v_root)
            WHERE a.attachment_id = p_attachment_id;
    END IF;
    IF v_problems && '{parts,unwatched}' THEN
        INSERT INTO attached_change (attachment_id) VALUES (p_attachment_id);
    END IF;
    PERFORM _watch_attached(v_attachment, v_root, false);
    RETURN NULL;
EXCEPTION
    WHEN lock_not_available OR serialization_failure OR deadlock_detected THEN
        RETURN NULL;
    WHEN OTHERS THEN
        PERFORM _attachment_failed(p_attachment_id, SQLERRM);
        RETURN SQLERRM;
END
$$;
COMMENT ON FUNCTION _rewatch_attached(bigint) IS
'Follows an attached table that was renamed, and creates triggers that are missing, as on a new partition, with the '
'rights of the current role; all rows are compared next. Locks tables until the transaction ends, but waits for them '
'at most a tenth of a second. Returns why that failed; null if it did not, or if another session has them.';

CREATE OR REPLACE FUNCTION conflictdb_internal._missing_table(p_problems text[]) RETURNS text
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN 'remade' = ANY (p_problems)
                    THEN 'was dropped, and another one has its name: reattach takes that one, or detach it'
                WHEN 'gone' = ANY (p_problems) THEN 'no longer exists: reattach another one, or detach it' END;
END;
COMMENT ON FUNCTION _missing_table(text[]) IS 'Words for an attached table that was dropped; null if it was not.';

CREATE OR REPLACE FUNCTION conflictdb_internal._stage_attached(
    p_attachment attachment, p_problems text[], p_change_ids bigint[], p_is_full boolean, p_how text
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- It must end even if another session has locked the table.
SET lock_timeout = '10s' AS $$
DECLARE
    v_who text := format('attachment of %s', _attached_name(p_attachment));
BEGIN
    IF _missing_table(p_problems) IS NOT NULL THEN
        FOUND := _raise('ZC009', v_who, 'table', _missing_table(p_problems), 'attached_there');
    END IF;
    PERFORM _hold_attached(v_who, _attached_root(p_attachment), p_attachment.has_triggers);
    PERFORM _begin_attached();
    INSERT INTO pg_temp.staged_attached
        SELECT r.* FROM _attached_rows(p_attachment.attachment_id, p_change_ids, p_is_full, p_how) r;
END
$$;
COMMENT ON FUNCTION _stage_attached(attachment, text[], bigint[], boolean, text) IS
'Reads the changed rows of an attached table into staged_attached (_attached_rows), unless it has the given problems.';

CREATE OR REPLACE FUNCTION conflictdb_internal._follow_attachment(
    p_attachment_id bigint, p_waits boolean, OUT is_done boolean, OUT mapped bigint, OUT removed bigint,
    OUT unmapped bigint, OUT error text
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_attachment attachment%ROWTYPE;
    v_change_ids bigint[];
    v_problems text[];
    v_is_full boolean;
    v_is_read boolean;
    v_how text;
BEGIN
    -- Serialises sessions that follow the same table.
    IF p_waits THEN
        SELECT a.* INTO v_attachment FROM attachment a WHERE a.attachment_id = p_attachment_id FOR NO KEY UPDATE;
    ELSE
        SELECT a.* INTO v_attachment FROM attachment a WHERE a.attachment_id = p_attachment_id
            FOR NO KEY UPDATE SKIP LOCKED;
    END IF;
    is_done := FOUND AND _is_mine(p_attachment_id);
    IF NOT is_done THEN
        RETURN;
    END IF;
    v_problems := _attached_problems(v_attachment);
    -- The function reads the former name, which may be another table's.
    is_done := NOT 'moved' = ANY (v_problems);
    IF NOT is_done THEN
        RETURN;
    END IF;
    SELECT coalesce(array_agg(c.attached_change_id), '{}'),
           _is_due(v_attachment) OR coalesce(bool_or(c.identities IS NULL), false)
        INTO v_change_ids, v_is_full FROM attached_change c WHERE c.attachment_id = p_attachment_id;
    -- All rows at once; if that fails, one by one, so that one failing row does not stop the others.
    FOREACH v_how IN ARRAY ARRAY['rows', 'carefully'] LOOP
        BEGIN
            v_is_read := false;
            PERFORM _stage_attached(v_attachment, v_problems, v_change_ids, v_is_full, v_how);
            v_is_read := true;
            SELECT t.mapped, t.removed, t.unmapped INTO mapped, removed, unmapped
                FROM _take_over_attached(v_attachment, v_change_ids) t;
            error := NULL;
            EXIT;
        EXCEPTION
            WHEN lock_not_available THEN
                -- Another session has the scene, as one that loads it: no fault of the table.
                IF v_is_read THEN
                    RAISE;
                END IF;
                error := 'another session has locked it';
                EXIT;
            WHEN OTHERS THEN
                error := SQLERRM;
        END;
    END LOOP;
    IF error IS NULL THEN
        UPDATE attachment a SET failed_at = NULL, error = NULL,
                                compared_at = CASE WHEN v_is_full THEN now() ELSE a.compared_at END,
                                comparison_s = CASE WHEN v_is_full THEN extract(epoch FROM clock_timestamp() - now())
                                                    ELSE a.comparison_s END
            WHERE a.attachment_id = p_attachment_id;
    ELSE
        PERFORM _attachment_failed(p_attachment_id, error);
    END IF;
END
$$;
COMMENT ON FUNCTION _follow_attachment(bigint, boolean) IS
'Updates the objects of an attachment from its table: returns numbers of objects created, updated or unchanged, of '
'objects removed, and of rows that cannot be mapped, or why the table cannot be read. is_done: false for other roles, '
'for a table that _rewatch_attached has to follow first, and unless p_waits while another session follows it: then '
'nothing happens.';

CREATE OR REPLACE FUNCTION follow_attached(p_scene text)
RETURNS TABLE ("table" text, mapped bigint, removed bigint, unmapped bigint, error text)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- The second round serves rows whose key the first round freed.
    c_rounds CONSTANT integer := 2;
    v_one record;
    v_round integer;
    v_error text;
BEGIN
    PERFORM _scene_to_change(p_scene);
    FOR v_round IN 1..c_rounds LOOP
        FOR v_one IN SELECT f.* FROM _attachments_to_follow(p_scene, v_round = 1) f LOOP
            v_error := CASE WHEN v_one.is_moved THEN _rewatch_attached(v_one.attachment_id) END;
            RETURN QUERY SELECT _attached_name(a), d.mapped, d.removed, d.unmapped, coalesce(v_error, d.error)
                         FROM attachment a CROSS JOIN _follow_attachment(v_one.attachment_id, true) d
                         WHERE a.attachment_id = v_one.attachment_id AND (d.is_done OR v_error IS NOT NULL);
        END LOOP;
    END LOOP;
END
$$;
COMMENT ON FUNCTION follow_attached(text) IS
'Updates the objects of a scene from the tables that the current role attached; returns one row per changed table: '
'numbers of objects created, updated or unchanged (mapped), of objects removed, and of rows that cannot be mapped '
'(view unmapped), and why a table cannot be read. Creates missing triggers, as on a new partition, which it then locks '
'against writers until the transaction ends. Detections and workers of that role do this automatically; other roles, '
'including superusers, never read the table.';

-- If changes of a table may be missed, its scene is not current.

CREATE OR REPLACE FUNCTION conflictdb_internal._last_run_s(p_scene_id bigint) RETURNS double precision
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- From the times of its stages: its start is an instant of another machine.
    SELECT coalesce((SELECT coalesce(r.pieces_s, 0) + coalesce(r.stage1_s, 0) + coalesce(r.stage2_s, 0)
                            + coalesce(r.stage3_s, 0) + coalesce(r.stage4_s, 0) + coalesce(r.write_s, 0)
                     FROM run r WHERE r.scene_id = p_scene_id ORDER BY r.run_id DESC LIMIT 1), 0);
END;
COMMENT ON FUNCTION _last_run_s(bigint) IS 'Seconds that the last detection of a scene took; 0: there was none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attachment_remark(p_attachment attachment) RETURNS text
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_role name := _attaching_role(p_attachment.attachment_id);
    v_problems text[] := _attached_problems(p_attachment);
BEGIN
    RETURN CASE
        WHEN v_problems && '{gone,remade}' THEN 'the table ' || _missing_table(v_problems)
        WHEN v_role IS NULL THEN 'the function that reads the table is gone: reattach makes it again'
        WHEN 'disabled' = ANY (v_problems) THEN 'triggers are disabled: enable them, or reattach the table'
        WHEN v_problems && '{parts,unwatched}'
            THEN format('partitions or triggers changed, which role %I has not followed yet: run a worker as that role,'
                        ' or follow_attached(scene)', v_role)
        -- Twice the interval: the role's sessions compare as soon as it is due, but not during a detection.
        WHEN NOT p_attachment.has_triggers AND (p_attachment.compared_at IS NULL
                 OR p_attachment.compared_at < now() - 2 * p_attachment.every - interval '10 s'
                                               - 2 * make_interval(secs => coalesce(p_attachment.comparison_s, 0)
                                                                           + _last_run_s(p_attachment.scene_id)))
            THEN format('was compared last at %s: run a worker as role %I, or follow_attached(scene) every %s',
                        coalesce(p_attachment.compared_at::text, 'no time'), v_role, p_attachment.every)
        WHEN v_role <> current_user AND EXISTS (SELECT FROM attached_change q
                                                WHERE q.attachment_id = p_attachment.attachment_id)
            THEN format('changes wait for role %I: run a worker as that role, or follow_attached(scene)', v_role)
        END;
END
$$;
COMMENT ON FUNCTION _attachment_remark(attachment) IS
'Why changes of an attached table may be missed; null if they are not.';

CREATE OR REPLACE VIEW attachments WITH (security_invoker = true) AS
SELECT s.name AS scene, a.attachment_id, CASE a.object_kind WHEN 0 THEN 'area' ELSE 'track' END AS kind,
       _attached_name(a) AS "table", a.map,
       _attaching_role(a.attachment_id) AS role, a.has_triggers, a.every,
       (SELECT count(*) FROM attached_object o WHERE o.attachment_id = a.attachment_id AND o.object_id IS NOT NULL)
           AS objects,
       (SELECT count(*) FROM attached_object o WHERE o.attachment_id = a.attachment_id AND o.reason IS NOT NULL)
           AS unmapped,
       EXISTS (SELECT FROM attached_change q WHERE q.attachment_id = a.attachment_id) AS is_waiting,
       a.compared_at, a.failed_at, a.error,
       _attachment_remark(a) AS remark
FROM attachment a JOIN scene s USING (scene_id);

COMMENT ON VIEW attachments IS 'Tables attached to scenes, and their state.';
COMMENT ON COLUMN attachments.scene IS 'Name of the scene.';
COMMENT ON COLUMN attachments.attachment_id IS 'Id, part of the names of its triggers and function.';
COMMENT ON COLUMN attachments.kind IS 'Kind of the objects made from its rows: area or track.';
COMMENT ON COLUMN attachments."table" IS 'The table, as SCHEMA.TABLE.';
COMMENT ON COLUMN attachments.map IS 'The column or expression of each field, as given.';
COMMENT ON COLUMN attachments.role IS
'Role that attached it and reads it; null if the function that reads it is missing.';
COMMENT ON COLUMN attachments.has_triggers IS 'Whether triggers record changes of the table.';
COMMENT ON COLUMN attachments.every IS
'Interval between comparisons of all rows; without triggers, only these find changes.';
COMMENT ON COLUMN attachments.objects IS 'Number of objects of the scene made from its rows.';
COMMENT ON COLUMN attachments.unmapped IS 'Number of objects that cannot be made (view unmapped).';
COMMENT ON COLUMN attachments.is_waiting IS 'Whether recorded changes are not applied yet.';
COMMENT ON COLUMN attachments.compared_at IS 'When all rows were last compared; null: never.';
COMMENT ON COLUMN attachments.failed_at IS
'When reading it last failed; null if the last attempt succeeded. It is retried after a minute.';
COMMENT ON COLUMN attachments.error IS 'Why reading it failed; null if the last attempt succeeded.';
COMMENT ON COLUMN attachments.remark IS 'Another problem, which may hide changes; null if there is none.';

CREATE OR REPLACE VIEW unmapped WITH (security_invoker = true) AS
SELECT s.name AS scene, a.attachment_id, _attached_name(a) AS "table",
       a.identity_columns, o.identity, o.key, o.reason, o.since, o.object_id IS NOT NULL AS is_kept
FROM attached_object o JOIN attachment a USING (attachment_id) JOIN scene s USING (scene_id)
WHERE o.reason IS NOT NULL;

COMMENT ON VIEW unmapped IS 'Rows of attached tables whose current values do not make an object, and why.';
COMMENT ON COLUMN unmapped.scene IS 'Name of the scene.';
COMMENT ON COLUMN unmapped.attachment_id IS 'Id of the attachment.';
COMMENT ON COLUMN unmapped."table" IS 'The table, as SCHEMA.TABLE.';
COMMENT ON COLUMN unmapped.identity_columns IS 'Columns from which the key is computed.';
COMMENT ON COLUMN unmapped.identity IS 'Values of these columns, as the text of an array.';
COMMENT ON COLUMN unmapped.key IS 'Key the object would have; null if there is none.';
COMMENT ON COLUMN unmapped.reason IS 'Why it cannot be made.';
COMMENT ON COLUMN unmapped.since IS 'Since when it cannot be made.';
COMMENT ON COLUMN unmapped.is_kept IS
'Whether the scene keeps the previous object: until the row can be mapped again, or is removed.';
