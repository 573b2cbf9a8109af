"""Time zones, clock times and instants in the text of schedules."""

import re
from datetime import UTC, date, datetime, timedelta, timezone, tzinfo
from typing import Any, Final
from zoneinfo import ZoneInfo

from conflictdb.errors import InvalidInput

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_CLOCK: Final = re.compile(r"(\d\d):(\d\d)(?::(\d\d)(?:\.0+)?)?(Z|[+-]\d\d:\d\d)?")
_DAY_S: Final = 86_400


def zone_of(who: str, field: str, name: Any) -> tzinfo:
    """Return the time zone of an IANA name, or of UTC; raises InvalidInput."""
    if name in ("UTC", "Etc/UTC", "Z"):
        return UTC
    try:
        return ZoneInfo(name)
    # An unknown name, one that is a path or a folder, or no text at all.
    except (KeyError, ValueError, OSError, TypeError, AttributeError):
        rule = "must be a time zone of the IANA database, such as Europe/Zurich or UTC"
        raise InvalidInput(who, field, f"{rule}; got {name!r:.60}") from None


def clock_s(who: str, field: str, text: Any) -> tuple[int, tzinfo | None]:
    """Return a clock time as seconds since midnight, 0 to 86,400, and its offset from UTC if given."""
    matched = _CLOCK.fullmatch(text) if isinstance(text, str) else None
    if matched is not None:
        hour, minute, second = (int(part or 0) for part in matched.groups()[:3])
        found = 3600 * hour + 60 * minute + second
        if hour <= 24 and minute < 60 and second < 60 and found <= _DAY_S:
            return found, _offset(who, field, matched[4])
    raise InvalidInput(who, field, f"must be a time of day such as 08:00, up to 24:00; got {text!r:.60}")


def instant_us(who: str, field: str, text: Any) -> int:
    """Return an instant of ISO 8601, with its offset from UTC, in microseconds."""
    try:
        at = datetime.fromisoformat(text)
        if at.utcoffset() is None:
            raise ValueError
        return (at - _EPOCH) // timedelta(microseconds=1)
    except (TypeError, ValueError, OverflowError):
        rule = "must be an instant with its offset, such as 2026-06-01T08:00:00Z"
        raise InvalidInput(who, field, f"{rule}; got {text!r:.60}") from None


def date_of(who: str, field: str, text: Any) -> date:
    """Return a date such as 2026-06-24; raises InvalidInput."""
    try:
        if not isinstance(text, str) or not re.fullmatch(r"\d{4}-\d\d-\d\d", text):
            raise ValueError
        return date.fromisoformat(text)
    except ValueError:
        raise InvalidInput(who, field, f"must be a date such as 2026-06-24; got {text!r:.60}") from None


def _offset(who: str, field: str, text: str | None) -> tzinfo | None:
    if text is None or text == "Z":
        return UTC if text else None
    minutes = int(text[1:3]) * 60 + int(text[4:6])
    if minutes >= 24 * 60 or int(text[4:6]) > 59:
        raise InvalidInput(who, field, f"has an offset from UTC that is none; got {text!r}")
    return timezone(timedelta(minutes=minutes if text[0] == "+" else -minutes)) if minutes else UTC
