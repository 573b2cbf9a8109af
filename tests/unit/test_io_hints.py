"""Files of other programs: names of columns, time zone, havens of points, dates with slashes."""

import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from plan_files import area, write

from conflictdb import FileHints, InvalidInput, read
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import rectangle_outline_m


def file(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def times(path: Path, hints: FileHints | None = None) -> list[datetime]:
    (track,) = read(path, hints=hints).tracks
    return [EPOCH + int(one) * MICROSECOND for one in track.times_us]


def closed(path: Path, **properties: object) -> Path:
    return write(path.parent, area(**properties), file=path.name)


DANISH = """# Timestamp,MMSI,Latitude,Longitude
31/05/2026 23:59:59,219000001,57.0,9.0
01/06/2026 00:09:59,219000001,57.01,9.0
"""


def test_dates_of_the_danish_archive_are_day_first_and_the_file_says_so(tmp_path: Path) -> None:
    path = file(tmp_path / "aisdk.csv", DANISH)
    assert times(path) == [datetime(2026, 5, 31, 23, 59, 59, tzinfo=UTC), datetime(2026, 6, 1, 0, 9, 59, tzinfo=UTC)]
    assert any("read as day/month/year" in str(one) for one in read(path).remarks)
    american = file(tmp_path / "american.csv", DANISH.replace("31/05", "05/31"))
    with pytest.raises(InvalidInput, match="line 2"):
        read(american)


@pytest.mark.parametrize(("field", "meant"), [("strat", "did you mean start"), ("xyzzy", "fields are .*, start, ")])
def test_a_column_is_mapped_to_a_field(tmp_path: Path, field: str, meant: str) -> None:
    """Else it would be kept as a property, and the area would be closed at all times."""
    path = closed(tmp_path / "a.geojson", opens="2026-06-01T09:00Z")
    with pytest.raises(InvalidInput, match=f"{field}: is not a field; {meant}"):
        read(path, hints=FileHints({field: "opens"}))


def test_times_without_offset_are_in_the_zone(tmp_path: Path) -> None:
    path = file(tmp_path / "t.csv", "key,time,lon,lat\nT,2026-06-01T09:00,9,57\nT,2026-06-01T10:00:00Z,9.1,57\n")
    with pytest.raises(InvalidInput, match="offset"):
        read(path)
    zone = FileHints(time_zone="Europe/Copenhagen")
    assert times(path, zone) == [datetime(2026, 6, 1, 7, tzinfo=UTC), datetime(2026, 6, 1, 10, tzinfo=UTC)]
    with pytest.raises(InvalidInput, match="offset"):
        read(path)  # the zone is not kept
    twice = file(tmp_path / "u.csv", path.read_text().replace("2026-06-01T09:00,", "2025-10-26T02:30,"))
    with pytest.raises(InvalidInput, match="occurs twice or never in Europe/Copenhagen"):
        read(twice, hints=zone)
    area = closed(tmp_path / "a.geojson", start="2026-06-01T09:00", end="2026-06-01T10:00")
    (found,) = read(area, hints=zone).areas
    assert found.start_us == int(datetime(2026, 6, 1, 7, tzinfo=UTC).timestamp() * 1e6)
    assert times(file(tmp_path / "d.csv", DANISH), zone)[0] == datetime(2026, 5, 31, 21, 59, 59, tzinfo=UTC)


def test_names_are_mapped_and_a_wrong_one_is_refused(tmp_path: Path) -> None:
    path = closed(tmp_path / "a.geojson", valid_from="2026-06-01T09:00Z", valid_to="2026-06-01T10:00Z")
    (free,) = read(path).areas
    assert free.start_us is None
    (found,) = read(path, hints=FileHints({"start": "valid_from", "end": "valid_to"})).areas
    assert (found.start_us, found.end_us) == (1780304400000000, 1780308000000000)
    assert "valid_from" not in found.properties
    with pytest.raises(InvalidInput, match="column valid_form: is mapped to start, but the file has no such column"):
        read(path, hints=FileHints({"start": "valid_form"}))
    both = closed(tmp_path / "b.geojson", valid_from="2026-06-01T09:00Z", start="2026-06-01T10:00Z")
    with pytest.raises(InvalidInput, match="column start: is there already, and valid_from too"):
        read(both, hints=FileHints({"start": "valid_from"}))
    rows = file(tmp_path / "t.csv", "ship,when,x,y\nT,2026-06-01T09:00Z,9,57\nT,2026-06-01T10:00Z,9.1,57\n")
    with pytest.raises(InvalidInput):
        read(rows)
    assert len(times(rows, FileHints({"id": "ship", "time": "when", "lon": "x", "lat": "y"}))) == 2


def test_tracks_without_a_size_get_the_haven_and_others_keep_theirs(tmp_path: Path) -> None:
    hints = FileHints(haven_m=(500, 200, 100, 150))
    rows = "T,2026-06-01T09:00Z,9,57{0}\nT,2026-06-01T10:00Z,9.1,57{0}\n"
    point = file(tmp_path / "p.csv", "id,time,lon,lat\n" + rows.format(""))
    contents = read(point, hints=hints)
    assert np.array_equal(contents.tracks[0].outline_m, rectangle_outline_m(500, 200, 100, 150))
    assert contents.remarks == []
    assert "all are points" in str(read(point).remarks[0])
    sized = file(tmp_path / "s.csv", "id,time,lon,lat,length,width\n" + rows.format(",100,20"))
    assert np.array_equal(read(sized, hints=hints).tracks[0].outline_m, read(sized).tracks[0].outline_m)


@pytest.mark.parametrize(
    "wrong",
    [{"time_zone": "Mars/Olympus"}, {"haven_m": (1, 2, 3)}, {"haven_m": (1, 2, 3, -4)}, {"time_zone": "/etc/passwd"}],
)
def test_wrong_hints_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InvalidInput):
        FileHints(**wrong)  # type: ignore[arg-type]


