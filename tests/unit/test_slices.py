"""Padded hulls from the kernel: against hulls made of squares one by one, and against the bounds of the motion."""

import numpy as np
import pytest
import scenes
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from layouts import WORKLOADS, Workload
from mixed_scenes import plain_scene
from staged import still

from conflictdb import kernel
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.pieces.cutting import track_pieces
from conflictdb.core.stage1_broad_phase import hulls_of
from conflictdb.earth.gnomonic import Gnomonic
from conflictdb.earth.plane import Plane, padding_m
from conflictdb.earth.registry import Setup
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import EarthModel, Scene
from conflictdb.model.results import Kind

# Largest reach of a ring, in paddings, where two of its edges meet (kernel.h).
FURTHEST = 2.5
ROUNDING_M = 1e-7


def cut(
    workload: Workload, seed: int, separation_m: float, earth: EarthModel = EarthModel.WGS84
) -> tuple[Scene, Plane, Pieces]:
    scene, areas, tracks = plain_scene(workload, seed, 10, 10, earth, separation_m=separation_m)
    setup = Setup.of(scene)
    pieces = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of(tracks))
    return scene, setup.plane, pieces.take(np.flatnonzero(pieces.turn == 0))


def swept(plane: Plane, pieces: Pieces, k: int, reach_m: float) -> tuple[np.ndarray, float, float]:
    """The vertices (n, 2) of a piece at both ends of its slice, its padding and deviation, by its motion."""
    row = np.array([k])
    if pieces.kind[k] == Kind.AREA.code:
        xy = pieces.shape_xy[pieces.shape_offset[k] : pieces.shape_offset[k + 1]]
        scale, deviation = plane.largest_scale(xy.T[:, :, None]), np.zeros(1)
    else:
        haven = Movement.of(kernel.KernelScene(plane.kernel_plane, pieces, row), row, pieces.start_us[row])
        ends = np.zeros(1), (pieces.end_us[row] - pieces.start_us[row]) / 1e6
        xy = np.concatenate([haven.positions(t)[:, :, 0].T for t in ends])
        bounds = haven.bounds(*ends)
        scale, deviation = bounds.scale, bounds.deviation
    return xy, float(padding_m(plane, scale, reach_m)[0] + deviation[0]), float(deviation[0])


def grown(xy: np.ndarray, pad: float) -> shapely.Polygon:
    corners = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    return shapely.convex_hull(shapely.multipoints((xy[:, None, :] + pad * corners).reshape(-1, 2)))


def assert_is_grown(ring: np.ndarray, xy: np.ndarray, pad: float) -> None:
    """The ring is closed, convex, counter-clockwise, contains the squares, and is at most FURTHEST paddings away."""
    polygon, squares = shapely.Polygon(ring), grown(xy, pad)
    np.testing.assert_array_equal(ring[0], ring[-1])
    assert polygon.is_valid
    assert polygon.exterior.is_ccw
    assert shapely.covers(polygon.buffer(ROUNDING_M), shapely.convex_hull(polygon))
    assert shapely.covers(polygon.buffer(ROUNDING_M), squares)
    assert shapely.covers(grown(xy, FURTHEST * pad + ROUNDING_M), polygon)
    assert len(ring) <= len(shapely.get_coordinates(squares))


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("separation_m", [0.0, 5000.0])
@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda w: w.name)
def test_hulls_are_those_of_the_motion(workload: Workload, separation_m: float, earth: EarthModel) -> None:
    scene, plane, pieces = cut(workload, 5, separation_m, earth)
    hulls = kernel.hulls(plane.kernel_plane, pieces, scene.reach_m)
    for k in range(len(pieces)):
        xy, pad, deviation = swept(plane, pieces, k, scene.reach_m)
        assert hulls.deviation_m[k] == pytest.approx(deviation, rel=1e-6, abs=1e-9)
        assert_is_grown(hulls.xy[hulls.offset[k] : hulls.offset[k + 1]], xy, pad)


