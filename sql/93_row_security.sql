-- Row-level security, active once scenes are protected (66_sharing.sql): a role sees and changes rows of scenes that it
-- owns or that are shared with it. Workers see all; so do the owner of the tables, superusers and roles with BYPASSRLS.
--
-- Subqueries do not depend on rows, so they run once per statement. One policy per command, so that editors run only
-- one.

DO $$
DECLARE
    c_readable CONSTANT text := 'scene_id IN (SELECT conflictdb_internal._readable_scenes())';
    c_writable CONSTANT text := 'scene_id IN (SELECT conflictdb_internal._writable_scenes())';
    c_owned CONSTANT text := 'scene_id IN (SELECT conflictdb_internal._own_scenes())';
    -- A scene inserted by the same statement is not visible to the functions yet.
    c_mine CONSTANT text := '%s IN (SELECT conflictdb_internal._my_roles())';
    c_attached CONSTANT text := 'attachment_id IN (SELECT a.attachment_id FROM conflictdb.attachment a WHERE %s)';
    v_table regclass;
    v_readable text;
    v_writable text;
    v_removable text;
    v_addable text;
    v_one record;
BEGIN
    FOR v_table IN SELECT t FROM conflictdb_internal._protected_tables() t
                   UNION ALL SELECT 'conflictdb.scene_share'::regclass LOOP
        v_readable := CASE v_table::text
            WHEN 'scene' THEN format(c_mine, 'owner') || ' AND parent_scene_id IS NULL OR ' || c_readable
            WHEN 'scene_share' THEN format(c_mine, 'role') || ' OR ' || c_owned
            WHEN 'attached_relation' THEN format(c_attached, 'a.' || c_readable)
            WHEN 'attached_change' THEN format(c_attached, 'a.' || c_readable)
            WHEN 'attached_object' THEN format(c_attached, 'a.' || c_readable)
            ELSE c_readable END;
        v_writable := CASE v_table::text
            WHEN 'scene_share' THEN c_owned
            WHEN 'attached_relation' THEN format(c_attached, 'a.' || c_writable)
            WHEN 'attached_change' THEN format(c_attached, 'a.' || c_writable)
            WHEN 'attached_object' THEN format(c_attached, 'a.' || c_writable)
            ELSE c_writable END;
        v_addable := CASE v_table::text WHEN 'scene' THEN format(c_mine, 'owner') ELSE v_writable END;
        v_removable := CASE v_table::text WHEN 'scene' THEN c_owned ELSE v_writable END;
        FOR v_one IN SELECT * FROM (VALUES
            ('read', 'SELECT TO conflictdb_reader', v_readable, NULL),
            ('add', 'INSERT TO ' || CASE v_table WHEN 'conflictdb.position'::regclass THEN 'conflictdb_tracker'
                                                 ELSE 'conflictdb_editor' END, NULL, v_addable),
            ('change', 'UPDATE TO conflictdb_editor', v_writable,
             CASE v_table::text WHEN 'scene' THEN 'true' ELSE v_writable END),
            ('remove', 'DELETE TO conflictdb_editor', v_removable, NULL),
            ('work', 'ALL TO conflictdb_worker', 'true', 'true')) p (name, what, using_rule, check_rule) LOOP
            EXECUTE format('DROP POLICY IF EXISTS %I ON %s', v_one.name, v_table);
            EXECUTE format('CREATE POLICY %I ON %s FOR %s', v_one.name, v_table, v_one.what)
                    || coalesce(' USING (' || v_one.using_rule || ')', '')
                    || coalesce(' WITH CHECK (' || v_one.check_rule || ')', '');
        END LOOP;
    END LOOP;
    -- Shares are always protected; new tables are protected like the others.
    ALTER TABLE scene_share ENABLE ROW LEVEL SECURITY;
    IF _is_protected() THEN
        PERFORM protect_scenes();
    END IF;
END
$$;
