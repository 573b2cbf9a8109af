"""Proposals that move areas, in time and in place: found, stored, applied, undone; from the command line."""

import json
from pathlib import Path
from typing import Any

import psycopg
import pytest
import shapely
from commands import Run
from patience import WAIT_S

import conflictdb
from conflictdb.core.moving_plans import moved
from conflictdb.model.plans import Area, Scene

MILE_DEG = 1.0 / 60.0  # of latitude: within half a per cent of a nautical mile


def area(key: str, west: float, **times: Any) -> dict[str, Any]:
    ring = [[west, 57.0], [west + 0.2, 57.0], [west + 0.2, 57.1], [west, 57.1], [west, 57.0]]
    return {
        "type": "Feature",
        "id": key,
        "geometry": {"type": "Polygon", "coordinates": [ring]},
        "properties": {"name": f"area {key}", "owner": "range", **times},
    }


def track(key: str, lat: float) -> dict[str, Any]:
    sizes = dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"), 100)
    return {
        "type": "Feature",
        "id": key,
        "geometry": {"type": "LineString", "coordinates": [[8.0, lat], [12.0, lat]]},
        "properties": {"kind": "track", "start": "2026-12-01T06:00:00Z", "speed_kn": 25, **sizes},
    }


WEEKLY = {"days": ["TUE"], "periods": [["06:00", "12:00"]], "from": "2026-12-01", "until": "2026-12-31"}
TWICE = {"spans": [["2026-12-01T06:00:00Z", "2026-12-01T09:00:00Z"], ["2026-12-01T10:00:00Z", "2026-12-01T12:00:00Z"]]}
ALONE = {"start": "2026-12-01T06:00:00Z", "end": "2026-12-01T12:00:00Z"}


@pytest.fixture
def strip(run: Run, tmp_path: Path) -> Run:
    """Two areas across a ferry's way, with another track 1 nautical mile south of them."""
    features = [area("BOX", 9.0, **ALONE), area("WEEKLY", 11.0, schedule=WEEKLY)]
    features += [track("FERRY", 57.05), track("SOUTH", 57.0 - MILE_DEG)]
    file = tmp_path / "strip.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "scene": {"name": "strip"}, "features": features}))
    assert len(run("detect", file, "--format", "json").json) == 2
    return run


def footprints(dsn: str) -> dict[str, shapely.Geometry]:
    with conflictdb.connect(dsn) as db:
        return {one.key: one.footprint for one in db.scene("strip")._read()[1]}


def test_an_area_goes_the_least_way_aside(strip: Run, dsn: str) -> None:
    """North: 3 nautical miles of the area south of the ferry, and its haven; south the other track is nearer."""
    before = footprints(dsn)
    some = ("resolve", "BOX", "WEEKLY", "--movable", "BOX", "WEEKLY", "--within", "1h", "--limit", f"{WAIT_S:g}s")
    assert "--aside (new waypoints and places of areas)" in strip(*some).out
    found = strip(*some, "--aside", "10nmi")
    assert "BOX (area BOX) goes 3.1 nmi on 000°: keeps clear of FERRY; clears 1 conflict, makes none" in found.out
    assert "WEEKLY (area WEEKLY) goes 3.1 nmi on 000°" in found.out
    proposed = strip(*some, "--aside", "10nmi", "--format", "json").json
    places = {move["key"]: move["place"] for move in proposed["moves"]}
    assert {key: place["bearing_deg"] for key, place in places.items()} == {"BOX": 0.0, "WEEKLY": 0.0}
    for key, place in places.items():
        with conflictdb.connect(dsn) as db:
            plan = db.scene("strip").plan(key)
            for steps, is_free in ((0, True), (-1, False)):
                copy = moved(plan, place["distance_m"] + steps * 185.2, 0.0, Scene("strip"))
                assert (not db.scene("strip").probe([copy])) == is_free, key
    number = str(proposed["proposal_id"])
    assert strip("branch", "create", "tried", "--proposal", number).code == 0
    assert strip("detect", "--scene", "tried", "--format", "json").json == []
    applied = strip("apply", number)
    assert "moved 2 plans" in applied.out
    assert strip("detect", "--scene", "strip", "--format", "json").json == []
    with conflictdb.connect(dsn) as db:
        box = db.scene("strip").plan("BOX")
        assert (box.name, box.owner) == ("area BOX", "range")
        assert isinstance(box, Area)
        there = moved(Area("BOX", before["BOX"]), places["BOX"]["distance_m"], 0.0, Scene("strip"))
        assert isinstance(there, Area)
        assert box.footprint.equals_exact(there.footprint, 0.0)
        [row] = db.connection.execute(
            "SELECT moves FROM conflictdb.proposals WHERE proposal_id = %s", [int(number)]
        ).fetchall()
        assert {move["key"]: (move["is_area"], move["place"]) for move in row[0]} == {
            key: (True, place) for key, place in places.items()
        }
    assert strip("apply", number, "--undo").code == 0
    assert all(shape.equals_exact(before[key], 0.0) for key, shape in footprints(dsn).items())
    assert len(strip("detect", "--scene", "strip", "--format", "json").json) == 2


