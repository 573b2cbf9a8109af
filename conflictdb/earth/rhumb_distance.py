"""The least distance on the earth between convex polygons whose edges are rhumb lines, at any distance.

For two points z = dlon + i dpsi apart in the Mercator plane, the great circle of the conformal sphere has the length
theta with sin^2(theta / 2) = |sin(z / 2)|^2 sech psi1 sech psi2. So ln sin^2(theta / 2) is a harmonic function of z,
minus ln cosh psi1 and ln cosh psi2. Two things follow.

*The least distance is that of a vertex from an edge.* Along two edges with directions a and b its second derivatives
are X - s1, Y - s2 and -Z, with X Y - Z^2 = -m^2 sin^2(angle between a and b) and s1, s2 >= 0 the share of ln cosh. If
X - s1 and Y - s2 are positive, the determinant is negative: no pair of places inside both edges is a minimum. On the
ellipsoid the radius of the conformal sphere changes s1, s2 and Z by less than 3 % of s1 and s2, which leaves it so.

*The nearest place on an edge* is where the derivative of the harmonic function equals that of ln cosh psi. For short
distances it is found as a fixed point, for any distance by branch and bound.

On the ellipsoid a distance is at most theta times the mean radius along the great circle. It is less by what another
way saves that runs through smaller radii: at most `overestimate_m`.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Earth, Floats, Sides, least_on_chord

# In the plane, radians: what is nearer than this is found by the fixed point.
NEARBY: Final = 0.25
# Its steps leave (0.68 z^2)^2 each of z^2 / 8 of the distance, less than 1e-13 of it with z up to NEARBY; the series
# that it takes, z^8 / 1e6 or less than this share. Bounds are brought as near to each other.
SOLVED_SHARE: Final = 2e-11
STEPS: Final = 4
# Of longer ways, radians, only the least and the largest radius give a bound: places opposite each other have several
# shortest ways.
LONGEST: Final = 2.9
# Halvings of an edge; 60 are beyond what numbers can tell apart.
MAX_HALVINGS: Final = 60
# What numpy holds at once when distances between all vertices and edges are taken, numbers.
BLOCK_NUMBERS: Final = 500_000

# Gauss and Legendre's rule for the mean radius along a way.
_NODES, _WEIGHTS = (values.tolist() for values in np.polynomial.legendre.leggauss(6))


def error_m(earth: Earth, distance_m: Floats | float) -> Floats:
    """Return by how much a true distance may exceed the one found less `overestimate_m`.

    Distances found may be too short by the rule for the mean radius, and so be that of a longer one, by 1 % at most.
    """
    return 1.01 * (overestimate_m(earth, distance_m) + _rule_error_m(earth, distance_m))


def overestimate_m(earth: Earth, distance_m: Floats | float) -> Floats:
    """Return by how much the distance found may exceed that of the shortest way.

    With c = ln(largest / least radius of the conformal sphere), which is also the largest d ln radius / d latitude: to
    second order, a way through smaller radii saves c^2 (2 tan(theta / 2) - theta) / 2 radians; twice that is taken. The
    nearest place by the mean radius is another, by less than its rule is wrong.
    """
    c = earth.oblateness
    theta = np.asarray(distance_m / earth.polar_conformal_radius_m)
    short = np.minimum(theta, LONGEST)
    saved = np.where(theta <= LONGEST, c**2 * np.maximum(2.0 * np.tan(0.5 * short) - short, 0.0), 1.001 * c * theta)
    return np.asarray(earth.radius_m * saved + 2.0 * _rule_error_m(earth, distance_m) + SOLVED_SHARE * distance_m)


def _rule_error_m(earth: Earth, distance_m: Floats | float) -> Floats:
    """Return by how much Simpson's rule for the mean radius is wrong, c theta^5 / 360, where it is used (nearby)."""
    theta = np.asarray(distance_m / earth.polar_conformal_radius_m)
    return np.asarray(earth.radius_m * earth.oblateness / 360.0 * np.minimum(theta, NEARBY) ** 4 * theta)


