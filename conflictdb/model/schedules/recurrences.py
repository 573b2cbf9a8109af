"""Schedules in the notation of calendars: DTSTART, RRULE, RDATE and EXDATE of RFC 5545."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta, tzinfo
from itertools import islice
from typing import Any, Final

import numpy as np
from dateutil import rrule

from conflictdb.errors import InvalidInput
from conflictdb.model.schedules.local_times import zone_of
from conflictdb.model.schedules.schedule import Floats, Ints, Schedule, TimedRule

_FIELD: Final = "schedule.rrule"
_NAMES: Final = ("DTSTART", "DTEND", "DURATION", "RRULE", "RDATE", "EXDATE")
_LINE: Final = re.compile(r"([A-Za-z-]+)((?:;[A-Za-z-]+=[^:;]+)*):(.+)")
_STAMP: Final = re.compile(r"(\d{4})(\d\d)(\d\d)(?:T(\d\d)(\d\d)(\d\d)(Z?))?")
_DURATION: Final = re.compile(r"\+?P(?:(\d{1,4})W|(?:(\d{1,5})D)?(?:T(?:(\d{1,5})H)?(?:(\d{1,6})M)?(?:(\d{1,8})S)?)?)")
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND: Final = timedelta(microseconds=1)
# More often is not a plan, and a rule that never matches would be searched for hours.
_OFTEN: Final = {"MINUTELY", "SECONDLY"}
# Parts that only pick from years or months: with other frequencies a rule can be impossible, and is searched for long.
_YEARLY_ONLY: Final = {"BYYEARDAY", "BYWEEKNO"}
_LONGEST: Final = {2: 29, 4: 30, 6: 30, 9: 30, 11: 30}
_MOST_DATES: Final = 100_000
_MOST_TEXT: Final = 10_000
_AT_ONCE: Final = 1_000
_STEPS: Final = {rrule.HOURLY: timedelta(hours=1), rrule.DAILY: timedelta(days=1), rrule.WEEKLY: timedelta(weeks=1)}
_YEARS_400: Final = timedelta(days=146_097)
_LAST_YEAR: Final = 9998


@dataclass(frozen=True, slots=True)
class _Duration:
    days: int
    seconds: int


@dataclass(frozen=True, slots=True)
class Recurrence:
    """Occurrences of RFC 5545: local starts of one zone, and a duration.

    zone : of the local times
    start : DTSTART, local
    rules : of dateutil, in local time
    also : RDATE in UTC, each with its local time
    except_ : EXDATE in UTC
    until : the last start of each rule, an instant, or None
    duration : whole days are of the local clock, seconds are exact
    """

    zone: tzinfo
    start: datetime
    rules: tuple[tuple[rrule.rrule, datetime | None], ...]
    also: dict[datetime, datetime]
    except_: frozenset[datetime]
    duration: _Duration

    @property
    def uses_sun(self) -> bool:
        """Whether occurrences depend on the place: they do not."""
        return False

    def occurrences(self, start_us: int, end_us: int, places_deg: Floats) -> Iterator[Ints]:
        """Yield spans (n, 2) of all occurrences that share time with [start, end), and perhaps others."""
        longest = timedelta(days=self.duration.days + 2, seconds=self.duration.seconds)
        starts = self._starts(_local(start_us, -longest), _local(end_us, timedelta(days=2)))
        while some := list(islice(starts, _AT_ONCE)):
            yield np.array([self._span(begin, local) for begin, local in some], np.int64)

    def _span(self, begin: datetime, local: datetime) -> tuple[int, int]:
        end = begin
        if self.duration.days:
            end = (local + timedelta(days=self.duration.days)).replace(tzinfo=self.zone)
        end_at = (end - _EPOCH) + timedelta(seconds=self.duration.seconds)
        return (begin - _EPOCH) // _MICROSECOND, end_at // _MICROSECOND

    def _starts(self, first: datetime, last: datetime) -> Iterator[tuple[datetime, datetime]]:
        """Yield starts from one local time to another: in UTC, and local."""
        seen = set(self.except_)
        lone = [(_utc(self.start, self.zone), self.start), *sorted(self.also.items())]
        for at, local in lone:
            if first <= local <= last and at not in seen:
                seen.add(at)
                yield at, local
        for rule, until in self.rules:
            for local in _found(rule, self.start, self.zone, first, last):
                at = _utc(local, self.zone)
                if until is not None and at > until:
                    break
                if at not in seen:
                    seen.add(at)
                    yield at, local


def _utc(local: datetime, zone: tzinfo) -> datetime:
    """Return a local time in UTC.

    RFC 5545: a local time that exists twice is the first one, one that does not exist is after the gap.
    """
    return local.replace(tzinfo=zone).astimezone(UTC)


def _exists(local: datetime, zone: tzinfo) -> bool:
    return _utc(local, zone).astimezone(zone).replace(tzinfo=None) == local


def _found(rule: rrule.rrule, start: datetime, zone: tzinfo, first: datetime, last: datetime) -> Iterator[datetime]:
    """Yield the times of a rule in [first, last], without the library's search of all hours up to the year 9999.

    RFC 5545, 3.3.10: a local time that does not exist is ignored, and does not count.
    """
    begin = start
    if (step := _STEPS.get(rule._freq)) and rule._count is None and first > start:
        # The rule repeats itself: begin just before the request.
        begin += (first - start) // (step * rule._interval) * (step * rule._interval)
    if begin > last:
        return
    # Calendars repeat every 400 years: the rule is the same late in the library's time.
    later = max((_LAST_YEAR - last.year) // 400, 0) * _YEARS_400
    every: Iterator[datetime]
    if rule._count is not None:
        every = islice(_existing(rule.replace(dtstart=begin + later, count=None), start, zone, later), rule._count)
    else:
        shifted = rule.replace(dtstart=begin + later).xafter(first + later, inc=True)
        every = _existing(shifted, start, zone, later)
    for local in every:
        if local > last:
            return
        if local >= first:
            yield local


def _existing(every: Iterable[datetime], start: datetime, zone: tzinfo, later: timedelta) -> Iterator[datetime]:
    """Yield the local times that exist of a rule that was moved to a later time."""
    for one in every:
        local = one - later
        if local == start or _exists(local, zone):
            yield local


def rrule_schedule(who: str, text: str, duration: str | None = None) -> Schedule:
    """Return the schedule of lines DTSTART, RRULE, RDATE, EXDATE, and DURATION or DTEND; raises InvalidInput.

    duration : in place of a line DURATION, as `PT2H`
    """
    lines = _lines(who, text)
    if duration is not None:
        if "DURATION" in lines or "DTEND" in lines:
            raise InvalidInput(who, _FIELD, "has its duration twice: leave out `duration`")
        lines["DURATION"] = [({}, duration)]
    if len(lines.get("DTSTART", ())) != 1:
        raise InvalidInput(who, _FIELD, "needs one line DTSTART, as DTSTART;TZID=Europe/Zurich:20260602T080000")
    (parameters, value), *_ = lines["DTSTART"]
    zone, start, is_date = _stamp(who, parameters, value)
    also, excepted = (
        dict(
            _same_zone(who, zone, is_date, parameters, one)
            for parameters, value in lines.get(name, ())
            for one in value.split(",")
        )
        for name in ("RDATE", "EXDATE")
    )
    rules = tuple(_rule(who, zone, start, value) for _, value in lines.get("RRULE", ()))
    recurrence = Recurrence(zone, start, rules, also, frozenset(excepted), _length(who, lines, zone, start, is_date))
    return Schedule(who, (TimedRule(recurrence),))


def _lines(who: str, text: str) -> dict[str, list[tuple[dict[str, str], str]]]:
    if not isinstance(text, str):
        raise InvalidInput(who, _FIELD, f"must be text of RFC 5545; got {text!r:.60}")
    if len(text) > _MOST_TEXT:
        raise InvalidInput(who, _FIELD, f"must have at most {_MOST_TEXT:,} characters; got {len(text):,}")
    found: dict[str, list[tuple[dict[str, str], str]]] = {}
    # A line that begins with a space continues the one before.
    for line in re.sub(r"\r?\n[ \t]", "", text.strip()).split("\n"):
        matched = _LINE.fullmatch(line.strip())
        if matched is None or matched[1].upper() not in _NAMES:
            raise InvalidInput(who, _FIELD, f"has lines of {', '.join(_NAMES)} only; got {line!r:.60}")
        name = matched[1].upper()
        parameters = {key.upper(): of for key, of in (one.split("=", 1) for one in matched[2].split(";") if one)}
        if unknown := set(parameters) - {"TZID", "VALUE"}:
            raise InvalidInput(who, _FIELD, f"has parameters TZID and VALUE only; got {min(unknown)!r:.60}")
        found.setdefault(name, []).append((parameters, matched[3].upper()))
        if name in ("DTSTART", "DTEND", "DURATION", "RRULE") and len(found[name]) > 1:
            raise InvalidInput(who, _FIELD, f"must have one line {name}; a schedule may be a list")
    return found


def _stamp(who: str, parameters: dict[str, str], value: str) -> tuple[tzinfo, datetime, bool]:
    """Return the zone and the local time of a stamp, and whether it is a date."""
    matched = _STAMP.fullmatch(value)
    try:
        if matched is None:
            raise ValueError
        year, month, day, hour, minute, second = (int(part or 0) for part in matched.groups()[:6])
        local = datetime(year, month, day, hour, minute, second)
    except ValueError:
        rule = "has times such as 20260602T080000Z, or with TZID 20260602T080000"
        raise InvalidInput(who, _FIELD, f"{rule}; got {value!r:.60}") from None
    is_date, is_utc = matched[4] is None, matched[7] == "Z"
    if is_utc and "TZID" in parameters:
        raise InvalidInput(who, _FIELD, f"has either TZID or the Z of UTC; got {value!r:.60}")
    if not is_utc and "TZID" not in parameters:
        rule = "needs TZID, or Z for UTC: a time of no zone is not one instant"
        raise InvalidInput(who, _FIELD, f"{rule}; got {value!r:.60}")
    return (UTC if is_utc else zone_of(who, _FIELD, parameters["TZID"])), local, is_date


def _same_zone(
    who: str, zone: tzinfo, is_date: bool, parameters: dict[str, str], value: str
) -> tuple[datetime, datetime]:
    """Return a date of RDATE or EXDATE in UTC, and as the local time of DTSTART's zone."""
    own, local, own_date = _stamp(who, parameters, value)
    if own_date != is_date:
        raise InvalidInput(who, _FIELD, f"RDATE and EXDATE must be dates if DTSTART is, or times; got {value!r:.60}")
    at = _utc(local, own)
    return at, local if own is zone else at.astimezone(zone).replace(tzinfo=None)


