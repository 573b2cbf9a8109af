"""Stage 1 in memory: rows of pieces that may meet, by the rule of a pair (`may_meet`; `_pieces_may_meet` in SQL)."""

import ctypes
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.pieces import Pieces
from conflictdb.kernel.header import structure
from conflictdb.kernel.library import Held, address, check, library


@dataclass(frozen=True, slots=True)
class RowBoxes:
    """Bounding boxes of n rows of pieces (KernelBoxes).

    boxes : (n, 4) min x, min y, max x, max y, plane metres; None: not compared
    floor_m, ceiling_m : (n,) -inf, inf if unbounded
    start_us, end_us : (n,) MINUS_INFINITY_US, INFINITY_US if unbounded
    object : (n,) number of the object
    is_copy : (n,) whether the row is a seam copy
    end_inclusive : (n,) whether the instant end_us belongs to the row; None: it does
    numbers : (n, KERNEL_NUMBERS) as of `Pieces`; None: not compared
    type : (n,) type of the object (`Separations`); None: one type
    """

    boxes: Floats | None
    floor_m: Floats
    ceiling_m: Floats
    start_us: NDArray[np.int64]
    end_us: NDArray[np.int64]
    object: NDArray[np.int64]
    is_copy: NDArray[np.bool_]
    end_inclusive: NDArray[np.bool_] | None = None
    numbers: NDArray[np.int64] | None = None
    type: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.object)

    @classmethod
    def of(cls, pieces: Pieces, boxes: Floats | None = None) -> Self:
        """Return pieces (n,) as rows without types; boxes : (n, 4) of their hulls (`boxes_of`)."""
        heights, times = (pieces.floor_m, pieces.ceiling_m), (pieces.start_us, pieces.end_us)
        number = numbers_of(pieces.kind, pieces.object_id)
        return cls(boxes, *heights, *times, number, pieces.turn != 0, pieces.end_inclusive, pieces.numbers)

    def take(self, rows: NDArray[np.int64] | slice) -> Self:
        """Return some of the rows."""
        columns: dict[str, Any] = {one.name: getattr(self, one.name) for one in fields(self)}
        return replace(self, **{name: column[rows] for name, column in columns.items() if column is not None})


class HeldBoxes(Held):
    """KernelBoxes."""

    _fields_, types = structure("KernelBoxes")

    @classmethod
    def of(cls, rows: RowBoxes) -> Self:
        """Return pointers to the columns of rows, which have the same names."""
        held = cls(len(rows))
        held.hold_each(zip(cls.types, _columns(rows), strict=True))
        return held


_columns: Final = attrgetter(*HeldBoxes.types)


class Compared(Held):
    """KernelCompared."""

    _fields_, types = structure("KernelCompared")

    @classmethod
    def of(cls, within_us: int, compared: NDArray[np.bool_] | None = None) -> Self:
        """Return which rows may meet: how far apart in time, and whether objects of two types (t, t); None: all."""
        held = cls(within_us, 0 if compared is None else len(compared))
        held.hold(of_types=compared)
        return held


def may_meet(
    rows: RowBoxes,
    a: NDArray[np.int64],
    b: NDArray[np.int64],
    within_us: int = 0,
    compared: NDArray[np.bool_] | None = None,
    *,
    others: RowBoxes | None = None,
) -> NDArray[np.bool_]:
    """Return (m,) whether rows a and b (m,), of different objects, may meet: stage 1. b : rows of `others`, if given.

    within_us : how far apart in time they may be
    compared : (t, t) whether objects of two types are compared; None: all are
    """
    held, found = HeldBoxes.of(rows), np.empty(len(a), np.bool_)
    held_others = held if others is None else HeldBoxes.of(others)
    which = Compared.of(within_us, compared)
    a, b = (np.ascontiguousarray(side, np.int64) for side in (a, b))
    given = [ctypes.byref(one) for one in (held, held_others, which)]
    check(library().kernel_may_meet(*given, address(a), address(b), len(a), address(found)))
    return found


