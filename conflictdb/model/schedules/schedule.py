"""The form that all notations of a schedule are read into, and its expansion to spans.

Spans are half-open [start, end), whole microseconds since 1970. Where a notation or nature leaves a choice, a span is
the longer one: a clock time that exists twice, or not at all, when clocks change, is the earlier one at a start and the
later one at an end; times of the sun begin before and end after all that their error allows, on whole minutes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, time, timedelta, tzinfo
from functools import lru_cache
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model.activations import MOST_ACTIVATIONS
from conflictdb.model.schedules.sun import EVENTS, MARGIN_DEG, sun_times

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

# Occurrences of one object, at most.
MOST_SPANS: Final = MOST_ACTIVATIONS

_SECOND_US: Final = 1_000_000
_DAY: Final = timedelta(days=1)
_DAY_S: Final = 86_400
_MINUTE_S: Final = 60
_DAYS_AT_ONCE: Final = 10_000
# On a day without sunrise and sunset, both events are one instant, up to rounding.
_LEAST_SUN_S: Final = 2.0
_EPOCH: Final = date(1970, 1, 1)
_CLOCK_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_FIRST, _LAST = date(1, 1, 3), date(9999, 12, 28)


@dataclass(frozen=True, slots=True)
class Moment:
    """A time of day: of a clock, or of the sun.

    offset_s : seconds since midnight, 0 to 86,400, or with an event seconds after it
    event : one of `sun.EVENTS`, or None
    """

    offset_s: int
    event: str | None = None


@dataclass(frozen=True, slots=True)
class Period:
    """A period of a day: it ends on the next day if it would not end after its start, or `days` later.

    Clock times that are equal are a whole day.
    """

    start: Moment
    end: Moment
    days: int | None = None


WHOLE_DAY: Final = Period(Moment(0), Moment(_DAY_S))


class SchedulePart(Protocol):
    """A part of a schedule."""

    @property
    def uses_sun(self) -> bool:
        """Whether occurrences depend on the place."""

    def occurrences(self, start_us: int, end_us: int, places_deg: Floats) -> Iterator[Ints]:
        """Yield spans (n, 2) of all occurrences that share time with [start, end), and perhaps others."""


@dataclass(frozen=True, slots=True)
class Daily:
    """Periods of certain days. A period belongs to the day on which it starts.

    zone : of the clock, and of the dates
    first, last : dates, both inclusive; None: unbounded
    days : days of the week, 0 is Monday; None: all
    dates : only these; None: all
    excepted, excepted_days : dates and days of the week on which no period starts
    """

    zone: tzinfo
    periods: tuple[Period, ...]
    first: date | None = None
    last: date | None = None
    days: frozenset[int] | None = None
    dates: frozenset[date] | None = None
    excepted: frozenset[date] = field(default_factory=frozenset)
    excepted_days: frozenset[int] = field(default_factory=frozenset)

    @property
    def uses_sun(self) -> bool:
        """Whether a period begins or ends with the sun."""
        return any(moment.event for period in self.periods for moment in (period.start, period.end))

    def occurrences(self, start_us: int, end_us: int, places_deg: Floats) -> Iterator[Ints]:
        """Yield all periods that share time with [start, end), and perhaps others."""
        longest = max(period.days or 1 for period in self.periods) + 2
        every = self._on(_day_of(start_us, -longest), _day_of(end_us, 2))
        for first in range(0, len(every), _DAYS_AT_ONCE):
            on = every[first : first + _DAYS_AT_ONCE]
            sun = _Sun(self.zone, list(map(date.fromordinal, on.tolist())), places_deg) if self.uses_sun else None
            for period in self.periods:
                if sun is not None and (period.start.event or period.end.event):
                    found = [sun.span(nth, period) for nth in range(len(on))]
                    yield np.array([one for one in found if one is not None], np.int64).reshape(-1, 2)
                else:
                    yield _spans(self.zone, on, period)

    def _on(self, first: date, last: date) -> Ints:
        """Return the days in [first, last] on which periods start, as ordinals."""
        first, last = max(first, self.first or first), min(last, self.last or last)
        if self.dates is None:
            days = np.arange(first.toordinal(), last.toordinal() + 1)
        else:
            days = np.array(sorted(day.toordinal() for day in self.dates if first <= day <= last), np.int64)
        if self.days is not None or self.excepted_days:
            on = (set(range(7)) if self.days is None else self.days) - self.excepted_days
            # Ordinal 1 is a Monday.
            days = days[np.array([day in on for day in range(7)])[(days - 1) % 7]]
        if self.excepted:
            days = days[~np.isin(days, [day.toordinal() for day in self.excepted])]
        return days


class _Sun:
    """Times of the sun on some days: the earliest and the latest of some places, outward."""

    def __init__(self, zone: tzinfo, on: Sequence[date], places_deg: Floats) -> None:
        # Longitudes on the same turn as the first, so that all places have their noon on one day.
        first = places_deg[0, 0]
        turned = first + (places_deg[:, 0] - first + 180.0) % 360.0 - 180.0
        self.zone, self.on, self.places = zone, on, np.column_stack([turned, places_deg[:, 1]])
        self.known: dict[tuple[str, int], tuple[Floats, Floats, Floats]] = {}

    def span(self, nth: int, period: Period) -> tuple[int, int] | None:
        """Return the period of a day, on whole minutes; None if the sun leaves nothing of it."""
        start_s, earliest_s, _ = self._moment(period.start, nth, 0)
        end_s, _, latest_s = self._moment(period.end, nth, period.days or 0)
        is_sun = period.start.event is not None and period.end.event is not None
        if period.days is None and (_ends_before(period) if is_sun else end_s <= start_s):
            end_s, _, latest_s = self._moment(period.end, nth, 1)
        if is_sun:
            # A day or night that does not happen at a place begins and ends there with the same noon or midnight.
            lasts_s = latest_s - period.end.offset_s - earliest_s + period.start.offset_s
            happens = (lasts_s >= _LEAST_SUN_S) & (latest_s - earliest_s >= _LEAST_SUN_S)
            if not happens.any():
                return None
            earliest_s, latest_s = earliest_s[happens], latest_s[happens]
        first, last = int(earliest_s.min() // _MINUTE_S), int(-(-latest_s.max() // _MINUTE_S))
        return first * _MINUTE_S * _SECOND_US, last * _MINUTE_S * _SECOND_US

    def _moment(self, moment: Moment, nth: int, later: int) -> tuple[float, Floats, Floats]:
        """Return a time of the day, and its earliest and its latest at each place (p,), Unix seconds."""
        if moment.event is None:
            day = self.on[nth] + later * _DAY
            earliest, latest = (_instant_s(self.zone, day, moment.offset_s, is_end) for is_end in (False, True))
            return earliest, np.full(len(self.places), earliest, float), np.full(len(self.places), latest, float)
        if (moment.event, later) not in self.known:
            self.known[moment.event, later] = self._times(moment.event, later)
        at_s, earliest_s, latest_s = (times[nth] + moment.offset_s for times in self.known[moment.event, later])
        return float(at_s), earliest_s, latest_s

    def _times(self, event: str, later: int) -> tuple[Floats, Floats, Floats]:
        # The solar day of a date is the one with its noon on that date, by the mean sun at the first place.
        days = [(day - _EPOCH).days + later for day in self.on]
        noon_s = np.array(days, np.float64) * _DAY_S + 0.5 * _DAY_S
        local_s = np.array([_offset_s(self.zone, day) for day in self.on], np.float64)
        from_noon_s = local_s - 240.0 * self.places[0, 0]
        noon_s -= _DAY_S * np.floor(from_noon_s / _DAY_S + 0.5)
        side = EVENTS[event][1]
        nominal = sun_times(event, noon_s, self.places[:1])[:, 0]
        # The sun is up for longer, or for shorter, if it is taken to be higher or lower.
        both = [sun_times(event, noon_s, self.places, sign * MARGIN_DEG) for sign in (-1.0, 1.0)]
        earlier, longer = (both[1], both[0]) if side < 0.0 else (both[0], both[1])
        return nominal, earlier, longer


def _ends_before(period: Period) -> bool:
    """Return whether a period from sun to sun ends on the next day: from sunset to sunrise, for example."""
    order = list(EVENTS)
    start, end = ((order.index(moment.event or ""), moment.offset_s) for moment in (period.start, period.end))
    return end <= start


@dataclass(frozen=True, slots=True)
class TimedRule:
    """A rule during [start, end) only; None: unbounded.

    place_deg : longitude and latitude for times of the sun, in place of those of the object
    """

    rule: SchedulePart
    start_us: int | None = None
    end_us: int | None = None
    place_deg: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Schedule:
    """When something is active: during all occurrences of all parts.

    who : the object, for messages
    """

    who: str
    parts: tuple[TimedRule, ...]

    @property
    def uses_sun(self) -> bool:
        """Whether spans depend on the object's place."""
        return any(part.rule.uses_sun and part.place_deg is None for part in self.parts)

    def expand(self, start_us: int, end_us: int, places_deg: Floats | None = None) -> Ints:
        """Return the spans (n, 2) within [start, end), sorted, disjoint, none touching the next; ends are exclusive.

        places_deg : (p, 2) longitude and latitude, for times of the sun: a span contains that of each place. The first
            decides which date a sunrise belongs to
        """
        found = [np.clip(spans, low, high) for spans, low, high in self._occurrences(start_us, end_us, places_deg)]
        return merged(np.concatenate([np.empty((0, 2), np.int64), *found]))

    def departures(self, start_us: int, end_us: int, places_deg: Floats | None = None) -> Ints:
        """Return the starts (n,) of all occurrences in [start, end), sorted, each once."""
        found = [
            spans[(spans[:, 0] >= low) & (spans[:, 0] < high), 0]
            for spans, low, high in self._occurrences(start_us, end_us, places_deg)
        ]
        return np.unique(np.concatenate([np.empty(0, np.int64), *found]))

    def _occurrences(self, start_us: int, end_us: int, places_deg: Floats | None) -> list[tuple[Ints, int, int]]:
        """Return occurrences, each with the part of the request that its own part of the schedule shares."""
        if places_deg is None or not len(places_deg):
            if self.uses_sun:
                raise InvalidInput(self.who, "schedule", "uses times of the sun, and needs a place: give `place`")
            places_deg = np.zeros((1, 2))
        found: list[tuple[Ints, int, int]] = []
        count = 0
        for part in self.parts:
            low = start_us if part.start_us is None else max(start_us, part.start_us)
            high = end_us if part.end_us is None else min(end_us, part.end_us)
            if low >= high:
                continue
            places = places_deg if part.place_deg is None else np.array([part.place_deg])
            for spans in part.rule.occurrences(low, high, places):
                shared = spans[(spans[:, 0] < high) & (spans[:, 1] > low)]
                if not len(shared):
                    continue
                found.append((shared, low, high))
                count += len(shared)
                if count > MOST_SPANS:
                    days = (end_us - start_us) / (_DAY_S * _SECOND_US)
                    limit = f"has more than {MOST_SPANS:,} activations in {days:,.0f} days"
                    raise InvalidInput(self.who, "schedule", f"{limit}: shorten it, or the scene's `horizon_days`")
        return found


