"""Least distances of tracks without a conflict are those of the near pairs of `solve`."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from layouts import GROWING_CIRCLES, HARBOUR, LOW_LATITUDE, SEAM, Workload
from mixed_scenes import plain_scene

from conflictdb import Area, InvalidInput, Scene, Track, Verdict, delays, solve
from conflictdb.core import margins
from conflictdb.core.near import Memory, Question
from conflictdb.core.pieces import covers
from conflictdb.core.world import World, occupy
from conflictdb.earth.registry import Setup
from conflictdb.model.inputs import certain
from conflictdb.model.rules import Rule


@pytest.mark.parametrize(
    ("workload", "separation_m"),
    [(LOW_LATITUDE, 0.0), (LOW_LATITUDE, 1852.0), (SEAM, 0.0), (SEAM, 500.0), (HARBOUR, 0.0), (GROWING_CIRCLES, 500.0)],
    ids=lambda value: value.name if isinstance(value, Workload) else None,
)
def test_a_margin_is_the_closest_approach_beyond_the_separation(
    workload: Workload, separation_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within the range; of one track as of all, however many are solved at once."""
    monkeypatch.setattr(margins, "_AT_ONCE", 4)
    scene, areas, tracks = plain_scene(workload, 1, 6, 14, separation_m=separation_m)
    within_m = 2000.0 if workload is HARBOUR else 60_000.0
    near = solve(tracks, areas, replace(scene, nearest_m=separation_m + within_m))
    found = delays(tracks, areas, scene, clear_within_m=within_m)
    counts = {"conflict": 0, "near": 0, "beyond": 0}
    for one in found:
        pairs = [pair for pair in near if one.key in (pair.a_key, pair.b_key)]
        assert one.clear_within_m == within_m
        if any(pair.verdict is not Verdict.NEAR for pair in pairs):
            assert (one.clear_by_s, one.clear_by_m, one.clear_error_m) == (0.0, 0.0, 0.0)
            counts["conflict"] += 1
        elif not pairs:
            assert (one.clear_by_m, one.clear_error_m) == (None, None)
            counts["beyond"] += 1
        else:
            expected = min(pairs, key=lambda pair: pair.closest_m or 0.0)
            assert expected.closest_m is not None
            assert one.clear_by_m is not None
            assert one.clear_error_m is not None
            assert one.clear_error_m < 0.01
            error_m = one.clear_error_m + expected.closest_error_m
            assert abs(one.clear_by_m - (expected.closest_m - separation_m)) <= error_m + 1e-6
            [alone] = delays(tracks, areas, scene, one.key, clear_within_m=within_m)
            assert alone.clear_by_m == pytest.approx(one.clear_by_m, abs=2.0 * one.clear_error_m + 1e-6)
            counts["near"] += 1
    assert counts["near"] > 0
    assert [replace(one, clear_within_m=None, clear_by_m=None, clear_error_m=None) for one in found] == (
        delays(tracks, areas, scene)
    )


def track(key: str, lat: float, **more: Any) -> Track:
    return Track(key, [(0.0, lat), (1.0, lat)], [1_780_000_000_000_000, 1_780_010_000_000_000], [(0.0, 0.0)], **more)


def test_heights_and_times_count() -> None:
    low, high = track("low", 0.0, ceiling_m=10.0), track("high", 0.001, floor_m=10.0)
    [found, _] = delays([low, high], [], Scene("s"), clear_within_m=1000.0)
    assert found.clear_by_m is None
    late = replace(high, key="late", floor_m=0.0, times_us=high.times_us + 20_000_000_000)
    assert [one.clear_by_m for one in delays([low, late], [], Scene("s"), clear_within_m=1000.0)] == [None, None]
    [one, _] = delays([low, replace(high, floor_m=0.0)], [], Scene("s"), clear_within_m=1000.0)
    assert one.clear_by_m == pytest.approx(110.574, abs=0.01)
    assert delays([low], [], Scene("s"), clear_within_m=0.0)[0].clear_by_m is None
    assert delays([], [], Scene("s"), clear_within_m=1.0) == []


