"""Where the published programs say that contacts begin and end: the kernel asks, and proves what it is told.

A pair that moves evenly is given to the linear program, any other to the nonlinear one.
"""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from conflictdb import kernel
from conflictdb.arrays.pairs import Pairs
from conflictdb.motion.contract import Plane
from conflictdb.published import linear_program, nonlinear_program
from conflictdb.published.calls import Programs
from conflictdb.published.encounters import Encounters

_log = logging.getLogger(__name__)

# Threads of linear algebra are those of the whole process: of two that limit them one waits, so that each gives back
# what it found.
_LIMITED = threading.Lock()


@contextmanager
def reproducible() -> Iterator[None]:
    """Have programs do their linear algebra by one thread: their last digits follow the number of threads."""
    with _LIMITED, threadpool_limits(1, user_api="blas"):
        yield


@dataclass(frozen=True, slots=True)
class Guesses:
    """Pairs of pieces, in time counted from zero_us (n,), and what programs were called for them."""

    plane: Plane
    separation_m: float
    prepared: kernel.Scene
    pairs: Pairs
    zero_us: NDArray[np.int64]
    programs: Programs

    def extreme_contact(self, rows: NDArray[np.int64], k: int, low_s: float, high_s: float, is_last: bool) -> float:
        """Return where the last (or first) contact of pair rows[k] may be, seconds; NaN where a program finds none."""
        pair = rows[k : k + 1]
        one = Encounters.of(self.plane, self.separation_m, self.prepared, self.pairs, pair, self.zero_us[pair])
        is_uniform = bool(linear_program.is_uniform(one, np.array([low_s]), np.array([high_s]))[0])
        self.programs.lp_calls += is_uniform
        self.programs.nlp_calls += not is_uniform
        program = linear_program if is_uniform else nonlinear_program
        found = None
        try:
            found = program.extreme_contact(one, low_s, high_s, latest=is_last)
        except Warning:  # made an error by somebody who wants to see it
            raise
        except Exception as error:  # whatever it is, the kernel finds the contact without it
            _log.warning("a program failed on pair of pieces %d: %s: %s", pair[0], type(error).__name__, error)
        if found is None:
            self.programs.failed_calls += 1
            return float("nan")
        return found
