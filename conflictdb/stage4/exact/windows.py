"""Stage 4, exact: what touching polygons and separated ones have in common.

Certified windows, an instant of conflict in each, its two ends brought to zero on the true motion, and a proof that the
conflict holds in between. See `stage4.exact.solver`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.constants import TOUCH_M
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.proofs import clear_window

# Halvings that prove a conflict to hold.
MAX_HALVINGS: Final = 12


@dataclass(slots=True)
class Work:
    """What was done: pairs by closed form, windows of pairs, and evaluations of the separation."""

    closed_forms: int = 0
    windows: int = 0
    evaluations: int = 0


@dataclass(frozen=True, slots=True)
class Window:
    """n pairs that are apart outside of [start, end], and in conflict in the middle; seconds.

    rows : (n,) their numbers in the block
    depth : (n,) how much too close they are in the middle, plane metres, < 0
    largest, smallest : (n,) scales that are reached
    """

    pairs: Encounters
    rows: NDArray[np.int64]
    start: Floats
    middle: Floats
    end: Floats
    depth: Floats
    largest: Floats
    smallest: Floats

    def sides(self) -> tuple[Encounters, Floats, Floats, Floats]:
        """Return (pairs, limits, insides, inward): first all starts, then all ends, each with the middle inside."""
        n = len(self.rows)
        both = np.concatenate([np.arange(n), np.arange(n)])
        limit = np.concatenate([self.start, self.end])
        inward = np.where(np.arange(2 * n) < n, 1.0, -1.0)
        return self.pairs.take(both), limit, np.concatenate([self.middle, self.middle]), inward


class Block(ABC):
    """Pairs settled together; rows number them.

    least_windows : how often windows are shrunk, also where the pair is known to be in conflict
    most_windows : rounds of window and witness; each shrinks the slack by the square of how much the window shrank
    """

    least_windows: ClassVar[int] = 1
    most_windows: ClassVar[int] = 6

    def __init__(self, pairs: Encounters, low: Floats, high: Floats, margin_m: float, work: Work) -> None:
        n = len(pairs)
        self.pairs, self.low, self.high, self.work = pairs, low, high, work
        self.margin_m = margin_m
        self.is_clear, self.is_solved = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        self.start, self.end, self.error = low.copy(), high.copy(), np.zeros(n)

    @abstractmethod
    def settle(self) -> None:
        """Settle what can be settled."""

    @abstractmethod
    def _wanted_m(self, pairs: Encounters, largest: Floats) -> Floats:
        """Return (n,) how far apart in the plane pairs are beyond doubt further apart than the margin."""

    @abstractmethod
    def _depth(self, pairs: Encounters, t: Floats, smallest: Floats) -> Floats:
        """Return (n,) a bound from above on how much further apart than wanted pairs are, plane metres."""

    @abstractmethod
    def _solve(self, window: Window) -> None:
        """Settle pairs that are in conflict in the middle of a window, and apart outside of it."""

    def _keep(
        self,
        rows: NDArray[np.int64],
        clear: NDArray[np.bool_],
        solved: NDArray[np.bool_],
        start: Floats,
        end: Floats,
        error: Floats,
    ) -> None:
        self.is_clear[rows] = clear
        self.is_solved[rows] = solved
        some = rows[solved]
        self.start[some], self.end[some], self.error[some] = start[solved], end[solved], error[solved]

    def _windows(self, rows: NDArray[np.int64], bend: Floats) -> None:
        """Settle pairs by certified windows, an instant of conflict in them, and their ends."""
        pairs = self.pairs if len(rows) == len(self.low) else self.pairs.take(rows)
        start, end = self.low[rows], self.high[rows]
        for turn in range(self.most_windows):
            a0, b0, a1, b1 = (
                pairs.a.positions(start),
                pairs.b.positions(start),
                pairs.a.positions(end),
                pairs.b.positions(end),
            )
            h = end - start
            largest, smallest = pairs.scale(a0, b0, a1, b1)
            u, v = clear_window(a0, b0, a1, b1, bend * h**2 / 8.0 + self._wanted_m(pairs, largest))
            self.work.windows += len(rows)
            possible = u <= v
            self.is_clear[rows[~possible]] = True
            keep = np.flatnonzero(possible)
            if not keep.size:
                return
            pairs, rows, bend, largest, smallest = (
                pairs.take(keep),
                rows[keep],
                bend[keep],
                largest[keep],
                smallest[keep],
            )
            start, end = (start + u * h)[keep], (start + v * h)[keep]
            middle = 0.5 * (start + end)
            depth = self._depth(pairs, middle, smallest)
            meets = (depth < -2.0 * TOUCH_M * largest) & (turn + 1 >= self.least_windows)
            deep = np.flatnonzero(meets)
            if deep.size:
                window = Window(
                    pairs.take(deep),
                    rows[deep],
                    start[deep],
                    middle[deep],
                    end[deep],
                    depth[deep],
                    largest[deep],
                    smallest[deep],
                )
                self._solve(window)
            keep = np.flatnonzero(~meets)
            if not keep.size:
                return
            pairs, rows, bend = pairs.take(keep), rows[keep], bend[keep]
            start, end = start[keep], end[keep]

    def _holds(
        self, pairs: Encounters, p: Floats, q: Floats, depth: Floats, touch: Floats, smallest: Floats
    ) -> NDArray[np.bool_]:
        """Return whether pairs are in conflict all the way from p, by `touch` or more, to q, by `depth` (< 0).

        With K the unevenness and L the time between, the separation at a share s of it is at most
        (1 - s) f(p) + s (f(q) + 2 K L): no more than -touch where f(p) <= -touch and f(q) <= -touch - 2 K L.
        """
        n = len(p)
        proven = np.ones(n, np.bool_)
        row, some, fp, fq = np.arange(n), pairs, -touch, depth
        for _ in range(MAX_HALVINGS):
            first, last = np.minimum(p, q), np.maximum(p, q)
            most = 2.0 * (some.a.velocity_spread(first, last) + some.b.velocity_spread(first, last)) * (last - first)
            limit = -touch[row] - most
            held = (fp <= limit) | (fq <= limit) | (np.maximum(fp, fq) <= -touch[row] - 0.5 * most)
            open_ = np.flatnonzero(~held & proven[row])
            if not open_.size:
                return proven
            row, p, q, fp, fq = row[open_], p[open_], q[open_], fp[open_], fq[open_]
            middle = 0.5 * (p + q)
            some = pairs.take(row)
            f = self._depth(some, middle, smallest[row])
            np.logical_and.at(proven, row, f <= -touch[row])
            row = np.concatenate([row, row])
            some = pairs.take(row)
            p, q, fp, fq = (np.concatenate(ends) for ends in ((p, middle), (middle, q), (fp, f), (f, fq)))
        proven[row] = False
        return proven
