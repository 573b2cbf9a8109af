"""Contact sets in the times of both: a diagonal meets one exactly if that delay brings the two into contact."""

import numpy as np
import pytest
import shapely
from layouts import GROWING_CIRCLES, LOW_LATITUDE, SEAM, Workload
from mixed_scenes import plain_scene
from shifting import meets_when_shifted

from conflictdb import Area, Scene, Track
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core.coordination import contact_set
from conflictdb.core.object_pairs import object_numbers
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.registry import Setup, centred

HORIZON_US = 40_000_000_000


def sets_of(
    scene: Scene, track: Track, other: Area | Track, slices: int = 30
) -> tuple[shapely.Geometry, shapely.Geometry]:
    areas, tracks = ([other], [track]) if isinstance(other, Area) else ([], [track, other])
    scene = centred(scene, areas, tracks)
    pieces = pieces_of(Setup.of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
    number = int(object_numbers(pieces)[np.flatnonzero((pieces.kind == 1) & (pieces.object_id == 0))[0]])
    return contact_set(Setup.of(scene), pieces, number, HORIZON_US, int(track.times_us[0]), slices)


def diagonal(track: Track, delay_s: float) -> shapely.LineString:
    lasts_s = (track.times_us[-1] - track.times_us[0]) / 1e6
    return shapely.LineString([(-1.0, -1.0 + delay_s), (lasts_s + 1.0, lasts_s + 1.0 + delay_s)])


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, GROWING_CIRCLES], ids=lambda workload: workload.name)
def test_a_diagonal_meets_the_contact_set_if_the_delay_is_forbidden(workload: Workload) -> None:
    """For tracks and areas; the outer set misses no contact, and the inner set has no other diagonals."""
    scene, areas, tracks = plain_scene(workload, 3, 6, 7, separation_m=500.0)
    rng, seen, met = np.random.default_rng(0), 0, 0
    for track, other in [(track, other) for track in tracks[:5] for other in [*areas, *tracks] if other is not track]:
        outer, inner = sets_of(scene, track, other)
        assert inner.difference(outer.buffer(1e-3)).is_empty
        shifts_us = rng.integers(-HORIZON_US, HORIZON_US, 5)
        if not outer.is_empty:
            _, south, _, north = outer.bounds
            near = 1e6 * rng.uniform(south - outer.bounds[2] - 60.0, north - outer.bounds[0] + 60.0, 15)
            shifts_us = np.append(shifts_us, near.astype(np.int64))
        shifts_us = shifts_us[np.abs(shifts_us) < HORIZON_US]
        pair = ([other], [track]) if isinstance(other, Area) else ([], [track, other])
        for shift_us, keys in zip(
            shifts_us.tolist(), meets_when_shifted(scene, *pair, track.key, shifts_us), strict=True
        ):
            line = diagonal(track, shift_us / 1e6)
            assert not keys or outer.distance(line) < 1e-3
            assert keys or not inner.buffer(-1e-3).intersects(line)
            seen, met = seen + 1, met + bool(keys)
    assert met > 20
    assert seen - met > 20


def test_contact_at_an_instant_ends_the_halving() -> None:
    """Two points on ways that cross."""
    scene = Scene("s", tolerance_m=0.0)
    times_us = [1_780_000_000_000_000, 1_780_003_600_000_000]
    east = Track("east", [(0.0, 0.0), (1.0, 0.0)], times_us, [(0.0, 0.0)])
    north = Track("north", [(0.5, -0.5), (0.5, 0.5)], times_us, [(0.0, 0.0)])
    outer, _ = sets_of(scene, east, north, 1000)
    assert outer.area < 1.0
