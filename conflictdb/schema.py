"""Creates, upgrades and checks the schema `conflictdb` in a database.

`migrations/` holds the past of the structure (alembic), `sql/` the present of the routines. An upgrade does everything
in one transaction, under a lock: it runs the missing revisions and, once at head, all of `sql/`.
"""

import hashlib
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import psycopg
from psycopg import sql
from psycopg.rows import tuple_row

from conflictdb import store
from conflictdb.errors import SchemaMissing, SchemaOutdated, SchemaTooNew, ServerError, StoreError

SCHEMA: Final = "conflictdb"
MIN_SERVER_VERSION: Final = 140000  # BEGIN ATOMIC bodies, multiranges
MIN_POSTGIS_VERSION: Final = (3, 3)

# Key of the advisory lock that makes upgrades of one database wait for each other: "conflict" in ASCII.
_UPGRADE_LOCK: Final = int.from_bytes(b"conflict")
# Alembic keeps what it does in global variables: one thread at a time. Other programs wait at the database's lock.
_ALEMBIC: Final = threading.Lock()
_PACKAGE: Final = Path(__file__).resolve().parent


def routine_files() -> list[Path]:
    """Return the files of sql/ in the order they are applied."""
    return sorted(_folder("sql").glob("[0-9][0-9]_*.sql"))


def routines_sha256() -> str:
    """Return the hash of all of sql/, names and contents."""
    digest = hashlib.sha256()
    for file in routine_files():
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def head() -> str:
    """Return the newest revision this program knows."""
    return max(_revisions())


def revision(conn: psycopg.Connection[Any]) -> str | None:
    """Return the revision of the schema in the database, None if there is none."""
    with _translated(), conn.transaction(), conn.cursor(row_factory=tuple_row) as cursor:
        cursor.execute("SELECT to_regclass('conflictdb.alembic_version') IS NOT NULL", prepare=False)
        if cursor.fetchone() != (True,):
            return None
        row = cursor.execute("SELECT version_num FROM conflictdb.alembic_version", prepare=False).fetchone()
        return None if row is None else str(row[0])


def check(conn: psycopg.Connection[Any]) -> None:
    """Raise SchemaMissing, SchemaOutdated or SchemaTooNew unless the database's schema is the one of this program."""
    found = revision(conn)
    if found is None:
        raise SchemaMissing(f"database {conn.info.dbname!r} has no conflictdb schema: run `conflictdb init`")
    _check_known(found, conn.info.dbname)
    if found != head():
        raise SchemaOutdated(
            f"the conflictdb schema of database {conn.info.dbname!r} is at revision {found}, this program needs "
            f"{head()}: run `conflictdb upgrade`"
        )
    # Between releases a routine may change before its revision has a name.
    with _translated(), conn.transaction():
        applied = _applied_sha256(conn)
    if applied != routines_sha256():
        raise SchemaOutdated(
            f"the routines of schema conflictdb in database {conn.info.dbname!r} are not those of this program: run "
            "`conflictdb upgrade`"
        )


def upgrade(dsn: str) -> str:
    """Create the schema, or bring it to this program's revision; returns the revision.

    Safe to call at the same time from several programs, and quick when there is nothing to do. A schema that was made
    by a newer program is left alone (SchemaTooNew).
    """
    with _translated(), store.connect(dsn) as conn:
        found = revision(conn)
        if found is not None:
            _check_known(found, conn.info.dbname)
        if found == head() and _applied_sha256(conn) == routines_sha256():
            return found
        store.require_writable(conn)
    # These two take longer to import than everything else; a schema that is up to date does not need them.
    import alembic.command
    import alembic.config
    import sqlalchemy

    config = alembic.config.Config()
    config.set_main_option("script_location", str(_folder("migrations")))
    engine = sqlalchemy.create_engine(
        "postgresql+psycopg://", creator=lambda: store.connect(dsn), poolclass=sqlalchemy.pool.NullPool
    )
    with _ALEMBIC, _translated(), engine.connect() as connection:
        config.attributes["connection"] = connection
        try:
            alembic.command.upgrade(config, "head")
        except sqlalchemy.exc.DBAPIError as error:
            raise (error.orig or error) from error
    with _translated(), store.connect(dsn) as conn:
        # The structure was at head already but the routines were not this program's.
        if _applied_sha256(conn) != routines_sha256():
            prepare(conn)
            apply_routines(conn)
        return str(revision(conn))


