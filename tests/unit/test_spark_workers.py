"""Spark workers on batches of rows, without Spark: the same rows however batches are cut."""

import json
import re
import subprocess
import sys
import threading
import time
import zipfile
from collections import defaultdict
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock, call

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
import scenes
import shapely
import shapely.affinity
from draws import draws
from layouts import GROWING, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene
from patience import WAIT_S
from spark_answers import answer_of_one_machine, in_order, need_pyspark

from conflictdb import kernel
from conflictdb.arrays.arrow.object_rows import OBJECTS as FORM
from conflictdb.arrays.arrow.object_rows import of_objects
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.packed import WORD, begins_in, packed, unpacked
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import COVER, pieces_of
from conflictdb.core.pieces.digests import area_digests, track_digests
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.earth.registry import Setup, centred
from conflictdb.errors import ConflictDBError, InvalidInput
from conflictdb.formats.scene_file import settings_of as settings_as_json
from conflictdb.memory.questions import solve
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, EarthModel, Scene, StoredArea, StoredTrack, Track, rectangle_outline_m
from conflictdb.spark import cut_objects, solving, work_units
from conflictdb.spark.work_units import Cells, two_blocks

Objects = tuple[Scene, list[Area], list[Track]]
THROWN = [plain_scene(SEAM, 3, 8, 16), plain_scene(GROWING, 5, 4, 10), plain_scene(OCEAN, 6, 6, 8)]
OBJECTS = [*((one.scene, one.areas, one.tracks) for one in scenes.known_scenes()), *THROWN]


@pytest.mark.spark
def test_files_of_one_scene_say_the_same_settings() -> None:
    """Those of the first that says any; other settings are refused, whichever of the files says them."""
    need_pyspark()
    from conflictdb.spark.files import settings_of

    def schema(scene: Scene | None) -> pa.Schema:
        said = {"conflictdb": json.dumps({"scene": settings_as_json(scene)})} if scene else {}
        return FORM.schema.with_metadata(said)

    first, other = Scene("s", separation_m=500.0), Scene("other", separation_m=500.0)
    assert settings_of({"a": schema(first), "b": schema(None)}) == first
    assert settings_of({"a": schema(None), "b": schema(other), "c": schema(first)}) == other
    assert settings_of({"a": schema(None)}) is None
    with pytest.raises(InvalidInput, match=r"second: scene 's': separation_m: differs from that in first"):
        settings_of({"first": schema(first), "second": schema(Scene("s", separation_m=100.0))})


def test_options_of_the_user_go_before_ours(tmp_path: Path) -> None:
    """Those of spark-defaults.conf, of PYSPARK_SUBMIT_ARGS and of --conf; tasks are tried again on one machine."""
    from conflictdb.spark import engine

    (tmp_path / "spark-defaults.conf").write_text("# spark.ui.enabled true\nspark.driver.memory  7g\n")
    for environ in (
        {"SPARK_CONF_DIR": str(tmp_path)},
        {"SPARK_CONF_DIR": "/nowhere", "SPARK_DRIVER_MEMORY": "7g"},
        {"SPARK_CONF_DIR": "/nowhere", "PYSPARK_SUBMIT_ARGS": "--driver-memory 7g pyspark-shell"},
        {"SPARK_CONF_DIR": "/nowhere", "PYSPARK_SUBMIT_ARGS": "--conf spark.driver.memory=7g pyspark-shell"},
    ):
        assert "spark.driver.memory" not in engine._alone("local[2]", engine._said_elsewhere(environ))
        assert engine._alone("local[2]", engine._said_elsewhere(environ))["spark.ui.enabled"] == "false"
    said = engine._said_elsewhere({"SPARK_CONF_DIR": "/nowhere"})
    assert engine._alone("local[2]", said)["spark.driver.memory"] == "2g"
    for master, tried in (
        ("local[2]", "local[2,4]"), ("local[*]", "local[*,4]"), ("local", "local[1,4]"), ("local[2, 1]", "local[2, 1]"),
        ("local-cluster[2,1,1024]", "local-cluster[2,1,1024]"), ("spark://host:7077", "spark://host:7077"),
    ):  # fmt: skip
        assert engine._alone(master, ())["spark.master"] == tried
    daemon = "spark.python.daemon.module"
    assert engine._alone("local[2]", ())[daemon] == "conflictdb.spark.worker_daemon"
    assert daemon not in engine._alone("spark://host:7077", ()), "machines may have another pyspark"
    merged = engine._with_jars({"spark.jars": "ours"}, {"spark.jars": "theirs", "spark.driver.memory": "8g"})
    assert merged == {"spark.jars": "ours,theirs", "spark.driver.memory": "8g"}
    with (
        pytest.raises(InvalidInput, match=r"--conf spark\.sql\.session\.timeZone: must be UTC"),
        engine.session(None, tmp_path, {}, is_quiet=True, options={"spark.sql.session.timeZone": "CET"}),
    ):
        pass


