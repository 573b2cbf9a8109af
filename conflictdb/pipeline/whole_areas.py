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
# Where objects reach in so many directions all around tells most of them apart: (2, 16), unit vectors.
_TURNED = np.arange(16) * np.pi / 8.0
_DIRECTIONS = np.stack([np.cos(_TURNED), np.sin(_TURNED)])


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
    wholes = planar(plane, footprints(numbers))
    corners = np.nan_to_num(shapely.bounds(wholes)).reshape(-1, 2, 2).transpose(2, 1, 0)
    margin = max(scene.tolerance_m, TOUCH_M) * plane.largest_scale(corners)
    # Either member may be the area, and is looked at at several instants.
    areas = np.flatnonzero(pieces.kind[every] == Kind.AREA.code)
    areas, share = np.tile(areas, len(_SHARES)), np.repeat(_SHARES, len(areas))
    whole, row = np.searchsorted(numbers, pieces.object_id[every[areas]]), areas % len(rows)
    zero, _ = pieces.shared_span(*members)
    moves = np.isfinite(contacts.end_s[rows])
    first, last = (np.where(moves, ends[rows], 0.0) for ends in (contacts.start_s, contacts.end_s))
    at = (1.0 - share) * first[row] + share * last[row]
    xy = Movement.of(prepared, PieceRows(np.concatenate(members[::-1])[areas]), zero[row]).positions(at)
    # Shapes are made of those only that may be deep.
    likely = np.flatnonzero(_may_be_deep(plane, wholes, margin, whole, xy))
    likely = likely[~_near_border(wholes[whole[likely]], margin[whole[likely]], xy[:, :, likely])]
    if not likely.size:
        return is_deep
    asked, mine = np.unique(whole[likely], return_inverse=True)
    cores = _cores(wholes[asked], margin[asked])[mine]
    has_core = np.flatnonzero(~shapely.is_empty(cores))
    likely, cores = likely[has_core], cores[has_core]
    is_deep[owner[row[likely[_meet(cores, plane, _polygons(xy[:, :, likely]))]]]] = True
    return is_deep


def _may_be_deep(
    plane: Plane, wholes: NDArray[np.object_], margin: Floats, whole: NDArray[np.int64], xy: Floats
) -> NDArray[np.bool_]:
    """Return (n,) whether polygons may reach deeper into areas of the plane than a margin.

    What is deep in an area is so in every half plane that holds it: where a polygon ends before the area reaches less
    the margin, in one of some directions, no point of it is.

    margin : (m,) of each area, plane metres
    whole : (n,) the area of each polygon
    xy : (2, slots, n) the polygons' vertices; of those that are NaN nothing is ruled out
    """
    corners, of = shapely.get_coordinates(wholes, return_index=True)
    reach = np.full((len(wholes), _DIRECTIONS.shape[1]), -np.inf)
    begins = np.flatnonzero(np.diff(of, prepend=-1))
    reach[of[begins]] = np.maximum.reduceat(corners @ _DIRECTIONS, begins)
    reach -= margin[:, None]
    half = _DIRECTIONS.shape[1] // 2
    is_wide = (reach[:, :half] + reach[:, half:] >= 0.0).all(axis=1)
    # A turn apart or not.
    aways = (-plane.turn_m, 0.0, plane.turn_m) if plane.turn_m else (0.0,)
    beyond = np.zeros((len(aways), len(whole)), np.bool_)
    for along, (x, y) in enumerate(_DIRECTIONS.T):
        nearest = (x * xy[0] + y * xy[1]).min(axis=0)
        for is_beyond, away in zip(beyond, aways, strict=True):
            is_beyond |= nearest + x * away > reach[whole, along]
    return np.asarray(is_wide[whole] & ~beyond.all(axis=0))


def _near_border(wholes: NDArray[np.object_], margin: Floats, xy: Floats) -> NDArray[np.bool_]:
    """Return (n,) whether all of a polygon is nearer to the border of an area of the plane than a margin (n,).

    No point of it is further from the border than its middle is and what it reaches around that.

    xy : (2, slots, n) the polygons' vertices; what is NaN is not
    """
    middle = 0.5 * (xy.min(axis=1) + xy.max(axis=1))
    reach = np.hypot(*(xy - middle[:, None])).max(axis=0)
    with np.errstate(invalid="ignore"):
        from_border = shapely.distance(shapely.boundary(wholes), shapely.points(middle.T))
    return np.asarray(from_border + reach < margin)


def _cores(wholes: NDArray[np.object_], margin: Floats) -> NDArray[np.object_]:
    """Return (n,) what of areas in the plane is deeper than a margin (n,), plane metres."""
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


def _polygons(xy: Floats) -> NDArray[np.object_]:
    """Return (n,) the polygons of vertices (2, slots, n)."""
    xy = xy.transpose(2, 1, 0)
    # A line through all vertices, a single one twice, has their hull, and is made at once.
    return np.asarray(shapely.convex_hull(shapely.linestrings(np.concatenate([xy, xy[:, :1]], axis=1))))
