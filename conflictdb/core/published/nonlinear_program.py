"""Stage 4, nonlinear program: the first and the last instant at which two polygons share a point.

Minimise (or maximise) t over t, convex weights p of one polygon's vertices and q of the other's, such that
sum p_i a_i(t) = sum q_j b_j(t): the two weighted means are one point that lies in both. Solved by sequential quadratic
programming with analytic gradients, in units scaled to one.

A local method may miss the first contact, so its answer is only a guess: the kernel proves that there is no
contact outside of it.

Reference: Bienkowski, Sidoti, Pattipati, IEEE Access 2021, eqs. 14-19. D. Kraft, "A software package for sequential
quadratic programming", DFVLR-FB 88-28 (1988), as scipy's SLSQP.
"""

import functools
from typing import Final

import numpy as np
import scipy.optimize

from conflictdb.arrays import Floats
from conflictdb.core.published.encounters import Encounters

# Fractions of the window from which the solver starts, in order, until one start succeeds.
STARTS: Final = (0.5, 0.1, 0.9)
# Violation of the constraints, as a share of the polygons' size, with which an answer still counts.
ACCURACY: Final = 1e-9
MAX_ITERATIONS: Final = 100


def extreme_contact(pair: Encounters, start_s: float, end_s: float, *, latest: bool) -> float | None:
    """Return the first (or latest) instant in [start_s, end_s] at which the one pair is as close as wanted, seconds.

    None if the solver finds none from any start: which proves nothing.
    """
    width = end_s - start_s
    m, n = pair.a.slots, pair.b.slots
    wanted = _wanted(pair, 0.5 * (start_s + end_s))

    @functools.lru_cache(maxsize=8)  # constraint and gradient ask for the same instant
    def vertices(fraction: float) -> tuple[Floats, Floats]:
        t = np.array([start_s + fraction * width])
        return pair.a.positions(t)[..., 0].T, pair.b.positions(t)[..., 0].T

    at_start = vertices(0.5)
    origin = at_start[0][0]
    size = max(float(np.ptp(np.concatenate(at_start), axis=0).max()), wanted, 1.0)

    def apart(z: Floats) -> Floats:
        a, b = vertices(float(z[0]))
        return np.asarray((z[1 : 1 + m] @ (a - origin) - z[1 + m :] @ (b - origin)) / size)

    def apart_gradient(z: Floats) -> Floats:
        t = np.array([start_s + float(z[0]) * width])
        a, b = vertices(float(z[0]))
        moving = z[1 : 1 + m] @ pair.a.velocities(t)[..., 0].T - z[1 + m :] @ pair.b.velocities(t)[..., 0].T
        return np.concatenate([(moving * width)[:, None], (a - origin).T, -(b - origin).T], axis=1) / size

    ones = np.zeros((2, 1 + m + n))
    ones[0, 1 : 1 + m] = ones[1, 1 + m :] = 1.0
    constraints: list[dict[str, object]] = [
        {"type": "eq", "fun": lambda z: ones @ z - 1.0, "jac": lambda z: ones},
    ]
    if wanted > 0.0:
        reach = (wanted / size) ** 2
        constraints.append(
            {
                "type": "ineq",
                "fun": lambda z: np.array([reach - apart(z) @ apart(z)]),
                "jac": lambda z: -2.0 * (apart(z) @ apart_gradient(z))[None, :],
            }
        )
    else:
        constraints.append({"type": "eq", "fun": apart, "jac": apart_gradient})

    sign = -1.0 if latest else 1.0
    gradient = np.zeros(1 + m + n)
    gradient[0] = sign
    for fraction in STARTS:
        guess = np.concatenate([[fraction], np.full(m, 1.0 / m), np.full(n, 1.0 / n)])
        result = scipy.optimize.minimize(
            lambda z: sign * z[0],
            guess,
            jac=lambda z: gradient,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * (1 + m + n),
            constraints=constraints,
            options={"maxiter": MAX_ITERATIONS, "ftol": ACCURACY},
        )
        if result.success and np.isfinite(result.x).all():
            return start_s + float(np.clip(result.x[0], 0.0, 1.0)) * width
    return None


def _wanted(pair: Encounters, t: float) -> float:
    """Return the separation wanted in plane metres, where vertices of the pair are nearest at time t."""
    if pair.separation_m == 0.0:
        return 0.0
    a, b = (shape.positions(np.array([t]))[..., 0] for shape in (pair.a, pair.b))
    way = b[:, None, :] - a[:, :, None]
    i, j = np.unravel_index(np.hypot(way[0], way[1]).argmin(), way.shape[1:])
    middle = 0.5 * (a[:, i] + b[:, j]) + pair.origin[:, 0]
    return float(pair.separation_m * pair.plane.smallest_scale(middle[:, None, None])[0])
