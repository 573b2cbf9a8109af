"""Read what plans may meet, detected or not, while no other admission of the scene runs (sql/86).

begin_admission; objects_near; some_areas, some_tracks; put_plans; commit.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import psycopg
from psycopg.pq import TransactionStatus

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.errors import LockTimeout
from conflictdb.model.limits import Limits
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind
from conflictdb.store.connection import Holder, call, call_many, transaction
from conflictdb.store.few import some_areas, some_tracks
from conflictdb.store.given_pieces import given
from conflictdb.store.scenes import scene_of


class StoredObject(NamedTuple):
    """An object of a scene, without its geometry.

    is_stale : whether its schedule must be expanded for the time of the question
    """

    kind: int
    id: int
    key: str
    name: str | None
    owner: str | None
    is_stale: bool = False


# By connection: name, id and settings of the scene of its last admission.
_LAST: "WeakKeyDictionary[psycopg.Connection[Any], tuple[str, int, Scene]]" = WeakKeyDictionary()


@contextmanager
def admission(
    conn: psycopg.Connection[Any], scene: str, lock_timeout_s: float | None, keys: Sequence[str], owner: str | None
) -> Iterator[tuple[int, Scene, Limits, list[StoredObject]]]:
    """Run the block in a transaction that holds the lock of admissions of a scene.

    Yields its id, settings and limits of plans, and the objects that have one of some keys, or the owner.

    An own transaction sees what was committed before each statement; the lock lasts until the outermost transaction
    ends. Raises LockTimeout, naming the holder, if the lock is not free within `lock_timeout_s` (None: the limit of the
    connection).
    """
    is_own = conn.info.transaction_status == TransactionStatus.IDLE
    begun = False
    try:
        with transaction(conn):
            if is_own:
                conn.execute(b"SET TRANSACTION ISOLATION LEVEL READ COMMITTED", prepare=False)
            number, settings, *limits, replaced = call(
                conn, "_begin_admission", scene, lock_timeout_s, list(keys), owner
            )
            begun = True
            stored = scene_of(settings)
            _LAST[conn] = scene, int(number), stored
            yield int(number), stored, Limits(*limits), [StoredObject(*row) for row in replaced]
    except LockTimeout as timeout:
        if begun or conn.info.transaction_status == TransactionStatus.INERROR:
            raise
        with transaction(conn):
            number = call(conn, "_scene_id", scene)[0]
            holders = " and ".join(str(Holder(*row)) for row in call_many(conn, "_admission_holders", number))
        holders = holders or "it has just ended, or is a prepared transaction"
        raise LockTimeout(f"another admission of scene {scene!r} is at work: {holders}") from timeout.__cause__


def settings_of_last_admission(conn: psycopg.Connection[Any], scene: str) -> tuple[int, Scene] | None:
    """Return the id and settings of a scene that the last admission of a connection read; None: of another scene."""
    name, number, settings = _LAST.get(conn, (None, 0, None))
    return None if settings is None or name != scene else (number, settings)


def replaced_objects(
    conn: psycopg.Connection[Any], scene_id: int, keys: Sequence[str], owner: str | None
) -> list[StoredObject]:
    """Return the objects of a scene that have one of some keys, or an owner (None: no other objects)."""
    return [StoredObject(*row) for row in call_many(conn, "_replaced_objects", scene_id, list(keys), owner)]


def objects_near(
    conn: psycopg.Connection[Any], scene_id: int, scene: Scene, pieces: Pieces, span: tuple[int, int] | None
) -> list[StoredObject]:
    """Return the objects that pieces might meet, as committed, detected or not.

    pieces : of plans and perhaps of others, with spans widened by the largest separation in time of the scene's pairs
    span : [start, end) that the plans may touch, MINUS_INFINITY_US and INFINITY_US where unbounded; None: no time
    """
    wanted_m = max(scene.reach_m, scene.tolerance_m + scene.largest_separation_m)
    asked = (scene_id, wanted_m, *(span or (None, None)), *given(pieces))
    return [StoredObject(*row) for row in call_many(conn, "_objects_near", *asked)]


def scheduled_keys_near(conn: psycopg.Connection[Any], scene_id: int, pieces: Pieces) -> list[str]:
    """Return the keys of the objects with a schedule that pieces may meet, at any time of the schedule."""
    return [key for (key,) in call_many(conn, "_scheduled_near", scene_id, *given(pieces))]


def read_objects(
    conn: psycopg.Connection[Any], scene_id: int, objects: Sequence[StoredObject]
) -> tuple[AreaBatch, TrackBatch]:
    """Return some objects of a scene as they are stored."""
    areas, tracks = ([one.id for one in objects if one.kind == kind.code] for kind in (Kind.AREA, Kind.TRACK))
    return (
        some_areas(conn, scene_id, areas) if areas else AreaBatch.of(()),
        some_tracks(conn, scene_id, tracks) if tracks else TrackBatch.of(()),
    )
