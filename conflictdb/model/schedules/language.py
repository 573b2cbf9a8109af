"""The JSON language of schedules, which scene files and the database store as written.

A schedule is one of these, or a list of them, whose activations are joined:

- `{"periods": [["08:00", "10:00"]], "days": ["TUE"], "timezone": "Europe/Zurich", "from": "2026-06-01",
  "until": "2026-09-30", "except": ["2026-06-24"]}`. Without `periods`: whole days. Without `days`: all. `dates` is a
  list of the only dates. A time is one of a clock, or `sunrise`, `sunset`, `civil_dawn`, `civil_dusk`, also with an
  offset: `sunset+30min`. `except` has dates and days of the week on which no period starts.
- `{"rrule": "DTSTART...", "duration": "PT2H"}`
- `{"notam": "MON-FRI 0800-1700"}`
- `{"ed318": [...], "timezone": ...}`

Each may have `from` and `until`: instants, which cut activations, or with `periods` and `ed318` dates, both inclusive,
on which a period may start. `place` is the longitude and latitude for times of the sun, else the object's own.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, date, tzinfo
from typing import Any, Final

from conflictdb.errors import InvalidInput
from conflictdb.model.schedules.days import DAYS
from conflictdb.model.schedules.ed318_schedule import ed318_schedule
from conflictdb.model.schedules.item_d import item_d_schedule
from conflictdb.model.schedules.local_times import clock_s, date_of, instant_us, zone_of
from conflictdb.model.schedules.recurrences import rrule_schedule
from conflictdb.model.schedules.schedule import WHOLE_DAY, Daily, Moment, Period, Schedule, TimedRule
from conflictdb.model.schedules.sun import EVENTS

_SUN: Final = re.compile(rf"({'|'.join(EVENTS)})(?:([+-])(\d{{1,3}})min)?")
_COMMON: Final = {"from", "until", "place"}
_NOTATIONS: Final = {
    "rrule": {"rrule", "duration"},
    "notam": {"notam"},
    "ed318": {"ed318", "timezone"},
    "periods": {"periods", "days", "dates", "except", "timezone"},
}
_MOST_PARTS: Final = 366
# Entries of a list in a schedule, and of all its lists together. More take seconds before they are refused.
_MOST_ENTRIES: Final = 10_000


def schedule_of(who: str, source: Any) -> Schedule:
    """Return the schedule of its JSON source; raises InvalidInput if any part of it is not understood."""
    listed = source if isinstance(source, list) else [source]
    if not 0 < len(listed) <= _MOST_PARTS:
        raise InvalidInput(who, "schedule", f"must be a schedule, or a list of 1 to {_MOST_PARTS:,}")
    values = [value for one in listed if isinstance(one, Mapping) for value in one.values()]
    count = sum(len(value) for value in values if isinstance(value, list))
    if len(listed) > 1 and count > _MOST_ENTRIES:
        raise InvalidInput(
            who, "schedule", f"must have lists of at most {_MOST_ENTRIES:,} entries in all; got {count:,}"
        )
    parts: list[TimedRule] = []
    for i, one in enumerate(listed):
        parts.extend(_parts(who, f"schedule[{i}]" if isinstance(source, list) else "schedule", one))
    return Schedule(who, tuple(parts))


def _parts(who: str, field: str, source: Any) -> tuple[TimedRule, ...]:
    if not isinstance(source, Mapping) or not all(isinstance(name, str) for name in source):
        rule = "must be an object such as {'days': ['TUE'], 'periods': [['08:00', '10:00']]}"
        raise InvalidInput(who, field, f"{rule}; got {source!r:.60}")
    named = [name for name in ("rrule", "notam", "ed318") if name in source]
    notation = named[0] if named else "periods"
    if unknown := set(source) - _NOTATIONS[notation] - _COMMON:
        known = ", ".join(sorted(_NOTATIONS[notation] | _COMMON))
        raise InvalidInput(who, f"{field}.{min(unknown)}", f"is not understood: with {notation} members are {known}")
    for name, value in source.items():
        if isinstance(value, list) and len(value) > _MOST_ENTRIES:
            rule = f"must have at most {_MOST_ENTRIES:,} entries; got {len(value):,}"
            raise InvalidInput(who, f"{field}.{name}", rule)
    zone = zone_of(who, f"{field}.timezone", source["timezone"]) if "timezone" in source else None
    takes_dates = notation in ("periods", "ed318")
    (start_us, first), (end_us, last) = (
        _bound(who, f"{field}.{name}", source.get(name), takes_dates) for name in ("from", "until")
    )
    if (start_us is not None and end_us is not None and start_us >= end_us) or (first and last and first > last):
        raise InvalidInput(who, f"{field}.until", "must be after `from`")
    read: dict[str, Callable[[], Schedule]] = {
        "rrule": lambda: rrule_schedule(who, source["rrule"], source.get("duration")),
        "notam": lambda: item_d_schedule(who, source["notam"], (start_us, end_us)),
        "ed318": lambda: ed318_schedule(who, source["ed318"], zone),
        "periods": lambda: Schedule(who, (TimedRule(_daily(who, field, source, zone or UTC)),)),
    }
    place = _place(who, f"{field}.place", source["place"]) if "place" in source else None
    try:
        rules = [part.rule for part in read[notation]().parts]
    except InvalidInput as error:
        if field == "schedule" or notation == "periods":
            raise
        raise InvalidInput(who, error.field.replace("schedule", field, 1), error.rule) from None
    if first or last:
        rules = [replace(rule, first=first, last=last) for rule in rules if isinstance(rule, Daily)]
    return tuple(TimedRule(rule, start_us, end_us, place) for rule in rules)


def _daily(who: str, field: str, source: Mapping[str, Any], zone: tzinfo) -> Daily:
    dates, _ = _dates_and_days(who, f"{field}.dates", source.get("dates", []), False)
    _, days = _dates_and_days(who, f"{field}.days", source.get("days", []), True)
    excepted, excepted_days = _dates_and_days(who, f"{field}.except", source.get("except", []), None)
    return Daily(
        zone,
        _periods(who, f"{field}.periods", source["periods"]) if "periods" in source else (WHOLE_DAY,),
        days=days if "days" in source else None,
        dates=dates if "dates" in source else None,
        excepted=excepted,
        excepted_days=excepted_days,
    )


def _periods(who: str, field: str, given: Any) -> tuple[Period, ...]:
    if not isinstance(given, list) or not given:
        raise InvalidInput(who, field, f"must be a list such as [['08:00', '10:00']]; got {given!r:.60}")
    found = []
    for i, pair in enumerate(given):
        if not isinstance(pair, list) or len(pair) != 2:
            raise InvalidInput(who, f"{field}[{i}]", f"must be a pair such as ['08:00', '10:00']; got {pair!r:.60}")
        start, end = (_moment(who, f"{field}[{i}][{side}]", at) for side, at in enumerate(pair))
        found.append(Period(start, end))
    return tuple(found)


def _moment(who: str, field: str, text: Any) -> Moment:
    matched = _SUN.fullmatch(text) if isinstance(text, str) else None
    if matched is not None:
        sign = -60 if matched[2] == "-" else 60
        return Moment(sign * int(matched[3] or 0), matched[1])
    try:
        found, offset = clock_s(who, field, text)
    except InvalidInput as error:
        raise InvalidInput(who, field, f"{error.rule}, or one of {', '.join(EVENTS)}, as in sunset+30min") from None
    if offset is not None:
        raise InvalidInput(who, field, f"must have no offset: its zone is `timezone`; got {text!r:.60}")
    return Moment(found)


def _dates_and_days(who: str, field: str, given: Any, want_days: bool | None) -> tuple[frozenset[date], frozenset[int]]:
    """Return the dates and the days of the week in a list; `want_days` allows only one of them."""
    if not isinstance(given, list):
        raise InvalidInput(who, field, f"must be a list; got {given!r:.60}")
    dates, days = set(), set()
    for i, one in enumerate(given):
        if want_days is not False and isinstance(one, str) and one.upper() in DAYS:
            days.add(DAYS.index(one.upper()))
        elif want_days is True:
            raise InvalidInput(who, f"{field}[{i}]", f"must be a day of {', '.join(DAYS)}; got {one!r:.60}")
        else:
            dates.add(date_of(who, f"{field}[{i}]", one))
    return frozenset(dates), frozenset(days)


def _bound(who: str, field: str, text: Any, takes_dates: bool) -> tuple[int | None, date | None]:
    """Return `from` or `until`: an instant, which cuts activations, or a date, on which they may still start."""
    if text is None:
        return None, None
    if takes_dates and isinstance(text, str) and len(text) == 10:
        return None, date_of(who, field, text)
    return instant_us(who, field, text), None


def _place(who: str, field: str, given: Any) -> tuple[float, float]:
    numbers = given if isinstance(given, list | tuple) else ()
    sound = len(numbers) == 2 and all(isinstance(x, int | float) and not isinstance(x, bool) for x in numbers)
    if sound and abs(numbers[0]) <= 180.0 and abs(numbers[1]) <= 90.0:
        return float(numbers[0]), float(numbers[1])
    raise InvalidInput(who, field, f"must be [longitude, latitude] in degrees; got {given!r:.60}")
