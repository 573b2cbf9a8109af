"""Stored plans that recur: spans, departures and schedules, from files, SQL and Python, to conflicts."""

import json
import re
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from psycopg.types.json import Jsonb
from test_recurring import alone, by_object, objects

import conflictdb
from conflictdb import store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.cli import main
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.registry import Setup
from conflictdb.errors import IncompleteWarning, InvalidInput, UnknownScheduleWarning
from conflictdb.jobs import expansion
from conflictdb.jobs.detect import detect, detect_pending
from conflictdb.model.plans import Scene
from conflictdb.model.recurring_plans import later
from conflictdb.model.tolerances import tolerances_of

DAY_US = 86_400_000_000
DAILY = """
INSERT INTO conflictdb.area (scene_id, key, footprint, schedule)
SELECT scene_id, 'S', ST_SetSRID(ST_Multi(ST_MakeEnvelope(0, 50, 1, 51)), 4326), '[{"periods": [["08:00", "16:00"]]}]'
FROM conflictdb.scene WHERE name = 's'
"""
TUESDAYS = {"days": ["TUE"], "periods": [["08:00", "10:00"]], "timezone": "Europe/Zurich"}


def conflicts(conn: psycopg.Connection[Any], scene: str) -> dict[tuple[str, str], Any]:
    with conflictdb.connect(conn) as db:
        return by_object(list(db.scene(scene).conflicts()))


def pending(conn: psycopg.Connection[Any]) -> int:
    conn.commit()
    [count] = conn.execute("SELECT pending FROM conflictdb.scenes").fetchone()  # type: ignore[misc]
    conn.commit()
    return int(count)


@pytest.mark.parametrize("seed", [1, 2])
def test_stored_activations_conflict_as_objects_entered_by_hand(conn: psycopg.Connection[Any], seed: int) -> None:
    areas, tracks = objects(seed)
    store.replace_scene(conn, Scene("recurring"), areas, tracks, merge=False)
    detect(conn, "recurring", few_objects=-1)
    found = conflicts(conn, "recurring")
    assert found == by_object(conflictdb.solve(*reversed(alone(areas, tracks))))
    # An edit of few objects gives what a full detection gives.
    conn.execute(
        "UPDATE conflictdb.area SET activations = activations - '{[2026-05-29 00:00+00, 2026-05-29 12:00+00)}'"
    )
    conn.execute("UPDATE conflictdb.track SET departures = departures[1:2]")
    conn.commit()
    detect(conn, "recurring")
    edited = conflicts(conn, "recurring")
    detect(conn, "recurring", full=True)
    assert conflicts(conn, "recurring") == edited != found
    # Read back, they are the same.
    _, again, sailing = store.read_scene(conn, "recurring")
    assert by_object(conflictdb.solve(sailing, again)) == edited


def feature(key: str, **properties: Any) -> dict[str, Any]:
    ring = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "id": key, "geometry": geometry, "properties": {"kind": "area", **properties}}


def voyage(key: str, **properties: Any) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": [[0.2, 0.5], [0.4, 0.5]]}
    times = ["2026-06-02T06:30:00Z", "2026-06-02T07:00:00Z"]
    own = {"kind": "track", "times": times, "fore_m": 10, "aft_m": 10, "port_m": 5, "starboard_m": 5}
    return {"type": "Feature", "id": key, "geometry": geometry, "properties": own | properties}


def scene_file(folder: Path, *features: dict[str, Any], **settings: Any) -> Path:
    file = folder / "plans.geojson"
    scene = {"name": "plans", **settings}
    file.write_text(json.dumps({"type": "FeatureCollection", "scene": scene, "features": features}))
    return file


def test_a_file_with_recurring_plans_round_trips(conn: psycopg.Connection[Any], tmp_path: Path) -> None:
    spans = [["2026-06-01T00:00:00Z", "2026-06-02T00:00:00Z"], ["2026-06-05T00:00:00Z", None]]
    departures = ["2026-06-02T06:30:00Z", "2026-06-09T06:30:00Z"]
    given = [
        feature("A", spans=spans),
        feature("B", schedule=TUESDAYS, start="2026-06-01T00:00:00Z"),
        feature("C", schedule={"notam": "DAILY SR-SS"}),
        voyage("T", departures=departures),
        voyage("U", schedule={"rrule": "DTSTART:20260602T060000Z\nRRULE:FREQ=DAILY;COUNT=3", "duration": "PT1H"}),
    ]
    with conflictdb.connect(conn) as db:
        db.load(scene_file(tmp_path, *given, horizon_days=30.0))
        db.scene("plans").detect()
        out = tmp_path / "out.geojson"
        db.scene("plans").export(out)
    written = json.loads(out.read_text())
    assert written["scene"]["horizon_days"] == 30.0
    for one, other in zip(given, written["features"], strict=True):
        for name in ("spans", "schedule", "departures", "start", "times"):
            assert other["properties"].get(name) == one["properties"].get(name), (one["id"], name)


