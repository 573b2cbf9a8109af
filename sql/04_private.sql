-- Private routines and views are in the schema conflictdb_internal: \df conflictdb.* lists the public ones. Their names
-- begin with an underscore, so none is also the name of a public one, which the same search path finds. Earlier
-- programs created them in conflictdb. They are moved, because triggers, policies and views of users depend on them.

DO $$
DECLARE
    v_one record;
BEGIN
    FOR v_one IN
        SELECT 'ROUTINE' AS kind, p.oid::regprocedure::text AS name FROM pg_catalog.pg_proc p
        WHERE p.pronamespace = 'conflictdb'::regnamespace AND starts_with(p.proname, '_')
        UNION ALL
        SELECT 'VIEW', c.oid::regclass::text FROM pg_catalog.pg_class c
        WHERE c.relnamespace = 'conflictdb'::regnamespace AND starts_with(c.relname, '_') AND c.relkind = 'v'
    LOOP
        EXECUTE format('ALTER %s %s SET SCHEMA conflictdb_internal', v_one.kind, v_one.name);
    END LOOP;
END
$$;
