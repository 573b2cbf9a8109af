"""Readers query, editors change the input, workers keep the rest; nobody else may do anything."""

from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from piecework import load
from psycopg import conninfo, sql
from workloads import PAPER, throw

from conflictdb import detect, store
from conflictdb.errors import StoreError
from conflictdb.model import Scene

Conn = psycopg.Connection[Any]

ROLES = ("conflictdb_reader", "conflictdb_editor", "conflictdb_worker")


@pytest.fixture
def scene(conn: Conn) -> Scene:
    scene, areas, tracks = throw(PAPER, 31, 8, 8)
    load(conn, scene, areas, tracks)
    detect.detect(conn, scene.name, jobs=1)
    return scene


@pytest.fixture
def acting(conn: Conn, dsn: str) -> Iterator[Any]:
    """Return a function that gives a connection of a user who has one role only."""
    made: list[tuple[Conn, str]] = []

    def act(role: str) -> Conn:
        user = f"{role}_{conn.info.dbname}"
        conn.execute(sql.SQL("CREATE ROLE {} LOGIN").format(sql.Identifier(user)))
        if role != "stranger":
            conn.execute(sql.SQL("GRANT {} TO {}").format(sql.Identifier(role), sql.Identifier(user)))
        conn.commit()
        try:
            connection = psycopg.connect(conninfo.make_conninfo(dsn, user=user))
        except psycopg.OperationalError:
            # A server that asks for passwords: the next best thing.
            connection = psycopg.connect(dsn)
            connection.execute(sql.SQL("SET SESSION AUTHORIZATION {}").format(sql.Identifier(user)))
            connection.commit()
        made.append((connection, user))
        return connection

    yield act
    conn.rollback()
    for connection, user in made:
        connection.close()
        conn.execute(sql.SQL("DROP OWNED BY {0}").format(sql.Identifier(user)))
        conn.execute(sql.SQL("DROP ROLE {0}").format(sql.Identifier(user)))
    conn.commit()


def refused(conn: Conn, statement: str, *arguments: object) -> None:
    with pytest.raises(psycopg.errors.InsufficientPrivilege):
        conn.execute(statement.encode(), arguments)
    conn.rollback()


EDITS = [
    "SELECT conflictdb.create_scene('new')",
    "SELECT conflictdb.remove_object('x', 'A1')",
    "SELECT conflictdb.request_detection('x')",
    "INSERT INTO conflictdb.scene (name) VALUES ('new')",
    "UPDATE conflictdb.area SET floor_m = 1",
    "DELETE FROM conflictdb.track",
]
DERIVED = [
    "DELETE FROM conflictdb.piece",
    "UPDATE conflictdb.conflict SET verdict = 'grazing'",
    "DELETE FROM conflictdb.change",
    "UPDATE conflictdb.run SET error = ''",
]
KEPT_BY_TRIGGERS = ["DELETE FROM conflictdb.object_key"]
QUERIES = [
    "SELECT * FROM conflictdb.conflicts",
    "SELECT * FROM conflictdb.conflicts_at(%s, '2026-03-01')",
    "SELECT * FROM conflictdb.conflicts_of(%s, 'A1')",
    "SELECT * FROM conflictdb.conflicts_within(%s, 'SRID=4326;POINT(0 0)', '(,)')",
    "SELECT * FROM conflictdb.candidates(%s)",
    "SELECT * FROM conflictdb.probe(%s, 'SRID=4326;POINT(0 0)')",
    "SELECT conflictdb.haven_at(%s, 'T1', '2026-03-01')",
]


def test_reader_queries_and_changes_nothing(acting: Any, scene: Scene) -> None:
    conn = acting("conflictdb_reader")
    for query in QUERIES:
        conn.execute(query.encode(), [scene.name] if "%s" in query else [])
    assert store.conflicts(conn, scene.name, with_region=True)
    assert store.list_scenes(conn)[0].areas == 8
    assert len(store.read_scene(conn, scene.name)[2]) == 8
    conn.commit()
    for statement in EDITS + DERIVED + KEPT_BY_TRIGGERS:
        refused(conn, statement)


def test_editor_changes_the_input_and_leaves_marks_it_cannot_touch(acting: Any, scene: Scene) -> None:
    conn = acting("conflictdb_editor")
    _, areas, tracks = throw(PAPER, 32, 9, 9)
    counts = store.replace_scene(conn, scene, areas, tracks, merge=False)
    assert counts.added == 2
    conn.execute("SELECT conflictdb.remove_object(%s, 'A0')", [scene.name])
    conn.execute("UPDATE conflictdb.area SET ceiling_m = 1e5")
    assert conn.execute("SELECT conflictdb.request_detection(%s)", [scene.name]).fetchone() == (18,)
    conn.commit()
    for statement in DERIVED + KEPT_BY_TRIGGERS:
        refused(conn, statement)
    refused(conn, "TRUNCATE conflictdb.area")
    with pytest.raises(StoreError, match="permission denied"):
        detect.detect(conn, scene.name, jobs=1)


def test_worker_detects(acting: Any, scene: Scene) -> None:
    conn = acting("conflictdb_worker")
    assert detect.detect(conn, scene.name, full=True, jobs=1).conflicts > 0
    assert store.list_scenes(conn)[0].pending == 0
    for statement in KEPT_BY_TRIGGERS:
        refused(conn, statement)


def test_stranger_may_do_nothing(acting: Any, scene: Scene) -> None:
    conn = acting("stranger")
    for statement in EDITS + DERIVED + [query.replace("%s", "'x'") for query in QUERIES]:
        refused(conn, statement)


def test_nothing_is_granted_to_public(conn: Conn) -> None:
    public = conn.execute(
        """SELECT 'routine', p.oid::regprocedure::text
           FROM pg_proc p, LATERAL aclexplode(coalesce(p.proacl, acldefault('f', p.proowner))) x
           WHERE p.pronamespace = 'conflictdb'::regnamespace AND x.grantee = 0
           UNION ALL
           SELECT 'relation', c.oid::regclass::text
           FROM pg_class c, LATERAL aclexplode(c.relacl) x
           WHERE c.relnamespace = 'conflictdb'::regnamespace AND x.grantee = 0
           UNION ALL
           SELECT 'schema', n.nspname FROM pg_namespace n, LATERAL aclexplode(n.nspacl) x
           WHERE n.nspname = 'conflictdb' AND x.grantee = 0"""
    ).fetchall()
    assert public == []


def test_what_runs_as_its_owner_pins_its_search_path(conn: Conn) -> None:
    """A SECURITY DEFINER routine must not look names up where its caller can put something."""
    routines = conn.execute(
        """SELECT proname, proconfig FROM pg_proc
           WHERE pronamespace = 'conflictdb'::regnamespace AND prosecdef ORDER BY proname"""
    ).fetchall()
    assert [name for name, _ in routines] == [
        "_after_object_change", "_after_scene_change", "_end_pieces", "_scene_holders", "request_detection",
    ]  # fmt: skip
    for _, settings in routines:
        assert any(s.startswith("search_path=conflictdb, ") and s.endswith("pg_temp") for s in settings)
