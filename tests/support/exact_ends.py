"""Motion and clearance in long double, for ends of contacts of many pairs; shares no formulas with the kernel.

Rhumb lines by meridian distances (`precise.meridian_terms`) and isometric latitudes; great circles by vectors in space.
The gap of convex polygons is that of separating axes: its sign is exact, its size a lower bound. Arrays are (n, ...)
for n pairs; `at_s` counts from the start of each leg and may lie outside of it.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from mpmath import mp, mpf
from precise import meridian_terms

from conflictdb.model.plans import EarthModel

Array = np.ndarray[Any, Any]

RADIUS_M: Final = np.longdouble("6371008.771415")
DEGREE: Final = np.arctan(np.longdouble(1)) / 45
# Nodes and weights of Gauss and Legendre in long double, by the number of nodes.
_GAUSS: dict[int, tuple[Array, Array]] = {}
# Latitudes nearer than this, radians, are integrated: quotients of their differences lose digits.
_NEAR: Final = 0.02


def _gauss(count: int, dtype: Any) -> tuple[Array, Array]:
    if count not in _GAUSS:
        x: Array = np.polynomial.legendre.leggauss(count)[0].astype(np.longdouble)
        for _ in range(3):
            before, now = np.ones_like(x), x
            for k in range(2, count + 1):
                before, now = now, ((2 * k - 1) * x * now - (k - 1) * before) / k
            slope = count * (x * now - before) / (x * x - 1)
            x = x - now / slope
        _GAUSS[count] = x, 2 / ((1 - x * x) * slope**2)
    nodes, weights = _GAUSS[count]
    return nodes.astype(dtype), weights.astype(dtype)


@dataclass(frozen=True)
class Globe:
    """Figure of the earth: radius in metres, squared eccentricity, terms of the meridian distance; radians."""

    a: Any
    e2: Any
    terms: tuple[Any, ...]

    @classmethod
    def of(cls, earth: EarthModel) -> "Globe":
        if earth is EarthModel.SPHERE:
            return cls(RADIUS_M, np.longdouble(0), (np.longdouble(1),))
        with mp.workdps(40):
            f = 1 / mpf("298.257223563")
            terms = [np.longdouble(mp.nstr(term, 30)) for term in meridian_terms(f * (2 - f), 30)]
        f = 1 / np.longdouble("298.257223563")
        return cls(np.longdouble(6378137), f * (2 - f), tuple(term for term in terms if abs(term) > 1e-22))

    def rough(self) -> "Globe":
        """The same in float64: ten times as fast."""
        return Globe(float(self.a), float(self.e2), tuple(map(float, self.terms)))

    def isometric(self, lat: Array) -> Array:
        e = np.sqrt(self.e2)
        return np.arcsinh(np.tan(lat)) - e * np.arctanh(e * np.sin(lat))

    def meridian_m(self, lat: Array) -> Array:
        first, *others = self.terms
        sine, cosine = np.sin(2 * lat), 2 * np.cos(2 * lat)
        here, after = np.zeros_like(lat), np.zeros_like(lat)
        for term in reversed(others):
            here, after = term + cosine * here - after, here
        return self.a * (first * lat + here * sine)

    def along_m(self, lat: Array) -> Array:
        return self.a * (1 - self.e2) / np.sqrt(1 - self.e2 * np.sin(lat) ** 2) ** 3

    def across_m(self, lat: Array) -> Array:
        return self.a * np.cos(lat) / np.sqrt(1 - self.e2 * np.sin(lat) ** 2)

    def turn_per_m(self, lat1: Array, lat2: Array, nodes: int) -> Array:
        """Radians of longitude per metre made good to the east, by quadrature: for latitudes near each other."""
        x, weights = _gauss(nodes, lat1.dtype)
        lat = (lat1 + lat2)[..., None] / 2 + (lat2 - lat1)[..., None] / 2 * x
        along = self.along_m(lat)
        return ((along / self.across_m(lat)) @ weights) / (along @ weights)

    def long_turn_per_m(self, lat1: Array, lat2: Array) -> Array:
        """The same for latitudes at any distance."""
        near = np.abs(lat2 - lat1) < _NEAR
        step = np.where(near, 1, self.meridian_m(lat2) - self.meridian_m(lat1))
        far = (self.isometric(lat2) - self.isometric(lat1)) / step
        return np.where(near, self.turn_per_m(lat1, lat2, 8), far)

    def step(self, lon: Array, lat: Array, north_m: Array, east_m: Array, *, is_long: bool) -> tuple[Array, Array]:
        """Go along a rhumb line by metres to the north and to the east; `is_long`: more than some kilometres."""
        aim = self.meridian_m(lat) + north_m
        to = lat + north_m / self.along_m(lat)
        for _ in range(3 if is_long else 2):
            to = to - (self.meridian_m(to) - aim) / self.along_m(to)
        turn = self.long_turn_per_m(lat, to) if is_long else self.turn_per_m(lat, to, 3)
        return lon + east_m * turn, to

    def metres_per_plane(self, lat: Array) -> Array:
        return self.across_m(lat) / self.a


_COLUMNS: Final = ("ends_deg", "lasts_s", "outline_m", "outline_to_m")


@dataclass(frozen=True)
class Riders:
    """n legs on rhumb lines with havens (n, m, 2), metres (starboard, forward), at the start and the end of the leg.

    ends_deg : (n, 2, 2) float64, longitude and latitude of the start and the end, less than half a turn apart
    lasts_s : (n,)
    """

    globe: Globe
    ends_deg: Array
    lasts_s: Array
    outline_m: Array
    outline_to_m: Array

    def moved(self, by_deg: Array) -> "Riders":
        return replace(self, ends_deg=self.ends_deg + by_deg[:, None, :])

    def take(self, rows: Array) -> "Riders":
        return type(self)(self.globe, *(getattr(self, name)[rows] for name in _COLUMNS))

    def rough(self) -> "Riders":
        columns = (getattr(self, name).astype(np.float64) for name in _COLUMNS)
        return type(self)(self.globe.rough(), *columns)

    @cached_property
    def way(self) -> tuple[Array, ...]:
        """Longitude and latitude (radians) of the start, and metres made good to the north and to the east."""
        globe, ends = self.globe, self.ends_deg.astype(self.lasts_s.dtype) * self.lasts_s.dtype.type(DEGREE)
        (lon0, lat0), (lon1, lat1) = ends[:, 0].T, ends[:, 1].T
        x, weights = _gauss(8, lat0.dtype)
        near = ((lat1 - lat0) / 2) * (
            globe.along_m((lat0 + lat1)[:, None] / 2 + (lat1 - lat0)[:, None] / 2 * x) @ weights
        )
        north = np.where(np.abs(lat1 - lat0) < _NEAR, near, globe.meridian_m(lat1) - globe.meridian_m(lat0))
        return lon0, lat0, north, (lon1 - lon0) / globe.long_turn_per_m(lat0, lat1)

    def reference(self, at_s: Array) -> tuple[Array, Array, Array, Array]:
        """Longitude, latitude (radians) and heading (north, east) of the reference points (n,)."""
        lon0, lat0, north, east = self.way
        share, length = at_s / self.lasts_s, np.hypot(north, east)
        lon, lat = self.globe.step(lon0, lat0, share * north, share * east, is_long=True)
        return lon, np.where(north == 0, lat0, lat), north / length, east / length

    def ring(self, at_s: Array) -> Array:
        """Vertices (n, m, 2) in the Mercator plane over its radius."""
        lon, lat, cos, sin = (value[:, None] for value in self.reference(at_s))
        share = (at_s / self.lasts_s)[:, None, None]
        starboard, forward = np.moveaxis(self.outline_m + share * (self.outline_to_m - self.outline_m), -1, 0)
        shape = np.broadcast_to(lon, starboard.shape), np.broadcast_to(lat, starboard.shape)
        lon, lat = self.globe.step(*shape, forward * cos, forward * sin, is_long=False)
        lon, lat = self.globe.step(lon, lat, -starboard * sin, starboard * cos, is_long=False)
        return np.stack([lon, self.globe.isometric(lat)], axis=-1)

    def place_deg(self, at_s: Array) -> Array:
        lon, lat, _, _ = self.reference(at_s)
        return np.stack([lon, lat], axis=-1) / at_s.dtype.type(DEGREE)


@dataclass(frozen=True)
class Circles(Riders):
    """The same on great circles of the sphere; rings are unit vectors (n, m, 3)."""

    def ring(self, at_s: Array) -> Array:
        start, heading, angle = self.circle
        share = (at_s / self.lasts_s)[:, None]
        outline = self.outline_m + share[..., None] * (self.outline_to_m - self.outline_m)
        across, ahead = (one[..., None] for one in np.moveaxis(outline / self.globe.a, -1, 0))
        at = (share * angle)[..., None] + ahead
        on_track = np.cos(at) * start[:, None] + np.sin(at) * heading[:, None]
        return np.cos(across) * on_track + np.sin(across) * np.cross(heading, start)[:, None]

    def place_deg(self, at_s: Array) -> Array:
        start, heading, angle = self.circle
        at = angle * (at_s / self.lasts_s)[:, None]
        x, y, z = (np.cos(at) * start + np.sin(at) * heading).T
        return np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=-1) / at_s.dtype.type(DEGREE)

    @cached_property
    def circle(self) -> tuple[Array, Array, Array]:
        """Where the reference point starts and which way it goes (unit vectors), and how far (radians)."""
        start, end = (space(self.ends_deg[:, k].astype(self.lasts_s.dtype)) for k in (0, 1))
        pole = np.cross(start, end)
        sine = np.sqrt((pole**2).sum(axis=-1, keepdims=True))
        return start, np.cross(pole, start) / sine, np.arctan2(sine, (start * end).sum(axis=-1, keepdims=True))


@dataclass(frozen=True)
class Fixed:
    """n areas with corners (n, m, 2), degrees, counter-clockwise; on great circles, or in the Mercator plane."""

    globe: Globe
    corners_deg: Array
    is_circle: bool

    def moved(self, by_deg: Array) -> "Fixed":
        return replace(self, corners_deg=self.corners_deg + by_deg[:, None, :])

    def take(self, rows: Array) -> "Fixed":
        return replace(self, corners_deg=self.corners_deg[rows])

    def rough(self) -> "Fixed":
        return replace(self, globe=self.globe.rough())

    def ring(self, at_s: Array) -> Array:
        if self.is_circle:
            return space(self.corners_deg.astype(at_s.dtype))
        lon, lat = np.moveaxis(self.corners_deg.astype(at_s.dtype) * at_s.dtype.type(DEGREE), -1, 0)
        return np.stack([lon, self.globe.isometric(lat)], axis=-1)


def space(lonlat_deg: Array) -> Array:
    lon, lat = np.moveaxis(lonlat_deg * lonlat_deg.dtype.type(DEGREE), -1, 0)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


def gap(one: Array, other: Array) -> Array:
    """Largest gap (n,) across the edges of counter-clockwise convex rings (n, m, 2 or 3); negative: overlap."""
    return np.maximum(_beyond(one, other), _beyond(other, one))


def _beyond(mine: Array, other: Array) -> Array:
    after = np.roll(mine, -1, axis=1)
    if mine.shape[-1] == 3:
        normal = np.cross(mine, after)
        aside = -np.einsum("nec,nvc->nev", normal, other)
    else:
        way = after - mine
        normal = np.stack([way[..., 1], -way[..., 0]], axis=-1)
        aside = np.einsum("nevc,nec->nev", other[:, None] - mine[:, :, None], normal)
    return (aside.min(axis=-1) / np.sqrt((normal**2).sum(axis=-1))).max(axis=-1)


def way_m(globe: Globe, one: Array, other: Array) -> Array:
    """Length (n,) of the shortest way between places (n, 2), degrees, up to some hundred kilometres.

    By the auxiliary sphere (F. W. Bessel, 1825). Its two integrals are computed by quadrature: Vincenty's series end at
    the third power of the flattening and are off by up to a micrometre.
    """
    root = np.sqrt(1 - globe.e2)
    (lon1, lat1), (lon2, lat2) = (place.T * DEGREE for place in (one, other))
    u1, u2 = (np.arctan(root * np.tan(lat)) for lat in (lat1, lat2))
    su1, cu1, su2, cu2 = np.sin(u1), np.cos(u1), np.sin(u2), np.cos(u2)
    nodes, weights = _gauss(8, lat1.dtype)
    away = lon2 - lon1
    turn = away
    for _ in range(12):
        s, c = np.sin(turn), np.cos(turn)
        # As a sum of squares: nothing cancels for short ways.
        north, east = np.sin(u2 - u1) + 2 * su1 * cu2 * np.sin(turn / 2) ** 2, cu2 * s
        sin_sigma = np.hypot(east, north)
        sigma = np.arctan2(sin_sigma, su1 * su2 + cu1 * cu2 * c)
        at = sigma[:, None] * (1 + nodes) / 2
        sin_u = su1[:, None] * np.cos(at) + (cu1 * north / sin_sigma)[:, None] * np.sin(at)
        stretch = np.sqrt(1 + globe.e2 / (1 - globe.e2) * sin_u**2)
        # The flattening f is 1 - root.
        turn = away + cu1 * east / sin_sigma * sigma / 2 * ((globe.e2 / (1 + root * stretch)) @ weights)
    return globe.a * root * sigma / 2 * (stretch @ weights)
