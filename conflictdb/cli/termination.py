"""SIGTERM ends a command as Ctrl-C does, and within 5 s whatever it is doing.

Python raises in the main thread, and only between two steps of its own: a long step of compiled code and a network that
does not answer hold that up. So a thread of its own hears of the signal as it arrives, and ends the process if it is
still there after some seconds. The server notices that nobody is there any more, and rolls back.
"""

import os
import select
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread
from types import FrameType
from typing import Final, NoReturn

from conflictdb.cli.codes import TERMINATED

# Within the 5 s that are promised.
_GRACE_S: Final = 4.0


class Terminated(KeyboardInterrupt):
    """SIGTERM; it ends a command as Ctrl-C does: what the database is doing is cancelled, nothing half done stays."""


@contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """Raise Terminated at SIGTERM; if what is inside has not ended some seconds later, end the process."""

    def interrupt(number: int, frame: FrameType | None) -> NoReturn:
        raise Terminated

    heard, told = os.pipe()
    os.set_blocking(told, False)
    watchdog = Thread(target=_end_late, args=(heard,), daemon=True, name="termination")
    watchdog.start()
    before = signal.signal(signal.SIGTERM, interrupt)
    told_before = signal.set_wakeup_fd(told, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(told_before)
        signal.signal(signal.SIGTERM, before)
        os.close(told)
        watchdog.join()
        os.close(heard)


def interrupt_behind(error: BaseException) -> KeyboardInterrupt | None:
    """Return the interrupt during whose cleanup an error was raised, None if there is none."""
    behind: BaseException | None = error
    while behind is not None and not isinstance(behind, KeyboardInterrupt):
        behind = behind.__context__
    return behind


def _end_late(heard: int) -> None:
    """End the process some seconds after SIGTERM; return when nobody tells of signals any more."""
    end_at_s: float | None = None
    while True:
        left_s = None if end_at_s is None else max(0.0, end_at_s - time.monotonic())
        if not select.select([heard], [], [], left_s)[0]:
            os._exit(TERMINATED)
        numbers = os.read(heard, 64)
        if not numbers:
            return
        if end_at_s is None and signal.SIGTERM in numbers:
            end_at_s = time.monotonic() + _GRACE_S
