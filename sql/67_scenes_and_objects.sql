-- Listing objects; renaming, copying and removing scenes and objects.

CREATE OR REPLACE FUNCTION list_objects(p_scene text) RETURNS TABLE (
    key text, kind text, name text, start_at timestamptz, end_at timestamptz, floor_m double precision,
    ceiling_m double precision, class text, owner text, schedule jsonb
)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT a.key, 'area', a.name, lower(_active_within(a.active_span, a.activations)),
           upper(_active_within(a.active_span, a.activations)), a.floor_m, a.ceiling_m,
           a.class, a.owner, a.schedule
    FROM _seen_areas(_scene_or_branch(p_scene)) a
    UNION ALL
    SELECT t.key, 'track', t.name, lower(_at_sea(t.path, t.departures)), upper(_at_sea(t.path, t.departures)),
           t.floor_m, t.ceiling_m, t.class, t.owner, t.schedule
    FROM _seen_tracks(_scene_or_branch(p_scene)) t
    ORDER BY 1;
END;
COMMENT ON FUNCTION list_objects(text) IS
'Areas and tracks of a scene, by key: when they are there, their heights (metres above the vertical datum), and their '
'schedule as written; null: unbounded, or no schedule. Raises ZC010 for an unknown scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._refuse_taken(p_name text) RETURNS void
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    FOUND := _raise('ZC007', format('scene %L', p_name), 'name', 'is taken by another scene', 'scene_name_unique');
END
$$;
COMMENT ON FUNCTION _refuse_taken(text) IS 'Raises ZC007: the name of a scene is taken.';

CREATE OR REPLACE FUNCTION rename_scene(p_scene text, p_name text) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch_to_change(p_scene);
BEGIN
    UPDATE scene s SET name = p_name WHERE s.scene_id = v_scene_id;
EXCEPTION
    WHEN unique_violation THEN
        PERFORM _refuse_taken(p_name);
END
$$;
COMMENT ON FUNCTION rename_scene(text, text) IS
'Renames a scene; its conflicts and history stay. Raises ZC007 if the name is taken.';

CREATE OR REPLACE FUNCTION copy_scene(p_scene text, p_name text) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch(p_scene);
    v_copy_id bigint;
BEGIN
    BEGIN
        INSERT INTO scene (name) VALUES (p_name) RETURNING scene_id INTO v_copy_id;
    EXCEPTION
        WHEN unique_violation THEN
            PERFORM _refuse_taken(p_name);
    END;
    PERFORM _set_scene(p_name, _scene_settings(s.scene_id) - 'name') FROM scene s WHERE s.scene_id = v_scene_id;
    -- The first detection expands schedules.
    INSERT INTO area (
        scene_id, key,
        /* area columns: NAME */
        footprint, active_span, floor_m, ceiling_m, name, properties, class, owner, activations, schedule
        /* end */
    ) SELECT
        v_copy_id, a.key,
        /* area columns: WRITTEN(a) */
        a.footprint, a.active_span, a.floor_m, a.ceiling_m, a.name, a.properties, a.class, a.owner,
        CASE WHEN a.schedule IS NULL THEN a.activations END, a.schedule
        /* end */
        FROM _seen_areas(v_scene_id) a;
    INSERT INTO track (
        scene_id, key,
        /* track columns: NAME */
        path, outline, floor_m, ceiling_m, name, properties, grow_mps, outlines, floors_m, ceilings_m, class, owner,
        tolerances, departures, schedule
        /* end */
    ) SELECT
        v_copy_id, t.key,
        /* track columns: WRITTEN(t) */
        t.path, t.outline, t.floor_m, t.ceiling_m, t.name, t.properties, t.grow_mps, t.outlines, t.floors_m,
        t.ceilings_m, t.class, t.owner, t.tolerances, CASE WHEN t.schedule IS NULL THEN t.departures END, t.schedule
        /* end */
        FROM _seen_tracks(v_scene_id) t;
    RETURN v_copy_id;
END
$$;
COMMENT ON FUNCTION copy_scene(text, text) IS
'Copies settings, rules and objects of a scene into a new one, which belongs to the current role; returns its id. '
'Conflicts, history, shares and attached tables are not copied: the copy waits for a detection. Raises ZC007 if the '
'name is taken.';

CREATE OR REPLACE FUNCTION remove_scene(p_scene text) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch_to_change(p_scene);
BEGIN
    DELETE FROM scene s WHERE s.scene_id = v_scene_id;
    -- Row-level security silently skips a scene of another role.
    IF NOT FOUND THEN
        FOUND := _raise('42501', format('scene %L', p_scene), 'owner', format('is not role %I', current_user),
                        'scene_owned', 'Only the owner of a protected scene may remove it.');
    END IF;
END
$$;
COMMENT ON FUNCTION remove_scene(text) IS
'Removes a scene with its objects, conflicts, history and branches. A protected scene: only for its owner.';

CREATE OR REPLACE FUNCTION rename_object(p_scene text, p_key text, p_new_key text) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch_to_change(p_scene);
BEGIN
    IF _parent_of(v_scene_id) IS NOT NULL THEN
        IF _has_key(v_scene_id, p_key) AND (SELECT o.object_id FROM _object_with(v_scene_id, p_key) o) IS NULL THEN
            FOUND := _raise('ZC020', format('object %L', p_key), 'key', 'is of the parent of a branch', 'object_own',
                            'Put it under the new key, and remove the former.');
        END IF;
        IF p_key <> p_new_key AND _has_key(v_scene_id, p_new_key) THEN
            RAISE unique_violation;
        END IF;
    END IF;
    IF EXISTS (SELECT FROM attachment a JOIN attached_object o USING (attachment_id)
               WHERE a.scene_id = v_scene_id AND o.key = p_key) THEN
        FOUND := _raise('ZC008', format('object %L', p_key), 'key', 'comes from an attached table', 'object_own',
                        'Change the row of the table.');
    END IF;
    UPDATE area a SET key = p_new_key WHERE a.scene_id = v_scene_id AND a.key = p_key;
    IF NOT FOUND THEN
        UPDATE track t SET key = p_new_key WHERE t.scene_id = v_scene_id AND t.key = p_key;
    END IF;
    IF NOT FOUND THEN
        FOUND := _raise('ZC011', format('object %L', p_key), 'key', format('is no object of scene %L', p_scene),
                        'object_known');
    END IF;
EXCEPTION
    WHEN unique_violation THEN
        FOUND := _raise('ZC007', format('object %L', p_new_key), 'key', 'is taken by another object of the scene',
                        'object_key_unique');
END
$$;
COMMENT ON FUNCTION rename_object(text, text, text) IS
'Gives an area or track another key. Until the next detection its conflicts show the former key and are not current. '
'Raises ZC007 if the key is taken, ZC011 if there is no such object.';
