"""Read the state of the server, its versions and workers, and listen for changes."""

import math
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

import psycopg
from psycopg.conninfo import conninfo_to_dict, make_conninfo

from conflictdb.errors import ConflictDBError
from conflictdb.store.connection import call, call_by_name, transaction, translated

# Sessions of workers have this name; routine _worker_count uses it too.
WORKER_NAME: Final = "conflictdb worker"

# Detect a dead network within about a minute; system defaults take hours.
_LIVELY: Final = {
    "connect_timeout": 10,
    "keepalives_idle": 30,
    "keepalives_interval": 10,
    "keepalives_count": 3,
    "tcp_user_timeout": 60_000,
}

# Notifications arrive in milliseconds. Where none can, a worker starts this much later.
HEARD_WITHIN_S: Final = 2.0


# How often a worker behind a pooler stamps: six times within the 30 s that a stamp lasts (_worker_count).
_STAMP_S: Final = 5.0


class WorkerStamp:
    """The row by which a worker is counted. A pooler keeps sessions of workers that are gone, and lends them out."""

    def __init__(self) -> None:
        self._worker_id = uuid.uuid4()
        self._due_s = -math.inf

    def begin(self, conn: psycopg.Connection[Any]) -> None:
        """Stamp a new connection."""
        self._due_s = -math.inf
        self.renew(conn)

    def renew(self, conn: psycopg.Connection[Any]) -> None:
        """Stamp the connection again if that is due."""
        if time.monotonic() < self._due_s:
            return
        with transaction(conn):
            pid = conn.info.backend_pid if has_own_session(conn) else None
            call(conn, "_stamp_worker", self._worker_id, pid)
        self._due_s = math.inf if pid is not None else time.monotonic() + _STAMP_S

    def end(self, conn: psycopg.Connection[Any]) -> None:
        """Remove the stamp, if the connection still works."""
        with suppress(psycopg.Error, ConflictDBError):
            conn.rollback()
            with transaction(conn):
                call(conn, "_remove_stamp", self._worker_id)


@dataclass(frozen=True, slots=True)
class Service:
    """State of a server.

    server_version, postgis_version : as the server reports them
    worker_count : workers connected to this database
    """

    server_version: str
    postgis_version: str
    worker_count: int

    def __str__(self) -> str:
        return f"PostgreSQL {self.server_version}, PostGIS {self.postgis_version}"


def service(conn: psycopg.Connection[Any]) -> Service:
    """Return the state of the server."""
    postgis_version, worker_count = call(conn, "_service")
    server_version = conn.info.parameter_status("server_version") or "?"
    return Service(server_version.partition(" ")[0], str(postgis_version), int(worker_count))


@dataclass(frozen=True, slots=True)
class SceneAlarm:
    """Alarms of a scene: its state, as metrics show it.

    waiting_since : when the first change was made that waits, also one of an attached table of another role; None: none
    unmapped : rows of attached tables that are no objects
    last_error : why the last detection failed; None: it did not
    tables : attached tables, and why they cannot be read or followed; None: they can
    """

    scene: str
    is_current: bool
    waiting_since: datetime | None
    unmapped: int
    last_error: str | None
    tables: dict[str, str | None]


def scene_alarms(conn: psycopg.Connection[Any]) -> list[SceneAlarm]:
    """Return the alarms of all scenes."""
    with transaction(conn):
        rows = call_by_name(conn, "_scene_alarms")
    return [SceneAlarm(**{**row, "tables": row["tables"] or {}}) for row in rows]


def worker_dsn(dsn: str) -> str:
    """Return the connection string for workers: named so that they can be counted, and quick to notice a dead network.

    Keywords that the string sets itself are kept.
    """
    return _named_dsn(dsn, WORKER_NAME)


def map_dsn(dsn: str) -> str:
    """Return the connection string for `conflictdb map`, named for it; otherwise as `worker_dsn`."""
    return _named_dsn(dsn, "conflictdb map")


def _named_dsn(dsn: str, name: str) -> str:
    with translated():
        return make_conninfo("", **{**_LIVELY, **conninfo_to_dict(dsn), "application_name": name})


def listen(
    conn: psycopg.Connection[Any],
    connect: Callable[[], psycopg.Connection[Any]],
    heard_within_s: float = HEARD_WITHIN_S,
) -> bool:
    """Listen for changes and requests on this session; return whether notifications arrive. Commits.

    A pooler that changes sessions between transactions forwards no notifications. If the session is not the
    connection's own, a test notification from another connection, opened by `connect`, must arrive in `heard_within_s`.
    """
    with translated():
        conn.execute("LISTEN conflictdb_request", prepare=False)
        is_own = has_own_session(conn)
        conn.commit()
        if not is_own and not _is_heard(conn, connect, heard_within_s):
            # It may still be the same session: do not notify its next user.
            conn.execute("UNLISTEN conflictdb_request", prepare=False)
            conn.commit()
            return False
        # The session idles until something changes.
        conn.execute("SELECT set_config('idle_session_timeout', '0', false)", prepare=False)
        conn.commit()
        return True


def has_own_session(conn: psycopg.Connection[Any]) -> bool:
    """Return whether the server sees the session that the connection began: poolers show another one."""
    with translated():
        row = conn.execute("SELECT pg_backend_pid()", prepare=False).fetchone()
    return row == (conn.info.backend_pid,)


def writers_notify(conn: psycopg.Connection[Any]) -> bool:
    """Return whether writers notify the workers: they do not where transactions can be prepared. Commits."""
    with translated():
        row = conn.execute("SELECT current_setting('max_prepared_transactions') = '0'", prepare=False).fetchone()
        conn.commit()
    return row == (True,)


def _is_heard(
    conn: psycopg.Connection[Any], connect: Callable[[], psycopg.Connection[Any]], heard_within_s: float
) -> bool:
    """Return whether a notification sent by another connection arrives at an idle connection."""
    token = f"heard {uuid.uuid4()}"
    with connect() as other:
        other.execute("SELECT pg_notify('conflictdb_request', %s)", [token], prepare=False)
        other.commit()
        return any(notify.payload == token for notify in conn.notifies(timeout=heard_within_s))


def wait_for_change(conn: psycopg.Connection[Any], timeout_s: float) -> bool:
    """Wait for a change or a request; return whether one came in time.

    Earlier notifications count too, all of them as one. Raises StoreError if the connection is lost.
    """
    with translated():
        # Consume all: each one left over would cause another look for waiting scenes.
        return bool(list(conn.notifies(timeout=timeout_s, stop_after=1)))
