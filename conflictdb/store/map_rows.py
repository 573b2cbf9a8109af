"""Read the data of `conflictdb map`: lists of a scene, tiles, and notifications of changes."""

from collections.abc import Iterator
from typing import Any, Final

import psycopg
from psycopg.rows import tuple_row
from psycopg.types.json import Json

from conflictdb.errors import NotPermitted
from conflictdb.store.connection import call, call_many, transaction, translated

# Every change of the data that a page shows notifies one of these channels (sql/14_marks.sql, 60_write_back.sql,
# 69_acknowledge.sql, 74_live_conflicts.sql).
_CHANNELS: Final = (
    "conflictdb", "conflictdb_event", "conflictdb_acknowledgement", "conflictdb_request", "conflictdb_alarm"
)  # fmt: skip

TILES: Final = ("areas", "tracks", "conflicts")


def map_conflicts(conn: psycopg.Connection[Any], scene: str) -> tuple[bytes, bytes]:
    """Return the conflicts of a scene as routine _map_conflicts packs them, head and numbers; errors as `map_areas`."""
    with transaction(conn):
        head, numbers = call(conn, "_map_conflicts", scene)
    return head.encode(), bytes(numbers)


def map_areas(conn: psycopg.Connection[Any], scene: str) -> list[tuple[Any, ...]]:
    """Return the areas of a scene as routine _map_areas returns them; InvalidInput if the scene does not exist."""
    with transaction(conn):
        return call_many(conn, "_map_areas", scene)


def map_live(conn: psycopg.Connection[Any], scene: str) -> str:
    """Return states and alarms of tracks with positions as routine _map_live writes them; errors as `map_areas`."""
    with transaction(conn):
        return str(call(conn, "_map_live", scene)[0])


def map_overview(conn: psycopg.Connection[Any], scene: str) -> bytes:
    """Return the outlines of the areas of a scene as routine _map_overview packs them; errors as `map_areas`."""
    with transaction(conn):
        return bytes(call(conn, "_map_overview", scene)[0] or b"")


def map_tracks(conn: psycopg.Connection[Any], scene: str) -> list[tuple[Any, ...]]:
    """Return the tracks of a scene as routine _map_tracks returns them; InvalidInput if the scene does not exist."""
    with transaction(conn):
        return call_many(conn, "_map_tracks", scene)


def map_shapes(
    conn: psycopg.Connection[Any], scene: str, keys: list[str] | None = None
) -> list[tuple[str, int, str | None, str]]:
    """Return layer, number, key and GeoJSON of the shapes of a scene, or of its objects with the given keys."""
    with transaction(conn):
        return [(row[0], row[1], row[2], row[3]) for row in call_many(conn, "_map_shapes", scene, keys)]


def may_acknowledge(conn: psycopg.Connection[Any]) -> bool:
    """Return whether the user of a connection may acknowledge conflicts."""
    with transaction(conn):
        return bool(call(conn, "_map_may_acknowledge")[0])


def may_edit(conn: psycopg.Connection[Any], scene: str) -> bool:
    """Return whether the user of a connection may change the objects of a scene; InvalidInput if it does not exist."""
    statement = b"SELECT has_any_column_privilege('conflictdb.track', 'UPDATE') AND NOT pg_is_in_recovery()"
    try:
        with translated(), conn.transaction(), psycopg.Cursor(conn, row_factory=tuple_row) as cursor:
            row = cursor.execute(statement, prepare=False).fetchone()
        if row is None or not row[0]:
            return False
        with transaction(conn):
            call(conn, "_scene_or_branch_to_change", scene)
    except NotPermitted:
        return False
    return True


def tile(conn: psycopg.Connection[Any], kind: str, z: int, x: int, y: int, scene: str) -> bytes:
    """Return a vector tile of one of TILES, possibly empty; InvalidInput if there is no such tile or scene."""
    if kind not in TILES:
        raise ValueError(kind)
    with transaction(conn):
        return bytes(call(conn, f"tile_{kind}", z, x, y, Json({"scene": scene}))[0] or b"")


def never_write(conn: psycopg.Connection[Any]) -> None:
    """Make the connection read-only."""
    with translated():
        conn.execute("SELECT set_config('default_transaction_read_only', 'on', false)", prepare=False)
        conn.commit()


def hear_changes(conn: psycopg.Connection[Any]) -> None:
    """Listen for changes on this connection; commits."""
    with translated():
        for channel in _CHANNELS:
            conn.execute(f"LISTEN {channel}".encode(), prepare=False)
        conn.execute("SELECT set_config('idle_session_timeout', '0', false)", prepare=False)
        conn.commit()


def changes(conn: psycopg.Connection[Any], timeout_s: float) -> Iterator[str]:
    """Yield the payloads of notifications as they arrive, until none came for `timeout_s`."""
    with translated():
        for notify in conn.notifies(timeout=timeout_s, stop_after=1):
            yield notify.payload
