"""A wait for another thread ends with the exception that interrupts it."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import pytest

from conflictdb.kernel.waiting import cancel_thread, run_in_thread, wait_for

# Thousands of interrupts, some microseconds after a wait began: none may become another exception. Of waits by
# Future.result itself, five in a thousand do. The signal repeats, since a signal just before the thread sleeps does not
# wake it; so this runs in a process of its own. Only the first signal of each round raises, so that no exception meets
# the handler of another.
INTERRUPTED = """
import signal
from concurrent.futures import Future
from conflictdb.kernel.waiting import wait_for

is_interrupted = False

def interrupt(*_):
    global is_interrupted
    if not is_interrupted:
        is_interrupted = True
        raise KeyboardInterrupt

signal.signal(signal.SIGALRM, interrupt)
others = []
for k in range(5_000):
    try:
        is_interrupted = False
        signal.setitimer(signal.ITIMER_REAL, 5e-6 + 2e-7 * (k % 200), 0.01)
        while True:
            future = Future()
            future.set_result(1)
            wait_for(future)
            wait_for(Future())
    except KeyboardInterrupt:
        pass
    except BaseException as error:
        others.append(error)
    signal.setitimer(signal.ITIMER_REAL, 0)
print(others)
"""


def test_what_another_thread_returns_or_raises_is_told() -> None:
    with ThreadPoolExecutor(1) as pool:
        assert wait_for(pool.submit(lambda: 3)) == 3
        with pytest.raises(ZeroDivisionError):
            wait_for(pool.submit(lambda: 1 // 0))


def test_work_of_another_thread_is_cancelled_and_waited_for() -> None:
    """It is cancelled once, its error is dropped, and a connection without such work is left alone."""

    class Connection:
        """Something that work is done with."""

    connection, is_cancelled, ended = Connection(), Event(), []

    def work() -> None:
        is_cancelled.wait(60.0)
        ended.append(True)
        raise ZeroDivisionError

    run_in_thread(connection, work)
    cancel_thread(connection, is_cancelled.set)
    assert ended == [True]
    is_cancelled.clear()
    cancel_thread(connection, is_cancelled.set)
    assert not is_cancelled.is_set()


def test_an_interrupt_while_it_waits_is_that_interrupt() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "[]\n", "")
