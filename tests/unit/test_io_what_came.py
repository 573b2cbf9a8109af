"""What a load brought, in one line, and remarks on what is far from the rest: mistakes that people make."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from conflictdb.formats.reading import read, read_parts
from conflictdb.formats.what_came import WhatCame
from conflictdb.model.place_text import minutes_text

Change = Callable[[dict[str, Any]], None]


def ship(key: str, lon: float, kn: float = 12.0, year: int = 2026, **more: Any) -> dict[str, Any]:
    """Return a ship that sails 60 nmi north."""
    hours = 60.0 / kn
    end = f"{year}-12-01T{int(hours):02}:{int(hours % 1 * 60):02}:00Z"
    return {
        "type": "Feature",
        "id": key,
        "geometry": {"type": "LineString", "coordinates": [[lon, 57.0], [lon, 58.0]]},
        "properties": {
            "times": [f"{year}-12-01T00:00:00Z", end],
            **dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"), 100),
            **more,
        },
    }


def eastward(key: str, lon: float, kn: float) -> dict[str, Any]:
    """Return a ship at a speed on a parallel, which the mean sphere has 0.4 % too short."""
    feature = ship(key, lon, kn)
    feature["geometry"]["coordinates"][1] = [lon + 2.0, 57.0]
    del feature["properties"]["times"]
    feature["properties"] |= {"start": "2026-12-01T00:00:00Z", "speed_kn": kn}
    return feature


def swap(feature: dict[str, Any]) -> None:
    feature["geometry"]["coordinates"] = [[y, x] for x, y in feature["geometry"]["coordinates"]]


def far_away(feature: dict[str, Any]) -> None:
    feature["geometry"]["coordinates"] = [[x - 15.0, y] for x, y in feature["geometry"]["coordinates"]]


def fleet(tmp_path: Path, mistake: dict[str, Any]) -> Path:
    ships = [ship(f"S{n}", 8.0 + n / 10.0) for n in range(5)]
    below = ship("SUB", 8.7, 8.0, floor_m=-200, ceiling_m=-100)
    path = tmp_path / "fleet.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [*ships, below, mistake]}))
    return path


def odd(change: Change) -> dict[str, Any]:
    feature = ship("ODD", 8.9)
    change(feature)
    return feature


@pytest.mark.parametrize(
    ("mistake", "remark"),
    [
        (odd(swap), "track 'ODD': lies 6,"),  # thousands of km
        (odd(far_away), "track 'ODD': lies 797 km from"),  # hundreds
        (ship("ODD", 8.9, 180.0), "track 'ODD': travels at 180 kn, and the others at most at 12 kn:"),
        (eastward("ODD", 8.9, 180.0), "track 'ODD': travels at 180 kn, and the others at most at 12 kn:"),
        (ship("ODD", 8.9, year=2062), "track 'ODD': begins on 2062-12-01, and the others about 2026-12-01:"),
        (
            ship("ODD", 8.9, 8.0, floor_m=100, ceiling_m=200),
            "track 'ODD': is 100 m above the sea at 8 kn, and others are below it:",
        ),
    ],
)
def test_mistakes_that_people_make_are_named(tmp_path: Path, mistake: dict[str, Any], remark: str) -> None:
    path = fleet(tmp_path, mistake)
    whole = [str(one) for one in read(path).remarks]
    assert len(whole) == 1, whole
    assert f"{path}: {remark}" in whole[0]
    with read_parts(path) as parts:
        assert sum(len(tracks) for _, tracks in parts.each) == 7
        assert [str(one) for one in parts.remarks] == whole


def test_metres_a_second_for_knots_show_in_the_line(tmp_path: Path) -> None:
    """12 m/s are 23 kn: no object is odd where all are wrong, but the line says so."""
    line = arrived(fleet(tmp_path, ship("ODD", 8.9, 12.0 * 1.943844)))
    assert line.endswith("2026-12-01 00:00 to 2026-12-01 07:30 UTC, 8 to 23 kn, -200 to -100 m high")
    assert line.startswith("7 tracks, 57°00'N to 58°00'N, 008°00'E to 008°54'E, ")


@pytest.mark.parametrize(("motion", "earth"), [("rhumb", "wgs84"), ("rhumb", "sphere"), ("great_circle", "sphere")])
def test_speeds_are_those_of_the_lines_of_the_scene(tmp_path: Path, motion: str, earth: str) -> None:
    feature = eastward("FAST", 8.0, 180.0)
    feature["geometry"]["coordinates"][1] = [88.0, 57.0]
    path = tmp_path / "fast.geojson"
    settings = {"name": "fast", "motion": motion, "earth": earth}
    path.write_text(json.dumps({"type": "FeatureCollection", "scene": settings, "features": [feature]}))
    contents = read(path)
    came = WhatCame(contents.scene)
    came.add(contents.areas, contents.tracks)
    assert ", 180 kn, " in str(came.summary())
    with read_parts(path) as parts:
        assert list(parts.each)
        assert parts.came == came.summary()


def test_a_fleet_without_mistakes_has_no_remarks(tmp_path: Path) -> None:
    assert not read(fleet(tmp_path, ship("ODD", 8.9, 20.0))).remarks
    aircraft = ship("JET", 8.9, 240.0, floor_m=3_000)
    assert not read(fleet(tmp_path, aircraft)).remarks


def test_a_lone_plan_far_ahead_is_remarked(tmp_path: Path) -> None:
    path = tmp_path / "one.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [ship("ODD", 8.9, year=2062)]}))
    (found,) = read(path).remarks
    assert found.text == "begins on 2062-12-01, more than five years from now: is its year right?"


def test_an_area_that_only_ends_does_not_begin(tmp_path: Path) -> None:
    ring = [[8.0, 57.0], [9.0, 57.0], [9.0, 58.0], [8.0, 57.0]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    area = {"type": "Feature", "id": "A", "geometry": shape, "properties": {"end": "2062-12-01T00:00:00Z"}}
    path = tmp_path / "one.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [area]}))
    found = [one.text for one in read(path).remarks]
    assert "ends on 2062-12-01, more than five years from now: is its year right?" in found, found


def test_the_same_remark_of_many_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "many.geojson"
    features = [ship(f"S{n}", 8.0, year=2062) for n in range(9)]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    found = [str(one.text) for one in read(path).remarks]
    assert len(found) == 4
    assert found[-1] == "6 more objects are like track 'S0' in this"


def test_what_is_always_there_or_by_schedule_is_said(tmp_path: Path) -> None:
    ring = [[179.0, -10.0], [181.0, -10.0], [181.0, -9.0], [179.0, -9.0], [179.0, -10.0]]
    area = {"type": "Feature", "id": "A", "geometry": {"type": "Polygon", "coordinates": [ring]}, "properties": {}}
    path = tmp_path / "always.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [area]}))
    assert arrived(path) == "1 area, 10°00'S to 09°00'S, 179°00'E to 179°00'W, at all times, no heights"
    assert not WhatCame().summary()


def arrived(path: Path) -> str:
    contents, came = read(path), WhatCame()
    came.add(contents.areas, contents.tracks)
    return str(came.summary())


def test_places_in_degrees_and_minutes() -> None:
    assert (minutes_text(57.6867, "NS"), minutes_text(10.0833, "EW")) == ("57°41'N", "010°05'E")
    assert (minutes_text(-0.5, "NS"), minutes_text(190.0, "EW")) == ("00°30'S", "170°00'W")
    assert (minutes_text(89.99999, "NS"), minutes_text(-0.99999, "EW")) == ("90°00'N", "001°00'W")
