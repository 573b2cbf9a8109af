"""Speeds and waits agree with a detection: no free one conflicts, and none proven forbidden is free.

Changed copies of a track go through stages 2 to 4 (`shifting`), most of them near a reported end.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from corners import KEY, corner
from layouts import GROWING, HARBOUR, HIGH_LATITUDE, LOW_LATITUDE, OCEAN, SEAM, WORKLOADS, Workload
from mixed_scenes import plain_scene
from shifting import is_forbidden, meets_when_changed, shifts_of, stretched, waiting

from conflictdb import Area, Scene, Speeds, Track, delays, solve, speeds

# Steps from an end, by the planned speed.
_NEAR = np.array([-1e-3, -1e-6, -1e-8, -1e-10, -1e-11, -1e-12, 0.0, 1e-12, 1e-11, 1e-10, 1e-8, 1e-6, 1e-3])
# An inner end is computed from exact times; rounding them by up to half a microsecond may free it this far inside.
_ROUNDED_S = 2e-6


def some_scene(workload: Workload, seed: int, rng: np.random.Generator) -> tuple[Scene, list[Area], list[Track]]:
    """A scene with a tolerance and a separation of several sizes."""
    tolerance_m, separation_m = float(rng.choice([0, 1, 100])), float(rng.choice([0, 0, 500, 1852, 9260]))
    return plain_scene(workload, seed, 10, 20, tolerance_m=tolerance_m, separation_m=separation_m)


def factors_of(found: Speeds, slowest: float, fastest: float, rng: np.random.Generator) -> np.ndarray:
    """Factors at random, and near the ends of forbidden intervals."""
    ends = [
        end
        for one in found.forbidden
        for end in (one.from_factor, one.from_factor + one.from_error, one.to_factor, one.to_factor - one.to_error)
    ]
    nearest = [end for end in (found.slower, found.faster) if end is not None]
    near = np.array(ends).reshape(-1)[:, None] + _NEAR
    every = np.concatenate([np.exp(rng.uniform(np.log(slowest), np.log(fastest), 30)), near.ravel(), nearest])
    return np.unique(every[(every >= slowest) & (every <= fastest)])


def checked(workload: Workload, scenes: int, tracks: int, seed: int, *, legs: bool) -> tuple[int, int]:
    """Compare many speeds; return their number, and the number in conflict.

    legs : another speed on one leg, else on all of them
    """
    rng, count, conflicts = np.random.default_rng(seed), 0, 0
    for number in range(scenes):
        scene, areas, every = some_scene(workload, 1000 * seed + number, rng)
        slowest, fastest = [(0.9, 1.1), (0.5, 2.0), (0.05, 20.0)][int(rng.integers(3))]
        for row in rng.choice(len(every), tracks, replace=False):
            one = every[row]
            leg = int(rng.integers(1, len(one.times_us))) if legs else None
            [found] = speeds(every, areas, scene, one.key, slowest, fastest, leg=leg)
            factors = factors_of(found, slowest, fastest, rng)
            copies = [stretched(one, factor, leg) for factor in factors.tolist()]
            meets = np.array([bool(met) for met in meets_when_changed(scene, areas, every, one.key, copies)])
            forbidden, proven = forbidden_of(found, factors, one, leg)
            case = f"{scene}, seed {1000 * seed + number}, {one.key}, leg {leg}"
            assert not (meets & ~forbidden).any(), f"free, but in conflict: {factors[meets & ~forbidden]}, {case}"
            assert not (proven & ~meets).any(), f"proven, but free: {factors[proven & ~meets]}, {case}"
            count, conflicts = count + len(factors), conflicts + int(meets.sum())
    return count, conflicts


def forbidden_of(found: Speeds, factors: np.ndarray, track: Track, leg: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Whether each factor is in a forbidden interval, and whether it is proven to be, also of rounded times."""
    first, last = (0, -1) if leg is None else (leg - 1, leg)
    lasts_s = float(track.times_us[last] - track.times_us[first]) / 1e6
    forbidden, proven = np.zeros(len(factors), np.bool_), np.zeros(len(factors), np.bool_)
    for one in found.forbidden:
        low, high = one.from_factor, one.to_factor
        forbidden |= (factors >= low) & (factors <= high)
        # A contact soon after the departure moves little with the speed.
        inside = 1e-3 if leg is None else factors**2 * _ROUNDED_S / lasts_s + 1e-6
        proven |= one.is_proven & (factors >= low + one.from_error + inside) & (factors <= high - one.to_error - inside)
    return forbidden, proven


