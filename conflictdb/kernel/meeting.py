"""Meeting points and distances of pairs of pieces at an instant."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.kernel.kernel_scene import HeldPairs, KernelScene
from conflictdb.kernel.library import address, check, library, shared

_Ints = NDArray[np.int64]


def meetings(scene: KernelScene, a: _Ints, b: _Ints, zero_us: _Ints, at_s: Floats, threads: int = 1) -> Floats:
    """Return the meeting points (n, 2) of pieces a and b at instants: longitude in [-180, 180) and latitude, degrees.

    A common point if they overlap, else the middle between their nearest points in the plane; NaN if a piece is
    invalid.

    at_s : (n,) seconds after zero_us (n,)
    """
    return _measured(scene, library().kernel_meetings, np.empty((len(a), 2)), (a, b, zero_us, at_s, at_s), threads)


def distances(scene: KernelScene, a: _Ints, b: _Ints, zero_us: _Ints, at_s: Floats, threads: int = 1) -> Floats:
    """Return the distances (n,) of pieces a and b at instants, metres on the earth; minus the depth of overlaps.

    Never too large, and too small by less than the plane's `distance_error_m`; NaN if a piece is invalid, and if the
    work budget of the pair is exhausted.

    at_s : (n,) seconds after zero_us (n,)
    """
    return _measured(scene, library().kernel_distances, np.empty(len(a)), (a, b, zero_us, at_s, at_s), threads)


def deepest(
    scene: KernelScene, a: _Ints, b: _Ints, zero_us: _Ints, low_s: Floats, high_s: Floats
) -> tuple[Floats, Floats]:
    """Return the least distances (n,) of pieces a and b during [low_s, high_s], as of `distances`, and when they are.

    Where the distance falls and rises again, as that of two convex pieces in uniform motion does; infinite if unknown.

    low_s, high_s : (n,) seconds after zero_us (n,)
    """
    pairs, n = HeldPairs.arrays(a, b, zero_us, low_s, high_s), len(a)
    least_m, at_s = np.empty(n), np.empty(n)

    def solve(rows: slice) -> None:
        held, answers = HeldPairs.of(pairs, rows), [address(least_m[rows]), address(at_s[rows])]
        check(library().kernel_deepest(scene.handle, ctypes.byref(held), *answers))

    shared(solve, n, 1, vertices=scene.vertices(a, b))
    return least_m, at_s


def _measured(
    scene: KernelScene, measure: Any, found: Floats, columns: tuple[NDArray[Any], ...], threads: int
) -> Floats:
    pairs = HeldPairs.arrays(*columns)

    def solve(rows: slice) -> None:
        check(measure(scene.handle, ctypes.byref(HeldPairs.of(pairs, rows)), address(found[rows])))

    shared(solve, len(found), threads, vertices=scene.vertices(*columns[:2]))
    return found
