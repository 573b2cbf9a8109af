"""Depth in a whole area, if every part of it is too narrow for a conflict deeper than the tolerance."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.pieces.cutting import planar
from conflictdb.core.stage4.contact_search import GRAZING
from conflictdb.core.whole_areas import deep_in_whole_areas
from conflictdb.earth.registry import Setup
from conflictdb.kernel.whole import Areas, Depth, whole_depths
from conflictdb.model.plans import Area, EarthModel, Scene

# Two strips of 56 m each, with the equator as their seam.
SOUTH, NORTH = shapely.box(0.0, -0.0005, 0.1, 0.0), shapely.box(0.0, 0.0, 0.1, 0.0005)
DEGREE_M = scenes.parallel_m(EarthModel.SPHERE, 0.0)


@pytest.mark.parametrize(
    ("lat", "tolerance_m", "is_deep"), [(0.0, 50.0, True), (0.0, 60.0, False), (0.0002, 50.0, False)]
)
def test_a_point_along_the_seam_of_two_strips(lat: float, tolerance_m: float, is_deep: bool) -> None:
    """It enters at one end of both, leaves at the other, and is deep in the whole only in between."""
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=tolerance_m)
    setup = Setup.of(scene)
    areas = [scenes.area(key, part) for key, part in (("S", SOUTH), ("N", NORTH))]
    track = scenes.track("T", [(-0.05, lat), (0.15, lat)], [0, 3600], 0.0, 0.0, 0.0, 0.0)
    pieces = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of([track]))
    moves = pieces.kind == 1
    # The strips as parts of one area; the whole leg in place of its slices.
    pieces = replace(
        pieces,
        object_id=np.zeros(len(pieces), np.int64),
        start_us=np.where(moves, pieces.leg_start_us, pieces.start_us),
        end_us=np.where(moves, pieces.leg_end_us, pieces.end_us),
    )
    parts, first = np.flatnonzero(~moves), np.flatnonzero(moves)[[0, 0]]
    pairs = Pairs(PieceRows(parts), PieceRows(first), np.empty((0, 2)), np.zeros(3, np.int64))
    both = np.full(2, 900.0), np.full(2, 2700.0), np.zeros(2), np.full(2, GRAZING, np.int8), np.ones(2, np.bool_)
    whole = np.array([shapely.union(SOUTH, NORTH)])
    prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces)
    contacts = Contacts(np.arange(2), *both)
    found = deep_in_whole_areas(setup, prepared, pairs, contacts, lambda numbers: whole[numbers])
    assert (found == Depth.DEEP).any() == is_deep


def star(rng: np.random.Generator, lon: float, lat: float) -> shapely.Geometry:
    """An area with dents, up to 1,400 m from a place near the equator, often with a hole."""
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 9))
    corners = rng.uniform(200.0, 1400.0, (9, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    hole = rng.uniform(-700.0, 700.0, 2) + rng.uniform(-200.0, 200.0, (3, 2))
    shape = shapely.make_valid(shapely.Polygon(corners)).difference(shapely.Polygon(hole))
    return shapely.transform(shape, lambda xy: xy / DEGREE_M + np.array([lon, lat]))


@pytest.mark.parametrize(("lon", "tolerance_m"), [(20.0, 30.0), (20.0, 100.0), (20.0, 200.0), (-179.986, 200.0)])
def test_what_is_deep_is_what_lies_within_the_area_less_a_margin(lon: float, tolerance_m: float) -> None:
    """Random areas with dents and holes, and triangles about them, also at the seam; to a hundredth of the margin."""
    rng, n = np.random.default_rng(5), 80
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=tolerance_m)
    setup = Setup.of(scene)
    at = 0.04 * (np.arange(n) - 0.5 * n)
    stars = [star(rng, lon, lat) for lat in at.tolist()]
    corners = (rng.uniform(-1300.0, 1300.0, (n, 1, 2)) + rng.uniform(-300.0, 300.0, (n, 3, 2))) / DEGREE_M
    triangles = shapely.orient_polygons(shapely.polygons(np.stack([np.full(n, lon), at], axis=1)[:, None] + corners))
    shapes = [*stars, *triangles]
    batch = AreaBatch.of(
        [Area(str(k), shapely.MultiPolygon(shapely.get_parts(shape))) for k, shape in enumerate(shapes)]
    )
    pieces = pieces_of(setup, batch, TrackBatch.of([]))
    a, b = (rows.ravel() for rows in np.meshgrid(np.arange(len(pieces)), np.arange(len(pieces))))
    of_same = (pieces.object_id[a] + n == pieces.object_id[b]) & (pieces.turn[a] == pieces.turn[b])
    a, b = PieceRows(a[of_same]), PieceRows(b[of_same])
    m, pair = len(a), np.arange(len(a))
    times = np.zeros(m), np.full(m, np.inf), np.zeros(m)
    contacts = Contacts(pair, *times, np.full(m, GRAZING, np.int8), np.ones(m, np.bool_))
    pairs = Pairs(a, b, np.empty((0, 2)), np.zeros(m + 1, np.int64))
    # Next to the seam some parts lie a turn away from their area.
    assert (lon > 0.0) == (pieces.shape_xy[:, 0] * lon > 0.0).all()
    prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces)
    depth = deep_in_whole_areas(setup, prepared, pairs, contacts, lambda numbers: batch.footprint[numbers])
    assert not (depth == Depth.UNKNOWN).any()
    is_deep = np.bincount(pieces.object_id[a], depth == Depth.DEEP, minlength=n) > 0
    flat = planar(setup.plane, batch.footprint)
    wholes, others = flat[:n], flat[n:]
    margin = tolerance_m * setup.plane.largest_scale(shapely.bounds(flat).reshape(-1, 2, 2).transpose(2, 1, 0))

    def deeper_than(share: float) -> NDArray[np.bool_]:
        cores = shapely.buffer(flat, -share * margin, quad_segs=64)
        return np.asarray(shapely.intersects(cores[:n], others) | shapely.intersects(cores[n:], wholes))

    assert deeper_than(1.01).sum() > 8
    assert not (deeper_than(1.01) & ~is_deep).any()
    assert not (is_deep & ~deeper_than(0.99)).any()


def square(x: float, y: float, half: float) -> shapely.Polygon:
    return shapely.box(x - half, y - half, x + half, y + half)


def depth_of_squares(areas: Areas, one: shapely.Polygon, other: shapely.Polygon) -> int:
    """Depth of the intersection of two boxes in an area of the plane."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    setup = Setup.of(scene)
    boxes = [shapely.transform(box, lambda xy: xy / DEGREE_M) for box in (one, other)]
    batch = AreaBatch.of([scenes.area(key, box) for key, box in zip("ab", boxes, strict=True)])
    pieces: Pieces = pieces_of(setup, batch, TrackBatch.of([]))
    numbers, none = (np.array([k]) for k in range(2)), np.zeros(1)
    prepared, never = kernel.KernelScene(setup.plane.kernel_plane, pieces), np.zeros(1, np.int64)
    (found,) = whole_depths(prepared, *numbers, never, none, none, areas, never, np.zeros(1, np.bool_), none)
    return int(found)


