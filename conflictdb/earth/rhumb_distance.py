"""Bound the error of the kernel's distances on the earth between polygons whose edges are rhumb lines.

On the ellipsoid a distance is at most that along the great circle of the conformal sphere. It is shorter by the saving
of paths through smaller radii. `kernel/planes/mercator.c` computes the distances.
"""

from typing import Final

import numpy as np

from conflictdb.arrays import Floats
from conflictdb.earth.geodesy import Earth

# Constants of mercator.c. Up to NEARBY, plane radians, a fixed point finds the nearest place, with steps of this
# relative error. Beyond LONGEST, radians, only the least and the largest radius bound a path.
NEARBY: Final = 0.25
SOLVED_SHARE: Final = 2e-11
LONGEST: Final = 2.9


def error_m(earth: Earth, distance_m: Floats | float) -> Floats:
    """Return the largest excess of a true distance over the stated one: the computed one less `_overestimate_m`.

    Computed distances may be too short by the rule for the mean radius, and so belong to a longer one, by 1 % at most.
    A distance stated as `distance_m` may have been computed beyond `LONGEST`, and reduced by its whole saving.
    """
    longest = LONGEST * (1.0 - 1.01 * earth.oblateness)
    return 1.01 * (_overestimate_m(earth, distance_m, longest) + _rule_error_m(earth, distance_m))


def _overestimate_m(earth: Earth, distance_m: Floats | float, longest: float) -> Floats:
    """Return the largest excess of the computed distance over that of the shortest path.

    With c = ln(largest / least radius of the conformal sphere), also a bound on d ln radius / d latitude: to second
    order, a path through smaller radii saves c^2 (2 tan(theta / 2) - theta) / 2 radians; twice that is used. The
    nearest place by the mean radius differs, by less than the error of its rule. Beyond `longest` radians the saving is
    at most the ratio of the largest radius to the least.
    """
    c = earth.oblateness
    theta = np.asarray(distance_m / earth.polar_conformal_radius_m)
    short = np.minimum(theta, longest)
    saved = np.where(theta <= longest, c**2 * np.maximum(2.0 * np.tan(0.5 * short) - short, 0.0), 1.001 * c * theta)
    return np.asarray(earth.radius_m * saved + 2.0 * _rule_error_m(earth, distance_m) + SOLVED_SHARE * distance_m)


def _rule_error_m(earth: Earth, distance_m: Floats | float) -> Floats:
    """Return the error of Simpson's rule for the mean radius, c theta^5 / 360, within the range of its use (NEARBY)."""
    theta = np.asarray(distance_m / earth.polar_conformal_radius_m)
    return np.asarray(earth.radius_m * earth.oblateness / 360.0 * np.minimum(theta, NEARBY) ** 4 * theta)
