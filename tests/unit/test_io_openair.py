"""Airspaces of OpenAir: what each record becomes, and one message a mistake.

The files are made here, after the description of Naviter (2.1) and the tests of XCSoar.
"""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely

from conflictdb import InvalidInput, read
from conflictdb.formats import Contents, FileHints
from conflictdb.formats.instants import parse_instant

GEOD = pyproj.Geod(ellps="WGS84")
NMI = 1852.0
AT_ALL_HEIGHTS = FileHints(unbounded_heights=True)
SQUARE = "DP 57:00:00 N 010:00:00 E\nDP 57:00.0N 010:12.0E\ndp 57:12:00 N, 10:12:00 E * north-east\nDP 57.2 N 10 E\n"


def contents(
    tmp_path: Path, *records: str, shape: str = SQUARE, name: str = "a.txt", hints: FileHints | None = None
) -> Contents:
    path = tmp_path / name
    path.write_text("\n".join(["* made here", "AC R", "AN EDR 1", *records, shape]))
    return read(path, hints=hints)


def us(text: str) -> int:
    return parse_instant(text)


def test_an_airspace_has_the_values_of_its_records(tmp_path: Path) -> None:
    records = ("AY TRA", "AI 62e1", "AF 123.300", "AG Nordholz Radar", "AX 7000", "AL GND", "AH 2500ft AMSL")
    found = contents(tmp_path, *records, "AA 2026-06-01T10:00Z/2026-06-01T24:00Z")
    (area,) = found.areas
    assert (area.key, area.name, area.object_class) == ("62e1", "EDR 1", "TRA")
    assert (area.floor_m, area.ceiling_m) == (None, pytest.approx(762.0))
    assert (area.start_us, area.end_us) == (us("2026-06-01T10:00Z"), us("2026-06-02T00:00Z"))
    assert area.properties == {
        "airspace_class": "R",
        "airspace_type": "TRA",
        "frequency": "123.300",
        "station": "Nordholz Radar",
        "transponder": "7000",
    }
    square = shapely.box(10.0, 57.0, 10.2, 57.2)
    assert shapely.symmetric_difference(area.footprint, square).area < 1e-4
    assert not found.remarks
    assert not found.derived


@pytest.mark.parametrize(
    ("times", "spans"),
    [
        ((), [(None, None)]),
        (("2026-06-01T10:00Z/NONE",), [("2026-06-01T10:00Z", None)]),
        (("none/2026-06-01T10:00:00Z",), [(None, "2026-06-01T10:00Z")]),
        (("2026-06-01/2026-06-02",), [("2026-06-01T00:00Z", "2026-06-03T00:00Z")]),
        (
            ("2026-06-01T10:00Z/2026-06-01T11:00Z ; first", "2026-06-02T10:00/2026-06-02T11:00"),
            [("2026-06-01T10:00Z", "2026-06-01T11:00Z"), ("2026-06-02T10:00Z", "2026-06-02T11:00Z")],
        ),
    ],
)
def test_times_are_those_of_aa(
    times: tuple[str, ...], spans: list[tuple[str | None, str | None]], tmp_path: Path
) -> None:
    found = contents(tmp_path, *(f"AA {one}" for one in times))
    (area,) = found.areas
    given = [tuple(None if at is None else us(at) for at in span) for span in spans]
    assert [tuple(one) for one in area.spans_us or [(area.start_us, area.end_us)]] == given
    said = [one.text for one in found.remarks]
    assert said == ([] if times else ["1 airspaces without times (AA) are active at all times, such as 'EDR 1'"])


def test_an_airspace_of_no_time_is_left_out_by_name(tmp_path: Path) -> None:
    found = contents(tmp_path, "AA NONE", shape=SQUARE + "AC Q\nAN EDD 2\n" + SQUARE)
    assert [area.key for area in found.areas] == ["EDD 2"]
    assert [str(one).partition(": ")[2] for one in found.skipped] == ["left out zone 'EDR 1': is never active: AA NONE"]


@pytest.mark.parametrize(
    ("record", "expected_m"),
    [
        ("AH 2500ft AMSL", 762.0),
        ("AH 2500 FT MSL", 762.0),
        ("AH 2500", 762.0),
        ("AH 2500 msl", 762.0),
        ("AH 900m", 900.0),
        ("AH UNL", None),
        ("AH UNLIMITED", None),
        ("AH FL999", None),
        ("AL SFC", None),
        ("AL gnd", None),
        ("AL 0", 0.0),
        ("AL 0 AGL", None),
        ("AL 1000ft AGL", "the ground"),
        ("AL 100m GND", "the ground"),
        ("AH FL 95", "a surface of constant pressure"),
        ("AH FL95", "a surface of constant pressure"),
        ("AH 5000 STD", "a surface of constant pressure"),
        ("AH GND", "must be such as"),
        ("AL 100m AGL/423m AMSL", "must be such as"),
    ],
)
def test_heights(record: str, expected_m: float | str | None, tmp_path: Path) -> None:
    if isinstance(expected_m, str):
        with pytest.raises(InvalidInput, match=f"zone 'EDR 1': {record[:2]} in line 4: .*{expected_m}"):
            contents(tmp_path, record)
        return
    (area,) = contents(tmp_path, record).areas
    height_m = area.ceiling_m if record.startswith("AH") else area.floor_m
    assert height_m == (None if expected_m is None else pytest.approx(expected_m))


