"""Roots of functions of one variable, for many rows at once: `crossing` brackets where they cross a level.

Each row has its own bracket and stops by itself, and what is found of it does not depend on the other rows: scipy's
scalar methods would call Python for every row.

References: M. Dowell, P. Jarratt, "A modified regula falsi method", BIT 11 (1971), doi:10.1007/BF01934364 (the Illinois
variant; bisection where it hardly narrows the bracket).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.constants import BRACKET_S, MAX_LEVELS

# A function of one variable for each row: given numbers of rows and a value for each, returns theirs.
Measure = Callable[[NDArray[np.int64], Floats], Floats]


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
