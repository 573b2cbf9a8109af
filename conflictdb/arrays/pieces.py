"""Represent pieces as arrays: the convex parts of areas and the slices of tracks, and bundles of them.

Units: metres, degrees for longitude, latitude and bearings, microseconds since 1970. Hulls and shapes are ragged
(`ragged`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any, Final, NewType, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.column_numbers import CLASS
from conflictdb.arrays.ragged import followed_by, offsets, ragged_rows
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US

# Row numbers in a `Pieces`: not ids of objects, nor of the database.
PieceRows = NewType("PieceRows", np.ndarray[Any, np.dtype[np.int64]])

# How far heights of a piece may be beyond those of its object, metres: with a vertical separation they are rounded, and
# in a scene with closed intervals those of climbs are extended by this.
HEIGHT_ROUNDING_M: Final = 1e-9
# Numbers of the pieces of tracks with tolerances count from here; no object has as many.
OF_TOLERANCES: Final = 2**30


def halves(within_us: int) -> tuple[int, int]:
    """Return by how much spans begin earlier and end later, so that they meet exactly if they come within a time."""
    return within_us // 2, within_us - within_us // 2


def later(at_us: NDArray[np.int64], by_us: int | NDArray[np.int64]) -> NDArray[np.int64]:
    """Return instants (n,) moved on by some microseconds; infinite ones stay."""
    return at_us + np.where((at_us == MINUS_INFINITY_US) | (at_us == INFINITY_US), 0, by_us)


def level_m(floor_m: NDArray[np.float64], ceiling_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return heights (n,) that do not change, as `Pieces.climb_m`."""
    return np.stack([floor_m, floor_m, ceiling_m, ceiling_m], axis=1)


