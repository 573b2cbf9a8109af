-- Following attached tables: changed rows become objects, in one transaction per table.

CREATE OR REPLACE FUNCTION conflictdb_internal._follow_attachment(
    p_attachment_id bigint, OUT is_done boolean, OUT mapped bigint, OUT removed bigint, OUT unmapped bigint,
    OUT error text
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_attachment attachment%ROWTYPE;
    v_change_ids bigint[];
    v_is_full boolean;
    v_how text;
BEGIN
    -- Serialises sessions that follow the same table.
    SELECT a.* INTO v_attachment FROM attachment a WHERE a.attachment_id = p_attachment_id FOR NO KEY UPDATE;
    is_done := FOUND AND _is_mine(p_attachment_id);
    IF NOT is_done THEN
        RETURN;
    END IF;
    SELECT coalesce(array_agg(c.attached_change_id), '{}'),
           NOT _is_compared(v_attachment) OR coalesce(bool_or(c.identities IS NULL), false)
        INTO v_change_ids, v_is_full FROM attached_change c WHERE c.attachment_id = p_attachment_id;
    -- All rows at once; if that fails, one by one, so that one failing row does not stop the others.
    FOREACH v_how IN ARRAY ARRAY['rows', 'carefully'] LOOP
        BEGIN
            -- The name may now belong to another relation.
            PERFORM _hold_attached(format('attachment of %I.%I', v_attachment.table_schema, v_attachment.table_name),
                                   format('%I.%I', v_attachment.table_schema, v_attachment.table_name),
                                   v_attachment.has_triggers);
            PERFORM _begin_attached();
            INSERT INTO pg_temp.staged_attached
                SELECT r.* FROM _attached_rows(p_attachment_id, v_change_ids, v_is_full, v_how) r;
            SELECT t.mapped, t.removed, t.unmapped INTO mapped, removed, unmapped
                FROM _take_over_attached(v_attachment, v_change_ids) t;
            error := NULL;
            EXIT;
        EXCEPTION WHEN OTHERS THEN
            error := SQLERRM;
        END;
    END LOOP;
    IF error IS NULL THEN
        UPDATE attachment a SET failed_at = NULL, error = NULL,
                                compared_at = CASE WHEN v_is_full THEN now() ELSE a.compared_at END
            WHERE a.attachment_id = p_attachment_id;
    ELSE
        PERFORM _attachment_failed(p_attachment_id, error);
    END IF;
END
$$;
COMMENT ON FUNCTION _follow_attachment(bigint) IS
'Updates the objects of an attachment from its table: returns numbers of objects created, updated or unchanged, of '
'objects removed, and of rows that cannot be mapped, or why the table cannot be read. is_done: false for other roles, '
'for which nothing happens.';

CREATE OR REPLACE FUNCTION follow_attached(p_scene text)
RETURNS TABLE ("table" text, mapped bigint, removed bigint, unmapped bigint, error text)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- The second round serves rows whose key the first round freed.
    c_rounds CONSTANT integer := 2;
    v_attachment_id bigint;
    v_round integer;
BEGIN
    PERFORM _scene_to_change(p_scene);
    FOR v_round IN 1..c_rounds LOOP
        FOR v_attachment_id IN SELECT f FROM _attachments_to_follow(p_scene, v_round = 1) f LOOP
            RETURN QUERY SELECT format('%I.%I', a.table_schema, a.table_name), d.mapped, d.removed, d.unmapped, d.error
                         FROM attachment a CROSS JOIN _follow_attachment(v_attachment_id) d
                         WHERE a.attachment_id = v_attachment_id AND d.is_done;
        END LOOP;
    END LOOP;
END
$$;
COMMENT ON FUNCTION follow_attached(text) IS
'Updates the objects of a scene from the tables that the current role attached; returns one row per changed table: '
'numbers of objects created, updated or unchanged (mapped), of objects removed, and of rows that cannot be mapped '
'(view unmapped), and why a table cannot be read. Detections and workers of that role do this automatically; other '
'roles, including superusers, never read the table.';

-- If changes of a table may be missed, its scene is not current.

CREATE OR REPLACE FUNCTION conflictdb_internal._attachment_remark(p_attachment attachment) RETURNS text
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_role name := _attaching_role(p_attachment.attachment_id);
BEGIN
    RETURN CASE
        WHEN v_role IS NULL THEN 'the function that reads the table is gone: detach, and attach again'
        WHEN NOT EXISTS (SELECT FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace
                         WHERE n.nspname = p_attachment.table_schema AND c.relname = p_attachment.table_name)
            THEN 'the table no longer exists: detach it'
        WHEN p_attachment.has_triggers AND NOT _is_watched(p_attachment.attachment_id, p_attachment.table_schema,
                                                           p_attachment.table_name)
            THEN 'triggers are missing or disabled, maybe on a new partition: detach, and attach again'
        -- Twice the interval: the role's sessions compare as soon as it is due.
        WHEN NOT p_attachment.has_triggers AND (p_attachment.compared_at IS NULL
                 OR p_attachment.compared_at < now() - 2 * p_attachment.every - interval '10 s')
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
       format('%I.%I', a.table_schema, a.table_name) AS "table", a.map,
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
SELECT s.name AS scene, a.attachment_id, format('%I.%I', a.table_schema, a.table_name) AS "table",
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
