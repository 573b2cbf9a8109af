"""What workers of Spark do with batches of rows, without Spark: the same rows however batches are cut."""

import re
from dataclasses import fields, replace

import numpy as np
import pyarrow as pa
import pytest
import scenes
import shapely
from spark_answers import answer_of_one_machine, in_order
from workloads import GROWING, OCEAN, SEAM, throw

from conflictdb.arrays.arrow.objects import of_objects
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.packed import WORD, packed, unpacked
from conflictdb.errors import InvalidInput
from conflictdb.in_memory import solve
from conflictdb.methods import Method
from conflictdb.model import Area, EarthModel, Scene, Track
from conflictdb.motion.registry import centred, plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.spark import pieces, solving
from conflictdb.stage1_broad_phase import candidates

Objects = tuple[Scene, list[Area], list[Track]]
THROWN = [throw(SEAM, 3, 8, 16), throw(GROWING, 5, 4, 10), throw(OCEAN, 6, 6, 8)]
OBJECTS = [*((one.scene, one.areas, one.tracks) for one in scenes.known_scenes()), *THROWN]


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
    outlines = [row for batch in pieces.outlines(given) for row in batch.to_pylist()]
    met = in_batches(pairs_of(rows).take(rng.permutation(len(pairs_of(rows)))), 7, rng)
    hulls_meet = pa.Table.from_batches(list(solving.meeting(met)), schema=solving.PAIRS)
    sorted_rows = hulls_meet.sort_by([("a_key", "ascending"), ("b_key", "ascending")])
    known = {row["key"]: row["outline"] for row in outlines}
    found = solving.solved(in_batches(sorted_rows, 9, rng), scene, lambda: known, 4)
    return in_order(pa.Table.from_batches(list(found), schema=solving.SCHEMA))


def pairs_of(rows: pa.Table) -> pa.Table:
    """The pairs of rows that stage 1 leaves."""
    held = b"".join(rows["piece"].to_pylist())
    begin = np.cumsum([0, *(len(one) // WORD for one in rows["piece"].to_pylist())])[:-1]
    made = unpacked(np.frombuffer(held, np.int64), begin)
    keys = [key.encode() for key in rows["key"].to_pylist()]
    made = replace(made, object_id=np.unique(keys, return_inverse=True)[1].astype(np.int64))
    columns = [rows.take(one) for one in candidates(made)]
    return pa.table(
        {
            f"{side}_{name}": some[name]
            for side, some in zip("ab", columns, strict=True)
            for name in ("kind", "key", "piece")
        },
        schema=solving.PAIRS,
    )


SOME_OF = {Method.EXACT: 2, Method.WINDOW: 7, Method.SCREEN: 7, Method.NLP: 20}


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


def test_packed_pieces_are_the_same_pieces() -> None:
    """Every field comes back, with its type; and shapes that do not change are one array."""
    for scene, areas, tracks in OBJECTS:
        scene = centred(scene, areas, tracks)
        made = pieces_of(scene, plane_of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
        words, offset = packed(made)
        again = unpacked(words, offset[:-1])
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
