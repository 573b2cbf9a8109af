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
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from itertools import pairwise
from math import asin, asinh, atan2, atanh, cos, cosh, floor, hypot, inf, pi, radians, sin, sinh, sqrt, tan, tanh
from pathlib import Path
from typing import Any

VERSION = 1
MEAN_RADIUS_M, WGS84_RADIUS_M, FLATTENING = 6371008.771415, 6378137.0, 1 / 298.257223563
# Rows j from 1: coefficients of n^j, n^(j + 2), n^(j + 4) of sin 2j lat in m, and of sin 2j mu in the latitude.
TO_M = [(-3 / 2, 9 / 16, -3 / 32), (15 / 16, -15 / 32, 135 / 2048), (-35 / 48, 105 / 256, 0)]
TO_M += [(315 / 512, -189 / 512, 0), (-693 / 1280, 0, 0), (1001 / 2048, 0, 0)]
TO_LAT = [(3 / 2, -27 / 32, 269 / 512), (21 / 16, -55 / 32, 6759 / 4096), (151 / 96, -417 / 128, 0)]
TO_LAT += [(1097 / 512, -15543 / 2560, 0), (8011 / 2560, 0, 0), (293393 / 61440, 0, 0)]
ROUNDING_M = 1e-6  # on the earth
DISTANCE_M = 1e-3  # of distances on the earth that show a contact, where a separation is required
SAME_HEIGHT_M = 5e-10
SHARP_S, SHARP_APART_S = 1e-2, 1.0  # how sharp ends of periods are proven, without and with a separation
FARTHEST = 0.1  # radians: larger separations are not checked
LEAST_UP = 0.49999999998488504  # 60 degrees from the centre of a scene of great circles
TOLERANCES = {"xtd_port_m", "xtd_starboard_m", "min_speed_kn", "max_speed_kn", "turn_radius_m"}
TOLERANCES |= {"departure_window", "arrival_window"}
SEPARATIONS = {"separation_m": "separation_m", "vertical_separation_m": "vertical_m", "time_separation_s": "time_s"}
HEIGHTS = [("floor_m", -inf), ("ceiling_m", inf)]
PARTS = ["settings", "objects", "pieces", "verdicts", "proofs"]
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
# Nodes from -1 to 1, and weights of sum 1.
GAUSS = [(0.0, 64 / 225), *((s * 0.5384693101056831, 0.23931433524968324) for s in (-1, 1))]
GAUSS += [(s * 0.906179845938664, 0.11846344252809454) for s in (-1, 1)]

Point = tuple[float, float]
Range = tuple[float, float]
Vector = tuple[float, ...]


class Refused(Exception):
    """The proof is no proof."""