def test_sessions_fetch_jars_one_after_another(tmp_path: Path) -> None:
    """Two that fetch a jar at once make each other fail: Ivy writes it under one name."""
    need_pyspark()
    from conflictdb.spark import engine

    jar = tmp_path / "jars" / "group_name-1.jar"
    fetched = threading.Event()
    met: list[tuple[dict[str, Any], bool]] = []

    def second() -> None:
        with engine._jars(tmp_path, ["group:name:1"]) as jars:
            met.append((jars, fetched.is_set()))

    with engine._jars(tmp_path, ["group:name:1"]) as jars:
        assert jars["spark.jars.packages"] == "group:name:1"
        thread = threading.Thread(target=second, daemon=True)
        thread.start()
        thread.join(0.2)
        assert not met, "it waits"
        jar.parent.mkdir()
        jar.touch()
        fetched.set()
    thread.join(WAIT_S)
    assert met == [({"spark.jars": str(jar)}, True)]


def test_the_file_of_a_java_says_its_version(tmp_path: Path) -> None:
    """No Java is started to ask; without the file it is."""
    from conflictdb.spark import engine

    java = tmp_path / "bin" / "java"
    java.parent.mkdir()
    java.write_text("#!/bin/sh\necho 'openjdk version \"11.0.2\" 2026' >&2\n")
    java.chmod(0o755)
    assert engine._java_version(str(java)) == "11.0.2"
    (tmp_path / "release").write_text('IMPLEMENTOR="Debian"\nJAVA_VERSION="17.0.15"\nJAVA_VERSION_DATE="2025"\n')
    link = tmp_path / "java"
    link.symlink_to(java)
    assert engine._java_version(str(link)) == "17.0.15"


def test_sedona_is_added_once_and_reports_nothing() -> None:
    """Its makers hear nothing of this machine: the property that says so is set first."""
    from conflictdb.spark import engine

    spark = Mock()
    assert engine.with_sedona(engine.with_sedona(spark)) is spark
    java = spark.sparkContext._jvm
    assert java.mock_calls == [
        call.java.lang.System.setProperty("SCARF_NO_ANALYTICS", "true"),
        call.org.apache.sedona.spark.SedonaContext.create(spark._jsparkSession, "python"),
    ]


@pytest.mark.spark
@pytest.mark.parametrize("is_installed", [True, False])
def test_workers_read_no_archive_of_spark_beside_installed_packages(tmp_path: Path, is_installed: bool) -> None:
    """Archives of the user stay on the path; without installed packages those of Spark stay, too."""
    need_pyspark()
    import py4j
    import pyspark

    names = {"pyspark.zip": "pyspark", "py4j-0.10.9.7-src.zip": "py4j", "mine.zip": "mine"}
    archives = [str(tmp_path / name) for name in names]
    for archive, name in zip(archives, names.values(), strict=True):
        with zipfile.ZipFile(archive, "w") as of:
            of.writestr(f"{name}/__init__.py", "")
    installed = [str(Path(one.__file__).parents[1]) for one in (pyspark, py4j)] if is_installed else []
    script = """
import sys
sys.path[:0] = sys.argv[1:]
from conflictdb.spark import worker_daemon
worker_daemon._prefer_installed_packages()
print(*(one for one in sys.path if one.endswith(".zip") and one in sys.argv), sep="\\n")
print(*(one for one in sys.path_importer_cache if one.endswith(".zip") and one in sys.argv), sep="\\n")
"""
    # Without other packages: archives come first, as Spark has it.
    command = [sys.executable, "-I", "-S", "-c", script, *archives, str(Path(kernel.__file__).parents[2]), *installed]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == (archives[2:] if is_installed else archives) * 2


