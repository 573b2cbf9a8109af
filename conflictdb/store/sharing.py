"""Own scenes, and share them with roles."""

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import psycopg

from conflictdb.store.connection import call, call_by_name, transaction


@dataclass(frozen=True, slots=True)
class Share:
    """The owner of a scene, or a role that it is shared with: a row of the view `shares`."""

    scene: str
    role: str
    access: str
    shared_by: str | None
    shared_at: datetime | None


def share_scene(conn: psycopg.Connection[Any], scene: str, role: str, access: str) -> None:
    """Let a role read or write a scene, or make it the owner."""
    with transaction(conn):
        if access == "own":
            call(conn, "give_scene", scene, role)
        else:
            call(conn, "share_scene", scene, role, access)


def unshare_scene(conn: psycopg.Connection[Any], scene: str, role: str) -> bool:
    """Stop sharing a scene with a role; return whether it was shared."""
    with transaction(conn):
        return bool(call(conn, "unshare_scene", scene, role)[0])


def shares(conn: psycopg.Connection[Any], scene: str) -> list[Share]:
    """Return the owner of a scene and the roles that it is shared with, as far as the connection's role sees them."""
    with transaction(conn):
        return [Share(**row) for row in call_by_name(conn, "_shares", scene)]


def protect_scenes(conn: psycopg.Connection[Any], *, on: bool) -> None:
    """Restrict scenes to their owners and the roles they are shared with, or show all scenes to all again."""
    with transaction(conn):
        call(conn, "protect_scenes", on)
