"""`detect`, `conflicts` and `demo`, on a real database."""

import csv
import json
import re
from collections.abc import Iterable, Sequence
from datetime import timedelta
from io import StringIO
from itertools import groupby
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import psycopg
import pytest
from commands import STRAIT, Run

import conflictdb
from conflictdb.core.memory_budget import MemoryBudget

EXPECTED = {
    ("CABLE", "SUB-1"),
    ("DIVING", "FERRY"),
    ("DIVING", "FIRING"),
    ("DIVING", "SUB-2"),
    ("FERRY", "TOW"),
    ("FIRING", "FERRY"),
    ("FIRING", "SURVEY"),
}
COLUMNS = [
    *("scene", "a_key", "a_kind", "b_key", "b_kind", "periods", "first_contact", "last_contact", "verdict", "region"),
    *("first_contact_point", "method", "time_error_s", "is_current", "run_id", "found_at"),
    *("closest_at", "closest_m", "closest_error_m", "closest_a_point", "closest_b_point"),
    *("scene_is_current", "conflict_id", "opened_at", "changed_at"),
    *("acknowledged_by", "acknowledged_at", "acknowledged_for", "acknowledged_until"),
    *("first_contact_lon_deg", "first_contact_lat_deg", "a_name", "b_name", "lacking_s"),
    "certainty",
]
INSTANT = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z")


@pytest.fixture
def strait(run: Run) -> Run:
    """Return a function that runs a command on the shipped scene, which is detected."""
    run("detect", STRAIT)
    return lambda command, *words: run(command, "--scene", "strait", *words)


def pairs(rows: Iterable[dict[str, Any]]) -> set[tuple[str, str]]:
    return {(row["a_key"], row["b_key"]) for row in rows}


def test_detect_file_prints_one_json_array_with_the_columns_of_the_view(run: Run) -> None:
    done = run("detect", STRAIT, "--format", "json")
    assert done.code == 0
    assert done.err.splitlines()[1:] == ["conflictdb: strait: 11 added, 0 updated, 0 removed, 0 unchanged"]
    rows = done.json
    assert pairs(rows) == EXPECTED
    for row in rows:
        assert list(row) == COLUMNS
        assert row["is_current"] is True
        assert row["region"]["type"] in ("Polygon", "MultiPolygon")
        assert all(INSTANT.fullmatch(end) for period in row["periods"] for end in period)
        assert (row["first_contact"], row["last_contact"]) == (row["periods"][0][0], row["periods"][-1][1])
    survey = next(row for row in rows if row["b_key"] == "SURVEY")
    assert len(survey["periods"]) == 3
    assert survey["first_contact_point"]["type"] == "Point"


def test_detection_again_and_by_scene_gives_the_same(run: Run) -> None:
    first = run("detect", STRAIT, "--format", "json", "--no-region").json
    again = run("detect", "--scene", "strait", "--format", "json", "--no-region").json
    known = run("conflicts", "--scene", "strait", "--format", "json", "--no-region").json
    full = run("detect", "--scene", "strait", "--full", "--jobs", "1", "--format", "json", "--no-region").json
    assert first == again == known == full
    assert all(row["region"] is None for row in first)


def test_table_csv_and_geojson_show_the_same_pairs(run: Run) -> None:
    table = run("detect", STRAIT).out.splitlines()
    header = "A B VERDICT FIRST CONTACT (UTC) LAST CONTACT (UTC) PERIODS HOW CLOSE A NAME B NAME"
    assert " ".join(table[0].split()) == header
    assert {tuple(line.split()[:2]) for line in table[1:]} == EXPECTED
    times = "2026-06-01 11:09:00  2026-06-01 11:50:27"
    survey = (
        f"FIRING  SURVEY  conflict  {times}        3  {'inside by 7.5 nmi':22}  {'Firing practice':26}  Survey aircraft"
    )
    assert survey in table
    # Two moving objects, then one, then none; within these the soonest.
    assert [line.split()[:2] for line in (table[1], table[2], table[-1])] == [
        ["FERRY", "TOW"],
        ["CABLE", "SUB-1"],
        ["DIVING", "FIRING"],
    ]
    assert "  too close by 0.6 nmi  " in table[1]
    assert table == run("conflicts").out.splitlines()
    named = next(line for line in table if line.startswith("CABLE "))
    assert "  Cable works on the sea bed  " in named

    rows = list(csv.DictReader(StringIO(run("conflicts", "--scene", "strait", "--format", "csv").out)))
    assert list(rows[0]) == COLUMNS
    assert pairs(rows) == EXPECTED
    assert all(INSTANT.fullmatch(end) for row in rows for part in row["periods"].split() for end in part.split("/"))

    features = run("conflicts", "--scene", "strait", "--format", "geojson").json["features"]
    assert {(f["properties"]["a_key"], f["properties"]["b_key"]) for f in features} == EXPECTED
    assert {f["geometry"]["type"] for f in features} <= {"Polygon", "MultiPolygon"}
    points = run("conflicts", "--scene", "strait", "--format", "geojson", "--no-region").json["features"]
    assert {None if f["geometry"] is None else f["geometry"]["type"] for f in points} <= {"Point", None}


def test_conflicts_at_an_instant(strait: Run) -> None:
    at = ("conflicts", "--format", "json", "--at")
    assert pairs(strait(*at, "2026-06-01T11:47:00+00:00").json) == {("DIVING", "FIRING"), ("FIRING", "SURVEY")}
    assert pairs(strait(*at, "2026-06-01T13:37:00+02:00").json) == {("CABLE", "SUB-1"), ("DIVING", "FIRING")}
    assert strait(*at, "2027-01-01T00:00:00Z").out == "[]\n"
    assert strait(*at, "2026-06-01T11:47:00").code == 2


def test_conflicts_are_selected(strait: Run) -> None:
    """By object, span, age, verdict and acknowledgement, alone and together."""

    def found(*words: str) -> set[tuple[str, str]]:
        done = strait("conflicts", "--format", "json", *words)
        assert done.code == 0, done.err
        return pairs(done.json)

    assert found("FERRY") == {pair for pair in EXPECTED if "FERRY" in pair}
    early = {("DIVING", "FERRY"), ("FERRY", "TOW"), ("FIRING", "FERRY"), ("DIVING", "SUB-2"), ("CABLE", "SUB-1")}
    assert found("--to", "2026-06-01T10:00Z") < EXPECTED
    assert found("--from", "2026-06-01T11:00Z") | found("--to", "2026-06-01T11:00Z") == EXPECTED
    assert found("FERRY", "--from", "2026-06-01T09:07Z", "--to", "2026-06-01T12:00Z") <= early
    assert found("--from", "2027-01-01T00:00Z") == found("--to", "2026-01-01T00:00Z") == set()
    assert found("--since", "1h") == EXPECTED
    assert found("--since", "2100-01-01T00:00Z") == set()
    assert found("--verdict", "conflict") == EXPECTED
    assert found("--verdict", "grazing") == set()
    assert found("--acknowledged", "no") == EXPECTED
    strait("acknowledge", "FERRY", "TOW", "--reason", "agreed, by radio")
    assert found("--acknowledged", "yes") == {("FERRY", "TOW")}
    assert found("--acknowledged", "no", "FERRY") == {("DIVING", "FERRY"), ("FIRING", "FERRY")}
    wrong = strait("conflicts", "FERRI")
    assert (wrong.code, "'FERRI': key: is no object of scene 'strait'" in wrong.err) == (4, True), wrong.err
    backwards = strait("conflicts", "--from", "2026-06-02T00:00Z", "--to", "2026-06-01T00:00Z")
    assert (backwards.code, "must be after from_" in backwards.err) == (4, True)
    assert strait("conflicts", "FERRY", "--known-at", "2100-01-01T00:00Z").code == 2


