"""Cut polygons of the plane into convex parts."""

from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.ragged import offsets, ragged_take
from conflictdb.earth.plane import ROUNDING_ALLOWANCE_M

# A polygon counts as convex if its hull is larger by at most this share of its area. Its dents are then less than a
# micrometre deep, in areas up to 1,000 km across.
CONVEX_AREA_SHARE: Final = 1e-13
# Rounding error of the total area of triangles, relative.
TRIANGULATION_AREA_SHARE: Final = 1e-9


def is_thread(polygons: shapely.Geometry | NDArray[np.object_]) -> NDArray[np.bool_]:
    """Return whether polygons are narrower than the plane's rounding, and may therefore look invalid."""
    narrow = shapely.area(shapely.oriented_envelope(polygons))
    return np.asarray(narrow <= ROUNDING_ALLOWANCE_M * np.maximum(shapely.length(polygons), 1.0))


def convex_parts(flat: NDArray[np.object_]) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Return the convex parts of polygons: row of the polygon (n,), sorted, and open rings, counter-clockwise.

    The rings are ragged: vertices (v, 2), offset (n + 1,).
    """
    polygons, polygon_of = shapely.get_parts(flat, return_index=True)
    hulls = shapely.convex_hull(polygons)
    whole = shapely.get_num_interior_rings(polygons) == 0
    whole &= shapely.area(hulls) <= shapely.area(polygons) * (1.0 + CONVEX_AREA_SHARE)
    whole |= shapely.get_dimensions(hulls) < 2
    dented = np.flatnonzero(~whole)
    if not dented.size:
        xy, count = _rings(hulls)
        return polygon_of.astype(np.int64), xy, offsets(count)
    of_triangle, triangles = _triangles(polygons[dented])
    cut = np.unique(of_triangle)
    # A polygon that cannot be triangulated reliably is replaced by its hull, so that nothing is missed.
    left = np.delete(np.arange(len(polygons)), dented[cut])
    corner, ring_offset = kernel.convex_parts(triangles, of_triangle)
    ring_xy, of_ring, ring_count = (
        triangles.reshape(-1, 2)[corner],
        of_triangle[corner[ring_offset[:-1]] // 3],
        np.diff(ring_offset),
    )
    hull_xy, hull_count = _rings(hulls[left])
    part = np.concatenate([left, dented[of_ring]])
    order = np.argsort(part, kind="stable")
    xy = np.concatenate([hull_xy, ring_xy])
    taken, offset = ragged_take(offsets(np.concatenate([hull_count, ring_count])), xy, order)
    return polygon_of[part[order]].astype(np.int64), taken, offset


def _rings(hulls: NDArray[np.object_]) -> tuple[Floats, NDArray[np.int64]]:
    """Return the corners of convex hulls (v, 2), counter-clockwise, and the number of each hull's."""
    xy, of = shapely.get_coordinates(shapely.orient_polygons(hulls), return_index=True)
    # Polygons repeat their first corner at the end; lines and points do not.
    is_last = np.append(of[1:] != of[:-1], True) & (shapely.get_dimensions(hulls) == 2)[of]
    return xy[~is_last], np.bincount(of[~is_last], minlength=len(hulls))


def _triangles(polygons: NDArray[np.object_]) -> tuple[NDArray[np.int64], Floats]:
    """Return the constrained Delaunay triangles of polygons: polygon of each (t,), sorted, corners (t, 3, 2).

    Counter-clockwise. A polygon that cannot be cut, because of rounding in the plane, has none.
    """
    try:
        found = shapely.constrained_delaunay_triangles(polygons)
    except shapely.errors.GEOSException:
        if len(polygons) == 1:
            return np.empty(0, np.int64), np.empty((0, 3, 2))
        alone = [_triangles(polygons[i : i + 1])[1] for i in range(len(polygons))]
        return np.repeat(np.arange(len(alone)), [len(one) for one in alone]), np.concatenate(alone)
    triangles, of = shapely.get_parts(found, return_index=True)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    doubled = ax * by - ay * bx
    corners = np.where((doubled < 0.0)[:, None, None], corners[:, ::-1], corners)
    areas = shapely.area(polygons)
    missing = np.abs(np.bincount(of, 0.5 * np.abs(doubled), len(polygons)) - areas)
    sound = ~is_thread(polygons) & (missing <= TRIANGULATION_AREA_SHARE * areas)
    return of[sound[of]].astype(np.int64), corners[sound[of]]
