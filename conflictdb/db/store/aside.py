"""Work that another thread does meanwhile."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def begun_aside(work: Callable[[], T]) -> "Future[T]":
    """Begin work in a thread of its own, which ends with it; a program that ends waits for it."""
    thread = ThreadPoolExecutor(1)
    begun = thread.submit(work)
    thread.shutdown(wait=False)
    return begun
