"""Answers equal the recorded ones to the bit; `digests.py` compares all scenes, and records them again."""

import pytest
from digests import acceptance_scenes, differences, few, recorded

from conflictdb import connect


def test_record_is_of_the_scenes() -> None:
    assert list(recorded()["scenes"]) == list(acceptance_scenes())


def test_answers_of_some_scenes_are_the_recorded_ones(dsn: str) -> None:
    with connect(dsn) as db:
        found = list(differences(few(), db))
    assert not found, "\n".join([*found, "if on purpose: ./run python tests/paths/digests.py --record"])


@pytest.mark.slow
def test_answers_of_all_scenes_are_the_recorded_ones(dsn: str) -> None:
    with connect(dsn) as db:
        found = list(differences(acceptance_scenes(), db))
    assert not found, "\n".join(found)
