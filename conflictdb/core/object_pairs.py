"""Group pairs of pieces by their two objects."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.answers import Members
from conflictdb.arrays.distinct import distinct
from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces


def ordered_members(pieces: Pieces, a: PieceRows, b: PieceRows) -> tuple[PieceRows, PieceRows, NDArray[np.bool_]]:
    """Return pieces a and b (n,) in the order of their objects: area first, else the smaller number.

    The third array (n,) is true for pairs that were swapped.
    """
    swapped = (pieces.kind[a] > pieces.kind[b]) | (
        (pieces.kind[a] == pieces.kind[b]) & (pieces.object_id[a] > pieces.object_id[b])
    )
    return PieceRows(np.where(swapped, b, a)), PieceRows(np.where(swapped, a, b)), swapped


def object_keys(pieces: Pieces, a: PieceRows, b: PieceRows) -> NDArray[np.int64]:
    """Return (4, n) kind and number of the objects of pieces a and b; columns of the same two objects are equal."""
    return np.stack([pieces.kind[a], pieces.object_id[a], pieces.kind[b], pieces.object_id[b]])


def members(pieces: Pieces, rows: PieceRows) -> Members:
    """Return kinds, numbers and versions of the objects of some pieces."""
    return pieces.kind[rows], pieces.object_id[rows], pieces.version[rows]


def numbered(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the rank (n,) of each column of (k, n) among distinct columns, and the count of these."""
    order = np.lexsort(keys[::-1])
    along = keys[:, order]
    is_new = np.ones(len(order), np.bool_)
    is_new[1:] = (along[:, 1:] != along[:, :-1]).any(axis=0)
    number = np.empty(len(order), np.int64)
    number[order] = np.cumsum(is_new) - 1
    return number, int(np.count_nonzero(is_new))


def object_numbers(pieces: Pieces) -> NDArray[np.int64]:
    """Return (n,) one number for the object of each piece, in the order of kinds, then ids."""
    return numbers_of(pieces.kind, pieces.object_id)


def company_of(pieces: Pieces, pairs: Pairs) -> NDArray[np.int64]:
    """Return (n,) the number of pairs that belong to the same two objects."""
    objects, number = distinct(object_numbers(pieces))
    a, b = number[pairs.a], number[pairs.b]
    _, group = distinct(np.minimum(a, b) * len(objects) + np.maximum(a, b))
    return np.asarray(np.bincount(group)[group], np.int64)


def chunks_of_objects(
    a_object: NDArray[np.int64], b_object: NDArray[np.int64], at_once: int
) -> Iterator[NDArray[np.int64]]:
    """Yield rows of pairs of pieces, at most `at_once`, except that all pairs of two objects stay together.

    a_object, b_object : (n,) numbers of the objects, of each pair in the same order
    """
    n = len(a_object)
    if n <= at_once:
        yield np.arange(n)
        return
    order = np.lexsort((b_object, a_object))
    a, b = a_object[order], b_object[order]
    ends = np.append(np.flatnonzero((a[1:] != a[:-1]) | (b[1:] != b[:-1])) + 1, n)
    first = 0
    while first < n:
        fits = int(np.searchsorted(ends, first + at_once, side="right")) - 1
        last = int(ends[fits])
        if fits < 0 or last <= first:
            last = int(ends[fits + 1])
        yield order[first:last]
        first = last
