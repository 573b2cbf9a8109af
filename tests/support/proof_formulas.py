"""The formulas of docs/reference/proof.md, as that page has them: whether a direction proves two pieces apart.

Shares nothing with `check_proof.py`. Meridians are integrals and inverses by Newton's method, not series.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

Floats = np.ndarray
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
R = 6_371_008.771415


def mean(f, low: float, high: float) -> float:
    """Return the mean of a function between two numbers."""
    return float(0.5 * np.sum(WEIGHTS * f(low + (high - low) * (0.5 + 0.5 * NODES))))


@dataclass(frozen=True)
class Mercator:
    """The plane of rhumb lines; latitudes in radians, lengths in metres."""

    a: float
    f: float

    @cached_property
    def e2(self) -> float:
        return self.f * (2.0 - self.f)

    def p(self, lat: Floats) -> Floats:
        return self.a * np.cos(lat) / np.sqrt(1.0 - self.e2 * np.sin(lat) ** 2)

    def curvature(self, lat: Floats) -> Floats:
        return self.a * (1.0 - self.e2) / (1.0 - self.e2 * np.sin(lat) ** 2) ** 1.5

    def psi(self, lat: Floats) -> Floats:
        e = np.sqrt(self.e2)
        return np.arcsinh(np.tan(lat)) - e * np.arctanh(e * np.sin(lat))

    def m(self, lat: Floats) -> Floats:
        return np.array([one * mean(self.curvature, 0.0, one) for one in np.ravel(lat)]).reshape(np.shape(lat))

    def lat(self, m: Floats) -> Floats:
        lat = np.asarray(m) / self.a
        for _ in range(6):
            lat = lat - (self.m(lat) - m) / self.curvature(lat)
        return lat

    def stretch(self, m: float, to: float) -> float:
        return mean(lambda at: 1.0 / self.p(self.lat(at)), m, to)

    def second(self, m: float) -> float:
        lat = self.lat(np.array(m))
        return float(np.sin(lat) / self.p(lat) ** 2)

    def third(self, m: float) -> float:
        lat = self.lat(np.array(m))
        p = self.p(lat)
        return float(np.cos(lat) / (self.curvature(lat) * p**2) + 2.0 * np.sin(lat) ** 2 / p**3)

    def half(self, xy: Floats, _n: Floats, distance_m: float) -> Floats:
        theta = distance_m / self.a
        lat = np.array([self.lat_of(y / self.a) for y in xy[:, 1]])
        s = self.a / self.p(lat) * np.sin(theta / 2.0 * (1.0 + 0.3 * self.f * theta**2))
        return self.a * (s + 0.21 * s**3)

    def lat_of(self, psi: float) -> float:
        lat = np.arctan(np.sinh(psi))
        for _ in range(8):
            lat = np.arctan(np.sinh(psi + np.sqrt(self.e2) * np.arctanh(np.sqrt(self.e2) * np.sin(lat))))
        return float(lat)

    def scale(self, xy: Floats) -> float:
        return max(self.a / float(self.p(np.array(self.lat_of(y / self.a)))) for y in xy[:, 1])

    def spread(self, scale: float, distance_m: float) -> float:
        z = 1.01 * scale * np.sin(distance_m / (2.0 * self.a))
        return z * (1.0 + 0.63 * z**2)


@dataclass(frozen=True)
class Gnomonic:
    """The plane of great circles."""

    centre: tuple[float, float]

    def axes(self) -> tuple[Floats, Floats, Floats]:
        return unit(*self.centre), *compass(*self.centre)

    def flat(self, v: Floats) -> Floats:
        up, east, north = self.axes()
        return R * np.stack([v @ east, v @ north], axis=-1) / (v @ up)[..., None]

    def half(self, xy: Floats, n: Floats, distance_m: float) -> Floats:
        square = np.sqrt((1.0 + (xy**2).sum(axis=1) / R**2) * (1.0 + (xy @ n) ** 2 / R**2))
        return R * np.sin(distance_m / (2.0 * R)) * square

    def scale(self, xy: Floats) -> float:
        return float(1.0 + (xy**2).sum(axis=1).max() / R**2)

    def spread(self, _scale: float, distance_m: float) -> float:
        return float(3.5 * np.sin(distance_m / (2.0 * R)))


def unit(lon: float, lat: float) -> Floats:
    lon, lat = np.radians(lon), np.radians(lat)
    return np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


def compass(lon: float, lat: float) -> tuple[Floats, Floats]:
    lon, lat = np.radians(lon), np.radians(lat)
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    return east, np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])


@dataclass(frozen=True)
class Leg:
    """A haven on a leg; seconds since its start.

    ends : (2, 2) degrees; lasts_s : of the leg; heading : radians; havens : (2, n, 2) right and ahead, at both ends
    """

    ends: Floats
    lasts_s: float
    heading: float
    havens: Floats

    def haven(self, s: float) -> tuple[Floats, Floats]:
        """Return right and ahead of each vertex, and their rates."""
        rate = (self.havens[1] - self.havens[0]) / self.lasts_s
        return self.havens[0] + rate * s, rate

    def latitudes(self, plane: Mercator, s: float) -> tuple[float, Floats, Floats]:
        m0, m1 = plane.m(np.radians(self.ends[:, 1]))
        (right, ahead), m = self.haven(s)[0].T, m0 + (m1 - m0) * s / self.lasts_s
        after = m + ahead * np.cos(self.heading)
        return m, after, after - right * np.sin(self.heading)

    def rhumb(self, plane: Mercator, s: float) -> Floats:
        m0, m1 = plane.m(np.radians(self.ends[:, 1]))
        m, after, last = self.latitudes(plane, s)
        lon, lon_to = np.radians(self.ends[:, 0])
        x = plane.a * lon + plane.a * (lon_to - lon) * s / self.lasts_s * plane.stretch(m0, m) / plane.stretch(m0, m1)
        e, n, found = np.sin(self.heading), np.cos(self.heading), []
        for (right, ahead), one, two in zip(self.haven(s)[0], after, last, strict=True):
            step = ahead * e * plane.stretch(m, one) + right * n * plane.stretch(one, two)
            found.append((x + plane.a * step, plane.a * plane.psi(plane.lat(np.array(two)))))
        return np.array(found)

    def vectors(self, s: float) -> Floats:
        start, (east, north) = unit(*self.ends[0]), compass(*self.ends[0])
        along = np.sin(self.heading) * east + np.cos(self.heading) * north
        (right, ahead), way = self.haven(s)[0].T / R, self.length() * s / self.lasts_s
        turned = np.cos(way + ahead)[:, None] * start + np.sin(way + ahead)[:, None] * along
        return np.cos(right)[:, None] * turned + np.sin(right)[:, None] * np.cross(along, start)

    def length(self) -> float:
        return float(2.0 * np.arcsin(np.linalg.norm(unit(*self.ends[1]) - unit(*self.ends[0])) / 2.0))

    def bend(self, plane: Mercator | Gnomonic, n: Floats, t: float, u: float) -> tuple[float, float]:
        """Return bounds of the second derivative along a vector."""
        if isinstance(plane, Gnomonic):
            most = self._bend_of_circle(plane, t, u) * float(np.linalg.norm(n))
            return -most, most
        m0, m1 = plane.m(np.radians(self.ends[:, 1]))
        pace, (_, rate) = (m1 - m0) / self.lasts_s, self.haven(t)
        at = [self.latitudes(plane, s) for s in (t, u)]
        every = np.concatenate([np.atleast_1d(part) for one in at for part in one])
        low, high = every.min(), every.max()
        second = interval(plane.second(low), plane.second(high))
        third = interval(plane.third(low), plane.third(high), *((plane.third(0.0),) if low < 0.0 < high else ()))
        lon, lon_to = np.radians(self.ends[:, 0])
        way = plane.a * (lon_to - lon) / (self.lasts_s * plane.stretch(m0, m1)) * pace
        reference = interval(way * plane.second(at[0][0]), way * plane.second(at[1][0]))
        e, north, found = np.sin(self.heading), np.cos(self.heading), []
        for (right, ahead), (right_to, ahead_to), (dr, df) in zip(
            self.haven(t)[0], self.haven(u)[0], rate, strict=True
        ):
            after, last = pace + df * north, pace + df * north - dr * e
            total = reference
            for g, g_to, dg, q, q_to in (
                (ahead * e, ahead_to * e, df * e, pace, after),
                (right * north, right_to * north, dr * north, after, last),
            ):
                paces = interval(q, q_to)
                squares = interval(q**2, q_to**2, *((0.0,) if paces[0] < 0.0 < paces[1] else ()))
                slow = times(times((2.0 * dg, 2.0 * dg), paces), second)
                steady = times(times(interval(g, g_to), squares), third)
                total = plus(total, times((plane.a, plane.a), plus(slow, steady)))
            found.append(plus(times((n[0], n[0]), total), times((n[1] * plane.a * last**2,) * 2, second)))
        return min(low for low, _ in found), max(high for _, high in found)

    def _bend_of_circle(self, plane: Gnomonic, t: float, u: float) -> float:
        up, most = plane.axes()[0], 0.0
        (one, rate), (other, _) = self.haven(t), self.haven(u)
        ups = self.vectors(t) @ up, self.vectors(u) @ up
        for i in range(len(one)):
            r, r_to, (dr, df) = one[i, 0] / R, other[i, 0] / R, rate[i] / R
            w, sigma = abs(self.length() / self.lasts_s + df), np.sin(max(abs(r), abs(r_to)))
            c = 1.0 if r * r_to <= 0.0 else np.cos(min(abs(r), abs(r_to)))
            v = min(ups[0][i], ups[1][i])
            if dr or df:
                v = max(v - (2.0 * w * abs(dr) * sigma + dr**2) * (u - t) ** 2 / 8.0, 0.49999999998488504)
            bound = w**2 * sigma * c + 2.0 * w * abs(dr) * sigma
            bound += 2.0 * (w**2 * c**2 + dr**2) * np.sqrt(max(1.0 / v**2 - 1.0, 0.0))
            most = max(most, R / v**2 * bound)
        return most


def interval(*values: float) -> tuple[float, float]:
    return min(values), max(values)


def plus(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return a[0] + b[0], a[1] + b[1]


def times(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return interval(*(x * y for x in a for y in b))


def excess(
    plane, one, other, turns: int, into: tuple[float, float], step: tuple[float, float], angle, distance_m
) -> float:
    """Return by how much the gap of a step exceeds what it must: more than 0 proves pieces apart, plane metres.

    one, other : `Leg`, or corners (n, 2) that stand still; into : seconds of both legs at the zero of the step
    """
    n, (t, u) = np.array([np.cos(angle), np.sin(angle)]), step
    gaps, every, pieces = [], [], ((one, into[0]), (other, into[1]))
    for s in step:
        ends = []
        for (piece, begin), sign in zip(pieces, (1.0, -1.0), strict=True):
            if not isinstance(piece, Leg):
                xy = piece
            elif isinstance(plane, Mercator):
                xy = piece.rhumb(plane, begin + s)
            else:
                xy = plane.flat(piece.vectors(begin + s))
            every.append(xy)
            reach = plane.half(xy, n, distance_m) if distance_m else 0.0
            ends.append(np.max(sign * (xy @ n) + reach))
        turn = 2.0 * np.pi * plane.a * n[0] * turns if isinstance(plane, Mercator) else 0.0
        gaps.append(turn - ends[1] - ends[0])
    bends = [
        piece.bend(plane, n, begin + t, begin + u) if isinstance(piece, Leg) else (0.0, 0.0) for piece, begin in pieces
    ]
    k, scale = max(0.0, bends[1][1] - bends[0][0]), plane.scale(np.concatenate(every))
    if distance_m:
        y = [
            max(map(abs, piece.bend(plane, np.array([0.0, 1.0]), begin + t, begin + u)))
            if isinstance(piece, Leg)
            else 0.0
            for piece, begin in pieces
        ]
        k += plane.spread(scale, distance_m) * sum(y)
    return min(gaps) - k * (u - t) ** 2 / 8.0 - 1e-6 * scale
