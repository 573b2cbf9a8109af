"""Tolerances of tracks in the database: stored, checked, detected, exported and copied."""

from typing import Any

import psycopg
import pytest

from conflictdb import connect, solve
from conflictdb.db import store

PATH = "track_path('SRID=4326;LINESTRING(4 57, 4.5 57.1, 5 57)', ARRAY['2026-03-01 00:00+00', '2026-03-01 02:00+00',"
PATH += " '2026-03-01 04:00+00']::timestamptz[])"
PUT = f"SELECT put_track('s', 'T', {PATH}, rectangle_outline(150, 150, 20, 20), p_tolerances => %s)"
BESIDE = (
    "SELECT put_area('s', 'A', 'SRID=4326;POLYGON((4.2 57.055, 4.22 57.055, 4.22 57.07, 4.2 57.07, 4.2 57.055))', %s)"
)
WIDE = '{"xtd_port_m": [2000, 0], "departure_window": ["2026-02-28T23:30Z", "2026-03-01T00:00Z"], "max_speed_kn": 25}'


@pytest.mark.parametrize(
    ("tolerances", "rule"),
    [
        ('{"xtd": 5}', "'xtd' is not known"),
        ("[]", "must be a JSON object"),
        ('{"xtd_port_m": -1}', "must be a number from 0 to 18520; got -1"),
        ('{"xtd_port_m": 740800}', "must be a number from 0 to 18520; got 740800"),
        ('{"xtd_port_m": [1, 2, 3]}', "must be one number, or 2"),
        ('{"turn_radius_m": [1, 2]}', "must be one number, or 1"),
        ('{"max_speed_kn": 0}', "must be a number from 0"),
        ('{"max_speed_kn": "fast"}', "must be a number from 0"),
        ('{"departure_window": ["2026-03-01T01:00Z", "2026-03-01T02:00Z"]}', "planned time of its waypoint"),
        ('{"arrival_window": ["soon", "later"]}', "must be two instants"),
        ('{"arrival_window": 5}', "must be [earliest, latest]"),
    ],
)
def test_wrong_tolerances_are_refused(rolled_back: psycopg.Connection[Any], tolerances: str, rule: str) -> None:
    rolled_back.execute("SELECT create_scene('s')")
    with pytest.raises(psycopg.Error) as caught:
        rolled_back.execute(PUT.encode(), [tolerances])
    assert caught.value.sqlstate == "ZC007"
    assert rule in str(caught.value)


def test_detections_protect_every_voyage(dsn: str, tmp_path: Any) -> None:
    """Few changes, all objects, memory, and a file loaded again give one answer; a change of tolerances marks."""
    with psycopg.connect(dsn, autocommit=True, options="-c search_path=conflictdb,conflictdb_internal,public") as conn:
        conn.execute("SELECT create_scene('s')")
        conn.execute(PUT.encode(), [None])
        conn.execute(BESIDE.encode(), ["[2026-02-28 00:00+00, 2026-03-01 00:20+00)"])
    with connect(dsn) as db:
        scene = db.scene("s")
        scene.detect()
        assert scene.conflicts() == []
        db.connection.execute("UPDATE conflictdb.track SET tolerances = %s", [WIDE])
        db.connection.commit()
        scene.detect()
        (few,) = scene.conflicts()
        assert few.verdict == "conflict"
        scene.detect(full=True)
        assert [one.periods for one in scene.conflicts()] == [few.periods]
        stored, areas, tracks = store.read_scene(db.connection, "s")
        assert tracks[0].tolerances is not None
        assert [one.periods for one in solve(tracks, areas, stored)] == [few.periods]
        path = tmp_path / "s.geojson"
        scene.export(path)
        assert db.load_files([path])[0].counts == store.LoadCounts(0, 0, 0, 2)
        db.connection.execute("SELECT conflictdb.copy_scene('s', 'copy')")
        db.connection.commit()
        db.scene("copy").detect()
        assert [one.periods for one in db.scene("copy").conflicts()] == [few.periods]
