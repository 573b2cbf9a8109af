-- Sharing and giving away scenes, and protecting them by row-level security.

CREATE OR REPLACE FUNCTION conflictdb_internal._own_scene_id(p_scene text) RETURNS bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_owner name := (SELECT s.owner FROM scene s WHERE s.scene_id = v_scene_id);
BEGIN
    IF NOT pg_has_role((SELECT c.relowner FROM pg_catalog.pg_class c WHERE c.oid = 'scene'::regclass), 'USAGE')
       AND (v_owner IN (SELECT m.role FROM _my_role m)) IS NOT TRUE THEN
        FOUND := _raise('42501', format('scene %L', p_scene), 'owner',
                        format('is %s, not role %I', coalesce('role ' || quote_ident(v_owner), 'nobody'), current_user),
                        'scene_owned', 'Only the owner of the scene or of schema conflictdb may share it or give '
                        'it away.');
    END IF;
    RETURN v_scene_id;
END
$$;
COMMENT ON FUNCTION _own_scene_id(text) IS
'Returns the scene''s id; raises ZC010 for an unknown name, insufficient_privilege if the current role owns neither '
'the scene nor the schema conflictdb.';

CREATE OR REPLACE FUNCTION share_scene(p_scene text, p_role text, p_access text DEFAULT 'read') RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene_id bigint := _own_scene_id(p_scene);
    v_needed text;
BEGIN
    IF (p_access IN ('read', 'write')) IS NOT TRUE THEN
        FOUND := _raise('ZC009', format('scene %L', p_scene), 'access',
                        format('must be read or write; got %s', quote_nullable(p_access)), 'share_access_known');
    END IF;
    v_needed := CASE p_access WHEN 'read' THEN 'conflictdb_reader' ELSE 'conflictdb_editor' END;
    IF p_role IS DISTINCT FROM 'public' THEN
        PERFORM _check_role(format('scene %L', p_scene), p_role);
        IF NOT pg_has_role(p_role::name, v_needed, 'USAGE') THEN
            RAISE NOTICE 'role % is no member of % yet', quote_ident(p_role), v_needed
                USING HINT = format('An administrator may run: GRANT %I TO %I', v_needed, p_role);
        END IF;
    END IF;
    INSERT INTO scene_share AS h (scene_id, role, may_write) VALUES (v_scene_id, p_role, p_access = 'write')
        ON CONFLICT (scene_id, role) DO UPDATE
            SET may_write = excluded.may_write, shared_by = excluded.shared_by, shared_at = excluded.shared_at;
    IF NOT _is_protected() THEN
        RAISE NOTICE 'scenes are not protected in this database: every reader reads, and every editor changes, all'
            USING CONSTRAINT = 'scenes_protected',
                  HINT = 'The owner of schema conflictdb may run: SELECT conflictdb.protect_scenes()';
    END IF;
END
$$;
COMMENT ON FUNCTION share_scene(text, text, text) IS
'Lets a role and its members read, or also change (p_access write), a scene; role public: every role. Takes effect '
'once scenes are protected (protect_scenes). Only for the owner of the scene or of schema conflictdb. The role also '
'needs conflictdb_reader, or conflictdb_editor to write.';

CREATE OR REPLACE FUNCTION unshare_scene(p_scene text, p_role text) RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene_id bigint := _own_scene_id(p_scene);
BEGIN
    DELETE FROM scene_share h WHERE h.scene_id = v_scene_id AND h.role::text = p_role;
    RETURN FOUND;
END
$$;
COMMENT ON FUNCTION unshare_scene(text, text) IS
'Withdraws a share from a role, even if the role no longer exists; returns whether there was one. Only for the owner '
'of the scene or of schema conflictdb.';

CREATE OR REPLACE FUNCTION give_scene(p_scene text, p_role text) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene_id bigint := _own_scene_id(p_scene);
BEGIN
    PERFORM _check_role(format('scene %L', p_scene), p_role);
    UPDATE scene s SET owner = p_role WHERE s.scene_id = v_scene_id;
END
$$;
COMMENT ON FUNCTION give_scene(text, text) IS
'Makes another role the owner of a scene. Only for the owner of the scene or of schema conflictdb.';

CREATE OR REPLACE VIEW shares WITH (security_invoker = true) AS
SELECT s.name AS scene, s.owner AS role, 'own' AS access, NULL::name AS shared_by, NULL::timestamptz AS shared_at
FROM scene s WHERE s.owner IS NOT NULL
UNION ALL
SELECT s.name, h.role, CASE WHEN h.may_write THEN 'write' ELSE 'read' END, h.shared_by, h.shared_at
FROM scene_share h JOIN scene s USING (scene_id);

COMMENT ON VIEW shares IS
'Owners and shares of scenes. Owners see all shares of a scene, other roles only their own.';
COMMENT ON COLUMN shares.scene IS 'Name of the scene.';
COMMENT ON COLUMN shares.role IS 'The role; public: every role.';
COMMENT ON COLUMN shares.access IS 'own, write or read; each includes the following ones.';
COMMENT ON COLUMN shares.shared_by IS 'Role that shared it; null for the owner.';
COMMENT ON COLUMN shares.shared_at IS 'When it was shared; null for the owner.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shares(p_scene text) RETURNS SETOF shares
LANGUAGE plpgsql STABLE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    PERFORM _scene_id(p_scene);
    RETURN QUERY SELECT s.* FROM shares s WHERE s.scene = p_scene ORDER BY s.access <> 'own', s.role;
END
$$;
COMMENT ON FUNCTION _shares(text) IS
'Owner and shares of a scene, as far as the current role may see them; raises ZC010 for an unknown name.';

CREATE OR REPLACE FUNCTION conflictdb_internal._protected_tables() RETURNS SETOF regclass
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    -- Probes and shares always have row-level security. Workers, looks, limits and seals belong to no scene.
    -- By the schema's name: PostgreSQL 18 cannot move a routine that depends on the schema in its body, too.
    SELECT c.oid::regclass FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace
    WHERE n.nspname = 'conflictdb' AND c.relkind IN ('r', 'p')
      AND c.relname NOT IN ('alembic_version', 'probe_request', 'probe_reply', 'scene_share', 'worker_stamp',
                            'upper_limit', 'edit_seal', 'position_look');
END;
COMMENT ON FUNCTION _protected_tables() IS 'Tables whose rows belong to scenes.';

CREATE OR REPLACE FUNCTION protect_scenes(p_on boolean DEFAULT true) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp SET lock_timeout = '10s' AS $$
DECLARE
    v_table regclass;
    v_orphans bigint;
BEGIN
    FOR v_table IN SELECT t FROM _protected_tables() t ORDER BY t::text LOOP
        EXECUTE format('ALTER TABLE %s %s ROW LEVEL SECURITY', v_table,
                       CASE WHEN p_on THEN 'ENABLE' ELSE 'DISABLE' END);
    END LOOP;
    SELECT count(*) INTO v_orphans FROM scene s WHERE s.owner IS NULL;
    IF p_on AND v_orphans > 0 THEN
        RAISE NOTICE '% of the scenes belong to no role yet: only workers and administrators see them', v_orphans
            USING CONSTRAINT = 'scenes_owned',
                  HINT = 'SELECT conflictdb.give_scene(scene, role), or share_scene(scene, ''public'', ''write'')';
    END IF;
END
$$;
COMMENT ON FUNCTION protect_scenes(boolean) IS
'Switches protection of scenes on or off, by row-level security: a protected scene is visible only to its owner, roles '
'it is shared with, workers, and the owner of schema conflictdb. Only that owner may call this.';
