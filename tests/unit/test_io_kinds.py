"""Kinds of reported faults, each in every format that can have it: days as ends, 24:00, rings over 180, and others."""

import json
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import geopandas
import pandas as pd
import pytest
import shapely
from whole_files import AIXM, CSV, GPX, KML, MFJSON, NOTAM, OPENAIR, RTZ, S124, ed269, ed318, f3548

from conflictdb import InvalidInput, read
from conflictdb.formats import Contents, FileHints
from conflictdb.formats.instants import parse_instant

SQUARE = [[9.0, 57.0], [9.2, 57.0], [9.2, 57.2], [9.0, 57.2], [9.0, 57.0]]
OVER_180 = [[179.0, -17.0], [-179.0, -17.0], [-179.0, -16.0], [179.0, -16.0], [179.0, -17.0]]


def loaded(path: Path, **more: Any) -> Contents:
    datum = "wgs84" if path.name == "f3548.json" else None
    hints = FileHints(time_zone="UTC", haven_m=(5, 5, 2, 2), unbounded_heights=True, vertical_datum=datum, **more)
    return read(path, hints=hints)


def written(folder: Path, name: str, text: Any) -> Path:
    (folder / name).write_text(text if isinstance(text, str) else json.dumps(text))
    return folder / name


def frame(folder: Path, name: str, shape: Any, **columns: Any) -> Path:
    made = geopandas.GeoDataFrame({"id": ["Z"], **columns}, geometry=[shape], crs=4326)
    (made.to_parquet if name.endswith("parquet") else made.to_file)(folder / name)
    return folder / name


def geojson(ring: Any, **properties: Any) -> dict[str, Any]:
    shape = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "id": "Z", "geometry": shape, "properties": properties}
    return {"type": "FeatureCollection", "features": [feature]}


def changed(document: str, change: Callable[[Any], None]) -> str:
    value = json.loads(document)
    change(value)
    return json.dumps(value)


def times_of_intent(start: str, end: str) -> Callable[[Any], None]:
    def change(value: Any) -> None:
        volume = value["operational_intent"]["details"]["volumes"][0]
        volume["time_start"]["value"], volume["time_end"]["value"] = start, end

    return change


def times_of_zone(start: str, end: str) -> Callable[[Any], None]:
    def change(value: Any) -> None:
        value["features"][0]["applicability"] = [{"startDateTime": start, "endDateTime": end}]

    return change


DAYS = {
    "geojson": lambda to: written(to, "a.geojson", geojson(SQUARE, start="2026-06-01", end="2026-06-02")),
    "spans": lambda to: written(to, "a.geojson", geojson(SQUARE, spans=[["2026-06-01", "2026-06-02"]])),
    **{
        name: lambda to, name=name: frame(
            to, name, shapely.Polygon(SQUARE), start=[date(2026, 6, 1)], end=[date(2026, 6, 2)]
        )
        for name in ("a.parquet", "a.gpkg", "a.fgb", "a.shp")
    },
    "f3548": lambda to: written(to, "f3548.json", changed(f3548(), times_of_intent("2026-06-01", "2026-06-02"))),
    "ed269": lambda to: written(to, "z.json", changed(ed269(), times_of_zone("2026-06-01", "2026-06-02"))),
    "openair": lambda to: written(
        to, "a.txt", OPENAIR.replace("2026-06-01T10:00Z/2026-06-01T12:00Z", "2026-06-01/2026-06-02")
    ),
    "kml": lambda to: written(
        to,
        "a.kml",
        KML.replace("<begin>2026-06-01T10:00:00Z", "<begin>2026-06-01").replace(
            "<end>2026-06-01T11:00:00Z", "<end>2026-06-02"
        ),
    ),
    "s124": lambda to: written(
        to,
        "a.gml",
        S124.replace("<timeOfDayStart>100000Z</timeOfDayStart>", "").replace(
            "<timeOfDayEnd>120000Z</timeOfDayEnd>", ""
        ),
    ),
    "aixm": lambda to: written(
        to, "a.xml", AIXM.replace("2026-06-01T10:00:00Z", "2026-06-01").replace("2026-07-01T00:00:00Z", "2026-06-02")
    ),
}


@pytest.mark.parametrize("kind", DAYS)
def test_an_end_that_is_a_date_contains_its_day(kind: str, tmp_path: Path) -> None:
    area = loaded(DAYS[kind](tmp_path)).areas[0]
    assert area.start_us == parse_instant("2026-06-01T00:00:00Z")
    assert area.end_us == parse_instant("2026-06-03T00:00:00Z")


