#!/usr/bin/env python3
"""Check a proof of `conflictdb admin certify`: what a detection found is true, and nothing is missing.

    python check_proof.py PROOF

One file that needs nothing but Python 3.11. It reads the objects itself, has its own formulas of how they move, and its
own boxes: pieces whose boxes meet need a proof. docs/reference/proof.md describes the file and the formulas.

Exit status 0: all is proven. 1: something is wrong, or without proof. 2: all that can be checked is proven, and the
report says what cannot be checked.
"""

import hashlib
import json
import sys
from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

# isort: split
from math import asin, asinh, atan, atan2, atanh, ceil, cos, cosh, floor, hypot, inf, isfinite, log2, pi

# isort: split
from math import radians, sin, sinh, sqrt, tan, tanh

VERSION = 1
MEAN_RADIUS_M, WGS84_RADIUS_M, FLATTENING = 6371008.771415, 6378137.0, 1 / 298.257223563
ROUNDING_M = 1e-6  # on the earth
DISTANCE_M = 1e-3  # of distances on the earth that show a contact, where a separation is required
SAME_HEIGHT_M = 5e-10
SHARP_S, SHARP_APART_S = 1e-2, 1.0  # how sharp ends of periods are proven, without and with a separation
FARTHEST = 0.1  # radians: larger separations are not checked
LEAST_UP = 0.49999999998488504  # 60 degrees from the centre of a scene of great circles
TOLERANCES = {"xtd_port_m", "xtd_starboard_m", "min_speed_kn", "max_speed_kn", "turn_radius_m"}
TOLERANCES |= {"departure_window", "arrival_window"}
PARTS = ["settings", "objects", "pieces", "verdicts", "proofs"]
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
GAUSS = [(s * sqrt(5 - s * s * 2 * sqrt(10 / 7)) / 3, (322 + 13 * sqrt(70)) / 1800) for s in (-1.0, 1.0)]
GAUSS += [(s * sqrt(5 + s * s * 2 * sqrt(10 / 7)) / 3, (322 - 13 * sqrt(70)) / 1800) for s in (-1.0, 1.0)]
GAUSS += [(0.0, 64 / 225)]  # nodes from -1 to 1, and weights of sum 1

Point = tuple[float, float]
Range = tuple[float, float]
Vector = tuple[float, ...]


class Refused(Exception):
    """The proof is no proof."""


# ---- Planes, in which legs and edges are straight -------------------------------------------------------------------


class _Mercator:
    """x = a lon, y = a psi; m is the distance from the equator along a meridian, metres."""

    def __init__(self, is_sphere: bool) -> None:
        f = self.f = 0.0 if is_sphere else FLATTENING
        self.a, self.e2, n = MEAN_RADIUS_M if is_sphere else WGS84_RADIUS_M, f * (2 - f), f / (2 - f)
        self.e, self.unit = sqrt(self.e2), self.a / (1 + n) * (1 + n**2 / 4 + n**4 / 64 + n**6 / 256)
        self.to_m = [
            n * (-3 / 2 + 9 / 16 * n**2 - 3 / 32 * n**4),
            n**2 * (15 / 16 - 15 / 32 * n**2 + 135 / 2048 * n**4),
        ]
        self.to_m += [n**3 * (-35 / 48 + 105 / 256 * n**2), n**4 * (315 / 512 - 189 / 512 * n**2), -693 / 1280 * n**5]
        self.to_m += [1001 / 2048 * n**6]
        self.to_lat = [n * (3 / 2 - 27 / 32 * n**2 + 269 / 512 * n**4)]
        self.to_lat += [n**2 * (21 / 16 - 55 / 32 * n**2 + 6759 / 4096 * n**4), n**3 * (151 / 96 - 417 / 128 * n**2)]
        self.to_lat += [n**4 * (1097 / 512 - 15543 / 2560 * n**2), 8011 / 2560 * n**5, 293393 / 61440 * n**6]
        self.turn, self.at_equator = 2 * pi * self.a, self.slopes(0.0)[1]

    def m(self, lat: float) -> float:
        return self.unit * (lat + sum(c * sin(2 * j * lat) for j, c in enumerate(self.to_m, 1)))

    def lat(self, m: float) -> float:
        mu = m / self.unit
        return mu + sum(c * sin(2 * j * mu) for j, c in enumerate(self.to_lat, 1)) if self.f else mu

    def psi(self, lat: float) -> float:
        return asinh(tan(lat)) - self.e * atanh(self.e * sin(lat))

    def lat_of(self, psi: float) -> float:
        lat = atan(sinh(psi))
        for _ in range(5 if self.f else 0):
            lat = atan(sinh(psi + self.e * atanh(self.e * sin(lat))))
        return lat

    def axis(self, lat: float) -> float:
        """Return the distance from the axis of the earth: the metres of a radian of longitude."""
        return self.a * cos(lat) / sqrt(1 - self.e2 * sin(lat) ** 2)

    def slopes(self, m: float) -> tuple[float, float]:
        """Return the second and the third derivative of psi in m; the first is 1 / axis."""
        lat = self.lat(m)
        p, sine, w = self.axis(lat), sin(lat), 1 - self.e2 * sin(lat) ** 2
        return sine / (p * p), cos(lat) * w**1.5 / (self.a * (1 - self.e2) * p * p) + 2 * sine * sine / (p * p * p)

    def stretch(self, m1: float, m2: float) -> float:
        """Return (psi(m2) - psi(m1)) / (m2 - m1), the mean of 1 / axis, without cancellation."""
        d, to_pole = m2 - m1, self.unit * pi / 2 - max(abs(m1), abs(m2))
        if abs(d) > 6e5:
            return (self.psi(self.lat(m2)) - self.psi(self.lat(m1))) / d
        parts = min(ceil(abs(d) / (0.1 * max(to_pole, 1e3))), 1000) or 1
        nodes = [(m1 + d * (k + 0.5 + 0.5 * x) / parts, w) for k in range(parts) for x, w in GAUSS]
        return sum(w / self.axis(self.lat(m)) for m, w in nodes) / parts

    def place(self, lon: float, lat: float) -> Point:
        return self.a * radians(lon), self.a * self.psi(radians(lat))

    def scale(self, points: Iterable[Point]) -> float:
        """Return the most plane metres of a metre at some places."""
        return self.a / self.axis(self.lat_of(max(abs(y) for _, y in points) / self.a))

    def half(self, distance_m: float, point: Point, _along: Point) -> float:
        """Return a half of a distance: two places nearer on the earth are within both halves, plane metres."""
        theta = distance_m / self.a
        sine = self.scale([point]) * sin(theta / 2 * (1 + 0.3 * self.f * theta**2))
        if sine > 0.5 or theta > FARTHEST:
            raise OverflowError
        return self.a * (sine + 0.21 * sine**3)

    def half_slope(self, distance_m: float, scale: float) -> float:
        """Return by how much a half may change from place to place."""
        sine = 1.01 * scale * sin(distance_m / self.a / 2)
        return sine * (1 + 0.63 * sine**2)

    def distance(self, one: Point, other: Point) -> float:
        """Return the length of the great circle of the conformal sphere: the shortest line is no longer."""
        psi, psi_to = (self.psi(radians(lat)) for _, lat in (one, other))
        sine = hypot(sin(radians(other[0] - one[0]) / 2), sinh((psi_to - psi) / 2)) / sqrt(cosh(psi) * cosh(psi_to))
        theta, total = 2 * asin(min(sine, 1.0)), 0.0
        for x, w in GAUSS if theta else ():
            part = theta * (0.5 + 0.5 * x)
            lat = self.lat_of(atanh((sin(theta - part) * tanh(psi) + sin(part) * tanh(psi_to)) / sin(theta)))
            total += w * theta * self.axis(lat) * cosh(self.psi(lat))
        return total


