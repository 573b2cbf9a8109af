"""Contact points of polygons at an instant, and their distances, by the kernel: known answers, and shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from layouts import GROWING, GROWING_CIRCLES, HIGH_LATITUDE, LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene
from staged import Staged, still

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.kernel.meeting import distances, meetings
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import EarthModel, Motion, Scene

ALPS = Scene("s", Motion.GREAT_CIRCLE, centre=(10.0, 46.0))
PLANES = [Setup.of(Scene("s")).plane, Setup.of(Scene("s", earth=EarthModel.SPHERE)).plane, Setup.of(ALPS).plane]
planes = pytest.mark.parametrize("plane", PLANES, ids=["wgs84", "sphere", "great circles"])
# Away from the origin of the planes, where coordinates have digits to lose; the seam's neighbourhood is tested below.
MIDDLE = np.array([9.0e5, 4.0e5])


def meeting_xy(plane: Plane, one: Floats, other: Floats) -> Floats:
    """Where two polygons meet, plane metres."""
    scene = kernel.KernelScene(plane.kernel_plane, still(one, other))
    ((lon, lat),) = meetings(scene, *np.array([[0], [1], [0]]), np.zeros(1))
    x, y = plane.to_plane(lon, lat)
    return np.array([float(x), float(y)])


SQUARE = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
KNOWN = [
    (SQUARE, SQUARE, (5.0, 5.0)),
    (SQUARE, np.add(SQUARE, (4.0, 6.0)), (7.0, 8.0)),
    (SQUARE, np.add(SQUARE * 0.2, (1.0, 1.0)), (2.0, 2.0)),
    (SQUARE, np.add(SQUARE, (10.0, 10.0)), (10.0, 10.0)),
    (SQUARE, np.add(SQUARE, (13.0, 14.0)), (11.5, 12.0)),
    (SQUARE, np.array([(3.0, 4.0)]), (3.0, 4.0)),
    (SQUARE, np.array([(3.0, 10.0)]), (3.0, 10.0)),
    (SQUARE, np.array([(4.0, -5.0), (4.0, 8.0)]), (4.0, 4.0)),
    (SQUARE, np.array([(2.0, 2.0), (4.0, 8.0)]), (3.0, 5.0)),
    (SQUARE, np.array([(20.0, 5.0), (30.0, 5.0)]), (15.0, 5.0)),
    (np.array([(0.0, 0.0), (8.0, 8.0)]), np.array([(0.0, 4.0), (4.0, 0.0)]), (2.0, 2.0)),
    (np.array([(0.0, 0.0), (8.0, 8.0)]), np.array([(6.0, 6.0)]), (6.0, 6.0)),
    (np.array([(1.0, 2.0)]), np.array([(1.0, 2.0)]), (1.0, 2.0)),
    (SQUARE[[0, 0, 1, 1, 2, 3]], np.add(SQUARE[[0, 1, 2, 2, 3, 3]], (8.0, 0.0)), (9.0, 5.0)),
]


@planes
@pytest.mark.parametrize(("one", "other", "where"), KNOWN)
def test_known_places(plane: Plane, one: Floats, other: Floats, where: tuple[float, float]) -> None:
    """In metres and in kilometres: the middle of the intersection, or halfway between the closest points."""
    for size in (1.0, 1000.0):
        for both in ((one, other), (other, one)):
            found = meeting_xy(plane, *(size * corners + MIDDLE for corners in both))
            np.testing.assert_allclose(found - MIDDLE, size * np.array(where), atol=2e-8, rtol=0)


@planes
def test_sides_that_touch_meet_on_the_side(plane: Plane) -> None:
    """Anywhere on it; a hair's breadth apart, in each other, or neither."""
    for east in (10.0, 10.0 + 1e-7, 10.0 - 1e-7, 10.0 - 1e-12):
        x, y = meeting_xy(plane, SQUARE + MIDDLE, np.add(SQUARE, (east, 5.0)) + MIDDLE) - MIDDLE
        assert x == pytest.approx(10.0, abs=2e-7)
        assert 5.0 - 1e-6 <= y <= 10.0 + 1e-6


def ring(rng: np.random.Generator, middle: Floats) -> Floats:
    """Corners of a random convex polygon of one to nine vertices, counter-clockwise, metres to kilometres wide."""
    count, size = rng.integers(1, 10), 10.0 ** rng.uniform(0.0, 4.0)
    if count < 3:
        return middle + rng.uniform(-size, size, (count, 2))
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    corners = middle + size * np.stack([np.cos(angle), rng.uniform(0.2, 1) * np.sin(angle)], axis=1)
    return shapely.get_coordinates(shapely.orient_polygons(shapely.MultiPoint(corners).convex_hull))[:-1]