def missing_grants(conn: psycopg.Connection[Any]) -> str | None:
    """Return what an administrator must run so that the roles can work, None if nothing is missing.

    The roles use the types of PostGIS; only who owns the schema it lives in may let them.
    """
    with _translated(), conn.transaction():
        where = _one(
            conn,
            "SELECT quote_ident(n.nspname) FROM pg_extension e JOIN pg_namespace n ON n.oid = e.extnamespace "
            "WHERE e.extname = 'postgis' AND NOT has_schema_privilege('conflictdb_reader', n.oid, 'USAGE')",
        )
    return None if where is None else f"GRANT USAGE ON SCHEMA {where} TO conflictdb_reader"


def prepare(conn: psycopg.Connection[Any]) -> None:
    """Lock out other upgrades until the transaction ends; make sure of the extensions, the schema and the search path.

    Raises ServerError if the server is too old, lacks PostGIS or refuses to create it.
    """
    if conn.info.server_version < MIN_SERVER_VERSION:
        raise ServerError(f"PostgreSQL {MIN_SERVER_VERSION // 10000} or newer is needed; this is {_server(conn)}")
    conn.execute("SELECT pg_advisory_xact_lock(%s)", (_UPGRADE_LOCK,))
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
    conn.execute("CREATE SCHEMA IF NOT EXISTS conflictdb")
    _set_search_path(conn)


def apply_routines(conn: psycopg.Connection[Any]) -> None:
    """Run all of sql/ in the transaction of `conn`, whose schema must be at head."""
    _set_search_path(conn)
    for file in routine_files():
        # As bytes and without parameters, so that neither % nor : means anything.
        conn.execute(file.read_bytes())
    conn.execute(
        sql.SQL("COMMENT ON TABLE conflictdb.alembic_version IS {}").format(
            sql.Literal(f"Revision of the structure. Routines: SHA-256 {routines_sha256()}")
        )
    )


def _applied_sha256(conn: psycopg.Connection[Any]) -> str:
    comment = _one(conn, "SELECT obj_description(to_regclass('conflictdb.alembic_version'), 'pg_class')")
    return str(comment).rpartition(" ")[2]


def _set_search_path(conn: psycopg.Connection[Any]) -> None:
    """Let names mean ours, then PostGIS's wherever it lives; temporary objects never come first."""
    where = _one(
        conn,
        "SELECT n.nspname FROM pg_extension e JOIN pg_namespace n ON n.oid = e.extnamespace WHERE extname = 'postgis'",
    )
    path = sql.SQL(", ").join(sql.Identifier(name) for name in (SCHEMA, str(where), "pg_temp"))
    conn.execute(sql.SQL("SET LOCAL search_path = {}").format(path))


def _check_known(found: str, database: str) -> None:
    if found not in _revisions():
        raise SchemaTooNew(
            f"the conflictdb schema of database {database!r} is at revision {found}, which this program does not know "
            f"(it knows up to {head()}): install a newer conflictdb"
        )


def _revisions() -> list[str]:
    """Return the revisions of this program: the numbers that file names of migrations/versions start with."""
    return [file.name.partition("_")[0] for file in (_folder("migrations") / "versions").glob("[0-9]*_*.py")]


def _folder(name: str) -> Path:
    """Return the folder sql or migrations: inside an installed package, else beside it in the source tree."""
    packaged = _PACKAGE / f"_{name}"
    return packaged if packaged.is_dir() else _PACKAGE.parent / name


def _server(conn: psycopg.Connection[Any]) -> str:
    return f"PostgreSQL {conn.info.parameter_status('server_version')}"


def _one(conn: psycopg.Connection[Any], query: str) -> object:
    with conn.cursor(row_factory=tuple_row) as cursor:
        row = cursor.execute(query, prepare=False).fetchone()
        return None if row is None else row[0]


@contextmanager
def _translated() -> Iterator[None]:
    try:
        yield
    except psycopg.Error as error:
        raise StoreError(f"database: {str(error).strip()}") from error
