"""Pairs of pieces as arrays: what stage 2 leaves for stage 4."""

from dataclasses import dataclass
from typing import Any, NewType, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import PieceRows
from conflictdb.arrays.ragged import ragged_rows

# Row numbers in a `Pairs`: not of pieces, and not of a selection.
PairRows = NewType("PairRows", np.ndarray[Any, np.dtype[np.int64]])


@dataclass(frozen=True, slots=True)
class Pairs:
    """n pairs of pieces that passed stage 2.

    a, b : (n,)   their pieces, rows of a `Pieces` (not database ids)
    region_xy, region_offset : (r, 2) float64, (n + 1,) int64   vertices of the intersection of the two hulls, plane
        coordinates in metres (shifted like the hulls); none where it was not computed (static pairs)
    company : (n,) int64   how many of the pairs are of the same two objects, which share the work that may be done for
        these; None is one each
    """

    a: PieceRows
    b: PieceRows
    region_xy: NDArray[np.float64]
    region_offset: NDArray[np.int64]
    company: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: PairRows) -> Self:
        """Return the pairs of some rows."""
        offset, index = ragged_rows(self.region_offset, rows)
        company = None if self.company is None else self.company[rows]
        a, b = PieceRows(self.a[rows]), PieceRows(self.b[rows])
        return type(self)(a, b, self.region_xy[index], offset, company)