# ---- Planes, in which legs and edges are straight ----
class _Mercator:
    """x = a lon, y = a psi; m is the distance from the equator along a meridian, metres."""

    def __init__(self, is_sphere: bool) -> None:
        f = self.f = 0.0 if is_sphere else FLATTENING
        self.a, self.e2, n = MEAN_RADIUS_M if is_sphere else WGS84_RADIUS_M, f * (2 - f), f / (2 - f)
        self.e, self.unit = sqrt(self.e2), self.a / (1 + n) * (1 + n**2 / 4 + n**4 / 64 + n**6 / 256)
        powers = [(n**j, n ** (j + 2), n ** (j + 4)) for j in range(1, 7)]
        self.to_m, self.to_lat = ([_dot(*one) for one in zip(row, powers, strict=True)] for row in (TO_M, TO_LAT))
        self.turn, self.at_equator = 2 * pi * self.a, self.slopes(0.0)[1]

    def m(self, lat: float) -> float:
        return self.unit * (lat + sum(c * sin(2 * j * lat) for j, c in enumerate(self.to_m, 1)))

    def lat(self, m: float) -> float:
        mu = m / self.unit
        return mu + sum(c * sin(2 * j * mu) for j, c in enumerate(self.to_lat, 1)) if self.f else mu

    def psi(self, lat: float) -> float:
        return asinh(tan(lat)) - self.e * atanh(self.e * sin(lat))

    def lat_of(self, psi: float) -> float:
        lat = atan2(sinh(psi), 1.0)
        for _ in range(5 if self.f else 0):
            lat = atan2(sinh(psi + self.e * atanh(self.e * sin(lat))), 1.0)
        return lat

    def axis(self, lat: float) -> float:
        """Return the distance from the axis of the earth: the metres of a radian of longitude."""
        return self.a * cos(lat) / sqrt(1 - self.e2 * sin(lat) ** 2)

    def slopes(self, m: float) -> Range:
        """Return the second and the third derivative of psi in m; the first is 1 / axis."""
        lat = self.lat(m)
        p, sine, w = self.axis(lat), sin(lat), 1 - self.e2 * sin(lat) ** 2
        return sine / (p * p), cos(lat) * w**1.5 / (self.a * (1 - self.e2) * p * p) + 2 * sine * sine / (p * p * p)

    def stretch(self, m1: float, m2: float) -> float:
        """Return (psi(m2) - psi(m1)) / (m2 - m1), the mean of 1 / axis, without cancellation."""
        d, to_pole = m2 - m1, self.unit * pi / 2 - max(abs(m1), abs(m2))
        if abs(d) > 6e5:
            return (self.psi(self.lat(m2)) - self.psi(self.lat(m1))) / d
        parts = min(1 + floor(abs(d) / (0.1 * max(to_pole, 1e3))), 1000)
        nodes = [(m1 + d * (k + 0.5 + 0.5 * x) / parts, w) for k in range(parts) for x, w in GAUSS]
        return sum(w / self.axis(self.lat(m)) for m, w in nodes) / parts

    def place(self, lon: float, lat: float) -> Point:
        return self.a * radians(lon), self.a * self.psi(radians(lat))

    def courses(self, lon: float, lat: float, lon_to: float, lat_to: float) -> Range:
        """Return the bearings of a leg at its start and at its end."""
        m, m_to = self.m(lat), self.m(lat_to)
        return (atan2((lon_to - lon) / self.stretch(m, m_to), m_to - m),) * 2

    def scale(self, points: Iterable[Point]) -> float:
        """Return the most plane metres of a metre at some places."""
        return self.a / self.axis(self.lat_of(max(abs(y) for _, y in points) / self.a))

    def half(self, distance_m: float, point: Point, _along: Point) -> float:
        """Return a half of a distance: two places nearer on the earth are within both halves, plane metres."""
        theta = distance_m / self.a
        sine = self.scale([point]) * sin(theta / 2 * (1 + 0.3 * self.f * theta**2))
        if sine > 0.5:
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

    turn = 8e7  # nothing is that far away

    def __init__(self, centre: Sequence[float]) -> None:
        self.up, self.east, self.north = _axes(*centre)

    def flat(self, v: Vector) -> Point:
        up = _dot(self.up, v)
        if not up > LEAST_UP - 1e-9:
            raise Refused("a place is too far from the centre of the scene")
        return MEAN_RADIUS_M * _dot(self.east, v) / up, MEAN_RADIUS_M * _dot(self.north, v) / up

    def place(self, lon: float, lat: float) -> Point:
        return self.flat(_axes(lon, lat)[0])

    def courses(self, lon: float, lat: float, lon_to: float, lat_to: float) -> Range:
        turn, step, bend = lon_to - lon, lat_to - lat, 2 * sin((lon_to - lon) / 2) ** 2
        first = atan2(cos(lat_to) * sin(turn), sin(step) + sin(lat) * cos(lat_to) * bend)
        return first, atan2(cos(lat) * sin(turn), sin(step) - sin(lat_to) * cos(lat) * bend)

    def scale(self, points: Iterable[Point]) -> float:
        return 1 + max(x * x + y * y for x, y in points) / MEAN_RADIUS_M**2

    def half(self, distance_m: float, point: Point, along: Point) -> float:
        own = ((point[0] * along[0] + point[1] * along[1]) / MEAN_RADIUS_M) ** 2
        return MEAN_RADIUS_M * sin(distance_m / MEAN_RADIUS_M / 2) * sqrt(self.scale([point]) * (1 + own))

    def half_slope(self, distance_m: float, _scale: float) -> float:
        return 3.5 * sin(distance_m / MEAN_RADIUS_M / 2)

    def distance(self, one: Point, other: Point) -> float:
        (x, y, z), (u, v, w) = _axes(*one)[0], _axes(*other)[0]
        return 2 * MEAN_RADIUS_M * asin(min(hypot(x - u, y - v, z - w) / 2, 1.0))


def _dot(u: Vector, v: Vector) -> float:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _axes(lon: float, lat: float) -> tuple[Vector, Vector, Vector]:
    """Return unit vectors up, east and north."""
    s, c, z, r = sin(radians(lon)), cos(radians(lon)), sin(radians(lat)), cos(radians(lat))
    return (r * c, r * s, z), (-s, c, 0.0), (-z * c, -z * s, r)


# ---- Pieces: polygons that stand still or move along a leg ----
def _range(*numbers: float) -> Range:
    return min(numbers), max(numbers)


