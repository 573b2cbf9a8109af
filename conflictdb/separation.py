"""How far apart two convex polygons are, and proofs that they stay apart.

The signed separation of two polygons is their distance where they are disjoint, and minus the depth of the shallowest
way out where they overlap (separating axes). It is continuous in time. `clear` proves, by branch and bound, that it
stays above a threshold during an interval: along a fixed direction n the gap min(n.b) - max(n.a) of polygons whose
vertices move straight is concave in time, so its chord bounds it from below; a vertex departs from its chord by at most
M h^2 / 8, M a bound on its second derivative. Nothing is decided by sampling.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.geodesy import Earth, Floats
from conflictdb.motion import Shapes

# Polygons within a micrometre touch: plane coordinates are rounded to about 1e-8 m, and a touch must not become a miss.
TOUCH_M: Final = 1e-6
# Intervals are not split below a microsecond, the resolution of a timestamp (seconds).
SHORTEST_INTERVAL_S: Final = 1e-6
# Halvings of a window; 64 reach a microsecond from a hundred thousand years.
MAX_LEVELS: Final = 64
# Intervals under way for one pair: beyond it the pair is left undecided rather than let one pair take all memory.
MAX_INTERVALS_PER_PAIR: Final = 4096
# Up to this distance Simpson's rule gives metres on the earth to a relative 1e-7 at 80 degrees of latitude.
SIMPSON_REACH_M: Final = 100_000.0
# Numbers held at once by one array of an evaluation (8 bytes each; there are a few such arrays).
BATCH_NUMBERS: Final = 2_000_000


@dataclass(frozen=True, slots=True)
class Encounters:
    """n pairs of shapes with a common time zero, and the separation wanted between them, metres."""

    earth: Earth
    a: Shapes
    b: Shapes
    separation_m: float

    def take(self, rows: NDArray[np.int64]) -> "Encounters":
        """Return the encounters of some rows."""
        return Encounters(self.earth, self.a.take(rows), self.b.take(rows), self.separation_m)

    def excess(self, rows: NDArray[np.int64], t: Floats) -> Floats:
        """Return by how many metres rows are further apart than wanted at times t (negative: too close), (n,)."""
        return self.nearest(rows, t).excess_m

    def nearest(self, rows: NDArray[np.int64], t: Floats) -> "Nearest":
        """Return how rows lie to each other at times t, (n,) each."""
        parts = [self.take(rows[batch])._nearest(t[batch]) for batch in self.batches(len(rows))]
        return Nearest(*(np.concatenate([getattr(part, name) for part in parts]) for name in Nearest.__slots__))

    def batches(self, n: int) -> list[slice]:
        """Return slices of n rows that keep the arrays of an evaluation within bounds."""
        widths = [(shapes.vertex_count, shapes.is_convex) for shapes in (self.a, self.b)]
        numbers = widths[0][0] * widths[1][0] + sum(0 if convex else count**2 for count, convex in widths)
        step = max(1, BATCH_NUMBERS // numbers)
        return [slice(first, first + step) for first in range(0, max(n, 1), step)]

    def _nearest(self, t: Floats) -> "Nearest":
        return nearest(self, self.a.positions(t), self.b.positions(t))


@dataclass(frozen=True, slots=True)
class Nearest:
    """How n pairs of polygons lie to each other.

    gap : (n,) signed separation, plane metres
    excess_m : (n,) signed separation less the separation wanted, metres on the earth
    axis : (n, 2) unit vector from a to b along which the gap is measured
    point_a, point_b : (n, 2) nearest points, plane metres (of no meaning where the polygons overlap)
    """

    gap: Floats
    excess_m: Floats
    axis: Floats
    point_a: Floats
    point_b: Floats


def nearest(pairs: Encounters, a: Floats, b: Floats) -> Nearest:
    """Return how the pairs lie to each other with vertices at a (n, va, 2) and b (n, vb, 2), plane metres.

    The distance on the earth is that of the straight (rhumb) line between the nearest points in the plane, by
    Simpson's rule, less what the true shortest way may save: it is never overstated.
    """
    gap, axis = _widest_gap(a, b, pairs.a.is_convex, pairs.b.is_convex)
    apart = np.flatnonzero(gap > 0.0)
    point_a, point_b = a.mean(axis=1), b.mean(axis=1)
    if apart.size:
        point_a[apart], point_b[apart] = _nearest_points(a[apart], b[apart])
        between = point_b[apart] - point_a[apart]
        distance = np.hypot(between[:, 0], between[:, 1])
        # Separated by less than the rounding of the nearest points: the axis found above is as good.
        sound = distance > 0.0
        gap[apart] = np.where(sound, distance, gap[apart])
        unit = between / np.where(sound, distance, 1.0)[:, None]
        axis[apart] = np.where(sound[:, None], unit, axis[apart])
    excess = _on_earth(pairs.earth, gap, point_a, point_b) - pairs.separation_m
    return Nearest(gap, excess, axis, point_a, point_b)


class Leaf(IntEnum):
    """Why an interval is not clear."""

    CONTACT = 0  # closer than wanted at the instant `at`
    NEAR = 1  # within the margin of it at the instant `at`
    BORDER = 2  # neither shown, down to the shortest interval


@dataclass(frozen=True, slots=True)
class Leaves:
    """m intervals that are not proven clear: row (m,), start, end, at (m,) seconds, kind (m,) Leaf values."""

    row: NDArray[np.int64]
    start: Floats
    end: Floats
    at: Floats
    kind: NDArray[np.int8]


def not_clear(pairs: Encounters, rows: NDArray[np.int64], start: Floats, end: Floats, margin_m: float) -> Leaves:
    """Return what remains of [start, end] of rows where the pairs are not proven further apart than wanted + margin.

    With a negative margin: not proven to overlap by less than that. Everything outside the leaves is proven clear. An
    interval becomes a leaf as soon as its middle is found closer than that, so a leaf may hold more than is needed,
    never less.
    """
    found: list[tuple[NDArray[np.int64], Floats, Floats, Floats, NDArray[np.int8]]] = []
    rows, start, end = rows.copy(), start.copy(), end.copy()

    def keep(mask: NDArray[np.bool_], at: Floats, kind: NDArray[np.int8]) -> None:
        found.append((rows[mask], start[mask], end[mask], at[mask], kind[mask]))

    for level in range(MAX_LEVELS):
        if not len(rows):
            break
        middle = 0.5 * (start + end)
        u, v, excess = _window(pairs, rows, start, middle, end, margin_m)
        open_ = u <= v
        close = open_ & (excess <= margin_m)
        keep(close, middle, np.where(excess <= TOUCH_M, Leaf.CONTACT, Leaf.NEAR).astype(np.int8))
        short = open_ & ~close & (end - start <= SHORTEST_INTERVAL_S)
        crowded = np.zeros(len(rows), np.bool_)
        if level > 8:  # fewer levels cannot make that many intervals
            crowded = (np.bincount(rows)[rows] > MAX_INTERVALS_PER_PAIR) & open_ & ~close & ~short
        keep(short | crowded, middle, np.full(len(rows), Leaf.BORDER, np.int8))
        split = open_ & ~close & ~short & ~crowded
        width = (end - start)[split]
        a, b, row = start[split] + u[split] * width, start[split] + v[split] * width, rows[split]
        c = 0.5 * (a + b)
        rows = np.concatenate([row, row])
        start, end = np.concatenate([a, c]), np.concatenate([c, b])
    else:
        keep(np.ones(len(rows), np.bool_), 0.5 * (start + end), np.full(len(rows), Leaf.BORDER, np.int8))
    if not found:
        none = np.empty(0)
        return Leaves(np.empty(0, np.int64), none, none, none, np.empty(0, np.int8))
    columns = [np.concatenate(column) for column in zip(*found, strict=True)]
    order = np.lexsort((columns[1], columns[0]))
    return Leaves(*(column[order] for column in columns))


def crossing(
    pairs: Encounters, rows: NDArray[np.int64], outside: Floats, inside: Floats, level_m: float
) -> tuple[Floats, Floats]:
    """Return brackets (outer, inner) of where the excess crosses a level, by bisection to a microsecond's quarter.

    outside, inside : (n,) seconds, with excess > level at outside and <= level at inside (either may be the later).
    A pair that is not above the level at `outside` gets `outside` for both.
    """
    outer, inner = outside.copy(), inside.copy()
    inner = np.where(pairs.excess(rows, outer) > level_m, inner, outer)
    for _ in range(MAX_LEVELS):
        middle = 0.5 * (outer + inner)
        wide = (np.abs(outer - inner) > 0.25 * SHORTEST_INTERVAL_S) & (middle != outer) & (middle != inner)
        active = np.flatnonzero(wide)
        if not active.size:
            break
        above = pairs.excess(rows[active], middle[active]) > level_m
        outer[active] = np.where(above, middle[active], outer[active])
        inner[active] = np.where(above, inner[active], middle[active])
    return outer, inner


def deepest(pairs: Encounters, rows: NDArray[np.int64], start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Return (instant, excess) at a local least separation within [start, end], by golden section; seconds, metres."""
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    low, high = start.copy(), end.copy()
    left, right = high - ratio * (high - low), low + ratio * (high - low)
    at_left, at_right = pairs.excess(rows, left), pairs.excess(rows, right)
    # 60 steps shrink a day to less than a microsecond.
    for _ in range(60):
        active = high - low > SHORTEST_INTERVAL_S
        if not active.any():
            break
        keep_left = at_left <= at_right
        low, high = np.where(keep_left, low, left), np.where(keep_left, right, high)
        new = np.where(keep_left, high - ratio * (high - low), low + ratio * (high - low))
        at_new = pairs.excess(rows, new)
        left, right = np.where(keep_left, new, right), np.where(keep_left, left, new)
        at_left, at_right = np.where(keep_left, at_new, at_right), np.where(keep_left, at_left, at_new)
    return np.where(at_left <= at_right, left, right), np.minimum(at_left, at_right)


