"""Bound how much of a scene is processed at once, so that memory does not grow with its size."""

from dataclasses import dataclass, replace
from typing import Final, Self

# Default memory limit of a process, megabytes, and the least limit that a user may set.
MEMORY_MB: Final = 512
LEAST_MEMORY_MB: Final = 256
# Memory of a process before it reads anything: Python, numpy, shapely, the driver.
_EMPTY_MB: Final = 160
# Largest memory of a pair of pieces while it is solved, with its share of pieces, and of a piece while it is built and
# sent; measured (tests/acceptance/test_memory.py). Pieces of hundreds of vertices take more, but are rare.
_PAIR_BYTES: Final = 3_000
_PIECE_BYTES: Final = 3_000
# Memory of the box of a row of pieces: while it is read (two copies), and until all pairs are found. Boxes may take
# this share of the room while nothing else is in memory; what stays of them leaves less for pairs.
_BOX_BYTES: Final = 400
_HELD_BOX_BYTES: Final = 150
_ROOM_FOR_BOXES: Final = 0.85


@dataclass(frozen=True, slots=True)
class MemoryBudget:
    """Numbers of pairs of pieces solved at once, of pieces built at once, and of boxes in memory at once."""

    pairs: int
    pieces: int
    boxes: int

    @classmethod
    def of(cls, memory_mb: int) -> Self:
        """Return what fits into a process of `memory_mb` megabytes."""
        room = (memory_mb - _EMPTY_MB) * 2**20
        return cls(room // _PAIR_BYTES, room // _PIECE_BYTES, int(_ROOM_FOR_BOXES * room) // _BOX_BYTES)

    def beside(self, boxes: int) -> Self:
        """Return what fits if `boxes` boxes are in memory."""
        taken = boxes * _HELD_BOX_BYTES
        return replace(self, pairs=self.pairs - taken // _PAIR_BYTES, pieces=self.pieces - taken // _PIECE_BYTES)


DEFAULT_MEMORY: Final = MemoryBudget.of(MEMORY_MB)
