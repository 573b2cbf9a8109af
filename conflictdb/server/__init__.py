"""The embedded database: a private PostgreSQL with PostGIS that is found, started and stopped by itself.

>>> with embedded() as server:
...     psycopg.connect(server.dsn)

The server is shared by all processes of a user and stops when the last of them has gone, kill -9 included;
`start_holder` keeps it running without any, until `stop_holder`. It listens on a Unix socket in a directory that only
its user (and root) can enter. Its database `conflictdb` is empty at first; `conflictdb.db.schema` fills it.

Environment, read by `Settings.from_environment` and nowhere else:

CONFLICTDB_HOME          directory of the cluster; default ~/.local/share/conflictdb/default, of root
                         /var/lib/conflictdb/default
CONFLICTDB_PG_BIN        the only directory to take PostgreSQL from
CONFLICTDB_NO_DOWNLOAD   1: never fetch packages
"""

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from conflictdb.server.cluster import Cluster, ServerStatus
from conflictdb.server.configuration import ADMINISTRATOR
from conflictdb.server.discovery import Psql, psql_of
from conflictdb.server.settings import Settings

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

#: Seconds in which a server that nobody uses any more begins to stop, and in which it writes its last checkpoint.
_BEGIN_TO_STOP_S: Final = 1.0
_STOP_S: Final = 60.0


class EmbeddedServer:
    """The use of the embedded database by this process; the server runs at least until `stop`.

    dsn : libpq connection string of the database `conflictdb` in it, for its everyday user, who is no superuser
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
        """Let the program that this process becomes go on with this use; it ends with that."""
        if self._alive is not None:
            os.set_inheritable(self._alive, True)

    def stop(self) -> None:
        """End this use; the server stops if it was the last one. May be called again."""
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
    """Return the use of the embedded database, its server started if need be.

    Parameters
    ----------
    home : Path, optional
        Directory of the cluster; default CONFLICTDB_HOME, else the user's own.
    durable : bool
        False makes a new data directory that a crash of the machine may ruin, but that is faster: for tests.
    say : callable
        Told in one line which server with which versions runs, and before anything is fetched.
    settings : Settings, optional
        Instead of the environment (and `home`).

    Raises
    ------
    ServerError
        No PostgreSQL with PostGIS was found (the text says where it looked and what helps), or it does not start.
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
    """End what `start_holder` began and wait until the server is down; return its state.

    It is still running if others use it; then it stops when the last of them has gone.
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
    """Return psql: the one that is beside a server's programs, else whatever is on this machine; None without any."""
    return psql_of(_settings(None, settings), server.programs() if server else None)


def status(home: Path | None = None, *, settings: Settings | None = None) -> ServerStatus:
    """Return the state of the server, without starting it."""
    return Cluster(_settings(home, settings), durable=True, say=_log.info).status()


def _settings(home: Path | None, settings: Settings | None) -> Settings:
    return settings or Settings.from_environment(home=home)
