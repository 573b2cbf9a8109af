"""Parse values of the command line: numbers with units, instants, places."""

import argparse
import os
import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta, tzinfo
from itertools import pairwise
from math import ulp
from sys import float_info
from typing import Final

from conflictdb.core.memory_budget import LEAST_MEMORY_MB
from conflictdb.errors import InvalidInput
from conflictdb.model.methods import REMOVED
from conflictdb.model.units import METRES_PER_NMI, Units

# Columns of a table of conflicts on request.
MORE_COLUMNS: Final = ("position", "microseconds", "acknowledged")

_MOST_MB: Final = 1e6  # a terabyte, unpacked: more is a wrong unit
_MOST_S: Final = 1e9  # 31 years: more is a wrong unit
# The first unit is that of a number without one; words and abbreviations that people try are units, too.
_UNITS_M: Final = {
    **dict.fromkeys(("m", "metres", "meters"), 1.0),
    "km": 1000.0,
    **dict.fromkeys(("nmi", "nm", "NM"), METRES_PER_NMI),
    **dict.fromkeys(("ft", "feet"), 0.3048),
}
_UNITS_KN: Final = {
    **dict.fromkeys(("kn", "kt", "kts", "knots"), 1.0),
    "m/s": 3600.0 / METRES_PER_NMI,
    **dict.fromkeys(("km/h", "kmh"), 1000.0 / METRES_PER_NMI),
}
_UNITS_S: Final = {
    "ms": 0.001,
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("m", "min", "mins", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
# Numbers with units, of each the longest that fits.
_PART: Final = re.compile(
    rf"(\d{{1,12}}(?:\.\d{{1,12}})?)\s*({'|'.join(sorted(_UNITS_S, key=len, reverse=True))})(?![a-z])"
)
_PARTS: Final = re.compile(rf"(?:{_PART.pattern}\s*)+")
_POINTS: Final = ["n", "nne", "ne", "ene", "e", "ese", "se", "sse", "s", "ssw", "sw", "wsw", "w", "wnw", "nw", "nnw"]


def name(text: str) -> str:
    """Return a valid name of a scene."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise argparse.ArgumentTypeError(f"must be UTF-8; got {text!a}") from None
    return text


def method(text: str) -> str:
    """Return the name of a method; those that are not known are refused by the choices."""
    if text in REMOVED:
        raise argparse.ArgumentTypeError(f"{text!r} {REMOVED[text]}")
    return text


def mapping(text: str) -> dict[str, str]:
    """Return the fields of ``key=id,floor_m=-depth_ft*0.3048``; commas in parentheses and quotes do not separate."""
    parts, depth, quote, start = [], 0, "", 0
    for i, sign in enumerate(text):
        if quote:
            quote = "" if sign == quote else quote
        elif sign in "'\"":
            quote = sign
        elif sign in "([":
            depth += 1
        elif sign in ")]":
            depth -= 1
        elif sign == "," and depth == 0:
            parts.append(text[start:i])
            start = i + 1
    fields = {}
    for part in [*parts, text[start:]]:
        match = re.fullmatch(r"\s*(\w+)\s*=(.*)", part, re.DOTALL)
        if not match or not match[2].strip() or match[1] in fields:
            raise argparse.ArgumentTypeError(f"must be FIELD=COLUMN, each field once, parted by commas; got {part!r}")
        fields[match[1]] = match[2].strip()
    return fields


def option(text: str) -> tuple[str, str]:
    """Return name and value of an option of Spark, ``spark.driver.memory=8g``."""
    key, equals, value = text.partition("=")
    if not equals or not key.startswith("spark."):
        raise argparse.ArgumentTypeError(
            f"must be KEY=VALUE, a setting of Spark such as spark.driver.memory=8g; got {text!r}"
        )
    return key.strip(), value


def place(text: str) -> tuple[float, float]:
    """Return longitude and latitude in degrees of ``9.5,54``."""
    parts = text.split(",")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"must be LONGITUDE,LATITUDE in degrees; got {text!r}")
    lon, lat = (_number(part, "LONGITUDE,LATITUDE in degrees", least=-360.0) for part in parts)
    return lon, lat


def metres(text: str) -> float:
    """Return a distance in metres, 0 or more, of ``500``, ``500m``, ``2km``, ``0.5nmi`` or ``300ft``."""
    rule = "a distance, 0 or more, in metres or with a unit, such as 500, 2km, 0.5nmi or 300ft"
    return _in_unit(text, _UNITS_M, rule, least=0.0)


def bearing_deg(text: str) -> float:
    """Return a bearing in degrees clockwise from north, of 270 or of a point of the compass, W or west."""
    rule = "a bearing in degrees, from -360 to 360, or a point of the compass such as W or NNE"
    point = re.sub("[ -]", "", text.lower())
    for word in ("north", "east", "south", "west"):
        point = point.replace(word, word[0])
    if point in _POINTS:
        return 22.5 * _POINTS.index(point)
    return _number(text.strip().removesuffix("°"), rule, least=-360.0, most=360.0)


def haven(text: str) -> dict[str, float]:
    """Return how far a haven reaches, metres, of ``500,200,150,150``: fore, aft, port, starboard."""
    parts = text.split(",")
    if len(parts) != 4:
        raise argparse.ArgumentTypeError(f"must be FORE,AFT,PORT,STARBOARD, four distances; got {text!r}")
    sides = ("fore_m", "aft_m", "port_m", "starboard_m")
    return {side: metres(part) for side, part in zip(sides, parts, strict=True)}


def speed_kn(text: str) -> float:
    """Return a speed in knots, more than 0, of ``12``, ``12kn``, ``6m/s`` or ``22km/h``."""
    rule = "a speed, more than 0, in knots or with a unit, such as 12, 6m/s or 22km/h"
    return _in_unit(text, _UNITS_KN, rule, least=ulp(0.0))


def hours(text: str) -> float:
    """Return hours, more than 0, of a number of hours or a duration."""
    if _duration_s(text.strip()) is not None:
        return duration_s(text) / 3600.0
    return _number(text, "a duration such as 90m or 6h, or a number of hours, more than 0", least=ulp(0.0))


def megabytes(text: str) -> float:
    """Return a size in millions of bytes, more than 0."""
    rule = f"a number of megabytes, more than 0 and at most {_MOST_MB:g}"
    return _number(text, rule, least=ulp(0.0), most=_MOST_MB)


def memory_mb(text: str) -> int:
    """Return a whole number of megabytes, enough for a detection."""
    return _whole(text, f"{LEAST_MEMORY_MB} or more", LEAST_MEMORY_MB, 10**9)


def count(text: str) -> int:
    """Return a whole number, 1 or more."""
    return _whole(text, "1 or more", 1, 999_999)


def whole(text: str) -> int:
    """Return a whole number, 0 or more."""
    return _whole(text, "0 or more", 0, 10**18)


def weight(text: str) -> tuple[str, float]:
    """Return key and number of ``FERRY=2.5``."""
    key, value = _assigned(text)
    return key, _number(value, "KEY=NUMBER, above 0", least=5e-324)


def level(text: str) -> tuple[str, int]:
    """Return key and whole number of ``FERRY=-1``."""
    key, value = _assigned(text)
    try:
        return key, int(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be KEY=WHOLE NUMBER; got {text!r}") from None


def _assigned(text: str) -> tuple[str, str]:
    """Return key and value; a key may contain ``=``."""
    key, equals, value = text.rpartition("=")
    if not (key and equals):
        raise argparse.ArgumentTypeError(f"must be KEY=NUMBER; got {text!r}")
    return key, value


def address(text: str) -> tuple[str, int]:
    """Return host and port of ``9187``, ``0.0.0.0:9187`` or ``[::1]:9187``; the default host is this machine only."""
    match = re.fullmatch(r"(?:(?P<host>[^:\[\]]+|\[[^\[\]]+\]):)?(?P<port>[0-9]{1,5})", text)
    if not match or int(match["port"]) > 65535:
        raise argparse.ArgumentTypeError(f"must be a port, or HOST:PORT; got {text!r}")
    return (match["host"] or "127.0.0.1").strip("[]"), int(match["port"])


def port(text: str) -> int:
    """Return a port number, or 0."""
    return _whole(text, "from 0 to 65535", 0, 65535)


def duration_s(text: str) -> float:
    """Return a duration such as 30s, 5m, 1.5h, 1d, 1h7m or 1:07:24 in seconds, as the program prints them."""
    value_s = _duration_s(text.strip())
    if not value_s:
        rule = "must be a duration with a unit, such as 30s, 5m, 1h7m or 1:07:24"
        raise argparse.ArgumentTypeError(f"{rule}; got {text!r}")
    if value_s > _MOST_S:
        raise argparse.ArgumentTypeError(f"must be at most 11574d, 31 years; got {text!r}")
    return value_s


def delay_s(text: str) -> float:
    """Return a duration in seconds, negative after a minus sign: earlier."""
    sign, rest = (
        (-1.0, text.strip()[1:]) if text.strip()[:1] in ("-", "\u2212") else (1.0, text.strip().removeprefix("+"))
    )
    return sign * duration_s(rest)


def step_s(text: str) -> float:
    """Return a duration in seconds, or 0."""
    return 0.0 if text.strip() == "0" else duration_s(text)


def margin(text: str) -> tuple[float, float]:
    """Return a margin in time, seconds, and in distance, metres, of `5m` (minutes) or `0.5nmi`; one of them is 0."""
    if text.strip() == "0":
        return 0.0, 0.0
    # A bare m is a minute here, as in all times of the command line.
    if text.strip().endswith(tuple(_UNITS_M.keys() - {"m"})):
        return 0.0, metres(text)
    try:
        return duration_s(text), 0.0
    except argparse.ArgumentTypeError:
        rule = "must be a time such as 5m (minutes) or 90s, or a distance such as 0.5nmi, 2km or 500metres"
        raise argparse.ArgumentTypeError(f"{rule}; got {text!r}") from None


def _duration_s(text: str) -> float | None:
    """Return h:mm:ss, h:mm, or numbers with units, largest first, in seconds; None for anything else."""
    if clock := re.fullmatch(r"(\d{1,9}):([0-5]\d)(?::([0-5]\d(?:\.\d{1,9})?))?", text):
        return 3600.0 * int(clock[1]) + 60.0 * int(clock[2]) + float(clock[3] or 0.0)
    if not _PARTS.fullmatch(text):
        return None
    parts = [(float(number), _UNITS_S[unit]) for number, unit in _PART.findall(text)]
    in_order = all(unit > smaller for (_, unit), (_, smaller) in pairwise(parts))
    return sum(number * unit for number, unit in parts) if in_order else None


def seconds(text: str) -> float:
    """Return seconds, or a duration in seconds: for options with the unit in their name."""
    number = re.fullmatch(r"(\d{1,12}(?:\.\d{1,12})?)\s*s?", text.strip())
    return duration_s(text) if number is None else _number(number[1], "must be at most 11574d, 31 years", 0.0, _MOST_S)


def days(text: str) -> float:
    """Return a number of days."""
    return float(text)


def instant(text: str) -> datetime:
    """Return an ISO 8601 instant with offset."""
    from conflictdb.formats.instants import parse_instant
    from conflictdb.model.inputs import EPOCH, MICROSECOND

    try:
        return EPOCH + parse_instant(text) * MICROSECOND
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def instants(text: str) -> list[datetime]:
    """Return ISO 8601 instants with offset, separated by commas."""
    return [instant(part.strip()) for part in text.split(",")]


def time(text: str) -> datetime:
    """Return an ISO 8601 instant, or a date, its midnight; naive without offset, for `aware`."""
    if re.search(r"(Z|[+-]\d\d(:?\d\d)?)$", text.strip(), re.IGNORECASE) and len(text.strip()) > 10:
        return instant(text)
    text = text.strip()
    try:
        return instant(f"{text}T00:00Z" if re.fullmatch(r"\d{4}-\d\d-\d\d", text) else f"{text}Z").replace(tzinfo=None)
    except argparse.ArgumentTypeError:
        rule = "must be a date, or a date and time, in ISO 8601, such as 2026-03-01 or 2026-03-01T06:00Z"
        raise argparse.ArgumentTypeError(f"{rule}; got {text!r:.60}") from None


def time_or_age(text: str) -> datetime:
    """Return an instant as `time` does, or for a duration such as 24h or 1d the instant so long ago."""
    if re.fullmatch(r"\d+(\.\d+)?\s*[a-z]+", text.strip()):
        return datetime.now(UTC) - timedelta(seconds=duration_s(text))
    try:
        return time(text)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{error}; or so long ago, such as 24h or 7d") from None


def chosen_units() -> Units:
    """Return the units of CONFLICTDB_UNITS, by default nautical; raises InvalidInput for others."""
    text = os.environ.get("CONFLICTDB_UNITS") or Units.NAUTICAL
    if text not in list(Units):
        raise InvalidInput("CONFLICTDB_UNITS", "", f"must be {' or '.join(Units)}; got {text!r:.60}")
    return Units(text)


def chosen_zone() -> tzinfo:
    """Return the time zone of CONFLICTDB_TZ, by default UTC; raises InvalidInput for others."""
    text = os.environ.get("CONFLICTDB_TZ")
    try:
        return zone(text) if text else UTC
    except argparse.ArgumentTypeError as error:
        raise InvalidInput("CONFLICTDB_TZ", "", str(error)) from None


def zone(text: str) -> tzinfo:
    """Return a time zone by its name."""
    from zoneinfo import ZoneInfo, ZoneInfoNotFoundError  # few commands are given one

    try:
        return ZoneInfo(text)
    except (ValueError, OSError, ZoneInfoNotFoundError):
        raise argparse.ArgumentTypeError(f"must be a time zone such as Europe/Copenhagen; got {text!r}") from None


def aware(moment: datetime | None, where: tzinfo | None) -> datetime | None:
    """Return a moment of `time` with its offset in a zone; raises ArgumentTypeError if it is unknown or ambiguous."""
    if moment is None or moment.tzinfo is not None:
        return moment
    if where is None:
        raise argparse.ArgumentTypeError(f"{moment.isoformat()} needs an offset, such as Z or +02:00, or --tz")
    early, late = (moment.replace(tzinfo=where, fold=fold) for fold in (0, 1))
    if early.utcoffset() != late.utcoffset():
        raise argparse.ArgumentTypeError(f"{moment.isoformat()} occurs twice or never in {where}: give an offset")
    return early


def columns(text: str) -> frozenset[str]:
    """Return more columns of a table."""
    found = frozenset(part.strip() for part in text.split(","))
    if not found <= set(MORE_COLUMNS):
        raise argparse.ArgumentTypeError(f"must be of {', '.join(MORE_COLUMNS)}, separated by commas; got {text!r}")
    return found


def height(text: str) -> float:
    """Return a height in metres, negative below the sea, of ``-100``, ``-100m`` or ``500ft``."""
    rule = "a height in metres or with a unit, such as -100, 2km or 500ft"
    return _in_unit(text, _UNITS_M, rule, least=-float_info.max)


def _whole(text: str, rule: str, least: int, most: int) -> int:
    if not re.fullmatch(r"\d{1,18}", text) or not least <= int(text) <= most:
        raise argparse.ArgumentTypeError(f"must be a whole number, {rule}; got {text!r}")
    return int(text)


def _in_unit(text: str, units: Mapping[str, float], rule: str, least: float) -> float:
    """Return a number in the first of the units; one without a unit is in that."""
    number, unit = text.strip(), next(iter(units))
    for one in sorted(units, key=len, reverse=True):
        if number.endswith(one) and number != one:
            number, unit = number.removesuffix(one).strip(), one
            break
    try:
        return _number(number, rule, least, float_info.max / max(units[unit], 1.0)) * units[unit]
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"must be {rule}; got {text!r}") from None


def _number(text: str, rule: str, least: float, most: float = float_info.max) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"must be {rule}; got {text!r}")
    return value
