"""Delays agree with a detection: no free delay conflicts, and no delay proven forbidden is free.

Shifted copies of a track go through stages 2 to 4 (`shifting`). A quarter of the shifts is within 10 us of a reported
end.
"""

from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
import pytest
from layouts import GROWING, GROWING_CIRCLES, HARBOUR, HIGH_LATITUDE, LOW_LATITUDE, OCEAN, SEAM, WORKLOADS, Workload
from mixed_scenes import plain_scene
from shifting import is_forbidden, meets_when_shifted, shifted, shifts_of

from conflictdb import Area, Delays, Scene, Track, delays, solve

Objects = tuple[Scene, list[Area], list[Track]]


def some_scene(workload: Workload, seed: int, rng: np.random.Generator) -> Objects:
    """A scene with a tolerance and a separation of several sizes."""
    tolerance_m, separation_m = float(rng.choice([0, 1, 100])), float(rng.choice([0, 0, 500, 1852, 9260]))
    return plain_scene(workload, seed, 10, 20, tolerance_m=tolerance_m, separation_m=separation_m)


def waiting_first(track: Track, waits_us: int) -> Track:
    """The track, after a leg that stands still at its first waypoint."""
    more: dict[str, Any] = {
        name: np.concatenate([values[:1], values])
        for name in ("outlines_m", "floors_m", "ceilings_m")
        if (values := getattr(track, name)) is not None
    }
    positions_deg = np.concatenate([track.positions_deg[:1], track.positions_deg])
    times_us = np.concatenate([track.times_us[:1] - waits_us, track.times_us])
    return replace(track, positions_deg=positions_deg, times_us=times_us, max_speed_kn=np.inf, grow_mps=0.0, **more)


def checked(workload: Workload, scenes: int, tracks: int, seed: int, *, waits: bool = False) -> tuple[int, int]:
    """Compare many shifts; return their number, and the number near an end.

    waits : each track begins with a leg that stands still
    """
    rng, count, near_ends = np.random.default_rng(seed), 0, 0
    for number in range(scenes):
        scene, areas, every = some_scene(workload, 1000 * seed + number, rng)
        if waits:
            every = [waiting_first(track, int(rng.integers(1, 3_600_000_000))) for track in every]
        # From a second to ten days; in a harbour everything is over after some minutes.
        within_s = float(rng.choice([1.0, 600.0, 7200.0, 40_000.0, 864_000.0]))
        within_s = min(within_s, 1200.0) if workload is HARBOUR else within_s
        for row in rng.choice(len(every), tracks, replace=False):
            key = every[row].key
            [found] = delays(every, areas, scene, key, within_s)
            shifts_us = shifts_of(found, round(1e6 * within_s), rng, 40)
            meets = np.array([bool(met) for met in meets_when_shifted(scene, areas, every, key, shifts_us)])
            forbidden, proven = is_forbidden(found, shifts_us)
            case = f"{scene}, seed {1000 * seed + number}, {key}, {within_s} s"
            assert not (meets & ~forbidden).any(), f"free, but in conflict: {shifts_us[meets & ~forbidden]}, {case}"
            assert not (proven & ~meets).any(), f"proven, but free: {shifts_us[proven & ~meets]}, {case}"
            ends_us = 1e6 * np.array([end for one in found.forbidden for end in (one.from_s, one.to_s)])
            count += len(shifts_us)
            near_ends += int((np.abs(shifts_us[:, None] - ends_us).min(axis=1, initial=np.inf) <= 10).sum())
    return count, near_ends


@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
def test_no_delay_is_called_free_that_conflicts_nor_proven_that_is_free(workload: Workload) -> None:
    count, _ = checked(workload, 2, 3, 0)
    assert count > 200


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, OCEAN, GROWING], ids=lambda workload: workload.name)
def test_nor_if_tracks_wait_at_their_first_waypoint(workload: Workload) -> None:
    count, _ = checked(workload, 2, 3, 2, waits=True)
    assert count > 200


@pytest.mark.slow
@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
def test_many_delays(workload: Workload) -> None:
    """More than 100,000 shifts over all workloads."""
    count, near_ends = checked(workload, 40, 4, 1)
    assert count > 10_000
    checked(workload, 10, 4, 3, waits=True)
    assert near_ends > 0.15 * count


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, OCEAN, GROWING], ids=lambda workload: workload.name)
def test_two_tracks_mirror_each_other(workload: Workload) -> None:
    """Forbidden delays of a with respect to b are those of b with the other sign; to the bit if both are requested."""
    rng = np.random.default_rng(0)
    scene, _, tracks = some_scene(workload, 3, rng)
    seen = 0
    for one, other in zip(tracks[::2], tracks[1::2], strict=True):
        a, b = sorted((one, other), key=lambda track: track.key)
        of_a, of_b = delays([a, b], [], scene, within_s=864_000.0)
        mirrored = [(-each.to_s, -each.from_s, each.is_proven) for each in reversed(of_b.forbidden)]
        assert [(each.from_s, each.to_s, each.is_proven) for each in of_a.forbidden] == mirrored
        [alone] = delays([a, b], [], scene, b.key, 864_000.0)
        assert _overlap(alone, of_b)
        seen += len(of_a.forbidden)
    assert seen > 0


