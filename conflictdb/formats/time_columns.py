"""Find unread properties of areas that look like times: such areas may be active for longer than intended."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
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


# Names of limits of heights, in lower case.
_HEIGHT: Final = re.compile(
    r"(lower|upper|min|max|minimum|maximum|bottom|top)[-_ ]?(limit|alt|altitude|height|level|vertical)(_?(m|ft|feet))?$"
)
# Nested values that say when data were made, not when an area is active.
_MADE: Final = re.compile("creat|updat|modif|publi|issue|edit|version", re.IGNORECASE)
# Values of an area that are looked at.
_MOST_VALUES: Final = 200


class TimeColumns:
    """The properties that look like times, or heights, of areas without a start or an end, or heights."""

    def __init__(self) -> None:
        self._names: dict[str, None] = {}
        self._areas = 0
        self._heights: dict[str, None] = {}
        self._unbounded = 0

    def add(self, areas: Iterable[Area]) -> None:
        """Check some areas."""
        for area in areas:
            if area.properties and (area.start_us is None or area.end_us is None):
                values = [one for one in _each_value(area.properties) if not ("." in one[0] and _MADE.search(one[0]))]
                names = [name for name, value in values if is_time_like(name, value)]
                self._names.update(dict.fromkeys(names))
                self._areas += bool(names)
            if area.properties and area.floor_m is None and area.ceiling_m is None:
                names = [name for name, value in _each_value(area.properties) if _is_height_like(name, value)]
                self._heights.update(dict.fromkeys(names))
                self._unbounded += bool(names)

    def remarks(self, source: str) -> Iterator[Remark]:
        """Yield one remark that names all of them, and one for heights, if there are any."""
        for names, count, lack, alike in (
            (self._names, self._areas, "start or end", "times"),
            (self._heights, self._unbounded, "floor and ceiling", "heights"),
        ):
            if names:
                named = ", ".join(list(names)[:_MOST_NAMED]) + (", …" if len(names) > _MOST_NAMED else "")
                areas = f"{count:,} area{'' if count == 1 else 's'}"
                text = f"{areas} without {lack}: {named} look like {alike} and are not read"
                yield Remark(source, "file", f"{text}; rename or map what is meant as these")


def _each_value(properties: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the simple values of properties, also of objects and lists in them, by their path; at most a few."""
    waiting: list[tuple[str, Any]] = list(properties.items())[::-1]
    for _ in range(_MOST_VALUES):
        if not waiting:
            return
        name, value = waiting.pop()
        if isinstance(value, dict):
            waiting += [(f"{name}.{own}"[:200], one) for own, one in value.items()][::-1]
        elif isinstance(value, list):
            waiting += [(name, one) for one in value[:_MOST_NAMED]][::-1]
        else:
            yield name, value


def _is_height_like(name: str, value: Any) -> bool:
    """Return whether a number has a name of a lower or upper limit of heights."""
    return type(value) in (int, float) and _HEIGHT.search(name.rpartition(".")[2].lower()) is not None


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
