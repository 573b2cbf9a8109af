"""Waits of tests, with a limit that no machine reaches which is only slow or busy."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import psycopg

from conflictdb.jobs import probes

# Far longer than what is waited for takes. A test that asserts less depends on the machine.
WAIT_S = 180.0

# The command, which has longer to clean up at SIGTERM than the four seconds after which it is ended.
_PATIENT = f"""
import sys
from conflictdb.cli import main, termination
termination._GRACE_S = {WAIT_S}
sys.exit(main())
"""


def patient_command(*words: str) -> list[str]:
    """Return the words of a program that is the command `conflictdb`, for tests that end it."""
    return [sys.executable, "-c", _PATIENT, *words]


def until(reached: Callable[[], object], within_s: float = WAIT_S, what: str = "waited too long") -> float:
    """Wait until a condition is true; return the time, seconds."""
    start = time.monotonic()
    while not reached():
        assert time.monotonic() < start + within_s, what
        time.sleep(0.01)
    return time.monotonic() - start


def until_blocked(watcher: psycopg.Connection[Any], by: psycopg.Connection[Any]) -> None:
    """Wait until a session waits for a lock of another session, `by`; a third one watches."""
    blocked = "SELECT FROM pg_locks WHERE NOT granted AND %s = ANY (pg_blocking_pids(pid))"

    def waits() -> bool:
        with watcher.transaction():
            return watcher.execute(blocked, [by.info.backend_pid]).rowcount > 0

    until(waits, what="no session waits")


@contextmanager
def killed_after(process: "subprocess.Popen[Any]", most_s: float) -> Iterator[None]:
    """Kill a program, whose output the body reads, if that takes longer: the reader then gets the end of it."""
    too_late = threading.Timer(most_s, process.kill)
    too_late.start()
    try:
        yield
    finally:
        too_late.cancel()


def answer_all(conn: psycopg.Connection[Any]) -> None:
    """Answer requests until none is left: one call ends after a second."""
    end_s = time.monotonic() + WAIT_S
    while probes.answer(conn):
        assert time.monotonic() < end_s
