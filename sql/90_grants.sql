-- Privileges. Nothing is granted to PUBLIC; each role includes the previous one (05_roles.sql).

REVOKE ALL ON SCHEMA conflictdb, conflictdb_internal FROM PUBLIC;
REVOKE ALL ON ALL TABLES IN SCHEMA conflictdb, conflictdb_internal FROM PUBLIC;
REVOKE ALL ON ALL SEQUENCES IN SCHEMA conflictdb FROM PUBLIC;
REVOKE ALL ON ALL ROUTINES IN SCHEMA conflictdb, conflictdb_internal FROM PUBLIC;

-- Readers see everything. Query functions run as their caller, so that they can be inlined; so the tables must be
-- readable, and the private routines that they call callable.
GRANT USAGE ON SCHEMA conflictdb, conflictdb_internal TO conflictdb_reader;
GRANT SELECT ON ALL TABLES IN SCHEMA conflictdb, conflictdb_internal TO conflictdb_reader;
GRANT EXECUTE ON ALL ROUTINES IN SCHEMA conflictdb, conflictdb_internal TO conflictdb_worker;
DO $$
DECLARE
    v_routine regprocedure;
BEGIN
    -- Functions that do not write are queries or their helpers.
    FOR v_routine IN
        SELECT p.oid FROM pg_catalog.pg_proc p
        WHERE p.pronamespace IN ('conflictdb'::regnamespace, 'conflictdb_internal'::regnamespace)
              AND p.provolatile <> 'v' LOOP
        EXECUTE format('GRANT EXECUTE ON FUNCTION %s TO conflictdb_reader', v_routine);
    END LOOP;
    -- EXECUTE on a trigger function would let a role use it on its own tables, and make it act as its owner on
    -- arbitrary rows. Triggers of our tables do not need it. Those of attached tables do: their owners create them
    -- (41_attached_changes.sql).
    FOR v_routine IN
        SELECT p.oid FROM pg_catalog.pg_proc p
        WHERE p.pronamespace = 'conflictdb_internal'::regnamespace AND p.prorettype = 'trigger'::regtype
              AND p.proname !~ '^_note_[0-9]+$' LOOP
        EXECUTE format('REVOKE ALL ON FUNCTION %s FROM conflictdb_worker', v_routine);
    END LOOP;
END
$$;

-- These are VOLATILE because they see what other sessions change meanwhile, but they write nothing. The view `queue`
-- calls _scene_holders.
GRANT EXECUTE ON FUNCTION wait_until_current, _scene_holders TO conflictdb_reader;

-- Readers may ask workers; only the asking role and workers see what (79_requests.sql).
GRANT EXECUTE ON FUNCTION request_probe, request_track_probe, request_plans_probe, wait_for_probe,
    wait_for_plans_probe, request_delays, wait_for_delays, _request, _request_probe, _wait_for_probe, _await_answer,
    _end_of_wait, _prune_probes, _notify, _wake_workers TO conflictdb_reader;

-- A restore into a server without the roles loses this grant of 42_attach.sql.
DO $$
BEGIN
    IF EXISTS (SELECT FROM pg_catalog.pg_namespace n
               WHERE n.nspname = 'conflictdb_attached' AND n.nspowner = current_user::regrole) THEN
        GRANT USAGE, CREATE ON SCHEMA conflictdb_attached TO conflictdb_editor;
    END IF;
END
$$;

-- Roles also need the schema of PostGIS. If the installing role may not grant it, conflictdb.jobs.schema.missing_grants
-- reports that. In an extension script the grant would make all grants on that schema part of the extension, which
-- dumps omit; so there is only a warning.
DO $$
DECLARE
    v_schema regnamespace := (SELECT e.extnamespace FROM pg_catalog.pg_extension e WHERE e.extname = 'postgis');
