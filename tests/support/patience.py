"""Waits of tests, with a limit."""

import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


def until(reached: Callable[[], object], within_s: float = 60.0, what: str = "waited too long") -> float:
    """Wait until a condition is true; return the time, seconds."""
    start = time.monotonic()
    while not reached():
        assert time.monotonic() < start + within_s, what
        time.sleep(0.01)
    return time.monotonic() - start


@contextmanager
def killed_after(process: "subprocess.Popen[Any]", most_s: float) -> Iterator[None]:
    """Kill a program, whose output the body reads, if that takes longer: the reader then gets the end of it."""
    too_late = threading.Timer(most_s, process.kill)
    too_late.start()
    try:
        yield
    finally:
        too_late.cancel()
