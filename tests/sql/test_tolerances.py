"""Tolerances of tracks in the database: stored, checked, detected, exported and copied."""

from pathlib import Path
from typing import Any

import psycopg
import pytest
import shapely

from conflictdb import Area, connect, solve, store
from conflictdb.jobs.probes import answer
from conflictdb.model.results import Certainty

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
        ("[]", "must be a JSON object"),
        ('{"max_speed_kn": "fast"}', "must be a number from 0"),
        ('{"arrival_window": 5}', "must be [earliest, latest]"),
    ],
)
def test_tolerances_of_other_types_are_refused(
    rolled_back: psycopg.Connection[Any], tolerances: str, rule: str
) -> None:
    rolled_back.execute("SELECT create_scene('s')")
    with pytest.raises(psycopg.Error) as caught:
        rolled_back.execute(PUT.encode(), [tolerances])
    assert caught.value.sqlstate == "ZC007"
    assert rule in str(caught.value)


def test_detections_protect_every_voyage(dsn: str, tmp_path: Path) -> None:
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


ACROSS = (
    "SELECT put_area('s', 'across', 'SRID=4326;POLYGON((4.2 56.9, 4.21 56.9, 4.21 57.2, 4.2 57.2, 4.2 56.9))', NULL)"
)
COLUMN = 'SELECT a_key, certainty FROM conflictdb.conflicts ORDER BY a_key COLLATE "C", b_key COLLATE "C"'


def test_conflicts_say_whether_all_voyages_conflict(dsn: str, tmp_path: Path) -> None:
    """The same in SQL, Python, files, explanations, reports and probes, after any detection."""
    with psycopg.connect(dsn, autocommit=True, options="-c search_path=conflictdb,conflictdb_internal,public") as conn:
        conn.execute("SELECT create_scene('s')")
        conn.execute(PUT.encode(), [WIDE])
        conn.execute(BESIDE.encode(), ["[2026-02-28 00:00+00, 2026-03-01 00:20+00)"])
        conn.execute(ACROSS.encode())
        plain = PUT.replace("'T'", "'P'").replace("57.1, 5 57", "57.1, 4.9 57")
        conn.execute(plain.encode(), [None])
    expected = [("A", None), ("A", "may"), ("P", "may"), ("across", None), ("across", "must")]
    with connect(dsn) as db:
        scene = db.scene("s")
        scene.detect()
        found = scene.conflicts()
        rows = db.connection.execute(COLUMN).fetchall()
        db.connection.rollback()
        assert sorted(rows, key=str) == sorted(expected, key=str)
        assert sorted(((one.a_key, one.certainty) for one in found), key=repr) == sorted(
            ((key, None if one is None else Certainty(one)) for key, one in expected), key=repr
        )
        scene.detect(full=True)
        assert db.connection.execute(COLUMN).fetchall() == rows
        db.connection.rollback()
        # Numbers of pieces count from 0 for users.
        must, may = scene.explain("across", "T"), scene.explain("A", "T")
        assert (must.facts["certainty"], may.facts["certainty"]) == ("must", "may")
        assert "on every voyage within the tolerances" in str(must)
        assert "perhaps not on every voyage" in str(may)
        assert all(piece[side] < 1_000 for piece in must.facts["pieces"] for side in "ab")
        probed = scene.probe(Area("X", shapely.MultiPolygon([shapely.box(4.2, 56.9, 4.21, 57.2)])))
        assert sorted((one.b_key, one.certainty) for one in probed if one.b_kind == "track") == [
            ("P", None),
            ("T", "must"),
        ]
        stored, areas, tracks = store.read_scene(db.connection, "s")
        db.connection.rollback()
        solved = solve(tracks, areas, stored)
        assert {(one.a_key, one.b_key, one.certainty) for one in solved} == {
            (one.a_key, one.b_key, one.certainty) for one in found
        }
        # A narrower window: one row changes.
        db.connection.execute(
            "UPDATE conflictdb.track SET tolerances = tolerances || %s WHERE key = 'T'", ['{"max_speed_kn": 20}']
        )
        db.connection.execute("UPDATE conflictdb.area SET active_span = '[2026-02-28 00:00+00, 2026-03-01 00:30+00)'")
        db.connection.commit()
        scene.detect()
        after = {(one.a_key, one.b_key): one.certainty for one in scene.conflicts()}
        scene.detect(full=True)
        assert after == {(one.a_key, one.b_key): one.certainty for one in scene.conflicts()}
        assert after["across", "T"] == "may"


def test_a_worker_answers_with_certainty(dsn: str) -> None:
    with psycopg.connect(dsn, autocommit=True, options="-c search_path=conflictdb,conflictdb_internal,public") as conn:
        conn.execute("SELECT create_scene('s')")
        conn.execute(PUT.encode(), [WIDE])
        with connect(dsn) as db:
            db.scene("s").detect()
        asked = "SELECT request_probe('s', 'SRID=4326;POLYGON((4.2 56.9, 4.21 56.9, 4.21 57.2, 4.2 57.2, 4.2 56.9))')"
        row = conn.execute(asked.encode()).fetchone()
        with connect(dsn) as db:
            assert answer(db.connection) is False
        found = conn.execute("SELECT key, verdict, certainty FROM wait_for_probe(%s)", row).fetchall()
        assert found == [("T", "conflict", "must")]
