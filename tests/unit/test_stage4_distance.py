"""Signed separation of polygons, as the kernel measures it, against shapely and brute force."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest
import scenes
import shapely
from draws import draws
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_planes import distance_m
from staged import still

from conflictdb import kernel
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.stage4.constants import TOUCH_M
from conflictdb.earth.geodesy import MEAN_RADIUS_M
from conflictdb.earth.registry import Setup
from conflictdb.kernel.meeting import distances
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import EarthModel, Motion, Scene

SCENE = Scene("sphere", earth=EarthModel.SPHERE)
SPHERE = Setup.of(SCENE).plane
# On the equator, where the plane has the scale of the earth to 2e-8 of a length for some kilometres.
MIDDLE = np.array([1e7, 0.0])


def apart_m(pieces: Pieces, a: int = 0, b: int = 1, at_s: float = 0.0, scene: Scene = SCENE) -> float:
    """Distance of two pieces, at a time in seconds after the start of the second one's leg."""
    held = kernel.KernelScene(Setup.of(scene).plane.kernel_plane, pieces)
    return float(distances(held, np.array([a]), np.array([b]), pieces.leg_start_us[[b]], np.array([at_s]))[0])


def polygon(rng: np.random.Generator, count: int, size: float, middle: np.ndarray) -> np.ndarray:
    """Counter-clockwise corners of a convex polygon; one or two of them for a point or a line."""
    if count < 3:
        return middle + rng.uniform(-size, size, (count, 2))
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    ring = middle + size * np.stack([np.cos(angle), rng.uniform(0.2, 1) * np.sin(angle)], axis=1)
    return shapely.get_coordinates(shapely.orient_polygons(shapely.MultiPoint(ring).convex_hull))[:-1]