def _window(
    pairs: Encounters, rows: NDArray[np.int64], start: Floats, middle: Floats, end: Floats, margin_m: float
) -> tuple[Floats, Floats, Floats]:
    """Return (u, v, excess): fractions of [start, end] outside of which rows are proven clear, u > v if everywhere.

    excess : (n,) at the middle, metres.
    """
    parts = [
        _window_batch(pairs.take(rows[batch]), start[batch], middle[batch], end[batch], margin_m)
        for batch in pairs.batches(len(rows))
    ]
    u, v, excess = (np.concatenate(column) for column in zip(*parts, strict=True))
    return u, v, excess


def _window_batch(
    pairs: Encounters, start: Floats, middle: Floats, end: Floats, margin_m: float
) -> tuple[Floats, Floats, Floats]:
    h = end - start
    shapes = [(pairs.a.positions(t), pairs.b.positions(t)) for t in (start, middle, end)]
    found = [nearest(pairs, *polygons) for polygons in shapes]
    bend = pairs.a.bend(start, end) + pairs.b.bend(start, end)
    # What is wanted, in plane metres at the highest latitude reached: every vertex is furthest from the equator at
    # one end of the interval.
    ordinates = np.concatenate([polygon[..., 1] for k in (0, 2) for polygon in shapes[k]], axis=1)
    highest = np.abs(ordinates).max(axis=1) / pairs.earth.radius_m
    wanted_m = pairs.separation_m + margin_m
    wanted = wanted_m / _shortest_share(pairs.earth, wanted_m, highest) * pairs.earth.plane_scale(highest)
    if wanted_m < 0.0:
        # A depth is least in the plane where the scale is: it is 1 at the equator and more everywhere else.
        wanted = np.full(len(h), wanted_m)
    away = bend * h**2 / 8.0 + wanted + TOUCH_M
    u, v = np.zeros(len(h)), np.ones(len(h))
    for nearest_then in found:
        g0, g1 = (_gap_along(nearest_then.axis, *shapes[k]) - away for k in (0, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            zero = g0 / (g0 - g1)
        u = np.maximum(u, np.where(g0 > 0.0, np.where(g1 > 0.0, 2.0, zero), 0.0))
        v = np.minimum(v, np.where((g1 > 0.0) & (g0 <= 0.0), zero, 1.0))
    excess = found[1].excess_m
    if wanted_m > 0.0:
        # The scale at the highest latitude overstates what is wanted: the rate at which a distance in true metres can
        # change decides short intervals.
        changes = _swing(pairs, middle, h, bend, ordinates, excess)
        sound = excess + pairs.separation_m < SIMPSON_REACH_M
        u = np.where(sound & (excess > margin_m + changes + TOUCH_M), 2.0, u)
    return u, v, excess


def _swing(pairs: Encounters, middle: Floats, h: Floats, bend: Floats, ordinates: Floats, excess: Floats) -> Floats:
    """Return (n,) by how many metres at most the excess differs from that at the middle of intervals of h seconds.

    ordinates : (n, v) plane metres of all vertices at both ends
    """
    radius_m = pairs.earth.radius_m
    highest = np.abs(ordinates).max(axis=1) / radius_m
    crosses = ordinates.min(axis=1) * ordinates.max(axis=1) <= 0.0
    lowest = np.where(crosses, 0.0, np.abs(ordinates).min(axis=1)) / radius_m
    rate = _relative_speed(pairs, middle) + bend * h
    # Of polygons that overlap it is not the depth that drifts: a negative rate would prove anything.
    distance = np.maximum(excess + pairs.separation_m, 0.0)
    drift = distance * np.sinh(highest) / pairs.earth.rectifying_m * _speed(pairs, middle, bend * h)
    return np.asarray((rate + drift) / pairs.earth.plane_scale(lowest) * 0.5 * h)


def _relative_speed(pairs: Encounters, t: Floats) -> Floats:
    """Return (n,) the greatest speed of a vertex of b relative to one of a, plane metres per second."""
    a, b = pairs.a.velocities(t), pairs.b.velocities(t)
    low = np.maximum(b.max(axis=1) - a.min(axis=1), a.max(axis=1) - b.min(axis=1))
    return np.asarray(np.hypot(low[:, 0], low[:, 1]))


def _speed(pairs: Encounters, t: Floats, more: Floats) -> Floats:
    """Return (n,) the greatest speed of any vertex plus `more`, plane metres per second."""
    fastest = [np.hypot(v[..., 0], v[..., 1]).max(axis=1) for v in (pairs.a.velocities(t), pairs.b.velocities(t))]
    return np.asarray(np.maximum(*fastest) + more)


def _gap_along(axis: Floats, a: Floats, b: Floats) -> Floats:
    """Return (n,) min of b less max of a along axes (n, 2), plane metres."""
    origin = a[:, :1]
    ahead = np.einsum("nk,nvk->nv", axis, b - origin).min(axis=1)
    return np.asarray(ahead - np.einsum("nk,nvk->nv", axis, a - origin).max(axis=1))


def _axes(polygon: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return (n, k, 2) unit outward normals of the edges, and which are real: repeated vertices make no edge.

    A polygon of two vertices is a line: its direction separates it from what lies ahead of it.
    """
    if polygon.shape[1] == 1:
        return np.empty((len(polygon), 0, 2)), np.empty((len(polygon), 0), np.bool_)
    edge = np.roll(polygon, -1, axis=1) - polygon
    length = np.hypot(edge[..., 0], edge[..., 1])
    edge = edge / np.where(length > 0.0, length, 1.0)[..., None]
    normal = np.stack([edge[..., 1], -edge[..., 0]], axis=-1)
    if polygon.shape[1] == 2:
        return np.concatenate([normal, edge], axis=1), np.concatenate([length > 0.0] * 2, axis=1)
    return normal, length > 0.0


def _widest_gap(a: Floats, b: Floats, a_is_convex: bool, b_is_convex: bool) -> tuple[Floats, Floats]:
    """Return (n,) the widest gap over the separating axes (negative: they overlap) and (n, 2) its axis from a to b."""
    between = b.mean(axis=1) - a.mean(axis=1)
    length = np.hypot(between[:, 0], between[:, 1])
    axis = np.where((length > 0.0)[:, None], between / np.where(length > 0.0, length, 1.0)[:, None], [1.0, 0.0])
    gap = _gap_along(axis, a, b)
    for mine, other, convex, sign in ((a, b, a_is_convex, 1.0), (b, a, b_is_convex, -1.0)):
        normals, real = _axes(mine)
        if not normals.shape[1]:
            continue
        origin = mine[:, :1]
        to_other = np.einsum("nek,nvk->nev", normals, other - origin).min(axis=2)
        if convex and mine.shape[1] > 2:
            # The edge itself is the furthest of a convex polygon along its own normal.
            own = np.einsum("nek,nek->ne", normals, mine - origin)
        else:
            own = np.einsum("nek,nvk->nev", normals, mine - origin).max(axis=2)
        gaps = np.where(real, to_other - own, -np.inf)
        best = gaps.argmax(axis=1)
        rows = np.arange(len(gaps))
        wider = gaps[rows, best] > gap
        gap = np.where(wider, gaps[rows, best], gap)
        axis = np.where(wider[:, None], sign * normals[rows, best], axis)
    return gap, axis


def _nearest_points(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return the nearest points of disjoint polygons, (n, 2) each."""
    on_b, foot_b, from_a = _vertex_to_edge(a, b)
    on_a, foot_a, from_b = _vertex_to_edge(b, a)
    first = (on_b <= on_a)[:, None]
    return np.where(first, from_a, foot_a), np.where(first, foot_b, from_b)


def _vertex_to_edge(points: Floats, polygon: Floats) -> tuple[Floats, Floats, Floats]:
    """Return (squared distance, foot on the polygon's edges, vertex) of the vertex nearest to the edges, (n, ...)."""
    edge = np.roll(polygon, -1, axis=1) - polygon
    square = np.einsum("nek,nek->ne", edge, edge)
    to_point = points[:, :, None, :] - polygon[:, None, :, :]
    along = np.einsum("npek,nek->npe", to_point, edge) / np.where(square > 0.0, square, 1.0)[:, None, :]
    off = to_point - np.clip(along, 0.0, 1.0)[..., None] * edge[:, None, :, :]
    distance = np.einsum("npek,npek->npe", off, off).reshape(len(points), -1)
    best = distance.argmin(axis=1)
    rows = np.arange(len(points))
    p, e = np.divmod(best, polygon.shape[1])
    vertex = points[rows, p]
    return distance[rows, best], vertex - off[rows, p, e], vertex


def _shortest_share(earth: Earth, distance_m: Floats | float, highest_psi: Floats) -> Floats:
    """Return (n,) a share of a rhumb distance that the truly shortest way between two polygons cannot undercut.

    Along a parallel a rhumb line has the geodesic curvature tan(latitude) / R; over a distance d the shortest way saves
    a share (d tan / R)^2 / 24, and shifting its ends along the edges less than as much again five times.
    """
    turn = distance_m * np.sinh(highest_psi) / earth.rectifying_m
    return np.asarray(1.0 - np.minimum(turn**2 / 4.0, 0.5))


def _on_earth(earth: Earth, gap: Floats, point_a: Floats, point_b: Floats) -> Floats:
    """Return (n,) plane gaps in metres on the earth, by Simpson's rule over the scale; never overstated."""
    psi_a, psi_b = point_a[:, 1] / earth.radius_m, point_b[:, 1] / earth.radius_m
    weights = ((psi_a, 1.0), (0.5 * (psi_a + psi_b), 4.0), (psi_b, 1.0))
    metres = gap * sum(weight / earth.plane_scale(psi) for psi, weight in weights) / 6.0
    share = _shortest_share(earth, np.maximum(metres, 0.0), np.maximum(np.abs(psi_a), np.abs(psi_b)))
    return np.asarray(np.where(gap > 0.0, metres * share, metres))
