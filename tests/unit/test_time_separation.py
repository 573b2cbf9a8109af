"""Separation in time, by hand and against the same question at one time, asked of shifted plans."""

from dataclasses import replace
from datetime import UTC, datetime
from itertools import combinations, product
from typing import Any

import numpy as np
import pytest
import shapely
from draws import draws
from layouts import GROWING, HARBOUR, LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene
from shifting import shifted, stretched, waiting, with_outlines

from conflictdb import (
    Area,
    Conflict,
    EarthModel,
    InvalidInput,
    Method,
    Motion,
    Scene,
    Speeds,
    Track,
    delays,
    rectangle_outline_m,
    resolve,
    solve,
    speeds,
)
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.client.advise import advise
from conflictdb.core import run
from conflictdb.core.near import Memory
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.pieces.cutting import track_pieces
from conflictdb.core.run import run_scene
from conflictdb.earth.registry import Setup, centred
from conflictdb.kernel.time_uses import uses_of_place
from conflictdb.model.rules import Rule

RADIUS_M = 6371008.771415
T0_US = 1_780_000_000_000_000
SPEED_MPS = 8.0
SCENE = Scene("by hand", earth=EarthModel.SPHERE, tolerance_m=0.0)


def track(
    key: str, start: tuple[float, float], end: tuple[float, float], departs_s: float, *sizes_m: float, **more: Any
) -> Track:
    """A track on the equator or a meridian, at 8 m/s."""
    lasts_s = RADIUS_M * np.radians(np.hypot(end[0] - start[0], end[1] - start[1])) / SPEED_MPS
    times = [T0_US + round(1e6 * departs_s), T0_US + round(1e6 * (departs_s + lasts_s))]
    return Track(key, [start, end], times, rectangle_outline_m(*sizes_m), **more)


EAST = track("east", (0.0, 0.0), (1.0, 0.0), 0.0, 1000.0, 500.0, 100.0, 100.0)
NORTH = track("north", (0.5, -0.5), (0.5, 0.5), 0.0, 300.0, 200.0, 50.0, 50.0)
HALF_S = RADIUS_M * np.radians(0.5) / SPEED_MPS


def area(key: str, start_s: float | None = None, end_s: float | None = None, lon: float = 0.5, **more: Any) -> Area:
    """An area on the equator, there during [start_s, end_s)."""
    start, end = (None if s is None else T0_US + round(1e6 * s) for s in (start_s, end_s))
    return Area(key, shapely.box(lon - 0.1, -0.1, lon + 0.1, 0.1), None, start, end, **more)


def later(plan: Track, by_s: float, **more: Any) -> Track:
    return replace(plan, times_us=plan.times_us + round(1e6 * by_s), max_speed_kn=np.inf, **more)


def rows(*objects: Track | Area, time_s: float, scene: Scene = SCENE) -> list[Conflict]:
    tracks, areas = ([one for one in objects if isinstance(one, kind)] for kind in (Track, Area))
    return list(solve(tracks, areas, replace(scene, time_separation_s=time_s)))


def seconds(instant: datetime | None) -> float:
    assert instant is not None
    return (instant - datetime.fromtimestamp(T0_US / 1e6, UTC)).total_seconds()


def periods_s(row: Conflict) -> list[tuple[float, float]]:
    return [(seconds(start), seconds(end)) for start, end in row.periods]


def near(low_s: float, high_s: float) -> list[tuple[object, object]]:
    return [(pytest.approx(low_s, abs=1e-3), pytest.approx(high_s, abs=1e-3))]


def test_a_crossing_that_one_passes_later() -> None:
    """The first is there from its bow to its stern, and then the second; what lacks is between stern and bow."""
    gap_s = 400.0
    [row] = rows(EAST, later(NORTH, gap_s), time_s=600.0)
    assert row.verdict == "conflict"
    assert periods_s(row) == near(HALF_S - (1000 + 50) / SPEED_MPS, HALF_S + gap_s + (200 + 100) / SPEED_MPS)
    assert row.lacking_s == pytest.approx(600.0 - (gap_s - (500 + 50 + 300 + 100) / SPEED_MPS), abs=2e-5)
    assert row.time_error_s <= 1e-3
    assert row.first_contact_deg == pytest.approx((0.5 - np.degrees(50 / RADIUS_M), 0.0), abs=2e-3)
    assert (row.closest_m, row.approach) == (None, None)
    assert rows(EAST, later(NORTH, gap_s), time_s=gap_s - 950 / SPEED_MPS - 1e-4) == []
    assert len(rows(EAST, later(NORTH, gap_s), time_s=gap_s - 950 / SPEED_MPS + 1e-4)) == 1


def test_those_who_meet_lack_all_of_it() -> None:
    [row], [at_once] = rows(EAST, NORTH, time_s=60.0), rows(EAST, NORTH, time_s=0.0)
    assert (row.lacking_s, at_once.lacking_s) == (60.0, None)
    assert row.closest_m == at_once.closest_m == 0.0
    assert row.closest_at == at_once.closest_at
    assert at_once.first_contact is not None
    assert row.first_contact is not None
    assert row.first_contact <= at_once.first_contact


