"""Acknowledge conflicts, and withdraw acknowledgements."""

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import psycopg

from conflictdb.store.connection import call, call_many, transaction


@dataclass(frozen=True, slots=True)
class EndedAcknowledgement:
    """An acknowledgement whose conflict has closed."""

    a_key: str
    b_key: str
    acknowledged_by: str
    reason: str


def acknowledge(
    conn: psycopg.Connection[Any],
    scene: str,
    a_key: str,
    b_key: str,
    reason: str,
    until: datetime | None,
    by: str | None = None,
) -> int:
    """Acknowledge the conflict of two objects and return its number; InvalidInput if they have no conflict."""
    with transaction(conn):
        return int(call(conn, "acknowledge", scene, a_key, b_key, reason, until, by)[0])


def unacknowledge(conn: psycopg.Connection[Any], scene: str, a_key: str, b_key: str) -> bool:
    """Withdraw the acknowledgement of the conflict of two objects; return whether it was acknowledged."""
    with transaction(conn):
        return bool(call(conn, "unacknowledge", scene, a_key, b_key)[0])


def acknowledgements_ended(conn: psycopg.Connection[Any], scene: str, run_id: int) -> list[EndedAcknowledgement]:
    """Return the acknowledgements that ended with the conflicts that a run closed, by key."""
    with transaction(conn):
        return [EndedAcknowledgement(*row) for row in call_many(conn, "_acknowledgements_ended", scene, run_id)]


def counted_conflicts(conn: psycopg.Connection[Any]) -> dict[tuple[str, str, bool], int]:
    """Return the numbers of conflicts by scene, verdict, and whether they are acknowledged."""
    with transaction(conn):
        return {(scene, verdict, is_known): n for scene, verdict, is_known, n in call_many(conn, "_counted_conflicts")}
