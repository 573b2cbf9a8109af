"""Create, upgrade and check the schema `conflictdb` of a database.

`migrations/` has the history of the structure (alembic), `sql/` the current routines. An upgrade is one transaction
under a lock: it runs the missing revisions and then, at head, all of `sql/`.
"""

import hashlib
import io
import logging
import re
import threading
import time
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, LiteralString

import psycopg
from psycopg import conninfo, sql
from psycopg.rows import tuple_row

from conflictdb import store
from conflictdb.errors import LockTimeout, SchemaMissing, SchemaOutdated, SchemaTooNew, ServerError

if TYPE_CHECKING:
    import alembic.config

_log = logging.getLogger(__name__)

SCHEMA: Final = "conflictdb"
PRIVATE_SCHEMA: Final = "conflictdb_internal"  # routines and views that only this package calls
MIN_SERVER_VERSION: Final = 150000  # views with security_invoker
MIN_POSTGIS_VERSION: Final = (3, 3)

# Key of the advisory lock that serialises upgrades of one database: "conflict" in ASCII.
_UPGRADE_LOCK: Final = int.from_bytes(b"conflict")
# Any session can hold that lock, and readers lock tables. An upgrade reports the holders after _SAY_AFTER_S and gives
# up after _UPGRADE_WAIT_S.
_UPGRADE_WAIT_S: Final = 300.0
_SAY_AFTER_S: Final = 5.0
_LOOK_EVERY_S: Final = 0.1
# Alembic keeps its state in global variables, so one thread at a time. Other processes wait for the database's lock.
_ALEMBIC: Final = threading.Lock()
# Revisions made before the first release were squashed into 0001. FORMER was the last of them: its structure is that of
# 0001, and it is upgraded. Databases at an earlier one are not.
FORMER: Final = "0028"
RESTAMP: Final = f"UPDATE conflictdb.alembic_version SET version_num = '0001' WHERE version_num = '{FORMER}';\n"  # noqa: S608
_FROM_BEFORE_RELEASE: Final = (
    "export its scenes with the program that made it, run DROP SCHEMA conflictdb CASCADE (of the extension: DROP "
    "EXTENSION conflictdb), then `conflictdb admin init`, and load them"
)
# A hash of the rights of our roles and of everybody, and of the policies. A restore into a server without the roles
# loses them, and the comment that holds the hash stays.
_RIGHTS: Final = """
SELECT pg_catalog.md5(coalesce(pg_catalog.string_agg(r.line, E'\\n' ORDER BY r.line COLLATE "C"), ''))
FROM (
    WITH ours AS (
        SELECT n.oid FROM pg_catalog.pg_namespace n
        WHERE n.nspname IN ('conflictdb'::name, 'conflictdb_internal'::name)
    ), granted AS (
        SELECT n.nspname::text AS name, coalesce(n.nspacl, acldefault('n'::"char", n.nspowner)) AS acl
        FROM pg_catalog.pg_namespace n WHERE n.oid IN (SELECT o.oid FROM ours o)
        UNION ALL
        SELECT c.relname::text, coalesce(c.relacl, acldefault(CASE c.relkind WHEN 'S'::"char" THEN 's'::"char"
                                                              ELSE 'r'::"char" END, c.relowner))
        FROM pg_catalog.pg_class c
        WHERE c.relnamespace IN (SELECT o.oid FROM ours o)
          AND c.relkind::text IN ('r'::text, 'p'::text, 'v'::text, 'S'::text)
        UNION ALL
        SELECT pg_catalog.concat_ws('.'::text, c.relname, a.attname), a.attacl
        FROM pg_catalog.pg_attribute a JOIN pg_catalog.pg_class c ON c.oid = a.attrelid
        WHERE c.relnamespace IN (SELECT o.oid FROM ours o) AND a.attacl IS NOT NULL AND NOT a.attisdropped
        UNION ALL
        SELECT pg_catalog.concat_ws('/'::text, p.proname, p.pronargs), coalesce(p.proacl,
               acldefault('f'::"char", p.proowner))
        FROM pg_catalog.pg_proc p
        WHERE p.pronamespace IN (SELECT o.oid FROM ours o) AND p.proname::text !~ '^_note_[0-9]+$'::text
    )
    SELECT pg_catalog.concat_ws(' '::text, g.name, coalesce(m.rolname::text, 'public'::text), x.privilege_type) AS line
    FROM granted g CROSS JOIN LATERAL pg_catalog.aclexplode(g.acl) x
    LEFT JOIN pg_catalog.pg_roles m ON m.oid = x.grantee
    WHERE x.grantee = 0::oid
       OR m.rolname IN ('conflictdb_reader'::name, 'conflictdb_tracker'::name, 'conflictdb_editor'::name,
                     'conflictdb_worker'::name)
    UNION ALL
    SELECT pg_catalog.concat_ws(' '::text, c.relname, p.polname, p.polcmd,
                                ARRAY(SELECT m.rolname FROM pg_catalog.pg_roles m WHERE m.oid = ANY (p.polroles)
                                      ORDER BY m.rolname)::text)
    FROM pg_catalog.pg_policy p JOIN pg_catalog.pg_class c ON c.oid = p.polrelid
    WHERE c.relnamespace IN (SELECT o.oid FROM ours o)
) r"""
# Whether the roles are all there, each with the rights of the former, and a policy for each: a restore loses those of
# any role that is missing, and roles made by hand may lack the others' rights.
_ROLES_ARE_WHOLE: Final = """
SELECT has_schema_privilege(r.oid, 'conflictdb', 'USAGE')
       AND pg_has_role(e.oid, r.oid, 'MEMBER') AND pg_has_role(w.oid, e.oid, 'MEMBER')
       AND NOT EXISTS (SELECT FROM pg_catalog.pg_roles m
                       WHERE m.oid IN (r.oid, e.oid, w.oid)
                         AND NOT EXISTS (SELECT FROM pg_catalog.pg_policy p
                                         WHERE p.polrelid = 'conflictdb.scene'::regclass::oid
                                           AND m.oid = ANY (p.polroles)))
       AND EXISTS (SELECT FROM pg_catalog.pg_roles f
                   WHERE f.rolname = 'conflictdb_tracker'::name AND pg_has_role(e.oid, f.oid, 'MEMBER')
                     AND has_any_column_privilege(f.oid, 'conflictdb.position', 'INSERT'))
FROM pg_catalog.pg_roles r CROSS JOIN pg_catalog.pg_roles e CROSS JOIN pg_catalog.pg_roles w
WHERE r.rolname = 'conflictdb_reader'::name AND e.rolname = 'conflictdb_editor'::name
  AND w.rolname = 'conflictdb_worker'::name"""
