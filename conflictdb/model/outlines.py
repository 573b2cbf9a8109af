"""Compute outlines of changing havens: the motion of corners when every side moves outward, and convexity.

Outlines are rings of (starboard, forward) metres, not closed; one vertex is a point, two are a line. Ragged arrays:
outline i has rows [offset[i], offset[i + 1]).
"""

import math
import sys
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.model.plan_rows import Many

Floats = NDArray[np.float64]
Offsets = NDArray[np.int64]

# The sharpest corner that may move outward, degrees: its tip moves 1 / sin(half of it) = 115 times as fast as the
# sides.
SHARPEST_CORNER_DEG: Final = 1.0
FASTEST_TIP: Final = 1.0 / math.sin(math.radians(0.5 * SHARPEST_CORNER_DEG))

# A point or a line is a degenerate rectangle, its corners in turn: behind and to the right, ahead, ...
_ALONG: Final = np.array([-1.0, 1.0, 1.0, -1.0])
_RIGHT: Final = np.array([1.0, 1.0, -1.0, -1.0])
_END: Final = np.array([0, 1, 1, 0])


def mitred(outline_m: Floats, offset: Offsets) -> tuple[Floats, Floats, Offsets]:
    """Return the corners of outlines, their rates when every side moves outward at speed 1, and their offsets.

    A corner stays where its two sides meet, so it moves along their bisector at constant speed. Repeated vertices are
    one corner. A point becomes the four corners of a square aligned fore and aft, a line those of a rectangle.

    outline_m : (v, 2), convex; offset : (n + 1,)
    Returns corners (w, 2) metres, rate (w, 2) metres per metre, offset (n + 1,). The rate is not finite, or exceeds
    FASTEST_TIP, at corners that are too sharp.
    """
    xy, offset = _without_repeats(outline_m, offset)
    count = np.diff(offset)
    out = _offsets(np.where(count <= 2, 4, count))
    of = np.repeat(np.arange(len(count)), np.diff(out))
    nth = np.arange(len(of)) - out[of]
    thin = count[of] <= 2
    index = offset[of] + np.where(thin, np.minimum(_END[nth % 4], count[of] - 1), nth)
    rate = np.empty((len(of), 2))

    first, last = xy[offset[of[thin]]], xy[offset[of[thin] + 1] - 1]
    ahead = _unit(np.where((first == last).all(axis=1)[:, None], [0.0, 1.0], last - first))
    right = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    rate[thin] = _ALONG[nth[thin]][:, None] * ahead + _RIGHT[nth[thin]][:, None] * right

    wide = ~thin
    here, start, size = index[wide], offset[of[wide]], count[of[wide]]
    before, after = start + (here - start - 1) % size, start + (here - start + 1) % size
    doubled = np.zeros(len(count))
    np.add.at(doubled, of[wide], xy[here, 0] * xy[after, 1] - xy[here, 1] * xy[after, 0])
    way = np.where(doubled < 0.0, -1.0, 1.0)[of[wide]][:, None]
    edge_in, edge_out = _unit(xy[here] - xy[before]), _unit(xy[after] - xy[here])
    normals = [way * np.stack([edge[:, 1], -edge[:, 0]], axis=1) for edge in (edge_in, edge_out)]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rate[wide] = (normals[0] + normals[1]) / (1.0 + (normals[0] * normals[1]).sum(axis=1))[:, None]
    return xy[index], rate, out


def lose_convexity(start_m: Floats, end_m: Floats, ring: Many) -> NDArray[np.bool_]:
    """Return (n,) which convex rings lose convexity while each vertex moves straight from one outline to the other.

    The turn at a corner, the cross product of its two edges, is quadratic in time: with a and b the edges at start and
    end its Bernstein coefficients are a1 x a2, (a1 x b2 + b1 x a2) / 2 and b1 x b2.

    start_m, end_m : (v, 2) of all rings; infinite ones lose it
    """
    with np.errstate(invalid="ignore", over="ignore"):
        return _lose_convexity(start_m, end_m, ring)


def _lose_convexity(start_m: Floats, end_m: Floats, ring: Many) -> NDArray[np.bool_]:
    edge = np.concatenate([ring.following(start_m) - start_m, ring.following(end_m) - end_m], axis=1)
    moves = (edge != 0.0).any(axis=1)
    corners = ring
    if np.count_nonzero(moves) < len(moves):
        corners, edge = Many.of(ring.total(moves)), edge[moves]
    (ax, ay, bx, by), (ax2, ay2, bx2, by2) = edge.T, corners.following(edge).T
    first, last = ax * ay2 - ay * ax2, bx * by2 - by * bx2
    middle = ax * by2 - ay * bx2 + bx * ay2 - by * ax2
    # Orientation: the sign of the total turn, at both ends and half-way.
    total = np.bincount(
        corners.spread(np.arange(len(corners.count))), 5.0 * first + middle + 5.0 * last, len(corners.count)
    )
    way = corners.spread(np.copysign(1.0, total))
    first, middle, last = way * first, way * middle, way * last
    least = np.minimum(np.minimum(first, last), middle)
    if np.minimum.reduce(least, initial=0.0) >= 0.0:  # as most do
        return np.zeros(len(corners.count), np.bool_)
    size = ring.most(np.abs(np.concatenate([start_m, end_m], axis=1)))
    slack = corners.spread(32.0 * sys.float_info.epsilon * size**2)
    reach = 2.0 * np.sqrt(np.maximum(first, 0.0) * np.maximum(last, 0.0))
    stays = (first >= -slack) & (last >= -slack) & (middle >= -reach - slack)
    return np.asarray(corners.any(~stays) & (corners.count > 2))


def _without_repeats(outline_m: Floats, offset: Offsets) -> tuple[Floats, Offsets]:
    """Return outlines without repeated vertices; one remains of vertices that are all equal."""
    before = np.arange(len(outline_m)) - 1
    before[offset[:-1]] = offset[1:] - 1
    kept = (outline_m != outline_m[before]).any(axis=1)
    left = np.add.reduceat(kept.astype(np.int64), offset[:-1])
    kept[offset[:-1][left == 0]] = True
    return outline_m[kept], _offsets(np.maximum(left, 1))


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.hypot(vector[:, 0], vector[:, 1])[:, None])


def _offsets(lengths: NDArray[np.int64]) -> Offsets:
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