def test_local_times_are_read_and_shown(strait: Run) -> None:
    local = ("conflicts", "--tz", "Europe/Copenhagen")
    table = strait(*local, "FERRY", "--to", "2026-06-01 11:05").out.splitlines()
    assert " ".join(table[0].split()) == "A B VERDICT FIRST CONTACT LAST CONTACT PERIODS HOW CLOSE A NAME B NAME"
    assert table[1].split()[:2] == ["FIRING", "FERRY"]
    assert "  2026-06-01 10:11:17+02:00  2026-06-01 11:07:24+02:00  " in table[1]
    assert len(table) == 3
    day = strait(*local, "--from", "2026-06-01", "--to", "2026-06-02", "--format", "json").json
    assert pairs(day) == EXPECTED
    assert strait(*local, "--at", "2026-10-25T02:30").code == 2  # twice
    assert strait(*local, "--at", "2026-03-29T02:30").code == 2  # never
    assert strait(*local, "--at", "2026-10-25T02:30+02:00").code == 0
    for wrong in (("--tz", "Mars/Olympus"), ("--at", "2026-06-01T09:00"), ("--at", "nine"), ("--since", "yesterday")):
        done = strait("conflicts", *wrong)
        assert (done.code, done.out) == (2, ""), done.err


def test_a_table_shows_more_on_request(strait: Run) -> None:
    strait("acknowledge", "FERRY", "TOW", "--reason", "seen\x1b[2J")
    shown = ("conflicts", "FERRY", "--show")
    lines = strait(*shown, "position, microseconds,acknowledged").out.splitlines()
    assert lines[0].split()[-13:-9] == ["LATITUDE", "LONGITUDE", "ACKNOWLEDGED", "BY"]
    (tow,) = [line for line in lines if line.startswith("FERRY ")]
    row = strait("conflicts", "--format", "json", "FERRY").json[-1]
    lon, lat = row["first_contact_point"]["coordinates"]
    assert f" {lat:.6f}   {lon:.6f} " in tow
    assert re.search(r" 2026-06-01 \d\d:\d\d:\d\d\.\d{6} ", tow)
    assert "  seen\\x1b[2J  " in tow
    assert strait(*shown, "colour").code == 2


def test_who_acknowledged_may_be_named_beside_the_user(strait: Run) -> None:
    """Where people share a user; the user is shown too, as the name is not verified."""
    pair = ("FERRY", "TOW")
    assert strait("acknowledge", *pair, "--reason", "seen", "--by", "Lt. Ø\x1b[2J").code == 0
    (row,) = strait("conflicts", "--acknowledged", "yes", "--format", "json").json
    assert re.fullmatch(r"Lt\. Ø\x1b\[2J \(\w+\)", row["acknowledged_by"])
    table = strait("conflicts", "--acknowledged", "yes", "--show", "acknowledged").out
    assert "Lt. Ø\\x1b[2J (" in table
    known = strait("conflicts", "--known-at", "2100-01-01T00:00Z", "--format", "json").json
    assert row["acknowledged_by"] in {one["acknowledged_by"] for one in known}
    assert strait("acknowledge", *pair, "--reason", "seen", "--by", " ").code == 4
    assert strait("acknowledge", *pair, "--undo", "--by", "me").code == 2


def test_plotters_and_calendars_get_files(strait: Run) -> None:
    gpx = ET.fromstring(strait("conflicts", "--format", "gpx").out.encode())  # noqa: S314
    names = {one.text for one in gpx.iter("{http://www.topografix.com/GPX/1/1}name")}
    assert {tuple(one.partition(" (")[0] for one in str(name).split(" / ")) for name in names} == EXPECTED
    assert "FIRING (Firing practice) / FERRY (Ferry)" in names
    calendar = strait("conflicts", "--format", "ics").out
    assert calendar.count("BEGIN:VEVENT") == 9  # SURVEY enters FIRING three times
    again = strait("conflicts", "--format", "ics").out
    assert again == calendar
    both = strait("detect", "--nearest-m", "5000", "--format", "ics")
    assert both.out.count("BEGIN:VEVENT") == 9
    assert "no start or no end" in both.err


def test_settings_given_once_stay_and_recompute(strait: Run) -> None:
    wide = strait("detect", "--separation-m", "400", "--tolerance-m", "5", "--format", "json")
    assert ("CONVOY-1", "CONVOY-2") in pairs(wide.json)
    assert pairs(strait("detect", "--format", "json").json) == pairs(wide.json)
    screened = strait("detect", "--method", "screen", "--format", "json")
    assert pairs(screened.json) >= pairs(wide.json)
    assert {row["verdict"] for row in screened.json if row["b_kind"] == "track"} == {"unresolved"}


def test_unbounded_periods_are_null_in_json_and_dots_elsewhere(run: Run, tmp_path: Path) -> None:
    square = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]}
    features = [{"type": "Feature", "id": key, "geometry": square, "properties": None} for key in "ab"]
    path = tmp_path / "always.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    (row,) = run("detect", path, "--format", "json").json
    assert (row["scene"], row["periods"], row["first_contact"]) == ("always", [[None, None]], None)
    assert "../.." in run("conflicts", "--scene", "always", "--format", "csv").out
    row = run("conflicts", "--scene", "always").out.splitlines()[1].split()
    assert row[:6] == ["a", "b", "conflict", "..", "..", "1"]
    assert row[6:8] == ["overlapping", "by"]


def test_fail_on_conflict(run: Run, tmp_path: Path) -> None:
    assert run("detect", STRAIT, "--fail-on-conflict").code == 10
    path = tmp_path / "ferry.geojson"
    document = json.loads(STRAIT.read_text())
    ferry = next(f for f in document["features"] if f["id"] == "FERRY")
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [ferry]}))
    quiet = run("detect", path, "--fail-on-conflict")
    assert (quiet.code, quiet.out) == (0, "no conflicts\n")


