"""Fixtures shared by all tests; where the test database comes from is in databases.py."""

import gc
import logging
import os
import subprocess
import uuid
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psycopg
import pytest
from commands import Run, runner
from databases import TestServer, begin, clean_up, run_home, test_server
from forked_readers import forked_readers
from hypothesis import HealthCheck, settings
from lent_sessions import LentSessions
from reused import ReusedDatabase

from conflictdb.formats import confined
from conflictdb.jobs import schema

if TYPE_CHECKING:
    from spark_answers import Spark

# The longest files come first, so that no worker is left with one of them in the end. Other long files wait for
# programs: they run beside short ones, so that no processor is idle.
_LONG = (
    "spark", "documents", "map_pictures", "map_page", "server_cluster", "load_by_parts", "upgrade", "oracle",
    "planning", "speeds", "shallow", "worker_faults", "attached_rights", "paths", "recurring_plans", "branches",
    "proposals", "benchmarks", "wheels", "bare_restore", "sources",
)  # fmt: skip
_BROWSER = "tests/browser"  # its files are one group, as they share open pages
_RUN = pytest.StashKey[str]()
_SERVERS = pytest.StashKey[set[str]]()
_NUMBERS = count(1)
# A draw may take long on a busy machine.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


def pytest_configure(config: pytest.Config) -> None:
    """Give the run a name, which its workers share, and keep it away from the user's own databases."""
    config.stash[_RUN] = _worker_input(config).get("conflictdb_run") or uuid.uuid4().hex[:8]
    config.stash[_SERVERS] = set()
    if not _worker_input(config):
        begin(config.stash[_RUN])
    os.environ.pop("CONFLICTDB_DSN", None)
    os.environ.pop("CONFLICTDB_SCENE", None)
    os.environ.pop("CONFLICTDB_TZ", None)
    os.environ["CONFLICTDB_HOME"] = str(run_home(config.stash[_RUN]))
    # A worker has a state of its own: commands remember the last scene there.
    os.environ["XDG_STATE_HOME"] = f"{run_home(config.stash[_RUN])}-state/{_worker(config)}"


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Pass the name of the run to a worker of pytest-xdist."""
    node.workerinput["conflictdb_run"] = node.config.stash[_RUN]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Take from a worker of pytest-xdist which server it used."""
    node.config.stash[_SERVERS].update(getattr(node, "workeroutput", {}).get("conflictdb_servers", []))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Report the server of this worker to the process that began the run."""
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["conflictdb_servers"] = sorted(session.config.stash[_SERVERS])


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say which server the tests ran on."""
    for description in sorted(config.stash[_SERVERS]):
        terminalreporter.write_line(f"test database: {description}")


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove leftovers of the run: the process that began it does, once its workers have ended."""
    if not _worker_input(config):
        clean_up(config.stash[_RUN])


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that need a database; take those of long files first."""
    for item in items:
        if "server_dsn" in getattr(item, "fixturenames", ()):
            item.add_marker("db")
    items.sort(key=lambda item: not item.path.stem.startswith(tuple(f"test_{name}" for name in _LONG)))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect no garbage while modules and tests are made, which stay: a fifth of the time went to looking for it."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish() -> None:
    """Collect garbage seldom, and exempt modules and collected tests, which stay: each full one would visit them."""
    gc.freeze()
    gc.set_threshold(100_000, 20, 20)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give a worker whole files, and groups of them: their tests share what is slow to make."""
    from xdist.scheduler import LoadGroupScheduling

    class Files(LoadGroupScheduling):
        def _split_scope(self, nodeid: str) -> str:
            group: str = super()._split_scope(nodeid)
            if group != nodeid:
                return group
            file = nodeid.split("::", 1)[0]
            return _BROWSER if file.startswith(f"{_BROWSER}/") else file

    config.option.loadscopereorder = False  # most tests are not most work
    return Files(config, log) if config.option.dist == "loadgroup" else None


def _seen_by_all() -> dict[str, object]:
    """State that a test may change for later tests: the working directory, and logging."""
    root = logging.getLogger()
    own = [handler for handler in root.handlers if not type(handler).__module__.startswith("_pytest")]
    levels = [logging.getLogger(name).level for name in (None, "conflictdb")]
    return {"directory": Path.cwd(), "levels": levels, "disabled": root.manager.disable, "handlers": own}


@pytest.fixture(scope="session")
def spark() -> "Iterator[Spark]":
    """Return Spark, which starts in some ten seconds; its tests are of group `spark`, so that one worker runs it."""
    from spark_answers import running_spark

    with running_spark() as found:
        yield found


@pytest.fixture(scope="session", autouse=True)
def _forked_readers() -> Iterator[None]:
    """Fork confined readers: to start one takes longer than most tests that read a file."""
    with forked_readers() as forking, pytest.MonkeyPatch.context() as patched:
        patched.setattr(confined, "subprocess", forking)
        yield


@pytest.fixture
def readers_of_users(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start confined readers as users do."""
    monkeypatch.setattr(confined, "subprocess", subprocess)


