"""How close groups of pairs of pieces come, when and where."""

import ctypes
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.library import Held, check, fields_of, library, shared
from conflictdb.kernel.scene import HeldPairs, HeldWork, Scene, Work

_Ints = NDArray[np.int64]
# Groups that a thread takes at once: milliseconds of work, and one where little is asked of them.
_SHARE = 128


@dataclass(frozen=True, slots=True)
class Closest:
    """How close each of g groups of pairs comes.

    pair : (g,) the pair that comes closest; -1 where none is within what was asked, and where that is not known
    at_s : (g,) its seconds: the earliest instant that is as close, of a touch the first; some one where less will do
    distance_m : (g,) metres on the earth, 0 of a touch, infinite beyond what was asked, NaN where a piece cannot be,
        and where the work of distances is used up
    error_m : (g,) how far from it the least distance may be, either way
    a_deg, b_deg : (g, 2) longitude (in [-180, 180)) and latitude of the nearest points
    """

    pair: _Ints
    at_s: Floats
    distance_m: Floats
    error_m: Floats
    a_deg: Floats
    b_deg: Floats


def closest(
    scene: Scene,
    a: _Ints,
    b: _Ints,
    zero_us: _Ints,
    low_s: Floats,
    high_s: Floats,
    group_offset: _Ints,
    wanted_m: Floats,
    aim_m: Floats,
    work: Work,
    threads: int = 1,
) -> Closest:
    """Return how close pieces a and b come during [low_s, high_s], both ends of which count, the closest of each group.

    group_offset : (g + 1,) the pairs of group k are [group_offset[k], group_offset[k + 1])
    wanted_m : (g,) the distance beyond which nothing needs to be known, metres; may be infinite
    aim_m : (g,) how well the distance needs to be known, metres: coarser takes less work; 0: as well as it can be
    work : counts what is done
    """
    n = len(wanted_m)
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
        mine.hold(offset=offset[groups.start : groups.stop + 1] - first, wanted_m=wanted_m[groups], aim_m=aim_m[groups])
        columns = [getattr(found, column.name)[groups] for column in fields(found)]
        answers = (column.ctypes.data for column in columns)
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

    types: ClassVar[dict[str, Any]] = {"offset": np.int64, "wanted_m": np.float64, "aim_m": np.float64}
    _fields_ = fields_of(types, "count")
