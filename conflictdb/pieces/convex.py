"""Polygons of the plane cut into convex parts."""

from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.motion.contract import ROUNDING_ALLOWANCE_M

# A polygon is convex if its hull is larger by at most this share of its area: dents less than a micrometre deep, in
# areas up to 1,000 km across.
CONVEX_AREA_SHARE: Final = 1e-13
# Share of an area that its triangles may lack or exceed by rounding.
TRIANGULATION_AREA_SHARE: Final = 1e-9


def is_thread(polygon: shapely.Geometry) -> bool:
    """Return whether a polygon is narrower than the plane's rounding: it may then look invalid without being so."""
    return bool(shapely.oriented_envelope(polygon).area <= ROUNDING_ALLOWANCE_M * max(polygon.length, 1.0))


def convex_parts(flat: NDArray[np.object_]) -> tuple[NDArray[np.int64], list[Floats]]:
    """Return for each convex part the row of its polygon (sorted), and its open ring, counter-clockwise."""
    polygons, owner = shapely.get_parts(flat, return_index=True)
    hulls = shapely.convex_hull(polygons)
    whole = shapely.get_num_interior_rings(polygons) == 0
    whole &= shapely.area(hulls) <= shapely.area(polygons) * (1.0 + CONVEX_AREA_SHARE)
    whole |= shapely.get_dimensions(hulls) < 2
    rings: list[Floats] = []
    owners: list[int] = []
    for polygon, hull, is_convex, row in zip(polygons, hulls, whole, owner, strict=True):
        parts = [hull] if is_convex else _split(polygon, hull)
        for part in parts:
            rings.append(_open_ring(part))
            owners.append(row)
    return np.array(owners, dtype=np.int64), rings


def _open_ring(part: shapely.Geometry | Floats) -> Floats:
    if isinstance(part, np.ndarray):
        return part
    if part.geom_type == "Polygon":
        return np.asarray(shapely.get_coordinates(shapely.orient_polygons(part))[:-1])
    return np.asarray(shapely.get_coordinates(part))


def _split(polygon: shapely.Polygon, hull: shapely.Geometry) -> list[shapely.Geometry | Floats]:
    """Return convex parts that cover a polygon: its constrained Delaunay triangles, merged while convex.

    S. Hertel, K. Mehlhorn, "Fast triangulation of the plane with respect to simple polygons", Information and
    Control 64 (1985), doi:10.1016/S0019-9958(85)80044-9: at most four times the least number of parts.
    """
    try:
        triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    except shapely.errors.GEOSException:  # a ring that crosses itself in the plane, by rounding
        return [hull]
    missing = abs(float(shapely.area(triangles).sum()) - polygon.area)
    if is_thread(polygon) or missing > TRIANGULATION_AREA_SHARE * polygon.area:
        # A polygon narrower than the plane's rounding cannot be cut reliably. Its hull is taken, so that nothing is
        # missed.
        return [hull]
    corners = shapely.get_coordinates(shapely.orient_polygons(triangles)).reshape(-1, 4, 2)[:, :3]
    points, index = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return [points[ring] for ring in _merge_convex(points, index.reshape(-1, 3).tolist())]


def _merge_convex(points: Floats, triangles: list[list[int]]) -> list[list[int]]:
    """Return counter-clockwise rings (indices of points): triangles joined over shared edges while convex."""
    xy = points.tolist()
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
