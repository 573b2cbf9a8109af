"""The kernel in C: when two pieces touch, or come nearer than a distance, a pair at a time and with proofs.

`kernel.h` is the contract of the library; here it is called with arrays. A `Scene` holds the pieces of a batch as the
kernel works on them; it may be used by several threads, and a call lets other threads of Python run. What is answered
for a pair depends on that pair alone: not on its company, nor on how many threads there are.

`build.py` makes the library; ./run and the wheel's build do that by themselves. docs/explanation/kernel.md says more.
"""

import ctypes
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cache
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import MEAN_RADIUS_M, Earth, Floats
from conflictdb.errors import KernelMissing
from conflictdb.kernel import build

__all__ = ["Outcome", "Plane", "Scene", "Solution", "Work"]

# As kernel.h has them.
ABI: Final = 1
_MERCATOR, _GNOMONIC = 0, 1
_STATUS: Final = {
    1: "no memory is left",
    2: "an array is missing",
    3: "a count is negative, or too large",
    4: "there is no such plane",
    5: "the offsets of vertices do not begin at 0, decrease, or do not end with the vertices",
    6: "the number of a pair's piece is none of the pieces'",
    7: "a separation or margin is negative, or no number",
}
# Pairs that a thread takes at once: milliseconds of work.
_SHARE: Final = 2048

_Ints = NDArray[np.int64]


class Plane(ctypes.Structure):
    """KernelPlane: what the kernel needs to know of a plane."""

    _fields_ = (
        ("projection", ctypes.c_int32),
        ("harmonics", ctypes.c_int32),
        ("radius_m", ctypes.c_double),
        ("rectifying_m", ctypes.c_double),
        ("eccentricity", ctypes.c_double),
        ("oblateness", ctypes.c_double),
        ("to_rectifying", ctypes.c_double * 6),
        ("to_conformal", ctypes.c_double * 6),
        ("conformal_radius", ctypes.c_double * 7),
        ("centre_lon_deg", ctypes.c_double),
        ("centre_lat_deg", ctypes.c_double),
    )

    @classmethod
    def mercator(cls, earth: Earth) -> "Plane":
        """Return the Mercator plane of a figure of the earth."""
        plane = cls(_MERCATOR, max(len(earth.to_rectifying), len(earth.to_conformal)), earth.radius_m)
        plane.rectifying_m, plane.eccentricity = earth.rectifying_m, earth.eccentricity
        plane.oblateness = earth.oblateness
        for name in ("to_rectifying", "to_conformal", "conformal_radius"):
            series = getattr(earth, name)
            getattr(plane, name)[: len(series)] = series
        return plane

    @classmethod
    def gnomonic(cls, centre_lon_deg: float, centre_lat_deg: float) -> "Plane":
        """Return the plane that touches the sphere at a centre."""
        plane = cls(_GNOMONIC, 0, MEAN_RADIUS_M, MEAN_RADIUS_M)
        plane.conformal_radius[0] = MEAN_RADIUS_M
        plane.centre_lon_deg, plane.centre_lat_deg = centre_lon_deg, centre_lat_deg
        return plane


@dataclass(slots=True)
class Work:
    """What was done: pairs by closed form, windows of pairs, and evaluations of two polygons at an instant."""

    closed_forms: int = 0
    windows: int = 0
    evaluations: int = 0


class Outcome(IntEnum):
    """What is proven of a pair (KernelOutcome)."""

    UNDECIDED = 0  # nothing
    SEPARATED = 1  # further apart than wanted by more than the margin, throughout
    CONTACT = 2  # nearer than wanted, by more than the margin at some instant


@dataclass(frozen=True, slots=True)
class Solution:
    """What is known of n pairs during the time they were asked about.

    outcome : (n,) int8, `Outcome`
    start_s, end_s : (n,) seconds; where the outcome is CONTACT the one contact lies between them, else they are 0
    error_s : (n,) seconds by which the contact may begin later, or end earlier
    """

    outcome: NDArray[np.int8]
    start_s: Floats
    end_s: Floats
    error_s: Floats

    def ended(self, outcome: Outcome) -> NDArray[np.bool_]:
        """Return (n,) where the kernel ended in this way."""
        return self.outcome == outcome


class Scene:
    """The pieces of a batch as the kernel works on them."""

    def __init__(self, plane: Plane, pieces: Pieces, a: _Ints | None = None, b: _Ints | None = None) -> None:
        """Prepare the pieces that pairs a, b have, or all; what cannot be leaves its pairs undecided.

        That is what has no vertices, no leg that takes time, or a number that is none.
        """
        wanted = np.full(len(pieces), a is None)
        for rows in (a, b):
            if rows is not None:
                wanted[rows] = True
        library, held = _library(), _Pieces.of(pieces, wanted)
        self._handle = ctypes.c_void_p()
        _check(library.kernel_scene_make(ctypes.byref(plane), ctypes.byref(held), ctypes.byref(self._handle)))
        weakref.finalize(self, library.kernel_scene_free, self._handle)

    def contacts(
        self,
        a: _Ints,
        b: _Ints,
        zero_us: _Ints,
        low_s: Floats,
        high_s: Floats,
        separation_m: float,
        margin_m: float,
        work: Work,
        threads: int = 1,
    ) -> Solution:
        """Return when pairs of pieces a and b are nearer than a separation; where that is 0, when they touch.

        a, b : (n,) numbers of pieces
        zero_us : (n,) what each pair's seconds count from
        low_s, high_s : (n,) each pair's time, within what both pieces have
        margin_m : by how much a pair must be deeper than wanted to meet, or further than wanted to be apart, metres on
            the earth; at least TOUCH_M
        work : counts what is done
        """
        n = len(a)
        found = Solution(np.empty(n, np.int8), np.empty(n), np.empty(n), np.empty(n))
        pairs = _Pairs.arrays(a, b, zero_us, low_s, high_s)

        def solve(rows: slice) -> _Work:
            done = _Work()
            columns = [getattr(found, column.name)[rows].ctypes.data for column in fields(found)]
            held = _Pairs.of(pairs, rows)
            status = _library().kernel_contacts(
                self._handle, ctypes.byref(held), separation_m, margin_m, *columns, ctypes.byref(done)
            )
            _check(status)
            return done

        for done in _shared(solve, n, threads):
            work.closed_forms += done.closed_forms
            work.windows += done.windows
            work.evaluations += done.evaluations
        return found

    def depths(
        self, a: _Ints, b: _Ints, zero_us: _Ints, low_s: Floats, high_s: Floats, margin_m: float
    ) -> NDArray[np.int8]:
        """Return (n,) whether pairs overlap by more than a margin: CONTACT at some instant, SEPARATED at none."""
        outcome = np.empty(len(a), np.int8)
        held = _Pairs.of(_Pairs.arrays(a, b, zero_us, low_s, high_s), slice(0, len(a)))
        _check(_library().kernel_depths(self._handle, ctypes.byref(held), margin_m, outcome.ctypes.data))
        return outcome


