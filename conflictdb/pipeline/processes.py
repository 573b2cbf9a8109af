"""Work in several processes that never outlive whoever began them.

Whatever ends the work kills them at once; if the process that began them is killed itself, they notice and end too.
"""

import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, Final, TypeVar

Answer = TypeVar("Answer")

# What ends a command. Ctrl-C and service managers send it to all processes at once: the first one decides what to do.
_ENDS: Final = (signal.SIGINT, signal.SIGTERM)


def computed(
    work: Callable[..., Answer], jobs: Iterable[tuple[Any, ...]], count: int
) -> Generator[tuple[int, Answer], None, None]:
    """Yield the number of each job and what `work` answers to it, as they are done; close it to end early.

    work : function of a module; gets the members of a job
    jobs : taken one by one, when a process is free
    count : processes, fresh interpreters: forked ones would share the connections of this process

    Raises what `work` raises, with its traceback as a note, and ChildProcessError if a process was killed.
    """
    todo = enumerate(jobs)
    workers: list[_Worker] = []
    busy: dict[Any, tuple[_Worker, int]] = {}
    try:
        for _ in range(count):
            workers.append(_Worker())
        for worker, (number, job) in zip(workers, todo, strict=False):
            worker.begin(work, job)
            busy[worker.connection] = worker, number
        while busy:
            for connection in wait(list(busy)):
                worker, number = busy.pop(connection)
                answer = worker.answer()
                following = next(todo, None)
                if following is not None:
                    worker.begin(work, following[1])
                    busy[worker.connection] = worker, following[0]
                yield number, answer
    finally:
        for worker in workers:
            worker.end()


class _Worker:
    """A process and the way to talk to it."""

    def __init__(self) -> None:
        self.connection, theirs = multiprocessing.get_context("spawn").Pipe()
        self._process = _Process(target=_serve, args=(theirs,), daemon=True)
        try:
            self._process.start()
        finally:
            theirs.close()

    def begin(self, work: Callable[..., Any], job: tuple[Any, ...]) -> None:
        """Give it something to do."""
        with self._expected_alive():
            self.connection.send((work, job))

    def answer(self) -> Any:
        """Return the answer to the last job, when there is one."""
        with self._expected_alive():
            is_well, answer = self.connection.recv()
        if not is_well:
            raise answer
        return answer

    @contextmanager
    def _expected_alive(self) -> Iterator[None]:
        try:
            yield
        except (EOFError, ConnectionError):
            self._process.join()
            code = self._process.exitcode
            raise ChildProcessError(f"a process ended (code {code}): killed, out of memory? Use fewer jobs") from None

    def end(self) -> None:
        """Kill the process."""
        self.connection.close()
        self._process.kill()
        self._process.join()


class _Process(SpawnProcess):
    """A process that does not hear what ends a command, not even before its first instruction."""

    def start(self) -> None:
        resource_tracker.ensure_running()  # which would else begin below, and let the signals through
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDS)
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _serve(connection: "Connection[Any, Any]") -> None:
    """Answer jobs until the other end is closed."""
    # First of all: to receive the work means to import it, which takes seconds on a busy machine.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, ConnectionError):
        while True:
            work, job = connection.recv()
            try:
                answer = True, work(*job)
            except Exception as error:
                error.add_note(traceback.format_exc())
                answer = False, error
            connection.send(answer)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