def nearby_m(earth: Earth, points: Floats, polygon: Floats, sides: Sides) -> Floats:
    """Return (n,) the least distance of vertices from sides of a polygon, where it is less than NEARBY in the plane.

    Elsewhere it is too much. points, polygon : (2, v, n) and (2, w, n) radians of longitude and psi
    """
    start = polygon[:, None, sides[0]]
    edge = polygon[:, None, sides[1]] - start
    length = np.hypot(edge[0], edge[1])
    unit = edge / np.where(length > 0.0, length, 1.0)
    way = points[:, :, None, :] - start
    foot = way[0] * unit[0] + way[1] * unit[1]
    off = way[0] * unit[1] - way[1] * unit[0]
    # z / 6 along the edge, and how the radius of the conformal sphere shrinks.
    slope = (unit[0] ** 2 - unit[1] ** 2) / 6.0
    level = (unit[0] * way[0] - unit[1] * way[1]) / 6.0
    shrinks = 2.0 * earth.oblateness
    square_off = off**2
    along = np.clip(foot, 0.0, length)
    for _ in range(STEPS):
        square = square_off + (along - foot) ** 2
        sine = np.tanh(start[1] + along * unit[1])
        pull = unit[1] * sine * (1.0 + shrinks - shrinks * sine * sine) + slope * along - level
        along = np.clip(foot + 0.5 * square * pull, 0.0, length)
    psi, psi_foot = np.broadcast_arrays(points[1][:, None, :], start[1] + along * unit[1])
    lon_apart = way[0] - along * unit[0]
    psi_apart = way[1] - along * unit[1]
    half = np.sqrt(np.sin(0.5 * lon_apart) ** 2 + np.sinh(0.5 * psi_apart) ** 2)
    half = np.minimum(half / np.sqrt(np.cosh(psi) * np.cosh(psi_foot)), 1.0)
    angle = 2.0 * np.arcsin(half)
    if not earth.oblateness:
        return np.asarray(earth.radius_m * angle.min(axis=(0, 1)))
    # Simpson's rule for the radius along the great circle, whose middle has this latitude.
    with np.errstate(divide="ignore", invalid="ignore"):  # of places opposite each other, which are too far anyway
        middle = np.arctanh(0.5 * (np.tanh(psi) + np.tanh(psi_foot)) / np.sqrt(1.0 - half**2))
    radius = earth.conformal_radius_m
    mean = (radius(psi) + 4.0 * radius(np.where(np.isfinite(middle), middle, 0.0)) + radius(psi_foot)) / 6.0
    return np.asarray((mean * angle).min(axis=(0, 1)))


def anywhere_m(earth: Earth, a: Floats, b: Floats, sides_a: Sides, sides_b: Sides) -> Floats:
    """Return (n,) the least distance between the vertices of polygons and the sides of others, however far they are.

    By branch and bound on the sides. Along a part of a side that is w long in the plane, the distance is at least its
    chord less M w^2 / 8, M a bound on its second derivative (`_least_between`).

    a, b : (2, v, n) and (2, w, n) radians of longitude and psi
    """
    n = a.shape[2]
    parts = [_combined(earth, a, b, sides_b), _combined(earth, b, a, sides_a)]
    row, point, start, step, first, last = (np.concatenate(column, axis=-1) for column in zip(*parts, strict=True))
    low, high = np.zeros(len(row)), np.ones(len(row))
    best, floor = np.full(n, np.inf), np.full(n, np.inf)
    np.minimum.at(best, row, np.minimum(first, last))
    for halving in range(MAX_HALVINGS + 1):
        bound = _least_between(earth, start, step, low, high, first, last)
        split = (bound < best[row] * (1.0 - SOLVED_SHARE)) & (halving < MAX_HALVINGS)
        np.minimum.at(floor, row[~split], bound[~split])
        if not split.any():
            break
        row, low, high, first, last = row[split], low[split], high[split], first[split], last[split]
        point, start, step = point[:, split], start[:, split], step[:, split]
        middle = 0.5 * (low + high)
        place = start + middle * step
        found = _way_m(earth, place[0] - point[0], point[1], place[1])
        np.minimum.at(best, row, found)
        row, low, high = np.tile(row, 2), np.concatenate([low, middle]), np.concatenate([middle, high])
        first, last = np.concatenate([first, found]), np.concatenate([found, last])
        point, start, step = (np.tile(xy, 2) for xy in (point, start, step))
    return np.minimum(floor, best)


