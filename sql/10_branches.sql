-- Branches: a branch is a scene that stores only the objects it has edited, and reads all others from its parent.
--
-- branch_edit lists the keys that differ: an edited key is read from the branch, or is gone there. A branch of 50,000
-- objects therefore takes the space of its edits. It follows its parent: what the parent changes, the branch shows,
-- unless it has edited it too. A question that does not read branches refuses them (_scene_id).
--
-- A branch locks no row of its parent, and nobody who works on the parent waits for a lock of a branch: its role may be
-- one that only reads the parent. So a branch may miss a change of the parent that commits at the same time, or that
-- finds the branch locked. Then it is not current (_is_behind_parent), and its next detection follows first.

CREATE OR REPLACE FUNCTION conflictdb_internal._parent_of(p_scene_id bigint) RETURNS bigint
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT s.parent_scene_id FROM scene s WHERE s.scene_id = p_scene_id;
END;
COMMENT ON FUNCTION _parent_of(bigint) IS 'Returns the parent of a branch; null for any other scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._unseen_hidden(p_branch_id bigint, p_parent_id bigint)
RETURNS TABLE (object_kind smallint, object_id bigint)
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE
SET search_path = conflictdb, conflictdb_internal, pg_temp SET enable_seqscan = off SET jit = off AS $$
#variable_conflict use_column
BEGIN
    RETURN QUERY
    SELECT o.object_kind, o.object_id
    FROM branch_edit e
    JOIN object_key k ON k.scene_id = p_parent_id AND k.key = e.key
    CROSS JOIN LATERAL _object_with(p_parent_id, e.key) o
    WHERE e.scene_id = p_branch_id AND e.object_id IS NULL
      AND EXISTS (SELECT FROM conflict c WHERE c.scene_id = p_branch_id
                    AND (c.a_key = e.key AND c.a_kind = o.object_kind AND c.a_id = o.object_id
                         OR c.b_key = e.key AND c.b_kind = o.object_kind AND c.b_id = o.object_id));
END
$$;
COMMENT ON FUNCTION _unseen_hidden(bigint, bigint) IS
'Objects that a parent got while its branch put their keys, and that still have conflicts in the branch.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_behind_parent(p_scene_id bigint) RETURNS boolean
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    c_own CONSTANT text[] := '{name,delays_within_s}';
    v_parent_id bigint := _parent_of(p_scene_id);
BEGIN
    IF v_parent_id IS NULL THEN
        RETURN false;
    END IF;
    RETURN NOT EXISTS (SELECT FROM scene b JOIN scene p ON p.scene_id = b.parent_scene_id
                       WHERE b.scene_id = p_scene_id AND _settings_of(b) - c_own = _settings_of(p) - c_own)
           OR (SELECT array_agg(r::text ORDER BY r::text) FROM jsonb_array_elements(_rules_of(p_scene_id)) r)
              IS DISTINCT FROM
              (SELECT array_agg(r::text ORDER BY r::text) FROM jsonb_array_elements(_rules_of(v_parent_id)) r)
           OR EXISTS (SELECT FROM _unseen_hidden(p_scene_id, v_parent_id));
END
$$;
COMMENT ON FUNCTION _is_behind_parent(bigint) IS
'Whether a branch has missed a change of its parent, or has lost it; false for any other scene. _follow_parent mends '
'it.';

CREATE OR REPLACE FUNCTION conflictdb_internal._follow_parent(p_branch_id bigint) RETURNS void
LANGUAGE plpgsql VOLATILE STRICT SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_parent_id bigint := _parent_of(p_branch_id);
BEGIN
    IF _is_behind_parent(p_branch_id) AND EXISTS (SELECT FROM scene p WHERE p.scene_id = v_parent_id) THEN
        -- _as_branch copies the settings. Of a column without a unique index: the name would exclude foreign keys.
        UPDATE scene b SET motion = b.motion WHERE b.scene_id = p_branch_id;
        PERFORM _put_rules(p_branch_id, _rules_of(v_parent_id), true);
        INSERT INTO change (scene_id, object_kind, object_id, version)
            SELECT p_branch_id, o.object_kind, o.object_id, nextval('version_seq')
            FROM _unseen_hidden(p_branch_id, v_parent_id) o;
    END IF;
