"""What formats hold of times, heights, speeds, sizes and limits: what is read, and what is only remarked.

Each reader declares its `Standard` once. Other names that look like one of these quantities are remarked too.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property, lru_cache
from typing import Any, Final

from conflictdb.formats.contents import Remark
from conflictdb.formats.xml_text import Element

_WORDS: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_LONGEST: Final = 200
_MOST_NAMED: Final = 40


class Quantity(StrEnum):
    """What a name of a file says: its value, in the plural, is for messages."""

    TIME = "times"
    HEIGHT = "heights"
    SPEED = "speeds"
    SIZE = "sizes"
    LIMIT = "limits"


_OF_WORDS: Final = {
    Quantity.TIME: "time times date dates datetime datetimes timestamp from since until till valid validity start "
    "begin end expiry expires expiration active activation effective eta etd ata atd when stay duration period periods "
    "hour hours day days schedule interval",
    Quantity.SPEED: "speed speeds velocity sog stw knots kn kt kts mps",
    Quantity.HEIGHT: "height heights altitude altitudes alt elevation elev ele floor ceiling depth draught draft ukc "
    "masthead airdraft lower upper agl amsl msl level",
    Quantity.SIZE: "size length width beam radius diameter loa breadth",
    Quantity.LIMIT: "limit limits xtd xtdl maximum minimum max min tolerance accuracy hdop vdop pdop",
}
# The first quantity that a word of a name has: a maximum speed is a speed.
_BY_WORD: Final = {word: one for one, words in reversed(_OF_WORDS.items()) for word in words.split()}
# Ends of words, as in baroaltitude.
_ENDS: Final = (
    *("altitude", "height", "depth", "draught", "draft", "speed", "velocity"),
    *("length", "width", "radius", "timestamp", "datetime", "duration"),
)
# Words of names that say when data were made, not when an object is active.
MADE: Final = re.compile("creat|updat|modif|publi|issue|edit|version", re.IGNORECASE)


@lru_cache(maxsize=4096)
def quantity_of(name: str) -> Quantity | None:
    """Return what a name looks like, None if it looks like none of these."""
    words = [word.lower() for word in _WORDS.findall(name[:_LONGEST])]
    words += [end for word in words for end in _ENDS if word.endswith(end)]
    found = [_BY_WORD[word] for word in words if word in _BY_WORD]
    return min(found, key=list(Quantity).index, default=None)


@dataclass(frozen=True)
class Standard:
    """What a format holds of these quantities; each key is a name, or names separated by blanks.

    title : of the format
    read : names that are read, and what they become
    unread : names that are remarked, and what they say
    aside : names that look like these quantities and say nothing of an object, and what they say
    within : elements of XML that are looked at; none: all
    """

    title: str
    read: Mapping[str, str]
    unread: Mapping[str, str] = field(default_factory=dict)
    aside: Mapping[str, str] = field(default_factory=dict)
    within: tuple[str, ...] = ()

    @cached_property
    def _of_name(self) -> dict[str, str]:
        """What is done with each name: the name of the member above that has it."""
        return {
            name: kind
            for kind, names in (("read", self.read), ("unread", self.unread), ("aside", self.aside))
            for group in names
            for name in group.split()
        }

    def names(self, kind: str) -> list[str]:
        """Return the names that are read, unread or aside."""
        return [name for name, own in self._of_name.items() if own == kind]

    def kind(self, name: str, outer: str = "") -> str | None:
        """Return what is done with a name, perhaps of an outer one: read, unread or aside; None if it is not known."""
        of_name = self._of_name
        return of_name.get(f"{outer}/{name}") or of_name.get(name)

    def is_unread(self, name: str, outer: str = "") -> bool:
        """Return whether a name with a value is to be remarked."""
        kind = self.kind(name, outer)
        return kind == "unread" or (kind is None and quantity_of(name) is not None and MADE.search(name) is None)

    def of_xml(self, root: Element) -> Counter[str]:
        """Return how often names occur in XML that are not read."""
        found: Counter[str] = Counter()
        waiting = [(one, "") for one in (root.all(*self.within) if self.within else (root,))]
        while waiting:
            element, outer = waiting.pop()
            kind = self.kind(element.name, outer)
            if kind == "aside":
                continue
            has_value = bool(element.text) and not element.children
            if kind == "unread" or (has_value and self.is_unread(element.name, outer)):
                found[element.name] += 1
                continue
            found.update(
                name for name, text in element.attributes.items() if text.strip() and self.is_unread(name, element.name)
            )
            waiting += [(child, element.name) for child in element.children]
        return found

    def of_json(self, document: Any) -> Counter[str]:
        """Return how often names occur in JSON that are not read."""
        found: Counter[str] = Counter()
        waiting: list[tuple[str, Any]] = [("", document)]
        while waiting:
            outer, value = waiting.pop()
            if isinstance(value, list):
                waiting += [(outer, one) for one in value if isinstance(one, dict | list)]
            elif isinstance(value, dict):
                for name, one in value.items():
                    kind = self.kind(name, outer)
                    if one in (None, "") or kind == "aside":
                        continue
                    is_leaf = not isinstance(one, dict) and not _has_objects(one)
                    if kind == "unread" or (is_leaf and self.is_unread(name, outer)):
                        found[name] += 1
                    elif not is_leaf:
                        waiting.append((name, one))
        return found

    def remarks(self, source: str, found: Counter[str]) -> Iterator[Remark]:
        """Yield a remark that names what is not read and how often it occurs, if there is any."""
        if found:
            named = ", ".join(f"{name} ({count:,})" for name, count in sorted(found.items())[:_MOST_NAMED])
            named += ", …" if len(found) > _MOST_NAMED else ""
            looks = sorted({quantity_of(name) or Quantity.LIMIT for name in found}, key=list(Quantity).index)
            yield Remark(source, "file", f"has {', '.join(looks)} that are not read: {named}")


def _has_objects(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(one, dict) or _has_objects(one) for one in value[:1])


def altitudes(source: str, count: int) -> Iterator[Remark]:
    """Yield a remark on objects with a third coordinate, if there are any."""
    if count:
        text = f"{count:,} object{' has' if count == 1 else 's have'} altitudes (third coordinates) that are not read"
        yield Remark(source, "file", f"{text}: heights are floor_m and ceiling_m")
