"""End a command at SIGTERM as at Ctrl-C, within 5 s in any state.

Python raises in the main thread only, and only between its own steps: a long step of compiled code or a dead network
delays that. A separate thread therefore receives the signal at once, and ends the process if it still runs after some
seconds.
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

# Less than the promised 5 s.
_GRACE_S: Final = 4.0


class Terminated(KeyboardInterrupt):
    """SIGTERM; it ends a command as Ctrl-C does: the database's work is cancelled, partial work is rolled back."""


@contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """Raise Terminated at SIGTERM; if the block has not ended some seconds later, end the process."""

    def interrupt(number: int, frame: FrameType | None) -> NoReturn:
        raise Terminated

    receiver, sender = os.pipe()
    os.set_blocking(sender, False)
    watchdog = Thread(target=_end_late, args=(receiver,), daemon=True, name="termination")
    watchdog.start()
    before = signal.signal(signal.SIGTERM, interrupt)
    sender_before = signal.set_wakeup_fd(sender, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(sender_before)
        signal.signal(signal.SIGTERM, before)
        os.close(sender)
        watchdog.join()
        os.close(receiver)


def interrupt_behind(error: BaseException) -> KeyboardInterrupt | None:
    """Return the interrupt during whose cleanup an error was raised, None if there was none."""
    behind: BaseException | None = error
    while behind is not None and not isinstance(behind, KeyboardInterrupt):
        behind = behind.__context__
    return behind


def _end_late(receiver: int) -> None:
    """End the process some seconds after SIGTERM; return when no more signals can come."""
    end_at_s: float | None = None
    while True:
        left_s = None if end_at_s is None else max(0.0, end_at_s - time.monotonic())
        if not select.select([receiver], [], [], left_s)[0]:
            os._exit(TERMINATED)
        numbers = os.read(receiver, 64)
        if not numbers:
            return
        if end_at_s is None and signal.SIGTERM in numbers:
            end_at_s = time.monotonic() + _GRACE_S
