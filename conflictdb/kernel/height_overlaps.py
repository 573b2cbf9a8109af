"""When the heights of two pieces overlap, if either climbs."""

import ctypes
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import Pieces
from conflictdb.kernel.differences import HeldShifts, Shifts
from conflictdb.kernel.header import structure
from conflictdb.kernel.library import Held, address, check, library

_Ints = NDArray[np.int64]


class HeldHeights(Held):
    """KernelHeights."""

    _fields_, types = structure("KernelHeights")

    @classmethod
    def of(cls, pieces: Pieces) -> Self:
        """Return pointers to the columns of pieces."""
        held = cls(len(pieces))
        held.hold(
            climb_m=pieces.climb_m,
            floor_m=pieces.floor_m,
            ceiling_m=pieces.ceiling_m,
            start_us=pieces.start_us,
            end_us=pieces.end_us,
            leg_start_us=pieces.leg_start_us,
            leg_end_us=pieces.leg_end_us,
        )
        return held


def height_overlaps(pieces: Pieces, a: _Ints, b: _Ints) -> tuple[Floats, Floats, Floats]:
    """Return when the heights of pairs (n,) overlap: first and last, seconds after the start of the shared span.

    Also return by how much each end may be too early or too late, seconds. The first is later than the last if they
    never overlap. -inf, inf and 0 for pairs without a climb.
    """
    held, found = HeldHeights.of(pieces), np.empty((3, len(a)))
    a, b = (np.ascontiguousarray(side, np.int64) for side in (a, b))
    answers = [address(one) for one in found]
    check(library().kernel_height_overlaps(ctypes.byref(held), address(a), address(b), len(a), *answers))
    return found[0], found[1], found[2]


def level_times(pieces: Pieces, shifts: Shifts) -> tuple[dict[str, Any], Floats]:
    """Return the times of pairs (n,) by name, cut to when their heights may overlap, and the errors (n,) of their ends.

    A start is later than its end if they never overlap. If only one piece climbs, the heights overlap at exactly these
    times; two that climb may still miss each other: errors are infinite unless they are known to overlap at them.
    """
    held, cut, found = HeldHeights.of(pieces), HeldShifts.of(shifts, slice(0, len(shifts))), np.empty((5, len(shifts)))
    answers = [address(one) for one in found]
    check(library().kernel_level_shifts(ctypes.byref(held), ctypes.byref(cut), *answers))
    names = "a_start_s", "a_end_s", "b_start_s", "b_end_s"
    return dict(zip(names, found, strict=False)), found[4]
