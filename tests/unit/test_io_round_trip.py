"""An export reads back as exactly the same objects; reading keeps the meaning of the file."""

import gzip
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import odd_values
import pytest
from draws import draws
from full_plans import lost
from mixed_scenes import odd_scene
from plan_files import HAVEN, read, track

from conflictdb import formats
from conflictdb.earth import geodesy
from conflictdb.errors import InvalidInput
from conflictdb.formats.instants import format_instant, parse_instant
from conflictdb.formats.scene_file import plans_text, read_plans, read_scene, scene_text
from conflictdb.model.plans import METRES_PER_NMI, Area, EarthModel, Scene, Track
from conflictdb.model.speed_limits import MPS_PER_KNOT


@draws("scenes", 100, 2000)
def test_export_reads_back_as_the_same_objects(scenes: int) -> None:
    for seed in range(scenes):
        scene, some_areas, some_tracks = odd_scene(seed)
        back = read_scene("".join(scene_text(scene, some_areas, some_tracks)), "other")
        assert back.scene == scene, seed
        assert back.skipped == [], seed
        for one, other in zip([*some_areas, *some_tracks], [*back.areas, *back.tracks], strict=True):
            assert lost(one, other) == [], seed


@draws("instants", 300, 100_000)
def test_instant_round_trip_is_exact(instants: int) -> None:
    for instant_us in odd_values.instants(np.random.default_rng(3), instants):
        assert parse_instant(format_instant(instant_us)) == instant_us


@pytest.mark.parametrize(
    ("text", "instant_us"),
    [
        ("1970-01-01T00:00:00Z", 0),
        ("1970-01-01t00:00:00z", 0),
        ("1970-01-01 01:00+01:00", 0),
        ("1969-12-31T23:59:59.999999Z", -1),
        ("1970-01-01T00:00:00.0000014Z", 1),
        ("1970-01-01T00:00:00.0000015+00:00", 2),
        ("1970-01-01T00:00:00,000001Z", 1),
        ("19700101T000000Z", 0),
    ],
)
def test_instant_forms(text: str, instant_us: int) -> None:
    assert parse_instant(text) == instant_us


THREE = ([3, 56], [4, 56.5], [5, 57])
HOURS = [f"2026-03-01T0{hour}:00:00Z" for hour in range(3)]


def only_track(folder: Path, scene: dict[str, Any] | None = None, **properties: Any) -> Track:
    """Return a track of three waypoints, as it is read."""
    (one,) = read(folder, track("T", THREE, **{"times": HOURS, **properties}), scene=scene or {}).tracks
    return one


def test_a_scene_without_name_is_named_after_the_file(tmp_path: Path) -> None:
    assert read(tmp_path).scene is None
    assert read(tmp_path, file="plan.v2.geojson", scene={"tolerance_m": 5}).scene == Scene("plan.v2", tolerance_m=5.0)


def test_start_and_speed_give_times_from_leg_lengths(tmp_path: Path) -> None:
    one = only_track(tmp_path, times=None, start="2026-03-01T00:00:00Z", speed_kn=[10, 20])
    earth = geodesy.earth_of(EarthModel.WGS84)
    legs_m = geodesy.rhumb_distance(earth, [3, 4], [56, 56.5], [4, 5], [56.5, 57])
    seconds = np.cumsum(legs_m / (np.array([10, 20]) * MPS_PER_KNOT))
    assert one.times_us[0] == parse_instant("2026-03-01T00:00:00Z")
    assert (one.times_us[1:] - one.times_us[0]).tolist() == np.rint(seconds * 1e6).astype(int).tolist()


def test_speed_in_mps_uses_the_earth_of_the_scene(tmp_path: Path) -> None:
    speed = {"times": None, "start": "2026-03-01T00:00:00Z", "speed_mps": 1}
    lasts = [np.ptp(only_track(tmp_path, {"earth": earth}, **speed).times_us) for earth in ("wgs84", "sphere")]
    assert lasts[0] != lasts[1]


