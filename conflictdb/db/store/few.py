"""What a detection of few changed objects works on: one transaction, and a call for each step (sql/22).

begin_detection; some_areas, some_tracks; put_pieces; what `writing` does; commit
"""

from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.db.store import copy_binary
from conflictdb.db.store.connection import call, transaction
from conflictdb.db.store.detection import (
    AREA_COLUMNS,
    AREA_STRINGS,
    TRACK_COLUMNS,
    TRACK_STRINGS,
    area_batch,
    piece_columns,
    track_batch,
)
from conflictdb.db.store.locking import Say, begin_taking
from conflictdb.db.store.objects import scene_of
from conflictdb.db.store.pairs import PIECE_COLUMNS, PIECE_STRINGS, decoded
from conflictdb.model import Scene
from conflictdb.results import Kind

_KIND_BIT: Final = 62  # above the numbers of all objects
# What _put_pieces takes of a piece, in its order.
_TYPES: Final = {
    "object_kind": "smallint",
    "object_id": "bigint",
    "version": "bigint",
    "part": "integer",
    "turn": "smallint",
    "hull": "bytea",
    "span": "tstzrange",
    "floor_m": "double precision",
    "ceiling_m": "double precision",
    "shape": "bytea",
    "shape_to": "bytea",
    "leg_start": "timestamptz",
    "leg_end": "timestamptz",
    "start_lon_deg": "double precision",
    "start_lat_deg": "double precision",
    "end_lon_deg": "double precision",
    "end_lat_deg": "double precision",
    "bearing_deg": "double precision",
}


@dataclass(frozen=True, slots=True)
class Few:
    """Few objects that changed; their pieces are gone, and their marks covered.

    srid : of the scene's plane
    area_ids, track_ids : their numbers; some may be removed
    known_objects : how many of them the last detection knew, None where that cannot be told
    """

    srid: int
    area_ids: list[int]
    track_ids: list[int]
    known_objects: int | None

    @property
    def numbers(self) -> list[int]:
        """One number for each object of any kind (_object_number)."""
        return [*self.area_ids, *(number | Kind.TRACK.code << _KIND_BIT for number in self.track_ids)]


@dataclass(frozen=True, slots=True)
class Begun:
    """A detection that has the lock of its scene.

    taken : how often the lock was taken (`locking.begin_locked`)
    is_behind : whether tables are attached to the scene that it has to follow first
    few : what changed, if it is little
    """

    scene_id: int
    taken: int
    is_behind: bool
    settings: Scene
    few: Few | None


def begin_detection(
    conn: psycopg.Connection[Any],
    scene: str,
    few: int,
    lock_timeout_s: float | None,
    say: Say,
    again: bool | None,
) -> Begun:
    """Begin the transaction of a detection as `begin_locked` does, and return what there is to do.

    few : so many marks at most are few; -1: none are
    again : whether it has to follow also tables that could not be read within the last minute; None: no table at all

    Raises InvalidInput if there is no scene of that name, and LockTimeout.
    """

    def take(wait_s: float) -> Begun | None:
        number, taken, is_behind, *settings, srid, area_ids, track_ids, known_objects = call(
            conn, "_begin_detection", scene, wait_s, few, again
        )
        if taken is None:
            return None
        some = None if area_ids is None else Few(srid, area_ids, track_ids, known_objects)
        return Begun(number, taken, is_behind, scene_of(scene, *settings), some)

    def scene_id() -> int:
        with transaction(conn):
            return int(call(conn, "_scene_id", scene)[0])

    return begin_taking(conn, take, scene_id, scene, lock_timeout_s, say)


def some_areas(conn: psycopg.Connection[Any], scene_id: int, area_ids: list[int]) -> AreaBatch:
    """Return those of some areas that are in a scene, by number."""
    return area_batch(*copy_binary.few(conn, "_some_areas", [scene_id, area_ids], AREA_COLUMNS, AREA_STRINGS))


def some_tracks(conn: psycopg.Connection[Any], scene_id: int, track_ids: list[int]) -> TrackBatch:
    """Return those of some tracks that are in a scene, by number."""
    return track_batch(*copy_binary.few(conn, "_some_tracks", [scene_id, track_ids], TRACK_COLUMNS, TRACK_STRINGS))


def put_pieces(
    conn: psycopg.Connection[Any], scene_id: int, srid: int, pieces: Pieces, most: int
) -> tuple[Pieces, NDArray[np.int64], NDArray[np.int64]]:
    """Store the pieces of the changed objects, and return their candidates: all pieces of these, and the pairs.

    The pieces are in the order of kind, key, part and turn. Pairs are of ids of pieces a, b (n,); so many at most.
    """
    columns = piece_columns(pieces, scene_id, srid, Kind.TRACK)
    is_area = pieces.kind == Kind.AREA.code
    if is_area.any():
        for name in list(_TYPES)[list(_TYPES).index("leg_start") :]:
            columns[name] = copy_binary.nullable(cast("copy_binary.Bytes", columns[name]), is_area)
    nothing = copy_binary.Ragged.of([None] * len(pieces))
    arrays = [copy_binary.array([columns.get(name, nothing)], of) for name, of in _TYPES.items()]
    found, strings = copy_binary.few(
        conn, "_put_pieces", [scene_id, most, *arrays], PIECE_COLUMNS, [*PIECE_STRINGS, "met"]
    )
    met = [copy_binary.int8_array(sent) if sent else np.empty(0, np.int64) for sent in strings.pop("met")]
    a = np.repeat(found["piece_id"], [len(one) for one in met])
    return decoded(found, strings), a, np.concatenate([np.empty(0, np.int64), *met])