def _times(a: Range, b: Range) -> Range:
    return _range(a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1])


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
        earth, (mt, start), (mu, end), e, n = self.earth, self.steps(t), self.steps(u), self.e, self.n
        places = [mt, mu, *(m for steps in (start, end) for one in steps for m in one[2:])]
        second, (low, high) = zip(earth.slopes(min(places)), earth.slopes(max(places)), strict=True)
        third = _range(low, high, *([earth.at_equator] if min(places) < 0 < max(places) else []))
        east, pace, bounds = earth.a * along[0], along[0] * self.dx / (self.seconds * self.whole) * self.pace, []
        for one, other, (right_rate, ahead_rate) in zip(start, end, self.rates, strict=True):
            middle = self.pace + ahead_rate * n
            last = middle - right_rate * e
            terms = [_range(pace * earth.slopes(mt)[0], pace * earth.slopes(mu)[0])]
            terms.append(_times((along[1] * earth.a * last * last,) * 2, second))
            # The second derivative of a step h is 2 h' psi'' q' + h psi''' q'^2, q where it is.
            for rate, h, h_to, q, q_to in (
                (ahead_rate * e, e * one[0], e * other[0], self.pace, middle),
                (right_rate * n, n * one[1], n * other[1], middle, last),
            ):
                square = _range(q * q, q_to * q_to, *([0.0] if q * q_to < 0 else []))
                terms.append(_times((2 * east * rate * q, 2 * east * rate * q_to), second))
                terms.append(_times(_times((east * h, east * h_to), square), third))
            bounds.append([sum(ends) for ends in zip(*terms, strict=True)])
        return min(low for low, _ in bounds), max(high for _, high in bounds)


class _Circle:
    """A haven on a leg of a great circle; seconds count from the start of the leg."""

    def __init__(self, plane: _Gnomonic, ends: Sequence[Point], seconds: float, bearing: float, havens: Any) -> None:
        (a, east, north), (end, _, _) = (_axes(*place) for place in ends)
        chord = hypot(*(x - y for x, y in zip(a, end, strict=True)))
        self.plane, self.pace, self.start = plane, 2 * asin(min(chord / 2, 1.0)) / seconds, a
        b = self.heading = tuple(sin(bearing) * x + cos(bearing) * y for x, y in zip(east, north, strict=True))
        self.starboard = b[1] * a[2] - b[2] * a[1], b[2] * a[0] - b[0] * a[2], b[0] * a[1] - b[1] * a[0]
        self.haven, last = ([(x / MEAN_RADIUS_M, y / MEAN_RADIUS_M) for x, y in haven] for haven in havens)
        pairs = zip(self.haven, last, strict=True)
        self.rates = [((c - a) / seconds, (d - b) / seconds) for (a, b), (c, d) in pairs]
        self.at = lru_cache(8)(self.at)  # type: ignore[method-assign]

    def steps(self, s: float) -> list[Point]:
        return [(x + dx * s, y + dy * s) for (x, y), (dx, dy) in zip(self.haven, self.rates, strict=True)]

    def vectors(self, s: float) -> Iterator[Vector]:
        for right, ahead in self.steps(s):
            c, d, r = cos(right) * cos(self.pace * s + ahead), cos(right) * sin(self.pace * s + ahead), sin(right)
            yield tuple(c * a + d * b + r * z for a, b, z in zip(self.start, self.heading, self.starboard, strict=True))

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

    def band(self, at: float) -> list[float]:
        """Return floor and ceiling at an instant."""
        into, lasts = at - self.leg[0], self.leg[1] - self.leg[0]
        return [a if a == b else a + (b - a) * into / lasts for a, b in self.heights]


# ---- Reading ----
def read(given: Iterable[str]) -> dict[str, list[Any]]:
    """Return the lines of each part; check the digests."""
    first, *lines, last = given
    about, digests = json.loads(first), json.loads(last)
    if not isinstance(about, dict) or about.get("conflictdb_proof") != VERSION:
        raise Refused(f"this is not a proof of version {VERSION}")
    begins = [k for k, line in enumerate(lines) if line.startswith('{"part"')]
    if [json.loads(lines[k])["part"] for k in begins] != PARTS or begins[0] != 0 or "sha256" not in digests:
        raise Refused("the proof ends too early, or has other parts")
    parts = {}
    for name, (begin, end) in zip(PARTS, pairwise([*begins, len(lines)]), strict=True):
        own = lines[begin + 1 : end]
        if digests["sha256"].get(name) != hashlib.sha256("".join(own).encode()).hexdigest():
            raise Refused("the digest of a part is another")
        parts[name] = own if name == "proofs" else [json.loads(line, parse_constant=int) for line in own]
    return parts


