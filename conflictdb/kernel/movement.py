"""Pieces of a scene as functions of time: vertices, reference points, and proven bounds on their motion."""

import ctypes
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.kernel.header import structure
from conflictdb.kernel.kernel_scene import KernelScene
from conflictdb.kernel.library import Held, address, check, library

_Ints = NDArray[np.int64]
# Bisections until a fraction of the time is known to its last digit.
_HALVINGS: Final = 53
# Half the time step of difference quotients of positions, which are rounded to 1e-8 m.
_ASIDE_S: Final = 1e-3


@dataclass(frozen=True, slots=True)
class Bounds:
    """Proven bounds on the motion of n polygons during a time (KernelBounds).

    velocity : (2, n) one velocity for the whole polygon, at the middle of the time, plane m/s
    acceleration : (n,) largest second derivative of a vertex, plane m/s^2
    spread : (n,) largest difference between a vertex' velocity and `velocity`, plane m/s
    deviation : (n,) havens: largest distance of a vertex from the hull of both end positions, plane metres; areas: 0
    scale : (n,) havens: most plane metres per metre at a vertex; areas: 1
    curve : (2, n) second derivative of the reference point at the middle of the time, plane m/s^2; areas: 0
    variation : (n,) largest difference between a vertex' second derivative and `curve`, plane m/s^2; areas: 0
    """

    velocity: Floats
    acceleration: Floats
    spread: Floats
    deviation: Floats
    scale: Floats
    curve: Floats
    variation: Floats


@dataclass(frozen=True, slots=True)
class Movement:
    """n pieces of a scene as functions of time. Results are NaN for invalid pieces.

    piece : (n,) index of the piece
    zero_us : (n,) the instant that seconds count from
    origin : (2, n) the plane point that coordinates count from, metres
    slots : at least the largest number of vertices of these pieces
    """

    scene: KernelScene
    piece: _Ints
    zero_us: _Ints
    origin: Floats
    slots: int

    @classmethod
    def of(cls, scene: KernelScene, piece: _Ints, zero_us: _Ints, origin: Floats | None = None) -> Self:
        """Return pieces (n,) of a scene; without `origin`, coordinates count from the plane's own origin."""
        slots = int(scene.vertex_count[piece].max(initial=1))
        return cls(scene, piece, zero_us, np.zeros((2, len(piece))) if origin is None else origin, slots)

    def take(self, rows: _Ints | slice) -> Self:
        """Return some rows, in this order; rows may repeat."""
        return type(self)(self.scene, self.piece[rows], self.zero_us[rows], self.origin[:, rows], self.slots)

    def positions(self, t: Floats) -> Floats:
        """Return the vertices at times t (n,), (2, slots, n); pieces of fewer vertices repeat their last one."""
        t = np.ascontiguousarray(t, np.float64)
        found = np.empty((2, self.slots, len(self.piece)))
        arguments = ctypes.byref(HeldRows.of(self)), address(t), self.slots, address(found)
        check(library().kernel_positions(self.scene.handle, *arguments))
        return found

    def reference(self, t: Floats) -> Floats:
        """Return the reference points (2, n) of havens at times t (n,), which move on straight lines; NaN for areas."""
        t = np.ascontiguousarray(t, np.float64)
        found = np.empty((2, len(self.piece)))
        arguments = ctypes.byref(HeldRows.of(self)), address(t), address(found)
        check(library().kernel_references(self.scene.handle, *arguments))
        return found

    def time_fraction(self, t0: Floats, t1: Floats, share: Floats) -> Floats:
        """Return (n,) the fraction of the time from t0 to t1 at which the fraction `share` of the path is covered.

        By bisection, as the reference point never turns back. If it does not move, `share` itself.
        """
        start = self.reference(t0)
        way = self.reference(t1) - start
        square = (way**2).sum(axis=0)
        low, high = np.zeros(len(share)), np.ones(len(share))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            gone = ((self.reference(t0 + middle * (t1 - t0)) - start) * way).sum(axis=0)
            is_late = gone > share * square
            low, high = np.where(is_late, low, middle), np.where(is_late, middle, high)
        return np.where(square > 0.0, 0.5 * (low + high), share)

    def velocities(self, t: Floats) -> Floats:
        """Return the vertices' velocities at times t (n,), (2, slots, n) plane m/s, to a millimetre per second."""
        return (self.positions(t + _ASIDE_S) - self.positions(t - _ASIDE_S)) / (2.0 * _ASIDE_S)

    def bounds(self, t0: Floats, t1: Floats) -> Bounds:
        """Return bounds on the motion during [t0, t1], (n,) both, within the slices."""
        t0, t1 = (np.ascontiguousarray(t, np.float64) for t in (t0, t1))
        n = len(self.piece)
        velocity, curve = np.empty((2, n)), np.empty((2, n))
        acceleration, spread, deviation, scale, variation = (np.empty(n) for _ in range(5))
        found = Bounds(velocity, acceleration, spread, deviation, scale, curve, variation)
        arguments = ctypes.byref(HeldRows.of(self)), address(t0), address(t1), ctypes.byref(_Bounds.of(found))
        check(library().kernel_bounds(self.scene.handle, *arguments))
        return found


class HeldRows(Held):
    """KernelRows."""

    _fields_, types = structure("KernelRows")

    @classmethod
    def of(cls, movement: Movement) -> "HeldRows":
        """Return pointers to the rows of some pieces."""
        n = len(movement.piece)
        if movement.zero_us.shape != (n,) or movement.origin.shape != (2, n):
            raise ValueError("kernel: the columns of rows are not of one length")
        held = cls(n)
        held.hold(piece=movement.piece, zero_us=movement.zero_us, origin=movement.origin)
        return held


class _Bounds(Held):
    """KernelBounds."""

    _fields_, types = structure("KernelBounds")

    @classmethod
    def of(cls, bounds: Bounds) -> "_Bounds":
        held = cls()
        held.hold(**{name: getattr(bounds, name) for name in cls.types})
        return held
