"""The lock that lets one detection of a scene work at a time: a row of `scene_lock`, kept to the end of a transaction.

Only workers may lock rows of that table. A pooler that gives every transaction another session cannot lose the lock: it
ends with the transaction. Each holder counts the row up. So a snapshot taken before the last detection ended is refused
by the server (SQLSTATE 40001), and that transaction begins again.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, TypeVar

import psycopg

from conflictdb.db.store.connection import (
    LOCK_WAIT_S,
    Holder,
    begin_snapshot,
    call,
    call_many,
    transaction,
    waiting_at_most,
)
from conflictdb.errors import LockTimeout, StoreError

_T = TypeVar("_T")
Say = Callable[[str], object]

# A detection that waits for another one says so after this time, and looks whether it is still the same one.
SAY_AFTER_S: Final = 5.0
# How long a detection that waits for no other one waits for all other locks: another scene may be free.
_IN_PASSING_S: Final = 10.0


def longest_wait_s(lock_timeout_s: float | None) -> float:
    """Return how long a detection waits for any lock but that of its scene, seconds: never for ever."""
    if lock_timeout_s is None:
        return LOCK_WAIT_S
    return lock_timeout_s if lock_timeout_s > 0.0 else _IN_PASSING_S


def begin_locked(
    conn: psycopg.Connection[Any], scene_id: int, scene: str, lock_timeout_s: float | None, say: Say
) -> int:
    """Begin a transaction that sees one state of the database and holds a scene's lock; commit or roll back ends both.

    Returns how often the lock was taken: two transactions between which nobody took it have numbers in sequence. Limits
    of time that the role or the database sets do not hold for the transaction. `say` is told after 5 s who holds the
    lock, and again when that is somebody else.

    Raises LockTimeout, without an open transaction, if somebody else keeps it for `lock_timeout_s` (None: no limit), or
    any other lock for `longest_wait_s(lock_timeout_s)`.
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
    """Begin a transaction as `begin_locked` does, with a routine that takes the lock of a scene; return what it does.

    take : told how long to wait, seconds; None if the lock cannot be had
    scene_id : the number of the scene, asked for where it has to be waited for
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
    """Begin the transaction; return None, without a transaction, if another session keeps the lock for `wait_s`.

    longest_s : to wait for any other lock, from the first statement to the end of the transaction
    """
    while True:
        # First, and by itself: a limit that is changed holds from the next statement on.
        limits = f"SELECT conflictdb._lift_limits('{longest_s!r}')"
        try:
            with waiting_at_most(conn, longest_s):
                begin_snapshot(conn, limits, "_lift_limits")
            taken = take(wait_s)
        except StoreError as error:
            with suppress(psycopg.Error):  # a lost connection: the first reason is the one to report
                conn.rollback()
            if isinstance(error, LockTimeout) and _is_of_scene(error):
                return None
            if isinstance(error.__cause__, psycopg.errors.SerializationFailure):
                continue  # somebody had the lock, and gave it back, since the snapshot
            raise
        if taken is None:
            conn.rollback()
        return taken


def _is_of_scene(timeout: LockTimeout) -> bool:
    """Return whether the lock of a scene was waited for, and no other one: servers translate all but the routine."""
    cause = timeout.__cause__
    return isinstance(cause, psycopg.Error) and "_take_scene(" in (cause.diag.context or "")


def _holder(conn: psycopg.Connection[Any], scene_id: int) -> str:
    """Return who holds the lock of a scene, for people; empty if nobody does."""
    with transaction(conn):
        return " and ".join(str(Holder(*row)) for row in call_many(conn, "_scene_holders", scene_id))
