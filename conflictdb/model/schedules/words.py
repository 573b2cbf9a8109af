"""Schedules in words, as lists and calendars show them: "Tue 08:00-16:00 Europe/Copenhagen"."""

import calendar
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, date, datetime, time, timedelta, tzinfo
from itertools import pairwise
from typing import Any, Final

from dateutil.rrule import rrule

from conflictdb.model.schedules.recurrences import Recurrence
from conflictdb.model.schedules.schedule import WHOLE_DAY, Daily, Ints, Moment, Period, Schedule, SchedulePart

_DAY_US: Final = 86_400_000_000
_DAYS: Final = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
_UNITS: Final = {"yearly": "years", "monthly": "months", "weekly": "weeks", "daily": "days", "hourly": "hours"}
_OFTEN: Final = tuple(_UNITS)  # as dateutil counts them
_MOST_DATES: Final = 3
_MOST_RULES: Final = 3
_MOST_TIMES: Final = 6


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
    weekdays = (set(range(7)) if rule.days is None else set(rule.days)) - rule.excepted_days
    if rule.dates is not None:
        days = _dates_text(sorted(date for date in rule.dates if date.weekday() in weekdays))
    else:
        days = _days_text(weekdays)
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
    how = f"for {_lasting_text(lasts)}{_zone_text(rule.zone)}"
    excepted = sorted(at.astimezone(rule.zone).replace(tzinfo=None) for at in rule.except_)
    lone = [*rule.also.values()]
    usual = {rule.start.time()}
    if not rule.rules:
        starts = sorted({rule.start, *lone} - {*excepted})
        times = {one.time() for one in starts}
        at = f" {_clock_text(*times)}" if len(times) == 1 else ""
        return f"{_starts_text(starts, times)}{at} {how}"
    [(found, until)] = rule.rules
    words = _rule_words(found, rule.start)
    if words is None:
        when = f"RRULE {str(found).rpartition('RRULE:')[2]} from {rule.start.date()} {_clock_text(rule.start.time())}"
        more = []
    else:
        when, usual = words
        # DTSTART counts, also where the rule does not contain it.
        lone += [] if next(iter(found), None) == rule.start else [rule.start]
        more = [f"from {rule.start.date()}"] if found._interval > 1 else []
        more += [] if found._count is None else [f"at most {found._count:,} times"]
    if until is not None:
        last = until.astimezone(rule.zone).replace(tzinfo=None)
        is_whole = usual and last.time() >= max(usual)
        more.append(f"until {last.date()}" + ("" if is_whole else f" {_clock_text(last.time())}"))
    also = f" and {_starts_text(sorted(lone), usual)}" if lone else ""
    except_ = f" except {_starts_text(excepted, usual)}" if excepted else ""
    return ", ".join([f"{when} {how}", *more]) + also + except_


def _rule_words(rule: rrule, start: datetime) -> tuple[str, set[time]] | None:
    """Return a rule in words, and its times of day; None if there are no words that say all of it.

    start : what the rule does not say follows from it
    """
    own = {name: values for name, values in rule._original_rule.items() if values}
    often, interval = _OFTEN[rule._freq], rule._interval
    if set(own) - {"bymonth", "bymonthday", "byweekday", "byhour", "byminute"} or (interval > 1 and rule._wkst):
        return None
    on = _rule_days(often, own, start)
    hours, minutes = (own.get(f"by{unit}", (getattr(start, unit),)) for unit in ("hour", "minute"))
    times = {time(hour, minute, start.second) for hour in hours for minute in minutes}
    if on is None or len(times) > _MOST_TIMES or (interval > 1 and own and often in ("daily", "hourly")):
        return None
    if often == "hourly" and "byhour" not in own:
        at = "at " + ", ".join(f":{one:02}" for one in minutes) if interval == 1 else f"at {_clock_text(start.time())}"
        times = set()
    else:
        often = "daily" if often == "hourly" else often
        at = ", ".join(map(_clock_text, sorted(times)))
    every = often if interval == 1 else f"every {interval} {_UNITS[often]}"
    return " ".join(filter(None, (every, on, at))), times


def _rule_days(often: str, own: Mapping[str, Sequence[Any]], start: datetime) -> str | None:
    """Return the days of a rule in words, perhaps none; None if there are no words for them."""
    days, dates = own.get("byweekday", ()), own.get("bymonthday", ())
    months = ", ".join(calendar.month_abbr[month] for month in own.get("bymonth", ()))
    in_months = f" in {months}" if months else ""
    if days and dates:
        return None
    if often in ("daily", "hourly", "weekly"):
        if (dates and often != "daily") or any(day.n for day in days):
            return None
        weekdays = {day.weekday for day in days} or ({start.weekday()} if often == "weekly" else set(range(7)))
        which = _dates_of_month(dates) if dates else "" if len(weekdays) == 7 else _days_text(weekdays)
        return f"{which}{in_months}".strip()
    if often == "yearly" and not months:
        return None if days or dates else f"on {start.day} {calendar.month_abbr[start.month]}"
    if days:
        return f"{', '.join(map(_nth_text, days))}{in_months}"
    return f"{_dates_of_month(dates or [start.day])}{in_months}"


def _nth_text(day: Any) -> str:
    """Return a day of the week of a month: "every Mon", "1st Mon", "last Fri", "2nd last Fri"."""
    name = _DAYS[day.weekday]
    return f"every {name}" if not day.n else f"{_nth(day.n)} {name}"


def _dates_of_month(dates: Collection[int]) -> str:
    """Return dates of a month: "on day 1, 15", "on the last day"."""
    first, last = sorted(day for day in dates if day > 0), sorted((day for day in dates if day < 0), reverse=True)
    parts = [f"day {', '.join(map(str, first))}"] if first else []
    parts += [f"the {_nth(day)} day" for day in last]
    return f"on {' and '.join(parts)}"


def _nth(n: int) -> str:
    """Return 1 as "1st", -1 as "last", -2 as "2nd last"."""
    if n == -1:
        return "last"
    number = abs(n)
    ending = "th" if number // 10 % 10 == 1 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}{' last' if n < 0 else ''}"


def _starts_text(starts: Sequence[datetime], usual: Collection[time]) -> str:
    """Return some starts by their dates, with the time where that is not one that is usual, or how many they are."""
    if len(starts) > _MOST_DATES:
        return f"{len(starts):,} dates"
    return ", ".join(
        str(one.date()) + ("" if usual == {one.time()} else f" {_clock_text(one.time())}") for one in starts
    )


def _clock_text(at: time) -> str:
    return f"{at:%H:%M:%S}" if at.second else f"{at:%H:%M}"


def _lasting_text(lasts: timedelta) -> str:
    minutes, seconds = divmod(lasts.seconds, 60)
    parts = ((lasts.days, "d"), (minutes // 60, "h"), (minutes % 60, "min"), (seconds, "s"))
    return " ".join(f"{count} {unit}" for count, unit in parts if count)
