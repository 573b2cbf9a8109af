"""Factors of time at which two moving pieces use one place within a separation in time, T.

Piece a is at u, seconds after its departure, where b is at v. At a factor k, a is there at k u, and they conflict if
|v - k u| <= T. So (v - T) / u and (v + T) / u bound the factors: those of contacts with b shifted by -T and by T. Where
these bounds exceed the limits, the differences v - k u at a limit k decide.
"""

from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.kernel.differences import Shifts, difference_parts, differences

_Ints = NDArray[np.int64]

# More than the separation in time changes if the instants of waypoints are rounded to microseconds.
_ROUNDED_US: Final = 2


class Factors(NamedTuple):
    """Factors of time of n rows.

    row : (n,) the pair
    low, high : (n,) outer intervals, which contain all factors of conflicts
    inner_low, inner_high : (n,) proven intervals, empty (low > high) where nothing is proven
    """

    row: _Ints
    low: Floats
    high: Floats
    inner_low: Floats
    inner_high: Floats


def factors_within(
    prepared: kernel.KernelScene,
    shifts: Shifts,
    doubt_s: Floats,
    least: float,
    most: float,
    reach_m: float,
    within_us: int,
    threads: int,
) -> Factors:
    """Return the factors from least to most that bring pairs to one place within `within_us`.

    A pair may have several rows.

    shifts : (n,) pairs of pieces that move, with one zero for both; only their times are used
    doubt_s : (n,) errors of these times; nothing is proven of pairs that have any
    """
    wide_us, sure_us = within_us + _ROUNDED_US, within_us - _ROUNDED_US
    wide_s, sure_s = wide_us / 1e6, sure_us / 1e6
    work = kernel.Work()
    row, parts, slow = difference_parts(prepared, _all_differences(shifts, least), reach_m, work, threads)
    fast = differences(prepared, _all_differences(parts, most), reach_m, work, threads)
    # If a contact at difference d has factor k, one at a lower factor has a larger difference.
    left = np.flatnonzero((slow["outer_high"] >= -wide_s) & (fast["outer_low"] <= wide_s))
    row, parts, slow, fast = row[left], parts.take(left), slow[left], fast[left]
    n = len(row)
    # Nothing more is known of bounds outside the limits.
    low, high = np.full(n, least), np.full(n, most)
    from_least, to_most = slow["outer_low"] <= wide_s, fast["outer_high"] >= -wide_s
    first, before = _with_b_later(prepared, parts, -wide_us, least, most, reach_m, threads)
    last, after = _with_b_later(prepared, parts, wide_us, least, most, reach_m, threads)
    low[~from_least], high[~to_most] = np.inf, -np.inf
    np.minimum.at(low, first, np.where(from_least[first], least, before["outer_low"]))
    np.maximum.at(high, last, np.where(to_most[last], most, after["outer_high"]))
    is_sure = (doubt_s[row] == 0.0) & (sure_us > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        inner = (
            # Contacts between both ends are connected; each has its own interval of factors.
            (
                first,
                before["inner_low"] + (wide_s - sure_s) / before["low_a_s"],
                before["inner_high"] + (wide_s + sure_s) / before["high_a_s"],
            ),
            (
                last,
                after["inner_low"] - (wide_s + sure_s) / after["low_a_s"],
                after["inner_high"] - (wide_s - sure_s) / after["high_a_s"],
            ),
            (np.arange(n), np.full(n, least), least + _spare(slow, 1.0, parts.a_end_s, sure_s)),
            (np.arange(n), most - _spare(fast, -1.0, parts.a_end_s, sure_s), np.full(n, most)),
        )
    proven = []
    for of, inner_low, inner_high in inner:
        is_known = is_sure[of] & (inner_low <= inner_high)
        few = of[is_known]
        proven.append(Factors(row[few], low[few], high[few], inner_low[is_known], inner_high[is_known]))
    outer = Factors(row, low, high, np.full(n, np.inf), np.full(n, -np.inf))
    return Factors(*(np.concatenate(columns) for columns in zip(outer, *proven, strict=True)))


def _all_differences(shifts: Shifts, factor: float) -> Shifts:
    """Return pairs (n,) asked about all differences v - factor u."""
    endless = np.full(len(shifts), np.inf)
    return replace(shifts, least=-endless, most=endless, is_factor=False, weight=np.full(len(shifts), factor))


def _with_b_later(
    prepared: kernel.KernelScene, parts: Shifts, later_us: int, least: float, most: float, reach_m: float, threads: int
) -> tuple[_Ints, NDArray[Any]]:
    """Return rows of pairs, and their factors if the other object is `later_us` later (negative: earlier)."""
    n, later_s = len(parts), later_us / 1e6
    shifted = replace(
        parts,
        b_zero_us=parts.b_zero_us - later_us,
        b_start_s=parts.b_start_s + later_s,
        b_end_s=parts.b_end_s + later_s,
        least=np.full(n, least),
        most=np.full(n, most),
        is_factor=True,
        weight=None,
    )
    row, _, found = difference_parts(prepared, shifted, reach_m, kernel.Work(), threads)
    return row, found


def _spare(found: NDArray[Any], sign: float, longest_s: Floats, within_s: float) -> Floats:
    """Return by how much (n,) a factor may grow, or shrink, so that a proven contact stays within the separation.

    found : the differences at this factor
    sign : 1: to grow, -1: to shrink
    longest_s : (n,) the largest seconds of a
    """
    spare = np.full(len(found), -np.inf)
    inner_low, inner_high = found["inner_low"], found["inner_high"]
    for end in ("low", "high"):
        difference = found[f"inner_{end}"]
        is_within = np.abs(difference) <= within_s
        spare = np.where(is_within, np.maximum(spare, (sign * difference + within_s) / found[f"{end}_a_s"]), spare)
    passes = (inner_low < -within_s) & (inner_high > within_s)
    return np.where(passes, 2.0 * within_s / longest_s, spare)
