"""Differences of departure, and factors of time, that bring pairs of pieces into contact, from the kernel."""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.kernel.header import record, structure
from conflictdb.kernel.kernel_scene import HeldWork, KernelScene, Work
from conflictdb.kernel.library import Held, address, check, library, shared, taken

_Ints = NDArray[np.int64]
# Pairs per slice of a thread: milliseconds of work.
_SHARE: Final = 128

# KernelDifference, KernelDifferencePart.
DIFFERENCE: Final = record("KernelDifference")
_PART: Final = record("KernelDifferencePart")


class DifferenceState(IntEnum):
    """What is proven about the goals of a pair (KernelDifferenceState)."""

    NONE = 0  # nothing asked about brings it into contact
    INNER = 1  # contact at each difference of the inner interval, at none outside of the outer
    OUTER = 2  # no contact outside of the outer interval; the inner one is empty
    UNKNOWN = 3  # nothing: the outer interval has all differences of both times, or all factors asked about


@dataclass(frozen=True, slots=True)
class Shifts:
    """n pairs of pieces, each piece with a time of its own, seconds from its own zero (KernelShifts).

    a, b : (n,) indices of pieces
    a_zero_us, b_zero_us : (n,) the instants that the seconds of a and of b count from
    a_start_s, a_end_s, b_start_s, b_end_s : (n,) times within the slices; [0, 0] for pieces that stand still
    least, most : (n,) goals asked about: differences, seconds, infinite for all; or factors, positive and finite
    is_factor : whether the goal is a factor of time: seconds of b by seconds of a, with one zero for both
    weight : (n,) of the seconds of a in a difference, positive; None: 1
    """

    a: _Ints
    b: _Ints
    a_zero_us: _Ints
    b_zero_us: _Ints
    a_start_s: Floats
    a_end_s: Floats
    b_start_s: Floats
    b_end_s: Floats
    least: Floats
    most: Floats
    is_factor: bool = False
    weight: Floats | None = None

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: _Ints) -> "Shifts":
        """Return some pairs."""
        some: dict[str, Any] = {name: column[rows] for name, column in self.columns().items()}
        return replace(self, **some)

    @classmethod
    def concatenate(cls, parts: Sequence["Shifts"]) -> "Shifts":
        """Return the pairs of all parts, which have one goal; at least one part."""
        columns = [part.columns() for part in parts]
        every: dict[str, Any] = {name: np.concatenate([some[name] for some in columns]) for name in columns[0]}
        return replace(parts[0], **every)

    def columns(self) -> dict[str, Any]:
        """Return the columns (n,) by name."""
        columns = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "is_factor"}
        return {name: column for name, column in columns.items() if column is not None}


def differences(scene: KernelScene, shifts: Shifts, reach_m: float, work: Work, threads: int = 1) -> NDArray[Any]:
    """Return the goals (n,) at which pairs are in contact, `DIFFERENCE`: seconds of b minus, or by, those of a.

    Of those asked about, all of contact are in the outer interval; of factors also if the instants of waypoints are
    rounded to microseconds. Empty intervals are [inf, -inf].

    reach_m : contact means to come within this, metres on the earth; 0: touching
    work : work counters, increased
    """
    found = np.empty(len(shifts), DIFFERENCE)

    def solve(rows: slice) -> HeldWork:
        held, done, answers = HeldShifts.of(shifts, rows), HeldWork(), address(found[rows])
        check(library().kernel_differences(scene.handle, ctypes.byref(held), reach_m, answers, ctypes.byref(done)))
        return done

    for done in shared(solve, len(shifts), threads, _SHARE, vertices=scene.vertices(shifts.a, shifts.b)):
        count(work, done)
    return found


def difference_parts(
    scene: KernelScene, shifts: Shifts, reach_m: float, work: Work, threads: int = 1
) -> tuple[_Ints, Shifts, NDArray[Any]]:
    """Return the rows (m,) of pairs that something asked about brings into contact, their times, and the answers.

    Where a part of an interval is neither proven free nor forbidden, times are halved, so that a pair may have several
    rows: contact sets of havens that change their shape may have several parts.
    """

    def solve(rows: slice) -> tuple[NDArray[Any], HeldWork]:
        held, found, size, done = HeldShifts.of(shifts, rows), ctypes.c_void_p(), ctypes.c_int64(), HeldWork()
        answers = [ctypes.byref(one) for one in (found, size, done)]
        check(library().kernel_difference_parts(scene.handle, ctypes.byref(held), reach_m, *answers))
        items = taken(found, size, _PART)
        items["pair"] += rows.start
        return items, done

    parts = shared(solve, len(shifts), threads, _SHARE, vertices=scene.vertices(shifts.a, shifts.b))
    for _, done in parts:
        count(work, done)
    items = np.concatenate([np.empty(0, _PART), *(some for some, _ in parts)])
    pair = items["pair"].copy()
    times: dict[str, Any] = {name: items[name].copy() for name in ("a_start_s", "a_end_s", "b_start_s", "b_end_s")}
    return pair, replace(shifts.take(pair), **times), items["found"].astype(DIFFERENCE)


def count(work: Work, done: HeldWork) -> None:
    """Add the work of a call."""
    work.windows += done.windows
    work.evaluations += done.evaluations


class HeldShifts(Held):
    """KernelShifts."""

    _fields_, types = structure("KernelShifts")

    @classmethod
    def of(cls, shifts: Shifts, rows: slice) -> Self:
        """Return pointers to some rows. Raises ValueError unless all columns have one length."""
        columns = shifts.columns()
        if any(column.shape != (len(shifts),) for column in columns.values()):
            raise ValueError("kernel: the columns of pairs are not of one length")
        held = cls(rows.stop - rows.start, shifts.is_factor)
        held.hold(**{name: column[rows] for name, column in columns.items()})
        return held
