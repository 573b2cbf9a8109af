"""OGC Moving Features JSON: moving points become tracks; parts that a track cannot represent are refused by name."""

import json
from pathlib import Path
from typing import Any

import pytest
from plan_files import HAVEN

from conflictdb import formats
from conflictdb.errors import InvalidInput
from conflictdb.formats.instants import parse_instant

POINT = {
    "type": "MovingPoint",
    "datetimes": ["2026-03-01T00:00:00Z", "2026-03-01T01:00:00+00"],
    "coordinates": [[4.0, 57.0, 0.0], [5.0, 57.5, 0.0]],
    "interpolation": "Linear",
}


def feature(**changes: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "id": "M1",
        "properties": {**HAVEN, "fore_m": 10, "name": "Mover"},
        "temporalGeometry": {**POINT, **changes},
    }


def read(tmp_path: Path, document: object) -> formats.Contents:
    path = tmp_path / "movers.mfjson"
    path.write_text(json.dumps(document))
    return formats.read(path)


@pytest.mark.parametrize("wrap", [lambda f: {"type": "FeatureCollection", "features": [f]}, lambda f: f])
def test_moving_point_becomes_a_track(tmp_path: Path, wrap: Any) -> None:
    (track,) = read(tmp_path, wrap(feature())).tracks
    assert (track.key, track.name) == ("M1", "Mover")
    assert track.positions_deg.tolist() == [[4.0, 57.0], [5.0, 57.5]]
    assert track.times_us.tolist() == [parse_instant("2026-03-01T00:00:00Z"), parse_instant("2026-03-01T01:00:00Z")]
    assert track.outline_m.tolist() == [[2, 10], [2, -5], [-2, -5], [-2, 10]]


def test_bare_moving_point_is_named_after_the_file(tmp_path: Path) -> None:
    assert [track.key for track in read(tmp_path, {**POINT, "properties": HAVEN}).tracks] == ["movers"]


def test_datetimes_may_be_milliseconds(tmp_path: Path) -> None:
    (track,) = read(tmp_path, feature(datetimes=[0, 3_600_001.5])).tracks
    assert track.times_us.tolist() == [0, 3_600_001_500]


def test_a_single_sequence_is_read(tmp_path: Path) -> None:
    sequence = {name: POINT[name] for name in ("coordinates", "datetimes")}
    changes = {"coordinates": None, "datetimes": None, "sequences": [sequence]}
    assert len(read(tmp_path, feature(**changes)).tracks[0].times_us) == 2


def test_linestring_with_datetimes_is_a_track(tmp_path: Path) -> None:
    line = {"type": "LineString", "coordinates": POINT["coordinates"]}
    properties = {**HAVEN, "datetimes": POINT["datetimes"]}
    trajectory = {"type": "Feature", "id": "L", "geometry": line, "properties": properties}
    assert read(tmp_path, trajectory).tracks[0].properties == {}


@pytest.mark.parametrize(
    ("changes", "field", "rule"),
    [
        ({"type": "MovingPolygon"}, "temporalGeometry.type", "MovingPoint"),
        ({"interpolation": "Step"}, "temporalGeometry.interpolation", "Linear"),
        ({"interpolations": ["Discrete"]}, "temporalGeometry.interpolations", "Linear"),
        ({"sequences": [POINT, POINT]}, "temporalGeometry.sequences", "no gaps"),
        ({"datetimes": ["2026-03-01T00:00:00Z"]}, "times", "2 waypoints, 1 times"),
        ({"datetimes": "x"}, "temporalGeometry.datetimes", "must be a list"),
        ({"datetimes": [0, True]}, "temporalGeometry.datetimes[1]", "number"),
        ({"datetimes": [0, 1e300]}, "temporalGeometry.datetimes[1]", "years 1 to 9999"),
        ({"datetimes": ["2026-03-01T00:00:00", 1]}, "temporalGeometry.datetimes[0]", "offset"),
        ({"coordinates": [[4.0, 57.0]]}, "temporalGeometry.coordinates", "two waypoints"),
        ({"trs": {"type": "Name", "properties": {"name": "urn:julian"}}}, "trs", "Gregorian"),
    ],
)
def test_what_a_track_cannot_be_is_refused(tmp_path: Path, changes: dict[str, Any], field: str, rule: str) -> None:
    with pytest.raises(InvalidInput, match=rule) as caught:
        read(tmp_path, feature(**changes))
    assert caught.value.key == "track 'M1'"
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("properties", "rule"),
    [
        (None, "needs its haven"),
        ({**HAVEN, "start": "2026-03-01T00:00:00Z"}, "together with temporalGeometry"),
        ({**HAVEN, "kind": "area"}, "must be 'track' for a moving feature"),
    ],
)
def test_properties_are_those_of_a_track_without_times(tmp_path: Path, properties: Any, rule: str) -> None:
    with pytest.raises(InvalidInput, match=rule):
        read(tmp_path, {**feature(), "properties": properties})
