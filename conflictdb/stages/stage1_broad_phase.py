"""Stage 1 in memory: the pairs of pieces whose boxes meet in space, time and height, for `solve`.

By the predicates of `sql/20_stage1_broad_phase.sql`, which does it for rows of pieces in the database, and leaves those
of a bundle to the kernel; both find the same pairs.
"""

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.pieces import PieceRows, Pieces


def candidates(pieces: Pieces) -> tuple[PieceRows, PieceRows]:
    """Return rows (a, b) of the pairs of pieces whose boxes meet, ordered, each pair once; never two of one object."""
    hulls = hulls_of(pieces)
    a, b = shapely.STRtree(hulls).query(hulls)
    earlier = (pieces.kind[a] < pieces.kind[b]) | (
        (pieces.kind[a] == pieces.kind[b]) & (pieces.object_id[a] < pieces.object_id[b])
    )
    a, b = pairs_together(pieces, PieceRows(a[earlier]), PieceRows(b[earlier]))
    order = np.lexsort((b, a))
    return PieceRows(a[order]), PieceRows(b[order])


def pairs_together(pieces: Pieces, a: PieceRows, b: PieceRows) -> tuple[PieceRows, PieceRows]:
    """Return those of some pairs that share time and heights; of two seam copies the originals do."""
    keep = (pieces.turn[a] == 0) | (pieces.turn[b] == 0)
    keep &= (pieces.floor_m[a] < pieces.ceiling_m[b]) & (pieces.floor_m[b] < pieces.ceiling_m[a])
    a, b = PieceRows(a[keep]), PieceRows(b[keep])
    keep = is_together(pieces, a, b)
    return PieceRows(a[keep]), PieceRows(b[keep])


def is_together(pieces: Pieces, a: PieceRows, b: PieceRows) -> NDArray[np.bool_]:
    """Return (n,) whether pieces a and b share time."""
    start, end = pieces.shared_span(a, b)
    last = np.ones(len(a), np.bool_)
    for member in (a, b):
        last &= (pieces.end_us[member] > end) | pieces.end_inclusive[member]
    return np.asarray((start < end) | ((start == end) & last))


def hulls_of(pieces: Pieces) -> NDArray[np.object_]:
    """Return the hulls of pieces (n,), polygons of the plane."""
    owner = np.repeat(np.arange(len(pieces)), np.diff(pieces.hull_offset))
    return np.asarray(shapely.polygons(shapely.linearrings(pieces.hull_xy, indices=owner)))
