"""The Arrow form of objects and conflicts: bit by bit, and one error for unsuitable values."""

import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import shapely
from draws import draws
from full_plans import lost
from mixed_scenes import mixed_scene, odd_scene
from patience import WAIT_S
from scene_features import Feature
from staged import Staged

from conflictdb import InvalidInput, solve
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.arrow.found import FOUND, of_found, of_rows, to_conflicts
from conflictdb.arrays.arrow.object_rows import OBJECTS, of_objects, to_objects
from conflictdb.arrays.polygons import Polygons
from conflictdb.model.plans import Area, Scene, Track

Objects = tuple[Scene, list[Area], list[Track]]


def numbered(areas: list[Area], tracks: list[Track]) -> pa.RecordBatch:
    numbers = np.concatenate([np.arange(len(areas)), np.arange(len(tracks))])
    return of_objects(areas, tracks, numbers, np.ones(len(numbers), np.int64))


def same_arrays(one: object, other: object) -> None:
    """Compare all arrays of two batches, types and bits."""
    for column in fields(one):  # type: ignore[arg-type]
        a, b = getattr(one, column.name), getattr(other, column.name)
        if isinstance(a, np.ndarray) and a.dtype == object:
            assert shapely.to_wkb(a).tolist() == shapely.to_wkb(b).tolist()
        elif isinstance(a, np.ndarray):
            assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), column.name


@draws("scenes", 25, 2000)
def test_objects_come_back_as_they_were(scenes: int) -> None:
    """All that is known of areas and tracks, also through the format of streams."""
    for seed in range(scenes):
        _, areas, tracks = odd_scene(seed)
        batch = of_objects(areas, tracks)
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, batch.schema) as writer:
            writer.write_batch(batch)
        back = pa.ipc.open_stream(sink.getvalue()).read_all()
        for one, other in zip([*areas, *tracks], [one for kind in to_objects(back) for one in kind], strict=True):
            assert lost(one, other) == [], seed


@draws("scenes", 15, 2000)
def test_some_rows_of_a_table_are_those_objects(scenes: int) -> None:
    """Slices begin in the middle of the memory that they share."""
    for seed in range(scenes):
        _, areas, tracks = odd_scene(seed)
        items = [*areas, *tracks]
        first, last = sorted(np.random.default_rng(seed).integers(0, len(items) + 1, 2).tolist())
        some = of_objects(areas, tracks).slice(first, last - first)
        for one, other in zip(items[first:last], [one for kind in to_objects(some) for one in kind], strict=True):
            assert lost(one, other) == [], seed


@pytest.mark.parametrize("feature", [Feature.SEPARATION, Feature.GROWTH, Feature.ANTIMERIDIAN])
def test_conflicts_come_back_as_they_were(feature: Feature) -> None:
    """All rows, and rows of a slice."""
    mixed = mixed_scene(7, {feature})
    scene = mixed.scene
    found, _ = Staged.of(scene, mixed.areas, mixed.tracks, regions=True).run()
    region = found.where(np.arange(len(found)))
    assert len(found)
    keys = [f"K{k}" for k in range(len(found))]
    as_users_see_it = of_found(scene, found, region, keys, keys)
    again, its_region = to_conflicts(as_users_see_it)
    same_arrays(found, again)
    assert its_region.geometries().tolist() == region.geometries().tolist()
    later, its_region = to_conflicts(as_users_see_it.slice(1))
    same_arrays(found.take(np.arange(1, len(found))), later)
    assert its_region.geometries().tolist() == region.geometries().tolist()[1:]


@pytest.mark.parametrize("features", [{Feature.NEAREST}, {Feature.NEAREST, Feature.ANTIMERIDIAN}])
def test_rows_are_told_alike_from_arrays_and_by_solve(features: set[Feature]) -> None:
    """Executors make of arrays the rows that `solve` returns, in columns."""
    mixed = mixed_scene(7, features)
    scene = mixed.scene
    solved = of_rows(solve(mixed.tracks, mixed.areas, scene))
    areas, tracks = (sorted(some, key=lambda one: one.key.encode()) for some in (mixed.areas, mixed.tracks))
    found, _ = Staged.of(scene, areas, tracks).run()
    keys = [
        [(areas, tracks)[kind][number].key for kind, number in zip(kinds.tolist(), numbers.tolist(), strict=True)]
        for kinds, numbers in ((found.a_kind, found.a_id), (found.b_kind, found.b_id))
    ]
    told = of_found(scene, found, Polygons.none(len(found)), *keys)
    order = [("a_kind", "ascending"), ("a_key", "ascending"), ("b_key", "ascending")]
    given = [name for name in FOUND.schema.names if not name.endswith(("_id", "_version", "_name"))]
    assert len(solved)
    assert set(solved["verdict"].to_pylist()) >= {"conflict", "near"}
    assert told.select(given).sort_by(order).to_pylist() == solved.select(given).to_pylist()


def test_nothing_comes_back_as_nothing() -> None:
    found, region = to_conflicts(FOUND.schema.empty_table())
    assert isinstance(found, Conflicts)
    assert (len(found), len(region)) == (0, 0)
    assert to_objects(OBJECTS.schema.empty_table()) == ([], [])


