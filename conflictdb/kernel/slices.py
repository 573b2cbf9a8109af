"""Padded swept hulls of pieces, and which hulls are disjoint."""

import ctypes
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.ragged import offsets
from conflictdb.kernel.header import constant
from conflictdb.kernel.kernel_scene import HeldPieces, KernelPlane
from conflictdb.kernel.library import SHARE, address, check, library

# Most vertices of a hull.
_PER_VERTEX: Final = constant("KERNEL_HULL_PER_VERTEX")
_MORE: Final = constant("KERNEL_HULL_MORE")


@dataclass(frozen=True, slots=True)
class Hulls:
    """Padded swept hulls of n pieces.

    xy, offset : (h, 2) plane metres, (n + 1,)  closed rings, counter-clockwise; empty for invalid pieces
    deviation_m : (n,) largest distance of a vertex from the hull of its slice's ends, plane metres; NaN if invalid
    reach_m : (n,) largest distance of a vertex from the reference point, plane metres; 0 for areas
    """

    xy: Floats
    offset: NDArray[np.int64]
    deviation_m: Floats
    reach_m: Floats


def hulls(plane: KernelPlane, pieces: Pieces, reach_m: float) -> Hulls:
    """Return the swept hull of each piece over its whole time, padded by half of reach_m.

    Hulls of two pieces intersect wherever the pieces come within reach_m of each other.

    reach_m : metres on the earth
    """
    held = HeldPieces.of(pieces, np.ones(len(pieces), np.bool_))
    shares = []
    # An interrupt waits for one call at most.
    for first in range(0, max(len(pieces), 1), SHARE):
        last = min(first + SHARE, len(pieces))
        n, vertices = last - first, int(pieces.shape_offset[last] - pieces.shape_offset[first])
        xy, offset = np.empty((_PER_VERTEX * vertices + _MORE * n, 2)), np.empty(n + 1, np.int64)
        deviation_m, reach = np.empty(n), np.empty(n)
        arrays = [address(array) for array in (xy, offset, deviation_m, reach)]
        check(library().kernel_hulls(ctypes.byref(plane), ctypes.byref(held), first, last, reach_m, *arrays))
        shares.append((xy[: offset[-1]], np.diff(offset), deviation_m, reach))
    xy, counts, deviation_m, reach = (np.concatenate(column) for column in zip(*shares, strict=True))
    return Hulls(xy, offsets(counts), deviation_m, reach)


def apart(xy: Floats, offset: NDArray[np.int64], a: PieceRows, b: PieceRows) -> NDArray[np.bool_]:
    """Return (n,) whether hulls a and b are proven disjoint; convex hulls that are not intersect, to rounding.

    xy, offset : (h, 2) plane metres, (m + 1,)  closed rings, counter-clockwise
    """
    xy, found = np.ascontiguousarray(xy, np.float64), np.empty(len(a), np.bool_)
    offset, first, second = (np.ascontiguousarray(one, np.int64) for one in (offset, a, b))
    given = address(xy), len(xy), address(offset), len(offset) - 1, address(first), address(second)
    check(library().kernel_apart(*given, len(a), address(found)))
    return found