def test_a_schedule_is_expanded_and_meets_a_voyage_on_its_days(conn: psycopg.Connection[Any], tmp_path: Path) -> None:
    """A ferry departs daily at 06:30Z; the area is closed on Tuesdays from 08:00 in Zurich, 06:00Z in summer."""
    daily = {"rrule": "DTSTART:20260601T063000Z\nRRULE:FREQ=DAILY;COUNT=15", "duration": "PT1H"}
    file = scene_file(tmp_path, feature("A", schedule=TUESDAYS), voyage("T", schedule=daily), voyage("Once"))
    with conflictdb.connect(conn) as db:
        db.load(file)
        db.scene("plans").detect()
        of_area = [one for one in db.scene("plans").conflicts() if one.a_key == "A"]
    [first, second] = sorted(of_area, key=lambda one: one.b_key)
    assert first.b_key == "Once"
    assert len(first.periods) == 1
    assert [period[0].isoformat() for period in second.periods] == [
        f"2026-06-{day:02}T06:30:00+00:00" for day in (2, 9)
    ]
    state = conn.execute("SELECT expanded_from, expanded_until > now(), pending FROM conflictdb.scenes").fetchone()
    assert state is not None
    assert str(state[0]).startswith("2026-06-02")
    assert state[1:] == (True, 0)
    listed = conn.execute("SELECT key, start_at FROM conflictdb.list_objects('plans') ORDER BY key").fetchall()
    assert listed[0][1].isoformat() >= "2026-06-02T06:00"


def test_the_horizon_advances_and_marks_only_what_changed(conn: psycopg.Connection[Any], tmp_path: Path) -> None:
    ends = {"rrule": "DTSTART:20260602T060000Z\nRRULE:FREQ=DAILY;COUNT=3", "duration": "PT1H"}
    file = scene_file(
        tmp_path, feature("A", schedule=TUESDAYS), feature("B", schedule=ends), voyage("T"), horizon_days=30
    )
    with conflictdb.connect(conn) as db:
        db.load(file)
        db.scene("plans").detect()
    conn.commit()
    assert detect_pending(conn, "plans") is None
    window = conn.execute("SELECT lower(expanded), upper(expanded) FROM conflictdb.scene").fetchone()
    conn.commit()
    now_us = round(window[1].timestamp() * 1e6)  # type: ignore[index]
    expansion.expand(conn, "plans", print, now_us - 29 * DAY_US)
    assert pending(conn) == 0
    expansion.expand(conn, "plans", print, now_us)
    assert pending(conn) == 1
    marked = conn.execute("SELECT DISTINCT object_kind, object_id FROM conflictdb.change").fetchall()
    key = conn.execute("SELECT key FROM conflictdb.area WHERE area_id = %s", [marked[0][1]]).fetchone()
    assert key == ("A",)
    conn.commit()
    assert detect_pending(conn, "plans") is not None
    # A voyage outside the window extends it, before it is compared.
    conn.execute(
        "SELECT conflictdb.put_track('plans', 'Late', conflictdb.track_path(ST_GeomFromText("
        "'LINESTRING(0.2 0.5, 0.4 0.5)', 4326), ARRAY['2041-06-04 06:30+00', '2041-06-04 07:00+00']::timestamptz[]), "
        "conflictdb.rectangle_outline(1, 1, 1, 1))"
    )
    conn.commit()
    detect(conn, "plans")
    assert ("A", "Late") in conflicts(conn, "plans")


