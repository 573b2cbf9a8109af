"""Which two objects the pieces of a pair belong to."""

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces


def ordered_members(pieces: Pieces, pairs: Pairs) -> tuple[PieceRows, PieceRows, NDArray[np.bool_]]:
    """Return the pieces of each pair in the order of its objects, area first, else the smaller number; (n,) each.

    And whether that is the other way round than in the pair.
    """
    a, b = pairs.a, pairs.b
    swapped = (pieces.kind[a] > pieces.kind[b]) | (
        (pieces.kind[a] == pieces.kind[b]) & (pieces.object_id[a] > pieces.object_id[b])
    )
    return PieceRows(np.where(swapped, b, a)), PieceRows(np.where(swapped, a, b)), swapped


def object_keys(pieces: Pieces, a: PieceRows, b: PieceRows) -> NDArray[np.int64]:
    """Return (4, n) kind and number of the objects of pieces a and of pieces b: equal for the same two objects."""
    return np.stack([pieces.kind[a], pieces.object_id[a], pieces.kind[b], pieces.object_id[b]])


def company_of(pieces: Pieces, pairs: Pairs) -> NDArray[np.int64]:
    """Return (n,) how many of the pairs are of the same two objects."""
    objects, number = np.unique(np.stack([pieces.kind, pieces.object_id]), axis=1, return_inverse=True)
    a, b = number[pairs.a], number[pairs.b]
    both = np.minimum(a, b) * objects.shape[1] + np.maximum(a, b)
    _, group, count = np.unique(both, return_inverse=True, return_counts=True)
    return np.asarray(count[group], np.int64)
