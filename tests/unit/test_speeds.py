"""Speeds and waits that are in conflict, by hand: a crossing, the same way, areas, one leg, waits, and input."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from layouts import GROWING
from mixed_scenes import plain_scene
from shifting import stretched

from conflictdb import (
    Area,
    Delays,
    EarthModel,
    InvalidInput,
    Scene,
    Speeds,
    Track,
    delays,
    kernel,
    rectangle_outline_m,
    solve,
    speeds,
)
from conflictdb.core import delays as stage_of_delays
from conflictdb.core.memory_budget import DEFAULT_MEMORY
from conflictdb.core.pieces import covers
from conflictdb.model.rules import Rule

RADIUS_M = 6371008.771415
T0_US = 1_780_000_000_000_000
MPS = 8.0
SCENE = Scene("by hand", earth=EarthModel.SPHERE, tolerance_m=0.0)
HALF_M = float(RADIUS_M * np.radians(0.5))


def track(key: str, places: list[tuple[float, float]], departs_s: float, *sizes_m: float) -> Track:
    """A track along the equator or a meridian, at 8 m/s."""
    legs_s = RADIUS_M * np.radians(np.hypot(*np.diff(np.array(places), axis=0).T)) / MPS
    times_s = departs_s + np.concatenate([[0.0], np.cumsum(legs_s)])
    return Track(key, places, T0_US + np.rint(1e6 * times_s).astype(np.int64), rectangle_outline_m(*sizes_m))


EAST = track("east", [(0.0, 0.0), (0.25, 0.0), (1.0, 0.0)], 0.0, 1000.0, 500.0, 100.0, 100.0)
NORTH = track("north", [(0.5, -0.5), (0.5, 0.5)], 0.0, 300.0, 200.0, 50.0, 50.0)
LEG_S = 0.5 * HALF_M / MPS
# Delays of a later part of east that meet north.
EARLIER_S, LATER_S = (500 + 50 + 300 + 100) / MPS, (1000 + 50 + 200 + 100) / MPS


def area(start_s: float | None = None, end_s: float | None = None) -> Area:
    """An area on the equator, there during [start_s, end_s)."""
    start, end = (None if s is None else T0_US + round(1e6 * s) for s in (start_s, end_s))
    return Area("closed", shapely.box(0.4, -0.1, 0.6, 0.1), None, start, end)


def one_of(*objects: Track | Area, key: str = "east", leg: int | None = None, most: float = 2.0) -> Speeds:
    tracks, areas = ([one for one in objects if isinstance(one, kind)] for kind in (Track, Area))
    [found] = speeds(tracks, areas, SCENE, key, 1.0 / most, most, leg=leg)
    return found


def wait_of(*tracks: Track, waypoint: int, within_s: float = 7200.0) -> Delays:
    [found] = delays(tracks, [], SCENE, "east", within_s, waypoint=waypoint)
    return found


def ends_of(found: Speeds) -> list[tuple[float, float]]:
    return [(one.from_factor, one.to_factor) for one in found.forbidden]


def near(low: float, high: float) -> list[tuple[object, object]]:
    return [(pytest.approx(low, abs=2e-9), pytest.approx(high, abs=2e-9))]


def test_a_crossing() -> None:
    """The contact set of a crossing is a rectangle: its corners have the extreme ratios."""
    found = one_of(EAST, NORTH)
    assert ends_of(found) == near((HALF_M - 1050) / (HALF_M + 300), (HALF_M + 550) / (HALF_M - 400))
    [forbidden] = found.forbidden
    assert (forbidden.is_proven, forbidden.by) == (True, ("north",))
    assert max(forbidden.from_error, forbidden.to_error) < 1e-9
    assert found.slower == pytest.approx(forbidden.from_factor, abs=2e-12)
    assert found.slower is not None
    assert found.slower < forbidden.from_factor
    assert found.faster is not None
    assert found.faster > forbidden.to_factor


def test_the_nearest_free_speed_clears_and_one_that_is_a_little_nearer_does_not() -> None:
    found = one_of(EAST, NORTH)
    assert found.slower is not None
    assert found.faster is not None
    for factor, nearer in ((found.slower, 1e-8), (found.faster, -1e-8)):
        for shift, meets in ((0.0, False), (nearer, True)):
            assert bool(solve([stretched(EAST, factor + shift), NORTH], [], SCENE)) == meets


def test_one_that_follows_on_the_same_way_is_met_by_what_is_slow() -> None:
    """The first has arrived before the second, an hour later, comes nearer than both havens are long."""
    later = replace(EAST, key="later", times_us=EAST.times_us + 3_600_000_000)
    way_m = 2.0 * HALF_M
    assert ends_of(one_of(EAST, later)) == near(0.5, way_m / (way_m + MPS * 3600.0 - 1500.0))
    assert one_of(EAST, later).slower == one_of(EAST, later).faster == 1.0


def test_an_area_with_times() -> None:
    first_s = (RADIUS_M * np.radians(0.4) - 1000) / MPS
    last_s = (RADIUS_M * np.radians(0.6) + 500) / MPS
    assert ends_of(one_of(EAST, area(8000, 9000))) == near(first_s / 9000, min(last_s / 8000, 2.0))
    assert ends_of(one_of(EAST, area(8000, None))) == near(0.5, last_s / 8000)
    assert ends_of(one_of(EAST, area(None, 8000))) == near(first_s / 8000, 2.0)
    assert ends_of(one_of(EAST, area(None, -1))) == []
    assert ends_of(one_of(EAST, area(-10, 1))) == []
    always = one_of(EAST, area())
    assert (ends_of(always), always.forbidden[0].is_proven) == ([(0.5, 2.0)], True)
    assert (always.slower, always.faster, always.blocked_by) == (None, None, ("closed",))


def test_one_leg() -> None:
    """North is met after the first leg, whose speed only shifts the rest; on the second leg, the crossing is nearer."""
    assert ends_of(one_of(EAST, NORTH, leg=1)) == near(LEG_S / (LEG_S + LATER_S), LEG_S / (LEG_S - EARLIER_S))
    left_m = 0.5 * HALF_M
    assert ends_of(one_of(EAST, NORTH, leg=2)) == near(
        (left_m - 1050) / (left_m + 300), (left_m + 550) / (left_m - 400)
    )
    behind = replace(NORTH, key="behind", positions_deg=NORTH.positions_deg - [0.4, 0.0])
    behind = replace(behind, times_us=behind.times_us - round(1e6 * 0.8 * HALF_M / MPS))
    blocked = one_of(EAST, behind, leg=2)
    assert (ends_of(blocked), blocked.blocked_by) == ([(0.5, 2.0)], ("behind",))
    assert blocked.forbidden[0].is_proven


def test_a_meeting_at_the_departure_forbids_every_speed() -> None:
    there = track("there", [(-0.01, 0.0), (0.01, 0.0)], -RADIUS_M * np.radians(0.01) / MPS, 10.0, 10.0, 10.0, 10.0)
    found = one_of(EAST, there)
    assert ends_of(found) == [(0.5, 2.0)]
    assert found.blocked_by == ("there",)


def test_limits_far_apart() -> None:
    [wide] = one_of(EAST, NORTH, most=100.0).forbidden
    [narrow] = one_of(EAST, NORTH).forbidden
    assert (wide.from_factor, wide.to_factor) == (
        pytest.approx(narrow.from_factor, abs=1e-9),
        pytest.approx(narrow.to_factor, abs=1e-9),
    )


def test_a_wait_on_the_way() -> None:
    """At the second waypoint: until then all is as planned, after it everything is later."""
    found = wait_of(EAST, NORTH, waypoint=2)
    [forbidden] = found.forbidden
    assert (forbidden.from_s, forbidden.to_s) == (0.0, pytest.approx(LATER_S, abs=3e-6))
    assert forbidden.is_proven
    assert found.least_later_s == pytest.approx(LATER_S, abs=3e-6)
    assert (found.least_earlier_s, found.waits) == (None, True)


def test_what_comes_by_during_a_wait_forbids_longer_ones() -> None:
    """It comes to the second waypoint 2,000 s after east: a wait until it is near is free, a longer wait is not."""
    by = replace(NORTH, key="by", positions_deg=NORTH.positions_deg - [0.25, 0.0])
    by = replace(by, times_us=by.times_us + round(1e6 * (2000.0 - HALF_M / MPS + LEG_S)))
    [forbidden] = wait_of(EAST, by, waypoint=2).forbidden
    assert forbidden.from_s == pytest.approx(2000.0 - EARLIER_S, abs=3e-6)
    assert (forbidden.to_s, forbidden.is_proven) == (7200.0, True)
    before = replace(by, times_us=by.times_us - 4_000_000_000)
    assert wait_of(EAST, before, waypoint=2).forbidden == ()
    crossing = replace(by, times_us=by.times_us - 2_000_000_000)
    assert wait_of(EAST, crossing, waypoint=2).blocked_by == ("by",)


def test_what_cannot_be_cut_forbids_every_change(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ValueError("cannot be cut")

    monkeypatch.setattr(covers, "track_pieces", fail)
    for found in (one_of(EAST, NORTH), one_of(EAST, NORTH, leg=1)):
        assert (ends_of(found), found.forbidden[0].is_proven) == ([(0.5, 2.0)], False)
    [forbidden] = wait_of(EAST, NORTH, waypoint=2).forbidden
    assert (forbidden.from_s, forbidden.to_s, forbidden.is_proven) == (0.0, 7200.0, False)


def test_an_area_that_cannot_be_cut_forbids_the_speeds_at_which_both_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ValueError("cannot be cut")

    monkeypatch.setattr(covers, "area_pieces", fail)
    lasts_s = 2.0 * HALF_M / MPS
    found = one_of(EAST, area(20_000, 30_000))
    assert ends_of(found) == near(0.5, lasts_s / 20_000)
    assert not found.forbidden[0].is_proven


def test_the_json_has_the_documented_members() -> None:
    found = json.loads(json.dumps(one_of(EAST, NORTH).as_json()))
    assert list(found) == ["key", "leg", "forbidden", "slower", "faster", "blocked_by"]
    assert list(found["forbidden"][0]) == ["from_factor", "to_factor", "from_error", "to_error", "is_proven", "by"]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"slowest": 0.0}, "slowest, fastest: must be factors"),
        ({"slowest": 1.5}, "slowest, fastest: must be factors"),
        ({"fastest": float("nan")}, "slowest, fastest: must be factors"),
        ({"fastest": "much"}, "slowest, fastest: must be factors"),
        ({"leg": 1}, "leg: needs the key"),
        ({"key": "east", "leg": 3}, "leg: must be from 1 to 2, of this track; got 3"),
        ({"key": "east", "leg": True}, "leg: must be from 1 to 2"),
        ({"key": "west"}, "'west' is not known"),
        ({"key": ["east"]}, "is not known"),
    ],
)
def test_odd_input_is_refused(more: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        speeds([EAST, NORTH], [], SCENE, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("key", "message"), [(3, "must be the key of a track or an area, or several"), ([["east"]], "is not known")]
)
def test_odd_keys_are_refused(key: Any, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        delays([EAST, NORTH], [], SCENE, key)


@pytest.mark.parametrize(
    ("key", "waypoint", "message"),
    [
        (None, 1, "waypoint: needs the key"),
        ("east", 3, "waypoint: must be from 1 to 2, of this track; got 3"),
        ("east", 0, "must be from 1 to 2"),
    ],
)
def test_an_odd_waypoint_is_refused(key: str | None, waypoint: int, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        delays([EAST, NORTH], [], SCENE, key, waypoint=waypoint)


def test_all_tracks_at_once_have_the_speeds_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """In one preparation of the kernel, also with areas, heights, growing havens, batches of pairs, and rules."""
    prepared: list[int] = []
    made = kernel.KernelScene.__init__

    def counted(self: kernel.KernelScene, *given: object) -> None:
        prepared.append(1)
        made(self, *given)  # type: ignore[arg-type]

    scene, areas, tracks = plain_scene(GROWING, 1, 6, 24, tolerance_m=1.0)
    low = [replace(one, floor_m=0.0, ceiling_m=100.0 * n) for n, one in enumerate(tracks[:6], 1)]
    tracks = [*low, *tracks[6:]]
    ruled = replace(scene, rules=(Rule("ferry", "ferry", 500.0),))
    ferries = [replace(one, object_class="ferry") for one in tracks[:12]] + tracks[12:]
    for settings, objects, kernels in ((scene, tracks, 1), (ruled, ferries, 2)):
        prepared.clear()
        with monkeypatch.context() as patched:
            patched.setattr(kernel.KernelScene, "__init__", counted)
            patched.setattr(stage_of_delays, "DEFAULT_MEMORY", DEFAULT_MEMORY._replace(pairs=50))
            every = speeds(objects, areas, settings)
        assert len(prepared) == kernels
        assert sum(bool(one.forbidden) for one in every) > 15
        keys = sorted((one.key for one in objects), key=str.encode)
        assert every == [found for key in keys for found in speeds(objects, areas, settings, key)]
    assert speeds([], areas, scene) == []
