"""Exact delays of a chosen order: which gap each pair takes leaves a system of differences, solved in whole numbers.

A solver keeps its rows to a tolerance only, so its numbers are no plan. Its choice of gaps is one: the least delays
that keep to these gaps are longest ways (Bellman, Ford), in microseconds.
"""

import numpy as np
from numpy.typing import NDArray

from conflictdb.memory.program import Program

_Ints = NDArray[np.int64]

# A start below a solver's numbers, microseconds: more than these are rounded by.
_BELOW_US = 5


def settle(program: Program, near: NDArray[np.float64], left: frozenset[int]) -> _Ints | None:
    """Return exact delays (n,) in the gaps next to some numbers, microseconds; None if these gaps admit none.

    Where no track may be earlier these are the least delays of these gaps, else those next to the numbers.

    left : tracks that stay as planned
    """
    low, high = np.zeros(len(program), np.int64), np.zeros(len(program), np.int64)
    for i in range(len(program)):
        if i not in left:
            free = program.gaps_of(i)
            if not len(free):
                return None
            low[i], high[i] = _next(free, near[i])
    rows = []
    for i, j in program.pair:
        if i in left and j in left:
            continue
        free = program.gaps_between(i, j)
        if not len(free):
            return None
        least, most = _next(free, (0.0 if i in left else near[i]) - (0.0 if j in left else near[j]))
        # d_i >= d_j + least, and d_j >= d_i - most.
        rows += [(i, j, least), (j, i, -most)]
    delays = low.copy()
    if (program.low < 0).any():
        delays = np.clip(np.floor(near).astype(np.int64) - _BELOW_US, low, high)
    if rows:
        to, of, more = (np.array(column, np.int64) for column in zip(*rows, strict=True))
        for _ in range(len(program) + 1):
            raised = delays.copy()
            np.maximum.at(raised, to, delays[of] + more)
            if (raised == delays).all():
                break
            delays = raised
        else:
            return None
    return delays if (delays <= high).all() else None


def _next(free: _Ints, value: float) -> tuple[int, int]:
    """Return the gap next to a value, of gaps (k, 2)."""
    away = np.maximum(np.maximum(free[:, 0] - value, value - free[:, 1]), 0.0)
    low, high = free[int(np.argmin(away))].tolist()
    return low, high
