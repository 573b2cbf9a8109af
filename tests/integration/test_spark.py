"""Scenes on Spark: the rows of one machine, bit by bit, whatever the number of partitions."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import scenes
import shapely
from layouts import GROWING, OCEAN, SEAM
from mixed_scenes import plain_scene
from pyarrow import parquet
from spark_answers import Job, Spark, answer_of_one_machine, in_order

from conflictdb.arrays.arrow.object_rows import of_objects
from conflictdb.formats.parquet_writing import write_objects
from conflictdb.formats.reading import read
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Track, rectangle_outline_m

pytestmark = [pytest.mark.spark, pytest.mark.xdist_group("spark")]


def test_scenes_on_spark_have_the_rows_of_one_machine(tmp_path: Path, spark: Spark) -> None:
    """All columns except those of a database: few partitions and many, also if an executor with data is killed."""
    strait, areas, tracks, _ = read(str(files("conflictdb") / "scenes" / "strait.geojson"))
    assert strait is not None
    near, closed, moving = plain_scene(SEAM, 3, 12, 24)
    # A crowd, which is dealt into blocks.
    objects = closed, [*moving, *(replace(moving[0], key=f"version {i}") for i in range(20))]
    near = replace(near, nearest_m=20_000.0, separation_m=500.0, time_separation_s=600.0)
    of_strait = Job("strait", strait, areas, tracks, 3)
    of_near = Job("near at the seam", near, *objects, 5, is_crowded=True, kills=True)
    names = ("exported.parquet", "output", "refused.parquet", "twins.parquet", "strange.parquet", "around.parquet")
    nothing, metres = (str(tmp_path / name) for name in ("nothing.parquet", "metres.parquet"))
    exported, output, refused, twins, strange, around = (str(tmp_path / name) for name in names)
    ends = np.array([[10.0, 20.0], [-170.0, -20.0]])
    opposite = Track("T", ends, np.array([0, 10**12]), rectangle_outline_m(100, 100, 100, 100))
    refused_ones = (
        (refused, ([polar()], [])),
        (twins, ([], [opposite] * 2)),
        (around, ([], [opposite])),
        (nothing, ([], [])),
    )
    for path, some in ((exported, objects), *refused_ones):
        with Path(path).open("wb") as stream:
            write_objects(stream, near, [of_objects(*some)])
    of_a_list = parquet.read_table(refused).replace_schema_metadata({"conflictdb": "[]"})
    parquet.write_table(of_a_list, strange)
    geo = {"encoding": "WKB", "crs": {"id": {"authority": "EPSG", "code": 3857}}}
    geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": geo}}
    parquet.write_table(of_a_list.replace_schema_metadata({"geo": json.dumps(geo)}), metres)
    detect = ["spark", "detect", "--output", output, "--input"]
    elsewhere = ["spark", "detect", "--output", str(tmp_path / "another output"), "--input"]
    commands = [[*elsewhere, refused], [*detect, exported, "--partitions", "2"], [*detect, exported]]
    commands += [[*elsewhere, path] for path in (__file__, strange, twins)]
    commands += [[*elsewhere, around, "--motion", "great_circle", "--earth", "sphere"]]
    commands += [[*elsewhere, path] for path in (nothing, metres)]
    for directory in (tmp_path / "one", tmp_path / "two"):
        directory.mkdir()
    found = spark.found([of_strait], tmp_path / "one")
    outcomes = spark.run(commands)  # in the same session
    found |= spark.found([of_near], tmp_path / "two", "local-cluster[2,1,1024]")
    for job in (of_strait, of_near):
        expected = answer_of_one_machine(job.scene, job.areas, job.tracks)
        assert expected.num_rows
        assert job is of_near or expected["a_name"].null_count < expected.num_rows, "it has names"
        assert found[job.name].to_pylist() == expected.to_pylist(), job.name

    # The command uses the settings of the file, and prints one line for each refusal.
    refusal, done, twice, no_parquet, no_object, same_key, no_centre, empty, projected = outcomes
    said = refusal, twice, no_parquet, no_object, same_key, no_centre, empty, projected
    assert all((code, text.count("\n")) == (4, 1) for code, text in said)
    assert refusal[1].startswith("conflictdb: area 'N': geometry: ")
    assert done[0] == 0
    assert in_order(parquet.read_table(output)).to_pylist() == expected.to_pylist()
    assert "already exists" in twice[1]
    assert not (tmp_path / "another output").exists()
    assert "test_spark.py" in no_parquet[1]
    assert no_object[1] == f"conflictdb: {strange}: metadata conflictdb: must be a JSON object\n"
    assert "object 'T': id: occurs more than once" in same_key[1]
    assert "centre: does not follow from objects all around the earth" in no_centre[1]
    assert empty[1] == f"conflictdb: {nothing}: file: holds no area and no track: nothing is changed\n"
    assert f"{metres}: metadata geo: must say that column geometry is longitude and latitude" in projected[1]
    geo = json.loads(parquet.read_schema(next(Path(output).glob("*.parquet"))).metadata[b"geo"])
    assert geo["primary_column"] == "region"
    assert all("crs" not in column for column in geo["columns"].values())


def polar() -> Area:
    """An area that fits no Mercator plane."""
    return Area("N", shapely.MultiPolygon([shapely.box(0, 89.5, 1, 89.9)]))


@pytest.mark.parametrize(("java", "says"), [(None, "JAVA_HOME is /nowhere"), (8, "needs Java 17"), (21, "is 21")])
def test_without_java_one_line_says_what_to_install(tmp_path: Path, java: int | None, says: str) -> None:
    """Nothing is fetched or begun; the exit code is 2."""
    home = "/nowhere"
    if java:
        program = tmp_path / "bin" / "java"
        program.parent.mkdir()
        program.write_text(f"#!/bin/sh\necho 'openjdk version \"{java}.0.1\" 2026' >&2\n")
        program.chmod(0o755)
        home = str(tmp_path)
    command = [sys.executable, "-m", "conflictdb", "spark", "demo"]
    environ = {**os.environ, "JAVA_HOME": home}
    done = subprocess.run(command, env=environ, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert says in done.stderr
    assert "openjdk-17-jre-headless" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_all_scenes_on_spark(tmp_path: Path, spark: Spark) -> None:
    """All known scenes and random ones, by all methods, in 1, 3 and 16 partitions in turn; the centre is found too."""
    known = [(one.scene, one.areas, one.tracks) for one in scenes.known_scenes()]
    thrown = [plain_scene(workload, 3, 10, 20) for workload in (SEAM, GROWING, OCEAN)]
    jobs = []
    for scene, areas, tracks in [*known, *thrown]:
        for method in Method:
            n = len(jobs)
            asked = replace(scene, method=method, centre=None if n % 2 else scene.centre)
            jobs.append(Job(f"{n:03}", asked, areas, tracks, (1, 3, 16)[n % 3]))
    found = spark.found(jobs, tmp_path)
    for job in jobs:
        expected = answer_of_one_machine(job.scene, job.areas, job.tracks)
        assert found[job.name].to_pylist() == expected.to_pylist(), (job.name, job.scene)
