"""Extend regions to cover a place, and place the regions of several parts in their rows."""

from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.polygons import SRID, Polygons
from conflictdb.arrays.ragged import offsets
from conflictdb.kernel.rows import interleaved

# Half the width of the strip from a region to a point of contact outside of it, degrees: 0.1 mm.
_WAY_DEG: Final = 1e-9


def covering(found: Polygons, place_deg: Floats) -> Polygons:
    """Return regions (n,) that each cover a place (ST_Covers is true); NaN: the place is unknown.

    A place may lie outside of its region because sides bend, or by rounding. It becomes a corner of the region.
    """
    asked = np.flatnonzero((np.diff(found.offset) > 0) & np.isfinite(place_deg).all(axis=1))
    region, place = found.take(asked).geometries(), shapely.points(place_deg[asked])
    beyond = np.flatnonzero(~shapely.covers(region, place))
    if not len(beyond):
        return found
    asked, region, place = asked[beyond], region[beyond], place[beyond]
    result = _with_corner(region, shapely.get_coordinates(place))
    left = np.flatnonzero(~(shapely.is_valid(result) & shapely.covers(result, place)))
    way = shapely.buffer(shapely.shortest_line(region[left], place[left]), _WAY_DEG, quad_segs=1)
    at = shapely.buffer(place[left], _WAY_DEG, quad_segs=1)
    world = shapely.box(-180.0, -90.0, 180.0, 90.0)
    result[left] = shapely.intersection(shapely.union_all(np.array([region[left], way, at]), axis=0), world)
    kept = np.setdiff1d(np.arange(len(found)), asked)
    return placed(len(found), (kept, found.take(kept)), (asked, Polygons.of(shapely.set_srid(result, SRID))))


def _with_corner(region: NDArray[np.object_], place_deg: Floats) -> NDArray[np.object_]:
    """Return polygons (n,), each with a place inserted as a corner of the nearest side; None for several rings."""
    made = np.full(len(region), None, dtype=object)
    is_polygon = shapely.get_type_id(region) == shapely.GeometryType.POLYGON
    plain = np.flatnonzero(is_polygon & (shapely.get_num_interior_rings(region) == 0))
    if not len(plain):
        return made
    xy, of = shapely.get_coordinates(region[plain], return_index=True)
    place = place_deg[plain]
    to_east = np.cos(np.radians(place[of, 1]))
    side = np.roll(xy, -1, axis=0) - xy
    to_place = place[of] - xy
    for one in (side, to_place):
        one[:, 0] *= to_east
    along = (side * to_place).sum(axis=1) / np.maximum((side**2).sum(axis=1), np.finfo(float).tiny)
    apart = to_place - np.clip(along, 0.0, 1.0)[:, None] * side
    distance = (apart**2).sum(axis=1)
    # Between the last corner and the next ring's first there is no side.
    distance[np.append(of[1:] != of[:-1], True)] = np.inf
    nearest = np.lexsort((distance, of))[np.searchsorted(of, np.arange(len(plain)))]
    more, of = np.insert(xy, nearest + 1, place, axis=0), np.insert(of, nearest + 1, np.arange(len(plain)))
    made[plain] = shapely.polygons(shapely.linearrings(more, indices=of))
    return made


def placed(n: int, *parts: tuple[NDArray[np.int64], Polygons]) -> Polygons:
    """Return n polygons: those of each part in its rows (k,); all other rows are unknown."""
    sizes = np.zeros((len(parts), n), np.int64)
    for size, (rows, some) in zip(sizes, parts, strict=True):
        size[rows] = np.diff(some.offset)
    data = interleaved([(some.data, offsets(size)) for size, (_, some) in zip(sizes, parts, strict=True)])
    return Polygons(data, offsets(sizes.sum(axis=0)))
