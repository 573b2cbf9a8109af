"""Follow the shortest lines of the WGS84 ellipsoid with rhumb lines, to a given deviation.

Files that say "geodesic" or "great circle" mean the shortest line between two points. Its bearing changes: a rhumb line
between the same points bends away from it by at most k s^2 / 8. Here s is its length, and k the geodesic curvature of a
rhumb line, at most tan(latitude) over the least radius of curvature of the earth.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import MEAN_RADIUS_M, WGS84_FLATTENING, WGS84_RADIUS_M, shorter_way_deg
from conflictdb.model.settings import EarthModel

Floats = NDArray[np.float64]

DEVIATION_M: Final = 0.5
# Waypoints or vertices along one line; longer ones only occur near the poles.
MOST_PIECES: Final = 10_000
_HIGHEST_DEG: Final = 89.0  # beyond, the plane of rhumb lines refuses the object
LEAST_CURVED_M: Final = WGS84_RADIUS_M * (1.0 - WGS84_FLATTENING) ** 2
_POLAR_M: Final = WGS84_RADIUS_M * (1.0 - WGS84_FLATTENING)
_STEPS: Final = 100
_SMALL: Final = 1e-14


class NoShortestLineError(ValueError):
    """Two places are nearly opposite: many lines between them are almost equally short."""


def followed(positions_deg: Floats, deviation_m: float = DEVIATION_M) -> tuple[Floats, NDArray[np.int64]]:
    """Return positions (m, 2) along shortest lines between positions (n, 2), and the place (n,) of the given ones.

    Rhumb lines between them deviate from the shortest lines by at most `deviation_m`. Longitudes are continuous: they
    may leave +-180. Raises NoShortestLineError.
    """
    given = np.asarray(positions_deg, np.float64)
    counts = _pieces(given, deviation_m)
    lines = [_between(given[i], given[i + 1], int(count)) for i, count in enumerate(counts)]
    lon = np.concatenate([given[:1, 0], *(line[:, 0] for line in lines)])
    lat = np.concatenate([given[:1, 1], *(line[:, 1] for line in lines)])
    lon = lon[0] + np.concatenate([[0.0], np.cumsum(shorter_way_deg(np.diff(lon)))])
    at = np.concatenate([[0], np.cumsum(counts)])
    turns = 360.0 * np.round((lon[at] - given[:, 0]) / 360.0)
    lon[at] = given[:, 0] + turns
    return np.stack([lon, lat], axis=1), at


def _pieces(positions_deg: Floats, deviation_m: float) -> NDArray[np.int64]:
    """Return the number of rhumb lines (n - 1,) for each shortest line."""
    lat = np.radians(positions_deg[:, 1])
    turn = np.radians(shorter_way_deg(np.diff(positions_deg[:, 0])))
    half = np.sin(0.5 * np.diff(lat)) ** 2 + np.cos(lat[:-1]) * np.cos(lat[1:]) * np.sin(0.5 * turn) ** 2
    angle = 2.0 * np.arcsin(np.sqrt(np.clip(half, 0.0, 1.0)))
    # The line comes no nearer to a pole than its higher end by half its length.
    highest = np.maximum(np.abs(lat[:-1]), np.abs(lat[1:])) + 0.5 * angle
    curvature = np.tan(np.minimum(highest, np.radians(_HIGHEST_DEG))) / LEAST_CURVED_M
    length_m = 1.01 * WGS84_RADIUS_M * angle
    count = np.ceil(length_m * np.sqrt(curvature / (8.0 * deviation_m)))
    meridian = turn == 0.0
    return np.where(meridian, 1, np.clip(count, 1, MOST_PIECES)).astype(np.int64)


def _between(start: Floats, end: Floats, count: int) -> Floats:
    """Return `count` positions (count, 2) that divide a shortest line, the last one its end.

    T. Vincenty, "Direct and inverse solutions of geodesics on the ellipsoid", Survey Review 23 (1975), eqs. 13-18: the
    line is a great circle on a sphere of reduced latitudes, whose longitudes differ.
    """
    if count == 1:
        return end[None]
    f = WGS84_FLATTENING
    first, azimuth, sine, sigma = _solved(start, end)
    along = sigma * np.arange(1, count + 1) / count
    sin_u, cos_u = np.sin(first), np.cos(first)
    reduced = np.arcsin(np.clip(sin_u * np.cos(along) + cos_u * np.sin(along) * np.cos(azimuth), -1.0, 1.0))
    on_sphere = np.arctan2(
        np.sin(along) * np.sin(azimuth), cos_u * np.cos(along) - sin_u * np.sin(along) * np.cos(azimuth)
    )
    lon = start[0] + np.degrees(on_sphere - _excess(first, azimuth, sine, along))
    lat = np.degrees(np.arctan(np.tan(reduced) / (1.0 - f)))
    line = np.stack([lon, lat], axis=1)
    line[-1] = end
    return line


def length_and_azimuth(start: Floats, end: Floats) -> tuple[float, float]:
    """Return the length of a shortest line, metres, and its azimuth at its start, degrees clockwise from north.

    Raises NoShortestLineError. T. Vincenty (see `_between`), eqs. 3, 4, 6 and 19.
    """
    first, azimuth, sine, sigma = _solved(start, end)
    big_a, big_b = series(1.0 - sine**2)
    begin = np.arctan2(np.tan(first), np.cos(azimuth))
    less = arc_difference(big_b, np.cos(2.0 * begin + sigma), sigma)
    return float(_POLAR_M * big_a * (sigma - less)), float(np.degrees(azimuth))


def series(cos2_azimuth: Floats, flattening: float = WGS84_FLATTENING) -> tuple[Floats, Floats]:
    """Return the coefficients A and B of a shortest line, from the cosine squared of its azimuth at the equator."""
    u2 = cos2_azimuth * (1.0 / (1.0 - flattening) ** 2 - 1.0)
    big_a = 1.0 + u2 / 16384.0 * (4096.0 + u2 * (-768.0 + u2 * (320.0 - 175.0 * u2)))
    return np.asarray(big_a), u2 / 1024.0 * (256.0 + u2 * (-128.0 + u2 * (74.0 - 47.0 * u2)))


def arc_difference(big_b: Floats, middle: Floats, sigma: Floats) -> Floats:
    """Return how far an arc `sigma` on the sphere exceeds the length of the line, over A times the polar radius.

    middle : the cosine of twice the arc from the equator to the middle of the line
    """
    inner = np.cos(sigma) * (2.0 * middle**2 - 1.0)
    inner = inner - big_b / 6.0 * middle * (4.0 * np.sin(sigma) ** 2 - 3.0) * (4.0 * middle**2 - 3.0)
    return np.asarray(big_b * np.sin(sigma) * (middle + big_b / 4.0 * inner))


def _solved(start: Floats, end: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return reduced latitude and azimuth of the start, the sine of the azimuth at the equator, and the arc, radians.

    They are those of the line on the sphere. Raises NoShortestLineError.
    """
    f = WGS84_FLATTENING
    wanted = float(np.radians(shorter_way_deg(end[0] - start[0])))
    first, last = (np.arctan((1.0 - f) * np.tan(np.radians(at))) for at in (start[1], end[1]))
    turn = wanted
    for _ in range(_STEPS):
        sin_turn, cos_turn = np.sin(turn), np.cos(turn)
        east = np.cos(last) * sin_turn
        north = np.cos(first) * np.sin(last) - np.sin(first) * np.cos(last) * cos_turn
        azimuth = np.arctan2(east, north)
        sigma = np.arctan2(
            np.hypot(east, north), np.sin(first) * np.sin(last) + np.cos(first) * np.cos(last) * cos_turn
        )
        sine = np.cos(first) * np.sin(azimuth)
        before = turn
        turn = wanted + float(_excess(first, azimuth, sine, sigma))
        if abs(turn - before) < _SMALL:
            break
    else:
        raise NoShortestLineError
    return first, azimuth, sine, sigma


