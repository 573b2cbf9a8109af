"""The search for disagreements itself: that it runs, finds none, and would find a bug that hides well."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from adversary import Answer, search
from verdicts import solved

from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Verdict

SEED = 3
CANDIDATES = 30  # a scene and a climb


class Planted:
    """A solver with a bug in every `every`-th conflict that it reports."""

    def __init__(self, kind: str, every: int) -> None:
        self.kind, self.every, self.conflicts = kind, every, 0

    def __call__(self, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Answer:
        answer = solved(scene, areas, tracks)
        for pair, one in list(answer.items()):
            self.conflicts += one.verdict is Verdict.CONFLICT
            if one.verdict is Verdict.CONFLICT and self.conflicts % self.every == 0:
                if self.kind == "drops":
                    del answer[pair]
                elif one.periods_us[0][0] is not None:
                    (start, end), *rest = one.periods_us
                    answer[pair] = replace(one, periods_us=((start + 1_000_000, end), *rest))
        return answer


def test_search_finds_nothing_wrong(tmp_path: Path) -> None:
    run = search(SEED, tmp_path, Method.EXACT, seconds=60.0, candidates=CANDIDATES)
    assert not run.found
    assert run.total.touching > 5
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", ["drops", "shifts"])
def test_search_finds_a_planted_bug(tmp_path: Path, kind: str) -> None:
    """A conflict of twenty is dropped, or begins a second late; and the scene file is kept."""
    run = search(SEED, tmp_path, Method.EXACT, Planted(kind, 20), seconds=60.0, candidates=CANDIDATES)
    assert run.found
    assert all("missed" in one or "is not within" in one or "off" in one for one in run.found)
    assert list(tmp_path.glob("*.geojson"))
