"""The embedded database: a private PostgreSQL with PostGIS, found, started and stopped automatically.

>>> with embedded() as server:
...     psycopg.connect(server.dsn)

All processes of a user share the server. It stops when the last of them has ended, kill -9 included; `start_holder`
keeps it running without any, until `stop_holder`. It listens on a Unix socket in a directory that only its user (and
root) can enter. Its database `conflictdb` is empty at first; `conflictdb.jobs.schema` fills it.

Only `Settings.from_environment` reads the environment: docs/reference/database.md lists the variables.
"""

import logging
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from conflictdb.embedded.cluster import Cluster, ServerStatus
from conflictdb.embedded.configuration import ADMINISTRATOR
from conflictdb.embedded.discovery import Psql, psql_of
from conflictdb.embedded.options import Settings
from conflictdb.errors import ServerError

__all__ = [
    "EmbeddedServer",
    "Psql",
    "ServerStatus",
    "Settings",
    "embedded",
    "find_psql",
    "start_holder",
    "status",
    "stop_holder",
]

_log = logging.getLogger(__name__)

# Seconds until an unused server begins to stop, and for its last checkpoint.
_BEGIN_TO_STOP_S: Final = 1.0
_STOP_S: Final = 60.0


class EmbeddedServer:
    """Use of the embedded database by one process; the server runs at least until `stop`.

    dsn : libpq connection string of its database `conflictdb`, for its everyday user, who is no superuser
    admin_dsn : the same for the superuser who owns the cluster
    """

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._alive: int | None = cluster.join()
        self.dsn: str = cluster.dsn()
        self.admin_dsn: str = cluster.dsn(ADMINISTRATOR)

    @property
    def home(self) -> Path:
        """Return the directory of the database."""
        return self._cluster.home

    def status(self) -> ServerStatus:
        """Return the state of the server."""
        return self._cluster.status()

    def programs(self) -> Path:
        """Return the directory of the server's programs."""
        return self._cluster.programs()

    def stay_through_exec(self) -> None:
        """Keep this use across exec; it ends with the new program."""
        if self._alive is not None:
            os.set_inheritable(self._alive, True)

    def stop(self) -> None:
        """End this use; the server stops if it was the last. May be called again."""
        if self._alive is not None:
            os.close(self._alive)
            self._alive = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()


def embedded(
    home: Path | None = None,
    *,
    durable: bool = True,
    say: Callable[[str], None] = _log.info,
    settings: Settings | None = None,
) -> EmbeddedServer:
    """Start the embedded database if needed, and return this process's use of it.

    Parameters
    ----------
    home : Path, optional
        Directory of the cluster; default CONFLICTDB_HOME, else the user's own.
    durable : bool
        False creates a data directory that a crash of the machine may corrupt, but that is faster: for tests.
    say : callable
        Called with a line that names server and versions, and with a line before a download.
    settings : Settings, optional
        Instead of the environment (and `home`).

    Raises
    ------
    ServerError
        No PostgreSQL with PostGIS was found (the text lists the places searched and remedies), or it does not start.
    """
    return EmbeddedServer(Cluster(_settings(home, settings), durable=durable, say=say))


def start_holder(
    home: Path | None = None, *, say: Callable[[str], None] = _log.info, settings: Settings | None = None
) -> ServerStatus:
    """Start the server and keep it running, also without users, until `stop_holder`; return its state.

    Raises
    ------
    ServerError
        As for `embedded`.
    """
    cluster = Cluster(_settings(home, settings), durable=True, say=say)
    os.close(cluster.join("hold"))
    return cluster.status()


def stop_holder(
    home: Path | None = None, *, say: Callable[[str], None] = _log.info, settings: Settings | None = None
) -> ServerStatus:
    """Undo `start_holder` and wait until the server is down; return its state.

    If others use the server it keeps running, and stops when the last of them has ended.
    """
    cluster = Cluster(_settings(home, settings), durable=True, say=say)
    if cluster.leave_held():
        began = time.monotonic()
        while (state := cluster.status()).pid is not None:
            if time.monotonic() - began > (_BEGIN_TO_STOP_S if state.running else _STOP_S):
                break
            time.sleep(0.01)
    return cluster.status()


def find_psql(server: EmbeddedServer | None = None, *, settings: Settings | None = None) -> Psql | None:
    """Return the psql beside a server's programs, else any on this machine; None without one."""
    programs = None
    if server is not None:
        with suppress(ServerError):  # started by settings that this process lacks
            programs = server.programs()
    return psql_of(_settings(None, settings), programs)


def status(home: Path | None = None, *, settings: Settings | None = None) -> ServerStatus:
    """Return the state of the server, without starting it."""
    return Cluster(_settings(home, settings), durable=True, say=_log.info).status()


def _settings(home: Path | None, settings: Settings | None) -> Settings:
    return settings or Settings.from_environment(home=home)
