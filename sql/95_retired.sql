-- Drops the routines renamed in 06_retired.sql, as nothing uses them any more.

DO $$
DECLARE
    v_routines text := (SELECT string_agg(p.oid::regprocedure::text, ', ') FROM pg_catalog.pg_proc p
                        WHERE p.pronamespace IN ('conflictdb'::regnamespace, 'conflictdb_internal'::regnamespace)
                              AND starts_with(p.proname, '_retired_'));
BEGIN
    IF v_routines IS NOT NULL THEN
        EXECUTE 'DROP ROUTINE ' || v_routines;
    END IF;
END
$$;
