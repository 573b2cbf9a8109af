"""Approximate circles by polygons that contain them and exceed the radius by at most a thousandth.

A circle is the set of points within the radius of its centre along geodesics of the scene's earth. The polygon's
corners lie on a slightly wider circle; its edges are straight in the scene's plane, as those of all areas.

Great circles: an edge between corners that are the angle h apart, seen from the centre, comes nearest half-way, where
tan(r) = tan(R) cos(h / 2). The wider radius R follows from the radius r exactly.

Rhumb lines: the wider circle is a curve in the Mercator plane. The chord between corners deviates from it by at most
max |second derivative by the azimuth| h^2 / 8 plane metres. That derivative is at most k R (1 + 2 R tan(lat) / rho),
with k the scale of the plane and rho the least radius of curvature of the earth: the curve has the speed k m, m the
reduced length, and curves by the geodesic curvature m' / m of the circle and by the gradient of ln k; and m <= R, m' <=
1. Points deeper inside the curve than that deviation are inside the polygon.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.earth.geodesy import MEAN_RADIUS_M, WGS84_FLATTENING, WGS84_RADIUS_M
from conflictdb.earth.shortest_lines import places_at
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import (
    MAX_LATITUDE_DEG,
    MAX_LONGITUDE_DEG,
    MAX_RHUMB_LATITUDE_DEG,
    EarthModel,
    Motion,
    Scene,
)

Floats = NDArray[np.float64]

EXCESS: Final = 1e-3  # share of the radius by which the polygon may exceed the circle
MAX_RADIUS_M: Final = 5e6  # beyond this, a circle on the earth differs too much from one on a map
_ROUNDING_M: Final = 1e-7  # rounding of longitudes and latitudes in float64, and of the steps to them
_LEAST_CORNERS: Final = 64
_MOST_CORNERS: Final = 4096
# For all circles of a file: 800 MB, or some 300,000 usual circles.
MAX_CORNERS: Final = 50_000_000
# Variation of the reduced length with azimuth on the ellipsoid, relative: below 0.002 (R / a)^3, from its equation m''
# = -K m and the gradient of the curvature K, at most 0.03 / a^3.
_UNEVEN: Final = 0.01
# A ring around a pole begins at a longitude within a turn east of this, so that it ends within 360.
_WEST_DEG: Final = -360.0


@dataclass(slots=True)
class Corners:
    """The number of corners of a file's circles; a hundred bytes of a file may describe a circle of 4,096."""

    made: int = 0

    def add(self, who: str, count: int) -> None:
        """Add corners; raises InvalidInput above the limit."""
        if self.made + count > MAX_CORNERS:
            rule = f"is a circle too many: those of a file have at most {MAX_CORNERS:,} corners; split the file"
            raise InvalidInput(who, "radius_m", rule)
        self.made += count


def disc(
    who: str, lon_deg: float, lat_deg: float, radius_m: float, scene: Scene, made: Corners | None = None
) -> shapely.MultiPolygon:
    """Return a polygon (longitude, latitude, degrees) that contains a circle; raises InvalidInput.

    made : counts the corners of a file
    """
    made = made or Corners()
    if not abs(lat_deg) <= MAX_LATITUDE_DEG:
        rule = f"latitude must lie within +-90 degrees; got {lat_deg:g} (is it longitude first?)"
        raise InvalidInput(who, "geometry", rule)
    if not 0.0 < radius_m <= MAX_RADIUS_M:
        rule = f"must be a number of metres, more than 0 and at most {MAX_RADIUS_M:,.0f}; got {radius_m:g}"
        raise InvalidInput(who, "radius_m", rule)
    if scene.motion == Motion.GREAT_CIRCLE:
        corners = int(np.ceil(np.pi / np.arccos(1.0 / (1.0 + 0.5 * EXCESS))))
        made.add(who, corners)
        angle = radius_m / MEAN_RADIUS_M
        wider_m = MEAN_RADIUS_M * float(np.arctan(np.tan(angle) / np.cos(np.pi / corners))) + _ROUNDING_M
        return _ring(*_around(lon_deg, lat_deg, wider_m, corners, EarthModel.SPHERE), lat_deg, wider_m)
    corners = _LEAST_CORNERS
    while corners <= _MOST_CORNERS:
        margin_m = _margin_m(who, lon_deg, lat_deg, radius_m, corners, scene.earth)
        if margin_m <= 0.5 * EXCESS * radius_m:
            made.add(who, corners)
            lon, lat = _around(lon_deg, lat_deg, radius_m + margin_m + _ROUNDING_M, corners, scene.earth)
            return _ring(lon, lat, lat_deg, 0.0)
        corners *= 2
    raise InvalidInput(who, "radius_m", "is too large a circle so near the limit of the scene's plane; give a polygon")


