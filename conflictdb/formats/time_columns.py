"""Find unread properties that look like times, heights or sizes of objects without these."""

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, Final

from conflictdb.formats.contents import Remark
from conflictdb.formats.standards import MADE, Quantity, quantity_of
from conflictdb.model.plans import Area, Track, has_heights, has_size

_INSTANT: Final = re.compile(r"\s*(?:\d{4}[-/]\d\d[-/]\d\d|\d\d?[-/.]\d\d?[-/.]\d{4})(?:[T ]\d\d:\d\d.*)?\s*")
# First characters of instants and numbers.
_FIRST: Final = frozenset("0123456789+-.F \t")
# Least number that may be an instant: seconds since 1970, in 1973. Milliseconds are larger.
_LEAST: Final = 1e8
_MOST_NAMED: Final = 20
_LACKS: Final = {
    Quantity.TIME: "start or end",
    Quantity.HEIGHT: "floor and ceiling",
    Quantity.SIZE: "a size",
}

# A number, perhaps with its unit, such as "2000 ft" or "FL95".
_NUMBER: Final = re.compile(r"\s*(?:FL\s?)?[-+]?\d{1,7}(?:[.,]\d{1,6})?\s*[A-Za-z]{0,5}\s*")
# Values of an area that are looked at.
_MOST_VALUES: Final = 200


class UnreadProperties:
    """The properties that look like times, heights or sizes of objects that have none of these."""

    def __init__(self) -> None:
        self._names: dict[tuple[Quantity, str], dict[str, None]] = defaultdict(dict)
        self._objects: Counter[tuple[Quantity, str]] = Counter()

    def add(self, objects: Iterable[Area | Track]) -> None:
        """Check some objects."""
        for item in objects:
            lacks = _lacks(item) if item.properties else ()
            if not lacks:
                continue
            of = "area" if isinstance(item, Area) else "track"
            alike: dict[Quantity, dict[str, None]] = defaultdict(dict)
            for name, value in _each_value(item.properties):
                looks = _looks_like(name, value)
                if looks in lacks:
                    alike[looks][name] = None
            for quantity, names in alike.items():
                self._names[quantity, of].update(names)
                self._objects[quantity, of] += 1

    def remarks(self, source: str) -> Iterator[Remark]:
        """Yield one remark for each of these quantities that names all properties."""
        for (quantity, of), names in sorted(self._names.items()):
            named = ", ".join(list(names)[:_MOST_NAMED]) + (", …" if len(names) > _MOST_NAMED else "")
            count = self._objects[quantity, of]
            objects = f"{count:,} {of}{'' if count == 1 else 's'} without {_LACKS[quantity]}"
            text = f"{objects}: {named} look like {quantity} and are not read"
            yield Remark(source, "file", f"{text}; rename or map what is meant as these")


def _lacks(item: Area | Track) -> list[Quantity]:
    has = {Quantity.HEIGHT: has_heights(item)}
    if isinstance(item, Area):
        has[Quantity.TIME] = item.start_us is not None and item.end_us is not None
    else:
        has[Quantity.SIZE] = has_size(item)
    return [quantity for quantity, is_given in has.items() if not is_given]


def _looks_like(name: str, value: Any) -> Quantity | None:
    """Return what a property looks like; times of nested objects that say when data were made look like nothing."""
    if isinstance(value, str) and value[:1] not in _FIRST:
        return None  # most texts
    if is_time_like(name, value):
        return None if "." in name and MADE.search(name) else Quantity.TIME
    if type(value) in (int, float) or (isinstance(value, str) and len(value) < 40 and _NUMBER.fullmatch(value)):
        looks = quantity_of(name.rpartition(".")[2])
        return None if looks is Quantity.TIME else looks
    return None


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
    return quantity_of(name) is Quantity.TIME or name.lower() == "to"
