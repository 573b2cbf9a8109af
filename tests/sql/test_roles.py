"""Readers query, editors change the input, workers update the rest; other roles may do nothing."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psycopg
import pytest
from databases import TestServer
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from piecework import load
from psycopg import conninfo, sql

from conflictdb import connect, store
from conflictdb.errors import StoreError
from conflictdb.jobs import detect
from conflictdb.model.plans import Scene

Conn = psycopg.Connection[Any]


@pytest.fixture(params=["public", "My GIS"])
def dsn(
    _server: TestServer, template: str, elsewhere_template: str, _fresh_name: str, request: pytest.FixtureRequest
) -> Iterator[str]:
    """Return how to connect to a fresh database whose PostGIS is in this schema."""
    yield _server.clone(template if request.param == "public" else elsewhere_template, _fresh_name)
    _server.drop(_fresh_name)


@pytest.fixture
def scene(conn: Conn) -> Scene:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 31, 8, 8)
    load(conn, scene, areas, tracks)
    detect.detect(conn, scene.name, jobs=1)
    return scene


@pytest.fixture
def acting(conn: Conn, dsn: str) -> Iterator[Any]:
    """Return a function that connects as a user with a single role."""
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
    "SELECT conflictdb.explain_conflict_text(%s, 'T1', 'A1')",
    "SELECT * FROM conflictdb.havens(%s, '2026-03-01', '2026-03-02', '6 h')",
    "SELECT * FROM conflictdb.queue",
]


PUTS = [
    """SELECT conflictdb.put_area(%s, 'AX', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))', '[2026-03-01 00:00Z,)',
       p_floor_m => 0, p_ceiling_m => 9)""",
    """SELECT conflictdb.put_track(%s, 'TX', conflictdb.track_path('SRID=4326;LINESTRING(0 0, 1 1)',
       ARRAY['2026-03-01 00:00Z', '2026-03-01 05:00Z']::timestamptz[]), conflictdb.rectangle_outline(9, 9, 5, 5),
       p_grow_mps => 0.1)""",
    """SELECT conflictdb.put_track(%s, 'TY', 'SRID=4326;LINESTRING M (0 0 0, 1 1 3600)', NULL, p_outlines =>
       'MULTIPOLYGON(((0 0, 1 0, 1 1, 0 0)), ((0 0, 2 0, 2 2, 0 0)))')""",
]


def test_reader_queries_and_changes_nothing(acting: Any, scene: Scene, tmp_path: Path) -> None:
    conn = acting("conflictdb_reader")
    first = """SELECT lower(p.span) FROM conflictdb.piece p
               JOIN conflictdb.track t ON p.object_kind = 1 AND t.track_id = p.object_id
               WHERE t.key = 'T1' ORDER BY p.span LIMIT 1"""
    ((starts,),) = conn.execute(first).fetchall()
    in_track = [scene.name, starts]
    for query in QUERIES:
        conn.execute(query.encode(), [scene.name] if "%s" in query else [])
    assert store.conflicts(conn, scene.name, with_region=True)
    assert store.list_scenes(conn)[0].areas == 8
    assert len(store.read_scene(conn, scene.name)[2]) == 8
    assert conn.execute("SELECT count(region) FROM conflictdb.conflicts").fetchone() != (0,)
    assert conn.execute("SELECT count(haven) FROM conflictdb.haven_at(%s, 'T1', %s) haven", in_track).fetchone() == (1,)
    asked = "SELECT count(region) FROM conflictdb.{}(%s, (SELECT footprint FROM conflictdb.area WHERE key = 'A1'){})"
    for function, more in (("probe", ""), ("conflicts_within", ", '(,)'")):
        conn.execute(asked.format(function, more).encode(), [scene.name])
    conn.commit()
    with connect(conn) as db:
        db.scene(scene.name).export(tmp_path / "scene.geojson")
        assert db.scene(scene.name).advise(sample=5).estimates
        assert db.scene(scene.name).approaches()
        assert db.status().scenes[0].conflicts == len(db.scene(scene.name).conflicts())
    for statement in EDITS + DERIVED + KEPT_BY_TRIGGERS:
        refused(conn, statement)


def test_editor_changes_the_input_and_leaves_marks_it_cannot_touch(acting: Any, scene: Scene) -> None:
    conn = acting("conflictdb_editor")
    _, areas, tracks = plain_scene(LOW_LATITUDE, 32, 9, 9)
    counts = store.replace_scene(conn, scene, areas, tracks, merge=False)
    assert counts.added == 2
    conn.execute("SELECT conflictdb.remove_object(%s, 'A0')", [scene.name])
    conn.execute("UPDATE conflictdb.area SET ceiling_m = 1e5")
    for put in PUTS:
        conn.execute(put.encode(), [scene.name])
    conn.execute("SELECT conflictdb.create_scene(%s, 'great_circle')", [scene.name + " round"])
    for put in PUTS:
        conn.execute(put.encode(), [scene.name + " round"])
    with pytest.raises(psycopg.Error, match="valid"), conn.transaction():
        conn.execute(PUTS[0].replace("1 1, 0 1", "0 1, 1 1").encode(), [scene.name])
    for key in ("AX", "TX", "TY"):
        conn.execute("SELECT conflictdb.remove_object(%s, %s)", [scene.name, key])
    conn.execute("UPDATE conflictdb.scene SET tolerance_m = 2 WHERE name = %s", [scene.name])
    conn.execute("UPDATE conflictdb.scene SET tolerance_m = 1 WHERE name = %s", [scene.name])
    # 18 objects, and temporary ones.
    assert conn.execute("SELECT conflictdb.request_detection(%s)", [scene.name]).fetchone() == (21,)
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
           WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND x.grantee = 0
           UNION ALL
           SELECT 'relation', c.oid::regclass::text
           FROM pg_class c, LATERAL aclexplode(c.relacl) x
           WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND x.grantee = 0
           UNION ALL
           SELECT 'schema', n.nspname FROM pg_namespace n, LATERAL aclexplode(n.nspacl) x
           WHERE n.nspname IN ('conflictdb', 'conflictdb_internal') AND x.grantee = 0"""
    ).fetchall()
    assert public == []


def test_what_runs_as_its_owner_pins_its_search_path(conn: Conn) -> None:
    """A SECURITY DEFINER routine must not look names up where its caller can put something."""
    routines = conn.execute(
        """SELECT proname, proconfig FROM pg_proc
           WHERE pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
                 AND prosecdef ORDER BY proname"""
    ).fetchall()
    assert [name for name, _ in routines] == [
        "_admission_holders", "_after_attachment_opened", "_after_attachment_removal", "_after_branch",
        "_after_branch_edit", "_after_object_change", "_after_positions",
        "_after_replicated_object", "_after_replicated_removal", "_after_replicated_rule",
        "_after_rule_change", "_after_scene_change", "_after_scene_removal", "_after_scene_resettled",
        "_after_scene_with_positions", "_after_track_with_positions", "_branch_edit_before", "_close_attached_schema",
        "_create_note", "_end_pieces",
        "_first_version", "_free_attached_name", "_free_orphan_name", "_note_branch_edits", "_note_edits",
        "_note_rule_edits", "_note_scene_edit", "_open_attached_schema", "_position_before", "_prune_probes",
        "_scene_holders", "_seal_batch",
    ]  # fmt: skip
    for _, settings in routines:
        assert "search_path=conflictdb, conflictdb_internal, pg_temp" in settings