class _Gnomonic:
    """The sphere, projected from its centre to the plane that touches it at the centre of the scene."""

    turn = 0.0

    def __init__(self, centre: Sequence[float]) -> None:
        self.up, (self.east, self.north) = _unit_vector(*centre), _compass(*centre)

    def flat(self, v: Vector) -> Point:
        up = _dot(self.up, v)
        if not up > 0.4:
            raise Refused("a place is too far from the centre of the scene")
        return MEAN_RADIUS_M * _dot(self.east, v) / up, MEAN_RADIUS_M * _dot(self.north, v) / up

    def place(self, lon: float, lat: float) -> Point:
        return self.flat(_unit_vector(lon, lat))

    def scale(self, points: Iterable[Point]) -> float:
        return 1 + max(x * x + y * y for x, y in points) / MEAN_RADIUS_M**2

    def half(self, distance_m: float, point: Point, along: Point) -> float:
        own = ((point[0] * along[0] + point[1] * along[1]) / MEAN_RADIUS_M) ** 2
        if distance_m / MEAN_RADIUS_M > FARTHEST:
            raise OverflowError
        return MEAN_RADIUS_M * sin(distance_m / MEAN_RADIUS_M / 2) * sqrt(self.scale([point]) * (1 + own))

    def half_slope(self, distance_m: float, _scale: float) -> float:
        return 3.5 * sin(distance_m / MEAN_RADIUS_M / 2)

    def distance(self, one: Point, other: Point) -> float:
        (x, y, z), (u, v, w) = _unit_vector(*one), _unit_vector(*other)
        return 2 * MEAN_RADIUS_M * asin(min(hypot(x - u, y - v, z - w) / 2, 1.0))


def _dot(u: Vector, v: Vector) -> float:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _unit_vector(lon: float, lat: float) -> Vector:
    lon, lat = radians(lon), radians(lat)
    return cos(lat) * cos(lon), cos(lat) * sin(lon), sin(lat)


def _compass(lon: float, lat: float) -> tuple[Vector, Vector]:
    lon, lat = radians(lon), radians(lat)
    return (-sin(lon), cos(lon), 0.0), (-sin(lat) * cos(lon), -sin(lat) * sin(lon), cos(lat))


def _courses(plane: Any, ends: Sequence[Point]) -> tuple[float, float] | None:
    """Return the bearing of a leg at its start and at its end; None: it stands still."""
    (lon, one), (lon_to, other) = ((radians(lon), radians(lat)) for lon, lat in ends)
    turn, bend = lon_to - lon, 2 * sin((lon_to - lon) / 2) ** 2
    if turn == 0.0 and one == other:
        return None
    if isinstance(plane, _Mercator):
        m, m_to = plane.m(one), plane.m(other)
        return (atan2(turn / plane.stretch(m, m_to), m_to - m),) * 2
    first = atan2(cos(other) * sin(turn), sin(other - one) + sin(one) * cos(other) * bend)
    return first, atan2(cos(one) * sin(turn), sin(other - one) - sin(other) * cos(one) * bend)


# ---- Pieces: polygons that stand still or move along a leg ----------------------------------------------------------


def _range(a: float, b: float) -> Range:
    return (a, b) if a <= b else (b, a)


def _plus(a: Range, b: Range) -> Range:
    return a[0] + b[0], a[1] + b[1]


def _times(a: Range, b: Range) -> Range:
    products = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    return min(products), max(products)


def _step_bend(rate: float, length: Range, pace: Range, second: Range, third: Range) -> Range:
    """Return bounds of the second derivative of a step h: 2 h' psi'' q' + h psi''' q'^2, q where it is."""
    low, high = _range(pace[0] ** 2, pace[1] ** 2)
    steady = _times(_times(length, (0.0 if pace[0] < 0 < pace[1] else low, high)), third)
    return _plus(steady, _times((2 * rate, 2 * rate), _times(pace, second)))


