"""Stage 1 in memory: the pairs of pieces that may meet (`kernel.boxes.may_meet`)."""

from collections.abc import Iterator
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.kernel.boxes import RowBoxes, box_pairs, boxes_of, may_meet, near_order

# Pairs in the first batch.
_AT_ONCE: Final = 1_000_000


def candidates(pieces: Pieces, within_us: int = 0) -> tuple[PieceRows, PieceRows]:
    """Return rows (a, b) of the pairs of pieces that may meet, ordered, each pair once; never two of one object.

    within_us : how far apart in time two may be
    """
    a, b = (np.concatenate(some) for some in zip(*batches(pieces, _AT_ONCE, within_us), strict=True))
    order = np.lexsort((b, a))
    return PieceRows(a[order]), PieceRows(b[order])


def batches(pieces: Pieces, at_once: int, within_us: int = 0) -> Iterator[tuple[PieceRows, PieceRows]]:
    """Yield these pairs in batches of about `at_once`, at least one, each with all pairs of some first objects."""
    rows = rows_of(pieces)
    order = near_order(rows)
    rows = rows.take(order)
    is_found = False
    for first, second, _ in box_pairs(rows, np.argsort(rows.object, kind="stable"), at_once, within_us):
        a, b = order[first], order[second]
        in_order, is_found = np.lexsort((b, a)), True
        yield PieceRows(a[in_order]), PieceRows(b[in_order])
    if not is_found:
        yield PieceRows(order[:0]), PieceRows(order[:0])


def rows_of(pieces: Pieces) -> RowBoxes:
    """Return pieces as rows without types."""
    return RowBoxes.of(pieces, boxes_of(pieces))


def pairs_together(pieces: Pieces, a: PieceRows, b: PieceRows, within_us: int = 0) -> tuple[PieceRows, PieceRows]:
    """Return those of some pairs, of different objects and whose boxes meet, that may meet within a time."""
    keep = may_meet(RowBoxes.of(pieces), a, b, within_us)
    return PieceRows(a[keep]), PieceRows(b[keep])


def hulls_of(pieces: Pieces) -> NDArray[np.object_]:
    """Return the hulls of pieces (n,), polygons of the plane."""
    piece_of = np.repeat(np.arange(len(pieces)), np.diff(pieces.hull_offset))
    return np.asarray(shapely.polygons(shapely.linearrings(pieces.hull_xy, indices=piece_of)))
