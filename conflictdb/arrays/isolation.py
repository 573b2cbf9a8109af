"""Process many rows at once, isolating rows that fail.

A batch that fails is halved until each failing row is alone, and that row gets a result that is safe for any
row.
"""

import logging
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import KernelMissing, StoreError

_log = logging.getLogger(__name__)

Rows = NDArray[np.int64]
T = TypeVar("T")


def isolated(rows: Rows, work: Callable[[Rows], T], safe: Callable[[Rows], T], what: str) -> list[tuple[Rows, T]]:
    """Return the results of `work` on parts of some rows, and those of `safe` for each row on which it fails.

    work : the result for a row must not depend on the other rows
    what : names the rows in the log
    """
    try:
        return [(rows, work(rows))] if len(rows) else []
    except Exception as error:
        return _halved(error, rows, work, safe, what)


def _halved(
    error: Exception, rows: Rows, work: Callable[[Rows], T], safe: Callable[[Rows], T], what: str
) -> list[tuple[Rows, T]]:
    """Return the results of both halves of rows on which work failed, or the safe one of a single row."""
    if isinstance(error, Warning | KernelMissing | StoreError):  # these concern the batch, not a row
        raise error
    # Any other error must not stop the other rows.
    if len(rows) == 1:
        _log.warning("%s %d is left unresolved: %s: %s", what, rows[0], type(error).__name__, error)
        _log.debug("because of", exc_info=error)
        return [(rows, safe(rows))]
    middle = len(rows) // 2
    return [*isolated(rows[:middle], work, safe, what), *isolated(rows[middle:], work, safe, what)]
