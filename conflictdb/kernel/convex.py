"""Convex parts of polygons, joined from their triangles."""

import ctypes

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.library import check, library


def convex_parts(triangles: Floats, of: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return convex parts of polygons, made of their triangles, which are joined over sides that are the same.

    triangles : (t, 3, 2) corners, counter-clockwise
    of : (t,) polygon of each, sorted

    Returns the corners of the parts, counter-clockwise, as rows of all corners of the triangles (3 t, 2), one part
    after the other, a polygon after the other; and where those of each begin, and the last end (n + 1,).
    """
    triangles, of = np.ascontiguousarray(triangles, np.float64), np.ascontiguousarray(of, np.int64)
    corner, offset, count = np.empty(3 * len(of), np.int64), np.empty(len(of) + 1, np.int64), ctypes.c_int64()
    arrays = [array.ctypes.data for array in (triangles, of, corner, offset)]
    check(library().kernel_convex_parts(*arrays[:2], len(of), *arrays[2:], ctypes.byref(count)))
    offset = offset[: count.value + 1]
    return corner[: offset[-1]], offset
