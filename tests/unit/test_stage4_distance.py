"""Signed separation against shapely and brute force, and proofs of clearance against dense sampling."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from workloads import HIGH_LATITUDE, PAPER, throw

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import MEAN_RADIUS_M
from conflictdb.model import EarthModel, Motion, Scene
from conflictdb.motion.contract import StaticShapes
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.stage4.constants import TOUCH_M
from conflictdb.stage4.distance import clearance_m, clearance_of, nearest
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.proofs import Reason, undecided_separation
from conflictdb.stage4.roots import crossing

SPHERE = plane_of(Scene("sphere", earth=EarthModel.SPHERE))
ROW = np.zeros(1, np.int64)
AT = np.zeros(1)


def still(a: np.ndarray, b: np.ndarray, separation_m: float = 0.0) -> Encounters:
    a, b = columns(a), columns(b)
    return Encounters(SPHERE, StaticShapes(a), StaticShapes(b), np.zeros((2, 1)), separation_m)


def columns(ring: np.ndarray) -> np.ndarray:
    return np.asarray(ring, float).T[:, :, None]


def polygon(rng: np.random.Generator, count: int, size: float, middle: np.ndarray) -> np.ndarray:
    """Counter-clockwise corners of a convex polygon; one or two of them for a point or a line."""
    if count < 3:
        return middle + rng.uniform(-size, size, (count, 2))
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    ring = middle + size * np.stack([np.cos(angle), rng.uniform(0.2, 1) * np.sin(angle)], axis=1)
    return shapely.get_coordinates(shapely.orient_polygons(shapely.MultiPoint(ring).convex_hull))[:-1]


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 9), st.integers(1, 9), st.sampled_from([0.3, 1.0, 1.5, 3.0, 30.0]))
def test_distance_agrees_with_shapely_and_depth_is_a_way_out(seed: int, m: int, n: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    a = polygon(rng, m, 1000.0, np.array([1e7, 5e6]))
    b = polygon(rng, n, rng.uniform(1, 1500), np.array([1e7, 5e6]) + rng.uniform(-1, 1, 2) * 1000 * spread)
    if rng.random() < 0.3:  # repeated corners change nothing
        b = np.repeat(b, rng.integers(1, 3, len(b)), axis=0)
    one, two = (shapely.MultiPoint(ring).convex_hull for ring in (a, b))
    found = nearest(still(a, b), columns(a), columns(b))
    distance = one.distance(two)
    if distance > 1e-6:
        assert found.gap[0] == pytest.approx(distance, abs=1e-7)
        assert np.hypot(*(found.point_b - found.point_a)[0]) == pytest.approx(distance, abs=1e-7)
        assert shapely.Point(found.point_a[0]).distance(one) < 1e-6
        assert shapely.Point(found.point_b[0]).distance(two) < 1e-6
        return
    assert found.gap[0] <= 1e-6
    # Moved along the axis by the depth the polygons only touch; by less they still overlap.
    moved = shapely.transform(two, lambda xy: xy + found.axis[0] * (-found.gap[0] + 1e-5))
    assert not one.intersects(moved) or one.intersection(moved).area < 1.0
    if found.gap[0] < -1.0:
        for angle in np.linspace(0, 2 * np.pi, 16, endpoint=False):
            push = np.array([np.cos(angle), np.sin(angle)]) * (-found.gap[0] - 0.5)
            assert one.intersects(shapely.transform(two, lambda xy, push=push: xy + push)), "a shorter way out"


def test_signs_of_known_positions() -> None:
    square = np.array([(0, 0), (10, 0), (10, 10), (0, 10)])
    cases = [
        (np.add(square, (20, 0)), 10.0),
        (np.add(square, (13, 14)), 5.0),
        (np.add(square, (10, 0)), 0.0),
        (np.add(square, (10, 10)), 0.0),
        (np.add(square, (8, 0)), -2.0),
        (square, -10.0),
        (np.array([(5, 5)]), -5.0),
        (np.array([(12, 5)]), 2.0),
        (np.array([(13, 14), (13, 14)]), 5.0),
        (np.array([(12, 5), (20, 5)]), 2.0),
        (np.array([(-5, 5), (20, 5)]), -5.0),
        (np.array([(4, 4), (6, 4), (6, 6), (4, 6)]), -6.0),
    ]
    for other, expected in cases:
        for a, b in ((square, other), (other, square)):
            found = nearest(still(a, b), columns(a), columns(b))
            assert found.gap[0] == pytest.approx(expected, abs=1e-9), (other, expected)


def test_lines_and_points() -> None:
    line = np.array([(0, 0), (10, 0)], float)
    cases = [
        (np.add(line, (20, 0)), 10.0),  # end to end
        (np.add(line, (10, 0)), 0.0),
        (np.add(line, (0, 3)), 3.0),
        (np.array([(5, -5), (5, 5)], float), 0.0),  # across: no depth to speak of along the other's direction
        (np.array([(5, 0)], float), 0.0),
        (np.array([(13, 4)], float), 5.0),
    ]
    for other, expected in cases:
        found = nearest(still(line, other), columns(line), columns(other))
        if expected > 0.0:
            assert found.gap[0] == pytest.approx(expected)
        else:
            assert found.gap[0] <= TOUCH_M
    point = np.array([(1.0, 1.0)])
    assert nearest(still(point, point), columns(point), columns(point)).gap[0] == pytest.approx(0.0, abs=1e-9)
    away = np.array([(4.0, 5.0)])
    assert nearest(still(point, away), columns(point), columns(away)).gap[0] == pytest.approx(5.0)


def on_sphere_m(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Great-circle distances between plane points (n, 2) and (m, 2)."""
    radius = MEAN_RADIUS_M
    lat_a, lat_b = (np.arctan(np.sinh(p[:, 1] / radius)) for p in (a, b))
    turn = (b[None, :, 0] - a[:, None, 0]) / radius
    half = np.sin((lat_b[None] - lat_a[:, None]) / 2) ** 2
    return 2 * radius * np.arcsin(np.sqrt(half + np.cos(lat_a)[:, None] * np.cos(lat_b)[None] * np.sin(turn / 2) ** 2))


