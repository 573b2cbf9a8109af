"""ISO 8601 instants from and to whole microseconds since 1970-01-01T00:00Z."""

import re
from datetime import UTC, datetime
from typing import Final

from conflictdb.formats.hints import with_offset
from conflictdb.model.inputs import EPOCH, MICROSECOND

# Digits after the sixth: datetime would truncate them, here they are rounded.
_FINER: Final = re.compile(r"([.,]\d{6})(\d+)")

_LONGEST: Final = 60  # characters of an invalid text in a message

OFFSET_RULE: Final = "needs an offset from UTC, such as 2026-03-01T06:00:00Z or 2026-03-01T07:00:00+01:00"


def parse_instant(text: str, *, naive_is_utc: bool = False) -> int:
    """Return the microseconds since 1970 of an ISO 8601 date and time; finer fractions are rounded to the nearest.

    Raises ValueError, with the rule as its message, if it is invalid or has no offset (unless `naive_is_utc`, or
    hints give a time zone).
    """
    finer = _FINER.search(text) if len(text) > 26 else None
    carry = 0
    if finer:
        carry = int(finer[2][0] >= "5")
        text = text[: finer.end(1)] + text[finer.end(2) :]
    try:
        moment = datetime.fromisoformat(text.upper())
    except ValueError:
        raise ValueError(
            f"must be a date and time in ISO 8601, such as 2026-03-01T06:00:00Z; got {text[:_LONGEST]!r}"
        ) from None
    if moment.tzinfo is None:
        local = with_offset(moment)
        if local is None and not naive_is_utc:
            raise ValueError(f"{OFFSET_RULE}; got {text[:_LONGEST]!r}")
        moment = local or moment.replace(tzinfo=UTC)
    return (moment - EPOCH) // MICROSECOND + carry


def format_instant(instant_us: int) -> str:
    """Return an instant (microseconds since 1970, years 1 to 9999) as the shortest exact ISO 8601 text in UTC."""
    return (EPOCH + instant_us * MICROSECOND).isoformat().removesuffix("+00:00") + "Z"


def format_moment(moment: datetime | None) -> str | None:
    """Return a moment as ISO 8601 UTC with microseconds, None for an unbounded end."""
    if moment is None:
        return None
    if moment.tzinfo is not UTC:
        moment = moment.astimezone(UTC)
    return f"{moment.isoformat(timespec='microseconds')[:-6]}Z"
