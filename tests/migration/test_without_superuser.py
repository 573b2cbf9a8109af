"""Everything works for an administrator who is no superuser, as on managed databases."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import psycopg
import pytest
from commands import STRAIT, Run, runner
from own_server import own_server
from psycopg import conninfo

from conflictdb.jobs import schema

ADMIN, PLANNER, STRANGER, WATCHER, ROBOT = PEOPLE = ("boss", "pilot", "stranger", "watcher", "robot")
GROUPS = {PLANNER: "conflictdb_editor", STRANGER: "conflictdb_editor", WATCHER: "conflictdb_reader",
          ROBOT: "conflictdb_worker"}  # fmt: skip
OPS = "CREATE TABLE planners.ops (id integer PRIMARY KEY, shape public.geometry)"
ROW = "INSERT INTO planners.ops VALUES (1, 'SRID=4326;POLYGON((5 5, 6 5, 6 6, 5 5))')"


@pytest.fixture
def server() -> Iterator[str]:
    """How a superuser connects to a server without our roles: that of CONFLICTDB_TEST_DSN if it has none, else one."""
    given = os.environ.get("CONFLICTDB_TEST_DSN")
    if given:
        with psycopg.connect(given) as conn:
            if not conn.execute("SELECT FROM pg_roles WHERE rolname LIKE 'conflictdb%'").rowcount:
                yield given
                return
    with own_server() as own:
        superuser = conninfo.make_conninfo(own.dsn, dbname="postgres")
        with psycopg.connect(superuser, autocommit=True) as conn:
            conn.execute("DROP DATABASE conflictdb WITH (FORCE)")
            conn.execute("DROP ROLE conflictdb_worker, conflictdb_editor, conflictdb_tracker, conflictdb_reader")
        yield superuser


@pytest.fixture
def managed(server: str) -> Iterator[str]:
    """How its administrator connects to a database with PostGIS: a role with CREATEROLE that owns it."""
    database = f"managed_{os.getpid()}"
    with psycopg.connect(server, autocommit=True) as conn:
        conn.execute(f"CREATE ROLE {ADMIN} LOGIN CREATEROLE".encode())
        conn.execute(f"CREATE DATABASE {database} OWNER {ADMIN}".encode())
        dsn = conninfo.make_conninfo(server, dbname=database)
        try:
            with psycopg.connect(dsn, autocommit=True) as inside:
                inside.execute("CREATE EXTENSION postgis; CREATE EXTENSION btree_gist")
            yield conninfo.make_conninfo(dsn, user=ADMIN)
        finally:
            conn.execute(f"DROP DATABASE {database} WITH (FORCE)".encode())
            # Who granted memberships is dropped last.
            for role in (
                *GROUPS,
                "conflictdb_worker",
                "conflictdb_editor",
                "conflictdb_tracker",
                "conflictdb_reader",
                ADMIN,
            ):
                conn.execute(f"DROP ROLE IF EXISTS {role}".encode())


@pytest.fixture
def as_role(managed: str, capsys: pytest.CaptureFixture[str]) -> Callable[[str], Run]:
    """Return a function that returns how a role runs commands."""
    return lambda role: runner(conninfo.make_conninfo(managed, user=role), capsys)


def _fill(managed: str, as_role: Callable[[str], Run]) -> None:
    """Create the schema and people, each as the administrator, and a scene, as a planner."""
    made = as_role(ADMIN)("admin", "init")
    assert (made.code, made.err) == (0, ""), made
    with psycopg.connect(managed, autocommit=True) as conn:
        assert conn.execute("SELECT current_setting('is_superuser')").fetchone() == ("off",)
        for role, group in GROUPS.items():
            conn.execute(f"CREATE ROLE {role} LOGIN; GRANT {group} TO {role}".encode())
    assert as_role(PLANNER)("load", STRAIT).code == 0
    assert as_role(ROBOT)("worker", "--once").code == 0


def test_everyday_commands(managed: str, as_role: Callable[[str], Run]) -> None:
    _fill(managed, as_role)
    (found,) = {as_role(role)("conflicts", "--scene", "strait", "--format", "json").out for role in GROUPS}
    assert found.count("a_key") > 0
    with psycopg.connect(managed, autocommit=True) as conn:
        conn.execute(f"CREATE SCHEMA planners; GRANT USAGE, CREATE ON SCHEMA planners TO {PLANNER}".encode())
    with psycopg.connect(managed, user=PLANNER, autocommit=True) as conn:
        conn.execute(OPS.encode())
        conn.execute(ROW.encode())
    words = ("admin", "attach", "area", "--scene", "ops", "--table", "planners.ops", "--map", "key=id,footprint=shape")
    attached = as_role(PLANNER)(*words)
    assert (attached.code, "1 area of planners.ops" in attached.out) == (0, True), attached
    assert as_role(PLANNER)("delete", "--scene", "strait", "--all").code == 0
    assert as_role(WATCHER)("load", STRAIT).code == 1


def test_upgrade_keeps_rights(managed: str, as_role: Callable[[str], Run], next_release: Path) -> None:
    """From the revision before, with the same rights afterwards."""
    del next_release
    newest = schema.head()
    _fill(managed, as_role)
    with psycopg.connect(managed) as conn:
        conn.execute("UPDATE conflictdb.alembic_version SET version_num = %s", [f"{int(newest) - 1:04}"])
        conn.execute("DROP FUNCTION conflictdb.scene_note(text); ALTER TABLE conflictdb.scene DROP COLUMN note")
    upgraded = as_role(ADMIN)("admin", "upgrade")
    assert (upgraded.code, upgraded.err, newest in upgraded.out) == (0, "", True), upgraded
    assert as_role(WATCHER)("conflicts", "--scene", "strait").code == 0
    assert as_role(PLANNER)("load", STRAIT).code == 0


def test_limits(managed: str, as_role: Callable[[str], Run]) -> None:
    _fill(managed, as_role)
    with psycopg.connect(managed, autocommit=True) as conn:
        conn.execute("SELECT conflictdb.set_limit('max_vertices', 3)")
        with pytest.raises(psycopg.errors.InsufficientPrivilege):  # the reason for the table
            conn.execute(f"ALTER DATABASE {conn.info.dbname} SET conflictdb.max_vertices = 3".encode())
    refused = as_role(PLANNER)("load", STRAIT, "--scene", "again")
    assert (refused.code, "must have at most 3 vertices" in refused.err) == (4, True), refused
    for role in GROUPS:
        with psycopg.connect(managed, user=role) as conn, pytest.raises(psycopg.errors.InsufficientPrivilege):
            conn.execute("SELECT conflictdb.set_limit('max_vertices', NULL)")
    with psycopg.connect(managed, autocommit=True) as conn:
        conn.execute("SELECT conflictdb.set_limit('max_vertices', NULL)")
    assert as_role(PLANNER)("load", STRAIT, "--scene", "again").code == 0


def test_protected_scenes(managed: str, as_role: Callable[[str], Run]) -> None:
    _fill(managed, as_role)
    assert as_role(PLANNER)("admin", "protect").code == 1
    assert as_role(ADMIN)("admin", "protect").code == 0
    seen = {role: as_role(role)("conflicts", "--scene", "strait").code for role in PEOPLE}
    assert {role for role, code in seen.items() if code == 0} == {ADMIN, PLANNER, ROBOT}
    assert as_role(PLANNER)("admin", "share", "--scene", "strait", WATCHER).code == 0
    assert as_role(WATCHER)("conflicts", "--scene", "strait").code == 0
    assert as_role(STRANGER)("conflicts", "--scene", "strait").code != 0
