"""Detect few changed objects in one transaction, with one call per step (sql/22).

begin_detection; some_areas, some_tracks, seen_tracks; put_pieces; the calls of `write_rows`; commit
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Bundles, Pieces
from conflictdb.core.pieces.bundling import bundles_of
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind
from conflictdb.store import copy_binary
from conflictdb.store.connection import call, transaction
from conflictdb.store.detections import AREA_ROW, TRACK_ROW, area_batch, track_batch
from conflictdb.store.locking import Say, begin_taking
from conflictdb.store.piece_columns import SCALARS
from conflictdb.store.scenes import scene_of
from conflictdb.store.stored_bundles import (
    PIECE_COLUMNS,
    PIECE_STRINGS,
    climb,
    climbs,
    decoded,
    hulls,
    leg_times,
    legs,
    scalars,
    shapes,
)
from conflictdb.store.stored_objects import AREA_STRINGS, TOLERANCES, TRACK_STRINGS
from conflictdb.store.stored_pairs import Parts

# Columns that _put_pieces returns besides PIECE_COLUMNS and PIECE_STRINGS.
_MET: Final = ["met", "own_parts", "met_parts"]
_COUNTS: Final = ["candidate_pairs", "stage2_us"]


@dataclass(frozen=True, slots=True)
class Few:
    """Few changed objects. Their old pieces are removed and their marks covered.

    srid : of the scene's plane
    area_ids, track_ids : some may be removed objects
    known_objects : how many of them the last detection knew; None: unknown
    """

    srid: int
    area_ids: list[int]
    track_ids: list[int]
    known_objects: int | None

    @property
    def numbers(self) -> list[int]:
        """Object numbers, unique across kinds (_object_number)."""
        kind = np.repeat([Kind.AREA.code, Kind.TRACK.code], [len(self.area_ids), len(self.track_ids)])
        return numbers_of(kind, np.array([*self.area_ids, *self.track_ids], np.int64)).tolist()


@dataclass(frozen=True, slots=True)
class Begun:
    """A detection that holds the lock of its scene.

    taken : how often the lock was taken (`locking.begin_locked`)
    is_behind : whether it must first follow tables attached to the scene
    few : the changed objects, if there are few
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
    """Begin the transaction of a detection as `begin_locked` does; return what the detection has to do.

    few : the largest number of marks that counts as few; -1: none does
    again : whether to follow also tables that could not be read within the last minute; None: follow no tables

    Raises InvalidInput if the scene does not exist, and LockTimeout.
    """

    def take(wait_s: float) -> Begun | None:
        number, taken, is_behind, settings, srid, area_ids, track_ids, known_objects = call(
            conn, "_begin_detection", scene, wait_s, few, again
        )
        if taken is None:
            return None
        some = None if area_ids is None else Few(srid, area_ids, track_ids, known_objects)
        return Begun(number, taken, is_behind, scene_of(settings), some)

    def scene_id() -> int:
        with transaction(conn):
            return int(call(conn, "_scene_or_branch", scene)[0])

    return begin_taking(conn, take, scene_id, scene, lock_timeout_s, say)


def some_areas(conn: psycopg.Connection[Any], scene_id: int, area_ids: list[int]) -> AreaBatch:
    """Return the areas of a scene with the given ids; missing ones are left out."""
    return area_batch(*copy_binary.few(conn, "_some_areas", [scene_id, area_ids], AREA_ROW, AREA_STRINGS))


def some_tracks(conn: psycopg.Connection[Any], scene_id: int, track_ids: list[int]) -> TrackBatch:
    """Return the tracks of a scene with the given ids; missing ones are left out."""
    return track_batch(
        *copy_binary.few(conn, "_some_tracks", [scene_id, track_ids], TRACK_ROW, [*TRACK_STRINGS, *TOLERANCES])
    )


def seen_tracks(conn: psycopg.Connection[Any], scene_id: int, track_ids: list[int]) -> TrackBatch:
    """Return the tracks with the given ids that a scene reads: its own, and of a branch those of its parent."""
    found = some_tracks(conn, scene_id, track_ids)
    if len(found) < len(track_ids):
        _, *parents = call(conn, "_layers", scene_id)[0]
        for parent_id in parents:
            found = found.followed_by(some_tracks(conn, parent_id, track_ids))
    return found


@dataclass(frozen=True, slots=True)
class Met:
    """The pairs of the changed objects' pieces, after stage 2 if few pieces are involved.

    bundles, place : all rows of pieces in a pair, and the rank of each piece (`pairs.bundles`)
    a, b : (n,) ids of rows
    parts : of the pieces in the pairs; None: stage 2 has not run, and the pairs are rows whose boxes overlap
    candidate_pairs : pairs of pieces before stage 2, if it has run
    stage2_s : its seconds
    """

    bundles: Bundles
    place: NDArray[np.int64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    parts: Parts | None
    candidate_pairs: int
    stage2_s: float


def put_pieces(
    conn: psycopg.Connection[Any], scene_id: int, srid: int, pieces: Pieces, most: int, most_compared: int
) -> Met:
    """Store the pieces of the changed objects, and return their pairs.

    most : the largest number of pairs of rows to return
    most_compared : pairs of pieces up to which the database runs stage 2
    """
    stored = bundles_of(pieces)
    of_rows, size = scalars(stored, srid), np.diff(stored.offset)
    is_bundle = size > 1
    some = stored.take(np.flatnonzero(is_bundle))
    is_area = some.pieces.kind[some.offset[:-1]] == Kind.AREA.code
    has_shapes = is_bundle.copy()
    has_shapes[is_bundle] = is_area
    of_pieces = stored.pieces
    columns: list[tuple[copy_binary.Column, str]] = [(of_rows[one.name], one.sent) for one in SCALARS]
    columns += [
        # Arrays count from 1.
        (copy_binary.fixed(stored.offset[:-1] + 1, "i4"), "integer"),
        (copy_binary.where(hulls(some, srid), is_bundle), "bytea"),
        (copy_binary.where(shapes(some.take(np.flatnonzero(is_area))), has_shapes), "bytea"),
        (copy_binary.fixed(of_pieces.part, "i4"), "integer"),
        (copy_binary.instants(of_pieces.start_us), "timestamptz"),
        (leg_times(of_pieces), "timestamptz"),
        (legs(of_pieces), "double precision"),
        (copy_binary.fixed(climbs(stored), "b1"), "boolean"),
        (climb(of_pieces), "double precision"),
    ]
    arrays = [copy_binary.array([column], of) for column, of in columns]
    found, strings = copy_binary.few(
        conn, "_put_pieces", [scene_id, most, most_compared, *arrays], PIECE_COLUMNS, [*PIECE_STRINGS, *_MET, *_COUNTS]
    )
    candidate_pairs, stage2_us = (int.from_bytes(strings.pop(name)[0], signed=True) for name in _COUNTS)
    # The only row may be one without a piece.
    rows = slice(len(found["piece_id"]))
    strings = {name: column[rows] for name, column in strings.items()}
    met, *sent = (strings.pop(name) for name in _MET)
    b = copy_binary.array_values(met, "i8")
    a = np.repeat(found["piece_id"], [copy_binary.array_length(one, "i8") for one in met])
    parts = None
    if candidate_pairs >= 0:
        own, other = (copy_binary.array_values(one, "i4").astype(np.int64) for one in sent)
        parts = own, other
    return Met(*decoded(found, strings), a, b, parts, candidate_pairs, stage2_us / 1e6)
