"""Limits of vertices and waypoints: settings of the database, the same rule for objects from any source."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely

from conflictdb.client.database import connect
from conflictdb.errors import InvalidInput
from conflictdb.model import plan_rules
from conflictdb.model.plans import MAX_POINTS, Area, Track

Conn = psycopg.Connection[Any]
SQUARE = "SRID=4326;POLYGON((0 0, 0 1, 1 1, 1 0, 0 0))"
TRACK = "ST_GeomFromEWKT('SRID=4326;LINESTRINGM(0 0 0, 1 1 6000, 2 2 12000)')"
LOWER = """DO $$ BEGIN
    EXECUTE format('ALTER DATABASE %I SET conflictdb.max_vertices = 4', current_database());
END $$"""
POINT = "ST_MakePolygon(ST_GeomFromText('LINESTRING(0 0, 0 0, 0 0, 0 0)'))"


@pytest.fixture
def scene(conn: Conn) -> Conn:
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute("SELECT conflictdb.put_area('s', 'there before', %s)", [SQUARE])
    conn.execute("SET LOCAL conflictdb.max_vertices = 4; SET LOCAL conflictdb.max_waypoints = 2")
    return conn


@pytest.mark.parametrize(
    ("statement", "who", "field"),
    [
        (f"SELECT conflictdb.put_area('s', 'A', '{SQUARE}')", "area 'A'", "footprint"),
        (
            f"INSERT INTO conflictdb.area (scene_id, key, footprint) SELECT 1, 'A', ST_Multi('{SQUARE}')",
            "area 'A'",
            "footprint",
        ),
        (f"SELECT conflictdb.put_track('s', 'T', {TRACK}, {POINT})", "track 'T'", "path"),
        (f"SELECT conflictdb.probe('s', '{SQUARE}')", "what is asked about", "geometry"),
        (f"SELECT conflictdb.request_probe('s', '{SQUARE}')", "what is asked about", "geometry"),
        (f"SELECT conflictdb.request_track_probe('s', {TRACK}, {POINT})", "what is asked about", "path"),
    ],
)
def test_too_many_are_refused_with_what_and_the_remedy(scene: Conn, statement: str, who: str, field: str) -> None:
    limit, most, what = ("max_waypoints", 2, "waypoints") if field == "path" else ("max_vertices", 4, "vertices")
    with pytest.raises(psycopg.Error) as refused:
        scene.execute(statement.encode())
    diag = refused.value.diag
    got = {"max_waypoints": 3, "max_vertices": 5}[limit]
    assert (diag.sqlstate, diag.table_name, diag.column_name) == ("ZC017", who, field)
    assert diag.message_primary == f"{who}: {field}: must have at most {most} {what}; got {got}"
    assert f"conflictdb.{limit} is the limit" in (diag.message_hint or "")


def test_outlines_of_waypoints_count_together(scene: Conn) -> None:
    scene.execute("SET LOCAL conflictdb.max_waypoints = 3")
    with pytest.raises(psycopg.Error, match="outlines: must have at most 4 vertices; got 12"):
        scene.execute(
            f"SELECT conflictdb.put_track('s', 'T', {TRACK}, NULL, p_outlines => ST_Collect(ARRAY[{POINT}, "
            f"{POINT}, {POINT}]))".encode()
        )


def test_what_is_there_already_may_stay(scene: Conn) -> None:
    scene.execute("UPDATE conflictdb.area SET name = 'Renamed'")


def test_a_limit_that_is_no_number_is_named(scene: Conn) -> None:
    scene.execute("SET LOCAL conflictdb.max_vertices = 'many'")
    with pytest.raises(psycopg.Error, match=r"setting conflictdb.max_vertices: .* 0 to 1000000; got 'many'") as refused:
        scene.execute("SELECT conflictdb.put_area('s', 'A', %s)", [SQUARE])
    assert refused.value.sqlstate == "ZC009"


def test_no_setting_lifts_the_limit_of_python(conn: Conn) -> None:
    source = "SELECT prosrc FROM pg_proc WHERE oid = 'conflictdb_internal._limit'::regproc"
    row = conn.execute(source.encode()).fetchone()
    assert row is not None
    assert f"c_most CONSTANT integer := {MAX_POINTS};" in row[0]
    conn.execute("SET LOCAL conflictdb.max_vertices = '999999999'")
    check = "SELECT conflictdb_internal._check_size('area A', 'footprint', %s, 'max_vertices')"
    conn.execute(check.encode(), [MAX_POINTS])
    with pytest.raises(psycopg.Error, match=f"at most {MAX_POINTS} vertices"):
        conn.execute(check.encode(), [MAX_POINTS + 1])


def test_a_haven_has_no_more_corners_than_the_kernel_takes(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    ring = "ST_ExteriorRing(ST_Buffer(ST_GeomFromText('POINT(0 0)'), 1000, 2501))"
    with pytest.raises(psycopg.Error, match="outline: must have at most 10000 corners; got 10004") as refused:
        conn.execute(f"SELECT conflictdb.put_track('s', 'T', {TRACK}, ST_MakePolygon({ring}))".encode())
    assert refused.value.sqlstate == "ZC006"


def test_files_are_held_to_the_limit_of_the_database(dsn: str, tmp_path: Path) -> None:
    feature = {
        "type": "Feature",
        "id": "A",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]},
    }
    file = tmp_path / "plans.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(LOWER.encode())
    with connect(dsn) as db, pytest.raises(InvalidInput, match="must have at most 4 vertices; got 5"):
        db.load(file)


def test_python_has_the_same_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_rules, "MAX_POINTS", 4)
    with pytest.raises(InvalidInput, match=r"area 'A'.*must have at most 4 vertices; got 5 .*split"):
        Area("A", shapely.box(0, 0, 1, 1))
    line, point = np.zeros((5, 2)) + np.arange(5)[:, None], np.zeros((1, 2))
    with pytest.raises(InvalidInput, match=r"track 'T'.*must have at most 4 waypoints; got 5"):
        Track("T", line, np.arange(5), point)
    with pytest.raises(InvalidInput, match="outlines_m: must have at most 4 vertices; got 6"):
        Track(
            "T",
            line[:2],
            np.arange(2),
            outlines := np.array([[0, 0], [1, 0], [0, 1.0]]),
            outlines_m=np.array([outlines, outlines]),
        )


def test_rows_of_attached_tables_are_held_to_it_without_failing(dsn: str) -> None:
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute("SELECT conflictdb.create_scene('s')")
        conn.execute("CREATE TABLE ops (id text PRIMARY KEY, shape geometry(Polygon, 4326))")
        conn.execute("INSERT INTO ops VALUES ('big', %s)", [SQUARE])
        conn.execute("INSERT INTO ops VALUES ('small', 'SRID=4326;POLYGON((0 0, 0 1, 1 1, 0 0))')")
        conn.execute(LOWER.encode())
    with connect(dsn) as db:
        db.scene("s").attach("area", "ops", {"key": "id", "footprint": "shape"})
        db.scene("s").follow()
        assert db.connection.execute("SELECT key FROM conflictdb.area").fetchall() == [("small",)]
        db.connection.rollback()
        (row,) = db.scene("s").unmapped()
        assert "must have at most 4 vertices; got 5" in row.reason
