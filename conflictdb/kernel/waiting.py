"""Run work in another thread, and wait for it so that an interrupt is reported as one."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, Final, TypeVar
from weakref import WeakKeyDictionary

_T = TypeVar("_T")
# The latest work of another thread on each connection.
_THREADS: Final[WeakKeyDictionary[Any, Future[Any]]] = WeakKeyDictionary()


def run_in_thread(connection: object, work: Callable[[], _T]) -> Future[_T]:
    """Run work with a connection in a thread of its own; the program waits for it before it exits."""
    thread = ThreadPoolExecutor(1)
    begun = _THREADS[connection] = thread.submit(work)
    thread.shutdown(wait=False)
    return begun


def cancel_thread(connection: object, cancel: Callable[[], object]) -> None:
    """Cancel the work that another thread does with a connection, and wait until the connection is free.

    Result and errors of the work are discarded.
    """
    begun = _THREADS.pop(connection, None)
    if begun is not None and not begun.done():
        try:
            cancel()
        finally:
            with suppress(Exception):
                wait_for(begun)


def wait_for(future: Future[_T]) -> _T:
    """Wait for a future; return its result or raise its error.

    `Future.result` waits in several steps of Python: an error raised by a signal handler in between may become
    ``RuntimeError: cannot release un-acquired lock``. A SimpleQueue waits in one step.
    """
    is_there = SimpleQueue[Future[_T]]()
    future.add_done_callback(is_there.put)
    return is_there.get().result()