def test_the_same_way_with_a_gap() -> None:
    """The way is used by both all the time, but for the first and the last steps, which the other makes too late."""
    convoy = later(EAST, 600.0, key="later")
    apart_s = 600 - 1500 / SPEED_MPS
    [row] = rows(EAST, convoy, time_s=500.0)
    assert periods_s(row) == near(100.0, 2 * HALF_S + 500.0)
    assert row.lacking_s == pytest.approx(500.0 - apart_s, abs=2e-5)
    assert rows(EAST, convoy, time_s=apart_s - 1e-3) == []


@pytest.mark.parametrize("is_before", [True, False])
def test_an_area_that_closes_before_a_track_comes_or_opens_after_it(is_before: bool) -> None:
    """The area counts for as long as the track is there within that time, and the track likewise."""
    first_s = (RADIUS_M * np.radians(0.4) - 1000) / SPEED_MPS
    last_s = (RADIUS_M * np.radians(0.6) + 500) / SPEED_MPS
    closed = area("closed", 0, first_s - 100) if is_before else area("closed", last_s + 100, 20_000)
    assert rows(EAST, closed, time_s=99.999) == []
    [row] = rows(EAST, closed, time_s=250.0)
    assert row.lacking_s == pytest.approx(150.0, abs=1e-5)
    by_hand = (first_s - 250, first_s + 150) if is_before else (last_s - 150, last_s + 250)
    assert periods_s(row) == near(*by_hand)
    [whole] = rows(EAST, area("for ever"), time_s=250.0)
    assert periods_s(whole) == near(first_s - 250, last_s + 250)
    assert whole.lacking_s == 250.0


def test_areas_one_after_the_other() -> None:
    """In closed form, exclusive ends too: from the last T of the first to the first T of the second."""
    first, second = area("first", 0, 1000), area("second", 1600, None)
    assert rows(first, second, time_s=600.0) == []
    [row] = rows(first, second, time_s=600.000001)
    assert row.lacking_s == pytest.approx(1e-6, abs=1e-12)
    [row] = rows(first, second, time_s=700.0)
    assert (row.lacking_s, row.time_error_s) == (100.0, 0.0)
    assert periods_s(row) == [(900.0, 1700.0)]
    [row] = rows(area("a"), area("b"), time_s=700.0)
    assert (row.periods, row.lacking_s) == (((None, None),), 700.0)
    [row] = rows(area("a", None, 0), area("b", 10, None), time_s=2_592_000.0)
    assert periods_s(row) == [(10 - 2_592_000.0, 2_592_000.0)]


def test_heights_and_places_still_count() -> None:
    high, low = replace(later(NORTH, 300.0), floor_m=100.0), replace(EAST, ceiling_m=100.0)
    assert rows(low, high, time_s=1000.0) == []
    assert rows(EAST, area("elsewhere", 0, 10, lon=3.0), time_s=2_592_000.0) == []
    assert len(rows(replace(low, ceiling_m=101.0), high, time_s=1000.0)) == 1


def test_a_separation_of_both_kinds() -> None:
    """With a distance wanted too, places are used from further away."""
    scene = replace(SCENE, separation_m=1000.0)
    [row], [without] = (rows(EAST, later(NORTH, 400.0), time_s=300.0, scene=one) for one in (scene, SCENE))
    assert row.lacking_s is not None
    assert without.lacking_s is not None
    assert row.lacking_s == pytest.approx(without.lacking_s + 1000 / SPEED_MPS, abs=60.0)
    assert periods_s(row)[0][0] < periods_s(without)[0][0] - 100.0


def test_a_microsecond_and_a_month() -> None:
    """The least and the largest setting; the least answers nearly as none."""
    [least], [none] = rows(EAST, NORTH, time_s=1e-6), rows(EAST, NORTH, time_s=0.0)
    assert periods_s(least) == near(*periods_s(none)[0])
    assert least.lacking_s == 1e-6
    [most] = rows(EAST, later(NORTH, 2_000_000.0), time_s=2_592_000.0)
    assert most.lacking_s == pytest.approx(592_000.0 + 950 / SPEED_MPS, abs=2e-5)


def test_grazing_in_space_stays_grazing() -> None:
    """Ways side by side that come within the tolerance, at any time, are too close to call."""
    side = np.degrees(200.5 / RADIUS_M)
    beside = track("beside", (0.0, side), (1.0, side), 600.0, 1000.0, 500.0, 100.0, 100.0)
    scene = replace(SCENE, tolerance_m=1.0)
    [row] = rows(EAST, beside, time_s=500.0, scene=scene)
    assert row.verdict == "grazing"
    assert row.lacking_s == pytest.approx(500.0 - (600 - 1500 / SPEED_MPS), abs=1.0)
    assert rows(EAST, beside, time_s=500.0) == []


