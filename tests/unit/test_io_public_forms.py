"""Small files in the forms of neighbouring programs, and what loads of them.

The forms are those of their documentation, writers and test data: MarineCadastre, the Danish Maritime Authority,
VesselFinder, OpenSky, OpenCPN, Garmin's trip planner, Navionics, Google Earth, QGIS, toGeoJSON, MovingPandas, openAIP,
XCSoar and national feeds of UAS zones. All values are made here.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from conflictdb import InvalidInput, read
from conflictdb.formats import Contents, FileHints
from conflictdb.formats.instants import parse_instant

UTC = FileHints(time_zone="UTC", haven_m=(5, 5, 2, 2), unbounded_heights=True)
SQUARE = [[9.0, 57.0], [9.2, 57.0], [9.2, 57.2], [9.0, 57.2], [9.0, 57.0]]
T = [f"2026-06-01T10:{minute:02}:00Z" for minute in (0, 10, 20, 30)]


def us(*texts: str) -> list[int]:
    return [parse_instant(text) for text in texts]


def loaded(folder: Path, name: str, text: Any, hints: FileHints | None = None) -> Contents:
    (folder / name).write_text(text if isinstance(text, str) else json.dumps(text))
    return read(folder / name, hints=hints)


def said(contents: Contents) -> str:
    return "\n".join([*map(str, contents.skipped), *(one.text for one in contents.remarks)])


def test_marine_cadastre(tmp_path: Path) -> None:
    head = "MMSI,BaseDateTime,LAT,LON,SOG,COG,Heading,VesselName,IMO,CallSign,VesselType,Status,Length,Width,Draft,Car"
    rows = [
        f"{mmsi},2026-06-01T10:{minute},{lat},-90,{sog},,511.0,{name},,,57,12,{size},57"
        for mmsi, name, size in ((368084090, "LARRY", "23,10,3.0"), (316005971, "NO SIZE", ",,"))
        for minute, lat, sog in (("00:00", 29.9, 6.0), ("30:00", 29.92, 6.4))
    ]
    found = loaded(tmp_path, "a.csv", "\n".join([head, *rows]))
    assert [(one.key, one.name, one.outline_m.max(axis=0).tolist()) for one in found.tracks] == [
        ("368084090", "LARRY", [5.0, 11.5])
    ]
    for words in ("1 of 2 objects have no size", "speeds that are not read: SOG (2)", "Draft look like heights"):
        assert words in said(found)


def test_danish_maritime_authority(tmp_path: Path) -> None:
    head = "# Timestamp,Type of mobile,MMSI,Latitude,Longitude,SOG,Name,Width,Length,Draught,ETA,A,B,C,D"
    own = "FERRY,12,62,3.4"
    rows = [
        f"01/06/2026 0{hour}:00:00,Class A,219000606,57.7,10.{hour},9.{hour},{own},0{hour}/06/2026 04:00,20,42,6,6"
        for hour in (1, 2)
    ]
    found = loaded(tmp_path, "a.csv", "\n".join([head, *rows]))
    (track,) = found.tracks
    assert track.times_us.tolist() == us("2026-06-01T01:00:00Z", "2026-06-01T02:00:00Z")
    assert (track.outline_m.max(axis=0).tolist(), track.outline_m.min(axis=0).tolist()) == ([6, 20], [-6, -42])
    assert "ETA (1), SOG (1)" in said(found)


def test_vessel_finder_writes_utc_behind_times(tmp_path: Path) -> None:
    """They were refused as no ISO 8601."""
    head = "MMSI,TIMESTAMP,LATITUDE,LONGITUDE,SPEED,NAME,A,B,C,D"
    rows = [f"228339600,2026-06-01 10:{m}:00 UTC,49.{m},0.1,13.8,GENOA,99,56,23,7" for m in (10, 20)]
    (track,) = loaded(tmp_path, "a.csv", "\n".join([head, *rows])).tracks
    assert track.times_us.tolist() == us(T[1], T[2])


def test_state_vectors_of_open_sky_are_as_fast_as_aircraft(tmp_path: Path) -> None:
    """The limit of ships left out all fixes; altitudes are said."""
    head = "time,icao24,lat,lon,velocity,callsign,onground,baroaltitude,geoaltitude,lastcontact"
    start = us(T[0])[0] // 1_000_000
    rows = [f"{start + 10 * i},4b1812,47.0,{8 + 0.03 * i},{210 + i},SWR1,False,{9e3 + i},{9e3 + i},0" for i in range(3)]
    found = loaded(tmp_path, "a.csv", "\n".join([head, *rows]))
    assert [len(track.times_us) for track in found.tracks] == [3]
    assert "baroaltitude (1), geoaltitude (1), velocity (1)" in said(found)


def test_open_cpn_plans_and_drawing(tmp_path: Path) -> None:
    point = '<rtept lat="57.{}" lon="10.6"><time>2026-05-30T12:0{}:00Z</time><extensions><opencpn:viz>1</opencpn:viz>'
    point += "{}</extensions></rtept>"
    drawing = '<opencpn:scale_min_max UseScale="false" ScaleMin="2147483646" ScaleMax="0" />'
    text = (
        '<gpx version="1.1" creator="OpenCPN" xmlns:opencpn="http://www.opencpn.org"><rte><name>S</name><extensions>'
        "<opencpn:planned_speed>6.00</opencpn:planned_speed><opencpn:time_display>UTC</opencpn:time_display>"
        f"<opencpn:planned_departure>{T[0]}</opencpn:planned_departure></extensions>"
        + point.format(4, 1, f"<opencpn:arrival_radius>0.05</opencpn:arrival_radius>{drawing}")
        + point.format(5, 2, '<opencpn:rte_properties planned_speed="8.0" etd="2026-06-01T12:00:00Z" />')
        + point.format(6, 3, '<opencpn:rte_properties planned_speed="5.0" />')
        + "</rte></gpx>"
    )
    found = loaded(tmp_path, "a.gpx", text)
    (track,) = found.tracks
    assert track.times_us[[0, 2]].tolist() == us(T[0], "2026-06-01T12:00:00Z")
    assert [one.text for one in found.remarks][1:] == ["has sizes that are not read: arrival_radius (1)"]


def test_trips_of_garmin_have_departures_arrivals_and_stays(tmp_path: Path) -> None:
    """They were left out, as routes without times."""
    via = '<rtept lat="57.{}" lon="10.5"><extensions><trp:ViaPoint>{}</trp:ViaPoint></extensions></rtept>'
    text = (
        '<gpx version="1.1" creator="Garmin" xmlns:trp="http://www.garmin.com/xmlschemas/TripExtensions/v1">'
        "<metadata><time>2026-05-01T00:00:00Z</time></metadata><rte><name>T</name>"
        + via.format(4, f"<trp:DepartureTime>{T[0]}</trp:DepartureTime>")
        + via.format(5, f"<trp:ArrivalTime>{T[1]}</trp:ArrivalTime><trp:StopDuration>PT10M</trp:StopDuration>")
        + via.format(6, f"<trp:ArrivalTime>{T[3]}</trp:ArrivalTime>")
        + "</rte></gpx>"
    )
    (track,) = loaded(tmp_path, "a.gpx", text, FileHints(haven_m=(0, 0, 0, 0))).tracks
    assert track.times_us.tolist() == us(*T)


def test_navionics_writes_offsets_without_a_colon(tmp_path: Path) -> None:
    point = '<trkpt lat="57.{}" lon="9.0"><ele>0.0</ele><time>2026-06-01T1{}:00:00.000+0000</time></trkpt>'
    points = point.format(0, 0) + point.format(1, 1)
    text = f'<gpx version="1.0"><trk><name>1 Jun</name><trkseg>{points}</trkseg></trk></gpx>'
    (track,) = loaded(tmp_path, "a.gpx", text).tracks
    assert track.times_us.tolist() == us("2026-06-01T10:00:00Z", "2026-06-01T11:00:00Z")


def test_a_tour_and_a_view_of_google_earth_are_no_times_of_zones(tmp_path: Path) -> None:
    ring = " ".join(f"{lon},{lat},120" for lon, lat in SQUARE)
    text = (
        '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><LookAt>'
        "<gx:TimeSpan><begin>2020-06-01T00:00:00Z</begin><end>2020-06-02T00:00:00Z</end></gx:TimeSpan></LookAt>"
        "<gx:Tour><gx:Playlist><gx:FlyTo><gx:duration>5.0</gx:duration></gx:FlyTo></gx:Playlist></gx:Tour>"
        f"<Placemark><name>Zone</name><TimeSpan><begin>{T[0]}</begin><end>{T[1]}</end></TimeSpan><Polygon>"
        "<altitudeMode>relativeToGround</altitudeMode><outerBoundaryIs><LinearRing><coordinates>"
        f"{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"
    )
    found = loaded(tmp_path, "a.kml", text)
    (area,) = found.areas
    assert [area.start_us, area.end_us] == us(T[0], T[1])
    assert [one.text.partition(" that")[0] for one in found.remarks] == ["1 object has altitudes (third coordinates)"]


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def collection(*features: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", **more, "features": list(features)}


def test_qgis_writes_dates_and_a_reference_system(tmp_path: Path) -> None:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    one = feature("MultiPolygon", [[SQUARE]], fid=1, start="2026-06-01", end="2026-06-30", floor_m=None)
    with pytest.raises(InvalidInput) as refused:
        loaded(tmp_path, "q.geojson", collection(one, name="zones", crs=crs))
    assert "got '2026-06-30'" in str(refused.value)  # as the file says it
    (area,) = loaded(tmp_path, "q.geojson", collection(one, name="zones", crs=crs), UTC).areas
    assert [area.start_us, area.end_us] == us("2026-06-01T00:00:00Z", "2026-07-01T00:00:00Z")


@pytest.mark.parametrize("is_old", [False, True])
@pytest.mark.parametrize("kind", ["LineString", "MultiLineString"])
def test_to_geojson_nests_the_times_of_positions(tmp_path: Path, kind: str, is_old: bool) -> None:
    """They were refused: times are missing, and time is not known."""
    line, times = [[9, 57], [9.1, 57], [9.2, 57]], T[:3]
    if kind == "MultiLineString":
        line, times = [line[:2], line[1:]], [T[:2], T[1:3]]
    nested = {"coordTimes": times} if is_old else {"coordinateProperties": {"times": times, "heart": [[1]]}}
    found = loaded(tmp_path, "t.geojson", collection(feature(kind, line, name="M", time=T[0], **nested)), UTC)
    (track,) = found.tracks
    assert track.times_us.tolist() == us(*T[:3])
    assert track.properties == ({} if is_old else {"coordinateProperties": {"heart": [[1]]}})


def test_moving_features_of_moving_pandas_need_a_zone(tmp_path: Path) -> None:
    moving = {"type": "MovingPoint", "coordinates": [[9, 57], [9.1, 57]], "datetimes": ["2026-06-01 10:00:00", T[1]]}
    document = collection({"type": "Feature", "properties": {"id": 1, "sog": 3}, "temporalGeometry": moving})
    with pytest.raises(InvalidInput, match="needs an offset from UTC"):
        loaded(tmp_path, "m.json", document)
    (track,) = loaded(tmp_path, "m.json", document, UTC).tracks
    assert (track.key, track.times_us.tolist()) == ("1", us(T[0], T[1]))


def test_a_national_list_of_uas_zones(tmp_path: Path) -> None:
    """UASZoneList, empty texts, heights above ground: refused in one sentence that names the option."""
    volume = {
        "uomDimensions": "M",
        "lowerLimit": 0,
        "lowerVerticalReference": "AGL",
        "upperLimit": 120,
        "upperVerticalReference": "AGL",
        "horizontalProjection": {"type": "Polygon", "coordinates": [SQUARE]},
    }
    zone = {
        "country": "DNK",
        "restriction": "REQ_AUTHORISATION",
        "applicability": [{"permanent": "YES", "startDateTime": None, "endDateTime": None, "schedule": None}],
        "zoneAuthority": [{"name": "A", "intervalBefore": ""}],
        "geometry": [volume],
    }
    feed = {"title": "t", "UASZoneList": [{"identifier": f"DNK-{i}", "name": "Z", **zone} for i in range(9)]}
    with pytest.raises(InvalidInput) as refused:
        loaded(tmp_path, "z.json", feed)
    (line,) = str(refused.value).splitlines()
    assert "--unbounded-heights takes" in line
    assert "(and 8 more: 'DNK-1'" in line
    found = loaded(tmp_path, "z.json", feed, UTC)
    assert (len(found.areas), list(found.remarks)) == (9, [])


def test_open_air_of_open_aip_and_of_xcsoar(tmp_path: Path) -> None:
    text = (
        "*\n* AIP SUP VFR 18/26\n*\nAC UNC\nAY R\nAN EDR GRAFENAU\nAA 2026-05-05T06:00:00Z/2026-05-13T14:00:00Z\n"
        "AL GND\nAH 8000ft AMSL\nDP 49:06:38 N 012:50:06 E\nDP 48:56:47 N 012:50:33 E\nDP 48:51:09 N 012:59:46 E\n\n"
        "* Airspace to test circle parsing\nAC TMZ\nAN Circle\nAR 130.125 MHz\nAL 1000 ft\nAH UNLIM\n"
        "V X=01:05.5 N 000:05.5 E\nDC 5\n"
    )
    found = loaded(tmp_path, "a.txt", text)
    first, second = found.areas
    assert [first.start_us, first.end_us] == us("2026-05-05T06:00:00Z", "2026-05-13T14:00:00Z")
    assert (first.object_class, first.ceiling_m) == ("R", pytest.approx(2438.4))
    assert (second.object_class, second.floor_m, second.ceiling_m) == ("TMZ", pytest.approx(304.8), None)
    assert "1 airspaces without times (AA) are active at all times, such as 'Circle'" in said(found)


def test_whole_numbers_of_a_column_with_gaps_are_the_same_ship(tmp_path: Path) -> None:
    """pandas writes 219000001.0 where a row of the column is empty."""
    rows = [f"219000001{end},2026-06-01T1{hour}:00:00,9.{hour},57" for hour, end in enumerate((".0", "", ".0"))]
    (track,) = loaded(tmp_path, "a.csv", "\n".join(["mmsi,basedatetime,lon,lat", *rows])).tracks
    assert (track.key, len(track.times_us)) == ("219000001", 3)


@pytest.mark.parametrize("end", ["2026-06-01T24:00:00Z", "2026-06-01T24:00Z", "2026-06-02T02:00:00+02:00"])
def test_the_end_of_a_day_in_kml(tmp_path: Path, end: str) -> None:
    ring = " ".join(f"{lon},{lat}" for lon, lat in SQUARE)
    text = (
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>Z</name><TimeSpan>'
        f"<begin>{T[0]}</begin><end>{end}</end></TimeSpan><Polygon><outerBoundaryIs><LinearRing><coordinates>{ring}"
        "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
    )
    assert loaded(tmp_path, "a.kml", text).areas[0].end_us == us("2026-06-02T00:00:00Z")[0]


def test_crs_84_with_a_colon_is_longitude_and_latitude(tmp_path: Path) -> None:
    document = collection(feature("Polygon", [SQUARE]), crs={"type": "name", "properties": {"name": "CRS:84"}})
    assert loaded(tmp_path, "a.geojson", document).areas[0].footprint.bounds == (9.0, 57.0, 9.2, 57.2)


def test_a_leg_of_decades_in_a_file_of_another_program_is_remarked(tmp_path: Path) -> None:
    moving = {"type": "MovingPoint", "coordinates": [[9, 57], [9.1, 57]], "datetimes": ["1980-01-06T00:00:00Z", T[1]]}
    document = collection({"type": "Feature", "id": "M", "properties": {}, "temporalGeometry": moving})
    found = loaded(tmp_path, "m.json", document, UTC)
    assert "1 track has legs of more than 31 days; the longest, of 46 years, is that of 'M'" in said(found)
