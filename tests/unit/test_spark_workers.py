"""What workers of Spark do with batches of rows, without Spark: the same rows however batches are cut."""

import json
import re
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
import scenes
import shapely
import shapely.affinity
from spark_answers import answer_of_one_machine, in_order
from workloads import GROWING, OCEAN, SEAM, throw

from conflictdb.arrays.arrow.objects import OBJECTS as FORM
from conflictdb.arrays.arrow.objects import of_objects
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.packed import WORD, begins_in, packed, unpacked
from conflictdb.errors import ConflictDBError, InvalidInput
from conflictdb.in_memory import solve
from conflictdb.io.scene_file import settings_of as settings_as_json
from conflictdb.methods import Method
from conflictdb.model import Area, EarthModel, Scene, Track
from conflictdb.motion.registry import centred, plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.spark import pieces, solving
from conflictdb.stage1_broad_phase import candidates

Objects = tuple[Scene, list[Area], list[Track]]
THROWN = [throw(SEAM, 3, 8, 16), throw(GROWING, 5, 4, 10), throw(OCEAN, 6, 6, 8)]
OBJECTS = [*((one.scene, one.areas, one.tracks) for one in scenes.known_scenes()), *THROWN]


def test_files_of_one_scene_say_the_same_settings() -> None:
    """Those of the first that says any; other settings are refused, whichever of the files says them."""
    pytest.importorskip("pyspark", reason="not run: pyspark is not here (`./run spark` adds it)")
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
    merged = engine._with_jars({"spark.jars": "ours"}, {"spark.jars": "theirs", "spark.driver.memory": "8g"})
    assert merged == {"spark.jars": "ours,theirs", "spark.driver.memory": "8g"}
    with (
        pytest.raises(InvalidInput, match=r"--conf spark\.sql\.session\.timeZone: must be UTC"),
        engine.session(None, tmp_path, {}, is_quiet=True, options={"spark.sql.session.timeZone": "CET"}),
    ):
        pass


def test_what_spark_cannot_do_is_one_line() -> None:
    """Not pages of Java, and not a mistake of this program: a full disk, a worker that ended, Java that is gone."""
    pytest.importorskip("pyspark", reason="not run: pyspark is not here (`./run spark` adds it)")
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
        with pytest.raises(ConflictDBError) as told, engine.errors_in_one_line(ConflictDBError, "Spark did not finish"):
            raise error
        assert str(told.value) == f"Spark did not finish: {said}"


def test_a_column_that_would_be_lost_is_refused() -> None:
    """Spark takes names in any case, and the form OBJECTS as they are; others may be called as they like."""
    pieces.check_case("objects", [*FORM.schema.names, "Port", "speed"])
    with pytest.raises(InvalidInput, match="objects: column Start: must be written start: rename it"):
        pieces.check_case("objects", ["id", "Start"])


def in_batches(rows: pa.Table | pa.RecordBatch, most: int, rng: np.random.Generator) -> list[pa.RecordBatch]:
    """Rows in batches of 1 to `most` of them, copied: as they come through a pipe."""
    batches, first = [], 0
    while first < rows.num_rows:
        count = int(rng.integers(1, most + 1))
        batches += pa.table(rows.slice(first, count).to_pydict(), schema=rows.schema).to_batches()
        first += count
    return batches


def answer_of_workers(objects: Objects, seed: int) -> pa.Table:
    """What workers answer, their pairs found here, by batches of random sizes."""
    rng = np.random.default_rng(seed)
    scene, areas, tracks = objects
    scene = centred(scene, areas, tracks)
    given = in_batches(of_objects(areas, tracks), 5, rng)
    rows = pa.Table.from_batches(list(pieces.cut(given, scene)), schema=pieces.SCHEMA)
    assert rows["refused"].null_count == len(rows)
    has_pieces = rows["pieces"].is_valid()
    large, rows = rows.filter(pc.invert(has_pieces)), rows.filter(has_pieces)
    large = large.filter(large["outline"].is_valid())
    known = dict(zip(large["key"].to_pylist(), large["outline"].to_pylist(), strict=True))
    met = in_batches(pairs_of(rows).take(rng.permutation(len(pairs_of(rows)))), 7, rng)
    hulls_meet = pa.Table.from_batches(list(solving.meeting(met)), schema=solving.PAIRS)
    sorted_rows = hulls_meet.sort_by([("a_key", "ascending"), ("b_key", "ascending")])
    found = solving.solved(in_batches(sorted_rows, 9, rng), scene, lambda: known, 4)
    return in_order(pa.Table.from_batches(list(found), schema=solving.SCHEMA))


