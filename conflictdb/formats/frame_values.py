"""Convert the cells of data frames to JSON values: no value is lost, one that has no JSON form is refused by name.

In columns of members a value keeps its meaning, or is refused. Columns without a meaning take texts of values that JSON
lacks: ISO 8601, WKT, hexadecimal bytes.
"""

from collections.abc import Iterable, Mapping, Set
from datetime import date, datetime, time, timedelta, tzinfo
from decimal import Decimal
from enum import Enum
from typing import Any, Final
from uuid import UUID
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import shapely

from conflictdb.errors import InvalidInput
from conflictdb.formats import file_objects
from conflictdb.formats.instants import format_instant
from conflictdb.formats.json_text import MAX_DEPTH, dumped
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plan_columns import PLAN_COLUMNS, Form
from conflictdb.model.tolerances import WINDOWS

# Columns of instants, or of lists of them.
INSTANTS: Final = frozenset({"start", "end", "time", "spans", "departures", *file_objects.TIMES, *WINDOWS})
_MEMBERS: Final = file_objects.AREA_MEMBERS | file_objects.TRACK_MEMBERS | INSTANTS | {"id", file_objects.DATUM}
# Members that are words; a schedule contains dates, times of day and durations.
_TEXTS: Final = frozenset({"id", "kind", file_objects.DATUM}) | {
    one.members[0] for one in PLAN_COLUMNS if one.is_member and one.form is not Form.NUMBER
}
_SPAN: Final = "is a span of time, not an instant: give its start_time or end_time"


