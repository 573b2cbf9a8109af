"""Areas through OGR: columns, reference systems, and clear refusals."""

import sys
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


def write(path: Path, shapes: list[Any], crs: str | None = "EPSG:4326", kind: str = "Polygon", **columns: Any) -> Path:
    pyogrio.raw.write(
        path,
        geometry=np.array([None if shape is None else shapely.to_wkb(shape) for shape in shapes], dtype=object),
        field_data=[np.array(values) for values in columns.values()],
        fields=np.array(list(columns), dtype=object),
        geometry_type=kind,
        crs=crs,
        append=path.exists(),
        **({"layer": "second"} if path.exists() else {}),
    )
    return path


@pytest.mark.parametrize("name", ["areas.gpkg", "areas.shp", "areas.fgb"])
def test_polygons_become_areas_with_their_columns(tmp_path: Path, name: str) -> None:
    path = write(
        tmp_path / name,
        [SQUARE],
        ID=np.array(["A1"], dtype=object),
        name=np.array(["Firing"], dtype=object),
        start=np.array(["2026-03-01T06:00:00Z"], dtype=object),
        floor_m=[-9.0],
        colour=np.array(["red"], dtype=object),
    )
    (area,) = formats.read(path).areas
    assert (area.key, area.name, area.floor_m, area.ceiling_m) == ("A1", "Firing", -9.0, None)
    assert (area.start_us, area.end_us) == (parse_instant("2026-03-01T06:00:00Z"), None)
    assert area.properties == {"colour": "red"}
    assert area.footprint.equals(SQUARE)


def test_columns_that_look_like_times_are_named(tmp_path: Path) -> None:
    """Of areas without start or end: they are active for longer than may be meant."""
    path = write(
        tmp_path / "zones.gpkg",
        [SQUARE, shapely.box(5.0, 57.0, 6.0, 58.0)],
        valid_from=np.array(["2026-03-01T06:00", "2026-03-02T06:00"], "datetime64[ms]"),
        day=np.array(["2026-03-01", "2026-03-02"], "datetime64[D]"),
        activeUntil=[1_772_323_200, 1_772_323_300],
        remark=np.array(["2026", "at 2026-03-01"], dtype=object),
        draught=[7.5, 1e9],
    )
    contents = formats.read(path)
    assert [area.start_us for area in contents.areas] == [None, None]
    (remark,) = contents.remarks
    rule = "valid_from, day, activeUntil look like times and are not read; rename what is meant as these"
    assert remark.text == f"2 areas without start or end: {rule}"
    known = {name: np.array(["2026-03-01T06:00:00Z"], dtype=object) for name in ("start", "revised")}
    known["end"] = np.array(["2026-03-01T08:00:00Z"], dtype=object)
    assert list(formats.read(write(tmp_path / "known.gpkg", [SQUARE], **known)).remarks) == []


KML = """<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>
<Placemark><name>FERRY</name>{}</Placemark>
<Placemark><name>ZONE</name><Polygon><outerBoundaryIs><LinearRing><coordinates>9,57 9.4,57 9.4,57.4 9,57</coordinates>
</LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"""
GX_TRACK = """<gx:Track><when>2026-06-01T08:00:00Z</when><when>2026-06-01T09:00:00Z</when>
<gx:coord>9.0 57.0 0</gx:coord><gx:coord>9.5 57.2 0</gx:coord></gx:Track>"""


@pytest.mark.parametrize("track", [GX_TRACK, f"<gx:MultiTrack>{GX_TRACK}</gx:MultiTrack>"])
def test_a_track_of_kml_is_refused_with_the_reason(tmp_path: Path, track: str) -> None:
    """Its times get lost on the way; all other objects are read if it is left out."""
    path = tmp_path / "plan.kml"
    path.write_text(KML.format(track))
    with pytest.raises(InvalidInput, match=r"times: are missing: .* as a gx:Track has"):
        formats.read(path)
    contents = formats.read(path, skip_invalid=True)
    assert (len(contents.areas), contents.tracks) == (1, [])
    assert [one.is_refused for one in contents.skipped] == [True]
    path.write_text(KML.format("<LineString><coordinates>9,57 9.4,57</coordinates></LineString>"))
    assert [one.reason for one in formats.read(path).skipped] == [
        "1 features are LineStrings, without times: no tracks (1)"
    ]


