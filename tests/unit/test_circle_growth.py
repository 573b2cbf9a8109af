"""Havens that change on great circles: their motion against the oracle, its bounds, and answers known by hand."""

from dataclasses import replace

import numpy as np
import oracle_circle
import pytest
import scenes
import shapely
from layouts import GROWING_CIRCLES
from mixed_scenes import plain_scene
from motion_bounds import LASTS_S, tightness
from scenes import HOUR_S
from verdicts import periods_us

from conflictdb import InvalidInput, kernel, solve
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.cutting import check_plane, track_pieces
from conflictdb.earth.geodesy import MEAN_RADIUS_M as RADIUS_M
from conflictdb.earth.registry import Setup
from conflictdb.kernel.kernel_scene import PieceState
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import Motion, Scene

ROUNDING_M = 2e-8  # plane coordinates reach 1.1e7 m
Sizes = tuple[float, float, float, float]
SCENE = Scene("s", Motion.GREAT_CIRCLE, centre=(20.0, 40.0))


def shapes_at(pieces: Pieces, rows: np.ndarray, zero_us: np.ndarray, scene: Scene = SCENE) -> Movement:
    return Movement.of(kernel.KernelScene(Setup.of(scene).plane.kernel_plane, pieces), rows, zero_us)


def test_vertices_agree_with_the_oracle() -> None:
    """On every leg, also of havens that change at every waypoint."""
    for seed in (21, 22):
        scene, _, tracks = plain_scene(GROWING_CIRCLES, seed, 0, 8)
        for track in tracks:
            pieces = track_pieces(Setup.of(scene), TrackBatch.of([track]))
            for phase in oracle_circle.phases(oracle_circle.Chart.at(*scene.centre), track):
                row = np.flatnonzero(pieces.leg_start_us == phase.start_us)[:1]
                seconds = np.linspace(0.0, (phase.end_us - phase.start_us) / 1e6, 7)
                rows = np.repeat(row, len(seconds))
                found = shapes_at(pieces, rows, pieces.leg_start_us[rows], scene).positions(seconds).T
                apart = found[:, :, None] - phase.vertices(int(phase.start_us), seconds)[:, None]
                distance = np.hypot(apart[..., 0], apart[..., 1])
                assert max(distance.min(axis=1).max(), distance.min(axis=2).max()) < ROUNDING_M


SMALL, LARGE = (1e4, 1e4, 1e4, 1e4), (1e5, 5e4, 3e4, 8e4)


@pytest.mark.parametrize(
    ("start", "way", "sizes", "mps", "limits"),
    [
        ((20, 40), (5, 0), SMALL, 0.0, (1.06, 1.37, 1.35)),
        ((20, 40), (0, 5), LARGE, 0.0, (1.11, 1.33, 1.32)),
        ((40, 60), (5, 5), LARGE, 0.0, (1.09, 1.46, 1.14)),
        ((-10, 10), (10, 5), SMALL, 0.0, (1.19, 1.85, 1.37)),
        ((60, 20), (5, -5), LARGE, 0.0, (1.04, 1.74, 1.13)),
        ((20, 40), (5, 3), LARGE, 1.0, (1.15, 2.84, 1.06)),
        ((60, 20), (5, -5), LARGE, 1.0, (1.04, 6.12, 1.12)),
        ((0, 75), (90, 5), SMALL, 1.0, (1.68, 7.41, 2.02)),
        ((-10, 10), (10, 5), (0.0, 0.0, 0.0, 0.0), 1.0, (1.18, 8.01, 1.34)),
        ((20, 40), (0, 0), SMALL, 3.0, (1.74, 5.30, 1.02)),
        ((60, 20), (0, 0), LARGE, 3.0, (1.06, 2.17, 1.02)),
    ],
)
def test_bounds_are_near_what_they_bound(
    start: tuple[float, float],
    way: tuple[float, float],
    sizes: Sizes,
    mps: float,
    limits: tuple[float, float, float],
) -> None:
    """The ratio of each bound to its exact value on a whole leg: as measured, and a hundredth more.

    A bound that grows costs time and widens the reported intervals; no other test notices.
    """
    end = (start[0] + way[0], start[1] + way[1])
    track = replace(scenes.track("T", [start, end], [0, LASTS_S], *sizes), grow_mps=mps)
    pieces = track_pieces(Setup.of(SCENE), TrackBatch.of([track]))
    one = shapes_at(pieces, np.zeros(1, np.int64), pieces.leg_start_us[:1])
    ratios, at, bounds = tightness(one)
    for ratio, limit in zip(ratios, limits, strict=True):
        assert 1.0 - 1e-6 <= ratio <= limit
    scale = 1.0 + (at[0] ** 2 + at[1] ** 2).max() / RADIUS_M**2
    assert bounds.scale[0] == pytest.approx(scale, rel=1e-13 if mps == 0.0 else 4e-4)