# Takes private routines out of the extension, so that they can be dropped.
_RELEASE: Final = """
DO $$
DECLARE
    v_routine regprocedure;
BEGIN
    FOR v_routine IN
        SELECT p.oid FROM pg_catalog.pg_proc p
        JOIN pg_catalog.pg_depend d ON d.classid = 'pg_proc'::regclass::oid AND d.objid = p.oid
        WHERE p.pronamespace IN ('conflictdb'::regnamespace::oid, 'conflictdb_internal'::regnamespace::oid)
            AND pg_catalog.starts_with(p.proname::text, '_') AND d.deptype = 'e'::"char" LOOP
        EXECUTE pg_catalog.format('ALTER EXTENSION conflictdb DROP ROUTINE %s', v_routine);
    END LOOP;
END
$$
"""
# Adds recreated routines to the extension, except the functions of single attached tables.
_ADOPT: Final = """
DO $$
DECLARE
    v_one record;
BEGIN
    FOR v_one IN
        SELECT i.type, i.identity
        FROM (SELECT 'pg_proc'::regclass::oid AS class, p.oid FROM pg_catalog.pg_proc p
              WHERE p.pronamespace IN ('conflictdb'::regnamespace::oid, 'conflictdb_internal'::regnamespace::oid)
                AND p.proname::text !~ '^_note_[0-9]+$'::text
              UNION ALL
              SELECT 'pg_class'::regclass::oid, c.oid FROM pg_catalog.pg_class c
              WHERE c.relnamespace IN ('conflictdb'::regnamespace::oid, 'conflictdb_internal'::regnamespace::oid)
                AND c.relkind = 'v'::"char") o
        CROSS JOIN LATERAL pg_catalog.pg_identify_object(o.class, o.oid, 0) i
        WHERE NOT EXISTS (SELECT FROM pg_catalog.pg_depend d
                          WHERE d.classid = o.class AND d.objid = o.oid AND d.deptype = 'e'::"char") LOOP
        EXECUTE pg_catalog.format('ALTER EXTENSION conflictdb ADD %s %s', v_one.type, v_one.identity);
    END LOOP;
END
$$
"""
# The owner of a schema, and roles with CREATE, can add functions, which our SECURITY DEFINER routines would call. Both
# sides of each operator have the same type, so that no operator of a user fits better.
REFUSE_FOREIGN_SCHEMA: Final = """
DO $refuse$
DECLARE
    v_schema record;
    v_found text;
    v_remedy text;
BEGIN
    FOR v_schema IN
        SELECT n.oid, n.nspname, n.nspacl, n.nspowner, r.rolname, r.rolsuper
        FROM pg_catalog.pg_namespace n JOIN pg_catalog.pg_roles r ON r.oid = n.nspowner
        WHERE n.nspname IN ('conflictdb'::name, 'conflictdb_internal'::name) ORDER BY n.nspname LOOP
        IF v_schema.rolname <> current_user::name AND NOT v_schema.rolsuper THEN
            v_found := pg_catalog.concat('belongs to role '::text, pg_catalog.quote_ident(v_schema.rolname::text));
            v_remedy := pg_catalog.concat('Connect as that role, or drop the schema or give it away: '::text,
                                          'ALTER SCHEMA '::text, v_schema.nspname, ' OWNER TO ...'::text);
        END IF;
        IF v_found IS NULL THEN
            SELECT pg_catalog.concat('lets '::text, pg_catalog.string_agg(
                       CASE x.grantee WHEN 0::pg_catalog.oid THEN 'PUBLIC'::text
                       ELSE pg_catalog.concat('role '::text, pg_catalog.quote_ident(r.rolname::text)) END, ', '::text),
                       ' create objects'::text)
                INTO v_found FROM pg_catalog.aclexplode(v_schema.nspacl) x LEFT JOIN pg_catalog.pg_roles r
                    ON r.oid = x.grantee
                WHERE x.privilege_type = 'CREATE'::text AND x.grantee <> v_schema.nspowner AND r.rolsuper IS NOT TRUE
                HAVING pg_catalog.bool_or(true);
            v_remedy := pg_catalog.concat('Drop it, or run: REVOKE CREATE ON SCHEMA '::text, v_schema.nspname,
                                          ' FROM ...'::text);
        END IF;
        IF v_found IS NULL THEN
            SELECT pg_catalog.concat('has an object of role '::text, pg_catalog.quote_ident(r.rolname::text),
                                     ': '::text, pg_catalog.pg_describe_object(o.classid, o.objid, 0))
                INTO v_found FROM pg_catalog.pg_depend o JOIN pg_catalog.pg_shdepend s
                    ON s.classid = o.classid AND s.objid = o.objid AND s.deptype = 'o'::"char"
                    JOIN pg_catalog.pg_database d ON d.oid = s.dbid AND d.datname = pg_catalog.current_database()
                    JOIN pg_catalog.pg_roles r ON r.oid = s.refobjid
                WHERE o.refobjid = v_schema.oid AND s.refobjid <> v_schema.nspowner
                      AND o.refclassid = 'pg_catalog.pg_namespace'::pg_catalog.regclass::pg_catalog.oid
                      AND NOT (r.rolsuper AND v_schema.rolsuper)
                ORDER BY o.classid, o.objid LIMIT 1;
            v_remedy := 'Drop the object, or give it to the owner of the schema: ALTER ... OWNER TO ...';
        END IF;
        IF v_found IS NULL AND pg_catalog.to_regclass('conflictdb.alembic_version'::text) IS NULL THEN
            SELECT pg_catalog.concat('has objects that are none of ours: '::text,
                                     pg_catalog.pg_describe_object(o.classid, o.objid, 0))
                INTO v_found FROM pg_catalog.pg_depend o
                WHERE o.refobjid = v_schema.oid
                      AND o.refclassid = 'pg_catalog.pg_namespace'::pg_catalog.regclass::pg_catalog.oid
                      -- CREATE EXTENSION puts the extension into the schema before it runs the script.
                      AND o.classid <> 'pg_catalog.pg_extension'::pg_catalog.regclass::pg_catalog.oid
                ORDER BY o.classid, o.objid LIMIT 1;
            v_remedy := 'Drop or rename the schema.';
        END IF;
        EXIT WHEN v_found IS NOT NULL;
    END LOOP;
    IF v_found IS NOT NULL THEN
        RAISE EXCEPTION 'database %: schema % % (must be created by %, and by nobody else)',
                        pg_catalog.quote_ident(pg_catalog.current_database()::text), v_schema.nspname, v_found,
                        pg_catalog.quote_ident(current_user::text)
            USING ERRCODE = 'duplicate_schema', HINT = v_remedy;
    END IF;
END
$refuse$;
"""
# Views and SQL functions stay bound to what their names meant when they were created. Each must be bound to objects of
# this schema, PostgreSQL or an extension: users may have created better fitting names in PostGIS's schema.
REFUSE_FOREIGN_NAMES: Final = """
DO $refuse$
DECLARE
    v_ours pg_catalog.oid[] := ARRAY['conflictdb'::pg_catalog.regnamespace::pg_catalog.oid,
                                     'conflictdb_internal'::pg_catalog.regnamespace::pg_catalog.oid];
    v_found text;
    v_user text;
BEGIN
    SELECT pg_catalog.pg_describe_object(d.refclassid, d.refobjid, 0),
           pg_catalog.pg_describe_object(d.classid, d.objid, 0)
        INTO v_found, v_user
        FROM pg_catalog.pg_depend d
        LEFT JOIN pg_catalog.pg_proc p
            ON d.refclassid = 'pg_catalog.pg_proc'::pg_catalog.regclass::pg_catalog.oid AND p.oid = d.refobjid
        LEFT JOIN pg_catalog.pg_operator o
            ON d.refclassid = 'pg_catalog.pg_operator'::pg_catalog.regclass::pg_catalog.oid AND o.oid = d.refobjid
        LEFT JOIN pg_catalog.pg_type t
            ON d.refclassid = 'pg_catalog.pg_type'::pg_catalog.regclass::pg_catalog.oid AND t.oid = d.refobjid
        LEFT JOIN pg_catalog.pg_proc f
            ON d.classid = 'pg_catalog.pg_proc'::pg_catalog.regclass::pg_catalog.oid AND f.oid = d.objid
        LEFT JOIN pg_catalog.pg_rewrite r
            ON d.classid = 'pg_catalog.pg_rewrite'::pg_catalog.regclass::pg_catalog.oid AND r.oid = d.objid
        LEFT JOIN pg_catalog.pg_constraint k
            ON d.classid = 'pg_catalog.pg_constraint'::pg_catalog.regclass::pg_catalog.oid AND k.oid = d.objid
        LEFT JOIN pg_catalog.pg_policy y
            ON d.classid = 'pg_catalog.pg_policy'::pg_catalog.regclass::pg_catalog.oid AND y.oid = d.objid
        LEFT JOIN pg_catalog.pg_attrdef a
            ON d.classid = 'pg_catalog.pg_attrdef'::pg_catalog.regclass::pg_catalog.oid AND a.oid = d.objid
        LEFT JOIN pg_catalog.pg_trigger g
            ON d.classid = 'pg_catalog.pg_trigger'::pg_catalog.regclass::pg_catalog.oid AND g.oid = d.objid
        LEFT JOIN pg_catalog.pg_class c
            ON c.oid = coalesce(r.ev_class, k.conrelid, y.polrelid, a.adrelid, g.tgrelid,
                                CASE WHEN d.classid = 'pg_catalog.pg_class'::pg_catalog.regclass::pg_catalog.oid
                                     THEN d.objid END)
        WHERE coalesce(f.pronamespace, c.relnamespace) = ANY (v_ours)
              AND coalesce(p.pronamespace, o.oprnamespace, t.typnamespace) <> ALL (v_ours)
              AND NOT EXISTS (SELECT FROM pg_catalog.pg_depend e
                              WHERE e.classid = d.refclassid AND e.objid = d.refobjid
                                    AND e.deptype IN ('e'::"char", 'i'::"char"))
              AND coalesce(p.pronamespace, o.oprnamespace, t.typnamespace)
                  NOT IN ('pg_catalog'::pg_catalog.regnamespace::pg_catalog.oid,
                          'pg_toast'::pg_catalog.regnamespace::pg_catalog.oid)
        ORDER BY d.classid, d.objid LIMIT 1;
    IF v_found IS NOT NULL THEN
        RAISE EXCEPTION 'database %: % is found in place of a name of PostgreSQL or PostGIS (by %)',
                        pg_catalog.quote_ident(pg_catalog.current_database()::text), v_found, v_user
            USING ERRCODE = 'duplicate_object',
                  HINT = 'Drop it, and see that nobody may create objects in that schema: REVOKE CREATE ON SCHEMA ...';
    END IF;
END
$refuse$;
"""
_PACKAGE: Final = Path(__file__).resolve().parents[1]


