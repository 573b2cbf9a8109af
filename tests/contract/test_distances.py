"""Distances of planes over everything that is accepted, against geodesics between points dense along the edges."""

from typing import Final

import kernel_planes
import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st
from implementations import MOTIONS, MotionRow, Place, for_every_motion, places_apart

# Rounding error of coordinates in the plane, metres on the earth.
ROUNDING_M: Final = 5e-8
# Distances up to here are known to a micrometre.
NEARBY_M: Final = 100e3
DENSE: Final = 40


def found_m(row: MotionRow, a: np.ndarray, b: np.ndarray) -> float:
    # Corners in a row may be those of a polygon seen from below.
    return kernel_planes.distance_m(row.plane, *(xy if turns_left(xy) else xy[:, ::-1] for xy in (a, b)))


def turns_left(xy: np.ndarray) -> bool:
    x, y = xy - xy[:, :1]
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) >= 0.0


@for_every_motion(places_apart)
def test_between_points(row: MotionRow, places: tuple[Place, Place]) -> None:
    """From side by side to the other side of the earth: never overstated, understated by at most the error bound."""
    true = row.geod.inv(*places[0], *places[1])[2]
    found = found_m(row, *(row.xy(place) for place in places))
    error = float(row.plane.distance_error_m(true))
    assert kernel_planes.distance_error_m(row.plane, true) == pytest.approx(error, rel=1e-12)
    assert true - error - ROUNDING_M <= found <= true + ROUNDING_M
    assert error <= 1e-6 + 1e-9 * true or true > NEARBY_M


@st.composite
def polygons(draw: st.DrawFn, row: MotionRow) -> tuple[np.ndarray, np.ndarray]:
    """A point, a line, a triangle or a rectangle each, (2, v) in the plane, of sizes that fit between them."""
    places = draw(places_apart(row))
    away = row.geod.inv(*places[0], *places[1])[2]
    assume(away > 1e3)
    found = []
    for place in places:
        size = min(away * draw(st.floats(0.05, 0.45)), 4e6)
        count = draw(st.integers(1, 4))
        turns = sorted(draw(st.lists(st.floats(0, 359), min_size=count, max_size=count)))
        turns = turns if count < 4 else turns[0] + np.arange(4) * 90.0
        corners = [inward(row, place, turn, size) for turn in turns]
        found.append(
            row.xy(*((place[0] + float(np.remainder(x - place[0] + 180, 360)) - 180.0, y) for x, y in corners))
        )
    return found[0], found[1]


def inward(row: MotionRow, place: Place, bearing: float, size: float) -> Place:
    """A place that far from another, or nearer if it would be outside the valid region."""
    while True:
        corner = row.geod.fwd(*place, bearing, size)[:2]
        if row.beyond_deg(*np.array(corner)) <= 0.0 or size == 0.0:
            return corner if size else place
        size = 0.5 * size if size > 1.0 else 0.0


@for_every_motion(polygons)
def test_between_polygons(row: MotionRow, two: tuple[np.ndarray, np.ndarray]) -> None:
    """No geodesic between two points of them is shorter, and the shortest agrees up to the error bound."""
    above, below = least_m(row, *two)
    assume(below > 0.0)
    check_between(row, *two, above, below)


def test_what_is_found_to_be_nearer_than_the_limit_may_be_beyond_it() -> None:
    """166 degrees apart: the distance is lessened by all that ways may save there, to one where they save little."""
    row = MOTIONS["rhumb, wgs84"]
    a, b = (row.xy(place) for place in ((0.0, -46.11143649), (-162.9750562, 55.14742298)))
    check_between(row, a, b, *least_m(row, a, b))


def check_between(row: MotionRow, a: np.ndarray, b: np.ndarray, above: float, below: float) -> None:
    found = found_m(row, a, b)
    assert found <= above + ROUNDING_M
    assert found + float(row.plane.distance_error_m(found)) + ROUNDING_M >= below


def dense(row: MotionRow, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Longitudes and latitudes of points along all edges of (2, v), its corners first."""
    edge = np.roll(xy, -1, axis=1) - xy
    points = xy[:, :, None] + edge[:, :, None] * np.linspace(0, 1, DENSE, endpoint=False)
    lon, lat = row.plane.from_plane(*points.reshape(2, -1))
    return np.asarray(lon), np.asarray(lat)


def least_m(row: MotionRow, a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """The least geodesic between points along both polygons, and a lower bound for all points between them."""
    (lon_a, lat_a), (lon_b, lat_b) = (dense(row, xy) for xy in (a, b))
    i, j = np.meshgrid(np.arange(len(lon_a)), np.arange(len(lon_b)), indexing="ij")
    least = float(np.min(row.geod.inv(lon_a[i].ravel(), lat_a[i].ravel(), lon_b[j].ravel(), lat_b[j].ravel())[2]))
    steps = 0.0
    for lon, lat in ((lon_a, lat_a), (lon_b, lat_b)):
        along = np.array(row.geod.inv(lon, lat, np.roll(lon, -1), np.roll(lat, -1))[2])
        # Half a step from the nearest point of an edge to a sample; half as much again for the curvature of edges.
        steps += 0.51 * 1.5 * along.max(initial=0.0) if len(lon) > DENSE else 0.0
    return least, least - steps
