"""What tests wait for, though not for ever."""

import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


def until(reached: Callable[[], object], within_s: float = 60.0, what: str = "waited too long") -> float:
    """Wait until something is so; return how long it took, seconds."""
    start = time.monotonic()
    while not reached():
        assert time.monotonic() < start + within_s, what
        time.sleep(0.01)
    return time.monotonic() - start


@contextmanager
def killed_after(process: "subprocess.Popen[Any]", most_s: float) -> Iterator[None]:
    """Kill a program whose output is waited for inside, if that takes longer: what reads it then comes to its end."""
    too_late = threading.Timer(most_s, process.kill)
    too_late.start()
    try:
        yield
    finally:
        too_late.cancel()
