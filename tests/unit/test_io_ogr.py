"""Files that OGR opens: columns, layers, reference systems, tracks among areas, and clear refusals."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from ogr_files import write_layer

from conflictdb import formats
from conflictdb.errors import InvalidInput
from conflictdb.formats.instants import parse_instant

SQUARE = shapely.box(4.0, 57.0, 5.0, 58.0)
BOW = shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])
LINE = shapely.LineString([(4, 57), (4.5, 57.1), (5, 57)])
HOURS = ["2026-03-01T05:00:00Z", "2026-03-01T06:00:00Z", "2026-03-01T07:00:00Z"]
HAVEN: dict[str, Any] = {"fore_m": [5.0], "aft_m": [5.0], "port_m": [2.0], "starboard_m": [2.0]}
TIMES = {"times": [json.dumps(HOURS)]}


@pytest.mark.parametrize("name", ["areas.gpkg", "areas.shp", "areas.fgb"])
def test_polygons_become_areas_with_their_columns(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    columns = {"ID": ["A1"], "name": ["Firing"], "start": HOURS[1:2], "floor_m": [-9.0], "colour": ["red"]}
    (area,) = formats.read(write_layer(path, [SQUARE], kind="Polygon", **columns)).areas  # type: ignore[arg-type]
    assert (area.key, area.name, area.floor_m, area.ceiling_m) == ("A1", "Firing", -9.0, None)
    assert (area.start_us, area.end_us) == (parse_instant(HOURS[1]), None)
    assert area.properties == {"colour": "red"}
    assert area.footprint.equals(SQUARE)


def cut(columns: dict[str, Any]) -> dict[str, Any]:
    """Return columns with names as OGR cuts them in a Shapefile, with a warning for each."""
    return {name[:10]: column for name, column in columns.items()}


def test_names_that_a_shapefile_cuts_are_read_whole(tmp_path: Path) -> None:
    own = {"start": HOURS[:1], "speed_mps": [5.0], "outline_m": ["[[0,0]]"]}
    limits = {"xtd_port_m": [500.0], "xtd_starboard_m": [400.0], "max_speed_kn": [20.0], "min_speed_kn": [2.0]}
    path = write_layer(tmp_path / "plan.shp", [LINE], kind="LineString", **own, **cut(limits))
    (track,) = formats.read(path).tracks
    assert track.tolerances == {name: value for name, (value,) in limits.items()}
    assert track.properties == {}
    windows = {
        name: [json.dumps([HOURS[0], "2026-03-02T06:00:00Z"])] for name in ("departure_window", "arrival_window")
    }
    path = write_layer(tmp_path / "windows.shp", [LINE], kind="LineString", **own, **cut(windows))
    (track,) = formats.read(path).tracks
    assert set(track.tolerances or ()) == set(windows)


@pytest.mark.parametrize(
    ("columns", "rule"),
    [
        ({"ceiling_m": [100.0], "vertical_datum": ["AGL"]}, "vertical_datum: must be 'msl', the scene's"),
        ({"xtd_starboard_m": [500.0]}, "xtd_starboard_m: has a meaning for tracks only"),
        ({"time_separation_s": [500.0]}, "time_separation_s: is a setting of the whole scene"),
        ({"starboard_m": [5.0]}, "column starboard_: is cut to 10 characters: it may be starboard_m or starboard_nmi"),
    ],
)
def test_a_name_that_a_shapefile_cuts_is_refused_as_the_whole_name(
    columns: dict[str, Any], rule: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=rule):
        formats.read(write_layer(tmp_path / "areas.shp", [SQUARE], kind="Polygon", **cut(columns)))


def test_columns_that_look_like_times_are_named(tmp_path: Path) -> None:
    """For areas without start or end: they are active for longer than perhaps intended."""
    path = write_layer(
        tmp_path / "zones.gpkg",
        [SQUARE, shapely.box(5.0, 57.0, 6.0, 58.0)],
        valid_from=np.array(["2026-03-01T06:00", "2026-03-02T06:00"], "datetime64[ms]"),
        day=np.array(["2026-03-01", "2026-03-02"], "datetime64[D]"),
        activeUntil=[1_772_323_200, 1_772_323_300],
        remark=["2026", "at 2026-03-01"],
        draught=[7.5, 1e9],
    )
    contents = formats.read(path)
    assert [area.start_us for area in contents.areas] == [None, None]
    heights, remark = contents.remarks
    assert heights.text.startswith("2 areas without floor and ceiling: draught look like heights and are not read")
    rule = "valid_from, day, activeUntil look like times and are not read; rename or map what is meant as these"
    assert remark.text == f"2 areas without start or end: {rule}"
    known = {"start": HOURS[:1], "revised": HOURS[:1], "end": HOURS[1:2]}
    assert list(formats.read(write_layer(tmp_path / "known.gpkg", [SQUARE], **known)).remarks) == []


def test_the_process_that_reads_imports_no_library_that_it_does_not_need() -> None:
    """pyogrio would import pandas and others where they are installed, which takes longer than reading."""
    script = "import io, sys; from conflictdb.formats import ogr_child; ogr_child.main(io.BytesIO(), 0, [])"
    script += "; print([name for name in ('pandas', 'pyarrow', 'shapely') if sys.modules.get(name)])"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, check=True).stdout == b"[]\n"


KML = """<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>
<Placemark><name>FERRY</name>{}</Placemark>
<Placemark><name>ZONE</name><Polygon><outerBoundaryIs><LinearRing><coordinates>9,57 9.4,57 9.4,57.4 9,57</coordinates>
</LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"""
GX_TRACK = """<gx:Track><when>2026-06-01T08:00:00Z</when><when>2026-06-01T09:00:00Z</when>
<gx:coord>9.0 57.0 0</gx:coord><gx:coord>9.5 57.2 0</gx:coord></gx:Track>"""


@pytest.mark.parametrize("track", [GX_TRACK, f"<gx:MultiTrack>{GX_TRACK}</gx:MultiTrack>"])
def test_a_track_of_kml_is_read_with_its_times(tmp_path: Path, track: str) -> None:
    """Also from a KMZ; a line with a begin and an end for all of it is refused, as it says no time of each point."""
    path = tmp_path / "plan.kml"
    path.write_text(KML.format(track))
    contents = formats.read(path)
    (found,) = contents.tracks
    assert (len(contents.areas), contents.skipped) == (1, [])
    assert found.positions_deg.tolist() == [[9.0, 57.0], [9.5, 57.2]]
    assert (found.times_us[1] - found.times_us[0]) == 3600 * 1_000_000
    with zipfile.ZipFile(tmp_path / "plan.kmz", "w") as archive:
        archive.write(path, "doc.kml")
    assert formats.read(tmp_path / "plan.kmz").tracks[0].times_us.tolist() == found.times_us.tolist()
    line = "<LineString><coordinates>9,57 9.5,57.2</coordinates></LineString>"
    span = "<TimeSpan><begin>2026-06-01T08:00:00Z</begin><end>2026-06-01T09:00:00Z</end></TimeSpan>"
    path.write_text(KML.format(span + line))
    with pytest.raises(InvalidInput, match=r"times: are missing: a line with a begin and an end says no time of each"):
        formats.read(path)
    path.write_text(KML.format(track.replace("<when>2026-06-01T09:00:00Z</when>", "")))
    with pytest.raises(InvalidInput, match=r"gx:Track 1 in line \d+: when: must have as many of when and gx:coord"):
        formats.read(path)
    path.write_text(KML.format(track.replace("2026-06-01T09:00:00Z", "2026-06-01T07:00:00Z")))
    with pytest.raises(
        InvalidInput, match=r"when in line \d+: must not be before the one above it; got '2026-06-01T07"
    ):
        formats.read(path)
    path.write_text(KML.format(track.replace("9.5 57.2 0", "9.5 97.2 0")))
    with pytest.raises(InvalidInput, match=r"gx:coord in line \d+: must lie within .* of latitude; got '9.5 97.2 0'"):
        formats.read(path)
    path.write_text(KML.format("<LineString><coordinates>9,57 9.4,57</coordinates></LineString>"))
    assert [one.reason for one in formats.read(path).skipped] == [
        "1 features are LineStrings, without times: no tracks (1)"
    ]


def test_keys_of_kml_are_unique_names(tmp_path: Path) -> None:
    """Other features keep their numbers, also one whose name is the number of another one."""
    path = tmp_path / "plan.kml"
    ring = "<coordinates>9,57 9.4,57 9.4,57.4 9,57</coordinates>"
    polygon = f"<Polygon><outerBoundaryIs><LinearRing>{ring}</LinearRing></outerBoundaryIs></Polygon>"
    names = ("<name>Pier</name>", "<name>Twin</name>", "<name>Twin</name>", "", "<name>plan.4</name>")
    marks = "".join(f"<Placemark>{name}{polygon}</Placemark>" for name in names)
    path.write_text(f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{marks}</Document></kml>')
    areas = formats.read(path).areas
    assert [area.key for area in areas] == ["Pier", "plan.2", "plan.3", "plan.4", "plan.5"]
    assert [area.name for area in areas] == ["Pier", "Twin", "Twin", None, "plan.4"]


def test_lines_without_times_name_columns_that_look_like_them(tmp_path: Path) -> None:
    laid = np.array(["2026-03-01"], "datetime64[D]")
    (skipped,) = formats.read(write_layer(tmp_path / "cables.gpkg", [LINE], laid=laid)).skipped
    assert "(laid look like times, but not of each point): no tracks" in skipped.reason


def test_other_reference_systems_are_transformed(tmp_path: Path) -> None:
    edge = np.radians([4.0, 5.0]) * 6378137.0
    path = write_layer(tmp_path / "areas.gpkg", [shapely.box(edge[0], 0.0, edge[1], 1000.0)], crs="EPSG:3857")
    west, south, east, _ = formats.read(path).areas[0].footprint.bounds
    assert (west, south, east) == pytest.approx((4.0, 0.0, 5.0), abs=1e-9)


def test_features_without_id_are_numbered_and_layers_named(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "areas.gpkg", [SQUARE, SQUARE])
    assert [area.key for area in formats.read(path).areas] == ["areas.1", "areas.2"]
    write_layer(path, [SQUARE], "second")
    assert [area.key for area in formats.read(path).areas] == ["areas.1", "areas.2", "areas.second.1"]


def test_numeric_ids_become_strings(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "areas.gpkg", [SQUARE], id=[1234567890])
    assert formats.read(path).areas[0].key == "1234567890"


FIRST = "feature 1 of layer 'areas'"


@pytest.mark.parametrize(
    ("shape", "columns", "key", "field", "rule"),
    [
        (shapely.GeometryCollection([SQUARE]), {}, FIRST, "geometry", "got a GeometryCollection"),
        (None, {}, FIRST, "geometry", "there is none"),
        (shapely.Polygon(), {}, FIRST, "geometry", "there is none"),
        (BOW, {}, "area 'areas.1'", "geometry", "valid"),
        (SQUARE, {"start": ["2026-03-01T06:00:00"]}, "area 'areas.1'", "start", "offset"),
        (SQUARE, {"floor_m": ["low"]}, "area 'areas.1'", "floor_m", "number"),
        (SQUARE, {"name": [7]}, "area 'areas.1'", "name", "string"),
    ],
)
def test_what_is_no_area_is_refused(
    tmp_path: Path, shape: Any, columns: dict[str, Any], key: str, field: str, rule: str
) -> None:
    path = write_layer(tmp_path / "areas.gpkg", [shape], **columns)
    with pytest.raises(InvalidInput, match=rule) as caught:
        formats.read(path)
    assert (caught.value.source, caught.value.key, caught.value.field) == (str(path), key, field)


def test_duplicate_ids_are_refused(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "areas.gpkg", [SQUARE, SQUARE], id=["a", "a"])
    with pytest.raises(InvalidInput, match="feature 1 of layer 'areas' and feature 2"):
        formats.read(path)


def test_an_unknown_reference_system_is_refused(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "areas.shp", [SQUARE], kind="Polygon")
    path.with_suffix(".prj").unlink()
    with pytest.raises(InvalidInput, match=r"reference system: is unknown"):
        formats.read(path)


def test_a_file_that_ogr_does_not_know_is_refused(tmp_path: Path) -> None:
    (tmp_path / "areas.xyz").write_text("hello")
    with pytest.raises(InvalidInput, match="cannot be read by OGR"):
        formats.read(tmp_path / "areas.xyz")


def test_an_archive_is_to_be_unzipped_and_files_of_a_directory_named(tmp_path: Path) -> None:
    """Official zones are published so."""
    with zipfile.ZipFile(tmp_path / "zones.zip", "w") as archive:
        archive.writestr("zones.json", '{"features": []}')
    with pytest.raises(InvalidInput, match="cannot be read by OGR as it is: unzip it, and load the files in it"):
        formats.read(tmp_path / "zones.zip")
    with pytest.raises(InvalidInput, match="cannot be read by OGR; name the files in this directory instead"):
        formats.read(tmp_path)


@pytest.mark.parametrize("missing", ["pyogrio", "pyproj"])
def test_without_the_extra_the_error_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    path = write_layer(tmp_path / "areas.gpkg", [SQUARE], crs="EPSG:3857")
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(InvalidInput, match=r"pip install 'conflictdb\[ogr\]'"):
        formats.read(path)


def test_a_track_may_have_heights_per_leg(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "a.gpkg", [LINE], id=["T"], **TIMES, FLOOR_M=["[0, null]"], colour=["red"], **HAVEN)
    (track,) = formats.read(path).tracks
    assert track.key == "T"
    assert track.times_us.tolist() == [parse_instant(hour) for hour in HOURS]
    assert track.positions_deg.tolist() == [list(place) for place in LINE.coords]
    assert track.floors_m is not None
    assert track.floors_m.tolist() == [0.0, -np.inf]
    assert track.properties == {"colour": "red"}


@pytest.mark.parametrize(
    "columns",
    [TIMES, {"Start": [HOURS[0]], "SPEED_KN": [20.0]}, {"datetimes": TIMES["times"]}],
)
@pytest.mark.parametrize("shape", [LINE, shapely.MultiLineString([LINE])])
def test_a_line_with_columns_of_times_is_a_track(tmp_path: Path, columns: dict[str, Any], shape: Any) -> None:
    (track,) = formats.read(write_layer(tmp_path / "a.gpkg", [shape], **columns, **HAVEN)).tracks
    assert track.key == "a.1"
    assert track.times_us[0] == parse_instant(HOURS[0])
    assert track.properties == {}


def test_a_track_in_another_reference_system_is_transformed(tmp_path: Path) -> None:
    scale = np.radians(1.0) * 6378137.0
    line = shapely.LineString([(4 * scale, 0), (5 * scale, 0)])
    path = write_layer(tmp_path / "a.gpkg", [line], crs="EPSG:3857", times=[json.dumps(HOURS[:2])], **HAVEN)
    assert formats.read(path).tracks[0].positions_deg == pytest.approx(np.array([[4, 0], [5, 0]]), abs=1e-9)


@pytest.mark.parametrize(
    ("shape", "columns", "field", "rule"),
    [
        (shapely.MultiLineString([LINE, LINE]), TIMES, "geometry", "must be one line: a track has no gaps"),
        (LINE, {"times": [TIMES["times"][0].replace("06:00:00", "05:00:01")]}, "times[1]", "beyond 2000 kn"),
        (LINE, {"times": ["now and then"]}, "times", "must be a list"),
        (LINE, {**TIMES, "grow_mp": [1.0]}, "grow_mp", "did you mean grow_mps? Rename the column"),
    ],
)
def test_what_is_no_track_is_refused(tmp_path: Path, shape: Any, columns: Any, field: str, rule: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        formats.read(write_layer(tmp_path / "a.gpkg", [shape], **columns, **HAVEN))
    assert (caught.value.key, caught.value.field) == ("track 'a.1'", field)
    assert rule in caught.value.rule


def test_points_and_lines_among_areas_are_left_out_by_name(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "a.gpkg", [SQUARE, shapely.Point(4, 57), LINE, *[shapely.Point(4, 57)] * 12])
    contents = formats.read(path)
    assert [area.key for area in contents.areas] == ["a.1"]
    numbers = "2, 4, 5, 6, 7, 8, 9, 10, 11, 12, …"
    assert [str(one) for one in contents.skipped] == [
        f"{path}: left out layer 'a': 13 features are Points, no areas or tracks ({numbers})",
        f"{path}: left out layer 'a': 1 features are LineStrings, without times: no tracks (3)",
    ]
    assert not any(one.is_whole for one in contents.skipped)


def test_layers_can_be_chosen(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "a.gpkg", [SQUARE], "zones")
    write_layer(path, [BOW], "wrong")
    write_layer(path, [SQUARE], "more")
    assert [area.key for area in formats.read(path, layers=["zones", "more"]).areas] == ["a.zones.1", "a.more.1"]
    with pytest.raises(InvalidInput, match=r"layer: there is no layer 'none'; the file has zones, wrong, more"):
        formats.read(path, layers=["zones", "none"])
    (tmp_path / "a.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    with pytest.raises(InvalidInput, match="has no layers"):
        formats.read(tmp_path / "a.geojson", layers=["zones"])


def test_the_rest_of_a_layer_is_read_on_request(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "a.gpkg", [SQUARE, BOW], begin_time=["", HOURS[0]])
    with pytest.raises(InvalidInput) as caught:
        formats.read(path)
    assert [(one.key, one.field) for one in caught.value] == [("area 'a.2'", "begin_time")]
    contents = formats.read(path, skip_invalid=True)
    assert [area.key for area in contents.areas] == ["a.1"]
    assert [one.key for one in contents.skipped if one.is_whole] == ["area 'a.2'"]


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
        (
            "layer 'routes'",
            "1 features are routes, which have no times: no tracks; --departure and --speed-kn give them",
            (),
        ),
        ("Boat.1", "no time", (3,)),
        ("a.2", "a single fix: no movement to follow", (7,)),
    ]
    assert [remark.text for remark in contents.remarks] == [
        "says nothing of sizes: all tracks are points",
        "has heights that are not read: ele (7)",
    ]


def test_text_that_is_not_utf_8_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.kml"
    kml = '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>Å</name>'
    kml += "<Polygon><outerBoundaryIs><LinearRing><coordinates>4,57 5,57 5,58 4,57</coordinates></LinearRing>"
    kml += "</outerBoundaryIs></Polygon></Placemark></kml>"
    path.write_bytes(kml.encode("latin-1"))
    with pytest.raises(InvalidInput, match="cannot be read by OGR"):
        formats.read(path)
