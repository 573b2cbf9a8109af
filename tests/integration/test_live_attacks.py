"""Looks at positions beside whatever else happens: removed and renamed scenes and objects, odd clocks and sessions."""

import threading
from datetime import UTC, datetime, timedelta
from typing import Any

import psycopg
import pytest
from patience import WAIT_S, until_blocked

from conflictdb import Scene, Track, connect, rectangle_outline_m, store
from conflictdb.jobs import detect
from conflictdb.jobs.looks import Looks

Conn = psycopg.Connection[Any]
BEGAN = datetime.now(UTC).replace(microsecond=0) - timedelta(minutes=30)


def us(minute: float) -> int:
    return int((BEGAN + timedelta(minutes=minute)).timestamp() * 1e6)


def plans() -> list[Track]:
    """Return a ferry that passes a crossing 10 minutes before a tow, both at a mile a minute."""
    side = rectangle_outline_m(500, 500, 500, 500)
    ferry = Track("FERRY", [(0.0, 0.0), (1.0, 0.0)], [us(0), us(60)], side)
    return [ferry, Track("TOW", [(0.5, -0.5), (0.5, 0.5)], [us(10), us(70)], side)]


@pytest.fixture
def sea(conn: Conn) -> Conn:
    store.replace_scene(conn, Scene("s", delays_within_s=3600), [], plans(), merge=False)
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    return conn


def put(conn: Conn, minute: float, late_min: float, key: str = "FERRY", scene: str = "s") -> None:
    """Insert a position of the ferry that is some minutes late."""
    conn.execute(
        "INSERT INTO conflictdb.position (scene, key, instant, place) "
        "VALUES (%s, %s, %s, ST_SetSRID(ST_MakePoint(%s, 0), 4326))",
        [scene, key, BEGAN + timedelta(minutes=minute), (minute - late_min) / 60],
    )


def look(conn: Conn, minute: float, looks: Looks | None = None) -> dict[tuple[str, str | None], tuple[str, int]]:
    """Look as a worker does; return the verdicts and numbers of alarms."""
    conn.commit()
    (looks or Looks()).look(conn, us(minute), is_silence_due=True)
    rows = conn.execute("SELECT key, other_key, verdict, alarm_id FROM conflictdb.live_conflicts").fetchall()
    conn.commit()
    return {row[:2]: row[2:] for row in rows}


def begun(conn: Conn) -> list[tuple[Any, ...]]:
    """Return which alarms began and ended."""
    found = conn.execute("SELECT kind, key, other_key FROM conflictdb.live_events ORDER BY event").fetchall()
    conn.commit()
    return found


@pytest.mark.parametrize("after", ["put_live", "unheard"])
def test_a_scene_is_removed_while_a_look_stores_its_alarms(
    sea: Conn, dsn: str, monkeypatch: pytest.MonkeyPatch, after: str
) -> None:
    """Who removes it waits for the look, which had waited for the removal in turn."""
    put(sea, 20, 0)
    look(sea, 20)
    put(sea, 28, 10)
    if after == "unheard":
        look(sea, 28)
        sea.execute("SELECT conflictdb.remove_object('s', 'FERRY')")
    sea.commit()
    failed: list[Exception] = []

    def remove() -> None:
        try:
            with psycopg.connect(dsn) as other:
                other.execute("SELECT conflictdb.remove_scene('s')")
        except psycopg.Error as error:
            failed.append(error)

    thread = threading.Thread(target=remove)
    whole = getattr(store, after)

    def then_removed(*given: Any) -> Any:
        found = whole(*given)
        if not thread.ident:
            thread.start()
            with psycopg.connect(dsn) as watcher:
                until_blocked(watcher, sea)
        return found

    with monkeypatch.context() as patched:
        patched.setattr(store, after, then_removed)
        Looks().look(sea, us(29), is_silence_due=True)
    thread.join(WAIT_S)
    assert failed == []
    assert look(sea, 29) == {}
    assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (0,)


def test_a_scene_that_is_being_removed_is_left_out_of_the_search_for_silence(sea: Conn, dsn: str) -> None:
    """Its open transaction stops no look at other scenes; if it is rolled back, the scene is looked at again."""
    store.replace_scene(sea, Scene("t", delays_within_s=3600), [], plans(), merge=False)
    sea.commit()
    detect.detect(sea, "t", jobs=1)
    for scene in ("s", "t"):
        put(sea, 10, 0, scene=scene)
    look(sea, 10)
    states = "SELECT scene, state FROM conflictdb.live ORDER BY scene"
    with psycopg.connect(dsn) as other:
        other.execute("SELECT conflictdb.rename_scene('s', 'r')")
        sea.execute("SET lock_timeout = '20s'")
        look(sea, 25)
        assert sea.execute(states).fetchall() == [("s", "on plan"), ("t", "silent")]
        other.rollback()
    look(sea, 25)
    assert sea.execute(states).fetchall() == [("s", "silent"), ("t", "silent")]