def test_flight_levels_are_those_of_a_scene_of_flight_levels(tmp_path: Path) -> None:
    (area,) = contents(tmp_path, "AL FL65", "AH 19500 STD", hints=FileHints(vertical_datum="flight_level")).areas
    assert (area.floor_m, area.ceiling_m) == (pytest.approx(6500 * 0.3048), pytest.approx(19500 * 0.3048))


def around(centre: tuple[float, float], azimuths: np.ndarray, radius_m: float) -> np.ndarray:
    lon, lat, _ = GEOD.fwd(*(np.full(len(azimuths), one) for one in centre), azimuths, np.full(len(azimuths), radius_m))
    return np.stack([lon, lat], axis=1)


def test_circles_are_contained_each_as_an_area(tmp_path: Path) -> None:
    found = contents(tmp_path, shape="V X=22:28:39 S 017:28:14 E\nDC 50.0\nDC 60.0\n")
    assert [(area.key, area.owner) for area in found.areas] == [("EDR 1/1", "EDR 1"), ("EDR 1/2", "EDR 1")]
    centre = 17 + 28 / 60 + 14 / 3600, -(22 + 28 / 60 + 39 / 3600)
    for area, radius in zip(found.areas, (50.0, 60.0), strict=True):
        inside, outside = (
            shapely.contains_xy(area.footprint, around(centre, np.arange(0.0, 360.0), share * radius * NMI))
            for share in (1.0, 1.0011)
        )
        assert inside.all()
        assert not outside.any()


@pytest.mark.parametrize("is_between", [False, True])
def test_arcs_are_contained_on_the_side_that_is_larger(tmp_path: Path, is_between: bool) -> None:
    """A sector of a ring, south of its centre: the outer arc bulges outward, the inner one inward."""
    centre = (1.0, 50.0)
    shape = "V X=50:00:00 N 001:00:00 E\nV D=-\nDA 15, 185, 155\nV D=+\nDA 25, 155, 185\n"
    if is_between:
        places = [
            ", ".join(f"{lat:.9f} N {lon:.9f} E" for lon, lat in around(centre, np.array(ends, float), radius * NMI))
            for ends, radius in (((185, 155), 15.0), ((155, 185), 25.0))
        ]
        shape = f"V X=50:00:00 N 001:00:00 E\nV D=-\nDB {places[0]}\nV D=+\nDB {places[1]}\n"
    (area,) = contents(tmp_path, shape=shape).areas
    azimuths = np.linspace(155.01, 184.99, 200)
    for radius, is_inside in ((15.0, True), (25.0, True), (14.98, False), (25.03, False)):
        assert (shapely.contains_xy(area.footprint, around(centre, azimuths, radius * NMI)) == is_inside).all()


def test_an_arc_of_two_radii_is_the_larger_one_outward(tmp_path: Path) -> None:
    """Its centre is 200 m off: either reading is contained."""
    centre = (1.0, 50.0)
    ends = [around(centre, np.array([at]), radius)[0] for at, radius in ((0.0, 18_400.0), (90.0, 18_600.0))]
    places = ", ".join(f"{lat:.9f} N {lon:.9f} E" for lon, lat in ends)
    (area,) = contents(tmp_path, shape=f"V X=50:0:0 N 001:0:0 E\nDB {places}\nDP 50:0:0 N 001:0:0 E").areas
    footprint = area.footprint.buffer(2e-7)  # sides are rhumb lines, 2 cm from straight ones here
    for radius_m in (18_400.0, 18_600.0):
        assert shapely.contains_xy(footprint, around(centre, np.linspace(5.0, 85.0, 50), radius_m)).all()


def test_sides_are_shortest_lines_also_across_the_antimeridian(tmp_path: Path) -> None:
    shape = "DP 50:00:00 N 170:00:00 E\nDP 50:00:00 N 170:00:00 W\nDP 40:00:00 N 170:00:00 W\nDP 40:00:00 N 170:00:00 E"
    (area,) = contents(tmp_path, shape=shape).areas
    for lon, lat in GEOD.npts(170.0, 50.0, -170.0, 50.0, 9):
        line = shapely.LineString([(lon % 360.0, lat - 1.0), (lon % 360.0, lat + 1.0)])
        (_, north) = shapely.intersection(line, area.footprint.geoms[0]).coords[-1]
        assert abs(north - lat) < 1e-5


