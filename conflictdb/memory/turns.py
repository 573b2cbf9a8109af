"""Orders of tracks that all must pass one place in turn: a clique of pairs whose order matters.

This module searches the orders themselves, layer by layer: a state is the set of tracks placed, with the earliest delay
of each other. It is bounded by the least spans that 2, 3, 4 ... turns take, and by releases of the tracks that follow,
in the order of these.
"""

import time
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.memory.program import Program

_Ints = NDArray[np.int64]

MOST_TRACKS: Final = 30
# States of a layer, at most: 30 numbers each.
_MOST_STATES: Final = 400_000
# States of a layer that find a good order first.
_BEAM: Final = 2_000
# How many others of the same set, that cost less, each state is compared with.
_RIVALS: Final = 12


@dataclass(frozen=True, slots=True)
class Turns:
    """Tracks (n,) that pass in turn, two by two.

    least : (n,) the least delay of each, microseconds
    lag : (n, n) how much later than a track each other is at least, if it comes after it
    weight : (n,) cost of a second
    """

    least: _Ints
    lag: _Ints
    weight: Floats

    @classmethod
    def of(cls, program: Program, tracks: _Ints) -> "Turns | None":
        """Return the turns of some tracks; None if not each two of them must be in one order or the other."""
        n = len(tracks)
        if n > MOST_TRACKS or (program.low[tracks] < 0).any():
            return None
        lag = np.zeros((n, n), np.int64)
        for x in range(n):
            for y in range(n):
                i, j = int(tracks[x]), int(tracks[y])
                if i < j:
                    spans = program.pair.get((i, j))
                    k = -1 if spans is None else int(np.searchsorted(spans.low, 0, side="right")) - 1
                    if spans is None or k < 0 or spans.high[k] < 0:
                        return None
                    # d_i - d_j > high, or d_j - d_i > -low.
                    lag[y, x], lag[x, y] = int(spans.high[k]) + 1, 1 - int(spans.low[k])
        least = np.array([gaps[0, 0] if len(gaps := program.gaps_of(int(i))) else 0 for i in tracks], np.int64)
        return cls(least, lag, program.weight[tracks])

    def delays_of(self, order: list[int]) -> Floats:
        """Return the least delays (n,) of tracks in an order, microseconds."""
        delays = self.least.astype(np.float64)
        for place, track in enumerate(order[:-1]):
            later = order[place + 1 :]
            delays[later] = np.maximum(delays[later], delays[track] + self.lag[track, later])
        return delays


def bound_of(turns: Turns, goal: str, best_s: float, ends: float) -> tuple[float, list[int] | None]:
    """Return a lower bound of the objective, seconds, and an order that is better than the best known, if there is one.

    best_s : the objective of the best delays that are known
    ends : when to stop, by `time.monotonic`
    """
    spans = _spans(turns, ends)
    found, order = _search(turns, goal, best_s, spans, _BEAM, ends)
    if order is not None:
        best_s = found
    bound, better = _search(turns, goal, best_s, spans, _MOST_STATES, ends)
    return bound, better or order


def _spans(turns: Turns, ends: float) -> Floats:
    """Return the least time (n,) between the first and the last of 1, 2, 3 ... turns, seconds."""
    n, lag = len(turns.least), turns.lag / 1e6
    apart = np.where(np.eye(n, dtype=np.bool_), np.inf, lag)
    spans = np.zeros(n)
    for k in range(1, n):
        # Two parts one after the other.
        spans[k] = max(spans[j] + spans[k - j] for j in range(k)) if k > 1 else apart.min()
        if time.monotonic() > ends:
            continue
        exact = _least_span(apart, k + 1, spans, ends)
        spans[k] = max(spans[k], exact)
    return spans


