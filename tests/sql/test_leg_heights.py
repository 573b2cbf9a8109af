"""Heights per leg in SQL: stored, read back, checked, and used by pieces and conflicts."""

from datetime import timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
from psycopg.rows import dict_row

from conflictdb import connect, solve, store

Conn = psycopg.Connection[Any]

PATH = "track_path('SRID=4326;LINESTRING(4 57, 4.5 57.1, 5 57)', ARRAY['2026-03-01 00:00+00', '2026-03-01 01:00+00',"
PATH += " '2026-03-01 02:00+00']::timestamptz[])"
PUT = f"SELECT put_track('s', 'T', {PATH}, rectangle_outline(50, 50, 20, 20), "
LATE = "'[2026-03-01 00:40+00, 2026-03-01 01:20+00)'"
WHOLE = "'SRID=4326;POLYGON((3 56, 6 56, 6 58, 3 58, 3 56))'"


@pytest.fixture
def scene(rolled_back: Conn) -> Conn:
    rolled_back.execute("SELECT create_scene('s')")
    return rolled_back


def put(conn: Conn, more: str) -> None:
    conn.execute((PUT + more + ")").encode())


def test_a_track_has_the_band_of_all_its_legs(scene: Conn) -> None:
    put(scene, "p_floors_m => '{0, 200}', p_ceilings_m => '{100, NULL}'")
    row = scene.execute("SELECT floor_m, ceiling_m, floors_m, ceilings_m FROM track").fetchone()
    assert row == (0.0, None, [0.0, 200.0], [100.0, None])


def test_heights_at_an_instant(scene: Conn) -> None:
    put(scene, "p_floors_m => '{0, 200}', p_ceilings_m => '{100, NULL}'")
    at = {
        "2026-02-28 23:59": (None, None),
        "2026-03-01 00:00": (0.0, 100.0),
        "2026-03-01 00:59": (0.0, 100.0),
        "2026-03-01 01:00": (0.0, None),
        "2026-03-01 01:01": (200.0, None),
        "2026-03-01 02:01": (None, None),
    }
    for instant, band in at.items():
        assert scene.execute("SELECT * FROM heights_at('s', 'T', %s)", [f"{instant}+00"]).fetchone() == band, instant


def test_putting_the_same_again_changes_nothing_and_other_heights_do(scene: Conn) -> None:
    def version() -> int:
        return int(scene.execute("SELECT version FROM track").fetchone()[0])  # type: ignore[index]

    put(scene, "p_floors_m => '{0, 200}'")
    first = version()
    put(scene, "p_floors_m => '{0, 200}'")
    assert version() == first
    put(scene, "p_floors_m => '{0, 201}'")
    second = version()
    assert second > first
    scene.execute("UPDATE track SET floors_m = '{-5, 201}'")
    assert scene.execute("SELECT floor_m FROM track").fetchone() == (-5.0,)
    assert version() > second
    put(scene, "p_floor_m => 7")
    assert scene.execute("SELECT floor_m, floors_m FROM track").fetchone() == (7.0, None)


@pytest.mark.parametrize(
    ("more", "rule"),
    [
        ("p_floors_m => '[0:1]={1,2}'", "must be one per leg"),
        ("p_ceilings_m => '{{1},{2}}'", "must be one per leg"),
        ("p_floors_m => '{0, infinity}'", "heights must be finite"),
    ],
)
def test_arrays_that_are_no_lists_of_heights_are_refused(scene: Conn, more: str, rule: str) -> None:
    with pytest.raises(psycopg.Error) as caught:
        put(scene, more)
    assert caught.value.sqlstate == "ZC004"
    assert rule in str(caught.value)


def test_another_height_of_the_whole_alone_is_refused(scene: Conn) -> None:
    put(scene, "p_floors_m => '{0, 200}'")
    with pytest.raises(psycopg.Error, match="must be that of all legs"):
        scene.execute("UPDATE track SET floor_m = 100")


