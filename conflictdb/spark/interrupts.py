"""Handle Ctrl-C and SIGTERM during Java calls: cancel the jobs, and raise the interrupt between two calls.

Raised within a call it would leave half an answer on the connection, which the next call would read as its own.
"""

import logging
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread, current_thread, main_thread
from types import FrameType
from typing import Any, Final

# Longest wait for the answer of a call: SIGTERM ends a command within 5 s.
_LONGEST_S: Final = {signal.SIGINT: 20.0, signal.SIGTERM: 3.0}
# Cancel again this often: new jobs may have begun.
_EVERY_S: Final = 0.2


@contextmanager
def interrupts_between_calls(cancel: Callable[[], Any]) -> Iterator[None]:
    """Delay the present signal handlers until between Java calls; errors after a signal become the signal's.

    cancel : called, in its own thread, to end a Java call soon
    """
    if current_thread() is not main_thread():
        yield
        return
    # A signal that is ignored, as SIGINT is in the background of a shell, stays ignored.
    before = {number: handler for number in _LONGEST_S if callable(handler := signal.getsignal(number))}
    waiting = _Waiting(cancel, before)
    for number in before:
        signal.signal(number, waiting.hear)
    try:
        yield
    except Exception:
        waiting.act(None)
        raise
    finally:
        waiting.ended.set()
        logging.disable(logging.NOTSET)
        for number, handler in before.items():
            signal.signal(number, handler)
    waiting.act(None)


class _Waiting:
    """A received signal that waits for a Java call to end."""

    def __init__(self, cancel: Callable[[], Any], before: dict[signal.Signals, Any]) -> None:
        self.ended = Event()
        self._cancel, self._before = cancel, before
        self._number: signal.Signals | None = None
        self._heard_s = 0.0

    def hear(self, number: int, frame: FrameType | None) -> None:
        """Act now, or cancel Java's jobs and wait to be called again."""
        if self._number is None:
            self._number, self._heard_s = signal.Signals(number), time.monotonic()
            if _is_call(frame):
                Thread(target=self._remind, daemon=True, name="interrupt").start()
        is_late = time.monotonic() - self._heard_s > _LONGEST_S[self._number]
        if is_late:
            logging.disable(logging.ERROR)  # py4j would log the interrupted call
        if is_late or not _is_call(frame):
            self.act(frame)

    def act(self, frame: FrameType | None) -> None:
        """Call the original handler of the received signal, if there is one; it raises."""
        self.ended.set()
        if self._number is not None:
            self._before[self._number](self._number, frame)

    def _remind(self) -> None:
        while not self.ended.is_set():
            with suppress(Exception):  # Java may be gone
                self._cancel()
            if not self.ended.wait(_EVERY_S) and self._number is not None:
                signal.pthread_kill(main_thread().ident or 0, self._number)


def _is_call(frame: FrameType | None) -> bool:
    """Return whether a Java call is in progress."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).startswith("py4j."):
            return True
        frame = frame.f_back
    return False
