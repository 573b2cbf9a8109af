"""Schedules in words: the rule of a plan, and how often it happens."""

from typing import Any

import pytest

from conflictdb.model.schedules import schedule_of
from conflictdb.model.schedules.words import known_spans, schedule_text

DAY_US = 86_400_000_000
WEEKLY = "DTSTART;TZID=Europe/Copenhagen:20261201T080000\nRRULE:FREQ=WEEKLY;BYDAY=TU,TH\nDURATION:PT2H30M"
DATES = {"dates": ["2026-12-01", "2026-12-24"], "periods": [["22:00", "02:00"]]}


@pytest.mark.parametrize(
    ("source", "text", "count"),
    [
        (
            {
                "days": ["TUE"],
                "periods": [["08:00", "16:00"]],
                "timezone": "Europe/Copenhagen",
                "from": "2026-12-01",
                "until": "2027-03-31",
            },
            "Tue 08:00-16:00 Europe/Copenhagen",
            18,
        ),
        (
            {"days": ["MON", "TUE", "WED"], "periods": [["08:00", "09:00"], ["10:00", "11:00"]]},
            "Mon-Wed 08:00-09:00, 10:00-11:00",
            None,
        ),
        (
            {"except": ["SAT", "SUN", "2026-12-24"], "from": "2026-12-21", "until": "2026-12-27"},
            "Mon-Fri all day except 2026-12-24",
            2,
        ),
        (DATES, "2026-12-01, 2026-12-24 22:00-02:00", 2),
        ([DATES, {**DATES, "dates": ["2026-12-02"]}], "2026-12-01, 2026-12-02, 2026-12-24 22:00-02:00", 3),
        ({"periods": [["sunset-30min", "civil_dawn"]]}, "daily sunset-30min-civil dawn", None),
        (
            {"notam": "DAILY 0700-1500", "from": "2026-12-01T07:00Z", "until": "2026-12-04T15:00Z"},
            "daily 07:00-15:00",
            4,
        ),
        ({"rrule": WEEKLY}, "weekly Tue, Thu 08:00 for 2 h 30 min Europe/Copenhagen", None),
        (
            {"rrule": WEEKLY.replace("WEEKLY", "MONTHLY;INTERVAL=2").replace(";BYDAY=TU,TH", "")},
            "every 2 months on day 1 08:00 for 2 h 30 min Europe/Copenhagen, from 2026-12-01",
            None,
        ),
        ({"dates": ["2026-12-01", "2026-12-24"], "days": ["TUE"]}, "2026-12-01 all day", 1),
        (
            [{"days": [day]} for day in ("MON", "TUE", "WED", "THU", "FRI")],
            "Mon all day; Tue all day; Wed all day; and 2 more",
            None,
        ),
    ],
)
def test_a_schedule_is_a_rule_in_words(source: Any, text: str, count: int | None) -> None:
    schedule = schedule_of("area 'A'", source)
    assert schedule_text(schedule) == text
    spans = known_spans(schedule, None, None)
    assert (None if spans is None else len(spans)) == count


ROME = "DTSTART;TZID=Europe/Rome:20261201T080000\n{}\nDURATION:PT2H"


