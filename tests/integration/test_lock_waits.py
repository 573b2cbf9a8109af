"""No wait for a lock is endless: a role that may delete rows of a table may lock it, and keep it locked."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import psycopg
import pytest
from commands import runner
from patience import WAIT_S

from conflictdb import connect, store
from conflictdb.cli.codes import FAILED
from conflictdb.errors import LockTimeout
from conflictdb.jobs import detect
from conflictdb.jobs.worker import Worker
from conflictdb.store import connection, locking

Conn = psycopg.Connection[Any]

# All that a detection of a scene without attached tables reads or writes.
TABLES = [
    *("scene", "area", "change", "piece", "conflict", "run", "scene_lock", "attachment", "history", "conflict_event"),
]
SHAPE = "SRID=4326;POLYGON((0 0,1 0,1 1,0 1,0 0))"
LIMIT_S = 0.1


@pytest.fixture
def filled(conn: Conn) -> Conn:
    """Scene s, with two areas that are in conflict and wait for a detection."""
    conn.execute("SELECT conflictdb.create_scene('s')")
    for key in "AB":
        conn.execute("SELECT conflictdb.put_area('s', %s, %s)", [key, SHAPE])
    conn.commit()
    return conn


@pytest.fixture
def other(dsn: str) -> Iterator[Conn]:
    with psycopg.connect(dsn, application_name="the other") as conn:
        yield conn
        conn.rollback()


def took_s(work: Callable[[], object]) -> float:
    start = time.monotonic()
    work()
    return time.monotonic() - start


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("full", [False, True])
def test_a_detection_waits_for_no_lock_longer_than_it_is_told(
    filled: Conn, other: Conn, table: str, full: bool
) -> None:
    """From its first statement on; and the error names the session with the lock."""
    other.execute(f"LOCK TABLE conflictdb.{table} IN ACCESS EXCLUSIVE MODE".encode())

    def detected() -> None:
        with pytest.raises(LockTimeout, match=f"locked by: process {other.info.backend_pid} .*'the other'"):
            detect.detect(filled, "s", full=full, jobs=1, lock_timeout_s=LIMIT_S)

    assert took_s(detected) < WAIT_S  # each of its statements waits LIMIT_S at most
    assert filled.info.transaction_status == psycopg.pq.TransactionStatus.IDLE
    other.rollback()
    assert detect.detect(filled, "s", jobs=1, lock_timeout_s=0.3).conflicts == 1


def test_a_detection_without_a_limit_ends_as_well(filled: Conn, other: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Except for another detection of the scene, whose end is in sight."""
    monkeypatch.setattr(locking, "LOCK_WAIT_S", LIMIT_S)
    other.execute("LOCK TABLE conflictdb.scene")
    with pytest.raises(LockTimeout, match="locked by: process"):
        detect.detect(filled, "s", jobs=1)
    other.rollback()
    other.execute("SELECT FROM conflictdb.scene FOR UPDATE")
    with pytest.raises(LockTimeout):
        detect.detect(filled, "s", jobs=1)


@pytest.mark.parametrize("table", ["scene", "attached_object", "attachment", "conflict"])
def test_a_command_with_a_limit_ends_in_time(
    dsn: str, filled: Conn, other: Conn, table: str, capsys: pytest.CaptureFixture[str]
) -> None:
    other.execute("SET ROLE conflictdb_worker")  # which may lock the tables
    other.execute(f"LOCK TABLE conflictdb.{table} IN ACCESS EXCLUSIVE MODE".encode())
    run = runner(dsn, capsys)
    for arguments in (["--tolerance-m", "2"], []):
        start = time.monotonic()
        done = run("detect", "--scene", "s", *arguments, "--jobs", "1", "--lock-timeout", f"{LIMIT_S}s")
        assert time.monotonic() - start < WAIT_S
        assert done.code == FAILED
        assert f"locked by: process {other.info.backend_pid} " in done.err


def test_what_a_program_opens_has_a_limit(dsn: str, filled: Conn, other: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also calls without an option for it, which use the default limit."""
    for module in (connection, locking):
        monkeypatch.setattr(module, "LOCK_WAIT_S", LIMIT_S)
    other.execute("LOCK TABLE conflictdb.scene")
    with connect(dsn) as db:
        for work in (
            lambda: db.scene("s").state(),
            lambda: list(db.scene("s").stream_conflicts()),
            lambda: store.list_scenes(db.connection),
            lambda: db.scene("s").detect(),
        ):
            with pytest.raises(LockTimeout, match="locked by: process"):
                work()


@pytest.mark.parametrize("autocommit", [False, True])
def test_a_connection_of_the_callers_keeps_its_own_limit(filled: Conn, autocommit: bool) -> None:
    filled.autocommit = autocommit
    filled.execute("SET lock_timeout = '7s'")
    filled.commit()
    with store.transaction(filled):
        assert filled.execute("SHOW lock_timeout").fetchone() == ("7s",)
    with store.waiting_at_most(filled, 3.0):
        with store.transaction(filled):
            assert filled.execute("SHOW lock_timeout").fetchone() == ("3s",)
        store.begin_snapshot(filled)
        assert filled.execute("SHOW lock_timeout").fetchone() == ("3s",)
        filled.rollback()
    with store.transaction(filled):
        assert filled.execute("SHOW lock_timeout").fetchone() == ("7s",)


def test_limits_of_the_role_hold_for_connections_of_a_program(dsn: str, filled: Conn) -> None:
    filled.execute(f"ALTER DATABASE {filled.info.dbname} SET lock_timeout = '8s'".encode())
    filled.commit()
    with store.connect(dsn) as conn, store.transaction(conn):
        assert conn.execute("SHOW lock_timeout").fetchone() == ("8s",)


def test_a_worker_passes_over_what_is_locked_and_says_so(
    dsn: str, filled: Conn, other: Conn, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It detects the other scenes, and that one too once it is free."""
    monkeypatch.setattr(locking, "_IN_PASSING_S", 0.3)
    filled.execute("SELECT conflictdb.create_scene('t')")
    for key in "AB":
        filled.execute("SELECT conflictdb.put_area('t', %s, %s)", [key, SHAPE])
    filled.commit()
    other.execute("SET ROLE conflictdb_editor")
    other.execute("SELECT FROM conflictdb.scene WHERE name = 's' FOR UPDATE")
    reported: list[tuple[str, object]] = []

    def report(scene: str, run: object, _: float) -> None:
        reported.append((scene, run))

    def worker() -> Worker:
        return Worker(lambda: store.connect(dsn), report, jobs=1, lock_timeout_s=1.0)

    assert not worker().once()
    assert [scene for scene, run in reported if not isinstance(run, Exception)] == ["t"]
    assert [(scene, type(run)) for scene, run in reported if isinstance(run, Exception)] == [("s", LockTimeout)]
    other.rollback()
    assert worker().once()
    assert [(scene, type(run)) for scene, run in reported[2:]] == [("s", detect.Run)]