def near_order(rows: RowBoxes) -> NDArray[np.int64]:
    """Return an order (n,) of rows in which neighbours in space and time are neighbours."""
    held, order = HeldBoxes.of(rows), np.empty(len(rows), np.int64)
    check(library().kernel_box_order(ctypes.byref(held), address(order)))
    return order


def box_pairs(
    rows: RowBoxes,
    of: NDArray[np.int64],
    at_once: int,
    within_us: int = 0,
    compared: NDArray[np.bool_] | None = None,
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], int]]:
    """Yield batches of pairs of rows that may meet: first (m,), second (m,), and the number of compared boxes.

    The first row's object has the smaller number. A batch has all pairs of a first object, and about `at_once` pairs.

    rows : in the order of `near_order`; any other order gives the same pairs, more slowly
    of : candidates for the first row, in the order of the answer; those of an object are consecutive
    within_us, compared : as of `may_meet`
    """
    held, left = HeldBoxes.of(rows), np.ascontiguousarray(of, np.int64)
    which = Compared.of(within_us, compared)
    wanted, room = len(left), max(at_once, 1)
    done, found, looked_at = (np.zeros(1, np.int64) for _ in range(3))
    while len(left):
        # Pages of an empty array that are never written take no memory.
        first, second = np.empty(room, np.int64), np.empty(room, np.int64)
        places: list[Any] = [address(first), address(second), room]
        counts: list[Any] = [address(count) for count in (done, found, looked_at)]
        given = ctypes.byref(held), ctypes.byref(which), address(left), wanted
        check(library().kernel_box_pairs(*given, *places, *counts))
        if not done[0]:
            # The pairs of the first object alone do not fit: retry it with more room.
            others = np.flatnonzero(rows.object[left] != rows.object[left[0]])
            wanted, room = int(others[0]) if len(others) else len(left), 2 * room
            continue
        left = left[done[0] :]
        wanted, room = len(left), max(at_once, 1)
        if found[0]:
            yield first[: found[0]].copy(), second[: found[0]].copy(), int(looked_at[0])


class BoxTree:
    """Rows that stay (KernelBoxTree), for lookups of others; threads may share it."""

    def __init__(self, rows: RowBoxes | HeldBoxes) -> None:
        self._handle, held = ctypes.c_void_p(), rows if isinstance(rows, HeldBoxes) else HeldBoxes.of(rows)
        check(library().kernel_box_tree_make(ctypes.byref(held), ctypes.byref(self._handle)))
        weakref.finalize(self, library().kernel_box_tree_free, self._handle)

    def pairs(
        self, rows: RowBoxes, within_us: int = 0, compared: NDArray[np.bool_] | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return pairs of a given row and a row of the tree that may meet (`may_meet`), also of one object."""
        return self.pairs_of(HeldBoxes.of(rows), within_us, compared)

    def pairs_of(
        self, held: HeldBoxes, within_us: int = 0, compared: NDArray[np.bool_] | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return what `pairs` does, of rows that several trees are asked about."""
        which = Compared.of(within_us, compared)
        found, room = ctypes.c_int64(), 1024
        while True:
            first, second = np.empty(room, np.int64), np.empty(room, np.int64)
            places = (address(first), address(second), room, ctypes.byref(found))
            check(library().kernel_box_tree_pairs(self._handle, ctypes.byref(held), ctypes.byref(which), *places))
            count = found.value
            if count <= room:
                return first[:count], second[:count]
            room = count


def boxes_of(pieces: Pieces) -> Floats:
    """Return the bounding boxes of hulls (n, 4): min x, min y, max x, max y. Every piece must have a hull."""
    if not len(pieces):
        return np.empty((0, 4))
    first = pieces.hull_offset[:-1]
    least_and_most = [extreme.reduceat(pieces.hull_xy, first) for extreme in (np.minimum, np.maximum)]
    return np.concatenate(least_and_most, axis=1)
