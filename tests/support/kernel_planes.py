"""The planes of the kernel (`plane.h`, `earth.h`), called with numbers: bounds on distances, distances of polygons."""

import ctypes
from typing import Any

import numpy as np
from kernel_internals import internals

from conflictdb.earth.plane import Plane

_NUMBER = ctypes.c_double


class Vector(ctypes.Structure):
    """Vector of polygon.h."""

    _fields_ = (("x", _NUMBER), ("y", _NUMBER))


class Polygon(ctypes.Structure):
    """Polygon of polygon.h."""

    _fields_ = (
        ("x", ctypes.c_void_p),
        ("y", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("is_in_runs", ctypes.c_bool),
        ("bends", ctypes.c_void_p),
        ("largest", _NUMBER),
    )

    @classmethod
    def of(cls, xy: np.ndarray) -> "Polygon":
        """A convex polygon of corners (2, v), counter-clockwise; too small to be in runs."""
        made = cls()
        made.held = np.ascontiguousarray(xy, np.float64)
        made.x, made.y, made.count = made.held[0].ctypes.data, made.held[1].ctypes.data, xy.shape[1]
        return made


def _called(name: str, plane: Plane, *arguments: float) -> float:
    function = getattr(internals(), name)
    function.restype, function.argtypes = _NUMBER, [ctypes.c_void_p, *[_NUMBER] * len(arguments)]
    return float(function(ctypes.byref(plane.kernel_plane), *map(float, arguments)))


def stretch(plane: Plane, mu1: float, mu2: float) -> float:
    return _called("earth_stretch", plane, mu1, mu2)


def slope(plane: Plane, mu: float) -> float:
    return _called("earth_slope", plane, mu)


def least_m(plane: Plane, span_m: float, scale: float) -> float:
    return _called("plane_least_m", plane, span_m, scale)


def drift(plane: Plane, distance_m: float, scale: float, speed: float) -> float:
    return _called("plane_drift", plane, distance_m, scale, speed)


def slant(plane: Plane, distance_m: float, scale: float) -> float:
    return _called("plane_slant", plane, distance_m, scale)


def christoffel(plane: Plane, scale: float) -> float:
    return _called("plane_christoffel", plane, scale)


def span_m(plane: Plane, distance_m: float, scale: float) -> float:
    return _called("plane_span_m", plane, distance_m, scale)


def half_m(plane: Plane, distance_m: float, place: np.ndarray, along: np.ndarray, largest_scale: float) -> float:
    """Half of a distance at a place (2,), along a unit vector (2,), plane metres."""
    functions, of = internals(), ctypes.byref(plane.kernel_plane)
    functions.plane_half_is_long.restype = ctypes.c_bool
    functions.plane_half_is_long.argtypes = [ctypes.c_void_p, _NUMBER, _NUMBER]
    for name in ("plane_half_m", "plane_half_along"):
        getattr(functions, name).restype = _NUMBER
    functions.plane_half_m.argtypes = [ctypes.c_void_p, _NUMBER, Vector, ctypes.c_bool]
    functions.plane_half_along.argtypes = [ctypes.c_void_p, _NUMBER, Vector, Vector, ctypes.c_bool]
    is_long = functions.plane_half_is_long(of, distance_m, largest_scale)
    half = functions.plane_half_m(of, distance_m, Vector(*place), is_long)
    return float(functions.plane_half_along(of, half, Vector(*place), Vector(*along), is_long))


def distance_error_m(plane: Plane, distance_m: float) -> float:
    return _called("plane_distance_error_m", plane, distance_m)


def distance_m(plane: Plane, a: np.ndarray, b: np.ndarray, halvings_left: ctypes.c_int64 | None = None) -> float:
    """Distance of polygons with corners (2, v) and (2, w), relative to the first corner, as computed by the kernel.

    halvings_left : budget of bisections of sides; the remainder is stored there
    """
    function: Any = internals().plane_distance_m
    function.restype, function.argtypes = _NUMBER, [ctypes.c_void_p] * 3 + [Vector, ctypes.c_void_p]
    origin = a[:, :1]
    one, other = Polygon.of(a - origin), Polygon.of(b - origin)
    given = ctypes.byref(plane.kernel_plane), ctypes.byref(one), ctypes.byref(other)
    return float(function(*given, Vector(*origin.ravel()), ctypes.byref(halvings_left or ctypes.c_int64(2**24))))
