"""Roots and minima of functions of one variable, for many rows at once.

`roots` finds where a function changes its sign, with instants on both sides where the sign is beyond rounding;
`crossing` brackets where it crosses a level; `first_below` bisects towards the earliest crossing; `golden_section`
finds a minimum.

Each row has its own bracket and stops by itself, so that its result does not depend on the other rows. scipy's scalar
methods would call Python for every row, and none of scipy's stops where the sign is certain on both sides. Inverses of
closed formulas (latitudes in `earth.geodesy`, circles in `io.discs`) take a fixed number of Newton or fixed-point steps
where they stand, and need no bracket.

References: M. Dowell, P. Jarratt, "A modified regula falsi method", BIT 11 (1971), doi:10.1007/BF01934364 (the Illinois
variant; bisection where it hardly narrows the bracket). J. Kiefer, "Sequential minimax search for a maximum", Proc. AMS
4 (1953), doi:10.1090/S0002-9939-1953-0055639-3 (golden section).
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.constants import (
    BRACKET_S,
    MAX_BISECTIONS,
    MAX_LEVELS,
    MAX_ROOT_STEPS,
    MOST_TOUCHES,
    RESOLVED_SPACINGS,
    SLOW_STEPS,
)

# A function of one variable for each row: given numbers of rows and a value for each, returns theirs.
Measure = Callable[[NDArray[np.int64], Floats], Floats]

GOLDEN: Final = 0.5 * (5.0**0.5 - 1.0)


@dataclass(frozen=True, slots=True)
class Roots:
    """Instants (n,) on either side of a change of sign, where the sign is certain, and whether they were found."""

    outer: Floats
    inner: Floats
    is_found: NDArray[np.bool_]


def roots(measure: Measure, outside: Floats, gap: Floats, inside: Floats, depth: Floats, touch: Floats) -> Roots:
    """Return where a measure falls from `gap` > touch at `outside` to `depth` < -touch at `inside`, (n,) each.

    First zero is found, then an instant on either side of it where the sign is certain: where the measure is between
    one and MOST_TOUCHES times `touch`.
    """
    n = len(gap)
    rows = np.arange(n)
    zero = _narrowed(measure, rows, _Bracket(outside, gap, inside, depth), -touch, touch, np.full(n, np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        before = (zero.outside - zero.at) / (zero.gap - zero.value)
        after = (zero.at - zero.inside) / (zero.value - zero.depth)
    # Seconds that one metre takes there, by the nearer end of the bracket.
    pace = np.where(np.abs(zero.outside - zero.at) < np.abs(zero.inside - zero.at), before, after)
    way = 0.5 * (1.0 + MOST_TOUCHES) * touch * pace
    both = _narrowed(
        measure,
        np.concatenate([rows, rows]),
        _Bracket(*(np.concatenate(ends) for ends in zero.halves())),
        np.concatenate([touch, -MOST_TOUCHES * touch]),
        np.concatenate([MOST_TOUCHES * touch, -touch]),
        np.concatenate([zero.at + way, zero.at - way]),
    )
    found = both.ending == _Ending.FOUND
    # Where instants are too coarse for that, the ends of the bracket are returned.
    outer, above = (np.where(found, *ends)[:n] for ends in ((both.at, both.outside), (both.value, both.gap)))
    inner, below = (np.where(found, *ends)[n:] for ends in ((both.at, both.inside), (both.value, both.depth)))
    is_wide = (both.ending == _Ending.OUT_OF_STEPS).reshape(2, n).any(axis=0)
    return Roots(outer, inner, ~is_wide & (above > touch) & (below < -touch))


def crossing(measure: Measure, outside: Floats, inside: Floats, level: Floats | float) -> tuple[Floats, Floats]:
    """Return brackets (outer, inner) of where a measure crosses a level, no wider than BRACKET_S.

    outside, inside : (n,) seconds, with measure > level at outside and <= level at inside (either may be the later).
    A row that is not above the level at `outside` gets `outside` for both.
    """
    rows = np.arange(len(outside))
    outer, level = outside.copy(), np.broadcast_to(level, outside.shape)
    above, below = measure(rows, outer) - level, measure(rows, inside) - level
    inner = np.where(above > 0.0, inside, outer)
    side = np.zeros(len(rows), np.int8)
    for step in range(2 * MAX_LEVELS):
        wide = (np.abs(outer - inner) > BRACKET_S) & (np.nextafter(outer, inner) != inner)
        active = np.flatnonzero(wide)
        if not active.size:
            break
        first, last, f0, f1 = outer[active], inner[active], above[active], below[active]
        # Regula falsi, stepping over by less than a bracket so that the other end follows; every third time bisection.
        with np.errstate(divide="ignore", invalid="ignore"):
            share = f0 / (f0 - f1)
        share = np.where(np.isfinite(share) & (step % 3 < 2), share, 0.5)
        over = 0.4 * BRACKET_S / np.abs(last - first) * np.where(side[active] > 0, 1.0, -1.0)
        at = first + np.clip(share + np.where(step % 3 < 2, over, 0.0), 0.0, 1.0) * (last - first)
        at = np.where((at == first) | (at == last), 0.5 * (first + last), at)
        found = measure(rows[active], at) - level[active]
        is_above = found > 0.0
        again = side[active] == np.where(is_above, 1, -1)
        outer[active] = np.where(is_above, at, first)
        inner[active] = np.where(is_above, last, at)
        above[active] = np.where(is_above, found, np.where(again, 0.5 * f0, f0))
        below[active] = np.where(is_above, np.where(again, 0.5 * f1, f1), found)
        side[active] = np.where(is_above, 1, -1)
    return outer, inner


def first_below(measure: Measure, outside: Floats, inside: Floats, level: Floats | float) -> Floats:
    """Return (n,) instants from which on a measure is at most a level, found by bisection to BRACKET_S, seconds.

    outside, inside : (n,) seconds, the measure at most the level at `inside`, the later. A row that is at most the
        level at `outside` gets that.
    """
    rows = np.arange(len(outside))
    outside, inside, level = outside.copy(), inside.copy(), np.broadcast_to(level, outside.shape)
    below = measure(rows, outside) <= level
    inside[below] = outside[below]
    for _ in range(MAX_BISECTIONS):
        active = np.flatnonzero(inside - outside > BRACKET_S)
        if not active.size:
            break
        middle = 0.5 * (outside + inside)[active]
        below = measure(active, middle) <= level[active]
        inside[active] = np.where(below, middle, inside[active])
        outside[active] = np.where(below, outside[active], middle)
    return inside


def golden_section(
    measure: Measure, low: Floats, high: Floats, resolution: float, most: int, pace: Floats | float = 1.0
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return (low, high, at, value): what is left of brackets of a minimum, and the lesser of the last values in them.

    It is a local minimum if the measure has several.

    resolution : brackets are narrowed to this width, times `pace` (n,); most : steps at most
    """
    rows = np.arange(len(low))
    low, high = low.copy(), high.copy()
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = measure(rows, left), measure(rows, right)
    for _ in range(most):
        # Each row by itself: what is found of it does not depend on the company it is in.
        k = np.flatnonzero((high - low) * pace > resolution)
        if not k.size:
            break
        earlier = at_left[k] <= at_right[k]
        low[k], high[k] = np.where(earlier, low[k], left[k]), np.where(earlier, right[k], high[k])
        width = GOLDEN * (high[k] - low[k])
        new = np.where(earlier, high[k] - width, low[k] + width)
        at_new = measure(k, new)
        left[k], right[k] = np.where(earlier, new, right[k]), np.where(earlier, left[k], new)
        at_left[k], at_right[k] = np.where(earlier, at_new, at_right[k]), np.where(earlier, at_left[k], at_new)
    return low, high, np.where(at_left <= at_right, left, right), np.minimum(at_left, at_right)


