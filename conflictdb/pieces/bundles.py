"""Bundles of pieces: what a database stores, indexes and compares as one.

A row and a look into its index cost a database some forty microseconds, a comparison of two boxes in memory
nanoseconds. So pieces of an object that lie near each other share a row, with one box around all of them: the parts of
an area, and slices of a track that moves little. Stage 1 finds pairs of bundles, and then pairs of their pieces.
"""

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Bundles, Pieces
from conflictdb.kernel.bundles import bundles
from conflictdb.results import Kind


def bundles_of(pieces: Pieces) -> Bundles:
    """Return pieces in bundles: all of them, each once; those of an object as `pieces_of` makes them."""
    return bundles(pieces, np.cumsum(_begins_run(pieces)))


def _begins_run(pieces: Pieces) -> NDArray[np.bool_]:
    """Return (n,) whether a piece must not go with the one before it."""
    together = np.ones(max(len(pieces) - 1, 0), np.bool_)
    for column in (pieces.kind, pieces.object_id, pieces.turn, pieces.floor_m, pieces.ceiling_m):
        together &= column[1:] == column[:-1]
    # A bundle of slices has one outline, and their times by where each begins.
    follows = (pieces.part[1:] == pieces.part[:-1] + 1) & (pieces.start_us[1:] == pieces.end_us[:-1])
    follows &= pieces.end_inclusive[:-1] & _same_outline(pieces)
    together &= (pieces.kind[1:] == Kind.AREA.code) | follows
    return np.append(True, ~together)[: len(pieces)]


def _same_outline(pieces: Pieces) -> NDArray[np.bool_]:
    """Return (n - 1,) whether a piece and the one before it have one shape, at both ends of their legs."""
    offset = pieces.shape_offset
    if len(pieces) < 2:
        return np.ones(0, np.bool_)
    count = np.diff(offset)
    alike = count[1:] == count[:-1]
    # Each vertex beside that of the same number of the piece before; beside itself where there is none.
    back = np.repeat(np.append(0, np.where(alike, count[1:], 0)), count)
    equal = (pieces.shape_xy == pieces.shape_xy[np.arange(offset[-1]) - back]).all(axis=1)
    alike &= np.logical_and.reduceat(equal, offset[:-1])[1:]
    if pieces.changes:
        stays = np.logical_and.reduceat((pieces.shape_xy == pieces.shape_to_xy).all(axis=1), offset[:-1])
        alike &= stays[1:] & stays[:-1]
    return alike
