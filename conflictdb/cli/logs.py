"""Log to stderr while a command runs."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from conflictdb.errors import printable


class Formatter(logging.Formatter):
    """Log records as lines with control characters escaped."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a record as text; a traceback keeps its lines."""
        return printable(super().format(record), keep="\n")


@contextmanager
def logged(debug: bool) -> Iterator[None]:
    """Log everything to stderr with `debug`; restore logging afterwards for callers of `main`."""
    if not debug:
        if not (driver := logging.getLogger("psycopg")).handlers:
            # The driver's warnings about a failed rollback after Ctrl-C are noise: the error itself is reported.
            driver.addHandler(logging.NullHandler())
        yield
        return
    root = logging.getLogger()
    level = root.level
    handler = logging.StreamHandler()
    handler.setFormatter(Formatter("%(asctime)s %(name)s: %(message)s"))
    root.addHandler(handler)
    root.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        root.setLevel(level)
        root.removeHandler(handler)
