"""Guesses of the published programs for the start and end of contacts; the kernel certifies them.

Pairs in uniform motion go to the linear program, all others to the nonlinear one.
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
from conflictdb.core.published import linear_program, nonlinear_program
from conflictdb.core.published.encounters import Encounters
from conflictdb.core.stage4.effort import Programs
from conflictdb.earth.plane import Plane

_log = logging.getLogger(__name__)

# The number of threads of linear algebra belongs to the process. Two callers that limit it take turns, so that each
# restores the number that it found.
_LIMITED = threading.Lock()


@contextmanager
def reproducible() -> Iterator[None]:
    """Limit linear algebra to one thread: the last digits of programs depend on the number of threads."""
    with _LIMITED, threadpool_limits(1, user_api="blas"):
        yield


@dataclass(frozen=True, slots=True)
class Guesses:
    """Pairs of pieces with times counted from zero_us (n,), and the counts of program calls."""

    plane: Plane
    separation_m: float
    prepared: kernel.KernelScene
    pairs: Pairs
    zero_us: NDArray[np.int64]
    programs: Programs

    def extreme_contact(self, rows: NDArray[np.int64], k: int, low_s: float, high_s: float, is_last: bool) -> float:
        """Return a guess of the last (or first) contact of pair rows[k], seconds; NaN if the program finds none."""
        pair = rows[k : k + 1]
        one = Encounters.of(self.plane, self.separation_m, self.prepared, self.pairs, pair, self.zero_us[pair])
        is_uniform = bool(linear_program.is_uniform(one, np.array([low_s]), np.array([high_s]))[0])
        self.programs.lp_calls += is_uniform
        self.programs.nlp_calls += not is_uniform
        program = linear_program if is_uniform else nonlinear_program
        found = None
        try:
            found = program.extreme_contact(one, low_s, high_s, latest=is_last)
        except Warning:  # raised as errors on request
            raise
        except Exception as error:  # the kernel finds the contact without a guess
            _log.warning("a program failed on pair of pieces %d: %s: %s", pair[0], type(error).__name__, error)
        if found is None:
            self.programs.failed_calls += 1
            return float("nan")
        return found