def test_files_of_one_scene_are_detected_together(run: Run, tmp_path: Path) -> None:
    document = json.loads(STRAIT.read_text())
    for name, kinds in (("areas.geojson", "area"), ("tracks.geojson", "track")):
        chosen = [f for f in document["features"] if f["properties"]["kind"] == kinds]
        (tmp_path / name).write_text(json.dumps({"type": "FeatureCollection", "features": chosen}))
    both = run("detect", tmp_path / "areas.geojson", tmp_path / "tracks.geojson", "--scene", "s", "--format", "json")
    assert pairs(both.json) == EXPECTED
    apart = run("detect", tmp_path / "areas.geojson", tmp_path / "tracks.geojson", "--format", "json")
    assert {row["scene"] for row in apart.json} == {"areas", "tracks"}
    assert pairs(apart.json) == {("DIVING", "FIRING"), ("FERRY", "TOW")}


def test_an_outdated_conflict_says_so(strait: Run, tmp_path: Path) -> None:
    document = json.loads(STRAIT.read_text())
    ferry = next(f for f in document["features"] if f["id"] == "FERRY")
    ferry["properties"]["start"] = "2026-06-01T20:15:00Z"
    (tmp_path / "later.geojson").write_text(json.dumps(document))
    strait("load", tmp_path / "later.geojson")
    known = strait("conflicts", "--format", "json").json
    outdated = {(row["a_key"], row["b_key"]) for row in known if not row["is_current"]}
    assert outdated == {pair for pair in EXPECTED if "FERRY" in pair}
    assert "conflict (outdated)" in strait("conflicts").out
    assert pairs(strait("detect", "--format", "json").json) == {p for p in EXPECTED if "FERRY" not in p}


@pytest.mark.parametrize(
    "words",
    [
        ("detect",),
        ("detect", "--replace", "--scene", "s"),
        ("detect", "--max-speed-kn", "5", "--scene", "s"),
        ("detect", "--scene", "s", "--tolerance-m", "-1"),
        ("detect", "--scene", "s", "--tolerance-m", "nan"),
        ("detect", "--scene", "s", "--jobs", "0"),
        ("detect", "--scene", "s", "--method", "guess"),
        ("conflicts",),
        ("conflicts", "--scene", "s", "--format", "xml"),
        ("nonsense",),
        (),
    ],
)
def test_usage_errors(run: Run, words: tuple[str, ...]) -> None:
    done = run(*words)
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1
    assert "--help" in done.err


def test_the_scene_is_that_of_the_environment_or_the_last_or_only_one(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """And a remark names it, so that no conflict of another scene is read by mistake."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    run("detect", STRAIT)
    (tmp_path / "conflictdb" / "last-scene.json").unlink()
    assert run("conflicts").err == "conflictdb: scene 'strait' (the only one)\n"
    run("load", STRAIT, "--scene", "other")
    assert "conflictdb: scene 'other' (the last one used)\n" in run("conflicts").err
    assert run("conflicts", "--scene", "strait").err == ""
    assert run("explain", "FERRY", "TOW").err == "conflictdb: scene 'strait' (the last one used)\n"
    monkeypatch.setenv("CONFLICTDB_SCENE", "other")
    assert "conflictdb: scene 'other' (CONFLICTDB_SCENE)\n" in run("detect").err
    monkeypatch.setenv("CONFLICTDB_SCENE", "")
    assert run("report", tmp_path / "r.xyz").err.startswith("conflictdb: scene 'strait' (the last one used)\n")


@pytest.mark.parametrize("content", ["", "[]", "{", '{"x": 1}', "\0"])
def test_without_any_hint_the_known_scenes_are_named(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, content: str
) -> None:
    """Also where the file of last scenes is damaged, cannot be written, or names a scene that is gone."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "conflictdb").mkdir()
    (tmp_path / "conflictdb" / "last-scene.json").write_text(content)
    (tmp_path / "conflictdb").chmod(0o500)
    run("load", STRAIT)
    run("load", STRAIT, "--scene", "b\x1b[2J")
    (tmp_path / "conflictdb" / "last-scene.json").write_text(content)
    done = run("conflicts")
    assert (done.code, done.out) == (2, "")
    assert "which scene? give --scene NAME; known: 'b\\x1b[2J', 'strait' (see" in done.err


def test_an_unknown_scene_is_refused_and_the_known_ones_named(run: Run) -> None:
    run("load", STRAIT)
    for command in ("detect", "conflicts"):
        done = run(command, "--scene", "nowhere")
        assert (done.code, done.out) == (4, "")
        assert "'nowhere'" in done.err
        assert "strait" in done.err


def test_demo_shows_funnel_conflicts_and_what_to_try(run: Run) -> None:
    done = run("demo")
    assert (done.code, done.err) == (0, "")
    for stage in ("1 broad phase", "2 intersection", "3 projection", "4 solver"):
        assert stage in done.out
    for a_key, b_key in EXPECTED:
        assert re.search(rf"^{a_key} +{b_key} +conflict +2026-06-01 ", done.out, re.MULTILINE)
    assert "CONVOY-1 and CONVOY-2 passed every stage but the last" in done.out
    assert "SUB-1 and SUB-2 cross" in done.out
    assert done.out.partition("Try next:")[2].count("\n  conflictdb --dsn ") == 6
    assert " map   # " in done.out.splitlines()[-1]


def test_nearest_m_prints_near_pairs_too_and_counts_no_conflict(run: Run, tmp_path: Path) -> None:
    apart = [
        {
            "type": "Feature",
            "id": key,
            "geometry": {"type": "LineString", "coordinates": [[0, lat], [0.1, lat]]},
            "properties": {"start": "2026-03-01T00:00:00Z", "speed_kn": 6, "outline_m": [[0, 0]]},
        }
        for key, lat in (("a", 0.0), ("b", 0.01))
    ]
    path = tmp_path / "apart.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": apart}))
    near = run("detect", path, "--nearest-m", "2000", "--fail-on-conflict")
    assert near.code == 0
    lines = near.out.splitlines()
    assert lines[:3] == ["no conflicts", "", "no conflict, but near:"]
    assert lines[-1].split() == ["a", "b", "near", "2026-03-01", "00:00:00", "0.5", "nmi", "apart", "1105.7"]
    (row,) = run("detect", "--scene", "apart", "--format", "json").json
    assert list(row) == COLUMNS
    assert (row["verdict"], row["periods"], row["first_contact"]) == ("near", [], None)
    assert row["closest_at"] == "2026-03-01T00:00:00.000000Z"
    assert row["closest_a_point"]["coordinates"] == [0.0, 0.0]
    (feature,) = run("detect", "--scene", "apart", "--format", "geojson").json["features"]
    assert feature["geometry"]["type"] == "LineString"
    assert run("conflicts", "--scene", "apart", "--format", "json").json == []
    assert '"nearest_m": 2000.0' in run("export", "--scene", "apart", "-").out