class _Rhumb:
    """A haven on a leg of constant bearing; seconds count from the start of the leg."""

    def __init__(self, earth: _Mercator, ends: Sequence[Point], seconds: float, bearing: float, havens: Any) -> None:
        (lon, lat), (lon_to, lat_to) = ends
        self.earth, self.seconds, self.m0, m1 = earth, seconds, earth.m(radians(lat)), earth.m(radians(lat_to))
        self.pace, self.whole = (m1 - self.m0) / seconds, earth.stretch(self.m0, m1)
        self.x0, self.dx = earth.a * radians(lon), earth.a * radians(lon_to - lon)
        self.e, self.n, self.haven = sin(bearing), cos(bearing), havens[0]
        self.rates = [((c - a) / seconds, (d - b) / seconds) for (a, b), (c, d) in zip(*havens, strict=True)]
        self.at = lru_cache(8)(self.at)  # type: ignore[method-assign]

    def steps(self, s: float) -> tuple[float, list[Any]]:
        """Return m of the reference point; of each vertex its steps ahead and to the right, and m after each."""
        m, found = self.m0 + self.pace * s, []
        for (right, ahead), (right_rate, ahead_rate) in zip(self.haven, self.rates, strict=True):
            f, r = ahead + ahead_rate * s, right + right_rate * s
            found.append((f, r, m + f * self.n, m + f * self.n - r * self.e))
        return m, found

    def at(self, s: float) -> list[Point]:
        earth, (m, steps), points = self.earth, self.steps(s), []
        x = self.x0 + self.dx * (s / self.seconds) * earth.stretch(self.m0, m) / self.whole
        first = {f: f * earth.stretch(m, m1) * self.e for f, _, m1, _ in steps}
        for f, r, m1, m2 in steps:
            east = first[f] + r * earth.stretch(m1, m2) * self.n
            points.append((x + earth.a * east, earth.a * earth.psi(earth.lat(m2))))
        return points

    def bend(self, along: Point, t: float, u: float) -> Range:
        """Return bounds of the second derivative of all vertices along a vector from t to u."""
        earth, (mt, start), (mu, end) = self.earth, self.steps(t), self.steps(u)
        places = [mt, mu, *(m for steps in (start, end) for one in steps for m in one[2:])]
        south, north = earth.slopes(min(places)), earth.slopes(max(places))
        second, (low, high) = (south[0], north[0]), _range(south[1], north[1])
        third = earth.at_equator if min(places) < 0 < max(places) else low, high
        pace = self.dx / (self.seconds * self.whole) * self.pace
        reference, bounds = _range(pace * earth.slopes(mt)[0], pace * earth.slopes(mu)[0]), []
        for one, other, (right_rate, ahead_rate) in zip(start, end, self.rates, strict=True):
            middle = self.pace + ahead_rate * self.n
            last, e, n = middle - right_rate * self.e, self.e, self.n
            x = _step_bend(ahead_rate * e, _range(e * one[0], e * other[0]), _range(self.pace, middle), second, third)
            y = _step_bend(right_rate * n, _range(n * one[1], n * other[1]), _range(middle, last), second, third)
            x = _times((along[0],) * 2, _plus(reference, _times((earth.a,) * 2, _plus(x, y))))
            bounds.append(_plus(x, _times((along[1] * earth.a * last * last,) * 2, second)))
        return min(low for low, _ in bounds), max(high for _, high in bounds)


class _Circle:
    """A haven on a leg of a great circle; seconds count from the start of the leg."""

    def __init__(self, plane: _Gnomonic, ends: Sequence[Point], seconds: float, bearing: float, havens: Any) -> None:
        a, (east, north), end = _unit_vector(*ends[0]), _compass(*ends[0]), _unit_vector(*ends[1])
        chord = hypot(*(x - y for x, y in zip(a, end, strict=True)))
        self.plane, self.pace, self.start = plane, 2 * asin(min(chord / 2, 1.0)) / seconds, a
        b = self.heading = tuple(sin(bearing) * x + cos(bearing) * y for x, y in zip(east, north, strict=True))
        self.starboard = b[1] * a[2] - b[2] * a[1], b[2] * a[0] - b[0] * a[2], b[0] * a[1] - b[1] * a[0]
        first, last = ([(x / MEAN_RADIUS_M, y / MEAN_RADIUS_M) for x, y in haven] for haven in havens)
        self.haven, pairs = first, zip(first, last, strict=True)
        self.rates = [((c - a) / seconds, (d - b) / seconds) for (a, b), (c, d) in pairs]
        self.at = lru_cache(8)(self.at)  # type: ignore[method-assign]

    def steps(self, s: float) -> list[Point]:
        return [(x + dx * s, y + dy * s) for (x, y), (dx, dy) in zip(self.haven, self.rates, strict=True)]

    def vectors(self, s: float) -> Iterator[Vector]:
        for right, ahead in self.steps(s):
            c, d, r = cos(right) * cos(self.pace * s + ahead), cos(right) * sin(self.pace * s + ahead), sin(right)
            columns = zip(self.start, self.heading, self.starboard, strict=True)
            yield tuple(c * a + d * b + r * z for a, b, z in columns)

    def at(self, s: float) -> list[Point]:
        return [self.plane.flat(v) for v in self.vectors(s)]

    def bend(self, along: Point, t: float, u: float) -> Range:
        most, ups = 0.0, [[_dot(self.plane.up, v) for v in self.vectors(s)] for s in (t, u)]
        for i, (one, other) in enumerate(zip(self.steps(t), self.steps(u), strict=True)):
            s = sin(max(abs(one[0]), abs(other[0])))
            c = cos(0.0 if one[0] * other[0] <= 0 else min(abs(one[0]), abs(other[0])))
            rate, across, up = abs(self.pace + self.rates[i][1]), abs(self.rates[i][0]), min(ups[0][i], ups[1][i])
            if self.rates[i] != (0.0, 0.0):
                up = max(up - (2 * rate * across * s + across**2) * (u - t) ** 2 / 8, LEAST_UP)
            bound = rate**2 * s * c + 2 * rate * across * s
            bound += 2 * (rate**2 * c**2 + across**2) * sqrt(max(1 / up**2 - 1, 0.0))
            most = max(most, MEAN_RADIUS_M / up**2 * bound * hypot(*along))
        return -most, most


class _Piece:
    """Points that stand still, or a haven on a leg, during a span of microseconds; floors and ceilings at its ends."""

    def __init__(self, of: int, body: Any, span: Any, is_closed: bool, leg: Any, heights: Any) -> None:
        self.of, self.body, (self.start, self.end), self.is_closed = of, body, span, is_closed
        self.is_still, self.leg, self.heights = isinstance(body, list), leg, heights
        self.number, self.level, self.box, self.late = 0, 0, (0.0, 0.0, 0.0, 0.0), -1

    def later(self, by: int) -> "_Piece":
        span, leg = ((one[0] + by, one[1] + by) for one in ((self.start, self.end), self.leg))
        return _Piece(self.of, self.body, span, self.is_closed, leg, self.heights)

    def at(self, zero: int, s: float) -> list[Point]:
        """Return the vertices at a time of a pair whose seconds count from `zero`."""
        return self.body if self.is_still else self.body.at((zero - self.leg[0]) / 1e6 + s)

    def bend(self, along: Point, zero: int, t: float, u: float) -> Range:
        into = 0.0 if self.is_still else (zero - self.leg[0]) / 1e6
        return (0.0, 0.0) if self.is_still else self.body.bend(along, into + t, into + u)

    def band(self, at: float) -> Sequence[float]:
        """Return floor and ceiling at an instant."""
        if all(a == b for a, b in self.heights):
            return [a for a, _ in self.heights]
        share = (at - self.leg[0]) / (self.leg[1] - self.leg[0])
        return [a if a == b else a + (b - a) * share for a, b in self.heights]


# ---- Reading --------------------------------------------------------------------------------------------------------


