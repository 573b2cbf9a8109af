"""Stage 2: the candidates of stage 1 whose hulls meet, and where. May over-report, never misses (see stage 1)."""

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.stage1_broad_phase import hulls_of
from conflictdb.model.results import Kind


def intersections(pieces: Pieces, a: PieceRows, b: PieceRows, *, regions: bool) -> Pairs:
    """Return the candidates (a, b) whose hulls meet, in their order.

    regions : whether to compute the regions in which they do
    """
    met = ~kernel.apart(pieces.hull_xy, pieces.hull_offset, a, b)
    a, b = PieceRows(a[met]), PieceRows(b[met])
    if not regions:
        return Pairs(a, b, np.empty((0, 2)), np.zeros(len(a) + 1, np.int64))
    return Pairs(a, b, *_regions(pieces, a, b))


def _regions(pieces: Pieces, a: PieceRows, b: PieceRows) -> tuple[Floats, NDArray[np.int64]]:
    """Return where the hulls of pairs meet, as of `Pairs`."""
    moving = (pieces.kind[a] == Kind.TRACK.code) | (pieces.kind[b] == Kind.TRACK.code)
    region = np.full(len(a), None, dtype=object)
    hulls = hulls_of(pieces)
    region[moving] = shapely.intersection(hulls[a[moving]], hulls[b[moving]])
    xy, pair_of = shapely.get_coordinates(region, return_index=True)
    return xy, np.searchsorted(pair_of, np.arange(len(a) + 1)).astype(np.int64)
