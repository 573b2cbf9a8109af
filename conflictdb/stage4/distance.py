"""How far apart two convex polygons are at an instant.

The signed separation of two polygons is their distance where they are disjoint, and minus their penetration depth where
they overlap: the length of the shortest translation that takes them apart. It is continuous in time. Where they
overlap it is the widest gap (a negative one) over the separating axes, which are the normals of the edges.

Distances are taken between every vertex and every edge, for many pairs in one array. The method of Gilbert, Johnson and
Keerthi needs fewer operations for large polygons, but each pair takes its own steps, which arrays cannot share.

References: S. Cameron, R. Culley, "Determining the minimum translational distance between two convex polyhedra", IEEE
International Conference on Robotics and Automation (1986). E. G. Gilbert, D. W. Johnson, S. S. Keerthi, "A fast
procedure for computing the distance between complex objects in three-dimensional space", IEEE Journal on Robotics and
Automation 4 (1988), doi:10.1109/56.2083.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats, Sides
from conflictdb.stage4.constants import EDGE_NUMBERS
from conflictdb.stage4.encounters import Encounters, short_m


@dataclass(frozen=True, slots=True)
class Nearest:
    """How n pairs of polygons lie to each other.

    gap : (n,) signed separation, plane metres
    clearance_m : (n,) signed separation less the separation wanted, metres on the earth
    axis : (n, 2) unit vector from a to b along which the gap is measured
    point_a, point_b : (n, 2) nearest points, plane metres (of no meaning where the polygons overlap)
    """

    gap: Floats
    clearance_m: Floats
    axis: Floats
    point_a: Floats
    point_b: Floats


def clearance_m(pairs: Encounters, rows: NDArray[np.int64], t: Floats) -> Floats:
    """Return (n,) the clearance of rows at times t, metres on the earth: distance less the separation wanted.

    Negative is a loss of separation.
    """
    return nearest_at(pairs, rows, t).clearance_m


def clearance_of(pairs: Encounters, rows: NDArray[np.int64]) -> Callable[[NDArray[np.int64], Floats], Floats]:
    """Return the clearance of rows as a function of (numbers of them, times), as `roots` take it."""
    return lambda k, t: clearance_m(pairs, rows[k], t)


def nearest_at(pairs: Encounters, rows: NDArray[np.int64], t: Floats) -> Nearest:
    """Return how rows lie to each other at times t, (n,) each."""
    parts = []
    for batch in pairs.batches(len(rows)):
        some = pairs.take(rows[batch])
        parts.append(nearest(some, some.a.positions(t[batch]), some.b.positions(t[batch])))
    return Nearest(*(np.concatenate([getattr(part, name) for part in parts]) for name in Nearest.__slots__))


def nearest(pairs: Encounters, a: Floats, b: Floats, within_m: float = np.inf) -> Nearest:
    """Return how the pairs lie to each other with vertices at a (2, va, n) and b (2, vb, n), metres from the origin.

    within_m : pairs that are proven further apart than this are said to be this far apart: their distance on the earth
        is not computed
    """
    gap, axis, point_a, point_b = _nearest_in_plane(pairs, a, b)
    point_a += pairs.origin
    point_b += pairs.origin
    distance_m = _distance_m(pairs, a, b, gap, point_a, point_b, within_m)
    return Nearest(gap, distance_m - pairs.separation_m, axis.T, point_a.T, point_b.T)


def _nearest_in_plane(pairs: Encounters, a: Floats, b: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return (gap, axis, point_a, point_b) in the plane, points from the origin (see `Nearest`)."""
    gap, axis = widest_gap(pairs, a, b)
    apart = np.flatnonzero(gap > 0.0)
    point_a, point_b = a.mean(axis=1), b.mean(axis=1)
    if apart.size:
        one, other = a[:, :, apart], b[:, :, apart]
        point_a[:, apart], point_b[:, apart] = _nearest_points(one, other, *pairs.sides)
        between = point_b[:, apart] - point_a[:, apart]
        distance = np.hypot(between[0], between[1])
        # The direction between two very near points is mostly rounding: then an edge's normal separates better.
        way = between / np.where(distance > 0.0, distance, 1.0)
        better = gap_along(way, one, other) > gap[apart]
        axis[:, apart] = np.where(better, way, axis[:, apart])
        gap[apart] = np.where(distance > 0.0, distance, gap[apart])
    return gap, axis, point_a, point_b


def _distance_m(
    pairs: Encounters, a: Floats, b: Floats, gap: Floats, point_a: Floats, point_b: Floats, within_m: float
) -> Floats:
    """Return (n,) gaps in the plane as metres on the earth, by the shortest way where the pairs are apart."""
    plane = pairs.plane
    metres = 2.0 * gap / (plane.largest_scale(point_a[:, None, :]) + plane.largest_scale(point_b[:, None, :]))
    apart = np.flatnonzero(metres > short_m(plane))
    if not apart.size:
        return np.asarray(metres)
    if np.isfinite(within_m):
        far = gap[apart] > plane.span_m(within_m, pairs.take(apart).scale(a[:, :, apart], b[:, :, apart])[0])
        metres[apart[far]] = within_m
        apart = apart[~far]
    # The scale varies along the polygons: other points than the nearest in the plane may be nearest on the earth.
    origin = pairs.origin[:, None, apart]
    metres[apart] = plane.distance_m(a[:, :, apart] + origin, b[:, :, apart] + origin, *pairs.sides)
    return np.asarray(metres)


