"""Stages 3 and 4 of two tracks with a separation in time, T.

Tracks A and B conflict if A at u and B at v come within the separation for instants u and v at most T apart. The
differences v - u of contact within T decide that (`kernel.differences`). Contacts of A with B, shifted by such a
difference, tell whether they are deeper than the tolerance.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.climbs import surely_overlap, with_heights
from conflictdb.core.ends_of_uses import LADDER, ROUNDING_US, ends_of, guessed_ends, shifted
from conflictdb.core.uses import Uses
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.kernel.differences import DifferenceState, Shifts, difference_parts, differences
from conflictdb.kernel.meeting import meetings
from conflictdb.model.results import Verdict

_Ints = NDArray[np.int64]

# Shifts at which two tracks are tested for an overlap deeper than the tolerance, if it is not as deep in the middle.
# Clearance is nearly convex in the shift, so that an overlap which is deeper by an eighth is found.
_SHIFTS: Final = 17
# Pairs decided at once: their pieces, four jobs each, fit into memory.
_AT_ONCE: Final = 20_000


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
    some = (PairRows(rows[first : first + _AT_ONCE]) for first in range(0, max(len(rows), 1), _AT_ONCE))
    return Uses.concatenate([one for few in some for one in _of_some(setup, prepared, pairs, few, work, threads)])


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
        row, found = _solved(prepared, shifts, reach_m, within_us, work, 1)
        between_us = (shifts.b_zero_us - shifts.a_zero_us)[row]
        low, high = _outer_us(found, between_us)
        is_sure = _is_sure(found, between_us, within_us) & np.isfinite(doubt_s[row])
        return np.unique(row[(low <= within_us) & (high >= -within_us)]), row[is_sure]

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
        high_m, step_m = min(high_m + step_m, limit_m), LADDER * step_m
    return low_m, high_m


def _of_some(
    setup: Setup,
    prepared: kernel.KernelScene,
    pairs: Pairs,
    rows: PairRows,
    work: kernel.Work,
    threads: int,
) -> Iterator[Uses]:
    """Yield the uses of pairs that come within the separation, then of the others that come within the tolerance."""
    within_us = setup.scene.time_separation_us
    shifts = _shifts(prepared.pieces, PieceRows(pairs.a[rows]), PieceRows(pairs.b[rows]), within_us)
    left, shifts, _ = with_heights(prepared.pieces, shifts)
    rows = PairRows(rows[left])
    met = _of_reach(setup, prepared, shifts, setup.scene.separation_m, touches=True, work=work, threads=threads)
    yield replace(met, pair=rows[met.pair])
    rest = np.setdiff1d(np.arange(len(rows)), met.pair)
    if len(rest) and setup.scene.tolerance_m > 0.0:
        reach_m = setup.scene.separation_m + setup.scene.tolerance_m
        met = _of_reach(setup, prepared, shifts.take(rest), reach_m, touches=False, work=work, threads=threads)
        yield replace(met, pair=rows[rest[met.pair]])


def _of_reach(
    setup: Setup,
    prepared: kernel.KernelScene,
    shifts: Shifts,
    reach_m: float,
    *,
    touches: bool,
    work: kernel.Work,
    threads: int,
) -> Uses:
    """Return uses of pairs of tracks (n,) that come within a reach of each other's places; `pair` counts from 0."""
    within_us = setup.scene.time_separation_us
    between_us = shifts.b_zero_us - shifts.a_zero_us
    row, found = _solved(prepared, shifts, reach_m, within_us, work, threads)
    outer = [np.clip(end, -within_us, within_us) for end in _outer_us(found, between_us[row])]
    inner = _inner_us(found, between_us[row])
    is_sure = _is_sure(found, between_us[row], within_us)
    pair, row = np.unique(row, return_inverse=True)
    n = len(pair)
    gap, sure_gap = np.full(n, np.inf), np.full(n, np.inf)
    np.minimum.at(gap, row, np.maximum(0.0, np.maximum(outer[0], -outer[1])))
    np.minimum.at(sure_gap, row[is_sure], np.maximum(0.0, np.maximum(inner[0], -inner[1]))[is_sure])
    # Of several intervals of shifts the widest is tested.
    order = np.lexsort((outer[1] - outer[0], row))
    widest = order[np.append(np.flatnonzero(np.diff(row[order])), len(order) - 1)] if n else order
    asked = shifts.take(pair)
    verdict = _verdicts(setup, prepared.pieces, asked, outer[0][widest], outer[1][widest], work, threads)
    is_sure_pair = np.isfinite(sure_gap)
    # Heights at two times: the tests know those of whole slices.
    is_level = surely_overlap(prepared.pieces, PieceRows(asked.a), PieceRows(asked.b))
    verdict[(verdict != Verdict.CONFLICT.code) & is_sure_pair] = Verdict.GRAZING.code
    verdict[~is_level] = Verdict.UNRESOLVED.code
    guesses_s = guessed_ends(setup.plane, prepared, asked, reach_m, within_us, work, threads)
    ends_s, error_s = ends_of(prepared, asked, guesses_s, reach_m, within_us, work, threads)
    first_us = [
        zero + np.floor(1e6 * ends_s[k]).astype(np.int64) for zero, k in ((asked.a_zero_us, 0), (asked.b_zero_us, 2))
    ]
    last_us = [
        zero + np.ceil(1e6 * ends_s[k]).astype(np.int64) for zero, k in ((asked.a_zero_us, 1), (asked.b_zero_us, 3))
    ]
    lacking_s = np.maximum(np.rint(within_us - gap), 0.0) / 1e6
    is_open = verdict == Verdict.UNRESOLVED.code
    uses = Uses(
        pair,
        first_us[0],
        last_us[0],
        first_us[1],
        last_us[1],
        error_s,
        verdict.astype(np.int8),
        np.full(n, touches),
        np.where(is_open, np.nan, lacking_s),
        np.where(is_open, np.nan, np.minimum((sure_gap - gap + 1.0) / 1e6, lacking_s)),
        _first_contacts(setup.plane, prepared, asked, ends_s, error_s, reach_m, within_us, work, threads),
    )
    # A track is proven apart before its first time and after its last one. If these parts cover all of its time, the
    # pair is apart: its whole was not proven so, and both parts are. Against a proven contact it stays inverted, which
    # `with_ordered_times` makes unresolved.
    is_apart = (ends_s[0] > ends_s[1]) | (ends_s[2] > ends_s[3])
    is_apart &= ~is_sure_pair & (verdict != Verdict.CONFLICT.code)
    return uses.take(np.flatnonzero(~is_apart))


