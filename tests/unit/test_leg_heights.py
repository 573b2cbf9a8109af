"""A track may have a height band on every leg: each leg meets the objects that a track of it alone meets."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from verdicts import periods_us

from conflictdb import formats, solve
from conflictdb.errors import InvalidInput
from conflictdb.formats.scene_file import read_scene, scene_text
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m

T0_US = 1_772_323_200_000_000
HOUR_US = 3_600_000_000
TIMES_US = np.array([T0_US, T0_US + HOUR_US, T0_US + 2 * HOUR_US])
WAY = np.array([[4.0, 57.0], [4.5, 57.1], [5.0, 57.0]])
OUTLINE = rectangle_outline_m(50.0, 50.0, 20.0, 20.0)
WHOLE = shapely.MultiPolygon([shapely.box(3.0, 56.0, 6.0, 58.0)])


def climbing(**changes: Any) -> Track:
    members = {"floors_m": np.array([0.0, 200.0]), "ceilings_m": np.array([100.0, 300.0]), **changes}
    return Track("T", WAY, TIMES_US, OUTLINE, **members)


@pytest.mark.parametrize("method", list(Method))
@pytest.mark.parametrize(
    ("band", "legs"),
    [
        ((50.0, 150.0), (0,)),
        ((150.0, 250.0), (1,)),
        ((99.0, 201.0), (0, 1)),
        ((None, None), (0, 1)),
        ((100.0, 200.0), ()),
    ],
)
def test_only_legs_at_the_height_of_an_area_meet_it(
    band: tuple[float | None, float | None], legs: tuple[int, ...], method: Method
) -> None:
    found = solve([climbing()], [Area("A", WHOLE, None, None, None, *band)], Scene("s", method=method))
    if not legs:
        assert found == []
        return
    ((start_us, end_us),) = periods_us(found[0])
    assert start_us == TIMES_US[legs[0]]
    # The last instant of a track does not belong to it; the waypoint between belongs to both legs.
    assert end_us in (TIMES_US[legs[-1] + 1], TIMES_US[legs[-1] + 1] - 1)


def test_one_of_two_heights_may_be_of_legs_and_unbounded() -> None:
    track = climbing(floors_m=np.array([-np.inf, 200.0]), ceilings_m=None, ceiling_m=300.0)
    assert (track.floor_m, track.ceiling_m) == (None, 300.0)
    floors_m, ceilings_m = track.heights_m()
    assert (floors_m.tolist(), ceilings_m.tolist()) == ([[-np.inf] * 2, [200.0] * 2], [[300.0] * 2] * 2)
    deep = Area("A", WHOLE, ceiling_m=-500.0)
    ((_, end_us),) = periods_us(solve([track], [deep], Scene("s"))[0])
    assert end_us == TIMES_US[1]


def test_random_tracks_meet_what_their_legs_meet() -> None:
    rng = np.random.default_rng(20260302)
    met = 0
    for _ in range(40):
        legs = int(rng.integers(2, 6))
        way = np.array([4.0, 57.0]) + np.cumsum(rng.uniform(-0.4, 0.4, (legs + 1, 2)), axis=0)
        times = T0_US + np.cumsum(rng.integers(HOUR_US // 4, HOUR_US, legs + 1))
        floors = rng.choice([-np.inf, 0.0, 100.0, 200.0], legs)
        ceilings = np.where(np.isfinite(floors), floors, 0.0) + rng.choice([50.0, 150.0, np.inf], legs)
        whole = Track("T", way, times, OUTLINE, floors_m=floors, ceilings_m=ceilings)
        alone = [
            Track(
                f"T{k}",
                way[k : k + 2],
                times[k : k + 2],
                OUTLINE,
                floor_m=floors[k] if np.isfinite(floors[k]) else None,
                ceiling_m=ceilings[k] if np.isfinite(ceilings[k]) else None,
            )
            for k in range(legs)
        ]
        low = float(rng.choice([-50.0, 40.0, 120.0, 260.0]))
        box = shapely.box(*(way.min(axis=0) - 0.1), *(way.mean(axis=0) + 0.1))
        area = Area("A", shapely.MultiPolygon([box]), floor_m=low, ceiling_m=low + 70.0)
        together = [period for one in solve([whole], [area], Scene("s")) for period in periods_us(one)]
        apart = sorted(period for one in solve(alone, [area], Scene("s")) for period in periods_us(one))
        merged: list[list[int]] = []
        for start, end in apart:
            if merged and start <= merged[-1][1] + 2:
                merged[-1][1] = max(merged[-1][1], end)
            else:
                merged.append([start, end])
        assert len(together) == len(merged)
        assert np.abs(np.array(together, dtype=np.int64).reshape(-1) - np.array(merged).reshape(-1)).max(initial=0) <= 2
        met += bool(together)
    assert met > 10


def feature(**properties: Any) -> dict[str, Any]:
    times = [f"2026-03-01T0{hour}:00:00Z" for hour in range(3)]
    haven = {"fore_m": 5, "aft_m": 5, "port_m": 2, "starboard_m": 2}
    geometry = {"type": "LineString", "coordinates": WAY.tolist()}
    return {"type": "Feature", "id": "T", "geometry": geometry, "properties": {"times": times, **haven, **properties}}


def read(tmp_path: Path, **properties: Any) -> Track:
    path = tmp_path / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature(**properties)]}))
    return formats.read(path).tracks[0]


def test_a_file_gives_heights_per_leg_and_gets_them_back(tmp_path: Path) -> None:
    track = read(tmp_path, floor_m=[0.1, None], ceiling_m=[100, 300.0])
    assert track.floors_m is not None
    assert track.ceilings_m is not None
    assert (track.floors_m.tolist(), track.ceilings_m.tolist()) == ([0.1, -np.inf], [100.0, 300.0])
    assert (track.floor_m, track.ceiling_m) == (None, 300.0)
    text = "".join(scene_text(Scene("s"), [], [track]))
    properties = json.loads(text)["features"][0]["properties"]
    assert (properties["floor_m"], properties["ceiling_m"]) == ([0.1, None], [100.0, 300.0])
    (back,) = read_scene(text, "s").tracks
    assert np.array_equal(back.floors_m, track.floors_m)
    assert np.array_equal(back.ceilings_m, track.ceilings_m)


def test_a_height_of_a_leg_must_be_a_number(tmp_path: Path) -> None:
    """Other refusals are in tests/integration/test_refusals.py."""
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, floor_m=[1, "x"])
    assert (caught.value.key, caught.value.field) == ("track 'T'", "floor_m[1]")
    assert "must be a number" in caught.value.rule


def test_the_height_of_the_whole_may_be_that_of_its_legs() -> None:
    assert climbing(floor_m=0.0, ceiling_m=300.0) is not None
