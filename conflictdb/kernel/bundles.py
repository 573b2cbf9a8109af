"""Bundles, which store and look up several pieces as one row: grouping, pairs of their pieces, and their boxes."""

import ctypes
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import Bundles, PieceRows, Pieces
from conflictdb.arrays.ragged import offsets
from conflictdb.kernel.boxes import Compared, HeldBoxes, RowBoxes, boxes_of
from conflictdb.kernel.library import address, check, library
from conflictdb.model.results import Kind

# First size of the result, pairs of pieces, and its growth factor. All pairs of two areas of a hundred thousand parts
# would not fit into memory, and few of them intersect.
_FIRST_ROOM: Final = 2**24
_MORE_ROOM: Final = 8


def bundles(pieces: Pieces, run: NDArray[np.int64]) -> Bundles:
    """Group pieces into bundles whose boxes are little larger than their pieces.

    run : (n,) consecutive pieces of the same number may share a bundle; slices are in order of time
    """
    n = len(pieces)
    boxes, run = boxes_of(pieces), np.ascontiguousarray(run, np.int64)
    moves = np.ascontiguousarray(pieces.kind == Kind.TRACK.code, np.uint8)
    order, begins = np.empty(n, np.int64), np.empty(n, np.uint8)
    given: list[Any] = [address(array) for array in (boxes, run, moves)]
    check(library().kernel_bundles(*given, n, address(order), address(begins)))
    return Bundles(pieces.take(order), np.append(np.flatnonzero(begins), n))


def bundled_pairs(
    bundles: Bundles, a: NDArray[np.int64], b: NDArray[np.int64], within_us: int = 0
) -> tuple[PieceRows, PieceRows]:
    """Return pairs of pieces (m,), (m,) of bundles a and b that may meet (`boxes.may_meet`)."""
    pieces, offset = bundles.pieces, np.ascontiguousarray(bundles.offset, np.int64)
    held, which = HeldBoxes.of(RowBoxes.of(pieces, boxes_of(pieces))), Compared.of(within_us)
    a, b = (np.ascontiguousarray(rows, np.int64) for rows in (a, b))
    size = np.diff(bundles.offset)
    most = int((size[a] * size[b]).sum())
    found, room = np.zeros(1, np.int64), min(most, _FIRST_ROOM)
    given: list[Any] = [ctypes.byref(held), address(offset), len(bundles), ctypes.byref(which), address(a), address(b)]
    while True:
        # Pages of an empty array that are never written take no memory.
        first, second = np.empty(room, np.int64), np.empty(room, np.int64)
        room_for: list[Any] = [address(array) for array in (first, second)]
        status = library().kernel_bundled_pairs(*given, len(a), *room_for, room, address(found))
        if not (status and found[0] == room < most):
            break
        room = min(_MORE_ROOM * room, most)
    check(status)
    return PieceRows(first[: found[0]].copy()), PieceRows(second[: found[0]].copy())


def wkb_rings(wkb: Sequence[bytes], rings: int) -> tuple[Floats, NDArray[np.int64]]:
    """Return the closed rings of polygons and multipolygons: vertices (v, 2), and offsets of the rings (rings + 1,).

    wkb : little-endian, without holes
    rings : expected number of rings in all

    Raises ValueError for other types of shapes, and another number of rings.
    """
    data = np.frombuffer(b"".join(wkb), np.uint8)
    offset, found = offsets([len(one) for one in wkb]), np.zeros(rings + 1, np.int64)
    xy = np.empty((len(data) // 16, 2))
    read: list[Any] = [address(array) for array in (data, offset, xy, found)]
    check(library().kernel_wkb_rings(read[0], len(data), read[1], len(wkb), read[2], len(xy), read[3], rings))
    return xy[: found[-1]], found
