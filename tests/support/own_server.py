"""A server of a test's own, which may be killed: a backend that ends by force ends all sessions of its server."""

import fcntl
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import psycopg
from databases import server_directory, shared_directory
from patience import WAIT_S

from conflictdb import embedded as server
from conflictdb.embedded.account import account_for
from conflictdb.embedded.discovery import find_server
from conflictdb.jobs import schema

# A commit survives the end of any process, though not of the machine.
SETTINGS = {"full_page_writes": "on", "synchronous_commit": "on", "listen_addresses": ""}


class OwnServer:
    """A server that runs while it is started, with the schema in its database `conflictdb`.

    home : directory, open to the account that serves root; the data are made in it, or found there
    settings : of the server, from its next start on
    """

    def __init__(self, home: Path, **settings: str) -> None:
        self.data = home / "data"
        self.settings = {**SETTINGS, "unix_socket_directories": str(self.data), **settings}
        self.dsn = f"host={self.data} port={settings.get('port', '5432')} user=postgres dbname=conflictdb"
        if not self.data.exists():
            subprocess.run(["cp", "-a", _initialised(), home], check=True)  # with the owners of the files
        account = account_for(home)
        self.programs = find_server(server.Settings.from_environment(home=home), account, None, print)
        self._started: dict[str, Any] = {"env": {**self.programs.environ, "HOME": str(home)}, **account.switch}
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it and wait until it answers, after a crash when it has recovered."""
        options = [word for name, value in self.settings.items() for word in ("-c", f"{name}={value}")]
        with (self.data.parent / "own.log").open("ab") as log:
            self._process = subprocess.Popen(
                [self.programs.bin / "postgres", "-D", self.data, *options], stdout=log, stderr=log, **self._started
            )
        self.await_answer()

    def await_answer(self) -> None:
        """Wait until it takes connections."""
        _await(self.answers)

    def stop(self, number: signal.Signals = signal.SIGINT) -> None:
        """Shut it down: SIGINT fast, SIGQUIT immediately, as in a crash."""
        if self._process is not None:
            self._process.send_signal(number)
            self._process.wait(WAIT_S)
            self._process = None

    def is_running(self) -> bool:
        """Return whether it has not ended by itself."""
        return self._process is not None and self._process.poll() is None

    def answers(self) -> bool:
        """Return whether it takes connections."""
        with suppress(psycopg.OperationalError):
            psycopg.connect(self.dsn).close()
            return True
        assert self._process is None or self._process.poll() is None, (self.data.parent / "own.log").read_text()
        return False


def _await(condition: Any) -> None:
    end = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@cache
def _initialised() -> Path:
    """Return a home to copy, with the schema: to make one takes seconds. The first worker of a run makes it."""
    folder = shared_directory() / "own_server"
    folder.mkdir(parents=True, exist_ok=True)
    for path in (folder, folder.parent):
        path.chmod(0o755)
    home, making = folder / "initialised", folder / "making"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not home.exists():
            with server.embedded(making, durable=False) as embedded:
                schema.upgrade(embedded.admin_dsn)
            # The supervisor removes its files after the server has ended, this one last.
            _await(lambda: server.status(making).pid is None and not (making / "server.pid").exists())
            making.rename(home)
    return home


@contextmanager
def own_server(place: Path | None = None, **settings: str) -> Iterator[OwnServer]:
    """Run a server of the test's own, in a place of its own or within a directory; it is removed afterwards."""
    home = Path(tempfile.mkdtemp(prefix="conflictdb-own-", dir=place or server_directory()))
    home.chmod(0o755)
    try:
        own = OwnServer(home / "db", **settings)
        own.start()
        try:
            yield own
        finally:
            own.stop()
    finally:
        shutil.rmtree(home, ignore_errors=True)