def test_history_is_printed_and_conflicts_acknowledged(strait: Run) -> None:
    outcome = strait("history", "FERRY", "DIVING")
    assert re.fullmatch(
        r"EVENT .* A NAME +B NAME\n +\d+  .* opened  DIVING  FERRY  conflict  2026-06-01 09:00.*  Diving .*  Ferry\n",
        outcome.out,
    )
    events = strait("history", "--format", "json").json
    assert len(events) == len(EXPECTED)
    assert events[0]["periods"][0][0].startswith("2026-06-01T")
    last = str(events[-1]["event"])
    assert strait("history", "--after", last).out == "no events\n"
    pair = ("FERRY", "DIVING")
    assert strait("acknowledge", *pair, "--reason", "agreed", "--until", "2100-01-01T00:00Z").out == (
        "acknowledged: FERRY (Ferry), DIVING (Diving on a wreck)\n"
    )
    assert "conflict (acknowledged)" in strait("conflicts").out
    listed = ("conflicts", "--format")
    noted = next(row for row in strait(*listed, "json").json if row["acknowledged_by"])
    assert (noted["a_key"], noted["b_key"], noted["acknowledged_for"]) == ("DIVING", "FERRY", "agreed")
    assert (noted["acknowledged_until"], noted["changed_at"]) == ("2100-01-01T00:00:00.000000Z", None)
    assert [noted["conflict_id"]] == [
        event["conflict_id"] for event in events if (event["a_key"], event["b_key"]) == ("DIVING", "FERRY")
    ]
    assert strait("acknowledge", *pair, "--reason", "=1+1").code == 0
    table = list(csv.DictReader(StringIO(strait(*listed, "csv").out)))
    assert [row["acknowledged_for"] for row in table if row["acknowledged_by"]] == ["'=1+1"]
    assert strait("acknowledge", *pair, "--undo").out.startswith("taken back: FERRY (Ferry), DIVING")
    assert strait("acknowledge", *pair, "--undo").out.startswith("was not acknowledged: FERRY (Ferry), ")
    assert strait("acknowledge", *pair, "--reason", "agreed", "--until", "2000-01-01T00:00Z").code != 0
    for wrong in (("acknowledge", *pair), ("acknowledge", *pair, "--undo", "--until", "2100-01-01T00:00Z")):
        assert strait(*wrong).code == 2
    assert strait("history", *pair, "CABLE").code == 2
    known = ("conflicts", "--known-at")
    assert len(strait(*known, "2100-01-01T00:00Z", "--format", "json").json) == len(EXPECTED)
    assert re.search(
        r"^DIVING  FERRY .*  Diving on a wreck +Ferry$", strait(*known, "2100-01-01T00:00Z").out, re.MULTILINE
    )
    early = strait(*known, "2000-01-01T00:00Z")
    assert (early.code, early.out, "first detection" in early.err) == (4, "", True)
    assert strait(*known, "2000-01-01T00:00Z", "--at", "2000-01-01T00:00Z").code == 2


def test_probe_says_what_a_plan_would_meet(strait: Run) -> None:
    box = "POLYGON((9.1 57.75, 9.4 57.75, 9.4 57.9, 9.1 57.9, 9.1 57.75))"
    area = ("--footprint", box, "--from", "2026-06-01T08:00Z", "--to", "2026-06-01T12:00Z", "--floor-m", "-100")
    rows = strait("probe", *area, "--ceiling-m", "0", "--format", "json").json
    assert pairs(rows) == {("FIRING", "plan"), ("plan", "SUB-2"), ("plan", "FERRY")}
    assert {row["verdict"] for row in rows} == {"conflict"}
    path = ("--path", "LINESTRING(8.2 57.9, 9.2 58.1)", "--times", "2026-06-01T08:00Z, 2026-06-01T11:00Z")
    sizes = ("--haven", "500,500,300,300")
    outcome = strait("probe", *path, *sizes, "--key", "SUB-1", "--fail-on-conflict")
    assert (outcome.code, outcome.out.count("\n")) == (10, 2)
    assert re.search(r"SUB-1 +CABLE +SUB-1 +conflict +2026-06-01 08:41:18", outcome.out)
    assert strait("probe", *path, "--floor-m", "9000", "--fail-on-conflict").out == "no conflicts\n"
    # The plans of a file: here the scene itself, each object in its own place.
    whole = strait("probe", STRAIT, "--format", "json").json
    assert pairs(whole) == EXPECTED
    assert len(whole) == len(EXPECTED)
    late = strait("probe", *path, "--worker", "50ms")
    assert (late.code, "is not answered after" in late.err) == (7, True)
    refused = {
        "must be a Polygon or MultiPolygon as WKT": ("--footprint", "LINESTRING(0 0, 1 1)"),
        "must be a LineString as WKT": ("--path", "LINE", "--times", "2026-06-01T08:00Z"),
        "times": (*path[:3], "2026-06-01T08:00Z"),
    }
    for message, plan in refused.items():
        wrong = strait("probe", *plan)
        assert (wrong.code, message in wrong.err) == (4, True), wrong.err
    assert strait("probe", "--scene", "nowhere", *path).code == 4
    for usage in (
        (),
        (*path, *area),
        path[:2],
        (*area, "--times", path[3]),
        (*area, "--haven", "5,5,5,5"),
        (*path, "--haven", "5,5,5"),
        (*path, "--from", "2026-06-01T08:00Z"),
        *((STRAIT, *more) for more in (area, ("--key", "K"), ("--floor-m", "1"))),
    ):
        assert strait("probe", *usage).code == 2


def plan_file(path: Path, keys: Sequence[str], **starts: str) -> Path:
    """Write some objects of the strait, with other starts for some of them."""
    features = [f for f in json.loads(STRAIT.read_text())["features"] if f["id"] in keys]
    for feature in features:
        if feature["id"] in starts:
            feature["properties"]["start"] = starts[feature["id"]]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_a_probe_has_the_class_and_owner_of_the_object_that_it_replaces(run: Run, tmp_path: Path) -> None:
    times = {"times": ["2026-12-03T08:00:00Z", "2026-12-03T09:00:00Z"], "fore_m": 50, "aft_m": 50}
    ring = [[4.0, 57.0], [4.2, 57.0], [4.2, 57.1], [4.0, 57.1], [4.0, 57.0]]
    line = {"type": "LineString", "coordinates": [[4.0, 57.13], [4.2, 57.13]]}
    of_ferry = times | {"port_m": 50, "starboard_m": 50, "class": "ferry", "owner": "line"}
    area = {"type": "Polygon", "coordinates": [ring]}
    scene = {"name": "ruled", "rules": [{"a_class": "ferry", "b_class": "area", "separation_m": 5000}]}
    features = [
        {"type": "Feature", "id": "A", "geometry": area, "properties": {"owner": "them"}},
        {"type": "Feature", "id": "FERRY", "geometry": line, "properties": of_ferry},
    ]
    path = tmp_path / "ruled.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "scene": scene, "features": features}))
    assert run("detect", path).code == 0
    track = ("--path", "LINESTRING(4 57.13, 4.2 57.13)", "--times", "2026-12-03T08:00Z,2026-12-03T09:00Z")
    box = ("--footprint", "POLYGON((4 57.13, 4.2 57.13, 4.2 57.14, 4 57.13))", "--from", "2026-12-04T08:00Z")
    for plan in (track, box):
        asked = ("probe", "--scene", "ruled", *plan, "--format", "json")
        for options, met in (
            (("--key", "FERRY"), {"A"}),
            (("--key", "new"), set()),
            (("--key", "new", "--class", "ferry"), {"A"}),
            (("--key", "FERRY", "--class", "tug"), set()),
            (("--key", "FERRY", "--owner", "them"), set()),
            (("--class", "ferry", "--owner", "them"), set()),
        ):
            found = run(*asked, *options).json
            # A plan of another key meets FERRY, too.
            keys = {row[name] for row in found for name in ("a_key", "b_key")}
            assert keys - {"FERRY", "plan", "new"} == met, options
    assert run("probe", "--scene", "ruled", path, "--class", "ferry").code == 2


