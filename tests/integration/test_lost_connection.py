"""A command that loses its connection, or is interrupted while it cleans up, says so in one line."""

import gc
import signal
import socket
from collections.abc import Callable
from typing import Any

import psycopg
import pytest
import shapely
from commands import runner
from piecework import load

from conflictdb import store
from conflictdb.cli import detecting, termination
from conflictdb.errors import InvalidInput, StoreError
from conflictdb.jobs import detect
from conflictdb.model.plans import Area, Scene
from conflictdb.store import connection, locking

LOST = "conflictdb: the connection to the database is lost"


@pytest.fixture
def scene(dsn: str, conn: psycopg.Connection[Any]) -> str:
    load(conn, Scene("s"), [Area(key, shapely.box(0, 0, 1, 1)) for key in "AB"], [])
    conn.commit()
    return dsn


def cut(conn: psycopg.Connection[Any]) -> None:
    """Close a connection as a server that dies does."""
    with socket.socket(fileno=conn.fileno()) as line:
        line.shutdown(socket.SHUT_RDWR)
        line.detach()


def cut_before(routine: Callable[..., Any]) -> Callable[..., Any]:
    """Return a routine whose connection is cut before it is called."""

    def cutting(conn: psycopg.Connection[Any], *arguments: Any, **named: Any) -> Any:
        cut(conn)
        return routine(conn, *arguments, **named)

    return cutting


@pytest.mark.parametrize(
    ("module", "name"),
    [(locking, "begin_snapshot"), (store, "begin_detection"), (store, "pending"), (store, "begin_write")],
)
def test_a_lost_connection_is_one_line(
    scene: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, module: Any, name: str
) -> None:
    """Also where the transaction is rolled back because of it, which fails."""
    monkeypatch.setattr(module, name, cut_before(getattr(module, name)))
    done = runner(scene, capsys)("detect", "--scene", "s", "--full")
    assert (done.code, done.out) == (1, "")
    assert done.err.startswith(LOST)
    assert done.err.count("\n") == 1


def test_an_error_of_the_driver_is_no_mistake_of_this_program(
    scene: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise psycopg.OperationalError("consuming input failed: it is gone\n\tThis probably means")

    monkeypatch.setattr(detecting, "run_text", fail)
    done = runner(scene, capsys)("detect", "--scene", "s")
    assert (done.code, done.err) == (1, f"{LOST}: consuming input failed: it is gone\n")


def test_detect_raises_no_error_of_the_driver(scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with store.connect(scene) as conn:
        monkeypatch.setattr(locking, "begin_snapshot", cut_before(locking.begin_snapshot))
        with pytest.raises(StoreError, match="is lost"):
            detect.detect(conn, "s", jobs=1)


@pytest.mark.parametrize(
    ("interrupt", "code", "word"),
    [(KeyboardInterrupt, 130, "interrupted"), (termination.Terminated, 143, "terminated")],
)
def test_an_error_while_an_interrupt_is_cleaned_up_is_that_interrupt(
    scene: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    interrupt: type[KeyboardInterrupt],
    code: int,
    word: str,
) -> None:
    def close(*_: object) -> None:
        with store.translated():
            try:
                raise interrupt
            finally:
                raise psycopg.OperationalError("sending query failed: another command is already in progress")

    monkeypatch.setattr(detecting, "run_text", close)
    done = runner(scene, capsys)("detect", "--scene", "s")
    assert (done.code, done.err) == (code, f"conflictdb: {word}\n")
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_rows_that_end_with_their_connection_leave_no_cursor(scene: str) -> None:
    """Python would warn of one that is open."""
    with store.connect(scene) as conn:
        rows = connection.call_each(conn, "_waiting_scenes")
        assert next(rows)[0] == "s"
        cut(conn)
        with pytest.raises(StoreError, match="is lost"):
            next(rows)
        del rows
        gc.collect()


@pytest.mark.parametrize("text", ["a\0b", "\ud800"])
def test_text_that_the_database_has_no_room_for_is_refused(conn: psycopg.Connection[Any], text: str) -> None:
    with pytest.raises(InvalidInput, match="no NUL character and no unpaired surrogate"):
        store.scene_id(conn, text)