KERNEL_PLANE = Setup.of(Scene("s", earth=EarthModel.SPHERE)).plane.kernel_plane
NUMBERS = st.sampled_from([0.0, 1.0, -1.0, 2.0, 1e-9, 1e3, -1e3, 12345.678, -1e7])


@settings(max_examples=300)
@given(st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=9), st.sampled_from([0.0, 1.0, 1e4]))
def test_hulls_of_any_points(points: list[tuple[float, float]], reach_m: float) -> None:
    """Also of one point, of a repeated point, of lines along the axes and not, and of nonconvex polygons."""
    pieces, plane = still(points), Setup.of(Scene("s", earth=EarthModel.SPHERE)).plane
    hulls = kernel.hulls(KERNEL_PLANE, pieces, reach_m)
    xy, pad, _ = swept(plane, pieces, 0, reach_m)
    assert_is_grown(hulls.xy, xy, pad)


def rings_of(*polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate(polygons), np.cumsum([0, *map(len, polygons)])


@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda w: w.name)
def test_hulls_are_apart_where_they_do_not_intersect(workload: Workload) -> None:
    _, _, pieces = cut(workload, 8, 20.0)
    a, b = (PieceRows(rows) for rows in np.triu_indices(len(pieces)))
    hulls = hulls_of(pieces)
    apart = kernel.apart(pieces.hull_xy, pieces.hull_offset, a, b)
    np.testing.assert_array_equal(apart, ~shapely.intersects(hulls[a], hulls[b]))
    assert apart.any()


@settings(max_examples=300)
@given(
    st.lists(st.tuples(NUMBERS, NUMBERS), min_size=3, max_size=7),
    st.lists(st.tuples(NUMBERS, NUMBERS), min_size=3, max_size=7),
)
def test_whatever_is_told_apart_is(one: list[tuple[float, float]], other: list[tuple[float, float]]) -> None:
    """Also of rings that are not convex, turn the other way, or have edges of no length or of rounding errors."""
    first, second = (np.array([*points, points[0]]) for points in (one, other))
    row = PieceRows(np.array([0, 1]))
    apart = kernel.apart(*rings_of(first, second), row, PieceRows(row[::-1].copy()))
    holds = [shapely.convex_hull(shapely.multipoints(points)) for points in (first, second)]
    assert apart[0] == apart[1]
    assert not (apart[0] and shapely.intersects(*holds))


def test_hulls_that_touch_are_not_apart() -> None:
    """At a corner, along an edge, and at an edge of rounding errors in another direction."""
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)]) * 1e6 + 1.7e7 / 3.0
    away = square + np.array([1e6, 0.0])
    odd = np.insert(square, 2, square[1] + np.array([-1e-9, 2e-9]), axis=0)
    xy, offset = rings_of(square, away, odd, away + np.array([1e-3, 0.0]), np.empty((0, 2)))
    a, b = PieceRows(np.array([0, 0, 2, 0, 2, 0])), PieceRows(np.array([0, 1, 1, 3, 3, 4]))
    assert kernel.apart(xy, offset, a, b).tolist() == [False, False, False, True, True, False]


def test_hulls_that_are_not_there_are_refused() -> None:
    xy, offset = rings_of(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 0.0)]))
    here, there = PieceRows(np.array([0])), PieceRows(np.array([1]))
    with pytest.raises(ValueError, match="an index of a piece"):
        kernel.apart(xy, offset, here, there)
    with pytest.raises(ValueError, match="end at the number of items"):
        kernel.apart(xy[:-1], offset, here, here)


def test_a_square_keeps_its_corners() -> None:
    """A piece of four corners has a hull of four, however it is turned: the rounded corners of a square are cut off."""
    square = np.array([(-1e3, -1e3), (1e3, -1e3), (1e3, 1e3), (-1e3, 1e3)])
    for angle in np.radians([0.0, 1.0, 30.0, 45.0, 89.0]):
        turn = np.array([(np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))])
        hulls = kernel.hulls(KERNEL_PLANE, still([tuple(point) for point in square @ turn]), 100.0)
        assert len(hulls.xy) == 5