@pytest.mark.parametrize(
    ("east_m", "north_m"),
    [
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.0, 0.0), (80.0, 160.0, 0.0, 0.0)),
        ((80.0, 160.0, 0.0, 0.0), (40.0, 40.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.0, 0.0), (80.0, 160.0, 24.0, 8.0)),
        ((0.0, 0.0, 24.0, 8.0), (80.0, 160.0, 0.0, 0.0)),
    ],
    ids=["points", "point and line", "lines", "point and area", "lines across and along"],
)
def test_havens_without_an_area(east_m: tuple[float, ...], north_m: tuple[float, ...]) -> None:
    """By hand: a point or a line passes the crossing, and the hull of its way may have no area."""
    east, north = (
        track("east", (0.0, 0.0), (1.0, 0.0), 0.0, *east_m),
        track("north", (0.5, -0.5), (0.5, 0.5), 30.0, *north_m),
    )
    fore, aft, port, starboard = east_m
    other_fore, other_aft, other_port, other_starboard = north_m
    # One is at the other's way while its own length, and the width of that way, pass.
    first = HALF_S - (fore + other_port) / SPEED_MPS
    last = HALF_S + (aft + other_starboard) / SPEED_MPS
    other_first = HALF_S + 30.0 - (other_fore + starboard) / SPEED_MPS
    other_last = HALF_S + 30.0 + (other_aft + port) / SPEED_MPS
    lacking_s = 60.0 - max(other_first - last, 0.0)
    for mine in ((east, north), (replace(east, key="z"), north)):
        [row] = rows(*mine, time_s=60.0)
        assert periods_s(row) == near(min(first, other_first), max(last, other_last))
        assert row.lacking_s == pytest.approx(lacking_s, abs=1e-3)
    assert rows(east, later(north, 10_000.0), time_s=60.0) == []
    # Pairs of one batch do not change each other.
    together = rows(east, north, replace(EAST, key="wide"), later(NORTH, 5.0, key="large"), time_s=60.0)
    assert [one for one in together if {one.a_key, one.b_key} == {"east", "north"}] == rows(east, north, time_s=60.0)


def planned(
    key: str, places_deg: list[tuple[float, float]], times_s: list[float], *sizes_m: float, **more: Any
) -> Track:
    times_us = [T0_US + round(1e6 * one) for one in times_s]
    return Track(key, places_deg, times_us, rectangle_outline_m(*sizes_m), max_speed_kn=np.inf, **more)


# Pairs at the edge: no time of a whole pair is proven apart, but all of its parts are.
SLOW = planned("a", [(8.9938867575, 70.0783905924), (9.0601064681, 69.9778450812)], [440, 2924], 200, 200, 10, 10)
SLOWER = planned("b", [(9.0740311632, 69.919555071), (8.9859783057, 70.0908360624)], [529, 2473], 50, 50, 50, 50)
ACROSS = planned("a", [(8.921614, 70.010608), (9.021669, 70.041677)], [378, 3071], 200, 200, 10, 10)
LINE = planned("b", [(9.004352, 70.043021), (8.960099, 70.012929)], [214, 2429], 0, 0, 10, 10)
NEAR = Scene("near", separation_m=500.0, tolerance_m=0.0)
# The same, but not in parts either: only the differences of all times are sharp enough.
BARE = planned("a", [(9.057515, 70.021674), (8.938767, 70.028929)], [2536, 3901], 200, 0, 200, 0)
GROWS = planned("b", [(9.043222, 70.024321), (9.082867, 70.021178)], [69, 2767], 200, 50, 200, 200, grow_mps=0.1)
AT_THE_EDGE = [
    (SLOW, SLOWER, replace(NEAR, tolerance_m=1.0), 600.0),
    (ACROSS, LINE, NEAR, 30.0),
    (BARE, GROWS, replace(NEAR, tolerance_m=1.0), 30.0),
]


@pytest.mark.parametrize(("plan", "other", "scene", "time_s"), AT_THE_EDGE, ids=["with tolerance", "a line", "growing"])
def test_the_least_delay_is_clear(plan: Track, other: Track, scene: Scene, time_s: float) -> None:
    """`solve` finds no conflict at delays that are proven free, and one at delays that are proven forbidden."""
    late = replace(scene, time_separation_s=time_s)
    [found] = delays([plan, other], [], late, plan.key, 7200.0)
    [forbidden] = found.forbidden
    assert found.least_later_s is not None
    assert found.least_earlier_s is not None
    for free_s in (found.least_later_s, -found.least_earlier_s):
        assert rows(later(plan, free_s), other, time_s=time_s, scene=scene) == []
    error_s = max(forbidden.from_error_s, forbidden.to_error_s) + 1e-3
    for by_s in (forbidden.from_s + error_s, forbidden.to_s - error_s):
        [row] = rows(later(plan, by_s), other, time_s=time_s, scene=scene)
        assert row.verdict in ("conflict", "grazing")