def _solved(
    prepared: kernel.KernelScene, shifts: Shifts, reach_m: float, within_us: int, work: kernel.Work, threads: int
) -> tuple[_Ints, NDArray[Any]]:
    """Return rows of pairs that may come within a reach, and their differences (`difference_parts`).

    A pair without a proven contact is asked again about all differences: ends are sharper that way, and `stages.delays`
    asks so. Thus what it proves free is free.
    """
    row, _, found = difference_parts(prepared, shifts, reach_m, work, threads)
    between_us = shifts.b_zero_us - shifts.a_zero_us
    doubtful = np.setdiff1d(row, row[_is_sure(found, between_us[row], within_us)])
    if not doubtful.size:
        return row, found
    endless = np.full(len(doubtful), np.inf)
    asked = replace(shifts.take(doubtful), least=-endless, most=endless)
    of, _, every = difference_parts(prepared, asked, reach_m, work, threads)
    low, high = _outer_us(every, between_us[doubtful[of]])
    apart = np.setdiff1d(doubtful, doubtful[of[~((low > within_us) | (high < -within_us))]])
    left = np.flatnonzero(~np.isin(row, apart))
    return row[left], found[left]


def _outer_us(found: NDArray[Any], between_us: _Ints) -> list[Floats]:
    """Return the ends (n,) of the differences outside of which no contact is, microseconds."""
    return [1e6 * found[f"outer_{end}"] + between_us + sign * ROUNDING_US for end, sign in (("low", -1), ("high", 1))]


def _inner_us(found: NDArray[Any], between_us: _Ints) -> list[Floats]:
    """Return the ends (n,) of the differences that are proven to be contacts, microseconds."""
    return [1e6 * found[f"inner_{end}"] + between_us - sign * ROUNDING_US for end, sign in (("low", -1), ("high", 1))]


def _is_sure(found: NDArray[Any], between_us: _Ints, within_us: int) -> NDArray[np.bool_]:
    """Return whether differences (n,) have a proven contact within `within_us`."""
    low, high = _inner_us(found, between_us)
    return (np.maximum(low, -within_us) <= np.minimum(high, within_us)) & (found["state"] == DifferenceState.INNER)


