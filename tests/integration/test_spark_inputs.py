"""Inputs and outputs of `spark detect`: paths, URIs and globs alike, parts of other columns, existing outputs."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import shapely
from pyarrow import parquet
from spark_answers import (
    SHORT_LIVED,
    Spark,
    answer_of_one_machine,
    await_end_of_group,
    await_java,
    await_workers,
    in_order,
    need_pyspark,
)

from conflictdb.arrays.arrow.object_rows import of_objects
from conflictdb.formats.parquet_writing import write_objects
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m

pytestmark = [pytest.mark.spark, pytest.mark.xdist_group("spark")]

T0_US = 1_780_000_000_000_000
HOUR_US = 3_600_000_000
# They pass at 3 km, which is a conflict with the separation of the scene alone; the area is over when B comes.
SCENE = Scene("apart", separation_m=5_000.0)
HAVEN = rectangle_outline_m(50.0, 50.0, 10.0, 10.0)
TRACKS = [
    Track(key, np.array([[0.0, lat], [0.2, lat]]), T0_US + np.array([0, HOUR_US]), HAVEN, grow_mps=grow)
    for key, lat, grow in (("A", 0.0, 0.0), ("B", 0.03, 0.1))
]
AREAS = [Area("PAST", shapely.MultiPolygon([shapely.box(0.1, 0.0, 0.2, 0.1)]), end_us=T0_US - HOUR_US)]


def exported(path: Path, scene: Scene | None, table: pa.Table) -> None:
    """A file of these rows and columns, which says the settings of a scene, if it is given."""
    with path.open("wb") as stream:
        write_objects(stream, scene or SCENE, [of_objects(AREAS, TRACKS)])
    said = parquet.read_schema(path).metadata
    if scene is None:
        said = {b"geo": said[b"geo"]}
    parquet.write_table(table.replace_schema_metadata(said), path)


def test_any_way_to_name_files_has_their_settings_and_columns(tmp_path: Path, spark: Spark) -> None:
    """A URI and a glob are read like a path; columns of all parts are read, or refused."""
    areas, tracks = (pa.table(of_objects(*some)) for some in ((AREAS, []), ([], TRACKS)))
    both = pa.concat_tables([tracks, areas])
    for name in ("whole", "parts", "untyped", "of others", "strange", "garbage", "earlier"):
        (tmp_path / name).mkdir()
    whole = tmp_path / "whole" / "the part.parquet"
    exported(whole, SCENE, both)
    # Tracks come first, without the columns of areas; and without growth, which the second has.
    steady = tracks.slice(0, 1).drop_columns(["start", "end", "grow_mps"])
    exported(tmp_path / "parts" / "1 {a}.parquet", SCENE, steady)
    exported(tmp_path / "parts" / "2.parquet", SCENE, pa.concat_tables([tracks.slice(1), areas]))
    # As pandas writes columns of unknown type, and small numbers.
    place = areas.schema.get_field_index("times")
    untyped = areas.set_column(place, "times", pa.nulls(1)).set_column(
        areas.schema.get_field_index("version"), "version", pa.array([1], pa.int32())
    )
    exported(tmp_path / "untyped" / "1.parquet", SCENE, untyped)
    exported(tmp_path / "untyped" / "2.parquet", SCENE, tracks)
    dated = both.append_column("valid_from", pa.array(["2026-01-01"] * len(both)))
    exported(tmp_path / "of others" / "1.parquet", None, dated)
    renamed = {"case": ("start", "Start"), "unit": ("floor_m", "floor_ft"), "zone": ("start", "start")}
    for name, (old, new) in renamed.items():
        table = both.rename_columns([new if column == old else column for column in both.column_names])
        place = table.schema.get_field_index(new)
        if name == "zone":
            table = table.set_column(place, new, table[new].cast(pa.timestamp("us")))
        if name == "unit":
            table = table.set_column(place, new, pa.array([1.0, 2.0, 3.0]))
        exported(tmp_path / f"{name}.parquet", None, table)
    exported(tmp_path / "empty.parquet", SCENE, both.slice(0, 0))
    (tmp_path / "nothing.parquet").touch()
    fast = Track(
        "FAST", np.array([[0.0, 0.0], [40.0, 0.0]]), T0_US + np.array([0, HOUR_US]), HAVEN, max_speed_kn=np.inf
    )
    exported(tmp_path / "fast.parquet", SCENE, pa.table(of_objects([], [fast])))
    metres = json.loads(parquet.read_schema(whole).metadata[b"geo"])
    metres["columns"]["geometry"]["crs"] = {
        "type": "ProjectedCRS",
        "name": "m",
        "id": {"authority": "EPSG", "code": 3857},
    }
    parquet.write_table(
        both.replace_schema_metadata({b"geo": json.dumps(metres).encode()}), tmp_path / "metres.parquet"
    )
    (tmp_path / "garbage" / "part.parquet").write_bytes(b"PAR1 this is none PAR1")
    (tmp_path / "strange" / "letter.txt").touch()
    outputs = iter(range(100))

    def detect(*words: str, into: str | None = None) -> list[str]:
        into = into or str(tmp_path / f"out {next(outputs)}")
        return ["spark", "detect", "--output", into, "--partitions", "2", "--input", *words]

    same = [
        detect(f"file://{tmp_path}/whole/the part.parquet"),
        detect(str(tmp_path / "parts")),
        detect(str(tmp_path / "unt*" / "[12].parquet")),
        # An existing output is replaced.
        detect(
            *(str(tmp_path / "of others"), "--separation-m", "5000", "--scene", "apart", "--overwrite"),
            into=str(tmp_path / "out 0"),
        ),
    ]
    refused = [
        (detect(str(tmp_path / f"{name}.parquet")), said)
        for name, said in (
            ("case", "column Start: must be written start: rename it"),
            ("unit", "floor_ft: is not known; did you mean floor_m? Rename the column"),
            ("zone", "start: must be timestamp[us, tz=UTC]; got timestamp[us]: instants need a time zone"),
        )
    ]
    refused += [
        (detect(str(tmp_path / "garbage")), "garbage/part.parquet: is no Parquet of conflictdb: it does not end"),
        (detect("s3a://nowhere/plans"), "s3a://nowhere/plans: cannot be read by Spark: Class org.apache.hadoop.fs.s3a"),
        (detect(str(tmp_path / "nowhere*.parquet")), "does not exist"),
        (detect(f"file://{tmp_path}/empty.parquet"), "holds no area and no track: nothing is changed"),
        (detect(str(tmp_path / "nothi*.parquet")), "nothing.parquet: is no Parquet of conflictdb"),
        (
            detect(str(tmp_path / "metres.parquet")),
            "metadata geo: must say that column geometry is longitude and latit",
        ),
        (
            detect(str(tmp_path / "fast.parquet")),
            "track 'FAST': times[1]: the leg to this waypoint is travelled at 2,40",
        ),
        # Before the input is looked at.
        (detect("/nowhere", into=str(tmp_path / "strange")), "already exists: name another directory, or give --over"),
        (detect("/nowhere", "--overwrite", into=str(tmp_path / "strange")), "holds 'letter.txt', which `spark detect`"),
        (detect("/nowhere", "--overwrite", into=str(whole)), "is a file"),
        (
            detect(str(tmp_path / "earlier" / "part-0.parquet"), "--overwrite", into=str(tmp_path / "earlier")),
            "holds input: what is read cannot be overwritten",
        ),
    ]
    exported(tmp_path / "earlier" / "part-0.parquet", SCENE, both)
    outcomes = spark.run([*same, *(command for command, _ in refused)])

    expected = answer_of_one_machine(SCENE, AREAS, TRACKS).to_pylist()
    assert [row["verdict"] for row in expected] == ["conflict"]
    for command, (code, text) in zip(same, outcomes, strict=False):
        assert code == 0, (command, text)
        found = in_order(parquet.read_table(command[3])).to_pylist()
        assert found == expected, command
    says_settings = [text for _, text in outcomes[: len(same)]]
    assert [bool(text) for text in says_settings] == [False] * 3 + [True]
    assert "does not say the settings of its scene: rhumb, wgs84, tolerance 1 m, separation 5000 m" in says_settings[3]
    assert "columns of the input look like times and are not read: valid_from" in says_settings[3]
    for (command, said), (code, text) in zip(refused, outcomes[len(same) :], strict=True):
        assert (code, text.count("\n")) == (4, 1), (command, text)
        assert said in text
    assert (tmp_path / "earlier" / "part-0.parquet").exists()


@pytest.fixture
def crowd(tmp_path: Path) -> list[Track]:
    """Ships, which are in `crowd.parquet` too."""
    rng = np.random.default_rng(1)
    crowd = [Track(f"S{i:03}", rng.uniform(0, 0.02, (3, 2)), T0_US + np.arange(3) * HOUR_US, HAVEN) for i in range(40)]
    with (tmp_path / "crowd.parquet").open("wb") as stream:
        write_objects(stream, Scene("crowd"), [of_objects([], crowd)])
    return crowd


def test_a_worker_that_is_killed_is_replaced(tmp_path: Path, crowd: list[Track], spark: Spark) -> None:
    """On one machine, too, tasks are tried again; input comes from another file system."""
    mount = f"spark.hadoop.fs.viewfs.mounttable.lake.link./plans=file:{tmp_path}"
    command = ["spark", "detect", "--input", "viewfs://lake/plans/crowd.parquet", "--output", str(tmp_path / "out")]
    assert spark.run([[*command, "--conf", mount]], kills_worker=True) == [(0, "")]
    expected = answer_of_one_machine(Scene("crowd"), [], crowd)
    assert in_order(parquet.read_table(tmp_path / "out")).to_pylist() == expected.to_pylist()


@pytest.mark.usefixtures("crowd")
@pytest.mark.parametrize("awaited", [await_java, await_workers])
def test_an_interrupt_is_one_line(tmp_path: Path, awaited: Callable[["subprocess.Popen[str]"], bool]) -> None:
    """Ctrl-C ends all of it with 130, and leaves neither a traceback nor a Java."""
    need_pyspark()
    # Not ignored, as it is in the background of a shell.
    command = ["env", "--default-signal=INT", sys.executable, "-m", "conflictdb", "spark", "detect", "--input"]
    running = subprocess.Popen(
        [*command, str(tmp_path / "crowd.parquet"), "--output", str(tmp_path / "out"), "--master", "local[2]"],
        env={**os.environ, "JAVA_TOOL_OPTIONS": SHORT_LIVED},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert awaited(running), running.stderr and running.stderr.read()
        os.killpg(running.pid, signal.SIGINT)
        _, said = running.communicate(timeout=300)
    finally:
        if running.poll() is None:
            running.kill()
    await_end_of_group(running.pid)
    assert (running.returncode, said) == (130, "conflictdb: interrupted\n")
