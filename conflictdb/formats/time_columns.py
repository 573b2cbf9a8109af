"""Find unread properties of areas that look like times: such areas may be active for longer than intended."""

import re
from collections.abc import Collection, Iterable, Iterator
from typing import Any, Final

from conflictdb.formats.contents import Remark
from conflictdb.model.plans import Area

_INSTANT: Final = re.compile(r"\s*(?:\d{4}[-/]\d\d[-/]\d\d|\d\d?[-/.]\d\d?[-/.]\d{4})(?:[T ]\d\d:\d\d.*)?\s*")
_WORDS: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
# Words of a name that make a number an instant.
_TIME_WORDS: Final = frozenset(
    {"time", "date", "datetime", "timestamp", "from", "to", "since", "until", "till", "valid", "validity", "start"}
    | {"begin", "end", "expiry", "expires", "expiration", "active", "activation", "effective"}
)
# Least number that may be an instant: seconds since 1970, in 1973. Milliseconds are larger.
_LEAST: Final = 1e8
_MOST_NAMED: Final = 20


class TimeColumns:
    """The properties that look like times, of areas without a start or an end."""

    def __init__(self) -> None:
        self._names: dict[str, None] = {}
        self._areas = 0

    def add(self, areas: Iterable[Area]) -> None:
        """Check some areas."""
        for area in areas:
            if area.properties and (area.start_us is None or area.end_us is None):
                names = [name for name, value in area.properties.items() if is_time_like(name, value)]
                self._names.update(dict.fromkeys(names))
                self._areas += bool(names)

    def remarks(self, source: str) -> Iterator[Remark]:
        """Yield one remark that names all of them, if there are any."""
        if self._names:
            named = ", ".join(list(self._names)[:_MOST_NAMED]) + (", …" if len(self._names) > _MOST_NAMED else "")
            areas = f"{self._areas:,} area{'' if self._areas == 1 else 's'}"
            text = (
                f"{areas} without start or end: {named} look like times and are not read; "
                "rename or map what is meant as these"
            )
            yield Remark(source, "file", text)


def without_times(names: Collection[str]) -> str:
    """Return a text that lines have no times, naming their columns that look like times."""
    if not names:
        return "without times"
    return f"without a column times or datetimes ({', '.join(names)} look like times, but not of each point)"


def is_time_like(name: str, value: Any) -> bool:
    """Return whether a value is an instant or a date, or a number that by its name and size represents one."""
    if isinstance(value, str):
        return len(value) < 64 and _INSTANT.fullmatch(value) is not None
    if isinstance(value, bool) or not isinstance(value, int | float) or value < _LEAST:
        return False
    return is_time_name(name)


def is_time_name(name: str) -> bool:
    """Return whether a name has a word of time."""
    return not _TIME_WORDS.isdisjoint(word.lower() for word in _WORDS.findall(name[:200]))
