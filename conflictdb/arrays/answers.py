"""Represent answers as arrays: contacts of pairs of pieces, conflicts of pairs of objects."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.polygons import Polygons
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.model.plans import MINUS_INFINITY_US
from conflictdb.model.record import MEASURED, ColumnType

_UNKNOWN_OF: Final[dict[ColumnType, tuple[Any, Any]]] = {
    ColumnType.NUMBER: (np.nan, np.float64),
    ColumnType.POINT: (np.nan, np.float64),
    ColumnType.INSTANT: (MINUS_INFINITY_US, np.int64),
    ColumnType.NAME: (-1, np.int8),
}
# Measured columns, the shape of a row, and value and type where they are not computed.
_UNKNOWN: Final = tuple(
    (one.array, (2,) if one.type is ColumnType.POINT else (), _UNKNOWN_OF[one.type]) for one in MEASURED
)


@dataclass(frozen=True, slots=True)
class Contacts:
    """m intervals during which pairs of pieces interfere, or might.

    pair : (m,) int64          row number of the pair in the input, not decreasing
    start_s, end_s : (m,) float64   seconds after the start of the pair's shared span; the true interval lies within
    error_s : (m,) float64     bound on how far either end may lie outside of the true one, seconds
    verdict : (m,) int8        Verdict.code
    touches : (m,) bool        true if they meet, false if they only come within the tolerance
    """

    pair: NDArray[np.int64]
    start_s: NDArray[np.float64]
    end_s: NDArray[np.float64]
    error_s: NDArray[np.float64]
    verdict: NDArray[np.int8]
    touches: NDArray[np.bool_]

    def of_pairs(self, rows: NDArray[np.int64]) -> "Contacts":
        """Return the same contacts with pair k renumbered to rows[k]."""
        return Contacts(rows[self.pair], *_beside_pairs(self))

    def take(self, rows: NDArray[np.int64]) -> "Contacts":
        """Return the contacts of some rows."""
        return Contacts(*(column[rows] for column in _of_contacts(self)))

    def __len__(self) -> int:
        return len(self.pair)

    @classmethod
    def none(cls) -> Self:
        """Return no contacts."""
        times = np.empty(0)
        return cls(np.empty(0, np.int64), times, times, times, np.empty(0, np.int8), np.empty(0, np.bool_))

    @classmethod
    def concatenate(cls, batches: Sequence["Contacts"]) -> Self:
        """Return all contacts in one, sorted by pair and start."""
        some = [batch for batch in batches if len(batch.pair)] or [cls.none()]
        each = map(_of_contacts, some)
        columns = next(each) if len(some) == 1 else [np.concatenate(column) for column in zip(*each, strict=True)]
        order = np.lexsort((columns[1], columns[0]))
        return cls(*(column[order] for column in columns))


_of_contacts: Final = attrgetter(*(one.name for one in fields(Contacts)))
_beside_pairs: Final = attrgetter(*(one.name for one in fields(Contacts)[1:]))

# Kinds (n,) int8, ids and versions (n,) int64 of objects.
Members = tuple[NDArray[np.int8], NDArray[np.int64], NDArray[np.int64]]
# Ends (p, 2) and offsets (n + 1,), as in `Conflicts`.
Periods = tuple[NDArray[np.int64], NDArray[np.int64]]


def _unknown(rows: NDArray[np.int64]) -> Polygons:
    return Polygons.none(len(rows))


@dataclass(frozen=True, slots=True)
class Conflicts:
    """n pairs of objects that interfere, or might, or come near each other (near pairs have no periods).

    The order of a and b within a pair is free: the store puts the area, else the smaller key, first.

    a_kind, b_kind : (n,) int8
    a_id, b_id, a_version, b_version : (n,) int64
    period_us, period_offset : (p, 2) int64, (n + 1,) int64   inclusive, increasing, disjoint; MINUS_INFINITY_US and
        INFINITY_US where unbounded
    verdict : (n,) int8            Verdict.code
    first_contact_deg : (n, 2) float64   longitude and latitude of the first contact; NaN if not computed
    time_error_s : (n,) float64    bound on the error of every end of every period, seconds; 0 if exact
    closest_us : (n,) int64        instant of the closest approach; MINUS_INFINITY_US if there is none
    closest_m : (n,) float64       distance then, metres on the earth; NaN if not computed
    closest_error_m : (n,) float64   bound on |closest_m - true least distance|, metres; NaN if not computed
    closest_a_deg, closest_b_deg : (n, 2) float64   longitude and latitude of the nearest points then; NaN if not
        computed
    lacking_s : (n,) float64       seconds by which the separation in time is missed; NaN if none is required or known
    certainty : (n,) int8          Certainty.code; -1 if neither has tolerances, or the verdict is unresolved or near
    where : computes the regions of some rows (k,)
    """

    a_kind: NDArray[np.int8]
    a_id: NDArray[np.int64]
    a_version: NDArray[np.int64]
    b_kind: NDArray[np.int8]
    b_id: NDArray[np.int64]
    b_version: NDArray[np.int64]
    period_us: NDArray[np.int64]
    period_offset: NDArray[np.int64]
    verdict: NDArray[np.int8]
    first_contact_deg: NDArray[np.float64]
    time_error_s: NDArray[np.float64]
    closest_us: NDArray[np.int64]
    closest_m: NDArray[np.float64]
    closest_error_m: NDArray[np.float64]
    closest_a_deg: NDArray[np.float64]
    closest_b_deg: NDArray[np.float64]
    lacking_s: NDArray[np.float64]
    certainty: NDArray[np.int8]
    where: Callable[[NDArray[np.int64]], Polygons] = _unknown

    def __len__(self) -> int:
        return len(self.a_id)

    @classmethod
    def of_members(cls, a: Members, b: Members, periods: Periods, verdict: NDArray[np.int8], **measured: Any) -> Self:
        """Return conflicts of objects a and b; columns of `measured` that are absent are not computed."""
        n = len(verdict)
        measured.setdefault("time_error_s", np.zeros(n))
        for name, shape, (value, dtype) in _UNKNOWN:
            if name not in measured:
                measured[name] = np.full((n, *shape), value, dtype)
        (a_kind, a_id, a_version), (b_kind, b_id, b_version) = a, b
        return cls(a_kind, a_id, a_version, b_kind, b_id, b_version, *periods, verdict, **measured)

    @classmethod
    def none(cls) -> Self:
        """Return no conflicts."""
        kind, number = np.empty(0, np.int8), np.empty(0, np.int64)
        nothing = kind, number, number
        return cls.of_members(nothing, nothing, (np.empty((0, 2), np.int64), np.zeros(1, np.int64)), kind)

    def take(self, rows: NDArray[np.int64]) -> "Conflicts":
        """Return some of the rows (k,), without `where`."""
        offset, periods = ragged_rows(self.period_offset, rows)
        taken: dict[str, Any] = {
            column.name: getattr(self, column.name)[rows] for column in fields(self) if column.name not in _OWN_WAY
        }
        taken |= {"period_us": self.period_us[periods], "period_offset": offset}
        return Conflicts(**taken)

    def turned(self, rows: NDArray[np.bool_]) -> "Conflicts":
        """Return all rows, with a and b exchanged in some of them (n,)."""
        if not rows.any():
            return self
        columns: dict[str, Any] = {}
        for pair in _OF_EITHER:
            a, b = (getattr(self, name) for name in pair)
            which = rows if a.ndim == 1 else rows[:, None]
            columns |= zip(pair, (np.where(which, b, a), np.where(which, a, b)), strict=True)
        return replace(self, **columns)

    @classmethod
    def concatenate(cls, batches: Sequence["Conflicts"]) -> "Conflicts":
        """Return the conflicts of all batches in one, without `where`; at least one batch."""
        if len(batches) == 1:
            return replace(batches[0], where=_unknown)
        columns: dict[str, Any] = {}
        for column in fields(cls):
            if column.name == "where":
                continue
            parts = [getattr(batch, column.name) for batch in batches]
            if column.name == "period_offset":
                ends = np.cumsum([0, *(part[-1] for part in parts)])
                parts = [np.zeros(1, np.int64), *(part[1:] + end for part, end in zip(parts, ends, strict=False))]
            columns[column.name] = np.concatenate(parts)
        return cls(**columns)


# Columns of conflicts that do not have one value per row.
_OWN_WAY: Final = {"period_us", "period_offset", "where"}
# Pairs of columns for a and b.
_OF_EITHER: Final = [
    ("a_kind", "b_kind"),
    ("a_id", "b_id"),
    ("a_version", "b_version"),
    ("closest_a_deg", "closest_b_deg"),
]
