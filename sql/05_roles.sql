-- Roles, shared by all databases of a server; 90_grants.sql grants their privileges.
-- Concurrent upgrades of two databases may both create a role; the second one finds it and goes on.

DO $$
DECLARE
    v_role text;
BEGIN
    FOREACH v_role IN ARRAY ARRAY['conflictdb_reader', 'conflictdb_tracker', 'conflictdb_editor',
                                  'conflictdb_worker'] LOOP
        IF NOT EXISTS (SELECT FROM pg_catalog.pg_roles WHERE rolname = v_role) THEN
            BEGIN
                EXECUTE format('CREATE ROLE %I NOLOGIN', v_role);
            EXCEPTION
                WHEN duplicate_object OR unique_violation THEN NULL;
                WHEN insufficient_privilege THEN
                    RAISE EXCEPTION 'role % is missing and % may not create it', v_role, current_user
                        USING ERRCODE = 'insufficient_privilege',
                              HINT = 'Let an administrator run: CREATE ROLE conflictdb_reader; '
                                     'CREATE ROLE conflictdb_tracker; '
                                     'CREATE ROLE conflictdb_editor IN ROLE conflictdb_reader, conflictdb_tracker; '
                                     'CREATE ROLE conflictdb_worker IN ROLE conflictdb_editor;';
            END;
        END IF;
    END LOOP;
    -- Each role includes the privileges of the previous one; an editor is a tracker, too.
    BEGIN
        IF NOT pg_has_role('conflictdb_editor', 'conflictdb_tracker', 'MEMBER') THEN
            GRANT conflictdb_tracker TO conflictdb_editor;
        END IF;
        IF NOT pg_has_role('conflictdb_editor', 'conflictdb_reader', 'MEMBER') THEN
            GRANT conflictdb_reader TO conflictdb_editor;
        END IF;
        IF NOT pg_has_role('conflictdb_worker', 'conflictdb_editor', 'MEMBER') THEN
            GRANT conflictdb_editor TO conflictdb_worker;
        END IF;
    EXCEPTION
        WHEN unique_violation THEN NULL;
    END;
END
$$;