def test_probe_says_what_of_a_file_was_not_read(run: Run, tmp_path: Path) -> None:
    """As load does: columns that look like times."""
    run("detect", STRAIT)
    path = plan_file(tmp_path / "closed.geojson", ["DIVING"])
    document = json.loads(path.read_text())
    properties = document["features"][0]["properties"]
    properties["valid_from"], properties["start"] = properties["start"], None
    path.write_text(json.dumps(document))
    asked = run("probe", "--scene", "strait", path)
    assert "1 area without start or end: valid_from look like times and are not read" in asked.err
    assert asked.err in run("load", "--scene", "strait", path).err


def intent(path: Path, reference: str) -> str:
    """A file of one volume of ASTM F3548, 50 to 80 m above a reference."""
    space: dict[str, Any] = {"outline_circle": {"center": {"lng": 8, "lat": 47}, "radius": {"value": 60, "units": "M"}}}
    for name, height in (("altitude_lower", 50), ("altitude_upper", 80)):
        space[name] = {"value": height, "reference": reference, "units": "M"}
    path.write_text(json.dumps({"reference": {"id": path.stem}, "details": {"volumes": [{"volume": space}]}}))
    return str(path)


def test_heights_of_probed_files_are_those_of_the_scene(run: Run, tmp_path: Path) -> None:
    settings = {"name": "utm", "vertical_datum": "wgs84"}
    ring = [[7.9, 46.9], [8.1, 46.9], [8.1, 47.1], [7.9, 46.9]]
    base = {"type": "Feature", "id": "base", "geometry": {"type": "Polygon", "coordinates": [ring]}}
    band = base | {"properties": {"floor_m": 60, "ceiling_m": 70}}
    files = {name: tmp_path / f"{name}.geojson" for name in ("utm", "same", "other", "all")}
    for name, datum, one in (("utm", "wgs84", band), ("same", "wgs84", band), ("other", "msl", band)):
        own = {"type": "FeatureCollection", "scene": settings | {"vertical_datum": datum}, "features": [one]}
        files[name].write_text(json.dumps(own))
    files["all"].write_text(json.dumps({"type": "FeatureCollection", "features": [base | {"properties": {}}]}))
    assert run("load", str(files["utm"])).code == 0

    ask = "probe", "--scene", "utm", "--format", "json"
    assert pairs(run(*ask, intent(tmp_path / "w84.json", "W84")).json) == {("base", "w84/1")}
    assert run(*ask, str(files["same"])).code == 0
    assert run(*ask, str(files["all"])).code == 0
    amsl = run(*ask, intent(tmp_path / "amsl.json", "AMSL"))
    assert amsl.code == 4
    assert "cannot be compared with heights above the ellipsoid" in amsl.err
    other = run(*ask, str(files["other"]))
    assert other.code == 4
    assert "vertical_datum: is 'wgs84', and the heights are above 'msl': convert them" in other.err


def periods_of(text: str) -> dict[tuple[str, str], list[list[str]]]:
    return {(row["a_key"], row["b_key"]): row["periods"] for row in json.loads(text)}


def test_plans_of_a_file_replace_their_namesakes_together(strait: Run, tmp_path: Path) -> None:
    """With a ferry 20 minutes late: the answer of a detection after loading them, without the old ferry."""
    keys = ("FERRY", "TOW", "DIVING")
    path = plan_file(tmp_path / "late.geojson", keys, FERRY="2026-06-01T07:35:00Z")
    ask = ("probe", path)
    rows = strait(*ask, "--format", "json").json
    changes = strait(*ask, "--diff", "--format", "json").json
    for row in rows:
        assert row["plans"] == [key for key in (row["a_key"], row["b_key"]) if key in keys]
    table = strait(*ask).out.splitlines()
    assert table[0].split()[:3] == ["PLANS", "A", "B"]
    assert any(line.startswith("DIVING, FERRY ") for line in table), table
    listed = list(csv.DictReader(StringIO(strait(*ask, "--format", "csv").out)))
    assert [json.loads(row["plans"]) for row in listed] == [row["plans"] for row in rows]
    features = strait(*ask, "--format", "geojson").json["features"]
    assert [one["properties"]["plans"] for one in features] == [row["plans"] for row in rows]

    before = periods_of(strait("conflicts", "--format", "json").out)
    after = periods_of(strait("detect", path, "--format", "json").out)
    assert {(row["a_key"], row["b_key"]): row["periods"] for row in rows} == {
        pair: periods for pair, periods in after.items() if {*pair} & {*keys}
    }
    expected = dict.fromkeys(before.keys() - after.keys(), "gone")
    expected |= dict.fromkeys(after.keys() - before.keys(), "new")
    expected |= {pair: "changed" for pair in after.keys() & before.keys() if after[pair] != before[pair]}
    assert {(row["a_key"], row["b_key"]): row["change"] for row in changes} == expected
    assert "changed" in expected.values()
    assert strait(*ask, "--diff").out == "no conflict would be gone, new or changed\n"


