"""A wait for another thread ends with the exception that interrupts it."""

import os
import signal
import subprocess
import sys
import time
from threading import Event

import pytest
from patience import WAIT_S

from conflictdb.kernel.library import shared
from conflictdb.kernel.waiting import ThreadWork, cancel_thread, run_in_thread

# A program starts threads and interrupts itself some microseconds later, 5,000 times. Each interrupt must stay that
# interrupt, and each wait must end. Threads and futures of the standard library raise another exception in three of
# 1,000 rounds. A signal just before the thread sleeps does not wake it. So the signal repeats, and this program is a
# process of its own. Only the first signal of a round raises: another one would interrupt the handler of the first.
INTERRUPTED = """
import signal
from threading import Event
from conflictdb.kernel.waiting import ThreadWork

is_interrupted = False

def interrupt(*_):
    global is_interrupted
    if not is_interrupted:
        is_interrupted = True
        raise KeyboardInterrupt

signal.signal(signal.SIGALRM, interrupt)
is_over = Event()
others = []
for k in range(5_000):
    try:
        is_interrupted = False
        signal.setitimer(signal.ITIMER_REAL, 5e-6 + 2e-7 * (k % 200), 0.01)
        for _ in range(20):
            ThreadWork(int).result()
        ThreadWork(is_over.wait).result()
    except KeyboardInterrupt:
        pass
    except BaseException as error:
        others.append(error)
    signal.setitimer(signal.ITIMER_REAL, 0)
    is_over.set()
    is_over = Event()
print(others)
"""


def test_a_result_or_an_error_of_another_thread_is_passed_on() -> None:
    three, failing = ThreadWork(lambda: 3), ThreadWork(lambda: 1 // 0)
    assert [three.result(), three.result()] == [3, 3]
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            failing.result()


def test_work_of_another_thread_is_cancelled_and_waited_for() -> None:
    """It is cancelled once, its error is dropped, and a connection without such work is left alone."""

    class Connection:
        """Something that work is done with."""

    connection, is_cancelled, ended = Connection(), Event(), []

    def work() -> None:
        is_cancelled.wait(WAIT_S)
        ended.append(True)
        raise ZeroDivisionError

    run_in_thread(connection, work)
    cancel_thread(connection, is_cancelled.set)
    assert ended == [True]
    is_cancelled.clear()
    cancel_thread(connection, is_cancelled.set)
    assert not is_cancelled.is_set()


def test_an_interrupt_while_it_waits_is_that_interrupt() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=WAIT_S)
    assert (done.returncode, done.stdout, done.stderr) == (0, "[]\n", "")


def test_an_interrupt_of_several_threads_skips_slices_that_are_not_begun() -> None:
    """It waits for the others: no thread runs afterwards."""
    solved: list[slice] = []

    def solve(rows: slice) -> None:
        time.sleep(0.01)
        solved.append(rows)
        if len(solved) == 10:
            os.kill(os.getpid(), signal.SIGALRM)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            shared(solve, 2000, 2, share=1)
    finally:
        signal.signal(signal.SIGALRM, before)
    count = len(solved)
    assert count < 1000
    time.sleep(0.05)
    assert len(solved) == count