def test_a_pair_is_free_if_its_parts_are() -> None:
    """Its differences are not sharp enough; but what is before its first and after its last time is all of it."""
    one = planned("a", [(9.04179915294637, 70.00832906905529), (9.015148892911892, 70.02283924421913)], [2771, 3329],
                  200, 200, 10, 10)  # fmt: skip
    other = planned("b", [(8.95964151434367, 70.01195502123439), (9.053529824540597, 70.00212073661125)], [1243, 4110],
                    50, 0, 10, 10)  # fmt: skip
    scene = replace(NEAR, tolerance_m=1.0)
    assert rows(later(one, 639.216735), other, time_s=30.0, scene=scene) == []
    assert len(rows(later(one, 639.217), other, time_s=30.0, scene=scene)) == 1


def test_proposals_at_the_edge_are_clear() -> None:
    """`resolve` detects conflicts of the changed plans, and raises an error if there are any."""
    one, other = (
        planned(
            "T0",
            [(8.979610433484455, 70.00513561574917), (8.945956199036111, 70.01581632058341)],
            [118, 3094],
            200.0,
            200.0,
            50.0,
            50.0,
        ),
        planned(
            "T3",
            [(9.004419721821186, 70.0632918394707), (8.958193885797684, 70.00989720440756)],
            [380, 1163],
            200.0,
            200.0,
            50.0,
            50.0,
            grow_mps=0.05,
        ),
    )
    found = resolve([one, other], [], replace(NEAR, time_separation_s=600.0), within_s=7200.0, limit_s=5.0)
    assert [move.key for move in found.moves] != []


def test_no_period_ends_before_it_starts() -> None:
    """All parts of this pair are proven apart: it is free, and was a period from its end to its start."""
    ferry, other = (
        planned(
            "T3",
            [(-180.4592406613171, -84.92698764365346)] * 2
            + [(-180.57530768363614, -85.00616537201013), (-179.68693937508925, -84.94023254392646)],
            [1391.983987, 2866.983987, 5854.983987, 6341.983987],
            300.0,
            300.0,
            0.0,
            0.0,
        ),
        planned(
            "T2",
            [(-179.4585657311607, -85.03301538967835), (-180.5405740714129, -84.96890049980259)],
            [4057, 6340],
            300.0,
            300.0,
            150.0,
            0.0,
        ),
    )
    assert rows(ferry, other, time_s=45.0, scene=replace(NEAR, tolerance_m=1.0)) == []
    for row in rows(ferry, other, time_s=600.0, scene=replace(NEAR, tolerance_m=1.0)):
        assert all(start <= end for start, end in periods_s(row))


@pytest.mark.parametrize("of_all", [False, True], ids=["of one track", "of both"])
def test_ends_against_a_proven_contact_leave_the_pair_alone_unresolved(
    monkeypatch: pytest.MonkeyPatch, of_all: bool
) -> None:
    """A mistake of the search is no answer, and takes away no other: that pair of pieces is open all the time."""
    sound = rows(EAST, NORTH, area("here"), time_s=600.0)

    def inverted(*arguments: Any) -> np.ndarray:
        found = uses_of_place(*arguments)
        for member in "ab" if of_all else "a":
            start, end = f"{member}_start_us", f"{member}_end_us"
            found[start], found[end] = found[end].copy(), found[start].copy()
        return found

    monkeypatch.setattr("conflictdb.core.uses_of_tracks.uses_of_place", inverted)
    found = rows(EAST, NORTH, area("here"), time_s=600.0)
    assert len(found) == len(sound) == 3
    for row, before in zip(found, sound, strict=True):
        if {row.a_key, row.b_key} == {"east", "north"}:
            assert (row.verdict, row.lacking_s) == ("unresolved", None)
            [(start, end)], [(first, last)] = periods_s(row), periods_s(before)
            assert start < first < last < end
            assert row.time_error_s == pytest.approx(end - start)
        else:
            assert row == before


def test_method_screen_says_who_might() -> None:
    [row] = rows(EAST, later(NORTH, 400.0), time_s=300.0, scene=replace(SCENE, method=Method.SCREEN))
    assert (row.verdict, row.lacking_s) == ("unresolved", None)
    assert rows(EAST, later(NORTH, 90_000.0), time_s=300.0, scene=replace(SCENE, method=Method.SCREEN)) == []


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf, 2_592_000.5, 1e-7, 0.1234567, True, "60", None])
def test_other_values_are_refused(value: Any) -> None:
    with pytest.raises(InvalidInput, match="time_separation_s"):
        Scene("s", time_separation_s=value)


def test_it_is_not_for_the_published_program() -> None:
    with pytest.raises(InvalidInput, match="time_separation_s: is not known to method 'nlp'"):
        Scene("s", method=Method.NLP, time_separation_s=60.0)


