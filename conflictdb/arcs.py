"""How near points on the sphere are to arcs of great circles, from their coordinates in a gnomonic plane.

A place (x, y) of the plane is in the direction (x, y, 1) from the middle of a sphere of radius 1. Everything is written
in differences of plane coordinates, so that nothing cancels however near the places are: the cross product of two such
vectors is (dy, -dx, x dy - y dx), and the triple product of three twice the area between them in the plane.
"""

import numpy as np
from numpy.typing import NDArray

from conflictdb.geodesy import Floats


def least_chord(points: Floats, polygon: Floats) -> Floats:
    """Return (n,) the least chord from points (2, p, n) to the edges of polygons (2, e, n), all in radii.

    Coordinates are those of the gnomonic plane; less than half a sphere lies in it.
    """
    edge = np.roll(polygon, -1, axis=1) - polygon
    to_point = points[:, :, None, :] - polygon[:, None, :, :]  # (2, p, e, n)
    to_next = to_point - edge[:, None]
    square = 1.0 + (polygon**2).sum(axis=0)  # (e, n)
    point_square = (1.0 + (points**2).sum(axis=0))[:, None]  # (p, 1, n)
    from_vertex = _sine2(polygon[:, None], to_point) / (square * point_square)
    # Within the edge: in front of either end, by the metric there.
    inside = (_metric(polygon[:, None], square, to_point, edge[:, None]) > 0.0) & (
        _metric(np.roll(polygon, -1, axis=1)[:, None], np.roll(square, -1, axis=0), to_next, -edge[:, None]) > 0.0
    )
    area = edge[0] * to_point[1] - edge[1] * to_point[0]
    normal = _sine2(polygon, edge)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_edge = area**2 / (normal * point_square)
    # Of the squared sine to the squared chord, 2 - 2 cos; polygons lie within 60 degrees of the centre, so that two
    # points may be more than a quarter turn apart: their cosine tells.
    dot = 1.0 + polygon[0] * points[0][:, None] + polygon[1] * points[1][:, None]
    chord = _chord2(from_vertex, dot < 0.0)
    return np.sqrt(np.where(inside, np.minimum(_chord2(to_edge, np.zeros(1, np.bool_)), chord), chord).min(axis=(0, 1)))


def _sine2(base: Floats, step: Floats) -> Floats:
    """Return the squared length of (base, 1) x (base + step, 1)."""
    return np.asarray(step[0] ** 2 + step[1] ** 2 + (base[0] * step[1] - base[1] * step[0]) ** 2)


def _metric(base: Floats, square: Floats, one: Floats, other: Floats) -> Floats:
    """Return the scalar product of two steps in the plane, as the sphere has it at their base."""
    return np.asarray(
        square * (one[0] * other[0] + one[1] * other[1])
        - (base[0] * one[0] + base[1] * one[1]) * (base[0] * other[0] + base[1] * other[1])
    )


def _chord2(sine2: Floats, obtuse: NDArray[np.bool_]) -> Floats:
    """Return the squared chord of angles whose squared sine is given: 2 - 2 cos, without cancellation."""
    cosine = np.sqrt(np.maximum(1.0 - sine2, 0.0))
    return np.where(obtuse, 2.0 + 2.0 * cosine, 2.0 * sine2 / (1.0 + cosine))