def read(lines: Iterable[str]) -> dict[str, list[Any]]:
    """Return the lines of each part; check the digests."""
    found: dict[str, list[Any]] = {}
    given, digests, end = iter(lines), list[Any](), None
    first = json.loads(next(given, "0"))
    if not isinstance(first, dict) or first.get("conflictdb_proof") != VERSION:
        raise Refused(f"this is not a proof of version {VERSION}")
    for line in given:
        if line.startswith('{"part"'):
            part = json.loads(line)["part"]
            found[part] = lines_of = []
            digests.append(hashlib.sha256())
        elif line.startswith('{"sha256"'):
            end = json.loads(line)["sha256"]
        else:
            digests[-1].update(line.encode())
            lines_of.append(line if part == "proofs" else json.loads(line))
    if end is None or list(found) != PARTS or not line.startswith('{"sha256"'):
        raise Refused("the proof ends too early, or has other parts")
    if end != {name: one.hexdigest() for name, one in zip(PARTS, digests, strict=True)}:
        raise Refused("the digest of a part is another")
    return found


class _Scene:
    """The objects of a proof as pieces, and how far apart two of them must be."""

    def __init__(self, given: dict[str, list[Any]]) -> None:
        [settings] = given["settings"]
        is_circle, is_sphere = settings["motion"] == "great_circle", settings["earth"] == "sphere"
        self.plane: Any = _Gnomonic(settings["centre"]) if is_circle else _Mercator(is_sphere)
        self.is_closed, self.rules = settings["intervals"] == "closed", settings.get("rules", [])
        names = "separation_m", "vertical_separation_m", "time_separation_s"
        self.tolerance_m, self.plain = settings["tolerance_m"], tuple(settings[name] for name in names)
        every = [self.plain, *(self.by_rule(rule) for rule in self.rules if not rule.get("allowed"))]
        self.farthest_m, self.longest_s = max(one[0] for one in every), max(one[2] for one in every)
        self.separation_of = lru_cache(None)(self.by_rules)
        self.features, self.pieces, self.keys = given["objects"], list[_Piece](), dict[str, int]()
        self.unproven, self.unchecked, self.about = set[int](), Counter[str](), list[Any]()
        more = {one["object"]: one for one in given["pieces"]}
        for k, feature in enumerate(self.features):
            members, extra = feature["properties"], more.get(k, {})
            if members.get("schedule") is None and not {"spans", "departures"}.isdisjoint(extra):
                raise Refused(f"{feature['id']!r} has other times than its object, without a schedule")
            if self.keys.setdefault(feature["id"], k) != k:
                raise Refused(f"two objects have the key {feature['id']!r}")
            kind = "track" if feature["geometry"]["type"] == "LineString" else "area"
            self.about.append((kind, members.get("class"), members.get("owner")))
            has_tolerances = kind == "track" and not TOLERANCES.isdisjoint(members)
            if has_tolerances or extra.get("unproven"):
                self.unchecked[f"objects, {'with tolerances' if has_tolerances else 'which were not cut'}"] += 1
                self.unproven.add(k)
            else:
                (self.add_track if kind == "track" else self.add_area)(k, feature, members, extra)
            if "schedule" in members:
                self.unchecked["schedules, but for the spans that they became"] += 1
        self.delays = [one for one in given["verdicts"] if "delay" in one]
        for late, one in enumerate(self.delays):
            self.add_delayed(late, one, more.get(len(self.features) + late, {}))
        for number, piece in enumerate(self.pieces):
            piece.number = number

    def add_delayed(self, late: int, one: Any, extra: Any) -> None:
        """Add the pieces of an object that departs later, or earlier."""
        k, first = self.keys[one["delay"]], len(self.pieces)
        feature, by_us, error_us = self.features[k], one["least_us"], one["error_us"]
        if not (isinstance(by_us, int) and by_us and isinstance(error_us, int) and error_us > 0):
            raise Refused(f"the least delay of {one['delay']!r} is none")
        members, places = feature["properties"], feature["geometry"]["coordinates"]
        if self.about[k][0] == "area" or k in self.unproven or "schedule" in members or places[0] == places[1]:
            self.unchecked["least delays of areas, of schedules, of objects that wait or are not checked"] += 1
            return
        self.add_track(k, feature, members, {name: extra[name] for name in extra if name == "cuts"}, by_us)
        for piece in self.pieces[first:]:
            piece.late = late

    def by_rule(self, rule: Any) -> Vector:
        names = "separation_m", "vertical_m", "time_s"
        return tuple(x if rule.get(name) is None else rule[name] for x, name in zip(self.plain, names, strict=True))

    def separation(self, i: int, j: int) -> Vector | None:
        """Return required separations: on the earth, vertical, in time; None: the two are not compared."""
        (*one, owner), (*other, other_owner) = self.about[i], self.about[j]
        return None if owner is not None and owner == other_owner else self.separation_of(*one, *other)

    def by_rules(self, kind: str, own: str | None, other_kind: str, other: str | None) -> Vector | None:
        one, two = (None, kind, own), (None, other_kind, other)
        able = []
        for rule in self.rules:
            a, b = rule.get("a_class"), rule.get("b_class")
            if (a in one and b in two) or (b in one and a in two):
                able.append((sum({None: 0, "area": 1, "track": 1}.get(side, 3) for side in (a, b)), rule))
        best = [rule for rank, rule in able if rank == max(rank for rank, _ in able)]
        # Two rules of two areas both apply: the larger separations count. No others may be tied.
        values = [self.by_rule(rule) for rule in best if not rule.get("allowed")]
        return self.plain if not best else tuple(map(max, zip(*values, strict=True))) if values else None

    def add_area(self, k: int, feature: Any, members: Any, extra: Any) -> None:
        shape = feature["geometry"]
        polygons = shape["coordinates"] if shape["type"] == "MultiPolygon" else [shape["coordinates"]]
        if any(ring[0] != ring[-1] for polygon in polygons for ring in polygon):
            raise Refused(f"a ring of area {feature['id']!r} is not closed")
        places = [tuple(place[:2]) for polygon in polygons for ring in polygon for place in ring[:-1]]
        points = [self.plane.place(*place) for place in places]
        parts = extra.get("parts")
        if parts is not None:
            _check_parts(feature["id"], [[len(ring) - 1 for ring in one] for one in polygons], places, points, parts)
        spans = extra.get("spans", members.get("spans", [[members.get("start"), members.get("end")]]))
        band = [(x, x) for x in (_or(members.get("floor_m"), -inf), _or(members.get("ceiling_m"), inf))]
        for start, end in spans:
            span = _instant(start, -inf), _instant(end, inf)
            for part in parts or [range(len(points))]:
                self.pieces.append(_Piece(k, [points[j] for j in part], span, self.is_closed, span, band))

    def add_track(self, k: int, feature: Any, members: Any, extra: Any, by_us: int = 0) -> None:
        places = [tuple(place[:2]) for place in feature["geometry"]["coordinates"]]
        at = [_instant(text, 0) for text in members["times"]]
        if len(at) != len(places) or len(at) < 2 or any(a >= b for a, b in pairwise(at)):
            raise Refused(f"the times of {feature['id']!r} do not increase, one for each place")
        gone = places[0][0]
        for i, ((before, _), (here, lat)) in enumerate(pairwise(list(places)), 1):
            step = here - before
            gone += step if abs(step) <= 180 else step - 360 * round(step / 360)
            places[i] = here + 360 * round((gone - here) / 360), lat
        havens, courses = _havens(members, [(t - at[0]) / 1e6 for t in at]), list(pairwise(places))
        names = ("floor_m", -inf), ("ceiling_m", inf)
        bands = list(zip(*(_heights(members.get(name), len(at), unbounded) for name, unbounded in names), strict=True))
        bodies, lasts = [], at[-1] - at[0]
        for i, bearing in enumerate(_headings(self.plane, courses)):
            make: Any = _Rhumb if self.plane.turn else _Circle
            bodies.append(make(self.plane, courses[i], (at[i + 1] - at[i]) / 1e6, bearing, havens[i : i + 2]))
        cuts = sorted({*(t - at[0] for t in at), *(cut for cut in extra.get("cuts", ()) if 0 < cut < lasts)})
        for departure in extra.get("departures", members.get("departures", at[:1])):
            zero = _instant(departure, 0) + by_us
            for start, end in pairwise(cuts):
                i = bisect_right(at, at[0] + start) - 1
                leg, span = (zero + at[i] - at[0], zero + at[i + 1] - at[0]), (zero + start, zero + end)
                self.pieces.append(_Piece(k, bodies[i], span, self.is_closed or end < lasts, leg, bands[i]))

    def box(self, piece: _Piece) -> Any:
        """Return a box that holds a piece during its time, and half of the largest separation around it."""
        last, plane = 0.0 if piece.is_still else (piece.end - piece.start) / 1e6, self.plane
        points = [*piece.at(piece.start, 0.0), *piece.at(piece.start, last)]
        more = ROUNDING_M * plane.scale(points)
        if self.farthest_m:
            more += max(plane.half(self.farthest_m, point, _unit(point)) for point in points)
        west, south, east, north = (least(one) for least in (min, max) for one in zip(*points, strict=True))
        x, y = (piece.bend(along, piece.start, 0.0, last) for along in ((1.0, 0.0), (0.0, 1.0)))
        square = last**2 / 8
        lower = west - max(x[1], 0.0) * square - more, south - max(y[1], 0.0) * square - more
        return *lower, east + max(-x[0], 0.0) * square + more, north + max(-y[0], 0.0) * square + more


