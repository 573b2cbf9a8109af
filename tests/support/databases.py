"""Databases for tests: a server from somewhere, one template on it per run, a clone of that per test.

The server comes from the first of these that there is; without any the run fails, it never skips:

1. CONFLICTDB_TEST_DSN: a server whose user is a superuser, with PostGIS (nothing else is tried then)
2. Docker, if CONFLICTDB_TEST_DB=docker asks for it
3. PostgreSQL with PostGIS on this machine, or unpacked into the cache earlier: a server of this run's own
4. Docker, if an engine answers within 3 s
5. the packages of Debian or Ubuntu, fetched into the cache (unless CONFLICTDB_NO_DOWNLOAD=1)
"""

import fcntl
import gc
import os
import shutil
import signal
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, LiteralString

import psycopg
import pytest
from patience import WAIT_S
from psycopg import conninfo, sql

from conflictdb import embedded as server
from conflictdb.embedded.account import account_for
from conflictdb.embedded.discovery import find_server
from conflictdb.embedded.options import Settings
from conflictdb.errors import ServerError

DOCKER_TIMEOUT_S = 3
DOCKER_IMAGE = "postgis/postgis:16-3.4"
_IN_MEMORY = Path("/dev/shm")  # noqa: S108 (for names of a run)
# Bytes that must be free there. The server of a whole run takes 1.4 GB; Spark and the browser need memory, too.
_LEAST_ROOM = 8 << 30
# The server of a run that was killed ends in less.
_MOST_S = 10.0
# Of runs of this process. A lock ends when any descriptor of its file is closed: it is opened once.
_LOCKS: dict[Path, int] = {}


@dataclass(frozen=True)
class TestServer:
    """A server for tests.

    dsn : connects as a user who may create databases
    prefix : first part of the names of databases on it
    description : its kind, for the run's summary
    """

    __test__ = False

    dsn: str
    prefix: str
    description: str

    def database(self, name: str) -> str:
        """Return the connection string of a database on it."""
        return conninfo.make_conninfo(self.dsn, dbname=name)

    def execute(self, statement: LiteralString, *names: str) -> None:
        """Run a statement that cannot run in a transaction, with names in place of its braces.

        The server waits five seconds until sessions of a database have ended, which may be too short on a busy machine.
        """
        end = time.monotonic() + WAIT_S
        with psycopg.connect(self.dsn, autocommit=True) as conn:
            while True:
                try:
                    conn.execute(sql.SQL(statement).format(*map(sql.Identifier, names)))
                except psycopg.errors.ObjectInUse:
                    if time.monotonic() > end:
                        raise
                else:
                    return

    def template(self, fill: Callable[[str], object]) -> str:
        """Return the name of the run's template database; the first worker that asks makes and fills it."""
        name, making = f"{self.prefix}_template", f"{self.prefix}_making"
        with psycopg.connect(self.dsn, autocommit=True) as conn:
            conn.execute("SELECT pg_advisory_lock(hashtext(%s))", [name])
            if conn.execute("SELECT FROM pg_database WHERE datname = %s", [name]).rowcount == 0:
                self.drop(making)
                self.execute("CREATE DATABASE {}", making)
                fill(self.database(making))
                self.execute("ALTER DATABASE {} RENAME TO {}", making, name)
        return name

    def clone(self, template: str, name: str) -> str:
        """Make a database from a template and return its connection string."""
        with psycopg.connect(self.dsn) as conn:
            # Copying files needs no write-ahead log of every page; before version 15 there was no other way.
            newer = conn.info.server_version >= 150000
        if newer:
            self.execute("CREATE DATABASE {} TEMPLATE {} STRATEGY file_copy", name, template)
        else:
            self.execute("CREATE DATABASE {} TEMPLATE {}", name, template)
        return self.database(name)

    def drop(self, name: str) -> None:
        """Drop a database, whoever is still connected to it."""
        self.execute("DROP DATABASE IF EXISTS {} WITH (FORCE)", name)


