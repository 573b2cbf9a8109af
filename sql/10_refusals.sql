-- Invalid input raises one SQLSTATE per rule, class ZC.
--
-- ZC001 invalid_geometry        ZC002 time_not_increasing    ZC003 invalid_span
-- ZC004 invalid_heights         ZC005 coordinate_out_of_range ZC006 invalid_outline
-- ZC007 duplicate_key           ZC008 invalid_key            ZC009 invalid_setting
-- ZC010 unknown_scene           ZC011 unknown_object         ZC012 invalid_properties
-- ZC013 wrong_sequence (called out of order, or in an unsuitable transaction)
-- ZC014 not_current (within the time limit)   ZC015 not_answered (within the time limit)
-- ZC016 invalid_plan             ZC017 too_large
-- ZC018 out_of_date (a proposal, since its scene changed)   ZC019 invalid_rule
-- ZC020 is_branch
--
-- Functions called by SECURITY DEFINER routines set search_path to the schemas of conflictdb: in another schema a user
-- could define a better-matching function or operator.
--
-- A refusal is written FOUND := _raise(...): an assignment evaluates the call without a statement of its own. PERFORM
-- would add the source of the call to the error's CONTEXT, which psql shows.
--
-- Checks are at most STABLE: the planner may evaluate IMMUTABLE calls early, even in a branch that never runs.

CREATE OR REPLACE FUNCTION conflictdb_internal._raise(
    p_state text, p_who text, p_field text, p_rule text, p_constraint text, p_hint text DEFAULT ''
) RETURNS boolean
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF p_hint = '' THEN -- RAISE would show an empty hint, and does not accept null.
        RAISE EXCEPTION '%: %: %', p_who, p_field, p_rule
            USING ERRCODE = p_state, TABLE = p_who, COLUMN = p_field, CONSTRAINT = p_constraint, SCHEMA = 'conflictdb';
    END IF;
    RAISE EXCEPTION '%: %: %', p_who, p_field, p_rule
        USING ERRCODE = p_state, TABLE = p_who, COLUMN = p_field, CONSTRAINT = p_constraint, SCHEMA = 'conflictdb',
              HINT = p_hint;
END
$$;
COMMENT ON FUNCTION _raise(text, text, text, text, text, text) IS
'Raises SQLSTATE p_state, so it never returns. For programs, TABLE names the object, COLUMN the field and CONSTRAINT '
'the rule.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_or_branch(p_scene text) RETURNS bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene_id bigint := (SELECT s.scene_id FROM scene s WHERE s.name = p_scene);
    v_known text;
BEGIN
    IF v_scene_id IS NULL OR EXISTS (SELECT FROM scene b WHERE b.scene_id = v_scene_id AND b.parent_scene_id IS NOT NULL
                                     AND NOT EXISTS (SELECT FROM scene p WHERE p.scene_id = b.parent_scene_id)) THEN
        SELECT string_agg(quote_literal(k.name), ', ' ORDER BY k.name)
            INTO v_known FROM (SELECT s.name FROM scene s ORDER BY s.name LIMIT 20) k;
        FOUND := _raise('ZC010', format('scene %L', p_scene), 'name',
                        'is not in this database; known: ' || coalesce(v_known, 'none'), 'scene_known',
                        'create_scene(name) creates one.');
    END IF;
    RETURN v_scene_id;
END
$$;
COMMENT ON FUNCTION _scene_or_branch(text) IS
'Returns the id of a scene, also of a branch, for queries that read its parent, too (10_branches.sql); raises ZC010 '
'for an unknown name.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_id(p_scene text) RETURNS bigint
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene_id bigint;
    v_parent_id bigint;
BEGIN
    SELECT s.scene_id, s.parent_scene_id INTO v_scene_id, v_parent_id FROM scene s WHERE s.name = p_scene;
    IF v_parent_id IS NOT NULL THEN
        FOUND := _raise('ZC020', format('scene %L', p_scene), 'name',
                        format('is a branch of %L, and this needs a whole scene',
                               (SELECT s.name FROM scene s WHERE s.scene_id = v_parent_id)), 'scene_whole',
                        'copy_scene(branch, name) makes one of it; merge_branch(branch) takes its edits over.');
    END IF;
    RETURN coalesce(v_scene_id, _scene_or_branch(p_scene));
END
$$;
COMMENT ON FUNCTION _scene_id(text) IS
'Returns the scene''s id; raises ZC010 for an unknown name, ZC020 for a branch (_scene_or_branch).';

CREATE OR REPLACE FUNCTION conflictdb_internal._require_snapshot() RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF current_setting('transaction_isolation') = 'read committed' THEN
        FOUND := _raise('ZC013', 'detection', 'transaction', 'must read one snapshot: REPEATABLE READ',
                        'detection_on_one_snapshot');
    END IF;
END
$$;
COMMENT ON FUNCTION _require_snapshot() IS
'Raises ZC013 in a READ COMMITTED transaction, whose statements could see marks and objects of different states.';