def test_an_outline_that_crosses_itself_is_all_that_it_encloses(tmp_path: Path) -> None:
    bow = "".join(f"DP {lat} N {lon} E\n" for lon, lat in ((10, 50), (11, 51), (11, 50), (10, 51)))
    found = contents(tmp_path, "AA 2026-06-01T10:00Z/NONE", shape=bow)
    (area,) = found.areas
    assert shapely.contains_xy(area.footprint, [[10.1, 50.5], [10.9, 50.5]]).all()
    assert ["cross themselves" in one.text for one in found.remarks] == [True]


def test_ids_are_names_or_numbers_and_records_that_are_not_read_are_said(tmp_path: Path) -> None:
    more = "AC D\nAN TMA\nAU x\n*AActiv [HX]\n" + SQUARE + "AC D\nAN TMA\nAT 57:00:00 N 010:00:00 E\n" + SQUARE
    more += "TO Lake\nSP 0,1,0,0,255\nDP 57:00:00 N 010:00:00 E\n"
    found = contents(tmp_path, "AA 2026-06-01T10:00Z/NONE", shape=SQUARE + more, name="zürich.openair")
    assert [area.key for area in found.areas] == ["EDR 1", "zürich.2", "zürich.3"] == list(found.derived)
    assert "records that are not read: *AActiv (1), AU (1), DP (1), TO (1)" in [one.text for one in found.remarks]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize("name", ["a.txt", "a.openair", "a.air", "a.notam"])
def test_names_are_utf_8_or_latin_1(encoding: str, name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(f"AC R\r\nAN Zürich\r\nAH 900m\r\n{SQUARE}".encode(encoding))
    assert [area.name for area in read(tmp_path / name).areas] == ["Zürich"]


def test_a_notam_in_another_encoding_is_refused_as_before(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes("A0123/26 NOTAMN für".encode("latin-1"))
    with pytest.raises(InvalidInput, match="byte 17: must be UTF-8 text"):
        read(tmp_path / "a.txt")


@pytest.mark.parametrize(
    ("records", "shape", "rule"),
    [
        ((), "DP 57:00:00 N 010:00:00", "DP in line 4: must be 1 place such as"),
        ((), "DP 91:00:00 N 010:00:00 E", "DP in line 4: must be 1 place such as"),
        ((), "DP 57:61:00 N 010:00:00 E", "DP in line 4: must be 1 place such as"),
        ((), "DP 57:00:00 N 010:00:00 E\nDP 57:00:00 N 011:00:00 E", "shape in line 4: needs at least 3 points; got 2"),
        ((), "DC 5", "DC in line 4: needs a centre before it"),
        ((), "V X=57:00:00 N 010:00:00 E\nDC 0", "DC in line 5: must have a radius above 0"),
        ((), "V X=57:00:00 N 010:00:00 E\nDC 5 km", "DC in line 5: must be a radius"),
        ((), "V X=57:00:00 N 010:00:00 E\nDA 5, 0", "DA in line 5: must be a radius and two bearings"),
        ((), "V D=cw\n", "V in line 4: must be X= with a centre, or D="),
        ((), "V W=5\nDY 57:00:00 N 010:00:00 E", "V in line 4: must be X= with"),
        ((), "DY 57:00:00 N 010:00:00 E", "DY in line 4: is a shape that is not read"),
        ((), f"{SQUARE}see the chart", "line 8: is no record of OpenAir"),
        ((), "", "AC in line 2: has no shape"),
        (("AL GND", "AL 100 ft"), SQUARE, "AL in line 5: is given twice"),
        (("AA BADSTUFF",), SQUARE, "AA in line 4: must be two times"),
        (("AA 2026-06-01T10:00Z/2026-06-01T25:00Z",), SQUARE, "AA in line 4: must be a date and time"),
        (("AA NONE", "AA 2026-06-01T10:00Z/NONE"), SQUARE, "AA in line 4: is NONE, and other times are given"),
    ],
)
def test_mistakes_are_refused_by_their_lines(records: tuple[str, ...], shape: str, rule: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refused:
        contents(tmp_path, *records, shape=shape)
    assert rule in str(refused.value)


def test_arcs_of_a_file_have_a_limit_of_corners(tmp_path: Path) -> None:
    shape = "V X=0:0:0 N 0:0:0 E\n" + "DA 2699, 0, 359\n" * 9_000
    with pytest.raises(InvalidInput, match="a circle too many"):
        contents(tmp_path, shape=shape)


def test_an_outline_around_a_pole_is_refused_by_its_line(tmp_path: Path) -> None:
    """It must not become the strip that its sides enclose on a map."""
    cap = "".join(
        f"DP 80:00:00 N {lon:03}:00:00 {east}\n" for lon, east in ((0, "E"), (90, "E"), (180, "E"), (90, "W"))
    )
    with pytest.raises(InvalidInput, match="shape in line 4: must be a ring; it goes round a pole"):
        contents(tmp_path, shape=cap)