@contextmanager
def test_server(run: str, worker: str) -> Iterator[TestServer]:
    """Keep a server for one worker of a test run; workers of a run share it if they can."""
    given = os.environ.get("CONFLICTDB_TEST_DSN")
    if given:
        _require_postgis(given)
        yield TestServer(given, f"conflictdb_test_{run}", "that of CONFLICTDB_TEST_DSN")
        return
    if os.environ.get("CONFLICTDB_TEST_DB") == "docker":
        if not _docker_answers():
            pytest.fail(f"CONFLICTDB_TEST_DB=docker, but no Docker engine answers within {DOCKER_TIMEOUT_S} s")
        with _in_docker(worker) as container:
            yield container
        return
    try:
        embedded = _embedded(run, download=False)
    except ServerError:
        if _docker_answers():
            with _in_docker(worker) as container:
                yield container
            return
        try:
            embedded = _embedded(run, download=True)
        except ServerError as error:
            pytest.fail(f"{error}\n  tests            export CONFLICTDB_TEST_DSN=... (a server to create databases on)")
    with embedded:
        dsn = conninfo.make_conninfo(embedded.admin_dsn, dbname="postgres")
        own = TestServer(dsn, "conflictdb_test", embedded.status().description)
        # ANALYZE in the middle of a test would change its plans.
        own.execute("ALTER SYSTEM SET autovacuum = off")
        own.execute("ALTER SYSTEM SET max_wal_size = '1GB'")  # it may be in memory
        own.execute("SELECT pg_reload_conf()")
        yield own


test_server.__test__ = False  # type: ignore[attr-defined]


def run_home(run: str) -> Path:
    """Return the home of the embedded server of a test run; short, and open to the account that serves root."""
    return server_directory() / f"conflictdb-tests-{run}"


def shared_directory() -> Path:
    """Return the directory of files that all workers of a run share; it is removed at the end of the run."""
    return Path(os.environ["XDG_STATE_HOME"]).parent


def server_directory() -> Path:
    """Return the directory for homes of servers, the same in all processes of a run.

    In memory where there is room: a seventh of the time of database tests was making and removing files on a disk.
    """
    return Path(os.environ.setdefault("CONFLICTDB_TEST_DIRECTORY", str(_server_directory())))


def _server_directory() -> Path:
    try:
        free = min(shutil.disk_usage(_IN_MEMORY).free, _available_memory())
    except OSError:
        free = 0
    has_room = free >= _LEAST_ROOM and os.access(_IN_MEMORY, os.W_OK | os.X_OK)
    return _IN_MEMORY if has_room else Path(tempfile.gettempdir())


def _available_memory() -> int:
    """Return the bytes of memory that programs can get without swapping."""
    lines = Path("/proc/meminfo").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:"))


def begin(run: str) -> None:
    """Hold the lock of a run until this process ends: then other runs may remove what it leaves."""
    lock = os.open(_lock(run_home(run)), os.O_RDWR | os.O_CREAT, 0o600)
    fcntl.lockf(lock, fcntl.LOCK_EX)  # forks do not inherit it
    _LOCKS[_lock(run_home(run))] = lock


def clean_up(run: str) -> None:
    """Remove leftovers of a run, once its workers have ended, and of runs that were killed."""
    given = os.environ.get("CONFLICTDB_TEST_DSN")
    if given:
        left = TestServer(given, f"conflictdb_test_{run}", "")
        try:
            left.drop(f"{left.prefix}_template")
            left.drop(f"{left.prefix}_making")
        except psycopg.OperationalError:
            pass  # the server could not be reached, which the tests have reported already
    home = run_home(run)
    _ends(home, WAIT_S)
    _remove(home)
    own = _LOCKS.pop(_lock(home), None)
    _lock(home).unlink(missing_ok=True)
    if own is not None:
        os.close(own)
    for lock in home.parent.glob(_lock(run_home("*")).name):
        if lock not in _LOCKS:
            _remove_killed(lock)
    for left_home in home.parent.glob(run_home("*").name):
        # Of programs that hold no lock.
        is_locked = _lock(left_home.with_name(left_home.name.removesuffix("-state"))).exists()
        if not is_locked and _age_s(left_home) > 86400 and _is_idle(left_home):
            shutil.rmtree(left_home, ignore_errors=True)


def _lock(home: Path) -> Path:
    return home.with_name(f"{home.name}.lock")