def _shared(solve: Any, n: int, threads: int) -> list[Any]:
    """Return what `solve` answers to slices of n rows, which threads take as they get to them."""
    if threads <= 1 or n <= _SHARE:
        return [solve(slice(0, n))]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(solve, [slice(first, min(first + _SHARE, n)) for first in range(0, n, _SHARE)]))


def _check(status: int) -> None:
    if status == 1:
        raise MemoryError(f"kernel: {_STATUS[status]}")
    if status:
        raise ValueError(f"kernel: {_STATUS.get(status, status)}")


class _Held(ctypes.Structure):
    """Counts and pointers to arrays, which it keeps alive."""

    _types: ClassVar[dict[str, Any]] = {}

    def _hold(self, **arrays: Any) -> None:
        self._arrays = []
        for name, values in arrays.items():
            array = np.ascontiguousarray(values, self._types[name])
            self._arrays.append(array)
            setattr(self, name, array.ctypes.data)


class _Pieces(_Held):
    """KernelPieces."""

    _types: ClassVar[dict[str, Any]] = {
        "moves": np.int8,
        "turn": np.int16,
        **dict.fromkeys(("start_us", "end_us", "leg_start_us", "leg_end_us"), np.int64),
        **dict.fromkeys(("leg_start_deg", "leg_end_deg", "bearing_deg"), np.float64),
        "shape_offset": np.int64,
        "shape": np.float64,
        "shape_to": np.float64,
        "wanted": np.int8,
    }
    _fields_ = (
        ("count", ctypes.c_int64),
        ("vertex_count", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in _types),
    )

    @classmethod
    def of(cls, pieces: Pieces, wanted: NDArray[np.bool_]) -> "_Pieces":
        held = cls(len(pieces), len(pieces.shape_xy))
        held._hold(
            moves=pieces.kind,
            turn=pieces.turn,
            start_us=pieces.start_us,
            end_us=pieces.end_us,
            leg_start_us=pieces.leg_start_us,
            leg_end_us=pieces.leg_end_us,
            leg_start_deg=pieces.leg_start_deg,
            leg_end_deg=pieces.leg_end_deg,
            bearing_deg=pieces.bearing_deg,
            shape_offset=pieces.shape_offset,
            shape=pieces.shape_xy,
            wanted=wanted,
            **({"shape_to": pieces.shape_to_xy} if pieces.changes else {}),
        )
        return held


class _Pairs(_Held):
    """KernelPairs."""

    _types: ClassVar[dict[str, Any]] = {
        **dict.fromkeys(("a", "b", "zero_us"), np.int64),
        **dict.fromkeys(("low_s", "high_s"), np.float64),
    }
    _fields_ = (("count", ctypes.c_int64), *((name, ctypes.c_void_p) for name in _types))

    @classmethod
    def arrays(cls, *columns: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Return the columns by name, as the kernel takes them; of equal length."""
        n = len(columns[0])
        if any(column.shape != (n,) for column in columns):
            raise ValueError("kernel: the columns of pairs are not of one length")
        return {
            name: np.ascontiguousarray(values, dtype)
            for (name, dtype), values in zip(cls._types.items(), columns, strict=True)
        }

    @classmethod
    def of(cls, columns: dict[str, NDArray[Any]], rows: slice) -> "_Pairs":
        held = cls(rows.stop - rows.start)
        held._hold(**{name: values[rows] for name, values in columns.items()})
        return held


class _Work(ctypes.Structure):
    """KernelWork."""

    _fields_ = tuple((name, ctypes.c_int64) for name in ("closed_forms", "windows", "evaluations"))


@cache
def _library() -> Any:
    """Return the library, which is of these sources and of this interface."""
    path = build.library()
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise KernelMissing(f"the kernel cannot be loaded ({error})") from error
    library.kernel_fingerprint.restype = ctypes.c_char_p
    if library.kernel_abi() != ABI or library.kernel_fingerprint().decode() != build.fingerprint():
        raise KernelMissing(f"the kernel is not that of the sources beside it: {path}")
    pointer, number = ctypes.c_void_p, ctypes.c_double
    library.kernel_scene_make.argtypes = [pointer, pointer, pointer]
    library.kernel_scene_free.argtypes = [pointer]
    library.kernel_scene_free.restype = None
    library.kernel_contacts.argtypes = [pointer, pointer, number, number, *[pointer] * 5]
    library.kernel_depths.argtypes = [pointer, pointer, number, pointer]
    return library
