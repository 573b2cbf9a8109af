"""How much of a scene is worked on at once, so that memory is bounded whatever its size."""

from dataclasses import dataclass
from typing import Final, Self

# Megabytes that a process keeps below where nothing else is said, and the least that can be asked for.
MEMORY_MB: Final = 512
LEAST_MEMORY_MB: Final = 256
# What a process takes before it has read anything: Python, numpy, shapely, the driver.
_EMPTY_MB: Final = 160
# What a pair of pieces takes at most while it is solved, with its share of pieces, and a piece while it is made and
# sent; measured (tests/acceptance/test_memory.py). Pieces of hundreds of vertices take more: they are few.
_PAIR_BYTES: Final = 3_000
_PIECE_BYTES: Final = 3_000


@dataclass(frozen=True, slots=True)
class Memory:
    """Pairs of pieces that are solved at once, and pieces that are made at once."""

    pairs: int
    pieces: int

    @classmethod
    def of(cls, memory_mb: int) -> Self:
        """Return what fits into so many megabytes of a process."""
        room = (memory_mb - _EMPTY_MB) * 2**20
        return cls(room // _PAIR_BYTES, room // _PIECE_BYTES)


DEFAULT_MEMORY: Final = Memory.of(MEMORY_MB)
