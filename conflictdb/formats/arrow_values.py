"""Convert Arrow columns to JSON values, for properties and members of objects."""

from collections.abc import Iterator
from datetime import UTC, date, datetime
from decimal import Decimal
from itertools import pairwise
from math import isfinite
from typing import Any

import numpy as np
import pyarrow as pa

from conflictdb.arrays.arrow.columns import lists, numbers
from conflictdb.arrays.arrow.forms import Array
from conflictdb.errors import InvalidInput
from conflictdb.formats import wkb
from conflictdb.formats.instants import format_instant
from conflictdb.model.inputs import EPOCH, MICROSECOND


def plain(name: str, column: Array) -> list[Any]:
    """Return the values of a column as JSON values; None for missing values, NaN and infinities.

    Instants are ISO 8601, to the nearest microsecond, with Z if they have a zone; bytes are hexadecimal. Raises
    InvalidInput for instants outside of the years 1 to 9999.
    """
    of, types = column.type, pa.types
    if types.is_dictionary(of):
        return plain(name, column.dictionary_decode())
    if types.is_timestamp(of):
        return _instants(name, column)
    if types.is_fixed_size_list(of):
        column = column.cast(pa.list_(of.value_type))
        of = column.type
    if types.is_map(of):
        column = column.cast(pa.list_(pa.struct([("key", of.key_type), ("value", of.item_type)])))
        of = column.type
    if types.is_list(of) or types.is_large_list(of):
        items, offset = lists(column)
        values = plain(name, items)
        known = column.is_valid().to_pylist()
        return [values[i:j] if ok else None for ok, (i, j) in zip(known, pairwise(offset.tolist()), strict=True)]
    if types.is_struct(of):
        names = [field.name for field in of]
        members = [plain(f"{name}.{own}", part) for own, part in zip(names, column.flatten(), strict=True)]
        known = column.is_valid().to_pylist()
        rows = zip(*members, strict=True) if members else (() for _ in known)
        return [dict(zip(names, row, strict=True)) if ok else None for ok, row in zip(known, rows, strict=True)]
    if types.is_floating(of):
        return [None if value is None or not isfinite(value) else value for value in column.to_pylist()]
    if types.is_boolean(of) or types.is_integer(of) or types.is_string(of) or types.is_large_string(of):
        return list(column.to_pylist())
    try:
        return [_text(value) for value in column.to_pylist()]
    except (ValueError, OverflowError, pa.ArrowException) as error:
        raise InvalidInput("file", f"column {name}", f"cannot be read: {error}") from error


def leaves(name: str, of: "pa.Schema | pa.DataType") -> Iterator[str]:
    """Yield a name for each column of simple values; a struct yields one per member."""
    if isinstance(of, pa.Schema | pa.StructType):
        for member in of:
            yield from leaves(member.name, member.type)
    elif isinstance(of, pa.ListType | pa.LargeListType | pa.FixedSizeListType):
        yield from leaves(name, of.value_type)
    else:
        yield name


def check_wkb(name: str, column: Array, first_row: int) -> None:
    """Raise InvalidInput for WKB that GEOS must not decode."""
    try:
        wkb.check(column.to_pylist(), first_row)
    except ValueError as error:
        raise InvalidInput("file", f"column {name}", f"holds what is no geometry in WKB: {error}") from error


def _instants(name: str, column: Array) -> list[Any]:
    """Return instants as ISO 8601, to the nearest microsecond."""
    if column.type.unit == "ns":
        since = column.view(pa.int64())
        us = np.asarray((numbers(since.fill_null(0)) + 500) // 1000)
        column = pa.array(us, mask=numbers(column.is_null())).view(pa.timestamp("us", column.type.tz))
    try:
        whole = column.cast(pa.timestamp("us", column.type.tz)).view(pa.int64()).to_pylist()
        if column.type.tz is not None:
            return [None if us is None else format_instant(us) for us in whole]
        return [None if us is None else (EPOCH + us * MICROSECOND).replace(tzinfo=None).isoformat() for us in whole]
    except (OverflowError, pa.ArrowException):
        raise InvalidInput("file", f"column {name}", "holds instants outside of the years 1 to 9999") from None


def _text(value: Any) -> Any:
    if value is None:
        return None
    if isinstance(value, Decimal):
        return float(value) if value.is_finite() else None
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, datetime):
        return value.astimezone(UTC).isoformat()
    return value.isoformat() if isinstance(value, date) else str(value)
