"""The view `queue`: scenes that wait for detection, since when, and their workers."""

from typing import Any

import psycopg
import pytest
from commands import STRAIT

from conflictdb import connect, store
from conflictdb.jobs import follow_attached as attached
from conflictdb.jobs.detect import detect

Conn = psycopg.Connection[Any]


def queue(conn: Conn, columns: str) -> list[tuple[Any, ...]]:
    """Return the rows of the view, as a transaction of its own sees them."""
    with conn.transaction():
        return conn.execute(f"SELECT {columns} FROM conflictdb.queue ORDER BY waiting_since".encode()).fetchall()


@pytest.fixture
def loaded(conn: Conn, dsn: str) -> Conn:
    """Two scenes of eleven objects, one after the other."""
    with connect(dsn) as db:
        db.load(STRAIT, "second")
        db.load(STRAIT, "first")
    conn.execute(
        "UPDATE conflictdb.change c SET changed_at = '2026-03-01' FROM conflictdb.scene s "
        "WHERE s.scene_id = c.scene_id AND s.name = 'first'"
    )
    conn.execute("UPDATE conflictdb.area SET ceiling_m = 9 WHERE key = 'DIVING'")
    conn.commit()
    return conn


def test_it_lists_what_waits_and_nothing_else(loaded: Conn) -> None:
    """An object that changed twice is one; the longest waiting has waited since its first change."""
    assert queue(loaded, "scene, changes, attached_changes, worker_pid, last_error") == [
        ("first", 11, 0, None, None),
        ("second", 11, 0, None, None),
    ]
    assert queue(loaded, "waiting_since = '2026-03-01', waiting_since > now() - interval '1 h'") == [
        (True, False),
        (False, True),
    ]
    assert list(store.waiting_scenes(loaded)) == ["first", "second"]
    detect(loaded, "first", jobs=1)
    assert queue(loaded, "scene") == [("second",)]
    detect(loaded, "second", jobs=1)
    assert queue(loaded, "scene") == []
    assert store.waiting_scenes(loaded) == {}


def test_it_tells_who_works_on_a_scene_and_what_went_wrong(loaded: Conn, dsn: str) -> None:
    with store.connect(store.worker_dsn(dsn)) as worker:
        store.begin_locked(worker, store.scene_id(worker, "second"), "second", 0.0, print)
        shown = "scene, worker_pid, worker, worker_role = current_user, worked_on_since <= clock_timestamp()"
        assert queue(loaded, shown) == [
            ("first", None, None, None, None),
            ("second", worker.info.backend_pid, store.WORKER_NAME, True, True),
        ]
    loaded.execute(
        "INSERT INTO conflictdb.run (scene_id, started_at, finished_at, method, settings, objects, error) "
        "SELECT scene_id, now(), now(), 'exact', '{}', 0, 'no luck' FROM conflictdb.scene WHERE name = 'first'"
    )
    loaded.commit()
    assert queue(loaded, "scene, worker_pid, last_error") == [("first", None, "no luck"), ("second", None, None)]


def test_no_clock_that_was_put_back_makes_a_wait_negative(loaded: Conn) -> None:
    loaded.execute("UPDATE conflictdb.change SET changed_at = now() + interval '1 day'")
    loaded.commit()
    assert store.waiting_scenes(loaded) == {"second": 0.0, "first": 0.0}


def test_changes_of_attached_tables_wait_too(conn: Conn) -> None:
    conn.execute("CREATE TABLE zone (id text PRIMARY KEY, shape geometry(Polygon, 4326))")
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute("SELECT conflictdb.attach('s', 'area', 'zone', '{\"key\": \"id\", \"footprint\": \"shape\"}')")
    conn.execute("INSERT INTO zone VALUES ('Z', ST_MakeEnvelope(0, 50, 1, 51, 4326))")
    conn.commit()
    ((scene, changes, attached),) = queue(conn, "scene, changes, attached_changes")
    assert (scene, changes, attached > 0) == ("s", 0, True)


def test_no_clock_that_was_put_back_keeps_a_table_from_being_followed(conn: Conn) -> None:
    """Whether it was last compared, or could not be read, far ahead of now."""
    conn.execute("CREATE TABLE zone (id text PRIMARY KEY, shape geometry(Polygon, 4326))")
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute(
        "SELECT conflictdb.attach('s', 'area', 'zone', '{\"key\": \"id\", \"footprint\": \"shape\"}', '5 min')"
    )
    conn.commit()
    attached.follow(conn, "s", again=True)
    assert store.waiting_scenes(conn) == {}
    conn.execute("UPDATE conflictdb.attachment SET compared_at = now() + interval '1 day'")
    conn.commit()
    assert list(store.waiting_scenes(conn)) == ["s"]
    for ahead, left_alone in (("1 second", True), ("1 day", False)):
        conn.execute("UPDATE conflictdb.attachment SET failed_at = now() + %s::interval, error = 'no luck'", [ahead])
        conn.commit()
        assert (store.waiting_scenes(conn) == {}) == left_alone
        assert (store.attachments_to_follow(conn, "s", again=False) == []) == left_alone
