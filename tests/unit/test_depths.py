"""How deep pairs undercut their required separation, and when most."""

import numpy as np
import pytest
import shapely

from conflictdb.core import depths as module
from conflictdb.core.depths import _of_pieces as of_pieces
from conflictdb.core.depths import depths
from conflictdb.model.plans import Area, EarthModel, Scene, Track, rectangle_outline_m
from conflictdb.model.rules import Rule

DEGREE_M = np.radians(1.0) * 6371008.771415  # on the equator of the sphere
T0_US = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC
HOUR_US = 3_600_000_000
SPHERE = {"earth": EarthModel.SPHERE}


def sail(key: str, west: float, east: float, north_m: float, **more: object) -> Track:
    """Return a ship that sails along the equator in an hour, 1,000 m long and 600 m wide."""
    ways = [(west, north_m / DEGREE_M), (east, north_m / DEGREE_M)]
    times = np.array([T0_US, T0_US + HOUR_US])
    return Track(key, ways, times, rectangle_outline_m(500, 500, 300, 300), **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("separation_m", [0.0, 250.0])
def test_depth_of_ships_that_pass_is_the_way_across(separation_m: float) -> None:
    """They are abreast half-way; 400 m of 600 m remain between their courses."""
    ships = [sail("EAST", -0.1, 0.1, 0.0), sail("WEST", 0.1, -0.1, 400.0)]
    [(pair, depth)] = depths(Scene("s", separation_m=separation_m, **SPHERE), [], ships).items()
    assert pair == ("EAST", "WEST")
    assert depth.depth_m == pytest.approx(200.0 + separation_m, abs=0.01)
    assert depth.at_us is not None
    # While one is as deep as the other is long, the way across is the shortest.
    assert abs(depth.at_us - T0_US - HOUR_US // 2) < 130_000_000


def test_depths_of_some_pairs_compute_these_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A list of few conflicts of a crowded scene waits for no others."""
    areas = [Area(key, shapely.box(-0.1, -0.1, 0.1, 0.1)) for key in ("A", "Z")]
    ships = [sail(key, -0.1, 0.1, 0.0) for key in ("B", "EAST", "WEST")]
    scene = Scene("s", **SPHERE)
    every = depths(scene, areas, ships)
    assert len(every) == 10
    computed = []
    monkeypatch.setattr(module, "_of_pieces", lambda *given: computed.append(len(given[2])) or of_pieces(*given))
    some = [("A", "Z"), ("Z", "B"), ("EAST", "WEST")]
    assert depths(scene, areas, ships, only=[*some, ("A", "REMOVED")]) == {pair: every[pair] for pair in some}
    assert computed == [3]
    assert depths(scene, areas, ships, only=[]) == {}


def test_depth_within_a_separation_only() -> None:
    ships = [sail("EAST", -0.1, 0.1, 0.0), sail("WEST", 0.1, -0.1, 1_000.0)]
    assert depths(Scene("s", separation_m=300.0, **SPHERE), [], ships) == {}
    [depth] = depths(Scene("s", separation_m=500.0, **SPHERE), [], ships).values()
    assert depth.depth_m == pytest.approx(100.0, abs=0.01)


def test_depth_of_areas_has_no_instant() -> None:
    areas = [Area("A", shapely.box(0.0, 0.0, 0.1, 0.1)), Area("B", shapely.box(0.09, -0.05, 0.2, 0.3))]
    [(pair, depth)] = depths(Scene("s", **SPHERE), areas, []).items()
    assert pair == ("A", "B")
    assert depth.depth_m == pytest.approx(0.01 * DEGREE_M, rel=1e-4)
    assert depth.at_us is None


def test_depth_is_that_of_the_time_in_an_area_at_its_heights() -> None:
    """The area ends half-way into it; below its heights nobody is in it."""
    end_us = T0_US + HOUR_US * 3 // 4
    area = Area("ZONE", shapely.box(0.0, -0.1, 0.2, 0.1), end_us=end_us, floor_m=-10.0, ceiling_m=10.0)
    ship = sail("SHIP", -0.1, 0.1, 0.0, floor_m=0.0, ceiling_m=5.0)
    deep = sail("SUB", -0.1, 0.1, 9_000.0, floor_m=-90.0, ceiling_m=-80.0)
    [(pair, depth)] = depths(Scene("s", **SPHERE), [area], [ship, deep]).items()
    assert pair == ("ZONE", "SHIP")
    assert depth.at_us == pytest.approx(T0_US + HOUR_US * 3 // 4, abs=10_000)
    assert depth.depth_m == pytest.approx(0.05 * DEGREE_M + 500.0, rel=1e-4)


def test_depth_is_of_the_separation_of_the_pair() -> None:
    ships = [sail("EAST", -0.1, 0.1, 0.0, object_class="tanker"), sail("WEST", 0.1, -0.1, 1_000.0)]
    scene = Scene("s", separation_m=100.0, rules=(Rule("tanker", None, separation_m=700.0),), **SPHERE)
    [depth] = depths(scene, [], ships).values()
    assert depth.depth_m == pytest.approx(300.0, abs=0.01)


def test_depth_across_the_antimeridian() -> None:
    ships = [sail("EAST", 179.9, 180.1, 0.0), sail("WEST", -179.9, -180.1, 400.0)]
    [depth] = depths(Scene("s", **SPHERE), [], ships).values()
    assert depth.depth_m == pytest.approx(200.0, abs=0.01)


def test_depth_with_a_separation_in_time_is_unknown() -> None:
    ships = [sail("EAST", -0.1, 0.1, 0.0), sail("WEST", 0.1, -0.1, 400.0)]
    assert depths(Scene("s", time_separation_s=60.0, **SPHERE), [], ships) == {}
