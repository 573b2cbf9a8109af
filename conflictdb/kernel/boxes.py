"""Rows of pieces whose boxes meet in place, height and time: stage 1 of a whole scene, joined in memory."""

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.library import Held, check, fields_of, library


class _Boxes(Held):
    """KernelBoxes."""

    types: ClassVar = {
        "boxes": np.float64,
        "floor_m": np.float64,
        "ceiling_m": np.float64,
        "start_us": np.int64,
        "end_us": np.int64,
        "object": np.int64,
        "is_copy": np.uint8,
    }
    _fields_: ClassVar = [*fields_of(types, "count")]


@dataclass(frozen=True, slots=True)
class RowBoxes:
    """n rows of pieces, of each what it takes up.

    boxes : (n, 4) least x, least y, largest x, largest y, metres of the plane
    floor_m, ceiling_m : (n,) -inf, inf where unbounded
    start_us, end_us : (n,) SINCE_EVER_US, FOR_EVER_US where unbounded
    object : (n,) a number for its object
    is_copy : (n,) whether it is of a seam copy
    """

    boxes: Floats
    floor_m: Floats
    ceiling_m: Floats
    start_us: NDArray[np.int64]
    end_us: NDArray[np.int64]
    object: NDArray[np.int64]
    is_copy: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.object)

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return some of the rows."""
        return type(self)(*(getattr(self, column.name)[rows] for column in fields(self)))


def near_order(rows: RowBoxes) -> NDArray[np.int64]:
    """Return rows (n,) in an order in which those near each other, in place and in time, follow each other."""
    held, order = _held(rows), np.empty(len(rows), np.int64)
    check(library().kernel_box_order(ctypes.byref(held), order.ctypes.data))
    return order


def box_pairs(
    rows: RowBoxes, of: NDArray[np.int64], at_once: int
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], int]]:
    """Yield the pairs of rows (m,) that meet, each with the object of the smaller number first: so many at once.

    All of a first object come together, more than that where it has more. Boxes at least touch, and spans; heights have
    more in common than an end; not both rows are of a seam copy. And yield how many boxes were compared for them.

    rows : in an order as `near_order` gives it, else it takes longer
    of : rows that may be first, those of an object next to each other, in the order in which they are looked at
    """
    held, left = _held(rows), np.ascontiguousarray(of, np.int64)
    wanted, room = len(left), max(at_once, 1)
    done, found, looked_at = (np.zeros(1, np.int64) for _ in range(3))
    while len(left):
        # Memory that nothing is written to is not taken.
        first, second = np.empty(room, np.int64), np.empty(room, np.int64)
        places: list[Any] = [first.ctypes.data, second.ctypes.data, room]
        counts: list[Any] = [count.ctypes.data for count in (done, found, looked_at)]
        check(library().kernel_box_pairs(ctypes.byref(held), left.ctypes.data, wanted, *places, *counts))
        if not done[0]:
            # The first object alone has more.
            others = np.flatnonzero(rows.object[left] != rows.object[left[0]])
            wanted, room = int(others[0]) if len(others) else len(left), 2 * room
            continue
        left = left[done[0] :]
        wanted, room = len(left), max(at_once, 1)
        if found[0]:
            yield first[: found[0]].copy(), second[: found[0]].copy(), int(looked_at[0])


def _held(rows: RowBoxes) -> _Boxes:
    held = _Boxes(len(rows))
    held.hold(**{column.name: getattr(rows, column.name) for column in fields(rows)})
    return held
