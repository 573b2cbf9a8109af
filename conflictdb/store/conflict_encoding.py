"""Columns of rows of conflicts, as PostgreSQL takes them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.polygons import SRID, Polygons
from conflictdb.model.plans import MINUS_INFINITY_US
from conflictdb.model.record import MEASURED, STATES, Column, ColumnType
from conflictdb.model.results import Certainty, Verdict
from conflictdb.store import copy_binary

Columns = dict[str, copy_binary.Column]
_VERDICT_NAMES = copy_binary.Ragged.of([Verdict.of_code(code).encode() for code in range(len(Verdict))])

# By code, from -1 on.
_CERTAINTIES = copy_binary.Ragged.of([None, *(one.encode() for one in sorted(Certainty, key=lambda one: one.code))])


def columns_of(found: Conflicts, region: Polygons) -> Columns:
    """Return those that follow from what was found (n,), and where each is (n,)."""
    columns: Columns = {
        "a_kind": copy_binary.fixed(found.a_kind, "i2"),
        "b_kind": copy_binary.fixed(found.b_kind, "i2"),
        "verdict": _VERDICT_NAMES.take(found.verdict.astype(np.int64)),
        "periods": copy_binary.multispans(found.period_us, found.period_offset),
        "region": copy_binary.Ragged(region.data, region.offset, np.diff(region.offset) == 0),
    }
    return columns | {one.name: _column(one, getattr(found, one.array)) for one in (*MEASURED, *STATES)}


def _column(column: Column, values: NDArray[Any]) -> copy_binary.Column:
    """Return an array of `Conflicts` as a column; what is not known is null."""
    if column.type is ColumnType.POINT:
        return copy_binary.points(values, SRID)
    if column.type is ColumnType.INSTANT:
        return copy_binary.nullable(copy_binary.instants(values), values == MINUS_INFINITY_US)
    if column.type is ColumnType.NAME:
        return _CERTAINTIES.take(values.astype(np.int64) + 1)
    if column.type is ColumnType.WHOLE:
        return copy_binary.fixed(values, "i8")
    stored = copy_binary.fixed(values, "f8")
    return stored if column.required else copy_binary.nullable(stored, np.isnan(values))
