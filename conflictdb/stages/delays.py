"""Which departures of tracks bring them into conflict: stages 1 and 2 without time, then differences of departure.

A delay d of a track, in whole microseconds, is forbidden if the track, departing d later, comes within the scene's
separation and tolerance of anything that departs as planned. Outer intervals contain all forbidden delays; inner
intervals contain forbidden ones only.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.earth.plane import Plane
from conflictdb.kernel.differences import DifferenceState, Shifts, differences
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Scene
from conflictdb.model.results import Delays, Forbidden, Kind
from conflictdb.stages.memory import DEFAULT_MEMORY
from conflictdb.stages.object_pairs import object_numbers
from conflictdb.stages.pieces.covers import is_covered
from conflictdb.stages.stage1_broad_phase import hulls_of

_Ints = NDArray[np.int64]

# Pieces of tracks whose candidates are looked up at once: their pairs fit into memory.
_AT_ONCE: Final = 20_000
# In place of infinity: beyond all differences of instants.
_FOREVER_US: Final = 2**61
# More than times of pieces are rounded by, microseconds.
_ROUNDING_US: Final = 0.1
# An inner interval ends this much inside of what is proven: at its end two objects may share only the last instant of
# one of them, which does not belong to it.
_LAST_INSTANT_US: Final = 1


@dataclass(frozen=True, slots=True)
class Spans:
    """n closed intervals of whole microseconds, in order and with a free microsecond between any two.

    low, high : (n,)
    """

    low: _Ints
    high: _Ints

    def __len__(self) -> int:
        return len(self.low)

    @classmethod
    def union(cls, low: _Ints, high: _Ints) -> Self:
        """Return the union of closed intervals (m,); empty ones (low > high) are left out."""
        order = np.argsort(low, kind="stable")
        order = order[low[order] <= high[order]]
        low, reached = low[order], np.maximum.accumulate(high[order])
        opens = np.ones(len(order), np.bool_)
        opens[1:] = low[1:] > reached[:-1] + 1
        first = np.flatnonzero(opens)
        return cls(low[first], reached[np.append(first[1:], len(reached)) - 1] if len(first) else reached)


@dataclass(frozen=True, slots=True)
class Differences:
    """Delays of n pieces of tracks that bring them into contact with a piece of another object, microseconds.

    track, other : (n,) numbers of the objects (`object_numbers`)
    low, high : (n,) outer intervals
    inner_low, inner_high : (n,) inner intervals, empty (low > high) where nothing is proven
    """

    track: _Ints
    other: _Ints
    low: _Ints
    high: _Ints
    inner_low: _Ints
    inner_high: _Ints

    def of_each_track(self) -> Iterator[tuple[int, "Differences"]]:
        """Yield the number of each track that has differences, and these."""
        order = np.argsort(self.track, kind="stable")
        numbers, first = np.unique(self.track[order], return_index=True)
        for number, rows in zip(numbers.tolist(), np.split(order, first[1:]), strict=False):
            yield number, self.take(rows)

    def take(self, rows: _Ints) -> "Differences":
        """Return some rows."""
        columns = (self.track, self.other, self.low, self.high, self.inner_low, self.inner_high)
        return Differences(*(column[rows] for column in columns))

    def forbidden(self, horizon_us: int) -> tuple[Spans, Spans]:
        """Return the outer and the inner intervals of all rows, within the horizon."""
        outer = Spans.union(self.low, self.high)
        inner = Spans.union(self.inner_low, self.inner_high)
        shrunk = inner.low + _LAST_INSTANT_US, inner.high - _LAST_INSTANT_US
        return _within(outer.low, outer.high, horizon_us), _within(*shrunk, horizon_us)

    def blocking(self, horizon_us: int) -> _Ints:
        """Return the numbers of the objects that forbid every delay within the horizon."""
        found = []
        for other in np.unique(self.other).tolist():
            rows = self.other == other
            own = _within(self.low[rows], self.high[rows], horizon_us)
            if len(own) == 1 and own.low[0] == -horizon_us and own.high[0] == horizon_us:
                found.append(other)
        return np.array(found, np.int64)


def _within(low: _Ints, high: _Ints, horizon_us: int) -> Spans:
    return Spans.union(np.maximum(low, -horizon_us), np.minimum(high, horizon_us))


def differences_of(
    scene: Scene, plane: Plane, pieces: Pieces, tracks: _Ints, horizon_us: int, threads: int = 1
) -> Differences:
    """Return the delays within the horizon that bring some tracks into contact with other objects.

    plane : of the scene, which the pieces were made in
    tracks : (m,) numbers of tracks (`object_numbers`)
    threads : of the kernel; the answer does not depend on it
    """
    number, found = object_numbers(pieces), []
    pairs = list(_candidates(pieces, number, tracks, horizon_us))
    a, b = (PieceRows(np.concatenate([np.empty(0, np.int64), *some])) for some in zip(*pairs, strict=True))
    prepared = kernel.KernelScene(plane.kernel_plane, pieces, a, b)
    for first in range(0, max(len(a), 1), DEFAULT_MEMORY.pairs):
        rows = slice(first, first + DEFAULT_MEMORY.pairs)
        found.append(_of_pairs(scene, prepared, number, PieceRows(a[rows]), PieceRows(b[rows]), threads))
    every = Differences(*(np.concatenate(column) for column in zip(*found, strict=True)))
    # Two tracks that are both asked about are solved once.
    mirrored = every.take(np.flatnonzero(np.isin(every.other, tracks)))
    swapped = mirrored.other, mirrored.track, -mirrored.high, -mirrored.low, -mirrored.inner_high, -mirrored.inner_low
    columns = (every.track, every.other, every.low, every.high, every.inner_low, every.inner_high)
    every = Differences(*(np.concatenate(both) for both in zip(columns, swapped, strict=True)))
    return every.take(np.flatnonzero((every.low <= horizon_us) & (every.high >= -horizon_us)))


def told_delays(key: str, keys: Mapping[int, str], found: Differences, horizon_us: int) -> Delays:
    """Return the delays of a track.

    keys : the keys of objects by number
    found : the differences of this track alone, perhaps none
    """
    outer, inner = found.forbidden(horizon_us)
    first = np.searchsorted(inner.low, outer.low)
    last = np.searchsorted(inner.low, outer.high, side="right")
    forbidden = []
    for k, (low, high) in enumerate(zip(outer.low.tolist(), outer.high.tolist(), strict=True)):
        by = np.unique(found.other[(found.low <= high) & (found.high >= low)]).tolist()
        parts = range(int(first[k]), int(last[k]))
        begins, ends = (int(inner.low[parts[0]]), int(inner.high[parts[-1]])) if parts else (high, low)
        forbidden.append(
            Forbidden(
                low / 1e6, high / 1e6, (begins - low) / 1e6, (high - ends) / 1e6, len(parts) == 1, _sorted(keys, by)
            )
        )
    later_us = least_later_us(outer, horizon_us)
    earlier_us = least_later_us(Spans(-outer.high[::-1], -outer.low[::-1]), horizon_us)
    blocked_by = _sorted(keys, found.blocking(horizon_us).tolist())
    return Delays(key, tuple(forbidden), _seconds(later_us), _seconds(earlier_us), blocked_by)


def least_later_us(forbidden: Spans, horizon_us: int) -> int | None:
    """Return the least delay of 0 or more that is not forbidden; None beyond the horizon."""
    k = int(np.searchsorted(forbidden.low, 0, side="right")) - 1
    if k < 0 or forbidden.high[k] < 0:
        return 0
    least_us = int(forbidden.high[k]) + 1
    return least_us if least_us <= horizon_us else None


def _seconds(us: int | None) -> float | None:
    return None if us is None else us / 1e6


def _sorted(keys: Mapping[int, str], numbers: list[int]) -> tuple[str, ...]:
    return tuple(sorted((keys[number] for number in numbers), key=str.encode))


def _candidates(pieces: Pieces, number: _Ints, tracks: _Ints, horizon_us: int) -> Iterator[tuple[_Ints, _Ints]]:
    """Yield pairs of pieces (a, b) whose hulls meet if a, of one of the tracks, departs at another time."""
    is_asked = np.isin(number, tracks)
    hulls = hulls_of(pieces)
    tree = shapely.STRtree(hulls)
    mine = np.flatnonzero(is_asked)
    # Unbounded spans, too, fit into 64 bits when they are subtracted.
    start, end = np.maximum(pieces.start_us, -_FOREVER_US), np.minimum(pieces.end_us, _FOREVER_US)
    yield np.empty(0, np.int64), np.empty(0, np.int64)
    for rows in (mine[first : first + _AT_ONCE] for first in range(0, len(mine), _AT_ONCE)):
        row, b = tree.query(hulls[rows])
        a = rows[row]
        keep = (number[a] != number[b]) & (~is_asked[b] | (number[a] < number[b]))
        keep &= (pieces.turn[a] == 0) | (pieces.turn[b] == 0)
        keep &= (pieces.floor_m[a] < pieces.ceiling_m[b]) & (pieces.floor_m[b] < pieces.ceiling_m[a])
        keep &= (start[b] - end[a] <= horizon_us) & (end[b] - start[a] >= -horizon_us)
        a, b = a[keep], b[keep]
        met = ~kernel.apart(pieces.hull_xy, pieces.hull_offset, PieceRows(a), PieceRows(b))
        yield a[met], b[met]


def _of_pairs(
    scene: Scene, prepared: kernel.KernelScene, number: _Ints, a: PieceRows, b: PieceRows, threads: int
) -> tuple[_Ints, ...]:
    """Return the columns of `Differences` of pairs of pieces that some delay brings into contact."""
    pieces = prepared.pieces
    still = pieces.kind[b] == Kind.AREA.code
    zero = pieces.start_us[a]
    first, last = pieces.start_us[b], np.where(still, pieces.end_us[b], pieces.start_us[b])
    lasts_s = (pieces.end_us[a] - zero) / 1e6
    b_lasts_s = np.where(still, 0, pieces.end_us[b] - np.where(still, pieces.end_us[b], first)) / 1e6
    nothing = np.zeros(len(a))
    b_zero = np.where(still, zero, first)
    shifts = Shifts(a, b, zero, b_zero, nothing, lasts_s, nothing, b_lasts_s)
    covered = is_covered(pieces, a, b)
    solved = np.flatnonzero(~covered)
    found = np.zeros(len(a), [(name, np.float64) for name in _ENDS])
    found["outer_low_s"], found["outer_high_s"] = -lasts_s, b_lasts_s
    found["inner_low_s"], found["inner_high_s"] = np.inf, -np.inf
    done = differences(
        prepared, shifts.take(solved), scene.separation_m + scene.tolerance_m, kernel.Work(), threads=threads
    )
    for name in _ENDS:
        found[name][solved] = done[name]
    met = covered.copy()
    met[solved] = done["state"] != DifferenceState.NONE
    low = _later(first, zero, np.floor(1e6 * found["outer_low_s"] - _ROUNDING_US))
    high = _later(last, zero, np.ceil(1e6 * found["outer_high_s"] + _ROUNDING_US))
    inner_low = _later(first, zero, np.ceil(1e6 * found["inner_low_s"] + _ROUNDING_US))
    inner_high = _later(last, zero, np.floor(1e6 * found["inner_high_s"] - _ROUNDING_US))
    return tuple(column[met] for column in (number[a], number[b], low, high, inner_low, inner_high))


_ENDS: Final = ("outer_low_s", "inner_low_s", "inner_high_s", "outer_high_s")


def _later(instant_us: _Ints, zero_us: _Ints, more_us: NDArray[np.float64]) -> _Ints:
    """Return instant minus zero plus more, microseconds; beyond all differences where one of them is infinite."""
    endless = np.where(instant_us == MINUS_INFINITY_US, -np.inf, np.where(instant_us == INFINITY_US, np.inf, 0.0))
    infinite = np.where(np.isinf(more_us), more_us, endless)
    known = infinite == 0.0
    exact = (
        np.where(known, instant_us, 0) - np.where(known, zero_us, 0) + np.where(known, more_us, 0.0).astype(np.int64)
    )
    return np.where(known, exact, np.where(infinite > 0.0, 2 * _FOREVER_US, -2 * _FOREVER_US))
