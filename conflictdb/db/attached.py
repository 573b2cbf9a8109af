"""Follows attached tables: rows of them that changed become objects of their scene.

Two transactions for each table. In the first, which is rolled back, the rows are read by the function that the table's
map became: it is code of whoever attached the table and runs with the rights of that role. In the second they become
objects. Who reads at the same time finds in its second transaction that it came too late, and leaves it at that.
"""

import logging
from typing import Any, Final

import psycopg

from conflictdb.db import store
from conflictdb.errors import ConflictDBError

_log = logging.getLogger(__name__)

# Keys that the first round frees, the second gives to rows that waited for them.
_ROUNDS: Final = 2


def follow(conn: psycopg.Connection[Any], scene: str, *, again: bool) -> None:
    """Bring the objects of a scene in step with the tables that are attached to it.

    A table that cannot be read keeps its objects as they are; the view `attachments` says why. It does not stop others.

    Parameters
    ----------
    conn : psycopg connection without an open transaction
    again : try also tables that could not be read within the last minute

    Raises
    ------
    InvalidInput
        There is no such scene.
    StoreError
        The connection is lost.
    """
    for k in range(_ROUNDS):
        attachment_ids = store.attachments_to_follow(conn, scene, again=again and k == 0)
        if not attachment_ids:
            return
        for attachment_id in attachment_ids:
            try:
                taken_over = _follow(conn, attachment_id)
            except ConflictDBError as error:
                if conn.closed:
                    raise
                conn.rollback()
                reason = str(error).partition("\n")[0]
                _log.warning("scene %r: attachment %d cannot be followed: %s", scene, attachment_id, reason)
                store.attachment_failed(conn, attachment_id, reason)
            else:
                _log.debug("scene %r: attachment %d: %s", scene, attachment_id, taken_over)


def _follow(conn: psycopg.Connection[Any], attachment_id: int) -> store.TakenOver | None:
    with store.kept_rows() as rows:
        try:
            work = store.read_attached(conn, attachment_id, rows, carefully=False)
        except ConflictDBError:
            if conn.closed:
                raise
            rows.seek(0)
            rows.truncate()
            work = store.read_attached(conn, attachment_id, rows, carefully=True)
        rows.seek(0)
        return store.take_over_attached(conn, attachment_id, work, rows)