def _unit(point: Point) -> Point:
    length = hypot(*point)
    return (point[0] / length, point[1] / length) if length else (1.0, 0.0)


def _or(given: Any, unbounded: float) -> Any:
    return unbounded if given is None else given


def _instant(at: Any, unbounded: Any) -> Any:
    """Return microseconds since 1970."""
    if isinstance(at, str):
        return (datetime.fromisoformat(at) - EPOCH) // timedelta(microseconds=1)
    return unbounded if at is None or abs(at) >= 2**62 else at


def _heights(given: Any, count: int, unbounded: float) -> list[Range]:
    """Return the heights at both ends of each leg."""
    if not isinstance(given, list):
        given = [given] * (count - 1)
    each = [_or(one, unbounded) for one in given]
    if len(each) == count:
        return [(a, b) if isfinite(a + b) else (unbounded, unbounded) for a, b in pairwise(each)]
    if len(each) != count - 1:
        raise Refused("the heights of a track are neither one for each leg nor one for each place")
    return [(one, one) for one in each]


def _havens(members: Any, ages: Sequence[float]) -> list[list[Point]]:
    """Return the haven at each waypoint, [starboard, forward] metres; ages: seconds since the first."""
    rings = [[(x, y) for x, y in ring] for ring in members.get("outlines_m") or [members.get("outline_m", ())]]
    if not rings[0]:
        fore, aft, port, starboard = (members[f"{side}_m"] for side in ("fore", "aft", "port", "starboard"))
        rings = [list(dict.fromkeys([(starboard, fore), (starboard, -aft), (-port, -aft), (-port, fore)]))]
    elif len(rings[0]) > 1 and all(ring[0] == ring[-1] for ring in rings):
        rings = [ring[:-1] for ring in rings]
    if members.get("outlines_m"):
        if len(rings) != len(ages) or len({len(ring) for ring in rings}) != 1:
            raise Refused("outlines_m has not one ring for each place, of as many corners")
        return rings
    grow = members.get("grow_mps", 0.0)
    corners, rates = _mitred(rings[0]) if grow else (rings[0], [(0.0, 0.0)] * len(rings[0]))
    moving = list(zip(corners, rates, strict=True))
    return [[(x + dx * grow * age, y + dy * grow * age) for (x, y), (dx, dy) in moving] for age in ages]


def _mitred(ring: list[Point]) -> tuple[list[Point], list[Point]]:
    """Return the corners of a convex ring, and how they move if every side moves outward at 1 m/s."""
    ring = [one for i, one in enumerate(ring) if one != ring[i - 1]] or ring[:1]
    if len(ring) <= 2:
        (x0, y0), (x1, y1) = ring[0], ring[-1]
        x, y = _unit((x1 - x0, y1 - y0)) if ring[0] != ring[-1] else (0.0, 1.0)
        rates = [(a * x + r * y, a * y - r * x) for a, r in ((-1, 1), (1, 1), (1, -1), (-1, -1))]
        return [ring[0], ring[-1], ring[-1], ring[0]], rates
    way, rates = -1.0 if _area(ring) < 0 else 1.0, []
    for i, (x, y) in enumerate(ring):
        (x0, y0), (x1, y1) = ring[i - 1], ring[(i + 1) % len(ring)]
        a, b = _unit((x - x0, y - y0)), _unit((x1 - x, y1 - y))
        scale = way / (1 + a[0] * b[0] + a[1] * b[1])
        rates.append(((a[1] + b[1]) * scale, -(a[0] + b[0]) * scale))
    return ring, rates


