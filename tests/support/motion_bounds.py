"""How tight the bounds of a motion are, against samples of it."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.kernel.movement import Movement

LASTS_S: Final = 36000.0
_SAMPLES: Final = 65


def tightness(one: Movement) -> tuple[tuple[float, ...], NDArray[np.float64], Any]:
    """Return the ratio of each bound of one motion of LASTS_S to its exact value, the places, and the bounds.

    In the order of acceleration, deviation (from the chords of vertices, as the reference point goes) and spread.
    """
    seconds = np.linspace(0.0, LASTS_S, _SAMPLES)
    shapes = one.take(np.zeros(_SAMPLES, np.int64))
    at, velocity, reference = shapes.positions(seconds), shapes.velocities(seconds), shapes.reference(seconds)
    acceleration = np.hypot(*np.gradient(velocity, seconds[1], axis=2))[:, 2:-2].max()
    offset, moved = at - reference[:, None, :], np.hypot(*(reference - reference[:, :1]))
    gone = moved / moved[-1] if moved[-1] > 1.0 else seconds / LASTS_S
    deviation = np.hypot(*(offset - (1 - gone) * offset[..., :1] - gone * offset[..., -1:])).max()
    bounds = one.bounds(np.zeros(1), np.full(1, LASTS_S))
    spread = np.hypot(*(velocity - bounds.velocity[:, None, :])).max()
    pairs = (bounds.acceleration, acceleration), (bounds.deviation, deviation), (bounds.spread, spread)
    return tuple(float(bound[0]) / true for bound, true in pairs), at, bounds