def routine_files() -> list[Path]:
    """Return the files of sql/ in the order they are applied."""
    return sorted(_folder("sql").glob("[0-9][0-9]_*.sql"))


def needs_no_postgis(file: Path) -> bool:
    """Return whether a file of sql/ creates no function, and so runs without PostGIS's schema on the path."""
    return "CREATE OR REPLACE FUNCTION" not in file.read_text(encoding="utf-8")


def routines_sha256() -> str:
    """Return the hash of all of sql/, names and contents."""
    digest = hashlib.sha256()
    for file in routine_files():
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def _triggers() -> int:
    """Return the number of triggers that sql/ creates."""
    code = "".join(file.read_text(encoding="utf-8") for file in routine_files())
    return len(re.findall(r"^CREATE (?:OR REPLACE|CONSTRAINT) TRIGGER (\w+)", code, re.MULTILINE))


@cache
def _expected(_sql: Path) -> tuple[str, str, int]:
    """Return what each connection compares: the newest revision, the hash of sql/, the number of triggers."""
    return head(), routines_sha256(), _triggers()


def revisions() -> list[str]:
    """Return the revisions of this program, oldest first: the prefixes of the file names in migrations/versions."""
    return sorted(file.name.partition("_")[0] for file in (_folder("migrations") / "versions").glob("[0-9]*_*.py"))


