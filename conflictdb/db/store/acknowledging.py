"""Acknowledge conflicts, and withdraw acknowledgements."""

from datetime import datetime
from typing import Any

import psycopg

from conflictdb.db.store.connection import call, transaction


def acknowledge(
    conn: psycopg.Connection[Any], scene: str, a_key: str, b_key: str, reason: str, until: datetime | None
) -> int:
    """Acknowledge the conflict of two objects and return its number; InvalidInput if they have no conflict."""
    with transaction(conn):
        return int(call(conn, "acknowledge", scene, a_key, b_key, reason, until)[0])


def unacknowledge(conn: psycopg.Connection[Any], scene: str, a_key: str, b_key: str) -> bool:
    """Withdraw the acknowledgement of the conflict of two objects; return whether it was acknowledged."""
    with transaction(conn):
        return bool(call(conn, "unacknowledge", scene, a_key, b_key)[0])
