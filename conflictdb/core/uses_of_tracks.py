"""Two tracks with a separation in time, T: when they use one place, and how near they come (kernel/narrow/uses.c)."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.climbs import with_heights
from conflictdb.core.uses import Uses, spans_us
from conflictdb.earth.registry import Setup
from conflictdb.kernel.differences import Shifts
from conflictdb.kernel.time_uses import OF_TRACKS, POSSIBLE, SURE, complete, near_in_time, uses_of_place

_Ints = NDArray[np.int64]

# More than times of pieces are rounded by, microseconds.
_ROUNDING_US: Final = 0.1
# Factor between the distances within which a contact next to a bound is looked for.
_LADDER: Final = 10.0


def uses_of_tracks(
    setup: Setup,
    prepared: kernel.KernelScene,
    pairs: Pairs,
    rows: PairRows,
    work: kernel.Work,
    threads: int,
) -> Uses:
    """Return when pairs of tracks use one place within the separation in time.

    rows : (n,) pairs of pieces of tracks, without covers
    work : counts the work
    """
    scene, a, b = setup.scene, PieceRows(pairs.a[rows]), PieceRows(pairs.b[rows])
    within_us = scene.time_separation_us
    found = uses_of_place(prepared, a, b, within_us, scene.separation_m, scene.tolerance_m, work, threads)
    used = np.flatnonzero(found["is_use"])
    spans = spans_us(prepared.pieces, PieceRows(a[used]), PieceRows(b[used]))
    return Uses(rows[used], complete(found[used], spans, within_us, np.full(len(used), OF_TRACKS)))


def least_reach(
    prepared: kernel.KernelScene, a: PieceRows, b: PieceRows, within_us: int, limit_m: float, aim_m: float
) -> tuple[float, float]:
    """Return two bounds on the least distance of tracks at instants at most `within_us` apart, metres.

    Both are infinite if it is beyond the limit; the second one is infinite if it is not known to be less.

    a, b : (n,) pairs of pieces of tracks, without covers
    aim_m : how close the bounds should be
    """
    work = kernel.Work()
    _, shifts, doubt_s = with_heights(prepared.pieces, _shifts(prepared.pieces, a, b, within_us))

    def near(reach_m: float) -> tuple[_Ints, _Ints]:
        """Return pairs that may come within a reach, and those that do."""
        found = near_in_time(prepared, shifts, reach_m, within_us, work)
        return np.flatnonzero(found >= POSSIBLE), np.flatnonzero((found == SURE) & np.isfinite(doubt_s))

    low_m, high_m, met = 0.0, limit_m, near(limit_m)[0]
    if not met.size:
        return np.inf, np.inf
    while True:
        shifts, doubt_s = shifts.take(met), doubt_s[met]
        if high_m - low_m <= aim_m:
            break
        middle_m = 0.5 * (low_m + high_m)
        met, _ = near(middle_m)
        if met.size:
            high_m = middle_m
        else:
            low_m, met = middle_m, np.arange(len(shifts))
    step_m = aim_m
    while not near(high_m)[1].size:
        if high_m >= limit_m:
            return low_m, np.inf
        high_m, step_m = min(high_m + step_m, limit_m), _LADDER * step_m
    return low_m, high_m


def _shifts(pieces: Pieces, a: PieceRows, b: PieceRows, within_us: int) -> Shifts:
    """Return pairs of tracks (n,), whose differences of time are wanted up to `within_us`."""
    zero_a, zero_b, nothing = pieces.start_us[a], pieces.start_us[b], np.zeros(len(a))
    lasts_s = [(pieces.end_us[one] - pieces.start_us[one]) / 1e6 for one in (a, b)]
    between_us = zero_b - zero_a
    least, most = (np.asarray((sign * (within_us + _ROUNDING_US) - between_us) / 1e6, np.float64) for sign in (-1, 1))
    return Shifts(a, b, zero_a, zero_b, nothing, lasts_s[0], nothing, lasts_s[1], least, most)
