"""Where a measure of many rows changes its sign: between two instants, as near to each other as rounding lets them be.

Regula falsi (M. Dowell, P. Jarratt, "A modified regula falsi method", BIT 11 (1971), doi:10.1007/BF01934364), and
bisection where that hardly narrows the bracket, as where the measure only just falls below zero.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.constants import MAX_ROOT_STEPS, MOST_TOUCHES, RESOLVED_SPACINGS, SLOW_STEPS

# Of rows (numbers) at instants, a function of time: their clearance, or their distance.
Measure = Callable[[NDArray[np.int64], Floats], Floats]


@dataclass(frozen=True, slots=True)
class Roots:
    """Instants (n,) beyond doubt on either side of a change of sign, and whether they were found."""

    outer: Floats
    inner: Floats
    is_found: NDArray[np.bool_]


def roots(measure: Measure, outside: Floats, gap: Floats, inside: Floats, depth: Floats, touch: Floats) -> Roots:
    """Return where a measure falls from `gap` > touch at `outside` to `depth` < -touch at `inside`, (n,) each.

    First to zero, and from there to where it is beyond doubt on either side: by one to MOST_TOUCHES times `touch`.
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
    # Where instants are too few to reach that, the bracket itself is left.
    outer, above = (np.where(found, *ends)[:n] for ends in ((both.at, both.outside), (both.value, both.gap)))
    inner, below = (np.where(found, *ends)[n:] for ends in ((both.at, both.inside), (both.value, both.depth)))
    is_wide = (both.ending == _Ending.OUT_OF_STEPS).reshape(2, n).any(axis=0)
    return Roots(outer, inner, ~is_wide & (above > touch) & (below < -touch))


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
    # What counts at the ends; of an end that stays twice only half, so that the other comes over.
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