def closest_shift_s(scene: Scene, a: Track, b: Track, within_s: float) -> tuple[float, float] | None:
    """The least time between uses of one place, and its error, by `delays`; None if there is none."""
    [found] = delays([a, b], [], replace(scene, time_separation_s=0.0), a.key, within_s)
    each = [(max(0.0, one.from_s, -one.to_s), max(one.from_error_s, one.to_error_s)) for one in found.forbidden]
    return min(each, default=None)


@pytest.mark.parametrize("workload", [LOW_LATITUDE, HARBOUR, SEAM, OCEAN, GROWING], ids=lambda one: one.name)
@pytest.mark.parametrize("separation_m", [0.0, 1000.0])
@draws("shifts", 4, 20)
def test_a_conflict_is_one_of_some_shift(workload: Workload, separation_m: float, shifts: int) -> None:
    """Pairs that shifts bring into conflict at one time; periods contain all contacts at such shifts."""
    rng = np.random.default_rng(1)
    seen = np.zeros(2, int)
    for seed in range(3):
        scene, _, tracks = plain_scene(workload, seed, 0, 4, tolerance_m=0.0, separation_m=separation_m)
        for (a, b), time_s in product(combinations(map(with_outlines, tracks), 2), (300.0, 14_400.0)):
            found = rows(a, b, time_s=time_s, scene=scene)
            least = closest_shift_s(scene, a, b, time_s)
            seen[int(bool(found))] += 1
            if not found:
                assert least is None or least[0] + least[1] >= time_s - 1e-4
                continue
            [row] = found
            assert least is not None
            assert row.lacking_s == pytest.approx(time_s - least[0], abs=row.time_error_s + least[1] + 1e-5)
            assert row.verdict == "conflict"
            low, high = np.inf, -np.inf
            shifts_s = np.append(rng.uniform(-time_s, time_s, shifts), [-time_s, time_s, max(least[0], 1e-3)])
            for shift_us in np.rint(1e6 * shifts_s).astype(int).tolist():
                for at_once in solve([a, shifted(b, -shift_us)], [], replace(scene, time_separation_s=0.0)):
                    for start, end in periods_s(at_once):
                        slack = at_once.time_error_s + 2e-6
                        low = min(low, start + slack, start + slack + shift_us / 1e6)
                        high = max(high, end - slack, end - slack + shift_us / 1e6)
            assert any(start <= low for start, _ in periods_s(row)) or low == np.inf
            assert any(end >= high for _, end in periods_s(row)) or high == -np.inf
    assert seen.all()


@pytest.mark.parametrize("workload", [LOW_LATITUDE, OCEAN], ids=lambda one: one.name)
def test_more_time_is_a_superset_and_names_do_not_matter(workload: Workload) -> None:
    scene, areas, tracks = plain_scene(workload, 3, 6, 8)
    areas = [
        replace(one, start_us=int(tracks[k].times_us[0]), end_us=int(tracks[k].times_us[-1]))
        for k, one in enumerate(areas)
    ]
    known: set[tuple[str, str]] = set()
    for time_s in (0.0, 60.0, 3600.0, 86_400.0):
        found = rows(*areas, *tracks, time_s=time_s, scene=scene)
        pairs = {(one.a_key, one.b_key) for one in found}
        assert pairs >= known
        known = pairs
    swapped = [replace(one, key=f"T{len(tracks) - k}") for k, one in enumerate(tracks)]
    names = {one.key: old.key for one, old in zip(swapped, tracks, strict=True)}
    mirrored = {
        tuple(sorted(names.get(key, key) for key in (one.a_key, one.b_key))): one
        for one in rows(*areas, *swapped, time_s=86_400.0, scene=scene)
    }
    assert mirrored.keys() == known
    for one in found:
        other = mirrored[tuple(sorted((one.a_key, one.b_key)))]
        assert one.verdict == other.verdict
        assert one.lacking_s == pytest.approx(other.lacking_s, abs=one.time_error_s + other.time_error_s + 1e-9)
        error_s = one.time_error_s + other.time_error_s + 1e-5
        assert _ends(one) == pytest.approx(_ends(other), abs=error_s)


def _ends(row: Conflict) -> list[float]:
    return [second for period in periods_s(row) for second in period]


def test_a_hundred_waypoints_and_growing_havens() -> None:
    """Conflicts of many pieces have one period where contacts follow on each other."""
    bends = [(0.01 * k, 0.002 * (k % 2)) for k in range(101)]
    times = T0_US + 1_000_000 * 150 * np.arange(101)
    way = Track("way", bends, times, rectangle_outline_m(50, 50, 20, 20), grow_mps=0.05)
    [row] = rows(way, later(way, 400.0, key="after"), time_s=390.0)
    assert len(row.periods) == 1
    assert row.verdict == "conflict"
    least = closest_shift_s(SCENE, way, later(way, 400.0, key="after"), 390.0)
    assert least is not None
    assert row.lacking_s == pytest.approx(390.0 - least[0], abs=row.time_error_s + least[1] + 1e-5)


