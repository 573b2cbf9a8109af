"""Limits: rows that only administrators write, which settings lower; the same rule for objects from any source."""

import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from patience import until

from conflictdb.client.database import connect
from conflictdb.errors import InvalidInput
from conflictdb.formats import scene_text, write_lines
from conflictdb.model import plan_rules
from conflictdb.model.plans import MAX_POINTS, Area, Scene, Track

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


def chosen(dsn: str, name: str, value: float | None) -> None:
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute("SELECT conflictdb.set_limit(%s, %s)", [name, value])


def role_of(conn: Conn, group: str) -> str:
    """Create a role of this transaction with the rights of a group, and return its name."""
    name = f"limits_{group}"
    conn.execute(f"CREATE ROLE {name} LOGIN IN ROLE conflictdb_{group}".encode())
    return name


def limits(conn: Conn) -> dict[str, float | None]:
    return dict(conn.execute("SELECT name, value FROM conflictdb.limits").fetchall())


def test_defaults_are_listed(conn: Conn) -> None:
    infinite = float("inf")
    assert limits(conn) == {
        "max_vertices": MAX_POINTS, "max_waypoints": MAX_POINTS, "max_days_ahead": None, "max_speed_kn": infinite,
    }  # fmt: skip
    assert conn.execute("SELECT count(*) FROM conflictdb.upper_limit").fetchone() == (0,)


def test_an_administrator_sets_and_resets_a_limit(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute("SELECT conflictdb.set_limit('max_vertices', 4)")
    assert limits(conn)["max_vertices"] == 4
    with pytest.raises(psycopg.Error, match="must have at most 4 vertices; got 5"), conn.transaction():
        conn.execute("SELECT conflictdb.put_area('s', 'A', %s)", [SQUARE])
    conn.execute("SELECT conflictdb.set_limit('max_vertices', NULL)")
    assert limits(conn)["max_vertices"] == MAX_POINTS
    conn.execute("SELECT conflictdb.put_area('s', 'A', %s)", [SQUARE])


def test_two_administrators_set_a_limit(dsn: str) -> None:
    """The second one waits, and wins."""
    waits = "SELECT cardinality(pg_blocking_pids(%s))"
    with psycopg.connect(dsn, autocommit=True) as first, psycopg.connect(dsn, autocommit=True) as second:
        for before in (None, 9):
            first.execute("SELECT conflictdb.set_limit('max_vertices', %s)", [before])
            setting = threading.Thread(target=second.execute, args=["SELECT conflictdb.set_limit('max_vertices', 5)"])
            with first.transaction():
                first.execute("SELECT conflictdb.set_limit('max_vertices', 4)")
                setting.start()
                until(lambda: first.execute(waits.encode(), [second.info.backend_pid]).fetchone() != (0,))
            setting.join()
            assert limits(first)["max_vertices"] == 5


def test_new_tracks_below_a_limit_of_speed_are_checked_together(conn: Conn) -> None:
    """The limit is read once for all rows, each of which passes without the checks one by one."""
    conn.execute("SELECT conflictdb.create_scene('s'); SET LOCAL track_functions = 'all'")
    insert = f"""INSERT INTO conflictdb.track (scene_id, key, path, outline)
                 SELECT s.scene_id, %s || n, {TRACK}, {POINT} FROM conflictdb.scene s, generate_series(1, 50) n"""
    called = """SELECT funcname, calls FROM pg_stat_xact_user_functions
                WHERE funcname IN ('_limit', '_check_track_shape')"""
    conn.execute("SELECT conflictdb.set_limit('max_speed_kn', 60)")
    conn.execute(insert.encode(), ["slow"])
    assert conn.execute(called.encode()).fetchall() == [("_limit", 2)]
    conn.execute("SELECT conflictdb.set_limit('max_speed_kn', 40)")
    with pytest.raises(psycopg.Error, match=r"track 'fast1': path: the leg to times\[1\] .* 51 kn, beyond 40 kn"):
        conn.execute(insert.encode(), ["fast"])


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("max_vertexes", 4, "'max_vertexes' is not known"),
        (None, 4, "NULL is not known"),
        ("max_vertices", -1, "from 0 to 1000000; got -1"),
        ("max_vertices", 1.5, "from 0 to 1000000; got 1.5"),
        ("max_waypoints", MAX_POINTS + 1, "from 0 to 1000000; got 1000001"),
        ("max_days_ahead", float("nan"), "number of days from 0 to 999999; got NaN"),
        ("max_days_ahead", float("inf"), "number of days from 0 to 999999; got Infinity"),
    ],
)
def test_a_limit_that_is_none_is_refused(conn: Conn, name: str | None, value: float, said: str) -> None:
    with pytest.raises(psycopg.Error, match=said) as refused:
        conn.execute("SELECT conflictdb.set_limit(%s, %s)", [name, value])
    assert refused.value.sqlstate == "ZC009"


@pytest.mark.parametrize("group", ["reader", "editor", "worker"])
def test_only_administrators_write_limits(conn: Conn, group: str) -> None:
    """Not even for the time until an error."""
    conn.execute("SELECT conflictdb.set_limit('max_vertices', 4)")
    conn.execute(f"SET LOCAL ROLE {role_of(conn, group)}".encode())
    assert limits(conn)["max_vertices"] == 4
    for attempt in (
        "SELECT conflictdb.set_limit('max_vertices', 5)",
        "INSERT INTO conflictdb.upper_limit VALUES ('max_waypoints', 5)",
        "UPDATE conflictdb.upper_limit SET value = 5",
        "DELETE FROM conflictdb.upper_limit",
        "TRUNCATE conflictdb.upper_limit",
    ):
        with pytest.raises(psycopg.errors.InsufficientPrivilege), conn.transaction():
            conn.execute(attempt.encode())


