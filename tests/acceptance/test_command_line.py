"""`detect FILE --format json` on random scenes prints the conflicts of the oracle."""

import json
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import pytest
from scene_file import write_scene
from verdicts import Period, Reported, compared, microseconds
from workloads import LONG_LEGS, SEAM, SOUTH, Workload, throw

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
    dsn: str, tmp_path: Path, workload: Workload, seed: int, earth: EarthModel
) -> None:
    scene, areas, tracks = throw(workload, seed, 10, 8, earth)
    path = write_scene(tmp_path / "scene.geojson", scene, areas, tracks)
    done = subprocess.run(
        [sys.executable, "-m", "conflictdb", "--dsn", dsn, "detect", str(path), "--format", "json", "--jobs", "1"],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    reported = {}
    for row in json.loads(done.stdout):
        assert row["scene"] == scene.name
        assert row["is_current"] is True
        periods: tuple[Period, ...] = tuple((instant(start), instant(end)) for start, end in row["periods"])
        reported[row["a_key"], row["b_key"]] = Reported(Verdict(row["verdict"]), periods, row["time_error_s"])
    result = compared(scene, areas, tracks, reported)
    assert not result.wrong
    assert result.touching > 3
    assert result.unresolved == 0
    assert result.worst_bound_s < 10.0