def _overlap(one: Delays, other: Delays) -> bool:
    """Whether two answers to the same question agree to their errors."""
    if len(one.forbidden) != len(other.forbidden):
        return False
    return all(
        abs(x.from_s - y.from_s) <= x.from_error_s + y.from_error_s + 2e-6
        and abs(x.to_s - y.to_s) <= x.to_error_s + y.to_error_s + 2e-6
        for x, y in zip(one.forbidden, other.forbidden, strict=True)
    )


@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, OCEAN], ids=lambda workload: workload.name)
def test_a_larger_distance_or_one_more_object_forbids_no_less(workload: Workload) -> None:
    """Up to the errors of ends."""
    scene, areas, tracks = plain_scene(workload, 5, 10, 12)
    last = tracks[-1].key
    before = {one.key: one for one in delays(tracks[:-1], areas, scene)}
    for more in (
        delays(tracks, areas, scene),
        delays(tracks[:-1], areas, replace(scene, separation_m=1852.0)),
        delays(tracks[:-1], areas, replace(scene, tolerance_m=100.0)),
    ):
        for one in more:
            if one.key == last:
                continue
            for each in before[one.key].forbidden:
                assert any(
                    large.from_s <= each.from_s + each.from_error_s and each.to_s - each.to_error_s <= large.to_s
                    for large in one.forbidden
                )


@pytest.mark.parametrize(
    ("workload", "separation_m", "median_s", "most_s"),
    [
        (LOW_LATITUDE, 0.0, 5e-6, 1e-3),
        (LOW_LATITUDE, 9260.0, 1e-2, 10.0),
        (OCEAN, 0.0, 5e-6, 1e-2),
        (OCEAN, 9260.0, 0.1, 10.0),
        (GROWING, 0.0, 5e-6, 2.0),
        (GROWING_CIRCLES, 1852.0, 0.1, 10.0),
    ],
    ids=lambda value: value.name if isinstance(value, Workload) else None,
)
def test_ends_are_sharp(workload: Workload, separation_m: float, median_s: float, most_s: float) -> None:
    """Also where contact sets are bent, or have several parts, as havens change their shape."""
    scene, areas, tracks = plain_scene(workload, 0, 20, 30, tolerance_m=1.0, separation_m=separation_m)
    found = [each for one in delays(tracks, areas, scene, within_s=40_000.0) for each in one.forbidden]
    errors_s = [error_s for each in found if each.is_proven for error_s in (each.from_error_s, each.to_error_s)]
    assert np.mean([each.is_proven for each in found]) > 0.9
    assert np.median([error_s for error_s in errors_s if error_s > 0.0]) <= median_s
    assert max(errors_s) <= most_s


@pytest.mark.parametrize("workload", [GROWING, GROWING_CIRCLES], ids=lambda workload: workload.name)
def test_delays_of_growing_havens_are_proven_and_sharp(workload: Workload) -> None:
    """If a pair of pieces leaves an end uncertain, other pieces prove the rest."""
    count = 0
    for seed in range(10):
        scene, areas, tracks = plain_scene(workload, seed, 15, 20, tolerance_m=0.0, separation_m=500.0 * (seed % 2))
        for one in delays(tracks, areas, scene, within_s=864_000.0):
            assert all(each.is_proven for each in one.forbidden)
            assert all(max(each.from_error_s, each.to_error_s) <= 2.0 for each in one.forbidden)
            count += len(one.forbidden)
    assert count > 200


def cleared(workload: Workload, scenes: int) -> int:
    """Apply least delays in both directions, and a little less; return their number."""
    rng, count = np.random.default_rng(1), 0
    for seed in range(scenes):
        scene, areas, tracks = some_scene(workload, seed, rng)
        for found in delays(tracks, areas, scene):
            [track] = (track for track in tracks if track.key == found.key)
            rest = [other for other in tracks if other is not track]
            errors = chain.from_iterable((each.from_error_s, each.to_error_s) for each in found.forbidden)
            error_s = max(errors, default=0.0)
            for least_s, sign in ((found.least_later_s, 1), (found.least_earlier_s, -1)):
                if not least_s or not all(each.is_proven for each in found.forbidden):
                    continue
                assert not _meets(scene, areas, rest, shifted(track, sign * round(1e6 * least_s)))
                less_us = round(1e6 * (least_s - error_s - 5e-3))
                assert less_us < 0 or _meets(scene, areas, rest, shifted(track, sign * less_us))
                count += 1
    return count


def _meets(scene: Scene, areas: list[Area], rest: list[Track], track: Track) -> bool:
    found = solve([track, *rest], areas, replace(scene, nearest_m=0.0))
    return any(track.key in (one.a_key, one.b_key) for one in found)


@pytest.mark.parametrize("workload", [LOW_LATITUDE, HARBOUR], ids=lambda workload: workload.name)
def test_the_least_delay_leaves_no_conflict_and_a_little_less_leaves_one(workload: Workload) -> None:
    assert cleared(workload, 2) > 3


@pytest.mark.slow
@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
def test_many_least_delays(workload: Workload) -> None:
    """Together more than 200 tracks."""
    assert cleared(workload, 12) > 0
