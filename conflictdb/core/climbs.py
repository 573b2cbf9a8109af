"""Times at which the heights of two pieces overlap, if either climbs.

Heights are linear along a leg, so bands overlap during one interval, in closed form. Bands that only touch do not
overlap: the interval is open, and one instant is none. Intervals are widened by the rounding error of heights, which a
slow climb takes long to pass.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import HEIGHT_ROUNDING_M, PieceRows, Pieces
from conflictdb.kernel.differences import Shifts

_Ints = NDArray[np.int64]

# More than the rounding error of a height on the way, relative to the largest height: some ten operations.
_ROUNDING: Final = 32.0 * np.finfo(np.float64).eps


def overlap_at_one_time(pieces: Pieces, a: PieceRows, b: PieceRows) -> tuple[Floats, Floats, Floats]:
    """Return when the heights of pairs (n,) overlap: first and last, seconds after the start of the shared span.

    Also return by how much each end may be too early or too late, seconds. The first is later than the last if they
    never overlap. -inf, inf and 0 for pairs without a climb.
    """
    first, last, error = np.full(len(a), -np.inf), np.full(len(a), np.inf), np.zeros(len(a))
    climbs = pieces.climbs()
    rows = np.flatnonzero(climbs[a] | climbs[b])
    if not rows.size:
        return first, last, error
    a, b = PieceRows(a[rows]), PieceRows(b[rows])
    start_us, end_us = pieces.shared_span(a, b)
    span_s = (end_us - start_us) / 1e6
    bands = [(bands_at(pieces, one, start_us), bands_at(pieces, one, end_us)) for one in (a, b)]
    first[rows], last[rows] = 0.0, span_s
    for (low, high), (low_to, high_to) in (
        ((one[0][0], other[0][1]), (one[1][0], other[1][1])) for one, other in (bands, bands[::-1])
    ):
        _narrow(first, last, error, rows, low, high, low_to, high_to, span_s)
    return first, last, error


def sharing_heights(pieces: Pieces, pairs: Pairs) -> Pairs:
    """Return the pairs whose heights overlap at some instant of their shared time."""
    if not pieces.climbs().any():
        return pairs
    first, last, _ = overlap_at_one_time(pieces, pairs.a, pairs.b)
    return pairs.take(PairRows(np.flatnonzero(first <= last)))


def surely_overlap(pieces: Pieces, a: PieceRows, b: PieceRows) -> NDArray[np.bool_]:
    """Return (n,) whether the heights of pieces overlap whenever both exist."""
    floor, ceiling = pieces.climb_m[:, :2].max(axis=1), pieces.climb_m[:, 2:].min(axis=1)
    return np.asarray((floor[a] < ceiling[b]) & (floor[b] < ceiling[a]))


def with_heights(pieces: Pieces, shifts: Shifts) -> tuple[_Ints, Shifts, Floats]:
    """Return pairs of pieces with times of their own, cut to the times when their heights may overlap.

    If only one piece climbs, the heights overlap at exactly these times; two that climb may still miss each other.

    Returns the rows (m,) of the remaining pairs, the pairs, and the errors (m,) of the ends of these times, seconds:
    infinite if heights are not known to overlap at them.
    """
    n = len(shifts)
    a, b = PieceRows(shifts.a), PieceRows(shifts.b)
    climbs = pieces.climbs()
    if not (climbs[a] | climbs[b]).any():
        return np.arange(n), shifts, np.zeros(n)
    times, doubt_s = {}, np.where(climbs[a] & climbs[b] & ~surely_overlap(pieces, a, b), np.inf, 0.0)
    for name, one, other, zero_us in (("a", a, b, shifts.a_zero_us), ("b", b, a, shifts.b_zero_us)):
        start, end = getattr(shifts, f"{name}_start_s").copy(), getattr(shifts, f"{name}_end_s").copy()
        rows = np.flatnonzero(climbs[one])
        one, other = PieceRows(one[rows]), PieceRows(other[rows])
        leg_us = pieces.leg_start_us[one], pieces.leg_end_us[one]
        span_s = (leg_us[1] - leg_us[0]) / 1e6
        since_s = (leg_us[0] - zero_us[rows]) / 1e6
        first, last, error = np.zeros(len(rows)), span_s.copy(), np.zeros(len(rows))
        floor, floor_to, ceiling, ceiling_to = pieces.climb_m[one].T
        low, high = pieces.floor_m[other], pieces.ceiling_m[other]
        every = np.arange(len(rows))
        _narrow(first, last, error, every, floor, high, floor_to, high, span_s)
        _narrow(first, last, error, every, low, ceiling, low, ceiling_to, span_s)
        start[rows], end[rows] = np.maximum(start[rows], since_s + first), np.minimum(end[rows], since_s + last)
        times[f"{name}_start_s"], times[f"{name}_end_s"] = start, end
        doubt_s[rows] += error
    left = np.flatnonzero((times["a_start_s"] <= times["a_end_s"]) & (times["b_start_s"] <= times["b_end_s"]))
    return left, replace(shifts, **times).take(left), doubt_s[left]


def bands_at(pieces: Pieces, rows: PieceRows, at_us: _Ints) -> tuple[Floats, Floats]:
    """Return the floor and the ceiling (n,) of pieces at an instant each."""
    start_us, end_us = pieces.leg_start_us[rows], pieces.leg_end_us[rows]
    share = (at_us - start_us) / np.maximum(end_us - start_us, 1)
    climb = pieces.climb_m[rows]
    level = climb[:, [0, 2]] == climb[:, [1, 3]]  # also infinite heights
    with np.errstate(invalid="ignore"):
        way = climb[:, [0, 2]] + (climb[:, [1, 3]] - climb[:, [0, 2]]) * share[:, None]
    floor, ceiling = np.where(level, climb[:, [0, 2]], way).T
    return floor, ceiling


def _narrow(
    first: Floats,
    last: Floats,
    error: Floats,
    rows: _Ints,
    low: Floats,
    high: Floats,
    low_to: Floats,
    high_to: Floats,
    span_s: Floats,
) -> None:
    """Cut intervals [first, last] of some rows to the time at which a floor is below a ceiling, both linear in time.

    low, high : floor and ceiling at the start of the span; low_to, high_to : at its end
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        heights = np.abs(np.stack([low, high, low_to, high_to]))
        slack = _ROUNDING * np.where(np.isfinite(heights), heights, 0.0).max(axis=0)
        above, above_to = low - high, low_to - high_to
        is_below, is_below_to = above < -slack, above_to < -slack
        crossing = span_s * (above / (above - above_to))
        # Two heights, each rounded and extended.
        error_m = 2.0 * slack + 4.0 * HEIGHT_ROUNDING_M
        doubt = span_s * (error_m / np.abs(above_to - above) + _ROUNDING)
    late, early = np.flatnonzero(~is_below & is_below_to), np.flatnonzero(is_below & ~is_below_to)
    starts, ends = np.zeros(len(rows)), span_s.copy()
    starts[late] = np.maximum(crossing[late] - doubt[late], 0.0)
    ends[early] = np.minimum(crossing[early] + doubt[early], span_s[early])
    starts[~is_below & ~is_below_to] = np.inf
    first[rows] = np.maximum(first[rows], starts)
    last[rows] = np.minimum(last[rows], ends)
    for some in (late, early):
        error[rows[some]] = np.maximum(error[rows[some]], 2.0 * doubt[some])