def area_of(xy: NDArray[np.float64], margin: float) -> Areas:
    return Areas(xy, np.array([0, len(xy)]), np.array([0, 1]), np.array([margin]))


def test_the_border_of_another_side_of_an_area_counts_and_what_is_outside_is_not_deep() -> None:
    """Boxes, including a part: in a box, outside it, across its border; an area without sides, or with NaN."""
    ring = shapely.get_coordinates(square(0.0, 0.0, 1000.0))
    part = square(0.0, 0.0, 990.0)
    assert depth_of_squares(area_of(ring, 890.0), part, square(100.0, 100.0, 5.0)) == Depth.DEEP
    assert depth_of_squares(area_of(ring, 910.0), part, square(100.0, 100.0, 5.0)) == Depth.SHALLOW
    assert depth_of_squares(area_of(ring + 2010.0, 1.0), part, square(100.0, 100.0, 5.0)) == Depth.SHALLOW
    assert depth_of_squares(area_of(ring + 900.0, 100.0), part, square(0.0, 0.0, 10.0)) == Depth.DEEP
    assert depth_of_squares(area_of(ring + 900.0, 120.0), part, square(0.0, 0.0, 10.0)) == Depth.SHALLOW
    assert depth_of_squares(area_of(np.empty((0, 2)), 1.0), part, square(0.0, 0.0, 10.0)) == Depth.UNKNOWN
    assert depth_of_squares(area_of(ring * [[np.nan, 1.0]], 1.0), part, square(0.0, 0.0, 10.0)) == Depth.UNKNOWN


@pytest.mark.parametrize(
    ("margin", "depth"),
    [
        (np.nan, Depth.UNKNOWN),
        (-1.0, Depth.UNKNOWN),
        (-np.inf, Depth.UNKNOWN),
        (np.inf, Depth.SHALLOW),
        (1e308, Depth.SHALLOW),
    ],
)
def test_a_margin_that_cannot_be_leaves_the_depth_unknown(margin: float, depth: Depth) -> None:
    """Nothing is deeper than an infinite one; where the border is near or, of a larger area, nowhere near."""
    for half in (1000.0, 1e6):
        ring = shapely.get_coordinates(square(0.0, 0.0, half))
        assert depth_of_squares(area_of(ring, margin), square(0.0, 0.0, 990.0), square(100.0, 100.0, 5.0)) == depth


def test_a_strip_of_many_vertices_that_is_just_too_narrow_is_soon_told() -> None:
    """Its middle is 99.9 m from both sides, all along its kilometres: halving alone would take thousands of cells."""
    x, y = np.linspace(-9e3, 9e3, 50), np.full(50, 99.9)
    shore = np.concatenate([np.stack([x, -y], axis=1), np.stack([x[::-1], y], axis=1)])
    ring = np.concatenate([shore, shore[:1]])
    part, other = shapely.box(-9e3, -99.9, 9e3, 99.9), shapely.box(-8e3, -50.0, 8e3, 90.0)
    assert depth_of_squares(area_of(ring, 100.0), part, other) == Depth.SHALLOW
    assert depth_of_squares(area_of(ring, 99.0), part, other) == Depth.DEEP


def test_areas_of_another_count_than_their_columns_are_refused() -> None:
    ring = shapely.get_coordinates(square(0.0, 0.0, 1000.0))
    with pytest.raises(ValueError, match="offsets of areas"):
        depth_of_squares(replace(area_of(ring, 1.0), margin=np.ones(2)), square(0.0, 0.0, 9.0), square(0.0, 0.0, 9.0))
    with pytest.raises(ValueError, match="offsets do not begin"):
        depth_of_squares(
            replace(area_of(ring, 1.0), ring_offset=np.array([0, 9])), square(0.0, 0.0, 9.0), square(0.0, 0.0, 9.0)
        )
