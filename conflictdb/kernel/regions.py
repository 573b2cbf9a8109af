"""Where pairs of pieces meet during a time, and what they cover put together."""

import ctypes
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.ragged import offsets
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.library import check, library, shared
from conflictdb.kernel.scene import HeldPairs, Scene

# As kernel.h has them: room for the rings of a pair, vertices per vertex of its pieces, and more.
_PER_VERTEX: Final = 8
_MORE: Final = 8
_PAIRS_AT_ONCE: Final = 4096  # bounds the room

_Ints = NDArray[np.int64]


class Told(IntEnum):
    """What is told of where a pair meets, as kernel.h has it.

    UNKNOWN : nothing: a piece cannot be or goes around the earth
    SWEPT : what both may sweep
    COMMON : what two that stand still have in common
    """

    UNKNOWN = 0
    SWEPT = 1
    COMMON = 2


def regions(
    scene: Scene,
    a: _Ints,
    b: _Ints,
    zero_us: _Ints,
    low_s: Floats,
    high_s: Floats,
    reach_m: float,
    threads: int = 1,
) -> tuple[Floats, _Ints, NDArray[np.int8]]:
    """Return where pieces a and b may come within reach_m of each other during times (n,): a superset.

    Of two that stand still and overlap it is what they have in common. Rings are closed: plane metres within half a
    turn (m, 2), and their offsets (2 n + 1,). Rings 2 i and 2 i + 1 are those of pair i, the second where it lies
    across the seam, both without vertices where they come no nearer. And (n,) what that is, `Told`.

    low_s, high_s : (n,) seconds after zero_us (n,), within what both pieces have
    """
    pairs = HeldPairs.arrays(a, b, zero_us, low_s, high_s)
    told, vertices = np.empty(len(a), np.int8), scene.vertices(a, b)

    def make(rows: slice) -> tuple[list[Floats], list[_Ints]]:
        found: list[Floats] = []
        counts: list[_Ints] = []
        for first in range(rows.start, rows.stop, _PAIRS_AT_ONCE):
            some = slice(first, min(first + _PAIRS_AT_ONCE, rows.stop))
            n = some.stop - some.start
            room = _PER_VERTEX * int(vertices[some].sum()) + _MORE * n
            ring, ring_offset = np.empty((room, 2)), np.empty(2 * n + 1, np.int64)
            held = HeldPairs.of(pairs, some)
            arrays = [array.ctypes.data for array in (ring, ring_offset, told[some])]
            check(library().kernel_regions(scene.handle, ctypes.byref(held), reach_m, *arrays))
            found.append(ring[: ring_offset[-1]].copy())
            counts.append(np.diff(ring_offset))
        return found, counts

    shares = shared(make, len(a), threads, vertices=vertices)
    rings = [ring for found, _ in shares for ring in found]
    counts = [count for _, some in shares for count in some]
    offset = offsets(np.concatenate([np.empty(0, np.int64), *counts]))
    return np.concatenate([np.empty((0, 2)), *rings]), offset, told


def joined(ring: Floats, offset: _Ints, owner: _Ints) -> tuple[Floats, _Ints, _Ints]:
    """Return convex rings with those of one owner that follow each other put together, and their offsets and owners.

    The hull of some takes their place while it is larger than their union by no more than a tenth.

    ring, offset, owner : (v, 2), (n + 1,), (n,)  closed, counter-clockwise
    """
    ring = np.ascontiguousarray(ring, np.float64)
    offset, owner = (np.ascontiguousarray(array, np.int64) for array in (offset, owner))
    found, found_offset, found_owner = np.empty_like(ring), np.empty_like(offset), np.empty_like(owner)
    count = ctypes.c_int64()
    of_ring, where, of, *room = (one.ctypes.data for one in (ring, offset, owner, found, found_offset, found_owner))
    check(library().kernel_joined(of_ring, len(ring), where, of, len(owner), *room, ctypes.byref(count)))
    n = count.value
    return found[: found_offset[n]].copy(), found_offset[: n + 1].copy(), found_owner[:n].copy()
