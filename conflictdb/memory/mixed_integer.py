"""The program of delays as a mixed-integer linear program, solved by HiGHS.

Each track and each pair chooses one of its free gaps g by binaries z: sum z_g = 1 and
sum low_g z_g <= d <= sum high_g z_g, d being a delay or a difference. A track that is left as planned has the delay 0,
and relieves its own rows.
"""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from conflictdb.memory.program import Pair, Program

_Ints = NDArray[np.int64]

# Cost of what does not count, beside what does: of all delays, if the goal is the largest.
_TRACE = 1e-7
_INFEASIBLE = 2  # status of scipy.optimize.milp


@dataclass(frozen=True, slots=True)
class Relaxed:
    """What the solver says of a program with some of its pairs.

    delays : (n,) microseconds, as exact as a solver is; None if it found none
    left : the tracks that are left as planned
    bound : lower bound of the objective, in which each track that is left counts `penalty`
    is_infeasible : whether no delays exist, so that some tracks must be left
    """

    delays: NDArray[np.float64] | None
    left: frozenset[int]
    bound: float
    is_infeasible: bool


class _Matrix:
    """Rows and columns of a linear program, one by one."""

    def __init__(self) -> None:
        self.cost: list[float] = []
        self.bounds: list[tuple[float, float]] = []
        self.whole: list[int] = []
        self.terms: list[tuple[int, int, float]] = []
        self.limits: list[tuple[float, float]] = []

    def column(self, cost: float, low: float, high: float, whole: bool = False) -> int:
        self.cost.append(cost)
        self.bounds.append((low, high))
        self.whole.append(int(whole))
        return len(self.cost) - 1

    def row(self, terms: Iterable[tuple[int, float]], low: float, high: float) -> None:
        self.terms += [(len(self.limits), column, value) for column, value in terms]
        self.limits.append((low, high))


def solve(
    program: Program,
    pairs: Iterable[Pair],
    goal: str,
    limit_s: float,
    penalty: float | None,
    cuts: Sequence[tuple[tuple[int, ...], float]] = (),
) -> Relaxed:
    """Solve the program with some of its pairs.

    penalty : cost of a track that is left; None: none may be
    cuts : tracks, and the least sum of their weighted delays (goal ``total``) or largest of them, seconds
    """
    rows = _Matrix()
    low, high = program.low / 1e6, program.high / 1e6
    n = len(program)
    counts = program.weight if goal == "total" else _TRACE * program.weight
    may_be_early = bool((program.low < 0).any())
    delay = [rows.column(0.0 if may_be_early else counts[i], low[i], high[i]) for i in range(n)]
    size = delay
    if may_be_early:
        size = [rows.column(counts[i], 0.0, np.inf) for i in range(n)]
        for i in range(n):
            rows.row([(size[i], 1.0), (delay[i], -1.0)], 0.0, np.inf)
            rows.row([(size[i], 1.0), (delay[i], 1.0)], 0.0, np.inf)
    if goal == "largest":
        largest = rows.column(1.0, 0.0, np.inf)
        for i in range(n):
            rows.row([(largest, 1.0), (size[i], -program.weight[i])], 0.0, np.inf)
    left = [] if penalty is None else [rows.column(penalty, 0.0, 1.0, True) for _ in range(n)]
    for i, x in enumerate(left):
        rows.row([(delay[i], 1.0), (x, high[i])], -np.inf, high[i])
        rows.row([(delay[i], 1.0), (x, low[i])], low[i], np.inf)
    if penalty is None:
        for tracks, least in cuts:
            if goal == "total":
                rows.row([(size[i], program.weight[i]) for i in tracks], least, np.inf)
            else:
                rows.row([(largest, 1.0)], least, np.inf)

    def choose(terms: list[tuple[int, float]], free: _Ints, least: float, most: float, relief: list[int]) -> bool:
        """Add the rows of a choice; return whether there is one."""
        if not len(free) and not relief:
            return False
        ends = (free / 1e6).tolist()
        if len(ends) == 1 and not relief:
            rows.row(terms, *ends[0])
            return True
        chosen = [rows.column(0.0, 0.0, 1.0, True) for _ in ends]
        # A pair is relieved only if both of its tracks are left: relief - 1 < their sum.
        if len(relief) == 2:
            is_out = rows.column(0.0, 0.0, 1.0)
            for x in relief:
                rows.row([(is_out, 1.0), (x, -1.0)], -np.inf, 0.0)
            out = [(is_out, 1.0)]
        else:
            out = [(x, 1.0) for x in relief]
        rows.row([*((x, 1.0) for x in chosen), *out], 1.0, 1.0)
        lows = [(x, -end[0]) for x, end in zip(chosen, ends, strict=True)] + [(x, -least) for x, _ in out]
        highs = [(x, -end[1]) for x, end in zip(chosen, ends, strict=True)] + [(x, -most) for x, _ in out]
        rows.row([*terms, *lows], 0.0, np.inf)
        rows.row([*terms, *highs], -np.inf, 0.0)
        return True

    possible = True
    for i in range(n):
        relief = [left[i]] if left else []
        possible &= choose([(delay[i], 1.0)], program.gaps_of(i), low[i], high[i], relief)
    for i, j in pairs:
        least, most = low[i] - high[j], high[i] - low[j]
        relief = [left[i], left[j]] if left else []
        possible &= choose([(delay[i], 1.0), (delay[j], -1.0)], program.gaps_between(i, j), least, most, relief)
    if not possible:
        return Relaxed(None, frozenset(), 0.0, True)
    row, column, value = zip(*rows.terms, strict=True)
    table = coo_array((value, (row, column)), shape=(len(rows.limits), len(rows.cost))).tocsr()
    with _quiet():
        found = milp(
            np.array(rows.cost),
            constraints=LinearConstraint(table, *np.array(rows.limits).T),
            bounds=Bounds(*np.array(rows.bounds).T),
            integrality=rows.whole,
            options={"time_limit": limit_s, "mip_rel_gap": 0.0},
        )
    bound = found.mip_dual_bound if found.mip_dual_bound is not None else (found.fun if found.status == 0 else 0.0)
    bound = float(bound) if np.isfinite(bound) else 0.0
    if found.x is None:
        return Relaxed(None, frozenset(), max(bound, 0.0), found.status == _INFEASIBLE)
    out = frozenset(i for i, x in enumerate(left) if found.x[x] > 0.5)
    return Relaxed(1e6 * found.x[:n], out, max(bound, 0.0), False)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Drop what the solver prints."""
    try:
        kept = os.dup(1)
    except OSError:  # closed
        yield
        return
    sys.stdout.flush()
    libc = ctypes.CDLL(None) if os.name == "posix" else ctypes.cdll.msvcrt
    try:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.close(null)
        yield
    finally:
        libc.fflush(None)
        os.dup2(kept, 1)
        os.close(kept)
