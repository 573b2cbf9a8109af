-- Previews of attach and reattach: both are done with the first rows, and rolled back.

CREATE OR REPLACE FUNCTION conflictdb_internal._preview(
    p_attachment attachment, p_table regclass, p_former_columns text[], p_objects integer, OUT steps text[],
    OUT objects text[], OUT unmapped text[]
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- Number of rows read for the first objects.
    c_most_rows CONSTANT integer := 10000;
    v_identities text[];
    v_where text := 'true';
BEGIN
    IF p_attachment.map ? 'where' THEN
        v_where := (_map_expression('', 'where', p_table, p_attachment.map ->> 'where', 'boolean'::regtype)).expression;
    END IF;
    steps := ARRAY[
        format('create function conflictdb_attached.rows_%1$s, by which role %3$I, and no other, reads %2$s',
               p_attachment.attachment_id, p_table, current_user),
        CASE WHEN p_attachment.has_triggers
             THEN (SELECT format('create triggers conflictdb_%s_… on %s', p_attachment.attachment_id,
                                 string_agg(t.relation::regclass::text, ', ' ORDER BY NOT t.is_root, t.relation))
                   FROM _attached_tables(p_table) t)
             ELSE format('compare all rows every %s', p_attachment.every) END,
        format('make %ss of scene %L of all rows%s, one for each (%s)',
               CASE p_attachment.object_kind WHEN 0 THEN 'area' ELSE 'track' END,
               (SELECT s.name FROM scene s WHERE s.scene_id = p_attachment.scene_id),
               ' where ' || (p_attachment.map ->> 'where'),
               (SELECT string_agg(quote_ident(c), ', ') FROM unnest(p_attachment.identity_columns) c))];
    EXECUTE format('SELECT ARRAY(SELECT DISTINCT i.identity FROM (SELECT %s AS identity FROM %s t WHERE %s '
                   'LIMIT $1) i ORDER BY 1 LIMIT $2)', _identity_of('t', p_attachment.identity_columns), p_table,
                   v_where)
        INTO v_identities USING c_most_rows, p_objects;
    PERFORM _begin_attached();
    EXECUTE format('INSERT INTO pg_temp.staged_attached '
                   'SELECT r.* FROM conflictdb_attached.rows_%s($1::text[], ''carefully''::text) r',
                   p_attachment.attachment_id)
        USING v_identities;
    IF p_former_columns <> p_attachment.identity_columns THEN
        INSERT INTO pg_temp.staged_attached (identity, is_asked)
            SELECT o.identity, true FROM attached_object o WHERE o.attachment_id = p_attachment.attachment_id;
    END IF;
    PERFORM _take_over_attached(p_attachment, '{}');
    objects := ARRAY(SELECT f.feature FROM (
                     SELECT a.key, _feature(a)::text
                     FROM attached_object o JOIN area a ON a.area_id = o.object_id
                     WHERE p_attachment.object_kind = 0 AND o.attachment_id = p_attachment.attachment_id
                           AND o.identity = ANY (v_identities)
                     UNION ALL
                     SELECT t.key, _feature(t)::text
                     FROM attached_object o JOIN track t ON t.track_id = o.object_id
                     WHERE p_attachment.object_kind = 1 AND o.attachment_id = p_attachment.attachment_id
                           AND o.identity = ANY (v_identities))
                     f (key, feature) ORDER BY f.key);
    unmapped := ARRAY(SELECT concat_ws(': ', o.identity, o.reason) FROM attached_object o
                      WHERE o.attachment_id = p_attachment.attachment_id AND o.reason IS NOT NULL
                            AND o.identity = ANY (v_identities));
END
$$;
COMMENT ON FUNCTION _preview(attachment, regclass, text[], integer) IS
'Takes over the first rows of an attachment without its triggers; returns what attaching it does, the first objects as '
'features of a scene file, and why some of them cannot be made. The caller rolls back.';

CREATE OR REPLACE FUNCTION preview_attachment(
    p_scene text, p_kind text, p_table regclass, p_map jsonb, p_every interval DEFAULT NULL,
    p_objects integer DEFAULT 5, p_again boolean DEFAULT false
) RETURNS TABLE (part text, what text)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_preview record;
BEGIN
    BEGIN
        v_preview := _preview(_register_attachment(p_scene, p_kind, p_table, p_map, p_every, p_again), p_table, NULL,
                              p_objects);
        -- Roll back all changes but keep the variable. Not a code ending in 000: that would catch its whole class.
        RAISE EXCEPTION USING ERRCODE = 'ZC999';
    EXCEPTION WHEN SQLSTATE 'ZC999' THEN
        NULL;
    END;
    RETURN QUERY SELECT 'would', w.what FROM unnest(v_preview.steps) WITH ORDINALITY w (what, n)
        UNION ALL SELECT 'object', o.what FROM unnest(v_preview.objects) WITH ORDINALITY o (what, n)
        UNION ALL SELECT 'unmapped', u.what FROM unnest(v_preview.unmapped) WITH ORDINALITY u (what, n);
END
$$;
COMMENT ON FUNCTION preview_attachment(text, text, regclass, jsonb, interval, integer, boolean) IS
'Returns what attach would do (part would), the first p_objects objects as features of a scene file (object), and why '
'some of these cannot be made (unmapped). Changes nothing.';

CREATE OR REPLACE FUNCTION preview_reattachment(
    p_scene text, p_table text, p_changes jsonb DEFAULT NULL, p_to regclass DEFAULT NULL, p_every interval DEFAULT NULL,
    p_objects integer DEFAULT 5
) RETURNS TABLE (part text, what text)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_former attachment;
    v_attachment attachment;
    v_preview record;
BEGIN
    BEGIN
        v_former := _hold_attachment(p_scene, p_table);
        v_attachment := _change_attachment(v_former, p_changes, p_to, p_every);
        v_preview := _preview(v_attachment, _attached_root(v_attachment)::regclass, v_former.identity_columns,
                              p_objects);
        RAISE EXCEPTION USING ERRCODE = 'ZC999';
    EXCEPTION WHEN SQLSTATE 'ZC999' THEN
        NULL;
    END;
    RETURN QUERY SELECT 'would', w.what FROM unnest(v_preview.steps) WITH ORDINALITY w (what, n)
        UNION ALL SELECT 'object', o.what FROM unnest(v_preview.objects) WITH ORDINALITY o (what, n)
        UNION ALL SELECT 'unmapped', u.what FROM unnest(v_preview.unmapped) WITH ORDINALITY u (what, n);
END
$$;
COMMENT ON FUNCTION preview_reattachment(text, text, jsonb, regclass, interval, integer) IS
'Returns what reattach would do, as preview_attachment does for attach. Changes nothing.';