END
$$;
COMMENT ON FUNCTION _follow_parent(bigint) IS
'Gives a branch the settings and rules of its parent; marks what they change, and objects of the parent that it hides.';

CREATE OR REPLACE FUNCTION conflictdb_internal._at_once(p_branch_id bigint, p_is_removal boolean) RETURNS boolean
LANGUAGE plpgsql VOLATILE STRICT SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    c_wait CONSTANT text := '20ms';
    v_lock_timeout text := current_setting('lock_timeout');
BEGIN
    PERFORM set_config('lock_timeout', c_wait, true);
    IF p_is_removal THEN
        DELETE FROM scene b WHERE b.scene_id = p_branch_id;
    ELSE
        PERFORM _follow_parent(p_branch_id);
    END IF;
    PERFORM set_config('lock_timeout', v_lock_timeout, true);
    RETURN true;
EXCEPTION WHEN OTHERS THEN
    -- Settings that do not fit its own objects (class ZC) stop its detection, not its parent.
    IF SQLSTATE NOT IN ('55P03', '40001') AND SQLSTATE !~ '^ZC' THEN
        RAISE;
    END IF;
    RETURN false;
END
$$;
COMMENT ON FUNCTION _at_once(bigint, boolean) IS
'Removes a branch, or lets it follow its parent; does nothing and returns false if another session has locked it, or '
'if it cannot have the settings of its parent.';

CREATE OR REPLACE FUNCTION conflictdb_internal._settle_branches(p_parent_id bigint, p_is_removal boolean) RETURNS void
LANGUAGE plpgsql VOLATILE STRICT SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    -- Locked branches together delay their parent by no more.
    c_most_locked CONSTANT integer := 10;
    -- And many large ones by little more.
    c_most CONSTANT interval := '0.5 s';
    v_end timestamptz := clock_timestamp() + c_most;
    v_locked integer := 0;
    v_branch_id bigint;
BEGIN
    FOR v_branch_id IN SELECT b.scene_id FROM scene b WHERE b.parent_scene_id = p_parent_id ORDER BY 1 LOOP
        EXIT WHEN v_locked >= c_most_locked OR clock_timestamp() > v_end;
        v_locked := v_locked + (NOT _at_once(v_branch_id, p_is_removal))::integer;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _settle_branches(bigint, boolean) IS
'Lets the branches of a scene follow it, or removes them; passes over those that other sessions have locked: their '
'detections follow, and workers remove them.';

CREATE OR REPLACE FUNCTION conflictdb_internal._drop_orphans() RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    PERFORM _at_once(b.scene_id, true) FROM scene b
        WHERE b.parent_scene_id IS NOT NULL
          AND NOT EXISTS (SELECT FROM scene p WHERE p.scene_id = b.parent_scene_id);
    -- Marks have no foreign key, which would lock the scene.
    DELETE FROM change m WHERE m.scene_id IN (
        WITH RECURSIVE marked AS (
            SELECT min(c.scene_id) AS scene_id FROM change c
            UNION ALL
            SELECT (SELECT min(c.scene_id) FROM change c WHERE c.scene_id > k.scene_id) FROM marked k
            WHERE k.scene_id IS NOT NULL
        )
        SELECT k.scene_id FROM marked k WHERE NOT EXISTS (SELECT FROM scene s WHERE s.scene_id = k.scene_id));
END
$$;
COMMENT ON FUNCTION _drop_orphans() IS
'Removes branches and marks that were in use when their scene was removed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._free_orphan_name(p_name text) RETURNS void
LANGUAGE plpgsql VOLATILE STRICT SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_branch_id bigint;
BEGIN
    SELECT b.scene_id INTO v_branch_id FROM scene b
        WHERE b.name = p_name AND b.parent_scene_id IS NOT NULL
          AND NOT EXISTS (SELECT FROM scene p WHERE p.scene_id = b.parent_scene_id);
    IF FOUND AND NOT _at_once(v_branch_id, true) THEN
        FOUND := _raise('ZC007', format('scene %L', p_name), 'name', 'is still used by a branch of a removed scene',
                        'scene_name_unique', 'Another session works on it. Try again.');
    END IF;
