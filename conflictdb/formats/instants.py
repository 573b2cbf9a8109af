"""ISO 8601 instants from and to whole microseconds since 1970-01-01T00:00Z."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.formats.hints import with_offset
from conflictdb.model.inputs import EPOCH, MICROSECOND

# Digits after the sixth: datetime would truncate them, here they are rounded.
_FINER: Final = re.compile(r"([.,]\d{6})(\d+)")

# The end of a day, which is the next midnight.
_MIDNIGHT: Final = re.compile(
    r"(\d{4}-?\d\d-?\d\d[T ])24(:?00(?::?00(?:[.,]0+)?)?)?(?=Z|[+-]\d|$)", re.ASCII | re.IGNORECASE
)
# A date without a time.
_DATE: Final = re.compile(r"\d{4}-?\d\d-?\d\d", re.ASCII)
_DAY: Final = timedelta(days=1)

# The places of digits and separators in 2026-03-01T06:00:00Z, and in 2026-03-01T06:00:00.000000Z.
_PLAIN: Final = ("0000-00-00T00:00:00Z", "0000-00-00T00:00:00.000000Z")

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
    given, later = text, timedelta(0)
    if (midnight := _MIDNIGHT.match(text)) is not None:
        text, later = f"{midnight[1]}00{midnight[2] or ''}{text[midnight.end() :]}", _DAY
    try:
        moment = datetime.fromisoformat(text.upper()) + later
    except ValueError:
        raise ValueError(
            f"must be a date and time in ISO 8601, such as 2026-03-01T06:00:00Z; got {given[:_LONGEST]!r}"
        ) from None
    except OverflowError:
        raise ValueError(f"must lie in the years 1 to 9999; got {given[:_LONGEST]!r}") from None
    if moment.tzinfo is None:
        local = with_offset(moment)
        if local is None and not naive_is_utc:
            raise ValueError(f"{OFFSET_RULE}; got {given[:_LONGEST]!r}")
        moment = local or moment.replace(tzinfo=UTC)
    return (moment - EPOCH) // MICROSECOND + carry


def parse_end(text: str, *, naive_is_utc: bool = False) -> int:
    """Return an end of a span as `parse_instant`; a date without a time is the whole day, which ends at midnight."""
    if _DATE.fullmatch(text) is None:
        return parse_instant(text, naive_is_utc=naive_is_utc)
    parse_instant(text, naive_is_utc=naive_is_utc)  # its refusal says the date as it is given
    return parse_instant(text + ("T24:00" if "-" in text else "T2400"), naive_is_utc=naive_is_utc)


def parse_plain(texts: Sequence[str]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return (n,) the instants of texts such as 2026-03-01T06:00:00Z, also with six decimals, and which texts are.

    The result is that of `parse_instant`.
    """
    us, is_plain = np.zeros(len(texts), np.int64), np.zeros(len(texts), np.bool_)
    length = np.fromiter(map(len, texts), np.int64, len(texts))
    for form in _PLAIN:
        rows = np.flatnonzero(length == len(form))
        if not rows.size:
            continue
        some = texts if rows.size == len(texts) else [texts[i] for i in rows.tolist()]
        letters = np.frombuffer("".join(some).encode("ascii", "replace"), np.uint8).reshape(-1, len(form))
        wanted = np.frombuffer(form.encode(), np.uint8)
        is_digit = wanted == ord("0")
        digits = letters - np.uint8(ord("0"))  # below "0" wraps to above 9
        fits = (digits[:, is_digit] <= 9).all(axis=1) & (letters[:, ~is_digit] == wanted[~is_digit]).all(axis=1)
        year, month, day, hour, minute, second, fraction = (
            digits[:, place].astype(np.int64) @ 10 ** np.arange(place.stop - place.start - 1, -1, -1)
            for place in map(slice, (0, 5, 8, 11, 14, 17, 20), (4, 7, 10, 13, 16, 19, max(len(form) - 1, 20)))
        )
        of_month = (12 * (year - 1970) + month - 1).astype("datetime64[M]")
        before, after = (one.astype("datetime64[D]").astype(np.int64) for one in (of_month, of_month + 1))
        fits &= (year > 0) & (month > 0) & (month <= 12) & (day > 0) & (day <= after - before)
        fits &= (hour < 24) & (minute < 60) & (second < 60)
        seconds = 86_400 * (before + day - 1) + 3600 * hour + 60 * minute + second
        us[rows], is_plain[rows] = np.where(fits, 1_000_000 * seconds + fraction, 0), fits
    return us, is_plain


def format_instant(instant_us: int) -> str:
    """Return an instant (microseconds since 1970, years 1 to 9999) as the shortest exact ISO 8601 text in UTC."""
    return (EPOCH + instant_us * MICROSECOND).isoformat().removesuffix("+00:00") + "Z"
