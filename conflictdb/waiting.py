"""Run work in another thread, and wait for it so that an interrupt is reported as one."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, Final, TypeVar
from weakref import WeakKeyDictionary

_T = TypeVar("_T")
# The last work that another thread began with a connection.
_ASIDE: Final[WeakKeyDictionary[Any, Future[Any]]] = WeakKeyDictionary()


def begun_aside(connection: object, work: Callable[[], _T]) -> Future[_T]:
    """Begin work with a connection in a thread of its own, which ends with it; a program that ends waits for it."""
    thread = ThreadPoolExecutor(1)
    begun = _ASIDE[connection] = thread.submit(work)
    thread.shutdown(wait=False)
    return begun


def end_aside(connection: object, cancel: Callable[[], object]) -> None:
    """Cancel the work that another thread does with a connection, and wait until the connection is free.

    The work's result and its errors are dropped.
    """
    begun = _ASIDE.pop(connection, None)
    if begun is not None and not begun.done():
        try:
            cancel()
        finally:
            with suppress(Exception):
                answer_of(begun)


def answer_of(future: Future[_T]) -> _T:
    """Return the result of a future, or raise what it raised, once it is there.

    `Future.result` waits in Python: what a signal handler raises between two of its steps may become
    ``RuntimeError: cannot release un-acquired lock``. A SimpleQueue waits in one step.
    """
    is_there = SimpleQueue[Future[_T]]()
    future.add_done_callback(is_there.put)
    return is_there.get().result()