def test_places_are_the_least_free_steps_along_bearings(strip: Run, dsn: str) -> None:
    """Against detections of the area at every step; with a margin, farther."""
    some = ("delays", "BOX", "--aside", "5nmi")
    found = strip(*some, "--format", "json").json[0]["places"]
    with conflictdb.connect(dsn) as db:
        settings, areas, tracks = db.scene("strip")._read()
    [box] = [one for one in areas if one.key == "BOX"]
    others = [one for one in areas if one.key != "BOX"]
    for place in found:
        free = []
        for steps in range(1, 51):
            copy = moved(box, 185.2 * steps, place["bearing_deg"], settings)
            assert isinstance(copy, Area)
            pairs = conflictdb.solve(tracks, [*others, copy], settings)
            if not any("BOX" in (one.a_key, one.b_key) for one in pairs):
                free.append(185.2 * steps)
        assert place["distance_m"] == (pytest.approx(free[0], abs=1e-6) if free else None), place
    assert {place["bearing_deg"]: place["distance_m"] is not None for place in found}[0.0]
    assert [place["bearing_deg"] for place in found] == [45.0 * n for n in range(8)]
    table = strip(*some).out
    assert "000°     3.1 nmi              FERRY" in table
    assert "180°     none within 5.0 nmi  SOUTH" in table
    [north] = strip(*some, "--bearing", "-360", "--margin", "0.5nmi", "--format", "json").json[0]["places"]
    assert north["distance_m"] == pytest.approx(36 * 185.2)
    for words, code, says in (
        (("delays", "--aside", "1nmi"), 2, "--aside needs a KEY"),
        (("delays", "BOX", "--bearing", "90"), 2, "--bearing is for --aside"),
        (("delays", "BOX", "--aside", "1nmi", "--bearing", "aft"), 2, "a bearing in degrees"),
        (("delays", "FERRY", "--aside", "1nmi"), 4, "'FERRY' is a track"),
    ):
        done = strip(*words)
        assert (done.code, says in done.err) == (code, True), done.err


def test_an_area_of_several_times_moves_in_time_and_back(run: Run, tmp_path: Path, dsn: str) -> None:
    """A change in between is named, and stops the undoing."""
    file = tmp_path / "strip.geojson"
    features = [area("BOX", 9.0, **TWICE), area("ALWAYS", 9.0, start="2026-12-02T00:00:00Z"), track("FERRY", 57.05)]
    file.write_text(json.dumps({"type": "FeatureCollection", "scene": {"name": "strip"}, "features": features}))
    run("detect", file)
    proposed = run("resolve", "BOX", "--movable", "BOX", "--within", "6h", "--round", "0", "--format", "json").json
    [move] = proposed["moves"]
    number = str(proposed["proposal_id"])
    with conflictdb.connect(dsn) as db:
        before = db.scene("strip").plan("BOX")
    run("apply", number)
    assert run("detect", "--scene", "strip", "--format", "json").json == []
    with conflictdb.connect(dsn) as db:
        after = db.scene("strip").plan("BOX")
    by_us = round(1e6 * move["delay_s"])
    assert isinstance(before, Area)
    assert isinstance(after, Area)
    assert before.spans_us is not None
    assert after.spans_us == tuple((start + by_us, end + by_us) for start, end in before.spans_us)
    assert by_us
    run("apply", number, "--undo")
    with conflictdb.connect(dsn) as db:
        assert db.scene("strip").plan("BOX") == before
    again = run("resolve", "BOX", "--movable", "BOX", "--within", "6h", "--format", "json").json
    run("apply", str(again["proposal_id"]))
    with psycopg.connect(dsn) as conn:
        conn.execute("UPDATE conflictdb.area SET ceiling_m = 500 WHERE key = 'BOX'")
    refused = run("apply", str(again["proposal_id"]), "--undo")
    assert (refused.code, "has changed since it was applied: area 'BOX'" in refused.err) == (4, True)
