"""What the search for the closest approach rests on: bounds of intervals, the polish of what is found, by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scenes
from workloads import GROWING_CIRCLES, HIGH_LATITUDE, PAPER, throw

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.earth.geodesy import Floats
from conflictdb.model import EarthModel, Scene, Track
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.stage1_broad_phase import candidates
from conflictdb.stage2_intersection import intersections
from conflictdb.stage4 import closest_approach
from conflictdb.stage4.closest_approach import _bounds, _Search, _upward
from conflictdb.stage4.distance import clearance_m
from conflictdb.stage4.encounters import Encounters, group_by_shape

SAMPLES = 17


def encounters(scene: Scene, areas: list[Any], tracks: list[Track]) -> list[tuple[Encounters, Floats]]:
    """All pairs that pass stages 1 and 2 and share a time, and how long; pieces that share arrays together."""
    plane = plane_of(scene)
    pieces = pieces_of(scene, plane, AreaBatch.of(areas), TrackBatch.of(tracks))
    pairs = intersections(pieces, *candidates(pieces), regions=False)
    start, end = pieces.shared_span(pairs.a, pairs.b)
    found = []
    for rows in group_by_shape(plane, pieces, pairs, np.flatnonzero(end > start)):
        found.append((Encounters.of(plane, 0.0, pieces, pairs, rows, start[rows]), (end - start)[rows] / 1e6))
    return found


def least_and_bound(pairs: Encounters, start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """The least of the distances at some instants of intervals, and what they are stated to be nowhere below."""
    rows = np.arange(len(pairs))
    at = [np.maximum(clearance_m(pairs, rows, t), 0.0) for t in np.linspace(start, end, SAMPLES)]
    distance, bound = _bounds(pairs, start, 0.5 * (start + end), end, at[0], at[-1])
    np.testing.assert_allclose(distance, at[SAMPLES // 2], atol=1e-8, rtol=0)
    return np.min(at, axis=0), bound


@pytest.mark.parametrize("workload", [PAPER, HIGH_LATITUDE, GROWING_CIRCLES], ids=lambda w: w.name)
def test_nothing_is_nearer_than_the_bound_of_its_interval(workload: Any) -> None:
    scene, areas, tracks = throw(workload, 3, 6, 6, separation_m=3e5)
    apart = 0
    for pairs, span_s in encounters(scene, areas, tracks):
        for parts in (1, 16, 1024):
            start = span_s * (np.arange(len(pairs)) % parts) / parts
            least, bound = least_and_bound(pairs, start, start + span_s / parts)
            # Distances may be understated, bounds are on those that are true.
            assert (bound <= least + pairs.plane.distance_error_m(least)).all()
            apart += int((bound > 0.0).sum())
    assert apart >= 50


def test_bounds_allow_for_rounding() -> None:
    """Ships abreast on the equator of the sphere, where plane, proofs and distances are the same to the last digit."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    size = (1000.0, 1000.0, 1.0, 1.0)
    behind = 2010.0 / scenes.parallel_m(EarthModel.SPHERE, 0.0)
    starts = (("a", 0.0), ("b", behind))
    tracks = [scenes.track(key, [(lon, 0.0), (lon + 1.0, 0.0)], [0, 3600], *size) for key, lon in starts]
    ((pairs, span_s),) = encounters(scene, [], tracks)
    for part in (1.0, 1e-3):
        least, bound = least_and_bound(pairs, np.zeros(len(pairs)), part * span_s)
        assert (least - 1e-6 < bound).all()
        assert (bound < least - 1e-8).all()


def test_how_fast_a_distance_may_curve_by_hand() -> None:
    """(Speeds of both ends)^2 / distance, what lines of the plane bend, and the acceleration; all on the earth.

    Polygons that go 6 and 2 m/s in the plane, in 10 s up to 1 m/s faster, at a scale of 2: 3.5 and 1.5 m/s.
    """
    plane = SimpleNamespace(christoffel_bound=lambda scale: 1e-3 * scale)
    pairs: Any = SimpleNamespace(plane=plane)
    velocities = np.array([[[3.6], [0.0]], [[4.8], [0.0]]]), np.array([[[0.0]], [[-2.0]]])
    ones = np.ones(1)
    found = _upward(pairs, velocities, 0.2 * ones, 10.0 * ones, 4.0 * ones, 2.0 * ones, 50.0 * ones)
    assert found == pytest.approx(5.0**2 / 50.0 + 4e-3 * (3.5**2 + 1.5**2) + 0.1)


def test_a_passage_is_polished_to_the_shortest_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wherever in the interval the distance is least, also at its ends."""
    closest_s = np.array([0.0, 1.0, 33.3, 50.0, 99.0, 100.0])
    n = len(closest_s)

    def distance(pairs: Encounters, rows: np.ndarray, t: Floats) -> Floats:
        return np.asarray(5.0 + np.abs(t - closest_s[rows]))

    monkeypatch.setattr(closest_approach, "_distance", distance)
    many: Any = SimpleNamespace()
    nothing = np.full(n, np.inf)
    search = _Search(many, np.full(n, 100.0), nothing, nothing.copy(), np.zeros(n), nothing, nothing, nothing)
    search._polish(np.arange(n), np.zeros(n), np.full(n, 100.0))
    np.testing.assert_allclose(search.at_s, closest_s, atol=2e-6, rtol=0)
    np.testing.assert_allclose(search.least_m, 5.0, atol=2e-6, rtol=0)
