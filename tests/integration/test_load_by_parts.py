"""A file of GeoParquet is loaded some objects at a time: as if it were read whole, and in bounded memory."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import psycopg
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import shapely
from commands import Outcome, Run
from peaks import PRINT_PEAK

from conflictdb import connect, formats, store
from conflictdb.arrays.arrow.object_rows import of_objects
from conflictdb.errors import InvalidInput
from conflictdb.formats import parquet_child
from conflictdb.formats.parquet_writing import write_objects
from conflictdb.model.plans import Area, Motion, Scene, Track

# Rows that are decoded at once: objects come in several parts.
AT_ONCE = parquet_child.ROWS_AT_ONCE
SCENE = Scene("sea", separation_m=10.0)


def area(key: str, lon: float, lat: float = 54.0) -> Area:
    return Area(key, shapely.MultiPolygon([shapely.box(lon, lat, lon + 0.001, lat + 0.001)]))


def track(key: str, lon: float) -> Track:
    times = np.array([0, 3_600_000_000])
    return Track(key, np.array([(lon, 54.0), (lon, 54.1)]), times, np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)]))


def written(path: Path, areas: Sequence[Area], tracks: Sequence[Track] = (), scene: Scene = SCENE) -> Path:
    with path.open("wb") as stream:
        write_objects(stream, scene, [of_objects(areas, []), of_objects([], tracks)])
    return path


def many(count: int, more: Sequence[Area] = ()) -> list[Area]:
    """`count` areas, and then some more, in the last of several parts."""
    return [*(area(f"A{i}", 9.0 + 1e-5 * i) for i in range(count)), *more]


def rows_of(dsn: str, query: str) -> list[Any]:
    with psycopg.connect(dsn) as conn:
        return conn.execute(query.encode()).fetchall()


def test_what_is_loaded_by_parts_is_what_is_read_whole(run: Run, dsn: str, tmp_path: Path) -> None:
    """Objects, their order and settings; added to, and replaced by fewer; remarks on all of them together."""
    path = written(
        tmp_path / "sea.parquet", many(AT_ONCE, [area("far", 170.0)]), [track(f"T{i}", 9.0) for i in range(9)]
    )
    done = run("load", path)
    assert (done.code, f"{AT_ONCE + 10} added") == (0, done.out.split(": ")[1].split(",")[0])
    assert done.err.count("km from the other objects") == 1
    assert "area 'far'" in done.err
    with connect(dsn) as db:
        contents = formats.read(path)
        settings, areas, tracks = db.scene("sea")._read()
        assert settings == contents.scene == SCENE
        assert [one.key for one in areas] == [one.key for one in contents.areas]
        assert [one.footprint for one in areas] == [one.footprint for one in contents.areas]
        assert [one.times_us.tolist() for one in tracks] == [one.times_us.tolist() for one in contents.tracks]
    one = written(tmp_path / "one.parquet", [area("A1", 20.0), area("new", 9.0)])
    assert "1 added, 1 updated, 0 removed, 0 unchanged" in run("load", one, "--scene", "sea").out
    replaced = run("load", one, "--scene", "sea", "--replace")
    assert f"0 added, 0 updated, {AT_ONCE + 9} removed, 2 unchanged" in replaced.out


@pytest.mark.parametrize(
    ("last", "rules"),
    [
        ([area("A7", 9.0)], [f"area 'A7': id: is given twice, by rows 7 and {AT_ONCE} (from 0)"]),
        ([area("N", 9.0, 89.5)], ["area 'N': "]),
        (
            [replace(area("B", 9.0), key="B\0"), area("A8", 9.0), area("A8", 9.5)],
            [
                "'B\\x00': id: ",
                f"area 'A8': id: is given twice, by rows 8 and {AT_ONCE + 1}",
                f"area 'A8': id: is given twice, by rows {AT_ONCE + 1} and {AT_ONCE + 2}",
            ],
        ),
    ],
)
def test_what_is_refused_in_the_last_part_leaves_all_as_it_was(
    run: Run, dsn: str, tmp_path: Path, last: list[Area], rules: list[str]
) -> None:
    """All errors are reported with the file's name, and nothing of the parts before is written."""
    path = written(tmp_path / "sea.parquet", many(AT_ONCE, last))
    refused = run("load", path)
    assert refused.code == 4
    for rule in rules:
        assert rule in refused.err, refused.err
    assert refused.err.count(str(path)) == len(rules) == refused.err.count("\n")
    assert rows_of(dsn, "SELECT count(*) FROM conflictdb.scene") == [(0,)]
    whole = path.read_bytes()
    for cut in (len(whole) // 2, len(whole) - 10):
        path.write_bytes(whole[:cut])
        assert "cannot be read as Parquet" in run("load", path).err
    assert rows_of(dsn, "SELECT count(*) FROM conflictdb.scene") == [(0,)]


def test_a_file_without_objects_is_refused(run: Run, dsn: str, tmp_path: Path) -> None:
    """It empties its scene only with --replace; a file without settings does not even then."""
    run("load", written(tmp_path / "sea.parquet", many(3)))
    path = written(tmp_path / "none.parquet", [])
    for words in (("load", path), ("load", path, "--skip-invalid"), ("detect", path)):
        done = run(*words)
        assert (done.code, "holds no area and no track" in done.err) == (4, True), done.err
    table = geopandas.GeoDataFrame({"id": ["P"]}, geometry=[shapely.Point(9.0, 54.0)], crs=4326)
    table.to_parquet(tmp_path / "points.parquet")
    for word in ((), ("--replace",)):
        done = run("load", tmp_path / "points.parquet", "--scene", "sea", *word)
        assert (done.code, "1 rows are Points" in done.err) == (4, True), done.err
    assert rows_of(dsn, "SELECT count(*) FROM conflictdb.area") == [(3,)]
    assert run("load", path, "--replace").out == "sea: 0 added, 0 updated, 3 removed, 0 unchanged\n"


def test_what_cannot_be_left_out_is_read_whole(run: Run, tmp_path: Path) -> None:
    """Refused objects can still be left out, also a duplicate."""
    path = written(tmp_path / "sea.parquet", many(20, [area("A7", 10.0), area("N", 9.0, 89.5)]))
    done: Outcome = run("load", path, "--skip-invalid")
    assert "20 added" in done.out
    assert "2 LEFT OUT" in done.out
    assert "given twice" in done.err
    assert "area 'N'" in done.err


def test_great_circles_without_a_centre_get_the_middle_of_all(run: Run, dsn: str, tmp_path: Path) -> None:
    """The middle of all parts, as for a file that is read whole; later loads keep it."""
    scene = Scene("circles", motion=Motion.GREAT_CIRCLE)
    path = written(tmp_path / "circles.parquet", many(AT_ONCE, [area("east", 30.0)]), scene=scene)
    whole = written(tmp_path / "whole.parquet", many(AT_ONCE, [area("east", 30.0)]), scene=scene)
    assert run("load", path).code == 0
    assert run("load", whole, "--scene", "whole", "--skip-invalid").code == 0
    (centre,), (other,) = (
        rows_of(dsn, f"SELECT centre_lon, centre_lat FROM conflictdb.scene WHERE name = '{name}'")
        for name in ("circles", "whole")
    )
    assert centre == other
    assert 9.0 < centre[0] < 9.2
    assert run("load", written(path, [area("B", 31.0)], scene=scene), "--replace").code == 0
    assert rows_of(dsn, "SELECT centre_lon, centre_lat FROM conflictdb.scene WHERE name = 'circles'") == [centre]


MEASURED = f"""
import sys
from conflictdb.cli import main
assert main(sys.argv[1:]) == 0
{PRINT_PEAK}"""


def test_memory_does_not_grow_with_the_file(dsn: str, tmp_path: Path) -> None:
    """Two parts are there at once; five more add less than a fifth of the memory of keeping all."""
    peaks = []
    for count in (2 * AT_ONCE, 7 * AT_ONCE):
        table = pa.Table.from_batches([of_objects(many(AT_ONCE), [])])
        tables = [
            table.set_column(0, "id", pa.array([f"{k} {key}" for key in table["id"].to_pylist()]))
            for k in range(count // AT_ONCE)
        ]
        pq.write_table(pa.concat_tables(tables), tmp_path / "sea.parquet", row_group_size=AT_ONCE)
        command = [sys.executable, "-c", MEASURED, "--dsn", dsn, "load", str(tmp_path / "sea.parquet")]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        peaks.append(int(done.stdout.split()[-1]))
    assert peaks[1] - peaks[0] < 5 * AT_ONCE * 1_900 / 5


def test_new_objects_are_stored_in_parts_all_or_none(dsn: str) -> None:
    """An object that is refused in a later part leaves nothing of the earlier ones; order and counts are as of one."""
    far = np.linspace(0.0, 2.0 * np.pi, 91)[:-1]
    circle = 0.001 * np.column_stack([np.cos(far), np.sin(far)])
    areas = [Area(f"A{i:04}", circle + np.array([9.0 + 0.01 * (i % 97), 54.0])) for i in range(3_000)]
    wide = Area("wide", np.concatenate([circle, 0.9 * circle[:1]]) + np.array([9.0, 54.0]))
    phases: list[tuple[str, int, int]] = []
    with psycopg.connect(dsn) as conn:
        conn.execute("SET conflictdb.max_vertices = 91")
        conn.commit()
        with pytest.raises(InvalidInput, match="area 'wide': footprint: must have at most 91 vertices; got 92"):
            store.replace_scene(conn, Scene("sea"), [*areas, wide], [], merge=True)
        assert rows_of(dsn, "SELECT count(*) FROM conflictdb.scene") == [(0,)]
        counts = store.replace_scene(
            conn, Scene("sea"), areas, [], merge=True, phase=lambda *phase: phases.append(phase)
        )
        assert counts == store.LoadCounts(3_000, 0, 0, 0)
        counts = store.replace_scene(conn, Scene("sea"), [*areas[:9], area("B", 9.0)], [], merge=False)
        assert counts == store.LoadCounts(1, 0, 2_991, 9)
    stored = [(done, of) for name, done, of in phases if name == "storing objects"]
    assert stored[0] == (0, 0)
    assert len(stored) > 1
    assert all(0 < done < of == 3_000 for done, of in stored[1:])
    keys = [key for (key,) in rows_of(dsn, "SELECT key FROM conflictdb.area ORDER BY area_id")]
    assert keys == [*(f"A{i:04}" for i in range(9)), "B"]
    assert rows_of(dsn, "SELECT count(*) FROM conflictdb.object_key") == [(10,)]


def test_new_rows_are_checked_together(dsn: str) -> None:
    """No routine checks a usual row by itself, or looks for a former object of its number; a bad row is refused."""
    tracks = [track(f"T{i}", 9.0) for i in range(300)]
    with psycopg.connect(dsn) as conn, conn.transaction(force_rollback=True):
        conn.execute("SET LOCAL track_functions = 'all'")
        store.replace_scene(conn, SCENE, many(300), tracks, merge=True)
        calls = dict(conn.execute("SELECT funcname, calls FROM pg_stat_xact_user_functions").fetchall())
        by_row = {name: n for name, n in calls.items() if n >= 300 and name.startswith("_")}
        assert by_row == {"_area_before": 300, "_track_before": 300}
        assert not {"_first_version", "_check_area_shape", "_check_track_shape"} & calls.keys()
        text = "SRID=4326;MULTIPOLYGON(((0 0, {} 1, 1 0, 0 1, 0 0)))"
        with pytest.raises(psycopg.errors.DatabaseError) as refused, conn.transaction():
            conn.execute(
                "INSERT INTO conflictdb.area (scene_id, key, footprint) SELECT s.scene_id, k.key, k.shape::geometry"
                " FROM conflictdb.scene s, (VALUES ('good', %s), ('bad', %s)) k (key, shape)",
                [text.format(0.2).replace("1 0, 0 1", "0.4 1, 0.4 0"), text.format(1)],
            )
        assert (refused.value.sqlstate, refused.value.diag.constraint_name) == ("ZC001", "footprint_valid")
