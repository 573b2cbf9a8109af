"""Closest points of approach (CPA) of groups of pairs of pieces."""

import ctypes
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.kernel.header import structure
from conflictdb.kernel.kernel_scene import HeldPairs, HeldWork, KernelScene, Work
from conflictdb.kernel.library import Held, address, check, library, shared

_Ints = NDArray[np.int64]
# Groups per slice of a thread: milliseconds of work, or one with a coarse accuracy.
_SHARE = 128


@dataclass(frozen=True, slots=True)
class Closest:
    """The closest point of approach of each of g groups of pairs.

    pair : (g,) the pair that comes closest; -1 if none comes within the limit, and if the distance is unknown
    at_s : (g,) seconds of that pair: the earliest instant of the minimum, of a touch the first; with a coarse accuracy
        any instant at which the distance is distance_m
    distance_m : (g,) metres on the earth, 0 for a touch, infinite beyond the limit; NaN (unknown) if a piece is
        invalid, and if the work budget of distances is exhausted
    error_m : (g,) the true minimum lies within distance_m plus or minus this
    a_deg, b_deg : (g, 2) longitude (in [-180, 180)) and latitude of the nearest points
    """

    pair: _Ints
    at_s: Floats
    distance_m: Floats
    error_m: Floats
    a_deg: Floats
    b_deg: Floats


def closest(
    scene: KernelScene,
    a: _Ints,
    b: _Ints,
    zero_us: _Ints,
    low_s: Floats,
    high_s: Floats,
    group_offset: _Ints,
    limit_m: Floats,
    accuracy_m: Floats,
    work: Work,
    threads: int = 1,
) -> Closest:
    """Return the closest approach of pieces a and b during [low_s, high_s], ends included, for each group of pairs.

    group_offset : (g + 1,) the pairs of group k are [group_offset[k], group_offset[k + 1])
    limit_m : (g,) distances beyond this need not be known, metres; may be infinite
    accuracy_m : (g,) required accuracy of the distance, metres: coarser takes less work; 0: the best there is
    work : work counters, increased
    """
    n = len(limit_m)
    offset = np.ascontiguousarray(group_offset, np.int64)
    if offset.shape != (n + 1,) or offset[0] != 0 or offset[-1] != len(a) or (np.diff(offset) < 0).any():
        raise ValueError("kernel: the offsets of groups do not begin at 0, decrease, or do not end with the pairs")
    places = np.empty((n, 2))
    found = Closest(np.empty(n, np.int64), np.empty(n), np.empty(n), np.empty(n), places, places.copy())
    pairs = HeldPairs.arrays(a, b, zero_us, low_s, high_s)

    def solve(groups: slice) -> HeldWork:
        done, first = HeldWork(), int(offset[groups.start])
        rows = slice(first, int(offset[groups.stop]))
        held, mine = HeldPairs.of(pairs, rows), _HeldGroups(groups.stop - groups.start)
        offsets = offset[groups.start : groups.stop + 1] - first
        mine.hold(offset=offsets, limit_m=limit_m[groups], accuracy_m=accuracy_m[groups])
        columns = [getattr(found, column.name)[groups] for column in fields(found)]
        answers = (address(column) for column in columns)
        functions, given = library(), (ctypes.byref(held), ctypes.byref(mine))
        check(functions.kernel_approaches(scene.handle, *given, *answers, ctypes.byref(done)))
        columns[0][columns[0] >= 0] += first
        return done

    for done in shared(solve, n, threads, _SHARE):
        work.windows += done.windows
        work.evaluations += done.evaluations
    return found


class _HeldGroups(Held):
    """KernelGroups."""

    _fields_, types = structure("KernelGroups")