@pytest.mark.parametrize("legs", [False, True], ids=["track", "leg"])
@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
def test_no_speed_is_called_free_that_conflicts_nor_proven_that_is_free(workload: Workload, legs: bool) -> None:
    count, _ = checked(workload, 1, 3, 0, legs=legs)
    assert count > 100


def test_a_speed_at_which_a_detection_reports_a_near_graze_is_not_free() -> None:
    """The speed stays forbidden for a pair that is 0.25 um too far apart for two microseconds: below the resolution."""
    assert checked(HARBOUR, 1, 4, 1002, legs=False)[0] > 100


@pytest.mark.slow
@pytest.mark.parametrize("legs", [False, True], ids=["track", "leg"])
@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
def test_many_speeds(workload: Workload, legs: bool) -> None:
    count, conflicts = checked(workload, 40, 4, 1, legs=legs)
    assert count > 5_000
    assert conflicts > 500


def checked_waits(workload: Workload, scenes: int, tracks: int, seed: int) -> int:
    """Compare many waits; return their number."""
    rng, count = np.random.default_rng(seed), 0
    for number in range(scenes):
        scene, areas, every = some_scene(workload, 1000 * seed + number, rng)
        within_s = float(rng.choice([1.0, 600.0, 7200.0])) if workload is not HARBOUR else 600.0
        for row in rng.choice(len(every), tracks, replace=False):
            one = every[row]
            waypoint = int(rng.integers(1, len(one.times_us)))
            [found] = delays(every, areas, scene, one.key, within_s, waypoint=waypoint)
            assert found.least_earlier_s in (0.0, None)
            waits_us = shifts_of(found, round(1e6 * within_s), rng, 40)
            waits_us = waits_us[waits_us >= 0]
            copies: list[Any] = [waiting(one, waypoint, wait) for wait in waits_us.tolist()]
            meets = np.array([bool(met) for met in meets_when_changed(scene, areas, every, one.key, copies)])
            forbidden, proven = is_forbidden(found, waits_us)
            case = f"{scene}, seed {1000 * seed + number}, {one.key}, waypoint {waypoint}"
            assert not (meets & ~forbidden).any(), f"free, but in conflict: {waits_us[meets & ~forbidden]}, {case}"
            assert not (proven & ~meets).any(), f"proven, but free: {waits_us[proven & ~meets]}, {case}"
            count += len(waits_us)
    return count


@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, SEAM, OCEAN, GROWING], ids=lambda one: one.name)
def test_no_wait_is_called_free_that_conflicts_nor_proven_that_is_free(workload: Workload) -> None:
    assert checked_waits(workload, 2, 3, 0) > 100


@pytest.mark.slow
@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
def test_many_waits(workload: Workload) -> None:
    assert checked_waits(workload, 40, 4, 1) > 5_000


def checked_corners(seeds: range) -> tuple[int, int]:
    """Compare waits at corners with detections; return the number of waits, and of those in conflict."""
    count, conflicts = 0, 0
    for seed in seeds:
        scene, areas, tracks, waypoint = corner(seed)
        rng = np.random.default_rng(seed)
        [one] = (track for track in tracks if track.key == KEY)
        rest = [track for track in tracks if track.key != KEY]
        [found] = delays(tracks, areas, scene, KEY, 3600.0, waypoint=waypoint)
        waits_us = shifts_of(found, 3_600_000_000, rng, 30)
        waits_us = np.unique(np.append(waits_us[waits_us >= 0], np.linspace(0, 3_600_000_000, 25).astype(np.int64)))
        # Copies of one owner are not compared with each other.
        copies = [
            replace(waiting(one, waypoint, wait), key=f"copy {n}", owner=one.owner or "copies", max_speed_kn=np.inf)
            for n, wait in enumerate(waits_us.tolist())
        ]
        met = {key for pair in solve([*rest, *copies], areas, scene) for key in (pair.a_key, pair.b_key)}
        meets = np.array([copy.key in met for copy in copies])
        forbidden, proven = is_forbidden(found, waits_us)
        case = f"corner {seed}, waypoint {waypoint}"
        assert not (meets & ~forbidden).any(), f"free, but in conflict: {waits_us[meets & ~forbidden]}, {case}"
        assert not (proven & ~meets).any(), f"proven, but free: {waits_us[proven & ~meets]}, {case}"
        count, conflicts = count + len(waits_us), conflicts + int(meets.sum())
    return count, conflicts


def test_a_wait_at_a_corner_has_the_heading_haven_and_heights_of_the_leg_before() -> None:
    count, conflicts = checked_corners(range(16))
    assert count > 400
    assert conflicts > 80


@pytest.mark.slow
def test_many_waits_at_corners() -> None:
    checked_corners(range(1_000, 2_000))