@settings(max_examples=300)
@given(st.integers(0, 2**32), st.sampled_from(range(3)))
def test_meeting_place_is_the_middle_of_what_shapely_finds_common(seed: int, which: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = ring(rng, MIDDLE), ring(rng, MIDDLE + rng.uniform(-2000.0, 2000.0, 2))
    a, b = (shapely.MultiPoint(corners).convex_hull for corners in (one, other))
    point = shapely.Point(meeting_xy(PLANES[which], one, other))
    common = shapely.intersection(a, b)
    if common.is_empty:
        assert a.distance(point) == pytest.approx(0.5 * a.distance(b), abs=1e-6)
        assert b.distance(point) == pytest.approx(0.5 * a.distance(b), abs=1e-6)
        return
    assert max(a.distance(point), b.distance(point)) < 1e-6
    if common.area > 1e-3 * common.length**2:
        assert point.distance(common.centroid) < 1e-6 * (1.0 + common.length)


@pytest.mark.parametrize(
    "workload", [LOW_LATITUDE, HIGH_LATITUDE, SEAM, GROWING, OCEAN, GROWING_CIRCLES], ids=lambda w: w.name
)
def test_what_meets_in_motion_meets_in_both(workload: Workload) -> None:
    """Pairs at instants at which they touch: the place is in both of the polygons, for any number of pairs."""
    scene, areas, tracks = plain_scene(workload, 3, 24, 24)
    staged = Staged.of(scene, areas, tracks)
    plane, pieces, held = staged.setup.plane, staged.pieces, staged.prepared
    every = np.arange(len(pieces))
    a, b = (one.ravel() for one in np.meshgrid(every, every))
    start, end = pieces.shared_span(PieceRows(a), PieceRows(b))
    moving = (a < b) & (start < end) & (pieces.kind[b] == 1)
    a, b, start, end = a[moving], b[moving], start[moving], end[moving]
    at_s = (end - start) / 2e6
    apart_m = distances(held, a, b, start, at_s)
    touch = np.flatnonzero(apart_m <= 0.0)
    places = meetings(held, a[touch], b[touch], start[touch], at_s[touch])
    assert len(places) >= 4
    for k, row in enumerate(touch.tolist()):
        x, y = plane.to_plane(*places[k])
        turns = [x + turn * plane.turn_m for turn in (-2, -1, 0, 1, 2)]
        for piece in (a[row], b[row]):
            shape = Movement.of(held, np.array([piece]), start[[row]]).positions(at_s[[row]])[:, :, 0].T
            hull = shapely.MultiPoint(shape).convex_hull
            assert min(hull.distance(shapely.Point(turn, y)) for turn in turns) < 1e-5
    many = meetings(held, *(np.tile(column, 1 + 5000 // len(a)) for column in (a, b, start, at_s)), threads=2)
    np.testing.assert_array_equal(many[: len(a)], meetings(held, a, b, start, at_s))
    np.testing.assert_array_equal(many[touch], places)


@planes
def test_longitudes_are_from_the_date_line_to_the_east(plane: Plane) -> None:
    for lon in (-180.0, 180.0, 179.9999999, 540.0, -540.0, -181.0):
        x, y = plane.to_plane(lon, 60.0)
        if not np.isfinite(x) or (not plane.turn_m and abs(lon) > 200.0):
            continue
        scene = kernel.KernelScene(plane.kernel_plane, still(np.array([(x, y)]), np.array([(x, y)])))
        ((found, lat),) = meetings(scene, *np.array([[0], [1], [0]]), np.zeros(1))
        assert found == pytest.approx((lon + 180.0) % 360.0 - 180.0, abs=1e-9)
        assert lat == pytest.approx(60.0, abs=1e-9)


def test_what_is_no_number_meets_nowhere() -> None:
    bad = SQUARE.copy()
    bad[0, 0] = np.nan
    scene = kernel.KernelScene(PLANES[0].kernel_plane, still(SQUARE, bad))
    a, b, zero = np.array([[0], [1], [0]])
    assert np.isnan(meetings(scene, a, b, zero, np.zeros(1))).all()
    assert np.isnan(distances(scene, a, b, zero, np.zeros(1))).all()
