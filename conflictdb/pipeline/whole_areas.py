"""Whether objects meet deeper than the tolerance in the whole of an area, where they do so in none of its parts.

An area is cut into convex parts that may be narrower than the tolerance, so that nothing is deep in any of them.
"""

from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.movement import Movement
from conflictdb.model import Scene
from conflictdb.motion.contract import Plane
from conflictdb.pieces.cutting import planar
from conflictdb.results import Kind
from conflictdb.stage4.constants import TOUCH_M

# Given numbers of areas, returns their footprints (degrees).
Footprints = Callable[[NDArray[np.int64]], NDArray[np.object_]]

# Contacts are looked at where they begin, in their middle and where they end.
_SHARES = (0.0, 0.5, 1.0)


def deep_in_whole_areas(
    scene: Scene,
    plane: Plane,
    prepared: kernel.Scene,
    pairs: Pairs,
    contacts: Contacts,
    contacts_of: list[NDArray[np.int64]],
    footprints: Footprints,
) -> NDArray[np.bool_]:
    """Return (n,) which pairs of objects are deep in the whole of an area, whose contacts are shallow in every part.

    prepared : the pieces of the pairs
    contacts_of : for each pair of objects the rows of its contacts
    """
    pieces = prepared.pieces
    rows = np.concatenate([np.empty(0, np.int64), *contacts_of])
    owner = np.repeat(np.arange(len(contacts_of)), [len(mine) for mine in contacts_of])
    pair = PairRows(contacts.pair[rows])
    members = PieceRows(pairs.a[pair]), PieceRows(pairs.b[pair])
    every = np.concatenate(members)
    numbers = np.unique(pieces.object_id[every[pieces.kind[every] == Kind.AREA.code]])
    is_deep = np.zeros(len(contacts_of), np.bool_)
    if not len(numbers):
        return is_deep
    cores = _cores(scene, plane, planar(plane, footprints(numbers)))
    # Either member may be the area, and is looked at at several instants, if there is anything deep in it.
    areas = np.flatnonzero(pieces.kind[every] == Kind.AREA.code)
    core = np.searchsorted(numbers, pieces.object_id[every[areas]])
    has_core = ~shapely.is_empty(cores)[core]
    areas, core = areas[has_core], core[has_core]
    if not areas.size:
        return is_deep
    zero, _ = pieces.shared_span(*members)
    moves = np.isfinite(contacts.end_s[rows])
    first, last = (np.where(moves, ends[rows], 0.0) for ends in (contacts.start_s, contacts.end_s))
    asked, share = np.tile(areas, len(_SHARES)), np.repeat(_SHARES, len(areas))
    row, other = asked % len(rows), PieceRows(np.concatenate(members[::-1])[asked])
    at = (1.0 - share) * first[row] + share * last[row]
    mine = cores[np.tile(core, len(_SHARES))]
    is_deep[owner[row[_meet(mine, plane, _polygons(prepared, other, at, zero[row]))]]] = True
    return is_deep


def _cores(scene: Scene, plane: Plane, wholes: NDArray[np.object_]) -> NDArray[np.object_]:
    """Return (n,) what of areas in the plane is deeper than the tolerance."""
    corners = np.nan_to_num(shapely.bounds(wholes)).reshape(-1, 2, 2).transpose(2, 1, 0)
    margin = max(scene.tolerance_m, TOUCH_M) * plane.largest_scale(corners)
    cores = np.full(len(wholes), shapely.Polygon(), np.object_)
    # What is deep is the middle of a disc within the area.
    wide = np.flatnonzero(shapely.area(wholes) >= np.pi * margin**2)
    cores[wide] = shapely.buffer(wholes[wide], -margin[wide], join_style="mitre")
    shapely.prepare(cores)
    return np.asarray(cores)


def _meet(cores: NDArray[np.object_], plane: Plane, polygons: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Return (n,) whether geometries of the plane meet, a turn apart or not."""
    meet = np.asarray(shapely.intersects(cores, polygons))
    west, _, east, _ = shapely.bounds(polygons).T
    first, _, last, _ = shapely.bounds(cores).T
    for away in (-plane.turn_m, plane.turn_m) if plane.turn_m else ():
        near = np.flatnonzero((west + away <= last) & (first <= east + away) & ~meet)
        if near.size:
            moved = shapely.transform(polygons[near], lambda xy, away=away: xy + np.array([away, 0.0]))
            meet[near] = shapely.intersects(cores[near], moved)
    return meet


def _polygons(prepared: kernel.Scene, rows: PieceRows, at_s: Floats, zero_us: NDArray[np.int64]) -> NDArray[np.object_]:
    """Return (n,) the polygons of pieces in the plane, at_s seconds after zero_us."""
    xy = Movement.of(prepared, rows, zero_us).positions(at_s).transpose(2, 1, 0)
    # A line through all vertices, a single one twice, has their hull, and is made at once.
    return np.asarray(shapely.convex_hull(shapely.linestrings(np.concatenate([xy, xy[:, :1]], axis=1))))
