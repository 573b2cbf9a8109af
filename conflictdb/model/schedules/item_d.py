"""Item D of a NOTAM: the times of day at which it is active, between its items B and C.

The grammar is that of ICAO Doc 8126 and of EUROCONTROL's OPADD. All times are UTC. A period that passes midnight
belongs to the day on which it starts, so `EXC` removes the periods that start on a day. 2359 ends a day, as 2400 does.
Three forms that are common though no grammar has them are read, too: 0800/1000, times before DAILY, and a list of spans
such as 2205201000 TO 2205201400. What has another reading, or needs a list of holidays, is refused.
"""

import re
from datetime import UTC, date, datetime, timedelta
from typing import Final

from conflictdb.errors import InvalidInput
from conflictdb.model.schedules.days import DAYS, MONTHS
from conflictdb.model.schedules.schedule import WHOLE_DAY, Daily, Moment, Period, Schedule, TimedRule

Valid = tuple[int | None, int | None]

_FIELD: Final = "schedule.notam"
_WORD: Final = re.compile(r"\d{4}(?!\d)|\d{1,3}(?!\d)|[A-Z]+\d*|[-,]")
_SLASH: Final = re.compile(r"(?<!\d)(\d{4})/(\d{4})(?!\d)")
_UTC: Final = re.compile(r"(?<!\d)(\d{4}) ?UTC\b")
_SPAN: Final = re.compile(r"(\d{6})(\d{4}) TO (\d{6})(\d{4})(?!\d)[ ,]*")
_EVENTS: Final = {"SR": "sunrise", "SS": "sunset", "BMCT": "civil_dawn", "EECT": "civil_dusk", "EECET": "civil_dusk"}
_SIGNS: Final = {"PLUS": 60, "MINUS": -60}
_WHOLE: Final = {
    "H24": WHOLE_DAY,
    "HJ": Period(Moment(0, "sunrise"), Moment(0, "sunset")),
    "HN": Period(Moment(0, "sunset"), Moment(0, "sunrise")),
}
_EVERY_DAY: Final = {"DAILY", "DLY"}
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_DAY: Final = timedelta(days=1)
_DAY_S: Final = 86_400
_MOST_TEXT: Final = 10_000


def item_d_schedule(who: str, text: str, valid_us: Valid = (None, None)) -> Schedule:
    """Return the schedule of item D; raises InvalidInput if it is not understood wholly.

    valid_us : items B and C, microseconds since 1970, the end exclusive; None: unbounded, and dates are refused
    """
    if not isinstance(text, str) or not text.strip():
        raise InvalidInput(who, _FIELD, f"must be text such as MON-FRI 0800-1700; got {text!r:.60}")
    if len(text) > _MOST_TEXT:
        raise InvalidInput(who, _FIELD, f"must have at most {_MOST_TEXT:,} characters; got {len(text):,}")
    return _ItemD(who, text, valid_us).schedule()


