"""A vertical separation counts wherever heights do: in memory, in the database, in its questions and explanations."""

from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from oracle import apart_in_height
from piecework import load

from conflictdb import Area, Motion, Scene, Track, rectangle_outline_m, solve, store
from conflictdb.jobs.detect import detect

Conn = psycopg.Connection[Any]
HERE = "ST_MakeEnvelope(0.1, 0.1, 0.2, 0.2, 4326)"
T0_US = 1_772_323_200_000_000


def area(key: str, floor_m: float | None, ceiling_m: float | None) -> Area:
    return Area(key, shapely.MultiPolygon([shapely.box(0, 0, 1, 1)]), floor_m=floor_m, ceiling_m=ceiling_m)


def track(key: str, **heights: Any) -> Track:
    times = T0_US + 3_600_000_000 * np.arange(3)
    way = np.array([(-1.0, 0.5), (0.5, 0.5), (2.0, 0.5)])
    return Track(key, way, times, rectangle_outline_m(50, 50, 20, 20), **heights)


def found(conn: Conn) -> set[tuple[str, str]]:
    return {(one.a_key, one.b_key) for one in store.conflicts(conn, "s")}


@pytest.mark.parametrize("step_m", [304.8, 0.1, 1000.0])
def test_flight_levels_that_far_apart_do_not_conflict(step_m: float) -> None:
    """Sums of equal decimals count as equal, although their binary numbers differ; 2 micrometres less is too close."""
    layers = [area(f"L{k:02}", k * step_m, k * step_m + 1e-5) for k in range(40)]
    scene = Scene("s", vertical_separation_m=step_m - 1e-5)
    assert solve([], layers, scene) == []
    close = solve([], layers, replace(scene, vertical_separation_m=step_m - 8e-6))
    assert [(one.a_key, one.b_key) for one in close] == [(f"L{k:02}", f"L{k + 1:02}") for k in range(39)]


@pytest.mark.parametrize("motion", list(Motion))
@pytest.mark.parametrize("separation_m", [0.0, 0.25, 10.0, 250.0])
def test_pairs_are_those_whose_heights_are_too_close(motion: Motion, separation_m: float) -> None:
    """All lie on each other, so that heights alone decide; some are without a limit, or as high as a number can be."""
    rng = np.random.default_rng(5)
    ends = np.sort(rng.choice([-300.0, -0.1, 0.2, 10.0, 20.25, 30.7, 1e8, 1e15], (25, 2)), axis=1)
    layers = [
        area(f"A{k:02}", None if k % 7 == 0 else low, None if k % 5 == 0 else high + 0.05)
        for k, (low, high) in enumerate(ends.tolist())
    ]
    objects = [*layers, track("T", floor_m=20.5, ceiling_m=25.0)]
    scene = Scene("s", motion=motion, vertical_separation_m=separation_m)
    expected = {
        (a.key, b.key) for i, a in enumerate(objects) for b in objects[i + 1 :] if not apart_in_height(scene, a, b)
    }
    conflicts = solve([objects[-1]], layers, scene)
    assert {(one.a_key, one.b_key) for one in conflicts} == expected


def test_it_stays_with_the_scene_and_recomputes_it(conn: Conn) -> None:
    """Detection of all, and of the few that change; the same as `solve`; 0 is as before."""
    layers = [area("LOW", None, -100.0), area("MIDDLE", -90.0, 5.0), area("HIGH", 100.0, None)]
    climbs = track("T", floors_m=[0.0, 50.0], ceilings_m=[10.0, 95.0])
    load(conn, Scene("s"), layers, [climbs])
    detect(conn, "s")
    assert found(conn) == {("MIDDLE", "T")}
    conn.execute("SELECT conflictdb.create_scene('s', p_vertical_separation_m => 10.5)")
    conn.commit()
    detect(conn, "s")
    scene = store.scene_settings(conn, "s")
    assert scene == Scene("s", vertical_separation_m=10.5)
    expected = {(one.a_key, one.b_key) for one in solve([climbs], layers, scene)}
    assert found(conn) == expected == {("MIDDLE", "T"), ("HIGH", "T"), ("LOW", "MIDDLE")}
    conn.execute("UPDATE conflictdb.area SET floor_m = 105.5 WHERE key = 'HIGH'")
    conn.commit()
    detect(conn, "s")
    assert found(conn) == expected - {("HIGH", "T")}


def test_questions_and_explanations_know_it(conn: Conn) -> None:
    """probe is a superset; an explanation shows the heights of the objects, not those of their pieces."""
    load(conn, Scene("s", vertical_separation_m=0.3), [area("LOW", None, 0.1), area("HIGH", 0.4, 9.7)], [])
    detect(conn, "s")
    assert found(conn) == set()
    row = conn.execute("SELECT conflictdb.explain_conflict('s', 'LOW', 'HIGH')").fetchone()
    assert row is not None
    facts = row[0]
    assert facts["decided_by"] == {"stage": 1, "by": "height"}
    assert facts["why"] == "one is between 0.4 and 9.7 m, the other below 0.1 m: 0.3 m or more apart"
    assert (facts["a"]["floor_m"], facts["a"]["ceiling_m"], facts["b"]["floor_m"]) == (0.4, 9.7, None)
    assert facts["settings"]["vertical_separation_m"] == 0.3
    for floor_m, keys in ((9.9, ["HIGH"]), (10.1, [])):
        rows = conn.execute(f"SELECT key FROM conflictdb.probe('s', {HERE}, NULL, {floor_m})".encode()).fetchall()
        assert [key for (key,) in rows] == keys
