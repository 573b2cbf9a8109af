"""Parse strict JSON: refuse, with its place, what PostgreSQL's jsonb or the model cannot store."""

import json
import math
import re
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any, Final, TypeAlias

from conflictdb.errors import InvalidInput

MAX_DEPTH: Final = 100  # levels of nesting: more than any scene file has, and below Python's own limit
_LONGEST_NAME: Final = 100  # characters of a member's name in a message
# Characters that JSON need not escape but a terminal may obey: DEL and C1 controls, direction marks, zero-width
# characters, and Unicode's line separators.
_OBEYED: Final = re.compile("[\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]")

Watch: TypeAlias = Callable[[int], object]
_SPACE: Final = re.compile(r"[ \t\n\r]*")
_EACH: Final = 1000  # features from one report of progress to the next


def parse(text: str, watch: Watch | None = None) -> Any:
    """Return the value of a JSON text.

    watch : called with the number of characters read so far, now and then in a long list of features

    NaN and Infinity become floats, so that later errors can name the object and field: `check_storable` and the number
    checks of `fields` refuse them. Raises InvalidInput for invalid JSON.
    """
    try:
        return _by_features(text, watch)
    except InvalidInput:
        raise
    except (ValueError, IndexError, RecursionError):
        pass  # another kind of text, or invalid: the following names the place
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        end = "the file ends too early: " if error.pos >= len(text.rstrip()) else ""
        raise InvalidInput("JSON", place, f"{end}{error.msg[0].lower()}{error.msg[1:]}") from None
    except InvalidInput:
        raise
    except RecursionError:
        raise InvalidInput("JSON", "", "is nested too deeply") from None
    except ValueError:  # more digits than Python converts
        raise InvalidInput("JSON", "", "holds a whole number of thousands of digits, out of range") from None


def dumped(value: Any, indent: int | None = None) -> str:
    """Return a value as JSON that is safe to print on a terminal and parses to the same value."""
    return harmless(json.dumps(value, ensure_ascii=False, allow_nan=False, indent=indent))


def harmless(text: str) -> str:
    """Escape characters of JSON that control a terminal."""
    return text if text.isascii() and "\x7f" not in text else _OBEYED.sub(lambda c: f"\\u{ord(c[0]):04x}", text)


def check_storable(who: str, where: str, value: Any, depth: int = 0) -> None:
    """Refuse a JSON value that a database cannot store, or other programs cannot read.

    That is NaN, infinities and numbers beyond a double's range, NUL and lone surrogates in text, and deep nesting.
    """
    if depth > MAX_DEPTH:
        raise InvalidInput(who, where.split(".")[0], f"is nested more than {MAX_DEPTH} deep")
    if isinstance(value, str):
        check_text(who, where, value)
    elif isinstance(value, float):
        if not math.isfinite(value):
            raise InvalidInput(who, where, f"must be a finite number; got {value}")
    elif isinstance(value, int):
        if abs(value) > sys.float_info.max:
            raise InvalidInput(who, where, "is too large a number")
    elif isinstance(value, dict):
        for name, member in value.items():
            check_text(who, where, name)
            place = name[:_LONGEST_NAME]
            check_storable(who, f"{where}.{place}" if where else place, member, depth + 1)
    elif isinstance(value, list):
        for i, member in enumerate(value):
            check_storable(who, f"{where}[{i}]", member, depth + 1)


def check_text(who: str, where: str, text: str) -> None:
    """Refuse a text that cannot be stored as UTF-8 in PostgreSQL."""
    if "\0" in text:
        raise InvalidInput(who, where, "must not contain the character U+0000")
    if not text.isascii():
        try:
            text.encode()
        except UnicodeEncodeError:
            raise InvalidInput(who, where, "contains half of a surrogate pair, which is no character") from None


def _by_features(text: str, watch: Watch | None) -> dict[str, Any]:
    """Return a JSON object, each of whose `features` is parsed by a call of its own; raises for all other texts."""
    decode = json.JSONDecoder(object_pairs_hook=_unique).raw_decode
    members: list[tuple[str, Any]] = []
    at = _after(text, _after(text, 0, ""), "{")
    while not members or text[at] == ",":
        at = _after(text, at, "," if members else "")
        name, at = decode(text, at)
        at = _after(text, _after(text, at, ""), ":")
        if name == "features" and text[at] == "[":
            value, at = _elements(text, at, decode, watch)
        else:
            value, at = decode(text, at)
        members.append((name, value))
        at = _after(text, at, "")
    document = _unique(members)
    if _after(text, at, "}") < len(text) or not all(isinstance(name, str) for name in document):
        raise ValueError
    return document


def _elements(
    text: str, at: int, decode: Callable[[str, int], tuple[Any, int]], watch: Watch | None
) -> tuple[list[Any], int]:
    """Return the elements of a list that begins at a place, not empty, and the place after it."""
    elements: list[Any] = []
    at = _after(text, at, "[")
    while not elements or text[at] == ",":
        element, at = decode(text, _after(text, at, "," if elements else ""))
        elements.append(element)
        at = _after(text, at, "")
        if watch is not None and len(elements) % _EACH == 0:
            watch(at)
    return elements, _after(text, at, "]")


def _after(text: str, at: int, letter: str) -> int:
    """Return the place after a letter (or none) and the space behind it; raises ValueError for another letter."""
    space = _SPACE.match(text, at + len(letter))
    if space is None or not text.startswith(letter, at):
        raise ValueError
    return space.end()


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) < len(pairs):
        twice = next(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
        raise InvalidInput("JSON", twice[:_LONGEST_NAME], "appears twice in one object")
    return members
