"""Distances on the earth over everything that is accepted, against geodesics between points dense along the edges.

A further plane is one more row of PLANES: where its polygons may lie, and the geodesics of its earth.
"""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from conflictdb.earth.geodesy import MEAN_RADIUS_M, WGS84_FLATTENING, WGS84_RADIUS_M
from conflictdb.model import EarthModel, Motion, Scene
from conflictdb.motion.contract import Plane, sides_of
from conflictdb.motion.gnomonic import Gnomonic
from conflictdb.motion.registry import plane_of

ROUND = Geod(a=MEAN_RADIUS_M, b=MEAN_RADIUS_M)
WGS84 = Geod(a=WGS84_RADIUS_M, f=WGS84_FLATTENING)
HALF_ROUND_M = 20_015_000.0
# What coordinates in the plane are rounded to, metres on the earth.
ROUNDING_M = 5e-8

Draw = Callable[[np.random.Generator], np.ndarray]


def mercator_place(rng: np.random.Generator) -> np.ndarray:
    """Longitude and latitude, often close to the poles and the seam."""
    lat = rng.choice([rng.uniform(-89.5, 89.5), 89.5 - rng.exponential(5.0), rng.uniform(-5, 5)])
    return np.array([rng.choice([rng.uniform(-180, 180), 180.0 - rng.exponential(1.0)]), np.clip(lat, -89.5, 89.5)])


def gnomonic_place(rng: np.random.Generator) -> np.ndarray:
    """Within 60 degrees of (20, 50), which holds the pole."""
    bearing, away = rng.uniform(0, 360), rng.uniform(0, 60 * np.pi / 180 * MEAN_RADIUS_M)
    return np.array(ROUND.fwd(20.0, 50.0, bearing, away)[:2])


PLANES = {
    "rhumb, wgs84": (plane_of(Scene("s", earth=EarthModel.WGS84)), WGS84, mercator_place),
    "rhumb, sphere": (plane_of(Scene("s", earth=EarthModel.SPHERE)), ROUND, mercator_place),
    "great circles": (plane_of(Scene("s", motion=Motion.GREAT_CIRCLE, centre=(20.0, 50.0))), ROUND, gnomonic_place),
}
planes = pytest.mark.parametrize("name", PLANES)


def in_plane(plane: Plane, lonlat: np.ndarray) -> np.ndarray:
    return np.stack(plane.to_plane(lonlat[:, 0], lonlat[:, 1]))


def around(
    rng: np.random.Generator, plane: Plane, geod: Geod, place: Draw, middle: np.ndarray, size_m: float
) -> np.ndarray:
    """Corners (2, v) in the plane of a convex polygon about a place: a point, a line, a triangle or a rectangle."""
    count = int(rng.integers(1, 5))
    bearing = np.sort(rng.uniform(0, 360, count)) if count < 4 else rng.uniform(0, 90) + np.arange(4) * 90.0
    lon, lat, _ = geod.fwd(np.full(count, middle[0]), np.full(count, middle[1]), bearing, np.full(count, size_m))
    lon = middle[0] + np.remainder(np.array(lon) - middle[0] + 180.0, 360.0) - 180.0
    if isinstance(plane, Gnomonic):
        # Back towards the centre where it leaves the plane.
        to_centre, _, far = geod.inv(lon, lat, np.full(count, 20.0), np.full(count, 50.0))
        step = np.maximum(np.array(far) - np.radians(60.0) * MEAN_RADIUS_M, 0.0)
        lon, lat, _ = geod.fwd(lon, lat, to_centre, step)
    else:
        lat = np.clip(lat, -89.5, 89.5)
    return in_plane(plane, np.stack([lon, lat], axis=1))


def dense(plane: Plane, xy: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Longitudes and latitudes of points along all edges of (2, v), its corners first."""
    edge = np.roll(xy, -1, axis=1) - xy
    points = xy[:, :, None] + edge[:, :, None] * np.linspace(0, 1, count, endpoint=False)
    lon, lat = plane.from_plane(*points.reshape(2, -1))
    return np.asarray(lon), np.asarray(lat)


def least_m(plane: Plane, geod: Geod, a: np.ndarray, b: np.ndarray, count: int = 40) -> tuple[float, float]:
    """The least geodesic between points along both polygons, and what none between them is below."""
    (lon_a, lat_a), (lon_b, lat_b) = (dense(plane, xy, count) for xy in (a, b))
    i, j = np.meshgrid(np.arange(len(lon_a)), np.arange(len(lon_b)), indexing="ij")
    metres = geod.inv(lon_a[i].ravel(), lat_a[i].ravel(), lon_b[j].ravel(), lat_b[j].ravel())[2]
    steps = []
    for lon, lat in ((lon_a, lat_a), (lon_b, lat_b)):
        along = np.array(geod.inv(lon, lat, np.roll(lon, -1), np.roll(lat, -1))[2])
        steps.append(along.max(initial=0.0) if len(lon) > count else 0.0)
    return float(np.min(metres)), float(np.min(metres)) - 0.51 * sum(steps) * 1.5


def found_m(plane: Plane, a: np.ndarray, b: np.ndarray) -> float:
    sides = (sides_of(xy.shape[1], convex=True) for xy in (a, b))
    return float(plane.distance_m(a[:, :, None], b[:, :, None], *sides)[0])


@planes
@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_points_anywhere(name: str, seed: int) -> None:
    """From side by side to the other side of the earth: never overstated, and understated by no more than is said."""
    plane, geod, place = PLANES[name]
    rng = np.random.default_rng(seed)
    one = place(rng)
    if rng.random() < 0.5:
        two = place(rng)
    else:
        two = np.array(geod.fwd(*one, rng.uniform(0, 360), 10.0 ** rng.uniform(-1, 7))[:2])
        if not plane.holds(*two[:, None]).all():
            return
    a, b = (in_plane(plane, xy[None]) for xy in (one, two))
    true = geod.inv(*one, *two)[2]
    error = float(plane.distance_error_m(true))
    assert true - error - ROUNDING_M <= found_m(plane, a, b) <= true + ROUNDING_M
    assert error <= 1e-6 + 1e-9 * true or true > 100e3


@planes
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_polygons_anywhere(name: str, seed: int) -> None:
    """No geodesic between two points of them is shorter, and one is as short, up to what is said."""
    plane, geod, place = PLANES[name]
    rng = np.random.default_rng(seed)
    one = place(rng)
    away = 10.0 ** rng.uniform(3, 7)
    two = np.array(geod.fwd(*one, rng.uniform(0, 360), away)[:2]) if rng.random() < 0.7 else place(rng)
    if not plane.holds(*two[:, None]).all():
        return
    size = away * rng.uniform(0.05, 0.45, 2)
    a, b = (around(rng, plane, geod, place, at, s) for at, s in zip((one, two), np.minimum(size, 4e6), strict=True))
    above, below = least_m(plane, geod, a, b)
    if below <= 0.0:
        return
    found = found_m(plane, a, b)
    assert found <= above + ROUNDING_M
    assert found + float(plane.distance_error_m(found)) + ROUNDING_M >= below
