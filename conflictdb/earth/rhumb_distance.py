"""How well distances on the earth between polygons with rhumb lines for edges are known, as the kernel finds them.

On the ellipsoid a distance is at most that along the great circle of the conformal sphere. It is less by what another
way saves that runs through smaller radii. `kernel/mercator.c` has how distances are found.
"""

from typing import Final

import numpy as np

from conflictdb.earth.geodesy import Earth, Floats

# As mercator.c has them: up to how many radians of the plane what is near is found by a fixed point; what its steps
# leave of a distance; and from where on, radians, only the least and the largest radius bound a way.
NEARBY: Final = 0.25
SOLVED_SHARE: Final = 2e-11
LONGEST: Final = 2.9


def error_m(earth: Earth, distance_m: Floats | float) -> Floats:
    """Return by how much a true distance may exceed the one stated: that found less `_overestimate_m`.

    Distances found may be too short by the rule for the mean radius, and so be that of a longer one, by 1 % at most;
    and what is stated as so far may have been found further than `LONGEST`, and lessened by all that saves.
    """
    longest = LONGEST * (1.0 - 1.01 * earth.oblateness)
    return 1.01 * (_overestimate_m(earth, distance_m, longest) + _rule_error_m(earth, distance_m))


def _overestimate_m(earth: Earth, distance_m: Floats | float, longest: float) -> Floats:
    """Return by how much the distance found may exceed that of the shortest way.

    With c = ln(largest / least radius of the conformal sphere), which is also the largest d ln radius / d latitude: to
    second order, a way through smaller radii saves c^2 (2 tan(theta / 2) - theta) / 2 radians; twice that is taken. The
    nearest place by the mean radius is another, by less than its rule is wrong. Beyond so many radians no more is saved
    than the largest radius is larger than the least.
    """
    c = earth.oblateness
    theta = np.asarray(distance_m / earth.polar_conformal_radius_m)
    short = np.minimum(theta, longest)
    saved = np.where(theta <= longest, c**2 * np.maximum(2.0 * np.tan(0.5 * short) - short, 0.0), 1.001 * c * theta)
    return np.asarray(earth.radius_m * saved + 2.0 * _rule_error_m(earth, distance_m) + SOLVED_SHARE * distance_m)


def _rule_error_m(earth: Earth, distance_m: Floats | float) -> Floats:
    """Return by how much Simpson's rule for the mean radius is wrong, c theta^5 / 360, where it is used (nearby)."""
    theta = np.asarray(distance_m / earth.polar_conformal_radius_m)
    return np.asarray(earth.radius_m * earth.oblateness / 360.0 * np.minimum(theta, NEARBY) ** 4 * theta)