@dataclass(frozen=True, slots=True)
class Pieces:
    """n pieces: the unit that stages 1 to 4 work on.

    piece_id : (n,) int64         database id; -1 before it has one
    kind : (n,) int8              Kind of the object: 0 area, 1 track
    object_id, version : (n,) int64
    part : (n,) int32             number of the piece within its object, from 0, or with tolerances from OF_TOLERANCES;
        the seam copy shares it
    turn : (n,) int16             0, or -1, -2, ... for a seam copy: shifted by this many whole turns of longitude
    start_us, end_us : (n,) int64 MINUS_INFINITY_US, INFINITY_US where unbounded
    end_inclusive : (n,) bool     whether the instant end_us belongs to the piece (inner slices: yes, the object's
        end: no)
    floor_m, ceiling_m : (n,) float64   the lowest and the highest, -inf, +inf where unbounded
    climb_m : (n, 4) float64      floor at the start and the end of the leg, then the ceilings; linear in between
    hull_xy, hull_offset : (h, 2) float64, (n + 1,) int64   padded convex hull of everything the piece covers, closed
        ring, plane coordinates in metres, shifted by `turn`
    shape_xy, shape_offset : (s, 2) float64, (n + 1,) int64  open ring, counter-clockwise, not shifted. Area: the exact
        convex part in the plane, metres. Track: the outline (starboard, forward) at the start of the leg, metres
    shape_to_xy : (s, 2) float64  the same vertices at the end of the leg; the very same array where nothing changes
    leg_start_us, leg_end_us : (n,) int64   tracks: the whole leg that the slice is cut from (areas: 0)
    leg_start_deg, leg_end_deg : (n, 2) float64   tracks: longitude (unwrapped, not shifted) and latitude (areas: 0)
    bearing_deg : (n,) float64    tracks: heading of the haven, clockwise from north (areas: 0)
    numbers : (n, k) int64        of the values IN_PIECES of the object (`column_numbers`): class, owner; 0 without
    """

    piece_id: NDArray[np.int64]
    kind: NDArray[np.int8]
    object_id: NDArray[np.int64]
    version: NDArray[np.int64]
    part: NDArray[np.int32]
    turn: NDArray[np.int16]
    start_us: NDArray[np.int64]
    end_us: NDArray[np.int64]
    end_inclusive: NDArray[np.bool_]
    floor_m: NDArray[np.float64]
    ceiling_m: NDArray[np.float64]
    climb_m: NDArray[np.float64]
    hull_xy: NDArray[np.float64]
    hull_offset: NDArray[np.int64]
    shape_xy: NDArray[np.float64]
    shape_to_xy: NDArray[np.float64]
    shape_offset: NDArray[np.int64]
    leg_start_us: NDArray[np.int64]
    leg_end_us: NDArray[np.int64]
    leg_start_deg: NDArray[np.float64]
    leg_end_deg: NDArray[np.float64]
    bearing_deg: NDArray[np.float64]
    numbers: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.piece_id)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        arrays = {id(array): array for array in (getattr(self, one.name) for one in fields(self))}
        return sum(array.nbytes for array in arrays.values())

    @property
    def excuses(self) -> bool:
        """Whether pairs may be left out for what their pieces have besides classes."""
        return bool(np.delete(self.numbers, CLASS, axis=1).any())

    @property
    def class_number(self) -> NDArray[np.int64]:
        """Return the numbers (n,) of classes, 0 without."""
        return self.numbers[:, CLASS]

    @property
    def changes(self) -> bool:
        """Whether any haven has a different outline at the end of its leg."""
        return self.shape_to_xy is not self.shape_xy

    def changed(self) -> NDArray[np.bool_]:
        """Return (n,) whether the shape of a piece differs at the end of its leg."""
        found = np.zeros(len(self), np.bool_)
        if self.changes:
            differs = (self.shape_to_xy != self.shape_xy).any(axis=1)
            found[np.repeat(np.arange(len(self)), np.diff(self.shape_offset))[differs]] = True
        return found

    def climbs(self) -> NDArray[np.bool_]:
        """Return (n,) whether the heights of a piece change along its leg."""
        climb = self.climb_m
        return (climb[:, 0] != climb[:, 1]) | (climb[:, 2] != climb[:, 3])

    def shared_span(self, a: PieceRows, b: PieceRows) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return (start_us, end_us) of the shared time of pieces a and b, (n,) each; unbounded where both are."""
        return np.maximum(self.start_us[a], self.start_us[b]), np.minimum(self.end_us[a], self.end_us[b])

    def longer(self, before_us: int | NDArray[np.int64], after_us: int | NDArray[np.int64]) -> Self:
        """Return the pieces with spans that begin earlier and end later, by microseconds for all or (n,) each."""
        return self.having(start_us=later(self.start_us, -before_us), end_us=later(self.end_us, after_us))

    def meeting_within(self, within_us: int) -> Self:
        """Return pieces whose spans meet exactly if the spans of these come within a number of microseconds."""
        return self.longer(*halves(within_us)) if within_us else self

    def having(self, **columns: NDArray[Any]) -> Self:
        """Return the pieces with other columns: as `replace`, in an eighth of the calls."""
        return type(self)(**(dict(zip(_NAMES, _columns(self), strict=True)) | columns))

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the pieces of some rows."""
        own = zip(_ONE_A_PIECE, _one_a_piece(self), strict=True)
        columns: dict[str, Any] = {name: column[rows] for name, column in own}
        columns["hull_offset"], index = ragged_rows(self.hull_offset, rows)
        columns["hull_xy"] = self.hull_xy[index]
        columns["shape_offset"], index = ragged_rows(self.shape_offset, rows)
        shape = columns["shape_xy"] = self.shape_xy[index]
        columns["shape_to_xy"] = self.shape_to_xy[index] if self.changes else shape
        return type(self)(**columns)

    @classmethod
    def concatenate(cls, batches: Sequence["Pieces"]) -> "Pieces":
        """Return the pieces of all batches in one; at least one batch."""
        if len(batches) == 1:
            return batches[0]
        changes = any(batch.changes for batch in batches)
        names = (*_ONE_A_PIECE, "hull_xy", "shape_xy", *(["shape_to_xy"] if changes else []))
        each = zip(names, zip(*map(attrgetter(*names), batches), strict=True), strict=True)
        columns: dict[str, Any] = {name: np.concatenate(some) for name, some in each}
        for name in ("hull_offset", "shape_offset"):
            columns[name] = followed_by([getattr(batch, name) for batch in batches])
        return cls(**({"shape_to_xy": columns["shape_xy"]} | columns))


_NAMES: Final = tuple(one.name for one in fields(Pieces))
_columns: Final = attrgetter(*_NAMES)
# Columns of one value, or one row of values, a piece.
_ONE_A_PIECE: Final = tuple(name for name in _NAMES if not name.endswith(("_xy", "_offset")))
_one_a_piece: Final = attrgetter(*_ONE_A_PIECE)


@dataclass(frozen=True, slots=True)
class Bundles:
    """m bundles of pieces, each stored as one row: nearby pieces of one object, with the same turn and heights.

    pieces : n, those of a bundle adjacent; slices in the order of time, each beginning when the one before ends
    offset : (m + 1,) int64  bundle i contains pieces [offset[i], offset[i + 1]), at least one
    """

    pieces: Pieces
    offset: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.offset) - 1

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the bundles of some rows."""
        offset, index = ragged_rows(self.offset, rows)
        return type(self)(self.pieces.take(index), offset)

    @classmethod
    def of_each(cls, pieces: Pieces) -> Self:
        """Return one bundle per piece."""
        return cls(pieces, np.arange(len(pieces) + 1))

    @classmethod
    def concatenate(cls, batches: Sequence["Bundles"]) -> Self:
        """Return the bundles of all batches in one; at least one batch."""
        sizes = np.concatenate([np.diff(batch.offset) for batch in batches])
        return cls(Pieces.concatenate([batch.pieces for batch in batches]), offsets(sizes))
