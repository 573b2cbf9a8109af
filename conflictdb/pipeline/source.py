"""Where the pairs of a scene come from: stages 1 and 2, wherever these run."""

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces


class PairSource(Protocol):
    """Stages 1 and 2 of a scene whose pieces are made: in a database, in memory, or wherever else pieces are joined."""

    def find_candidates(self) -> int:
        """Find the pairs of pieces whose boxes meet in space, time and height; return how many. Called first, once."""

    def intersections(self, *, regions: bool) -> Iterator[tuple[Pieces, Pairs]]:
        """Yield the candidates whose hulls meet, in chunks of pieces and pairs of these.

        All pairs of the same two objects are in one chunk, for they become one row; else they may be split at will, so
        that a chunk fits the memory: of one that is done only its answers are kept. There is one chunk at least, and
        it may be empty. Pieces need no hulls.

        regions : whether the intersections of the hulls are asked for, where a member moves
        """

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        """Return the footprints (n,) of whole areas, shapely geometries in degrees; empty ones of areas that are gone.

        Asked for while a chunk is worked on.
        """
