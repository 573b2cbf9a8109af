"""What a worker and `status` need of the server: its versions, its workers, and word of changes."""

from dataclasses import dataclass
from typing import Any, Final

import psycopg
from psycopg.conninfo import make_conninfo

from conflictdb.store.connection import call, translated

# By this name workers are counted; routine _service knows it too.
WORKER_NAME: Final = "conflictdb worker"


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
    """Return a connection string by whose connections a worker is known."""
    with translated():
        return make_conninfo(dsn, application_name=WORKER_NAME)


def listen(conn: psycopg.Connection[Any]) -> None:
    """Let this session be told of changes and requests; commits."""
    with translated():
        conn.execute("LISTEN conflictdb_request")
        conn.commit()


def wait_for_change(conn: psycopg.Connection[Any], timeout_s: float) -> bool:
    """Wait until something changed, or a detection was requested; return whether it did before the time was over.

    Whatever came while nobody waited counts too. Raises StoreError if the connection is lost.
    """
    with translated():
        return any(True for _ in conn.notifies(timeout=timeout_s, stop_after=1))
