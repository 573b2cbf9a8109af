"""Airspaces of AIXM, NOTAM, and warnings of S-124: what each field becomes, and one message a mistake.

The files are made here, after the public schemas. `docs/how-to/read-notam-and-airspaces.md` says which public files
were read, with what result.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely

from conflictdb import Area, InvalidInput, Scene, Track, read, rectangle_outline_m, solve
from conflictdb.formats import Contents, FileHints

GEOD = pyproj.Geod(ellps="WGS84")
NMI = 1852.0
AT_ALL_HEIGHTS = FileHints(unbounded_heights=True)
SQUARE = "57 4 57 5 58 5 58 4 57 4"
PERIOD = (
    "<gml:beginPosition>2026-03-01T06:00:00Z</gml:beginPosition><gml:endPosition>2026-03-31T18:00:00Z</gml:endPosition>"
)
SHEET = "<aixm:timeReference>UTC</aixm:timeReference><aixm:day>{}</aixm:day><aixm:startTime>{}</aixm:startTime>"
SHEET += "<aixm:endTime>{}</aixm:endTime>"


def lines(positions: str = SQUARE, kind: str = "GeodesicString") -> str:
    return f"<gml:{kind}><gml:posList>{positions}</gml:posList></gml:{kind}>"


def surface(*segments: str, system: str = 'srsName="urn:ogc:def:crs:EPSG::4326"') -> str:
    each = "".join(segments or (lines(),))
    curve = f"<gml:curveMember><gml:Curve><gml:segments>{each}</gml:segments></gml:Curve></gml:curveMember>"
    patch = f"<gml:PolygonPatch><gml:exterior><gml:Ring>{curve}</gml:Ring></gml:exterior></gml:PolygonPatch>"
    return f"<aixm:Surface {system}><gml:patches>{patch}</gml:patches></aixm:Surface>"


def volume(shape: str = "", lower: str = "", upper: str = "", operation: str = "BASE") -> str:
    limits = lower or '<aixm:lowerLimit uom="FT">GND</aixm:lowerLimit>'
    limits += (
        upper
        or '<aixm:upperLimit uom="M">900</aixm:upperLimit><aixm:upperLimitReference>MSL</aixm:upperLimitReference>'
    )
    projection = f"<aixm:horizontalProjection>{shape or surface()}</aixm:horizontalProjection>"
    return (
        f"<aixm:geometryComponent><aixm:AirspaceGeometryComponent><aixm:operation>{operation}</aixm:operation>"
        f"<aixm:theAirspaceVolume><aixm:AirspaceVolume>{limits}{projection}</aixm:AirspaceVolume>"
        "</aixm:theAirspaceVolume></aixm:AirspaceGeometryComponent></aixm:geometryComponent>"
    )


def activation(status: str = "ACTIVE", *sheets: str) -> str:
    times = "".join(f"<aixm:timeInterval><aixm:Timesheet>{one}</aixm:Timesheet></aixm:timeInterval>" for one in sheets)
    inside = f"{times}<aixm:status>{status}</aixm:status>"
    return f"<aixm:activation><aixm:AirspaceActivation>{inside}</aixm:AirspaceActivation></aixm:activation>"


def aixm(*slices: tuple[str, str], more: str = "") -> str:
    every = "".join(
        "<aixm:timeSlice><aixm:AirspaceTimeSlice><gml:validTime><gml:TimePeriod>"
        f"{PERIOD}</gml:TimePeriod></gml:validTime><aixm:interpretation>{kind}</aixm:interpretation>"
        f"<aixm:sequenceNumber>{number}</aixm:sequenceNumber><aixm:designator>EAR1</aixm:designator>{inside}"
        "</aixm:AirspaceTimeSlice></aixm:timeSlice>"
        for number, (kind, inside) in enumerate(slices or (("BASELINE", volume()),), 1)
    )
    return (
        '<message:AIXMBasicMessage xmlns:message="http://www.aixm.aero/schema/5.1.1/message" '
        'xmlns:aixm="http://www.aixm.aero/schema/5.1.1" xmlns:gml="http://www.opengis.net/gml/3.2" '
        'xmlns:xlink="http://www.w3.org/1999/xlink">'
        f'<message:hasMember><aixm:Airspace gml:id="uuid.1">{every}</aixm:Airspace></message:hasMember>{more}'
        "</message:AIXMBasicMessage>"
    )


def contents(tmp_path: Path, text: str, name: str = "a.xml", **more: Any) -> Contents:
    (tmp_path / name).write_text(text)
    return read(tmp_path / name, **more)


def one(tmp_path: Path, text: str, name: str = "a.xml", **more: Any) -> Area:
    (area,) = contents(tmp_path, text, name, **more).areas
    return area


def minutes(instant_us: int | None) -> np.datetime64:
    return np.datetime64(instant_us, "us").astype("datetime64[m]")


def test_an_airspace_becomes_an_area(tmp_path: Path) -> None:
    area = one(tmp_path, aixm())
    assert (area.key, area.floor_m, area.ceiling_m) == ("EAR1", None, 900.0)
    assert minutes(area.start_us) == np.datetime64("2026-03-01T06:00")
    assert minutes(area.end_us) == np.datetime64("2026-03-31T18:00")
    assert area.footprint.bounds[:3] == (4.0, 57.0, 5.0)
    assert area.properties == {"interpretation": "BASELINE", "airspace_designator": "EAR1"}


def test_geodesics_of_an_airspace_bulge_towards_the_pole(tmp_path: Path) -> None:
    """Straight segments do not; without a reference system the order of coordinates is unknown."""
    positions = "60 0 60 20 62 20 62 0 60 0"
    geodesic = one(tmp_path, aixm(("BASELINE", volume(surface(lines(positions)))))).footprint
    straight = one(tmp_path, aixm(("BASELINE", volume(surface(lines(positions, "LineStringSegment")))))).footprint
    assert geodesic.bounds[3] == pytest.approx(GEOD.npts(0, 62, 20, 62, 1)[0][1], abs=1e-4)
    assert straight.bounds == (0, 60, 20, 62)
    longitude_first = surface(lines("0 60 20 60 20 62 0 60"), system='srsName="urn:ogc:def:crs:OGC:1.3:CRS84"')
    assert one(tmp_path, aixm(("BASELINE", volume(longitude_first)))).footprint.bounds[0] == 0.0


def arc(start: float, end: float, radius: float = 25.0) -> str:
    return (
        f'<gml:ArcByCenterPoint><gml:pos>55 10</gml:pos><gml:radius uom="NM">{radius}</gml:radius>'
        f'<gml:startAngle uom="deg">{start}</gml:startAngle><gml:endAngle uom="deg">{end}</gml:endAngle>'
        "</gml:ArcByCenterPoint>"
    )


def place(azimuth: float, miles: float) -> str:
    lon, lat, _ = GEOD.fwd(10, 55, azimuth, miles * NMI)
    return f"{lat} {lon}"


def test_an_arc_is_contained_on_both_sides(tmp_path: Path) -> None:
    """A sector between 15 and 25 miles: its outer arc bulges outward, its inner one inward."""
    outer = lines(f"{place(40, 15)} {place(40, 25)}"), arc(40, 130, 25.0)
    inner = lines(f"{place(130, 25)} {place(130, 15)}"), arc(130, 40, 15.0)
    area = one(tmp_path, aixm(("BASELINE", volume(surface(*outer, *inner))))).footprint
    boundary = area.buffer(1e-5)
    rng = np.random.default_rng(5)
    for azimuth, share in rng.random((500, 2)):
        lon, lat, _ = GEOD.fwd(10, 55, 40 + 90 * azimuth, (15 + 10 * share) * NMI)
        assert boundary.contains(shapely.Point(lon, lat))
    for azimuth in np.linspace(45, 125, 20):
        assert not boundary.contains(shapely.Point(*GEOD.fwd(10, 55, azimuth, 25.05 * NMI)[:2]))
        assert not boundary.contains(shapely.Point(*GEOD.fwd(10, 55, azimuth, 14.95 * NMI)[:2]))


def test_a_circle_of_an_airspace_is_contained(tmp_path: Path) -> None:
    circle = (
        '<gml:CircleByCenterPoint numArc="1"><gml:pointProperty xlink:href="#P"/><gml:radius uom="KM">10</gml:radius>'
    )
    more = '<message:hasMember><aixm:DesignatedPoint><aixm:Point gml:id="P"><gml:pos>55 10</gml:pos></aixm:Point>'
    more += "</aixm:DesignatedPoint></message:hasMember>"
    found = contents(tmp_path, aixm(("BASELINE", volume(surface(circle + "</gml:CircleByCenterPoint>"))), more=more))
    ring = shapely.get_coordinates(found.areas[0].footprint)
    away = [GEOD.inv(10, 55, *corner)[2] for corner in ring.tolist()]
    assert 9999.9 < min(away) < max(away) < 10_011.0
    assert [str(one.reason) for one in found.skipped] == ["1 features are DesignatedPoints, no airspaces"]


def test_a_temporary_change_has_the_shape_of_its_baseline(tmp_path: Path) -> None:
    base, delta = contents(tmp_path, aixm(("BASELINE", volume()), ("TEMPDELTA", activation()))).areas
    assert (base.key, delta.key) == ("EAR1", "EAR1/TEMPDELTA")
    assert shapely.equals(base.footprint, delta.footprint)
    found = contents(tmp_path, aixm(("BASELINE", volume() + activation("INACTIVE"))))
    assert [str(one.reason) for one in found.skipped] == ["is never active"]


def spans(text: str, *each: tuple[str, str]) -> str:
    """Return a message whose time slices are valid in these months of 2026, one after the other."""
    for first, end in each:
        last = (
            f"<gml:endPosition>{end}T00:00:00Z</gml:endPosition>"
            if end
            else '<gml:endPosition indeterminatePosition="unknown"/>'
        )
        text = text.replace(PERIOD, f"<gml:beginPosition>{first}T00:00:00Z</gml:beginPosition>{last}", 1)
    return text


NORTH = surface(lines("67 4 67 5 68 5 68 4 67 4"))
INACTIVE, JUNE = activation("INACTIVE"), ("2026-06-01", "2026-07-01")


@pytest.mark.parametrize(
    ("slices", "times"),
    [
        (
            (("BASELINE", volume() + INACTIVE), ("BASELINE", volume(NORTH) + INACTIVE)),
            (("2025-01-01", "2026-05-01"), ("2026-05-01", "")),
        ),
        ((("BASELINE", volume(NORTH) + INACTIVE), ("BASELINE", volume())), (("2026-01-01", ""), ("2026-07-01", ""))),
        (
            (("BASELINE", volume() + INACTIVE), ("PERMDELTA", volume(NORTH))),
            (("2025-01-01", ""), ("2026-05-01", "")),
        ),
        (
            (("BASELINE", volume(NORTH) + INACTIVE), ("PERMDELTA", volume(NORTH))),
            (("2026-05-01", ""), ("2026-05-01", "")),
        ),
    ],
)
def test_a_temporary_change_has_the_shape_that_is_valid_then(
    slices: tuple[tuple[str, str], ...], times: tuple[tuple[str, str], ...], tmp_path: Path
) -> None:
    found = contents(tmp_path, spans(aixm(*slices, ("TEMPDELTA", activation())), *times, JUNE))
    (area,) = [area for area in found.areas if area.key == "EAR1/TEMPDELTA"]
    assert area.footprint.bounds[1] == 67.0


@pytest.mark.parametrize(
    ("slices", "times", "rule"),
    [
        (
            (("BASELINE", volume()),),
            (("2025-01-01", "2026-05-01"),),
            "is missing: the file has no baseline of this airspace that is valid",
        ),
        (
            (("BASELINE", volume()), ("BASELINE", volume(NORTH))),
            (("2026-01-01", ""), ("2026-06-15", "")),
            "is missing, and several shapes of this airspace are valid then",
        ),
        (
            (("BASELINE", volume()), ("PERMDELTA", volume(NORTH))),
            (("2026-01-01", ""), ("2026-01-01", "")),
            "is missing, and several shapes of this airspace are valid then",
        ),
    ],
)
def test_a_temporary_change_without_one_shape_is_refused(
    slices: tuple[tuple[str, str], ...], times: tuple[tuple[str, str], ...], rule: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=f"'EAR1/TEMPDELTA': geometryComponent: {rule}"):
        contents(tmp_path, spans(aixm(*slices, ("TEMPDELTA", activation())), *times, JUNE))


EXCLUDED = SHEET.format("ANY", "00:00", "24:00") + "<aixm:excluded>YES</aixm:excluded>"
LOCAL = SHEET.format("MON", "08:00", "10:00").replace("UTC", "LOCAL")
LIMIT = '<aixm:upperLimit uom="{}">{}</aixm:upperLimit><aixm:upperLimitReference>{}</aixm:upperLimitReference>'
MISTAKES = {
    "a delta alone": (aixm(("TEMPDELTA", activation())), "geometryComponent: is missing: the file has no"),
    "an operation": (aixm(("BASELINE", volume(operation="SUBTR"))), "'EAR1': operation in line 1: is SUBTR"),
    "a flight level": (
        aixm(("BASELINE", volume(upper=LIMIT.format("FL", 195, "STD")))),
        "'EAR1': upperLimit in line 1: is measured from a surface of constant pressure",
    ),
    "no reference": (
        aixm(("BASELINE", volume(upper='<aixm:upperLimit uom="FT">900</aixm:upperLimit>'))),
        "'EAR1': upperLimit in line 1: needs a unit and a reference",
    ),
    "a unit": (aixm(("BASELINE", volume(upper=LIMIT.format("YD", 9, "MSL")))), "in line 1: has the unit 'YD'"),
    "no system": (aixm(("BASELINE", volume(surface(system="")))), "in line 1: names no reference system"),
    "a system": (
        aixm(("BASELINE", volume(surface(system='srsName="EPSG:3857"')))),
        "Surface in line 1: has the reference system EPSG:3857; read are EPSG:4326 and CRS84",
    ),
    "an open ring": (
        aixm(("BASELINE", volume(surface(lines("57 4 57 5 58 5"))))),
        "exterior in line 1: must be closed",
    ),
    "a gap": (
        aixm(("BASELINE", volume(surface(lines("57 4 57 5"), lines("58 5 57 4"))))),
        "exterior in line 1: has a gap of 1 degrees",
    ),
    "a spline": (
        aixm(("BASELINE", volume(surface("<gml:BSpline/>")))),
        "BSpline in line 1: is a curve that is not read",
    ),
    "elsewhere": (
        aixm(("BASELINE", volume('<aixm:Surface><gml:patches xlink:href="#x"/></aixm:Surface>'))),
        "patches in line 1: is elsewhere, in #x",
    ),
    "a status": (
        aixm(("BASELINE", volume() + activation("PERHAPS"))),
        "status in line 1: is not understood: 'PERHAPS'",
    ),
    "a holiday": (
        aixm(("BASELINE", volume() + activation("ACTIVE", SHEET.format("HOL", "08:00", "10:00")))),
        "Timesheet in line 1: has the day HOL; understood are ANY and MON",
    ),
    "an excluded time": (
        aixm(("BASELINE", volume() + activation("ACTIVE", EXCLUDED))),
        "Timesheet in line 1: excludes times",
    ),
    "no zone": (
        aixm(("BASELINE", volume() + activation("ACTIVE", LOCAL))),
        "Timesheet in line 1: needs a timeReference such as UTC or UTC",
    ),
    "an interpretation": (aixm(("DELTA", volume())), "interpretation: must be one of BASELINE"),
    "a time": (aixm().replace("06:00:00Z", "06:00:00"), "validTime, beginPosition: needs an offset from UTC"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_in_aixm_has_one_message_that_names_it(mistake: str, tmp_path: Path) -> None:
    text, rule = MISTAKES[mistake]
    with pytest.raises(InvalidInput, match=rule) as refused:
        contents(tmp_path, text)
    assert str(refused.value).count("\n") == 0


NOTAM = """(A1485/26 NOTAMN
Q) EDWW/{}/IV/BO/W/000/100/5405N01030E010
A) EDWW B) 2603010600 C) {}
E) {}
F) {} G) {})
"""
RING = "GUN FIRING WI AREA 540000N 0102000E - 541000N 0102000E - 541000N\n0104000E - 540000N 0102000E"


def notam(text: str = RING, q: str = "QWMLW", c: str = "2603311800", f: str = "SFC", g: str = "10000FT AMSL") -> str:
    return NOTAM.format(q, c, text, f, g)


def test_a_notam_becomes_an_area(tmp_path: Path) -> None:
    area = one(tmp_path, notam(), "a.txt")
    assert (area.key, area.floor_m, area.ceiling_m) == ("A1485/26", None, pytest.approx(3048.0))
    assert (minutes(area.start_us), minutes(area.end_us)) == (
        np.datetime64("2026-03-01T06:00"),
        np.datetime64("2026-03-31T18:00"),
    )
    assert area.footprint.bounds == pytest.approx((10 + 1 / 3, 54.0, 10 + 2 / 3, 54 + 1 / 6), abs=2e-4)
    assert area.properties["q_code"] == "QWMLW"
    assert one(tmp_path, notam(c="PERM"), "a.txt").end_us is None
    prefixed = "DANGER AREA BOUNDED BY N540000E0102000-N541000E0102000-N5410\n00E0104000 BACK TO START"
    again = one(tmp_path, notam(prefixed), "a.txt")
    assert again.footprint.bounds == pytest.approx(area.footprint.bounds, abs=1e-4)


def test_a_circle_is_that_of_item_e_or_else_of_item_q(tmp_path: Path) -> None:
    def reach_m(text: str, lon: float, lat: float) -> float:
        ring = shapely.get_coordinates(one(tmp_path, notam(text), "a.txt").footprint).tolist()
        return min(GEOD.inv(lon, lat, *corner)[2] for corner in ring)

    for text in (
        "WI 5NM RADIUS OF 540000N 0102000E",
        "RADIUS OF 5 NM CENTRED ON 5400N01020E",
        "5.0NM RADIUS 5400N01020E",
    ):
        assert reach_m(text, 10 + 1 / 3, 54) == pytest.approx(5 * NMI, rel=2e-3)
    assert reach_m("GUN FIRING AS PUBLISHED", 10.5, 54 + 5 / 60) == pytest.approx(11 * NMI, rel=2e-3)
    curved = "AREA 5400N01020E - CLOCKWISE ARC 5NM RADIUS OF 5405N01020E - 5410N01020E"
    assert reach_m(curved, 10.5, 54 + 5 / 60) == pytest.approx(11 * NMI, rel=2e-3)
    (remark,) = contents(tmp_path, notam(curved), "a.txt").remarks
    assert "the circle of item Q is used" in remark.text


PLACE = "540000N 0102000E"
LIST = "540000N 0102000E - 541000N 0102000E - 541000N 0104000E"


@pytest.mark.parametrize(
    ("text", "radius_m"),
    [
        (f"WI 1500M RADIUS OF {PLACE}", 1500.0),
        (f"WI 10,5NM RADIUS OF {PLACE}", 10.5 * NMI),
        (f"WI 0.125NM RADIUS OF {PLACE}", 0.125 * NMI),
        (f"CIRCLE WITH RADIUS 2KM CENTRED ON {PLACE} (22NM SOUTHEAST OF HAMBURG)", 2000.0),
        (f"uas wi 2nm radius of {PLACE.lower()}. 500m and below", 2 * NMI),
    ],
)
def test_the_radius_of_a_notam_is_read_whole(text: str, radius_m: float, tmp_path: Path) -> None:
    found = contents(tmp_path, notam(text), "a.txt")
    _, south, _, north = found.areas[0].footprint.bounds
    assert (north - south) * 60 * NMI / 2 == pytest.approx(radius_m, rel=5e-3)
    assert found.remarks == []


@pytest.mark.parametrize(
    "text",
    [
        f"WI 1,500M RADIUS OF {PLACE}",
        f"WI 10 000M RADIUS OF {PLACE}",
        f"WI 2NM RADIUS OF {PLACE} AND WI 10NM RADIUS OF EDDF ARP",
        f"WI 2NM RADIUS OF {PLACE} EXTENDING 10NM TO THE EAST",
        f"WI RADIUS 2NM TO 10NM OF {PLACE}",
        f"WI 5NM EITHER SIDE OF LINE {LIST}",
        f"GUN FIRING WI 5NM OF {LIST}",
        f"{LIST} PLUS 5NM BUFFER",
        f"{LIST} AND ED-R 116 ACT",
        f"{LIST}. ED-R 116 ACT",
        f"ED-R 116 AND AREA {LIST}",
        f"ED-R 116, ED-R 117 AND AREA {LIST}",
        f"ED-R 116, ED-R 117, {LIST}",
        f"ED-R 116 ACT. IN ADDITION {LIST}",
        f"WI 2NM RADIUS OF A POINT 10NM SE OF {PLACE}",
        f"{LIST} WITH 500M SAFETY ZONE",
        f"{LIST} - N54130E01030",
        f"{LIST} - KOLOT",
        f"AREAS {LIST} AND 542000N 0102000E - 543000N 0102000E - 543000N 0104000E",
        f"{LIST} - 540000N 0102000E - 535000N 0102000E - 535000N 0104000E",
        f"{LIST}, 542000N 0102000E",
    ],
)
def test_a_notam_with_more_than_plain_words_gets_the_circle_of_item_q(text: str, tmp_path: Path) -> None:
    found = contents(tmp_path, notam(text), "a.txt")
    _, south, _, north = found.areas[0].footprint.bounds
    assert (north - south) * 60 * NMI / 2 == pytest.approx(11 * NMI, rel=5e-3)
    assert [remark.text for remark in found.remarks] == [
        "item E describes its area otherwise: the circle of item Q is used"
    ]


@pytest.mark.parametrize(
    "tail",
    [
        " BACK TO START. VERTICAL LIMITS: 20,000M(QNE) AND BELOW.",
        " (AREA 2).",
        " - 540000N 0102000E - ALL FLIGHTS ARE PROHIBITED IN LINE WITH ANNEX 11",
        ". RMK/ATS ROUTES M768 AND N884 NOT AVBL",
    ],
)
def test_words_that_name_no_area_leave_a_polygon(tail: str, tmp_path: Path) -> None:
    found = contents(tmp_path, notam(LIST + tail), "a.txt")
    assert found.areas[0].footprint.bounds == pytest.approx((10 + 1 / 3, 54.0, 10 + 2 / 3, 54 + 1 / 6), abs=2e-4)
    assert found.remarks == []


def test_cancelled_and_other_notam_are_left_out(tmp_path: Path) -> None:
    cancel = "(A1486/26 NOTAMC A1485/26\nQ) EDWW/QWMLC/IV/BO/W/000/100/5405N01030E010\nA) EDWW B) 2603010600\nE) CNL)"
    runway = notam("RWY CLSD", "QMRLC").replace("A1485", "A1487")
    found = contents(tmp_path, notam() + cancel + runway, "a.txt")
    assert found.areas == []
    assert [one.reason for one in found.skipped] == [
        "is replaced or cancelled by A1486/26",
        "cancels A1485/26",
        "is no airspace restriction or warning: QMRLC",
    ]


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("no NOTAM here", "file: holds no NOTAM"),
        (notam().replace("Q)", "X)"), "NOTAM 'A1485/26': Q: is missing"),
        (notam().replace("5405N", "5465N").replace(RING, "AS PUBLISHED"), "'A1485/26': Q: holds 5465N, which is no"),
        (notam().replace("E010\n", "E999\n").replace(RING, "WHOLE FIR"), "Q: has no circle to use"),
        (notam(c="2603321800"), "'A1485/26': C: must be ten digits, year to minute, or PERM"),
        (notam(RING.replace("541000N", "546100N")), "'A1485/26': E: holds 546100N, which is no coordinate"),
        (notam(g="FL100"), "'A1485/26': G: is measured from a surface of constant pressure"),
        (notam(f="500FT AGL"), "'A1485/26': F: is measured from the ground"),
        (notam(g="3000FT"), "'A1485/26': G: must be such as SFC, FL195, 2000FT AMSL or UNL, with its reference"),
        (notam() * 2, "area 'A1485/26': id: is given twice, by NOTAM 1 and NOTAM 2"),
    ],
)
def test_a_mistake_in_a_notam_is_named(text: str, rule: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=rule) as refused:
        contents(tmp_path, text, "a.notam")
    assert str(refused.value).count("\n") == 0


def s124(dates: str = "", shape: str = "", part: str = "NavwarnPart") -> str:
    ring = f"<gml:LinearRing><gml:posList>{SQUARE}</gml:posList></gml:LinearRing>"
    patch = f"<gml:PolygonPatch><gml:exterior>{ring}</gml:exterior></gml:PolygonPatch>"
    own = (
        shape
        or f"<S100:surfaceProperty><S100:Surface><gml:patches>{patch}</gml:patches></S100:Surface>"
        "</S100:surfaceProperty>"
    )
    return (
        '<Dataset xmlns="http://www.iho.int/S124/gml/2.0" xmlns:gml="http://www.opengis.net/gml/3.2" '
        'xmlns:S100="http://www.iho.int/s100gml/5.0"><members><NavwarnPreamble><messageSeriesIdentifier>'
        "<warningNumber>1</warningNumber><year>2026</year></messageSeriesIdentifier></NavwarnPreamble>"
        f'<{part} gml:id="W.1">{dates}<warningInformation><information><text>Firing</text></information>'
        f"</warningInformation><geometry>{own}</geometry></{part}></members></Dataset>"
    )


def dates(start: str = "2026-03-01", end: str = "2026-03-02", clock: str = "") -> str:
    return (
        f"<fixedDateRange><dateStart><S100:date>{start}</S100:date></dateStart><dateEnd><S100:date>{end}</S100:date>"
        f"</dateEnd>{clock}</fixedDateRange>"
    )


@pytest.mark.parametrize("part", ["NavwarnPart", "NAVWARNPart", "S124_NavigationalWarningPart", "NavwarnAreaAffected"])
def test_a_part_of_a_warning_becomes_an_area(part: str, tmp_path: Path) -> None:
    area = one(tmp_path, s124(dates(), part=part))
    assert (area.key, area.name, area.footprint.bounds) == ("W.1", "Firing", (4.0, 57.0, 5.0, 58.0))
    assert (minutes(area.start_us), minutes(area.end_us)) == (np.datetime64("2026-03-01"), np.datetime64("2026-03-03"))
    assert area.properties == {"warningNumber": "1", "year": "2026", "text": "Firing", "part": part}
    clock = "<timeOfDayStart>10:00:00</timeOfDayStart><timeOfDayEnd>123000Z</timeOfDayEnd>"
    area = one(tmp_path, s124(dates(clock=clock)))
    assert (minutes(area.start_us), minutes(area.end_us)) == (
        np.datetime64("2026-03-01T10:00"),
        np.datetime64("2026-03-02T12:30"),
    )
    assert one(tmp_path, s124()).start_us is None


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        (s124(dates("--03-01")), "warning 'W.1': dateStart in line 1: must be a whole date"),
        (s124(dates(clock="<timeOfDayStart>10h</timeOfDayStart>")), "timeOfDayStart in line 1: must be such as"),
        (s124("<periodicDateRange/>"), "'W.1': periodicDateRange in line 1: is not understood"),
        (s124(dates("2026-03-05")), "area 'W.1': end: must be later than start"),
        (s124().replace(SQUARE, SQUARE[:-5]), "'W.1': exterior in line 1: must be closed"),
        (s124().replace(SQUARE, "157 4 157 5 158 5 157 4"), "latitude must lie"),
    ],
)
def test_a_mistake_in_a_warning_is_named(text: str, rule: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=rule) as refused:
        contents(tmp_path, text)
    assert str(refused.value).count("\n") == 0


def test_points_of_warnings_are_left_out(tmp_path: Path) -> None:
    point = "<S100:pointProperty><S100:Point><gml:pos>57 4</gml:pos></S100:Point></S100:pointProperty>"
    found = contents(tmp_path, s124(shape=point))
    assert found.areas == []
    assert [one.reason for one in found.skipped] == ["1 geometries are Points: no areas"]


@pytest.mark.parametrize(
    ("number", "key"),
    [
        ("(B12345/26 NOTAMN", "B12345/26"),
        ("(B0002/26 NOTAM", "B0002/26"),
        ("(b0002/26 notamn", "B0002/26"),
        ("B0002/2026 NOTAMR A0009/2026", "B0002/26"),
    ],
)
@pytest.mark.parametrize("subject", ["QMRLC", "QWMLW"])
def test_numbers_of_notam_in_other_spellings(number: str, key: str, subject: str, tmp_path: Path) -> None:
    """The NOTAM before it may be of any subject."""
    found = contents(tmp_path, notam(q=subject) + notam().replace("(A1485/26 NOTAMN", number), "a.txt")
    assert [area.key for area in found.areas if area.key != "A1485/26"] == [key]
    replaced = notam().replace("A1485/26", "A0009/26") + notam().replace("(A1485/26 NOTAMN", number)
    assert len(contents(tmp_path, replaced, "a.txt").areas) == (1 if "NOTAMR" in number else 2)


def test_a_notam_in_small_letters_is_read(tmp_path: Path) -> None:
    area = one(tmp_path, notam().lower(), "a.txt")
    assert area.footprint.bounds == one(tmp_path, notam(), "a.txt").footprint.bounds
    assert area.ceiling_m == pytest.approx(3048.0)


@pytest.mark.parametrize("subject", ["QMRLC", "QWMLW"])
@pytest.mark.parametrize(
    ("number", "rule"),
    [
        ("(B0002/26 NOTAMX", r"NOTAM 'A1485/26': number of the next NOTAM: is not understood.*got '\(B0002/26 NOTAMX'"),
        ("(B0002-26 NOTAMN", r"NOTAM 'A1485/26': number of the next NOTAM: is not understood.*got '\(B0002-26 NOTAMN'"),
        ("!FDC 6/1234 ZLA CA..AIRSPACE", "NOTAM '!FDC 6/1234': is in a domestic format"),
    ],
)
def test_a_notam_whose_number_is_not_understood_is_refused(
    subject: str, number: str, rule: str, tmp_path: Path
) -> None:
    text = notam(q=subject) + notam().replace("(A1485/26 NOTAMN", number)
    with pytest.raises(InvalidInput, match=rule):
        contents(tmp_path, text, "a.txt")
    skipped = contents(tmp_path, text, "a.txt", skip_invalid=True).skipped
    assert any("is not understood" in one.reason or "domestic" in one.reason for one in skipped)
    first = notam().replace("(A1485/26 NOTAMN", number) + notam()
    with pytest.raises(InvalidInput, match=r"is not understood|domestic"):
        contents(tmp_path, first, "a.txt")


def test_schedules_of_airspaces_and_notam_are_kept(tmp_path: Path) -> None:
    weekly = activation("ACTIVE", SHEET.format("MON", "08:00", "10:00"), SHEET.format("FRI", "22:00", "02:00"))
    area = one(tmp_path, aixm(("BASELINE", volume() + weekly)))
    assert [(rule["days"], rule["periods"], rule["timezone"]) for rule in area.schedule] == [
        (["MON"], [["08:00", "10:00"]], "UTC"),
        (["FRI"], [["22:00", "02:00"]], "UTC"),
    ]
    area = one(tmp_path, notam().replace("E) GUN", "D) MON-FRI 0600-1800\nE) GUN"), "a.txt")
    assert area.schedule["notam"] == "MON-FRI 0600-1800"
    with pytest.raises(InvalidInput, match=r"A1485/26.*schedule"):
        contents(tmp_path, notam().replace("E) GUN", "D) SOMETIMES\nE) GUN"), "a.txt")


@pytest.mark.parametrize(
    ("unit", "start", "end"),
    [("HR", 60, 90), ("MIN", 1, 2), ("SEC", 0, 1), ("", 1, 2), ("DAY", None, None), ("hr", None, None)],
)
def test_a_relative_event_has_its_unit(unit: str, start: int | None, end: int, tmp_path: Path) -> None:
    """Hours were read as minutes. Seconds are rounded outward to whole minutes."""
    uom = f' uom="{unit}"' if unit else ""
    sheet = (
        "<aixm:timeReference>UTC</aixm:timeReference><aixm:day>ANY</aixm:day><aixm:startEvent>SR</aixm:startEvent>"
        f"<aixm:startTimeRelativeEvent{uom}>1</aixm:startTimeRelativeEvent><aixm:endEvent>SS</aixm:endEvent>"
        f"<aixm:endTimeRelativeEvent{uom}>1.5</aixm:endTimeRelativeEvent>"
    )
    text = aixm(("BASELINE", volume() + activation("ACTIVE", sheet)))
    if start is None:
        with pytest.raises(InvalidInput, match=f"of the unit {unit}; understood are HR, MIN, SEC"):
            one(tmp_path, text, hints=AT_ALL_HEIGHTS)
        return
    rule = one(tmp_path, text, hints=AT_ALL_HEIGHTS).schedule
    begins = f"sunrise+{start}min" if start else "sunrise"
    assert rule["periods"] == [[begins, f"sunset+{end}min"]]


@pytest.mark.parametrize(
    "system",
    [
        "http://www.opengis.net/def/crs/EPSG/0/4326",
        "https://www.opengis.net/def/crs/EPSG/9.9.1/4326",
        "urn:x-ogc:def:crs:EPSG:6.9:4326",
        "EPSG:4326",
        "http://www.opengis.net/def/crs/OGC/1.3/CRS84",
        "urn:ogc:def:crs:OGC:1.3:CRS84",
    ],
)
def test_systems_are_read_in_each_of_their_forms(system: str, tmp_path: Path) -> None:
    ring = SQUARE if "CRS84" not in system else "4 57 5 57 5 58 4 58 4 57"
    text = aixm(("BASELINE", volume(surface(lines(ring), system=f'srsName="{system}"'))))
    assert one(tmp_path, text, hints=AT_ALL_HEIGHTS).footprint.bounds == pytest.approx((4, 57, 5, 58), abs=0.02)


def test_an_end_of_a_day_is_the_next_midnight(tmp_path: Path) -> None:
    """2359 in item C, and a date without a time as the end of a valid time."""
    assert minutes(one(tmp_path, notam(c="2603312359"), "a.txt").end_us) == np.datetime64("2026-04-01T00:00")
    assert minutes(one(tmp_path, notam(c="2603312358"), "a.txt").end_us) == np.datetime64("2026-03-31T23:58")


@pytest.mark.parametrize(
    ("words", "floor", "ceiling"),
    [
        ("TWY K (BTN J AND Q) CLSD", "SFC", "1000FT AMSL"),
        ("TWY (E INTO F) AND (H INTO G) CLSD", "SFC", "1000FT AMSL"),
        ("TWY E INTO F) AND\nG) CLSD", "SFC", "1000FT AMSL"),
        ("A) GUNS B) ROCKETS F) MORTARS G) OTHERS", "FL010", "FL100"),
        ("TWY K (BTN J AND Q) CLSD", "1000FT AMSL", "2000FT AMSL"),
    ],
)
def test_letters_in_item_e_are_no_items(words: str, floor: str, ceiling: str, tmp_path: Path) -> None:
    """They began item Q of a NOTAM that is not there, or took the place of items F and G."""
    text = notam(f"{RING}. {words}", f=floor, g=ceiling)
    area = one(tmp_path, text, "a.txt", hints=AT_ALL_HEIGHTS)
    plain = one(tmp_path, notam(f=floor, g=ceiling), "a.txt", hints=AT_ALL_HEIGHTS)
    assert (area.floor_m, area.ceiling_m) == (plain.floor_m, plain.ceiling_m)
    assert area.properties["text"].endswith(" ".join(words.split()))


def test_coordinates_that_are_not_read_are_remarked(tmp_path: Path) -> None:
    found = contents(
        tmp_path, notam("AREA 54 00 00N 010 20 00E - 54 10 00N 010 20 00E - 54 10 00N 010 40 00E"), "a.txt"
    )
    assert [one.text for one in found.remarks][:1] == [
        "item E describes its area otherwise: the circle of item Q is used"
    ]
    assert not contents(tmp_path, notam("GUN FIRING"), "a.txt").remarks


def test_a_surface_around_a_pole_says_so(tmp_path: Path) -> None:
    """It was refused as not closed, though it is."""
    cap = surface(lines("80 0 80 90 80 180 80 -90 80 0"))
    with pytest.raises(InvalidInput, match="must be a ring; it goes round a pole"):
        contents(tmp_path, aixm(("BASELINE", volume(cap))))


def test_2400_ends_a_day_of_item_c(tmp_path: Path) -> None:
    text = "A0123/26 NOTAMN\nQ) EDWW/QRRCA/IV/BO/W/000/100/5405N01030E010\nA) EDWW B) 2606010600 C) 2606302400\nE) X"
    (area,) = contents(tmp_path, text, "a.txt", hints=AT_ALL_HEIGHTS).areas
    assert area.end_us == int(np.datetime64("2026-07-01", "us").astype(int))
    with pytest.raises(InvalidInput, match="B: must be ten digits"):
        contents(tmp_path, text.replace("2606010600", "2606012400"), "a.txt", hints=AT_ALL_HEIGHTS)


def test_dates_across_new_year_are_those_of_each_year(tmp_path: Path) -> None:
    """Several rules of one valid time keep their own dates."""
    inside = {
        "timeReference": "UTC",
        "startDate": "15-12",
        "endDate": "15-01",
        "startTime": "08:00",
        "endTime": "16:00",
    }
    sheet = "".join(f"<aixm:{name}>{value}</aixm:{name}>" for name, value in inside.items())
    path = tmp_path / "winter.xml"
    text = aixm(("BASELINE", volume() + activation("ACTIVE", sheet)))
    path.write_text(text.replace("2026-03-31T18", "2027-03-31T18"))
    (area,) = read(path).areas
    west, south, east, north = area.footprint.bounds
    way = [[west, south], [east, north]]

    def meets(day: str, hour: int) -> bool:
        times = [np.datetime64(f"{day}T{hour:02}:{minute}") for minute in ("00", "30")]
        ship = Track("ship", way, times, rectangle_outline_m(9.0, 9.0, 9.0, 9.0))
        scene = Scene("s", horizon_days=500)
        return len(solve([ship], [area], scene)) == 1

    days = ("2026-03-02", "2026-12-14", "2026-12-15", "2027-01-14", "2027-01-17")
    assert [meets(day, 10) for day in days] == [False, False, True, True, False]
    assert not meets("2026-12-20", 18)
