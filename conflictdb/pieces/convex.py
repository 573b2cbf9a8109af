"""Polygons of the plane cut into convex parts."""

from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.ragged import offsets, ragged_take
from conflictdb.earth.geodesy import Floats
from conflictdb.motion.contract import ROUNDING_ALLOWANCE_M

# A polygon is convex if its hull is larger by at most this share of its area: dents less than a micrometre deep, in
# areas up to 1,000 km across.
CONVEX_AREA_SHARE: Final = 1e-13
# Share of an area that its triangles may lack or exceed by rounding.
TRIANGULATION_AREA_SHARE: Final = 1e-9


def is_thread(polygons: shapely.Geometry | NDArray[np.object_]) -> NDArray[np.bool_]:
    """Return whether polygons are narrower than the plane's rounding: they may then look invalid without being so."""
    narrow = shapely.area(shapely.oriented_envelope(polygons))
    return np.asarray(narrow <= ROUNDING_ALLOWANCE_M * np.maximum(shapely.length(polygons), 1.0))


def convex_parts(flat: NDArray[np.object_]) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Return the convex parts of polygons: row of the polygon (n,), sorted, and open rings, counter-clockwise.

    The rings are ragged: vertices (v, 2), offset (n + 1,).
    """
    polygons, owner = shapely.get_parts(flat, return_index=True)
    hulls = shapely.convex_hull(polygons)
    whole = shapely.get_num_interior_rings(polygons) == 0
    whole &= shapely.area(hulls) <= shapely.area(polygons) * (1.0 + CONVEX_AREA_SHARE)
    whole |= shapely.get_dimensions(hulls) < 2
    dented = np.flatnonzero(~whole)
    of_triangle, triangles = _triangles(polygons[dented])
    cut = np.unique(of_triangle)
    # What cannot be cut reliably is taken as its hull, so that nothing is missed.
    left = np.delete(np.arange(len(polygons)), dented[cut])
    of_ring, ring_xy, ring_count = _merged(of_triangle, triangles)
    hull_xy, of_hull = shapely.get_coordinates(shapely.orient_polygons(hulls[left]), return_index=True)
    # The last of a polygon's corners is its first; lines and points have no such one.
    is_last = np.append(of_hull[1:] != of_hull[:-1], True) & (shapely.get_dimensions(hulls[left]) == 2)[of_hull]
    hull_count = np.bincount(of_hull[~is_last], minlength=len(left))
    part = np.concatenate([left, dented[of_ring]])
    order = np.argsort(part, kind="stable")
    xy = np.concatenate([hull_xy[~is_last], ring_xy])
    taken, offset = ragged_take(offsets(np.concatenate([hull_count, ring_count])), xy, order)
    return owner[part[order]].astype(np.int64), taken, offset


def _triangles(polygons: NDArray[np.object_]) -> tuple[NDArray[np.int64], Floats]:
    """Return the constrained Delaunay triangles of polygons: polygon of each (t,), sorted, corners (t, 3, 2).

    Counter-clockwise. None of a polygon that cannot be cut: one narrower than the plane's rounding, or whose ring
    crosses itself in the plane, by rounding.
    """
    try:
        found = shapely.constrained_delaunay_triangles(polygons)
    except shapely.errors.GEOSException:
        if len(polygons) == 1:
            return np.empty(0, np.int64), np.empty((0, 3, 2))
        alone = [_triangles(polygons[i : i + 1])[1] for i in range(len(polygons))]
        return np.repeat(np.arange(len(alone)), [len(one) for one in alone]), np.concatenate(alone)
    triangles, of = shapely.get_parts(found, return_index=True)
    areas = shapely.area(polygons)
    missing = np.abs(np.bincount(of, shapely.area(triangles), len(polygons)) - areas)
    sound = ~is_thread(polygons) & (missing <= TRIANGULATION_AREA_SHARE * areas)
    triangles, of = triangles[sound[of]], of[sound[of]]
    corners = shapely.get_coordinates(shapely.orient_polygons(triangles)).reshape(-1, 4, 2)[:, :3]
    return of.astype(np.int64), corners


def _merged(of: NDArray[np.int64], triangles: Floats) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Return convex parts of polygons, merged from their triangles: polygon of each (n,), sorted, and their rings.

    The rings are the vertices (v, 2) one after the other, and how many each has (n,).

    S. Hertel, K. Mehlhorn, "Fast triangulation of the plane with respect to simple polygons", Information and
    Control 64 (1985), doi:10.1016/S0019-9958(85)80044-9: at most four times the least number of parts.
    """
    if not len(of):
        return of, np.empty((0, 2)), of
    # Corners of one polygon only have one number.
    named = np.column_stack([np.repeat(of, 3), triangles.reshape(-1, 2)])
    points, index = np.unique(named, axis=0, return_inverse=True)
    rings = _merge_convex(points[:, 1:].tolist(), index.reshape(-1, 3).tolist())
    counts = np.array([len(ring) for ring in rings], dtype=np.int64)
    first, vertices = [ring[0] for ring in rings], [vertex for ring in rings for vertex in ring]
    return points[first, 0].astype(np.int64), np.asarray(points[vertices, 1:], np.float64), counts


def _merge_convex(xy: list[list[float]], triangles: list[list[int]]) -> list[list[int]]:
    """Return counter-clockwise rings (indices of xy): triangles joined over shared edges while convex."""
    rings: list[list[int]] = triangles
    edge_of = {(ring[k - 1], ring[k]): r for r, ring in enumerate(rings) for k in range(3)}
    joined = list(range(len(rings)))

    def root(r: int) -> int:
        while joined[r] != r:
            joined[r] = joined[joined[r]]
            r = joined[r]
        return r

    def turns_left(a: int, b: int, c: int) -> bool:
        (ax, ay), (bx, by), (cx, cy) = xy[a], xy[b], xy[c]
        return bool((bx - ax) * (cy - by) - (by - ay) * (cx - bx) >= 0.0)

    for (u, v), mine in list(edge_of.items()):
        other = edge_of.get((v, u))
        if other is None or u > v:
            continue
        p, q = root(mine), root(other)
        if p == q:
            continue
        first, second = rings[p], rings[q]
        at, opposite = first.index(v), second.index(u)
        # first runs ... u, v ...; second runs ... v, u ...: open both at the shared edge.
        chain = first[at:] + first[:at]
        chain_other = second[opposite:] + second[:opposite]
        if turns_left(chain[-2], u, chain_other[1]) and turns_left(chain_other[-2], v, chain[1]):
            rings[p] = chain + chain_other[1:-1]
            joined[q] = p
    return [ring for r, ring in enumerate(rings) if joined[r] == r]
