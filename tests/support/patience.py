"""Programs that tests wait for, though not for ever."""

import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def killed_after(process: "subprocess.Popen[Any]", most_s: float) -> Iterator[None]:
    """Kill a program whose output is waited for inside, if that takes longer: what reads it then comes to its end."""
    too_late = threading.Timer(most_s, process.kill)
    too_late.start()
    try:
        yield
    finally:
        too_late.cancel()
