"""A scene of a database through Spark and back: read by workers or exported, its conflicts are those of `detect`."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
import scenes
import shapely
from commands import STRAIT, Run, known, runner
from own_server import own_server
from ports import free_port
from psycopg import conninfo
from spark_answers import Spark

from conflictdb import connect, store
from conflictdb.arrays.arrow.object_rows import of_objects
from conflictdb.errors import StoreError
from conflictdb.formats.parquet_writing import write_objects
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m
from conflictdb.model.results import Kind

pytestmark = [pytest.mark.spark, pytest.mark.xdist_group("spark")]

PASSWORD = "never-to-be-seen"  # noqa: S105
# Of three ships, and of the areas that they cross.
LATITUDES = (("S", 0.0), ("T", 0.5), ("U", 1.0))
SHIP = rectangle_outline_m(50.0, 50.0, 50.0, 50.0)
# Objects of scenes of great circles, without the processing by `put_area` and `put_track`.
ROWS = """
INSERT INTO conflictdb.scene (name, motion, earth) VALUES ('late', 'great_circle', 'sphere');
INSERT INTO conflictdb.track (scene_id, key, path, outline, outlines, grow_mps, floor_m, ceiling_m)
SELECT conflictdb_internal._scene_id('late'), key, path, outline, outlines, grow_mps, floor_m, ceiling_m
FROM conflictdb.track WHERE scene_id = conflictdb_internal._scene_id('circles') ORDER BY key DESC;
INSERT INTO conflictdb.area (scene_id, key, footprint, active_span)
SELECT conflictdb_internal._scene_id('late'), key, footprint, active_span
FROM conflictdb.area WHERE scene_id = conflictdb_internal._scene_id('circles')
"""


@dataclass(frozen=True)
class Networked:
    """Connection strings of a server over the network: as its owner, and as a read-only user with a password."""

    owner: str
    reader: str


@pytest.fixture
def networked() -> Iterator[Networked]:
    with own_server(listen_addresses="127.0.0.1", port=str(free_port())) as server:
        with (server.data / "pg_hba.conf").open("a") as rules:
            rules.write("\nhost conflictdb reader 127.0.0.1/32 scram-sha-256\n")
        with psycopg.connect(server.dsn, autocommit=True) as conn:
            conn.execute(f"CREATE ROLE reader LOGIN PASSWORD '{PASSWORD}' IN ROLE conflictdb_reader")
            conn.execute("SELECT pg_reload_conf()")
        over = conninfo.make_conninfo(server.dsn, host="127.0.0.1", user="reader", password=PASSWORD)
        yield Networked(server.dsn, over)


@pytest.fixture
def run(networked: Networked, capsys: pytest.CaptureFixture[str]) -> Run:
    return runner(networked.owner, capsys)


def over_the_pole(path: Path) -> None:
    """A scene of great circles without a centre."""
    one = scenes.circles_over_the_pole()
    with path.open("wb") as stream:
        write_objects(stream, replace(one.scene, name="circles", centre=None), [of_objects(one.areas, one.tracks)])


def test_a_scene_goes_through_spark_and_back(networked: Networked, run: Run, tmp_path: Path, spark: Spark) -> None:
    """Scenes exported, read by workers and over a socket: `detect` finds the conflicts that are written back.

    A second write-back changes nothing. No conflict of an object that was edited in the file is written: it waits for a
    detection. The password of a reader is in no log, neither of this program nor of Spark.
    """
    over_the_pole(tmp_path / "circles.parquet")
    assert run("load", STRAIT, tmp_path / "circles.parquet").code == 0
    with psycopg.connect(networked.owner) as conn:
        conn.execute(ROWS)
    exported = {name: tmp_path / f"{name}.parquet" for name in ("strait", "late")}
    for name, path in exported.items():
        assert run("export", "--scene", name, path).code == 0
    ways = [
        ("strait", networked.reader, ["--scene", "strait"]),
        ("strait", networked.owner, ["--scene", "strait"]),  # over a socket, which Java does not know
        ("circles", networked.reader, ["--scene", "circles"]),
        ("late", networked.owner, ["--input", str(exported["late"])]),
    ]
    edited = pq.read_table(exported["strait"])
    lower = pc.if_else(pc.equal(edited["id"], "FERRY"), pa.scalar(-8.0), edited["floor_m"])
    edited = edited.set_column(edited.schema.get_field_index("floor_m"), "floor_m", lower)
    pq.write_table(edited, tmp_path / "edited.parquet")
    ways.append(("strait", networked.owner, ["--input", str(tmp_path / "edited.parquet")]))
    outputs = [tmp_path / f"{number} {name}" for number, (name, _, _) in enumerate(ways)]
    detect = [["--debug", "--dsn", dsn, "spark", "detect", *given, "--partitions", "2"] for _, dsn, given in ways]
    commands = [[*command, "--output", str(output)] for command, output in zip(detect, outputs, strict=True)]
    commands.append(["--dsn", networked.reader, "spark", "detect", "--scene", "no", "--output", str(tmp_path / "no")])
    *done, refused = spark.run(commands)
    assert [code for code, _ in done] == [0] * len(done), done
    assert refused[0] == 4
    assert "is not in this database" in refused[1]
    logs = spark.logs()
    # Workers read only the scenes `strait` and `circles`.
    relations = [line for text in logs for line in text.splitlines() if "JDBCRelation" in line]
    assert len({number for line in relations for number in re.findall(r"_read_tracks\((\d+), NULL\)", line)}) == 2
    assert not any(PASSWORD in text for text in [*logs, *(text for _, text in done)])

    written = run("spark", "write-back", "--scene", "strait", outputs.pop())
    assert written.code == 0
    assert "1 objects are not what was computed" in written.err
    assert known(run, "strait")
    assert "FERRY" not in {row[key] for row in known(run, "strait") for key in ("a_key", "b_key")}
    for name, output in zip((name for name, _, _ in ways), outputs, strict=False):
        written = run("spark", "write-back", "--scene", name, output)
        assert (written.code, written.err) == (0, "")
        found = known(run, name)
        assert found
        assert "0 opened, 0 changed, 0 closed" in run("spark", "write-back", "--scene", name, output).out
        copy = tmp_path / "copy.parquet"
        assert run("export", "--scene", name, copy).code == 0
        assert run("detect", copy, "--scene", "copy", "--replace").code == 0
        assert known(run, "copy") == found
        run("detect", "--scene", name, "--full")
        assert known(run, name) == found


def test_a_schedule_that_is_not_understood_is_unresolved(
    networked: Networked, run: Run, tmp_path: Path, spark: Spark
) -> None:
    """As in a detection of the database, which names it, too."""
    start = datetime(2026, 6, 1, 6, tzinfo=UTC)
    daily = {"rrule": "DTSTART:20260601T060000Z\nRRULE:FREQ=DAILY;COUNT=2", "duration": "PT2H"}
    ships = [Track(key, [(0.1, lat), (0.4, lat)], [start, start + timedelta(hours=1)], SHIP) for key, lat in LATITUDES]
    areas = [
        Area(f"around {key}", shapely.box(0.2, lat - 0.05, 0.3, lat + 0.05), schedule=daily) for key, lat in LATITUDES
    ]
    with connect(networked.owner) as db:
        scene = db.scene("plans")
        scene.put([*ships, *areas[:2], replace(areas[2], key="A")], Scene("plans"))
        db.connection.execute("UPDATE conflictdb.area SET schedule = %s WHERE key = 'A'", ['{"notam": "WHENEVER"}'])
        db.connection.execute("UPDATE conflictdb.track SET schedule = %s WHERE key = 'S'", ['{"notam": "WHENEVER"}'])
        db.connection.commit()
        scene.detect()
        verdicts = {(one.a_key, one.b_key): one.verdict for one in scene.conflicts()}
    output = tmp_path / "found"
    detect = ["--dsn", networked.reader, "spark", "detect", "--scene", "plans", "--output", str(output)]
    ((code, said),) = spark.run([detect])
    assert code == 0, said
    assert "area 'A', track 'S': schedule is not understood" in said
    found = {(row["a_key"], row["b_key"]): row["verdict"] for row in pq.read_table(output).to_pylist()}
    assert found == {pair: str(verdict) for pair, verdict in verdicts.items()}
    assert "unresolved" in found.values()
    assert "conflict" in found.values()
    written = run("spark", "write-back", "--scene", "plans", output)
    assert (written.code, written.err) == (0, "")
    assert "0 opened, 0 changed, 0 closed" in written.out


def test_readers_see_the_state_that_is_shared(dsn: str) -> None:
    """Others read the very objects that there were, by parts; rows of another state are refused."""
    with connect(dsn) as db, psycopg.connect(dsn) as reader, psycopg.connect(dsn, autocommit=True) as editor:
        name = db.load(STRAIT).name
        number = store.scene_id(db.connection, name)
        with store.snapshot(db.connection):
            before = [to_rows(one) for one in store.each_object(db.connection, number)]
        with store.shared_snapshot(db.connection) as shared:
            editor.execute("DELETE FROM conflictdb.track WHERE key = 'FERRY'")
            editor.execute("UPDATE conflictdb.area SET ceiling_m = 7 WHERE key = 'DIVING'")
            reader.execute(shared.begin)
            read = [rows_of(reader, number, kind, shared) for kind in Kind]
            assert [to_rows(one) for one in read] == before
            first = {kind: store.firsts(db.connection, number, kind, 3) for kind in Kind}
        assert {kind: len(of) for kind, of in first.items()} == {Kind.AREA: 2, Kind.TRACK: 3}
        assert first[Kind.TRACK] == read[1].object_id[::3].tolist()
        reader.rollback()
        with pytest.raises(StoreError, match="did not read the state"):
            rows_of(reader, number, Kind.AREA, shared)


def rows_of(reader: psycopg.Connection[Any], number: int, kind: Kind, shared: store.Shared) -> store.Numbered:
    """The objects of a kind as another program reads them."""
    cursor = reader.execute(store.query(number, kind).encode(), binary=True)
    names = [column.name for column in cursor.description or ()]
    columns = dict(zip(names, zip(*cursor.fetchall(), strict=True), strict=True))
    store.require_state(columns.pop("state"), shared)
    is_bytes = {name: isinstance(values[0], bytes) for name, values in columns.items()}
    return store.numbered(
        kind,
        {name: np.array(values) for name, values in columns.items() if not is_bytes[name]},
        {name: values for name, values in columns.items() if is_bytes[name]},
    )


def to_rows(of: store.Numbered) -> list[dict[str, Any]]:
    """Objects as rows, without names and properties."""
    return of_objects(of.areas, of.tracks, of.object_id, of.version).drop_columns(["name", "properties"]).to_pylist()
