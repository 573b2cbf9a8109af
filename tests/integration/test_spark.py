"""Scenes on Spark: the rows of one machine, bit by bit, whatever the number of partitions."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest
import scenes
from spark_answers import Job, answer_of_one_machine, answers
from workloads import GROWING, OCEAN, SEAM, throw

from conflictdb.io.reading import read
from conflictdb.methods import Method

# Sedona joins small scenes by sending one side everywhere, unless it is told not to.
BY_TREE = {"sedona.join.autoBroadcastJoinThreshold": "-1"}
BY_SENDING = {"sedona.join.autoBroadcastJoinThreshold": "10MB"}


def test_scenes_on_spark_have_the_rows_of_one_machine(tmp_path: Path) -> None:
    """All columns that are not of a database alone: by one partition and many, joined one way and the other, also where
    an executor is killed with what it held."""
    strait, areas, tracks, _ = read(str(files("conflictdb") / "scenes" / "strait.geojson"))
    assert strait is not None
    near, closed, moving = throw(SEAM, 3, 12, 24)
    # A crowd, which is joined in lots.
    objects = closed, [*moving, *(replace(moving[0], key=f"version {i}") for i in range(50))]
    near = replace(near, nearest_m=20_000.0, separation_m=500.0)
    jobs = [
        Job("strait", strait, areas, tracks, 3, BY_SENDING),
        Job("near at the seam", near, *objects, 5, BY_TREE, kills=True),
    ]
    found = answers(jobs, tmp_path, master="local-cluster[2,1,1024]")
    assert (tmp_path / "near at the seam.killed").exists()
    for job in jobs:
        expected = answer_of_one_machine(job.scene, job.areas, job.tracks)
        assert expected.num_rows
        assert found[job.name].to_pylist() == expected.to_pylist(), job.name


@pytest.mark.slow
def test_all_scenes_on_spark(tmp_path: Path) -> None:
    """All known scenes and random ones, by all methods, in 1, 3 and 16 partitions in turn; the centre is found too."""
    known = [(one.scene, one.areas, one.tracks) for one in scenes.known_scenes()]
    thrown = [throw(workload, 3, 10, 20) for workload in (SEAM, GROWING, OCEAN)]
    jobs = []
    for scene, areas, tracks in [*known, *thrown]:
        for method in Method:
            n = len(jobs)
            asked = replace(scene, method=method, centre=None if n % 2 else scene.centre)
            jobs.append(Job(f"{n:03}", asked, areas, tracks, (1, 3, 16)[n % 3], (BY_TREE, BY_SENDING)[n // 3 % 2]))
    found = answers(jobs, tmp_path, master="local[2]")
    for job in jobs:
        expected = answer_of_one_machine(job.scene, job.areas, job.tracks)
        assert found[job.name].to_pylist() == expected.to_pylist(), (job.name, job.scene)
