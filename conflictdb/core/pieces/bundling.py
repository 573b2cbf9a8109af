"""Bundle pieces: one row of the database stores and indexes several pieces.

Storing and probing a row costs about 40 us; comparing two boxes in memory, a few ns. Nearby pieces of an object
therefore share a row with one bounding box: the parts of an area, and slices of a slow track.
"""

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Bundles, Pieces
from conflictdb.kernel.bundles import bundles
from conflictdb.model.results import Kind


def bundles_of(pieces: Pieces) -> Bundles:
    """Return all pieces in bundles; the pieces of an object must be in the order of `pieces_of`."""
    return bundles(pieces, np.cumsum(_begins_run(pieces)))


def _begins_run(pieces: Pieces) -> NDArray[np.bool_]:
    """Return (n,) whether a piece must not share a bundle with the one before it."""
    together = np.ones(max(len(pieces) - 1, 0), np.bool_)
    for column in (pieces.kind, pieces.object_id, pieces.turn, pieces.floor_m, pieces.ceiling_m):
        together &= column[1:] == column[:-1]
    if pieces.climbs().any():
        # A bundle has one band of heights.
        level = ~pieces.climbs()
        together &= level[1:] & level[:-1]
    # A bundle of slices has one outline, and stores only the start of each slice.
    follows = (pieces.part[1:] == pieces.part[:-1] + 1) & (pieces.start_us[1:] == pieces.end_us[:-1])
    follows &= pieces.end_inclusive[:-1] & _same_outline(pieces)
    # A bundle of an area's parts has one span.
    same_span = (pieces.start_us[1:] == pieces.start_us[:-1]) & (pieces.end_us[1:] == pieces.end_us[:-1])
    together &= np.where(pieces.kind[1:] == Kind.AREA.code, same_span, follows)
    return np.append(True, ~together)[: len(pieces)]


def _same_outline(pieces: Pieces) -> NDArray[np.bool_]:
    """Return (n - 1,) whether a piece has the same constant outline as the one before it."""
    offset = pieces.shape_offset
    if len(pieces) < 2:
        return np.ones(0, np.bool_)
    count = np.diff(offset)
    alike = count[1:] == count[:-1]
    # Compare each vertex with the same vertex of the piece before; with itself if there is none.
    back = np.repeat(np.append(0, np.where(alike, count[1:], 0)), count)
    equal = (pieces.shape_xy == pieces.shape_xy[np.arange(offset[-1]) - back]).all(axis=1)
    alike &= np.logical_and.reduceat(equal, offset[:-1])[1:]
    if pieces.changes:
        stays = ~pieces.changed()
        alike &= stays[1:] & stays[:-1]
    return alike
