"""Roots and minima of functions of one variable, for many rows at once.

`crossing` brackets where a function crosses a level; `first_below` bisects towards the earliest crossing;
`golden_section` finds a minimum.

Each row has its own bracket and stops by itself, and what is found of it does not depend on the other rows: scipy's
scalar methods would call Python for every row.

References: M. Dowell, P. Jarratt, "A modified regula falsi method", BIT 11 (1971), doi:10.1007/BF01934364 (the Illinois
variant; bisection where it hardly narrows the bracket). J. Kiefer, "Sequential minimax search for a maximum", Proc. AMS
4 (1953), doi:10.1090/S0002-9939-1953-0055639-3 (golden section).
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.constants import BRACKET_S, MAX_BISECTIONS, MAX_LEVELS

# A function of one variable for each row: given numbers of rows and a value for each, returns theirs.
Measure = Callable[[NDArray[np.int64], Floats], Floats]

GOLDEN: Final = 0.5 * (5.0**0.5 - 1.0)


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