def test_a_delay_is_a_plan(strait: Run, tmp_path: Path, dsn: str) -> None:
    """It gives a detection's answer for the delayed object, of tracks and areas, without writing."""
    before = strait("conflicts", "--format", "json").out
    asked = strait("probe", "--late", "FERRY", "20m", "--format", "json").json
    file = plan_file(tmp_path / "late.geojson", ["FERRY"], FERRY="2026-06-01T07:35:00Z")
    by_file = strait("probe", file, "--format", "json").json
    assert asked == by_file
    assert asked
    changes = strait("probe", "--late", "FERRY", "20m", "--diff").out.splitlines()
    assert {line.split()[0] for line in changes[1:]} <= {"new", "changed", "gone"}
    both = strait("probe", "--late", "FIRING", "30d", "--late", "FERRY", "1s", "--diff").out
    assert re.search(r"^gone +FIRING +FIRING +SURVEY ", both, re.MULTILINE)
    assert strait("conflicts", "--format", "json").out == before
    assert strait("probe", "--late", "nobody", "20m").code == 4
    for wrong in (
        ("--late", "FERRY", "soon"),
        ("--late", "FERRY", "20m", file),
        ("--late", "FERRY", "1h", "--key", "K"),
    ):
        assert strait("probe", *wrong).code == 2
    with conflictdb.connect(dsn) as db:
        scene = db.scene("strait")
        early = scene.delayed("FERRY", timedelta(minutes=-5))
        assert isinstance(early, conflictdb.Track)
        (own,) = [one for one in conflictdb.read(STRAIT).tracks if one.key == "FERRY"]
        assert (own.times_us - early.times_us == 300_000_000).all()


def test_a_diff_names_what_is_gone_and_new(strait: Run, tmp_path: Path) -> None:
    path = plan_file(tmp_path / "evening.geojson", ["FERRY"], FERRY="2026-06-01T20:15:00Z")
    table = strait("probe", path, "--diff").out.splitlines()
    assert table[0].split()[:4] == ["CHANGE", "PLANS", "A", "B"]
    assert {tuple(line.split()[:4]) for line in table[1:]} == {
        ("gone", "FERRY", *pair) for pair in EXPECTED if "FERRY" in pair
    }
    strait("detect", path)
    back = plan_file(path, ["FERRY"])
    changes = strait("probe", back, "--diff", "--format", "json").json
    assert {(row["change"], row["a_key"], row["b_key"]) for row in changes} == {
        ("new", *pair) for pair in EXPECTED if "FERRY" in pair
    }


def test_explain_says_why(strait: Run) -> None:
    outcome = strait("explain", "FERRY", "DIVING")
    assert outcome.code == 0
    assert outcome.out.startswith(
        '"DIVING" (area, "Diving on a wreck") and "FERRY" (track, "Ferry"): conflict\n'
        "  they meet\n  from 2026-06-01 09:00:00Z"
    )
    facts = strait("explain", "SUB-1", "SUB-2", "--format", "json").json
    assert (facts["verdict"], facts["decided_by"]) == ("apart", {"stage": 1, "by": "height"})
    assert [one["key"] for one in facts["delays"]] == ["SUB-1", "SUB-2"]
    assert outcome.out.splitlines()[-2:] == [
        "  if only one of these two departs at another time:",
        '    "FERRY" must leave 17 min 26 s earlier to clear "DIVING"; no later departure within 2 h does',
    ]
    for a, b, says in (
        ("FERRY", "TOW", '"FERRY" must leave 7 min 59 s later or 11 min 18 s earlier to clear "TOW"'),
        ("FERRY", "TOW", '"TOW" must leave 11 min 18 s later or 7 min 59 s earlier to clear "FERRY"'),
        ("SUB-1", "CABLE", 'no delay within 2 h clears "SUB-1": it meets "CABLE"'),
        ("SUB-1", "SUB-2", '"SUB-1" may leave 2 h later or earlier without a conflict'),
        ("CONVOY-1", "CONVOY-2", '"CONVOY-1" may leave up to 29 s later before it meets "CONVOY-2", and 2 h earlier'),
    ):
        assert f"    {says}" in strait("explain", a, b).out.splitlines()
    assert strait("explain", "DIVING", "CABLE", "--format", "json").json["delays"] == []
    assert "departs at another time" not in strait("explain", "DIVING", "CABLE").out
    unknown = strait("explain", "FERRY", "nobody")
    assert unknown.code != 0
    assert "is no object of scene 'strait'" in unknown.err


def test_approaches_are_printed_in_every_format(run: Run) -> None:
    run("detect", STRAIT, "--nearest-m", "20000")
    rows = run("approaches", "--scene", "strait", "--format", "json").json
    assert pairs(rows) > EXPECTED
    assert {row["verdict"] for row in rows} == {"conflict", "near"}
    assert all(row["closest_m"] == 0.0 for row in rows if row["verdict"] == "conflict")
    assert all(0.0 < row["closest_m"] <= 20000.0 for row in rows if row["verdict"] == "near")
    table = run("approaches", "--scene", "strait").out.splitlines()
    assert len(table) == 1 + len(rows)
    read = list(csv.DictReader(StringIO(run("approaches", "--scene", "strait", "--format", "csv").out)))
    assert list(read[0]) == list(rows[0])
    assert [float(row["closest_m"]) for row in read] == [row["closest_m"] for row in rows]
    assert json.loads(read[0]["a_point"]) == rows[0]["a_point"]
    features = run("approaches", "--scene", "strait", "--format", "geojson").json["features"]
    assert [feature["properties"] for feature in features] == rows
    run("detect", "--scene", "strait", "--nearest-m", "0")
    assert pairs(run("approaches", "--scene", "strait", "--format", "json").json) == EXPECTED


def test_the_phases_of_a_detection_and_of_loading_are_reported(dsn: str) -> None:
    phases: list[tuple[str, int, int]] = []
    with conflictdb.connect(dsn) as db:
        db.load_files([STRAIT], phase=lambda *phase: phases.append(phase))
        assert list(dict.fromkeys(phase[0] for phase in phases)) == ["reading", "reading MB", "storing objects"]
        phases.clear()
        db.load_files([STRAIT], skip_invalid=True, phase=lambda *phase: phases.append(phase))
        names = ["reading", "reading MB", "checking places", "sending objects", "storing objects"]
        assert list(dict.fromkeys(phase[0] for phase in phases)) == names
        assert [phase[1:] for phase in phases if phase[0] == "checking places"] == [(0, 11), (4, 11), (11, 11)]
        phases.clear()
        db.scene("strait").detect(full=True, phase=lambda *phase: phases.append(phase))
    names = list(dict.fromkeys(phase[0] for phase in phases))
    assert names == ["preparing objects", "indexing", "comparing objects", "solving pairs", "writing conflicts"]
    assert ("preparing objects", 11, 0) in phases
    solved = [phase for phase in phases if phase[0] == "solving pairs"]
    assert solved[-1][1] == solved[-1][2] > 0


