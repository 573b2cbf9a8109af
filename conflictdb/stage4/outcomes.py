"""What a solver of stage 4 says of many pairs: how it ended with each, and the contact that it found."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats


class Outcome(IntEnum):
    """How a solver ended with a pair."""

    UNDECIDED = 0  # nothing is proven
    SEPARATED = 1  # proven further apart than asked, throughout
    CONTACT = 2  # proven nearer than asked


@dataclass(frozen=True, slots=True)
class Solution:
    """What is known of n pairs during the time they were asked about.

    outcome : (n,) int8, `Outcome`
    start_s, end_s : (n,) seconds; where the outcome is CONTACT the one contact lies between them
    error_s : (n,) seconds by which the contact may begin later, or end earlier
    """

    outcome: NDArray[np.int8]
    start_s: Floats
    end_s: Floats
    error_s: Floats

    @classmethod
    def undecided(cls, start_s: Floats, end_s: Floats) -> Self:
        """Return that nothing is known."""
        return cls(np.zeros(len(start_s), np.int8), start_s.copy(), end_s.copy(), np.zeros(len(start_s)))

    def ended(self, outcome: Outcome) -> NDArray[np.bool_]:
        """Return (n,) where the solver ended in this way."""
        return self.outcome == outcome