def _rule(who: str, zone: tzinfo, start: datetime, value: str) -> tuple[rrule.rrule, datetime | None]:
    parts = {name: of for name, _, of in (part.partition("=") for part in value.upper().split(";"))}
    if len(parts) != value.count(";") + 1:
        raise InvalidInput(who, _FIELD, f"has a part of RRULE twice; got {value!r:.60}")
    _check_search(who, parts)
    until = None
    if "UNTIL" in parts:
        if "COUNT" in parts:
            raise InvalidInput(who, _FIELD, "RRULE has COUNT or UNTIL, not both")
        text = parts.pop("UNTIL")
        own, local, is_date = _stamp(who, {} if text.endswith("Z") else {"TZID": "UTC"}, text)
        # A date, or a time without Z, is of DTSTART's zone; a date includes its day.
        local = datetime.combine(local, time.max) if is_date else local
        until = local.replace(tzinfo=own if text.endswith("Z") else zone)
    try:
        text = ";".join(f"{name}={of}" for name, of in parts.items())
        rule: Any = rrule.rrulestr(text, dtstart=start)
    except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise InvalidInput(who, _FIELD, f"RRULE is not understood: {error}; got {value!r:.60}") from None
    return rule, until


def _check_search(who: str, parts: dict[str, str]) -> None:
    """Refuse rules that would be searched for hours: too often, or never."""
    every = parts.get("FREQ", "")
    if every in _OFTEN:
        raise InvalidInput(who, _FIELD, f"FREQ must be HOURLY or rarer; got {every}")
    if every not in ("YEARLY", "MONTHLY", "WEEKLY", "DAILY", "HOURLY"):
        raise InvalidInput(
            who, _FIELD, f"RRULE needs FREQ: YEARLY, MONTHLY, WEEKLY, DAILY or HOURLY; got {every!r:.60}"
        )
    if "BYEASTER" in parts:  # which the library knows
        raise InvalidInput(who, _FIELD, "BYEASTER is not known to RFC 5545: give the dates as RDATE")
    if every == "DAILY" and "BYSETPOS" in parts:
        raise InvalidInput(who, _FIELD, "BYSETPOS needs a FREQ of WEEKLY or rarer")
    if (wrong := _YEARLY_ONLY & set(parts)) and every != "YEARLY":
        raise InvalidInput(who, _FIELD, f"{min(wrong)} needs FREQ=YEARLY")
    if every == "HOURLY" and (wrong := {p for p in parts if p.startswith("BY")} - {"BYDAY", "BYHOUR", "BYMINUTE"}):
        raise InvalidInput(
            who, _FIELD, f"FREQ=HOURLY goes with BYDAY, BYHOUR and BYMINUTE only; got {min(wrong)!r:.60}"
        )
    try:
        count, interval = int(parts.get("COUNT", 1)), int(parts.get("INTERVAL", 1))
        months = [int(one) for one in parts.get("BYMONTH", "").split(",") if one]
        days = [int(one) for one in parts.get("BYMONTHDAY", "").split(",") if one]
    except ValueError:
        raise InvalidInput(who, _FIELD, "RRULE has whole numbers in COUNT, INTERVAL, BYMONTH and BYMONTHDAY") from None
    if not (0 < count <= _MOST_DATES and 0 < interval <= _MOST_DATES):
        raise InvalidInput(who, _FIELD, f"COUNT and INTERVAL must be 1 or more, at most {_MOST_DATES:,}")
    if days and months and not any(abs(day) <= _LONGEST.get(month, 31) for day in days for month in months):
        raise InvalidInput(who, _FIELD, "RRULE never happens: no such day in these months")


