"""A schema that other roles could put names into is refused: routines that run as another role would call them."""

from collections.abc import Iterator
from typing import Any

import alembic.command
import alembic.config
import psycopg
import pytest
import sqlalchemy
from databases import TestServer
from psycopg import conninfo

from conflictdb.errors import ServerError, StoreError
from conflictdb.jobs import extension, schema

# A user plants this before an administrator installs conflictdb; the function fits better than PostgreSQL's own.
PLANTED = """
CREATE FUNCTION conflictdb.format(text, text) RETURNS text LANGUAGE plpgsql AS
    $$ BEGIN ALTER ROLE conflictdb_editor SUPERUSER; RETURN 'x'; END $$
"""
OWNED = "CREATE SCHEMA conflictdb AUTHORIZATION conflictdb_editor"
OPEN = "CREATE SCHEMA conflictdb; GRANT CREATE ON SCHEMA conflictdb TO conflictdb_editor"
CASES = {
    OWNED: "belongs to role conflictdb_editor",
    f"{OWNED}; SET ROLE conflictdb_editor; {PLANTED}": "belongs to role conflictdb_editor",
    OPEN: "lets role conflictdb_editor create objects",
    "CREATE SCHEMA conflictdb; GRANT ALL ON SCHEMA conflictdb TO PUBLIC": "lets PUBLIC create objects",
    f"{OPEN}; SET ROLE conflictdb_editor; {PLANTED}; RESET ROLE; REVOKE CREATE ON SCHEMA conflictdb FROM "
    "conflictdb_editor": r"has an object of role conflictdb_editor: function .*format\(text,text\)",
    "CREATE SCHEMA conflictdb; CREATE TABLE conflictdb.mine ()": "has objects that are none of ours: table .*mine",
}
# The schema of private routines is on the same search path.
PRIVATE = {
    made.replace("SCHEMA conflictdb", "SCHEMA conflictdb_internal").replace("conflictdb.", "conflictdb_internal."): said
    for made, said in CASES.items()
}

# Numbers of objects in a database.
OBJECTS = """SELECT ARRAY[(SELECT count(*) FROM pg_proc), (SELECT count(*) FROM pg_type),
                          (SELECT count(*) FROM pg_namespace), (SELECT count(*) FROM pg_extension)]"""


@pytest.fixture(scope="module")
def _bare(_server: TestServer, worker_id: str) -> Iterator[str]:
    name = f"{_server.prefix}_{worker_id}_bare"
    yield _server.clone("template0", name)
    _server.drop(name)


@pytest.fixture
def bare_dsn(_bare: str) -> Iterator[str]:
    """Return the connection string of a database without the schema, in which a test may leave our schemas' names."""
    before = one(_bare, OBJECTS)
    yield _bare
    execute(_bare, "DROP SCHEMA IF EXISTS conflictdb, conflictdb_internal CASCADE")
    assert one(_bare, OBJECTS) == before


def execute(dsn: str, statements: str) -> None:
    with psycopg.connect(dsn) as conn:
        conn.execute(statements.encode())


def one(dsn: str, query: str) -> Any:
    with psycopg.connect(dsn) as conn:
        row = conn.execute(query.encode()).fetchone()
        assert row is not None
        return row[0]


def alembic_upgrade(dsn: str) -> None:
    """Upgrade as the command line of alembic does."""
    config = alembic.config.Config()
    config.set_main_option("script_location", str(schema._folder("migrations")))
    engine = sqlalchemy.create_engine(
        "postgresql+psycopg://", creator=lambda: psycopg.connect(dsn), poolclass=sqlalchemy.pool.NullPool
    )
    with engine.connect() as connection:
        config.attributes["connection"] = connection
        alembic.command.upgrade(config, "head")


@pytest.mark.usefixtures("template")  # its roles
@pytest.mark.parametrize("made", [*CASES, *PRIVATE])
@pytest.mark.parametrize("how", ["init", "alembic"])
def test_a_schema_that_is_not_ours_is_refused_and_left_alone(bare_dsn: str, made: str, how: str) -> None:
    execute(bare_dsn, made)
    before = one(bare_dsn, "SELECT count(*) FROM pg_proc")
    upgrade = schema.upgrade if how == "init" else alembic_upgrade
    name, said = ("conflictdb", CASES[made]) if made in CASES else ("conflictdb_internal", PRIVATE[made])
    with pytest.raises(ServerError, match=f"schema {name} {said}.*must be created by "):
        upgrade(bare_dsn)
    assert one(bare_dsn, "SELECT count(*) FROM pg_proc") == before
    assert one(bare_dsn, "SELECT rolsuper FROM pg_roles WHERE rolname = 'conflictdb_editor'") is False


@pytest.mark.usefixtures("template")  # its roles
@pytest.mark.parametrize("made", [*CASES, *PRIVATE])
def test_the_script_of_the_extension_refuses_it_too(bare_dsn: str, made: str) -> None:
    execute(bare_dsn, made)
    (script,) = (text for name, text in extension.files() if name == f"conflictdb--{schema.head()}.sql")
    refusal = script[: script.index("CREATE TABLE")]
    assert schema.REFUSE_FOREIGN_SCHEMA in refusal
    with pytest.raises(psycopg.errors.DuplicateSchema, match=(CASES | PRIVATE)[made]):
        execute(bare_dsn, schema.REFUSE_FOREIGN_SCHEMA)