@pytest.fixture(autouse=True)
def _leaves_all_as_it_was() -> Iterator[None]:
    """Fail the test that leaves something changed, rather than a later one in some order."""
    before = _seen_by_all()
    yield
    assert _seen_by_all() == before


@pytest.fixture(scope="session")
def _server(request: pytest.FixtureRequest) -> Iterator[TestServer]:
    with test_server(request.config.stash[_RUN], _worker(request.config)) as server:
        request.config.stash[_SERVERS].add(server.description)
        yield server


@pytest.fixture(scope="session")
def server_dsn(_server: TestServer) -> str:
    """Return the connection string of the test server, as a user who may create databases."""
    return _server.dsn


@pytest.fixture(scope="session")
def template(_server: TestServer, server_dsn: str) -> str:
    """Return the name of a database with the schema and nothing in it; do not connect to it, clone it."""
    return _server.template(schema.upgrade)


@pytest.fixture
def _fresh_name(_server: TestServer, request: pytest.FixtureRequest) -> str:
    return f"{_server.prefix}_{_worker(request.config)}_{next(_NUMBERS)}"


@pytest.fixture
def empty_dsn(_server: TestServer, server_dsn: str, _fresh_name: str) -> Iterator[str]:
    """Return how to connect to a database without the schema (and without PostGIS), dropped afterwards."""
    yield _server.clone("template0", _fresh_name)
    _server.drop(_fresh_name)


@pytest.fixture(scope="session")
def _reused(_server: TestServer, template: str, request: pytest.FixtureRequest) -> Iterator[ReusedDatabase]:
    reused = ReusedDatabase(_server, template, f"{_server.prefix}_{_worker(request.config)}_reused")
    yield reused
    reused.drop()


@pytest.fixture
def dsn(_reused: ReusedDatabase) -> Iterator[str]:
    """Return the connection string of a database with an empty schema; objects that a test leaves are removed."""
    yield _reused.dsn()
    _reused.clean()


@pytest.fixture
def conn(dsn: str, _reused: ReusedDatabase) -> Iterator[psycopg.Connection[Any]]:
    """Return a connection to it, in time zone UTC."""
    with _reused.session(dsn) as connection:
        yield connection


@pytest.fixture
def run(dsn: str, capsys: pytest.CaptureFixture[str]) -> Iterator[Run]:
    """Return a function that runs a command on a database with the schema and nothing in it, on a session for all."""
    lent = LentSessions()
    yield runner(dsn, capsys, lent.connect)
    lent.close()


def _worker_input(config: pytest.Config) -> dict[str, Any]:
    return getattr(config, "workerinput", {})


def _worker(config: pytest.Config) -> str:
    return str(_worker_input(config).get("workerid", "main"))
