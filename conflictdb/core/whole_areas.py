"""Test whether objects overlap a whole area by more than the tolerance if they do so in none of its parts.

An area is cut into convex parts, which may be narrower than the tolerance: then no overlap with a part is deep.
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
from conflictdb.core.pieces.cutting import planar
from conflictdb.core.stage4.constants import TOUCH_M
from conflictdb.earth.registry import Setup
from conflictdb.kernel.whole import Areas, Depth, whole_depths
from conflictdb.model.results import Kind

# Given numbers of areas, returns their footprints (degrees).
Footprints = Callable[[NDArray[np.int64]], NDArray[np.object_]]


def deep_in_whole_areas(
    setup: Setup,
    prepared: kernel.KernelScene,
    pairs: Pairs,
    contacts: Contacts,
    footprints: Footprints,
) -> NDArray[np.int8]:
    """Return (n,) the `Depth` of contacts with a part in the whole area, at their start, middle and end.

    prepared : the pieces of the pairs
    contacts : (n,) shallow in every part; a contact without an area is never deep
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
    wholes = planar(setup.plane, footprints(numbers))
    areas, east_m = areas_of(setup, wholes), np.zeros(len(part))
    if setup.plane.turn_m:
        # Parts may be copies, a turn away.
        corner = pieces.shape_offset[part][:, None] + np.arange(3)
        x = pieces.shape_xy[corner, 0].mean(axis=1) + setup.plane.turn_m * pieces.turn[part]
        west, _, east, _ = shapely.bounds(wholes[area]).T
        east_m = setup.plane.turn_m * np.round((x - 0.5 * (west + east)) / setup.plane.turn_m)
    found = whole_depths(prepared, a[row], b[row], start_us[row], low_s, high_s, areas, area, is_b == 1, east_m)
    for known in (Depth.UNKNOWN, Depth.DEEP):
        depth[row[found == known]] = known
    return depth


def areas_of(setup: Setup, wholes: NDArray[np.object_]) -> Areas:
    """Return areas of the plane, with a margin that exceeds the tolerance also at the largest scale."""
    parts, of_area = shapely.get_parts(wholes, return_index=True)
    rings, of_part = shapely.get_rings(parts, return_index=True)
    xy, of_ring = shapely.get_coordinates(rings, return_index=True)
    corners = np.nan_to_num(shapely.bounds(wholes)).reshape(-1, 2, 2).transpose(2, 1, 0)
    margin = max(setup.scene.tolerance_m, TOUCH_M) * setup.plane.largest_scale(corners)
    ring_offset = offsets(np.bincount(of_ring, minlength=len(rings)))
    return Areas(xy, ring_offset, offsets(np.bincount(of_area[of_part], minlength=len(wholes))), margin)