def circle(centre: Sequence[float], radius_m: float, scene: Scene) -> shapely.MultiPolygon:
    """Return a footprint that contains a circle on the earth, and exceeds its radius by at most a thousandth.

    The circle is all places within the radius of its centre along the shortest way. The footprint is for areas of a
    scene of the same motion and earth, in whose plane its sides are straight.

    Parameters
    ----------
    centre : longitude and latitude, degrees
    radius_m : float
        More than 0, at most 5,000 km.
    scene : Scene

    Raises InvalidInput for other numbers, and for circles that the scene's plane cannot contain.
    """
    try:
        lon_deg, lat_deg = map(float, centre)
        radius_m = float(radius_m)
    except (TypeError, ValueError):
        lon_deg = lat_deg = np.nan
    if not (abs(lon_deg) <= MAX_LONGITUDE_DEG and abs(lat_deg) <= MAX_LATITUDE_DEG):
        rule = "must be longitude and latitude in degrees, within +-360 and +-90, of a radius in metres"
        raise InvalidInput("circle", "centre", f"{rule}; got {centre!r:.60}, {radius_m!r:.20}")
    return disc("circle", lon_deg, lat_deg, radius_m, scene)


def _margin_m(who: str, lon_deg: float, lat_deg: float, radius_m: float, corners: int, earth: EarthModel) -> float:
    """Return the widening, metres, of the corners' circle that keeps edges along rhumb lines outside the circle."""
    flattening = WGS84_FLATTENING if earth == EarthModel.WGS84 else 0.0
    least_curved_m = WGS84_RADIUS_M * (1.0 - flattening) ** 2 if flattening else MEAN_RADIUS_M
    wider_m = (1.0 + 0.5 * EXCESS) * radius_m
    highest = np.radians(MAX_RHUMB_LATITUDE_DEG)
    if abs(np.radians(lat_deg)) + wider_m / least_curved_m > highest:
        rule = (
            f"reaches beyond {MAX_RHUMB_LATITUDE_DEG:g} degrees of latitude, the limit of a scene with motion 'rhumb'"
        )
        raise InvalidInput(who, "radius_m", f"{rule}; use motion 'great_circle'")
    step = 2.0 * np.pi / corners
    lat = np.abs(np.radians(_around(lon_deg, lat_deg, wider_m, corners, earth)[1]))
    nearby = wider_m * step / least_curved_m  # latitude range around each corner that contains both edges
    largest = np.minimum(lat + nearby, highest)
    second = wider_m * (1.0 + _UNEVEN + 2.0 * wider_m * np.tan(largest) / least_curved_m) * step**2 / 8.0
    scale = np.cos(np.maximum(lat - nearby, 0.0)) / np.cos(largest)
    return float((second * scale).max())


def _ring(lon: Floats, lat: Floats, centre_lat: float, wider_m: float) -> shapely.MultiPolygon:
    """Return the polygon of the corners; around a pole it is closed along the pole."""
    pole = np.copysign(90.0, centre_lat)
    if wider_m and np.radians(90.0 - abs(centre_lat)) * MEAN_RADIUS_M <= wider_m:
        turns = np.sort(np.remainder(lon - _WEST_DEG, 360.0) + _WEST_DEG)
        order = np.argsort(np.remainder(lon - _WEST_DEG, 360.0))
        edge = np.concatenate([np.stack([turns, lat[order]], axis=1), [[turns[0] + 360.0, lat[order[0]]]]])
        ring = np.concatenate([edge, [[edge[-1, 0], pole], [edge[0, 0], pole]]])
    else:
        ring = np.stack([lon, lat], axis=1)
    return shapely.MultiPolygon([shapely.Polygon(ring)])


def _around(lon_deg: float, lat_deg: float, distance_m: float, count: int, earth: EarthModel) -> tuple[Floats, Floats]:
    """Return longitude and latitude (count,) at a distance, in evenly spread directions."""
    return places_at(lon_deg, lat_deg, distance_m, 2.0 * np.pi * np.arange(count) / count, earth)