@settings(max_examples=300)
@given(st.integers(0, 2**32), st.integers(1, 9), st.integers(1, 9), st.sampled_from([0.3, 1.0, 1.5, 3.0, 30.0]))
def test_distance_agrees_with_shapely_and_depth_is_a_way_out(seed: int, m: int, n: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    a = polygon(rng, m, 1000.0, MIDDLE)
    b = polygon(rng, n, rng.uniform(1, 1500), MIDDLE + rng.uniform(-1, 1, 2) * 100 * spread)
    if rng.random() < 0.3:  # repeated corners change nothing
        b = np.repeat(b, rng.integers(1, 3, len(b)), axis=0)
    distance = shapely.MultiPoint(a).convex_hull.distance(shapely.MultiPoint(b).convex_hull)
    found = apart_m(still(a, b))
    if distance > 1e-6:
        assert found == pytest.approx(distance, abs=1e-6, rel=1e-6)
        return
    # The shortest way out, by brute force over all directions.
    angle = np.linspace(0.0, 2.0 * np.pi, 20_001)
    way = np.stack([np.cos(angle), np.sin(angle)])
    out = ((a - MIDDLE) @ way).max(axis=0) - ((b - MIDDLE) @ way).min(axis=0)
    assert -1e-6 <= -found <= out.min() * (1.0 + 1e-6) + 1e-6
    assert -found >= 0.999 * out.min() - 1.0


SQUARE = np.array([(0, 0), (10, 0), (10, 10), (0, 10)], float)
LINE = np.array([(0, 0), (10, 0)], float)
POINT = np.array([(1.0, 1.0)])
KNOWN = [
    (SQUARE, np.add(SQUARE, (20, 0)), 10.0),
    (SQUARE, np.add(SQUARE, (13, 14)), 5.0),
    (SQUARE, np.add(SQUARE, (10, 0)), 0.0),
    (SQUARE, np.add(SQUARE, (10, 10)), 0.0),
    (SQUARE, np.add(SQUARE, (8, 0)), -2.0),
    (SQUARE, SQUARE, -10.0),
    (SQUARE, np.array([(5, 5)]), -5.0),
    (SQUARE, np.array([(12, 5)]), 2.0),
    (SQUARE, np.array([(13, 14), (13, 14)]), 5.0),
    (SQUARE, np.array([(12, 5), (20, 5)]), 2.0),
    (SQUARE, np.array([(-5, 5), (20, 5)]), -5.0),
    (SQUARE, np.array([(4, 4), (6, 4), (6, 6), (4, 6)]), -6.0),
    (LINE, np.add(LINE, (20, 0)), 10.0),  # end to end
    (LINE, np.add(LINE, (0, 3)), 3.0),
    (LINE, np.array([(13, 4)], float), 5.0),
    (POINT, np.array([(4.0, 5.0)]), 5.0),
]


@pytest.mark.parametrize(("one", "other", "expected"), KNOWN)
def test_known_distances_and_depths(one: np.ndarray, other: np.ndarray, expected: float) -> None:
    for a, b in ((one, other), (other, one)):
        assert apart_m(still(a + MIDDLE, b + MIDDLE)) == pytest.approx(expected, abs=2e-8)


@pytest.mark.parametrize(
    ("one", "other"),
    [(LINE, np.add(LINE, (10, 0))), (LINE, np.array([(5.0, -5.0), (5.0, 5.0)])), (LINE, LINE[:1]), (POINT, POINT)],
)
def test_lines_and_points_that_touch_have_no_depth_to_speak_of(one: np.ndarray, other: np.ndarray) -> None:
    for a, b in ((one, other), (other, one)):
        assert apart_m(still(a + MIDDLE, b + MIDDLE)) <= TOUCH_M


def on_sphere_m(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Great-circle distances between plane points (n, 2) and (m, 2)."""
    radius = MEAN_RADIUS_M
    lat_a, lat_b = (np.arctan(np.sinh(p[:, 1] / radius)) for p in (a, b))
    turn = (b[None, :, 0] - a[:, None, 0]) / radius
    half = np.sin((lat_b[None] - lat_a[:, None]) / 2) ** 2
    return 2 * radius * np.arcsin(np.sqrt(half + np.cos(lat_a)[:, None] * np.cos(lat_b)[None] * np.sin(turn / 2) ** 2))


def least_on_sphere_m(a: np.ndarray, b: np.ndarray) -> float:
    """Least great-circle distance between two boundaries: sampled all along, then ever denser about the least."""
    rings = [shapely.LinearRing(p) for p in (a, b)]

    def places(at: list[np.ndarray]) -> list[np.ndarray]:
        return [
            shapely.get_coordinates(shapely.line_interpolate_point(ring, share % 1, normalized=True))
            for ring, share in zip(rings, at, strict=True)
        ]

    at, width, best = [np.linspace(0, 1, 1201)] * 2, 1 / 1200, np.inf
    one, other = map(unit, places(at))
    nearness = one @ other.T
    for _ in range(8):
        i, j = np.unravel_index(np.argmax(nearness), nearness.shape)
        at = [
            np.linspace(shares[k] - 2 * width, shares[k] + 2 * width, 81) for shares, k in zip(at, (i, j), strict=True)
        ]
        width /= 20
        nearness = -on_sphere_m(*places(at))
        best = min(best, float(-nearness.max()))
    return best


@pytest.mark.parametrize("distance_m", [1e3, 2e4, 1e5])
@pytest.mark.parametrize("lat", [0, 45, 60, 78, -80, 87])
@draws("polygons", 3, 8)
def test_distance_on_the_earth_is_never_overstated(lat: float, distance_m: float, polygons: int) -> None:
    """At most the least great-circle distance, and less by micrometres only."""
    rng = np.random.default_rng(7)
    scale = 1 / np.cos(np.radians(lat))
    middle = np.array([0.0, MEAN_RADIUS_M * np.arcsinh(np.tan(np.radians(lat)))])
    for _ in range(polygons):
        size = distance_m * scale * rng.uniform(0.3, 2.0)
        a = polygon(rng, 5, size, middle)
        angle = rng.uniform(0, 2 * np.pi)
        way = np.array([np.cos(angle), np.sin(angle)]) * (2 * size + distance_m * scale) * 0.8
        b = polygon(rng, 5, size, middle + way)
        if shapely.Polygon(a).distance(shapely.Polygon(b)) < 0.2 * distance_m * scale:
            continue
        true = least_on_sphere_m(a, b)
        assert true - float(SPHERE.distance_error_m(true)) - 5e-6 <= apart_m(still(a, b)) <= true + 1e-6


@pytest.mark.parametrize("motion", Motion)
@pytest.mark.parametrize("lat", [0.0, 45.0, 75.0, -80.0])
def test_sides_that_dent_count_as_their_hull(motion: Motion, lat: float) -> None:
    """A vertex on a straight side of a large haven may lie inside of its image: the distance is that of the hull.

    So it is as far from a small area as the haven of the hull's vertices is.
    """
    scene = replace(SCENE, motion=motion, centre=(0.0, lat) if motion == "great_circle" else None)
    setup, size, dented = Setup.of(scene), 200e3, 0
    corners = [(size, size), (size, -size), (-size, -size), (-size, size)]
    ring = [
        (x, y)
        for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1], strict=True)
        for x, y in ((x, y), ((x + u) / 2, (y + v) / 2))
    ]
    for bearing in (0.0, 30.0, 90.0):
        course = [(0.0, lat), (np.sin(np.radians(bearing)), lat + 0.3 * np.cos(np.radians(bearing)))]
        for lon_apart, lat_apart in ((4.2, 0.1), (-4.1, 0.0), (0.3, 2.5), (-0.2, -2.4)):
            turn = lon_apart / np.cos(np.radians(lat))
            place = shapely.box(turn - 0.01, lat + lat_apart - 0.01, turn + 0.01, lat + lat_apart + 0.01)
            haven = replace(scenes.track("T", course, [0, 3600], 1.0, 1.0, 1.0, 1.0), outline_m=np.array(ring))
            pieces = pieces_of(setup, AreaBatch.of([scenes.area("A", place)]), TrackBatch.of([haven]))
            own = pieces.take(np.array([0, len(pieces) - 1]))
            held = kernel.KernelScene(setup.plane.kernel_plane, own)
            vertices = Movement.of(held, np.array([1]), own.leg_start_us[[1]]).positions(np.zeros(1))[:, :, 0].T
            hull = shapely.get_coordinates(shapely.orient_polygons(shapely.MultiPoint(vertices).convex_hull))[:-1]
            small = own.shape_xy[: own.shape_offset[1]]
            if len(hull) < 4 or shapely.Polygon(hull).intersects(shapely.MultiPoint(small).convex_hull):
                continue
            dented += len(hull) < len(np.unique(vertices, axis=0))
            as_hull = apart_m(still(small, hull), scene=scene)
            assert apart_m(own, scene=scene) == pytest.approx(as_hull, abs=1e-6)
    # On a great circle the sides that run along it are straight.
    assert dented or lat == 0.0 or motion is Motion.GREAT_CIRCLE


def unit(xy: np.ndarray) -> np.ndarray:
    """Directions (n, 3) of places of the sphere's Mercator plane (n, 2)."""
    lon, latitude = xy[:, 0] / MEAN_RADIUS_M, np.arctan(np.sinh(xy[:, 1] / MEAN_RADIUS_M))
    return np.stack([np.cos(latitude) * np.cos(lon), np.cos(latitude) * np.sin(lon), np.sin(latitude)], axis=1)


def sampled_m(a: np.ndarray, b: np.ndarray, samples: int) -> float:
    """The least great circle from corners of either to samples of the other's sides."""
    share = np.linspace(0.0, 1.0, samples)[:, None]
    found = np.inf
    for corners, ring in ((a, b), (b, a)):
        for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            chords = np.linalg.norm(unit(start + share * (end - start))[:, None] - unit(corners), axis=2)
            found = min(found, 2.0 * MEAN_RADIUS_M * np.arcsin(0.5 * chords.min()))
    return found


def psi_m(latitude_deg: float) -> float:
    return float(MEAN_RADIUS_M * np.arctanh(np.sin(np.radians(latitude_deg))))


@pytest.mark.parametrize("from_pole_m", [2.0, 300.0, 30e3])
@pytest.mark.parametrize("south_deg", [-40.0, 3.0, 50.0])
def test_distance_of_a_parallel_from_near_a_pole(from_pole_m: float, south_deg: float) -> None:
    """All of it is about as near, and yet the distance is known, with few halvings."""
    rng = np.random.default_rng(int(from_pole_m))
    north = psi_m(90.0 - np.degrees(from_pole_m / MEAN_RADIUS_M))
    turn = np.pi * MEAN_RADIUS_M
    a = polygon(rng, 5, 0.1 * turn, np.array([0.2 * turn, north]))
    low, high = psi_m(south_deg - 4.0), psi_m(south_deg)
    b = np.array([(0.0, low), (0.5 * turn, low), (0.5 * turn, high), (0.0, high)])
    left = ctypes.c_int64(1000)
    found = distance_m(SPHERE, a.T, b.T, left)
    best = sampled_m(a, b, 20_001)
    assert best - 0.002 <= found <= best + 1e-6
    assert left.value > 0


def test_distance_of_what_touches_across_the_seam_takes_little_work() -> None:
    """The distance is below rounding, so it takes no halvings: corners of two triangles in one place."""
    corner, turn = np.array([-0.644734000621, 1.60003188456]), np.array([2.0 * np.pi, 0.0])
    a = corner + np.array([(0.0, 0.0), (0.0069, -0.0003), (0.007, 0.005)])
    b = corner - turn + np.array([(0.0, 0.0), (-0.0035, 0.005), (-0.00707936, 0.000304731)])
    left = ctypes.c_int64(1000)
    assert distance_m(SPHERE, MEAN_RADIUS_M * a.T, MEAN_RADIUS_M * b.T, left) == pytest.approx(0.0, abs=1e-8)
    assert left.value > 0