def merged(spans: Ints) -> Ints:
    """Return spans (n, 2) as their union: sorted, disjoint, none touching the next."""
    spans = spans[np.argsort(spans[:, 0], kind="stable")]
    spans = spans[spans[:, 0] < spans[:, 1]]
    if not len(spans):
        return spans
    reach = np.maximum.accumulate(spans[:, 1])
    begins = np.append(True, spans[1:, 0] > reach[:-1])
    ends = np.append(begins[1:], True)
    return np.stack([spans[begins, 0], reach[ends]], axis=1)


def _day_of(at_us: int, later: int) -> date:
    day = at_us // (_DAY_S * _SECOND_US) + later
    return _EPOCH + _DAY * min(max(day, (_FIRST - _EPOCH).days), (_LAST - _EPOCH).days)


def _spans(zone: tzinfo, on: Ints, period: Period) -> Ints:
    """Return the spans (n, 2) of a period without the sun, on days given as ordinals."""
    start, end = period.start.offset_s, period.end.offset_s
    days = (0 if end > start else 1) if period.days is None else period.days
    starts_s, ends_s = _instants_s(zone, on, start, False), _instants_s(zone, on + days, end, True)
    return np.stack([starts_s, ends_s], axis=1) * _SECOND_US


def _instants_s(zone: tzinfo, on: Ints, clock_s: int, is_end: bool) -> Ints:
    """Return `_instant_s` of several days, given as ordinals."""
    found = (on - _EPOCH.toordinal()) * _DAY_S + clock_s
    if zone is UTC or not len(on):
        return found
    first, last = (date.fromordinal(int(day)).year for day in (on.min(), on.max()))
    years = [_ahead(zone, year) for year in range(first, last + 1)]
    ahead_s, changes = (np.concatenate([year[i] for year in years]) for i in (0, 1))
    nth = on - date(first, 1, 1).toordinal()
    found -= ahead_s[nth]
    for i in np.flatnonzero(changes[nth]):
        found[i] = _instant_s(zone, date.fromordinal(int(on[i])), clock_s, is_end)
    return found


