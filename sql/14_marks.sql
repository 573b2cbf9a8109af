-- Marks: every change of an object leaves a row in `change`, in the same transaction. The marks are the queue.
--
--   made (is_covered = false) --pieces refreshed--> covered (true) --conflicts replaced--> deleted
--                                transaction 1                        transaction 2
--
-- Writers only insert marks and a detection only touches marks it saw: they never wait for, or fail, each other.

CREATE OR REPLACE FUNCTION _after_object_change() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path FROM CURRENT AS $$
DECLARE
    v_kind smallint := TG_ARGV[0];
    v_id text := TG_ARGV[1];
    v_renamed text;
    v_wanted bigint;
    v_claimed bigint;
    v_taken text;
    v_marked bigint;
BEGIN
    IF TG_OP IN ('UPDATE', 'DELETE') THEN
        EXECUTE format('DELETE FROM object_key k USING old_rows o WHERE k.scene_id = o.scene_id AND k.key = o.key'
                       || CASE TG_OP WHEN 'UPDATE' THEN ' AND NOT EXISTS (SELECT FROM new_rows n WHERE n.%1$I = o.%1$I '
                                                        'AND n.key = o.key)' ELSE '' END, v_id);
    END IF;
    IF TG_OP = 'DELETE' THEN
        -- When the scene itself goes, its marks go too.
        EXECUTE format('INSERT INTO change (scene_id, object_kind, object_id, version) '
                       'SELECT o.scene_id, $1, o.%I, nextval(''version_seq'') FROM old_rows o '
                       'JOIN scene s ON s.scene_id = o.scene_id', v_id) USING v_kind;
        GET DIAGNOSTICS v_marked = ROW_COUNT;
    ELSE
        v_renamed := CASE TG_OP WHEN 'UPDATE' THEN format('JOIN old_rows o ON o.%1$I = n.%1$I AND o.key <> n.key', v_id)
                                ELSE '' END;
        EXECUTE format('SELECT count(*) FROM new_rows n %s', v_renamed) INTO v_wanted;
        EXECUTE format('INSERT INTO object_key (scene_id, key, object_kind) SELECT n.scene_id, n.key, $1 '
                       'FROM new_rows n %s ON CONFLICT DO NOTHING', v_renamed) USING v_kind;
        GET DIAGNOSTICS v_claimed = ROW_COUNT;
        IF v_claimed < v_wanted THEN
            EXECUTE 'SELECT n.key FROM new_rows n JOIN object_key k ON k.scene_id = n.scene_id AND k.key = n.key '
                    'WHERE k.object_kind <> $1 ORDER BY n.key LIMIT 1' INTO v_taken USING v_kind;
            PERFORM _refuse('ZC007', format('%s %L', TG_TABLE_NAME, v_taken), 'key',
                            'is taken by another object of the scene', 'object_key_unique');
        END IF;
        EXECUTE format('INSERT INTO change (scene_id, object_kind, object_id, version) '
                       'SELECT n.scene_id, $1, n.%1$I, n.version FROM new_rows n'
                       || CASE TG_OP WHEN 'UPDATE' THEN ' JOIN old_rows o ON o.%1$I = n.%1$I AND o.version <> n.version'
                                     ELSE '' END, v_id) USING v_kind;
        GET DIAGNOSTICS v_marked = ROW_COUNT;
    END IF;
    IF v_marked > 0 THEN
        PERFORM pg_notify('conflictdb_request', '');
    END IF;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_object_change() IS
'Trigger, once per statement: marks changed objects, keeps keys unique in their scene, wakes workers. '
'Arguments: kind (0 area, 1 track) and name of the id column. Runs as its owner: editors cannot touch marks.';

CREATE OR REPLACE FUNCTION _mark_all(p_scene_id bigint) RETURNS bigint
LANGUAGE sql VOLATILE PARALLEL UNSAFE
BEGIN ATOMIC
    WITH marked AS (
        INSERT INTO change (scene_id, object_kind, object_id, version)
        SELECT p_scene_id, 0, a.area_id, nextval('version_seq') FROM area a WHERE a.scene_id = p_scene_id
        UNION ALL
        SELECT p_scene_id, 1, t.track_id, nextval('version_seq') FROM track t WHERE t.scene_id = p_scene_id
        RETURNING change_id
    )
    SELECT count(*) FROM marked;
END;
COMMENT ON FUNCTION _mark_all(bigint) IS 'Marks every object of a scene as changed; returns how many.';

CREATE OR REPLACE FUNCTION _after_scene_change() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _mark_all(NEW.scene_id);
    PERFORM pg_notify('conflictdb_request', '');
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_scene_change() IS
'Trigger: other settings mean other pieces and other conflicts, so every object of the scene is marked.';

CREATE OR REPLACE TRIGGER scene_changed AFTER UPDATE ON scene
    FOR EACH ROW
    WHEN ((OLD.motion, OLD.earth, OLD.method, OLD.tolerance_m, OLD.separation_m, OLD.nearest_m, OLD.centre_lon,
           OLD.centre_lat)
          IS DISTINCT FROM (NEW.motion, NEW.earth, NEW.method, NEW.tolerance_m, NEW.separation_m, NEW.nearest_m,
                            NEW.centre_lon, NEW.centre_lat))
    EXECUTE FUNCTION _after_scene_change();

CREATE OR REPLACE TRIGGER area_inserted AFTER INSERT ON area REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(0, area_id);
CREATE OR REPLACE TRIGGER area_updated AFTER UPDATE ON area REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(0, area_id);
CREATE OR REPLACE TRIGGER area_deleted AFTER DELETE ON area REFERENCING OLD TABLE AS old_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(0, area_id);
CREATE OR REPLACE TRIGGER track_inserted AFTER INSERT ON track REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(1, track_id);
CREATE OR REPLACE TRIGGER track_updated AFTER UPDATE ON track REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(1, track_id);
CREATE OR REPLACE TRIGGER track_deleted AFTER DELETE ON track REFERENCING OLD TABLE AS old_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change(1, track_id);

CREATE OR REPLACE FUNCTION _refuse_truncate() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    RAISE EXCEPTION 'table % cannot be truncated: removed objects must leave marks', TG_TABLE_NAME
        USING ERRCODE = 'feature_not_supported', HINT = 'Use DELETE.';
END
$$;
COMMENT ON FUNCTION _refuse_truncate() IS 'Trigger: TRUNCATE would remove objects without marking them.';
CREATE OR REPLACE TRIGGER area_not_truncated BEFORE TRUNCATE ON area
    FOR EACH STATEMENT EXECUTE FUNCTION _refuse_truncate();
CREATE OR REPLACE TRIGGER track_not_truncated BEFORE TRUNCATE ON track
    FOR EACH STATEMENT EXECUTE FUNCTION _refuse_truncate();
