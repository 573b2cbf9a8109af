-- Ownership of scenes and access of other roles. Row-level security (93_row_security.sql) enforces it once scenes are
-- protected (66_sharing.sql); before that, only the roles of conflictdb matter.

CREATE OR REPLACE VIEW conflictdb_internal._my_role AS
SELECT r.rolname AS role FROM pg_catalog.pg_roles r WHERE pg_has_role(r.oid, 'USAGE')
UNION ALL SELECT 'public';
COMMENT ON VIEW _my_role IS 'Roles whose rights the current role has, and public.';
COMMENT ON COLUMN _my_role.role IS 'Name of the role.';

-- Runs with the rights of its owner, to whom row-level security does not apply, because policies query it.
-- OFFSET 0 keeps UNION ALL intact: otherwise user conditions could be evaluated on rows the user may not see.
CREATE OR REPLACE VIEW conflictdb_internal._accessible WITH (security_barrier = true) AS
SELECT a.scene_id, a.may_write, a.is_owner
FROM (SELECT s.scene_id, true AS may_write, true AS is_owner
      FROM scene s WHERE s.owner IN (SELECT m.role FROM _my_role m)
      UNION ALL
      -- Branches of its own scenes, also of roles that may no longer read them.
      SELECT b.scene_id, true, true
      FROM scene p JOIN scene b ON b.parent_scene_id = p.scene_id WHERE p.owner IN (SELECT m.role FROM _my_role m)
      UNION ALL
      SELECT h.scene_id, h.may_write, false
      FROM scene_share h WHERE h.role IN (SELECT m.role FROM _my_role m)) a
-- A branch that showed no objects of its parent would answer from a part.
WHERE NOT EXISTS (SELECT FROM scene b LEFT JOIN scene p ON p.scene_id = b.parent_scene_id
                  WHERE b.scene_id = a.scene_id AND b.parent_scene_id IS NOT NULL AND NOT (
                      p.owner IN (SELECT m.role FROM _my_role m)
                      OR EXISTS (SELECT FROM scene_share h WHERE h.scene_id = p.scene_id
                                 AND h.role IN (SELECT m.role FROM _my_role m))) IS TRUE)
OFFSET 0;
COMMENT ON VIEW _accessible IS
'Scenes that the current role owns or that are shared with it; branches if it may read the parent, too; all branches '
'of scenes that it owns.';
COMMENT ON COLUMN _accessible.scene_id IS 'Scene.';
COMMENT ON COLUMN _accessible.may_write IS 'Whether the role may change it.';
COMMENT ON COLUMN _accessible.is_owner IS 'Whether the role owns it.';

-- Functions for policies: planned once per session, as planning them for every table of a query costs more than
-- running.

CREATE OR REPLACE FUNCTION conflictdb_internal._my_roles() RETURNS SETOF name
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN QUERY SELECT m.role FROM _my_role m;
END
$$;
COMMENT ON FUNCTION _my_roles() IS 'Roles whose rights the current role has, and public.';

CREATE OR REPLACE FUNCTION conflictdb_internal._readable_scenes() RETURNS SETOF bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN QUERY SELECT a.scene_id FROM _accessible a;
END
$$;
COMMENT ON FUNCTION _readable_scenes() IS 'Ids of scenes that the current role owns or that are shared with it.';

CREATE OR REPLACE FUNCTION conflictdb_internal._writable_scenes() RETURNS SETOF bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN QUERY SELECT a.scene_id FROM _accessible a WHERE a.may_write;
END
$$;
COMMENT ON FUNCTION _writable_scenes() IS 'Ids of scenes that the current role owns or that are shared for writing.';

CREATE OR REPLACE FUNCTION conflictdb_internal._own_scenes() RETURNS SETOF bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN QUERY SELECT a.scene_id FROM _accessible a WHERE a.is_owner;
END
$$;
COMMENT ON FUNCTION _own_scenes() IS 'Ids of scenes that the current role owns.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_protected() RETURNS boolean
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT c.relrowsecurity FROM pg_catalog.pg_class c WHERE c.oid = 'scene'::regclass;
END;
COMMENT ON FUNCTION _is_protected() IS
'Whether scenes are visible only to their owners and the roles they are shared with.';

CREATE OR REPLACE FUNCTION conflictdb_internal._may_change(p_scene_id bigint) RETURNS boolean
-- Not LANGUAGE sql, which would be planned at each call.
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET jit = off AS $$
BEGIN
    IF NOT row_security_active('scene'::regclass::oid) OR pg_has_role('conflictdb_worker', 'USAGE') THEN
        RETURN true;
    END IF;
    RETURN EXISTS (SELECT FROM _accessible a WHERE a.scene_id = p_scene_id AND a.may_write);
END
$$;
COMMENT ON FUNCTION _may_change(bigint) IS 'Whether row-level security allows the current role to change a scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_may_change(p_scene_id bigint, p_scene text) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF NOT _may_change(p_scene_id) THEN
        FOUND := _raise('42501', format('scene %L', p_scene), 'owner',
                        format('lets role %I read it, but not change it', current_user), 'scene_changeable',
                        format('Its owner may run: SELECT conflictdb.share_scene(%L, %L, ''write'')', p_scene,
                               current_user));
    END IF;
END
$$;
COMMENT ON FUNCTION _check_may_change(bigint, text) IS
'Raises insufficient_privilege for a scene that the current role may read but not change.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_to_change(p_scene text) RETURNS bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
BEGIN
    PERFORM _check_may_change(v_scene_id, p_scene);
    RETURN v_scene_id;
END
$$;
COMMENT ON FUNCTION _scene_to_change(text) IS
'Returns the scene''s id; raises ZC010 for an unknown name, ZC020 for a branch, insufficient_privilege for a scene '
'that the current role may not change.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_or_branch_to_change(p_scene text) RETURNS bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch(p_scene);
BEGIN
    PERFORM _check_may_change(v_scene_id, p_scene);
    RETURN v_scene_id;
END
$$;
COMMENT ON FUNCTION _scene_or_branch_to_change(text) IS 'As _scene_to_change, also for a branch.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_owner(
    p_who text, p_owner name, p_new_owner name, p_is_new boolean
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    -- The owner of the tables may do everything, including restores.
    IF NOT p_is_new AND p_new_owner IS NOT DISTINCT FROM p_owner
       OR pg_has_role((SELECT c.relowner FROM pg_catalog.pg_class c WHERE c.oid = 'scene'::regclass), 'USAGE') THEN
        RETURN;
    END IF;
    IF (p_owner IN (SELECT m.role FROM _my_role m WHERE m.role <> 'public')) IS NOT TRUE THEN
        FOUND := _raise('42501', p_who, 'owner',
                        format('is %s, not role %I', coalesce('role ' || quote_ident(p_owner), 'nobody'), current_user),
                        'scene_owned');
    END IF;
    PERFORM _check_role(p_who, p_new_owner::text);
END
$$;
COMMENT ON FUNCTION _check_owner(text, name, name, boolean) IS
'Raises insufficient_privilege if the current role is not the owner of a new scene, or changes the owner of a scene it '
'does not own; ZC009 if the new owner does not exist.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_role(p_who text, p_role text) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM pg_catalog.pg_roles r WHERE r.rolname::text = p_role) THEN
        FOUND := _raise('ZC009', p_who, 'role', format('%s is not a role of this server', quote_nullable(p_role)),
                        'role_known', 'Names are used literally: no quotes, case is kept.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_role(text, text) IS 'Raises ZC009 for a role that does not exist.';