def gap_along(axis: Floats, a: Floats, b: Floats) -> Floats:
    """Return (n,) min of b less max of a along axes (2, n), plane metres."""
    ahead = (axis[0] * b[0] + axis[1] * b[1]).min(axis=0)
    ahead -= (axis[0] * a[0] + axis[1] * a[1]).max(axis=0)
    return np.asarray(ahead)


def widest_gap(pairs: Encounters, a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return (n,) the widest gap over the separating axes (negative: they overlap) and (2, n) its axis from a to b.

    Axes are the normals of the edges, and the line between the middles. A polygon of two vertices is a line: its
    direction separates it from what lies ahead of it.
    """
    axis = b.mean(axis=1) - a.mean(axis=1)
    length = np.hypot(axis[0], axis[1])
    axis = np.where(length > 0.0, axis / np.where(length > 0.0, length, 1.0), np.array([[1.0], [0.0]]))
    gap = gap_along(axis, a, b)
    for normal, found, real in edge_gaps(pairs, a, b):
        axes = [(normal, found)]
        if 2 in (a.shape[1], b.shape[1]):
            along = np.stack([-normal[1], normal[0]])
            axes.append((along, np.stack([gap_along(along[:, e], a, b) for e in range(along.shape[1])])))
        for candidate, width in axes:
            _take_wider(gap, axis, candidate, np.where(real, width, -np.inf))
    return gap, axis


def _take_wider(gap: Floats, axis: Floats, normal: Floats, found: Floats) -> None:
    """Put in place the widest of gaps (e, n) along normals (2, e, n) where it is wider."""
    best = found.argmax(axis=0)
    every = np.arange(len(gap))
    widest = found[best, every]
    wider = widest > gap
    np.copyto(gap, widest, where=wider)
    np.copyto(axis, normal[:, best, every], where=wider)


def edge_gaps(pairs: Encounters, a: Floats, b: Floats) -> list[tuple[Floats, Floats, NDArray[np.bool_]]]:
    """Return for edges of both polygons unit normals from a to b (2, e, n), gaps along them (e, n), if they are real.

    In blocks of as many edges as fit the processor's cache.
    """
    found = []
    for mine, other, convex, sign in ((a, b, pairs.a.is_convex, 1.0), (b, a, pairs.b.is_convex, -1.0)):
        for k, m in edges(mine, other, convex=convex):
            normal = np.stack([mine[1, m] - mine[1, k], mine[0, k] - mine[0, m]])
            length = np.sqrt(normal[0] ** 2 + normal[1] ** 2)
            real = length > 0.0
            normal /= np.where(real, length, 1.0)
            found.append((sign * normal, gaps_along(normal[0], normal[1], mine, other, k, convex=convex), real))
    return found


def gaps_along(nx: Floats, ny: Floats, mine: Floats, other: Floats, k: NDArray[np.int64], *, convex: bool) -> Floats:
    """Return (e, n) gaps along normals nx, ny (e, n) of edges that start at vertices k of `mine`."""
    gap = _along(nx, ny, other).min(axis=1)
    if convex and mine.shape[1] > 2:
        # The edge itself is the furthest of a convex polygon along its own normal.
        gap -= nx * mine[0, k] + ny * mine[1, k]
    else:
        gap -= _along(nx, ny, mine).max(axis=1)
    return np.asarray(gap)


def _along(nx: Floats, ny: Floats, polygon: Floats) -> Floats:
    """Return (e, v, n) vertices along directions nx, ny (e, n)."""
    return np.asarray(nx[:, None] * polygon[0] + ny[:, None] * polygon[1])


def edges(mine: Floats, other: Floats, *, convex: bool) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return blocks of vertices (k, m) that edges of `mine` run between: any two, where edges are not known."""
    count = mine.shape[1]
    if count == 1:
        return []
    first = np.arange(count)
    if convex:
        k, m = first, np.roll(first, -1)
    else:
        k, m = np.divmod(np.arange(count * count), count)
        k, m = k[k != m], m[k != m]
    width = max(count, other.shape[1]) * mine.shape[2]
    size = max(1, EDGE_NUMBERS // max(width, 1))
    return [(k[i : i + size], m[i : i + size]) for i in range(0, len(k), size)]


def _nearest_points(a: Floats, b: Floats, sides_a: Sides, sides_b: Sides) -> tuple[Floats, Floats]:
    """Return the nearest points of disjoint polygons, (2, n) each."""
    on_b, foot_b, from_a = _vertex_to_side(a, b, sides_b)
    on_a, foot_a, from_b = _vertex_to_side(b, a, sides_a)
    first = on_b <= on_a
    return np.where(first, from_a, foot_a), np.where(first, foot_b, from_b)


def _vertex_to_side(points: Floats, polygon: Floats, sides: Sides) -> tuple[Floats, Floats, Floats]:
    """Return (squared distance, foot on the polygon's sides, vertex) of the vertex nearest to the sides, (..., n)."""
    start = polygon[:, sides[0]]
    edge = polygon[:, sides[1]] - start
    square = edge[0] ** 2 + edge[1] ** 2
    way = points[:, :, None, :] - start[:, None]
    along = (way[0] * edge[0] + way[1] * edge[1]) / np.where(square > 0.0, square, 1.0)
    off = way - np.clip(along, 0.0, 1.0) * edge[:, None, :, :]
    distance = (off[0] ** 2 + off[1] ** 2).reshape(-1, points.shape[2])
    best = distance.argmin(axis=0)
    rows = np.arange(points.shape[2])
    p, e = np.divmod(best, len(sides[0]))
    vertex = points[:, p, rows]
    return distance[best, rows], vertex - off[:, p, e, rows], vertex
