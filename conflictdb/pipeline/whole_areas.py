"""Whether objects meet deeper than the tolerance in the whole of an area, where they do so in none of its parts.

An area is cut into convex parts that may be narrower than the tolerance, so that nothing is deep in any of them.
"""

from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows
from conflictdb.arrays.ragged import offsets
from conflictdb.kernel.whole import Areas, Depth, whole_depths
from conflictdb.model import Scene
from conflictdb.motion.contract import Plane
from conflictdb.pieces.cutting import planar
from conflictdb.results import Kind
from conflictdb.stage4.constants import TOUCH_M

# Given numbers of areas, returns their footprints (degrees).
Footprints = Callable[[NDArray[np.int64]], NDArray[np.object_]]


def deep_in_whole_areas(
    scene: Scene,
    plane: Plane,
    prepared: kernel.Scene,
    pairs: Pairs,
    contacts: Contacts,
    footprints: Footprints,
) -> NDArray[np.int8]:
    """Return (n,) how deep contacts are in the whole of an area of which they are with a part, `Depth`.

    They are looked at where they begin, in their middle and where they end.

    prepared : the pieces of the pairs
    contacts : (n,) that are shallow in every part; of those without an area none is deep
    """
    pieces = prepared.pieces
    a, b = (PieceRows(member[contacts.pair]) for member in (pairs.a, pairs.b))
    # Either member may be the area, or both.
    is_b, row = np.nonzero(pieces.kind[np.stack([a, b])] == Kind.AREA.code)
    part = np.where(is_b == 1, b[row], a[row])
    numbers, area = np.unique(pieces.object_id[part], return_inverse=True)
    depth = np.full(len(contacts), Depth.SHALLOW, np.int8)
    if not len(numbers):
        return depth
    start_us, _ = pieces.shared_span(a, b)
    moves = np.isfinite(contacts.end_s)
    low_s, high_s = (np.where(moves, ends, 0.0)[row] for ends in (contacts.start_s, contacts.end_s))
    wholes = planar(plane, footprints(numbers))
    areas, east_m = _areas(scene, plane, wholes), np.zeros(len(part))
    if plane.turn_m:
        # Parts may be copies of what is a turn away.
        corner = pieces.shape_offset[part][:, None] + np.arange(3)
        x = pieces.shape_xy[corner, 0].mean(axis=1) + plane.turn_m * pieces.turn[part]
        west, _, east, _ = shapely.bounds(wholes[area]).T
        east_m = plane.turn_m * np.round((x - 0.5 * (west + east)) / plane.turn_m)
    found = whole_depths(prepared, a[row], b[row], start_us[row], low_s, high_s, areas, area, is_b == 1, east_m)
    for known in (Depth.UNKNOWN, Depth.DEEP):
        depth[row[found == known]] = known
    return depth


def _areas(scene: Scene, plane: Plane, wholes: NDArray[np.object_]) -> Areas:
    """Return areas of the plane, with what is beyond the tolerance also where the scale is largest."""
    parts, of_area = shapely.get_parts(wholes, return_index=True)
    rings, of_part = shapely.get_rings(parts, return_index=True)
    xy, of_ring = shapely.get_coordinates(rings, return_index=True)
    corners = np.nan_to_num(shapely.bounds(wholes)).reshape(-1, 2, 2).transpose(2, 1, 0)
    margin = max(scene.tolerance_m, TOUCH_M) * plane.largest_scale(corners)
    ring_offset = offsets(np.bincount(of_ring, minlength=len(rings)))
    return Areas(xy, ring_offset, offsets(np.bincount(of_area[of_part], minlength=len(wholes))), margin)
