-- Who may do what. Nothing is granted to PUBLIC; each role can do what the one before it can (05_roles.sql).

REVOKE ALL ON SCHEMA conflictdb FROM PUBLIC;
REVOKE ALL ON ALL TABLES IN SCHEMA conflictdb FROM PUBLIC;
REVOKE ALL ON ALL SEQUENCES IN SCHEMA conflictdb FROM PUBLIC;
REVOKE ALL ON ALL ROUTINES IN SCHEMA conflictdb FROM PUBLIC;

-- Readers see everything. Query functions run as their caller, so that the planner can look into them; what they read
-- must be readable.
GRANT USAGE ON SCHEMA conflictdb TO conflictdb_reader;
GRANT SELECT ON ALL TABLES IN SCHEMA conflictdb TO conflictdb_reader;
GRANT EXECUTE ON ALL ROUTINES IN SCHEMA conflictdb TO conflictdb_worker;
DO $$
DECLARE
    v_routine regprocedure;
BEGIN
    -- A function that does not write is a query; it comes with the helpers it calls.
    FOR v_routine IN
        SELECT p.oid FROM pg_catalog.pg_proc p
        WHERE p.pronamespace = 'conflictdb'::regnamespace AND p.provolatile <> 'v' LOOP
        EXECUTE format('GRANT EXECUTE ON FUNCTION %s TO conflictdb_reader', v_routine);
    END LOOP;
    -- Who may execute what triggers call may make triggers of it on tables of his own, and have it act as its owner on
    -- rows that he made up. Triggers of the tables here ask for no such right. Those of attached tables do: their
    -- owners make them (41_attached_changes.sql).
    FOR v_routine IN
        SELECT p.oid FROM pg_catalog.pg_proc p
        WHERE p.pronamespace = 'conflictdb'::regnamespace AND p.prorettype = 'trigger'::regtype
              AND p.proname !~ '^_note_[0-9]+$' LOOP
        EXECUTE format('REVOKE ALL ON FUNCTION %s FROM conflictdb_worker', v_routine);
    END LOOP;
END
$$;

-- Waiting sees what others commit meanwhile, and who works on a scene changes too, so these are no queries; they write
-- nothing all the same. The view `queue` calls the second.
GRANT EXECUTE ON FUNCTION wait_until_current, _scene_holders TO conflictdb_reader;

-- Who reads may ask; what somebody asked, nobody else but the workers sees (79_probes.sql).
GRANT EXECUTE ON FUNCTION request_probe, request_track_probe, wait_for_probe, _prune_probes, _notify, _wake_workers
    TO conflictdb_reader;

-- The types of PostGIS have names too, in whatever schema it lives. Who may not grant them is told by
-- conflictdb.db.schema.missing_grants. In the script of an extension a grant would make all grants on that schema those
-- of the extension, which dumps leave out: there it is said instead.
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

-- Editors change the input. Marks and keys are kept by triggers that run as their owner.
GRANT DELETE ON scene, area, track, attachment, attached_change, attached_object, scene_share TO conflictdb_editor;
GRANT USAGE ON SEQUENCE version_seq TO conflictdb_editor;
-- Column by column: only the database gives numbers and versions. An id ahead of its sequence would block the rows of
-- others, and a first_version would claim the conflicts of a removed object.
DO $$
DECLARE
    v_table regclass;
    v_role text;
    v_columns text;
BEGIN
    FOR v_table, v_role IN
        SELECT t.name::regclass, t.role
        FROM (VALUES ('scene', 'editor'), ('area', 'editor'), ('track', 'editor'), ('attachment', 'editor'),
                     ('attached_change', 'editor'), ('attached_object', 'editor'), ('scene_share', 'editor'),
                     ('probe_request', 'reader')) t (name, role) LOOP
        SELECT string_agg(quote_ident(a.attname), ', ' ORDER BY a.attnum) INTO v_columns
            FROM pg_catalog.pg_attribute a
            WHERE a.attrelid = v_table AND a.attnum > 0 AND NOT a.attisdropped AND a.attidentity = ''
                  AND NOT (v_table IN ('area'::regclass, 'track'::regclass)
                           AND a.attname IN ('version', 'first_version'));
        EXECUTE format('REVOKE INSERT, UPDATE ON %s FROM conflictdb_%s', v_table, v_role);
        EXECUTE format('GRANT INSERT (%s) ON %s TO conflictdb_%s', v_columns, v_table, v_role);
        IF v_role = 'editor' THEN
            EXECUTE format('GRANT UPDATE (%s) ON %s TO conflictdb_editor', v_columns, v_table);
        END IF;
    END LOOP;
END
$$;
GRANT EXECUTE ON FUNCTION create_scene, put_area, put_track, remove_object, request_detection, _set_scene,
                          _ensure_centre, _first_version, _begin_load, _load, _mark_all, share_scene, unshare_scene,
                          give_scene
    TO conflictdb_editor;
-- What they mark is detected again, which does no harm: nothing depends on the version of a mark.
GRANT INSERT (scene_id, object_kind, object_id, version) ON change TO conflictdb_editor;
REVOKE EXECUTE ON FUNCTION protect_scenes FROM conflictdb_worker;
-- Attaching a table, and taking its rows over. Who writes to the table needs nothing of this.
GRANT EXECUTE ON FUNCTION attach, detach, preview_attachment, _register_attachment, _open_attached_schema,
                          _close_attached_schema, _map_expression, _create_attached_rows,
                          _create_attached_triggers, _create_note, _hold_attached, _attached_rows,
                          _attachment_failed, _begin_attached, _staged_tracks, _put_attached, _put_attached_by_halves,
                          _take_over_attached, _follow_attachment, follow_attached
    TO conflictdb_editor;
GRANT SELECT ON SEQUENCE attachment_attachment_id_seq TO conflictdb_editor;

-- Editors acknowledge, each in their own name and at the time it is.
GRANT INSERT (scene_id, conflict_id, reason, until, a_key, b_key, periods, verdict, time_error_s, closest_m,
              closest_error_m),
      UPDATE (ended_by, ended_at) ON acknowledgement TO conflictdb_editor;
GRANT EXECUTE ON FUNCTION acknowledge, unacknowledge, _end_acknowledgement, _notify_acknowledgement
    TO conflictdb_editor;

-- Workers keep the derived tables.
GRANT INSERT, UPDATE, DELETE ON piece, conflict, change, run, history, probe_request, probe_reply
    TO conflictdb_worker;
GRANT INSERT, DELETE ON conflict_event TO conflictdb_worker;
GRANT DELETE ON acknowledgement TO conflictdb_worker;
GRANT USAGE ON SEQUENCE conflict_seq, conflict_event_conflict_event_id_seq TO conflictdb_worker;
-- Who may update a row may lock it: nobody else can keep a scene from being detected.
GRANT INSERT, UPDATE ON scene_lock TO conflictdb_worker;