def _headings(plane: Any, legs: Sequence[Any]) -> Iterator[float]:
    """Yield the bearing of each leg; one that stands still has that of the leg before, else of the next, else 0."""
    courses = [_courses(plane, leg) for leg in legs]
    first = next((k for k, one in enumerate(courses) if one), None)
    for k, one in enumerate(courses):
        before = next((i for i in range(k - 1, -1, -1) if courses[i]), first)
        if one or before is None:
            yield one[0] if one else 0.0
        else:
            known, place = (courses[before] or (0.0, 0.0))[before < k], legs[before][before < k]
            (lon, lat), _ = legs[k]
            # Only at a pole a place has several meridians, and headings.
            yield known + (radians(lon - place[0]) * (1 if lat > 0 else -1) if lat else 0.0)


def _area(ring: Sequence[Point]) -> float:
    (x0, y0), after = ring[0], [*ring[1:], ring[0]]
    return 0.5 * sum((a - x0) * (d - y0) - (c - x0) * (b - y0) for (a, b), (c, d) in zip(ring, after, strict=True))


def _check_parts(key: str, rings: Any, places: Any, points: list[Point], parts: list[list[int]]) -> None:
    """Refuse parts that do not cover an area: their sides must cancel out, but for those of the area."""
    left, at = Counter[Any](), 0

    def add(corners: Sequence[int], by: int) -> None:
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
            one, other = places[a], places[b]
            left[min(one, other), max(one, other)] += by if one < other else -by if one > other else 0

    for i, count in ((i, count) for polygon in rings for i, count in enumerate(polygon)):
        is_left = _area(points[at : at + count]) > 0
        add(range(at, at + count), 1 if is_left == (i == 0) else -1)
        at += count
    for part in parts:
        if not (len(part) > 2 and 0 <= min(part) <= max(part) < len(places) and _area([points[j] for j in part]) > 0):
            raise Refused(f"a part of area {key!r} is no ring of its corners, counter-clockwise")
        add(part, -1)
    if any(left.values()):
        raise Refused(f"the parts of area {key!r} do not cover it")


# ---- Which pairs need a proof ---------------------------------------------------------------------------------------


def _meeting(scene: _Scene) -> Iterator[tuple[_Piece, _Piece, int]]:
    """Yield pairs of pieces of different objects whose boxes meet in place and time, and by how many turns."""
    turn, within = scene.plane.turn, round(1e6 * scene.longest_s)
    grids: Any = defaultdict(lambda: defaultdict(list))
    for p in scene.pieces:
        size = max(p.box[2] - p.box[0], p.box[3] - p.box[1], 1.0)
        p.level = max(0, min(20, floor(log2((turn or 8e7) / size))))
        for cell in _cells(p, p.level, turn):
            grids[p.level][cell].append(p)
    known = {}
    for level, grid in grids.items():
        for cell, inside in grid.items():
            inside.sort(key=lambda one: one.start)
            known[level, cell] = [one.start for one in inside], max(one.end - one.start for one in inside)
    for p in scene.pieces:
        seen = set()
        for key in [(level, cell) for level in grids if level <= p.level for cell in _cells(p, level, turn)]:
            starts, longest = known.get(key, ([], 0))
            low = 0 if longest == inf or p.start == -inf else bisect_left(starts, p.start - longest - within)
            for q in grids[key[0]][key[1]][low : bisect_right(starts, p.end + within)] if starts else ():
                is_first = q.level < p.level or q.number > p.number
                if is_first and q.of != p.of and q.number not in seen and q.end + within >= p.start:
                    seen.add(q.number)
                    one, other = (p, q) if p.number < q.number else (q, p)
                    yield from ((one, other, turns) for turns in _turns(one.box, other.box, turn))


def _cells(piece: _Piece, level: int, turn: float) -> list[tuple[int, int]]:
    west, south, east, north = (floor(one * 2**level / (turn or 8e7)) for one in piece.box)
    wide = range(west, min(east, west + 2**level - 1) + 1)
    columns = {column % 2**level for column in wide} if turn else range(west, east + 1)
    return [(column, row) for column in columns for row in range(south, north + 1)]


def _turns(one: Any, other: Any, turn: float) -> Iterable[int]:
    """Return by how many turns of longitude the second box is moved to meet the first."""
    if one[1] > other[3] or other[1] > one[3]:
        return ()
    if not turn:
        return (0,) if one[0] <= other[2] and other[0] <= one[2] else ()
    return range(ceil((one[0] - other[2]) / turn), floor((one[2] - other[0]) / turn) + 1)


def _shared(p: _Piece, q: _Piece) -> tuple[int, int, bool] | None:
    """Return start and end of the time that two pieces share, and whether the end belongs to both."""
    start, end = max(p.start, q.start), min(p.end, q.end)
    is_closed = (p.end > end or p.is_closed) and (q.end > end or q.is_closed)
    return None if start > end or (start == end and not is_closed) else (start, end, is_closed)


def _overlap(p: _Piece, q: _Piece, vertical_m: float, is_closed: bool, ends: Range, lasts: float) -> Range | None:
    """Return when the heights of two pieces overlap, seconds; None: never."""
    low, high = 0.0, lasts
    for one, other in ((p, q), (q, p)):
        first, last = (one.band(at)[0] - other.band(at)[1] - vertical_m for at in ends)
        first, last = (x - SAME_HEIGHT_M if is_closed else x + SAME_HEIGHT_M for x in (first, last))
        if first >= 0 and last >= 0:
            return None
        if first >= 0:
            low = max(low, lasts * first / (first - last))
        elif last >= 0:
            high = min(high, lasts * first / (first - last))
    return (low, high) if low <= high else None


# ---- Checking -------------------------------------------------------------------------------------------------------


def _is_apart(
    plane: Any, p: _Piece, q: _Piece, turns: int, zero: int, step: Range, angle: float, apart_m: float
) -> bool:
    """Return whether a direction proves two pieces apart during a time."""
    along, (t, u), gap, every = (cos(angle), sin(angle)), step, inf, []
    for s in (t, u):
        between = turns * plane.turn * along[0]
        for points, sign in ((p.at(zero, s), 1.0), (q.at(zero, s), -1.0)):
            every += points
            reach = [sign * (along[0] * x + along[1] * y) for x, y in points]
            if apart_m:
                reach = [one + plane.half(apart_m, point, along) for one, point in zip(reach, points, strict=True)]
            between -= max(reach)
        gap = min(gap, between)
    scale, h = plane.scale(every), u - t
    if not gap > ROUNDING_M * scale:
        return False
    bend = max(0.0, q.bend(along, zero, t, u)[1] - p.bend(along, zero, t, u)[0])
    if apart_m:
        away = sum(max(map(abs, one.bend((0.0, 1.0), zero, t, u))) for one in (p, q))
        bend += plane.half_slope(apart_m, scale) * away
    return bool(gap > bend * h * h / 8 + ROUNDING_M * scale)


