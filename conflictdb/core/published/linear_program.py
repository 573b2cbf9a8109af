"""Stage 4, linear program: the same question where both polygons move uniformly in the plane.

When every vertex of a polygon has one constant velocity (east-west legs, small or slow scenes, areas), the weights sum
to one and the velocity leaves the sum: sum p_i a_i(0) - sum q_j b_j(0) + (v_a - v_b) t = 0 is linear in (t, p, q).

Reference: Bienkowski, Sidoti, Pattipati, IEEE Access 2021, eq. 20.
"""

from typing import Final

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.core.published.encounters import Encounters
from conflictdb.kernel.movement import Movement

# A pair is given to the linear program if no vertex is further than this from uniform motion in its window, plane
# metres. The answer is a guess, refined on the true motion: this decides the cost, not the accuracy.
UNIFORM_M: Final = 1.0


def is_uniform(pairs: Encounters, start_s: Floats, end_s: Floats) -> NDArray[np.bool_]:
    """Return (n,) whether both polygons of each pair move uniformly during [start_s, end_s]."""
    if pairs.separation_m > 0.0:
        # A distance is a cone, not a plane.
        return np.zeros(len(start_s), np.bool_)
    return np.asarray(_deviation(pairs.a, start_s, end_s) + _deviation(pairs.b, start_s, end_s) <= UNIFORM_M)


def extreme_contact(pair: Encounters, start_s: float, end_s: float, *, latest: bool) -> float | None:
    """Return the first (or latest) instant in [start_s, end_s] at which the one uniform pair meets, seconds.

    None if there is none, or the solver does not find it.
    """
    t0, t1 = np.array([start_s]), np.array([end_s])
    a, b = pair.a.positions(t0)[..., 0].T, pair.b.positions(t0)[..., 0].T
    a_way, b_way = ((shape.positions(t1) - shape.positions(t0))[..., 0].mean(axis=1) for shape in (pair.a, pair.b))
    origin = a[0]
    size = max(float(np.ptp(np.concatenate([a, b]), axis=0).max()), 1.0)
    m, n = len(a), len(b)
    equal = np.zeros((4, 1 + m + n))
    equal[:2, 0] = (a_way - b_way) / size
    equal[:2, 1 : 1 + m] = (a - origin).T / size
    equal[:2, 1 + m :] = -(b - origin).T / size
    equal[2, 1 : 1 + m] = equal[3, 1 + m :] = 1.0
    cost = np.zeros(1 + m + n)
    cost[0] = -1.0 if latest else 1.0
    result = scipy.optimize.linprog(cost, A_eq=equal, b_eq=[0.0, 0.0, 1.0, 1.0], bounds=(0.0, 1.0), method="highs")
    if not result.success:
        return None
    return start_s + float(np.clip(result.x[0], 0.0, 1.0)) * (end_s - start_s)


def _deviation(shapes: Movement, start_s: Floats, end_s: Floats) -> Floats:
    """Return (n,) a bound on how far any vertex leaves uniform motion, plane metres."""
    way = shapes.positions(end_s) - shapes.positions(start_s)
    spread = way - way.mean(axis=1, keepdims=True)
    chord = shapes.bounds(start_s, end_s).acceleration * (end_s - start_s) ** 2 / 8.0
    return np.asarray(np.hypot(spread[0], spread[1]).max(axis=0) + chord)