def head() -> str:
    """Return the newest revision this program knows."""
    return revisions()[-1]


def structure_sql(after: str | None = None) -> str:
    """Return the structure as SQL: all revisions, or those after one, without the routines; run as one transaction."""
    script = io.StringIO()
    import alembic.command  # slow to import, and needed only by upgrades

    config = _alembic_config(script)
    with _ALEMBIC:
        alembic.command.upgrade(config, f"{after}:head" if after else "head", sql=True)
    return script.getvalue()


def marking_sql(after: str | None) -> str:
    """Return the statement with which an upgrade from a revision marks every object of every scene.

    Empty if no later revision changes answers (`changes_answers`), and without an earlier revision (None).
    """
    if after is None or not any(name > after and _changes_answers(name) for name in revisions()):
        return ""
    return "SELECT pg_catalog.sum(conflictdb_internal._mark_all(s.scene_id)) FROM conflictdb.scene s;\n"


def _changes_answers(name: str) -> bool:
    """Return whether a revision changes answers; revisions that do not say count as changing them."""
    (file,) = (_folder("migrations") / "versions").glob(f"{name}_*.py")
    said = re.search(r"^changes_answers = (True|False)$", file.read_text(encoding="utf-8"), re.MULTILINE)
    return said is None or said[1] == "True"


