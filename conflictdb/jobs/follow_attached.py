"""Follow attached tables: their changed rows become objects of the scene.

It follows only tables that the connected role attached: the map is that role's code, and no other role runs it.
"""

import logging
from typing import Any, Final

import psycopg

from conflictdb import store
from conflictdb.errors import ConflictDBError, LockTimeout

_log = logging.getLogger(__name__)

# Keys that the first round frees go to the rows that waited for them in the second.
_ROUNDS: Final = 2


def follow(
    conn: psycopg.Connection[Any], scene: str, *, again: bool, read_within_s: float = store.READ_WITHIN_S
) -> None:
    """Update the objects of a scene from the tables that the connected role attached to it.

    A table that cannot be read keeps its objects; the view `attachments` gives the reason. It does not stop the others.

    Parameters
    ----------
    conn : psycopg connection without an open transaction
    again : try also tables that could not be read within the last minute, and wait for other sessions that follow one
    read_within_s : longest time to read a table, seconds

    Raises
    ------
    InvalidInput
        The scene does not exist.
    LockTimeout
        Another session has an attachment, or the scene.
    StoreError
        The connection is lost.
    """
    for k in range(_ROUNDS):
        found = store.attachments_to_follow(conn, scene, again=again and k == 0)
        if not found:
            return
        for attachment_id, is_moved in found:
            try:
                error = store.rewatch_attachment(conn, attachment_id) if is_moved else None
                if error is None:
                    error = store.follow_attachment(conn, attachment_id, read_within_s, waits=again)
            except LockTimeout:  # no fault of the table, which waits for the next time
                raise
            except ConflictDBError as failure:  # a time limit ends the transaction
                if conn.closed:
                    raise
                error = str(failure).partition("\n")[0]
                store.attachment_failed(conn, attachment_id, error)
            if error is not None:
                _log.warning("scene %r: attachment %d cannot be followed: %s", scene, attachment_id, error)