class TimeZone:
    """The zone for instants without one; if it is None they are refused."""

    def __init__(self, given: str | tzinfo | None) -> None:
        given = getattr(given, "zone", None) or given  # pytz zones would give offsets of a century ago
        self._zone = given if isinstance(given, tzinfo) else None
        if isinstance(given, str):
            try:
                self._zone = ZoneInfo(given)
            except (ZoneInfoNotFoundError, ValueError):
                raise InvalidInput("solve", "time_zone", f"must be the name of a zone; got {given!r:.60}") from None
        elif not isinstance(given, tzinfo | None):
            raise InvalidInput("solve", "time_zone", f"must be the name of a zone, or a tzinfo; got {given!r:.60}")

    def text(self, who: str, field: str, instant: datetime) -> str:
        """Return an instant as ISO 8601 UTC with microseconds, truncated; raises InvalidInput."""
        if instant.utcoffset() is None:
            instant = self._with_zone(who, field, instant)
        return format_instant(int((instant - EPOCH) // MICROSECOND))

    def _with_zone(self, who: str, field: str, instant: datetime) -> datetime:
        if self._zone is None:
            rule = (
                "has no time zone: give it one with tz_localize, or all that have none with solve(..., time_zone=...)"
            )
            raise InvalidInput(who, field, f"{rule}; got {instant.isoformat()}")
        early, late = (instant.replace(tzinfo=self._zone, fold=fold) for fold in (0, 1))
        if early.utcoffset() != late.utcoffset():
            rule = f"is there twice, or not at all, in {self._zone}, where clocks are set: give instants in UTC"
            raise InvalidInput(who, field, f"{rule}; got {instant.isoformat()}")
        return early


def is_of(given: object, library: str, *names: str) -> bool:
    """Return whether an object is of a class of a library, by its name; imports nothing."""
    return any(one.__name__ in names and one.__module__.split(".")[0] == library for one in type(given).__mro__)


def is_missing(value: Any) -> bool:
    """Return whether a cell is missing: None, NaN, NaT, NA, or masked."""
    if value is None or value is np.ma.masked or is_of(value, "pandas", "NAType", "NaTType"):
        return True
    if isinstance(value, np.datetime64 | np.timedelta64):
        return bool(np.isnat(value))
    if isinstance(value, Decimal):
        return value.is_nan()
    return isinstance(value, float | np.floating) and bool(np.isnan(value))


def plain(who: str, column: str, value: Any, zone: TimeZone) -> Any:
    """Return a cell as a JSON value, None if it is missing.

    Instants of the columns INSTANTS become ISO 8601. Raises InvalidInput, with the column and the type, for a value
    that the column cannot have.
    """
    return _Column(who, column, zone).plain(column, value, 0)


class _Column:
    """The meaning of a column."""

    def __init__(self, who: str, name: str, zone: TimeZone) -> None:
        lower = name.lower()
        self.who = who
        self.zone = zone
        self.is_instant = lower in INSTANTS
        self.is_end = lower == "end"  # a date contains its day
        self.is_member = lower in _MEMBERS
        self.takes_texts = not self.is_member or lower in _TEXTS
        self.is_schedule = lower == "schedule"

    def plain(self, where: str, value: Any, depth: int) -> Any:
        """Return a value as a JSON value; raises InvalidInput."""
        if is_missing(value):
            return None
        if depth > MAX_DEPTH:
            raise InvalidInput(self.who, where, f"is nested more than {MAX_DEPTH} deep")
        if isinstance(value, Enum):
            return self.plain(where, value.value, depth + 1)
        if hasattr(value, "as_py"):  # of pyarrow
            return self.plain(where, value.as_py(), depth + 1)
        if isinstance(value, np.timedelta64 | np.complexfloating):
            return self._text(where, value, depth)
        if isinstance(value, str | bool | int | float | np.bool_ | np.number | Decimal):
            return _simple(value)
        if isinstance(value, np.datetime64 | datetime | date):
            return self._moment(where, value)
        if isinstance(value, Mapping):
            return self._object(where, value, depth)
        if isinstance(value, Iterable) and not isinstance(value, bytes | bytearray | memoryview | Set | np.generic):
            if isinstance(value, np.ndarray) and value.ndim == 0:
                return self.plain(where, value[()], depth + 1)
            return [self.plain(f"{where}[{i}]", one, depth + 1) for i, one in enumerate(value)]
        return self._text(where, value, depth)

    def _moment(self, where: str, value: Any) -> Any:
        """Return an instant in UTC, or the text of a date or time that is none here."""
        if isinstance(value, np.datetime64):
            value = value.astype("datetime64[us]").item()
            if not isinstance(value, datetime):
                raise InvalidInput(self.who, where, "must lie in the years 1 to 9999")
        if self.is_instant and not isinstance(value, datetime):
            midnight = datetime(value.year, value.month, value.day)
            return self.zone.text(self.who, where, midnight + timedelta(days=self.is_end))
        if self.is_instant:
            return self.zone.text(self.who, where, value)
        if self.takes_texts:
            return value.isoformat()
        raise self._refusal(where, value)

    def _object(self, where: str, value: Mapping[Any, Any], depth: int) -> dict[str, Any]:
        for name in value:
            if not isinstance(name, str):
                raise InvalidInput(self.who, where, f"must be an object whose names are texts; got {name!r:.60}")
        found = {str(name): self.plain(f"{where}.{name}", one, depth + 1) for name, one in value.items()}
        # A struct of Arrow has all members, in every row.
        return {name: one for name, one in found.items() if one is not None} if self.is_schedule else found

    def _text(self, where: str, value: Any, depth: int) -> Any:
        """Return the text of a value that JSON lacks; raises InvalidInput where it would lose its meaning."""
        if is_of(value, "pandas", "Period", "Interval") and self.is_instant:
            raise InvalidInput(self.who, where, f"{_SPAN}; got a {type(value).__name__}")
        if self.takes_texts:
            if isinstance(value, np.timedelta64):
                value = value.astype("timedelta64[us]").item()
            if isinstance(value, timedelta):
                return f"PT{Decimal(value // MICROSECOND) / 1_000_000:f}S"
            if isinstance(value, time):
                return value.isoformat()
            if isinstance(value, UUID) or is_of(value, "pandas", "Period"):
                return str(value)
        if not self.is_member:
            if isinstance(value, bytes | bytearray | memoryview):
                return bytes(value).hex()
            if isinstance(value, Set):
                return sorted((self.plain(where, one, depth + 1) for one in value), key=dumped)
            if isinstance(value, shapely.Geometry):
                return shapely.to_wkt(value, rounding_precision=-1)
            if isinstance(value, complex) or is_of(value, "pandas", "Interval"):
                return str(value)
        raise self._refusal(where, value)

    def _refusal(self, where: str, value: Any) -> InvalidInput:
        kind = type(value).__name__
        if self.is_member:
            hint = ", which has no order: give a list" if isinstance(value, Set) else ""
            return InvalidInput(self.who, where, f"must not be of the type {kind}{hint}; got {value!r:.60}")
        rule = f"is of the type {kind}, which would be lost: convert the column, or drop it"
        return InvalidInput(self.who, where, f"{rule}; got {value!r:.60}")


def _simple(value: Any) -> str | bool | float:
    if isinstance(value, str):
        return str(value)
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    is_whole = isinstance(value, Decimal) and value.is_finite() and value == value.to_integral_value()
    return int(value) if is_whole else float(value)
