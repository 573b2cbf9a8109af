"""Pieces that are stored and looked up together: which go into a bundle, and which of two bundles meet."""

import ctypes
from collections.abc import Sequence
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Bundles, PieceRows, Pieces
from conflictdb.arrays.ragged import offsets
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.library import Held, check, fields_of, library
from conflictdb.results import Kind

# Pairs of pieces that there is room for at first, and how many times as much each time that is too little: all pairs of
# two areas of a hundred thousand parts would be more than any memory holds, and few of them meet.
_FIRST_ROOM: Final = 2**24
_MORE_ROOM: Final = 8


class _Bundled(Held):
    """KernelBundled."""

    types: ClassVar = {
        "offset": np.int64,
        "boxes": np.float64,
        "start_us": np.int64,
        "end_us": np.int64,
        "end_inclusive": np.uint8,
    }
    _fields_: ClassVar = [*fields_of(types, "count", "bundles")]


def bundles(pieces: Pieces, run: NDArray[np.int64]) -> Bundles:
    """Return pieces in bundles, which take up little more than the pieces of each do.

    run : (n,) pieces next to each other that have the same number may go together; slices are in the order of time
    """
    n = len(pieces)
    boxes, run = boxes_of(pieces), np.ascontiguousarray(run, np.int64)
    moves = np.ascontiguousarray(pieces.kind == Kind.TRACK.code, np.uint8)
    order, begins = np.empty(n, np.int64), np.empty(n, np.uint8)
    given: list[Any] = [array.ctypes.data for array in (boxes, run, moves)]
    check(library().kernel_bundles(*given, n, order.ctypes.data, begins.ctypes.data))
    return Bundles(pieces.take(order), np.append(np.flatnonzero(begins), n))


def bundled_pairs(bundles: Bundles, a: NDArray[np.int64], b: NDArray[np.int64]) -> tuple[PieceRows, PieceRows]:
    """Return the pieces of pairs of bundles (a, b) whose boxes meet and whose spans share an instant, (m,) each."""
    pieces = bundles.pieces
    held = _Bundled(len(pieces), len(bundles))
    held.hold(
        offset=bundles.offset,
        boxes=boxes_of(pieces),
        start_us=pieces.start_us,
        end_us=pieces.end_us,
        end_inclusive=pieces.end_inclusive,
    )
    a, b = (np.ascontiguousarray(rows, np.int64) for rows in (a, b))
    size = np.diff(bundles.offset)
    most = int((size[a] * size[b]).sum())
    found, room = np.zeros(1, np.int64), min(most, _FIRST_ROOM)
    given: list[Any] = [array.ctypes.data for array in (a, b)]
    while True:
        # Memory that nothing is written to is not taken.
        first, second = np.empty(room, np.int64), np.empty(room, np.int64)
        room_for: list[Any] = [array.ctypes.data for array in (first, second)]
        status = library().kernel_bundled_pairs(ctypes.byref(held), *given, len(a), *room_for, room, found.ctypes.data)
        if not (status and found[0] == room < most):
            break
        room = min(_MORE_ROOM * room, most)
    check(status)
    return PieceRows(first[: found[0]].copy()), PieceRows(second[: found[0]].copy())


def wkb_rings(wkb: Sequence[bytes], rings: int) -> tuple[Floats, NDArray[np.int64]]:
    """Return the closed rings of polygons and multipolygons: vertices (v, 2), and where each begins (rings + 1,).

    wkb : little-endian, without holes; so many rings in all

    Raises ValueError for other shapes, and another number of rings.
    """
    data = np.frombuffer(b"".join(wkb), np.uint8)
    offset, found = offsets([len(one) for one in wkb]), np.zeros(rings + 1, np.int64)
    xy = np.empty((len(data) // 16, 2))
    read: list[Any] = [array.ctypes.data for array in (data, offset, xy, found)]
    check(library().kernel_wkb_rings(read[0], len(data), read[1], len(wkb), read[2], len(xy), read[3], rings))
    return xy[: found[-1]], found


def boxes_of(pieces: Pieces) -> Floats:
    """Return the boxes of hulls (n, 4): least x, least y, largest x, largest y; every piece has a hull."""
    if not len(pieces):
        return np.empty((0, 4))
    first = pieces.hull_offset[:-1]
    least_and_most = [extreme.reduceat(pieces.hull_xy, first) for extreme in (np.minimum, np.maximum)]
    return np.concatenate(least_and_most, axis=1)