def test_motion_on_great_circles_near_the_pole() -> None:
    scene = Scene("s", motion=Motion.GREAT_CIRCLE, tolerance_m=0.0)
    over = Track(
        "over", [(0.0, 85.0), (180.0, 85.0)], [T0_US, T0_US + 36_000_000_000], rectangle_outline_m(500, 500, 50, 50)
    )
    across = Track(
        "across", [(90.0, 85.0), (-90.0, 85.0)], over.times_us + 600_000_000, rectangle_outline_m(500, 500, 50, 50)
    )
    assert rows(over, across, time_s=0.0, scene=scene) == []
    [row] = rows(over, across, time_s=599.0, scene=scene)
    speed_mps = RADIUS_M * np.radians(10.0) / 36_000
    assert row.lacking_s == pytest.approx(599 - 600 + 1100 / speed_mps, abs=0.01)


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, OCEAN], ids=lambda one: one.name)
def test_regions_contain_all_places_that_are_shared(workload: Workload) -> None:
    """The first contact of each shift is in the region; so is the first of all."""
    rng, seen = np.random.default_rng(2), 0
    for seed in range(2):
        scene, areas, tracks = plain_scene(workload, seed, 2, 7)
        tracks = [with_outlines(one) for one in tracks]
        late = replace(scene, time_separation_s=86_400.0)
        for a, b in combinations(tracks, 2):
            [delayed] = delays([a, b], [], scene, a.key, 86_400.0)
            shifts_s = [rng.uniform(one.from_s, one.to_s) for one in delayed.forbidden for _ in range(5)]
            shifts_us = [round(-1e6 * by_s) for by_s in shifts_s]
            at_once = [one for by_us in shifts_us for one in solve([a, shifted(b, by_us)], [], scene)]
            for region, first_deg in regions_of(late, [a, b], []):
                assert shapely.distance(region, shapely.Point(first_deg)) < 1e-9
                for one in at_once:
                    assert shapely.distance(region, shapely.Point(one.first_contact_deg)) < 1e-9
                seen += len(at_once)
        for region, first_deg in regions_of(late, tracks, areas):
            assert shapely.distance(region, shapely.Point(first_deg)) < 1e-9
    assert seen > 10


