-- Preview of an attachment.

CREATE OR REPLACE FUNCTION preview_attachment(
    p_scene text, p_kind text, p_table regclass, p_map jsonb, p_every interval DEFAULT NULL, p_objects integer DEFAULT 5
) RETURNS TABLE (part text, what text)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- Number of rows read for the first objects.
    c_most_rows CONSTANT integer := 10000;
    v_attachment attachment;
    v_identities text[];
    v_where text := 'true';
    v_would text[];
    v_objects text[];
    v_unmapped text[];
BEGIN
    BEGIN
        v_attachment := _register_attachment(p_scene, p_kind, p_table, p_map, p_every);
        IF p_map ? 'where' THEN
            v_where := (_map_expression('', 'where', p_table, p_map ->> 'where', 'boolean'::regtype)).expression;
        END IF;
        v_would := ARRAY[
            format('create function conflictdb_attached.rows_%1$s, by which role %3$I, and no other, reads %2$s',
                   v_attachment.attachment_id, p_table, current_user),
            CASE WHEN v_attachment.has_triggers
                 THEN (SELECT format('create triggers conflictdb_%s_… on %s', v_attachment.attachment_id,
                                     string_agg(t.relation::regclass::text, ', ' ORDER BY NOT t.is_root, t.relation))
                       FROM _attached_tables(p_table) t)
                 ELSE format('compare all rows every %s', v_attachment.every) END,
            format('make %ss of scene %L of all rows%s, one for each (%s)', p_kind, p_scene,
                   ' where ' || (p_map ->> 'where'),
                   (SELECT string_agg(quote_ident(c), ', ') FROM unnest(v_attachment.identity_columns) c))];
        EXECUTE format('SELECT ARRAY(SELECT DISTINCT i.identity FROM (SELECT %s AS identity FROM %s t WHERE %s '
                       'LIMIT $1) i ORDER BY 1 LIMIT $2)', _identity_of('t', v_attachment.identity_columns), p_table,
                       v_where)
            INTO v_identities USING c_most_rows, p_objects;
        PERFORM _begin_attached();
        EXECUTE format('INSERT INTO pg_temp.staged_attached '
                       'SELECT r.* FROM conflictdb_attached.rows_%s($1::text[], ''carefully''::text) r',
                       v_attachment.attachment_id)
            USING v_identities;
        PERFORM _take_over_attached(v_attachment, '{}');
        v_objects := ARRAY(SELECT f.feature FROM (
                           SELECT a.key, _feature(a)::text
                           FROM attached_object o JOIN area a ON a.area_id = o.object_id
                           WHERE v_attachment.object_kind = 0 AND o.attachment_id = v_attachment.attachment_id
                           UNION ALL
                           SELECT t.key, _feature(t)::text
                           FROM attached_object o JOIN track t ON t.track_id = o.object_id
                           WHERE v_attachment.object_kind = 1 AND o.attachment_id = v_attachment.attachment_id)
                           f (key, feature) ORDER BY f.key);
        v_unmapped := ARRAY(SELECT concat_ws(': ', o.identity, o.reason) FROM attached_object o
                            WHERE o.attachment_id = v_attachment.attachment_id AND o.reason IS NOT NULL);
        -- Roll back all changes but keep the variables. Not a code ending in 000: that would catch its whole class.
        RAISE EXCEPTION USING ERRCODE = 'ZC999';
    EXCEPTION WHEN SQLSTATE 'ZC999' THEN
        NULL;
    END;
    RETURN QUERY SELECT 'would', w.what FROM unnest(v_would) WITH ORDINALITY w (what, n)
        UNION ALL SELECT 'object', o.what FROM unnest(v_objects) WITH ORDINALITY o (what, n)
        UNION ALL SELECT 'unmapped', u.what FROM unnest(v_unmapped) WITH ORDINALITY u (what, n);
END
$$;
COMMENT ON FUNCTION preview_attachment(text, text, regclass, jsonb, interval, integer) IS
'Returns what attach would do (part would), the first p_objects objects as features of a scene file (object), and why '
'some of these cannot be made (unmapped). Changes nothing.';