@pytest.mark.spark
def test_what_spark_cannot_do_is_one_line() -> None:
    """Neither pages of Java nor an error of this program: a full disk, a worker that ended, Java that is gone."""
    need_pyspark()
    from py4j.protocol import Py4JError, Py4JNetworkError
    from pyspark.errors import PySparkException

    from conflictdb.spark import engine

    @dataclass
    class Thrown:
        message: str | None
        cause: "Thrown | None" = None

        def getMessage(self) -> str | None:  # noqa: N802 Java's name
            return self.message

        def getCause(self) -> "Thrown | None":  # noqa: N802
            return self.cause

    full = Py4JError("An error occurred while calling o1.count.")
    full.java_exception = Thrown("Job aborted\n\tat org.apache", Thrown("No space left on device\n\tat java.io"))
    killed = Py4JError("An error occurred while calling o1.save.")
    killed.java_exception = Thrown("Job aborted", Thrown("Python worker exited unexpectedly", Thrown(None)))
    worker = PySparkException("An exception was thrown from the Python worker.\nTraceback (...):\n  File\nMemoryError")
    for error, said in (
        (full, "No space left on device"),
        (worker, "MemoryError"),
        (Py4JNetworkError("Answer from Java side is empty\n"), "Answer from Java side is empty"),
        (Py4JNetworkError(""), "Py4JNetworkError"),
        (killed, "Python worker exited unexpectedly"),
    ):
        with (
            pytest.raises(ConflictDBError) as raised,
            engine.errors_in_one_line(ConflictDBError, "Spark did not finish"),
        ):
            raise error
        assert str(raised.value) == f"Spark did not finish: {said}"