def _shifts(pieces: Pieces, a: PieceRows, b: PieceRows, within_us: int) -> Shifts:
    """Return pairs of tracks (n,), asked about differences of time within so many microseconds."""
    zero_a, zero_b, nothing = pieces.start_us[a], pieces.start_us[b], np.zeros(len(a))
    lasts_s = [(pieces.end_us[one] - pieces.start_us[one]) / 1e6 for one in (a, b)]
    between_us = zero_b - zero_a
    least, most = (np.asarray((sign * (within_us + ROUNDING_US) - between_us) / 1e6, np.float64) for sign in (-1, 1))
    return Shifts(a, b, zero_a, zero_b, nothing, lasts_s[0], nothing, lasts_s[1], least, most)


def _verdicts(
    setup: Setup,
    pieces: Pieces,
    shifts: Shifts,
    low_us: Floats,
    high_us: Floats,
    work: kernel.Work,
    threads: int,
) -> NDArray[np.int64]:
    """Return verdicts on pairs of tracks (n,): conflict if at some tested shift they are deeper than the tolerance.

    low_us, high_us : (n,) the shifts at which they meet
    """
    verdict = np.full(len(shifts), Verdict.UNRESOLVED.code)
    middle, *others = np.roll(np.linspace(0.0, 1.0, _SHIFTS), -(_SHIFTS // 2))
    for share in (np.array([middle]), np.array(others)):
        left = np.flatnonzero(verdict != Verdict.CONFLICT.code)
        rows = np.repeat(left, len(share))
        tested = np.rint(low_us[rows] + np.tile(share, len(left)) * (high_us - low_us)[rows]).astype(np.int64)
        moved, a, b = shifted(setup.plane, pieces, shifts.take(rows), tested)
        start, end = moved.pieces.shared_span(a, b)
        there = np.flatnonzero(start <= end)
        span_s = np.where(start <= end, end - start, 0) / 1e6
        asked = kernel.Questions(a, b, start, np.zeros(len(a)), span_s, np.full(len(a), np.inf)).take(there)
        if not len(asked):
            continue
        found = kernel.contacts(moved, asked, setup.scene.separation_m, setup.scene.tolerance_m, work, threads)
        for code in (Verdict.GRAZING.code, Verdict.CONFLICT.code):
            verdict[rows[there[found.pair[found.verdict == code]]]] = code
    return verdict


def _first_contacts(
    plane: Plane,
    prepared: kernel.KernelScene,
    shifts: Shifts,
    ends_s: Floats,
    error_s: Floats,
    reach_m: float,
    within_us: int,
    work: kernel.Work,
    threads: int,
) -> Floats:
    """Return where the uses of pairs (n,) begin: the place of the first piece that is where the other will be."""
    between_us = shifts.b_zero_us - shifts.a_zero_us
    is_a = 1e6 * (ends_s[0] - ends_s[2]) <= between_us
    times = {name: getattr(shifts, name) for name in ("a_start_s", "a_end_s", "b_start_s", "b_end_s")}
    begins = np.where(is_a, ends_s[0], ends_s[2])
    for member, is_first, at in (("a", is_a, ends_s[0]), ("b", ~is_a, ends_s[2])):
        start, stop = times[f"{member}_start_s"], times[f"{member}_end_s"]
        times[f"{member}_end_s"] = np.where(is_first, np.minimum(at + error_s, stop), stop)
        times[f"{member}_start_s"] = np.where(is_first, np.minimum(at, stop), start)
    found = differences(prepared, replace(shifts, **times), reach_m, work, threads)
    sure = found["state"] == DifferenceState.INNER
    low, high = (
        np.where(
            sure, found[f"inner_{name}"], np.where(np.isfinite(found[f"outer_{name}"]), found[f"outer_{name}"], 0.0)
        )
        for name in ("low", "high")
    )
    by_us = np.clip(np.rint(0.5e6 * (low + high)).astype(np.int64) + between_us, -within_us, within_us)
    moved, a, b = shifted(plane, prepared.pieces, shifts, by_us)
    start, end = moved.pieces.shared_span(a, b)
    begins_us = np.rint(1e6 * begins).astype(np.int64)
    at_us = np.where(is_a, shifts.a_zero_us + begins_us, shifts.b_zero_us + begins_us - by_us)
    at_us = np.clip(at_us, np.minimum(start, end), np.maximum(start, end))
    return meetings(moved, a, b, at_us, np.zeros(len(shifts)), threads)
