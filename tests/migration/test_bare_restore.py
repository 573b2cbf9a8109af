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
ROLES = "conflictdb_reader, conflictdb_tracker, conflictdb_editor, conflictdb_worker"


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


ATTACHED = """
CREATE SCHEMA mission;
CREATE TABLE mission.day (id integer, on_day date, shape geometry) PARTITION BY LIST (id);
CREATE TABLE mission.day1 PARTITION OF mission.day FOR VALUES IN (1);
CREATE TABLE mission.day2 PARTITION OF mission.day FOR VALUES IN (2);
INSERT INTO mission.day SELECT i, '2026-01-01', ST_MakeEnvelope(8 + 0.1 * i, 57, 8.2 + 0.1 * i, 57.2, 4326)
FROM generate_series(1, 2) i;
CREATE TABLE mission.zone (id integer PRIMARY KEY, shape geometry);
INSERT INTO mission.zone SELECT 7, ST_MakeEnvelope(8, 57, 9, 58, 4326);
-- A dump creates it after all contents of tables.
CREATE MATERIALIZED VIEW mission.late AS SELECT 'L' || id AS id, shape FROM mission.zone GROUP BY zone.id;
CREATE TABLE mission.lost (id integer, shape geometry);
"""
RENAMED = """
ALTER TABLE mission.day RENAME TO days; CREATE TABLE mission.day AS SELECT 99 AS id, '2026-01-01'::date AS on_day, shape
FROM mission.zone;
DROP TABLE mission.lost;
"""
STATE = """
SELECT (SELECT array_agg((area_id, key) ORDER BY key)::text FROM conflictdb.area),
       (SELECT array_agg((conflict_id, a_key, b_key, acknowledged_for) ORDER BY conflict_id)::text
        FROM conflictdb.conflicts)
"""


@pytest.mark.parametrize("late", [False, True])
def test_a_restore_keeps_tables_attached(server: OwnServer, late: bool) -> None:
    """A dump writes names of tables, also of one that was renamed and not followed yet: they stay attached.

    late : with a table that is created only after its name is read, so that names count (attached_relation is empty)
    """
    conninfo, areas = server.dsn, {"key": "id", "footprint": "shape"}
    with psycopg.connect(conninfo) as conn:
        conn.execute(ATTACHED)
        conn.execute("SELECT conflictdb.create_scene('attached')")
    with connect(conninfo) as db:
        scene = db.scene("attached")
        scene.attach("area", "mission.day", {**areas, "start": "on_day::timestamp AT TIME ZONE 'UTC'"})
        scene.attach("area", "mission.lost", areas)
        scene.attach("area", "mission.late" if late else "mission.zone", areas)
        scene.detect()
        scene.acknowledge("1", "2", reason="known")
    with psycopg.connect(conninfo) as conn:
        if not late:
            conn.execute(RENAMED)
        before = conn.execute(STATE.encode()).fetchall()
    programs = server.programs
    dump = subprocess.run(
        [programs.bin / "pg_dump", "-Fc", "-d", conninfo], env=programs.environ, check=True, capture_output=True
    ).stdout
    with psycopg.connect(conninfo.replace("dbname=conflictdb", "dbname=postgres"), autocommit=True) as conn:
        conn.execute("DROP DATABASE conflictdb WITH (FORCE)")
        conn.execute(f"DROP ROLE {ROLES}".encode())
        conn.execute("CREATE DATABASE conflictdb")
    restored = subprocess.run(
        [programs.bin / "pg_restore", "-d", conninfo],
        env=programs.environ,
        input=dump,
        capture_output=True,
        check=False,
    )
    assert (b'relation "mission.late" does not exist' in restored.stderr) == late
    schema.upgrade(conninfo)
    with connect(conninfo) as db:
        if not late:
            remarks = {one.table: str(one.remark) for one in db.attachments()}
            assert {table for table, remark in remarks.items() if remark == "None"} == {"mission.days", "mission.zone"}
            assert "no longer exists" in remarks["mission.lost"]
            db.scene("attached").detach("mission.lost")
        db.scene("attached").detect()
        assert all(one.error is None and one.remark is None for one in db.attachments())
        assert db.scenes()[0].is_current
    with psycopg.connect(conninfo) as conn:
        assert conn.execute(STATE.encode()).fetchall() == before
        conn.execute(f"DELETE FROM mission.{'day' if late else 'days'} WHERE id = 2")
        if not late:
            conn.execute("DROP TABLE mission.day1")
    with connect(conninfo) as db:
        scene = db.scene("attached")
        scene.detect()
        with psycopg.connect(conninfo) as conn:
            left = conn.execute("SELECT array_agg(key ORDER BY key) FROM conflictdb.area").fetchone()
        assert left == (["1", "L7"] if late else ["7"],)
        for one in db.attachments():
            scene.detach(str(one.attachment_id))
    with psycopg.connect(conninfo) as conn:
        conn.execute("SELECT conflictdb.remove_scene('attached')")
        conn.execute("DROP SCHEMA mission CASCADE")


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
