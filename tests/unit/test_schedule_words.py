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
            "every 2 months 08:00 for 2 h 30 min Europe/Copenhagen",
            None,
        ),
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
