"""Convert timesheets of AIXM 5.1 to schedules as scene files write them."""

import math
import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import Any, Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.xml_text import Element
from conflictdb.model.inputs import EPOCH, MICROSECOND

_DAYS: Final = ("MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN")
_EVENTS: Final = {"SR": "sunrise", "SS": "sunset"}
_UNITS_S: Final = {"HR": 3600, "MIN": 60, "SEC": 1}
_ZONE: Final = re.compile(r"UTC(?:([+-])(\d{1,2}))?")
_CLOCK: Final = re.compile(r"([01]\d|2[0-4]):([0-5]\d)")
_DATE: Final = re.compile(r"([0-3]\d)-([01]\d)")
_KNOWN: Final = frozenset(
    {
        *("timeReference", "startDate", "endDate", "day", "dayTil", "startTime", "startEvent"),
        *("startTimeRelativeEvent", "endTime", "endEvent", "endTimeRelativeEvent", "daylightSavingAdjust", "excluded"),
        *("annotation", "extension", "startEventInterpretation", "endEventInterpretation"),
    }
)
# Years of yearly dates that are written out; of a longer validity they are refused.
_MOST_YEARS: Final = 50


def schedule_of_sheets(
    who: str, sheets: Sequence[Element], span_us: tuple[int | None, int | None]
) -> list[dict[str, Any]]:
    """Return the schedules of timesheets, none for all the time; raises InvalidInput for one that is not understood.

    span_us : within which they apply, for dates without a year
    """
    found = [one for sheet in sheets for one in _schedules(who, sheet, span_us)]
    return [] if any(not one for one in found) else found


def _schedules(who: str, sheet: Element, span_us: tuple[int | None, int | None]) -> Iterator[dict[str, Any]]:
    """Yield the schedules of one sheet, an empty one for all the time."""
    where = f"Timesheet in line {sheet.line}"
    unknown = [child.name for child in sheet.children if child.name not in _KNOWN]
    if unknown:
        raise InvalidInput(who, where, f"has {unknown[0]:.40}, which is not understood")
    if (sheet.value("excluded") or "NO") != "NO":
        raise InvalidInput(who, where, "excludes times, which is not understood")
    first, last = sheet.value("day") or "ANY", sheet.value("dayTil")
    if first not in (*_DAYS, "ANY"):
        raise InvalidInput(who, where, f"has the day {first:.40}; understood are ANY and {', '.join(_DAYS)}")
    if last not in (None, first):
        raise InvalidInput(who, where, f"lasts from {first} to {last:.40}, which is not understood: give each day")
    start, end = (_moment(who, where, sheet, side) for side in ("start", "end"))
    is_whole_day = {start, end} <= {"00:00", "24:00"} and (start == end or (start, end) == ("00:00", "24:00"))
    schedule: dict[str, Any] = {}
    if first != "ANY":
        schedule["days"] = [first]
    if not is_whole_day:
        schedule["periods"] = [[start, end]]
    if sheet.value("startDate") is None and sheet.value("endDate") is None:
        if schedule:
            schedule["timezone"] = _zone(who, where, sheet)
        yield schedule
        return
    schedule["timezone"] = _zone(who, where, sheet)
    for begin, until in _dates(who, where, sheet, span_us):
        yield {**schedule, "from": begin, "until": until}


def _moment(who: str, where: str, sheet: Element, side: str) -> str:
    """Return a time of day, of a clock or of the sun."""
    clock, event = sheet.value(f"{side}Time"), sheet.value(f"{side}Event")
    if event is not None:
        relative = sheet.child(f"{side}TimeRelativeEvent")
        later = (None if relative is None else relative.text) or "0"
        if event not in _EVENTS or clock is not None or not re.fullmatch(r"[+-]?\d{1,5}(\.\d{0,6})?", later):
            raise InvalidInput(who, where, f"has the {side}Event {event:.40}, which is not understood as it is given")
        unit = (None if relative is None else relative.get("uom")) or "MIN"
        if unit not in _UNITS_S:
            rule = f"has a {side}TimeRelativeEvent of the unit {unit:.40}; understood are {', '.join(_UNITS_S)}"
            raise InvalidInput(who, where, rule)
        # On whole minutes, outward.
        minutes = float(later) * _UNITS_S[unit] / 60.0
        whole = math.floor(minutes) if side == "start" else math.ceil(minutes)
        return _EVENTS[event] + (f"{whole:+d}min" if whole else "")
    if clock is None or not _CLOCK.fullmatch(clock) or clock > "24:00":
        raise InvalidInput(who, where, f"needs a {side}Time such as 08:00; got {clock!r:.40}")
    return clock


def _zone(who: str, where: str, sheet: Element) -> str:
    """Return the name of the zone of the clock; a fixed offset from UTC."""
    reference = sheet.value("timeReference")
    given = _ZONE.fullmatch(reference or "")
    if given is None:
        raise InvalidInput(who, where, f"needs a timeReference such as UTC or UTC+1; got {reference!r:.40}")
    if sheet.value("daylightSavingAdjust") == "YES":
        raise InvalidInput(who, where, "changes with daylight saving, whose dates it does not say")
    hours = int(given[2] or 0)
    if hours > 12:
        raise InvalidInput(who, where, f"has an offset of {hours} hours; at most 12 are understood")
    # The database of zones counts hours west of Greenwich.
    return "UTC" if hours == 0 else f"Etc/GMT{'-' if given[1] == '+' else '+'}{hours}"


def _dates(who: str, where: str, sheet: Element, span_us: tuple[int | None, int | None]) -> Iterator[tuple[str, str]]:
    """Yield the first and last dates of a yearly period in each year of a span."""
    ends = []
    for name, other in (("startDate", "01-01"), ("endDate", "31-12")):
        given = _DATE.fullmatch(sheet.value(name) or other)
        if given is None:
            raise InvalidInput(who, where, f"needs a {name} such as 24-12; got {sheet.value(name)!r:.40}")
        ends.append((int(given[2]), int(given[1])))
    if None in span_us:
        raise InvalidInput(who, where, "has dates of every year, and the airspace has no end")
    years = [(EPOCH + int(one or 0) * MICROSECOND).astimezone(UTC).year for one in span_us]
    if years[1] - years[0] > _MOST_YEARS:
        raise InvalidInput(who, where, f"has dates of every year of {years[1] - years[0]}; at most {_MOST_YEARS}")
    over_new_year = ends[1] < ends[0]
    for year in range(years[0] - over_new_year, years[1] + 1):
        try:
            begin, until = datetime(year, *ends[0]), datetime(year + over_new_year, *ends[1])
        except ValueError:
            raise InvalidInput(who, where, "has a date that does not exist in every year") from None
        yield begin.date().isoformat(), until.date().isoformat()
