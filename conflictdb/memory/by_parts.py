"""Solve a program with some of its pairs by parts that share none of them, and keep the parts that stay the same."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from conflictdb.memory import mixed_integer
from conflictdb.memory.mixed_integer import Relaxed
from conflictdb.memory.program import Pair, Program, joined, nearest_to_zero

_Ints = NDArray[np.int64]

Cut = tuple[tuple[int, ...], float]
# A solver is given this long at least, seconds.
_LEAST_S = 0.05


@dataclass(slots=True)
class PartialProgram:
    """A program whose pairs are added step by step.

    penalty : cost of a track that is left; more than all delays of a plan cost
    cuts : tracks, and the least sum of their weighted delays (goal ``total``) or largest of them, seconds; of plans
        that leave none of them
    """

    program: Program
    goal: str
    penalty: float
    cuts: Sequence[Cut]
    _known: dict[tuple[tuple[int, ...], tuple[Pair, ...]], Relaxed] = field(default_factory=dict)

    def solve(self, pairs: set[Pair], ends: float) -> Relaxed:
        """Solve the program with some pairs, until an instant of `time.monotonic`.

        A track is left only where its part has no delays without that; each one left counts the penalty.
        """
        n = len(self.program)
        delays, left = np.zeros(n), set[int]()
        bounds: list[float] = []
        is_solved = True
        links = [*pairs, *((tracks[0], one) for tracks, _ in self.cuts for one in tracks[1:])]
        label = joined(links, n)
        pairs_of: dict[int, list[Pair]] = {}
        for pair in sorted(pairs):
            pairs_of.setdefault(int(label[pair[0]]), []).append(pair)
        order = np.argsort(label, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
            mine = pairs_of.get(int(label[rows[0]]), [])
            found = self._few(rows) or self._part(rows, mine, ends)
            bounds.append(found.bound)
            left |= {int(rows[k]) for k in found.left}
            if found.delays is None:
                is_solved = False
            else:
                delays[rows] = found.delays
        return Relaxed(delays if is_solved else None, frozenset(left), self._together(bounds), False)

    def _few(self, rows: _Ints) -> Relaxed | None:
        """Solve one or two tracks without a solver; None if that cannot be."""
        if len(rows) == 1:
            return self._alone(int(rows[0]))
        return self._pair(*rows.tolist()) if len(rows) == 2 and (self.program.low[rows] >= 0).all() else None

    def _pair(self, i: int, j: int) -> Relaxed | None:
        """Solve two tracks, neither of which may be earlier: the least delays of each choice of gaps."""
        program = self.program
        low_i, high_i = program.gaps_of(i).T[:, :, None, None]
        low_j, high_j = program.gaps_of(j).T[:, None, :, None]
        least, most = program.gaps_between(i, j).T[:, None, None, :]
        # d_i >= d_j + least, and d_j >= d_i - most.
        first = np.maximum(low_i, low_j + least)
        second = np.maximum(low_j, first - most)
        first, second = np.broadcast_arrays(first, second)
        if not ((first <= high_i) & (second <= high_j)).any():
            return None
        costs = program.weight[i] * first / 1e6, program.weight[j] * second / 1e6
        total = costs[0] + costs[1]
        cost = total if self.goal == "total" else np.maximum(*costs)
        cost = np.where((first <= high_i) & (second <= high_j), cost, np.inf)
        # Among equal choices take the least total.
        k = int(np.lexsort((total.ravel(), cost.ravel()))[0])
        delays = np.array([first.ravel()[k], second.ravel()[k]], np.float64)
        return Relaxed(delays, frozenset(), float(cost.ravel()[k]), False)

    def _alone(self, i: int) -> Relaxed:
        chosen = nearest_to_zero(self.program.gaps_of(i))
        if chosen is None:
            return Relaxed(np.zeros(1), frozenset({0}), self.penalty, False)
        return Relaxed(np.array([float(chosen)]), frozenset(), float(self.program.weight[i]) * abs(chosen) / 1e6, False)

    def _part(self, rows: _Ints, pairs: list[Pair], ends: float) -> Relaxed:
        key = (tuple(rows.tolist()), tuple(pairs))
        if key in self._known:
            return self._known[key]
        if time.monotonic() > ends + _LEAST_S:
            return Relaxed(None, frozenset(), 0.0, False)
        at = {row: k for k, row in enumerate(rows.tolist())}
        part, within = self.program.part(rows), [(at[i], at[j]) for i, j in pairs]
        cuts = [(tuple(at[i] for i in tracks), least) for tracks, least in self.cuts if tracks[0] in at]
        for penalty in (None, self.penalty):
            limit_s = max(ends - time.monotonic(), _LEAST_S)
            found = mixed_integer.solve(part, within, self.goal, limit_s, penalty, cuts)
            if not found.is_infeasible:
                break
        if found.delays is not None:
            self._known[key] = found
        return found

    def _together(self, bounds: list[float]) -> float:
        """Return the bound of all parts: of the largest delay, each part leaves at least what its bound says."""
        if self.goal == "total":
            return float(sum(bounds))
        count = [int(bound // self.penalty) for bound in bounds]
        return sum(count) * self.penalty + max(bound - k * self.penalty for bound, k in zip(bounds, count, strict=True))
