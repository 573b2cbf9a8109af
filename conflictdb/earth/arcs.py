"""How near points on the sphere are to arcs of great circles, from their coordinates in a gnomonic plane.

A place (x, y) of the plane is in the direction (x, y, 1) from the middle of a sphere of radius 1. All formulas use
differences of plane coordinates, so that no digits cancel for near places. The cross product of two such vectors is
(dy, -dx, x dy - y dx). The triple product of three is twice the area between them in the plane.
"""

import numpy as np

from conflictdb.earth.geodesy import Floats, Sides


def least_chord(points: Floats, polygon: Floats, sides: Sides) -> Floats:
    """Return (n,) the least chord from points (2, p, n) to the sides of polygons (2, v, n), all in radii.

    Coordinates are those of the gnomonic plane; less than half a sphere lies in it.
    """
    start, end = (polygon[:, side] for side in sides)
    edge = end - start
    to_point = points[:, :, None, :] - start[:, None]  # (2, p, e, n)
    to_next = to_point - edge[:, None]
    square = 1.0 + (start**2).sum(axis=0)  # (e, n)
    point_square = (1.0 + (points**2).sum(axis=0))[:, None]  # (p, 1, n)
    from_vertex = _sine2(start[:, None], to_point) / (square * point_square)
    # Within the edge: in front of either end, by the metric there.
    inside = (_metric(start[:, None], square, to_point, edge[:, None]) > 0.0) & (
        _metric(end[:, None], 1.0 + (end**2).sum(axis=0), to_next, -edge[:, None]) > 0.0
    )
    area = edge[0] * to_point[1] - edge[1] * to_point[0]
    normal = _sine2(start, edge)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_edge = area**2 / (normal * point_square)
    # Polygons lie within 60 degrees of the centre: two points may be more than a quarter turn apart, an edge may not.
    dot = 1.0 + start[0] * points[0][:, None] + start[1] * points[1][:, None]
    chord = _chord2(from_vertex, dot / np.sqrt(square * point_square))
    cosine = np.sqrt(np.maximum(1.0 - to_edge, 0.0))
    if (to_edge > 0.5).any():
        # Near a quarter turn the cosine cannot be had from the sine; |(start x end) x point| gives it.
        ahead = edge[0] * points[0][:, None] + edge[1] * points[1][:, None]
        across2 = sum((edge[k] * dot - start[k] * ahead) ** 2 for k in (0, 1)) + ahead**2
        with np.errstate(divide="ignore", invalid="ignore"):
            cosine = np.where(to_edge > 0.5, np.sqrt(across2 / (normal * point_square)), cosine)
    return np.sqrt(np.where(inside, np.minimum(_chord2(to_edge, cosine), chord), chord).min(axis=(0, 1)))


def _sine2(base: Floats, step: Floats) -> Floats:
    """Return the squared length of (base, 1) x (base + step, 1)."""
    return np.asarray(step[0] ** 2 + step[1] ** 2 + (base[0] * step[1] - base[1] * step[0]) ** 2)


def _metric(base: Floats, square: Floats, one: Floats, other: Floats) -> Floats:
    """Return the scalar product of two steps in the plane, as the sphere has it at their base."""
    return np.asarray(
        square * (one[0] * other[0] + one[1] * other[1])
        - (base[0] * one[0] + base[1] * one[1]) * (base[0] * other[0] + base[1] * other[1])
    )


def _chord2(sine2: Floats, cosine: Floats) -> Floats:
    """Return the squared chord of angles, 2 - 2 cos, without cancellation."""
    return np.where(cosine < 0.0, 2.0 - 2.0 * cosine, 2.0 * sine2 / np.maximum(1.0 + cosine, 1.0))
