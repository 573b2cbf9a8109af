"""KML, KMZ and ZIP: what the OGR library would lose or change in silence is refused by name."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from ogr_files import write_layer

from conflictdb import FileHints, InvalidInput, Scene, read
from conflictdb.formats.objects_writing import object_lines
from conflictdb.model.plans import Area, Track

RING = "<coordinates>8,47 8.1,47 8.1,47.1 8,47</coordinates>"
OUTER = f"<outerBoundaryIs><LinearRing>{RING}</LinearRing></outerBoundaryIs>"
POLYGON = f"<Polygon>{OUTER}</Polygon>"
SCHEMA = '<Schema id="h" name="h"><SimpleField type="{}" name="floor_m"/></Schema>'
FLOOR = (
    '<ExtendedData><SchemaData schemaUrl="#h"><SimpleData name="floor_m">{}</SimpleData></SchemaData></ExtendedData>'
)


def kml(shape: str = POLYGON, more: str = "", outside: str = "") -> str:
    spaces = 'xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"'
    mark = f"<Placemark><name>P</name>{more}{shape}</Placemark>"
    return f"<kml {spaces}><Document>{outside}{mark}</Document></kml>"


def span(begin: str, end: str) -> str:
    return f"<TimeSpan><begin>{begin}</begin><end>{end}</end></TimeSpan>"


def read_text(tmp_path: Path, text: str) -> Any:
    path = tmp_path / "plan.kml"
    path.write_text(text)
    return read(path)


def modes(*given: str) -> str:
    each = (POLYGON.replace("<Polygon>", f"<Polygon><altitudeMode>{mode}</altitudeMode>") for mode in given)
    return f"<MultiGeometry>{''.join(each)}</MultiGeometry>"


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        (kml(more=span("01.01.2026", "2026-01-02T00:00:00Z")), "begin: must be a date and time in ISO 8601"),
        (kml(more=span("2026-01-01T00:00:00Z", "2027-13")), "end: must be a date and time .*; got '2027-13'"),
        (
            kml(more=FLOOR.format("ten"), outside=SCHEMA.format("double")),
            "floor_m: must be a number of the type double",
        ),
        (
            kml(more=FLOOR.format("9.9"), outside=SCHEMA.format("int")),
            "floor_m: must be a number of the type int; got '9",
        ),
        (kml(f"<Polygon>{OUTER}{OUTER.replace('8', '9')}</Polygon>"), "Polygon in line 1: has 2 outer rings, and must"),
        (kml(POLYGON.replace("8.1,47 ", "8.1;47 ")), "coordinates in line 1: must be lon,lat or .*; got '8.1;47'"),
        (kml(POLYGON.replace("8.1,47 ", "NaN,47 ")), "coordinates in line 1: must be lon,lat"),
        (
            kml("<gx:Track><when>2026-01-01T00:00:00Z</when><gx:coord>9 57 0</gx:coord></gx:Track>"),
            "Track in line 1: must have two positions or more; got one",
        ),
        (
            kml("<LineString><coordinates>9,57</coordinates></LineString>"),
            "LineString in line 1: must have two positions or more; got one",
        ),
        (
            kml("<LinearRing><coordinates>9,57 9.4,57 9.4,57.4 9,57</coordinates></LinearRing>"),
            "LinearRing in line 1: is a ring outside of a Polygon: write it as a Polygon, or as a LineString",
        ),
        (
            kml(POLYGON.replace("<coordinates>", "<coordinates>1,1 ")),
            "LinearRing in line 1: must have 4 positions or more, and end where it begins; got 5 from",
        ),
        (
            kml(modes("AboveGround"), FLOOR.format("10"), SCHEMA.format("double")),
            "altitudeMode: must be one of absolute, .*; got 'AboveGround'",
        ),
        (
            kml(modes("absolute", "relativeToGround"), FLOOR.format("10"), SCHEMA.format("double")),
            "altitudeMode: differs within an object",
        ),
    ],
)
def test_a_mistake_that_ogr_passes_over_is_named(tmp_path: Path, text: str, rule: str) -> None:
    """OGR reads such times as none, such numbers as 0, and one ring, position or mode of several."""
    with pytest.raises(InvalidInput, match=f"plan.kml: placemark 'P': {rule}") as refused:
        read_text(tmp_path, text)
    assert "\n" not in str(refused.value)


def test_data_of_kml_are_numbers_where_numbers_are_meant(tmp_path: Path) -> None:
    """Data without a schema are texts in KML; so is a datum, in any case of letters."""
    data = '<ExtendedData><Data name="FLOOR_M"><value>10</value></Data></ExtendedData>'
    (area,) = read_text(tmp_path, kml(more=data)).areas
    assert area.floor_m == 10.0
    with pytest.raises(InvalidInput, match="area 'P': floor_m: must be a number; got 'ten'"):
        read_text(tmp_path, kml(more=data.replace("10", "ten")))
    ground = data.replace("<Data", '<Data name="Vertical_Datum"><value>AGL</value></Data><Data', 1)
    with pytest.raises(InvalidInput, match="vertical_datum: must be 'msl'"):
        read_text(tmp_path, kml(more=ground))


def test_a_written_file_keeps_class_owner_and_properties(tmp_path: Path) -> None:
    """OGR reads no Data of a placemark that has SchemaData, as heights were written."""
    box = shapely.MultiPolygon([shapely.box(8.0, 47.0, 8.1, 47.1)])
    more: Any = {"floor_m": 1.5, "object_class": "navy", "owner": "me & you", "properties": {"colour": "red"}}
    area = Area("A", box, "Zone <1>", **more)
    track = Track("T", [(8.0, 47.0), (8.1, 47.0)], [0, 10**9], [(0.0, 0.0)], name="Ferry")
    contents = read_text(tmp_path, "".join(object_lines("plan.kml", Scene("s"), [area], [track])))
    (found,), (ferry,) = contents.areas, contents.tracks
    assert (found.key, found.name, found.floor_m) == ("A", "Zone <1>", 1.5)
    assert (found.object_class, found.owner, found.properties["colour"]) == ("navy", "me & you", "red")
    assert ferry.key == "T"
    both = FLOOR.format("10").replace("</ExtendedData>", '<Data name="class"><value>navy</value></Data></ExtendedData>')
    with pytest.raises(InvalidInput, match="placemark 'P': class: is Data beside SchemaData"):
        read_text(tmp_path, kml(more=both, outside=SCHEMA.format("double")))


@pytest.mark.parametrize(
    "more",
    [
        {"outline_m": [(-5.5, -20.0), (5.5, -20.0), (5.5, 30.0), (-5.5, 30.0)], "floor_m": -3.25, "owner": "me"},
        {"outline_m": [(0.0, 0.0), (9.5, 0.0), (0.0, 9.5)], "grow_mps": 0.25, "object_class": "ferry"},
        {
            "outlines_m": [[(0.0, 0.0), (size, 0.0), (0.0, size)] for size in (10.0, 20.0, 30.5)],
            "floors_m": [-1.5, -2.5],
            "ceilings_m": [7.5, float("inf")],
        },
        {"outline_m": [(0.0, 0.0)], "tolerances": {"xtd_port_m": 100.0, "xtd_starboard_m": 50.0}},
    ],
)
def test_a_written_track_keeps_all_that_decides_conflicts(tmp_path: Path, more: Any) -> None:
    """Its haven, heights, tolerances and class were lost: OGR gives a gx:Track as a line, and the rest as its data."""
    given = {name: one if isinstance(one, str | float | dict) else np.array(one) for name, one in more.items()}
    given.setdefault("outline_m", np.array(more.get("outlines_m", [[]])[0]))
    times = [1_772_323_200_000_001, 1_772_326_800_000_000, 1_772_330_400_999_999]
    track = Track("T", [(8.0, 57.0), (8.25, 57.0), (8.25, 57.125)], times, **given, name="Ferry")
    contents = read_text(tmp_path, "".join(object_lines("plan.kml", Scene("s"), [], [track])))
    (found,) = contents.tracks
    assert list(contents.remarks) == []
    for name in ("key", "name", "floor_m", "ceiling_m", "grow_mps", "object_class", "owner", "tolerances"):
        assert getattr(found, name) == getattr(track, name), name
    for name in ("positions_deg", "times_us", "outline_m", "outlines_m", "floors_m", "ceilings_m"):
        assert np.array_equal(getattr(found, name), getattr(track, name)), name


def test_times_of_kml_keep_their_microseconds(tmp_path: Path) -> None:
    spans = [(1_767_225_600_000_001 + 7 * k, 1_767_225_700_999_993 + 11 * k) for k in range(20)]
    box = shapely.MultiPolygon([shapely.box(8.0, 47.0, 8.1, 47.1)])
    areas = [Area(f"A{k}", box, None, *one) for k, one in enumerate(spans)]
    found = read_text(tmp_path, "".join(object_lines("plan.kml", Scene("s"), areas, []))).areas
    # Several times within a millisecond are taken together: none is active for less.
    assert all(one.start_us <= start and one.end_us >= end for one, (start, end) in zip(found, spans, strict=True))
    assert all(start - one.start_us < 1000 for one, (start, _) in zip(found, spans, strict=True))
    (only,) = read_text(tmp_path, "".join(object_lines("plan.kml", Scene("s"), areas[:1], []))).areas
    assert (only.start_us, only.end_us) == spans[0]


def test_links_of_kml_are_remarked(tmp_path: Path) -> None:
    contents = read_text(tmp_path, kml(outside="<NetworkLink><Link><href>more.kml</href></Link></NetworkLink>"))
    assert [one.key for one in contents.areas] == ["P"]
    (remark,) = (one for one in contents.remarks if "NetworkLink" in one.text)
    assert remark.text == "has 1 NetworkLinks, which are not read (the first in line 1, to 'more.kml')"


def packed(path: Path, *files: tuple[str, bytes | str]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files:
            archive.writestr(name, text)
    return path


@pytest.mark.parametrize(
    ("name", "files", "rule"),
    [
        ("a.kmz", [("a.kml", kml()), ("b/b.kml", kml())], "KMZ that holds 2 KML files, such as 'a.kml' and 'b/b.kml'"),
        ("a.kmz", [("inner.kmz", "PK")], "is a KMZ that holds no KML file, and must hold one: unpack it"),
        ("a.kmz", [("../doc.kml", kml())], "is an archive with a path outside of it, '../doc.kml'"),
        ("a.kmz", [("/doc.kml", kml())], "is an archive with a path outside of it, '/doc.kml'"),
        (
            "a.zip",
            [("a.kml", kml()), ("s.shp", ""), ("s.dbf", "")],
            "several data sets, such as 'a' and 's': unpack",
        ),
        ("a.zip", [("s.shp", ""), ("s.dbf", ""), ("in.zip", "")], "of several data sets, such as 'in' and 's': unpack"),
        ("a.zip", [("a.kml", kml().replace("8.1,47 ", "8.1;47 "))], "coordinates in line 1: must be lon,lat"),
    ],
)
def test_archives_that_lose_a_plan_are_refused(tmp_path: Path, name: str, files: Any, rule: str) -> None:
    """OGR reads the first data set of an archive, and nothing of the others."""
    with pytest.raises(InvalidInput, match=rule) as refused:
        read(packed(tmp_path / name, *files))
    assert "\n" not in str(refused.value)


def test_archives_of_one_plan_are_read(tmp_path: Path) -> None:
    assert len(read(packed(tmp_path / "a.kmz", ("doc.kml", kml()), ("files/icon.png", b"x"))).areas) == 1
    assert len(read(packed(tmp_path / "a.zip", ("doc.kml", kml()))).areas) == 1
    for name in ("one", "two"):
        write_layer(tmp_path / f"{name}.shp", [shapely.box(8.0, 47.0, 8.1, 47.1)], kind="Polygon")
    files = [(one.name, one.read_bytes()) for one in sorted(tmp_path.glob("[ot]*.*")) if one.suffix != ".kmz"]
    assert len(read(packed(tmp_path / "shapes.zip", *files)).areas) == 2


def test_bombs_are_refused_before_they_are_unpacked(tmp_path: Path) -> None:
    """Gigabytes of zeros, and a long list of files."""
    path = tmp_path / "bomb.kmz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("a.kml", "w") as one,
    ):
        for _ in range(20):
            one.write(bytes(10_000_000))
    with pytest.raises(InvalidInput, match="holds more than 64 MB: split it"):
        read(path)
    path = packed(tmp_path / "many.kmz", ("doc.kml", kml()), *((f"{k:050}.kml", "") for k in range(25_000)))
    with pytest.raises(InvalidInput, match="is an archive of too many files: unpack it"):
        read(path)


@pytest.mark.parametrize("name", ["plan.kml.gz", "plan.tar", "plan.7z", "plan.rtzp", "plan.kmz", "plan.zip"])
def test_what_is_no_archive_that_is_read_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(kml())
    known = name.endswith(("kmz", "zip"))
    rule = (
        r"is no (KMZ|ZIP) archive, or a broken one" if known else "is compressed, or an archive, of a kind that is not"
    )
    with pytest.raises(InvalidInput, match=rule):
        read(path)


def test_kml_of_another_name_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.foo"
    path.write_text(kml())
    with pytest.raises(InvalidInput, match=r"is KML: its name must end with \.kml or \.kmz"):
        read(path)


BOX = (
    "<Polygon><outerBoundaryIs><LinearRing><coordinates>9,57 9.1,57 9.1,57.01 9,57</coordinates></LinearRing>"
    "</outerBoundaryIs></Polygon>"
)


def spanning(begin: str, end: str) -> str:
    return f"<TimeSpan><begin>{begin}</begin><end>{end}</end></TimeSpan>"


def document(path: Path, *parts: str, version: str = "2.2") -> Path:
    path.write_text(f'<kml xmlns="http://www.opengis.net/kml/{version}"><Document>{"".join(parts)}</Document></kml>')
    return path


def test_times_are_those_of_the_nearest_folder(tmp_path: Path) -> None:
    """They were not inherited: the area was active for ever. Lines and tracks keep their own."""
    june, july = (spanning(f"2026-0{m}-01T00:00:00Z", f"2026-0{m}-02T00:00:00Z") for m in (6, 7))
    stamp = "<TimeStamp><when>2026-06-01T00:00:00Z</when></TimeStamp>"
    marks = {
        name: f"<Placemark><name>{name}</name><styleUrl>#s</styleUrl>{span}{BOX}</Placemark>"
        for name, span in (("A", ""), ("B", july), ("C", ""), ("D", ""), ("E", ""))
    }
    line = "<Placemark><name>L</name><LineString><coordinates>9,57 9.1,57</coordinates></LineString></Placemark>"
    inner = f"<Folder>{july}{marks['C']}</Folder>"
    path = document(tmp_path / "a.kml", f"<Folder>{june}{marks['A']}{marks['B']}{inner}{line}</Folder>", marks["D"])
    months = {one.key: one.start_us and np.datetime64(one.start_us, "us").item().month for one in read(path).areas}
    assert months == {"A": 6, "B": 7, "C": 7, "D": None}
    path = document(tmp_path / "b.kml", f"{june}<Folder>{stamp}{marks['A']}</Folder>{marks['E']}")
    assert {one.key: one.start_us is not None for one in read(path).areas} == {"A": False, "E": True}


@pytest.mark.parametrize(
    ("begin", "end", "first", "after"),
    [
        ("2026-06-01", "2026-06-30", "2026-06-01", "2026-07-01"),
        ("2026-02", "2026-02", "2026-02-01", "2026-03-01"),
        ("2025", "2026", "2025-01-01", "2027-01-01"),
        ("2026-12", "2026-12-31", "2026-12-01", "2027-01-01"),
    ],
)
def test_an_end_contains_its_day_month_or_year(begin: str, end: str, first: str, after: str, tmp_path: Path) -> None:
    path = document(tmp_path / "a.kml", f"<Placemark><name>A</name>{spanning(begin, end)}{BOX}</Placemark>")
    (area,) = read(path, hints=FileHints(time_zone="UTC")).areas
    assert area.start_us == int(np.datetime64(first, "us").astype(int))
    assert area.end_us == int(np.datetime64(after, "us").astype(int))


def test_tracks_of_kml_2_3_and_fixes_without_a_place(tmp_path: Path) -> None:
    whens = "".join(f"<when>2026-06-01T1{hour}:00:00Z</when>" for hour in range(3))
    coords = "<coord>9 57 0</coord><coord/><coord>9.1 57 0</coord>"
    path = document(
        tmp_path / "a.kml", f"<Placemark><name>T</name><Track>{whens}{coords}</Track></Placemark>", version="2.3"
    )
    (track,) = read(path).tracks
    assert track.positions_deg.tolist() == [[9.0, 57.0], [9.1, 57.0]]
    assert np.diff(track.times_us).tolist() == [7_200_000_000]


def test_extensions_have_any_prefix(tmp_path: Path) -> None:
    """XML leaves prefixes to the writer; OGR reads tracks of gx alone."""
    whens = "".join(f"<when>2026-06-01T1{hour}:00:00Z</when>" for hour in range(2))
    track = f"<g:Track>{whens}<g:coord>9 57 0</g:coord><g:coord>9.1 57 0</g:coord></g:Track>"
    path = tmp_path / "a.kml"
    path.write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:g="http://www.google.com/kml/ext/2.2"><Document>'
        f"<Placemark><name>T</name>{track}</Placemark></Document></kml>"
    )
    (found,) = read(path).tracks
    assert found.positions_deg.tolist() == [[9.0, 57.0], [9.1, 57.0]]