def pairs_of(rows: pa.Table) -> pa.Table:
    """The pairs of rows that stage 1 leaves: those with pieces whose boxes meet."""
    held = b"".join(rows["pieces"].to_pylist())
    bounds = np.cumsum([0, *(len(one) // WORD for one in rows["pieces"].to_pylist())])
    begin, offset = begins_in(np.frombuffer(held, np.int64), bounds[:-1], bounds[1:])
    made = unpacked(np.frombuffer(held, np.int64), begin)
    row = np.repeat(np.arange(len(rows)), np.diff(offset))
    keys = [key.encode() for key in rows["key"].to_pylist()]
    made = replace(made, object_id=np.unique(keys, return_inverse=True)[1].astype(np.int64)[row])
    pairs = np.unique(np.stack([row[one] for one in candidates(made)]), axis=1)
    columns = [rows.take(one) for one in pairs]
    return pa.table(
        {
            f"{side}_{name}": some[name]
            for side, some in zip("ab", columns, strict=True)
            for name in ("kind", "key", "pieces", "outline")
        },
        schema=solving.JOINED,
    )


SOME_OF = {Method.EXACT: 2, Method.SCREEN: 7, Method.NLP: 20}


@pytest.mark.parametrize("method", list(Method))
def test_workers_answer_as_one_machine(method: Method) -> None:
    """All rows of known scenes and of random ones, bit by bit."""
    for seed, (scene, areas, tracks) in enumerate(OBJECTS[:: SOME_OF[method]]):
        objects = (replace(scene, method=method), areas, tracks)
        assert answer_of_workers(objects, seed).to_pylist() == answer_of_one_machine(*objects).to_pylist(), scene.name


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
    """What is too large to go with each row of an area is told once, and found where it is asked for."""
    ring = shapely.Point(0.1, 0.0).buffer(0.05, quad_segs=40)
    comb = shapely.union_all([ring, *(shapely.box(0.01 * i, 0, 0.01 * i + 0.004, 0.2) for i in range(20))])
    areas = [Area("COMB", comb), Area("BOX", shapely.MultiPolygon([shapely.box(0, 0.1, 1, 1)]))]
    scene = Scene("large", tolerance_m=1_000.0)
    (rows, large) = pieces.cut([of_objects(areas, [])], scene)
    assert large["key"].to_pylist() == ["COMB", "BOX"]
    assert shapely.from_wkb(large["outline"][0].as_py()) == comb
    assert large["outline"][1].as_py() is None
    outlines = dict(zip(rows["key"].to_pylist(), rows["outline"].to_pylist(), strict=True))
    assert (outlines["COMB"], outlines["BOX"]) == (None, shapely.to_wkb(areas[1].footprint))
    expected = answer_of_one_machine(scene, areas, []).to_pylist()
    assert expected
    for most in (0, 10_000):
        monkeypatch.setattr(pieces, "_MOST_CARRIED", most)
        assert answer_of_workers((scene, areas, []), 1).to_pylist() == expected


def test_pairs_of_pieces_are_made_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of crowded rows they would be more than a column holds; however many at once, they are the same."""
    comb = shapely.MultiPolygon([shapely.box(0.01 * i, 0, 0.01 * i + 0.004, 0.2) for i in range(20)])
    areas = [Area("DOWN", comb), Area("ACROSS", shapely.affinity.rotate(comb, 90.0))]
    rows, _ = pieces.cut([of_objects(areas, [])], Scene("s"))
    (joined,) = pairs_of(pa.Table.from_batches([rows])).combine_chunks().to_batches()
    (whole,) = solving.meeting([joined])
    assert len(whole) > 200
    told = [len(whole) - whole[f"{side}_outline"].null_count for side in "ab"]
    assert told == [len(joined)] * 2
    for most in (1, 10_000):
        monkeypatch.setattr(solving, "_MOST_BYTES", most)
        parts = list(solving.meeting([joined]))
        assert len(parts) == len(whole) if most == 1 else 3 < len(parts) < len(whole) / 5
        assert pa.Table.from_batches(parts).equals(pa.Table.from_batches([whole]))


def test_parts_that_are_solved_hold_whole_pairs_of_objects() -> None:
    """However rows come: parts end where a pair of objects does, and one that fills more than a part is one."""
    rng = np.random.default_rng(4)
    of = np.repeat(np.arange(40), rng.choice([1, 2, 5, 60], 40))
    columns = {"a_key": pa.array(of // 3).cast(pa.string()), "b_key": pa.array(of).cast(pa.string())}
    held = [columns.get(field.name, pa.nulls(len(of), field.type)) for field in solving.PAIRS]
    rows = pa.table(held, schema=solving.PAIRS)
    for most in (1, 3, 200):
        parts = list(solving._whole(in_batches(rows, most, rng), 10))
        assert pa.concat_tables(parts).select(["a_key", "b_key"]).equals(rows.select(["a_key", "b_key"]))
        pairs = [set(part["b_key"].to_pylist()) for part in parts]
        assert len(pairs) >= (2 if most == 200 else 8)
        assert sum(map(len, pairs)) == 40


def test_packed_pieces_are_the_same_pieces() -> None:
    """Every field comes back, with its type; and shapes that do not change are one array."""
    for scene, areas, tracks in OBJECTS:
        scene = centred(scene, areas, tracks)
        made = pieces_of(scene, plane_of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
        words, offset = packed(made)
        again = unpacked(words, offset[:-1])
        # Of runs of one, two, three pieces it is found out where each begins.
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
    """An object that the plane cannot hold is refused with the words of `solve`."""
    known = scenes.hole(EarthModel.WGS84)
    polar = Area("N", shapely.MultiPolygon([shapely.box(0, 89.5, 1, 89.9)]))
    (row,) = next(iter(pieces.cut([of_objects([polar], [])], known.scene))).to_pylist()
    refusal = pieces.refusal_of(row["refused"])
    with pytest.raises(InvalidInput, match=re.escape(str(refusal))):
        solve([], [polar], known.scene)
    assert "area 'N': geometry" in str(refusal)


def test_the_second_of_two_objects_with_one_key_is_refused() -> None:
    """Also where they come in different batches."""
    known = scenes.hole(EarthModel.WGS84)
    batch = of_objects(known.areas, [])
    *first, second = pieces.cut([batch, batch], known.scene)
    assert all(part["refused"].null_count == len(part) for part in first)
    with pytest.raises(InvalidInput, match=f"object '{known.areas[0].key}': id: occurs more than once"):
        raise pieces.refusal_of(second["refused"][0].as_py())