@lru_cache(1_000)
def _ahead(zone: tzinfo, year: int) -> tuple[Ints, NDArray[np.bool_]]:
    """Return how far a clock is ahead of UTC on each day of a year, seconds, and on which days that changes."""
    days = [date.fromordinal(n) for n in range(date(year, 1, 1).toordinal(), date(year, 12, 31).toordinal() + 1)]
    noon_s = np.array([_offset_s(zone, day) for day in days])
    midnight = [datetime.combine(day, time(), zone) for day in days]
    # Both times of a midnight that exists twice or not at all.
    both_s = np.array([[_seconds(one.replace(fold=fold).utcoffset()) for fold in (0, 1)] for one in midnight])
    next_s = np.append(both_s[1:], [[np.nan, np.nan]], axis=0)
    is_constant = (np.hstack([both_s, next_s]) == noon_s[:, None]).all(axis=1) & (noon_s % 1.0 == 0.0)
    return noon_s.astype(np.int64), ~is_constant


@lru_cache(10_000)
def _instant_s(zone: tzinfo, day: date, clock_s: int, is_end: bool) -> int:
    """Return the Unix time of a clock; where clocks change, the earlier one of a start, and the later one of an end."""
    if zone is UTC:
        return (day - _EPOCH).days * _DAY_S + clock_s
    local = datetime.combine(day, time()) + timedelta(seconds=clock_s)
    both = [int((local.replace(tzinfo=zone, fold=fold) - _CLOCK_EPOCH).total_seconds()) for fold in (0, 1)]
    return max(both) if is_end else min(both)


def _offset_s(zone: tzinfo, day: date) -> float:
    """Return how far the zone's clock is ahead of UTC at noon of a day, seconds."""
    return _seconds(datetime.combine(day, time(12), zone).utcoffset())


def _seconds(ahead: timedelta | None) -> float:
    return 0.0 if ahead is None else ahead.total_seconds()
