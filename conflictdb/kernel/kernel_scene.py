"""Scenes of the kernel: the prepared pieces of a batch, and pairs of them."""

import ctypes
import weakref
from dataclasses import dataclass, field
from enum import IntEnum
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Pieces
from conflictdb.kernel.header import structure
from conflictdb.kernel.library import Held, address, check, library

_Ints = NDArray[np.int64]


class KernelPlane(ctypes.Structure):
    """KernelPlane: the plane that a scene lies in."""

    _fields_ = structure("KernelPlane")[0]
    MERCATOR, GNOMONIC = 0, 1


@dataclass(slots=True)
class Work:
    """Work counters (KernelWork); instances are equal if their counts are.

    closed_forms : pairs decided in closed form
    closed_apart : of these, pairs that are apart
    windows : certified windows of the other pairs
    evaluations : of two polygons at an instant
    searched_pairs : pairs searched by branch and bound
    closed_form_s, contacts_s : seconds of the pairs decided in closed form, and of all pairs asked for contacts, added
        up over threads
    """

    closed_forms: int = 0
    closed_apart: int = 0
    windows: int = 0
    evaluations: int = 0
    searched_pairs: int = 0
    closed_form_s: float = field(default=0.0, compare=False)
    contacts_s: float = field(default=0.0, compare=False)


class PieceState(IntEnum):
    """State of a piece of a scene (KernelState)."""

    INVALID = 0  # or not used
    NONCONVEX = 1  # may lose convexity; its convex hull is used
    CONVEX = 2  # the vertices stay in convex position


class KernelScene:
    """The pieces of a batch, prepared once for all calls; threads may share it.

    handle : pointer to the KernelScene
    vertex_count : (pieces,) number of vertices of each piece
    """

    def __init__(self, plane: KernelPlane, pieces: Pieces, a: _Ints | None = None, b: _Ints | None = None) -> None:
        """Prepare the pieces of the pairs a, b, or all. Pairs with an invalid piece (KernelState) are unresolved."""
        functions, held = library(), HeldPieces.of(pieces, _used(len(pieces), a, b))
        self.handle, self.pieces = ctypes.c_void_p(), pieces
        check(functions.kernel_scene_make(ctypes.byref(plane), ctypes.byref(held), ctypes.byref(self.handle)))
        self.vertex_count = np.diff(pieces.shape_offset)
        weakref.finalize(self, functions.kernel_scene_free, self.handle)

    def vertices(self, a: _Ints, b: _Ints) -> _Ints:
        """Return (n,) the number of vertices of pairs; indices out of range are clipped."""
        if not len(self.pieces):
            return np.zeros(len(a), np.int64)
        return np.asarray(self.vertex_count.take(a, mode="clip") + self.vertex_count.take(b, mode="clip"))

    def states(self) -> NDArray[np.int8]:
        """Return the `PieceState` of each piece."""
        found = np.empty(len(self.pieces), np.int8)
        check(library().kernel_states(self.handle, address(found)))
        return found


def _used(n: int, a: _Ints | None, b: _Ints | None) -> NDArray[np.bool_]:
    """Return which of n pieces are in pairs; without pairs all are."""
    used = np.full(n, a is None)
    for rows in (a, b):
        if rows is not None:
            used[rows] = True
    return used


class HeldPieces(Held):
    """KernelPieces."""

    _fields_, types = structure("KernelPieces")

    @classmethod
    def of(cls, pieces: Pieces, used: NDArray[np.bool_]) -> "HeldPieces":
        """Return pointers to the arrays of pieces; used : (n,) whether a pair has the piece."""
        held = cls(len(pieces), len(pieces.shape_xy))
        columns = dict(zip(_COLUMNS, _columns(pieces), strict=True))
        shape_to = pieces.shape_to_xy if pieces.changes else None
        held.hold(moves=pieces.kind, used=used, shape=pieces.shape_xy, shape_to=shape_to, **columns)
        return held


# Columns of the same names.
_COLUMNS: Final = tuple(HeldPieces.types.keys() - {"moves", "used", "shape", "shape_to"})
_columns: Final = attrgetter(*_COLUMNS)


class HeldPairs(Held):
    """KernelPairs."""

    _fields_, types = structure("KernelPairs")

    @classmethod
    def arrays(cls, *columns: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Return the columns by name, converted to the types of KernelPairs. Raises ValueError unless lengths agree."""
        n = len(columns[0])
        if any(column.shape != (n,) for column in columns):
            raise ValueError("kernel: the columns of pairs are not of one length")
        return {
            name: np.ascontiguousarray(values, dtype)
            for (name, dtype), values in zip(cls.types.items(), columns, strict=True)
        }

    @classmethod
    def of(cls, columns: dict[str, NDArray[Any]], rows: slice) -> "HeldPairs":
        """Return pointers to some rows of the columns."""
        held = cls(rows.stop - rows.start)
        held.hold(**{name: values[rows] for name, values in columns.items()})
        return held


class HeldWork(ctypes.Structure):
    """KernelWork."""

    _fields_ = structure("KernelWork")[0]