END
$$;
COMMENT ON FUNCTION _free_orphan_name(text) IS
'Removes a branch of a name that was in use when its scene was removed; raises ZC007 if it still is. Runs as its '
'owner: the branch may belong to another role, and nobody sees it. Restricted to branches whose scene is gone.';

CREATE OR REPLACE FUNCTION conflictdb_internal._before_scene_name() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    PERFORM _free_orphan_name(NEW.name);
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _before_scene_name() IS 'Trigger: frees the name of a new or renamed scene.';
CREATE OR REPLACE TRIGGER scene_name_freed BEFORE INSERT OR UPDATE OF name ON scene
    FOR EACH ROW EXECUTE FUNCTION _before_scene_name();
ALTER TABLE scene ENABLE ALWAYS TRIGGER scene_name_freed;

CREATE OR REPLACE FUNCTION conflictdb_internal._layers(p_scene_id bigint) RETURNS bigint[]
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN array_remove(ARRAY[p_scene_id, _parent_of(p_scene_id)], NULL);
END
$$;
COMMENT ON FUNCTION _layers(bigint) IS
'Scenes whose rows a scene reads: itself, and the parent of a branch (without _hidden_numbers).';

CREATE OR REPLACE FUNCTION conflictdb_internal._hidden_numbers(p_scene_id bigint) RETURNS bigint[]
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_parent_id bigint := _parent_of(p_scene_id);
BEGIN
    IF v_parent_id IS NULL THEN
        RETURN '{}';
    END IF;
    -- OFFSET 0 forces a lookup per key.
    RETURN ARRAY(SELECT o.number FROM branch_edit e
                 CROSS JOIN LATERAL (SELECT _object_number(0::smallint, a.area_id) AS number
                                     FROM area a WHERE a.scene_id = v_parent_id AND a.key = e.key
                                     UNION ALL
                                     SELECT _object_number(1::smallint, t.track_id)
                                     FROM track t WHERE t.scene_id = v_parent_id AND t.key = e.key OFFSET 0) o
                 WHERE e.scene_id = p_scene_id);
END
$$;
COMMENT ON FUNCTION _hidden_numbers(bigint) IS
'Objects of the parent (_object_number) that a branch has edited or removed; empty for any other scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._seen_areas(p_scene_id bigint) RETURNS SETOF area
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT a.* FROM area a WHERE a.scene_id = p_scene_id
    UNION ALL
    SELECT a.* FROM scene b JOIN area a ON a.scene_id = b.parent_scene_id
    WHERE b.scene_id = p_scene_id
      AND NOT EXISTS (SELECT FROM branch_edit e WHERE e.scene_id = b.scene_id AND e.key = a.key);
END;
COMMENT ON FUNCTION _seen_areas(bigint) IS
'Areas of a scene; of a branch also those of its parent. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._seen_tracks(p_scene_id bigint) RETURNS SETOF track
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT t.* FROM track t WHERE t.scene_id = p_scene_id
    UNION ALL
    SELECT t.* FROM scene b JOIN track t ON t.scene_id = b.parent_scene_id
    WHERE b.scene_id = p_scene_id
      AND NOT EXISTS (SELECT FROM branch_edit e WHERE e.scene_id = b.scene_id AND e.key = t.key);
END;
COMMENT ON FUNCTION _seen_tracks(bigint) IS
'Tracks of a scene; of a branch also those of its parent. Inlined into queries.';

