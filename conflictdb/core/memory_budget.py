"""Bound how much of a scene is processed at once, so that memory does not grow with its size."""

from typing import Final, NamedTuple, Self

# Default memory limit of a process, megabytes, and the least limit that a user may set.
MEMORY_MB: Final = 512
LEAST_MEMORY_MB: Final = 256
# Memory of a process before it reads anything: Python, numpy, shapely, the driver.
_EMPTY_MB: Final = 160
# Largest memory of a pair of pieces while it is solved, with its share of pieces, and of a piece while it is built and
# sent; measured (tests/acceptance/test_memory.py). Pieces of hundreds of vertices take more, but are rare.
_PAIR_BYTES: Final = 3_000
_PIECE_BYTES: Final = 3_000
# Pieces cut at once, and pairs solved at once while their pieces are in memory: the work for each batch is small beside
# that for its members.
_MOST_PIECES_AT_ONCE: Final = 32_768
_MOST_PAIRS_AT_ONCE: Final = 32_768
# Memory of a pair of rows of pieces; such pairs may take this share of the room for pairs of pieces. Each batch of them
# visits all boxes once: a small part of its time if it has at least half as many pairs as there are boxes.
_ROW_PAIR_BYTES: Final = 150
_ROOM_FOR_ROW_PAIRS: Final = 1 / 4
_LEAST_ROW_PAIRS: Final = 65_536
# Memory of the box of a row of pieces: while it is sorted, and until all pairs are found. Boxes may take this share of
# the room while nothing else is in memory; what stays of them leaves less for pairs.
_BOX_BYTES: Final = 190
_HELD_BOX_BYTES: Final = 180
_ROOM_FOR_BOXES: Final = 0.85
# Pieces in hand may take this share of the room. While they are sent a block of them is encoded.
_ROOM_IN_HAND: Final = 1 / 2
_SENT_BYTES: Final = 16 * 2**20


class MemoryBudget(NamedTuple):
    """Numbers of pairs of pieces solved at once, of pieces built at once, and of boxes in memory at once."""

    pairs: int
    pieces: int
    boxes: int

    @classmethod
    def of(cls, memory_mb: int) -> Self:
        """Return what fits into a process of `memory_mb` megabytes."""
        room = (memory_mb - _EMPTY_MB) * 2**20
        return cls(room // _PAIR_BYTES, room // _PIECE_BYTES, int(_ROOM_FOR_BOXES * room) // _BOX_BYTES)

    @property
    def hand_bytes(self) -> int:
        """Bytes of all pieces of a scene that may stay in memory from one transaction to the next."""
        return int(_ROOM_IN_HAND * self.pieces * _PIECE_BYTES)

    @property
    def pieces_at_once(self) -> int:
        """Number of pieces to cut at once."""
        return min(self.pieces, _MOST_PIECES_AT_ONCE)

    @property
    def pairs_at_once(self) -> int:
        """Number of pairs of pieces in memory to solve at once."""
        return min(self.pairs, _MOST_PAIRS_AT_ONCE)

    def row_pairs(self, rows: int) -> int:
        """Return how many pairs of `rows` rows of pieces to find at once."""
        fit = int(_ROOM_FOR_ROW_PAIRS * self.pairs * _PAIR_BYTES) // _ROW_PAIR_BYTES
        return max(min(fit, max(rows // 2, _LEAST_ROW_PAIRS)), 1)

    def beside(self, boxes: int) -> Self:
        """Return what fits if `boxes` boxes are in memory."""
        return self._without(boxes * _HELD_BOX_BYTES)

    def beside_hand(self, hand_bytes: int) -> Self:
        """Return what fits if pieces in hand are in memory, and are sent."""
        return self._without(hand_bytes + min(hand_bytes, _SENT_BYTES))

    def _without(self, taken: int) -> Self:
        pairs, pieces = self.pairs - taken // _PAIR_BYTES, self.pieces - taken // _PIECE_BYTES
        return self._replace(pairs=max(pairs, 1), pieces=max(pieces, 1))


DEFAULT_MEMORY: Final = MemoryBudget.of(MEMORY_MB)
