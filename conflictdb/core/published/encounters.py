"""The input of the published programs: pairs of moving polygons with a common clock and origin."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pairs import Pairs
from conflictdb.earth.plane import Plane, origins
from conflictdb.kernel.movement import Movement


@dataclass(frozen=True, slots=True)
class Encounters:
    """n pairs of polygons with a common time zero and origin, and the required separation, metres.

    origin : (2, n) plane metres
    """

    plane: Plane
    a: Movement
    b: Movement
    origin: Floats
    separation_m: float

    @classmethod
    def of(
        cls,
        plane: Plane,
        separation_m: float,
        prepared: kernel.KernelScene,
        pairs: Pairs,
        rows: NDArray[np.int64],
        zero_us: NDArray[np.int64],
    ) -> "Encounters":
        """Return the encounters of some pairs; row i counts its time from zero_us[i]."""
        origin = origins(plane, prepared.pieces, pairs.a[rows])
        a, b = (Movement.of(prepared, member[rows], zero_us, origin) for member in (pairs.a, pairs.b))
        return cls(plane, a, b, origin, separation_m)