def _put_by(dsn: str, role: str, *, options: str = "", before: str = "") -> None:
    """Put an area of five vertices as a role that logs in, with options of its connection, after a statement."""
    with psycopg.connect(dsn, user=role, options=options) as conn:
        if before:
            conn.execute(before.encode())
        conn.execute("SELECT conflictdb.put_area('s', 'A', %s)", [SQUARE])
        conn.rollback()


@pytest.fixture
def editor(dsn: str) -> Iterator[str]:
    """A role that logs in; the limit is four vertices, two days and ten knots."""
    name = f"limits_{os.getpid()}"
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.share_scene('s', 'public', 'write')")
        for limit, value in (("max_vertices", 4), ("max_waypoints", 2), ("max_days_ahead", 2), ("max_speed_kn", 10)):
            conn.execute("SELECT conflictdb.set_limit(%s, %s)", [limit, value])
        conn.execute(f"CREATE ROLE {name} LOGIN IN ROLE conflictdb_editor".encode())
        try:
            yield name
        finally:
            conn.execute(f"DROP ROLE {name}".encode())


@pytest.mark.parametrize("value", ["5", "1000000", "999999999"])
@pytest.mark.parametrize("protected", [False, True])
def test_an_editor_cannot_raise_a_limit(dsn: str, editor: str, value: str, protected: bool) -> None:
    """By SET, by a setting of its role, of the database, or by an option of its connection, as poolers pass it."""
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute("SELECT conflictdb.protect_scenes(%s)", [protected])
    ways: list[dict[str, str]] = [
        {"before": f"SET conflictdb.max_vertices = {value}"},
        {"before": f"SELECT set_config('conflictdb.max_vertices', '{value}', true)"},
        {"options": f"-c conflictdb.max_vertices={value}"},
    ]
    for way in ways:
        with pytest.raises(psycopg.Error, match="must have at most 4 vertices; got 5"):
            _put_by(dsn, editor, **way)
    with psycopg.connect(dsn, autocommit=True) as conn:
        # Also where an administrator set it so.
        conn.execute(f"ALTER ROLE {editor} SET conflictdb.max_vertices = {value}".encode())
    with pytest.raises(psycopg.Error, match="must have at most 4 vertices; got 5"):
        _put_by(dsn, editor)
    with psycopg.connect(dsn, user=editor, autocommit=True) as conn:
        assert conn.execute("SHOW conflictdb.max_vertices").fetchone() == (value,)
        for whom in (f"ROLE {editor}", f"DATABASE {conn.info.dbname}"):
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                conn.execute(f"ALTER {whom} SET conflictdb.max_vertices = {value}".encode())


def test_an_editor_cannot_raise_the_other_limits(dsn: str, editor: str) -> None:
    with psycopg.connect(dsn, user=editor) as conn:
        for name, value, most in (("max_waypoints", "7", 2), ("max_days_ahead", "7", 2), ("max_speed_kn", "5000", 10)):
            for given in (value, "infinity") if name == "max_speed_kn" else (value,):
                conn.execute("SELECT set_config(%s, %s, true)", [f"conflictdb.{name}", given])
                assert conn.execute("SELECT conflictdb_internal._limit(%s)", [name]).fetchone() == (most,)
            conn.execute("SELECT set_config(%s, '1', true)", [f"conflictdb.{name}"])
            assert conn.execute("SELECT conflictdb_internal._limit(%s)", [name]).fetchone() == (1,)


def test_a_load_is_held_to_the_limit_of_speed(dsn: str, editor: str, tmp_path: Path) -> None:
    """A file is read under a limit of its own, which does not raise the database's."""
    file = tmp_path / "fast.geojson"
    fast = Track("T", np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([0, 3_600_000_000]), np.zeros((1, 2)))
    write_lines(file, scene_text(Scene("s"), [], [fast]))
    with connect(psycopg.conninfo.make_conninfo(dsn, user=editor)) as db:
        with pytest.raises(InvalidInput, match="travelled at 60 kn, beyond 10 kn"):
            db.scene("s").put(fast)
        with pytest.raises(InvalidInput, match="travelled at 60 kn, beyond 10 kn"):
            db.load(file)
    chosen(dsn, "max_speed_kn", None)
    with connect(psycopg.conninfo.make_conninfo(dsn, user=editor)) as db:
        db.scene("s").put(fast)


def test_objects_above_a_new_limit_stay_and_are_restored(dsn: str) -> None:
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute("SELECT conflictdb.create_scene('s')")
        conn.execute("SELECT conflictdb.put_area('s', 'A', %s)", [SQUARE])
        conn.execute(f"SELECT conflictdb.put_track('s', 'T', {TRACK}, {POINT})".encode())
        conn.execute("SELECT conflictdb.set_limit('max_vertices', 4), conflictdb.set_limit('max_waypoints', 2)")
        conn.execute("UPDATE conflictdb.area SET name = 'Renamed'; UPDATE conflictdb.track SET name = 'Renamed'")
        conn.execute("CREATE TABLE a AS TABLE conflictdb.area; CREATE TABLE t AS TABLE conflictdb.track")
        conn.execute("DELETE FROM conflictdb.area; DELETE FROM conflictdb.track")
        # As the data of a dump, which bring first_version.
        conn.execute("INSERT INTO conflictdb.area OVERRIDING SYSTEM VALUE TABLE a")
        conn.execute("INSERT INTO conflictdb.track OVERRIDING SYSTEM VALUE TABLE t")
        assert conn.execute("SELECT count(*) FROM conflictdb.area").fetchone() == (1,)
