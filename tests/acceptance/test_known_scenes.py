"""Scenes that can be solved by hand: loaded from a scene file, detected in the database, read back."""

from pathlib import Path

import pytest
from scene_file import write_scene
from scenes import T0_US, Known, known_scenes
from verdicts import Reported, by_pair, solved

from conflictdb import connect
from conflictdb.model.results import Verdict

ROUNDING_S = 3e-6
KNOWN = known_scenes()


def assert_known(known: Known, reported: dict[tuple[str, str], Reported]) -> None:
    assert set(known.expected) <= set(reported), "missed"
    assert set(reported) <= set(known.expected) | known.undecided, "false"
    for pair, expected in known.expected.items():
        answer = reported[pair]
        if answer.verdict is Verdict.GRAZING and pair in known.undecided:
            continue
        assert answer.verdict is (Verdict.GRAZING if pair in known.grazing else Verdict.CONFLICT), pair
        assert len(answer.periods_us) == len(expected), (pair, answer)
        for period, interval in zip(answer.periods_us, expected, strict=True):
            for mine, want in zip(period, interval, strict=True):
                if want is None or mine is None:
                    assert mine is want, (pair, answer)
                else:
                    assert abs((mine - T0_US) / 1e6 - want) <= answer.time_error_s + ROUNDING_S, (
                        pair,
                        answer,
                        expected,
                    )


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.scene.name)
def test_known_answers_in_memory(known: Known) -> None:
    assert_known(known, solved(known.scene, known.areas, known.tracks))


def test_known_answers_through_files_and_the_database(dsn: str, tmp_path: Path) -> None:
    with connect(dsn) as db:
        for known in KNOWN:
            path = write_scene(tmp_path / "scene.geojson", known.scene, known.areas, known.tracks)
            assert db.load(path).name == known.scene.name
            db.scene(known.scene.name).detect(jobs=1)
            assert_known(known, by_pair(db.scene(known.scene.name).conflicts()))
            again = db.scene(known.scene.name).detect(jobs=1)
            assert (again.opened, again.changed, again.closed) == (0, 0, 0)