def _least_span(apart: Floats, count: int, spans: Floats, ends: float) -> float:
    """Return the least time between the first and last of some turns, or less if that takes too long."""
    n = len(apart)
    best = np.inf
    for most in (_BEAM // 4, _MOST_STATES // 4):
        release = apart.copy()
        at = np.zeros(n)
        for placed in range(1, count):
            rest = count - 1 - placed
            following = np.maximum(release, at[:, None] + spans[1])
            following[~np.isfinite(release)] = np.inf
            state, track = np.nonzero(following + spans[rest] < best - 1e-9)
            if not len(state):
                break
            start = following[state, track]
            order = np.argsort(start, kind="stable")
            if len(order) > most:
                if most > _BEAM:
                    return 0.0
                order = order[:most]
            state, track, at = state[order], track[order], start[order]
            release = np.maximum(release[state], at[:, None] + apart[track])
            if time.monotonic() > ends:
                return 0.0
        else:
            best = min(best, float(at.min()))
    return best if np.isfinite(best) else 0.0


def _search(
    turns: Turns, goal: str, best_s: float, spans: Floats, most: int, ends: float
) -> tuple[float, list[int] | None]:
    """Search orders in layers; return a bound and the best order below `best_s`, or the best that a beam finds."""
    n, lag, is_beam = len(turns.least), turns.lag / 1e6, most == _BEAM
    weight = turns.weight
    release = (turns.least / 1e6)[None, :].copy()
    placed = np.zeros((1, n), np.bool_)
    cost, at = np.zeros(1), np.full(1, -np.inf)
    path = np.zeros((1, 0), np.int8)
    bound = 0.0
    for _ in range(n):
        state, track = np.nonzero(~placed)
        start = np.maximum(release[state, track], at[state])
        new_cost = (
            cost[state] + weight[track] * start if goal == "total" else np.maximum(cost[state], weight[track] * start)
        )
        early = new_cost < best_s - 1e-7
        state, track, start, new_cost = state[early], track[early], start[early], new_cost[early]
        new_placed = placed[state]
        new_placed[np.arange(len(state)), track] = True
        new_release = np.maximum(release[state], start[:, None] + lag[track])
        lowest = _bounds(new_placed, new_release, start, new_cost, spans, weight, goal)
        kept = np.flatnonzero(lowest < best_s - 1e-7)
        if not len(kept):
            return best_s, None
        kept = kept[np.argsort(lowest[kept], kind="stable")]
        kept = kept[_undominated(new_placed[kept], new_release[kept], start[kept], new_cost[kept])]
        if len(kept) > most or time.monotonic() > ends:
            if not is_beam:
                return max(bound, float(lowest[kept].min())), None
            kept = kept[np.argsort(lowest[kept], kind="stable")][:most]
        bound = max(bound, float(lowest[kept].min()))
        placed, release, at, cost = new_placed[kept], new_release[kept], start[kept], new_cost[kept]
        path = np.concatenate([path[state[kept]], track[kept, None].astype(np.int8)], axis=1)
    k = int(np.argmin(cost))
    return float(cost[k]), path[k].tolist()


def _bounds(
    placed: NDArray[np.bool_],
    release: Floats,
    at: Floats,
    cost: Floats,
    spans: Floats,
    weight: Floats,
    goal: str,
) -> Floats:
    """Return lower bounds (m,) of the objective of states: the others follow in the order of their releases."""
    rest = placed.shape[1] - int(placed[0].sum()) if len(placed) else 0
    ordered = np.sort(np.where(placed, np.inf, release), axis=1)[:, :rest]
    starts = [at]
    for k in range(rest):
        earliest = ordered[:, k]
        for j in range(len(starts)):
            earliest = np.maximum(earliest, starts[len(starts) - 1 - j] + spans[j + 1])
        starts.append(earliest)
    if goal == "largest":
        return np.maximum(cost, weight.min() * starts[-1]) if rest else cost
    lightest = np.sort(np.where(placed, -np.inf, weight[None, :]), axis=1)[:, ::-1][:, :rest]
    total = cost.copy()
    for k in range(rest):
        total += lightest[:, k] * starts[k + 1]
    return total


def _undominated(placed: NDArray[np.bool_], release: Floats, at: Floats, cost: Floats) -> _Ints:
    """Return the states that no other of the same set of tracks is at least as good as, as far as compared."""
    code = placed @ (1 << np.arange(placed.shape[1], dtype=np.int64))
    order = np.lexsort((cost, code))
    code, cost = code[order], cost[order]
    release = np.where(placed, 0.0, np.maximum(release, at[:, None]))[order]
    kept = np.ones(len(order), np.bool_)
    for back in range(1, _RIVALS + 1):
        same = code[back:] == code[:-back]
        better = same & (release[:-back] <= release[back:]).all(axis=1)
        # Among equals the first is kept.
        kept[back:] &= ~better
    return np.sort(order[kept])
