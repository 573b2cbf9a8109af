"""Show the progress of phases that last, with an estimate where their size is known; on a terminal only."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from threading import Event, Thread
from typing import Final

from conflictdb.cli.output import progress

_AFTER_S: Final = 2.0
_EVERY_S: Final = 0.5
# An estimate from less than this share of the work is a guess.
_LEAST_SHARE: Final = 0.02


@contextmanager
def shown_phases(sizes: Mapping[str, int] | None = None) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function to call with the name of a phase, and the amounts done and to do; 0: see `sizes`, else unknown.

    A phase that lasts longer than 2 s is shown, and again every half a second, until the context ends.
    """
    known = sizes or {}
    now = ("", 0, 0)
    began_s = time.monotonic()

    def phase(name: str, done: int, of: int) -> None:
        nonlocal now, began_s
        if name != now[0]:
            began_s = time.monotonic()
        now = (name, done, of or known.get(name, 0))

    def show() -> None:
        while not ended.wait(_EVERY_S):
            elapsed_s = time.monotonic() - began_s
            progress(phase_text(*now, elapsed_s) if now[0] and elapsed_s >= _AFTER_S else "")

    ended = Event()
    if not sys.stderr.isatty():
        yield phase
        return
    showing = Thread(target=show, daemon=True, name="progress")
    showing.start()
    try:
        yield phase
    finally:
        ended.set()
        showing.join()
        progress("")


def phase_text(name: str, done: int, of: int, elapsed_s: float) -> str:
    """Return a phase with its amounts, and how long it will last, or has lasted."""
    counts = f": {done:,} of {of:,}" if of else f": {done:,}" if done else ""
    if of and done >= _LEAST_SHARE * of:
        left_s = max(elapsed_s * (of - done) / done, 0.0)
        return f"{name}{counts}, about {_duration(left_s)} left"
    return f"{name}{counts}, {_duration(elapsed_s)} so far"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
