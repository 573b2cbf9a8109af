"""The interface of stage 1: a source of the candidate pairs of a scene."""

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces


class Chunk(NamedTuple):
    """Pieces, and pairs of them (a, b), as stage 1 leaves them.

    candidate_pairs : number of pairs that stage 1 left, if the source has run stage 2 since (a, b may still contain
        pairs whose hulls are at most a micrometre apart); None: count a, b
    stage2_s : seconds of the source's stage 2
    share : about which share of all pairs is found with this chunk; None: unknown
    """

    pieces: Pieces
    a: PieceRows
    b: PieceRows
    candidate_pairs: int | None = None
    stage2_s: float = 0.0
    share: float | None = 1.0


class PairSource(Protocol):
    """Stage 1 of a scene whose pieces exist: in a database, in memory or elsewhere."""

    def candidates(self) -> Iterator[Chunk]:
        """Yield the pairs of pieces (a, b) whose boxes meet in space, time and height, in chunks of pieces and pairs.

        All pairs of the same two objects are in one chunk, because they become one row. Otherwise chunks are of any
        size that fits the memory. Only answers stay in memory after a chunk.
        """

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        """Return the footprints (n,) of whole areas, shapely geometries in degrees; empty if an area was removed.

        Called while a chunk is solved.
        """

    def plans(self, track_ids: NDArray[np.int64]) -> TrackBatch:
        """Return tracks with tolerances by id, in any order, without those that were removed.

        Called while a chunk is solved.
        """
