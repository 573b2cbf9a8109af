"""Regions where pairs of pieces meet during a time, merged regions, and regions in longitude and latitude."""

import ctypes
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.ragged import followed_by, offsets
from conflictdb.kernel.header import constant, structure
from conflictdb.kernel.kernel_scene import HeldPairs, KernelPlane, KernelScene
from conflictdb.kernel.library import Held, address, check, library, shared

# Result vertices of a pair.
_PER_VERTEX: Final = constant("KERNEL_REGION_PER_VERTEX")
_MORE: Final = constant("KERNEL_REGION_MORE")
_PAIRS_AT_ONCE: Final = 4096  # limits the memory of results
# Bytes in EWKB of a region or ring without its vertices, at most, and of a vertex.
_RING_BYTES: Final = 40
_VERTEX_BYTES: Final = 16

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


class OutlineKind(IntEnum):
    """What is known of a region in longitude and latitude (KernelOutline).

    UNKNOWN : no polygon: it reaches a pole, or is no wider than rounding
    SOUND : valid, within 180 degrees of longitude, and the place is inside
    AWAY : valid, but the place is not certainly inside
    CROSSED : its sides may cross or touch; no polygon if its rings could not be united
    BEYOND : it reaches beyond 180 degrees of longitude; its sides may cross
    """

    UNKNOWN = 0
    SOUND = 1
    AWAY = 2
    CROSSED = 3
    BEYOND = 4


class _HeldRings(Held):
    """KernelRings."""

    _fields_, types = structure("KernelRings")


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


def outlines(
    plane: KernelPlane,
    ring: Floats,
    ring_offset: _Ints,
    offset: _Ints,
    limit_m: float,
    *,
    is_hole: NDArray[np.bool_] | None = None,
    place_deg: Floats | None = None,
) -> tuple[NDArray[np.uint8], _Ints, NDArray[np.int8]]:
    """Return regions (n,) in longitude and latitude that contain all places of their rings in the plane.

    ring, ring_offset : (v, 2), (r + 1,) closed, plane metres, the inside on the left: holes are clockwise
    offset : (n + 1,) the rings of region i are [offset[i], offset[i + 1])
    limit_m : largest distance that a region may reach beyond its rings, metres on the earth, from 0.01 to 100,000; of
        more than some 20,000 corners further
    is_hole : (r,) holes follow their shells; None: all rings are convex shells, and a region is their union
    place_deg : (n, 2) a place that each should contain; NaN or None: not known

    Returns EWKB, its offsets (n + 1,), and the `OutlineKind` (n,).
    """
    ring, place = np.ascontiguousarray(ring, np.float64), np.ascontiguousarray(place_deg, np.float64)
    n, first = len(offset) - 1, 0
    kinds, done = np.empty(n, np.int8), ctypes.c_int64()
    parts: list[NDArray[np.uint8]] = []
    ends: list[_Ints] = []
    # Twice the corners are more than most rings need; if not, the rest is written again.
    more = 2
    while first < n:
        last = min(first + _PAIRS_AT_ONCE, n)
        rings = slice(offset[first], offset[last])
        corners = slice(ring_offset[rings.start], ring_offset[rings.stop])
        some = _HeldRings(last - first, rings.stop - rings.start, corners.stop - corners.start)
        some.hold(
            vertex=ring[corners],
            ring_offset=ring_offset[rings.start : rings.stop + 1] - corners.start,
            offset=offset[first : last + 1] - rings.start,
            is_hole=None if is_hole is None else is_hole[rings],
        )
        room = _RING_BYTES * (last - first + some.ring_count) + more * _VERTEX_BYTES * some.vertex_count
        data, end = np.empty(room, np.uint8), np.empty(last - first + 1, np.int64)
        at = None if place_deg is None else address(place[first:last])
        given = ctypes.byref(plane), ctypes.byref(some), limit_m, at, address(data), room, address(end)
        check(library().kernel_outlines(*given, address(kinds[first:last]), ctypes.byref(done)))
        parts.append(data[: end[done.value]].copy())
        ends.append(end[: done.value + 1])
        first += done.value
        more = more if done.value else 8 * more
    if not n:
        return np.empty(0, np.uint8), np.zeros(1, np.int64), kinds
    return np.concatenate(parts), followed_by(ends), kinds


def joined(ring: Floats, offset: _Ints, group: _Ints) -> tuple[Floats, _Ints, _Ints]:
    """Merge consecutive convex rings of one group while their hull exceeds their union by at most a tenth.

    ring, offset, group : (v, 2), (n + 1,), (n,)  closed, counter-clockwise

    Returns rings, offsets and groups in the same form.
    """
    ring = np.ascontiguousarray(ring, np.float64)
    offset, group = (np.ascontiguousarray(array, np.int64) for array in (offset, group))
    found, found_offset, found_group = np.empty_like(ring), np.empty_like(offset), np.empty_like(group)
    count = ctypes.c_int64()
    of_ring, where, of, *room = (address(one) for one in (ring, offset, group, found, found_offset, found_group))
    check(library().kernel_joined(of_ring, len(ring), where, of, len(group), *room, ctypes.byref(count)))
    n = count.value
    return found[: found_offset[n]].copy(), found_offset[: n + 1].copy(), found_group[:n].copy()
