"""Work that another thread does meanwhile, and waiting for it so that an interrupt is told as what it is."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from queue import SimpleQueue
from typing import TypeVar

_T = TypeVar("_T")


def begun_aside(work: Callable[[], _T]) -> Future[_T]:
    """Begin work in a thread of its own, which ends with it; a program that ends waits for it."""
    thread = ThreadPoolExecutor(1)
    begun = thread.submit(work)
    thread.shutdown(wait=False)
    return begun


def answer_of(future: Future[_T]) -> _T:
    """Return the result of a future, or raise what it raised, once it is there.

    `Future.result` waits in Python: what a signal handler raises between two of its steps may become
    ``RuntimeError: cannot release un-acquired lock``. A SimpleQueue waits in one step.
    """
    is_there = SimpleQueue[Future[_T]]()
    future.add_done_callback(is_there.put)
    return is_there.get().result()
