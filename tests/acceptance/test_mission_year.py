"""A mission of a year beside a worker: current every day, acknowledgements kept, tables bounded."""

import mission_year
import pytest


@pytest.mark.db
def test_a_fortnight() -> None:
    """Every kind of edit comes once."""
    mission_year.run(13, 5)


@pytest.mark.slow
@pytest.mark.db
def test_a_year_in_a_day() -> None:
    """`tests/acceptance/mission_year.py` says what happens on which day."""
    lines: list[str] = []
    sizes = mission_year.run(365, 20, lines.append)
    assert len(lines) == 12
    assert set(mission_year.BOUNDED) <= set(sizes)