def comment_sql() -> str:
    """Return the statement that records in the database its rights, and the hash of this program's routines."""
    return f"""
DO $conflictdb$
BEGIN
    EXECUTE pg_catalog.format('COMMENT ON TABLE conflictdb.alembic_version IS %L',
        'Revision of the structure. Rights: MD5 '::text || ({_RIGHTS})
        || '. Routines: SHA-256 {routines_sha256()}'::text);
END
$conflictdb$;
"""


def revision(conn: psycopg.Connection[Any]) -> str | None:
    """Return the revision of the schema in the database, None if there is none."""
    with store.transaction(conn), conn.cursor(row_factory=tuple_row) as cursor:
        cursor.execute("SELECT to_regclass('conflictdb.alembic_version') IS NOT NULL", prepare=False)
        if cursor.fetchone() != (True,):
            return None
        row = cursor.execute("SELECT version_num FROM conflictdb.alembic_version", prepare=False).fetchone()
        return None if row is None else str(row[0])


def check(conn: psycopg.Connection[Any]) -> None:
    """Raise SchemaMissing, SchemaOutdated or SchemaTooNew unless the database's schema is the one of this program."""
    found = revision(conn)
    if found is None:
        raise SchemaMissing(f"database {conn.info.dbname!r} has no conflictdb schema: run `conflictdb admin init`")
    newest, routines, triggers = _expected(_folder("sql"))
    if found != newest:
        _check_known(found, conn.info.dbname)
        raise SchemaOutdated(
            f"the conflictdb schema of database {conn.info.dbname!r} is at revision {found}, this program needs "
            f"{newest}: run `conflictdb admin upgrade`"
        )
    # Between releases a routine may change before it has a revision.
    with store.translated(), conn.transaction():
        applied = _applied_sha256(conn)
        armed = _triggers_armed(conn, triggers)
        usable = _one(conn, _ROLES_ARE_WHOLE)
    if applied != routines:
        raise SchemaOutdated(
            f"the routines of schema conflictdb in database {conn.info.dbname!r} are not those of this program: run "
            "`conflictdb admin upgrade`"
        )
    if usable is not True:
        raise SchemaOutdated(
            f"database {conn.info.dbname!r} lacks the rights and policies of schema conflictdb: a restore into a "
            "server without the roles conflictdb_reader, conflictdb_tracker, conflictdb_editor and "
            "conflictdb_worker loses them; run "
            "`conflictdb admin upgrade`"
        )
    if not armed:
        raise SchemaOutdated(
            f"triggers of schema conflictdb in database {conn.info.dbname!r} are switched off, or a restore has reset "
            "them, and changes go unnoticed: run `conflictdb admin upgrade`, then `conflictdb detect --full` for each "
            "scene"
        )


def upgrade(dsn: str) -> str:
    """Create the schema, or upgrade it to this program's revision; return the revision.

    Safe to run concurrently, and quick when there is nothing to do. A schema of a newer program is left unchanged
    (SchemaTooNew).

    Raises LockTimeout, naming the holders, if another upgrade or a transaction that locks a table lasts more than five
    minutes.
    """
    store.forget_fit()
    with store.translated(), store.connect(dsn) as conn:
        found = revision(conn)
        if found is not None:
            _check_known(found, conn.info.dbname)
        _refuse_foreign_schema(conn)
        if found == head() and _is_complete(conn):
            return found
        store.require_writable(conn)
        if found is not None:
            _check_released(conn)
        if _is_extension(conn):
            _update_extension(conn, str(found))
            return head()
    # Both are slow to import, and not needed for a schema that is up to date.
    import alembic.command
    import sqlalchemy

    config = _alembic_config()
    engine = sqlalchemy.create_engine(
        "postgresql+psycopg://", creator=lambda: store.connect(dsn), poolclass=sqlalchemy.pool.NullPool
    )
    try:
        with _ALEMBIC, store.translated(), engine.connect() as connection:
            config.attributes["connection"] = connection
            try:
                alembic.command.upgrade(config, "head")
            except sqlalchemy.exc.DBAPIError as error:
                raise (error.orig or error) from error
        with store.translated(), store.connect(dsn) as conn:
            # The structure was already at head, but routines, triggers or rights differed.
            if not _is_complete(conn):
                prepare(conn)
                apply_routines(conn)
            return str(revision(conn))
    except LockTimeout as error:
        with store.translated(), store.connect(dsn) as conn:
            holders = _holders(conn) or "nobody any more"
        raise LockTimeout(
            f"upgrading the schema waited {_UPGRADE_WAIT_S:g} s for locks; they are held by: {holders}"
        ) from error


