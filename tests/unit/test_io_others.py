"""Files of other programs: ids, reference systems, instants, and objects left out on request."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plan_files import HAVEN, TIMES, area, refusal, track, write

from conflictdb import formats
from conflictdb.errors import InvalidInput
from conflictdb.formats.instants import parse_instant

METRES_PER_DEGREE = np.radians(1.0) * 6378137.0  # of longitude, in EPSG:3857


@pytest.mark.parametrize(
    ("key", "properties", "expected"),
    [
        (7, {}, "7"),
        (7.0, {}, "7"),
        (-1.5, {}, "-1.5"),
        (None, {"id": "own"}, "own"),
        (None, {"ID": 12}, "12"),
        ("first", {"id": "second"}, "first"),
    ],
)
def test_ids_may_be_numbers_or_properties(tmp_path: Path, key: Any, properties: Any, expected: str) -> None:
    (one,) = formats.read(write(tmp_path, area(key, **properties, note="x"))).areas
    assert one.key == expected
    assert one.properties == {"note": "x"} | ({"id": "second"} if key == "first" else {})


def test_a_number_and_its_text_are_the_same_id(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"area '7': id: is given twice, by features\[0\] and features\[1\]"):
        formats.read(write(tmp_path, area(7), area("7")))


@pytest.mark.parametrize(
    "name",
    [
        *("EPSG:4326", "CRS84"),
        "urn:ogc:def:crs:OGC:1.3:CRS84",
        "urn:ogc:def:crs:OGC::CRS84",
        "urn:ogc:def:crs:EPSG::4326",
        "urn:ogc:def:crs:EPSG:6.9:4326",
        "http://www.opengis.net/def/crs/OGC/1.3/CRS84",
        "http://www.opengis.net/def/crs/EPSG/0/4326",
    ],
)
def test_longitude_and_latitude_have_many_names(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyproj", None)  # not even imported
    (one,) = formats.read(write(tmp_path, area(), crs={"type": "name", "properties": {"name": name}})).areas
    assert one.footprint.bounds == (4, 57, 5, 58)


@pytest.mark.parametrize(
    "crs", [{"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}, {"properties": {"code": 3857}}]
)
def test_other_reference_systems_are_transformed(tmp_path: Path, crs: Any) -> None:
    ring = [[x * METRES_PER_DEGREE, y] for x, y in [(4, 0), (5, 0), (5, 1000), (4, 0)]]
    moving = {"type": "MovingPoint", "datetimes": TIMES, "coordinates": ring[:2]}
    mover = {"type": "Feature", "id": "M", "temporalGeometry": moving, "properties": HAVEN}
    circle = area("C", radius_m=5)
    circle["geometry"] = {"type": "Point", "coordinates": ring[1]}
    plain = area("P", [[4, 0], [5, 0], [5, 1], [4, 0]])
    plain["crs"] = {"properties": {"name": "EPSG:4326"}}  # the nearer one counts
    contents = formats.read(write(tmp_path, area("A", ring), track("T", ring[:2]), mover, circle, plain, crs=crs))
    assert contents.areas[0].footprint.bounds[:3] == pytest.approx((4, 0, 5), abs=1e-9)
    for one in contents.tracks:
        assert one.positions_deg == pytest.approx(np.array([[4, 0], [5, 0]]), abs=1e-9)
    assert contents.areas[1].footprint.centroid.coords[0] == pytest.approx((5, 0), abs=1e-9)
    assert contents.areas[2].footprint.bounds == (4, 0, 5, 1)


def test_without_the_extra_another_reference_system_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyproj", None)
    with pytest.raises(InvalidInput, match=r"file: crs: is EPSG:3857; to transform it needs the extra 'ogr'"):
        formats.read(write(tmp_path, area(), crs={"properties": {"name": "EPSG:3857"}}))


@pytest.mark.parametrize(
    ("cell", "instant"),
    [
        ("1772344800", "2026-03-01T06:00:00Z"),
        ("1772344800.0000015", "2026-03-01T06:00:00.000002Z"),
        ("1772344800.", "2026-03-01T06:00:00Z"),
        ("20260301T060000Z", "2026-03-01T06:00:00Z"),
    ],
)
@pytest.mark.parametrize("column", ["time", "timestamp"])
def test_positions_may_have_seconds_since_1970(tmp_path: Path, column: str, cell: str, instant: str) -> None:
    path = tmp_path / "fixes.csv"
    path.write_text(f"id,{column},lon,lat\na,{cell},4,57\na,1772348400,4.1,57\n")
    assert formats.read(path).tracks[0].times_us[0] == parse_instant(instant)


@pytest.mark.parametrize("cell", ["20260301", "20260301060000", "1772344800000", "5", "-1772344800"])
def test_numbers_that_may_be_dates_or_milliseconds_are_refused(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "fixes.csv"
    path.write_text(f"id,time,lon,lat\na,{cell},4,57\na,1772348400,4.1,57\n")
    with pytest.raises(InvalidInput, match="a number is seconds since 1970, from 100000000 to 100000000000"):
        formats.read(path)


BOW = [[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]


def test_on_request_the_rest_of_a_file_is_read(tmp_path: Path) -> None:
    fast, slow = (track(key, times=None, start=TIMES[0], speed_kn=kn) for key, kn in (("F", 1e5), ("S", 5)))
    features = [area("bow", BOW, begin=TIMES[0]), area("A"), fast, area("A", note="again"), {"type": "x"}, slow]
    path = write(tmp_path, *features)
    contents = formats.read(path, skip_invalid=True)
    assert [one.key for one in [*contents.areas, *contents.tracks]] == ["A", "S"]
    assert contents.areas[0].properties == {}
    keys = ["area 'bow'", "features[4]", "area 'A'", "track 'F'"]
    assert [one.key for one in refusal(path)] == [one.key for one in contents.skipped] == keys
    assert str(contents.skipped[0]).startswith(f"{path}: left out area 'bow': begin: is not known; did you mean start?")
    assert all(one.is_whole and not one.lines for one in contents.skipped)


def test_mistakes_of_the_file_itself_are_not_skipped(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="separation_m"):
        formats.read(write(tmp_path, area(), separation_m=5), skip_invalid=True)
