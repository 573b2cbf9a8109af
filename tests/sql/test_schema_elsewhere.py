"""The schema works with PostGIS in a schema of its own, and survives dump and restore there."""

import os
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import psycopg
import pytest
from commands import runner
from databases import TestServer, client_programs
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from piecework import load
from psycopg import conninfo, sql

from conflictdb import store
from conflictdb.errors import SchemaOutdated
from conflictdb.jobs import detect, schema
from conflictdb.model.plans import EarthModel
from conflictdb.model.results import Conflict

Conn = psycopg.Connection[Any]
MIXED = replace(LOW_LATITUDE, changing_share=0.5)  # havens of every kind


@pytest.fixture
def elsewhere(_server: TestServer, elsewhere_template: str, worker_id: str) -> Iterator[str]:
    """Return how to connect to a database with PostGIS in schema "My GIS", off everybody's search path."""
    name = f"{_server.prefix}_{worker_id}_elsewhere"
    yield _server.clone(elsewhere_template, name)
    _server.drop(name)


@pytest.fixture
def restored(_server: TestServer, worker_id: str) -> Iterator[str]:
    """Return how to connect to an empty database."""
    name = f"{_server.prefix}_{worker_id}_restored"
    yield _server.clone("template0", name)
    _server.drop(name)


def use_everything(conn: Conn, name: str) -> list[Conflict]:
    """Detect and query a scene as every user would, with nothing but the default search path; return the conflicts."""
    detect.detect(conn, name, full=True, jobs=1)
    for query in (
        "SELECT * FROM conflictdb.conflicts_at(%s, '2026-03-01')",
        "SELECT * FROM conflictdb.conflicts_of(%s, 'A1')",
        "SELECT * FROM conflictdb.candidates(%s)",
        "SELECT conflictdb.haven_at(%s, 'T1', '2026-03-01 06:00+00')",
        """SELECT * FROM conflictdb.probe(%s, (SELECT footprint FROM conflictdb.area WHERE key = 'A1' LIMIT 1))""",
        """SELECT * FROM conflictdb.conflicts_within(
               %s, (SELECT footprint FROM conflictdb.area WHERE key = 'A1' LIMIT 1), '(,)')""",
    ):
        conn.execute(query.encode(), [name])
    conn.commit()
    return store.conflicts(conn, name, with_region=True)


@pytest.mark.parametrize("earth", list(EarthModel))
def test_postgis_may_live_in_another_schema(elsewhere: str, dsn: str, earth: EarthModel) -> None:
    scene, areas, tracks = plain_scene(MIXED, 41, 12, 12, earth)
    answers = []
    for where in (elsewhere, dsn):
        with store.connect(where) as conn:
            load(conn, scene, areas, tracks)
            answers.append(use_everything(conn, scene.name))
            put = "SELECT conflictdb.put_area(%s, 'X', (SELECT footprint FROM conflictdb.area LIMIT 1))"
            conn.execute(put, [scene.name])
            conn.execute("UPDATE conflictdb.area SET floor_m = 0")
            conn.commit()
    assert [(c.a_key, c.b_key, c.periods, c.region) for c in answers[0]] == [
        (c.a_key, c.b_key, c.periods, c.region) for c in answers[1]
    ]
    assert answers[0]


def test_dump_and_restore(elsewhere: str, restored: str) -> None:
    scene, areas, tracks = plain_scene(MIXED, 42, 12, 12)
    with store.connect(elsewhere) as conn:
        load(conn, scene, areas, tracks)
        before = use_everything(conn, scene.name)
        programs, environ = client_programs(conn)
    dump, restore = [programs / "pg_dump", "-Fc", "-d", elsewhere], [programs / "pg_restore", "-e", "-d", restored]
    archive = subprocess.run(dump, check=True, env=environ, stdout=subprocess.PIPE).stdout
    subprocess.run(restore, check=True, env=environ, input=archive)
    with store.connect(restored) as conn:
        schema.check(conn)
        assert store.conflicts(conn, scene.name, with_region=True) == before
        assert store.list_scenes(conn)[0].pending == 0
        again = use_everything(conn, scene.name)
    assert [(c.a_key, c.b_key, c.periods, c.region) for c in again] == [
        (c.a_key, c.b_key, c.periods, c.region) for c in before
    ]