def test_corners_may_dent_alike_whether_they_grow_or_shrink_and_however_they_are_turned() -> None:
    """Rectangles of 250 to 3,200 km; some of them are known to stay convex."""
    rng = np.random.default_rng(1)
    corners = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    start, end = (np.concatenate(corners * rng.uniform(0.02, 0.25, (200, 1, 2))) for _ in range(2))
    leg = track_pieces(Setup.of(SCENE), TrackBatch.of([scenes.track("T", [(20, 40), (21, 40)], [0, LASTS_S], *SMALL)]))
    legs = leg.take(np.zeros(200, np.int64))

    def may_dent(first: np.ndarray, last: np.ndarray) -> np.ndarray:
        pieces = replace(legs, shape_xy=first * RADIUS_M, shape_to_xy=last * RADIUS_M)
        states = kernel.KernelScene(Setup.of(SCENE).plane.kernel_plane, pieces).states()
        assert (states != PieceState.INVALID).all()
        return states == PieceState.NONCONVEX

    found = may_dent(start, end)
    assert 0.1 < found.mean() < 0.9
    np.testing.assert_array_equal(may_dent(end, start), found)
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
    np.testing.assert_array_equal(may_dent(start @ quarter, end @ quarter), found)


def test_a_point_that_grows_reaches_a_wall_when_it_says() -> None:
    """A square about a moored point, its sides moving at 2 m/s, and a wall due north of it."""
    point = replace(scenes.track("T", [(20, 40), (20, 40)], [0, 4 * HOUR_S], 0.0, 0.0, 0.0, 0.0), grow_mps=2.0)
    wall = scenes.area("A", shapely.box(19, 40.2, 21, 41))
    # The wall's side across the meridian runs north of its corners; the haven's own is as far north as it has gone.
    way = np.arctan(np.tan(np.radians(40.2)) / np.cos(np.radians(1.0))) - np.radians(40.0)
    (met,) = solve([point], [wall], SCENE)
    ((start_us, end_us),) = periods_us(met)
    assert abs((start_us - point.times_us[0]) / 1e6 - way * RADIUS_M / 2.0) < 3e-6
    assert end_us == point.times_us[1]


def test_a_haven_that_outgrows_the_plane_is_refused() -> None:
    """And the message names the field that causes it."""
    track = scenes.track("T", [(20, -18), (20, -18)], [0, 10 * HOUR_S], 1000.0, 1000.0, 1000.0, 1000.0)
    check_plane(Setup.of(SCENE).plane, [], [track])
    for other, field in (
        (replace(track, grow_mps=10.0), "grow_mps"),
        (replace(track, outlines_m=np.array([track.outline_m, 300.0 * track.outline_m])), "outlines_m"),
    ):
        with pytest.raises(InvalidInput, match=f"'T': {field}: the haven reaches beyond 60 degrees"):
            check_plane(Setup.of(SCENE).plane, [], [other])
