"""Describes a schema from the catalog, for docs/reference/schema.sql: all that must not depend on how it came about."""

from typing import Any

import psycopg

HEADER = """\
-- The schema conflictdb as a fresh install makes it, described from the catalog. Generated: do not edit.
-- CONFLICTDB_UPDATE_SNAPSHOT=1 ./run test tests/migration writes it anew.
"""

PRIVILEGES_HEADER = """\
What each role may do with each relation and function: conflictdb_reader, _editor, _worker; PUBLIC may nothing.
Generated: CONFLICTDB_UPDATE_SNAPSHOT=1 ./run test tests/migration writes it anew; a change of it is reviewed.
"""
# Turns a database into one of earlier programs: private routines and views in the schema of the public ones.
TOGETHER = """
DO $$
DECLARE
    v_one record;
BEGIN
    FOR v_one IN SELECT 'ROUTINE' AS kind, oid::regprocedure::text AS name FROM pg_proc
                 WHERE pronamespace = 'conflictdb_internal'::regnamespace
                 UNION ALL
                 SELECT 'VIEW', oid::regclass::text FROM pg_class
                 WHERE relnamespace = 'conflictdb_internal'::regnamespace AND relkind = 'v' LOOP
        EXECUTE format('ALTER %s %s SET SCHEMA conflictdb', v_one.kind, v_one.name);
    END LOOP;
END
$$;
COMMENT ON TABLE conflictdb.alembic_version IS 'Routines: SHA-256 0';
"""
RELATIONS = """
SELECT CASE c.relkind WHEN 'v' THEN 'VIEW' WHEN 'S' THEN 'SEQUENCE' ELSE 'TABLE' END || ' ' || c.relname
       || coalesce((
            SELECT E' (\n' || string_agg(format('    %s %s%s%s%s', a.attname, format_type(a.atttypid, a.atttypmod),
                       CASE WHEN a.attcollation <> t.typcollation THEN ' COLLATE ' || l.collname ELSE '' END,
                       CASE WHEN a.attnotnull THEN ' NOT NULL' ELSE '' END,
                       CASE WHEN a.attidentity <> '' THEN ' GENERATED ALWAYS AS IDENTITY'
                            ELSE coalesce(' DEFAULT ' || pg_get_expr(d.adbin, d.adrelid), '') END),
                       E',\n' ORDER BY a.attnum) || E'\n)'
            FROM pg_attribute a JOIN pg_type t ON t.oid = a.atttypid
            LEFT JOIN pg_collation l ON l.oid = a.attcollation
            LEFT JOIN pg_attrdef d ON d.adrelid = a.attrelid AND d.adnum = a.attnum
            WHERE a.attrelid = c.oid AND a.attnum > 0 AND NOT a.attisdropped AND c.relkind <> 'S'), '')
FROM pg_class c
WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND c.relkind IN ('r', 'p', 'v', 'S')
ORDER BY c.relkind, c.relname
"""
CONSTRAINTS = """
SELECT format('CONSTRAINT %s ON %s: %s', n.conname, n.conrelid::regclass, pg_get_constraintdef(n.oid))
FROM pg_constraint n WHERE n.connamespace = 'conflictdb'::regnamespace AND n.contype <> 'n'
ORDER BY n.conrelid::regclass::text, n.conname
"""
INDEXES = """
SELECT i.indexdef FROM pg_indexes i WHERE i.schemaname = 'conflictdb'
    AND NOT EXISTS (SELECT FROM pg_constraint n WHERE n.conname = i.indexname)
ORDER BY i.indexname
"""
TRIGGERS = """
SELECT pg_get_triggerdef(t.oid) || CASE t.tgenabled WHEN 'A' THEN ' -- always' WHEN 'R' THEN ' -- replicas' ELSE '' END
FROM pg_trigger t JOIN pg_class c ON c.oid = t.tgrelid
WHERE c.relnamespace = 'conflictdb'::regnamespace AND NOT t.tgisinternal ORDER BY c.relname, t.tgname
"""
ROUTINES = """
SELECT format(E'FUNCTION %s(%s)\n    RETURNS %s LANGUAGE %s %s%s PARALLEL %s%s%s', p.proname,
              pg_get_function_arguments(p.oid), pg_get_function_result(p.oid), l.lanname,
              CASE p.provolatile WHEN 'i' THEN 'IMMUTABLE' WHEN 's' THEN 'STABLE' ELSE 'VOLATILE' END,
              CASE WHEN p.proisstrict THEN ' STRICT' ELSE '' END,
              CASE p.proparallel WHEN 's' THEN 'SAFE' WHEN 'r' THEN 'RESTRICTED' ELSE 'UNSAFE' END,
              CASE WHEN p.prosecdef THEN ' SECURITY DEFINER' ELSE '' END,
              coalesce(' SET ' || array_to_string(p.proconfig, ' SET '), ''))
FROM pg_proc p JOIN pg_language l ON l.oid = p.prolang
WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
ORDER BY p.proname, pg_get_function_arguments(p.oid)
"""
GRANTS = """
SELECT format('GRANT %s ON %s TO %s', string_agg(x.privilege_type, ', ' ORDER BY x.privilege_type), o.what,
              x.grantee::regrole)
FROM (
    SELECT 'SCHEMA ' || n.nspname AS what, n.nspacl AS acl, n.nspowner AS owner FROM pg_namespace n
    WHERE n.nspname IN ('conflictdb', 'conflictdb_internal')
    UNION ALL
    SELECT c.relname, c.relacl, c.relowner FROM pg_class c
    WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
    UNION ALL
    SELECT p.oid::regprocedure::text, p.proacl, p.proowner FROM pg_proc p
    WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
) o, LATERAL aclexplode(o.acl) x
WHERE x.grantee <> o.owner
GROUP BY o.what, x.grantee ORDER BY o.what, x.grantee::regrole::text
"""
# A role's rights include those of the roles that it is a member of; rights of the owner only are left out.
PRIVILEGES = """
WITH role (name, place) AS (VALUES ('reader', 1), ('tracker', 2), ('editor', 3), ('worker', 4)),
thing AS (
    SELECT CASE c.relkind WHEN 'v' THEN 'VIEW ' WHEN 'S' THEN 'SEQUENCE ' ELSE 'TABLE ' END || c.relname AS what,
           r.place, r.name, (
               SELECT string_agg(x.privilege, ', ' ORDER BY x.privilege)
               FROM unnest(CASE c.relkind WHEN 'S' THEN '{SELECT,UPDATE,USAGE}'::text[]
                           ELSE '{SELECT,INSERT,UPDATE,DELETE,TRUNCATE,REFERENCES,TRIGGER}' END) x (privilege)
               WHERE CASE c.relkind WHEN 'S' THEN has_sequence_privilege('conflictdb_' || r.name, c.oid, x.privilege)
                     ELSE has_table_privilege('conflictdb_' || r.name, c.oid, x.privilege) END) AS may
    FROM pg_class c CROSS JOIN role r
    WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
      AND c.relkind IN ('r', 'p', 'v', 'S')
    UNION ALL
    SELECT 'FUNCTION ' || p.oid::regprocedure::text || CASE WHEN p.prosecdef THEN ' as its owner' ELSE '' END,
           r.place, r.name,
           CASE WHEN has_function_privilege('conflictdb_' || r.name, p.oid, 'EXECUTE') THEN 'EXECUTE' END
    FROM pg_proc p CROSS JOIN role r WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
)
SELECT format('%s: %s', t.what, coalesce(string_agg(format('%s %s', t.name, t.may), '; ' ORDER BY t.place)
                                         FILTER (WHERE t.may IS NOT NULL), 'none'))
FROM thing t GROUP BY t.what ORDER BY t.what COLLATE "C"
"""
BODIES = """
SELECT p.oid::regprocedure::text || md5(pg_get_functiondef(p.oid)) FROM pg_proc p
WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
UNION ALL SELECT c.relname || md5(pg_get_viewdef(c.oid)) FROM pg_class c
WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND c.relkind = 'v'
UNION ALL SELECT coalesce(c.relname, p.proname, '') || d.objsubid || d.description
FROM pg_description d
LEFT JOIN pg_class c ON d.classoid = 'pg_class'::regclass AND c.oid = d.objoid
LEFT JOIN pg_proc p ON d.classoid = 'pg_proc'::regclass AND p.oid = d.objoid
WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
   OR p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
ORDER BY 1
"""


