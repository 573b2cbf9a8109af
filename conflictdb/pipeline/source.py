"""Where the pairs of a scene come from: stage 1, wherever it runs."""

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import PieceRows, Pieces


class Chunk(NamedTuple):
    """Pieces, and pairs of them (a, b), as stage 1 leaves them.

    candidate_pairs : number of pairs that stage 1 left, if the source has run stage 2 since (a, b may still contain
        pairs whose hulls are at most a micrometre apart); None: count a, b
    stage2_s : seconds of the source's stage 2
    """

    pieces: Pieces
    a: PieceRows
    b: PieceRows
    candidate_pairs: int | None = None
    stage2_s: float = 0.0


class PairSource(Protocol):
    """Stage 1 of a scene whose pieces are made: in a database, in memory, or wherever else pieces are joined."""

    def candidates(self) -> Iterator[Chunk]:
        """Yield the pairs of pieces (a, b) whose boxes meet in space, time and height, in chunks of pieces and pairs.

        All pairs of the same two objects are in one chunk, for they become one row; else they may be split at will, so
        that a chunk fits the memory: of one that is done only its answers are kept.
        """

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        """Return the footprints (n,) of whole areas, shapely geometries in degrees; empty ones of areas that are gone.

        Asked for while a chunk is worked on.
        """
