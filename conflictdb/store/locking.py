"""Lock a scene for one detection at a time: a row of `scene_lock`, locked until the transaction ends.

Only workers may lock rows of that table. The lock ends with the transaction, so a pooler that changes sessions between
transactions cannot lose it. Each holder increments the row. The server therefore refuses a snapshot taken before the
last detection ended (SQLSTATE 40001), and that transaction begins again.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, TypeVar

import psycopg

from conflictdb.errors import LockTimeout, StoreError
from conflictdb.store.connection import (
    LOCK_WAIT_S,
    Holder,
    begin_snapshot,
    call,
    call_many,
    transaction,
    waiting_at_most,
)

_T = TypeVar("_T")
Say = Callable[[str], object]

# A waiting detection reports the lock's holder after this time, and checks for a new holder as often.
SAY_AFTER_S: Final = 5.0
# With `lock_timeout_s` 0, how long to wait for locks other than the scene's: another scene may be free.
_IN_PASSING_S: Final = 10.0


def longest_wait_s(lock_timeout_s: float | None) -> float:
    """Return how long a detection waits for any lock but that of its scene, seconds; always finite."""
    if lock_timeout_s is None:
        return LOCK_WAIT_S
    return lock_timeout_s if lock_timeout_s > 0.0 else _IN_PASSING_S


def begin_locked(
    conn: psycopg.Connection[Any], scene_id: int, scene: str, lock_timeout_s: float | None, say: Say
) -> int:
    """Begin a transaction that sees one state of the database and holds a scene's lock; commit or roll back ends both.

    Returns how often the lock was taken: two transactions have consecutive numbers if no detection ran in between. Time
    limits of the role or the database do not apply in the transaction. `say` is called after 5 s with the holder of the
    lock, and again when the holder changes.

    Raises LockTimeout, without an open transaction, if the lock is not free within `lock_timeout_s` (None: no limit),
    or another lock within `longest_wait_s(lock_timeout_s)`.
    """

    def take(wait_s: float) -> int | None:
        (taken,) = call(conn, "_take_scene", scene_id, wait_s)
        return None if taken is None else int(taken)

    return begin_taking(conn, take, lambda: scene_id, scene, lock_timeout_s, say)


def begin_taking(
    conn: psycopg.Connection[Any],
    take: Callable[[float], _T | None],
    scene_id: Callable[[], int],
    scene: str,
    lock_timeout_s: float | None,
    say: Say,
) -> _T:
    """Begin a transaction as `begin_locked` does, with a routine that takes the scene's lock; return its result.

    take : called with the time to wait, seconds; returns None if the lock is not free by then
    scene_id : called for the id of the scene if it has to wait
    """
    start = time.monotonic()
    said = ""
    longest_s = longest_wait_s(lock_timeout_s)
    while True:
        left_s = SAY_AFTER_S if lock_timeout_s is None else max(0.0, start + lock_timeout_s - time.monotonic())
        taken = _begin(conn, take, min(SAY_AFTER_S, left_s), longest_s)
        if taken is not None:
            return taken
        with waiting_at_most(conn, longest_s):
            key = scene_id()
            with transaction(conn):
                (had_none,) = call(conn, "_add_scene_lock", key)
            if had_none:
                continue
            holder = _holder(conn, key)
        waited_s = time.monotonic() - start
        if lock_timeout_s is not None and waited_s >= lock_timeout_s:
            waited = f"waited {lock_timeout_s:g} s: " if lock_timeout_s > 0.0 else ""
            who = holder or "it has just ended"
            raise LockTimeout(f"{waited}another detection of scene {scene!r} is at work: {who}")
        if holder and holder != said:
            say(f"waiting for another detection of scene {scene!r}: {holder}")
            said = holder


def _begin(
    conn: psycopg.Connection[Any], take: Callable[[float], _T | None], wait_s: float, longest_s: float
) -> _T | None:
    """Begin the transaction; return None, without a transaction, if another session holds the lock for `wait_s`.

    longest_s : limit for every other lock, in all statements of the transaction
    """
    while True:
        # A statement of its own: a changed limit applies from the next statement on.
        limits = f"SELECT conflictdb_internal._lift_limits('{longest_s!r}')"
        try:
            with waiting_at_most(conn, longest_s):
                begin_snapshot(conn, limits, "_lift_limits")
            taken = take(wait_s)
        except StoreError as error:
            with suppress(psycopg.Error):  # a lost connection: the first error is the one to report
                conn.rollback()
            if isinstance(error, LockTimeout) and _is_of_scene(error):
                return None
            if isinstance(error.__cause__, psycopg.errors.SerializationFailure):
                continue  # another session took and released the lock since the snapshot
            raise
        if taken is None:
            conn.rollback()
        return taken


def _is_of_scene(timeout: LockTimeout) -> bool:
    """Return whether the scene's lock timed out, and not another one."""
    cause = timeout.__cause__
    return isinstance(cause, psycopg.Error) and "_take_scene(" in (cause.diag.context or "")


def _holder(conn: psycopg.Connection[Any], scene_id: int) -> str:
    """Return the holder of a scene's lock, as text for people; empty if it is free."""
    with transaction(conn):
        return " and ".join(str(Holder(*row)) for row in call_many(conn, "_scene_holders", scene_id))
