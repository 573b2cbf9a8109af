"""Changed files of other formats never end in another error than InvalidInput."""

import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from route_files import rtz, s421

from conflictdb import InvalidInput, read
from conflictdb.formats import FileHints

GPX = (
    '<gpx xmlns:o="http://www.opencpn.org"><wpt lat="1" lon="2"/><trk><name>T</name><trkseg>'
    '<trkpt lat="57" lon="4"><time>2026-03-01T06:00:00Z</time></trkpt>'
    '<trkpt lat="57.1" lon="4"><time>2026-03-01T07:00:00Z</time></trkpt></trkseg></trk>'
    "<rte><name>R</name><extensions><o:planned_departure>2026-03-01T06:00:00Z</o:planned_departure>"
    '<o:planned_speed>12</o:planned_speed></extensions><rtept lat="57" lon="4"/><rtept lat="57" lon="5"/></rte></gpx>'
)
AIXM = (
    '<m:AIXMBasicMessage xmlns:m="http://www.aixm.aero/schema/5.1/message"><m:hasMember><Airspace id="uuid.1">'
    "<timeSlice><AirspaceTimeSlice><validTime><TimePeriod><beginPosition>2026-03-01T06:00:00Z</beginPosition>"
    "<endPosition>2026-03-31T18:00:00Z</endPosition></TimePeriod></validTime><interpretation>BASELINE</interpretation>"
    "<sequenceNumber>1</sequenceNumber><correctionNumber>0</correctionNumber><designator>EAR1</designator>"
    "<geometryComponent><AirspaceGeometryComponent><operation>BASE</operation><theAirspaceVolume><AirspaceVolume>"
    '<upperLimit uom="M">900</upperLimit><upperLimitReference>MSL</upperLimitReference><horizontalProjection>'
    '<Surface srsName="urn:ogc:def:crs:EPSG::4326"><patches><PolygonPatch><exterior><Ring><curveMember><Curve>'
    "<segments><GeodesicString><posList>55 10 55.4 10</posList></GeodesicString><ArcByCenterPoint><pos>55 10</pos>"
    '<radius uom="NM">24.06</radius><startAngle uom="deg">0</startAngle><endAngle uom="deg">90</endAngle>'
    "</ArcByCenterPoint><LineStringSegment><pos>54.998 10.697</pos><pos>55 10</pos></LineStringSegment></segments>"
    "</Curve></curveMember></Ring></exterior></PolygonPatch></patches></Surface></horizontalProjection>"
    "</AirspaceVolume></theAirspaceVolume></AirspaceGeometryComponent></geometryComponent><activation>"
    "<AirspaceActivation><timeInterval><Timesheet><timeReference>UTC</timeReference><day>ANY</day>"
    "<startTime>00:00</startTime><endTime>00:00</endTime></Timesheet></timeInterval><status>ACTIVE</status>"
    "</AirspaceActivation></activation></AirspaceTimeSlice></timeSlice></Airspace></m:hasMember></m:AIXMBasicMessage>"
)
S124 = (
    '<Dataset xmlns="http://www.iho.int/S124/gml/2.0"><members><NavwarnPart id="W"><fixedDateRange><dateStart>'
    "<date>2026-03-01</date></dateStart><dateEnd><date>2026-03-02</date></dateEnd><timeOfDayStart>100000Z"
    "</timeOfDayStart></fixedDateRange><geometry><surfaceProperty><Surface><patches><PolygonPatch><exterior>"
    "<LinearRing><posList>57 4 57 5 58 5 57 4</posList></LinearRing></exterior></PolygonPatch></patches></Surface>"
    "</surfaceProperty></geometry></NavwarnPart></members></Dataset>"
)
NOTAM = (
    "(A1485/26 NOTAMN Q) EDWW/QWMLW/IV/BO/W/000/100/5405N01030E010 A) EDWW B) 2603010600 C) 2603311800 EST "
    "E) WI 5NM RADIUS OF 540000N 0102000E F) SFC G) 10000FT AMSL)"
)
OPENAIR = (
    "AC R\nAY TRA\nAN EDR 1\nAA 2026-06-01T10:00Z/2026-06-01T12:00Z\nAL 500ft AGL\nAH FL95\nV X=57:0:0 N 010:0:0 E\n"
    "V D=-\nDA 5, 185, 155\nDP 56:50:00 N 010:05:00 E\nDB 57:06:00 N 010:00:00 E, 57:00:00 N 010:11:00 E\nDC 2.5\n"
)
SCHEDULE = '<schedule id="1"><manual><scheduleElement waypointId="1" etd="2026-03-01T06:00:00Z"/>'
SCHEDULE += '<scheduleElement waypointId="2" speed="12" stay="PT1H"/>'
SCHEDULE += '<scheduleElement waypointId="3" speed="9"/></manual></schedule>'
FILES = {
    "a.rtz": rtz(schedules=SCHEDULE),
    "a.s421": s421(),
    "a.gpx": GPX,
    "airspace.xml": AIXM,
    "warning.gml": S124,
    "a.notam": NOTAM,
    "a.openair": OPENAIR,
}
TOKEN = re.compile(r"[A-Za-z_]+|-?\d+(?:\.\d+)?|[<>/=\"':.]")
OTHERS = ("", "-1", "1e999", "nan", "999999999999999999999", "x", "é", "0", "<a/>", "2026", "-")
HINTS = FileHints(unbounded_heights=True)


