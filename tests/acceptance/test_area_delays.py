"""Delays of areas agree with a detection: free delays have no conflict, and delays proven forbidden have one."""

from dataclasses import replace

import numpy as np
import pytest
from layouts import LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene

from conflictdb import Area, Delays, delays, solve
from conflictdb.model.plans import Scene, Track
from conflictdb.model.recurring_plans import later

HOUR_US = 3_600_000_000


def met(scene: Scene, areas: list[Area], tracks: list[Track], moved: Area) -> set[str]:
    """The keys that an area meets, also grazing or unresolved."""
    found = solve(tracks, [moved if one.key == moved.key else one for one in areas], scene)
    return {key for one in found for key in (one.a_key, one.b_key) if moved.key in (one.a_key, one.b_key)} - {moved.key}


def asked(found: Delays, rng: np.random.Generator, within_us: int) -> list[int]:
    """Some delays: next to each end, and at random."""
    ends = [round(1e6 * end) for one in found.forbidden for end in (one.from_s, one.to_s)]
    near = [end + by for end in ends[:4] for by in (-1_000_000, -10, -1, 0, 1, 10, 1_000_000)]
    return [us for us in [0, *near, *rng.integers(-within_us, within_us, 3).tolist()] if abs(us) <= within_us]


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, OCEAN], ids=lambda workload: workload.name)
def test_areas_that_move_in_time(workload: Workload) -> None:
    """With separations in distance and time, several activations, areas without an end, and a margin."""
    rng, count, within_us = np.random.default_rng(5), 0, 6 * HOUR_US
    for seed, margin_s in ((1, 0.0), (2, 300.0)):
        scene, areas, tracks = plain_scene(workload, seed, 6, 8, separation_m=500.0)
        scene = replace(scene, time_separation_s=60.0)
        at_us = int(tracks[0].times_us[0])
        spans = [[at_us, at_us + HOUR_US], [at_us + 3 * HOUR_US, at_us + 4 * HOUR_US]]
        areas[0] = replace(areas[0], start_us=None, end_us=None, spans_us=spans)
        areas[1] = replace(areas[1], start_us=at_us + HOUR_US, end_us=None)
        wider = replace(scene, time_separation_s=60.0 + margin_s)
        for one in areas[:3]:
            [found] = delays(tracks, areas, scene, one.key, within_us / 1e6, margin_s=margin_s)
            for us in asked(found, rng, within_us):
                keys = met(wider, areas, tracks, later(one, us))
                of = [each for each in found.forbidden if round(1e6 * each.from_s) <= us <= round(1e6 * each.to_s)]
                case = f"seed {seed}, {one.key}, {us} us: {keys}, {of}"
                assert bool(of) >= bool(keys), case
                assert not of or keys <= set(of[0].by), case
                for each in of:
                    low, high = (
                        round(1e6 * (each.from_s + each.from_error_s)),
                        round(1e6 * (each.to_s - each.to_error_s)),
                    )
                    assert not (each.is_proven and low <= us <= high) or keys, case
                count += 1
    assert count > 50