def admit(admin_dsn: str, dsn: str) -> None:
    """Let the user of a connection string work in a database, with a schema of the same name for its own tables.

    Grants conflictdb_worker if that role exists. Runs as an administrator (`admin_dsn`).
    """
    role = str(conninfo.conninfo_to_dict(dsn)["user"])
    with store.translated(), store.connect(admin_dsn) as conn:
        names = {"role": sql.Identifier(role), "database": sql.Identifier(conn.info.dbname)}
        if _one(conn, "SELECT true FROM pg_roles WHERE rolname = %s", role) is None:
            conn.execute(sql.SQL("CREATE ROLE {role} LOGIN").format(**names))
        conn.execute(sql.SQL("GRANT CREATE, TEMPORARY ON DATABASE {database} TO {role}").format(**names))
        conn.execute(sql.SQL("CREATE SCHEMA IF NOT EXISTS {role} AUTHORIZATION {role}").format(**names))
        if _one(conn, "SELECT true FROM pg_roles WHERE rolname = 'conflictdb_worker'") is True:
            conn.execute(sql.SQL("GRANT conflictdb_worker TO {role}").format(**names))


def _is_extension(conn: psycopg.Connection[Any]) -> bool:
    return _one(conn, "SELECT true FROM pg_extension WHERE extname = 'conflictdb'") is True


def _update_extension(conn: psycopg.Connection[Any], found: str) -> None:
    """Update the extension to this program's revision, from the files of its server.

    Raises SchemaOutdated if the server lacks them.
    """
    with conn.transaction():
        prepare(conn)
        if found == head():
            # Between releases routines change without a revision, and a restore can reset triggers.
            conn.execute(_RELEASE)
            apply_routines(conn)
            conn.execute(_ADOPT)
            return
        known = "SELECT true FROM pg_available_extension_versions WHERE name = 'conflictdb' AND version = %s"
        if _one(conn, known, head()) is not True:
            raise SchemaOutdated(
                f"database {conn.info.dbname!r} has conflictdb as an extension, of version {found}, and its server has "
                f"no files of version {head()}: run `conflictdb admin extension` on the machine of the server, "
                "then `conflictdb admin upgrade` again"
            )
        conn.execute(sql.SQL("ALTER EXTENSION conflictdb UPDATE TO {}").format(sql.Literal(head())))


def missing_grants(conn: psycopg.Connection[Any]) -> str | None:
    """Return the grant that an administrator must run for the roles to work, None if nothing is missing.

    The roles use PostGIS's types; only the owner of its schema may grant that.
    """
    with store.translated(), conn.transaction():
        where = _one(
            conn,
            "SELECT pg_catalog.quote_ident(n.nspname) FROM pg_extension e "
            "JOIN pg_namespace n ON n.oid = e.extnamespace "
            "WHERE e.extname = 'postgis' AND NOT has_schema_privilege('conflictdb_reader', n.oid, 'USAGE')",
        )
    return None if where is None else f"GRANT USAGE ON SCHEMA {where} TO conflictdb_reader"


# Roles belong to the server: the administrator of another database may use them, and not grant them. CREATEROLE grants
# all roles before PostgreSQL 16, and from then on those that its role created.
_ROLE_ADMINISTRATORS: Final = """
SELECT (SELECT pg_catalog.string_agg(DISTINCT pg_catalog.quote_ident(m.rolname), ', ')
        FROM pg_catalog.pg_auth_members g JOIN pg_catalog.pg_roles m ON m.oid = g.member
        WHERE g.admin_option AND g.roleid = 'conflictdb_worker'::regrole),
       pg_catalog.quote_ident(current_user)
WHERE pg_has_role((SELECT n.nspowner FROM pg_catalog.pg_namespace n WHERE n.nspname = 'conflictdb'), 'USAGE')
  AND NOT (SELECT r.rolsuper OR r.rolcreaterole AND pg_catalog.current_setting('server_version_num')::integer < 160000
           FROM pg_catalog.pg_roles r WHERE r.rolname = current_user)
  AND NOT (pg_has_role('conflictdb_reader', 'MEMBER WITH ADMIN OPTION')
           AND pg_has_role('conflictdb_editor', 'MEMBER WITH ADMIN OPTION')
           AND pg_has_role('conflictdb_worker', 'MEMBER WITH ADMIN OPTION'))
"""