def test_each_pair_has_its_own_separation() -> None:
    """The nearest object is not the one that the track clears by the least; some pairs are not compared."""
    ship, near, far = track("ship", 0.0), track("near", 0.01), track("far", 0.03)
    tanker, friend = replace(far, object_class="tanker"), track("friend", 0.001, object_class="pilot")
    rules = (Rule("tanker", None, separation_m=3000.0), Rule("pilot", "track", allowed=True))
    scene = Scene("s", separation_m=100.0, rules=rules)
    every = [ship, near, tanker, friend]
    assert {(one.a_key, one.b_key) for one in solve(every, [], scene)} == {("far", "near")}
    found = {one.key: one for one in delays(every, [], scene, clear_within_m=5000.0)}
    assert found["ship"].clear_by_m == pytest.approx(3317.2 - 3000.0, abs=0.1)
    assert found["ship"].clear_error_m is not None
    assert found["ship"].clear_error_m < 0.01
    assert (found["friend"].clear_by_m, found["friend"].clear_error_m) == (None, None)
    assert delays(every, [], scene, "ship", clear_within_m=300.0)[0].clear_by_m is None
    alone = delays([ship, near], [], scene, "ship", clear_within_m=5000.0)[0]
    assert alone.clear_by_m == pytest.approx(1105.74 - 100.0, abs=0.1)


def test_heights_are_those_of_the_pair() -> None:
    """Another pair with a larger vertical separation adds nothing to the heights of this one."""
    low, high = track("low", 0.0, ceiling_m=100.0), track("high", 0.01, floor_m=150.0, ceiling_m=200.0)
    rules = (Rule("drone", None, vertical_m=300.0),)
    scene, drone = Scene("s", rules=rules), replace(high, key="drone", object_class="drone")
    low = replace(low, object_class="boat")
    [found, _] = delays([high, low], [], scene, clear_within_m=5000.0)
    assert found.clear_by_m is None
    [found, _] = delays([drone, low], [], scene, clear_within_m=5000.0)
    assert found.clear_by_m == pytest.approx(1105.74, abs=0.1)


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM], ids=lambda one: one.name)
def test_margins_by_class_are_those_of_pairs(workload: Workload) -> None:
    scene, areas, tracks = plain_scene(workload, 1, 6, 14, separation_m=500.0)
    tracks = [replace(one, object_class=("one", "two", None)[n % 3]) for n, one in enumerate(tracks)]
    required_m = {frozenset(["one", "two"]): 20_000.0, frozenset(["one"]): 0.0}
    rules = (Rule("one", "two", separation_m=20_000.0), Rule("one", "one", separation_m=0.0))
    scene, within_m, count = replace(scene, rules=rules), 60_000.0, 0
    near = solve(tracks, areas, replace(scene, rules=(), separation_m=0.0, nearest_m=80_000.0))
    class_of = {one.key: one.object_class for one in tracks}
    for one in delays(tracks, areas, scene, clear_within_m=within_m):
        margins_m = [
            (pair.closest_m or 0.0)
            - required_m.get(frozenset([class_of.get(pair.a_key, "area"), class_of.get(pair.b_key, "area")]), 500.0)
            for pair in near
            if one.key in (pair.a_key, pair.b_key)
        ]
        expected = max(min([margin for margin in margins_m if margin <= within_m], default=np.inf), 0.0)
        assert (np.inf if one.clear_by_m is None else one.clear_by_m) == pytest.approx(expected, abs=0.1)
        count += 0.0 < expected < np.inf
    assert count > 2


