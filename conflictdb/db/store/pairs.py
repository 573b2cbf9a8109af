"""What stage 1 leaves of a scene: the pairs of rows of pieces whose boxes meet, some at a time, and the pieces.

In the second transaction of a detection: `boxes`, or where it gives none `candidates`; and `bundles` of some of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Bundles
from conflictdb.db.store import copy_binary
from conflictdb.db.store.bundles import PIECE_COLUMNS, PIECE_STRINGS, decoded
from conflictdb.db.store.connection import call_each
from conflictdb.kernel.boxes import RowBoxes

# Rows whose boxes fit into one answer, which holds a gigabyte at most: each takes 134 bytes of it. And pairs of rows,
# of 52 bytes, with room for all of the last two objects.
_MOST_ROWS: Final = 7_000_000
_MOST_PAIRS: Final = 10_000_000
# What _row_boxes gives arrays of.
_BOX_COLUMNS: Final = [
    ("piece_id", "i8"), ("pieces", "i4"), ("object", "i8"), ("turn", "i2"), ("low_x", "f8"), ("low_y", "f8"),
    ("high_x", "f8"), ("high_y", "f8"), ("floor_m", "f8"), ("ceiling_m", "f8"), ("start", "i8"), ("end", "i8"),
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Candidates:
    """n pairs of rows of pieces, bundles or not, whose boxes meet; those of the same two objects follow each other.

    a, b : (n,) ids of the rows
    a_pieces, b_pieces : (n,) how many pieces each holds
    objects : (n,) a number for the two objects
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    a_pieces: NDArray[np.int64]
    b_pieces: NDArray[np.int64]
    objects: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: slice) -> Self:
        """Return some of the pairs."""
        return type(self)(self.a[rows], self.b[rows], self.a_pieces[rows], self.b_pieces[rows], self.objects[rows])


def candidates(conn: psycopg.Connection[Any], scene_id: int, at_once: int) -> Iterator[Candidates]:
    """Yield the candidates of changed objects, each pair with the first of these: so many at once, or a few more.

    All pairs of the same two objects come together; there are no more than one answer holds. Raises StoreError outside
    of a snapshot.
    """
    for sent in call_each(conn, "_candidates", scene_id, min(at_once, _MOST_PAIRS), rows_at_once=2):
        kinds = ("i8", "i8", "i4", "i4", "i8")
        *found, ranks = (copy_binary.array_values([one], kind) for one, kind in zip(sent, kinds, strict=True))
        order = np.argsort(ranks, kind="stable")
        yield Candidates(*(column.astype(np.int64)[order] for column in (*found, ranks)))


def boxes(
    conn: psycopg.Connection[Any], scene_id: int, most: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], RowBoxes]:
    """Return the rows of pieces of a scene all of whose objects changed: ids, how many pieces each holds, and boxes.

    None where only some changed, or there are more rows than `most`, or than one answer holds. Raises StoreError
    outside of a snapshot.
    """
    rows = copy_binary.receive_arrays(conn, "_row_boxes", [scene_id, min(most, _MOST_ROWS)], _BOX_COLUMNS)
    found = RowBoxes(
        boxes=np.stack([rows.pop(name) for name in ("low_x", "low_y", "high_x", "high_y")], axis=1),
        floor_m=rows["floor_m"],
        ceiling_m=rows["ceiling_m"],
        start_us=copy_binary.microseconds(rows["start"]),
        end_us=copy_binary.microseconds(rows["end"]),
        object=rows["object"],
        is_copy=rows["turn"] != 0,
    )
    return rows["piece_id"], rows["pieces"].astype(np.int64), found


def bundles(
    conn: psycopg.Connection[Any], scene_id: int, piece_ids: NDArray[np.int64]
) -> tuple[Bundles, NDArray[np.int64]]:
    """Return some rows of pieces of a scene as bundles, and of each piece its place.

    Places are in the order of kind, key, part and turn, which does not depend on the database's numbering.
    """
    return decoded(*copy_binary.receive(conn, "_pieces", [scene_id, piece_ids.tolist()], PIECE_COLUMNS, PIECE_STRINGS))