def test_a_pair_that_fails_leaves_the_answers_of_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is unresolved for the time that both are there within the separation."""
    far = [
        replace(plan, key=key, positions_deg=np.add(plan.positions_deg, [5.0, 0.0]), max_speed_kn=np.inf)
        for key, plan in (("a", EAST), ("b", NORTH))
    ]
    plans = (EAST, NORTH, *far)
    before = {(one.a_key, one.b_key): one for one in rows(*plans, time_s=600.0)}
    assert len(before) == 2
    made = run.uses_of_tracks

    def fail(setup: Setup, prepared: Any, pairs: Any, some: Any, *rest: Any) -> Any:
        numbers = np.stack([prepared.pieces.object_id[side[some]] for side in (pairs.a, pairs.b)])
        if (np.sort(numbers, axis=0) == np.array([[2], [3]])).all(axis=0).any():  # east and north
            raise ValueError("no")
        return made(setup, prepared, pairs, some, *rest)

    monkeypatch.setattr(run, "uses_of_tracks", fail)
    after = {(one.a_key, one.b_key): one for one in rows(*plans, time_s=600.0)}
    assert after.keys() == before.keys()
    failed = after.pop(("east", "north"))
    assert failed.verdict == "unresolved"
    for (start, end), (first, last) in zip(failed.periods, before[("east", "north")].periods, strict=True):
        assert start <= first <= last <= end
    assert [(one.verdict, one.periods) for one in after.values()] == [
        (before[key].verdict, before[key].periods) for key in after
    ]


def regions_of(scene: Scene, tracks: list[Track], areas: list[Area]) -> list[tuple[shapely.Geometry, np.ndarray]]:
    """The region and the first contact of each conflict."""
    setup, batches = Setup.of(centred(scene, areas, tracks)), (AreaBatch.of(areas), TrackBatch.of(tracks))
    source = Memory(pieces_of(setup, *batches), batches)
    found = []
    for conflicts, _ in run_scene(setup, source):
        regions = conflicts.where(np.arange(len(conflicts))).geometries()
        found += list(zip(regions, conflicts.first_contact_deg, strict=True))
    return found


def test_an_object_that_cannot_be_cut_is_unresolved_with_what_comes_within_that_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def cut(setup: Setup, batch: TrackBatch) -> Any:
        if (batch.track_id == 1).any():
            raise ValueError("no")
        return track_pieces(setup, batch)

    monkeypatch.setattr("conflictdb.core.pieces.covers.track_pieces", cut)
    gone = later(NORTH, 2 * HALF_S + 600.0)
    assert rows(EAST, gone, time_s=600.0) == []
    [row] = rows(EAST, gone, time_s=700.0)
    assert (row.verdict, row.lacking_s) == ("unresolved", None)
    assert periods_s(row) == near(2 * HALF_S - 100.0, 2 * HALF_S + 700.0)


def test_times_of_others_do_not_matter_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """With 0 nothing of it runs."""
    for name in ("uses_of_contacts", "uses_of_tracks", "as_contacts", "with_wide_areas"):
        monkeypatch.setattr(f"conflictdb.core.run.{name}", None)
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 1, 6, 6)
    assert len(rows(*areas, *tracks, time_s=0.0, scene=scene)) > 3


def test_advice_counts_what_comes_within_that_time() -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 1, 5, 15)
    at_once, late = (advise(replace(scene, time_separation_s=time_s), areas, tracks) for time_s in (0.0, 3600.0))
    assert late.pairs > at_once.pairs


def factors_of(*objects: Track | Area, time_s: float, leg: int | None = None, most: float = 2.0) -> Speeds:
    tracks, areas = ([one for one in objects if isinstance(one, kind)] for kind in (Track, Area))
    [found] = speeds(tracks, areas, replace(SCENE, time_separation_s=time_s), "east", 1.0 / most, most, leg=leg)
    return found


def ends_of_speeds(found: Speeds) -> list[tuple[float, float]]:
    return [(one.from_factor, one.to_factor) for one in found.forbidden]


def about(low: float, high: float) -> list[tuple[object, object]]:
    return [(pytest.approx(low, abs=2e-9), pytest.approx(high, abs=2e-9))]


def test_speeds_at_a_crossing() -> None:
    """The extreme factors are those of the corners of the contact set, with the other earlier and later."""
    first_s, last_s = HALF_S - (1000 + 50) / SPEED_MPS, HALF_S + (500 + 50) / SPEED_MPS
    other_s = HALF_S - (300 + 100) / SPEED_MPS, HALF_S + (200 + 100) / SPEED_MPS
    for time_s in (1e-6, 1.0, 600.0, 3000.0):
        found = factors_of(EAST, NORTH, time_s=time_s)
        assert ends_of_speeds(found) == about(first_s / (other_s[1] + time_s), last_s / (other_s[0] - time_s))
        assert found.forbidden[0].by == ("north",)
        assert found.slower == pytest.approx(found.forbidden[0].from_factor, abs=2e-12)
        assert found.forbidden[0].is_proven == (time_s >= 1.0)
        if found.forbidden[0].is_proven:
            assert max(found.forbidden[0].from_error, found.forbidden[0].to_error) < 5e-9
    [always] = factors_of(EAST, NORTH, time_s=50_000.0).forbidden
    assert (always.from_factor, always.to_factor, always.is_proven) == (0.5, 2.0, True)


def test_the_nearest_free_speed_clears_in_time_and_one_that_is_a_little_nearer_does_not() -> None:
    found = factors_of(EAST, NORTH, time_s=600.0)
    assert found.slower is not None
    assert found.faster is not None
    for factor, nearer in ((found.slower, 1e-8), (found.faster, -1e-8)):
        for shift, meets in ((0.0, False), (nearer, True)):
            assert bool(rows(stretched(EAST, factor + shift), NORTH, time_s=600.0)) == meets


def test_speeds_of_a_leg_and_of_an_area_with_times() -> None:
    times_us = T0_US + np.rint(1e6 * HALF_S * np.array([0.0, 0.5, 2.0])).astype(np.int64)
    way = replace(EAST, positions_deg=[(0.0, 0.0), (0.25, 0.0), (1.0, 0.0)], times_us=times_us)
    leg_s, earlier_s, later_s = 0.5 * HALF_S, (500 + 50 + 300 + 100) / SPEED_MPS, (1000 + 50 + 200 + 100) / SPEED_MPS
    assert ends_of_speeds(factors_of(way, NORTH, time_s=600.0, leg=1)) == about(
        leg_s / (leg_s + later_s + 600.0), leg_s / (leg_s - earlier_s - 600.0)
    )
    by = later(replace(NORTH, key="by", positions_deg=NORTH.positions_deg - [0.4, 0.0]), 500.0 - 0.8 * HALF_S)
    assert ends_of_speeds(factors_of(way, by, time_s=60.0, leg=2)) == []
    assert ends_of_speeds(factors_of(way, by, time_s=600.0, leg=2)) == [(0.5, 2.0)]
    first_s = (RADIUS_M * np.radians(0.4) - 1000) / SPEED_MPS
    last_s = (RADIUS_M * np.radians(0.6) + 500) / SPEED_MPS
    for time_s in (1.0, 300.0):
        assert ends_of_speeds(factors_of(EAST, area("closed", 8000, 9000), time_s=time_s)) == about(
            first_s / (9000 + time_s), min(last_s / (8000 - time_s), 2.0)
        )


def test_speeds_near_the_departure() -> None:
    """What passes the place of departure half an hour before it forbids each speed, if it is that near in time."""
    before = later(replace(NORTH, key="by", positions_deg=NORTH.positions_deg - [0.5, 0.0]), -HALF_S - 1800.0)
    assert ends_of_speeds(factors_of(EAST, before, time_s=1000.0)) == []
    assert ends_of_speeds(factors_of(EAST, before, time_s=2000.0, most=50.0)) == [(0.02, 50.0)]


def test_a_proposal_of_a_speed_keeps_the_separation_in_time() -> None:
    scene = replace(SCENE, time_separation_s=600.0)
    found = resolve([EAST, NORTH], [], scene, keys=["east"], within_s=0.0, slowest=0.5, fastest=2.0)
    assert [(move.key, move.speed != 1.0) for move in found.moves] == [("east", True)]
    advised = factors_of(EAST, NORTH, time_s=600.0)
    assert found.moves[0].speed in (advised.slower, advised.faster)
    assert rows(stretched(EAST, found.moves[0].speed), NORTH, time_s=600.0) == []


@pytest.mark.parametrize("workload", [LOW_LATITUDE, GROWING, SEAM], ids=lambda one: one.name)
def test_speeds_are_forbidden_that_bring_a_use_within_the_time_of_the_pair(workload: Workload) -> None:
    """The copies of a track have one owner, so that one `solve` compares each with all others."""
    scene, areas, tracks = plain_scene(workload, 5, 4, 10, tolerance_m=0.0)
    classes = ["one", "two"]
    tracks = [replace(one, object_class=classes[n % 2]) for n, one in enumerate(tracks)]
    rules = (Rule("one", "two", time_s=900.0), Rule("two", "area", time_s=60.0))
    scene, rng, count = replace(scene, time_separation_s=120.0, rules=rules), np.random.default_rng(5), 0
    for one in tracks[:4]:
        [found] = speeds(tracks, areas, scene, one.key, 0.6, 1.8)
        ends = [end for some in found.forbidden for end in (some.from_factor, some.to_factor)]
        factors = np.concatenate([rng.uniform(0.6, 1.8, 6), *([end - 1e-6, end + 1e-6] for end in ends)])
        factors = np.append(factors, [free for free in (found.slower, found.faster) if free is not None])
        factors = factors[(factors >= 0.6) & (factors <= 1.8)]
        copies = [
            replace(stretched(one, factor), key=f"copy {n}", owner="copies")
            for n, factor in enumerate(factors.tolist())
        ]
        rest = [other for other in tracks if other.key != one.key]
        met = {key for row in solve([*rest, *copies], areas, scene) for key in (row.a_key, row.b_key)}
        for n, factor in enumerate(factors.tolist()):
            is_met, case = f"copy {n}" in met, (one.key, factor, found.forbidden)
            by = [some for some in found.forbidden if some.from_factor <= factor <= some.to_factor]
            assert by or not is_met, case
            for some in by:
                inside = some.from_error + 1e-7 <= factor - some.from_factor
                inside &= some.to_error + 1e-7 <= some.to_factor - factor
                assert is_met or not (some.is_proven and inside), case
            count += 1
    assert count > 12


@pytest.mark.parametrize("workload", [LOW_LATITUDE, OCEAN], ids=lambda one: one.name)
def test_delays_are_forbidden_that_bring_a_use_within_that_time(workload: Workload) -> None:
    """Forbidden intervals are those without it, longer at both ends; of waits, `solve` says so."""
    scene, areas, tracks = plain_scene(workload, 5, 3, 6, tolerance_m=0.0)
    areas = [replace(one, start_us=int(tracks[0].times_us[0]), end_us=int(tracks[0].times_us[-1])) for one in areas]
    tracks = [with_outlines(one) for one in tracks]
    late = replace(scene, time_separation_s=1800.0)
    met = 0
    for plain, wide in zip(
        delays(tracks, areas, scene, within_s=20_000.0), delays(tracks, areas, late, within_s=18_200.0), strict=True
    ):
        expected: list[list[float]] = []
        for one in plain.forbidden:
            low, high = max(one.from_s - 1800.0, -18_200.0), min(one.to_s + 1800.0, 18_200.0)
            if low > high:
                continue
            if expected and low <= expected[-1][1] + 2e-6:
                expected[-1][1] = max(high, expected[-1][1])
            else:
                expected.append([low, high])
        assert [[one.from_s, one.to_s] for one in wide.forbidden] == [pytest.approx(one, abs=1e-5) for one in expected]
        met += len(expected)
    assert met > 3
    rng, seen = np.random.default_rng(3), set()
    for track_of in tracks[:3]:
        others = [one for one in tracks if one is not track_of]
        [found] = delays(tracks, areas, late, track_of.key, 20_000.0, waypoint=1)
        for wait_us in rng.integers(0, 20_000_000_000, 5).tolist():
            is_forbidden = any(one.from_s <= wait_us / 1e6 <= one.to_s for one in found.forbidden)
            own = [
                one
                for one in solve([waiting(track_of, 1, wait_us), *others], areas, late)
                if track_of.key in (one.a_key, one.b_key)
            ]
            assert bool(own) == is_forbidden
            seen.add(is_forbidden)
    assert True in seen