def test_nautical_miles_are_exact(tmp_path: Path) -> None:
    sides = {"fore_m": None, "fore_nmi": 5, "aft_m": None, "aft_nmi": 10, "port_m": 0, "starboard_m": 0}
    outline = only_track(tmp_path, **sides).outline_m
    assert outline.tolist() == [[0.0, 5 * METRES_PER_NMI], [0.0, -10 * METRES_PER_NMI]]


def test_closed_outline_is_opened(tmp_path: Path) -> None:
    outline = only_track(tmp_path, **dict.fromkeys(HAVEN), outline_m=[[0, 0], [1, 0], [0, 1], [0, 0]]).outline_m
    assert outline.tolist() == [[0, 0], [1, 0], [0, 1]]


def test_unknown_properties_are_kept_and_known_ones_taken(tmp_path: Path) -> None:
    assert only_track(tmp_path, kind="track", colour="red", end=None).properties == {"colour": "red", "end": None}


def test_altitude_is_left_aside(tmp_path: Path) -> None:
    (one,) = read(tmp_path, track("T", [[3, 56, 100], [4, 57], [5, 58, -3.5]], times=HOURS)).tracks
    assert one.positions_deg.tolist() == [[3, 56], [4, 57], [5, 58]]
    assert one.floor_m is None


def test_compressed_and_marked_files_read_like_plain_ones(tmp_path: Path) -> None:
    text = '\ufeff{"type": "FeatureCollection", "scene": {}, "features": []}'
    (tmp_path / "plan.geojson.gz").write_bytes(gzip.compress(text.encode()))
    assert formats.read(tmp_path / "plan.geojson.gz").scene == Scene("plan")


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("2026-06-01T24:00:00Z", "2026-06-02T00:00:00Z"),
        ("2026-12-31 24:00+01:00", "2027-01-01T00:00:00+01:00"),
        ("20260601T240000Z", "2026-06-02T00:00:00Z"),
        ("2026-06-01T24:00:00.000Z", "2026-06-02T00:00:00Z"),
        ("2026-06-01T24Z", "2026-06-02T00:00:00Z"),
    ],
)
def test_the_end_of_a_day_is_the_next_midnight(text: str, same: str) -> None:
    assert parse_instant(text) == parse_instant(same)


@pytest.mark.parametrize(
    "text", ["2026-06-01T24:00:01Z", "2026-06-01T24:30Z", "2026-06-01T25:00Z", "9999-12-31T24:00Z"]
)
def test_other_times_of_hour_24_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"got {text!r}")):
        parse_instant(text)


def test_a_date_as_an_end_contains_its_day(tmp_path: Path) -> None:
    """It was read as its first instant: the last day was missing."""
    zone = formats.FileHints(time_zone="Europe/Oslo")
    path = tmp_path / "a.geojson"
    for members in ({"start": "2026-06-01", "end": "20260630"}, {"spans": [["2026-06-01", "2026-06-30"]]}):
        feature = {"type": "Feature", "id": "A", "geometry": SQUARE, "properties": members}
        path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
        (area,) = formats.read(path, hints=zone).areas
        assert format_instant(area.start_us or 0) == "2026-05-31T22:00:00Z"
        assert format_instant(area.end_us or 0) == "2026-06-30T22:00:00Z"
        with pytest.raises(InvalidInput, match="needs an offset"):
            formats.read(path)


SQUARE = {"type": "Polygon", "coordinates": [[[4, 57], [5, 57], [5, 58], [4, 58], [4, 57]]]}


def test_properties_that_name_another_format_change_no_plan_of_a_request() -> None:
    """A zone from a feed keeps them: its key, owner, times and heights were lost on the way to a worker."""
    feed = {"identifier": "Z1", "country": "DEU", "type": "PROHIBITED", "variant": "COMMON", "zoneAuthority": []}
    zone = Area("P", [(0, 0), (1, 0), (1, 1)], None, 10**15, 10**15 + 10**9, 5.0, 10.0, feed, owner="me")
    (read_back,) = read_plans(plans_text([zone]), Scene("s"))
    assert lost(zone, read_back) == []
