"""Read the candidates of stage 1: pairs of rows of pieces whose boxes overlap, in chunks, and the pieces.

In the second transaction of a detection: `boxes`, or `candidates` where it returns no rows; then `bundles` of their
rows.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.column_numbers import CLASS, IN_PIECES, numbers_of_words
from conflictdb.arrays.object_numbers import kinds_and_ids
from conflictdb.arrays.pieces import Bundles
from conflictdb.kernel.boxes import RowBoxes
from conflictdb.model.rules import KINDS
from conflictdb.store import copy_binary
from conflictdb.store.connection import call, call_each
from conflictdb.store.stored_bundles import PIECE_COLUMNS, PIECE_STRINGS, decoded

# Pairs that fit one answer, limited by the 1 GB of a value. A pair takes 52 bytes, with room for all pairs of the last
# two objects.
_PAIRS_THAT_FIT: Final = 10_000_000
# The columns of _row_boxes.
_BOX_COLUMNS: Final = [
    ("piece_id", "i8"), ("pieces", "i4"), ("object", "i8"), ("turn", "i2"), ("low_x", "f8"), ("low_y", "f8"),
    ("high_x", "f8"), ("high_y", "f8"), ("floor_m", "f8"), ("ceiling_m", "f8"), ("start", "i8"), ("end", "i8"),
    *((name, "i8") for name in IN_PIECES), ("marks", "i8"),
]  # fmt: skip


# The parts (n,), (n,) of the two pieces of each pair.
Parts = tuple[NDArray[np.int64], NDArray[np.int64]]


@dataclass(frozen=True, slots=True)
class Candidates:
    """n pairs of rows of pieces (bundles or not) whose boxes overlap; pairs of the same two objects are adjacent.

    a, b : (n,) ids of the rows
    a_pieces, b_pieces : (n,) numbers of pieces in each row
    objects : (n,) a number for the two objects
    share : about which share of all pairs is found with these; None: unknown
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    a_pieces: NDArray[np.int64]
    b_pieces: NDArray[np.int64]
    objects: NDArray[np.int64]
    share: float | None = None

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: slice | NDArray[np.int64]) -> Self:
        """Return some of the pairs."""
        a, b, objects = self.a[rows], self.b[rows], self.objects[rows]
        return type(self)(a, b, self.a_pieces[rows], self.b_pieces[rows], objects, self.share)


def candidates(
    conn: psycopg.Connection[Any], scene_id: int, at_once: int, *, fit: int = _PAIRS_THAT_FIT
) -> Iterator[Candidates]:
    """Yield the candidates of changed objects in chunks of about `at_once` pairs, or of `fit` if that is fewer.

    Each pair comes with its first changed object. All pairs of the same two objects are in one chunk. Raises StoreError
    outside of a snapshot.
    """
    for sent in call_each(conn, "_candidates", scene_id, min(at_once, fit), rows_at_once=2):
        kinds = ("i8", "i8", "i4", "i4", "i8")
        columns = [copy_binary.array_values([one], kind) for one, kind in zip(sent, kinds, strict=True)]
        order = np.argsort(columns[-1], kind="stable")
        a, b, a_pieces, b_pieces, ranks = (column.astype(np.int64)[order] for column in columns)
        yield Candidates(a, b, a_pieces, b_pieces, ranks)


@dataclass(frozen=True, slots=True)
class Marks:
    """The marks of n rows of pieces, as bits: bit 0 for all pairs, any other for those with a class or kind.

    marked : (n,) int64, the bits of the object's marks
    concerned : (n,) int64, the bits of the marks that concern the object's pairs with theirs
    """

    marked: NDArray[np.int64]
    concerned: NDArray[np.int64]

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the marks of some of the rows."""
        return type(self)(self.marked[rows], self.concerned[rows])

    def are_dirty(self, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return (m,) whether marks of either row concern a pair."""
        return ((self.marked[a] & self.concerned[b]) | (self.marked[b] & self.concerned[a])) != 0