def test_what_cannot_be_has_no_hull_and_leaves_others_theirs() -> None:
    rings = [[(0.0, 0.0), (1.0, 0.0)], [(np.nan, 0.0)], [], [(np.inf, 1.0)], [(5.0, 5.0)]]
    hulls = kernel.hulls(KERNEL_PLANE, still(*rings), 1.0)
    assert (np.diff(hulls.offset) > 0).tolist() == [True, False, False, False, True]
    assert np.isnan(hulls.deviation_m).tolist() == [False, True, True, True, False]
    np.testing.assert_array_equal(hulls.xy[hulls.offset[4] :], kernel.hulls(KERNEL_PLANE, still(rings[4]), 1.0).xy)


def test_what_is_grown_beyond_all_numbers_has_no_hull() -> None:
    """No ring has an infinite corner."""
    plane = Gnomonic(0.0, 0.0).kernel_plane
    # Where edges meet far out it has one corner, further than the squares that grow it reach.
    rhombus = [(0.0, -1e4), (1.4e4, 0.0), (0.0, 1e4), (-1.4e4, 0.0)]
    assert len(kernel.hulls(plane, still(rhombus), 1e308).xy) > 0
    assert len(kernel.hulls(plane, still(rhombus), 1.6e308).xy) == 0


@pytest.mark.parametrize("workload", [WORKLOADS[0], WORKLOADS[-1]], ids=lambda w: w.name)
def test_many_pieces_have_the_hulls_of_few(workload: Workload) -> None:
    """To the bit, also where one call of the kernel ends and the next begins."""
    scene, plane, pieces = cut(workload, 6, 0.0)
    times = 1 + 10_000 // len(pieces)
    few = kernel.hulls(plane.kernel_plane, pieces, scene.reach_m)
    many = kernel.hulls(plane.kernel_plane, pieces.take(np.tile(np.arange(len(pieces)), times)), scene.reach_m)
    np.testing.assert_array_equal(many.xy, np.tile(few.xy, (times, 1)))
    np.testing.assert_array_equal(np.diff(many.offset), np.tile(np.diff(few.offset), times))
    np.testing.assert_array_equal(many.deviation_m, np.tile(few.deviation_m, times))
    np.testing.assert_array_equal(many.reach_m, np.tile(few.reach_m, times))


@pytest.mark.parametrize("reach_m", [-1.0, np.nan, np.inf])
def test_reaches_that_are_none_are_refused(reach_m: float) -> None:
    with pytest.raises(ValueError, match="negative, NaN or infinite"):
        kernel.hulls(KERNEL_PLANE, still([(0.0, 0.0)]), reach_m)


def test_a_haven_that_reaches_away_from_the_pole_has_a_hull() -> None:
    """Although it would reach past the pole if it went the other way."""
    scene = Scene("s")
    track = scenes.track("T", [(0.0, 82.0), (0.0, 0.0)], [0, 1e6], 900e3, 0.0, 0.0, 0.0)
    pieces = track_pieces(Setup.of(scene), TrackBatch.of([track]))
    assert (np.diff(pieces.hull_offset) > 0).all()


def test_reach_is_the_way_to_the_reference_point() -> None:
    _, plane, pieces = cut(WORKLOADS[0], 7, 0.0)
    rows = np.flatnonzero(pieces.kind == Kind.TRACK.code)
    hulls = kernel.hulls(plane.kernel_plane, pieces, 0.0)
    for k in rows[:20]:
        row = np.array([k])
        haven = Movement.of(kernel.KernelScene(plane.kernel_plane, pieces, row), row, pieces.start_us[row])
        ends = np.zeros(1), (pieces.end_us[row] - pieces.start_us[row]) / 1e6
        away = [np.hypot(*(haven.positions(t) - haven.reference(t)[:, None, :])[:, :, 0]).max() for t in ends]
        assert hulls.reach_m[k] == pytest.approx(max(away), rel=1e-9)
    assert not hulls.reach_m[pieces.kind == Kind.AREA.code].any()
