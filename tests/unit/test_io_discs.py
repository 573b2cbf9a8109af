"""A circle becomes a polygon that contains it, with edges as the scene has them, and exceeds it by a thousandth."""

from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely
from numpy.typing import NDArray
from plan_files import area, read

from conflictdb.formats.discs import EXCESS, disc
from conflictdb.model.plans import EarthModel, Motion, Scene

Floats = NDArray[np.float64]

GEOD = {EarthModel.WGS84: pyproj.Geod(ellps="WGS84"), EarthModel.SPHERE: pyproj.Geod(a=6371008.771415, f=0.0)}
ROUNDING_M = 5e-7


def rhumb_edges(polygon: Any, earth: EarthModel, per_edge: int = 41) -> tuple[Floats, Floats]:
    """Points on the edges of a polygon, straight in the Mercator plane: longitude and latitude."""
    f = 1 / 298.257223563 if earth == EarthModel.WGS84 else 0.0
    e = np.sqrt(f * (2.0 - f))
    xy = shapely.get_coordinates(polygon)
    sine = np.sin(np.radians(xy[:, 1]))
    psi = np.arctanh(sine) - e * np.arctanh(e * sine)
    t = np.linspace(0.0, 1.0, per_edge)
    lon = (xy[:-1, :1] * (1.0 - t) + xy[1:, :1] * t).ravel()
    way = (psi[:-1, None] * (1.0 - t) + psi[1:, None] * t).ravel()
    lat = np.arctan(np.sinh(way))
    for _ in range(10):
        lat = np.arctan(np.sinh(way + e * np.arctanh(e * np.sin(lat))))
    return lon, np.degrees(lat)


def great_circle_edges(polygon: Any, per_edge: int = 41) -> tuple[Floats, Floats]:
    """Points on the edges of a polygon that follow great circles."""
    lon, lat = np.radians(shapely.get_coordinates(polygon)).T
    at = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    t = np.linspace(0.0, 1.0, per_edge)[None, :, None]
    x, y, z = (at[:-1, None] * (1.0 - t) + at[1:, None] * t).reshape(-1, 3).T
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


def distances_m(earth: EarthModel, lon: float, lat: float, edge: tuple[Floats, Floats]) -> Floats:
    shape = np.shape(edge[0])
    return np.asarray(GEOD[earth].inv(np.full(shape, lon), np.full(shape, lat), *edge)[2])


CIRCLES = [
    (4.0, 57.0, 1000.0),
    (0.0, 0.0, 0.5),
    (179.999, 12.0, 50_000.0),
    (-180.0, -45.0, 1_000_000.0),
    (10.0, 0.0, 4_000_000.0),
    (10.0, 85.0, 300_000.0),
    (20.0, -88.9, 5_000.0),
    (33.0, 88.99, 100.0),
]


@pytest.mark.parametrize("earth", list(EarthModel))
@pytest.mark.parametrize(("lon", "lat", "radius_m"), CIRCLES)
def test_rhumb_polygon_contains_the_circle_and_little_more(
    lon: float, lat: float, radius_m: float, earth: EarthModel
) -> None:
    polygon = disc("area 'A'", lon, lat, radius_m, Scene("s", earth=earth))
    assert shapely.is_valid(polygon)
    assert polygon.contains(shapely.Point(lon, lat))
    away_m = distances_m(earth, lon, lat, rhumb_edges(polygon, earth))
    assert away_m.min() >= radius_m - ROUNDING_M
    assert away_m.max() <= (1.0 + EXCESS) * radius_m + ROUNDING_M


def test_random_circles_are_contained() -> None:
    rng = np.random.default_rng(20260301)
    for _ in range(60):
        lon, lat, radius_m = rng.uniform(-180, 180), rng.uniform(-88, 88), 10 ** rng.uniform(-1, 5.5)
        earth = EarthModel(rng.choice(list(EarthModel)))
        if abs(lat) + radius_m / 110_000 > 88.9:
            continue
        polygon = disc("area 'A'", lon, lat, radius_m, Scene("s", earth=earth))
        away_m = distances_m(earth, lon, lat, rhumb_edges(polygon, earth))
        assert radius_m - ROUNDING_M <= away_m.min(), (lon, lat, radius_m, earth)
        assert away_m.max() <= (1.0 + EXCESS) * radius_m + ROUNDING_M, (lon, lat, radius_m, earth)


@pytest.mark.parametrize(("lon", "lat", "radius_m"), [*CIRCLES[:-1], (5.0, 89.9, 5_000.0)])
def test_great_circle_polygon_contains_the_circle_and_little_more(lon: float, lat: float, radius_m: float) -> None:
    polygon = disc("area 'A'", lon, lat, radius_m, Scene("s", Motion.GREAT_CIRCLE))
    assert shapely.is_valid(polygon)
    away_m = distances_m(EarthModel.SPHERE, lon, lat, great_circle_edges(polygon))
    assert away_m.min() >= radius_m - ROUNDING_M
    assert away_m.max() <= (1.0 + EXCESS) * radius_m + ROUNDING_M


@pytest.mark.parametrize(("lat", "radius_m"), [(90.0, 1000.0), (89.0, 300_000.0), (-80.0, 2_000_000.0)])
def test_a_circle_around_a_pole_is_closed_along_it(lat: float, radius_m: float) -> None:
    polygon = disc("area 'A'", 170.0, lat, radius_m, Scene("s", Motion.GREAT_CIRCLE))
    assert shapely.is_valid(polygon)
    ring = shapely.get_coordinates(polygon)
    assert np.count_nonzero(np.abs(ring[:, 1]) == 90.0) == 2
    assert np.ptp(ring[:, 0]) == pytest.approx(360.0, abs=1e-9)
    rim = shapely.LineString(ring[np.abs(ring[:, 1]) != 90.0][:-1])
    away_m = distances_m(EarthModel.SPHERE, 170.0, lat, great_circle_edges(rim))
    assert away_m.min() >= radius_m - ROUNDING_M
    assert away_m.max() <= (1.0 + EXCESS) * radius_m + ROUNDING_M


def test_a_point_with_a_radius_is_an_area(tmp_path: Path) -> None:
    circle = area("C", radius_m=10_000, end="2026-03-01T00:00:00Z", colour="red")
    circle["geometry"] = {"type": "Point", "coordinates": [180.0, 57.0, 12.0]}
    (found,) = read(tmp_path, circle).areas
    assert found.properties == {"colour": "red"}
    assert found.footprint.equals(disc("", 180.0, 57.0, 10_000.0, Scene("plan")))
    assert found.footprint.bounds[2] > 180.1
