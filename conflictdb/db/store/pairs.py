"""What stage 1 leaves of a scene: the pairs of rows of pieces whose boxes meet, some at a time, and the pieces.

In the second transaction of a detection: `candidates`, and `bundles` of some of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Bundles
from conflictdb.db.store import copy_binary
from conflictdb.db.store.bundles import PIECE_COLUMNS, PIECE_STRINGS, decoded
from conflictdb.db.store.connection import call_each


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

    All pairs of the same two objects come together. Raises StoreError outside of a snapshot.
    """
    for sent in call_each(conn, "_candidates", scene_id, at_once, rows_at_once=2):
        kinds = ("i8", "i8", "i4", "i4", "i8")
        *found, ranks = (copy_binary.array_values([one], kind) for one, kind in zip(sent, kinds, strict=True))
        order = np.argsort(ranks, kind="stable")
        yield Candidates(*(column.astype(np.int64)[order] for column in (*found, ranks)))


def bundles(
    conn: psycopg.Connection[Any], scene_id: int, piece_ids: NDArray[np.int64]
) -> tuple[Bundles, NDArray[np.int64]]:
    """Return some rows of pieces of a scene as bundles, and of each piece its place.

    Places are in the order of kind, key, part and turn, which does not depend on the database's numbering.
    """
    return decoded(*copy_binary.receive(conn, "_pieces", [scene_id, piece_ids.tolist()], PIECE_COLUMNS, PIECE_STRINGS))