def test_conflicts_follow_the_heights_of_legs(dsn: str, tmp_path: Any) -> None:
    with psycopg.connect(dsn, autocommit=True, options="-c search_path=conflictdb,conflictdb_internal,public") as conn:
        conn.execute("SELECT create_scene('s')")
        put(conn, "p_floors_m => '{0, 200}', p_ceilings_m => '{100, 300}'")
        conn.execute(f"SELECT put_area('s', 'low', {WHOLE}, NULL, 50, 150)".encode())
        conn.execute(f"SELECT put_area('s', 'high', {WHOLE}, NULL, 150, 250)".encode())
        conn.execute(f"SELECT put_area('s', 'between', {WHOLE}, NULL, 100, 200)".encode())
    with connect(dsn) as db:
        db.scene("s").detect(method="exact")
        found = {
            c.a_key: [(a.isoformat()[11:16], b.isoformat()[11:16]) for a, b in c.periods]
            for c in db.scene("s").conflicts()
            if c.b_key == "T"
        }
        assert {key: starts[0][0] for key, starts in found.items() if starts} == {"low": "00:00", "high": "01:00"}
        assert found["low"][0][1] == "01:00"
        with db.connection.cursor(row_factory=dict_row) as cursor:
            pieces = cursor.execute("SELECT DISTINCT floor_m, ceiling_m FROM conflictdb.piece WHERE object_kind = 1")
            assert {(row["floor_m"], row["ceiling_m"]) for row in pieces} == {(0.0, 100.0), (200.0, 300.0)}
        # One leg climbs: only then are its pairs other ones.
        db.connection.execute("UPDATE conflictdb.track SET floors_m = '{400, 200}', ceilings_m = '{500, 300}'")
        db.connection.commit()
        run = db.scene("s").detect()
        assert (run.opened, run.closed) == (0, 1)
        path = tmp_path / "out.geojson"
        db.scene("s").export(path)
        assert db.load_files([path])[0].counts == store.LoadCounts(0, 0, 0, 4)
        _, _, (track,) = store.read_scene(db.connection, "s")
        assert np.array_equal(track.floors_m, [400.0, 200.0])


def test_heights_of_waypoints_change_along_legs(dsn: str) -> None:
    """Stored pieces keep the climb: detections of few changes, in full, and in memory agree; so does heights_at."""
    with psycopg.connect(dsn, autocommit=True, options="-c search_path=conflictdb,conflictdb_internal,public") as conn:
        conn.execute("SELECT create_scene('s')")
        put(conn, "p_floors_m => '{0, 1000, 400}', p_ceilings_m => '{100, 1100, NULL}'")
        conn.execute(f"SELECT put_area('s', 'A', {WHOLE}, NULL, 300, 500)".encode())
        conn.execute(f"SELECT put_area('s', 'never', {WHOLE}, NULL, -300, 0)".encode())
        bands = {"00:00": (0.0, 100.0), "00:30": (500.0, 600.0), "01:00": (1000.0, None), "01:30": (700.0, None)}
        for at, band in bands.items():
            found = conn.execute("SELECT * FROM heights_at('s', 'T', %s)", [f"2026-03-01 {at}+00"]).fetchone()
            assert found == band, at
        rows = conn.execute(
            "SELECT floor_m, ceiling_m FROM havens('s', '2026-03-01 00:00+00', '2026-03-01 01:30+00', '30 min')"
        ).fetchall()
        assert rows == [(0.0, 100.0), (500.0, 600.0), (1000.0, None), (700.0, None)]
    with connect(dsn) as db:
        scene = db.scene("s")
        scene.detect()
        (few,) = [(c.a_key, c.b_key, c.periods) for c in scene.conflicts()]
        rounding = timedelta(milliseconds=1)
        starts = [((start + rounding).strftime("%H:%M"), end.strftime("%H:%M")) for start, end in few[2]]
        assert starts == [("00:12", "00:30"), ("01:50", "02:00")]
        scene.detect(full=True)
        assert [(c.a_key, c.b_key, c.periods) for c in scene.conflicts()] == [few]
        stored, areas, tracks = store.read_scene(db.connection, "s")
        (alone,) = solve(tracks, areas, stored)
        assert alone.periods == few[2]
        climbs = db.connection.execute("SELECT climb FROM conflictdb.piece WHERE object_kind = 1").fetchall()
        assert [1000.0, 400.0, float("inf"), float("inf")] in [row[0] for row in climbs]
        (one,) = db.connection.execute("SELECT conflictdb.explain_conflict('s', 'T', 'never')").fetchone()
        assert one["decided_by"] == {"stage": 1, "by": "height"}
        db.connection.execute(f"SELECT conflictdb.put_area('s', 'never', {WHOLE}, {LATE}, 0, 500)".encode())
        db.connection.commit()
        scene.detect()
        (one,) = db.connection.execute("SELECT conflictdb.explain_conflict('s', 'T', 'never')").fetchone()
        assert (one["verdict"], one["further_than_m"]) == ("apart", None)
        assert one["why"].endswith("while their heights overlap")
