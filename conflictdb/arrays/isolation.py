"""Work on many rows at once, in which a row that fails does not stop the others.

Arrays are quick, but an exception in one of a million rows would lose them all. So a batch that fails is halved until
each row that fails stands alone. That row gets an answer that is safe for any row.
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

    work : must give each row the same result in any company
    what : the rows are, for the log
    """
    if not len(rows):
        return []
    try:
        return [(rows, work(rows))]
    except (Warning, KernelMissing, StoreError):  # warnings raised as errors, a lost database: no row's fault
        raise
    except Exception as error:  # whatever it is, one row must not stop the others
        if len(rows) == 1:
            _log.warning("%s %d is left unresolved: %s: %s", what, rows[0], type(error).__name__, error)
            _log.debug("because of", exc_info=error)
            return [(rows, safe(rows))]
    middle = len(rows) // 2
    return [*isolated(rows[:middle], work, safe, what), *isolated(rows[middle:], work, safe, what)]
