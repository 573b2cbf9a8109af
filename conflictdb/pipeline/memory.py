"""How much of a scene is worked on at once, so that memory is bounded whatever its size."""

from dataclasses import dataclass, replace
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
# What a row of pieces takes whose box is read, twice while it comes, and what of that stays until all pairs are found.
# Rows may take so much of the room; of pairs, which come after them, there are fewer then.
_BOX_BYTES: Final = 400
_HELD_BOX_BYTES: Final = 150
_ROOM_FOR_BOXES: Final = 1 / 2


@dataclass(frozen=True, slots=True)
class Memory:
    """Pairs of pieces that are solved at once, pieces that are made at once, and rows whose boxes are held at once."""

    pairs: int
    pieces: int
    boxes: int

    @classmethod
    def of(cls, memory_mb: int) -> Self:
        """Return what fits into so many megabytes of a process."""
        room = (memory_mb - _EMPTY_MB) * 2**20
        return cls(room // _PAIR_BYTES, room // _PIECE_BYTES, int(_ROOM_FOR_BOXES * room) // _BOX_BYTES)

    def beside(self, boxes: int) -> Self:
        """Return what fits beside so many boxes that are held."""
        taken = boxes * _HELD_BOX_BYTES
        return replace(self, pairs=self.pairs - taken // _PAIR_BYTES, pieces=self.pieces - taken // _PIECE_BYTES)


DEFAULT_MEMORY: Final = Memory.of(MEMORY_MB)
