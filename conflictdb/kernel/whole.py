"""Decide whether pairs reach deeper than a margin into an area; one piece is a convex part of it."""

import ctypes
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.kernel.header import structure
from conflictdb.kernel.kernel_scene import HeldPairs, KernelScene
from conflictdb.kernel.library import Held, address, check, library

_Ints = NDArray[np.int64]


class Depth(IntEnum):
    """Depth of a pair in an area (KernelDepth)."""

    SHALLOW = 0
    DEEP = 1
    UNKNOWN = 2


@dataclass(frozen=True, slots=True)
class Areas:
    """m areas of the plane (KernelAreas).

    ring_xy : (v, 2) closed rings one after the other, plane metres
    ring_offset, area_offset : (r + 1,), (m + 1,) offsets of the vertices of rings, and of the rings of areas
    margin : (m,) places farther than this from the border are deep, plane metres
    """

    ring_xy: Floats
    ring_offset: _Ints
    area_offset: _Ints
    margin: Floats


def whole_depths(
    scene: KernelScene,
    a: _Ints,
    b: _Ints,
    zero_us: _Ints,
    low_s: Floats,
    high_s: Floats,
    areas: Areas,
    area: _Ints,
    is_b: NDArray[np.bool_],
    east_m: Floats,
) -> NDArray[np.int8]:
    """Return the `Depth` (n,) of pairs a, b in areas: the deepest of the start, the middle and the end of their time.

    area, is_b : (n,) the area, and whether b is its part, else a
    east_m : (n,) how far east of the area the part lies (seam copies lie whole turns away), plane metres
    """
    n = len(a)
    given = tuple(
        np.ascontiguousarray(column, kind) for column, kind in ((area, np.int64), (is_b, np.int8), (east_m, np.float64))
    )
    if any(len(column) != n for column in given):
        raise ValueError("kernel: the columns of pairs are not of one length")
    held, of_areas, depth = HeldPairs.arrays(a, b, zero_us, low_s, high_s), _HeldAreas.of(areas), np.empty(n, np.int8)
    pairs = HeldPairs.of(held, slice(0, n))
    arrays = (address(column) for column in (*given, depth))
    check(library().kernel_whole_depths(scene.handle, ctypes.byref(pairs), ctypes.byref(of_areas), *arrays))
    return depth


class _HeldAreas(Held):
    """KernelAreas."""

    _fields_, types = structure("KernelAreas")

    @classmethod
    def of(cls, areas: Areas) -> "_HeldAreas":
        if len(areas.area_offset) != len(areas.margin) + 1:
            raise ValueError("kernel: the offsets of areas are not one more than areas")
        held = cls(len(areas.margin), len(areas.ring_offset) - 1, len(areas.ring_xy))
        held.hold(ring=areas.ring_xy, ring_offset=areas.ring_offset, area_offset=areas.area_offset, margin=areas.margin)
        return held