@pytest.mark.parametrize("name", FILES)
def test_a_valid_file_is_read(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(FILES[name])
    found = read(tmp_path / name, hints=HINTS)
    assert len(found.areas) + len(found.tracks) >= 1


@pytest.mark.parametrize(
    ("name", "change", "reason"),
    [
        ("warning.gml", ("geometry>", "geometri>"), "left out warning 'W': has no geometry that is read: no area"),
        ("airspace.xml", ("timeSlice>", "timeSlices>"), "left out zone .*: has no AirspaceTimeSlice: no area"),
    ],
)
def test_an_object_without_its_contents_is_listed(
    name: str, change: tuple[str, str], reason: str, tmp_path: Path
) -> None:
    """It was left out in silence, beside others."""
    (tmp_path / name).write_text(FILES[name].replace(*change))
    assert [bool(re.search(reason, str(one))) for one in read(tmp_path / name, hints=HINTS).skipped] == [True]


@pytest.mark.parametrize(("name", "other"), [("stay", "Stay"), ("speed", "sped"), ("etd", "ETD")])
def test_a_misspelt_attribute_of_a_schedule_is_refused(name: str, other: str, tmp_path: Path) -> None:
    (tmp_path / "a.rtz").write_text(FILES["a.rtz"].replace(f" {name}=", f" {other}="))
    with pytest.raises(InvalidInput, match=f"{other}: is not known to RTZ; did you mean {name}?"):
        read(tmp_path / "a.rtz", hints=HINTS)
    more = 'windSpeed="9" fuel="1" Note="n" rpm="80" speed='
    (tmp_path / "a.rtz").write_text(FILES["a.rtz"].replace("speed=", more, 1))
    assert len(read(tmp_path / "a.rtz", hints=HINTS).tracks) == 1


@pytest.mark.parametrize("name", FILES)
def test_a_changed_file_is_read_or_refused(name: str, tmp_path: Path) -> None:
    """One token is replaced, removed or doubled at a time."""
    text, path = FILES[name], tmp_path / name
    rng = np.random.default_rng(7)
    tokens = list(TOKEN.finditer(text))
    for at in rng.choice(len(tokens), 60):
        token = tokens[at]
        other = token[0] * 2 if rng.random() < 0.2 else OTHERS[rng.integers(len(OTHERS))]
        path.write_text(text[: token.start()] + other + text[token.end() :])
        with suppress(InvalidInput):
            read(path, hints=HINTS)