CREATE OR REPLACE VIEW conflictdb_internal._layer WITH (security_invoker = true) AS
SELECT s.scene_id AS seen_by, s.scene_id FROM scene s
UNION ALL
SELECT s.scene_id, s.parent_scene_id FROM scene s WHERE s.parent_scene_id IS NOT NULL;
COMMENT ON VIEW _layer IS
'Scenes whose rows each scene reads: itself, and the parent of a branch (without edited keys).';
COMMENT ON COLUMN _layer.seen_by IS 'The scene that reads.';
COMMENT ON COLUMN _layer.scene_id IS 'The scene that is read.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_edited(p_scene_id bigint, p_key text) RETURNS boolean
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT EXISTS (SELECT FROM branch_edit e WHERE e.scene_id = p_scene_id AND e.key = p_key);
END;
COMMENT ON FUNCTION _is_edited(bigint, text) IS 'Whether a branch has edited or removed a key. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._has_key(p_scene_id bigint, p_key text) RETURNS boolean
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE
SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    RETURN EXISTS (SELECT FROM object_key k WHERE k.scene_id = p_scene_id AND k.key = p_key)
           OR EXISTS (SELECT FROM scene b JOIN object_key k ON k.scene_id = b.parent_scene_id
                      WHERE b.scene_id = p_scene_id AND k.key = p_key AND NOT _is_edited(b.scene_id, k.key));
END
$$;
COMMENT ON FUNCTION _has_key(bigint, text) IS 'Whether a scene has an object with a key; a branch: also of its parent.';

CREATE OR REPLACE FUNCTION conflictdb_internal._branch_edit_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_parent_id bigint := _parent_of(NEW.scene_id);
BEGIN
    IF current_setting('session_replication_role') = 'replica' THEN
        RETURN NEW;
    END IF;
    -- A restore gives the versions, perhaps after its objects have made the row.
    IF num_nonnulls(NEW.object_id, NEW.version) > 0 THEN
        DELETE FROM branch_edit e WHERE e.scene_id = NEW.scene_id AND e.key = NEW.key;
        RETURN NEW;
    END IF;
    SELECT o.* INTO NEW.object_kind, NEW.object_id, NEW.version FROM _object_with(v_parent_id, NEW.key) o;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _branch_edit_before() IS
'Trigger: stores which object of the parent an edit replaces, and its version. Runs as its owner, as that decides what '
'a merge refuses. Restricted to the key of the row.';

CREATE OR REPLACE FUNCTION conflictdb_internal._object_with(
    p_scene_id bigint, p_key text, OUT object_kind smallint, OUT object_id bigint, OUT version bigint
)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    SELECT 0, a.area_id, a.version INTO object_kind, object_id, version
        FROM area a WHERE a.scene_id = p_scene_id AND a.key = p_key;
    IF NOT FOUND THEN
        SELECT 1, t.track_id, t.version INTO object_kind, object_id, version
            FROM track t WHERE t.scene_id = p_scene_id AND t.key = p_key;
    END IF;
END
$$;
COMMENT ON FUNCTION _object_with(bigint, text) IS
'Kind, id and version of the object with a key; nulls if there is none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_branch_edit() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    INSERT INTO change (scene_id, object_kind, object_id, version)
        SELECT n.scene_id, n.object_kind, n.object_id, nextval('version_seq')
        FROM new_rows n WHERE n.object_id IS NOT NULL;
    PERFORM _wake_workers();
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_branch_edit() IS
'Trigger: marks the objects of the parent that edits replace, so that their conflicts with objects of the branch '
'close. Runs as its owner: editors cannot write all marks. Restricted to the inserted edits.';

CREATE OR REPLACE TRIGGER branch_edit_before BEFORE INSERT ON branch_edit
    FOR EACH ROW EXECUTE FUNCTION _branch_edit_before();
ALTER TABLE branch_edit ENABLE ALWAYS TRIGGER branch_edit_before;
CREATE OR REPLACE TRIGGER branch_edit_inserted AFTER INSERT ON branch_edit REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_branch_edit();

COMMENT ON COLUMN scene.parent_scene_id IS 'The scene that this one is a branch of; null: none.';
COMMENT ON TABLE branch_edit IS 'Keys that branches have edited or removed.';
COMMENT ON COLUMN branch_edit.scene_id IS 'The branch.';
COMMENT ON COLUMN branch_edit.key IS 'Key that the branch no longer reads from its parent.';
COMMENT ON COLUMN branch_edit.object_kind IS 'Object of the parent at the first edit: 0 area, 1 track; null: none.';
COMMENT ON COLUMN branch_edit.object_id IS 'Its id; null: none.';
COMMENT ON COLUMN branch_edit.version IS 'Its version, which a merge must find unchanged; null: none.';
