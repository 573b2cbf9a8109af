"""Show the progress of phases that last, with an estimate where their size is known; on a terminal only."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from threading import Event, Thread
from typing import Final

from conflictdb.cli.output import progress

# An estimate from less than this share of the work is a guess.
_LEAST_SHARE: Final = 0.02


@contextmanager
def shown(text: Callable[[], str], every_s: float) -> Iterator[None]:
    """Show a text on one line of the terminal, again and again until the context ends; an empty one removes the line.

    text : called by another thread
    """
    if not sys.stderr.isatty():
        yield
        return
    ended = Event()

    def show() -> None:
        while not ended.wait(every_s):
            progress(text())

    thread = Thread(target=show, daemon=True, name="progress")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        progress("")


@contextmanager
def shown_phases(
    sizes: Mapping[str, int] | None = None, *, after_s: float = 2.0, every_s: float = 0.5
) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function to call with the name of a phase, and the amounts done and to do; 0: see `sizes`, else unknown.

    A phase that lasts longer than `after_s` is shown, and again every `every_s` seconds, until the context ends.
    """
    known = sizes or {}
    now = ("", 0, 0)
    began_s = time.monotonic()

    def phase(name: str, done: int, of: int) -> None:
        nonlocal now, began_s
        if name != now[0]:
            began_s = time.monotonic()
        now = (name, done, of or known.get(name, 0))

    def text() -> str:
        elapsed_s = time.monotonic() - began_s
        return phase_text(*now, elapsed_s) if now[0] and elapsed_s >= after_s else ""

    with shown(text, every_s):
        yield phase


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
