"""Pieces of a scene of the kernel as functions of time: where vertices are, and what bounds how they move."""

import ctypes
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.library import Held, check, library
from conflictdb.kernel.scene import Scene

_Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Bounds:
    """What is promised of n polygons during a time.

    velocity : (2, n) one for the whole polygon, in the middle, plane m/s
    acceleration : (n,) no vertex has a larger second derivative, plane m/s^2
    spread : (n,) no vertex has a velocity further from that of the whole, plane m/s
    """

    velocity: Floats
    acceleration: Floats
    spread: Floats


@dataclass(frozen=True, slots=True)
class Movement:
    """n pieces of a scene; NaN is what is asked of those that cannot be.

    piece : (n,) their numbers
    zero_us : (n,) the instant that each counts its seconds from
    origin : (2, n) the plane point that each counts its coordinates from, metres
    slots : at least as many vertices as any of them has
    """

    scene: Scene
    piece: _Ints
    zero_us: _Ints
    origin: Floats
    slots: int

    def take(self, rows: _Ints | slice) -> Self:
        """Return some rows, each as often as it is named."""
        return type(self)(self.scene, self.piece[rows], self.zero_us[rows], self.origin[:, rows], self.slots)

    def positions(self, t: Floats) -> Floats:
        """Return the vertices at times t (n,), (2, slots, n); pieces of fewer vertices repeat their last one."""
        t = np.ascontiguousarray(t, np.float64)
        found = np.empty((2, self.slots, len(self.piece)))
        arguments = ctypes.byref(_Rows.of(self)), t.ctypes.data, self.slots, found.ctypes.data
        check(library().kernel_positions(self.scene.handle, *arguments))
        return found

    def bounds(self, t0: Floats, t1: Floats) -> Bounds:
        """Return what is promised during [t0, t1], (n,) both, within the slices."""
        t0, t1 = (np.ascontiguousarray(t, np.float64) for t in (t0, t1))
        n = len(self.piece)
        found = Bounds(np.empty((2, n)), np.empty(n), np.empty(n))
        arguments = ctypes.byref(_Rows.of(self)), t0.ctypes.data, t1.ctypes.data, ctypes.byref(_Bounds.of(found))
        check(library().kernel_bounds(self.scene.handle, *arguments))
        return found


class _Rows(Held):
    """KernelRows."""

    types: ClassVar[dict[str, Any]] = {"piece": np.int64, "zero_us": np.int64, "origin": np.float64}
    _fields_ = (("count", ctypes.c_int64), *((name, ctypes.c_void_p) for name in types))

    @classmethod
    def of(cls, movement: Movement) -> "_Rows":
        n = len(movement.piece)
        if movement.zero_us.shape != (n,) or movement.origin.shape != (2, n):
            raise ValueError("kernel: the columns of rows are not of one length")
        held = cls(n)
        held.hold(piece=movement.piece, zero_us=movement.zero_us, origin=movement.origin)
        return held


class _Bounds(Held):
    """KernelBounds."""

    types: ClassVar[dict[str, Any]] = dict.fromkeys(("velocity", "acceleration", "spread"), np.float64)
    _fields_ = tuple((name, ctypes.c_void_p) for name in types)

    @classmethod
    def of(cls, bounds: Bounds) -> "_Bounds":
        held = cls()
        held.hold(velocity=bounds.velocity, acceleration=bounds.acceleration, spread=bounds.spread)
        return held
