-- CREATE OR REPLACE cannot change a routine's name, parameters or results, and views of users may depend on the old
-- routine. So the routines of earlier releases that are listed here are renamed; 95_retired.sql drops them once all
-- views use the new ones.

DO $$
DECLARE
    -- Name, parameters and columns of the result, e.g. 'conflicts_of(p_scene, p_key, a_key, b_key)'.
    c_retired CONSTANT text[] := '{}';
    v_routine record;
BEGIN
    FOR v_routine IN
        SELECT p.oid::regprocedure AS header, p.proname FROM pg_catalog.pg_proc p
        WHERE p.pronamespace IN ('conflictdb'::regnamespace, 'conflictdb_internal'::regnamespace)
          AND format('%s(%s)', p.proname, array_to_string(p.proargnames, ', ')) = ANY (c_retired)
    LOOP
        EXECUTE format('ALTER FUNCTION %s RENAME TO %I', v_routine.header, '_retired_' || v_routine.proname);
    END LOOP;
END
$$;
