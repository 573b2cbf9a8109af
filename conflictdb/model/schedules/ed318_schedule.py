"""Daily periods of UAS geographical zones: `schedule` of EUROCAE ED-318 and ED-269."""

from collections.abc import Mapping
from datetime import UTC, tzinfo
from typing import Any, Final

from conflictdb.errors import InvalidInput
from conflictdb.model.schedules.days import DAYS
from conflictdb.model.schedules.local_times import clock_s
from conflictdb.model.schedules.schedule import Daily, Moment, Period, Schedule, TimedRule

_EVENTS: Final = {"BMCT": "civil_dawn", "SR": "sunrise", "SS": "sunset", "EECT": "civil_dusk"}
_MEMBERS: Final = {"day", "startTime", "startEvent", "endTime", "endEvent"}


def ed318_schedule(who: str, periods: Any, zone: tzinfo | None = None) -> Schedule:
    """Return the schedule of a list of daily periods; raises InvalidInput.

    zone : of times without an offset, and of days with times of the sun (UTC if None); None refuses such times
    """
    field = "schedule"
    if isinstance(periods, Mapping):
        periods = [periods]
    if not isinstance(periods, list) or not periods:
        raise InvalidInput(who, field, f"must be a list of daily periods; got {periods!r:.60}")
    return Schedule(who, tuple(TimedRule(_daily(who, f"{field}[{i}]", one, zone)) for i, one in enumerate(periods)))


def _daily(who: str, field: str, period: Any, zone: tzinfo | None) -> Daily:
    if not isinstance(period, Mapping):
        raise InvalidInput(who, field, f"must be a daily period; got {period!r:.60}")
    # Optional members may be null.
    given = {name: value for name, value in period.items() if value is not None}
    if unknown := set(given) - _MEMBERS:
        raise InvalidInput(
            who, f"{field}.{min(unknown)}", f"is not understood: members are {', '.join(sorted(_MEMBERS))}"
        )
    zones: set[tzinfo] = set()
    start = _moment(who, field, "start", given, zone, zones)
    end = _moment(who, field, "end", given, zone, zones)
    if len(zones) > 1:
        raise InvalidInput(who, f"{field}.endTime", "must have the offset of startTime")
    days = given.get("day", ["ANY"])
    days = [days] if isinstance(days, str) else days
    known = isinstance(days, list) and days and all(isinstance(d, str) and d.upper() in (*DAYS, "ANY") for d in days)
    if not known:
        raise InvalidInput(who, f"{field}.day", f"must be days of {', '.join(DAYS)} or ANY; got {days!r:.60}")
    names = {day.upper() for day in days}
    of = None if "ANY" in names else frozenset(DAYS.index(name) for name in names)
    return Daily(zones.pop() if zones else zone or UTC, (Period(start, end),), days=of)


def _moment(who: str, field: str, side: str, given: dict[str, Any], zone: tzinfo | None, zones: set[tzinfo]) -> Moment:
    at, event = given.get(f"{side}Time"), given.get(f"{side}Event")
    if (at is None) == (event is None):
        raise InvalidInput(who, f"{field}.{side}Time", f"needs either {side}Time or {side}Event")
    if event is not None:
        if not isinstance(event, str) or event.upper() not in _EVENTS:
            rule = f"must be one of {', '.join(_EVENTS)}"
            raise InvalidInput(who, f"{field}.{side}Event", f"{rule}; got {event!r:.60}")
        return Moment(0, _EVENTS[event.upper()])
    found, offset = clock_s(who, f"{field}.{side}Time", at)
    own = offset or zone
    if own is None:
        raise InvalidInput(who, f"{field}.{side}Time", f"needs an offset from UTC, such as 08:00:00Z; got {at!r:.60}")
    zones.add(own)
    return Moment(found)
