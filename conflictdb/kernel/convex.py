"""Merge the triangles of polygons into convex parts."""

import ctypes

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.kernel.library import address, check, library


def convex_parts(triangles: Floats, of: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Merge the triangles of polygons into convex parts, across shared sides.

    triangles : (t, 3, 2) corners, counter-clockwise
    of : (t,) polygon of each triangle, sorted

    Returns the corners of the parts, counter-clockwise, as rows of all corners (3 t, 2), ordered by polygon and part;
    and the offsets of the parts (n + 1,).
    """
    triangles, of = np.ascontiguousarray(triangles, np.float64), np.ascontiguousarray(of, np.int64)
    corner, offset, count = np.empty(3 * len(of), np.int64), np.empty(len(of) + 1, np.int64), ctypes.c_int64()
    arrays = [address(array) for array in (triangles, of, corner, offset)]
    check(library().kernel_convex_parts(*arrays[:2], len(of), *arrays[2:], ctypes.byref(count)))
    offset = offset[: count.value + 1]
    return corner[: offset[-1]], offset
