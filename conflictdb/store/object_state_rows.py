"""Read the states of a scene's objects, and cover their marks, for the write-back of answers computed outside."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.column_numbers import NUMBERED, number_of
from conflictdb.arrays.object_numbers import kinds_and_ids, numbers_of
from conflictdb.core.pieces.digests import area_digests, track_digests
from conflictdb.model.results import Kind
from conflictdb.store import copy_binary
from conflictdb.store.connection import call
from conflictdb.store.detections import area_batch, track_batch
from conflictdb.store.stored_objects import each_area_row, each_track_row, values_of_rows


@dataclass(frozen=True, slots=True)
class ObjectStates:
    """The states of n objects.

    number : (n,) int64, unique across kinds (`arrays.object_numbers`), increasing
    version : (n,) int64
    digest : (n,) int64, of all data that conflicts depend on (`pieces.contents`)
    key : (n,) object, texts
    """

    number: NDArray[np.int64]
    version: NDArray[np.int64]
    digest: NDArray[np.int64]
    key: NDArray[np.object_]

    def __len__(self) -> int:
        return len(self.number)

    @classmethod
    def of(
        cls,
        kind: NDArray[Any],
        ids: NDArray[np.int64],
        version: NDArray[np.int64],
        digest: NDArray[np.int64],
        key: NDArray[np.object_],
    ) -> "ObjectStates":
        """Return the states of objects given by kind and id, ordered by number."""
        number = numbers_of(kind, ids)
        order = np.argsort(number, kind="stable")
        return cls(number[order], version[order], digest[order], key[order])

    def rows(self, number: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows (k,) of objects by their numbers; -1 for objects that are missing."""
        if not len(self):
            return np.full(len(number), -1)
        row = np.minimum(np.searchsorted(self.number, number), len(self) - 1)
        return np.where(self.number[row] == number, row, -1)


def object_states(conn: psycopg.Connection[Any], scene_id: int) -> ObjectStates:
    """Return the states of a scene's objects, as the transaction sees them; reads in chunks."""
    parts: list[tuple[NDArray[Any], ...]] = []
    for columns, strings in each_area_row(conn, scene_id):
        areas = area_batch(_with_numbers(Kind.AREA, columns, strings), strings)
        parts.append(_states(Kind.AREA, areas.area_id, areas.version, area_digests(areas), strings["key"]))
    for columns, strings in each_track_row(conn, scene_id):
        tracks = track_batch(_with_numbers(Kind.TRACK, columns, strings), strings)
        parts.append(_states(Kind.TRACK, tracks.track_id, tracks.version, track_digests(tracks), strings["key"]))
    return ObjectStates.of(*map(np.concatenate, zip(*parts, strict=True)))


def _with_numbers(
    kind: Kind, columns: dict[str, NDArray[Any]], strings: dict[str, list[bytes]]
) -> dict[str, NDArray[Any]]:
    """Return columns with the numbers of NUMBERED."""
    numbers = {
        f"{one.name}_number": [number_of(value, one.form) for value in values_of_rows(one, columns, strings)]
        for one in NUMBERED[kind]
    }
    return columns | {name: np.array(each, np.int64) for name, each in numbers.items()}


def _states(kind: Kind, *columns: Any) -> tuple[NDArray[Any], ...]:
    ids, version, digest, keys = columns
    key = np.empty(len(ids), dtype=object)
    key[:] = [one.decode() for one in keys]
    return np.full(len(ids), kind.code, np.int8), ids, version, digest, key


def cover(conn: psycopg.Connection[Any], scene_id: int, number: NDArray[np.int64]) -> None:
    """Cover the marks of exactly these objects, marking objects without one; before `begin_write`."""
    kind, ids = kinds_and_ids(number)
    arrays = [
        copy_binary.array([copy_binary.fixed(kind, "i2")], "smallint"),
        copy_binary.array([copy_binary.fixed(ids, "i8")], "bigint"),
    ]
    call(conn, "_cover", scene_id, *arrays)
