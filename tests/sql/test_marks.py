"""Every change of an object leaves a mark in its transaction, and nothing else does."""

from typing import Any

import psycopg
import pytest
from patience import WAIT_S

Conn = psycopg.Connection[Any]

AREA = "SELECT put_area('s', %s, ST_SetSRID(ST_MakeEnvelope(4, 57, 5, 58), 4326), p_floor_m => %s, p_name => %s)"
TRACK = "SELECT put_track('s', %s, 'SRID=4326;LINESTRING M(3 57 1000,4 57 2000)', rectangle_outline(9, 9, 9, 9), %s)"


@pytest.fixture
def scene(conn: Conn) -> Conn:
    conn.execute("SET search_path = conflictdb, conflictdb_internal, public")
    conn.execute("SELECT create_scene('s')")
    conn.execute(AREA, ["A", None, None])
    conn.execute(TRACK, ["T", None])
    return conn


def marks(conn: Conn) -> list[tuple[str, bool]]:
    """Return the keys of the marked objects ('-' for a removed one), and whether the mark has its object's version."""
    return conn.execute(
        """SELECT coalesce(a.key, t.key, '-'), coalesce(a.version, t.version) IS NOT DISTINCT FROM c.version
           FROM change c LEFT JOIN area a ON c.object_kind = 0 AND a.area_id = c.object_id
           LEFT JOIN track t ON c.object_kind = 1 AND t.track_id = c.object_id ORDER BY c.change_id"""
    ).fetchall()


def forget(conn: Conn) -> None:
    conn.execute("DELETE FROM change")


def test_new_objects_are_marked_with_their_version(scene: Conn) -> None:
    assert marks(scene) == [("A", True), ("T", True)]


def test_changed_content_gets_a_new_version_and_a_mark(scene: Conn) -> None:
    before = scene.execute("SELECT version FROM area").fetchone()
    forget(scene)
    scene.execute(AREA, ["A", -10, None])
    after = scene.execute("SELECT version FROM area").fetchone()
    assert before is not None
    assert after is not None
    assert after > before
    assert marks(scene) == [("A", True)]


def test_same_content_and_mere_names_leave_no_mark(scene: Conn) -> None:
    forget(scene)
    scene.execute(AREA, ["A", None, None])
    scene.execute(AREA, ["A", None, "other name"])
    scene.execute("UPDATE area SET properties = '{\"a\": 1}', version = 12345")
    scene.execute("UPDATE track SET key = key")
    assert marks(scene) == []
    assert scene.execute("SELECT name, version <> 12345 FROM area").fetchone() == ("other name", True)


def test_change_of_one_instant_by_a_microsecond_is_a_change(scene: Conn) -> None:
    forget(scene)
    scene.execute("UPDATE track SET path = 'SRID=4326;LINESTRING M(3 57 1000,4 57 2000.000001)'")
    assert marks(scene) == [("T", True)]


def test_removed_object_leaves_a_mark(scene: Conn) -> None:
    forget(scene)
    assert scene.execute("SELECT remove_object('s', 'T'), remove_object('s', 'nobody')").fetchone() == (True, False)
    assert marks(scene) == [("-", False)]


@pytest.mark.parametrize(
    ("setting", "value"), [("tolerance_m", "2"), ("separation_m", "5"), ("earth", "'sphere'"), ("method", "'screen'")]
)
def test_other_settings_mark_every_object(scene: Conn, setting: str, value: str) -> None:
    forget(scene)
    scene.execute(f"SELECT create_scene('s', p_{setting} => {value})".encode())
    assert sorted(key for key, _ in marks(scene)) == ["A", "T"]
    forget(scene)
    scene.execute(f"SELECT create_scene('s', p_{setting} => {value})".encode())
    scene.execute("UPDATE scene SET name = 'other'")
    assert marks(scene) == []


def test_bulk_statements_mark_every_row_once(scene: Conn) -> None:
    scene.execute(
        """INSERT INTO area (scene_id, key, footprint)
           SELECT a.scene_id, 'N' || n, a.footprint FROM area a, generate_series(1, 50) n"""
    )
    row = scene_id(scene), "C", "SRID=4326;MULTIPOLYGON(((0 0,1 0,1 1,0 0)))"
    with scene.cursor().copy("COPY area (scene_id, key, footprint) FROM STDIN") as copy:
        copy.write_row(row)
    assert len(marks(scene)) == 53
    forget(scene)
    scene.execute("UPDATE area SET floor_m = 3 WHERE key > 'N'")
    assert len(marks(scene)) == 50
    scene.execute("DELETE FROM area")
    assert len(marks(scene)) == 102
    assert scene.execute("SELECT array_agg(key) FROM object_key").fetchone() == (["T"],)