HOUR = ["2026-06-01T09:00:00Z", "2026-06-01T10:00:00Z"]


def geojson(path: Path, **members: object) -> Path:
    feature = {
        "type": "Feature",
        "id": "T",
        "geometry": {"type": "LineString", "coordinates": [[9, 57], [9.1, 57]]},
        "properties": {"times": HOUR, **members},
    }
    return file(path, json.dumps({"type": "FeatureCollection", "features": [feature]}))


def mfjson(path: Path, **members: object) -> Path:
    moving = {"type": "MovingPoint", "coordinates": [[9, 57], [9.1, 57]], "datetimes": HOUR}
    return file(path, json.dumps({"type": "Feature", "id": "T", "temporalGeometry": moving, "properties": members}))


def geopackage(path: Path, **members: object) -> Path:
    columns = {name: [one] for name, one in members.items()} | {"times": [json.dumps(HOUR)]}
    frame = geopandas.GeoDataFrame(columns, geometry=[shapely.LineString([(9, 57), (9.1, 57)])], crs=4326)
    (frame.to_parquet if path.suffix == ".parquet" else frame.to_file)(path)
    return path


def kml(path: Path, **members: object) -> Path:
    data = "".join(f'<Data name="{name}"><value>{one}</value></Data>' for name, one in members.items())
    points = "".join(f"<when>{at}</when>" for at in HOUR) + "<gx:coord>9 57 0</gx:coord><gx:coord>9.1 57 0</gx:coord>"
    return file(
        path,
        '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><Placemark>'
        f"<name>T</name><ExtendedData>{data}</ExtendedData><gx:Track>{points}</gx:Track></Placemark></Document></kml>",
    )


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("t.geojson", geojson),
        ("t.mfjson", mfjson),
        ("t.gpkg", geopackage),
        ("t.parquet", geopackage),
        ("t.kml", kml),
    ],
)
def test_the_haven_fills_in_sizes_in_each_format(name: str, write: Callable[..., Path], tmp_path: Path) -> None:
    """Without any size, with some sides, and with a class only; without the option the message names it."""
    hints = FileHints(haven_m=(500, 200, 100, 150))
    for members, sides in (
        ({}, (500, 200, 100, 150)),
        ({"fore_m": 7.0}, (7, 200, 100, 150)),
        ({"aft_m": 7.0, "port_nmi": 1.0, "class": "ferry", "floor_m": -5.0}, (500, 7, 1852, 150)),
        ({"class": "ferry"}, (500, 200, 100, 150)),
    ):
        path = write(tmp_path / name, **members)
        (track,) = read(path, hints=hints).tracks
        assert np.array_equal(track.outline_m, rectangle_outline_m(*sides)), members
        assert (track.object_class, track.floor_m) == (members.get("class"), members.get("floor_m"))
        if members or name != "t.kml":  # a gx:Track without members is a point, with a remark
            with pytest.raises(InvalidInput, match=r"_m: is missing.*; --haven, in Python `haven`, gives a size"):
                read(path)
