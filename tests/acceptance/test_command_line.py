"""`detect FILE --format json` on random scenes prints the conflicts of the oracle."""

from datetime import datetime
from pathlib import Path

import pytest
from commands import Run
from layouts import LONG_LEGS, SEAM, SOUTH, Workload
from mixed_scenes import plain_scene
from scene_file import write_scene
from verdicts import Period, Reported, compared, microseconds

from conflictdb.model.plans import EarthModel
from conflictdb.model.results import Verdict


def instant(text: str | None) -> int | None:
    return microseconds(None if text is None else datetime.fromisoformat(text))


@pytest.mark.parametrize(
    ("workload", "seed", "earth"),
    [(LONG_LEGS, 3, EarthModel.WGS84), (SEAM, 4, EarthModel.WGS84), (SOUTH, 5, EarthModel.SPHERE)],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_printed_conflicts_are_those_of_the_oracle(
    run: Run, tmp_path: Path, workload: Workload, seed: int, earth: EarthModel
) -> None:
    """The programs of test_documents and test_ends_cleanly start as users start them; this is called."""
    scene, areas, tracks = plain_scene(workload, seed, 10, 8, earth)
    path = write_scene(tmp_path / "scene.geojson", scene, areas, tracks)
    done = run("detect", path, "--format", "json", "--jobs", "1")
    assert done.code == 0, done.err
    reported = {}
    for row in done.json:
        assert row["scene"] == scene.name
        assert row["is_current"] is True
        periods: tuple[Period, ...] = tuple((instant(start), instant(end)) for start, end in row["periods"])
        reported[row["a_key"], row["b_key"]] = Reported(Verdict(row["verdict"]), periods, row["time_error_s"])
    result = compared(scene, areas, tracks, reported)
    assert not result.wrong
    assert result.touching > 3
    assert result.unresolved == 0
    assert result.worst_bound_s < 10.0
