"""Where a scene is crowded: cells of space and time, from a sample of its pieces, and into how many lots each falls.

A join is work where pieces meet, not where they are: a thousand versions of one track are half a million pairs, as many
ships at sea a few hundred. So the pieces of a crowded cell are dealt into lots, each of which is joined with all pieces
of the cell, until a row meets about as many others as anywhere. What is made of a sample balances the work, and
decides no answer.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats

# Pieces of a scene that are looked at: at least so many, and of many this share, up to a bound.
_LEAST: Final = 4_000
_SHARE: Final = 0.01
_MOST: Final = 40_000
# A cell of so many of these is not cut further, nor one in whose cut more than this share of them would lie.
_FEW: Final = 24
_MOST_CUT: Final = 0.5
# So many others each row of a lot should meet: then meeting them takes about as long as having the row.
_MEETS: Final = 8.0
_MOST_LOTS: Final = 256
# Of two that meet each counts; fewer are by chance, where a sample stands for many.
_FEWEST_SEEN: Final = 16
# Of a cell that cannot be cut so many are compared with each other.
_COMPARED: Final = 400


@dataclass(frozen=True, slots=True)
class Cells:
    """n cells that fill space and time, which do not overlap.

    low, high : (n, 3) plane metres east and north, microseconds; from low on, below high; infinite at the ends
    lots : (n,) int64 into how many lots the pieces of each fall
    """

    low: Floats
    high: Floats
    lots: NDArray[np.int64]

    @staticmethod
    def share(count: int) -> float:
        """Return which share of so many pieces is to be looked at."""
        return min(1.0, max(_LEAST, min(_SHARE * count, _MOST)) / max(count, 1))

    @classmethod
    def of(cls, low: Floats, high: Floats, share: float) -> "Cells":
        """Return the cells of a scene of which these boxes of pieces, (m, 3) each, are a share."""
        whole = np.full(3, np.inf)
        lows, highs, lots = zip(*_cells(low, high, -whole, whole, share), strict=True)
        return cls(np.array(lows), np.array(highs), np.array(lots, np.int64))


def _cells(low: Floats, high: Floats, first: Floats, last: Floats, share: float) -> list[tuple[Floats, Floats, int]]:
    """Return the cells of what lies between two corners: bounds and lots; one where no part of it is crowded.

    low, high : (m, 3) boxes of the pieces that were looked at there
    """
    cut = _cut(low, high)
    if cut is None:
        return [(first, last, _lots(low, high, first, last, share))]
    along, at = cut
    below, above = last.copy(), first.copy()
    below[along] = above[along] = at
    is_below, is_above = low[:, along] < at, high[:, along] >= at
    cells = [
        *_cells(low[is_below], high[is_below], first, below, share),
        *_cells(low[is_above], high[is_above], above, last, share),
    ]
    # A piece is in each cell that it meets: so there are no more than needed.
    return [(first, last, 1)] if all(lots == 1 for _, _, lots in cells) else cells


def _cut(low: Floats, high: Floats) -> tuple[int, float] | None:
    """Return along which axis and where to cut boxes (m, 3) in two, so that fewest lie in the cut; None: not at all."""
    if len(low) <= _FEW:
        return None
    at = np.median(low, axis=0)
    cut = np.count_nonzero((low < at) & (high >= at), axis=0)
    cut[(high >= at).all(axis=0)] = len(low)  # nothing would be on one side alone
    along = int(np.argmin(cut))
    return None if cut[along] > _MOST_CUT * len(low) else (along, float(at[along]))


def _lots(low: Floats, high: Floats, first: Floats, last: Floats, share: float) -> int:
    """Return into how many lots the pieces of a cell fall, of which these boxes are a share."""
    compared = np.arange(min(len(low), _COMPARED)) * max(1, len(low) // _COMPARED)
    meet = np.ones((len(compared), len(compared)), np.bool_)
    for lows, highs, begin, end in zip(low[compared].T, high[compared].T, first, last, strict=True):
        later = np.maximum.outer(lows, lows)
        meet &= (later <= np.minimum.outer(highs, highs)) & (later >= begin) & (later < end)
    np.fill_diagonal(meet, val=False)
    seen = meet.sum()
    others = (0.0 if seen < _FEWEST_SEEN else seen) / max(len(compared), 1) ** 2 * len(low) / share
    return int(np.clip(np.ceil(others / _MEETS), 1, _MOST_LOTS))
