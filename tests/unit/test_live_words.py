"""Latenesses in the words of alarms, as the page says them."""

from datetime import UTC, datetime

import pytest

from conflictdb.cli.detecting import _lateness, _named
from conflictdb.store import LiveTrack


def track(state: str, from_s: float | None, to_s: float | None) -> LiveTrack:
    now = datetime(2026, 12, 1, tzinfo=UTC)
    return LiveTrack("A", state, from_s, to_s, None, now, 0.0, 0.0, None, 0.0, now, None, None)


@pytest.mark.parametrize(
    ("state", "from_s", "to_s", "words", "column"),
    [
        ("late", 661.0, 839.0, "A 11 to 14 min late", "+11 to +14 min"),
        ("late", 660.0, 660.0, "A 11 min late", "+11 min"),
        ("early", -780.0, -720.5, "A 12 to 13 min early", "-13 to -12 min"),
        ("silent", -120.0, 300.0, "A silent, 2 min early to 5 min late", "-2 to +5 min"),
        ("silent", None, None, "A silent", None),
        ("off", None, None, "A off", None),
        ("on plan", 0.0, 60.0, "A", "+0 to +1 min"),
    ],
)
def test_an_alarm_says_early_and_late_without_signs(
    state: str, from_s: float | None, to_s: float | None, words: str, column: str | None
) -> None:
    one = track(state, from_s, to_s)
    assert _named("A", {"A": one}) == words
    assert _lateness(one) == column
