"""Stage 4, closest approach (CPA): when, where and how close two objects come, metres on the earth.

The distance D(t) is minimised over the span that a pair of pieces shares, by branch and bound. The distance in the
middle of an interval of h seconds is an upper bound of the least one. Three lower bounds hold within the interval:

1. *Gap.* Along the direction between the nearest points the gap is concave in time if all vertices move straight. So it
   is nowhere less than at the ends, less M h^2 / 8 where accelerations are at most M.
2. *Rate.* |D'| is at most the relative velocity along that direction, plus a share of the velocity across it, as the
   direction of a shorter way may differ. This is the Lipschitz bound of Piyavskii, and of conservative advancement.
3. *Second derivative.* D'' is at most what `_upward` says, C. So D is nowhere less than its chord less C h^2 / 8, which
   decides short intervals, however far apart and large the polygons are.

Intervals are halved until the bounds meet, or the pair's share of the work is used up. Then the distance is stated with
the difference of the bounds. Nothing is decided by sampling.

References: S. A. Piyavskii, "An algorithm for finding the absolute extremum of a function", USSR Computational
Mathematics and Mathematical Physics 12 (1972), doi:10.1016/0041-5553(72)90115-2. B. Mirtich, see `proofs`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import Floats, Sides, least_on_chord
from conflictdb.model import SINCE_EVER_US
from conflictdb.motion.contract import Plane, sides_of
from conflictdb.results import Kind
from conflictdb.stage4.constants import (
    APPROACH_M,
    EDGE_PLACES,
    EDGE_STEPS,
    MAX_APPROACH_INTERVALS,
    MAX_APPROACH_LEVELS,
    MAX_BISECTIONS,
    MAX_INTERVALS,
    MAX_ROUNDS,
    MIN_APPROACH_INTERVALS,
    PLACE_M,
    SHORTEST_INTERVAL_S,
    TIE_M,
    TOUCH_M,
)
from conflictdb.stage4.distance import clearance_m, gap_along, nearest, nearest_at
from conflictdb.stage4.encounters import Encounters, group_by_shape, short_m
from conflictdb.stage4.proofs import Reason, undecided_separation
from conflictdb.stage4.roots import Measure, first_below, golden_section


@dataclass(frozen=True, slots=True)
class Approaches:
    """The closest approach of n pairs of objects.

    pair, at_s : (n,) the pair of pieces that comes closest, and the seconds after the start of its shared span; -1
        where none is within what was asked
    at_us : (n,) int64, the same in microseconds since 1970; SINCE_EVER_US for areas that are always there
    distance_m : (n,) metres on the earth, 0 where they touch; infinite where they are not within what was asked
    error_m : (n,) bound on how far distance_m is from the least distance, either way, metres
    a_deg, b_deg : (n, 2) longitude (in [-180, 180)) and latitude of the nearest points; NaN where there are none
    """

    pair: PairRows
    at_s: Floats
    at_us: NDArray[np.int64]
    distance_m: Floats
    error_m: Floats
    a_deg: Floats
    b_deg: Floats


@dataclass(slots=True)
class _Search:
    """Pairs of pieces that are searched together.

    span_s : (n,) seconds of the shared span
    limit_m : (n,) a distance above this need not be known
    least_m, at_s : (n,) the least distance seen, and when
    floor_m : (n,) what it is nowhere below in the intervals that were searched; infinite while none was
    first_m, last_m : (n,) the distances at both ends of the span
    """

    pairs: Encounters
    span_s: Floats
    limit_m: Floats
    least_m: Floats
    at_s: Floats
    floor_m: Floats
    first_m: Floats
    last_m: Floats

    @classmethod
    def of(cls, pairs: Encounters, span_s: Floats) -> "_Search":
        """Return a search that has seen the ends and the middle of the span."""
        n = len(span_s)
        everything = np.full(n, np.inf)
        rows = np.arange(n)
        first, middle, last = (_distance(pairs, rows, span_s * part) for part in (0.0, 0.5, 1.0))
        search = cls(pairs, span_s, everything, everything.copy(), np.zeros(n), everything.copy(), first, last)
        for part, distance in ((0.0, first), (0.5, middle), (1.0, last)):
            search.see(rows, span_s * part, distance)
        return search

    def see(self, row: NDArray[np.int64], at_s: Floats, distance_m: Floats) -> None:
        """Take note of distances; of equal ones the earliest counts."""
        order = np.lexsort((at_s, distance_m, row))
        first = order[np.unique(row[order], return_index=True)[1]]
        better = first[distance_m[first] < self.least_m[row[first]]]
        self.least_m[row[better]], self.at_s[row[better]] = distance_m[better], at_s[better]

    def run(self) -> None:
        """Search until the bounds meet."""
        row = np.flatnonzero(self.span_s > 0.0)
        start, end, first, last = np.zeros(len(row)), self.span_s[row], self.first_m[row], self.last_m[row]
        best = np.zeros(len(self.span_s))  # half the width of the interval in which the least was seen
        best[row] = 0.5 * end
        most = self.pairs.share(MAX_INTERVALS, MIN_APPROACH_INTERVALS, MAX_APPROACH_INTERVALS)
        for level in range(MAX_APPROACH_LEVELS):
            if not len(row):
                break
            middle = 0.5 * (start + end)
            distance, bound = self._bounds(row, start, middle, end, first, last)
            before = self.least_m.copy()
            self.see(row, middle, distance)
            improved = np.flatnonzero(self.least_m < before)
            best[improved] = (0.5 * self.span_s / 2.0**level)[improved]
            enough = np.minimum(self.least_m, self.limit_m)[row] - APPROACH_M
            open_ = bound < enough
            crowded = np.bincount(row, open_, minlength=len(self.span_s))[row] > most[row]
            done = ~open_ | crowded | (end - start <= SHORTEST_INTERVAL_S) | (level == MAX_APPROACH_LEVELS - 1)
            np.minimum.at(self.floor_m, row[done], bound[done])
            row, start, middle, end = row[~done], start[~done], middle[~done], end[~done]
            first, distance, last = first[~done], distance[~done], last[~done]
            row = np.concatenate([row, row])
            start, end = np.concatenate([start, middle]), np.concatenate([middle, end])
            first, last = np.concatenate([first, distance]), np.concatenate([distance, last])
        known = self.least_m - self.floor_m <= TIE_M
        near = np.flatnonzero((self.least_m <= self.limit_m + APPROACH_M) & (best > 0.0) & ~known)
        if near.size:
            low, high = np.maximum(self.at_s - best, 0.0)[near], np.minimum(self.at_s + best, self.span_s)[near]
            self._polish(near, low, high)

    def _polish(self, rows: NDArray[np.int64], low: Floats, high: Floats) -> None:
        """Look for a lesser distance between two instants, by golden section."""
        found = golden_section(self._distance_of(rows), low, high, SHORTEST_INTERVAL_S, MAX_BISECTIONS)
        self.see(rows, *found[2:])

    def _distance_of(self, rows: NDArray[np.int64]) -> Measure:
        return lambda k, t: _distance(self.pairs, rows[k], t)

    def _bounds(
        self, row: NDArray[np.int64], start: Floats, middle: Floats, end: Floats, first: Floats, last: Floats
    ) -> tuple[Floats, Floats]:
        """Return distances in the middle of intervals, and what they are nowhere below during them, metres.

        first, last : (n,) distances at start and end
        """
        columns = (start, middle, end, first, last)
        parts = [
            _bounds(self.pairs.take(row[batch]), *(column[batch] for column in columns))
            for batch in self.pairs.batches(len(row))
        ]
        distance, bound = (np.concatenate(column) for column in zip(*parts, strict=True))
        return distance, bound

    def earliest(self, rows: NDArray[np.int64], level_m: Floats) -> Floats:
        """Return the first instants, before those of the least distance, at which rows come as close as this, seconds.

        level_m : (n,) at least the least distance; TOUCH_M: the first touch is proven to be the first
        """
        first = first_below(self._distance_of(rows), np.zeros(len(rows)), self.at_s[rows], level_m)
        active = np.flatnonzero(level_m <= TOUCH_M)
        for _ in range(MAX_ROUNDS):
            active = active[first[active] > SHORTEST_INTERVAL_S]
            if not active.size:
                break
            before = first[active] - SHORTEST_INTERVAL_S
            undecided = undecided_separation(
                self.pairs.take(rows[active]), np.arange(len(active)), np.zeros(len(active)), before, 0.0
            )
            touch = undecided.reason == Reason.CONTACT
            at = np.full(len(active), np.inf)
            np.minimum.at(at, undecided.row[touch], undecided.at[touch])
            active, at = active[np.isfinite(at)], at[np.isfinite(at)]
            first[active] = first_below(self._distance_of(rows[active]), np.zeros(len(active)), at, level_m[active])
        return first


def approaches(plane: Plane, pieces: Pieces, pairs: Pairs, group: NDArray[np.int64], wanted_m: Floats) -> Approaches:
    """Return how close pairs of objects come during the time they share.

    Both ends of that time count, also one that does not belong to it: the distance tends to what it is there.

    group : (n,) of which pair of objects each pair of pieces is
    wanted_m : (g,) for each pair of objects, the distance beyond which nothing needs to be known, metres
    """
    searches = []
    for rows in group_by_shape(plane, pieces, pairs, np.arange(len(pairs))):
        start = np.maximum(pieces.start_us[pairs.a[rows]], pieces.start_us[pairs.b[rows]])
        end = np.minimum(pieces.end_us[pairs.a[rows]], pieces.end_us[pairs.b[rows]])
        still = (pieces.kind[pairs.a[rows]] == Kind.AREA.code) & (pieces.kind[pairs.b[rows]] == Kind.AREA.code)
        span = np.where(still, 0, end - np.where(still, end, start)) / 1e6
        encounters = Encounters.of(plane, 0.0, pieces, pairs, rows, start)
        searches.append((rows, start, _Search.of(encounters, span)))

    # A distance seen for one pair of pieces is a limit for all pairs of the same objects: many need no search then.
    limit, least, floor = wanted_m.copy(), np.full(len(wanted_m), np.inf), np.full(len(wanted_m), np.inf)
    for rows, _, search in searches:
        np.minimum.at(limit, group[rows], search.least_m)
    for rows, _, search in searches:
        search.limit_m = limit[group[rows]]
        search.run()
        np.minimum.at(least, group[rows], search.least_m)
        np.minimum.at(floor, group[rows], search.floor_m)
    least[least > wanted_m] = np.inf
    least[least <= TOUCH_M] = 0.0

    # The earliest of the closest.
    level = np.where(least == 0.0, TOUCH_M, least + TIE_M)
    columns: list[tuple[NDArray[np.int64], NDArray[np.int64], Floats, NDArray[np.int64]]] = []
    for rows, start, search in searches:
        close = np.flatnonzero((search.least_m <= level[group[rows]]) & np.isfinite(level[group[rows]]))
        at_s = search.earliest(close, level[group[rows[close]]])
        zero = start[close]
        columns.append((group[rows[close]], rows[close], at_s, zero + np.rint(at_s * 1e6).astype(np.int64)))
    nothing = (np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty(0, np.int64))
    owner, pair, at_s, at_us = (np.concatenate(column) for column in zip(nothing, *columns, strict=True))
    order = np.lexsort((pair, at_us, owner))
    owner, first = np.unique(owner[order], return_index=True)
    chosen = order[first]

    found = Approaches(
        PairRows(np.full(len(least), -1)),
        np.zeros(len(least)),
        np.full(len(least), SINCE_EVER_US),
        least,
        np.zeros(len(least)),
        np.full((len(least), 2), np.nan),
        np.full((len(least), 2), np.nan),
    )
    found.pair[owner], found.at_s[owner], found.at_us[owner] = pair[chosen], at_s[chosen], at_us[chosen]
    apart = np.flatnonzero(np.isfinite(least) & (least > 0.0))
    distance_error = np.where(least[apart] > short_m(plane), plane.distance_error_m(least[apart]), 0.0)
    found.error_m[apart] = np.maximum(least[apart] - floor[apart], 0.0) + TOUCH_M + distance_error
    some = pairs.take(PairRows(found.pair[owner]))
    for rows in group_by_shape(plane, pieces, some, np.arange(len(some))):
        start = np.maximum(pieces.start_us[some.a[rows]], pieces.start_us[some.b[rows]])
        encounters = Encounters.of(plane, 0.0, pieces, some, rows, start)
        one, other = _nearest_points(encounters, found.at_s[owner[rows]])
        found.a_deg[owner[rows]], found.b_deg[owner[rows]] = _degrees(plane, one), _degrees(plane, other)
    return found


def _distance(pairs: Encounters, rows: NDArray[np.int64], t: Floats) -> Floats:
    """Return (n,) distances on the earth at times t, 0 where the polygons meet."""
    return np.maximum(clearance_m(pairs, rows, t), 0.0)


def _bounds(
    pairs: Encounters, start: Floats, middle: Floats, end: Floats, first: Floats, last: Floats
) -> tuple[Floats, Floats]:
    polygons = [(pairs.a.positions(t), pairs.b.positions(t)) for t in (start, middle, end)]
    found = nearest(pairs, *polygons[1])
    distance = np.maximum(found.clearance_m, 0.0)
    largest, smallest = pairs.scale(*polygons[0], *polygons[1], *polygons[2])
    h, axis, plane = end - start, found.axis.T, pairs.plane
    acceleration = pairs.a.max_acceleration(start, end) + pairs.b.max_acceleration(start, end)

    gap = np.minimum(gap_along(axis, *polygons[0]), gap_along(axis, *polygons[2])) - acceleration * h**2 / 8.0
    gap = np.maximum(gap - TOUCH_M * largest, 0.0)
    by_gap = plane.least_m(gap, largest)

    # A distance below that in the middle is at most `reach` in the plane, and at least the gap along the axis. So the
    # angle between axis and way has a cosine of gap / reach or more. On the earth
    # the gradient of the distance may be another direction: off by the plane's gradient angle.
    reach = plane.span_m(distance, largest)
    sine = np.sqrt(np.maximum(1.0 - (gap / np.where(reach > 0.0, reach, 1.0)) ** 2, 0.0))
    sine = np.where((gap > 0.0) & (reach > 0.0), sine + plane.gradient_angle(distance, largest), 1.0)
    a, b = pairs.a.velocities(middle), pairs.b.velocities(middle)
    ahead = _fastest(axis[0] * a[0] + axis[1] * a[1], axis[0] * b[0] + axis[1] * b[1])
    across = _fastest(axis[0] * a[1] - axis[1] * a[0], axis[0] * b[1] - axis[1] * b[0])
    straight = np.hypot(ahead, across)
    rate = np.minimum(ahead + sine * across, straight) if plane.is_conformal else straight
    speed = np.maximum(np.hypot(a[0], a[1]).max(axis=0), np.hypot(b[0], b[1]).max(axis=0)) + acceleration * h
    rate = rate + acceleration * h + plane.distortion_rate(distance, largest, speed)
    by_rate = distance - 0.5 * rate * h / smallest - TOUCH_M
    bound = np.maximum(by_gap, np.maximum(by_rate, 0.0))

    far = np.flatnonzero(bound > 0.0)
    if far.size:
        upward = _upward(pairs, (a, b), acceleration, h, largest, smallest, bound)[far]
        halves = [
            least_on_chord(one[far], other[far], upward * (0.5 * h[far]) ** 2 / 8.0)
            for one, other in ((first, distance), (distance, last))
        ]
        bound[far] = np.maximum(bound[far], np.minimum(*halves) - TOUCH_M)
    return distance, bound


def _upward(
    pairs: Encounters,
    velocities: tuple[Floats, Floats],
    acceleration: Floats,
    h: Floats,
    largest: Floats,
    smallest: Floats,
    least_m: Floats,
) -> Floats:
    """Return (n,) a bound on the second derivative of distances during h seconds about instants, m/s^2.

    velocities : (2, v, n) of the vertices in the middle; acceleration : bounds on theirs, plane m/s^2
    largest, smallest : (n,) scales during that time; least_m : (n,) what the distance is nowhere below, > 0

    A place of a polygon is a fixed convex combination of its vertices, so D is the least of the distances of two
    places, one that moves with each polygon. For one such distance d with speeds v1, v2 and accelerations a1, a2 of its
    ends, the second variation of arc length gives d'' <= (v1 + v2)^2 / d + a1 + a2, as the earth's curvature is nowhere
    negative. (If another way becomes the shortest, d is only less.) With C the largest of these bounds, each d - C t^2
    / 2 is concave, and so is their least: D lies below its chord over h seconds by at most C h^2 / 8.

    Reference: M. do Carmo, "Riemannian Geometry" (1992), chapter 9, formula of the second variation.
    """
    speeds = [(np.hypot(v[0], v[1]).max(axis=0) + 0.5 * acceleration * h) / smallest for v in velocities]
    curving = pairs.plane.christoffel_bound(largest) * (speeds[0] ** 2 + speeds[1] ** 2) + acceleration / smallest
    return np.asarray((speeds[0] + speeds[1]) ** 2 / np.where(least_m > 0.0, least_m, np.inf) + curving)


def _fastest(a: Floats, b: Floats) -> Floats:
    """Return (n,) the largest difference between components of velocities (va, n) and (vb, n)."""
    return np.asarray(np.maximum(b.max(axis=0) - a.min(axis=0), a.max(axis=0) - b.min(axis=0)))


def _nearest_points(pairs: Encounters, t: Floats) -> tuple[Floats, Floats]:
    """Return the nearest points on the earth at times t, (2, n) plane metres (not where polygons overlap)."""
    origin = pairs.origin[:, None, :]
    a, b = pairs.a.positions(t) + origin, pairs.b.positions(t) + origin
    found = nearest_at(pairs, np.arange(len(t)), t)
    one, other = found.point_a.T.copy(), found.point_b.T.copy()
    # The nearest points of the plane may not be those of the earth.
    far = np.flatnonzero(found.clearance_m > short_m(pairs.plane))
    if far.size:
        sides_a, sides_b = pairs.sides
        from_a, on_b, a_distance = _vertex_and_side(pairs.plane, a[:, :, far], b[:, :, far], sides_b)
        from_b, on_a, b_distance = _vertex_and_side(pairs.plane, b[:, :, far], a[:, :, far], sides_a)
        of_a = a_distance <= b_distance
        one[:, far], other[:, far] = np.where(of_a, from_a, on_a), np.where(of_a, on_b, from_b)
    return one, other


def _vertex_and_side(plane: Plane, points: Floats, polygon: Floats, sides: Sides) -> tuple[Floats, Floats, Floats]:
    """Return the vertex nearest to another polygon, its nearest point there, (2, n) plane metres, and their distance.

    points, polygon : (2, v, n) and (2, w, n) plane metres
    """
    n = points.shape[2]
    vertex, start, end, least = points[:, 0].copy(), polygon[:, 0].copy(), polygon[:, 0].copy(), np.full(n, np.inf)
    for k in range(points.shape[1]):
        for first, last in zip(*sides, strict=True):
            distance = _apart(plane, points[:, [k]], polygon[:, [first, last]])
            nearer = distance < least
            least = np.where(nearer, distance, least)
            vertex = np.where(nearer, points[:, k], vertex)
            start, end = np.where(nearer, polygon[:, first], start), np.where(nearer, polygon[:, last], end)

    def place(part: Floats) -> Floats:
        return np.asarray(start + part * (end - start))

    def distance_at(rows: NDArray[np.int64], part: Floats) -> Floats:
        at = start[:, rows] + part * (end[:, rows] - start[:, rows])
        return _apart(plane, vertex[:, None, rows], at[:, None])

    # Golden section about the nearest of some places along the side.
    every = np.arange(n)
    sampled = np.linspace(0.0, 1.0, EDGE_PLACES)
    nearest_of = np.stack([distance_at(every, np.full(n, part)) for part in sampled]).argmin(axis=0)
    low, high = sampled[np.maximum(nearest_of - 1, 0)], sampled[np.minimum(nearest_of + 1, EDGE_PLACES - 1)]
    length = np.hypot(*(end - start))
    low, high, _, _ = golden_section(distance_at, low, high, PLACE_M, EDGE_STEPS, length)
    part = 0.5 * (low + high)
    for end_of in (np.zeros(n), np.ones(n)):
        part = np.where(distance_at(every, end_of) <= distance_at(every, part), end_of, part)
    return vertex, place(part), distance_at(every, part)


def _apart(plane: Plane, one: Floats, other: Floats) -> Floats:
    """Return the distance on the earth of points or lines, (2, 1 or 2, n) plane metres each."""
    return plane.distance_m(one, other, *(sides_of(xy.shape[1], convex=True) for xy in (one, other)))


def _degrees(plane: Plane, xy: Floats) -> Floats:
    lon, lat = plane.from_plane(xy[0], xy[1])
    return np.stack([np.mod(lon + 180.0, 360.0) - 180.0, lat], axis=1)
