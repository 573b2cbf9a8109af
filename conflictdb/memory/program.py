"""The program of delays: tracks that may move, delays that are forbidden to each, and differences forbidden to pairs.

A delay d shifts a whole plan. Track i, delayed by d_i, meets what stays as planned if d_i is forbidden to it, and track
j if d_i - d_j is a forbidden difference of both (O'Donnell and Lozano-Perez, ICRA 1989, for paths of robots). A free
gap is an interval between forbidden ones. All numbers are whole microseconds, so that a plan is checked exactly.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from conflictdb.core.delays import Differences, Spans

_Ints = NDArray[np.int64]
Pair: TypeAlias = tuple[int, int]

NOTHING: Final = Spans(np.empty(0, np.int64), np.empty(0, np.int64))


@dataclass(frozen=True, slots=True)
class Program:
    """Delays of n tracks.

    low, high : (n,) the least and the greatest delay of each track; 0 lies between them
    weight : (n,) cost of a second of each track
    single : n times the delays forbidden by what stays
    pair : the differences d_i - d_j forbidden to tracks i < j
    """

    low: _Ints
    high: _Ints
    weight: NDArray[np.float64]
    single: list[Spans]
    pair: Mapping[Pair, Spans]

    def __len__(self) -> int:
        return len(self.low)

    @classmethod
    def of(cls, found: Differences, movable: _Ints, low: _Ints, high: _Ints, weight: NDArray[np.float64]) -> "Program":
        """Return the program of tracks (n,), by their numbers; found: all differences of them."""
        row = {number: i for i, number in enumerate(movable.tolist())}
        single, pair = [NOTHING] * len(movable), {}
        for number, own in found.of_each_track():
            i = row[number]
            moves = np.isin(own.other, movable)
            stays = own.take(np.flatnonzero(~moves))
            single[i] = _within(stays.low, stays.high, int(low[i]), int(high[i]))
            for other in np.unique(own.other[moves]).tolist():
                j = row[other]
                if i < j:
                    rows = own.other == other
                    least, most = int(low[i] - high[j]), int(high[i] - low[j])
                    spans = _within(own.low[rows], own.high[rows], least, most)
                    if len(spans):
                        pair[i, j] = spans
        return cls(low, high, weight, single, pair)

    def part(self, rows: _Ints) -> "Program":
        """Return the program of some tracks alone; all pairs with others are left out."""
        at = {row: k for k, row in enumerate(rows.tolist())}
        pair = {(at[i], at[j]): spans for (i, j), spans in self.pair.items() if i in at and j in at}
        ordered = {(i, j) if i < j else (j, i): spans if i < j else mirrored(spans) for (i, j), spans in pair.items()}
        return Program(self.low[rows], self.high[rows], self.weight[rows], [self.single[r] for r in rows], ordered)

    def with_fixed(self, delays: Mapping[int, int]) -> "Program":
        """Return the program in which some tracks have delays that do not change, and forbid delays to all others."""
        single = list(self.single)
        for (i, j), spans in self.pair.items():
            if i in delays and j not in delays:
                single[j] = both(single[j], moved(mirrored(spans), delays[i]))
            elif j in delays and i not in delays:
                single[i] = both(single[i], moved(spans, delays[j]))
        free = np.array([i for i in range(len(self)) if i not in delays], np.int64)
        return Program(self.low, self.high, self.weight, single, self.pair).part(free)

    def components(self) -> list[_Ints]:
        """Return the tracks of each part of the program that shares no pair with another, smallest first."""
        if not len(self):
            return []
        label = joined(self.pair, len(self))
        order = np.argsort(label, kind="stable")
        return sorted(np.split(order, np.flatnonzero(np.diff(label[order])) + 1), key=len)

    def gaps_of(self, i: int) -> _Ints:
        """Return the free delays (k, 2) of a track among what stays: closed intervals."""
        return gaps(self.single[i], int(self.low[i]), int(self.high[i]))

    def gaps_between(self, i: int, j: int) -> _Ints:
        """Return the free differences (k, 2) of a pair: closed intervals."""
        return gaps(self.pair[i, j], int(self.low[i] - self.high[j]), int(self.high[i] - self.low[j]))

    def broken(self, delays: NDArray[np.float64] | _Ints, slack: float = 0.0) -> list[Pair]:
        """Return the pairs whose difference is forbidden, by more than a slack."""
        found = []
        for (i, j), spans in self.pair.items():
            difference = delays[i] - delays[j]
            if bool(((spans.low + slack <= difference) & (difference <= spans.high - slack)).any()):
                found.append((i, j))
        return found

    def cost(self, delays: _Ints, goal: str) -> float:
        """Return the objective of delays (n,), seconds."""
        each = self.weight * np.abs(delays) / 1e6
        return float(each.sum() if goal == "total" else each.max(initial=0.0))


def _within(low: _Ints, high: _Ints, least: int, most: int) -> Spans:
    return Spans.union(np.maximum(low, least), np.minimum(high, most))


def joined(links: Iterable[Pair], n: int) -> NDArray[np.int32]:
    """Return the number of the connected part (n,) of each of n tracks."""
    edges = np.array(list(links), np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    label: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return label


def mirrored(spans: Spans) -> Spans:
    """Return the negative of each value."""
    return Spans(-spans.high[::-1], -spans.low[::-1])


def moved(spans: Spans, by: int) -> Spans:
    """Return each value plus a number."""
    return Spans(spans.low + by, spans.high + by)


def both(*some: Spans) -> Spans:
    """Return the union of spans."""
    return Spans.union(np.concatenate([one.low for one in some]), np.concatenate([one.high for one in some]))


def is_free(spans: Spans, value: int) -> bool:
    """Return whether no span contains a value."""
    k = int(np.searchsorted(spans.low, value, side="right")) - 1
    return k < 0 or int(spans.high[k]) < value


def gaps(spans: Spans, low: int, high: int) -> _Ints:
    """Return the closed intervals (k, 2) of [low, high] that are in no span."""
    begins = np.append(low, np.maximum(spans.high + 1, low))
    ends = np.append(np.minimum(spans.low - 1, high), high)
    found = np.stack([begins, ends], axis=1)
    return found[found[:, 0] <= found[:, 1]]


def nearest_to_zero(free: _Ints) -> int | None:
    """Return the value of free gaps (k, 2) that is nearest to 0; None if there is none."""
    if not len(free):
        return None
    values = np.clip(0, free[:, 0], free[:, 1])
    return int(values[np.argmin(np.abs(values))])


def chain_of(low: Iterable[int], high: Iterable[int], least: int, most: int) -> list[int]:
    """Return the indices of few intervals that together cover all of [least, most]; empty if they do not."""
    rows = sorted(zip(low, high, range(2**62), strict=False))
    chosen: list[int] = []
    at, k, best = least, 0, (least - 1, -1)
    while at <= most:
        while k < len(rows) and rows[k][0] <= at:
            best = max(best, (rows[k][1], rows[k][2]))
            k += 1
        if best[0] < at:
            return []
        chosen.append(best[1])
        at = best[0] + 1
    return chosen
