"""Whose scenes are, and with whom they are shared."""

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import psycopg

from conflictdb.db.store.connection import call, call_by_name, transaction


@dataclass(frozen=True, slots=True)
class Share:
    """Whose a scene is, or a role that it is shared with: a row of the view `shares`."""

    scene: str
    role: str
    access: str
    shared_by: str | None
    shared_at: datetime | None


def share_scene(conn: psycopg.Connection[Any], scene: str, role: str, access: str) -> None:
    """Let a role read or write a scene, or own it in place of who does."""
    with transaction(conn):
        if access == "own":
            call(conn, "give_scene", scene, role)
        else:
            call(conn, "share_scene", scene, role, access)


def unshare_scene(conn: psycopg.Connection[Any], scene: str, role: str) -> bool:
    """Take back that a scene is shared with a role, and return whether it was."""
    with transaction(conn):
        return bool(call(conn, "unshare_scene", scene, role)[0])


def shares(conn: psycopg.Connection[Any], scene: str) -> list[Share]:
    """Return whose a scene is, and with whom it is shared, as far as the connection's role sees it."""
    with transaction(conn):
        return [Share(**row) for row in call_by_name(conn, "_shares", scene)]


def protect_scenes(conn: psycopg.Connection[Any], *, on: bool) -> None:
    """Have scenes seen by those alone whose they are and who they are shared with, or by all again."""
    with transaction(conn):
        call(conn, "protect_scenes", on)
