"""Find which pairs of objects already have a row, and whether that row is still the answer.

A row stores a 64-bit digest of its contents and of the settings. Unchanged answers are recognised without sending or
reading them; collision probability 2^-64 per pair.
"""

from collections.abc import Sequence
from typing import Any, Final, Self

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.object_numbers import kinds_and_ids, numbers_of
from conflictdb.kernel import rows
from conflictdb.store import copy_binary

# The columns of _known_conflicts, which returns each as an array.
_COLUMNS: Final = [
    ("a_kind", "i2"),
    ("a_id", "i8"),
    ("b_kind", "i2"),
    ("b_id", "i8"),
    ("digest", "i8"),
    ("place", "V6"),
]
_Objects = tuple[NDArray[np.int64], NDArray[np.int64]]
DIGEST_KEY_BYTES: Final = 16


class KnownPairs:
    """The pairs of objects with a changed member that have a row, and which of them were found again."""

    def __init__(
        self, a: NDArray[np.int64], b: NDArray[np.int64], digest: NDArray[np.int64], place: copy_binary.Bytes
    ) -> None:
        """Index rows by the numbers of their members (n,), with digests and row addresses (n, 6).

        A pair may come twice.
        """
        self._objects = np.unique(np.concatenate([a, b]))
        first, second = np.minimum(a, b), np.maximum(a, b)
        self._pair, row = np.unique(self._pairs(first, second), return_index=True)
        self._first, self._second, self._digest, self._place = first[row], second[row], digest[row], place[row]
        self._is_found = np.zeros(len(row), np.bool_)

    @classmethod
    def read(cls, conn: psycopg.Connection[Any], scene_id: int, changed: list[int] | None = None) -> Self:
        """Read the rows that a detection of a scene replaces; raises StoreError outside of a snapshot.

        changed : numbers of the changed objects, if these are few (_object_number)
        """
        known = copy_binary.receive_arrays(conn, "_known_conflicts", [scene_id, changed], _COLUMNS)
        return cls(
            numbers_of(known["a_kind"], known["a_id"]),
            numbers_of(known["b_kind"], known["b_id"]),
            known["digest"],
            known["place"].view(np.uint8).reshape(-1, 6),
        )

    def find(
        self,
        a_kind: NDArray[Any],
        a_id: NDArray[np.int64],
        b_kind: NDArray[Any],
        b_id: NDArray[np.int64],
        digest: NDArray[np.int64],
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Record that pairs (n,) were found, smaller kind and number first, and return their rows.

        Returns the rows (n,), -1 for a pair without one, and whether they have the same digest (n,).
        """
        found, is_same = np.full(len(digest), -1), np.zeros(len(digest), np.bool_)
        if not len(self._pair):
            return found, is_same
        a, b = numbers_of(a_kind, a_id), numbers_of(b_kind, b_id)
        row = np.minimum(np.searchsorted(self._pair, self._pairs(a, b)), len(self._pair) - 1)
        known = np.flatnonzero((self._first[row] == a) & (self._second[row] == b))
        found[known] = row = row[known]
        is_same[known] = self._digest[row] == digest[known]
        self._is_found[row] = True
        return found, is_same

    def places(self, of: NDArray[np.int64]) -> copy_binary.Ragged:
        """Return a column of tid: the addresses of rows (n,), null for -1."""
        place = np.zeros((len(of), 6), np.uint8)
        known = np.flatnonzero(of >= 0)
        place[known] = self._place[of[known]]
        return copy_binary.nullable(place, of < 0)

    def leave(self, among: NDArray[np.int64]) -> None:
        """Keep the pairs with a member outside `among` (increasing object numbers)."""
        self._is_found |= ~(np.isin(self._first, among) & np.isin(self._second, among))

    def gone(self) -> NDArray[np.int64]:
        """Return the rows of pairs that were not found again."""
        return np.flatnonzero(~self._is_found)

    def members(self, of: NDArray[np.int64]) -> tuple[_Objects, _Objects]:
        """Return kinds and ids of the first and of the second members of rows (n,), as in `find`."""
        return kinds_and_ids(self._first[of]), kinds_and_ids(self._second[of])

    def _pairs(self, first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return a number (n,) for each pair of members, unique if both members are known."""
        return np.searchsorted(self._objects, first) * (len(self._objects) + 1) + np.searchsorted(self._objects, second)


def digests(columns: Sequence[copy_binary.Column], key: bytes) -> NDArray[np.int64]:
    """Return digests (n,) of rows, from the bytes of their columns; never 0, which means no digest."""
    parts = [column if isinstance(column, np.ndarray) else (column.data, column.offset) for column in columns]
    return np.maximum(rows.digests(parts, key), 1).astype(np.int64)
