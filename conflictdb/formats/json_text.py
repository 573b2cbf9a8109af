"""Parse strict JSON: refuse, with its place, what PostgreSQL's jsonb or the model cannot store."""

import json
import math
import re
import sys
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

from conflictdb.errors import InvalidInput

MAX_DEPTH: Final = 100  # levels of nesting: more than any scene file has, and below Python's own limit
_LONGEST_NAME: Final = 100  # characters of a member's name in a message
# Characters that JSON need not escape but a terminal may obey: DEL and C1 controls, direction marks, zero-width
# characters, and Unicode's line separators.
_OBEYED: Final = re.compile("[\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]")

SPACE: Final = re.compile(r"[ \t\n\r]*")


def parse(text: str) -> Any:
    """Return the value of a JSON text.

    NaN and Infinity become floats, so that later errors can name the object and field: `check_storable` and the number
    checks of `fields` refuse them. Raises InvalidInput for invalid JSON.
    """
    try:
        return json.loads(text, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise refused(error, (error.lineno, error.colno), is_at_end=error.pos >= len(text.rstrip())) from None
    except (RecursionError, ValueError) as error:
        raise refused(error) from None


def refused(
    error: RecursionError | ValueError, place: tuple[int, int] = (0, 0), *, is_at_end: bool = False
) -> InvalidInput:
    """Return the refusal of an invalid JSON text; an InvalidInput is returned itself.

    error : of Python's parser
    place : line and column, counted from 1; is_at_end : whether that is where the text ends
    """
    if isinstance(error, InvalidInput):
        return error
    if isinstance(error, json.JSONDecodeError):
        end = "the file ends too early: " if is_at_end else ""
        return InvalidInput("JSON", "line {}, column {}".format(*place), f"{end}{error.msg[0].lower()}{error.msg[1:]}")
    if isinstance(error, RecursionError):
        return InvalidInput("JSON", "", "is nested too deeply")
    # More digits than Python converts.
    return InvalidInput("JSON", "", "holds a whole number of thousands of digits, out of range")


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


def once(names: Sequence[str]) -> None:
    """Raise InvalidInput for a member that occurs twice in one object."""
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice is not None:
        raise InvalidInput("JSON", twice[:_LONGEST_NAME], "appears twice in one object")


def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the members of a JSON object; none may occur twice."""
    members = dict(pairs)
    if len(members) < len(pairs):
        once([name for name, _ in pairs])
    return members
