"""Values that look like times are recognised in the forms that people write."""

import pytest

from conflictdb.formats.time_columns import is_time_like


@pytest.mark.parametrize(
    "text", ["2026-06-01", "2026/06/01 08:00", "01/06/2026", "1.6.2026", "01-06-2026 08:00:00", "01/06/2026T08:00"]
)
def test_dates_look_like_times(text: str) -> None:
    assert is_time_like("note", text)


@pytest.mark.parametrize("text", ["", "12", "1/2", "01/06/26", "7 of 12/06/2026", "10.0.0.2026.1", "2026"])
def test_other_texts_do_not(text: str) -> None:
    assert not is_time_like("note", text)