def test_swapped_and_moved_keys_stay_unique(scene: Conn) -> None:
    scene.execute(AREA, ["B", None, None])
    forget(scene)
    scene.execute("UPDATE area SET key = key || 'x'")
    scene.execute(TRACK, ["A", None])  # free again
    assert [key for key, _ in marks(scene)] == ["Ax", "Bx", "A"]
    with pytest.raises(psycopg.Error) as refused:
        scene.execute("UPDATE area SET key = 'T' WHERE key = 'Ax'")
    assert refused.value.sqlstate == "ZC007"


def test_object_cannot_move_to_another_scene(scene: Conn) -> None:
    scene.execute("SELECT create_scene('t')")
    with pytest.raises(psycopg.Error) as refused:
        scene.execute("UPDATE track SET scene_id = (SELECT scene_id FROM scene WHERE name = 't')")
    assert (refused.value.sqlstate, refused.value.diag.constraint_name) == ("ZC008", "object_stays")


def test_truncate_is_refused_because_it_would_leave_no_marks(scene: Conn) -> None:
    with pytest.raises(psycopg.errors.FeatureNotSupported):
        scene.execute("TRUNCATE area")


def test_removed_scene_takes_everything_with_it(scene: Conn) -> None:
    scene.execute("DELETE FROM scene")
    for table in ("area", "track", "change", "object_key", "piece", "conflict", "run"):
        assert scene.execute(f"SELECT count(*) FROM {table}".encode()).fetchone() == (0,)


def test_changes_and_requests_wake_listeners_once_per_transaction(scene: Conn, dsn: str) -> None:
    scene.commit()
    with psycopg.connect(dsn, autocommit=True) as listener:
        listener.execute("LISTEN conflictdb_request")
        scene.execute(AREA, ["A", -1, None])
        scene.execute(AREA, ["A", -2, None])
        scene.commit()
        scene.execute(AREA, ["A", -2, None])
        scene.commit()
        scene.execute("NOTIFY conflictdb_request, 'the last'")
        scene.commit()
        heard = [one.payload for one in listener.notifies(timeout=WAIT_S, stop_after=2)]
        assert heard == ["", "the last"]
        assert scene.execute("SELECT request_detection('s'), request_detection('s', true)").fetchone() == (2, 2)
        scene.commit()
        assert len(list(listener.notifies(timeout=WAIT_S, stop_after=1))) == 1


def test_a_question_wakes_a_worker_while_an_editor_has_not_committed(scene: Conn, dsn: str) -> None:
    """The editor would wake it at commit, perhaps much later."""
    scene.commit()
    with psycopg.connect(dsn, autocommit=True) as listener, psycopg.connect(dsn, autocommit=True) as asker:
        listener.execute("LISTEN conflictdb_request")
        scene.execute(AREA, ["A", -1, None])
        asker.execute("SELECT conflictdb.request_probe('s', ST_SetSRID(ST_MakeEnvelope(4, 57, 5, 58), 4326), NULL)")
        assert len(list(listener.notifies(timeout=WAIT_S, stop_after=1))) == 1


def scene_id(conn: Conn) -> int:
    row = conn.execute("SELECT scene_id FROM scene").fetchone()
    assert row is not None
    return int(row[0])


def test_growth_and_outlines_are_changes(scene: Conn) -> None:
    """Each leaves a mark and a new version; the same again leaves none."""
    put = "SELECT put_track('s', 'T', 'SRID=4326;LINESTRING M(3 57 1000,4 57 2000)', {o}, p_grow_mps => {g}"
    outline = "rectangle_outline(9, 9, 9, 9)"
    statements = [
        put.format(o=outline, g=0.5) + ")",
        put.format(o=outline, g=0.25) + ")",
        put.format(o="NULL", g=0) + f", p_outlines => ST_Collect({outline}, rectangle_outline(8, 9, 9, 9)))",
        put.format(o=outline, g=0) + ")",
    ]
    seen = set()
    for statement in statements:
        scene.execute("DELETE FROM change")
        scene.execute(statement.encode())
        assert marks(scene) == [("T", True)]
        seen.add(scene.execute("SELECT version FROM track").fetchone())
        scene.execute("DELETE FROM change")
        scene.execute(statement.encode())
        assert marks(scene) == []
    assert len(seen) == len(statements)


def test_full_detection_marks_only_objects_that_have_no_mark(scene: Conn) -> None:
    """A new scene has a mark for each object: a second one would be written, indexed and deleted for nothing."""
    cover = "SELECT _cover_all(scene_id) FROM scene"
    scene.execute(cover)
    assert marks(scene) == [("A", True), ("T", True)]
    scene.execute("DELETE FROM change WHERE object_kind = 0")
    scene.execute("UPDATE change SET with_number = 1")  # a mark of one pair does not stand for the object
    scene.execute(cover)
    covered = "SELECT object_kind FROM change WHERE is_covered AND with_number IS NULL ORDER BY 1"
    assert scene.execute(covered).fetchall() == [(0,), (1,)]
