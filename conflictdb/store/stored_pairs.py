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
from conflictdb.store.connection import call_each
from conflictdb.store.stored_bundles import PIECE_COLUMNS, PIECE_STRINGS, decoded

# Rows and pairs that fit one answer, limited by the 1 GB of a value. A row's box takes 134 bytes, a pair 52, with room
# for all pairs of the last two objects.
_ROWS_THAT_FIT: Final = 7_000_000
_PAIRS_THAT_FIT: Final = 10_000_000
# The columns of _row_boxes, which returns each as an array.
_BOX_COLUMNS: Final = [
    ("piece_id", "i8"), ("pieces", "i4"), ("object", "i8"), ("turn", "i2"), ("low_x", "f8"), ("low_y", "f8"),
    ("high_x", "f8"), ("high_y", "f8"), ("floor_m", "f8"), ("ceiling_m", "f8"), ("start", "i8"), ("end", "i8"),
    *((name, "i8") for name in IN_PIECES), ("marks", "i8"), ("with_number", "i8"),
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

    def are_all(self) -> bool:
        """Return whether all pairs of rows are marked."""
        return bool((self.marked & 1).all())

    def are_dirty(self, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return (m,) whether marks of either row concern a pair."""
        return ((self.marked[a] & self.concerned[b]) | (self.marked[b] & self.concerned[a])) != 0


def boxes(
    conn: psycopg.Connection[Any], scene_id: int, most: int, *, fit: int = _ROWS_THAT_FIT
) -> tuple[NDArray[np.int64], NDArray[np.int64], RowBoxes, NDArray[np.int64], Marks]:
    """Return ids, numbers of pieces, boxes, classes and marks of all rows that may be in a marked pair.

    Returns no rows if few objects changed, or the scene has more rows than `most` or `fit`. Raises StoreError outside
    of a snapshot.
    """
    rows = copy_binary.receive_arrays(conn, "_row_boxes", [scene_id, min(most, fit)], _BOX_COLUMNS)
    found = RowBoxes(
        boxes=np.stack([rows.pop(name) for name in ("low_x", "low_y", "high_x", "high_y")], axis=1),
        floor_m=rows["floor_m"],
        ceiling_m=rows["ceiling_m"],
        start_us=copy_binary.microseconds(rows["start"]),
        end_us=copy_binary.microseconds(rows["end"]),
        object=rows["object"],
        is_copy=rows["turn"] != 0,
        numbers=np.stack([rows.pop(name) for name in IN_PIECES], axis=1),
    )
    assert found.numbers is not None  # noqa: S101
    classes = found.numbers[:, CLASS]
    of_kind = numbers_of_words(KINDS)[kinds_and_ids(found.object)[0]]
    concerned = np.ones(len(found), np.int64)
    for bit, number in enumerate(rows["with_number"].tolist(), 1):
        concerned |= ((classes == number) | (of_kind == number)).astype(np.int64) << bit
    return rows["piece_id"], rows["pieces"].astype(np.int64), found, classes, Marks(rows["marks"], concerned)


def bundles(
    conn: psycopg.Connection[Any], scene_id: int, piece_ids: NDArray[np.int64]
) -> tuple[Bundles, NDArray[np.int64]]:
    """Read rows of pieces of a scene as bundles; also return the rank of each piece.

    Ranks follow kind, key, part and turn, so they do not depend on the database's ids.
    """
    return decoded(*copy_binary.receive(conn, "_pieces", [scene_id, piece_ids.tolist()], PIECE_COLUMNS, PIECE_STRINGS))
