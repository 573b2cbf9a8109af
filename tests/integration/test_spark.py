"""Scenes on Spark: the rows of one machine, bit by bit, whatever the number of partitions."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import scenes
from spark_answers import Job, answer_of_one_machine, answers
from workloads import SEAM, throw

from conflictdb.io.reading import read

# Sedona joins small scenes by sending one side everywhere, unless it is told not to.
BY_TREE = {"sedona.join.autoBroadcastJoinThreshold": "-1"}
BY_SENDING = {"sedona.join.autoBroadcastJoinThreshold": "10MB"}


def test_scenes_on_spark_have_the_rows_of_one_machine(tmp_path: Path) -> None:
    """All columns that are not of a database alone; by one partition and many, joined one way and the other."""
    strait, areas, tracks, _ = read(str(files("conflictdb") / "scenes" / "strait.geojson"))
    assert strait is not None
    near, closed, moving = throw(SEAM, 3, 12, 24)
    # A crowd, which is joined in lots.
    objects = closed, [*moving, *(replace(moving[0], key=f"version {i}") for i in range(50))]
    near = replace(near, nearest_m=20_000.0, separation_m=500.0)
    pole = scenes.circles_over_the_pole()
    jobs = [
        Job("strait", strait, areas, tracks, 16, BY_TREE),
        Job("near at the seam", near, *objects, 3, BY_TREE),
        Job("centre to be found", replace(pole.scene, centre=None), pole.areas, pole.tracks, 1, BY_SENDING),
    ]
    found = answers(jobs, tmp_path)
    for job in jobs:
        expected = answer_of_one_machine(job.scene, job.areas, job.tracks)
        assert expected.num_rows
        assert found[job.name].to_pylist() == expected.to_pylist(), job.name
