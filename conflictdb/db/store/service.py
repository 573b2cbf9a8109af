"""What a worker and `status` need of the server: its versions, its workers, and word of changes."""

import uuid
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import psycopg
from psycopg.conninfo import conninfo_to_dict, make_conninfo

from conflictdb.db.store.connection import call, translated

# By this name workers are counted; routine _service knows it too.
WORKER_NAME: Final = "conflictdb worker"

# A network that is gone without a word is noticed within about a minute, and not after hours, as systems are set up.
_LIVELY: Final = {
    "connect_timeout": 10,
    "keepalives_idle": 30,
    "keepalives_interval": 10,
    "keepalives_count": 3,
    "tcp_user_timeout": 60_000,
}

# Notifications arrive in milliseconds; where none does, a worker begins this much later.
_HEARD_WITHIN_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class Service:
    """State of a server.

    server_version, postgis_version : as they call themselves
    worker_count : workers connected to this database
    """

    server_version: str
    postgis_version: str
    worker_count: int


def service(conn: psycopg.Connection[Any]) -> Service:
    """Return the state of the server."""
    postgis_version, worker_count = call(conn, "_service")
    server_version = conn.info.parameter_status("server_version") or "?"
    return Service(server_version.partition(" ")[0], str(postgis_version), int(worker_count))


def worker_dsn(dsn: str) -> str:
    """Return a connection string by whose connections a worker is known, and notices soon that a network is gone.

    What the string itself says of that stays.
    """
    return _named_dsn(dsn, WORKER_NAME)


def map_dsn(dsn: str) -> str:
    """Return a connection string by whose connections the page of `conflictdb map` is known; else as `worker_dsn`."""
    return _named_dsn(dsn, "conflictdb map")


def _named_dsn(dsn: str, name: str) -> str:
    with translated():
        return make_conninfo("", **{**_LIVELY, **conninfo_to_dict(dsn), "application_name": name})


def listen(conn: psycopg.Connection[Any], connect: Callable[[], psycopg.Connection[Any]]) -> bool:
    """Let this session be told of changes and requests; returns whether it will be. Commits.

    A pooler that gives every transaction another session hands on no notifications. So where the session is not the
    connection's own, one is sent on another connection, which `connect` opens, and must arrive.
    """
    with translated():
        conn.execute("LISTEN conflictdb_request", prepare=False)
        row = conn.execute("SELECT pg_backend_pid()", prepare=False).fetchone()
        conn.commit()
        if row != (conn.info.backend_pid,) and not _is_heard(conn, connect):
            # Maybe it is still the same session: it should not tell whoever has it next.
            conn.execute("UNLISTEN conflictdb_request", prepare=False)
            conn.commit()
            return False
        # It waits between changes, for as long as there are none.
        conn.execute("SELECT set_config('idle_session_timeout', '0', false)", prepare=False)
        conn.commit()
        return True


def writers_notify(conn: psycopg.Connection[Any]) -> bool:
    """Return whether who changes something notifies the workers: not where transactions can be prepared. Commits."""
    with translated():
        row = conn.execute("SELECT current_setting('max_prepared_transactions') = '0'", prepare=False).fetchone()
        conn.commit()
    return row == (True,)


def _is_heard(conn: psycopg.Connection[Any], connect: Callable[[], psycopg.Connection[Any]]) -> bool:
    """Return whether a notification that another connection sends arrives at an idle connection."""
    token = f"heard {uuid.uuid4()}"
    with connect() as other:
        other.execute("SELECT pg_notify('conflictdb_request', %s)", [token], prepare=False)
        other.commit()
        return any(notify.payload == token for notify in conn.notifies(timeout=_HEARD_WITHIN_S))


def wait_for_change(conn: psycopg.Connection[Any], timeout_s: float) -> bool:
    """Wait until something changed, or a detection was requested; return whether it did before the time was over.

    Whatever came while nobody waited counts too, all of it at once. Raises StoreError if the connection is lost.
    """
    with translated():
        # To the end: what is left of it would be answered one by one, each by a look at what waits.
        return bool(list(conn.notifies(timeout=timeout_s, stop_after=1)))