def ungrantable_roles(conn: psycopg.Connection[Any]) -> str | None:
    """Return why the connection's role cannot grant the roles to users, and who can; None if it can."""
    with store.translated(), conn.transaction():
        row = conn.execute(_ROLE_ADMINISTRATORS.encode()).fetchone()
    if row is None:
        return None
    administrators, role = row
    who = f"{administrators}, or a superuser" if administrators else "a superuser"
    return (
        f"the roles of conflictdb belong to the whole server, and {role} may not grant them; let {who} run: "
        f"GRANT conflictdb_reader, conflictdb_editor, conflictdb_worker TO {role} WITH ADMIN OPTION"
    )


def prepare(conn: psycopg.Connection[Any]) -> None:
    """Lock out other upgrades until the transaction ends; ensure extensions, schema and search path.

    Raises ServerError if the server is too old, lacks PostGIS or refuses to create it.
    """
    if conn.info.server_version < MIN_SERVER_VERSION:
        raise ServerError(f"PostgreSQL {MIN_SERVER_VERSION // 10000} or newer is needed; this is {_server(conn)}")
    _lock_out_others(conn)
    _refuse_foreign_schema(conn)
    for extension in ("postgis", "btree_gist"):
        try:
            conn.execute(sql.SQL("CREATE EXTENSION IF NOT EXISTS {}").format(sql.Identifier(extension)))
        except (psycopg.errors.FeatureNotSupported, psycopg.errors.UndefinedFile) as error:
            raise ServerError(f"the server has no extension {extension!r}: install it ({_server(conn)})") from error
        except psycopg.errors.InsufficientPrivilege as error:
            raise ServerError(
                f"extension {extension!r} is missing in database {conn.info.dbname!r} and {conn.info.user!r} may not "
                f"create it; let an administrator run: CREATE EXTENSION {extension}"
            ) from error
    version = str(_one(conn, "SELECT extversion FROM pg_extension WHERE extname = 'postgis'"))
    if tuple(int(part) for part in re.findall(r"\d+", version)[:2]) < MIN_POSTGIS_VERSION:
        raise ServerError(f"PostGIS 3.3 or newer is needed; database {conn.info.dbname!r} has {version}")
    try:
        for name in (SCHEMA, PRIVATE_SCHEMA):
            # Not IF NOT EXISTS, which requires the right to create schemas even if it exists.
            if _one(conn, "SELECT to_regnamespace(%s) IS NULL", name) is True:
                conn.execute(sql.SQL("CREATE SCHEMA {}").format(sql.Identifier(name)))
                if _is_extension(conn):
                    conn.execute(sql.SQL("ALTER EXTENSION conflictdb ADD SCHEMA {}").format(sql.Identifier(name)))
    except psycopg.errors.InsufficientPrivilege as error:
        grant = sql.SQL("GRANT CREATE ON DATABASE {} TO {}")
        statement = grant.format(sql.Identifier(conn.info.dbname), sql.Identifier(conn.info.user)).as_string(conn)
        raise ServerError(
            f"{conn.info.user!r} may not create schemas in database {conn.info.dbname!r}; let an administrator run: "
            f"{statement}"
        ) from error
    _set_search_path(conn)


def _refuse_foreign_schema(conn: psycopg.Connection[Any]) -> None:
    """Raise ServerError if one of our schemas exists and a role other than the current one may create objects in it."""
    _refuse(conn, REFUSE_FOREIGN_SCHEMA, psycopg.errors.DuplicateSchema)


def _refuse(conn: psycopg.Connection[Any], refusal: str, kind: type[psycopg.Error]) -> None:
    try:
        conn.execute(refusal.encode())
    except kind as error:
        raise ServerError(f"{error.diag.message_primary}. {error.diag.message_hint}") from error


def _lock_out_others(conn: psycopg.Connection[Any]) -> None:
    start, is_said = time.monotonic(), False
    while _one(conn, "SELECT pg_try_advisory_xact_lock(%s)", _UPGRADE_LOCK) is not True:
        waited_s = time.monotonic() - start
        if waited_s >= _UPGRADE_WAIT_S:
            raise LockTimeout("another upgrade is at work")
        if waited_s >= _SAY_AFTER_S and not is_said:
            is_said = True
            _log.warning("waiting for another upgrade of the schema: %s", _holders(conn))
        time.sleep(_LOOK_EVERY_S)
    # Lift the role's or database's limit: building indexes of full tables takes long.
    conn.execute("SET LOCAL statement_timeout = 0")
    conn.execute(f"SET LOCAL lock_timeout = '{_UPGRADE_WAIT_S * 1000:.0f}ms'".encode())


