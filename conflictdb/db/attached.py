"""Follows attached tables: rows that changed become objects of their scene.

Only tables that the connected role attached: their maps are code of that role, which no other role runs.
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
    """Bring the objects of a scene in step with the tables that the connected role attached to it.

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
                error = store.follow_attachment(conn, attachment_id)
            except ConflictDBError as failure:  # a limit of time ends the transaction
                if conn.closed:
                    raise
                error = str(failure).partition("\n")[0]
                store.attachment_failed(conn, attachment_id, error)
            if error is not None:
                _log.warning("scene %r: attachment %d cannot be followed: %s", scene, attachment_id, error)
