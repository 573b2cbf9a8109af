"""Delays of tracks that bring them into contact, by pair of objects: what a scene stores."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.core.delays import LAST_INSTANT, Differences, Spans

_Ints = NDArray[np.int64]

# Intervals of pairs are united on one axis of this length, where each pair has a stretch of its own.
_AXIS: Final = 2**62


@dataclass(frozen=True, slots=True)
class PairDifferences:
    """The delays of n tracks that bring them into contact with another object each, as intervals of whole microseconds.

    track, other : (n,) numbers of the objects
    forbidden_us, forbidden_offset : (f, 2), (n + 1,) closed intervals; all other delays within the horizon are free
    proven_us, proven_offset : (p, 2), (n + 1,) closed intervals of `Differences.inner_low`, perhaps none
    """

    track: _Ints
    other: _Ints
    forbidden_us: _Ints
    forbidden_offset: _Ints
    proven_us: _Ints
    proven_offset: _Ints

    def __len__(self) -> int:
        return len(self.track)

    @classmethod
    def of_each(cls, found: Differences, horizon_us: int, most: int) -> Iterator[Self]:
        """Yield the differences of pieces by pair, at most `most` pairs at a time, cut off at the horizon."""
        order = np.lexsort((found.other, found.track))
        track, other = found.track[order], found.other[order]
        first = np.flatnonzero(np.append(True, (track[1:] != track[:-1]) | (other[1:] != other[:-1])))[: len(order)]
        most = min(most, _AXIS // (2 * horizon_us + 8))
        for start in range(0, len(first), most):
            pairs = first[start : start + most]
            end = first[start + most] if start + most < len(first) else len(order)
            rows = found.take(order[pairs[0] : end])
            pair = np.repeat(np.arange(len(pairs)), np.diff(np.append(pairs, end)))
            yield cls(
                track[pairs],
                other[pairs],
                *_united(pair, len(pairs), rows.low, rows.high, horizon_us),
                *_united(pair, len(pairs), rows.inner_low, rows.inner_high, horizon_us + LAST_INSTANT),
            )


def _united(pair: _Ints, count: int, low: _Ints, high: _Ints, most: int) -> tuple[_Ints, _Ints]:
    """Return the union of the intervals of each pair, cut off at `most` either way, and its offsets."""
    kept = np.flatnonzero(low <= high)
    zero = pair[kept] * (2 * most + 4)
    spans = Spans.union(zero + np.maximum(low[kept], -most), zero + np.minimum(high[kept], most))
    of = (spans.low + most) // (2 * most + 4)
    zero = of * (2 * most + 4)
    offset = np.searchsorted(of, np.arange(count + 1))
    return np.stack([spans.low - zero, spans.high - zero], axis=1), offset