def _length(
    who: str, lines: dict[str, list[tuple[dict[str, str], str]]], zone: tzinfo, start: datetime, is_date: bool
) -> _Duration:
    if "DTEND" in lines and "DURATION" in lines:
        raise InvalidInput(who, _FIELD, "has DTEND or DURATION, not both")
    if "DTEND" in lines:
        (parameters, value), *_ = lines["DTEND"]
        own, local, end_is_date = _stamp(who, parameters, value)
        if is_date and end_is_date and own is not UTC and zone is not UTC:
            found = _Duration((local - start).days, 0)
        else:
            # If clocks change in between, by the clock or exactly: the longer one.
            exact = _utc(local, own) - _utc(start, zone)
            found = _Duration(0, int((max(exact, local - start) if own is zone else exact).total_seconds()))
    elif "DURATION" in lines:
        text = lines["DURATION"][0][1]
        matched = _DURATION.fullmatch(text) if isinstance(text, str) else None
        if matched is None:
            raise InvalidInput(who, _FIELD, f"DURATION must be as PT2H, PT90M or P1D; got {text!r:.60}")
        weeks, days, hours, minutes, seconds = (int(part or 0) for part in matched.groups())
        found = _Duration(7 * weeks + days, 3600 * hours + 60 * minutes + seconds)
    elif is_date:
        found = _Duration(1, 0)
    else:
        raise InvalidInput(who, _FIELD, "needs how long it lasts: a line DURATION:PT2H or DTEND, or `duration`")
    if found.days * 86400 + found.seconds <= 0:
        raise InvalidInput(who, _FIELD, "must last longer than 0 seconds")
    return found


def _local(at_us: int, by: timedelta) -> datetime:
    try:
        return (_EPOCH + at_us * _MICROSECOND + by).replace(tzinfo=None)
    except OverflowError:
        return datetime.combine(date.min if at_us < 0 else date.max, time())