BEGIN
    IF has_schema_privilege('conflictdb_reader', v_schema, 'USAGE') THEN
        NULL;
    ELSIF current_setting('conflictdb.is_extension', true) = 'on' THEN
        RAISE WARNING 'the roles of conflictdb cannot use PostGIS yet'
            USING HINT = format('Run: GRANT USAGE ON SCHEMA %s TO conflictdb_reader', v_schema);
    ELSE
        BEGIN
            EXECUTE format('GRANT USAGE ON SCHEMA %s TO conflictdb_reader', v_schema);
        EXCEPTION
            WHEN insufficient_privilege THEN NULL;
        END;
    END IF;
END
$$;

-- Editors change the input. Triggers that run as their owner maintain marks and keys.
GRANT DELETE ON scene, area, track, rule, attachment, attached_relation, attached_change, attached_object, scene_share
    TO conflictdb_editor;
GRANT USAGE ON SEQUENCE version_seq TO conflictdb_editor;
-- By column, without ids and versions: an id ahead of its sequence would block rows of others, and first_version would
-- claim the conflicts of a removed object.
DO $$
DECLARE
    v_table regclass;
    v_role text;
    v_columns text;
BEGIN
    FOR v_table, v_role IN
        SELECT t.name::regclass, t.role
        FROM (VALUES ('scene', 'editor'), ('area', 'editor'), ('track', 'editor'), ('rule', 'editor'),
                     ('attachment', 'editor'), ('attached_relation', 'editor'),
                     ('attached_change', 'editor'), ('attached_object', 'editor'), ('scene_share', 'editor'),
                     ('probe_request', 'reader')) t (name, role) LOOP
        SELECT string_agg(quote_ident(a.attname), ', ' ORDER BY a.attnum) INTO v_columns
            FROM pg_catalog.pg_attribute a
            WHERE a.attrelid = v_table AND a.attnum > 0 AND NOT a.attisdropped AND a.attidentity = ''
                  AND NOT (v_table IN ('area'::regclass, 'track'::regclass)
                           AND a.attname IN ('version', 'first_version'))
                  -- Whoever expands schedules says how far.
                  AND NOT (v_table = 'scene'::regclass AND a.attname = 'expanded');
        EXECUTE format('REVOKE INSERT, UPDATE ON %s FROM conflictdb_%s', v_table, v_role);
        EXECUTE format('GRANT INSERT (%s) ON %s TO conflictdb_%s', v_columns, v_table, v_role);
        IF v_role = 'editor' THEN
            EXECUTE format('GRANT UPDATE (%s) ON %s TO conflictdb_editor', v_columns, v_table);
        END IF;
    END LOOP;
END
$$;
GRANT EXECUTE ON FUNCTION create_scene, put_area, put_track, put_rule, remove_rule, _put_rules, _set_columns,
                          remove_object, request_detection, _set_scene, _put_scene,
                          _ensure_centre, _check_area_shape, _check_track_shape, _first_version, _begin_load,
                          _load, _add_staged, _mark_all, share_scene,
                          unshare_scene, give_scene, rename_scene, copy_scene, remove_scene, rename_object,
                          create_branch, drop_branch, merge_branch, _free_orphan_name, _before_scene_name,
                          _begin_admission, _admission_holders, _put_plans, admit, wait_for_admission
    TO conflictdb_editor;
-- Row-level security limits these to scenes that the role may change; a trigger fills in the versions.
GRANT INSERT (scene_id, key) ON branch_edit TO conflictdb_editor;
REVOKE UPDATE ON admission_lock FROM conflictdb_editor;
GRANT INSERT, UPDATE (taken) ON admission_lock TO conflictdb_editor;
-- A superfluous mark only causes another detection.
GRANT INSERT (scene_id, object_kind, object_id, version) ON change TO conflictdb_editor;
REVOKE EXECUTE ON FUNCTION protect_scenes, set_limit, prune_edits FROM conflictdb_worker;
-- Readers may not see all edits, and would report them as missing.
REVOKE EXECUTE ON FUNCTION verify_edits FROM conflictdb_reader;
-- Attaching tables and taking their rows over. Writers of the tables need none of this.
GRANT EXECUTE ON FUNCTION attach, reattach, detach, preview_attachment, preview_reattachment, _preview,
                          _register_attachment, _check_attachment, _hold_attachment, _change_attachment,
                          _open_attached_schema, _free_attached_name,
                          _close_attached_schema, _map_expression, _create_attached_rows,
                          _watch_attached, _create_note, _hold_attached, _attached_rows,
                          _attachment_failed, _begin_attached, _staged_tracks, _put_attached, _put_attached_by_halves,
                          _take_over_attached, _rewatch_attached, _stage_attached, _follow_attachment, follow_attached
    TO conflictdb_editor;
