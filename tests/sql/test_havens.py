"""havens has exactly the rows of haven_at and heights_at of all tracks, at all instants."""

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
from layouts import ARCTIC, GROWING, GROWING_CIRCLES, SEAM
from mixed_scenes import plain_scene
from piecework import load

from conflictdb.model.plans import Motion, Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
T0_US = 1_772_323_200_000_000
HOUR_US = 3_600_000_000
CIRCLES = Scene("s", Motion.GREAT_CIRCLE, centre=(0.0, 50.0))
ONE_BY_ONE = """
SELECT t.key, i.at, conflictdb.haven_at(s.name, t.key, i.at)::text, h.floor_m, h.ceiling_m
FROM conflictdb.scene s JOIN conflictdb.track t USING (scene_id)
CROSS JOIN generate_series(%s::timestamptz, %s, %s) i (at) CROSS JOIN conflictdb.heights_at(s.name, t.key, i.at) h
WHERE conflictdb.haven_at(s.name, t.key, i.at) IS NOT NULL
ORDER BY t.key, i.at
"""
ALL = "SELECT key, at, haven::text, floor_m, ceiling_m FROM conflictdb.havens(%s, %s, %s, %s)"


def instant(us: int) -> datetime:
    return EPOCH + timedelta(microseconds=us)


def assert_same(conn: Conn, scene: str, first_us: int, last_us: int, step: timedelta) -> int:
    """Compare with one haven at a time, to the bit, and return their number."""
    asked = [instant(first_us), instant(last_us), step]
    found = conn.execute(ALL, [scene, *asked]).fetchall()
    assert found == conn.execute(ONE_BY_ONE, asked).fetchall()
    return len(found)


@pytest.mark.parametrize("workload", [SEAM, GROWING, ARCTIC, GROWING_CIRCLES], ids=lambda w: w.name)
def test_havens_are_those_at_each_instant(conn: Conn, workload: Any) -> None:
    """Across the seam, around the pole, also of havens that grow."""
    scene, _, tracks = plain_scene(workload, 5, 0, 6)
    load(conn, scene, [], tracks)
    first, last = min(int(t.times_us[0]) for t in tracks), max(int(t.times_us[-1]) for t in tracks)
    step = timedelta(microseconds=(last - first) // 9)
    assert assert_same(conn, scene.name, first - HOUR_US, last + HOUR_US, step) > 10


@pytest.mark.parametrize("settings", [Scene("s"), CIRCLES], ids=["rhumb", "great circle"])
def test_at_waypoints_and_in_loiters(conn: Conn, settings: Scene) -> None:
    """A waypoint has the haven of the leg it starts and the heights of both; loiters have the heading of another."""
    outline = rectangle_outline_m(1000, 0, 300, 0)
    times = T0_US + HOUR_US * np.arange(6)
    around = [[0.0, 50.0], [0.0, 50.0], [50.0, 50.0], [50.0, 50.0], [410.0 - 360.0, 50.0], [50.0, 60.0]]
    heights = {"floors_m": np.arange(5.0) * 100, "ceilings_m": np.arange(5.0) * 100 + 50}
    tracks = [
        Track("came", np.array(around), times, outline, **heights),
        Track("leaves", np.array([around[0]] * 4 + around[2:4]), times, outline),
        Track("stays", np.array([around[0]] * 6), times, outline),
    ]
    load(conn, settings, [], tracks)
    count = assert_same(conn, "s", T0_US, T0_US + 5 * HOUR_US, timedelta(minutes=20))
    assert count == 3 * 15  # the last instant belongs to none
    assert_same(conn, "s", T0_US - HOUR_US, T0_US + 9 * HOUR_US, timedelta(minutes=7))


def test_loiters_have_the_heading_that_the_whole_path_gives_them(conn: Conn) -> None:
    """Several loiters in a row, and at the pole, where every longitude is the same place."""
    outline = np.array([[0.0, 0.0], [0.0, 1000.0]])
    times = T0_US + HOUR_US * np.arange(4)
    load(conn, Scene("s", Motion.GREAT_CIRCLE, centre=(0.0, 80.0)), [], [
        Track("T", np.array([[20.0, 90.0], [110.0, 90.0], [200.0, 90.0], [200.0, 80.0]]), times, outline),
    ])  # fmt: skip
    rows = conn.execute(ALL, ["s", instant(T0_US), instant(T0_US + 2 * HOUR_US), "1 hour"]).fetchall()
    assert len({haven for _, _, haven, *_ in rows}) == 1  # towards 200 degrees, while it waits and when it leaves


def test_steps_are_those_of_generate_series_in_any_session(conn: Conn) -> None:
    load(conn, Scene("s"), [], [
        Track("T", np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([T0_US, T0_US + 40 * 24 * HOUR_US]), np.zeros((1, 2))),
    ])  # fmt: skip
    conn.execute("SET TimeZone = 'Europe/Copenhagen'")
    days = [T0_US, T0_US + 60 * 24 * HOUR_US]
    assert assert_same(conn, "s", *days, timedelta(days=1)) == 41  # a day has 23 hours
    conn.execute("SET DateStyle = 'SQL, DMY'; SET IntervalStyle = 'iso_8601'")
    count = "SELECT count(*) FROM conflictdb.havens('s', to_timestamp(%s), to_timestamp(%s), 'P1D')"
    assert conn.execute(count, [us / 1e6 for us in days]).fetchone() == (41,)


def test_more_rows_than_a_map_holds_are_refused_before_they_are_made(conn: Conn) -> None:
    times = np.array([T0_US, T0_US + HOUR_US])
    tracks = [Track(f"T{n}", np.array([[0.0, 0.0], [1.0, 0.0]]), times, np.zeros((1, 2))) for n in range(30)]
    load(conn, Scene("s"), [], tracks)
    asked = ["s", instant(T0_US), instant(T0_US + 9 * HOUR_US), timedelta(seconds=1)]
    with pytest.raises(psycopg.Error, match=r"gives 108000 havens .* more than 100000") as refused:
        conn.execute(ALL, asked)
    assert (refused.value.sqlstate, refused.value.diag.constraint_name) == ("ZC003", "havens_at_most")


def test_a_scene_without_tracks_has_no_havens(conn: Conn) -> None:
    load(conn, Scene("s"), [], [])
    assert conn.execute(ALL, ["s", instant(T0_US), instant(T0_US), "1 s"]).fetchall() == []
