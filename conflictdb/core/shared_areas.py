"""Intersect two areas of many parts: as whole areas, not as thousands of pairs of parts."""

from contextlib import suppress
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.earth.plane import Plane

# An area may differ from the sum of its parts by this share, by rounding; by more if the parts overlap.
_AREA_SHARE: Final = 1e-9
# Corners are snapped to a grid of a micrometre. Without it a union of sides that differ by rounding lost whole parts
# without an error (GEOS 3.14.1; four parts: a tenth of the area).
_GRID_M: Final = 1e-6
# Metres: rounding to degrees moves corners by 1e-8. The kernel's regions are wider than this, too (LEAST_SIDE_M).
_LEAST_WIDTH_M: Final = 1e-7
# The kernel grows disjoint polygons by at least this much, metres.
_GROWN_M: Final = 4e-6


def common_area(plane: Plane, pieces: Pieces, a: PieceRows, b: PieceRows) -> shapely.Geometry:
    """Return the intersection of an area's parts a and another's parts b: plane metres, within half a turn."""
    found = shapely.intersection(*(_whole(plane, pieces, np.unique(rows)) for rows in (a, b)), grid_size=_GRID_M)
    return _home(plane, _wide(shapely.get_parts(found)))


def united(parts: NDArray[np.object_], stand: NDArray[np.bool_]) -> NDArray[np.object_]:
    """Return the unions (n,) of polygons (n, k), to a micrometre.

    stand : (n,) whether they are of two areas. A grid then keeps parts that rounding puts next to each other.
    """
    unions = np.full(len(parts), None, dtype=object)
    unions[~stand] = shapely.union_all(parts[~stand], axis=1)
    with_grid = np.flatnonzero(stand | _lack_something(unions, parts))
    unions[with_grid] = shapely.union_all(parts[with_grid], axis=1, grid_size=_GRID_M)
    # Parts that are narrower than the grid are kept.
    gone = np.flatnonzero(shapely.is_empty(unions))
    unions[gone] = shapely.union_all(parts[gone], axis=1)
    return unions


def _lack_something(unions: NDArray[np.object_], parts: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Return (n,) whether a union is smaller than a part, or has another box than all parts."""
    low, high = np.split(shapely.bounds(parts), 2, axis=-1)
    box = np.concatenate([low.min(axis=1), high.max(axis=1)], axis=1)
    is_other = (np.abs(shapely.bounds(unions) - box) > _GRID_M).any(axis=1)
    return np.asarray(is_other | (shapely.area(unions) < shapely.area(parts).max(axis=1) * (1.0 - _AREA_SHARE)))


def beyond(plane: Plane, common: shapely.Geometry, parts: NDArray[np.object_], distance_m: float) -> NDArray[np.int64]:
    """Return which of some parts are not within a distance, metres on the earth, of what areas have in common."""
    if shapely.is_empty(common) or not len(parts):
        return np.arange(len(parts))
    corners = shapely.bounds(common).reshape(2, 2, 1).transpose(1, 0, 2)
    margin_m = distance_m * float(plane.smallest_scale(corners)[0])
    # Corners are cut off a little: then more parts are outside, which does no harm.
    around = shapely.buffer(common, margin_m + _GROWN_M, quad_segs=2)
    shapely.prepare(around)
    return np.flatnonzero(~shapely.covers(around, parts))


def _whole(plane: Plane, pieces: Pieces, rows: NDArray[np.int64]) -> shapely.Geometry:
    """Return parts of one area put together."""
    rows = rows[np.diff(pieces.shape_offset)[rows] > 2]
    # Wherever pieces come from: the result begins at the same corner.
    rows = rows[np.lexsort((pieces.part[rows], pieces.turn[rows]))]
    offset, index = ragged_rows(pieces.shape_offset, rows)
    count = np.diff(offset)
    of = np.repeat(np.arange(len(rows)), count)
    xy: Floats = pieces.shape_xy[index] + np.stack([plane.turn_m * pieces.turn[rows][of], np.zeros(len(of))], axis=1)
    parts = shapely.polygons(shapely.linearrings(xy, indices=of))
    # Parts of a cut object have the same corners where they meet. Those of an object that cannot be cut are hulls,
    # which may overlap; corners that differ by rounding are no coverage either, and GEOS then raises an error.
    with suppress(shapely.errors.GEOSException):
        whole = shapely.coverage_union_all(parts)
        area = shapely.area(parts).sum()
        if shapely.is_valid(whole) and abs(shapely.area(whole) - area) <= _AREA_SHARE * area:
            return whole
    return shapely.union_all(parts, grid_size=_GRID_M)


def _wide(parts: NDArray[np.object_]) -> shapely.Geometry:
    """Return those of some parts that are polygons wider than rounding."""
    is_wide = shapely.area(parts) > _LEAST_WIDTH_M * shapely.length(parts)
    return shapely.multipolygons(parts[is_wide])


def _home(plane: Plane, common: shapely.Geometry) -> shapely.Geometry:
    """Return polygons of the plane within half a turn, cut at the seam where they cross it."""
    half_m = 0.5 * plane.turn_m
    west, south, east, north = shapely.bounds(common)
    if not plane.turn_m or shapely.is_empty(common) or (west >= -half_m and east <= half_m):
        return common
    parts = []
    for turn in range(round(west / plane.turn_m), round(east / plane.turn_m) + 1):
        at_m = plane.turn_m * turn
        box = shapely.box(at_m - half_m, south - 1.0, at_m + half_m, north + 1.0)
        part = _wide(shapely.get_parts(shapely.intersection(common, box, grid_size=_GRID_M)))
        parts.append(
            shapely.transform(part, lambda xy, by=at_m: np.clip(xy - (by, 0.0), (-half_m, south), (half_m, north)))
        )
    return shapely.union_all(parts, grid_size=_GRID_M)
