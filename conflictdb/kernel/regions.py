"""Regions where pairs of pieces meet during a time, and merged regions."""

import ctypes
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.ragged import offsets
from conflictdb.kernel.header import constant
from conflictdb.kernel.kernel_scene import HeldPairs, KernelScene
from conflictdb.kernel.library import address, check, library, shared

# Result vertices of a pair.
_PER_VERTEX: Final = constant("KERNEL_REGION_PER_VERTEX")
_MORE: Final = constant("KERNEL_REGION_MORE")
_PAIRS_AT_ONCE: Final = 4096  # limits the memory of results

_Ints = NDArray[np.int64]


class RegionKind(IntEnum):
    """Kind of the region of a pair (KernelRegion).

    UNKNOWN : no region: a piece is invalid, or the region goes around the earth
    SWEPT : intersection of the swept hulls: a superset
    COMMON : intersection of two pieces that stand still
    """

    UNKNOWN = 0
    SWEPT = 1
    COMMON = 2


def regions(
    scene: KernelScene,
    a: _Ints,
    b: _Ints,
    zero_us: _Ints,
    low_s: Floats,
    high_s: Floats,
    reach_m: float,
    threads: int = 1,
) -> tuple[Floats, _Ints, NDArray[np.int8]]:
    """Return where pieces a and b may come within reach_m of each other during times (n,): a superset.

    For two overlapping pieces that stand still it is their intersection.

    low_s, high_s : (n,) seconds after zero_us (n,), within the slices of both pieces

    Returns closed rings (m, 2) in plane metres within half a turn; their offsets (2 n + 1,); and the `RegionKind` (n,).
    Rings 2 i and 2 i + 1 belong to pair i, the second if the region crosses the antimeridian. Both are empty if the
    pair does not come that close.
    """
    pairs = HeldPairs.arrays(a, b, zero_us, low_s, high_s)
    kinds, vertices = np.empty(len(a), np.int8), scene.vertices(a, b)

    def make(rows: slice) -> tuple[list[Floats], list[_Ints]]:
        found: list[Floats] = []
        counts: list[_Ints] = []
        for first in range(rows.start, rows.stop, _PAIRS_AT_ONCE):
            some = slice(first, min(first + _PAIRS_AT_ONCE, rows.stop))
            n = some.stop - some.start
            room = _PER_VERTEX * int(vertices[some].sum()) + _MORE * n
            ring, ring_offset = np.empty((room, 2)), np.empty(2 * n + 1, np.int64)
            held = HeldPairs.of(pairs, some)
            arrays = [address(array) for array in (ring, ring_offset, kinds[some])]
            check(library().kernel_regions(scene.handle, ctypes.byref(held), reach_m, *arrays))
            found.append(ring[: ring_offset[-1]].copy())
            counts.append(np.diff(ring_offset))
        return found, counts

    shares = shared(make, len(a), threads, vertices=vertices)
    rings = [ring for found, _ in shares for ring in found]
    counts = [count for _, some in shares for count in some]
    offset = offsets(np.concatenate([np.empty(0, np.int64), *counts]))
    return np.concatenate([np.empty((0, 2)), *rings]), offset, kinds


def joined(ring: Floats, offset: _Ints, owner: _Ints) -> tuple[Floats, _Ints, _Ints]:
    """Merge consecutive convex rings of one owner while their hull exceeds their union by at most a tenth.

    ring, offset, owner : (v, 2), (n + 1,), (n,)  closed, counter-clockwise

    Returns rings, offsets and owners in the same form.
    """
    ring = np.ascontiguousarray(ring, np.float64)
    offset, owner = (np.ascontiguousarray(array, np.int64) for array in (offset, owner))
    found, found_offset, found_owner = np.empty_like(ring), np.empty_like(offset), np.empty_like(owner)
    count = ctypes.c_int64()
    of_ring, where, of, *room = (address(one) for one in (ring, offset, owner, found, found_offset, found_owner))
    check(library().kernel_joined(of_ring, len(ring), where, of, len(owner), *room, ctypes.byref(count)))
    n = count.value
    return found[: found_offset[n]].copy(), found_offset[: n + 1].copy(), found_owner[:n].copy()
