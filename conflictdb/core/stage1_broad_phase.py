"""Stage 1 in memory: the pairs of pieces whose boxes meet in space, time and height, for `solve`.

By the rule of the kernel (`kernel.boxes.may_meet`). The database has the same rule for rows of pieces, and leaves those
of a bundle to the kernel; both find the same pairs.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.kernel.boxes import RowBoxes, may_meet

# Pieces of a slice of time. Slices are used if they and the pieces alive in each are at most this multiple of all.
_SLICE: Final = 1_000
_MOST_ALIVE: Final = 4


def candidates(pieces: Pieces) -> tuple[PieceRows, PieceRows]:
    """Return rows (a, b) of the pairs of pieces whose boxes meet, ordered, each pair once; never two of one object."""
    hulls = hulls_of(pieces)
    found = [_pairs_in_order(pieces, a, b) for a, b in _meeting(pieces, hulls)]
    a, b = (np.concatenate([pair[i] for pair in found] or [np.empty(0, np.intp)]) for i in (0, 1))
    order = np.lexsort((b, a))
    return PieceRows(a[order]), PieceRows(b[order])


def _meeting(pieces: Pieces, hulls: NDArray[np.object_]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield rows (a, b) of all pairs of pieces whose boxes meet in space, in either order, in parts.

    An area that recurs has a piece for each activation, all in one place: where few pieces exist at a time, they are
    compared in slices of time.
    """
    order = np.argsort(pieces.start_us, kind="stable")
    firsts = np.arange(0, len(order), _SLICE)
    starts_us = pieces.start_us[order[firsts]]
    gone = np.searchsorted(np.sort(pieces.end_us), starts_us)
    if len(firsts) < 2 or (firsts + _SLICE - gone).sum() > _MOST_ALIVE * len(order):
        yield shapely.STRtree(hulls).query(hulls)
        return
    alive = order[:0]
    for first, start_us in zip(firsts.tolist(), starts_us.tolist(), strict=True):
        rows = order[first : first + _SLICE]
        alive = alive[pieces.end_us[alive] >= start_us]
        a, b = shapely.STRtree(hulls[rows]).query(hulls[rows])
        yield rows[a], rows[b]
        a, b = shapely.STRtree(hulls[alive]).query(hulls[rows])
        yield rows[a], alive[b]
        yield alive[b], rows[a]
        alive = np.concatenate([alive, rows])


def _pairs_in_order(
    pieces: Pieces, a: NDArray[np.int64], b: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return those pairs whose first object is before the second, and that share time and heights."""
    earlier = (pieces.kind[a] < pieces.kind[b]) | (
        (pieces.kind[a] == pieces.kind[b]) & (pieces.object_id[a] < pieces.object_id[b])
    )
    return pairs_together(pieces, PieceRows(a[earlier]), PieceRows(b[earlier]))


def pairs_together(pieces: Pieces, a: PieceRows, b: PieceRows, within_us: int = 0) -> tuple[PieceRows, PieceRows]:
    """Return those of some pairs, of different objects and whose boxes meet, that may meet within a time."""
    keep = may_meet(rows_of(pieces), a, b, within_us)
    return PieceRows(a[keep]), PieceRows(b[keep])


def rows_of(pieces: Pieces) -> RowBoxes:
    """Return pieces as rows for `may_meet`, without boxes and types."""
    heights, times = (pieces.floor_m, pieces.ceiling_m), (pieces.start_us, pieces.end_us)
    ends, owner = pieces.end_inclusive, pieces.owner_number
    return RowBoxes(None, *heights, *times, pieces.object_id, pieces.turn != 0, end_inclusive=ends, owner=owner)


def hulls_of(pieces: Pieces) -> NDArray[np.object_]:
    """Return the hulls of pieces (n,), polygons of the plane."""
    owner = np.repeat(np.arange(len(pieces)), np.diff(pieces.hull_offset))
    return np.asarray(shapely.polygons(shapely.linearrings(pieces.hull_xy, indices=owner)))