def _excess(first: Floats, azimuth: Floats, sine: Floats, sigma: Floats) -> Floats:
    """Return how far longitudes on the sphere exceed those on the ellipsoid after an arc `sigma`, radians."""
    f = WGS84_FLATTENING
    cos2 = 1.0 - sine**2
    begin = np.arctan2(np.tan(first), np.cos(azimuth))
    middle = np.cos(2.0 * begin + sigma)
    c = f / 16.0 * cos2 * (4.0 + f * (4.0 - 3.0 * cos2))
    return np.asarray(
        (1.0 - c) * f * sine * (sigma + c * np.sin(sigma) * (middle + c * np.cos(sigma) * (2.0 * middle**2 - 1.0)))
    )


def places_at(
    lon_deg: Floats | float, lat_deg: Floats | float, distance_m: Floats | float, azimuth: Floats, earth: EarthModel
) -> tuple[Floats, Floats]:
    """Return longitude and latitude, degrees, at a distance along geodesics of azimuths, radians from north.

    Arrays have a common shape, by broadcasting.

    T. Vincenty, "Direct and inverse solutions of geodesics on the ellipsoid", Survey Review 23 (1975), eqs. 1-11.
    """
    is_round = earth == EarthModel.SPHERE
    radius, f = (MEAN_RADIUS_M, 0.0) if is_round else (WGS84_RADIUS_M, WGS84_FLATTENING)
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    reduced = np.arctan((1.0 - f) * np.tan(np.radians(np.clip(lat_deg, -90.0, 90.0))))
    sin_u, cos_u = np.sin(reduced), np.cos(reduced)
    sigma_1 = np.arctan2(sin_u, cos_u * cosine)
    sin_alpha = cos_u * sine
    cos2_alpha = 1.0 - sin_alpha**2
    big_a, big_b = series(cos2_alpha, f)
    first = distance_m / (radius * (1.0 - f) * big_a)
    sigma = first
    for _ in range(8):  # each step gains three digits
        middle = np.cos(2.0 * sigma_1 + sigma)
        sigma = first + arc_difference(big_b, middle, sigma)
    middle = np.cos(2.0 * sigma_1 + sigma)
    sin_s, cos_s = np.sin(sigma), np.cos(sigma)
    lat = np.arctan2(
        sin_u * cos_s + cos_u * sin_s * cosine,
        (1.0 - f) * np.hypot(sin_alpha, sin_u * sin_s - cos_u * cos_s * cosine),
    )
    turn = np.arctan2(sin_s * sine, cos_u * cos_s - sin_u * sin_s * cosine)
    c = f / 16.0 * cos2_alpha * (4.0 + f * (4.0 - 3.0 * cos2_alpha))
    turn -= (1.0 - c) * f * sin_alpha * (sigma + c * sin_s * (middle + c * cos_s * (2.0 * middle**2 - 1.0)))
    return lon_deg + np.degrees(turn), np.degrees(lat)
