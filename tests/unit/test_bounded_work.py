"""Hostile objects cost a bounded amount of work, counted and not timed: the test must not depend on the machine."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from layouts import GROWING, HARBOUR, HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE, OCEAN, Workload
from mixed_scenes import plain_scene
from staged import Staged
from verdicts import periods_us

from conflictdb import Area, Scene, Track, Verdict, rectangle_outline_m, solve
from conflictdb.arrays.objects import TrackBatch
from conflictdb.core import whole_areas
from conflictdb.core.object_pairs import company_of
from conflictdb.core.pieces.cutting import MAX_SLICES, MAX_SLICES_FOR_DEVIATION, track_pieces
from conflictdb.core.stage4.contact_search import CONFLICT, GRAZING, UNRESOLVED
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import EarthModel

T0_US = 1_700_000_000_000_000
MINUTE_US = 60_000_000
# As conflictdb/kernel/narrow/contacts.c has it: intervals looked at for two objects, in each step of their search.
MAX_INTERVALS = 131_072


def track(key: str, positions: Any, half_m: float) -> Track:
    times = T0_US + MINUTE_US * np.arange(len(positions))
    return Track(
        key,
        np.array(positions, np.float64),
        times,
        rectangle_outline_m(half_m, half_m, half_m, half_m),
        max_speed_kn=np.inf,
    )


def counted_calls(monkeypatch: pytest.MonkeyPatch, module: Any, name: str) -> Callable[[], int]:
    """Count the calls of a function of a module."""
    function, calls = getattr(module, name), [0]

    def counting(*arguments: Any, **more: Any) -> Any:
        calls[0] += 1
        return function(*arguments, **more)

    monkeypatch.setattr(module, name, counting)
    return lambda: calls[0]


def test_a_wide_haven_that_bends_near_the_poles_makes_a_bounded_number_of_pieces() -> None:
    """Every leg of it comes near a pole: without a bound for all of them together there were tens of thousands."""
    there = [(lon, 88.4 if k % 2 else -88.4) for k, lon in enumerate(np.mod(np.arange(30) * 170.0, 360.0) - 180.0)]
    wide = track("wide", there, 40_000.0)
    pieces = track_pieces(Setup.of(Scene("s")), TrackBatch.of([wide]))
    assert len(pieces) > MAX_SLICES  # it bends
    own = np.count_nonzero(pieces.turn == 0)
    assert own <= 29 * MAX_SLICES + MAX_SLICES_FOR_DEVIATION
    # In a batch it is cut as it is alone.
    both = track_pieces(Setup.of(Scene("s")), TrackBatch.of([wide, track("other", there[:3], 40_000.0)]))
    assert np.count_nonzero(both.object_id == both.object_id[0]) == len(pieces)


def test_a_track_that_grazes_in_all_of_its_pieces_is_taken_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A point that goes along the edge of an area of two parts: all of its pieces are looked at, in few calls."""
    asked = counted_calls(monkeypatch, whole_areas, "whole_depths")
    along = track("T", [(4.0 + 0.002 * k, 57.5) for k in range(51)], 0.0)
    area = shapely.MultiPolygon([shapely.box(3.0, 57.0, 4.05, 57.5), shapely.box(4.0500000000001, 57.0, 6.0, 57.5)])
    (found,) = solve([along], [Area("A", area)], Scene("s"))
    assert found.verdict == Verdict.GRAZING
    assert periods_us(found) == ((T0_US, T0_US + 50 * MINUTE_US),)
    assert 0 < asked() < 20


def test_a_track_of_which_nothing_can_be_proven_takes_bounded_work() -> None:
    """A point that hardly moves on the edge of an area: each of its pieces would be split thousands of times."""
    still = track("T", [(10.0 + 1e-12 * k, -89.0) for k in range(20)], 0.0)
    scene, area = Scene("s", tolerance_m=0.0), shapely.MultiPolygon([shapely.box(-180.0, -89.0, 180.0, 89.0)])
    staged = Staged.of(scene, [Area("A", area)], [still])
    shared = replace(staged.pairs, company=company_of(staged.pieces, staged.pairs))
    found, effort = replace(staged, pairs=shared).contacts()
    assert set(found.verdict.tolist()) == {GRAZING}
    assert MAX_INTERVALS < effort.exact.windows < 4 * MAX_INTERVALS


