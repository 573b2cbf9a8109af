"""What editors may write in columns that others rely on: nothing that hides conflicts, or acts in another's name."""

import threading
from contextlib import closing
from typing import Any

import psycopg
import pytest

from conflictdb.jobs import detect

Conn = psycopg.Connection[Any]

SQUARE = "SRID=4326;MULTIPOLYGON(((0 50, 1 50, 1 51, 0 51, 0 50)))"
TRACK = """
SELECT conflictdb.put_track('s', %s, 'SRID=4326;LINESTRING M (-1 50.5 1772323200, 2 50.5 1772409600)',
                            conflictdb.rectangle_outline(9, 9, 5, 5))
"""


@pytest.fixture
def scene(conn: Conn) -> Conn:
    """Return a connection to a database with scene s, of two editors."""
    conn.execute("CREATE ROLE alice IN ROLE conflictdb_editor; CREATE ROLE bob IN ROLE conflictdb_editor")
    conn.execute("SET ROLE alice")
    conn.execute("SELECT conflictdb.create_scene('s')")
    return conn


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("activations", ["{}", "{[2031-01-01,2031-01-02)}"])
def test_activations_of_a_schedule_are_those_of_its_expansion(conn: Conn, activations: str, late: bool) -> None:
    conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.put_area('s', 'A', %s)", [SQUARE])
    conn.execute("SET ROLE conflictdb_editor")
    conn.execute(
        """INSERT INTO conflictdb.area (scene_id, key, footprint, schedule, activations)
           SELECT scene_id, 'S', %s, '[{"periods": [["08:00", "16:00"]]}]', %s FROM conflictdb.scene""",
        [SQUARE, None if late else activations],
    )
    conn.execute("RESET ROLE")
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    if late:
        conn.execute("SET ROLE conflictdb_editor")
        conn.execute("UPDATE conflictdb.area SET activations = %s WHERE key = 'S'", [activations])
        conn.execute("RESET ROLE")
        conn.commit()
        detect.detect(conn, "s", jobs=1)
    found = conn.execute("SELECT a_key, b_key, lower(periods) < now() + interval '2 days' FROM conflictdb.conflicts")
    assert found.fetchall() == [("A", "S", True)]


def test_the_error_of_a_schedule_stays(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.put_area('s', 'A', %s)", [SQUARE])
    conn.execute("""SELECT conflictdb.put_area('s', 'S', %s, p_schedule => '[{"no": 1}]')""", [SQUARE])
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    conn.execute("SET ROLE conflictdb_editor")
    conn.execute("UPDATE conflictdb.area SET schedule_error = NULL")
    conn.execute("RESET ROLE")
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    assert conn.execute("SELECT verdict FROM conflictdb.conflicts").fetchall() == [("unresolved",)]


def test_admissions_go_on_whatever_the_lock_has_counted(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute("SET ROLE conflictdb_editor")
    conn.execute("INSERT INTO conflictdb.admission_lock SELECT scene_id, 9223372036854775807 FROM conflictdb.scene")
    for _ in range(2):
        conn.execute("SELECT conflictdb_internal._begin_admission('s', 1, '{}', NULL)")
    with pytest.raises(psycopg.errors.InsufficientPrivilege):
        conn.execute("UPDATE conflictdb.admission_lock SET scene_id = 7")
    conn.rollback()


@pytest.mark.parametrize(
    "part",
    [
        """INSERT INTO conflictdb.proposal_move (proposal_id, scene_id, track_id, key, version, planned, path, delay_s,
                                                 speed, clears, passes, explanation)
           SELECT p.proposal_id, p.scene_id, t.track_id, 'U', t.version, t.path, ST_Translate(t.path, 40, 0), 0, 1,
                  '{}', '[]', '' FROM conflictdb.proposal p, conflictdb.track t WHERE t.key = 'U'""",
        "INSERT INTO conflictdb.proposal_left SELECT proposal_id, scene_id, 'U', '{}' FROM conflictdb.proposal",
    ],
)
def test_nobody_adds_to_the_proposal_of_another(scene: Conn, part: str) -> None:
    scene.execute(TRACK.encode(), ["T"])
    scene.execute(TRACK.encode(), ["U"])
    scene.execute(
        """SELECT conflictdb_internal._put_proposal(s.scene_id, to_jsonb(b), 'total', 60, 60, true,
               '[{"key": "T", "times_us": [1772323260000000, 1772409660000000], "delay_s": 60, "speed": 1,
                  "clears": ["A"], "passes": [], "text": "T 1 min later"}]', '[]')
           FROM conflictdb.scene s, conflictdb_internal._proposal_basis(s.scene_id) b"""
    )
    scene.execute("RESET ROLE")
    scene.execute("SET ROLE bob")
    with pytest.raises(psycopg.errors.InsufficientPrivilege, match="by the transaction that makes it"):
        scene.execute(part.encode())
    scene.rollback()


def test_an_editor_does_not_make_a_foreign_table_compared_more_seldom(scene: Conn) -> None:
    scene.execute("RESET ROLE")
    scene.execute("CREATE SCHEMA m; CREATE TABLE m.ops (id text PRIMARY KEY, shape public.geometry)")
    scene.execute("SELECT conflictdb.attach('s', 'area', 'm.ops', %s, '1 s')", ['{"key": "id", "footprint": "shape"}'])
    scene.execute("SET ROLE bob")
    with pytest.raises(psycopg.Error, match="is written by role postgres alone"):
        scene.execute("UPDATE conflictdb.attachment SET every = '1000 years'")
    scene.rollback()


def test_no_table_is_attached_to_a_branch(scene: Conn) -> None:
    """Nobody could detach it, nor remove the parent."""
    scene.execute("SELECT conflictdb.create_branch('s', 'b')")
    with pytest.raises(psycopg.Error, match="cannot be changed"):
        scene.execute(
            """INSERT INTO conflictdb.attachment (scene_id, object_kind, table_schema, table_name, map,
                                                  identity_columns, has_triggers, every)
               SELECT scene_id, 0, 'x', 'y', '{}', '{}', false, '1 h' FROM conflictdb.scene WHERE name = 'b'"""
        )
    scene.rollback()


def test_a_merge_waits_for_an_edit_that_leaves_no_mark(conn: Conn, dsn: str) -> None:
    conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.put_area('s', 'A', %s)", [SQUARE])
    conn.execute("SELECT conflictdb.create_branch('s', 'b')")
    conn.execute("SELECT conflictdb.put_area('b', 'A', ST_Translate(%s::geometry, 1, 0))", [SQUARE])
    conn.commit()
    conn.execute(
        """UPDATE conflictdb.area a SET name = 'new' FROM conflictdb.scene s
           WHERE s.scene_id = a.scene_id AND s.name = 'b'"""
    )
    with closing(psycopg.connect(dsn, autocommit=True)) as other:
        merging = threading.Thread(target=other.execute, args=("SELECT conflictdb.merge_branch('b')",))
        merging.start()
        merging.join(0.5)
        conn.commit()
        merging.join()
    assert conn.execute("SELECT ST_XMin(footprint), name FROM conflictdb.area").fetchall() == [(1.0, "new")]