class _Scene:
    """The objects of a proof as pieces, and how far apart two of them must be."""

    def __init__(self, given: dict[str, list[Any]]) -> None:
        [settings] = given["settings"]
        is_circle = {"rhumb": False, "great_circle": True}[settings["motion"]]
        is_sphere = {"wgs84": False, "sphere": True}[settings["earth"]]
        self.plane: Any = _Gnomonic(settings["centre"]) if is_circle else _Mercator(is_sphere)
        self.is_closed = {"half_open": False, "closed": True}[settings["intervals"]]
        self.rules = settings.get("rules", [])
        self.tolerance_m, self.plain = settings["tolerance_m"], tuple(settings[name] for name in SEPARATIONS)
        every = [self.plain, *(self.by_rule(rule) for rule in self.rules if not rule.get("allowed"))]
        self.farthest_m, _, self.longest_s = map(max, zip(*every, strict=True))
        numbers = [self.tolerance_m, *(x for one in every for x in one)]
        if not all(0 <= x < inf for x in numbers) or self.farthest_m > FARTHEST * MEAN_RADIUS_M:
            raise Refused("a separation or the tolerance is negative, too large or no number")
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
            if extra.get("unproven") or (kind == "track" and not TOLERANCES.isdisjoint(members)):
                self.unchecked["objects with tolerances, or which were not cut"] += 1
                self.unproven.add(k)
            else:
                (self.add_track if kind == "track" else self.add_area)(k, feature, members, extra)
            self.unchecked["schedules, but for the spans that they became"] += "schedule" in members
        self.delays = [one for one in given["verdicts"] if "delay" in one]
        for late, one in enumerate(self.delays):
            self.add_delayed(late, one, more.get(len(self.features) + late, {}))
        for number, piece in enumerate(self.pieces):
            piece.number, piece.box = number, self.box(piece)

    def add_delayed(self, late: int, one: Any, extra: Any) -> None:
        """Add the pieces of an object that departs later, or earlier."""
        k, first, by_us, error_us = self.keys[one["delay"]], len(self.pieces), one["least_us"], one["error_us"]
        if not (isinstance(by_us, int) and by_us and isinstance(error_us, int) and error_us > 0):
            raise Refused(f"the least delay of {one['delay']!r} is none")
        members, places = self.features[k]["properties"], self.features[k]["geometry"]["coordinates"]
        if self.about[k][0] == "area" or k in self.unproven or "schedule" in members or places[0] == places[1]:
            self.unchecked["least delays of areas, of schedules, of objects that wait or are not checked"] += 1
            return
        self.add_track(k, self.features[k], members, {"cuts": extra.get("cuts", ())}, by_us)
        for piece in self.pieces[first:]:
            piece.late = late

    def by_rule(self, rule: Any) -> Vector:
        pairs = zip(self.plain, SEPARATIONS.values(), strict=True)
        return tuple(x if rule.get(name) is None else rule[name] for x, name in pairs)

    def separation(self, i: int, j: int) -> Vector | None:
        """Return required separations: on the earth, vertical, in time; None: the two are not compared."""
        (*own, owner), (*others, other_owner) = self.about[i], self.about[j]
        if owner is not None and owner == other_owner:
            return None
        one, two, able = (None, *own), (None, *others), defaultdict[int, list[Any]](list)
        for rule in self.rules:
            a, b = rule.get("a_class"), rule.get("b_class")
            if (a in one and b in two) or (b in one and a in two):
                able[sum({None: 0, "area": 1, "track": 1}.get(side, 3) for side in (a, b))].append(rule)
        # Two rules of two areas both apply: the larger separations count. No others may be tied.
        values = [self.by_rule(rule) for rule in able[max(able)] if not rule.get("allowed")] if able else [self.plain]
        return tuple(map(max, zip(*values, strict=True))) if values else None

    def add_area(self, k: int, feature: Any, members: Any, extra: Any) -> None:
        shape, parts, loops, places = feature["geometry"], extra.get("parts"), list[Any](), list[Any]()
        for polygon in shape["coordinates"] if shape["type"] == "MultiPolygon" else [shape["coordinates"]]:
            for i, ring in enumerate(polygon):
                if ring[0] != ring[-1]:
                    raise Refused(f"a ring of area {feature['id']!r} is not closed")
                loops.append((i == 0, range(len(places), len(places) + len(ring) - 1)))
                places += [tuple(place[:2]) for place in ring[:-1]]
        points = [self.plane.place(*place) for place in places]
        if parts is not None:
            _check_parts(feature["id"], loops, places, points, parts)
        band = [_heights([members.get(name)], 2, unbounded)[0] for name, unbounded in HEIGHTS]
        for ends in extra.get("spans", members.get("spans", [[members.get("start"), members.get("end")]])):
            span = _instant(ends[0], -inf), _instant(ends[1], inf)
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
        floors, ceilings = (_heights(members.get(name), len(at), unbounded) for name, unbounded in HEIGHTS)
        bodies, lasts, make = [], at[-1] - at[0], _Rhumb if isinstance(self.plane, _Mercator) else _Circle
        for i, bearing in enumerate(_headings(self.plane, courses)):
            bodies.append(make(self.plane, courses[i], (at[i + 1] - at[i]) / 1e6, bearing, havens[i : i + 2]))
        cuts = sorted({*(t - at[0] for t in at), *(cut for cut in extra.get("cuts", ()) if 0 < cut < lasts)})
        for departure in extra.get("departures", members.get("departures", at[:1])):
            zero = _instant(departure, 0) + by_us
            for start, end in pairwise(cuts):
                i = bisect_right(at, at[0] + start) - 1
                leg, span = (zero + at[i] - at[0], zero + at[i + 1] - at[0]), (zero + start, zero + end)
                self.pieces.append(
                    _Piece(k, bodies[i], span, self.is_closed or end < lasts, leg, [floors[i], ceilings[i]])
                )

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