def _combined(
    earth: Earth, points: Floats, polygon: Floats, sides: Sides
) -> tuple[NDArray[np.int64], Floats, Floats, Floats, Floats, Floats]:
    """Return every vertex with every side (m,): the row, vertex, start and step (2, m), distances from both ends."""
    way = polygon[:, None] - points[:, :, None]
    distance = _way_m(earth, way[0], np.broadcast_to(points[1][:, None], way[0].shape), polygon[1][None])
    shape = (2, points.shape[1], len(sides[0]), points.shape[2])
    start, end = (np.broadcast_to(polygon[:, None, side], shape).reshape(2, -1) for side in sides)
    point = np.broadcast_to(points[:, :, None], shape).reshape(2, -1)
    row = np.broadcast_to(np.arange(points.shape[2]), shape[1:]).reshape(-1)
    first, last = (distance[:, side].reshape(-1) for side in sides)
    return row, point, start, end - start, first, last


def _way_m(earth: Earth, lon_apart: Floats, psi1: Floats, psi2: Floats) -> Floats:
    """Return the length of great circles of the conformal sphere on the earth: at least that of the shortest way."""
    # Each with its own digits: on the other side of the earth those of a cosine are lost in a sine.
    sine2 = np.sin(0.5 * lon_apart) ** 2 + np.sinh(0.5 * (psi2 - psi1)) ** 2
    cosine2 = np.cos(0.5 * lon_apart) ** 2 + np.sinh(0.5 * (psi1 + psi2)) ** 2
    theta = 2.0 * np.arctan2(np.sqrt(sine2), np.sqrt(cosine2))
    if not earth.oblateness:
        return np.asarray(earth.radius_m * theta)
    sine1, sine2 = np.tanh(psi1), np.tanh(psi2)
    whole = np.sin(theta)
    mean = np.zeros_like(theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            part = 0.5 + 0.5 * node
            sine = (np.sin((1.0 - part) * theta) * sine1 + np.sin(part * theta) * sine2) / whole
            mean += 0.5 * weight * earth.conformal_radius_of(np.minimum(sine * sine, 1.0))
    mean = np.where((theta > LONGEST) | ~(whole > 0.0), earth.radius_m, mean)
    return np.asarray(mean * theta)


def _least_between(
    earth: Earth, start: Floats, step: Floats, low: Floats, high: Floats, first: Floats, last: Floats
) -> Floats:
    """Return (m,) what the distance from a vertex is nowhere below on parts of sides, metres.

    first, last : (m,) the distances at their ends

    A radian of the plane is at most v metres. Along a straight line of the plane the distance D from a point has
    D'' <= v^2 / D + v tanh(psi): the first term by comparison with the flat plane, as the earth's curvature is not
    negative; the second since the line itself curves on the earth.
    """
    psi0, psi1 = start[1] + low * step[1], start[1] + high * step[1]
    least = np.where(psi0 * psi1 > 0.0, np.minimum(np.abs(psi0), np.abs(psi1)), 0.0)
    v = earth.radius_m / np.cosh(least)
    width = np.hypot(step[0], step[1]) * (high - low)
    nearest = 0.5 * (first + last - width * v)
    # The distances given are not quite those of the shortest ways.
    safe = 0.99 * np.where(nearest > 0.0, nearest, 1.0)
    second = v * v / safe + 1.01 * v * np.tanh(np.maximum(np.abs(psi0), np.abs(psi1)))
    between = least_on_chord(first, last, second * width**2 / 8.0)
    return np.maximum(np.where(nearest > 0.0, np.maximum(between, nearest), 0.0), 0.0)
