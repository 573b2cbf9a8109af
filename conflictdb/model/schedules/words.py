"""Schedules in words, as lists and calendars show them: "Tue 08:00-16:00 Europe/Copenhagen"."""

from collections.abc import Collection
from dataclasses import replace
from datetime import UTC, date, timedelta, tzinfo
from itertools import pairwise
from typing import Final

from conflictdb.model.schedules.recurrences import Recurrence
from conflictdb.model.schedules.schedule import WHOLE_DAY, Daily, Ints, Moment, Period, Schedule, SchedulePart

_DAY_US: Final = 86_400_000_000
_DAYS: Final = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
_OFTEN: Final = ("yearly", "monthly", "weekly", "daily", "hourly")  # as dateutil counts them
_MOST_DATES: Final = 3
_MOST_RULES: Final = 3


def schedule_text(schedule: Schedule) -> str:
    """Return when something is active, in words."""
    rules = [part.rule for part in schedule.parts]
    dailies = [rule for rule in rules if isinstance(rule, Daily)]
    found = [_daily_text(one) for one in _joined(dailies)]
    found += [_recurrence_text(rule) for rule in rules if isinstance(rule, Recurrence)]
    more = len(found) - _MOST_RULES
    return "; ".join(found[:_MOST_RULES]) + (f"; and {more} more" if more > 0 else "")


def known_spans(schedule: Schedule, start_us: int | None, end_us: int | None) -> Ints | None:
    """Return the spans (n, 2) of a schedule without times of the sun between two instants; None: without an end.

    start_us, end_us : as far as known; the schedule's own first and last dates count, too
    """
    if schedule.uses_sun:
        return None
    starts, ends = [], []
    for part in schedule.parts:
        first, last = _own_dates(part.rule)
        # A day of a zone begins and ends within a day of that of UTC; a period ends on the next.
        begins = [at for at in (start_us, part.start_us, _day_us(first, -1)) if at is not None]
        finishes = [at for at in (end_us, part.end_us, _day_us(last, 3)) if at is not None]
        if not (begins and finishes):
            return None
        starts.append(max(begins))
        ends.append(min(finishes))
    return schedule.expand(min(starts), max(ends)) if starts and min(starts) < max(ends) else None


def _own_dates(rule: SchedulePart) -> tuple[date | None, date | None]:
    """Return the first and the last date on which a rule begins a period, as far as it says them."""
    if isinstance(rule, Recurrence):
        return rule.start.date(), None
    if not isinstance(rule, Daily):
        return None, None
    if rule.dates:
        return rule.first or min(rule.dates), rule.last or max(rule.dates)
    return rule.first, rule.last


def _day_us(day: date | None, later: int) -> int | None:
    return None if day is None else ((day - date(1970, 1, 1)).days + later) * _DAY_US


def _joined(rules: Collection[Daily]) -> list[Daily]:
    """Return rules in which those that differ by their dates only are one."""
    found: dict[Daily, set[date]] = {}
    for rule in rules:
        key = rule if rule.dates is None else replace(rule, dates=frozenset(), excepted=frozenset())
        found.setdefault(key, set()).update((rule.dates or frozenset()) - rule.excepted)
    return [rule if rule.dates is None else replace(rule, dates=frozenset(dates)) for rule, dates in found.items()]


def _daily_text(rule: Daily) -> str:
    if rule.dates is not None:
        days = _dates_text(sorted(rule.dates))
    else:
        days = _days_text((set(range(7)) if rule.days is None else set(rule.days)) - rule.excepted_days)
    periods = ", ".join("all day" if period == WHOLE_DAY else _period_text(period) for period in rule.periods)
    except_ = f" except {_dates_text(sorted(rule.excepted))}" if rule.excepted else ""
    return f"{days} {periods}{_zone_text(rule.zone)}{except_}"


def _days_text(days: Collection[int]) -> str:
    """Return days of the week: "daily", "Tue", "Mon-Fri", "Tue, Thu"."""
    if len(days) == 7:
        return "daily"
    ordered = sorted(days)
    if len(ordered) > 2 and all(b - a == 1 for a, b in pairwise(ordered)):
        return f"{_DAYS[ordered[0]]}-{_DAYS[ordered[-1]]}"
    return ", ".join(_DAYS[day] for day in ordered) or "never"


def _dates_text(dates: list[date]) -> str:
    """Return some dates, or from when to when if they are consecutive, or how many they are."""
    if not dates:
        return "never"
    if len(dates) > 2 and all(b - a == timedelta(days=1) for a, b in pairwise(dates)):
        return f"{dates[0]} to {dates[-1]}"
    return ", ".join(map(str, dates)) if len(dates) <= _MOST_DATES else f"{len(dates)} dates"


def _period_text(period: Period) -> str:
    later = f" (+{period.days} days)" if period.days is not None and period.days > 1 else ""
    return f"{_moment_text(period.start)}-{_moment_text(period.end)}{later}"


def _moment_text(moment: Moment) -> str:
    minutes, seconds = divmod(moment.offset_s, 60)
    if moment.event is None:
        return f"{minutes // 60:02}:{minutes % 60:02}" + (f":{seconds:02}" if seconds else "")
    return moment.event.replace("_", " ") + (f"{minutes:+d}min" if minutes else "")


def _zone_text(zone: tzinfo) -> str:
    return "" if zone is UTC else f" {getattr(zone, 'key', zone)}"


def _recurrence_text(rule: Recurrence) -> str:
    lasts = timedelta(days=rule.duration.days, seconds=rule.duration.seconds)
    how = f"{rule.start:%H:%M} for {_lasting_text(lasts)}{_zone_text(rule.zone)}"
    if len(rule.rules) != 1:
        return f"{len(rule.also) + 1} dates, {how}" if not rule.rules else f"by {len(rule.rules)} rules, {how}"
    found = rule.rules[0][0]
    often, interval = _OFTEN[found._freq], found._interval
    days = sorted(found._byweekday or ()) if often in ("weekly", "daily") else []
    every = f"every {interval} {dict(zip(_OFTEN, ('years', 'months', 'weeks', 'days', 'hours'), strict=True))[often]}"
    on = f" {_days_text(days)}" if days and len(days) < 7 else ""
    return f"{often if interval == 1 else every}{on} {how}"


def _lasting_text(lasts: timedelta) -> str:
    minutes, seconds = divmod(lasts.seconds, 60)
    parts = ((lasts.days, "d"), (minutes // 60, "h"), (minutes % 60, "min"), (seconds, "s"))
    return " ".join(f"{count} {unit}" for count, unit in parts if count)
