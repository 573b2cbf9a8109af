"""Read numbers, times and durations from the texts of XML."""

import re
from typing import Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.fields import finite
from conflictdb.formats.instants import parse_end, parse_instant

_DURATION: Final = re.compile(
    r"P(?:(?P<days>\d+)D)?(?:T(?:(?P<hours>\d+)H)?(?:(?P<minutes>\d+)M)?(?:(?P<seconds>\d+(?:\.\d+)?)S)?)?"
)
_SECONDS: Final = {"days": 86_400, "hours": 3600, "minutes": 60, "seconds": 1}


def number_of(who: str, field: str, text: str | None) -> float:
    """Return the number of a text of XML; raises InvalidInput."""
    try:
        return finite(who, field, float(text or ""))
    except ValueError as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(who, field, f"must be a number; got {text!r:.40}") from None


def time_of(who: str, field: str, text: str | None, *, is_end: bool = False) -> int | None:
    """Return a time in microseconds since 1970, None for no text; raises InvalidInput.

    is_end : a date without a time contains its day
    """
    if text is None:
        return None
    try:
        return parse_end(text) if is_end else parse_instant(text)
    except ValueError as error:
        raise InvalidInput(who, field, str(error)) from None


def duration_us(who: str, field: str, text: str) -> int:
    """Return a duration such as PT2H30M in microseconds; raises InvalidInput, also for months and years."""
    given = _DURATION.fullmatch(text)
    if given is None or text in ("P", "PT") or text.endswith("T") or len(text) > 40:
        raise InvalidInput(who, field, f"must be a duration such as PT2H30M; got {text!r:.40}")
    return round(1e6 * sum(_SECONDS[unit] * float(one) for unit, one in given.groupdict().items() if one))