def test_keys_of_kml_are_unique_names(tmp_path: Path) -> None:
    """Other features keep their numbers, also one whose name is the number of another one."""
    path = tmp_path / "plan.kml"
    ring = "<coordinates>9,57 9.4,57 9.4,57.4 9,57</coordinates>"
    polygon = f"<Polygon><outerBoundaryIs><LinearRing>{ring}</LinearRing></outerBoundaryIs></Polygon>"
    names = ("<name>Pier</name>", "<name>Twin</name>", "<name>Twin</name>", "", "<name>4</name>")
    marks = "".join(f"<Placemark>{name}{polygon}</Placemark>" for name in names)
    path.write_text(f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{marks}</Document></kml>')
    areas = formats.read(path).areas
    assert [area.key for area in areas] == ["Pier", "2", "3", "4", "5"]
    assert [area.name for area in areas] == ["Pier", "Twin", "Twin", None, "4"]


def test_lines_without_times_name_columns_that_look_like_them(tmp_path: Path) -> None:
    line = shapely.LineString([(4.0, 57.0), (5.0, 58.0)])
    laid = np.array(["2026-03-01"], "datetime64[D]")
    (skipped,) = formats.read(write(tmp_path / "cables.gpkg", [line], kind="LineString", laid=laid)).skipped
    assert "(laid look like times, but not of each point): no tracks" in skipped.reason


def test_other_reference_systems_are_transformed(tmp_path: Path) -> None:
    edge = np.radians([4.0, 5.0]) * 6378137.0
    path = write(tmp_path / "areas.gpkg", [shapely.box(edge[0], 0.0, edge[1], 1000.0)], crs="EPSG:3857")
    west, south, east, _ = formats.read(path).areas[0].footprint.bounds
    assert (west, south, east) == pytest.approx((4.0, 0.0, 5.0), abs=1e-9)


def test_features_without_id_are_numbered_and_layers_named(tmp_path: Path) -> None:
    path = write(tmp_path / "areas.gpkg", [SQUARE, SQUARE])
    assert [area.key for area in formats.read(path).areas] == ["1", "2"]
    write(path, [SQUARE])
    assert [area.key for area in formats.read(path).areas] == ["areas.1", "areas.2", "second.1"]


def test_numeric_ids_become_strings(tmp_path: Path) -> None:
    path = write(tmp_path / "areas.gpkg", [SQUARE], id=[1234567890])
    assert formats.read(path).areas[0].key == "1234567890"


@pytest.mark.parametrize(
    ("shape", "columns", "key", "field", "rule"),
    [
        (
            shapely.GeometryCollection([SQUARE]),
            {},
            "feature 1 of layer 'areas'",
            "geometry",
            "got a GeometryCollection",
        ),
        (None, {}, "feature 1 of layer 'areas'", "geometry", "there is none"),
        (shapely.Polygon(), {}, "feature 1 of layer 'areas'", "geometry", "there is none"),
        (shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), {}, "area '1'", "geometry", "valid"),
        (SQUARE, {"start": np.array(["2026-03-01T06:00:00"], dtype=object)}, "area '1'", "start", "offset"),
        (SQUARE, {"floor_m": np.array(["low"], dtype=object)}, "area '1'", "floor_m", "number"),
        (SQUARE, {"name": [7]}, "area '1'", "name", "string"),
    ],
)
def test_what_is_no_area_is_refused(
    tmp_path: Path, shape: Any, columns: dict[str, Any], key: str, field: str, rule: str
) -> None:
    path = write(tmp_path / "areas.gpkg", [shape], kind="Unknown", **columns)
    with pytest.raises(InvalidInput, match=rule) as caught:
        formats.read(path)
    assert (caught.value.source, caught.value.key, caught.value.field) == (str(path), key, field)


def test_duplicate_ids_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "areas.gpkg", [SQUARE, SQUARE], id=np.array(["a", "a"], dtype=object))
    with pytest.raises(InvalidInput, match="feature 1 of layer 'areas' and feature 2"):
        formats.read(path)


def test_an_unknown_reference_system_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "areas.shp", [SQUARE])
    path.with_suffix(".prj").unlink()
    with pytest.raises(InvalidInput, match=r"reference system: is unknown"):
        formats.read(path)


def test_a_file_that_ogr_does_not_know_is_refused(tmp_path: Path) -> None:
    (tmp_path / "areas.xyz").write_text("hello")
    with pytest.raises(InvalidInput, match="cannot be read by OGR"):
        formats.read(tmp_path / "areas.xyz")


@pytest.mark.parametrize("missing", ["pyogrio", "pyproj"])
def test_without_the_extra_the_error_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    path = write(tmp_path / "areas.gpkg", [SQUARE], crs="EPSG:3857")
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(InvalidInput, match=r"pip install 'conflictdb\[ogr\]'"):
        formats.read(path)