def least_on_sphere_m(a: np.ndarray, b: np.ndarray) -> float:
    """Least great-circle distance between two boundaries, by ever denser sampling."""
    rings = [shapely.LinearRing(p) for p in (a, b)]
    at, width, best = [np.linspace(0, 1, 1201)] * 2, 1 / 1200, np.inf
    for _ in range(5):
        points = [
            shapely.get_coordinates(shapely.line_interpolate_point(ring, u % 1, normalized=True))
            for ring, u in zip(rings, at, strict=True)
        ]
        distance = on_sphere_m(*points)
        i, j = np.unravel_index(np.argmin(distance), distance.shape)
        best = min(best, float(distance[i, j]))
        at = [np.linspace(u[k] - 2 * width, u[k] + 2 * width, 401) for u, k in zip(at, (i, j), strict=True)]
        width /= 100
    return best


@pytest.mark.parametrize("distance_m", [1e3, 2e4, 1e5])
@pytest.mark.parametrize("lat", [0, 45, 60, 78, -80, 87])
def test_distance_on_the_earth_is_never_overstated(lat: float, distance_m: float) -> None:
    """Not more than the least great-circle distance, and at most micrometres less."""
    rng = np.random.default_rng(7)
    scale = 1 / np.cos(np.radians(lat))
    middle = np.array([0.0, MEAN_RADIUS_M * np.arcsinh(np.tan(np.radians(lat)))])
    for _ in range(8):
        size = distance_m * scale * rng.uniform(0.3, 2.0)
        a = polygon(rng, 5, size, middle)
        angle = rng.uniform(0, 2 * np.pi)
        b = polygon(
            rng, 5, size, middle + np.array([np.cos(angle), np.sin(angle)]) * (2 * size + distance_m * scale) * 0.8
        )
        if shapely.Polygon(a).distance(shapely.Polygon(b)) < 0.2 * distance_m * scale:
            continue
        found = float(clearance_m(still(a, b), ROW, AT)[0])
        true = least_on_sphere_m(a, b)
        assert true - float(SPHERE.distance_error_m(true)) - 5e-6 <= found <= true + 1e-6
        assert clearance_m(still(a, b, 500.0), ROW, AT)[0] == pytest.approx(found - 500.0, abs=1e-6)