def test_a_schema_that_looks_complete_is_refused_too(dsn: str) -> None:
    """It has the revision and the hash of this program; its owner could replace every function of it."""
    schema.upgrade(dsn)
    for name in ("conflictdb", "conflictdb_internal"):
        execute(dsn, f"ALTER SCHEMA {name} OWNER TO conflictdb_editor")
        with pytest.raises(ServerError, match=f"schema {name} belongs to role conflictdb_editor"):
            schema.upgrade(dsn)
        execute(dsn, f"ALTER SCHEMA {name} OWNER TO CURRENT_USER")
    execute(dsn, "ALTER FUNCTION conflictdb_internal._is_plain(jsonb) OWNER TO conflictdb_editor")
    with pytest.raises(ServerError, match=r"has an object of role conflictdb_editor: function .*_is_plain\(jsonb\)"):
        schema.upgrade(dsn)


@pytest.mark.usefixtures("template")
def test_a_role_that_was_given_the_schemas_installs_into_them(empty_dsn: str) -> None:
    """As administrators do for roles that may not create schemas."""
    for extension_name in ("postgis", "btree_gist"):
        execute(empty_dsn, f"CREATE EXTENSION {extension_name}")
    execute(empty_dsn, OWNED)
    execute(empty_dsn, "CREATE SCHEMA conflictdb_internal AUTHORIZATION conflictdb_editor")
    assert schema.upgrade(conninfo.make_conninfo(empty_dsn, options="-c role=conflictdb_editor")) == schema.head()
    assert schema.upgrade(conninfo.make_conninfo(empty_dsn, options="-c role=conflictdb_editor")) == schema.head()


@pytest.mark.usefixtures("template")
@pytest.mark.parametrize(
    "planted",
    [
        "CREATE FUNCTION public.jsonb_path_exists(jsonb, text) RETURNS boolean LANGUAGE sql AS 'SELECT true'",
        "CREATE FUNCTION public.lower(tstzrange) RETURNS timestamptz LANGUAGE sql AS 'SELECT now()'",
        """CREATE FUNCTION public.less(tstzrange, tstzrange) RETURNS boolean LANGUAGE sql AS 'SELECT true';
           CREATE OPERATOR public.&& (LEFTARG = tstzrange, RIGHTARG = tstzrange, FUNCTION = public.less)""",
        "CREATE FUNCTION public.array_send(double precision[]) RETURNS bytea LANGUAGE sql AS 'SELECT NULL::bytea'",
    ],
)
def test_a_name_in_the_schema_of_postgis_is_bound_by_nothing_of_ours(empty_dsn: str, planted: str) -> None:
    """Functions in SQL, views and policies stay bound to the objects found at their creation."""
    execute(empty_dsn, "CREATE EXTENSION postgis; GRANT CREATE ON SCHEMA public TO conflictdb_editor")
    execute(empty_dsn, f"SET ROLE conflictdb_editor; {planted}")
    bound = """SELECT count(*) FROM pg_depend d
               JOIN pg_proc p ON d.refobjid = p.oid AND d.refclassid = 'pg_proc'::regclass
               JOIN pg_proc f ON f.oid = d.objid
                    AND f.pronamespace IN (to_regnamespace('conflictdb'), to_regnamespace('conflictdb_internal'))
               WHERE p.proowner = 'conflictdb_editor'::regrole"""
    try:
        schema.upgrade(empty_dsn)
    except (ServerError, StoreError) as refusal:
        told = ("is found in place of a name of PostgreSQL or PostGIS", "is not unique")
        assert any(text in str(refusal) for text in told)  # noqa: PT017
        assert one(empty_dsn, "SELECT to_regnamespace('conflictdb') IS NULL")
    assert one(empty_dsn, bound) == 0


@pytest.mark.usefixtures("template")
def test_an_administrator_who_installs_runs_no_function_of_others(empty_dsn: str) -> None:
    """Where users may create in the schema of PostGIS, as before PostgreSQL 15 in public."""
    execute(empty_dsn, "CREATE EXTENSION postgis; GRANT CREATE ON SCHEMA public TO conflictdb_editor")
    execute(empty_dsn, "CREATE TABLE public.caught (by_role name); GRANT INSERT ON public.caught TO PUBLIC")
    for name, arguments, result in (
        ("pg_has_role", "text, text, text", "true"),
        ("has_schema_privilege", "name, regnamespace, text", "true"),
        ("starts_with", "name, text", "false"),
    ):
        execute(
            empty_dsn,
            f"""SET ROLE conflictdb_editor;
                CREATE FUNCTION public.{name}({arguments}) RETURNS boolean LANGUAGE plpgsql AS
                $$ BEGIN INSERT INTO public.caught VALUES (current_user); RETURN {result}; END $$""",
        )
    schema.upgrade(empty_dsn)
    execute(empty_dsn, "COMMENT ON TABLE conflictdb.alembic_version IS 'Routines: SHA-256 older'")
    schema.upgrade(empty_dsn)
    with psycopg.connect(empty_dsn) as conn:
        schema.check(conn)
        assert conn.execute("SELECT DISTINCT by_role FROM public.caught").fetchall() == []