def test_sql_stores_schedules_which_the_next_detection_reads(conn: psycopg.Connection[Any]) -> None:
    conn.execute("SELECT conflictdb.create_scene('plans', p_horizon_days => 10)")
    put = (
        "SELECT conflictdb.put_area('plans', 'A', ST_MakeEnvelope(0, 0, 1, 1, 4326), p_schedule => %s::jsonb), "
        "conflictdb.put_track('plans', 'T', conflictdb.track_path("
        "ST_GeomFromText('LINESTRING(0.2 0.5, 0.4 0.5)', 4326), "
        "ARRAY['2026-06-02 06:30+00', '2026-06-02 07:00+00']::timestamptz[]), "
        "conflictdb.rectangle_outline(1, 1, 1, 1), "
        "p_departures => ARRAY['2026-06-01 06:30+00', '2026-06-02 06:30+00']::timestamptz[])"
    )
    conn.execute(put, [Jsonb(TUESDAYS)])
    conn.commit()
    assert pending(conn) == 2
    assert conn.execute("SELECT scene FROM conflictdb_internal._waiting_scenes()").fetchall() == [("plans",)]
    conn.commit()
    detect(conn, "plans")
    [periods] = conflicts(conn, "plans").values()
    assert [period[0].isoformat() for period in periods] == ["2026-06-02T06:30:00+00:00"]
    # Stored again, they stay as they are.
    conn.execute(put, [Jsonb(TUESDAYS)])
    conn.commit()
    assert pending(conn) == 0
    # The haven sails on both days.
    sails = "SELECT conflictdb.haven_at('plans', 'T', %s) IS NOT NULL"
    for at, there in (("2026-06-01 06:45+00", True), ("2026-06-02 06:45+00", True), ("2026-06-03 06:45+00", False)):
        assert conn.execute(sails, [at]).fetchone() == (there,)
    conn.commit()
    with pytest.raises(psycopg.Error, match="before the voyage before it has ended"):
        conn.execute("UPDATE conflictdb.track SET departures = '{2026-06-01 06:30+00, 2026-06-01 06:40+00}'")
    conn.rollback()


def test_a_copy_of_a_scene_recurs_as_well(conn: psycopg.Connection[Any], tmp_path: Path) -> None:
    spans = [["2026-06-01T00:00:00Z", "2026-06-02T00:00:00Z"], ["2026-06-02T06:40:00Z", "2026-06-02T06:50:00Z"]]
    departures = ["2026-06-02T06:30:00Z", "2026-06-09T06:30:00Z"]
    file = scene_file(
        tmp_path, feature("A", spans=spans), feature("B", schedule=TUESDAYS), voyage("T", departures=departures)
    )
    with conflictdb.connect(conn) as db:
        db.load(file)
        db.scene("plans").detect()
        found = conflicts(conn, "plans")
        conn.commit()
        conn.execute("SELECT conflictdb.copy_scene('plans', 'copy')")
        conn.commit()
        db.scene("copy").detect()
        assert conflicts(conn, "copy") == found
    assert len(found[("A", "T")]) == 1
    assert len(found[("B", "T")]) == 2


@pytest.mark.parametrize(
    ("properties", "message"),
    [
        ({"schedule": {"days": ["X"]}}, r"area 'A': schedule\.days\[0\]: must be a day"),
        ({"schedule": "H24"}, "area 'A': schedule: must be an object"),
        ({"schedule": {}, "spans": []}, "area 'A': spans: must not be given together with schedule"),
        ({"spans": [["2026-06-01T00:00:00Z"]]}, "area 'A': spans: must be a list of pairs"),
        ({"spans": [["2026-06-01T00:00:00Z", "June"]]}, r"area 'A': spans\[0\]\[1\]: "),
        (
            {"spans": [["2026-06-01T00:00:00Z", None]], "end": "2026-07-01T00:00:00Z"},
            "area 'A': end: must not be given",
        ),
    ],
)
def test_plans_with_a_mistake_are_refused_by_name(
    conn: psycopg.Connection[Any], tmp_path: Path, properties: dict[str, Any], message: str
) -> None:
    with conflictdb.connect(conn) as db, pytest.raises(InvalidInput, match=message):
        db.load(scene_file(tmp_path, feature("A", **properties)))