def _remove_killed(path: Path) -> None:
    """Remove leftovers of a run that nobody runs any more, unless it is another user's."""
    try:
        lock = os.open(path, os.O_RDWR)
    except OSError:
        return
    try:
        fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        home = path.with_suffix("")
        if os.fstat(lock).st_uid == os.geteuid() and _ends(home, _MOST_S):
            _remove(home)
            path.unlink(missing_ok=True)
    except BlockingIOError:
        return
    finally:
        os.close(lock)


def _remove(home: Path) -> None:
    for left in (home, home.with_name(f"{home.name}-state")):
        shutil.rmtree(left, ignore_errors=True)


def _ends(home: Path, within_s: float) -> bool:
    """End the programs of a run; return whether its server has ended within some time."""
    _end_programs(home)
    end = time.monotonic() + within_s
    while not (is_idle := _is_idle(home)) and time.monotonic() < end:
        time.sleep(0.01)
    return is_idle


def _end_programs(home: Path) -> None:
    """End the programs of Python that tests of a run have begun, as workers that were killed leave them."""
    begun = f"CONFLICTDB_HOME={home}".encode()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            is_left = begun in (process / "environ").read_bytes().split(b"\0")
            if is_left and "python" in (process / "exe").readlink().name and int(process.name) != os.getpid():
                os.kill(int(process.name), signal.SIGKILL)
        except OSError:  # it has ended, or is another user's
            continue


def _age_s(home: Path) -> float:
    try:
        return time.time() - home.stat().st_mtime
    except FileNotFoundError:  # another run has just removed it
        return 0.0


def _is_idle(home: Path) -> bool:
    try:
        return server.status(home).pid is None
    except ServerError:  # another user's
        return False


def _embedded(run: str, *, download: bool) -> server.EmbeddedServer:
    settings = server.Settings.from_environment(home=run_home(run))
    settings = replace(settings, download=download and settings.download)
    return server.embedded(durable=False, settings=settings)


def _require_postgis(dsn: str) -> None:
    with psycopg.connect(dsn) as conn:
        asked = "SELECT name FROM pg_available_extensions WHERE name IN ('postgis', 'btree_gist')"
        found = {name for (name,) in conn.execute(asked)}
    if found != {"postgis", "btree_gist"}:
        pytest.fail(f"the server of CONFLICTDB_TEST_DSN offers only {found or 'nothing'} of postgis and btree_gist")


def _docker_answers() -> bool:
    import docker
    from docker.errors import DockerException

    with _docker_leaks():
        try:
            client: Any = docker.from_env(timeout=DOCKER_TIMEOUT_S)
        except DockerException:
            return False
        try:
            return bool(client.ping())
        except (DockerException, OSError):
            return False
        finally:
            client.close()


@contextmanager
def _docker_leaks() -> Iterator[None]:
    # Docker's client leaves sockets open, which is an error in our tests: collect them while warnings are off.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            gc.collect()


@contextmanager
def _in_docker(worker: str) -> Iterator[TestServer]:
    with _docker_leaks():
        from testcontainers.community.postgres import PostgresContainer

        image = os.environ.get("CONFLICTDB_TEST_IMAGE", DOCKER_IMAGE)
        container = PostgresContainer(image, driver="psycopg").start()
    try:
        # The address is SQLAlchemy's, with the driver in it; libpq wants it without.
        dsn = container.get_connection_url().replace("+psycopg", "", 1)
        yield TestServer(dsn, f"conflictdb_test_{worker}", f"Docker: {image}")
    finally:
        with _docker_leaks():
            container.stop()
            del container


def client_programs(conn: psycopg.Connection[Any]) -> tuple[Path, dict[str, str]]:
    """Return the directory of pg_dump and pg_restore that suit a server, and their environment; skip without them."""
    home, major = Path(tempfile.gettempdir()), conn.info.server_version // 10000
    try:
        found = find_server(Settings.from_environment(home=home), account_for(home), None, lambda _: None)
    except ServerError as error:
        pytest.skip(f"did not run: no pg_dump here ({error})")
    if found.major < major or not (found.bin / "pg_dump").exists():
        pytest.skip(f"did not run: no pg_dump of version {major} or newer in {found.bin}")
    return found.bin, found.environ