def describe(conn: psycopg.Connection[Any]) -> str:
    """Return the description in docs/reference/schema.sql: everything except the bodies of routines."""
    conn.execute("SET LOCAL search_path = conflictdb, conflictdb_internal, public")
    parts = []
    for query, gap in ((RELATIONS, "\n\n"), (CONSTRAINTS, "\n"), (INDEXES, "\n"), (TRIGGERS, "\n"), (ROUTINES, "\n\n")):
        parts.append(gap.join(f"{row[0]};" for row in conn.execute(query.encode())))
    return HEADER + "\n" + "\n\n".join(parts) + "\n"


def privileges(conn: psycopg.Connection[Any]) -> str:
    """Return the text of docs/reference/privileges.txt: rights of each role on each relation and function."""
    conn.execute("SET LOCAL search_path = conflictdb, conflictdb_internal, public")
    rows = [row[0] for row in conn.execute(PRIVILEGES.encode())]
    return PRIVILEGES_HEADER + "\n".join([*rows, ""])


def details(conn: psycopg.Connection[Any]) -> list[str]:
    """Return parts that the description omits: grants, bodies of routines and views, comments."""
    conn.execute("SET LOCAL search_path = conflictdb, conflictdb_internal, public")
    return [row[0] for query in (GRANTS, BODIES) for row in conn.execute(query.encode())]