def encounters(scene: Scene, pieces: Pieces, a: int, b: int) -> tuple[Encounters, float]:
    start = max(int(pieces.start_us[a]), int(pieces.start_us[b]))
    end = min(int(pieces.end_us[a]), int(pieces.end_us[b]))
    zero = np.array([start])
    pairs = Pairs(np.array([a]), np.array([b]), np.empty((0, 2)), np.zeros(2, np.int64))
    return Encounters.of(plane_of(scene), scene.separation_m, pieces, pairs, ROW, zero), (end - start) / 1e6


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("workload", [PAPER, HIGH_LATITUDE], ids=lambda w: w.name)
@pytest.mark.parametrize(("margin_m", "separation_m"), [(0.0, 0.0), (2000.0, 0.0), (1.0, 5000.0)])
def test_what_is_not_a_leaf_is_clear(workload: object, earth: EarthModel, margin_m: float, separation_m: float) -> None:
    """Outside of undecided intervals no sample is within the margin; one of contact or closeness says when."""
    scene, areas, tracks = throw(workload, 2, 8, 6, earth, separation_m=separation_m)
    pieces = pieces_of(scene, plane_of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
    pairs = []
    for b in np.flatnonzero(pieces.kind == 1).tolist():
        for a in range(b):
            if max(pieces.start_us[a], pieces.start_us[b]) < min(pieces.end_us[a], pieces.end_us[b]):
                pair, span_s = encounters(scene, pieces, a, b)
                pairs.append((float(clearance_m(pair, ROW, np.array([span_s / 2]))[0]), a, b))
    intervals_seen = 0
    for _, a, b in sorted(pairs)[:40]:
        pair, span_s = encounters(scene, pieces, a, b)
        undecided = undecided_separation(pair, ROW, np.zeros(1), np.array([span_s]), margin_m)
        seconds = np.linspace(0.0, span_s, 400)
        clearance = clearance_m(pair, np.zeros(400, np.int64), seconds)
        inside = np.zeros(400, bool)
        for k in range(len(undecided.row)):
            inside |= (undecided.start[k] <= seconds) & (seconds <= undecided.end[k])
            said = float(clearance_m(pair, ROW, undecided.at[k : k + 1])[0])
            assert undecided.reason[k] != Reason.CONTACT or said <= TOUCH_M
            assert undecided.reason[k] != Reason.NEAR or said <= margin_m
        assert (clearance[~inside] > margin_m).all()
        intervals_seen += len(undecided.row)
    assert intervals_seen >= 5


def test_crossing_of_a_passage() -> None:
    """On the equator, past a box with 300 m to spare, and through one."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    degree = scenes.parallel_m(EarthModel.SPHERE, 0.0)
    box = scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 500.0, 500.0, 500.0, 500.0)
    pieces = pieces_of(scene, plane_of(scene), AreaBatch.of([box]), TrackBatch.of([track]))
    (k,) = [k for k in range(1, len(pieces)) if pieces.start_us[k] <= scenes.instant_us(1700) < pieces.end_us[k]][:1]
    pair, span_s = encounters(scene, pieces, 0, k)
    begins = (0.5 - 500.0 / degree) * 3600 - (int(pieces.start_us[k]) - scenes.T0_US) / 1e6
    assert 0.0 < begins < span_s
    outer, inner = crossing(clearance_of(pair, ROW), np.zeros(1), np.array([begins + 5.0]), 0.0)
    assert outer[0] <= begins + 1e-7 <= inner[0] + 2e-7
    assert inner[0] - outer[0] < 1e-6


@pytest.mark.parametrize("motion", Motion)
@pytest.mark.parametrize("lat", [0.0, 45.0, 75.0, -80.0])
def test_sides_that_dent_count_as_their_hull(motion: Motion, lat: float) -> None:
    """A vertex on a straight side of a large haven may lie inside of its image: the hull is meant, and measured.

    So it is as far from a small area as the haven of the hull's vertices is.
    """
    scene = Scene("s", motion=motion, earth=EarthModel.SPHERE, centre=(0.0, lat) if motion == "great_circle" else None)
    size, dented = 200e3, 0
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
            pieces = pieces_of(scene, plane_of(scene), AreaBatch.of([scenes.area("A", place)]), TrackBatch.of([haven]))
            pair, _ = encounters(scene, pieces, 0, len(pieces) - 1)
            one, other = (shape.positions(AT) for shape in (pair.a, pair.b))
            vertices = other[:, :, 0].T
            hull = shapely.get_coordinates(shapely.MultiPoint(vertices).convex_hull)[:-1]
            if len(hull) < 4 or shapely.Polygon(hull).intersects(shapely.MultiPoint(one[:, :, 0].T).convex_hull):
                continue
            dented += len(hull) < len(np.unique(vertices, axis=0))
            as_hull = Encounters(pair.plane, pair.a, StaticShapes(columns(hull)), pair.origin, 0.0)
            assert clearance_m(pair, ROW, AT)[0] == pytest.approx(clearance_m(as_hull, ROW, AT)[0], abs=1e-6)
            found = nearest(pair, one, other)
            assert np.hypot(*(found.point_b - found.point_a)[0]) == pytest.approx(found.gap[0], abs=1e-6)
            assert found.gap[0] == pytest.approx(nearest(as_hull, one, columns(hull)).gap[0], abs=1e-6)
    # On a great circle the sides that run along it are straight.
    assert dented or lat == 0.0 or motion is Motion.GREAT_CIRCLE