def _instant(at: Any, unbounded: Any) -> Any:
    """Return microseconds since 1970."""
    if isinstance(at, str):
        return (datetime.fromisoformat(at) - EPOCH) // timedelta(microseconds=1)
    return unbounded if at is None or abs(at) >= 2**62 else at


def _heights(given: Any, count: int, unbounded: float) -> list[Range]:
    """Return the heights at both ends of each leg."""
    given = given if isinstance(given, list) else [given] * (count - 1)
    each = [unbounded if one is None else one for one in given]
    if len(each) not in (count, count - 1):
        raise Refused("the heights of a track are neither one for each leg nor one for each place")
    legs = list(pairwise(each)) if len(each) == count else [(one, one) for one in each]
    return [(a, b) if abs(a + b) < inf else (unbounded, unbounded) for a, b in legs]


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
    moving = _mitred(rings[0]) if grow else [(corner, (0.0, 0.0)) for corner in rings[0]]
    return [[(x + dx * grow * age, y + dy * grow * age) for (x, y), (dx, dy) in moving] for age in ages]


def _mitred(ring: list[Point]) -> list[tuple[Point, Point]]:
    """Return the corners of a convex ring, each with how it moves if every side moves outward at 1 m/s."""
    ring = [one for i, one in enumerate(ring) if one != ring[i - 1]] or ring[:1]
    if len(ring) > 2:
        sides, way = [_unit((c - a, d - b)) for (a, b), (c, d) in _sides(ring)], -1.0 if _area(ring) < 0 else 1.0
    else:
        x, y = _unit((ring[-1][0] - ring[0][0], ring[-1][1] - ring[0][1])) if len(ring) > 1 else (0.0, 1.0)
        ring, way = [ring[0], ring[-1], ring[-1], ring[0]], 1.0
        sides = [(x, y), (-y, x), (-x, -y), (y, -x)]
    moving = []
    for corner, (a, b), (c, d) in zip(ring, [sides[-1], *sides[:-1]], sides, strict=True):
        scale = way / (1 + a * c + b * d)
        moving.append((corner, ((b + d) * scale, -(a + c) * scale)))
    return moving


def _headings(plane: Any, legs: Sequence[Any]) -> Iterator[float]:
    """Yield the bearing of each leg; one that stands still has that of the leg before, else of the next, else 0."""
    ends = [[(radians(lon), radians(lat)) for lon, lat in leg] for leg in legs]
    last, at = next(((plane.courses(*a, *b)[0], a) for a, b in ends if a != b), (0.0, ends[0][0]))
    for a, b in ends:
        if a == b:  # Only at a pole a place has several meridians, and headings.
            yield last + ((a[0] - at[0]) * (1 if a[1] > 0 else -1) if a[1] else 0.0)
        else:
            first, last = plane.courses(*a, *b)
            at = b
            yield first