def _holders(conn: psycopg.Connection[Any]) -> str:
    """Return the holders of the upgrade lock or of a table of the schema, as text for people; may be empty."""
    high, low = _UPGRADE_LOCK >> 32, _UPGRADE_LOCK & 0xFFFFFFFF
    ours = f"l.locktype = 'advisory' AND l.classid = {high} AND l.objid = {low} AND l.objsubid = 1"
    return " and ".join(map(str, store.lock_holders(conn, f"{store.ON_OUR_TABLE} OR {ours}")))


def apply_routines(conn: psycopg.Connection[Any]) -> None:
    """Run all of sql/ in the transaction of `conn`, whose schema must be at head."""
    for file in routine_files():
        if needs_no_postgis(file):
            conn.execute("SET LOCAL search_path = conflictdb, conflictdb_internal, pg_temp")
        else:
            _set_search_path(conn)
        # As bytes and without parameters, so that % and : have no special meaning.
        conn.execute(file.read_bytes())
    _set_search_path(conn)
    _refuse(conn, REFUSE_FOREIGN_NAMES, psycopg.errors.DuplicateObject)
    conn.execute(comment_sql().encode())


def _triggers_armed(conn: psycopg.Connection[Any], triggers: int) -> bool:
    """Return whether all triggers exist and fire as their names say: always, for users only, or for replicas only."""
    armed = _one(
        conn,
        """SELECT count(*) FROM pg_trigger t JOIN pg_class c ON c.oid = t.tgrelid
           WHERE c.relnamespace = 'conflictdb'::regnamespace::oid AND NOT t.tgisinternal
             AND t.tgparentid = 0::oid
             AND t.tgenabled = CASE WHEN t.tgname::text ~ '_replicated$'::text THEN 'R'::"char"
                                    WHEN t.tgname::text ~ '_(inserted|updated|deleted|removed)$'::text THEN 'O'::"char"
                                    WHEN t.tgname = 'scene_holds_objects'::name THEN 'O'::"char"
                                    ELSE 'A'::"char" END""",
    )
    return armed == triggers


def _is_complete(conn: psycopg.Connection[Any]) -> bool:
    """Return whether the routines are those of this program, and triggers and rights as they were then."""
    return (
        _applied_sha256(conn) == routines_sha256()
        and _triggers_armed(conn, _triggers())
        and _one(conn, _ROLES_ARE_WHOLE) is True
        and f"Rights: MD5 {_one(conn, _RIGHTS)}." in _comment(conn)
    )


def _applied_sha256(conn: psycopg.Connection[Any]) -> str:
    return _comment(conn).rpartition(" ")[2]


def _comment(conn: psycopg.Connection[Any]) -> str:
    return str(_one(conn, "SELECT obj_description(to_regclass('conflictdb.alembic_version'), 'pg_class')"))


def _set_search_path(conn: psycopg.Connection[Any]) -> None:
    """Set the search path: our schemas, then PostGIS's, then temporary objects last."""
    where = _one(
        conn,
        "SELECT n.nspname FROM pg_extension e JOIN pg_namespace n ON n.oid = e.extnamespace WHERE extname = 'postgis'",
    )
    path = sql.SQL(", ").join(sql.Identifier(name) for name in (SCHEMA, PRIVATE_SCHEMA, str(where), "pg_temp"))
    conn.execute(sql.SQL("SET LOCAL search_path = {}").format(path))


def _check_known(found: str, database: str) -> None:
    if found not in (*revisions(), FORMER):
        raise SchemaTooNew(
            f"the conflictdb schema of database {database!r} is at revision {found}, which this program does not know "
            f"(it knows up to {head()}): install a newer conflictdb, or if the database was made before the first "
            f"release, {_FROM_BEFORE_RELEASE}"
        )


def _check_released(conn: psycopg.Connection[Any]) -> None:
    """Raise SchemaOutdated for a schema at a former revision 0001 or 0002."""
    if _one(conn, "SELECT to_regclass('conflictdb.scene_share') IS NULL") is True:
        raise SchemaOutdated(
            f"the conflictdb schema of database {conn.info.dbname!r} was made before the first release: "
            f"{_FROM_BEFORE_RELEASE}"
        )


def _alembic_config(output: io.StringIO | None = None) -> "alembic.config.Config":
    import alembic.config

    config = alembic.config.Config(output_buffer=output)
    config.set_main_option("script_location", str(_folder("migrations")))
    return config


def _folder(name: str) -> Path:
    """Return the folder sql or migrations: inside an installed package, else beside it in the source tree."""
    packaged = _PACKAGE / f"_{name}"
    return packaged if packaged.is_dir() else _PACKAGE.parent / name


def _server(conn: psycopg.Connection[Any]) -> str:
    return f"PostgreSQL {conn.info.parameter_status('server_version')}"


def _one(conn: psycopg.Connection[Any], query: LiteralString, *arguments: object) -> object:
    with conn.cursor(row_factory=tuple_row) as cursor:
        row = cursor.execute(query, arguments, prepare=False).fetchone()
        return None if row is None else row[0]
