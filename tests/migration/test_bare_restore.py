"""A dump is a backup also where the roles are missing: an upgrade gives the rights and policies back."""

import subprocess
from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from catalog import privileges
from own_server import OwnServer, own_server

from conflictdb import connect
from conflictdb.errors import SchemaOutdated
from conflictdb.jobs import schema

POLICIES = """
SELECT p.polrelid::regclass::text, p.polname, p.polcmd, p.polroles::regrole[]::text, pg_get_expr(p.polqual, p.polrelid),
       pg_get_expr(p.polwithcheck, p.polrelid)
FROM pg_policy p ORDER BY 1, 2
"""
OPEN = """
SELECT count(*) FROM pg_proc p
WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
  AND (p.proacl IS NULL OR EXISTS (SELECT FROM aclexplode(p.proacl) x WHERE x.grantee = 0))
"""
ROLES = "conflictdb_reader, conflictdb_editor, conflictdb_worker"


@pytest.fixture(scope="module")
def server() -> Iterator[OwnServer]:
    with own_server() as own:
        yield own


def rights(server: OwnServer) -> list[Any]:
    with psycopg.connect(server.dsn) as conn:
        return [privileges(conn), conn.execute(POLICIES).fetchall(), conn.execute(OPEN).fetchall()]


def test_a_restore_without_roles_gets_its_rights_back(server: OwnServer) -> None:
    """pg_restore skips grants to roles that are missing, and with them what the same entry takes from everybody."""
    with psycopg.connect(server.dsn) as conn:
        conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.protect_scenes()")
    before = rights(server)
    programs = server.programs
    dump = subprocess.run(
        [programs.bin / "pg_dump", "-Fc", "-d", server.dsn], env=programs.environ, check=True, capture_output=True
    ).stdout
    with psycopg.connect(server.dsn.replace("dbname=conflictdb", "dbname=postgres"), autocommit=True) as conn:
        conn.execute("DROP DATABASE conflictdb WITH (FORCE)")
        conn.execute("DROP ROLE IF EXISTS planner")
        conn.execute(f"DROP ROLE {ROLES}".encode())
        conn.execute("CREATE DATABASE conflictdb")
    restored = subprocess.run(
        [programs.bin / "pg_restore", "-d", server.dsn],
        env=programs.environ,
        input=dump,
        capture_output=True,
        check=False,
    )
    assert b'role "conflictdb_reader" does not exist' in restored.stderr
    with psycopg.connect(server.dsn) as conn:
        with pytest.raises(SchemaOutdated, match="lacks the rights and policies"):
            schema.check(conn)
        assert conn.execute("SELECT count(*) FROM pg_policy").fetchone() == (0,)
        assert conn.execute("SELECT count(*) FROM conflictdb.scene").fetchone() == (1,)
    assert schema.upgrade(server.dsn) == schema.head()
    assert rights(server) == before
    with connect(server.dsn) as db:
        assert [one.scene.name for one in db.scenes()] == ["s"]


def test_a_restore_without_the_workers_role_is_noticed(server: OwnServer) -> None:
    """Readers could read, but workers would see no protected scene."""
    before = rights(server)
    programs = server.programs
    dump = subprocess.run(
        [programs.bin / "pg_dump", "-Fc", "-d", server.dsn], env=programs.environ, check=True, capture_output=True
    ).stdout
    with psycopg.connect(server.dsn.replace("dbname=conflictdb", "dbname=postgres"), autocommit=True) as conn:
        conn.execute("DROP DATABASE conflictdb WITH (FORCE)")
        conn.execute("DROP ROLE conflictdb_worker")
        conn.execute("CREATE DATABASE conflictdb")
    subprocess.run(
        [programs.bin / "pg_restore", "-d", server.dsn],
        env=programs.environ,
        input=dump,
        capture_output=True,
        check=False,
    )
    with psycopg.connect(server.dsn) as conn, pytest.raises(SchemaOutdated, match="lacks the rights and policies"):
        schema.check(conn)
    schema.upgrade(server.dsn)
    assert rights(server) == before


@pytest.mark.parametrize(
    "loss", ["REVOKE conflictdb_reader FROM conflictdb_editor", "REVOKE conflictdb_editor FROM conflictdb_worker"]
)
def test_roles_made_by_hand_get_the_rights_of_the_former(server: OwnServer, loss: str) -> None:
    with psycopg.connect(server.dsn) as conn:
        conn.execute(loss.encode())
    with psycopg.connect(server.dsn) as conn, pytest.raises(SchemaOutdated, match="lacks the rights and policies"):
        schema.check(conn)
    schema.upgrade(server.dsn)
    with psycopg.connect(server.dsn) as conn:
        schema.check(conn)
        assert conn.execute("SELECT pg_has_role('conflictdb_worker', 'conflictdb_reader', 'USAGE')").fetchone() == (
            True,
        )


@pytest.mark.parametrize(
    "loss",
    [
        "GRANT EXECUTE ON FUNCTION conflictdb_internal._end_pieces TO PUBLIC",
        "REVOKE EXECUTE ON FUNCTION conflictdb.put_rule FROM conflictdb_editor",
        "REVOKE SELECT ON conflictdb.conflicts FROM conflictdb_reader",
        "REVOKE UPDATE (taken) ON conflictdb.admission_lock FROM conflictdb_editor",
        "DROP POLICY read ON conflictdb.area",
        "REVOKE USAGE ON SCHEMA conflictdb FROM conflictdb_reader",
    ],
)
def test_an_upgrade_restores_each_right(server: OwnServer, loss: str) -> None:
    before = rights(server)
    with psycopg.connect(server.dsn) as conn:
        conn.execute(loss.encode())
    assert rights(server) != before or "PUBLIC" in loss or "USAGE ON SCHEMA" in loss or "taken" in loss
    schema.upgrade(server.dsn)
    assert rights(server) == before
    with psycopg.connect(server.dsn) as conn:
        schema.check(conn)