ENDS_OF_DAYS = {
    "aixm": ("a.xml", AIXM.replace("2026-07-01T00:00:00Z", "2026-06-01T24:00:00Z")),
    "csv": ("a.csv", CSV.replace("2026-06-01T11:00:00Z", "2026-06-01 24:00:00")),
    "ed269": ("z.json", changed(ed269(), times_of_zone("2026-06-01T10:00:00Z", "2026-06-01T24:00:00Z"))),
    "f3548": ("f3548.json", changed(f3548(), times_of_intent("2026-06-01T10:00:00Z", "2026-06-01T24:00:00Z"))),
    "gpx": ("a.gpx", GPX[: GPX.index("<rte>")] + GPX[GPX.index("<trk>") :].replace("T11:00:00Z", "T24:00:00Z")),
    "kml": ("a.kml", KML.replace("2026-06-01T11:00:00Z", "2026-06-01T24:00:00Z")),
    "mfjson": ("a.mfjson", MFJSON.replace("2026-06-01T11:00:00Z", "2026-06-01T24:00:00Z")),
    "notam": ("a.notam", NOTAM.replace("2606301800", "2606012400").replace("D) 0800-1000 ", "")),
    "openair": ("a.txt", OPENAIR.replace("2026-06-01T12:00Z", "2026-06-01T24:00Z")),
    "rtz": ("a.rtz", RTZ.replace('eta="2026-06-01T14:00:00Z"', 'eta="2026-06-01T24:00:00Z"')),
    "s124": ("a.gml", S124.replace("<date>2026-06-02<", "<date>2026-06-01<").replace("120000Z", "240000Z")),
}


@pytest.mark.parametrize("kind", ENDS_OF_DAYS)
def test_24_00_is_the_next_midnight(kind: str, tmp_path: Path) -> None:
    found = loaded(written(tmp_path, *ENDS_OF_DAYS[kind]), max_gap_s=1e9)
    ends = {area.end_us for area in found.areas} | {int(track.times_us[-1]) for track in found.tracks}
    assert ends == {parse_instant("2026-06-02T00:00:00Z")}


def vertices(value: Any) -> None:
    volume = value["operational_intent"]["details"]["volumes"][0]["volume"]
    volume.pop("outline_circle")
    volume["outline_polygon"] = {"vertices": [{"lng": lon, "lat": lat} for lon, lat in OVER_180[:4]]}


def projection(value: Any) -> None:
    value["features"][0]["geometry"][0]["horizontalProjection"] = {"type": "Polygon", "coordinates": [OVER_180]}


def segments(positions: str) -> str:
    at = AIXM.index("<segments>"), AIXM.index("</segments>")
    return (
        f"{AIXM[: at[0]]}<segments><LineStringSegment><posList>{positions}</posList></LineStringSegment>{AIXM[at[1] :]}"
    )


LAT_LON = " ".join(f"{lat:g} {lon:g}" for lon, lat in OVER_180)
SHORTER_WAY = {
    "f3548": ("f3548.json", changed(f3548(), vertices)),
    "openair": (
        "a.txt",
        (
            "AC R\nAN X\nDP 17:00:00 S 179:00:00 E\nDP 17:00:00 S 179:00:00 W\nDP 16:00:00 S 179:00:00 W\n"
            "DP 16:00:00 S 179:00:00 E\n"
        ),
    ),
    "notam": (
        "a.notam",
        NOTAM.replace("5NM RADIUS OF 540000N 0102000E", "1700S17900E-1700S17900W-1600S17900W-1600S17900E"),
    ),
    "aixm": ("a.xml", segments(LAT_LON)),
    "s124": ("a.gml", S124.replace("57 4 57 5 58 5 57 4", LAT_LON)),
}
REMARKED = {
    "geojson": lambda to: written(to, "a.geojson", geojson(OVER_180)),
    "kml": lambda to: written(
        to,
        "a.kml",
        KML.replace("9,57 9.2,57 9.2,57.2 9,57.2 9,57", " ".join(f"{lon},{lat}" for lon, lat in OVER_180)),
    ),
    "ed269": lambda to: written(to, "z.json", changed(ed269(), projection)),
    "parquet": lambda to: frame(to, "a.parquet", shapely.Polygon(OVER_180)),
    "gpkg": lambda to: frame(to, "a.gpkg", shapely.Polygon(OVER_180)),
}