def test_a_region_that_is_not_known_stays_so() -> None:
    mixed = mixed_scene(7, ())
    scene = mixed.scene
    found, _ = Staged.of(scene, mixed.areas, mixed.tracks).run()
    keys = [f"K{k}" for k in range(len(found))]
    assert keys
    batch = of_found(scene, found, Polygons.none(len(found)), keys, keys)
    assert batch["region"].null_count == len(found)
    assert not len(to_conflicts(batch)[1].data)


def one_track() -> pa.RecordBatch:
    track = Track("T", [(0, 0), (1, 1)], np.array([0, 10**15], "datetime64[us]"), [(0, 0)])
    return numbered([], [track])


def changed(batch: pa.RecordBatch | pa.Table, name: str, column: pa.Array) -> pa.Table:
    table = batch if isinstance(batch, pa.Table) else pa.Table.from_batches([batch])
    return table.set_column(table.schema.get_field_index(name), name, column)


@pytest.mark.parametrize(
    ("name", "column", "rule"),
    [
        ("id", pa.array([7]), "must be string; got int64"),
        ("id", pa.array([None], pa.string()), "must not be null"),
        ("kind", pa.array(["trac"]), "must be 'area' or 'track'; got 'trac'"),
        ("geometry", pa.array([None], pa.binary()), "must not be null"),
        ("geometry", pa.array([b"\x01\x02"]), "must be WKB"),
        ("geometry", pa.array([shapely.Point(1, 2).wkb]), "must be a LineString"),
        ("times", pa.array([[1, 2]]), r"must be list<.*timestamp\[us, tz=UTC\]>; got list<item: int64>"),
        ("times", pa.array([[1, 2]], pa.list_(pa.timestamp("us"))), "instants need a time zone"),
        ("times", pa.array([[1, 2]], pa.list_(pa.timestamp("ns", "UTC"))), "would lose data"),
        ("times", pa.array([[1]], pa.list_(pa.timestamp("us", "UTC"))), "one per waypoint: 2 waypoints, 1 times"),
        ("outline_m", pa.array([[[0.0, 1.0, 2.0]]]), r"ring of \[starboard, forward\]"),
        ("outline_m", pa.array([[[0.0, None]]]), r"ring of \[starboard, forward\]"),
        ("outline_m", pa.array([None], pa.list_(pa.list_(pa.float64()))), "is missing|needs at least|ring of"),
        ("floors_m", pa.array([[1.0, 2.0, 3.0]]), "per leg"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(name: str, column: pa.Array, rule: str) -> None:
    """One error that names the column."""
    with pytest.raises(InvalidInput, match=rule):
        to_objects(changed(one_track(), name, column))


def test_a_missing_column_is_named() -> None:
    with pytest.raises(InvalidInput, match="'objects': geometry: is missing: it must be binary"):
        to_objects(pa.Table.from_batches([one_track()]).drop_columns("geometry"))


def test_another_form_or_a_later_edition_is_refused() -> None:
    batch = one_track()
    for told, rule in (
        (b'{"form": "pieces", "edition": 1}', "says that this is 'pieces'"),
        (b'{"form": "objects", "edition": 99}', "edition 99.*upgrade"),
        (b"{", "must be a JSON object"),
        (b"[1]", "must be a JSON object"),
        (b"[" * 100_000, "must be a JSON object"),
    ):
        with pytest.raises(InvalidInput, match=rule):
            to_objects(batch.replace_schema_metadata({b"conflictdb": told}))
    assert to_objects(batch.replace_schema_metadata(None))[1][0].key == "T"


def test_types_that_hold_the_same_are_taken() -> None:
    """As other engines give them: large and fixed lists, dictionaries, coarser and finer instants, smaller numbers."""
    batch = pa.Table.from_batches([one_track()])
    loose = {
        "id": pa.large_string(),
        "kind": pa.dictionary(pa.int32(), pa.string()),
        "geometry": pa.large_binary(),
        "object_id": pa.int32(),
        "times": pa.large_list(pa.timestamp("ns", "Europe/Berlin")),
        "outline_m": pa.large_list(pa.list_(pa.float64(), 2)),
    }
    table = batch
    for name, of in loose.items():
        table = changed(table, name, table[name].combine_chunks().cast(of))
    assert lost(to_objects(table)[1][0], to_objects(batch)[1][0]) == []
    assert OBJECTS.columns(table) == OBJECTS.columns(batch)


def test_the_page_shows_what_runs_and_lists_every_column() -> None:
    page = (Path(__file__).parents[2] / "docs/reference/arrow.md").read_text()
    made: dict[str, Any] = {}
    exec(page.split("```python\n")[1].split("```")[0], made)  # noqa: S102
    assert made["tracks"][0].key == "T1"
    parts = dict(zip(("objects", "found"), page.split("\n## ")[1:], strict=True))
    for form in (OBJECTS, FOUND):
        assert [name for name in form.schema.names if f"`{name}`" not in parts[form.name]] == []


def test_without_pyarrow_the_extra_is_named() -> None:
    script = "import sys; sys.modules['pyarrow'] = None\nimport conflictdb.arrays.arrow.object_rows"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=WAIT_S)
    assert done.returncode == 1
    assert "ConflictDBError: Arrow and Parquet need pyarrow: pip install 'conflictdb[parquet]'" in done.stderr
