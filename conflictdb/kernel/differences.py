"""Differences of departure that bring pairs of pieces into contact, from the kernel."""

import ctypes
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.kernel.kernel_scene import HeldWork, KernelScene, Work
from conflictdb.kernel.library import Held, check, fields_of, library, shared

_Ints = NDArray[np.int64]
# Pairs per slice of a thread: milliseconds of work.
_SHARE: Final = 128

# KernelDifference.
DIFFERENCE: Final = np.dtype(
    [
        *((name, np.float64) for name in ("outer_low_s", "inner_low_s", "inner_high_s", "outer_high_s")),
        ("state", np.int32),
        ("_", np.int32),
    ]
)


class DifferenceState(IntEnum):
    """What is proven about the differences of a pair (KernelDifferenceState)."""

    NONE = 0  # no difference brings it into contact
    INNER = 1  # contact at each difference of the inner interval, at none outside of the outer
    OUTER = 2  # no contact outside of the outer interval; the inner one is empty
    UNKNOWN = 3  # nothing: the outer interval has all differences of both times


@dataclass(frozen=True, slots=True)
class Shifts:
    """n pairs of pieces, each piece with a time of its own, seconds from its own zero (KernelShifts).

    a, b : (n,) indices of pieces
    a_zero_us, b_zero_us : (n,) the instants that the seconds of a and of b count from
    a_start_s, a_end_s, b_start_s, b_end_s : (n,) times within the slices; [0, 0] for pieces that stand still
    least_s, most_s : (n,) differences asked about; infinite for all
    """

    a: _Ints
    b: _Ints
    a_zero_us: _Ints
    b_zero_us: _Ints
    a_start_s: Floats
    a_end_s: Floats
    b_start_s: Floats
    b_end_s: Floats
    least_s: Floats
    most_s: Floats

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: _Ints) -> "Shifts":
        """Return some pairs."""
        return Shifts(*(getattr(self, one.name)[rows] for one in fields(self)))


def differences(scene: KernelScene, shifts: Shifts, reach_m: float, work: Work, threads: int = 1) -> NDArray[Any]:
    """Return the differences (n,) of pairs, `DIFFERENCE`: seconds of b minus seconds of a at which they are in contact.

    Of the differences asked about: all of contact are in the outer interval.

    Empty intervals are [inf, -inf].

    reach_m : contact means to come within this, metres on the earth; 0: touching
    work : work counters, increased
    """
    n = len(shifts)
    columns = {one.name: getattr(shifts, one.name) for one in fields(Shifts)}
    if any(column.shape != (n,) for column in columns.values()):
        raise ValueError("kernel: the columns of pairs are not of one length")
    found = np.empty(n, DIFFERENCE)

    def solve(rows: slice) -> HeldWork:
        held, done = _HeldShifts(rows.stop - rows.start), HeldWork()
        held.hold(**{name: column[rows] for name, column in columns.items()})
        answers = found[rows].ctypes.data
        check(library().kernel_differences(scene.handle, ctypes.byref(held), reach_m, answers, ctypes.byref(done)))
        return done

    for done in shared(solve, n, threads, _SHARE, vertices=scene.vertices(shifts.a, shifts.b)):
        work.windows += done.windows
        work.evaluations += done.evaluations
    return found


class _HeldShifts(Held):
    """KernelShifts."""

    types: ClassVar[dict[str, Any]] = {
        **dict.fromkeys(("a", "b", "a_zero_us", "b_zero_us"), np.int64),
        **dict.fromkeys(("a_start_s", "a_end_s", "b_start_s", "b_end_s", "least_s", "most_s"), np.float64),
    }
    _fields_ = fields_of(types, "count")