class _ItemD:
    """Read words from left to right: groups of days, then periods, then exceptions."""

    def __init__(self, who: str, text: str, valid_us: Valid) -> None:
        self.who, self.text, self.valid_us = who, text, valid_us
        upper = text.upper().strip().rstrip(".")
        self.spans = [] if _SPAN.sub("", upper) else _SPAN.findall(upper)
        upper = "" if self.spans else _UTC.sub(r"\1", _SLASH.sub(r"\1-\2", upper))
        rest = _WORD.sub(" ", upper).split()
        if rest:
            raise self._unread(rest[0])
        self.words: list[str] = _WORD.findall(upper)
        self.at = 0
        self.month: int | None = None

    def schedule(self) -> Schedule:
        rules = [self._from_to(*span) for span in self.spans]
        while self.at < len(self.words):
            rules.append(self._group())
        return Schedule(self.who, tuple(TimedRule(rule, *self.valid_us) for rule in rules))

    def _from_to(self, first: str, start: str, last: str, end: str) -> Daily:
        """Return a period from one date and time to another, written as items B and C."""
        self.words, self.at = [start, end], 0
        try:
            begin, until = (datetime.strptime(day, "%y%m%d").date() for day in (first, last))
        except ValueError:
            raise self._refused("has a date that is none") from None
        period = Period(self._moment(is_end=False), self._moment(is_end=True), (until - begin).days)
        if (begin, period.start.offset_s) >= (until, period.end.offset_s):
            raise self._refused("has a span that ends before it starts")
        start_us, end_us = self.valid_us
        at_us = (begin - _EPOCH.date()).days * _DAY_S * 1_000_000
        if (start_us is not None and at_us + 2 * _DAY_S * 1_000_000 <= start_us) or (
            end_us is not None and at_us >= end_us
        ):
            raise self._refused(f"has the date {first}, which is not between items B and C")
        return Daily(UTC, (period,), dates=frozenset({begin}))

    # --- groups

    def _group(self) -> Daily:
        weekdays: set[int] = set()
        dates: set[date] = set()
        is_daily = False
        periods: list[Period] = []
        excepted: set[date] = set()
        excepted_days: set[int] = set()
        while self.at < len(self.words):
            if self._is_comma():
                self.at += 1
            elif self._peek() in _EVERY_DAY and not periods:
                self.at, is_daily = self.at + 1, True
            elif self._is_time():
                periods.append(self._period(weekdays, dates))
            elif self._is_day() and not periods and not (excepted or excepted_days):
                self._days(weekdays, dates)
            elif self._peek() in ("EXC", "EXCEPT"):
                self.at += 1
                self._exceptions(excepted, excepted_days, bool(periods))
                if periods:
                    break
            elif periods and self._peek() in _EVERY_DAY and not (weekdays or dates) and self.at == len(self.words) - 1:
                self.at += 1
            elif periods and (self._is_day() or self._peek() in _EVERY_DAY):
                break
            else:
                raise self._unread(self._peek())
        if not periods:
            raise self._refused("has days without times: write H24 for whole days")
        if weekdays and (dates or is_daily):
            raise self._refused("has days of the week beside dates or DAILY in one group, which has two readings")
        return Daily(
            UTC,
            tuple(periods),
            days=frozenset(weekdays) if weekdays else None,
            dates=frozenset(dates) if dates else None,
            excepted=frozenset(excepted),
            excepted_days=frozenset(excepted_days),
        )

    def _exceptions(self, dates: set[date], weekdays: set[int], has_periods: bool) -> None:
        begin = self.at
        while self.at < len(self.words):
            if self._is_day():
                self._days(weekdays, dates)
            elif self._is_comma() and self.at > begin and self._more_days(self.at + 1):
                self.at += 1
            else:
                break
        if self.at == begin:
            raise self._refused("EXC needs dates or days of the week")
        # "EXC 14 JUL 01 0800-1000" has two readings; a comma before JUL decides.
        if has_periods and self.at < len(self.words) and self._is_time():
            raise self._refused("has times after EXC: write a comma before the days that they belong to")

    def _more_days(self, at: int) -> bool:
        """Return whether the days from word `at` on are not the days of another group, with times."""
        kept, self.at = self.at, at
        try:
            more = False
            while self.at < len(self.words) and (self._is_day() or self._is_comma()):
                more = more or self._is_day()
                self.at += 1
                while self.at < len(self.words) and self._peek() == "-":
                    self.at += 2
            return more and not (self.at < len(self.words) and self._is_time())
        finally:
            self.at = kept

    # --- days

    def _is_day(self, at: int | None = None) -> bool:
        word = self._peek(at)
        return word in DAYS or word in MONTHS or word == "EVERY" or (word.isdigit() and len(word) <= 2)

    def _days(self, weekdays: set[int], dates: set[date]) -> None:
        if self._peek() == "EVERY":
            self.at += 1
            if self._peek() not in DAYS:
                raise self._refused("EVERY needs a day of the week")
        if self._peek() in DAYS:
            begin = end = DAYS.index(self._next())
            if self._peek() == "-" and self._peek(self.at + 1) in DAYS:
                self.at += 1
                end = DAYS.index(self._next())
            weekdays.update((begin + i) % 7 for i in range((end - begin) % 7 + 1))
            return
        firsts = self._date()
        if self._peek() == "-" and self._is_day(self.at + 1) and self._peek(self.at + 1) not in DAYS:
            self.at += 1
            lasts = self._date()
            for first in firsts:
                later = [last for last in lasts if last >= first]
                if not later:
                    raise self._refused("has a range of dates that ends before it starts, or after item C")
                dates.update(first + i * _DAY for i in range((later[0] - first).days + 1))
        else:
            dates.update(firsts)

    def _date(self) -> list[date]:
        """Return the dates of a month and a day: one in each year that items B and C allow."""
        start_us, end_us = self.valid_us
        if start_us is None or end_us is None:
            raise self._refused("has dates, whose year is that of items B and C: give `from` and `until`")
        begin, end = (_EPOCH + timedelta(microseconds=us) for us in (start_us, end_us - 1))
        # A period may start on the day before B, and pass midnight.
        low, high = begin.date() - _DAY, end.date()
        if self._peek() in MONTHS:
            self.month = MONTHS.index(self._next()) + 1
        elif self.month is None and (begin.year, begin.month) != (end.year, end.month):
            raise self._refused("has days of no month, and items B and C are of different months")
        month = self.month or begin.month
        word = self._next()
        if not (word.isdigit() and len(word) <= 2):
            raise self._unread(word)
        found = []
        for year in range(low.year, high.year + 1):
            try:
                found.append(date(year, month, int(word)))
            except ValueError:  # 29 February of other years
                continue
        within = [day for day in found if low <= day <= high]
        if not within:
            raise self._refused(f"has the date {MONTHS[month - 1]} {word}, which is not between items B and C")
        return within

    # --- times

    def _is_time(self, at: int | None = None) -> bool:
        word = self._peek(at)
        return word in _WHOLE or word in _EVENTS or (word.isdigit() and len(word) == 4)

    def _period(self, weekdays: set[int], dates: set[date]) -> Period:
        if self._peek() in _WHOLE:
            return _WHOLE[self._next()]
        start = self._moment(is_end=False)
        if self._next() != "-":
            raise self._refused("has a time without an end, such as 0800-1700")
        if self._is_time():
            return Period(start, self._moment(is_end=True))
        # "MON 0800-FRI 1700": one period over several days.
        end_weekdays: set[int] = set()
        end_dates: set[date] = set()
        if not self._is_day():
            raise self._unread(self._peek())
        self._days(end_weekdays, end_dates)
        if not self._is_time():
            raise self._unread(self._peek())
        end = self._moment(is_end=True)
        if len(weekdays) == len(end_weekdays) == 1 and not dates and not end_dates:
            days = (end_weekdays.pop() - next(iter(weekdays))) % 7
            if days == 0 and not (start.event or end.event) and end.offset_s <= start.offset_s:
                days = 7
            return Period(start, end, days)
        if len(dates) == len(end_dates) == 1 and not weekdays and not end_weekdays:
            days = (end_dates.pop() - next(iter(dates))).days
            if days > 0 or (days == 0 and start.offset_s < end.offset_s and not (start.event or end.event)):
                return Period(start, end, days)
        raise self._refused("has a period from one day to another that needs one day on both sides, in order")

    def _moment(self, is_end: bool) -> Moment:
        word = self._next()
        if word in _EVENTS:
            return Moment(self._offset_s(), _EVENTS[word])
        if not (word.isdigit() and len(word) == 4):
            raise self._unread(word)
        hour, minute = int(word[:2]), int(word[2:])
        if is_end and word == "2359":
            return Moment(_DAY_S)
        if minute > 59 or hour > 24 or (hour == 24 and (minute or not is_end)):
            raise self._refused(f"has the time {word}")
        return Moment(3600 * hour + 60 * minute)

    def _offset_s(self) -> int:
        word = self._peek()
        sign = next((name for name in _SIGNS if word.startswith(name)), None)
        if sign is None:
            return 0
        minutes = self._next()[len(sign) :] or self._next()
        if not minutes.isdigit() or len(minutes) > 3:
            raise self._unread(minutes)
        return _SIGNS[sign] * int(minutes)

    # --- words

    def _peek(self, at: int | None = None) -> str:
        at = self.at if at is None else at
        return self.words[at] if at < len(self.words) else ""

    def _next(self) -> str:
        word = self._peek()
        self.at += 1
        return word

    def _is_comma(self) -> bool:
        # "AND" joins as a comma does.
        return self._peek() in (",", "AND")

    def _refused(self, rule: str) -> InvalidInput:
        return InvalidInput(self.who, _FIELD, f"{rule}; got {self.text!r:.200}")

    def _unread(self, word: str) -> InvalidInput:
        return self._refused(f"is not understood at {word!r}" if word else "ends too early")