def test_a_distance_that_is_unknown_is_no_margin(monkeypatch: pytest.MonkeyPatch) -> None:
    """If a wide hull cannot be made, its track is covered: the margin is 0, without an error bound."""
    made = covers.track_pieces

    def fail(setup: Setup, *rest: object) -> object:
        if setup.scene.nearest_m > 0.0:
            raise ValueError("cannot be cut")
        return made(setup, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(covers, "track_pieces", fail)
    [found, _] = delays([track("a", 0.0), track("b", 1.0)], [], Scene("s"), clear_within_m=1000.0)
    assert (found.clear_by_m, found.clear_error_m) == (0.0, None)


@pytest.mark.parametrize("within_m", [-1.0, np.nan, np.inf, 2e6, "1 km", True])
def test_a_range_that_is_none_is_refused(within_m: float) -> None:
    with pytest.raises(InvalidInput, match="clear_within_m"):
        delays([track("a", 0.0)], [Area("b", [(0, 0), (1, 0), (0, 1)])], clear_within_m=within_m)


def test_margins_with_a_separation_in_time_are_those_of_moved_copies() -> None:
    """The nearest approach of a copy that is earlier or later by at most that time."""
    within_s, range_m, count = 300.0, 60_000.0, 0
    scene, areas, tracks = plain_scene(SEAM, 2, 2, 5, separation_m=200.0)
    for one in delays(tracks, areas, replace(scene, time_separation_s=within_s), clear_within_m=range_m):
        assert one.clear_by_m is None or one.clear_error_m is not None
        least_m = np.inf
        [own] = [some for some in tracks if some.key == one.key]
        others = [some for some in tracks if some.key != one.key]
        for by_s in np.linspace(-within_s, within_s, 11).tolist():
            copy = replace(own, times_us=own.times_us + round(1e6 * by_s), max_speed_kn=np.inf)
            near = solve([copy, *others], areas, replace(scene, nearest_m=200.0 + range_m))
            distances = [pair.closest_m for pair in near if one.key in (pair.a_key, pair.b_key)]
            least_m = min(least_m, *[(at or 0.0) - 200.0 for at in distances], np.inf)
        by_m = np.inf if one.clear_by_m is None else one.clear_by_m
        # Between two copies they move by less than this.
        assert max(least_m, 0.0) - 3000.0 <= by_m <= max(least_m, 0.0) + (one.clear_error_m or 0.0) + 0.01, one.key
        count += 0.0 < by_m < np.inf
    assert count > 0


def test_a_track_that_follows_within_the_separation_in_time_counts() -> None:
    """Both sail one way; the second one 600 s later, 1105.74 m beside it. An area ends before the first one departs."""
    first, second = track("first", 0.0), track("second", 0.01)
    second = replace(second, times_us=second.times_us + 20_000_000_000)
    scene = Scene("s", time_separation_s=20_000.0, separation_m=100.0)
    found = delays([first, second], [], scene, clear_within_m=5000.0)
    assert [one.clear_by_m for one in found] == pytest.approx([1105.74 - 100.0] * 2, abs=0.1)
    assert all(one.clear_error_m is not None and one.clear_error_m <= 0.01 for one in found)
    found = delays([first, second], [], replace(scene, time_separation_s=9_000.0), clear_within_m=5000.0)
    assert [one.clear_by_m for one in found] == [None, None]
    ends_us = int(first.times_us[0]) - 60_000_000
    box = shapely.box(0.2, 0.02, 0.3, 0.03)
    area = Area("area", box, end_us=certain(ends_us))
    [one] = delays([first], [area], replace(scene, time_separation_s=9_000.0), clear_within_m=5000.0)
    assert one.clear_by_m == pytest.approx(2211.49 - 100.0, abs=0.1)


def test_pieces_in_memory_need_not_share_heights() -> None:
    """Only a question that says so finds pairs at other heights."""
    ring = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)]
    areas = [Area("low", ring, ceiling_m=10.0), Area("high", ring, floor_m=20.0)]
    world = World.of(Scene("s"), areas, [])
    placed = Memory(occupy(world, areas, []).pieces)
    every = Question(np.arange(len(placed.pieces)))
    assert len(placed.rows(every)[0]) == 0
    assert len(placed.rows(every._replace(any_height=True))[0]) == 1