def _hull(points: Iterable[Point]) -> list[Point]:
    rest, chains = sorted(set(points)), list[Point]()
    for order in (rest, rest[::-1]) if len(rest) > 2 else ():
        chain: list[Point] = []
        for x, y in order:
            while len(chain) > 1 and _area([*chain[-2:], (x, y)]) <= 0:
                chain.pop()
            chain.append((x, y))
        chains += chain[:-1]
    return chains or rest


def _outside(ring: Sequence[Point], point: Point) -> float:
    """Return how far a point lies outside of a convex ring, 0 inside."""
    far, is_in = inf, len(ring) > 2
    for a, b in zip(ring, [*ring[1:], ring[0]], strict=True):
        x, y, u, v = b[0] - a[0], b[1] - a[1], point[0] - a[0], point[1] - a[1]
        is_in, square = is_in and x * v - y * u >= 0, x * x + y * y
        share = min(max((x * u + y * v) / square, 0.0), 1.0) if square else 0.0
        far = min(far, hypot(u - share * x, v - share * y))
    return 0.0 if is_in else far


def _depth(a: Sequence[Point], b: Sequence[Point]) -> float:
    """Return how far two convex rings must be moved against each other so that they do not overlap."""
    least = inf
    for mine, other in ((a, b), (b, a)):
        for (x0, y0), (x1, y1) in zip(mine, [*mine[1:], mine[0]], strict=True):
            x, y = _unit((y1 - y0, x0 - x1))
            if (x0, y0) != (x1, y1):
                least = min(least, max(x * u + y * v for u, v in mine) - min(x * u + y * v for u, v in other))
    return least if least < inf else 0.0


class Checker:
    """The verdicts and the proofs of a scene, checked.

    counts : what is proven; unchecked : what is not checked; unproven : what is without proof
    """

    def __init__(self, given: dict[str, list[Any]]) -> None:
        self.scene = scene = _Scene(given)
        self.counts, self.unproven, self.unchecked = Counter[str](), list[str](), scene.unchecked
        self.reported: dict[Any, tuple[str, list[Range], float]] = {}
        for one in (one for one in given["verdicts"] if "delay" not in one):
            pair, verdict = tuple(sorted((scene.keys[one["a"]], scene.keys[one["b"]]))), one["verdict"]
            periods = [(_instant(a, -inf), _instant(b, inf)) for a, b in one["periods"]]
            is_known = verdict in ("conflict", "grazing", "unresolved") and pair not in self.reported
            if not is_known or not periods or any(a > b for a, b in periods) or not one["time_error_s"] >= 0:
                raise Refused(f"the verdict on {one['a']!r} and {one['b']!r} is none, or given twice")
            self.reported[pair] = verdict, periods, one["time_error_s"]
        self.steps: dict[tuple[int, ...], str] = {}
        self.contacts: dict[Any, list[Any]] = defaultdict(list)
        self.late: dict[int, list[Any]] = defaultdict(list)
        for line in given["proofs"]:
            if line.startswith('["'):
                kind, p, q, turns, *rest = json.loads(line)
                if not isinstance(turns, int):
                    raise Refused(f"{turns} is no whole number of turns")
                one, other = scene.pieces[p], scene.pieces[q]
                if kind == "late":
                    self.late[max(one.late, other.late)].append((one, other, turns, *rest))
                    continue
                if max(one.late, other.late) >= 0:
                    raise Refused("a delayed object shows no conflict")
                self.contacts[tuple(sorted((one.of, other.of)))].append((kind == "deep", one, other, turns, *rest))
            else:
                self.steps[tuple(int(number) for number in line[1:].split(",", 3)[:3])] = line

    def run(self) -> None:
        """Check that every pair is apart except during its reported conflicts, and that these are true."""
        for piece in self.scene.pieces:
            piece.box = self.scene.box(piece)
        for p, q, turns in _meeting(self.scene):
            pair = tuple(sorted((p.of, q.of)))
            if min(p.late, q.late) < 0:
                self.fail(pair, self.lacks_pair(pair, p, q, turns))
        for late, one in enumerate(self.scene.delays):
            if any(piece.late == late for piece in self.scene.pieces):
                why = self.lacks_delay(late, one["least_us"], one["error_us"])
                self.unproven += [f"{one['delay']!r}: {why}"] if why else []
        for pair, (verdict, periods, error_s) in self.reported.items():
            if self.scene.unproven.intersection(pair):
                self.unchecked["verdicts on objects that are not checked"] += 1
            elif verdict != "conflict":
                self.unchecked[f"verdicts: {verdict}"] += 1
            else:
                self.fail(pair, self.lacks_conflict(pair, periods, error_s))

    def fail(self, pair: Any, why: str) -> None:
        """Note what a pair lacks, unless it is nothing."""
        if why:
            one, other = (self.scene.features[k]["id"] for k in pair)
            self.unproven.append(f"{one!r} and {other!r}: {why}")

    def lacks_pair(self, pair: Any, p: _Piece, q: _Piece, turns: int) -> str:
        """Return what two pieces whose boxes meet lack to be apart while nothing is reported; empty: nothing."""
        scene, separation, both = self.scene, self.scene.separation(*pair), _shared(p, q)
        if separation is None or separation[2]:
            name = "of one owner, or allowed by a rule" if separation is None else "with a separation in time"
            (self.unchecked if separation else self.counts)[f"pairs of pieces {name}"] += 1
        if separation is None or separation[2] or both is None:
            return ""
        (apart_m, vertical_m, _), (start, end, is_closed) = separation, both
        is_still = p.is_still and q.is_still
        zero, lasts = (0, 0.0) if is_still else (start, (end - start) / 1e6)
        band = _overlap(p, q, vertical_m, scene.is_closed, (start, end), lasts)
        if band is None:
            self.counts["pairs of pieces at other heights"] += 1
            return ""
        sharp_s, periods = SHARP_APART_S if apart_m else SHARP_S, []
        for a, b in self.reported.get(pair, ("", [], 0.0))[1] if max(p.late, q.late) < 0 else ():
            if not is_still:
                periods.append(((a - zero) / 1e6 - sharp_s, (b - zero) / 1e6 + sharp_s))
            elif a <= start and b >= end:
                periods.append((0.0, 0.0))
        # Contact at an end that does not belong to both is none, and no proof reaches it.
        last, is_open = inf if is_closed or is_still else lasts - sharp_s, False
        needed = _without(band, periods)
        line = self.steps.get((p.number, q.number, turns))
        steps: Any = json.loads(line)[3:] if line else [None]
        t = 0.0
        for k in range(0, len(steps), 2):
            u = steps[k + 1] if k + 1 < len(steps) else lasts
            is_needed = any(max(a, t) < min(b, u) or (a == b and t <= a <= u) for a, b in needed)
            angle = _or(steps[k], inf)
            is_sound = t <= u <= lasts and (not is_needed or isfinite(angle))
            if is_needed and t >= last and t <= u <= lasts and not isfinite(angle):
                is_open = True
            elif not is_sound or (is_needed and not _is_apart(scene.plane, p, q, turns, zero, (t, u), angle, apart_m)):
                at = "" if is_still else f" from {EPOCH + timedelta(microseconds=zero + 1e6 * t)} on"
                return f"pieces {p.number} and {q.number} are not proven apart{at}"
            self.counts["steps"] += is_needed
            t = u
        self.unchecked[f"pairs of pieces, for the last {sharp_s:g} s of a plan"] += is_open
        self.counts["pairs of pieces " + ("proven apart" if needed else "in a period that is reported")] += 1
        return ""

    def lacks_conflict(self, pair: Any, periods: list[Range], error_s: float) -> str:
        """Return what a conflict lacks: contact at the ends of periods, deep enough at an instant; empty: nothing."""
        separation = self.scene.separation(*pair)
        if separation is None or separation[2]:
            self.unchecked["conflicts with a separation in time"] += separation is not None
            return "" if separation else "the two are not compared"
        sharp_us = 1e6 * (error_s + (SHARP_APART_S if separation[0] else SHARP_S))
        seen, is_deep = [], False
        for needs_depth, p, q, turns, s, *points in self.contacts[pair]:
            at = self.contact(separation, needs_depth, p, q, turns, s, points)
            if at is None:
                return f"the contact at {s} s of pieces {p.number} and {q.number} is none"
            if needs_depth:
                is_deep = is_deep or any(a <= at[1] and at[0] <= b for a, b in periods)
            else:
                seen.append(at)
        for a, b in periods:
            if not any(a - 1 <= last and first <= min(a + sharp_us, b + 1) for first, last in seen):
                return "no contact is proven at the begin of a period"
            if not any(max(b - sharp_us, a - 1) <= last and first <= b + 1 for first, last in seen):
                return "no contact is proven at the end of a period"
        self.counts["conflicts proven"] += is_deep
        self.counts["periods proven"] += len(periods) * is_deep
        return "" if is_deep else "nothing proves that they come closer than the tolerance"

    def lacks_delay(self, late: int, by_us: int, error_us: int) -> str:
        """Return what a least delay lacks: contact with a delay that is smaller by the error; empty: nothing."""
        for p, q, turns, s, *points in self.late[late]:
            one, other = (a.later(-error_us if by_us > 0 else error_us) if a.late >= 0 else a for a in (p, q))
            separation = self.scene.separation(p.of, q.of) if p.of != q.of and min(p.late, q.late) < 0 else None
            if separation is None or separation[2]:
                continue
            near = (separation[0] + self.scene.tolerance_m, *separation[1:])
            if self.contact(near, False, one, other, turns, s, points):
                self.counts["least delays proven"] += 1
                return ""
        return f"no contact is proven {error_us} microseconds before a delay of {by_us}"

    def contact(self, apart: Vector, is_deep: bool, p: _Piece, q: _Piece, turns: int, s: float, points: Any) -> Any:
        """Return the first and the last instant of a contact, the same unless both stand still; None: it is none."""
        scene, plane, both, is_still = self.scene, self.scene.plane, _shared(p, q), p.is_still and q.is_still
        if both is None:
            return None
        zero, lasts = (0, 0.0) if is_still else (both[0], (both[1] - both[0]) / 1e6)
        at = both[:2] if is_still else (zero + 1e6 * s,) * 2
        is_level = all(a.band(at[0])[0] - b.band(at[0])[1] - apart[1] <= 1e-6 for a, b in ((p, q), (q, p)))
        if not 0 <= s <= lasts + 1e-6 or not is_level:
            return None
        a, b = p.at(zero, s), [(x + turns * plane.turn, y) for x, y in q.at(zero, s)]
        scale, rings = plane.scale([*a, *b]), (_hull(a), _hull(b))
        for piece, ring, own in zip((p, q), rings, (a, b), strict=True):
            # A part that is not convex holds less than its hull.
            if piece.is_still and len(ring) > 2 and _area(ring) > abs(_area(own)) * (1 + 1e-9) + ROUNDING_M:
                return None
        if is_deep and not points:
            return at if _depth(*rings) > max(scene.tolerance_m - apart[0], 0.0) * scale else None
        near = points[:2], points[-2:]
        for ring, place in zip(rings, near, strict=True):
            x, y = plane.place(*place)
            x += plane.turn * round((ring[0][0] - x) / plane.turn) if plane.turn else 0.0
            if not _outside(ring, (x, y)) <= ROUNDING_M * scale:
                return None
        wanted_m = apart[0] - scene.tolerance_m if is_deep else apart[0] + DISTANCE_M if apart[0] else 0.0
        return at if plane.distance(*near) <= wanted_m else None


