"""What stands in the proofs of stage 4, held to brute force over all vertices."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest
import scenes
from swinging import SWING_S, encounters

from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.earth.geodesy import Floats
from conflictdb.model import EarthModel, Scene, Track
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.cutting import track_pieces
from conflictdb.stage4.distance import clearance_m
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.proofs import _clearance_upper_bound, _relative_speed, _speed, undecided_separation


class Moving:
    """Polygons of which only velocities (2, v, n) are known."""

    def __init__(self, velocities: Floats) -> None:
        self._velocities = velocities

    def velocities(self, t: Floats) -> Floats:
        return self._velocities


class Both:
    def __init__(self, a: Floats, b: Floats) -> None:
        self.a, self.b = Moving(a), Moving(b)


def test_speeds_are_the_greatest_of_all_vertices() -> None:
    """Whichever of the two is the faster, whatever way it goes; relative ones are exact in each direction."""
    rng = np.random.default_rng(1)
    n = 200
    a, b = rng.normal(size=(2, 4, n)) + rng.normal(size=(2, 1, n)), rng.normal(size=(2, 3, n))
    both: Any = Both(a, b)
    t = np.zeros(n)
    apart = np.abs(b[:, None, :, :] - a[:, :, None, :]).max(axis=(1, 2))
    np.testing.assert_allclose(_relative_speed(both, t), np.hypot(*apart), rtol=1e-15)
    fastest = np.hypot(*np.concatenate([a, b], axis=1)).max(axis=0)
    np.testing.assert_allclose(_speed(both, t, np.full(n, 0.5)), fastest + 0.5, rtol=1e-15)


@pytest.mark.parametrize("separation_m", [0.0, 2000.0])
def test_bounds_from_above_are_above_and_near(separation_m: float) -> None:
    """During an interval, a swing comes no closer to parting than is said, up to twice what it moves in that time."""
    middle = np.concatenate([np.linspace(45.0, 55.0, 21), np.linspace(145.0, 155.0, 21)])
    pairs = encounters([-3.0] * len(middle), separation_m)
    rows = np.arange(len(middle))
    for width in (0.01, 1.0, 5.0):
        bound = _clearance_upper_bound(pairs, rows, middle, np.full(len(middle), width))
        at = [clearance_m(pairs, rows, middle + share * width) for share in np.linspace(-0.5, 0.5, 21)]
        assert (bound >= np.max(at, axis=0)).all()
        held = clearance_m(pairs, rows, middle) <= 0.0
        assert held.sum() > 10
        moved = 50.0 * 2.0 * np.pi / SWING_S * width
        assert (bound[held] <= np.max(at, axis=0)[held] + 2.0 * moved + 1e-3).all()


# Two ships and their longitudes, degrees.
ABREAST: Final = (("a", 0.0), ("b", 8.0))


def on_whole_legs(scene: Scene, tracks: list[Track], separation_m: float) -> Encounters:
    """The one pair of two tracks with one leg each, not cut into slices."""
    pieces = track_pieces(scene, plane_of(scene), TrackBatch.of(tracks))
    pieces = replace(pieces, start_us=pieces.leg_start_us, end_us=pieces.leg_end_us)
    row, (a, b) = np.zeros(1, np.int64), np.flatnonzero(np.diff(pieces.object_id, prepend=-1))[:, None]
    pair = Pairs(a, b, np.empty((0, 2)), np.zeros(2, np.int64))
    return Encounters.of(plane_of(scene), separation_m, pieces, pair, row, pieces.start_us[:1])


@pytest.mark.parametrize("earth", EarthModel)
def test_ships_abreast_that_run_towards_the_pole_come_nearer(earth: EarthModel) -> None:
    """In the plane they keep their distance: that the plane distorts it is all that the proof has to go by.

    500 km apart, 10 km towards the pole: 650 m nearer, and the separation is lost in the second half.
    """
    tracks = [scenes.track(key, [(lon, 55.0), (lon, 55.09)], [0, 3600], *(100.0,) * 4) for key, lon in ABREAST]
    row, pairs = np.zeros(1, np.int64), on_whole_legs(Scene("s", earth=earth), tracks, separation_m=0.0)
    distance_m = [float(clearance_m(pairs, row, np.array([t]))[0]) for t in (0.0, 1800.0, 3600.0)]
    assert distance_m[1] - distance_m[2] > 300.0, "metres that are lost in the second half"
    for separation_m, is_clear in (
        (distance_m[1] - 100.0, False),
        (distance_m[2] + 10.0, False),
        (distance_m[2] - 10.0, True),
    ):
        wanted = replace(pairs, separation_m=separation_m)
        undecided = undecided_separation(wanted, row, np.zeros(1), np.full(1, 3600.0), 0.0)
        assert (not len(undecided.row)) == is_clear


@pytest.mark.parametrize("earth", EarthModel)
def test_a_way_is_bounded_from_above_alike_in_both_directions(earth: EarthModel) -> None:
    """Of ships abreast, up and down the same meridians: the plane distorts most at the end, or at the start."""
    scene, bounds = Scene("s", earth=earth), []
    for first, last in ((55.0, 56.0), (56.0, 55.0)):
        tracks = [scenes.track(key, [(lon, first), (lon, last)], [0, 3600], *(100.0,) * 4) for key, lon in ABREAST]
        pairs = on_whole_legs(scene, tracks, separation_m=600e3)
        bounds.append(_clearance_upper_bound(pairs, np.zeros(1, np.int64), np.full(1, 1800.0), np.full(1, 3600.0)))
    assert np.isfinite(bounds).all()
    np.testing.assert_allclose(bounds[0], bounds[1], rtol=0.0, atol=1e-3)
