"""Estimate where a scene is crowded: cells of space and time, from a sample of its pieces, each with a number of lots.

The work of a join grows with the pairs that meet, not with the pieces: a thousand versions of one track are half a
million pairs, a thousand ships at sea a few hundred. The pieces of a crowded cell are therefore dealt into lots, and
each lot is joined with all pieces of the cell, so that a row meets about as many others as elsewhere. The sample only
balances the work; it does not change the answer.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats

# Sample size: at least _LEAST pieces, at most _MOST, in between _SHARE of all.
_LEAST: Final = 4_000
_SHARE: Final = 0.01
_MOST: Final = 40_000
# Do not cut a cell with at most _FEW sampled pieces, nor where more than _MOST_CUT of them would be in both halves.
_FEW: Final = 24
_MOST_CUT: Final = 0.5
# Target for the number of others that a row of a lot meets: meeting them then costs about as much as the row.
_MEETS: Final = 8.0
_MOST_LOTS: Final = 256
# Least number of meeting pairs (both members count) that is more than chance in a sample.
_FEWEST_SEEN: Final = 16
# Pieces of a cell compared with each other.
_COMPARED: Final = 400


@dataclass(frozen=True, slots=True)
class Cells:
    """n disjoint cells that cover space and time.

    low, high : (n, 3) plane metres east and north, microseconds; from low on, below high; infinite at the ends
    lots : (n,) int64, number of lots of each cell's pieces
    """

    low: Floats
    high: Floats
    lots: NDArray[np.int64]

    @staticmethod
    def share(count: int) -> float:
        """Return the share of `count` pieces to sample."""
        return min(1.0, max(_LEAST, min(_SHARE * count, _MOST)) / max(count, 1))

    @classmethod
    def of(cls, low: Floats, high: Floats, share: float) -> "Cells":
        """Return the cells of a scene from a sample of its pieces' boxes, (m, 3) each."""
        whole = np.full(3, np.inf)
        lows, highs, lots = zip(*_cells(low, high, -whole, whole, share), strict=True)
        return cls(np.array(lows), np.array(highs), np.array(lots, np.int64))


def _cells(low: Floats, high: Floats, first: Floats, last: Floats, share: float) -> list[tuple[Floats, Floats, int]]:
    """Return the cells between two corners: bounds and lots; a single cell if no part is crowded.

    low, high : (m, 3) boxes of the sampled pieces there
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
    # A piece is in each cell that it meets, so fewer cells mean fewer rows.
    return [(first, last, 1)] if all(lots == 1 for _, _, lots in cells) else cells


def _cut(low: Floats, high: Floats) -> tuple[int, float] | None:
    """Return the axis and place to cut boxes (m, 3) in two with the fewest boxes in both halves; None: do not cut."""
    if len(low) <= _FEW:
        return None
    at = np.median(low, axis=0)
    cut = np.count_nonzero((low < at) & (high >= at), axis=0)
    cut[(high >= at).all(axis=0)] = len(low)  # one half would be empty of boxes of its own
    along = int(np.argmin(cut))
    return None if cut[along] > _MOST_CUT * len(low) else (along, float(at[along]))


def _lots(low: Floats, high: Floats, first: Floats, last: Floats, share: float) -> int:
    """Return the number of lots of a cell, from a sample of its pieces' boxes."""
    compared = np.arange(min(len(low), _COMPARED)) * max(1, len(low) // _COMPARED)
    meet = np.ones((len(compared), len(compared)), np.bool_)
    for lows, highs, begin, end in zip(low[compared].T, high[compared].T, first, last, strict=True):
        later = np.maximum.outer(lows, lows)
        meet &= (later <= np.minimum.outer(highs, highs)) & (later >= begin) & (later < end)
    np.fill_diagonal(meet, val=False)
    seen = meet.sum()
    others = (0.0 if seen < _FEWEST_SEEN else seen) / max(len(compared), 1) ** 2 * len(low) / share
    return int(np.clip(np.ceil(others / _MEETS), 1, _MOST_LOTS))
