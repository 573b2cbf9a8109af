"""Divide a scene into units of about equal work, from a sample of its pieces: cells, and blocks where one is crowded.

A cell is a box of space and time; a piece is in each cell that it meets. The objects of a crowded cell are
dealt into blocks, and each two blocks are a unit. The sample only balances the work; it does not change the answer.
"""

import math
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.ragged import offsets

# Sample size: at least _LEAST pieces, at most _MOST, in between _SHARE of all.
_LEAST: Final = 4_000
_SHARE: Final = 0.01
_MOST: Final = 40_000
# Do not cut a cell with at most _FEW sampled pieces, nor where more than _MOST_CUT of them would be in both halves.
_FEW: Final = 24
_MOST_CUT: Final = 0.5
# Do not divide the pairs of a cell for less than _LEAST_PAIRS each: more units repeat more pieces.
_LEAST_PAIRS: Final = 20_000
# Least number of meeting pairs (both members count) that is more than chance in a sample.
_FEWEST_SEEN: Final = 16
# Pieces of a cell compared with each other.
_COMPARED: Final = 400


Number = TypeVar("Number", int, NDArray[np.int64])


@dataclass(frozen=True, slots=True)
class Cells:
    """n disjoint cells that cover space and time.

    low, high : (n, 3) plane metres east and north, microseconds; from low on, below high; infinite at the ends
    blocks : (n,) int64, number of blocks of each cell's objects
    pairs : estimated number of pairs of pieces in all cells
    """

    low: Floats
    high: Floats
    blocks: NDArray[np.int64]
    pairs: float

    @staticmethod
    def share(count: int) -> float:
        """Return the share of `count` pieces to sample."""
        return min(1.0, max(_LEAST, min(_SHARE * count, _MOST)) / max(count, 1))

    @classmethod
    def of(cls, low: Floats, high: Floats, share: float, units: int) -> "Cells":
        """Return cells for about `units` units from a sample of a scene's pieces: their boxes, (m, 3) each."""
        whole = np.full(3, np.inf)
        leaves = _cells(low, high, -whole, whole, max(_FEW, len(low) // units))
        lows, highs, pairs = (np.array(column) for column in zip(*leaves, strict=True))
        pairs /= share**2
        most = max(pairs.sum() / units, _LEAST_PAIRS)
        return cls(lows, highs, np.array([blocks_for(math.ceil(one / most)) for one in pairs]), float(pairs.sum()))

    @property
    def first_unit(self) -> NDArray[np.int64]:
        """The first unit of each cell, and the number of units, (n + 1,)."""
        return offsets(self.blocks * (self.blocks + 1) // 2)

    def of_unit(self, number: int) -> tuple[int, bool]:
        """Return the cell of a unit, and whether the unit is of two different blocks."""
        first = self.first_unit
        cell = int(np.searchsorted(first, number, side="right")) - 1
        within = number - int(first[cell])
        later = (math.isqrt(8 * within + 1) - 1) // 2
        return cell, within != two_blocks(later, later)


def two_blocks(a: Number, b: Number) -> Number:
    """Return the number of the unit of two blocks, a up to b: from 0, those of smaller b first."""
    return b * (b + 1) // 2 + a


def blocks_for(units: int) -> int:
    """Return the least number of blocks that make at least `units` units: pairs of blocks, and single blocks."""
    return max(1, math.ceil((math.sqrt(8.0 * units + 1.0) - 1.0) / 2.0))


def _cells(low: Floats, high: Floats, first: Floats, last: Floats, few: int) -> list[tuple[Floats, Floats, float]]:
    """Return the cells between two corners: bounds, and the pairs of the sample.

    low, high : (m, 3) boxes of the sampled pieces there
    few : a cell with at most this many boxes is not cut
    """
    cut = _cut(low, high, few)
    if cut is None:
        return [(first, last, _pairs(low, high, first, last))]
    along, at = cut
    below, above = last.copy(), first.copy()
    below[along] = above[along] = at
    is_below, is_above = low[:, along] < at, high[:, along] >= at
    return [
        *_cells(low[is_below], high[is_below], first, below, few),
        *_cells(low[is_above], high[is_above], above, last, few),
    ]


def _cut(low: Floats, high: Floats, few: int) -> tuple[int, float] | None:
    """Return the axis and place to cut boxes (m, 3) in two with the fewest boxes in both halves; None: do not cut."""
    if len(low) <= few:
        return None
    at = np.median(low, axis=0)
    cut = np.count_nonzero((low < at) & (high >= at), axis=0)
    cut[(high >= at).all(axis=0)] = len(low)  # one half would be empty of boxes of its own
    along = int(np.argmin(cut))
    return None if cut[along] > _MOST_CUT * len(low) else (along, float(at[along]))


def _pairs(low: Floats, high: Floats, first: Floats, last: Floats) -> float:
    """Return the estimated number of pairs in a cell among boxes (m, 3)."""
    compared = np.arange(min(len(low), _COMPARED)) * max(1, len(low) // _COMPARED)
    meet = np.ones((len(compared), len(compared)), np.bool_)
    for lows, highs, begin, end in zip(low[compared].T, high[compared].T, first, last, strict=True):
        later = np.maximum.outer(lows, lows)
        meet &= (later <= np.minimum.outer(highs, highs)) & (later >= begin) & (later < end)
    np.fill_diagonal(meet, val=False)
    seen = meet.sum()
    return 0.0 if seen < _FEWEST_SEEN else 0.5 * float(seen) * (len(low) / len(compared)) ** 2