@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS, HARBOUR], ids=lambda w: w.name)
def test_a_larger_tolerance_takes_no_more_work_for_a_pair(workload: Workload) -> None:
    """Closest approaches, counted: a pair that only comes within the tolerance costs no more than the tolerance allows.

    Also in a harbour, where everything is smaller than the tolerance.
    """
    taken = []
    for tolerance_m in (0.0, 0.01, 1.0, 10.0, 100.0, 1000.0):
        work, pairs, close, searched = 0, 0, 0, 0
        for seed in range(12):
            scene, areas, tracks = plain_scene(workload, seed, 10, 10, tolerance_m=tolerance_m)
            conflicts, funnel = Staged.of(scene, areas, tracks).run()
            work += funnel.effort.exact.windows + funnel.effort.exact.evaluations
            pairs += funnel.solved_pairs
            searched += funnel.effort.exact.searched_pairs
            close += int((conflicts.closest_m > 0.0).sum())
            assert (conflicts.closest_error_m <= tolerance_m + 1e-3).all()
        taken.append(work / pairs)
        # Corners that pass each other at about the tolerance are decided without a search.
        assert searched <= 0.01 * pairs
    assert close >= 1
    assert max(later / earlier for k, earlier in enumerate(taken) for later in taken[k:]) <= 1.03


@pytest.mark.parametrize("tolerance_m", [99.0, 100.0, 101.0])
def test_what_glides_past_just_beyond_the_tolerance_is_soon_clear(tolerance_m: float) -> None:
    """Along a side, where both reach so far north that the plane's scale says little: that took 14,000 windows."""
    box = shapely.MultiPolygon([shapely.box(10.0, 75.0, 12.0, 76.0)])
    earth_m = 6_371_008.8 * np.radians(1.0)
    half_m = 10_000.0
    middle = 75.0 - (half_m + 102.0) / earth_m
    times = T0_US + 60 * MINUTE_US * np.arange(2)
    outline = rectangle_outline_m(half_m, half_m, half_m, half_m)
    passes = Track("T", np.array([(9.0, middle), (13.0, middle)]), times, outline, max_speed_kn=np.inf)
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=tolerance_m)
    staged = Staged.of(scene, [Area("A", box)], [passes])
    assert len(staged.pairs)
    conflicts, funnel = staged.run()
    assert not len(conflicts)
    assert funnel.effort.exact.windows < 600


@pytest.mark.parametrize(
    ("share", "verdict"), [(0.999, CONFLICT), (0.999999998, UNRESOLVED), (1.000000002, UNRESOLVED)]
)
def test_what_stands_within_rounding_of_the_separation_is_not_halved(share: float, verdict: int) -> None:
    """No part of the time is decided: that took 49,000 windows, twenty times as long."""
    lon_deg = 10.0 + np.degrees(share / 6_371_008.771415)
    tracks = [track("A", [(10.0, 0.0)] * 2, 0.0), track("B", [(lon_deg, 0.0)] * 2, 0.0)]
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=1e-9, separation_m=1.0)
    found, effort = Staged.of(scene, [], tracks).contacts()
    assert found.verdict.tolist() == [verdict]
    assert effort.exact.windows < 50


def test_pairs_of_pieces_share_with_those_of_the_same_objects() -> None:
    tracks = [track("A", [(4.0, 57.0), (5.0, 57.0), (6.0, 57.0)], 10.0), track("B", [(4.0, 57.0), (4.1, 57.0)], 10.0)]
    staged = Staged.of(Scene("s"), [], tracks)
    assert company_of(staged.pieces, staged.pairs).tolist() == [len(staged.pairs)] * len(staged.pairs)


# Evaluations of two polygons at an instant, per pair of pieces after stage 2, when the limits were last set. Columns:
# conflicts alone, a separation of 500 m, closest approaches within 5 km.
EVALUATIONS = {
    LOW_LATITUDE: (3.23, 103.0, 160.9),
    HIGH_LATITUDE: (3.44, 20.4, 158.8),
    LONG_LEGS: (2.84, 19.6, 101.1),
    HARBOUR: (1.61, 32.8, 13.2),
    GROWING: (7.57, 34.6, 14.5),
    OCEAN: (3.28, 21.8, 7.46),
}


@pytest.mark.parametrize("workload", EVALUATIONS, ids=lambda one: one.name)
def test_evaluations_per_pair_do_not_grow(workload: Workload) -> None:
    """By more than a twentieth; lower the limits after they shrink."""
    scene, areas, tracks = plain_scene(workload, 1, 20, 20)
    for (separation_m, nearest_m), limit in zip(
        ((0.0, 0.0), (500.0, 0.0), (0.0, 5000.0)), EVALUATIONS[workload], strict=True
    ):
        scene = replace(scene, separation_m=separation_m, nearest_m=nearest_m)
        staged = Staged.of(scene, areas, tracks)
        _, funnel = staged.run()
        assert funnel.effort.exact.evaluations < 1.05 * limit * len(staged.pairs), (separation_m, nearest_m)