def _sides(ring: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    return zip(ring, [*ring[1:], ring[0]], strict=True)


def _area(ring: Sequence[Point]) -> float:
    x0, y0 = ring[0]
    return 0.5 * sum((a - x0) * (d - y0) - (c - x0) * (b - y0) for (a, b), (c, d) in _sides(ring))


def _length(ring: Sequence[Point]) -> float:
    return sum(hypot(c - a, d - b) for (a, b), (c, d) in _sides(ring))


def _check_parts(key: str, loops: Any, places: Any, points: list[Point], parts: list[list[int]]) -> None:
    """Refuse parts that do not cover an area: their sides must cancel out, but for those of the area."""
    left = Counter[Any]()
    for part in parts:
        if not (len(part) > 2 and 0 <= min(part) <= max(part) < len(places) and _area([points[j] for j in part]) > 0):
            raise Refused(f"a part of area {key!r} is no ring of its corners, counter-clockwise")
    for is_shell, loop in [*((None, part) for part in parts), *loops]:
        is_left = _area([points[j] for j in loop]) > 0
        for one, other in _sides([places[j] for j in loop]):
            by = (one < other) - (one > other)
            left[min(one, other), max(one, other)] += by if is_left == is_shell else -by
    if any(left.values()):
        raise Refused(f"the parts of area {key!r} do not cover it")


# ---- Which pairs need a proof ----
def _meeting(scene: _Scene) -> Iterator[tuple[_Piece, _Piece, int]]:
    """Yield pairs of pieces of different objects whose boxes meet in place and time, and by how many turns."""
    turn, within = scene.plane.turn, round(1e6 * scene.longest_s)
    for p in scene.pieces:
        size = max(p.box[2] - p.box[0], p.box[3] - p.box[1], 1.0)
        p.level = max(0, min(20, int(turn / size).bit_length() - 1))
    # Pieces that began before, in cells about as large as themselves, and in larger cells.
    own, small, levels = defaultdict[Any, Any](list), defaultdict[Any, Any](list), {p.level for p in scene.pieces}
    for p in sorted(scene.pieces, key=lambda one: one.start):
        met: dict[int, _Piece] = {}
        for level in (level for level in levels if level <= p.level):
            west, south, east, north = (floor(one * 2**level / turn) for one in p.box)
            columns = {column % 2**level for column in range(west, min(east, west + 2**level - 1) + 1)}
            for key in ((level, column, row) for column in columns for row in range(south, north + 1)):
                for cells in (own, small) if level == p.level else (own,):
                    cells[key] = [q for q in cells[key] if q.end + within >= p.start]
                    met.update((q.number, q) for q in cells[key] if q.of != p.of)
                (own if level == p.level else small)[key].append(p)
        for q in met.values():
            one, other = (p, q) if p.number < q.number else (q, p)
            (west, south, east, north), (west_to, south_to, east_to, north_to) = one.box, other.box
            if south <= north_to and south_to <= north:
                # The second box is moved by `turns` turns of longitude.
                for turns in range(-floor((east_to - west) / turn), floor((east - west_to) / turn) + 1):
                    yield one, other, turns


def _together(p: _Piece, q: _Piece, vertical_m: float, is_closed: bool) -> Any:
    """Return the time that two pieces share; None: none, or their heights do not overlap then.

    Its start and end, whether the end belongs to both; from when seconds count, the last; when heights overlap.
    """
    start, end = max(p.start, q.start), min(p.end, q.end)
    has_end = (p.end > end or p.is_closed) and (q.end > end or q.is_closed)
    if start > end or (start == end and not has_end):
        return None
    zero, lasts = (0, 0.0) if p.is_still and q.is_still else (start, (end - start) / 1e6)
    low, high = 0.0, lasts
    for one, other in ((p, q), (q, p)):
        first, last = (one.band(at)[0] - other.band(at)[1] - vertical_m for at in (start, end))
        first, last = (x - SAME_HEIGHT_M if is_closed else x + SAME_HEIGHT_M for x in (first, last))
        if first >= 0:
            low = inf if last >= 0 else max(low, lasts * first / (first - last))
        elif last >= 0:
            high = min(high, lasts * first / (first - last))
    return (start, end, has_end, zero, lasts, (low, high)) if low <= high else None


# ---- Checking ----
def _is_apart(plane: Any, p: _Piece, q: _Piece, turns: int, zero: int, step: Any, angle: float, apart_m: float) -> bool:
    """Return whether a direction proves two pieces apart during a time."""
    along, (t, u), gap, every = (cos(angle), sin(angle)), step, inf, []
    for s in step:
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


def _is_left(t: float, end: float, is_instant: bool, periods: list[Range]) -> bool:
    """Return whether a time is not all in periods, which are in order."""
    for a, b in periods:
        if a <= t <= b:
            t, is_instant = b, is_instant and b < end
    return t < end or (t == end and is_instant)


def _hull(points: Iterable[Point]) -> list[Point]:
    rest, chains = sorted(set(points)), list[Point]()
    for order in (rest, rest[::-1]) if len(rest) > 2 else ():
        chain: list[Point] = []
        for point in order:
            while len(chain) > 1 and _area([*chain[-2:], point]) <= 0:
                chain.pop()
            chain.append(point)
        chains += chain[:-1]
    return chains or rest


def _outside(ring: Sequence[Point], point: Point) -> float:
    """Return how far a point lies outside of a convex ring, 0 inside."""
    far, is_in = inf, len(ring) > 2
    for a, b in _sides(ring):
        x, y, u, v = b[0] - a[0], b[1] - a[1], point[0] - a[0], point[1] - a[1]
        is_in, square = is_in and x * v - y * u >= 0, x * x + y * y
        share = min(max((x * u + y * v) / square, 0.0), 1.0) if square else 0.0
        far = min(far, hypot(u - share * x, v - share * y))
    return 0.0 if is_in else far


def _depth(a: Sequence[Point], b: Sequence[Point]) -> float:
    """Return how far two convex rings must be moved against each other so that they do not overlap."""
    least = inf
    for mine, other in ((a, b), (b, a)):
        for (x0, y0), (x1, y1) in _sides(mine):
            x, y = _unit((y1 - y0, x0 - x1))
            least = min(least, max(x * u + y * v for u, v in mine) - min(x * u + y * v for u, v in other))
    return least


class Checker:
    """The verdicts and the proofs of a scene, checked.

    counts : what is proven; unchecked : what is not checked; unproven : what is without proof
    """

    def __init__(self, given: dict[str, list[Any]]) -> None:
        self.scene = _Scene(given)
        self.counts, self.unproven, self.unchecked = Counter[str](), list[str](), self.scene.unchecked
        self.reported: dict[Any, tuple[str, list[Range], float]] = {}
        self.steps: dict[tuple[int, ...], str] = {}
        self.contacts = defaultdict[Any, list[Any]](list)
        for one in given["verdicts"]:
            self.read_verdict(one)
        for line in given["proofs"]:
            self.read_proof(line)

    def read_verdict(self, one: Any) -> None:
        """Note what is reported of two objects."""
        if "delay" not in one:
            pair, verdict = tuple(sorted((self.scene.keys[one["a"]], self.scene.keys[one["b"]]))), one["verdict"]
            periods = [(_instant(a, -inf), _instant(b, inf)) for a, b in one["periods"]]
            is_known = pair[0] != pair[1] and verdict in ("conflict", "grazing", "unresolved")
            is_ordered = bool(periods) and all(a <= b for a, b in periods)
            if not is_known or pair in self.reported or not is_ordered or not one["time_error_s"] >= 0:
                raise Refused(f"the verdict on {one['a']!r} and {one['b']!r} is none, or given twice")
            self.reported[pair] = verdict, periods, one["time_error_s"]

    def read_proof(self, line: str) -> None:
        """Note the steps, or a contact, of two pieces."""
        if not line.startswith('["'):
            self.steps[tuple(int(number) for number in line[1:].split(",", 3)[:3])] = line
            return
        kind, p, q, turns, *rest = json.loads(line)
        one, other = self.scene.pieces[p], self.scene.pieces[q]
        late, pair = max(one.late, other.late), tuple(sorted((one.of, other.of)))
        if not isinstance(turns, int) or (late >= 0) != (kind == "late"):
            raise Refused(f"{turns} is no whole number of turns, or a delayed object shows a conflict")
        self.contacts[late if kind == "late" else pair].append((kind == "deep", one, other, turns, *rest))

    def run(self) -> None:
        """Check that every pair is apart except during its reported conflicts, and that these are true."""
        scene = self.scene
        for p, q, turns in _meeting(scene):
            if min(p.late, q.late) < 0:
                pair = tuple(sorted((p.of, q.of)))
                self.note(pair, self.lacks_pair(pair, p, q, turns))
        for late in sorted({piece.late for piece in scene.pieces if piece.late >= 0}):
            self.note([scene.keys[scene.delays[late]["delay"]]], self.lacks_delay(late))
        for pair, (verdict, periods, error_s) in self.reported.items():
            if scene.unproven.intersection(pair):
                self.unchecked["verdicts on objects that are not checked"] += 1
            elif verdict != "conflict":
                self.unchecked[f"verdicts: {verdict}"] += 1
            else:
                self.note(pair, self.lacks_conflict(pair, periods, error_s))

    def note(self, objects: Iterable[int], why: str) -> None:
        """Note what objects lack, if anything."""
        if why:
            self.unproven.append(f"{' and '.join(repr(self.scene.features[k]['id']) for k in objects)}: {why}")

    def lacks_pair(self, pair: Any, p: _Piece, q: _Piece, turns: int) -> str:
        """Return what two pieces whose boxes meet lack to be apart while nothing is reported; empty: nothing."""
        scene, separation, is_still = self.scene, self.scene.separation(*pair), p.is_still and q.is_still
        if separation is None or separation[2]:
            name = "of one owner, or allowed by a rule" if separation is None else "with a separation in time"
            (self.unchecked if separation else self.counts)[f"pairs of pieces {name}"] += 1
            return ""
        apart_m, together = separation[0], _together(p, q, separation[1], scene.is_closed)
        if together is None:
            self.counts["pairs of pieces at other times or heights"] += 1
            return ""
        start, end, has_end, zero, lasts, band = together
        sharp_s, periods = SHARP_APART_S if apart_m else SHARP_S, []
        for a, b in self.reported.get(pair, ("", [], 0.0))[1] if max(p.late, q.late) < 0 else ():
            if not is_still:
                periods.append(((a - zero) / 1e6 - sharp_s, (b - zero) / 1e6 + sharp_s))
            elif a <= start and b >= end:
                periods.append((0.0, 0.0))
        # Contact at an end that does not belong to both is none, and no proof reaches it.
        last, is_open = inf if has_end or is_still else lasts - sharp_s, False
        line = self.steps.get((p.number, q.number, turns), "[0,0,0,null]")
        steps, t, is_apart = [*json.loads(line)[3:], lasts], 0.0, False
        for angle, u in zip(steps[::2], steps[1::2], strict=True):
            is_needed = _is_left(max(t, band[0]), min(u, band[1]), band[0] == band[1], sorted(periods))
            is_sound = t <= u <= lasts and (not is_needed or (angle is not None and abs(angle) < inf))
            if is_needed and angle is None and last <= t <= u <= lasts:
                is_open = True
            elif not is_sound or (is_needed and not _is_apart(scene.plane, p, q, turns, zero, (t, u), angle, apart_m)):
                at = "" if is_still else f" from {EPOCH + timedelta(microseconds=zero + 1e6 * t)} on"
                return f"pieces {p.number} and {q.number} are not proven apart{at}"
            self.counts["steps"] += is_needed
            t, is_apart = u, is_apart or is_needed
        self.unchecked[f"pairs of pieces, for the last {sharp_s:g} s of a plan"] += is_open
        self.counts["pairs of pieces " + ("proven apart" if is_apart else "in a period that is reported")] += 1
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

    def lacks_delay(self, late: int) -> str:
        """Return what a least delay lacks: contact with a delay that is smaller by the error; empty: nothing."""
        by_us, error_us = (self.scene.delays[late][name] for name in ("least_us", "error_us"))
        for _, p, q, turns, s, *points in self.contacts[late]:
            one, other = (a.later(-error_us if by_us > 0 else error_us) if a.late >= 0 else a for a in (p, q))
            separation = self.scene.separation(p.of, q.of) if p.of != q.of and min(p.late, q.late) < 0 else None
            if separation is not None and not separation[2]:
                near = (separation[0] + self.scene.tolerance_m, *separation[1:])
                if self.contact(near, False, one, other, turns, s, points):
                    self.counts["least delays proven"] += 1
                    return ""
        return f"no contact is proven {error_us} microseconds before a delay of {by_us}"

    def contact(self, apart: Vector, is_deep: bool, p: _Piece, q: _Piece, turns: int, s: float, points: Any) -> Any:
        """Return the first and the last instant of a contact, the same unless both stand still; None: it is none."""
        scene, plane, together = self.scene, self.scene.plane, _together(p, q, apart[1], self.scene.is_closed)
        if together is None:
            return None
        start, end, _, zero, lasts, band = together
        at = (start, end) if p.is_still and q.is_still else (zero + 1e6 * s,) * 2
        if not (0 <= s <= lasts + 1e-6 and band[0] - 1e-6 <= s <= band[1] + 1e-6):
            return None
        a, b = p.at(zero, s), [(x + turns * plane.turn, y) for x, y in q.at(zero, s)]
        scale, rings = plane.scale([*a, *b]), (_hull(a), _hull(b))
        for piece, ring, own in zip((p, q), rings, (a, b), strict=True):
            # A part that is not convex holds less than its hull.
            is_convex = _area(ring) <= abs(_area(own)) * (1 + 1e-9) + ROUNDING_M
            if piece.is_still and not (is_convex and _length(own) <= _length(ring) * (1 + 1e-9) + ROUNDING_M):
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


def main(arguments: list[str]) -> int:
    """Check the proof of the command line."""
    out = sys.stdout.write
    try:
        with sys.stdin if arguments[0] == "-" else Path(arguments[0]).open(encoding="utf-8", newline="\n") as lines:
            checker = Checker(read(lines))
        checker.run()
    except (Refused, ArithmeticError, AttributeError, LookupError, NameError, TypeError, ValueError) as error:
        why = "" if isinstance(error, Refused) else f"the proof is damaged, {type(error).__name__}: "
        out(f"refused: {why}{error}\n")
        return 1
    checker.unchecked = +checker.unchecked
    out(f"{len(checker.scene.features):12,} objects\n{len(checker.scene.pieces):12,} pieces\n")
    out("".join(f"{count:12,} {name}\n" for name, count in sorted(checker.counts.items())))
    out("".join(f"not checked: {count:,} {name}\n" for name, count in sorted(checker.unchecked.items())))
    out("".join(f"without proof: {why}\n" for why in checker.unproven[:20]))
    if checker.unproven:
        out(f"refused: {len(checker.unproven):,} pairs are without proof\n")
    else:
        out("proven, but for what is not checked\n" if checker.unchecked else "proven\n")
    return 1 if checker.unproven else 2 if checker.unchecked else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
