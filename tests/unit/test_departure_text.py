"""Sentences about delays: each time that they name is free of conflicts, whatever it is rounded to."""

import json
from dataclasses import replace

import pytest
import shapely

from conflictdb import Area, Delays, Forbidden
from conflictdb.model.departure_text import departure_text, duration_text

RANGE = Area("RANGE", shapely.box(0, 0, 1, 1))
TUESDAYS = Area("TUESDAYS", shapely.box(0, 0, 1, 1), schedule={"periods": [["19:10", "23:00"]]})
CLOSED = Area("CLOSED", shapely.box(0, 0, 1, 1), start_us=1_780_000_000_000_000)


def found(
    *spans: tuple[float, float, str], least: tuple[float | None, float | None] = (0.0, 0.0), blocked: str = ""
) -> Delays:
    """The delays of FERRY: intervals with the keys that forbid them."""
    forbidden = tuple(Forbidden(low, high, 0.0, 0.0, True, tuple(by.split())) for low, high, by in spans)
    return Delays("FERRY", forbidden, *least, tuple(blocked.split()), False, False, -7200.0, 7200.0)


@pytest.mark.parametrize(
    ("delays", "says"),
    [
        (found(), "FERRY may leave 2 h later or earlier without a conflict"),
        (
            found((720.000001, 7200.0, "TOW")),
            "FERRY may leave up to 12 min later before it meets TOW, and 2 h earlier",
        ),
        (
            found((-7200.0, -3660.0, "A"), (720.0, 900.0, "B"), (1000.0, 1001.0, "C")),
            "FERRY may leave up to 11 min 59 s later before it meets B, and up to 1 h 59 s earlier before it meets A",
        ),
        (found((0.25, 1.0, "B")), "FERRY may leave up to 0.249 s later before it meets B, and 2 h earlier"),
        (found((0.000002, 1.0, "B")), "FERRY may leave up to 0.000001 s later before it meets B, and 2 h earlier"),
        (found((0.000001, 1.0, "B")), "FERRY may leave up to 0 s later before it meets B, and 2 h earlier"),
        (
            found((-478.552697, 677.337142, "TOW"), least=(677.337143, 478.552698)),
            "FERRY must leave 11 min 18 s later or 7 min 59 s earlier to clear TOW",
        ),
        (
            found((-7200.0, 677.337142, "A B C"), least=(677.337143, None)),
            "FERRY must leave 11 min 18 s later to clear A, B and C; no earlier departure within 2 h does",
        ),
        (
            found((-10.0, 7200.0, "A B"), least=(None, 10.000001)),
            "FERRY must leave 11 s earlier to clear A and B; no later departure within 2 h does",
        ),
        (
            found((-10.0, 7200.0, "A B C D E F G"), least=(None, 10.000001)),
            "FERRY must leave 11 s earlier to clear A, B, C, D, E and 2 more; no later departure within 2 h does",
        ),
        (
            found((-7200.0, 7200.0, "A RANGE"), least=(None, None), blocked="A RANGE"),
            "no delay within 2 h clears FERRY: it crosses RANGE, which is there for ever",
        ),
        (
            found((-7200.0, 7200.0, "CLOSED"), least=(None, None), blocked="CLOSED"),
            "no delay within 2 h clears FERRY: it meets CLOSED",
        ),
        (
            found((-7200.0, 7200.0, "TUESDAYS"), least=(None, None), blocked="TUESDAYS"),
            "no delay within 2 h clears FERRY: it meets TUESDAYS",
        ),
        (found((-7200.0, 7200.0, "A B"), least=(None, None)), "no delay within 2 h clears FERRY: it meets A and B"),
    ],
)
def test_a_sentence_says_how_much_later_or_earlier(delays: Delays, says: str) -> None:
    assert departure_text(delays, [RANGE, CLOSED, TUESDAYS], str) == says


@pytest.mark.parametrize(
    ("next_s", "says"),
    [(678.000001, "11 min 18 s"), (678.0, "11 min 17.338 s"), (677.338, "11 min 17.337143 s")],
)
def test_a_least_delay_is_not_rounded_into_the_next_conflict(next_s: float, says: str) -> None:
    later = found((-7200.0, 677.337142, "A"), (next_s, 700.0, "B"), least=(677.337143, None))
    assert f"must leave {says} later" in departure_text(later, [], str)
    earlier = found((-700.0, -next_s, "B"), (-677.337142, 7200.0, "A"), least=(None, 677.337143))
    assert f"must leave {says} earlier" in departure_text(earlier, [], str)


def test_nor_beyond_the_horizon() -> None:
    last = replace(found((-7200.0, 7199.9, "A"), least=(7199.900001, None)), latest_s=7199.95)
    assert "must leave 1 h 59 min 59.901 s later" in departure_text(last, [], str)


def test_keys_are_shown_as_named() -> None:
    text = departure_text(found((1.0, 2.0, "B")), [], json.dumps)
    assert text.startswith('"FERRY" may leave')
    assert 'before it meets "B"' in text


def test_durations_are_exact() -> None:
    shown = {0: "0 s", 1: "0.000001 s", 3_600_000_000: "1 h", 90_061_500_000: "25 h 1 min 1.5 s", 60_000_000: "1 min"}
    assert {us: duration_text(us) for us in shown} == shown
