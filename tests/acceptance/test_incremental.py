"""The answer depends on the content of a scene alone: not on its history, on order, or on who computes."""

from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from layouts import EQUATOR, OCEAN, SEAM
from mixed_scenes import plain_scene

from conflictdb import store
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, EarthModel, Motion, Scene, Track

EDITS = 6
NEAR_M = 20_000.0


def answer(conn: psycopg.Connection[Any], scene: Scene) -> list[tuple[object, ...]]:
    """All columns of the view except those that name the run, in a fixed order."""
    rows = store.conflicts(conn, scene.name, with_region=True)
    assert all(row.is_current for row in rows)
    found = [
        (
            *(r.a_key, r.a_kind, r.b_key, r.b_kind, r.periods, r.verdict, r.first_contact_deg, r.time_error_s),
            *(r.region, r.lacking_s),
        )
        for r in rows
    ]
    near = [
        (
            r.a_key,
            r.a_kind,
            r.b_key,
            r.b_kind,
            r.closest_at,
            r.closest_m,
            r.closest_error_m,
            r.a_deg,
            r.b_deg,
            r.verdict,
        )
        for r in store.approaches(conn, scene.name)
    ]
    return sorted([*found, *near], key=lambda row: (len(row), str(row[1]), str(row[0]), str(row[2])))


def fresh_answer(
    conn: psycopg.Connection[Any], scene: Scene, areas: list[Area], tracks: list[Track]
) -> list[tuple[object, ...]]:
    """The same content as a scene of its own, loaded backwards and detected at once."""
    other = replace(scene, name=f"{scene.name} anew")
    store.replace_scene(conn, other, areas[::-1], tracks[::-1], merge=False)
    detect(conn, other.name, jobs=1, full=True)
    return answer(conn, other)


def edited(rng: np.random.Generator, areas: list[Area], tracks: list[Track]) -> tuple[list[Area], list[Track]]:
    """Some objects moved, delayed, closed for another time, taken away."""
    areas, tracks = list(areas), list(tracks)
    for _ in range(int(rng.integers(1, 4))):
        kind = rng.choice(["move", "delay", "close", "remove"])
        if kind == "remove" and len(areas) > 3:
            areas.pop(int(rng.integers(len(areas))))
        elif kind == "close":
            i = int(rng.integers(len(areas)))
            start = int(tracks[0].times_us[0]) + int(rng.integers(3_600_000_000))
            areas[i] = replace(areas[i], start_us=start, end_us=start + int(rng.integers(1, 10)) * 3_600_000_000)
        else:
            i = int(rng.integers(len(tracks)))
            if kind == "move":
                aside = np.array([0.0, rng.uniform(-0.4, 0.4)])
                tracks[i] = replace(tracks[i], positions_deg=tracks[i].positions_deg + aside)
            else:
                tracks[i] = replace(tracks[i], times_us=tracks[i].times_us + int(rng.integers(-(10**10), 10**10)))
    return areas, tracks


@pytest.mark.parametrize("time_s", [0.0, 1800.0])
@pytest.mark.parametrize(
    ("workload", "earth", "seed"),
    [
        (EQUATOR, EarthModel.WGS84, 2),
        (SEAM, EarthModel.SPHERE, 2),
        (OCEAN, EarthModel.SPHERE, 2),
        *(
            pytest.param(w, e, s, marks=pytest.mark.slow)
            for w in (EQUATOR, SEAM)
            for e in EarthModel
            for s in range(5, 9)
        ),
    ],
)
def test_history_does_not_matter(
    conn: psycopg.Connection[Any], workload: Any, earth: EarthModel, seed: int, time_s: float
) -> None:
    """After any edits a detection of what changed says the same, to the last digit, as one of everything."""
    rng = np.random.default_rng(seed)
    scene, areas, tracks = plain_scene(workload, seed, 9, 9, earth)
    scene = replace(scene, nearest_m=NEAR_M, time_separation_s=time_s)
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    detect(conn, scene.name, jobs=1)
    changes = 0
    for _ in range(EDITS):
        areas, tracks = edited(rng, areas, tracks)
        counts = store.replace_scene(conn, scene, areas, tracks, merge=False)
        assert counts.unchanged > 0
        run = detect(conn, scene.name, jobs=1)
        changes += run.opened + run.changed + run.closed
        assert answer(conn, scene) == fresh_answer(conn, scene, areas, tracks)
    assert changes > 3


def test_settings_change_everything(conn: psycopg.Connection[Any]) -> None:
    """A larger separation, another earth: the next detection notices, and gives the answer of a fresh scene."""
    scene, areas, tracks = plain_scene(EQUATOR, 2, 4, 5)
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    detect(conn, scene.name, jobs=1)
    for settings in (
        {"separation_m": 3000.0},
        {"earth": EarthModel.SPHERE},
        {"nearest_m": NEAR_M},
        {"time_separation_s": 3600.0},
    ):
        scene = replace(scene, **settings)  # type: ignore[arg-type]
        store.set_scene(conn, scene)
        detect(conn, scene.name, jobs=1)
        assert answer(conn, scene) == fresh_answer(conn, scene, areas, tracks)


def test_settings_change_where_areas_meet(conn: psycopg.Connection[Any]) -> None:
    """Also where nothing else does: sides become great circles, which the database itself finds regions of."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    boxes = [shapely.box(0.0, 50.0, 20.0, 60.0), shapely.box(5.0, 55.0, 25.0, 70.0)]
    areas = [Area(f"A{i}", shapely.MultiPolygon([one])) for i, one in enumerate(boxes)]
    store.replace_scene(conn, scene, areas, [], merge=False)
    detect(conn, "s", jobs=1)
    scene = replace(scene, motion=Motion.GREAT_CIRCLE, centre=(12.5, 60.0))
    store.set_scene(conn, scene)
    run = detect(conn, "s", jobs=1)
    assert (run.opened, run.changed, run.closed) == (0, 0, 0)
    assert answer(conn, scene) == fresh_answer(conn, scene, areas, [])
    bulge = "ST_SetSRID(ST_MakeEnvelope(12, 60.1, 13, 60.2), 4326)"
    assert conn.execute(f"SELECT FROM conflictdb.conflicts_within('s', {bulge}, '(,)')".encode()).rowcount == 1


def test_number_of_threads_does_not_matter(conn: psycopg.Connection[Any]) -> None:
    scene, areas, tracks = plain_scene(EQUATOR, 2, 8, 8)
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    detect(conn, scene.name, jobs=1)
    alone = answer(conn, scene)
    told: list[tuple[int, int]] = []
    detect(conn, scene.name, jobs=2, full=True, progress=lambda *counts: told.append(counts))
    assert answer(conn, scene) == alone
    assert told, "progress is told"
    assert told[-1][0] == told[-1][1]