def test_a_terminal_shows_how_far_spark_is(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, rewritten: finished work, and the tasks of active stages; it is removed at the end."""
    from conflictdb.cli import on_spark

    class Tracker:
        def getActiveStageIds(self) -> list[int]:  # noqa: N802 Spark's name
            return [1, 2, 3]

        def getStageInfo(self, number: int) -> SimpleNamespace | None:  # noqa: N802
            return SimpleNamespace(numCompletedTasks=number, numTasks=1_000) if number < 3 else None

    spark: Any = SimpleNamespace(sparkContext=SimpleNamespace(statusTracker=Tracker))
    for is_terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda shown=is_terminal: shown)
        shown = ""
        with on_spark._shown_progress(spark, 0.01) as begin:
            begin("solving")
            ends = time.monotonic() + (WAIT_S if is_terminal else 0.1)
            while "solving" not in shown and time.monotonic() < ends:
                shown += capsys.readouterr().err
        shown += capsys.readouterr().err
        if is_terminal:
            assert re.search(r"\r\S*Spark: solving, 3 of 2,000 tasks, \d+ s", shown)
            assert shown.endswith("\r\x1b[K")
        else:
            assert not shown


def test_a_column_that_would_be_lost_is_refused() -> None:
    """Spark takes names in any case, and the form OBJECTS as they are; others may be called as they like."""
    cut_objects.check_case("objects", [*FORM.schema.names, "Port", "speed"])
    with pytest.raises(InvalidInput, match="objects: column Start: must be written start: rename it"):
        cut_objects.check_case("objects", ["id", "Start"])


def in_batches(rows: pa.Table | pa.RecordBatch, most: int, rng: np.random.Generator) -> list[pa.RecordBatch]:
    """Rows in batches of 1 to `most` of them, copied: as they come through a pipe."""
    batches, first = [], 0
    while first < rows.num_rows:
        count = int(rng.integers(1, most + 1))
        batches += pa.table(rows.slice(first, count).to_pydict(), schema=rows.schema).to_batches()
        first += count
    return batches


def answer_of_workers(objects: Objects, seed: int) -> pa.Table:
    """The rows of workers, in random cells and blocks, by batches of random sizes."""
    rng = np.random.default_rng(seed)
    scene, areas, tracks = objects
    scene = centred(scene, areas, tracks)
    given = in_batches(of_objects(areas, tracks), 5, rng)
    rows = pa.Table.from_batches(list(cut_objects.cut(given, scene)), schema=cut_objects.SCHEMA)
    assert rows["refused"].null_count == len(rows)
    has_pieces = rows["pieces"].is_valid()
    large, rows = rows.filter(pc.invert(has_pieces)), rows.filter(has_pieces)
    large = large.filter(large["outline"].is_valid())
    known = dict(zip(large["key"].to_pylist(), large["outline"].to_pylist(), strict=True))
    met = met_in(rows, rng).sort_by("group")
    found = solving.solved(in_batches(met, 9, rng), scene, lambda: known, 4)
    return in_order(pa.Table.from_batches(list(found), schema=solving.SCHEMA))


def met_in(rows: pa.Table, rng: np.random.Generator) -> pa.Table:
    """The pairs that workers find among rows of pieces, in random cells and blocks of objects."""
    low, high = (
        np.stack([rows[name].to_numpy().astype(float) for name in names], axis=1)
        for names in (("west", "south", "start_us"), ("east", "north", "end_us"))
    )
    cells = Cells.of(low, high, 1.0, 1_000)
    cells = replace(cells, blocks=rng.integers(1, 4, len(cells.low)))
    by_key = {key: int(rng.integers(-(2**31), 2**31)) for key in rows["key"].to_pylist()}
    dealt = np.array([by_key[key] for key in rows["key"].to_pylist()], np.int32)
    at = []
    for cell, (first, blocks) in enumerate(zip(cells.first_unit, cells.blocks, strict=False)):
        for row in np.flatnonzero(((low < cells.high[cell]) & (high >= cells.low[cell])).all(axis=1)):
            block = int(dealt[row]) % int(blocks)
            at += [(first + two_blocks(min(block, i), max(block, i)), row) for i in range(blocks)]
    unit, row = np.array(sorted(at, key=lambda one: (one[0], rng.random()))).T
    placed = rows.append_column("unit", pa.array(rows["kind"].to_numpy(), pa.int32()))
    placed = placed.append_column("dealt", pa.array(dealt)).take(row)
    placed = placed.set_column(placed.schema.get_field_index("unit"), "unit", pa.array(unit, pa.int32()))
    met = solving.meeting(in_batches(placed.select(solving.PLACED.names), 7, rng), cells, int(rng.integers(1, 5)))
    return pa.Table.from_batches(list(met), schema=solving.MET)


def pieces_in(words: list[bytes]) -> Pieces:
    """The pieces in packed columns of rows."""
    held = np.frombuffer(b"".join(words), np.int64)
    bounds = np.cumsum([0, *(len(one) // WORD for one in words)])
    return unpacked(held, begins_in(held, bounds[:-1], bounds[1:])[0])


@pytest.fixture(autouse=True)
def small_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells of few pieces, so that small scenes have several."""
    monkeypatch.setattr(work_units, "_FEW", 5)


def test_schedules_are_expanded_over_the_window_and_keep_the_activations_of_a_database() -> None:
    """A database knows their states by its activations. Schedules of files were refused."""
    scene, hour = Scene("s"), 3_600_000_000
    daily = {"days": ["MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN"], "periods": [["08:00", "10:00"]]}
    given = ((0, hour), (10 * hour, 11 * hour))
    box = shapely.box(4, 57, 5, 58)
    areas = [Area("new", box, schedule=daily), Area("stored", box, schedule=daily, spans_us=given)]
    at = np.array([0, hour], np.int64)
    sails = Track("T", [(4, 57), (4, 57)], at, [(0, 0)], schedule=daily, departures_us=(20 * hour,))
    window = 24 * hour, 72 * hour
    table = pa.Table.from_batches(list(cut_objects.cut([of_objects(areas, [sails])], scene, window=window)))
    active = table.filter(table["pieces"].is_valid())
    expected = {
        "new": [(32, 34), (56, 58)],
        "stored": [(0, 1), (10, 11), (32, 34), (56, 58)],
        "T": [(20, 21), (32, 33), (56, 57)],
    }
    for key, spans in expected.items():
        rows = active.filter(pc.equal(active["key"], key))
        found = [one for row in rows["pieces"].to_pylist() for one in spans_in(row)]
        assert sorted(found) == [(first * hour, last * hour) for first, last in spans]
    digest = dict(zip(table["key"].to_pylist(), table["digest"].to_pylist(), strict=True))
    assert digest["stored"] == area_digests(AreaBatch.of(areas[1:])).tolist()[0]
    assert digest["T"] == track_digests(TrackBatch.of([sails])).tolist()[0]
    (times,) = cut_objects.touched_times(
        [of_objects(areas, [replace(sails, schedule=None, departures_us=None)])], scene
    )
    assert times.to_pylist() == [{"start_us": 0, "end_us": hour + 1}]


def test_schedules_that_are_idle_or_not_understood_are_rows_that_say_so() -> None:
    """Only of a database, whose objects have numbers: its detections keep them, as covers that are never sure."""
    scene, hour = Scene("s"), 3_600_000_000
    once = {"rrule": "DTSTART:20010101T000000Z\nRRULE:FREQ=DAILY;COUNT=1", "duration": "PT1H"}
    strange = {"notam": "WHENEVER"}
    box, at = shapely.box(4, 57, 5, 58), np.array([0, hour], np.int64)
    areas = [StoredArea(key, box, schedule=one) for key, one in (("idle", once), ("unknown", strange))]
    given = (
        areas,
        [
            StoredTrack("T", [(4, 57), (4.1, 57)], at, [(0, 0)], schedule=strange),
            Track("sails", [(4, 57), (4.1, 57)], at, [(0, 0)]),
        ],
    )
    table = pa.Table.from_batches(
        list(cut_objects.cut([of_objects(*given, np.arange(4), np.ones(4, np.int64))], scene, window=(0, 72 * hour)))
    )
    said = table.filter(table["digest"].is_valid())
    assert dict(zip(said["key"].to_pylist(), said["schedule"].to_pylist(), strict=True)) == {
        "idle": cut_objects.IDLE,
        "unknown": cut_objects.UNKNOWN,
        "T": cut_objects.UNKNOWN,
        "sails": None,
    }
    cut = table.filter(table["pieces"].is_valid())
    assert set(cut["key"].to_pylist()) == {"unknown", "T", "sails"}
    parts = {key: pieces_in([row]).part for key, row in zip(cut["key"], cut["pieces"].to_pylist(), strict=True)}
    assert {str(key): (part == COVER).all() for key, part in parts.items()} == {
        "unknown": True,
        "T": True,
        "sails": False,
    }
    (refused,) = cut_objects.cut([of_objects(*given)], scene, window=(0, 72 * hour))
    assert "schedule" in refused.column("refused").to_pylist()[0]


def spans_in(row: bytes) -> list[tuple[int, int]]:
    found = pieces_in([row])
    return list(zip(found.start_us.tolist(), found.end_us.tolist(), strict=True))


@pytest.mark.parametrize("workload", [SEAM, GROWING, OCEAN], ids=lambda one: one.name)
@draws("cuts", 2, 4)
def test_each_pair_of_pieces_is_met_once(workload: Workload, monkeypatch: pytest.MonkeyPatch, cuts: int) -> None:
    """The pairs whose boxes and hulls meet, each in one cell and in one unit; those of two objects in one group."""
    monkeypatch.setattr(solving, "_PAIRS_AT_ONCE", 3)
    scene, areas, tracks = plain_scene(workload, 7, 8, 24)
    batch = of_objects(areas, [*tracks, *(replace(tracks[0], key=f"version {i}") for i in range(12))])
    rows = pa.Table.from_batches(list(cut_objects.cut([batch], centred(scene, areas, tracks))))
    rows = rows.filter(rows["pieces"].is_valid())
    sizes = [len(pieces_in([one])) for one in rows["pieces"].to_pylist()]
    keys = np.repeat(rows["key"].to_numpy(), sizes)
    all_pieces = pieces_in(rows["pieces"].to_pylist())
    names = [(key, part, turn) for key, part, turn in zip(keys, all_pieces.part, all_pieces.turn, strict=True)]
    number = np.unique([key.encode() for key in keys], return_inverse=True)[1].astype(np.int64)
    a, b = candidates(replace(all_pieces, object_id=number))
    meet = ~kernel.apart(all_pieces.hull_xy, all_pieces.hull_offset, a, b)
    expected = sorted((names[i], names[j]) for i, j in zip(a[meet], b[meet], strict=True))
    assert len(expected) > 100
    for seed in range(cuts):
        met = met_in(rows, np.random.default_rng(seed))
        of_met = pieces_in(met["piece"].to_pylist())
        named = list(zip(met["key"].to_pylist(), of_met.part, of_met.turn, strict=True))
        by_id = dict(zip(zip(met["group"].to_pylist(), met["id"].to_pylist(), strict=True), named, strict=True))
        pairs, groups = [], defaultdict(set)
        for group, name, mates in zip(met["group"].to_pylist(), named, met["mates"].to_pylist(), strict=True):
            others = [by_id[group, mate] for mate in np.frombuffer(mates, np.int64).tolist()]
            pairs += [(name, other) for other in others]
            for other in others:
                groups[name[0], other[0]].add(group)
        assert sorted(pairs) == expected
        assert {len(of) for of in groups.values()} == {1}


SOME_OF = {Method.EXACT: 2, Method.SCREEN: 7, Method.NLP: 20}


@pytest.mark.parametrize("method", list(Method))
def test_workers_answer_as_one_machine(method: Method) -> None:
    """All rows of known scenes and of random ones, bit by bit."""
    for seed, (scene, areas, tracks) in enumerate(OBJECTS[:: SOME_OF[method]]):
        objects = (replace(scene, method=method), areas, tracks)
        assert answer_of_workers(objects, seed).to_pylist() == answer_of_one_machine(*objects).to_pylist(), scene.name


def test_workers_know_the_plans_of_tracks_with_tolerances() -> None:
    """Certainties too are those of one machine: of areas, and of tracks with and without tolerances."""
    at = 1_772_323_200_000_000
    way, times = np.array([[4.0, 57.0], [5.0, 57.0]]), at + np.array([0, 7_200_000_000])
    late = {"departure_window": [np.datetime64(at, "us"), np.datetime64(at + 60_000_000, "us")]}
    ship = rectangle_outline_m(150.0, 150.0, 20.0, 20.0)
    tracks = [
        Track("A", way, times, ship, tolerances=late),
        Track("B", way[::-1], times, ship, tolerances={**late, "xtd_port_m": 5_000.0}),
        Track("C", way, times, ship),
    ]
    areas = [Area("D", shapely.MultiPolygon([shapely.box(4.5, 56.99, 4.6, 57.01)]))]
    objects = (Scene("tolerances", separation_m=900.0), areas, tracks)
    expected = answer_of_one_machine(*objects)
    assert set(expected["certainty"].to_pylist()) == {None, "may", "must"}
    assert answer_of_workers(objects, 1).to_pylist() == expected.to_pylist()


def test_workers_find_what_is_near() -> None:
    """Pairs that only come near have their rows too."""
    scene, areas, tracks = THROWN[0]
    objects = (replace(scene, nearest_m=30_000.0, separation_m=300.0), areas, tracks)
    found = answer_of_workers(objects, 1)
    assert "near" in found["verdict"].to_pylist()
    assert found.to_pylist() == answer_of_one_machine(*objects).to_pylist()


def test_workers_know_the_whole_of_both_areas() -> None:
    """A box of one part that is as shallow in both parts of an area as the tolerance allows is decided by the whole."""
    two = shapely.MultiPolygon([shapely.box(0, 0, 0.08, 0.1), shapely.box(0.12, 0, 0.2, 0.1)])
    areas = [Area("TWO", two), Area("BOX", shapely.MultiPolygon([shapely.box(0.02, -0.05, 0.18, 4e-6)]))]
    objects = (Scene("shallow"), areas, [])
    expected = answer_of_one_machine(*objects)
    assert expected["verdict"].to_pylist() == ["grazing"]
    assert answer_of_workers(objects, 1).to_pylist() == expected.to_pylist()


def test_large_outlines_have_rows_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """An outline too large to go with each row of an area is sent once, and looked up where it is used."""
    ring = shapely.Point(0.1, 0.0).buffer(0.05, quad_segs=40)
    comb = shapely.union_all([ring, *(shapely.box(0.01 * i, 0, 0.01 * i + 0.004, 0.2) for i in range(20))])
    areas = [Area("COMB", comb), Area("BOX", shapely.MultiPolygon([shapely.box(0, 0.1, 1, 1)]))]
    scene = Scene("large", tolerance_m=1_000.0)
    (rows, large) = cut_objects.cut([of_objects(areas, [])], scene)
    assert large["key"].to_pylist() == ["COMB", "BOX"]
    assert shapely.from_wkb(large["outline"][0].as_py()) == comb
    assert large["outline"][1].as_py() is None
    outlines = dict(zip(rows["key"].to_pylist(), rows["outline"].to_pylist(), strict=True))
    assert (outlines["COMB"], outlines["BOX"]) == (None, shapely.to_wkb(areas[1].footprint))
    expected = answer_of_one_machine(scene, areas, []).to_pylist()
    assert expected
    for most in (0, 10_000):
        monkeypatch.setattr(cut_objects, "_MOST_CARRIED", most)
        assert answer_of_workers((scene, areas, []), 1).to_pylist() == expected


def test_rows_are_made_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pairs of crowded units would be more than fits a column; for any number at once, the pairs are the same."""
    comb = shapely.MultiPolygon([shapely.box(0.01 * i, 0, 0.01 * i + 0.004, 0.2) for i in range(20)])
    areas = [Area("DOWN", comb), Area("ACROSS", shapely.affinity.rotate(comb, 90.0))]
    rows, _ = cut_objects.cut([of_objects(areas, [])], Scene("s"))
    whole = met_in(pa.table(rows), np.random.default_rng(1))
    pairs = sum(len(mates) // WORD for mates in whole["mates"].to_pylist())
    assert pairs > 200
    assert 0 < len(whole) - whole["outline"].null_count <= len(whole) / 2
    for most in (1, 2_000):
        monkeypatch.setattr(solving, "_MOST_BYTES", most)
        parts = met_in(pa.table(rows), np.random.default_rng(1))
        assert parts.column("id").num_chunks > whole.column("id").num_chunks
        assert parts.combine_chunks().equals(whole.combine_chunks())


def test_rows_of_a_unit_come_together() -> None:
    """In batches of any size: a run ends where the value changes, also across batches and next to empty ones."""
    rng = np.random.default_rng(4)
    of = np.repeat(np.arange(40), rng.choice([1, 2, 5, 60], 40))
    rows = pa.table({"unit": pa.array(of, pa.int32()), "row": np.arange(len(of))})
    for most in (1, 3, 200):
        batches = in_batches(rows, most, rng)
        batches.insert(1, batches[0].slice(0, 0))
        runs = list(solving._runs(batches, "unit"))
        assert [set(run["unit"].to_pylist()) for run in runs] == [{i} for i in range(40)]
        assert pa.concat_tables(runs).equals(rows)


def test_packed_pieces_are_the_same_pieces() -> None:
    """Every field comes back, with its type; and shapes that do not change are one array."""
    for scene, areas, tracks in OBJECTS:
        scene = centred(scene, areas, tracks)
        made = pieces_of(Setup.of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
        words, offset = packed(made)
        again = unpacked(words, offset[:-1])
        # Where each piece begins, in runs of one, two, three pieces.
        runs = np.unique([0, *np.cumsum(np.arange(len(made))), len(made)].copy())
        runs = runs[runs <= len(made)]
        begin, pieces_of_runs = begins_in(words, offset[runs[:-1]], offset[runs[1:]])
        assert (begin.tolist(), pieces_of_runs.tolist()) == (offset[:-1].tolist(), runs.tolist())
        assert again.changes == made.changes
        for column in fields(made):
            one, other = getattr(made, column.name), getattr(again, column.name)
            assert one.dtype == other.dtype
            assert np.array_equal(one, other, equal_nan=True), column.name


def test_refused_objects_are_rows_that_say_so() -> None:
    """An object that does not fit the plane is refused with the message of `solve`."""
    known = scenes.hole(EarthModel.WGS84)
    polar = Area("N", shapely.MultiPolygon([shapely.box(0, 89.5, 1, 89.9)]))
    (row,) = next(iter(cut_objects.cut([of_objects([polar], [])], known.scene))).to_pylist()
    refusal = cut_objects.refusal_of(row["refused"])
    with pytest.raises(InvalidInput, match=re.escape(str(refusal))):
        solve([], [polar], known.scene)
    assert "area 'N': geometry" in str(refusal)


def test_the_second_of_two_objects_with_one_key_is_refused() -> None:
    """Also where they come in different batches."""
    known = scenes.hole(EarthModel.WGS84)
    batch = of_objects(known.areas, [])
    *first, second = cut_objects.cut([batch, batch], known.scene)
    assert all(part["refused"].null_count == len(part) for part in first)
    with pytest.raises(InvalidInput, match=f"object '{known.areas[0].key}': id: occurs more than once"):
        raise cut_objects.refusal_of(second["refused"][0].as_py())