@pytest.mark.parametrize(
    ("lines", "text"),
    [
        ("RRULE:FREQ=WEEKLY", "weekly Tue 08:00 {}"),
        ("RRULE:FREQ=WEEKLY;INTERVAL=2", "every 2 weeks Tue 08:00 {}, from 2026-12-01"),
        ("RRULE:FREQ=MONTHLY;BYDAY=1TU,-1FR", "monthly 1st Tue, last Fri 08:00 {}"),
        ("RRULE:FREQ=MONTHLY;BYDAY=TU", "monthly every Tue 08:00 {}"),
        ("RRULE:FREQ=MONTHLY;BYMONTHDAY=1,15,-2", "monthly on day 1, 15 and the 2nd last day 08:00 {}"),
        ("RRULE:FREQ=YEARLY", "yearly on 1 Dec 08:00 {}"),
        ("RRULE:FREQ=YEARLY;BYMONTH=6,12", "yearly on day 1 in Jun, Dec 08:00 {}"),
        ("RRULE:FREQ=YEARLY;BYMONTH=12;BYDAY=1TU", "yearly 1st Tue in Dec 08:00 {}"),
        ("RRULE:FREQ=DAILY;BYHOUR=8,12;BYMINUTE=0,30", "daily 08:00, 08:30, 12:00, 12:30 {}"),
        ("RRULE:FREQ=DAILY;BYMONTH=6,12", "daily in Jun, Dec 08:00 {}"),
        ("RRULE:FREQ=HOURLY;INTERVAL=6", "every 6 hours at 08:00 {}, from 2026-12-01"),
        ("RRULE:FREQ=HOURLY;BYHOUR=8,9;BYDAY=TU", "daily Tue 08:00, 09:00 {}"),
        ("RRULE:FREQ=HOURLY;BYMINUTE=0,30", "hourly at :00, :30 {}"),
        ("RRULE:FREQ=WEEKLY;COUNT=10", "weekly Tue 08:00 {}, at most 10 times"),
        ("RRULE:FREQ=WEEKLY;UNTIL=20270202", "weekly Tue 08:00 {}, until 2027-02-02"),
        ("RRULE:FREQ=WEEKLY;UNTIL=20270202T060000Z", "weekly Tue 08:00 {}, until 2027-02-02 07:00"),
        # DTSTART is a start, too.
        ("RRULE:FREQ=WEEKLY;BYDAY=WE;BYHOUR=9", "weekly Wed 09:00 {} and 2026-12-01 08:00"),
        (
            "RRULE:FREQ=WEEKLY\nRDATE;TZID=Europe/Rome:20261224T080000,20261226T100000\nEXDATE;TZID=Europe/Rome:20261208T080000",
            "weekly Tue 08:00 {} and 2026-12-24, 2026-12-26 10:00 except 2026-12-08",
        ),
        ("RDATE;TZID=Europe/Rome:20261224T080000", "2026-12-01, 2026-12-24 08:00 {}"),
        ("RDATE;TZID=Europe/Rome:20261224T100000", "2026-12-01 08:00, 2026-12-24 10:00 {}"),
        # There are no words for it: the rule, as it is written.
        ("RRULE:FREQ=MONTHLY;BYSETPOS=2;BYDAY=MO", "RRULE FREQ=MONTHLY;BYSETPOS=2;BYDAY=MO from 2026-12-01 08:00 {}"),
        ("RRULE:FREQ=YEARLY;BYYEARDAY=100", "RRULE FREQ=YEARLY;BYYEARDAY=100 from 2026-12-01 08:00 {}"),
        ("RRULE:FREQ=YEARLY;BYWEEKNO=20", "RRULE FREQ=YEARLY;BYWEEKNO=20 from 2026-12-01 08:00 {}"),
        (
            "RRULE:FREQ=MONTHLY;BYMONTHDAY=13;BYDAY=FR",
            "RRULE FREQ=MONTHLY;BYMONTHDAY=13;BYDAY=FR from 2026-12-01 08:00 {}",
        ),
        ("RRULE:FREQ=DAILY;INTERVAL=7;BYDAY=WE", "RRULE FREQ=DAILY;INTERVAL=7;BYDAY=WE from 2026-12-01 08:00 {}"),
        (
            "RRULE:FREQ=MONTHLY;BYSETPOS=1;BYDAY=TU;UNTIL=20270202\nEXDATE;TZID=Europe/Rome:20261208T080000",
            "RRULE FREQ=MONTHLY;BYSETPOS=1;BYDAY=TU from 2026-12-01 08:00 {}, until 2027-02-02 except 2026-12-08",
        ),
    ],
)  # fmt: skip
def test_the_words_of_a_rule_say_all_of_it(lines: str, text: str) -> None:
    schedule = schedule_of("area 'A'", {"rrule": ROME.format(lines)})
    assert schedule_text(schedule) == text.format("for 2 h Europe/Rome")


def test_spans_are_those_between_two_instants() -> None:
    """Without an end of their own they need one."""
    schedule = schedule_of("area 'A'", {"rrule": WEEKLY})
    first_us = 20_788 * DAY_US  # 1 December 2026
    spans = known_spans(schedule, None, first_us + 14 * DAY_US)
    assert spans is not None
    assert len(spans) == 4
    assert known_spans(schedule, first_us, None) is None
    empty = known_spans(schedule, None, first_us - DAY_US)
    assert empty is None or not len(empty)
