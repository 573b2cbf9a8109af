"""Layers of files that OGR opens: chosen by name, with tracks among areas, and the rest left out by name."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from conflictdb import formats
from conflictdb.errors import InvalidInput
from conflictdb.formats.instants import parse_instant

pyogrio = pytest.importorskip("pyogrio", reason="the extra 'ogr' is not installed")

SQUARE = shapely.box(4.0, 57.0, 5.0, 58.0)
BOW = shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])
LINE = shapely.LineString([(4, 57), (4.5, 57.1), (5, 57)])
HOURS = ["2026-03-01T05:00:00Z", "2026-03-01T06:00:00Z", "2026-03-01T07:00:00Z"]
HAVEN: dict[str, Any] = {"fore_m": [5.0], "aft_m": [5.0], "port_m": [2.0], "starboard_m": [2.0]}


def write(path: Path, shapes: list[Any], layer: str = "plans", crs: str = "EPSG:4326", **columns: Any) -> Path:
    pyogrio.raw.write(
        path,
        geometry=np.array([None if x is None else shapely.to_wkb(x) for x in shapes], dtype=object),
        field_data=[
            np.array(values, dtype=object if isinstance(values[0], str) else None) for values in columns.values()
        ],
        fields=np.array(list(columns), dtype=object),
        geometry_type="Unknown",
        layer=layer,
        crs=crs,
        driver="GPKG",
        append=path.exists(),
    )
    return path


def test_a_track_may_have_heights_per_leg(tmp_path: Path) -> None:
    times = json.dumps(HOURS)
    path = write(tmp_path / "a.gpkg", [LINE], id=["T"], times=[times], FLOOR_M=["[0, null]"], colour=["red"], **HAVEN)
    (track,) = formats.read(path).tracks
    assert track.key == "T"
    assert track.times_us.tolist() == [parse_instant(hour) for hour in HOURS]
    assert track.positions_deg.tolist() == [list(place) for place in LINE.coords]
    assert track.floors_m is not None
    assert track.floors_m.tolist() == [0.0, -np.inf]
    assert track.properties == {"colour": "red"}


@pytest.mark.parametrize(
    "columns",
    [{"times": [json.dumps(HOURS)]}, {"Start": [HOURS[0]], "SPEED_KN": [20.0]}, {"datetimes": [json.dumps(HOURS)]}],
)
@pytest.mark.parametrize("shape", [LINE, shapely.MultiLineString([LINE])])
def test_a_line_with_columns_of_times_is_a_track(tmp_path: Path, columns: dict[str, Any], shape: Any) -> None:
    (track,) = formats.read(write(tmp_path / "a.gpkg", [shape], **columns, **HAVEN)).tracks
    assert track.key == "1"
    assert track.times_us[0] == parse_instant(HOURS[0])
    assert track.properties == {}


def test_a_track_in_another_reference_system_is_transformed(tmp_path: Path) -> None:
    scale = np.radians(1.0) * 6378137.0
    line = shapely.LineString([(4 * scale, 0), (5 * scale, 0)])
    path = write(tmp_path / "a.gpkg", [line], crs="EPSG:3857", times=[json.dumps(HOURS[:2])], **HAVEN)
    assert formats.read(path).tracks[0].positions_deg == pytest.approx(np.array([[4, 0], [5, 0]]), abs=1e-9)


@pytest.mark.parametrize(
    ("shape", "columns", "field", "rule"),
    [
        (
            shapely.MultiLineString([LINE, LINE]),
            {"times": [json.dumps(HOURS)]},
            "geometry",
            "a track has no gaps; got 2",
        ),
        (
            LINE,
            {"times": ['["2026-03-01T05:00:00Z", "2026-03-01T05:00:01Z", "2026-03-01T06:00:00Z"]']},
            "times[1]",
            "beyond 2000 kn",
        ),
        (LINE, {"times": ["now and then"]}, "times", "must be a list"),
        (LINE, {"times": [json.dumps(HOURS)], "grow_mp": [1.0]}, "grow_mp", "did you mean grow_mps? Rename the column"),
    ],
)
def test_what_is_no_track_is_refused(tmp_path: Path, shape: Any, columns: Any, field: str, rule: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        formats.read(write(tmp_path / "a.gpkg", [shape], **columns, **HAVEN))
    assert (caught.value.key, caught.value.field) == ("track '1'", field)
    assert rule in caught.value.rule


def test_points_and_lines_among_areas_are_left_out_by_name(tmp_path: Path) -> None:
    path = write(tmp_path / "a.gpkg", [SQUARE, shapely.Point(4, 57), LINE, *[shapely.Point(4, 57)] * 12])
    contents = formats.read(path)
    assert [area.key for area in contents.areas] == ["1"]
    numbers = "2, 4, 5, 6, 7, 8, 9, 10, 11, 12, …"
    assert [str(one) for one in contents.skipped] == [
        f"{path}: left out layer 'plans': 13 features are Points, no areas or tracks ({numbers})",
        f"{path}: left out layer 'plans': 1 features are LineStrings, without times: no tracks (3)",
    ]
    assert not any(one.is_whole for one in contents.skipped)


def test_layers_can_be_chosen(tmp_path: Path) -> None:
    path = write(tmp_path / "a.gpkg", [SQUARE], "zones")
    write(path, [BOW], "wrong")
    write(path, [SQUARE], "more")
    assert [area.key for area in formats.read(path, layers=["zones", "more"]).areas] == ["zones.1", "more.1"]
    with pytest.raises(InvalidInput, match=r"layer: there is no layer 'none'; the file has zones, wrong, more"):
        formats.read(path, layers=["zones", "none"])
    (tmp_path / "a.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    with pytest.raises(InvalidInput, match="has no layers"):
        formats.read(tmp_path / "a.geojson", layers=["zones"])


def test_the_rest_of_a_layer_is_read_on_request(tmp_path: Path) -> None:
    path = write(tmp_path / "a.gpkg", [SQUARE, BOW], begin_time=["", HOURS[0]])
    with pytest.raises(InvalidInput) as caught:
        formats.read(path)
    assert [(one.key, one.field) for one in caught.value] == [("area '2'", "begin_time")]
    contents = formats.read(path, skip_invalid=True)
    assert [area.key for area in contents.areas] == ["1"]
    assert [one.key for one in contents.skipped if one.is_whole] == ["area '2'"]


GPX = """<?xml version="1.0"?>
<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">
<wpt lat="57" lon="4"><name>W</name></wpt>
<rte><name>R</name><rtept lat="57" lon="4"/><rtept lat="57.1" lon="4"/></rte>
<trk><name>Boat</name>
<trkseg>{}</trkseg><trkseg>{}</trkseg></trk>
<trk><trkseg>{}</trkseg></trk>
</gpx>
"""


def point(lon: float, time: str) -> str:
    return f'<trkpt lat="57" lon="{lon}"><ele>3</ele>{time and f"<time>{time}</time>"}</trkpt>'


def test_gpx_tracks_are_read_as_positions(tmp_path: Path) -> None:
    path = tmp_path / "a.gpx"
    first = point(4, HOURS[0]) + point(4.1, "2026-03-01T07:00:00.25+01:00") + point(4.2, "") + point(4.2, HOURS[2])
    path.write_text(GPX.format(first, point(5, HOURS[0]) + point(5.1, HOURS[1]), point(6, HOURS[0])))
    contents = formats.read(path)
    assert [(track.key, track.name) for track in contents.tracks] == [("Boat.1", "Boat"), ("Boat.2", "Boat")]
    times = [parse_instant(HOURS[0]), parse_instant(HOURS[1]) + 250_000, parse_instant(HOURS[2])]
    assert contents.tracks[0].times_us.tolist() == times
    assert contents.tracks[0].positions_deg.tolist() == [[4, 57], [4.1, 57], [4.2, 57]]
    assert contents.tracks[0].outline_m.tolist() == [[0, 0]]
    assert [(one.key, one.reason, one.lines) for one in contents.skipped] == [
        ("layer 'waypoints'", "1 features are waypoints: no tracks", ()),
        ("layer 'routes'", "1 features are routes, which have no times: no tracks", ()),
        ("Boat.1", "no time", (3,)),
        ("2", "a single fix: no movement to follow", (7,)),
    ]
    assert [remark.text for remark in contents.remarks] == ["says nothing of sizes: all tracks are points"]


def test_text_that_is_not_utf_8_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.kml"
    kml = '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>Å</name>'
    kml += "<Polygon><outerBoundaryIs><LinearRing><coordinates>4,57 5,57 5,58 4,57</coordinates></LinearRing>"
    kml += "</outerBoundaryIs></Polygon></Placemark></kml>"
    path.write_bytes(kml.encode("latin-1"))
    with pytest.raises(InvalidInput, match="cannot be read by OGR"):
        formats.read(path)