def test_an_answer_beyond_the_horizon_says_so(
    conn: psycopg.Connection[Any], dsn: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    daily = {"rrule": "DTSTART:20260601T063000Z\nRRULE:FREQ=DAILY", "duration": "PT1H"}
    file = scene_file(tmp_path, feature("A", schedule=TUESDAYS), voyage("T", schedule=daily), horizon_days=30)
    with conflictdb.connect(conn) as db:
        db.load(file)
        db.scene("plans").detect()
        scene = db.scene("plans")
        window = conn.execute("SELECT expanded_from, expanded_until FROM conflictdb.scenes").fetchone()
        conn.commit()
        assert window is not None
        first, last = window
        # Inside, and for all that is known, nothing is said (a warning is an error here).
        for inside in ({}, {"at": first}, {"from_": first, "to": last}, {"from_": first}):
            assert scene.conflicts(**inside).is_current
        for beyond in (
            {"at": last},
            {"at": first - timedelta(microseconds=1)},
            {"from_": last},
            {"from_": first, "to": last + timedelta(microseconds=1)},
            {"to": first - timedelta(days=1)},
        ):
            with pytest.warns(IncompleteWarning, match=r"schedules are expanded from .* until .* only"):
                assert not scene.conflicts(**beyond).is_current
        with pytest.warns(IncompleteWarning, match="schedules are expanded"):
            list(scene.stream_conflicts(last))
        # A probe expands them as far as its plan.
        plan = conflictdb.Area("P", shapely.box(0, 0, 1, 1), start_us=last, end_us=last + timedelta(days=8))
        assert [one.a_key for one in scene.probe(plan)] == ["A", "P"]
        assert scene.probe(plan).is_current
        assert scene.probe(replace(plan, start_us=None, end_us=None)).is_current
    notices: list[str] = []
    conn.add_notice_handler(lambda notice: notices.append(notice.message_primary or ""))
    tile = '{"scene": "plans", "at": "%s"}'
    for instant, said in (("2071-01-01T00:00:00Z", True), (first.isoformat(), False)):
        day = f"'[{instant}, {instant}]'"
        for query in (
            f"conflictdb.conflicts_at('plans', '{instant}')",
            f"conflictdb.conflicts_within('plans', ST_MakeEnvelope(0, 0, 1, 1, 4326), {day})",
            f"conflictdb.probe('plans', ST_MakeEnvelope(0, 0, 1, 1, 4326), {day})",
            f"conflictdb.havens('plans', '{instant}', '{instant}', '1 hour')",
            f"conflictdb.haven_at('plans', 'T', '{instant}')",
            f"conflictdb.tile_areas(0, 0, 0, '{tile % instant}')",
        ):
            notices.clear()
            conn.execute(f"SELECT * FROM {query}".encode())
            assert [one for one in notices if "schedules are expanded from" in one] == notices, query
            assert bool(notices) == said, query
    conn.commit()
    commands = ("--dsn", dsn, "conflicts", "--scene", "plans", "--at", "2071-01-01T00:00Z")
    assert main(commands) == 0
    assert "plans: not complete: schedules are expanded from" in capsys.readouterr().err
    assert main([*commands, "--require-current"]) == 7
    assert "schedules are expanded from" in capsys.readouterr().err


def repeated(db: Any, tmp_path: Path, **settings: Any) -> Any:
    """Return a detected scene with an area and a ferry that sails twice."""
    twice = ["2026-06-02T06:30:00Z", "2026-06-09T06:30:00Z"]
    one_day = feature("A", spans=[["2026-06-09T06:40:00Z", "2026-06-09T06:50:00Z"]])
    db.load(scene_file(tmp_path, one_day, voyage("T", departures=twice), voyage("Once"), **settings))
    db.scene("plans").detect()
    return db.scene("plans")


def test_schedules_without_an_activation_are_named(conn: psycopg.Connection[Any], tmp_path: Path) -> None:
    """A schedule that ended in the past is not expanded: a detection that finds nothing says so."""
    ended = {"rrule": "DTSTART:20200602T080000Z\nRRULE:FREQ=WEEKLY;COUNT=3", "duration": "PT2H"}
    said: list[str] = []
    with conflictdb.connect(conn) as db:
        db.load(scene_file(tmp_path, feature("A", schedule=ended), feature("B"), feature("C", schedule=TUESDAYS)))
        expansion.expand(conn, "plans", said.append)
        expansion.expand(conn, "plans", said.append)
        scene, areas, tracks = store.read_scene(conn, "plans")
    rule = r"^area 'A': no activation of the schedule from \S+Z until \S+Z, as far as schedules are expanded$"
    (only,) = said
    assert re.search(rule, only)
    with pytest.warns(IncompleteWarning, match=rule):
        assert [one.a_key for one in conflictdb.solve(tracks, areas, scene)] == ["B"]
    # Where a voyage reaches that far, it is expanded.
    with conflictdb.connect(conn) as db:
        db.load(scene_file(tmp_path, voyage("T", times=["2020-06-02T06:00:00Z", "2020-06-02T09:00:00Z"])))
        db.scene("plans").detect()
        assert ("A", "B") in verdicts(conn)


def test_explain_says_all_of_a_repeated_voyage(conn: psycopg.Connection[Any], tmp_path: Path) -> None:
    with conflictdb.connect(conn) as db:
        found = repeated(db, tmp_path).explain("A", "T")
    assert found.facts["verdict"] == "conflict"
    assert "2026-06-09" in found.text


@pytest.mark.parametrize("stored_s", [0.0, 3600.0])
def test_delays_of_a_repeated_voyage_are_those_of_all_its_voyages(
    conn: psycopg.Connection[Any], tmp_path: Path, stored_s: float
) -> None:
    """A delay moves every voyage: it is forbidden if one of them would conflict."""
    with conflictdb.connect(conn) as db:
        scene = repeated(db, tmp_path, delays_within_s=stored_s)
        [together] = scene.delays("T", 3600.0)
        with pytest.raises(InvalidInput, match="delays: waypoint: is for one voyage: track 'T' has departures"):
            scene.delays("T", waypoint=1)
        _, areas, tracks = store.read_scene(conn, "plans")
    once, twice = sorted(tracks, key=lambda track: track.key)
    assert twice.departures_us is not None
    moved = [twice.departures_us[i] - int(twice.times_us[0]) for i in (0, 1)]
    apart = []
    for by_us in moved:
        voyage_alone = later(replace(twice, departures_us=None), by_us)
        [found] = conflictdb.delays([once, voyage_alone], areas, key="T", within_s=3600.0)
        assert found.forbidden
        apart.append(found)

    def is_forbidden(delays: Any, delay_s: float) -> bool:
        return any(one.from_s <= delay_s <= one.to_s for one in delays.forbidden)

    grid = [7.3 * i for i in range(-490, 491)]
    assert [is_forbidden(together, at) for at in grid] == [any(is_forbidden(one, at) for one in apart) for at in grid]
    assert not all(is_forbidden(together, at) for at in grid)


def test_speeds_refuse_repeated_voyages_and_resolve_keeps_them(conn: psycopg.Connection[Any], tmp_path: Path) -> None:
    with conflictdb.connect(conn) as db:
        scene = repeated(db, tmp_path)
        with pytest.raises(InvalidInput, match="speeds: key: is for one voyage: track 'T' has departures"):
            scene.speeds("T")
        with pytest.raises(InvalidInput, match="resolve: keys: is for one voyage: track 'T' has departures"):
            scene.resolve(keys=["T"])
        proposal = scene.resolve()
        assert [move.key for move in proposal.moves] == ["Once"]
        assert "track 'T' stays as planned: its voyages repeat" in proposal.notes


# Each reached the database without Python: by SQL, or by a restore.
UNREAD = {
    "a day that is none": '{"days": ["X"]}',
    "a holiday": '{"notam": "HOL 0800-1000"}',
    "an unknown zone": '{"timezone": "Mars/Olympus"}',
    "a number": "7",
    "a text": '"H24"',
    "an empty list": "[]",
    "lists in lists": "[" * 99 + "]" * 99,
    "a number of 300 digits": '{"days": [' + "1" * 300 + "]}",
    "no date": '{"from": "2026-02-30"}',
    "too many": '{"rrule": "DTSTART:00010101T000000Z\\nRRULE:FREQ=HOURLY", "duration": "PT5M"}',
}


def verdicts(conn: psycopg.Connection[Any]) -> dict[tuple[str, str], str]:
    found = conn.execute("SELECT a_key, b_key, verdict FROM conflictdb.conflicts WHERE scene = 'plans'").fetchall()
    conn.commit()
    return {(a, b): verdict for a, b, verdict in found}


def spoil(conn: psycopg.Connection[Any], table: str, key: str, schedule: str) -> None:
    conn.execute(f"UPDATE conflictdb.{table} SET schedule = %s WHERE key = %s".encode(), [schedule, key])
    conn.commit()


@pytest.mark.parametrize("schedule", ["[" * 3000 + "]" * 3000, '{"days": [' + "1" * 5000 + "]}"])
def test_schedules_that_programs_cannot_read_are_refused(conn: psycopg.Connection[Any], schedule: str) -> None:
    conn.execute("SELECT conflictdb.create_scene('plans')")
    put = "SELECT conflictdb.put_area('plans', 'A', ST_MakeEnvelope(0, 0, 1, 1, 4326), p_schedule => %s::jsonb)"
    with pytest.raises(psycopg.Error, match="schedule: must be nested at most 99 deep"):
        conn.execute(put, [schedule])
    conn.rollback()


@pytest.mark.parametrize("name", UNREAD)
def test_pairs_of_an_unread_schedule_are_unresolved(
    conn: psycopg.Connection[Any], tmp_path: Path, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    with conflictdb.connect(conn) as db:
        days = 36500 if name == "too many" else 366
        db.load(scene_file(tmp_path, feature("A"), feature("B"), voyage("T"), horizon_days=days))
        spoil(conn, "area", "A", UNREAD[name])
        db.scene("plans").detect()
        assert verdicts(conn) == {("A", "B"): "unresolved", ("A", "T"): "unresolved", ("B", "T"): "conflict"}
        assert "area 'A': schedule" in caplog.text
        assert "its pairs are unresolved" in caplog.text
        with pytest.warns(UnknownScheduleWarning, match="area 'A': schedule is not understood"):
            assert db.scene("plans").explain("A", "T").facts["verdict"] == "unresolved"
        why = conn.execute("SELECT conflictdb.explain_conflict('plans', 'A', 'T') ->> 'why'").fetchone()
        conn.commit()
        assert why is not None
        assert why[0].startswith("the schedule of \"A\" is not understood: area 'A': schedule")
        # It waits for nothing: further detections have nothing to do.
        assert not db.scene("plans").detect().candidate_pairs
        spoil(conn, "area", "A", '{"dates": ["2026-06-03"]}')
        db.scene("plans").detect()
        assert verdicts(conn) == {("A", "B"): "conflict", ("B", "T"): "conflict"}
    assert conn.execute("SELECT count(*) FROM conflictdb.area WHERE schedule_error IS NOT NULL").fetchone() == (0,)


def test_a_track_of_unknown_departures_is_unresolved_where_it_may_sail(
    conn: psycopg.Connection[Any], tmp_path: Path
) -> None:
    """At any time, within its own hull only; other objects are detected."""
    late = feature("late", spans=[["2150-01-01T00:00:00Z", "2150-01-02T00:00:00Z"]])
    far = feature("far")
    far["geometry"]["coordinates"] = [[[2, 2], [3, 2], [3, 3], [2, 2]]]
    with conflictdb.connect(conn) as db:
        with pytest.warns(UserWarning, match="area 'late': begins on 2150-01-01"):
            db.load(
                scene_file(tmp_path, late, far, voyage("T"), voyage("other"), separation_m=10, time_separation_s=60)
            )
        spoil(conn, "track", "T", '{"notam": "WHENEVER"}')
        db.scene("plans").detect()
        assert verdicts(conn) == {("late", "T"): "unresolved", ("T", "other"): "unresolved"}
        with pytest.warns(UnknownScheduleWarning, match="track 'T': schedule is not understood"):
            (found,) = db.scene("plans").delays("other")
        assert (found.blocked_by, found.least_later_s) == (("T",), None)
        conn.execute("DELETE FROM conflictdb.track WHERE key = 'T'")
        conn.commit()
        db.scene("plans").detect()
        assert not verdicts(conn)


def test_spans_with_inclusive_ends_keep_their_last_instant(conn: psycopg.Connection[Any]) -> None:
    conn.execute("SELECT conflictdb.create_scene('plans')")
    conn.execute(
        "SELECT conflictdb.put_area('plans', 'A', ST_MakeEnvelope(0, 0, 1, 1, 4326), p_activations => "
        "'{[2026-06-01 08:00+00, 2026-06-01 08:00+00], (2026-06-02 08:00+00, 2026-06-02 09:00+00], "
        "[2026-06-03, infinity)}'::tstzmultirange)"
    )
    found = conn.execute(
        "SELECT count(*), count(*) FILTER (WHERE lower_inc(s) AND NOT upper_inc(s)), "
        "count(*) FILTER (WHERE upper_inf(s)), "
        "(array_agg(upper(s)))[1] - '2026-06-01 08:00+00', (array_agg(lower(s)))[2] - '2026-06-02 08:00+00' "
        "FROM conflictdb.area a, unnest(a.activations) s"
    ).fetchone()
    assert found == (3, 3, 1, timedelta(microseconds=1), timedelta(microseconds=1))


def test_times_written_in_place_of_the_schedule_that_gave_them_stay(
    conn: psycopg.Connection[Any], tmp_path: Path
) -> None:
    """They were lost, and the track made one voyage only."""
    daily = {"rrule": "DTSTART:20260601T063000Z\nRRULE:FREQ=DAILY;COUNT=3", "duration": "PT1H"}
    with conflictdb.connect(conn) as db:
        scene = db.load(scene_file(tmp_path, feature("A", schedule=daily), voyage("T", schedule=daily), voyage("Once")))
        scene.detect()
    _, (area,), tracks = store.read_scene(conn, scene.name)
    (track,) = (one for one in tracks if one.key == "T")
    assert area.spans_us is not None
    assert track.departures_us is not None
    assert (len(area.spans_us), len(track.departures_us)) == (2, 2)
    written = replace(area, schedule=None), replace(track, schedule=None)
    store.replace_scene(conn, Scene(scene.name), [written[0]], [written[1]], merge=True)
    _, (area_after,), tracks = store.read_scene(conn, scene.name)
    (track_after,) = (one for one in tracks if one.key == "T")
    assert (area_after.schedule, area_after.spans_us) == (None, area.spans_us)
    assert (track_after.schedule, track_after.departures_us) == (None, track.departures_us)


def test_edits_of_activations_alone_are_checked_and_count(conn: psycopg.Connection[Any]) -> None:
    """Activations and departures are checked without the geometry; the object has a new version."""
    areas, tracks = objects(1)
    store.replace_scene(conn, Scene("recurring"), areas, tracks, merge=False)
    for table, column, value in (
        ("area", "activations", "'{[2026-05-29 00:00+00, 2026-05-29 12:00+00]}'::tstzmultirange"),
        ("track", "departures", "ARRAY[timestamptz '2026-05-29', '2026-09-29']"),
    ):
        query = f"SELECT {table}_id, version FROM conflictdb.{table} ORDER BY 1 LIMIT 1"
        [(number, version)] = conn.execute(query).fetchall()
        for _ in range(2):
            conn.execute(f"UPDATE conflictdb.{table} SET {column} = {value} WHERE {table}_id = %s", [number])
        [(_, later_version)] = conn.execute(query).fetchall()
        assert later_version == conn.execute("SELECT last_value FROM conflictdb.version_seq").fetchone()[0]
        assert later_version > version
    [(stored, span)] = conn.execute(
        "SELECT a.activations::text, a.active_span::text FROM conflictdb.area a ORDER BY area_id LIMIT 1"
    ).fetchall()
    assert stored == f"{{{span}}}"
    assert stored.endswith('12:00:00.000001+00")}')
    conn.commit()
    for wrong, rule in (("2026-05-29", "departures_apart"), ("infinity", "departures_in_calendar")):
        edit = (
            f"UPDATE conflictdb.track SET departures = ARRAY[timestamptz '2026-05-29', '{wrong}'] WHERE track_id = %s"
        )
        with pytest.raises(psycopg.Error) as raised, conn.transaction():
            conn.execute(edit, [number])
        assert raised.value.diag.constraint_name == rule


# A voyage that ends five days before an area is active.
ONCE = """
INSERT INTO conflictdb.area (scene_id, key, footprint, schedule)
SELECT scene_id, 'S', ST_SetSRID(ST_Multi(ST_MakeEnvelope(0, 50, 1, 51)), 4326), jsonb_build_array(jsonb_build_object(
    'dates', jsonb_build_array((now() + interval '107 days')::date), 'periods', '[["00:00", "23:00"]]'::jsonb))
FROM conflictdb.scene WHERE name = 's'
"""
BEFORE = """
SELECT conflictdb.put_track('s', 'V', conflictdb.track_path('SRID=4326;LINESTRING(-1 50.5, 0.5 50.5)',
    ARRAY[date_trunc('day', now()) + interval '100 days', date_trunc('day', now()) + interval '102 days']),
    conflictdb.rectangle_outline(9, 9, 5, 5), p_tolerances => %s)
"""


@pytest.mark.parametrize(
    ("limits", "separation_s"),
    [
        (None, 14 * 86_400.0),
        ({"min_speed_kn": 0.1, "arrival_window": [101, 110]}, 0.0),
        ({"departure_window": [100, 108]}, 0.0),
        ({"min_speed_kn": 0.2}, 0.0),
    ],
)
def test_schedules_are_expanded_as_far_as_voyages_may_meet_them(
    conn: psycopg.Connection[Any], limits: dict[str, Any] | None, separation_s: float
) -> None:
    """In a scene that expands them for a day: as far as windows, the slowest voyage and the separation reach."""
    create = "SELECT conflictdb.create_scene('s', p_horizon_days => 0, p_time_separation_s => %s)"
    conn.execute(create.encode(), [separation_s])
    conn.execute(ONCE.encode())
    row = conn.execute("SELECT date_trunc('day', now() AT TIME ZONE 'UTC')").fetchone()
    assert row is not None
    windows = {
        name: [f"{row[0] + timedelta(days=day):%Y-%m-%dT%H:%M:%SZ}" for day in days]
        for name, days in (limits or {}).items()
        if name.endswith("window")
    }
    conn.execute(BEFORE.encode(), [None if limits is None else Jsonb({**limits, **windows})])
    conn.commit()
    detect(conn, "s")
    assert conflicts(conn, "s").keys() == {("S", "V")}
    with conflictdb.connect(conn) as db:
        scene, areas, tracks = store.read_scene(db.connection, "s")
        planned = [replace(area, spans_us=None, start_us=None, end_us=None) for area in areas]
        assert len(conflictdb.solve(tracks, planned, scene)) == 1


def test_delays_meet_schedules_beyond_the_planned_voyage(conn: psycopg.Connection[Any]) -> None:
    """A delay that ends in an activation after all voyages is in conflict, in memory and as a detection stores it."""
    start_us = int(np.datetime64("2040-05-01T18:00", "us").astype(int))
    there = shapely.box(0.0, 50.0, 1.0, 51.0)
    daily = {"days": ["MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN"], "periods": [["08:00", "16:00"]]}
    area = conflictdb.Area("S", there, schedule=daily)
    ship = conflictdb.rectangle_outline_m(9.0, 9.0, 5.0, 5.0)
    plan = conflictdb.Track("V", [(-1.0, 50.5), (2.0, 50.5)], [start_us, start_us + DAY_US // 8], ship)
    scene = Scene("s", horizon_days=30.0, delays_within_s=86_400.0)
    (found,) = conflictdb.delays([plan], [area], scene, within_s=86_400.0)
    assert [one.from_s > 0 for one in found.forbidden] == [False, True]
    store.replace_scene(conn, scene, [area], [plan], merge=False)
    detect(conn, "s")
    with conflictdb.connect(conn) as db:
        (stored,) = db.scene("s").delays("V", within_s=86_400.0)
    assert [(one.from_s, one.to_s) for one in stored.forbidden] == [(one.from_s, one.to_s) for one in found.forbidden]


@pytest.mark.parametrize("year", ["0001-01-01T00:00:00", "9999-12-31T12:00:00"])
def test_voyages_at_the_ends_of_the_calendar_are_detected(conn: psycopg.Connection[Any], year: str) -> None:
    start_us = int(np.datetime64(year, "us").astype(int))
    area = conflictdb.Area(
        "S", shapely.box(0.0, 50.0, 1.0, 51.0), schedule={"dates": ["2026-12-01"], "periods": [["08:00", "16:00"]]}
    )
    ship = conflictdb.rectangle_outline_m(9.0, 9.0, 5.0, 5.0)
    plan = conflictdb.Track("V", [(-1.0, 50.5), (2.0, 50.5)], [start_us, start_us + DAY_US // 2 - 1_000_000], ship)
    store.replace_scene(conn, Scene("s", time_separation_s=60.0), [area], [plan], merge=False)
    detect(conn, "s")
    assert pending(conn) == 0


def test_the_longest_voyage_is_the_same_in_sql_and_python(conn: psycopg.Connection[Any]) -> None:
    """Pieces end before it, also across the date line, with waits and turns."""
    rng = np.random.default_rng(7)
    for k in range(60):
        count = int(rng.integers(2, 6))
        # Pieces of long legs are many.
        most_deg = 40.0 if k % 12 == 0 else 2.0
        lon = np.cumsum(rng.uniform(-most_deg, most_deg, count)) + 180.0
        lat = rng.uniform(-78.0, 78.0) + rng.uniform(-most_deg, most_deg, count)
        places = np.column_stack([(lon + 180.0) % 360.0 - 180.0, np.clip(lat, -80.0, 80.0)])
        if rng.random() < 0.3:
            places[1] = places[0]
        times = 1_780_300_800_000_000 + np.cumsum(rng.integers(3_600, 40 * 3_600, count)) * 1_000_000
        limits: dict[str, Any] = {"min_speed_kn": [float(x) for x in rng.uniform(0.5, 20.0, count - 1)]}
        if rng.random() < 0.5:
            limits["turn_radius_m"] = 500.0
        ship = conflictdb.rectangle_outline_m(50.0, 50.0, 9.0, 9.0)
        track = conflictdb.Track(
            "T", places, times.astype("datetime64[us]"), ship, tolerances=limits, max_speed_kn=np.inf
        )
        known = tolerances_of("T", track.tolerances or {}, track.times_us)
        lasts_s = (known.latest_arrival_us(track.positions_deg, track.times_us) - int(track.times_us[0])) / 1e6
        path = (
            "SRID=4326;LINESTRING M ("
            + ", ".join(
                f"{x!r} {y!r} {at / 1e6!r}" for (x, y), at in zip(places.tolist(), track.times_us.tolist(), strict=True)
            )
            + ")"
        )
        query = "SELECT conflictdb_internal._longest_voyage_s(%s, %s)"
        (row,) = conn.execute(query, [path, Jsonb(track.tolerances)]).fetchall()
        assert row[0] == pytest.approx(lasts_s, rel=1e-3)
        pieces = pieces_of(Setup.of(Scene("s")), AreaBatch.of([]), TrackBatch.of([track]))
        assert pieces.end_us.max() <= track.times_us[0] + round(1e6 * (lasts_s + 1.0))


def test_an_unread_schedule_is_exported_and_stops_no_other_object(dsn: str, tmp_path: Path) -> None:
    """As it is stored: who mends it reads it in the file. A scene is read whole."""
    with conflictdb.connect(dsn) as db:
        db.load(scene_file(tmp_path, *map(feature, UNREAD), feature("B"), voyage("T"), horizon_days=36500))
        for name, schedule in UNREAD.items():
            spoil(db.connection, "area", name, schedule)
        spoil(db.connection, "track", "T", '{"notam": "WHENEVER"}')
        db.scene("plans").detect()
        db.scene("plans").export(tmp_path / "out.geojson")
    found = json.loads((tmp_path / "out.geojson").read_text())
    written = {one["id"]: one["properties"].get("schedule") for one in found["features"]}
    unread = {name: json.loads(schedule) for name, schedule in UNREAD.items()}
    assert written == {**unread, "B": None, "T": {"notam": "WHENEVER"}}
