"""Conflicts that another program computed are written as `detect` writes them, or refused if they would be untrue."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
import shapely
from commands import KEPT, STRAIT, Run, known
from mixed_scenes import mixed_scene
from scene_features import Feature

from conflictdb import connect, store
from conflictdb.arrays.arrow.found import COMPUTED, of_found
from conflictdb.arrays.arrow.object_rows import to_objects
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.near import Chunk, Question
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.run import run_scene
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.earth.registry import Setup
from conflictdb.formats import read
from conflictdb.formats.computed import STATES, read_computed, settings_text
from conflictdb.model.plans import Scene
from conflictdb.spark import cut_objects as pieces


class Elsewhere:
    """The stages on numbered objects, without a database: the work of executors."""

    def __init__(self, pieces: Pieces, footprint: dict[int, Any]) -> None:
        self._pieces, self._footprint = pieces, footprint

    def pairs(self, _: Question) -> Iterator[Chunk]:
        a, b = candidates(self._pieces)
        a, b = np.minimum(a, b), np.maximum(a, b)  # in the order of their keys, as everywhere
        order = np.lexsort((b, a))
        yield Chunk(self._pieces, PieceRows(a[order]), PieceRows(b[order]))

    def footprints(self, ids: np.ndarray) -> np.ndarray:
        found = np.empty(len(ids), object)
        found[:] = [self._footprint[i] for i in ids.tolist()]
        return found

    def plans(self, ids: np.ndarray) -> TrackBatch:
        raise AssertionError("no track has tolerances")


def computed(objects: Path, directory: Path, scene: Scene) -> Path:
    """Compute the conflicts of an exported scene, and write them as `conflictdb spark detect` does."""
    table = pq.read_table(objects).sort_by([("kind", "ascending"), ("id", "ascending")])
    areas, tracks = to_objects(table)
    (area_ids, track_ids), versions = (np.split(table[of].to_numpy(), [len(areas)]) for of in ("object_id", "version"))
    plans = table.select(["kind", "object_id", "id"]).to_pylist()
    keys = {(row["kind"] == "track", row["object_id"]): row["id"] for row in plans}
    setup = Setup.of(scene)
    of_areas = replace(AreaBatch.of(areas), area_id=area_ids, version=versions[0])
    of_tracks = replace(TrackBatch.of(tracks), track_id=track_ids, version=versions[1])
    footprints = dict(zip(area_ids.tolist(), of_areas.footprint, strict=True))
    source = Elsewhere(pieces_of(setup, of_areas, of_tracks), footprints)
    directory.mkdir()
    pairs = 0
    for k, (found, _) in enumerate(run_scene(setup, source)):
        pairs += len(found)
        a, b = (
            [keys[bool(kind), number] for kind, number in zip(kinds.tolist(), ids.tolist(), strict=True)]
            for kinds, ids in ((found.a_kind, found.a_id), (found.b_kind, found.b_id))
        )
        batch = of_found(scene, found, found.where(np.arange(len(found))), a, b)
        pq.write_table(pa.Table.from_batches([batch]), directory / f"part-{k}.parquet")
    cut = pa.Table.from_batches(list(pieces.cut(table.to_batches(), scene))).select(["key", "digest"])
    digests = dict(zip(*cut.filter(cut["digest"].is_valid()).to_pydict().values(), strict=True))
    states = table.select(["kind", "id", "object_id", "version"])
    states = states.append_column("digest", pa.array([digests[key] for key in table["id"].to_pylist()]))
    states = states.append_column("settings", pa.array([settings_text(scene)] * len(states)))
    states = states.append_column("pairs", pa.array([pairs] * len(states)))
    (directory / STATES).mkdir()
    states = states.select(COMPUTED.schema.names).replace_schema_metadata(None)
    pq.write_table(states, directory / STATES / "part-0.parquet")
    return directory


@pytest.fixture
def strait(run: Run, tmp_path: Path) -> Path:
    """Return the computed conflicts of the shipped scene, which was loaded, exported and not detected."""
    run("load", STRAIT)
    assert run("export", "--scene", "strait", tmp_path / "strait.parquet").code == 0
    scene = read(tmp_path / "strait.parquet").scene
    assert scene is not None
    return computed(tmp_path / "strait.parquet", tmp_path / "conflicts.parquet", scene)


def rows_of(conn: psycopg.Connection[Any], query: str) -> list[Any]:
    with conn.transaction():
        return conn.execute(query.encode()).fetchall()


def test_what_is_written_back_is_what_detect_finds(run: Run, conn: psycopg.Connection[Any], strait: Path) -> None:
    """The same rows, nothing waits, and neither another write-back nor a detection changes anything."""
    done = run("spark", "write-back", "--scene", "strait", strait)
    assert (done.code, done.err) == (0, "")
    assert "opened, 0 changed, 0 closed" in done.out
    assert rows_of(conn, "SELECT scene_is_current FROM conflictdb.conflicts GROUP BY 1") == [(True,)]
    found = known(run, "strait")
    run("detect", STRAIT, "--scene", "copy")
    expected = known(run, "copy")
    for name in KEPT:
        assert [row[name] for row in found] == [row[name] for row in expected], name
    assert len(found) > 3
    assert "0 opened, 0 changed, 0 closed" in run("spark", "write-back", "--scene", "strait", strait).out
    events = rows_of(conn, "SELECT count(*) FROM conflictdb.conflict_event WHERE kind <> 'opened'")
    run("detect", "--scene", "strait", "--full")
    assert rows_of(conn, "SELECT count(*) FROM conflictdb.conflict_event WHERE kind <> 'opened'") == events == [(0,)]
    assert rows_of(conn, "SELECT settings ->> 'is_written_back' FROM conflictdb.run ORDER BY run_id LIMIT 1") == [
        ("true",)
    ]


def test_what_changed_since_waits_for_a_detection(run: Run, conn: psycopg.Connection[Any], strait: Path) -> None:
    """Nothing is written about a moved, a new and a removed object; the rest is written."""
    with conn.transaction():
        moved, gone = (key for (key,) in rows_of(conn, "SELECT key FROM conflictdb.track ORDER BY key LIMIT 2"))
        conn.execute("UPDATE conflictdb.track SET grow_mps = 0.5 WHERE key = %s", [moved])
        conn.execute("DELETE FROM conflictdb.track WHERE key = %s", [gone])
        conn.execute(
            "INSERT INTO conflictdb.area (scene_id, key, footprint) SELECT scene_id, 'NEW', footprint"
            " FROM conflictdb.area ORDER BY key LIMIT 1"
        )
    done = run("spark", "write-back", "--scene", "strait", strait)
    assert done.code == 0
    assert "3 objects are not what was computed" in done.err
    keys = {row[name] for row in known(run, "strait") for name in ("a_key", "b_key")}
    assert keys
    assert not keys & {moved, gone, "NEW"}
    waiting = rows_of(conn, "SELECT DISTINCT object_kind, object_id FROM conflictdb.change WHERE NOT is_covered")
    assert len(waiting) == 3
    run("detect", "--scene", "strait")
    found = known(run, "strait")
    run("detect", "--scene", "strait", "--full")
    assert found == known(run, "strait")
    assert {"NEW", moved} <= {row[name] for row in found for name in ("a_key", "b_key")}
    # Newer results of a detection stay.
    assert run("spark", "write-back", "--scene", "strait", strait).code == 0
    assert found == known(run, "strait")


def test_conflicts_that_are_gone_are_closed(run: Run, conn: psycopg.Connection[Any], strait: Path) -> None:
    run("detect", "--scene", "strait")
    before = known(run, "strait")
    (part,), (states,) = strait.glob("*.parquet"), (strait / STATES).iterdir()
    found, computed_of = pq.read_table(part).slice(1), pq.read_table(states)
    pq.write_table(found, part)
    fewer = pa.array([len(found)] * len(computed_of))
    pq.write_table(computed_of.set_column(computed_of.schema.get_field_index("pairs"), "pairs", fewer), states)
    assert "0 opened, 0 changed, 1 closed" in run("spark", "write-back", "--scene", "strait", strait).out
    assert len(known(run, "strait")) == len(before) - 1


def test_what_was_computed_of_a_part_of_a_scene_hides_nothing(
    run: Run, conn: psycopg.Connection[Any], strait: Path, tmp_path: Path
) -> None:
    """An object that moved was compared with those of the file alone: the others are detected again."""
    run("detect", "--scene", "strait")
    with conn.transaction():
        conn.execute("UPDATE conflictdb.track SET path = ST_Translate(path, 0.0, 0.02) WHERE key = 'FERRY'")
    whole = tmp_path / "strait.parquet"
    assert run("export", "--scene", "strait", whole).code == 0
    scene, objects = read(whole).scene, pq.read_table(whole)
    assert scene is not None
    pq.write_table(objects.filter(pc.field("id") != "DIVING"), whole)
    done = run("spark", "write-back", "--scene", "strait", computed(whole, tmp_path / "part", scene))
    assert done.code == 0
    assert "1 objects are not what was computed" in done.err
    assert rows_of(conn, "SELECT pending, is_current FROM conflictdb.scenes WHERE scene = 'strait'") == [(1, False)]
    run("detect", "--scene", "strait")
    found = known(run, "strait")
    run("detect", "--scene", "strait", "--full")
    assert found == known(run, "strait")
    # If no object of the file waits, all of its pairs are known: no other object waits either.
    assert run("spark", "write-back", "--scene", "strait", tmp_path / "part").code == 0
    assert rows_of(conn, "SELECT pending, is_current FROM conflictdb.scenes WHERE scene = 'strait'") == [(0, True)]


def moved(table: pa.Table, key: str) -> pa.Table:
    """Objects, one of them a bit further north, as written by a tool that does not know versions."""
    shapes = shapely.from_wkb(table["geometry"].to_numpy())
    further = shapely.to_wkb(shapely.transform(shapes, lambda xy: xy + np.array([0.0, 0.02])))
    return given(table, key, geometry=dict(zip(table["id"].to_pylist(), further, strict=True))[key])


def put(table: pa.Table, name: str, column: pa.Array) -> pa.Table:
    return table.set_column(table.schema.get_field_index(name), name, column)


def given(table: pa.Table, key: str, **values: Any) -> pa.Table:
    """Objects, one of them with other values."""
    return pa.Table.from_pylist(
        [row | values if row["id"] == key else row for row in table.to_pylist()], schema=table.schema
    )


EDITS: dict[str, tuple[set[str], Callable[[pa.Table], pa.Table]]] = {
    "a track moved": ({"FERRY"}, lambda of: moved(of, "FERRY")),
    "an area moved": ({"DIVING"}, lambda of: moved(of, "DIVING")),
    "a track that reaches deeper": ({"TOW"}, lambda of: given(of, "TOW", floor_m=-150.0)),
    "a haven that grows": ({"TOW"}, lambda of: given(of, "TOW", grow_mps=0.25)),
    "an area for ever": ({"DIVING"}, lambda of: given(of, "DIVING", end=None)),
    "two under other names": (
        {"SUB-1", "SUB-2"},
        lambda of: given(
            given(of, "SUB-1", id="?", version=1, object_id=2**40), "SUB-2", id="SUB-1", version=1, object_id=2**41
        ),
    ),
    "one that was removed": ({"FERRY"}, lambda of: of.filter(pc.field("id") != "FERRY")),
}


@pytest.mark.parametrize("edit", EDITS)
def test_objects_that_were_edited_in_the_file_wait_for_a_detection(
    run: Run, conn: psycopg.Connection[Any], tmp_path: Path, edit: str
) -> None:
    """Conflicts computed from other values do not apply to them, whatever the file says of their versions."""
    run("load", STRAIT)
    run("load", STRAIT, "--scene", "copy")
    run("detect", "--scene", "copy")
    file = tmp_path / "strait.parquet"
    assert run("export", "--scene", "strait", file).code == 0
    edited, change = EDITS[edit]
    scene, objects = read(file).scene, pq.read_table(file)
    assert scene is not None
    pq.write_table(change(objects), file)
    done = run("spark", "write-back", "--scene", "strait", computed(file, tmp_path / "found", scene))
    assert done.code == 0
    assert "objects are not what was computed" in done.err
    waiting = rows_of(
        conn,
        "SELECT key FROM (SELECT scene_id, 0 AS kind, area_id AS id, key FROM conflictdb.area UNION ALL"
        " SELECT scene_id, 1, track_id, key FROM conflictdb.track) o JOIN conflictdb.change c"
        " ON c.scene_id = o.scene_id AND c.object_kind = o.kind AND c.object_id = o.id",
    )
    assert {key for (key,) in waiting} == edited
    assert not {row[name] for row in known(run, "strait") for name in ("a_key", "b_key")} & edited
    run("detect", "--scene", "strait")
    assert known(run, "strait") == known(run, "copy")


def test_objects_that_were_added_to_the_file_are_not_written(
    run: Run, conn: psycopg.Connection[Any], tmp_path: Path
) -> None:
    """An invented number counts as a deleted object; without a number, the conflicts are refused."""
    run("load", STRAIT)
    file = tmp_path / "strait.parquet"
    assert run("export", "--scene", "strait", file).code == 0
    scene, objects = read(file).scene, pq.read_table(file)
    assert scene is not None
    added = given(objects.filter(pc.field("id") == "FERRY"), "FERRY", id="NEW", object_id=2**40)
    pq.write_table(pa.concat_tables([objects, added]), file)
    found = computed(file, tmp_path / "found", scene)
    done = run("spark", "write-back", "--scene", "strait", found)
    assert done.code == 0
    assert "1 objects are not what was computed" in done.err
    assert "NEW" not in {row[name] for row in known(run, "strait") for name in ("a_key", "b_key")}
    (part,) = found.glob("*.parquet")
    rows = pq.read_table(part)
    for name in ("a_id", "b_id"):
        rows = put(rows, name, pc.if_else(pc.equal(rows[name], 2**40), None, rows[name]))
    pq.write_table(rows, part)
    assert "an object that was added to an exported file is in no database" in refuse(run, found)


def test_versions_that_come_again_are_not_trusted(run: Run, conn: psycopg.Connection[Any], tmp_path: Path) -> None:
    """In a copy of a database, or one restored from a backup, the same version may be of another state."""
    run("load", STRAIT)
    file = tmp_path / "strait.parquet"
    assert run("export", "--scene", "strait", file).code == 0
    scene, objects = read(file).scene, pq.read_table(file)
    assert scene is not None
    move = "UPDATE conflictdb.track SET path = ST_Translate(path, 0.0, 0.02) WHERE key = 'FERRY' RETURNING version"
    ((version,),) = rows_of(conn, move)
    pq.write_table(given(objects, "FERRY", version=version), file)
    done = run("spark", "write-back", "--scene", "strait", computed(file, tmp_path / "found", scene))
    assert done.code == 0
    assert "1 objects are not what was computed" in done.err
    assert "FERRY" not in {row[name] for row in known(run, "strait") for name in ("a_key", "b_key")}


def test_digests_of_the_database_are_those_of_what_was_exported(dsn: str, tmp_path: Path) -> None:
    """Also of havens that change, and of heights of legs."""
    features = {Feature.GROWTH, Feature.OUTLINES, Feature.LEG_HEIGHTS, Feature.CLIMBS, Feature.ACTIVATIONS}
    made = [mixed_scene(seed, features) for seed in range(10)]
    areas = [replace(one, key=f"{one.key} {each.seed}") for each in made for one in each.areas]
    tracks = [replace(one, key=f"{one.key} {each.seed}", max_speed_kn=np.inf) for each in made for one in each.tracks]
    scene, file = replace(made[0].scene, name="mixed"), tmp_path / "mixed.parquet"
    with connect(dsn) as db:
        store.replace_scene(db.connection, scene, areas, tracks, merge=False)
        db.scene("mixed").export(file)
        known = store.object_states(db.connection, store.scene_id(db.connection, "mixed"))
    of = read_computed(computed(file, tmp_path / "found", scene))
    exported = dict(zip(of.key.tolist(), of.digest.tolist(), strict=True))
    assert dict(zip(known.key.tolist(), known.digest.tolist(), strict=True)) == exported
    assert len(exported) == len(areas) + len(tracks)


def test_files_that_were_rewritten_and_say_the_same_are_written_back(run: Run, tmp_path: Path) -> None:
    """Rows in another order, in parts, of other types and otherwise compressed are equal to the export."""
    run("load", STRAIT)
    file, parts = tmp_path / "strait.parquet", tmp_path / "parts.parquet"
    assert run("export", "--scene", "strait", file).code == 0
    scene, objects = read(file).scene, pq.read_table(file)
    assert scene is not None
    backwards = objects.take(list(range(len(objects)))[::-1])
    for name, of in (("id", pa.large_string()), ("geometry", pa.large_binary())):
        backwards = put(backwards, name, backwards[name].cast(of))
    parts.mkdir()
    for first in range(0, len(objects), 4):
        pq.write_table(backwards.slice(first, 4), parts / f"part-{first}.parquet", compression="gzip", row_group_size=3)
    done = run("spark", "write-back", "--scene", "strait", computed(parts, tmp_path / "found", scene))
    assert (done.code, done.err) == (0, "")


def refuse(run: Run, path: Path, scene: str = "strait") -> str:
    done = run("spark", "write-back", "--scene", scene, path)
    assert done.code == 4, done
    return done.err


def test_what_would_be_untrue_is_refused(run: Run, conn: psycopg.Connection[Any], strait: Path, tmp_path: Path) -> None:
    """Other settings, another scene, conflicts of unknown objects: nothing is written, and no run is recorded."""
    scene = read(tmp_path / "strait.parquet").scene
    assert scene is not None
    other = computed(tmp_path / "strait.parquet", tmp_path / "other", replace(scene, separation_m=500.0))
    assert "separation_m: is 0.0, but the conflicts were computed with 500.0" in refuse(run, other)
    run("load", STRAIT, "--scene", "copy")
    assert "are none of those that the conflicts were computed from" in refuse(run, strait, "copy")
    assert "is not in this database" in refuse(run, strait, "nowhere")
    assert "does not exist" in refuse(run, tmp_path / "nothing.parquet")
    assert "does not say which objects it was computed from" in refuse(run, tmp_path / "strait.parquet")

    (states,) = (strait / STATES).iterdir()
    whole = pq.read_table(states)
    pq.write_table(whole.slice(1), states)
    assert "are not all of those that they say they were computed from" in refuse(run, strait)
    pq.write_table(pa.concat_tables([whole, whole]), states)
    assert "are listed twice" in refuse(run, strait)
    strange = pa.array([f"{key}?" for key in whole["id"].to_pylist()])
    pq.write_table(whole.set_column(whole.schema.get_field_index("id"), "id", strange), states)
    assert "are of another database" in refuse(run, strait)
    pq.write_table(whole.drop_columns("version"), states)
    assert "version: is missing" in refuse(run, strait)
    pq.write_table(whole, states)

    (part,) = strait.glob("*.parquet")
    found = pq.read_table(part)
    pq.write_table(found, strait / "part-9.parquet")
    assert "two answers for one pair" in refuse(run, strait)
    (strait / "part-9.parquet").write_bytes(part.read_bytes()[:-10])
    assert "cannot be read as Parquet" in refuse(run, strait)
    (strait / "part-9.parquet").unlink()
    pq.write_table(found.slice(1), part)
    assert f"holds {len(found) - 1} pairs of the {len(found)} that were found" in refuse(run, strait)
    pq.write_table(found, part)
    assert rows_of(conn, "SELECT count(*) FROM conflictdb.run") == [(0,)]
    assert rows_of(conn, "SELECT count(*) FROM conflictdb.conflict") == [(0,)]
    assert rows_of(conn, "SELECT count(*) FROM conflictdb.change WHERE is_covered") == [(0,)]
    assert run("spark", "write-back", "--scene", "strait", strait).code == 0
