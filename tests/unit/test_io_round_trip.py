"""What is exported reads back as exactly the same objects; what is read means what the file said."""

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from scene_strategies import INSTANT, assert_same, scenes

from conflictdb import formats
from conflictdb.earth import geodesy
from conflictdb.formats.instants import format_instant, parse_instant
from conflictdb.formats.scene_file import read_scene, scene_text
from conflictdb.model.plans import METRES_PER_NMI, Area, EarthModel, Scene, Track
from conflictdb.model.speeds import MPS_PER_KNOT


@settings(suppress_health_check=[HealthCheck.too_slow])  # a busy machine takes its time
@given(scenes())
def test_export_reads_back_as_the_same_objects(content: tuple[Scene, list[Area], list[Track]]) -> None:
    scene, some_areas, some_tracks = content
    back = read_scene("".join(scene_text(scene, some_areas, some_tracks)), "other")
    assert back.scene == scene
    assert back.skipped == []
    for one, other in zip([*some_areas, *some_tracks], [*back.areas, *back.tracks], strict=True):
        assert_same(one, other)


@given(INSTANT)
def test_instant_round_trip_is_exact(instant_us: int) -> None:
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


def read(tmp_path: Path, features: list[dict[str, Any]], **members: Any) -> formats.Contents:
    path = tmp_path / "plan.v2.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", **members, "features": features}))
    return formats.read(path)


def track_feature(**properties: Any) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": [[3, 56], [4, 56.5], [5, 57]]}
    haven = {"fore_m": 0, "aft_m": 0, "port_m": 0, "starboard_m": 0}
    return {"type": "Feature", "id": "T", "geometry": geometry, "properties": {**haven, **properties}}


def test_a_file_without_scene_names_none(tmp_path: Path) -> None:
    assert read(tmp_path, []).scene is None


def test_a_scene_without_name_is_named_after_the_file(tmp_path: Path) -> None:
    assert read(tmp_path, [], scene={"tolerance_m": 5}).scene == Scene("plan.v2", tolerance_m=5.0)


def test_start_and_speed_give_times_from_leg_lengths(tmp_path: Path) -> None:
    track = read(tmp_path, [track_feature(start="2026-03-01T00:00:00Z", speed_kn=[10, 20])]).tracks[0]
    earth = geodesy.earth_of(EarthModel.WGS84)
    legs_m = geodesy.rhumb_distance(earth, [3, 4], [56, 56.5], [4, 5], [56.5, 57])
    seconds = np.cumsum(legs_m / (np.array([10, 20]) * MPS_PER_KNOT))
    assert track.times_us[0] == parse_instant("2026-03-01T00:00:00Z")
    assert (track.times_us[1:] - track.times_us[0]).tolist() == np.rint(seconds * 1e6).astype(int).tolist()


def test_speed_in_mps_uses_the_earth_of_the_scene(tmp_path: Path) -> None:
    feature = track_feature(start="2026-03-01T00:00:00Z", speed_mps=1)
    lasts = [
        np.ptp(read(tmp_path, [feature], scene={"earth": earth}).tracks[0].times_us) for earth in ("wgs84", "sphere")
    ]
    assert lasts[0] != lasts[1]


def test_nautical_miles_are_exact(tmp_path: Path) -> None:
    sides = {"fore_m": None, "fore_nmi": 5, "aft_m": None, "aft_nmi": 10, "times": ["2026-03-01T00:00:00Z"] * 3}
    sides["times"] = [f"2026-03-01T0{hour}:00:00Z" for hour in range(3)]
    outline = read(tmp_path, [track_feature(**sides)]).tracks[0].outline_m
    assert outline.tolist() == [[0.0, 5 * METRES_PER_NMI], [0.0, -10 * METRES_PER_NMI]]


def test_closed_outline_is_opened(tmp_path: Path) -> None:
    sides = dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"))
    times = [f"2026-03-01T0{hour}:00:00Z" for hour in range(3)]
    feature = track_feature(**sides, times=times, outline_m=[[0, 0], [1, 0], [0, 1], [0, 0]])
    assert read(tmp_path, [feature]).tracks[0].outline_m.tolist() == [[0, 0], [1, 0], [0, 1]]


def test_unknown_properties_are_kept_and_known_ones_taken(tmp_path: Path) -> None:
    times = [f"2026-03-01T0{hour}:00:00Z" for hour in range(3)]
    track = read(tmp_path, [track_feature(times=times, kind="track", colour="red", end=None)]).tracks[0]
    assert track.properties == {"colour": "red", "end": None}


def test_altitude_is_left_aside(tmp_path: Path) -> None:
    feature = track_feature(times=[f"2026-03-01T0{hour}:00:00Z" for hour in range(3)])
    feature["geometry"]["coordinates"] = [[3, 56, 100], [4, 57], [5, 58, -3.5]]
    track = read(tmp_path, [feature]).tracks[0]
    assert track.positions_deg.tolist() == [[3, 56], [4, 57], [5, 58]]
    assert track.floor_m is None


@pytest.mark.parametrize("name", ["EPSG:4326", "urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:EPSG::4326"])
def test_a_crs_member_that_says_wgs84_is_accepted(tmp_path: Path, name: str) -> None:
    assert read(tmp_path, [], crs={"type": "name", "properties": {"name": name}}).areas == []


def test_compressed_and_marked_files_read_like_plain_ones(tmp_path: Path) -> None:
    text = '\ufeff{"type": "FeatureCollection", "scene": {}, "features": []}'
    (tmp_path / "plan.geojson.gz").write_bytes(gzip.compress(text.encode()))
    assert formats.read(tmp_path / "plan.geojson.gz").scene == Scene("plan")