def test_who_may_not_grant_the_use_of_postgis_is_told_what_to_ask_for(
    elsewhere: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The owner of our schema need not be that of PostGIS's."""
    asked = 'GRANT USAGE ON SCHEMA "My GIS" TO conflictdb_reader'
    run = runner(elsewhere, capsys)
    assert run("admin", "init").err == ""
    with psycopg.connect(elsewhere) as conn:
        conn.execute('REVOKE USAGE ON SCHEMA "My GIS" FROM conflictdb_reader')
    assert f"let an administrator run: {asked}" in run("admin", "init").err
    with psycopg.connect(elsewhere) as conn:
        conn.execute(asked)
    assert run("admin", "upgrade").err == ""


def test_an_installation_without_the_right_to_grant_succeeds_and_says_so(elsewhere: str) -> None:
    user = sql.Identifier(f"installer_{os.getpid()}")
    with psycopg.connect(elsewhere) as conn:
        conn.execute("DROP SCHEMA conflictdb, conflictdb_internal CASCADE")
        conn.execute('REVOKE USAGE ON SCHEMA "My GIS" FROM conflictdb_reader')
        conn.execute(sql.SQL("CREATE ROLE {}").format(user))
        conn.execute(sql.SQL('GRANT USAGE ON SCHEMA "My GIS" TO {}').format(user))
        conn.execute(sql.SQL("GRANT CREATE ON DATABASE {} TO {}").format(sql.Identifier(conn.info.dbname), user))
    try:
        schema.upgrade(conninfo.make_conninfo(elsewhere, options=f"-c role=installer_{os.getpid()}"))
        with psycopg.connect(elsewhere) as conn:
            assert schema.missing_grants(conn) == 'GRANT USAGE ON SCHEMA "My GIS" TO conflictdb_reader'
            assert schema.ungrantable_roles(conn) is None  # a superuser
            conn.execute(sql.SQL("SET ROLE {}").format(user))
            said = schema.ungrantable_roles(conn)
            assert said is not None
            assert said.startswith("the roles of conflictdb belong to the whole server")
            conn.execute("RESET ROLE")
            conn.execute(said.rpartition("run: ")[2].encode())
            conn.execute(sql.SQL("SET ROLE {}").format(user))
            assert schema.ungrantable_roles(conn) is None
            conn.execute("RESET ROLE")
    finally:
        with psycopg.connect(elsewhere) as conn:
            conn.execute(sql.SQL("DROP OWNED BY {}").format(user))
            conn.execute(sql.SQL("DROP ROLE {}").format(user))


@pytest.mark.parametrize("how", ["users", "replica", "without triggers"])
def test_restore_of_data_alone_into_a_schema_that_is_there(elsewhere: str, restored: str, how: str) -> None:
    """All that it brings waits for detection, or, without triggers, is as it was in the dump."""
    scene, areas, tracks = plain_scene(MIXED, 42, 8, 8)
    with store.connect(elsewhere) as conn:
        load(conn, scene, areas, tracks)
        before = use_everything(conn, scene.name)
        conn.execute("SELECT conflictdb.remove_object(%s, 'A0')", [scene.name])
        conn.commit()
        programs, environ = client_programs(conn)
    with psycopg.connect(restored) as conn:
        conn.execute('CREATE SCHEMA "My GIS"')
        conn.execute('CREATE EXTENSION postgis SCHEMA "My GIS"')
        conn.execute('CREATE EXTENSION btree_gist SCHEMA "My GIS"')
    schema.upgrade(restored)
    dump = [programs / "pg_dump", "-Fc", "--data-only", "-n", "conflictdb", "-T", "conflictdb.alembic_version"]
    archive = subprocess.run([*dump, "-d", elsewhere], check=True, env=environ, stdout=subprocess.PIPE).stdout
    target = restored
    if how == "replica":
        target = conninfo.make_conninfo(restored, options="-c session_replication_role=replica")
    restore = [programs / "pg_restore", "-e", "--data-only", "-d", target]
    if how == "without triggers":
        restore.insert(2, "--disable-triggers")
    subprocess.run(restore, check=True, env=environ, input=archive)
    if how == "without triggers":
        with psycopg.connect(restored) as conn, pytest.raises(SchemaOutdated, match="a restore has reset"):
            schema.check(conn)
        schema.upgrade(restored)
    with store.connect(restored) as conn:
        schema.check(conn)
        (status,) = store.list_scenes(conn)
        assert (status.areas, status.tracks, status.is_current) == (7, 8, False)
        # 15 objects, and the one whose removal waited already.
        assert status.pending == (1 if how == "without triggers" else 16)
        detect.detect(conn, scene.name, jobs=1)
        conn.execute("UPDATE conflictdb.track SET floor_m = NULL, ceiling_m = 1e5 WHERE key = 'T1'")
        assert store.list_scenes(conn)[0].pending == 1
        conn.commit()
        again = use_everything(conn, scene.name)
    kept = {(c.a_key, c.b_key) for c in before if "A0" not in (c.a_key, c.b_key)}
    assert kept
    assert kept <= {(c.a_key, c.b_key) for c in again}
