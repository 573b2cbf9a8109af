"""Uses of one place by two pieces within a separation in time."""

import ctypes
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.kernel.differences import HeldShifts, Shifts, count
from conflictdb.kernel.header import record, structure
from conflictdb.kernel.height_overlaps import HeldHeights
from conflictdb.kernel.kernel_scene import HeldWork, KernelScene, Work
from conflictdb.kernel.library import Held, address, check, library, shared

_Ints = NDArray[np.int64]
# Pairs per slice of a thread: milliseconds of work.
_SHARE: Final = 16

# KernelUse.
USE: Final = record("KernelUse")
# What is known of a use.
OF_SPANS, OF_AREA_A, OF_AREA_B, OF_TRACKS = range(4)
# Whether pairs come near each other.
POSSIBLE, SURE = 1, 2


def uses_of_place(
    scene: KernelScene,
    a: _Ints,
    b: _Ints,
    within_us: int,
    separation_m: float,
    tolerance_m: float,
    work: Work,
    threads: int = 1,
) -> NDArray[Any]:
    """Return the use of each pair of tracks (n,), `USE`: one at most.

    within_us : how far apart in time
    work : work counters, increased
    """
    found, held = np.empty(len(a), USE), HeldHeights.of(scene.pieces)
    a, b = (np.ascontiguousarray(side, np.int64) for side in (a, b))

    def solve(rows: slice) -> HeldWork:
        asked, done = _UsesAsked(rows.stop - rows.start, within_us, separation_m, tolerance_m), HeldWork()
        asked.hold(a=a[rows], b=b[rows])
        given = [ctypes.byref(one) for one in (held, asked)]
        check(library().kernel_uses(scene.handle, *given, address(found[rows]), ctypes.byref(done)))
        return done

    for done in shared(solve, len(a), threads, _SHARE, vertices=scene.vertices(a, b)):
        count(work, done)
    return found


def near_in_time(scene: KernelScene, shifts: Shifts, reach_m: float, within_us: int, work: Work) -> NDArray[np.int8]:
    """Return whether pairs (n,) come within a reach at instants at most `within_us` apart: 0: no, `POSSIBLE`, `SURE`.

    shifts : asked about differences of the same time
    work : work counters, increased
    """
    held, done, found = HeldShifts.of(shifts, slice(0, len(shifts))), HeldWork(), np.empty(len(shifts), np.int8)
    given = ctypes.byref(held), reach_m, within_us, address(found), ctypes.byref(done)
    check(library().kernel_near_in_time(scene.handle, *given))
    count(work, done)
    return found


def complete(
    uses: NDArray[Any],
    spans_us: tuple[_Ints, _Ints, _Ints, _Ints],
    within_us: int,
    known: NDArray[np.int8],
    contact_s: tuple[Floats, Floats] | None = None,
) -> NDArray[Any]:
    """Complete uses (n,) whose verdict and touches are known, and return them.

    One that ends before it starts becomes unresolved while both pieces are near in time.

    spans_us : start and end of a, and of b (n,)
    known : (n,) OF_SPANS: no more; OF_AREA_A, OF_AREA_B: also its error, and `contact_s`; OF_TRACKS: all
    contact_s : start and end (n,) of contacts with an area that is there for longer by `within_us` at both ends
    """
    asked = _Used(len(uses), within_us)
    names = "a_start_us", "a_end_us", "b_start_us", "b_end_us"
    start_s, end_s = contact_s or (None, None)
    asked.hold(**dict(zip(names, spans_us, strict=True)), start_s=start_s, end_s=end_s, known=known)
    check(library().kernel_use_times(ctypes.byref(asked), address(uses)))
    return uses


class _UsesAsked(Held):
    """KernelUsesAsked."""

    _fields_, types = structure("KernelUsesAsked")


class _Used(Held):
    """KernelUsed."""

    _fields_, types = structure("KernelUsed")