@dataclass(frozen=True, slots=True)
class _Bracket:
    """Instants (n,) between which a measure falls, and its values there."""

    outside: Floats
    gap: Floats
    inside: Floats
    depth: Floats


class _Ending(IntEnum):
    """How the narrowing of a bracket ended."""

    FOUND = 0  # the measure is in the wanted range
    RESOLVED = 1  # the bracket is as narrow as instants can be
    OUT_OF_STEPS = 2


@dataclass(frozen=True, slots=True)
class _Narrowed(_Bracket):
    """What is left of brackets, and the instants that were looked for, with the values there.

    ending : (n,) int8, `_Ending`; where it is not FOUND the instant and value are those of the inner end
    """

    at: Floats
    value: Floats
    ending: NDArray[np.int8]

    def halves(self) -> tuple[tuple[Floats, Floats], ...]:
        """Return the brackets outside and inside of the instants: outsides, gaps, insides, depths of both."""
        return (
            (self.outside, self.at),
            (self.gap, self.value),
            (self.at, self.inside),
            (self.value, self.depth),
        )


def _narrowed(
    measure: Measure, rows: NDArray[np.int64], bracket: _Bracket, least: Floats, most: Floats, guess: Floats
) -> _Narrowed:
    """Return brackets narrowed until the measure is between `least` and `most` at an instant.

    guess : (n,) where to look first; NaN where there is none
    """
    a, fa, b, fb = bracket.outside.copy(), bracket.gap.copy(), bracket.inside.copy(), bracket.depth.copy()
    aim = 0.5 * (least + most)
    # The values that regula falsi takes at the ends. The value of an end that stays for two steps is halved (Illinois),
    # so that the other end moves too.
    ga, gb = fa - aim, fb - aim
    side, slow = np.zeros(len(rows), np.int8), np.zeros(len(rows), np.int8)
    at, value, is_found = b.copy(), fb.copy(), fb > least
    first = fa < most
    at[first], value[first], is_found[first] = a[first], fa[first], True
    active = np.flatnonzero(~is_found & _differ(a, b))
    for step in range(MAX_ROOT_STEPS):
        if not active.size:
            break
        x0, x1, g0, g1 = a[active], b[active], ga[active], gb[active]
        with np.errstate(divide="ignore", invalid="ignore"):
            x = x0 + (x1 - x0) * (g0 / (g0 - g1))
        if step == 0:
            x = np.where(np.isfinite(guess[active]), guess[active], x)
        is_between = (x - x0) * (x - x1) < 0.0
        x = np.where(is_between & (slow[active] < SLOW_STEPS), x, 0.5 * (x0 + x1))
        f = measure(rows[active], x)
        done = (f > least[active]) & (f < most[active])
        is_outside = f >= most[active]
        again = side[active] == np.where(is_outside, 1, -1)
        g = f - aim[active]
        a[active], b[active] = np.where(is_outside, x, x0), np.where(is_outside | done, x1, x)
        fa[active], fb[active] = np.where(is_outside, f, fa[active]), np.where(is_outside | done, fb[active], f)
        ga[active] = np.where(is_outside, g, np.where(again, 0.5 * g0, g0))
        gb[active] = np.where(is_outside, np.where(again, 0.5 * g1, g1), g)
        side[active] = np.where(is_outside, 1, -1)
        halved = np.abs(b[active] - a[active]) <= 0.5 * np.abs(x1 - x0)
        slow[active] = np.where(halved, 0, slow[active] + 1)
        some = active[done]
        at[some], value[some], is_found[some] = x[done], f[done], True
        active = active[~done]
        active = active[_differ(a[active], b[active])]
    ending = np.where(is_found, _Ending.FOUND, _Ending.RESOLVED).astype(np.int8)
    ending[active] = _Ending.OUT_OF_STEPS
    at, value = np.where(is_found, at, b), np.where(is_found, value, fb)
    return _Narrowed(a, fa, b, fb, at, value, ending)


def _differ(a: Floats, b: Floats) -> NDArray[np.bool_]:
    """Return whether there are instants between two."""
    return np.asarray(np.abs(b - a) > RESOLVED_SPACINGS * np.spacing(np.maximum(np.abs(a), np.abs(b))))
