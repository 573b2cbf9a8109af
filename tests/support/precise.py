"""The oracle's motion and the polygons' separation in 50 digits, for the extremes.

One instant at a time, no arrays, no shapely: slow and plain. `refine` sharpens what the float oracle found.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import oracle
from mpmath import mp, mpf
from oracle_motion import outlines

from conflictdb.model.plans import Area, EarthModel, Scene, Track

Point = tuple[mpf, mpf]
Ring = list[Point]


@cache
def meridian_terms(e2: mpf, digits: int) -> list[mpf]:
    """Coefficients c of the meridian distance from the equator: c0 lat + c1 sin(2 lat) + c2 sin(4 lat) + ...

    With the third flattening n it is the integral of (1 - n)^2 (1 + n) |1 + n exp(2 i lat)|^-3. Both factors of this
    power are binomial series. The coefficients decrease as n^k, so this is much faster than `mp.ellipe`.
    """
    with mp.workdps(digits + 10):
        root = mp.sqrt(1 - e2)
        n = (1 - root) / (1 + root)
        many = 2 + int(digits * mp.log(10) / -mp.log(n)) if n else 1
        power = [mp.binomial(mpf(-3) / 2, k) * n**k for k in range(2 * many)]
        sums = [mp.fsum(power[j] * power[j + k] for j in range(many)) for k in range(many)]
        scale = (1 - n) ** 2 * (1 + n)
        return [scale * sums[0], *(scale * total / k for k, total in enumerate(sums) if k)]


@dataclass(frozen=True)
class PreciseGlobe:
    """Figure of the earth, as in `oracle.Globe`."""

    a: mpf
    e2: mpf

    @classmethod
    def of(cls, earth: EarthModel) -> "PreciseGlobe":
        if earth is EarthModel.SPHERE:
            return cls(mpf("6371008.771415"), mpf(0))
        f = 1 / mpf("298.257223563")
        return cls(mpf(6378137), f * (2 - f))

    def isometric(self, lat: mpf) -> mpf:
        e = mp.sqrt(self.e2)
        return mp.asinh(mp.tan(lat)) - e * mp.atanh(e * mp.sin(lat))

    def meridian_m(self, lat: mpf) -> mpf:
        """Sum the series of `meridian_terms` by Clenshaw's recurrence."""
        first, *others = meridian_terms(self.e2, mp.dps)
        twice_cos, here, after = 2 * mp.cos(2 * lat), mpf(0), mpf(0)
        for term in reversed(others):
            here, after = term + twice_cos * here - after, here
        return self.a * (first * lat + here * mp.sin(2 * lat))

    def along_m(self, lat: mpf) -> mpf:
        return self.a * (1 - self.e2) / mp.sqrt(1 - self.e2 * mp.sin(lat) ** 2) ** 3

    def across_m(self, lat: mpf) -> mpf:
        return self.a * mp.cos(lat) / mp.sqrt(1 - self.e2 * mp.sin(lat) ** 2)

    def latitude_of_meridian(self, m: mpf) -> mpf:
        lat = m / self.a
        for _ in range(60):
            step = (self.meridian_m(lat) - m) / self.along_m(lat)
            lat -= step
            if abs(step) < mpf(10) ** (3 - mp.dps):
                break
        return lat

    def turn_per_m(self, lat1: mpf, lat2: mpf) -> mpf:
        if abs(lat2 - lat1) < mpf(10) ** -22:
            return 1 / self.across_m((lat1 + lat2) / 2)
        return (self.isometric(lat2) - self.isometric(lat1)) / (self.meridian_m(lat2) - self.meridian_m(lat1))

    def step(self, lon: mpf, lat: mpf, north_m: mpf, east_m: mpf) -> Point:
        lat2 = lat if north_m == 0 else self.latitude_of_meridian(self.meridian_m(lat) + north_m)
        return lon + east_m * self.turn_per_m(lat, lat2), lat2

    def length_m(self, lon1: float, lat1: float, lon2: float, lat2: float) -> mpf:
        """Metres of the rhumb line between two points in degrees, unwrapped."""
        p1, p2 = mp.radians(mpf(lat1)), mp.radians(mpf(lat2))
        east = mp.radians(mpf(lon2) - mpf(lon1)) / self.turn_per_m(p1, p2)
        return mp.sqrt(east**2 + (self.meridian_m(p2) - self.meridian_m(p1)) ** 2)


