"""Read a JSON object some elements of its list `features` at a time, from text that arrives in parts.

Memory is that of the parts in use and of the largest element, not of the text. The rules and the errors are those of
`json_text`.
"""

import json
from collections.abc import Callable, Iterator
from typing import Any, Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.contents import TOO_LARGE
from conflictdb.formats.json_text import SPACE, once, refused, unique

# A text that ends within a value breaks a rule of JSON at most so far from its end, but for texts without their end.
_AT_END: Final = 16
_LIST: Final = "features"
# Characters that end a part.
_PART: Final = 4_000_000


class NoObjectError(Exception):
    """The text is no JSON object."""


def members(
    chunks: Iterator[str], at_once: int, most: float, watch: Callable[[int], object] | None = None
) -> Iterator[tuple[str, Any, bool]]:
    """Yield the members of a JSON object: name, value, and whether the value is a part of the list `features`.

    at_once : elements of that list in a part; fewer if they are large
    most : characters of an element, and of all members but that list together
    watch : called with the number of characters read so far, after each part

    Raises InvalidInput for invalid JSON and for names that occur twice, NoObjectError for another value.
    """
    text = _ArrivingText(chunks, most)
    kept = 0
    if text.next() != "{":
        raise NoObjectError
    text.skip()
    names: list[str] = []
    while text.next() != "}" or names:
        if text.next() != '"':
            text.refuse("Expecting property name enclosed in double quotes")
        name = text.value()
        names.append(name)
        text.require(":", "Expecting ':' delimiter")
        if name == _LIST and text.next() == "[":
            once(names)  # before its parts are used
            for part in _elements(text, at_once):
                yield name, part, True
                if watch is not None:
                    watch(text.place)
        else:
            began = text.place
            yield name, text.value(), False
            kept += text.place - began
            if kept > most:
                raise too_large(most)
        if text.next() != ",":
            break
        text.skip()
    text.require("}", "Expecting ',' delimiter")
    once(names)
    if text.next():
        text.refuse("Extra data")


def joined(chunks: Iterator[str], most: float) -> str:
    """Return a text that arrives in parts; raises InvalidInput beyond the limit of characters."""
    found, size = [], 0
    for chunk in chunks:
        found.append(chunk)
        size += len(chunk)
        if size > most:
            raise too_large(most)
    return "".join(found)


def too_large(most: float) -> InvalidInput:
    """Return the refusal of a text of more characters, of a kind that is kept in memory."""
    return InvalidInput("file", "", f"holds more than {most / 1e6:g} MB{TOO_LARGE}")


def _elements(text: "_ArrivingText", at_once: int) -> Iterator[list[Any]]:
    """Yield the elements of a list that begins here, at least one part."""
    text.skip()
    part: list[Any] = []
    began = text.place
    if text.next() != "]":
        part.append(text.value())
        while text.next() == ",":
            text.skip()
            if len(part) == at_once or text.place - began > _PART:
                yield part
                part = []
                began = text.place
            part.append(text.value())
    text.require("]", "Expecting ',' delimiter")
    yield part


class _ArrivingText:
    """A part of a text, and a place in it.

    here : those characters
    at : the place in them
    done : the number of characters before them
    """

    def __init__(self, chunks: Iterator[str], most: float) -> None:
        self._chunks = chunks
        self._most = most
        self._is_whole = False
        # Line breaks before `here`, and characters since the last one.
        self._lines = self._column = 0
        self.here, self.at, self.done = "", 0, 0

    @property
    def place(self) -> int:
        """The number of characters before the place."""
        return self.done + self.at

    def next(self) -> str:
        """Return the next character that is no space, at which the place is then; empty at the end."""
        while True:
            self.at = SPACE.match(self.here, self.at).end()  # type: ignore[union-attr]
            if self.at < len(self.here) or not self._more():
                return self.here[self.at : self.at + 1]

    def skip(self) -> None:
        """Pass a character."""
        self.at += 1

    def require(self, character: str, rule: str) -> None:
        """Pass a character; raises InvalidInput for another one."""
        if self.next() != character:
            self.refuse(rule)
        self.at += 1

    def refuse(self, rule: str) -> None:
        """Raise the InvalidInput for a character that breaks a rule of JSON."""
        raise self._refused(json.JSONDecodeError(rule, self.here, self.at))

    def value(self) -> Any:
        """Return the value that begins here, and pass it."""
        self.next()
        while True:
            try:
                value, end = _DECODE(self.here, self.at)
            except json.JSONDecodeError as error:
                is_cut = error.msg.startswith("Unterminated string") or error.pos > len(self.here) - _AT_END
                if not (is_cut and self._more()):
                    raise self._refused(error) from None
            except (RecursionError, ValueError) as error:
                raise refused(error) from None
            else:
                # A number may go on in the next chunk.
                if end < len(self.here) or isinstance(value, dict | list | str) or not self._more():
                    self.at = end
                    return value

    def _more(self) -> bool:
        """Fetch characters, as many as are here at least; return whether there are any."""
        if self._is_whole:
            return False
        if len(self.here) - self.at > self._most:
            raise too_large(self._most)
        found, size, wanted = [self.here[self.at :]], 0, len(self.here) - self.at
        while size <= wanted and not self._is_whole:
            chunk = next(self._chunks, "")
            self._is_whole = not chunk
            found.append(chunk)
            size += len(chunk)
        if not size:
            return False
        dropped = self.here[: self.at]
        breaks = dropped.count("\n")
        self._lines += breaks
        self._column = len(dropped) - dropped.rfind("\n") - 1 if breaks else self._column + len(dropped)
        self.done += self.at
        self.here, self.at = "".join(found), 0
        return True

    def _refused(self, error: json.JSONDecodeError) -> InvalidInput:
        """Return the refusal of the text, with the place of an error in what is here."""
        column = error.colno + (self._column if error.lineno == 1 else 0)
        is_at_end = self._is_whole and error.pos >= len(self.here.rstrip())
        return refused(error, (self._lines + error.lineno, column), is_at_end=is_at_end)


_DECODE: Final = json.JSONDecoder(object_pairs_hook=unique).raw_decode
