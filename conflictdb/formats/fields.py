"""Read the members of one object of a file with type checks; errors name the member."""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.formats.contents import FileRefusals
from conflictdb.formats.instants import parse_end, parse_instant
from conflictdb.formats.json_text import check_storable, check_text

# Limit of an index entry of the database, with a margin.
MAX_KEY_BYTES: Final = 1000


class Fields:
    """Members of one object, and which of them have been read.

    Parameters
    ----------
    who : str
        The object, as the user knows it: ``track 'T1'``.
    values : Mapping
        Its members. None counts as absent.
    refusals : FileRefusals
        Errors in them, collected until `raise_found`.
    """

    def __init__(self, who: str, values: Mapping[str, Any]) -> None:
        self.who = who
        self.values = values
        self.known: set[str] = set()
        self.refusals = FileRefusals()

    def get(self, name: str) -> Any:
        """Return a member unchecked, None if absent."""
        self.known.add(name)
        return self.values.get(name)

    def has(self, name: str) -> bool:
        """Return whether a member exists and is not null."""
        self.known.add(name)
        return self.values.get(name) is not None

    def text(self, name: str) -> str | None:
        """Return a string member; None if it is absent or invalid."""
        value = self.get(name)
        with self.refusals:
            if value is not None and not isinstance(value, str):
                raise self.refusal(name, f"must be a string; got {value!r:.60}")
            if value is not None:
                check_text(self.who, name, value)
            return value
        return None

    def word(self, name: str) -> str | None:
        """Return a member that names something: a non-empty string, or a number; None if it is absent or invalid."""
        value = self.get(name)
        with self.refusals:
            return None if value is None or value == "" else key(self.who, name, number_as_key(value))
        return None

    def number(self, name: str) -> float | None:
        """Return a finite number member; None if it is absent or invalid."""
        value = self.get(name)
        with self.refusals:
            return None if value is None else finite(self.who, name, value)
        return None

    def document(self, name: str) -> Any:
        """Return a member with any value that a database can store; None if it is absent or invalid."""
        value = self.get(name)
        with self.refusals:
            check_storable(self.who, "", {name: value})
            return value
        return None

    def instant(self, name: str) -> int | None:
        """Return an ISO 8601 instant in microseconds since 1970; None if it is absent or invalid.

        A date without a time as an `end` contains its day.
        """
        value = self.get(name)
        with self.refusals:
            return None if value is None else instant(self.who, name, value, is_end=name == "end")
        return None

    def rest(self) -> dict[str, Any]:
        """Return the members that were not read, nulls included; refuse values that a database cannot store."""
        rest = {name: value for name, value in self.values.items() if name not in self.known}
        with self.refusals:
            check_storable(self.who, "", rest)
        return rest

    def raise_found(self) -> None:
        """Raise the collected errors, if there are any."""
        self.refusals.raise_found()

    def refusal(self, field: str, rule: str) -> InvalidInput:
        """Return the error that refuses a field of this object."""
        return InvalidInput(self.who, field, rule)


def number_as_key(value: Any) -> Any:
    """Return a number as the text of a key, 7 and 7.0 alike; other values unchanged."""
    if type(value) is float and value.is_integer():
        value = int(value)
    return repr(value) if type(value) in (int, float) else value


def key(who: str, where: str, value: Any) -> str:
    """Return the id of an object or the name of a scene: a string that can be stored and indexed."""
    if not isinstance(value, str) or not value:
        raise InvalidInput(who, where, f"must be a non-empty string; got {value!r:.60}")
    check_text(who, where, value)
    if len(value.encode()) > MAX_KEY_BYTES:
        raise InvalidInput(who, where, f"must be at most {MAX_KEY_BYTES} bytes long; got {value[:40]!r}…")
    return value


def finite(who: str, where: str, value: Any) -> float:
    """Return a number as a float; refuse booleans, texts, NaN, infinities and numbers beyond a float's range."""
    if type(value) not in (int, float):
        raise InvalidInput(who, where, f"must be a number; got {value!r:.60}")
    try:
        number = float(value)
    except OverflowError:
        raise InvalidInput(who, where, "is too large a number") from None
    if not math.isfinite(number):
        raise InvalidInput(who, where, f"must be a finite number; got {number}")
    return number


def instant(who: str, where: str, value: Any, *, is_end: bool = False) -> int:
    """Return an ISO 8601 instant in microseconds since 1970; a date without a time as an end contains its day."""
    if not isinstance(value, str):
        raise InvalidInput(who, where, f"must be a date and time as a string; got {value!r:.60}")
    try:
        return parse_end(value) if is_end else parse_instant(value)
    except ValueError as error:
        raise InvalidInput(who, where, str(error)) from None


def instants(who: str, where: str, values: Any, read: Callable[[str, str, Any], int] = instant) -> NDArray[np.int64]:
    """Return a list of instants in microseconds since 1970; `read` converts one of them."""
    if not isinstance(values, list):
        raise InvalidInput(who, where, f"must be a list of dates and times, one per waypoint; got {values!r:.60}")
    return np.array([read(who, f"{where}[{i}]", value) for i, value in enumerate(values)], dtype=np.int64)