def test_a_detection_in_several_chunks_is_one_phase_with_an_estimate(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its end is extrapolated from the objects whose pairs were found; conflicts are written in between."""
    monkeypatch.setattr(MemoryBudget, "of", lambda memory_mb: MemoryBudget(pairs=4, pieces=1_000, boxes=1_000))
    phases: list[tuple[str, int, int]] = []
    with conflictdb.connect(dsn) as db:
        db.load_files([STRAIT])
        run = db.scene("strait").detect(full=True, phase=lambda *phase: phases.append(phase))
    assert run.conflicts == len(EXPECTED)
    names = [name for name, _ in groupby(phases, key=lambda phase: phase[0])]
    assert names == ["preparing objects", "indexing", "comparing objects", "solving pairs", "writing conflicts"]
    solved = [phase[1:] for phase in phases if phase[0] == "solving pairs"]
    assert any(0 < done < of != solved[-1][1] for done, of in solved)
    assert solved[-1][0] == solved[-1][1]


def test_delays_say_when_tracks_could_depart_instead(run: Run) -> None:
    run("load", STRAIT)
    found = run("delays", "--scene", "strait", "--within", "8h", "--format", "json").json
    assert [one["key"] for one in found] == ["CONVOY-1", "CONVOY-2", "FERRY", "SUB-1", "SUB-2", "SURVEY", "TOW"]
    [ferry] = run("delays", "FERRY", "--scene", "strait", "--within", "8h", "--format", "json").json
    assert ferry == found[2]
    [forbidden] = ferry["forbidden"]
    assert (forbidden["by"], forbidden["is_proven"]) == (["DIVING", "FIRING", "TOW"], True)
    assert ferry["least_earlier_s"] == round(1e-6 - forbidden["from_s"], 6)
    assert found[3]["blocked_by"] == ["CABLE"]
    outcome = run("delays", "--scene", "strait")
    assert (outcome.code, outcome.err) == (0, "")
    assert re.search(
        r"^TOW +conflict +2026-06-01 06:45 +06:57 \(12 min\) +06:37 \(8 min\) +Tug with .* line +FERRY \(Ferry\)$",
        outcome.out,
        re.MULTILINE,
    )
    assert re.search(
        r"^CONVOY-1 +free +2026-06-01 \S+ +0:00:29\.\d+ +First ship of a convoy +CONVOY-2 \(Second .* behind\)$",
        outcome.out,
        re.MULTILINE,
    )
    assert outcome.out.splitlines()[-3:] == [
        "SUB-1 (Submarine haven, deep): no departure within 2 h clears CABLE (Cable works on the sea bed)",
        "SUB-2 (Submarine haven, shallow): no departure within 2 h clears DIVING (Diving on a wreck)",
        "clear, no margin",
    ]
    exact = run("delays", "--scene", "strait", "--round", "0", "--tz", "Europe/Copenhagen").out
    assert "DEPARTS (Europe/Copenhagen)" in exact
    assert re.search(r"^TOW .* 2026-06-01 08:45 +08:56:17.337145 \(11 min 17.337145 s\) ", exact, re.MULTILINE)
    alone = run("delays", "TOW", "--scene", "strait", "--within", "30m").out
    assert re.search(
        r"^ *-0:07:58\.\d+ +\+0:11:17\.\d+ +0\.00000\d, 0\.00000\d +yes +FERRY \(Ferry\)$", alone, re.MULTILINE
    )
    assert run("delays", "CONVOY-1", "--scene", "strait", "--within", "10s").out.splitlines()[1].split()[4:] == (
        ["0:00:10", "or", "more", "First", "ship", "of", "a", "convoy"]
    )
    soon, late = (run("delays", "--scene", "strait", "--now", f"2026-06-01T{now}Z") for now in ("06:40", "06:46"))
    assert re.search(
        r"^TOW +conflict +2026-06-01 06:45 +06:57 \(12 min\) +none +Tug.* FERRY \(Ferry\)$", soon.out, re.MULTILINE
    )
    assert re.search(
        r"^TOW +conflict +2026-06-01 06:45 +departed +departed +Tug.* FERRY \(Ferry\)$", late.out, re.MULTILINE
    )
    assert re.search(
        r"^CONVOY-1 +free +2026-06-01 \S+ +departed +departed +First ship of a convoy +CONVOY-2 \(.*\)$",
        late.out,
        re.MULTILINE,
    )
    assert "SUB-1 (" not in late.out
    assert "CLEAR BY" not in soon.out
    wide, narrow = (run("delays", "--scene", "strait", "--clear-within-m", metres) for metres in ("20000", "100"))
    assert re.search(
        r"^CONVOY-1 +free +2026-06-01 \S+ +0:00:29\.\d+ +\d+ m +First ship of a convoy +CONVOY-2 \(.*\)$",
        wide.out,
        re.MULTILINE,
    )
    assert re.search(
        r"^CONVOY-1 +free +2026-06-01 \S+ +0:00:29\.\d+ +100 m or more +First ship of a convoy +CONVOY-2 \(.*\)$",
        narrow.out,
        re.MULTILINE,
    )
    assert re.search(r"^TOW +conflict .* +06:37 \(8 min\) +Tug.* FERRY \(Ferry\)$", wide.out, re.MULTILINE)


DAY = Path(__file__).resolve().parents[1] / "acceptance" / "tasks" / "day.geojson"


def test_windows_margins_and_areas_in_clock_times(run: Run) -> None:
    """The three best departures from 06 to 12 with five minutes of margin: the first is 10:42:26 without a margin."""
    run("load", DAY)
    ask = ("delays", "FERRY NORTH", "--scene", "skagerrak", "--from", "2026-12-01T06:00Z", "--to", "2026-12-01T12:00Z")
    exact = run(*ask, "--best", "3", "--round", "0").out.splitlines()
    assert "clear, no margin" in exact
    assert "free    10:42:25.784273-12:00" in exact
    found = run(*ask, "--best", "3", "--margin", "5m").out.splitlines()
    assert found[1].startswith("FERRY NORTH  too close  2026-12-01 06:00  10:48 (4 h 48 min)  ")
    assert found[3:] == [
        "clear by 5 min",
        "",
        "free    10:48-12:00",
        *(line for line in found if line.startswith("closed  06:0")),
        "closed  08:17-10:48, by FERRY SOUTH (Morning ferry southbound)",
    ]
    # An area alone: when it would have to end.
    tanker = run("delays", "TANKER", "--scene", "skagerrak", "--within", "8h", "--best", "1").out.splitlines()
    assert "closed  06:41-08:02, by SURVEY-7 (Survey corridor); free if it ends at 07:40" in tanker
    assert tanker[5] == "free    2026-11-30 21:30-2026-12-01 03:05"
    area = run("delays", "EK D 382", "--scene", "skagerrak", "--within", "8h", "--margin", "0.5nmi").out
    assert re.search(r"^EK D 382 +too close +2026-12-01 07:00 +09:39 \(2 h 39 min\) +04:44 \(2 h 16 min\) ", area, re.M)
    assert "clear by 0.5 nmi" in area
    for args, says in (
        (("--best", "3"), "--from, --to and --best need a KEY"),
        (("TANKER", "--margin", "20"), "must be a time such as 5m (minutes) or 90s, or a distance such as 0.5nmi"),
        (("TANKER", "--round", "20"), "must be a duration with a unit"),
        (("TANKER", "--from", "2026-12-01T06:00"), "needs an offset, such as Z or +02:00, or --tz"),
    ):
        refused = run("delays", *args, "--scene", "skagerrak")
        assert (refused.code, refused.out) == (2, "")
        assert says in refused.err


def test_speeds_and_waits_say_what_else_a_track_could_do(run: Run) -> None:
    run("load", STRAIT)
    found = run("speeds", "--scene", "strait")
    assert (found.code, found.err) == (0, "")
    assert re.search(r"^TOW +conflict +0\.938 +1\.045 +Tug.* FERRY \(Ferry\)$", found.out, re.MULTILINE)
    assert re.search(r"^CONVOY-1 +free +First ship of a convoy +CONVOY-2 \(.*\)$", found.out, re.MULTILINE)
    assert "SUB-1 (Submarine haven, deep): no speed from 0.5 to 2 times the planned one clears CABLE (" in found.out
    alone = run("speeds", "TOW", "--scene", "strait", "--leg", "1")
    assert re.search(r"^ *0\.93859\d+ +1\.04413\d+ +\S+e-\d+, \S+e-\d+ +yes +FERRY \(Ferry\)$", alone.out, re.MULTILINE)
    [tow] = run("speeds", "TOW", "--scene", "strait", "--format", "json").json
    assert (tow["key"], tow["leg"], tow["forbidden"][0]["by"]) == ("TOW", None, ["FERRY"])
    assert 0.5 < tow["slower"] < tow["forbidden"][0]["from_factor"]
    # The printed factors have fewer digits, and are farther away.
    assert tow["slower"] >= 0.938
    assert tow["faster"] <= 1.045
    waits = run("delays", "TOW", "--waypoint", "2", "--scene", "strait")
    assert waits.out.splitlines()[3].endswith("no wait at waypoint 2 within 2 h clears FERRY (Ferry)")
    for args in (["--leg", "1"], ["TOW", "--leg", "9"], ["TOW", "--slowest", "2"]):
        refused = run("speeds", *args, "--scene", "strait")
        assert (refused.code, refused.out) == (4, "")
        assert refused.err.startswith("conflictdb: speeds: ")


def test_what_is_gone_is_listed_as_well(run: Run, dsn: str) -> None:
    """`--since` never says "no conflicts" alone after some have closed; what opened again is not gone."""
    assert run("detect", STRAIT).code == 0
    with psycopg.connect(dsn) as conn:
        conn.execute("UPDATE conflictdb.area SET ceiling_m = -5000, floor_m = -6000 WHERE key = 'DIVING'")
    assert run("detect", "--scene", "strait").code == 0
    done = run("conflicts", "--scene", "strait", "--since", "1h")
    assert "3 conflicts have ended since:" in done.out
    assert run("conflicts", "--scene", "strait", "--since", "1h", "FIRING").out.count("closed") == 1
    listed = run("conflicts", "--scene", "strait", "--since", "1h", "--format", "json")
    assert "3 conflicts have ended since: history --since lists them" in listed.err
    assert run("history", "--scene", "strait", "--since", "1h").out.count("closed") == 3
    assert run("history", "--scene", "strait", "--since", "2100-01-01T00:00Z").out == "no events\n"


def test_plans_move_swap_and_depart_later_in_one_question(strait: Run) -> None:
    """Old and new times stand side by side, and a branch with the same changes finds the same."""
    assert (
        strait("probe", "--late", "CONVOY-1", "0:00:01", "--diff").out == "no conflict would be gone, new or changed\n"
    )
    late = strait("probe", "--late", "FERRY", "20m", "--diff").out.splitlines()
    assert "  WAS  " in late[0]
    (firing,) = [line for line in late if "FIRING" in line]
    assert "2026-06-01 08:11:17 to 09:07:24" in firing
    assert "2026-06-01 08:31:17  2026-06-01 09:27:24" in firing
    (row,) = [
        one
        for one in strait("probe", "--late", "FERRY", "20m", "--diff", "--format", "json").json
        if one["a_key"] == "FIRING"
    ]
    assert row["was"].startswith("2026-06-01T08:11:17")
    assert row["periods"][0][0].startswith("2026-06-01T08:31:17")

    changes = ("--move", "FIRING", "2nmi", "270", "--late", "TOW", "-10m", "--swap", "FERRY", "SURVEY")
    probed = strait("probe", *changes, "--format", "json").json
    made = strait("branch", "create", "tried", *changes)
    assert made.out == "tried: a branch of strait, 4 changed\n"
    found = strait("detect", "--scene", "tried", "--format", "json", "--no-region").json
    moved = {"FIRING", "TOW", "FERRY", "SURVEY"}
    periods = {(row["a_key"], row["b_key"]): row["periods"] for row in found if {row["a_key"], row["b_key"]} & moved}
    assert periods == {(row["a_key"], row["b_key"]): row["periods"] for row in probed}
    diff = strait("branch", "diff", "tried", "--scene", "strait").out.splitlines()
    assert diff[0].split() == ["CHANGE", "WHAT", "KEY", "NAME", "OR", "KEY", "NOW", "(UTC)", "WAS", "(UTC)"]
    assert any("2026-06-01 08:11:17 to 09:07:24" in line for line in diff)
    for wrong in (
        ("--move", "FIRING", "2nmi", "left"),
        ("--move", "FIRING", "-2nmi", "0"),
        ("--late", "FERRY", "20"),
        ("--late", "FERRY", "20m", "--path", "LINESTRING(0 0, 1 1)"),
    ):
        assert strait("probe", *wrong).code == 2
    for wrong, lines in (
        (("--move", "NOBODY", "2nmi", "0"), 2),  # with a hint
        (("--swap", "FERRY", "FIRING"), 1),
        (("--move", "FIRING", "9000km", "0"), 1),
    ):
        done = strait("probe", *wrong)
        assert done.code not in (0, 2), done.err
        assert len(done.err.splitlines()) == lines, done.err


def test_probe_reads_a_route_with_the_options_of_load(strait: Run, tmp_path: Path) -> None:
    """A route of a plotter has no times and no size; the probe is that of a detection with the loaded file."""
    path = tmp_path / "route.gpx"
    points = "".join(f'<rtept lat="{lat}" lon="{lon}"/>' for lon, lat in ((9.95, 57.62), (8.9, 57.9), (8.05, 58.07)))
    path.write_text(
        f'<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><rte><name>R</name>{points}</rte></gpx>'
    )
    options = ("--departure", "2026-06-01T07:00:00Z", "--speed-kn", "18", "--haven", "500,500,300,300")
    probed = strait("probe", path, *options, "--format", "json").json
    assert probed
    strait("load", path, "--scene", "strait", *options)
    found = strait("detect", "--format", "json", "--no-region").json
    keys = {one["plans"][0] for one in probed}
    periods = {(row["a_key"], row["b_key"]): row["periods"] for row in found if keys & {row["a_key"], row["b_key"]}}
    assert periods == {(row["a_key"], row["b_key"]): row["periods"] for row in probed}
    assert strait("probe", "--late", "FERRY", "20m", "--speed-kn", "18").code == 2