@dataclass(frozen=True, slots=True)
class JoinedRows:
    """The n rows of pieces that may be in a marked pair.

    ids : (n,) int64
    pieces : (n,) int32, numbers of pieces in each row
    boxes : without types
    marks : None if all pairs are marked
    """

    ids: NDArray[np.int64]
    pieces: NDArray[np.int32]
    boxes: RowBoxes
    marks: Marks | None

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def class_number(self) -> NDArray[np.int64]:
        """Return the classes (n,) of the objects."""
        assert self.boxes.numbers is not None  # noqa: S101
        return self.boxes.numbers[:, CLASS]


def boxes(conn: psycopg.Connection[Any], scene_id: int, most: int) -> JoinedRows:
    """Return the rows of a scene that may be in a marked pair, to be joined in memory.

    Returns no rows if few objects changed, or the scene has more rows than `most`. Rows are decoded as they arrive, so
    memory is that of the result. Raises StoreError outside of a snapshot.
    """
    rows, is_all, is_any, with_numbers = call(conn, "_joined_in_memory", scene_id, most)
    ids, pieces = np.empty(rows, np.int64), np.empty(rows, np.int32)
    corners, numbers = np.empty((rows, 4)), np.empty((rows, len(IN_PIECES)), np.int64)
    marked = np.empty(0 if is_all else rows, np.int64)
    found = RowBoxes(
        boxes=corners,
        floor_m=np.empty(rows),
        ceiling_m=np.empty(rows),
        start_us=np.empty(rows, np.int64),
        end_us=np.empty(rows, np.int64),
        object=np.empty(rows, np.int64),
        is_copy=np.empty(rows, np.bool_),
        numbers=numbers,
    )
    n = 0
    sent = copy_binary.receive_each(conn, "_row_boxes", [scene_id, is_all, is_any, with_numbers], _BOX_COLUMNS)
    for part, _ in sent if rows else ():
        now = slice(n, n + len(part["piece_id"]))
        ids[now], pieces[now] = part["piece_id"], part["pieces"]
        for corner, name in enumerate(("low_x", "low_y", "high_x", "high_y")):
            corners[now, corner] = part[name]
        for column, name in enumerate(IN_PIECES):
            numbers[now, column] = part[name]
        found.floor_m[now], found.ceiling_m[now] = part["floor_m"], part["ceiling_m"]
        found.start_us[now] = copy_binary.microseconds(part["start"])
        found.end_us[now] = copy_binary.microseconds(part["end"])
        found.object[now], found.is_copy[now] = part["object"], part["turn"] != 0
        if not is_all:
            marked[now] = part["marks"]
        n = now.stop
    found = found.take(slice(n))
    marks = None if is_all else _marks(found, numbers[:n, CLASS], marked[:n], with_numbers)
    return JoinedRows(ids[:n], pieces[:n], found, marks)


def _marks(
    rows: RowBoxes, class_number: NDArray[np.int64], marked: NDArray[np.int64], with_numbers: list[int]
) -> Marks:
    """Return the marks of rows, where bit n of `marked` (n,) is for pairs with the nth of some classes and kinds."""
    of_kind = numbers_of_words(KINDS)[kinds_and_ids(rows.object)[0]]
    concerned = np.ones(len(rows), np.int64)
    for bit, number in enumerate(with_numbers, 1):
        concerned |= ((class_number == number) | (of_kind == number)).astype(np.int64) << bit
    return Marks(marked, concerned)


def bundles(
    conn: psycopg.Connection[Any], scene_id: int, piece_ids: NDArray[np.int64]
) -> tuple[Bundles, NDArray[np.int64]]:
    """Read rows of pieces of a scene as bundles; also return the rank of each piece.

    Ranks follow kind, key, part and turn, so they do not depend on the database's ids.
    """
    return decoded(*copy_binary.receive(conn, "_pieces", [scene_id, piece_ids.tolist()], PIECE_COLUMNS, PIECE_STRINGS))
