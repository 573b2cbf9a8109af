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
    wholes = planar(plane, footprints(numbers)) if len(numbers) else np.empty(0, dtype=object)
    cores = np.array([_core(scene, plane, whole) for whole in wholes], dtype=object)
    shapely.prepare(cores)
    zero, _ = pieces.shared_span(*members)
    moves = np.isfinite(contacts.end_s[rows])
    first, last = (np.where(moves, ends[rows], 0.0) for ends in (contacts.start_s, contacts.end_s))
    is_deep = np.zeros(len(contacts_of), np.bool_)
    for share in _SHARES:
        at = (1.0 - share) * first + share * last
        for area, other in (members, members[::-1]):
            asked = np.flatnonzero((pieces.kind[area] == Kind.AREA.code) & ~is_deep[owner])
            mine = cores[np.searchsorted(numbers, pieces.object_id[area[asked]])]
            reaches = _meet(mine, plane, _polygons(prepared, PieceRows(other[asked]), at[asked], zero[asked]))
            is_deep[owner[asked[reaches]]] = True
    return is_deep


def _core(scene: Scene, plane: Plane, whole: shapely.Geometry) -> shapely.Geometry:
    """Return what of an area in the plane is deeper than the tolerance."""
    if whole.is_empty:
        return whole
    corners = np.array(whole.bounds).reshape(2, 2).T[:, :, None]
    margin = max(scene.tolerance_m, TOUCH_M) * float(plane.largest_scale(corners)[0])
    return shapely.buffer(whole, -margin, join_style="mitre")


def _meet(cores: NDArray[np.object_], plane: Plane, polygons: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Return (n,) whether geometries of the plane meet, a turn apart or not."""
    meet = np.zeros(len(cores), np.bool_)
    for turn in (-1, 0, 1) if plane.turn_m else (0,):
        away = np.array([turn * plane.turn_m, 0.0])
        meet |= shapely.intersects(cores, shapely.transform(polygons, lambda xy, away=away: xy + away))
    return meet


def _polygons(prepared: kernel.Scene, rows: PieceRows, at_s: Floats, zero_us: NDArray[np.int64]) -> NDArray[np.object_]:
    """Return (n,) the polygons of pieces in the plane, at_s seconds after zero_us."""
    xy = Movement.of(prepared, rows, zero_us).positions(at_s)
    indices = np.repeat(np.arange(len(rows)), xy.shape[1])
    return np.asarray(shapely.convex_hull(shapely.multipoints(xy.transpose(2, 1, 0).reshape(-1, 2), indices=indices)))