@dataclass(frozen=True)
class PreciseLeg:
    """One leg of a track: its ends unwrapped in degrees, the components of its heading, the haven at both ends."""

    start_us: int
    end_us: int
    start: Point
    north_m: mpf
    east_m: mpf
    heading: Point
    outlines_m: tuple[Sequence[Sequence[float]], Sequence[Sequence[float]]]

    def ring(self, globe: PreciseGlobe, seconds: mpf) -> Ring:
        """Plane vertices at so many seconds after the start of the leg."""
        fraction = seconds / (mpf(self.end_us - self.start_us) / 1_000_000)
        lon, lat = globe.step(*self.start, fraction * self.north_m, fraction * self.east_m)
        cos, sin = self.heading
        ring = []
        for (x0, y0), (x1, y1) in zip(*self.outlines_m, strict=True):
            starboard, forward = (mpf(a) + fraction * (mpf(b) - mpf(a)) for a, b in ((x0, x1), (y0, y1)))
            x, y = globe.step(lon, lat, forward * cos, forward * sin)
            x, y = globe.step(x, y, -starboard * sin, starboard * cos)
            ring.append((globe.a * x, globe.a * globe.isometric(y)))
        return ring


def precise_legs(globe: PreciseGlobe, track: Track) -> list[PreciseLeg]:
    lon = mpf(float(track.positions_deg[0, 0]))
    moves, starts = [], []
    for (x1, y1), (x2, y2) in zip(track.positions_deg.tolist(), track.positions_deg[1:].tolist(), strict=False):
        turn = mpf(x2) - mpf(x1)
        if abs(turn) > 180:
            turn -= 360 * mp.nint(turn / 360)
        p1, p2 = mp.radians(mpf(y1)), mp.radians(mpf(y2))
        moves.append((globe.meridian_m(p2) - globe.meridian_m(p1), mp.radians(turn) / globe.turn_per_m(p1, p2)))
        starts.append((mp.radians(lon), p1))
        lon += turn
    units = [(n / mp.hypot(n, e), e / mp.hypot(n, e)) if (n, e) != (0, 0) else None for n, e in moves]
    heading = next((u for u in units if u), (mpf(1), mpf(0)))
    found = []
    havens = [outline.tolist() for outline in outlines(track)]
    for i, (north, east) in enumerate(moves):
        heading = units[i] or heading
        times = int(track.times_us[i]), int(track.times_us[i + 1])
        found.append(PreciseLeg(*times, starts[i], north, east, heading, (havens[i], havens[i + 1])))
    return found


def precise_area(globe: PreciseGlobe, area: Area) -> list[list[Ring]]:
    """Polygons of an area in the plane: outer ring, then holes."""

    def ring(coordinates: Sequence[Sequence[float]]) -> Ring:
        points = [(mp.radians(mpf(x)), mp.radians(mpf(y))) for x, y in coordinates]
        return [(globe.a * x, globe.a * globe.isometric(y)) for x, y in points[:-1]]

    return [[ring(r.coords) for r in (p.exterior, *p.interiors)] for p in area.footprint.geoms]


def inside(point: Point, ring: Ring) -> bool:
    """Whether a point is inside a ring, by crossings of a ray."""
    x, y = point
    found = False
    for (x1, y1), (x2, y2) in zip(ring, [*ring[1:], ring[0]], strict=True):
        if (y1 > y) != (y2 > y) and x < x1 + (y - y1) / (y2 - y1) * (x2 - x1):
            found = not found
    return found


def _to_segment(p: Point, a: Point, b: Point) -> mpf:
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    t = min(max(((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / square, mpf(0)), mpf(1)) if square else mpf(0)
    return mp.hypot(p[0] - a[0] - t * dx, p[1] - a[1] - t * dy)


def _cross(p: Point, q: Point, r: Point) -> mpf:
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])