GRANT SELECT ON SEQUENCE attachment_attachment_id_seq TO conflictdb_editor;

-- Editors acknowledge in their own name, at the current time, and a conflict as it is known.
REVOKE INSERT, UPDATE ON acknowledgement FROM conflictdb_editor;
GRANT INSERT (scene_id, conflict_id, reason, until, a_key, b_key, given_name), UPDATE (ended_at)
    ON acknowledgement TO conflictdb_editor;
GRANT UPDATE (acknowledged_by, acknowledged_at, acknowledged_for) ON live_conflict TO conflictdb_editor;
GRANT EXECUTE ON FUNCTION acknowledge, unacknowledge, _acknowledge_alarm, _end_acknowledgement, _notify_acknowledgement
    TO conflictdb_editor;

-- Proposals, in their own name.
REVOKE UPDATE ON proposal FROM conflictdb_editor;
GRANT INSERT (scene_id, goal, objective_s, bound_s, is_least, settings, last_version, objects_hash),
      UPDATE (applied_at, undone_at) ON proposal TO conflictdb_editor;
GRANT INSERT, UPDATE (version_after) ON proposal_move TO conflictdb_editor;
GRANT INSERT ON proposal_left TO conflictdb_editor;
GRANT EXECUTE ON FUNCTION apply_proposal, undo_proposal, _put_proposal, _hold_proposal, _move_attached,
                          _check_attached_rows
    TO conflictdb_editor;

-- Feeds insert positions, and do nothing else; policies read which scenes they may write.
GRANT USAGE ON SCHEMA conflictdb, conflictdb_internal TO conflictdb_tracker;
GRANT INSERT (scene, key, instant, place, height_m, error_m) ON position TO conflictdb_tracker;
GRANT SELECT ON _accessible TO conflictdb_tracker;
GRANT EXECUTE ON FUNCTION _writable_scenes, _insert_positions TO conflictdb_tracker;
GRANT TRUNCATE ON position_0, position_1, position_2, position_3, position_4, position_5, position_6, position_7
    TO conflictdb_worker;
GRANT INSERT, UPDATE, DELETE ON live_state, live_conflict TO conflictdb_worker;
GRANT INSERT, DELETE ON live_event TO conflictdb_worker;
GRANT INSERT, UPDATE ON position_look TO conflictdb_worker;
GRANT UPDATE (transaction_id) ON position TO conflictdb_worker;

-- Workers write the derived tables.
GRANT INSERT, UPDATE, DELETE ON piece, conflict, difference, change, run, history, probe_request, probe_reply,
                                worker_stamp
    TO conflictdb_worker;
GRANT INSERT, DELETE ON conflict_event TO conflictdb_worker;
GRANT UPDATE (expanded) ON scene TO conflictdb_worker;
-- Schedules of a parent that are expanded again are no edits of it.
GRANT UPDATE (version) ON branch_edit TO conflictdb_worker;
GRANT INSERT, DELETE ON acknowledgement TO conflictdb_worker;
GRANT DELETE ON proposal TO conflictdb_worker;
GRANT USAGE ON SEQUENCE conflict_seq, conflict_event_conflict_event_id_seq TO conflictdb_worker;
-- Updating a row includes locking it: only workers can block the detection of a scene.
GRANT INSERT, UPDATE ON scene_lock TO conflictdb_worker;
