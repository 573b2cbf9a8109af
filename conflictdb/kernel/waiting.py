"""Run work in another thread, and wait for it so that an interrupt is reported as one."""

from _thread import start_new_thread
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Final, Generic, TypeVar
from weakref import WeakKeyDictionary

_T = TypeVar("_T")


class ThreadWork(Generic[_T]):
    """Work in a thread of its own, which starts at once. The program does not wait for it at its end.

    Threads and futures of the standard library start and wait in several steps of Python: an error raised by a signal
    handler in between becomes ``RuntimeError: release unlocked lock``, or a lock stays taken. Here each is one step.
    """

    def __init__(self, work: Callable[[], _T]) -> None:
        self._work = work
        self._is_done = SimpleQueue[bool]()
        self._result: list[_T] = []
        self._error: BaseException | None = None
        start_new_thread(self._run, ())

    def _run(self) -> None:
        try:
            self._result.append(self._work())
        except BaseException as error:
            self._error = error
        finally:
            del self._work
            self._is_done.put(True)

    def is_done(self) -> bool:
        """Return whether the work has ended."""
        return bool(self._result) or self._error is not None

    def wait(self) -> None:
        """Wait for the end of the work; discard its result or error."""
        if not self.is_done():
            self._is_done.get()

    def result(self) -> _T:
        """Wait for the work; return its result or raise its error."""
        self.wait()
        if self._error is not None:
            raise self._error
        return self._result[0]


# The latest work of another thread on each connection.
_THREADS: Final[WeakKeyDictionary[Any, ThreadWork[Any]]] = WeakKeyDictionary()


def run_in_thread(connection: object, work: Callable[[], _T]) -> ThreadWork[_T]:
    """Run work with a connection in a thread of its own."""
    begun = _THREADS[connection] = ThreadWork(work)
    return begun


def cancel_thread(connection: object, cancel: Callable[[], object]) -> None:
    """Cancel the work that another thread does with a connection, and wait until the connection is free.

    Result and errors of the work are discarded.
    """
    begun = _THREADS.pop(connection, None)
    if begun is not None and not begun.is_done():
        try:
            cancel()
        finally:
            begun.wait()