@pytest.mark.parametrize("kind", SHORTER_WAY)
def test_rings_of_shortest_lines_take_the_shorter_way(kind: str, tmp_path: Path) -> None:
    (area,) = loaded(written(tmp_path, *SHORTER_WAY[kind])).areas
    assert area.footprint.bounds[::2] == pytest.approx((179.0, 181.0))


@pytest.mark.parametrize("kind", REMARKED)
def test_rings_that_are_not_cut_at_180_are_remarked(kind: str, tmp_path: Path) -> None:
    said = [one.text for one in loaded(REMARKED[kind](tmp_path)).remarks]
    assert any("sides of more than 180 degrees" in text for text in said)


@pytest.mark.parametrize("name", ["a.parquet", "a.gpkg"])
def test_tracks_that_are_cut_at_180_are_joined(name: str, tmp_path: Path) -> None:
    lines = shapely.MultiLineString([[(179, 0), (180, 0)], [(-180, 0), (-179, 0)]])
    times = [f"2026-06-01T1{hour}:00:00Z" for hour in range(3)]
    (track,) = loaded(frame(tmp_path, name, lines, times=[json.dumps(times)])).tracks
    assert track.positions_deg[:, 0].tolist() == [179.0, 180.0, 181.0]


@pytest.mark.parametrize(
    "name",
    [
        "http://www.opengis.net/def/crs/EPSG/0/4326",
        "https://www.opengis.net/def/crs/EPSG/0/4326",
        "urn:ogc:def:crs:EPSG:9.9.1:4326",
        "urn:ogc:def:crs:OGC::CRS84",
        "http://www.opengis.net/def/crs/OGC/1.3/CRS84",
        "OGC:CRS84",
        "CRS:84",
    ],
)
def test_names_of_longitude_and_latitude(name: str, tmp_path: Path) -> None:
    document = {**geojson(SQUARE), "crs": {"type": "name", "properties": {"name": name}}}
    (area,) = loaded(written(tmp_path, "a.geojson", document)).areas
    assert area.footprint.bounds == (9.0, 57.0, 9.2, 57.2)


@pytest.mark.parametrize("row", ["0,100,0,20", "0,100,0,0"])
@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_sizes_of_ships_without_a_place_of_the_antenna(row: str, name: str, tmp_path: Path) -> None:
    """Of columns a to d only four zeros are no size, also in GeoParquet; a whole number of a float is the same ship."""
    sizes = dict(zip("abcd", map(float, row.split(",")), strict=True))
    times = pd.to_datetime(["2026-06-01T10:00:00Z", "2026-06-01T11:00:00Z"])
    table = pd.DataFrame({"mmsi": 219000001.0, "time": times, "lon": [9.0, 9.1], "lat": 57.0, **sizes})
    if name == "a.csv":
        table.rename(columns={"time": "basedatetime"}).to_csv(tmp_path / name, index=False)
    else:
        table.to_parquet(tmp_path / name)
    (track,) = read(tmp_path / name).tracks
    assert track.key == "219000001"
    assert track.outline_m.max(axis=0).tolist() == [sizes["d"], 100.0]
    assert track.outline_m.min(axis=0).tolist() == [-sizes["d"], -100.0]


def test_rings_around_a_pole_are_refused_in_every_format(tmp_path: Path) -> None:
    cap = [[0.0, 80.0], [90.0, 80.0], [180.0, 80.0], [-90.0, 80.0], [0.0, 80.0]]

    def around(value: Any) -> None:
        vertices(value)
        outline = value["operational_intent"]["details"]["volumes"][0]["volume"]["outline_polygon"]
        outline["vertices"] = [{"lng": lon, "lat": lat} for lon, lat in cap[:4]]

    def layered(value: Any) -> None:
        value["features"][0]["geometry"] = {"type": "Polygon", "coordinates": [cap], "layer": {}}

    lat_lon = " ".join(f"{lat:g} {lon:g}" for lon, lat in cap)
    places = "8000N00000E-8000N09000E-8000N18000E-8000N09000W"
    files = [
        frame(tmp_path, "a.gpkg", shapely.Polygon(cap)),
        written(tmp_path, "f3548.json", changed(f3548(), around)),
        written(tmp_path, "z.geojson", changed(ed318(), layered)),
        written(tmp_path, "a.notam", NOTAM.replace("5NM RADIUS OF 540000N 0102000E", places)),
        written(tmp_path, "a.xml", segments(lat_lon)),
        written(tmp_path, "a.gml", S124.replace("57 4 57 5 58 5 57 4", lat_lon)),
    ]
    for path in files:
        with pytest.raises(InvalidInput, match="it goes round a pole: close it along latitude 90"):
            loaded(path)