def boundary_distance(one: list[Ring], two: list[Ring]) -> mpf:
    """Least distance between the edges of two polygons, plane metres; 0 if any cross."""
    best = mp.inf
    for r in one:
        for a, b in zip(r, [*r[1:], r[0]], strict=True):
            for s in two:
                for c, d in zip(s, [*s[1:], s[0]], strict=True):
                    if _cross(a, b, c) * _cross(a, b, d) < 0 and _cross(c, d, a) * _cross(c, d, b) < 0:
                        return mpf(0)
                    best = min(
                        best, _to_segment(a, c, d), _to_segment(b, c, d), _to_segment(c, a, b), _to_segment(d, a, b)
                    )
    return best


def distance(one: list[Ring], two: list[Ring]) -> mpf:
    """Distance of two polygons (outer ring, then holes), plane metres; 0 if they share a point."""

    def holds(polygon: list[Ring], p: Point) -> bool:
        return len(polygon[0]) > 2 and inside(p, polygon[0]) and not any(inside(p, hole) for hole in polygon[1:])

    if holds(one, two[0][0]) or holds(two, one[0][0]):
        return mpf(0)
    return boundary_distance(one, two)


def convex_hull(points: Ring) -> Ring:
    """Hull by the monotone chain."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return ordered

    def chain(run: Ring) -> Ring:
        kept: Ring = []
        for p in run:
            while len(kept) > 1 and _cross(kept[-2], kept[-1], p) <= 0:
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return chain(ordered) + chain(ordered[::-1])


def separation(scene: Scene, a: Area | Track, b: Area | Track, seconds: mpf, epoch_us: int) -> mpf:
    """Plane distance of two objects at so many seconds after an instant within their spans; 0 if they touch."""
    globe = PreciseGlobe.of(scene.earth)
    best = mp.inf
    turn = 2 * mp.pi * globe.a
    for one in _shapes(globe, a, seconds, epoch_us):
        for two in _shapes(globe, b, seconds, epoch_us):
            aside = mp.nint((one[0][0][0] - two[0][0][0]) / turn)
            for k in (aside - 1, aside, aside + 1):
                moved = [[(x + k * turn, y) for x, y in ring] for ring in two]
                best = min(best, distance(one, moved))
    return best


def _shapes(globe: PreciseGlobe, thing: Area | Track, seconds: mpf, epoch_us: int) -> list[list[Ring]]:
    if isinstance(thing, Area):
        return precise_area(globe, thing)
    found = []
    for leg in precise_legs(globe, thing):
        at = seconds + mpf(epoch_us - leg.start_us) / 1_000_000
        if 0 <= at <= mpf(leg.end_us - leg.start_us) / 1_000_000:
            found.append([convex_hull(leg.ring(globe, at))])
    return found


def refine(
    scene: Scene, a: Area | Track, b: Area | Track, meeting: oracle.Meeting, within_s: float = 1e-3, digits: int = 50
) -> list[tuple[mpf, mpf]]:
    """The intervals that the float oracle found, their ends sharpened in 50 digits, seconds after `epoch_us`.

    An end at a limit of both spans stays; else it must lie within `within_s` of what was found.
    """
    with mp.workdps(digits):

        def touches(t: mpf) -> bool:
            return separation(scene, a, b, t, meeting.epoch_us) == 0

        def sharpen(found: float, middle: mpf, outward: int) -> mpf:
            outer, inner = mpf(found) + outward * mpf(within_s), mpf(found) - outward * mpf(within_s)
            if (inner - middle) * outward < 0:
                inner = middle
            if separation(scene, a, b, outer, meeting.epoch_us) in (0, mp.inf):
                return mpf(found)
            assert touches(inner), "the float oracle's contact is not one"
            while abs(outer - inner) > mpf(10) ** -10:
                middle = (outer + inner) / 2
                outer, inner = (outer, middle) if touches(middle) else (middle, inner)
            return inner

        middles = [(mpf(start) + mpf(end)) / 2 for start, end in meeting.intervals]
        ends = zip(meeting.intervals, middles, strict=True)
        return [(sharpen(start, middle, -1), sharpen(end, middle, 1)) for (start, end), middle in ends]