def _without(band: Range, periods: list[Range]) -> list[Range]:
    """Return what remains of a time without some periods."""
    rest, (t, end) = [], band
    if t == end:
        return [] if any(a <= t <= b for a, b in periods) else [band]
    for a, b in [*sorted(periods), (inf, inf)]:
        if min(a, end) > t:
            rest.append((t, min(a, end)))
        t = max(t, b)
    return rest


def main(arguments: list[str]) -> int:
    """Check the proof of the command line."""
    out = sys.stdout.write
    try:
        with sys.stdin if arguments[0] == "-" else Path(arguments[0]).open(encoding="utf-8", newline="\n") as lines:
            given = read(lines)
        checker = Checker(given)
        checker.run()
    except Refused as error:
        out(f"refused: {error}\n")
        return 1
    except (ArithmeticError, AttributeError, LookupError, NameError, TypeError, ValueError) as error:
        out(f"refused: the proof is damaged ({type(error).__name__}: {error})\n")
        return 1
    out(f"{len(given['objects']):12,} objects\n{len(checker.scene.pieces):12,} pieces\n")
    out("".join(f"{count:12,} {name}\n" for name, count in sorted(checker.counts.items())))
    checker.unchecked = +checker.unchecked
    out("".join(f"not checked: {count:,} {name}\n" for name, count in sorted(checker.unchecked.items())))
    out("".join(f"without proof: {why}\n" for why in checker.unproven[:20]))
    if checker.unproven:
        out(f"refused: {len(checker.unproven):,} pairs are without proof\n")
    else:
        out("proven, but for what is not checked\n" if checker.unchecked else "proven\n")
    return 1 if checker.unproven else 2 if checker.unchecked else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
