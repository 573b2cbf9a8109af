"""Files for OGR as attackers write them: no other file, no address, no gigabytes; bounded time, one message."""

import socket
import sqlite3
import threading
import time
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from ogr_files import write_layer
from plan_files import LONGEST_S, hostile_refusal

from conflictdb import formats
from conflictdb.errors import InvalidInput
from conflictdb.formats import ogr

pytestmark = pytest.mark.usefixtures("readers_of_users")

SECRET = "stolen from another file"  # noqa: S105


# Two seconds and half a gigabyte, so that tests need not wait for more.
LITTLE = replace(ogr.PROGRAM, seconds_per_mb=0.01, memory_per_mb=1, least_seconds=2.0, least_memory=1 << 29)
SQUARE = shapely.box(4, 57, 5, 58)


def geopackage(path: Path, name: str = "one") -> Path:
    return write_layer(path, [SQUARE], kind="Polygon", name=[name])


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    (tmp_path / "private").mkdir()
    return geopackage(tmp_path / "private" / "secret.gpkg", SECRET)


@pytest.fixture
def listener() -> Iterator[tuple[str, list[bytes]]]:
    """A web server on this machine, and the requests that it got."""
    asked: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    caller, _ = server.accept()
                except OSError:
                    return
                with caller:
                    asked.append(caller.recv(1000))
                    caller.sendall(b"HTTP/1.0 404 Not Found\r\n\r\n")

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}", asked
        server.shutdown(socket.SHUT_RDWR)
    thread.join(5.0)


VRT = '<OGRVRTDataSource><OGRVRTLayer name="secret"><SrcDataSource>{}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>'
GDALG = '{{"type": "gdal_streamed_alg", "command_line": "gdal vector read {} --output-format=stream"}}'
KML = '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'
LINK = "<NetworkLink><Link><href>{0}</href></Link></NetworkLink><Style><IconStyle><href>{0}</href></IconStyle></Style>"
GML = (
    '<?xml version="1.0"?><ogr:FeatureCollection xmlns:ogr="http://ogr.maptools.org/" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:gml="http://www.opengis.net/gml" '
    'xmlns:xlink="http://www.w3.org/1999/xlink" xsi:schemaLocation="http://ogr.maptools.org/ {0}">'
    '<gml:featureMember><ogr:a fid="1"><ogr:geometryProperty xlink:href="{0}#x"/></ogr:a></gml:featureMember>'
    "</ogr:FeatureCollection>"
)
ENTITY = '<?xml version="1.0"?><!DOCTYPE kml [<!ENTITY x SYSTEM "{}">]><kml><Document><name>&x;</name></Document></kml>'


@pytest.mark.parametrize("name", ["areas.vrt", "areas.kml"])
@pytest.mark.parametrize("text", [VRT, GDALG, GML, ENTITY, KML.format(LINK)])
def test_no_other_file_is_read(tmp_path: Path, secret: Path, name: str, text: str) -> None:
    """Whatever the name is; and no new file is written to the directory."""
    path = tmp_path / name
    path.write_text(text.format(secret))
    try:
        contents = formats.read(path)
    except InvalidInput as refused:
        assert SECRET not in str(refused)  # noqa: PT017
    else:
        assert not contents.areas
    assert sorted(one.name for one in tmp_path.iterdir()) == sorted([name, "private"])


@pytest.mark.parametrize("text", [VRT, GML, ENTITY, KML.format(LINK), '{{"type": "x", "href": "{}"}}', "WFS:{}"])
def test_no_address_is_fetched(tmp_path: Path, listener: tuple[str, list[bytes]], text: str) -> None:
    address, asked = listener
    path = tmp_path / "areas.kml"
    path.write_text(text.format(f"{address}/areas.kml"))
    with suppress(InvalidInput):
        assert not formats.read(path).areas
    assert not asked


@pytest.mark.parametrize(
    "path", ["/vsicurl/http://127.0.0.1:9/a.gpkg", "/vsistdin/", "PG:dbname=postgres", "WFS:http://127.0.0.1:9"]
)
def test_what_is_no_file_does_not_exist(path: str) -> None:
    with pytest.raises(InvalidInput, match="does not exist"):
        formats.read(path)


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE VIRTUAL TABLE stolen USING VirtualOGR('{}')",
        "CREATE VIEW stolen AS SELECT ogr_layer_Extent('{}') AS geom, 1 AS fid",
        "CREATE VIEW stolen AS SELECT load_extension('{}') AS geom, 1 AS fid",
        "CREATE VIEW stolen AS SELECT readfile('{}') AS geom, 1 AS fid",
    ],
)
def test_a_geopackage_reaches_no_other_file(tmp_path: Path, secret: Path, statement: str) -> None:
    path = geopackage(tmp_path / "areas.gpkg")
    register(path, statement.format(secret) if "VIRTUAL" not in statement else "", "stolen")
    if "VIRTUAL" in statement:
        with sqlite3.connect(path) as database:
            database.execute("PRAGMA writable_schema = ON")
            row = ("table", "stolen", "stolen", 0, statement.format(secret))
            database.execute("INSERT INTO sqlite_master VALUES (?, ?, ?, ?, ?)", row)
        database.close()
    try:
        names = [area.name for area in formats.read(path).areas]
    except InvalidInput as refused:
        assert SECRET not in str(refused)  # noqa: PT017
    else:
        assert SECRET not in names


def register(path: Path, statement: str, table: str) -> None:
    database = sqlite3.connect(path)
    database.create_function("ST_IsEmpty", 1, lambda shape: 0)
    for name in ("ST_MinX", "ST_MaxX", "ST_MinY", "ST_MaxY"):
        database.create_function(name, 1, lambda shape: 0.0)
    with database:
        if statement:
            database.execute(statement)
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES (?, 'features', ?, 4326)",
            (table, table),
        )
        database.execute("INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'POLYGON', 4326, 0, 0)", (table,))
    database.close()


def test_a_geopackage_that_never_ends_is_ended(tmp_path: Path) -> None:
    """A view that counts for ever."""
    path = geopackage(tmp_path / "areas.gpkg")
    count = "WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) SELECT n AS fid, NULL AS geom FROM c"
    register(path, f"CREATE VIEW endless AS {count}", "endless")
    with pytest.raises(InvalidInput, match="takes too much to read"):
        ogr.read_layers(path, 64.0, LITTLE)


def test_a_small_archive_of_gigabytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "areas.kmz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("doc.kml", "w") as one,
    ):
        one.write(KML.format("<name>").split("</Document>")[0].encode())
        for _ in range(600):
            one.write(b"x" * 1_000_000)
    assert path.stat().st_size < 10_000_000
    with pytest.raises(InvalidInput, match=r"takes too much to read|cannot be read"):
        ogr.read_layers(path, 64.0, LITTLE)


def test_more_than_the_limit_is_refused(tmp_path: Path) -> None:
    path = geopackage(tmp_path / "areas.gpkg", "n" * 20_000)
    with pytest.raises(InvalidInput, match=r"holds more than 0\.01 MB"):
        formats.read(path, max_file_mb=0.01)
    assert len(formats.read(path, max_file_mb=1.0).areas) == 1


@pytest.mark.parametrize(
    "text",
    [
        KML.format("<Folder>" * 100_000),
        KML.format("<Folder>" * 20_000 + "</Folder>" * 20_000),
        '<?xml version="1.0"?><!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa">'
        + "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefghij", "bcdefghijk", strict=True))
        + "]><kml><Document><name>&k;</name></Document></kml>",
    ],
)
def test_nested_xml_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "areas.kml"
    path.write_text(text)
    assert hostile_refusal(path)


def test_settings_of_the_caller_do_not_reach_ogr(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GDAL_SKIP", "GPKG")
    monkeypatch.setenv("OGR_SKIP", "GPKG")
    assert len(formats.read(geopackage(tmp_path / "areas.gpkg")).areas) == 1


def test_points_without_a_time_are_told_in_no_time(tmp_path: Path) -> None:
    path = tmp_path / "plan.gpx"
    points = '<trkpt lat="1" lon="1"/>' * 30_000
    path.write_text(
        '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">'
        f"<trk><trkseg>{points}</trkseg></trk></gpx>"
    )
    began = time.monotonic()
    (skipped,) = formats.read(path).skipped
    assert time.monotonic() - began < LONGEST_S
    assert len(skipped.lines) == 30_000


def test_layers_that_are_called_as_those_of_gpx_are_read_as_others(tmp_path: Path) -> None:
    path = tmp_path / "areas.gpkg"
    for layer in ("waypoints", "routes", "tracks", "route_points", "track_points"):
        write_layer(path, [SQUARE], layer, time=[7])
    assert len(formats.read(path).areas) == 5


def test_many_columns_are_refused(tmp_path: Path) -> None:
    path = write_layer(tmp_path / "areas.fgb", [SQUARE], kind="Polygon", **{f"c{i}": [1] for i in range(2_001)})
    assert "columns: has 2,001 columns; at most 2,000 are read" in hostile_refusal(path)


def test_missing_values_count_as_what_they_take(tmp_path: Path) -> None:
    columns = {f"c{i}": [None] * 1_000 for i in range(200)}
    path = write_layer(tmp_path / "areas.fgb", [SQUARE] * 1_000, kind="Polygon", **columns)
    with pytest.raises(InvalidInput, match=r"holds more than 1 MB"):
        formats.read(path, max_file_mb=1.0)
    assert len(formats.read(path, max_file_mb=3.0).areas) == 1_000


def test_geometries_in_geometries_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the process that reads says, it does not reach GEOS."""
    deep = b"\1\7\0\0\0\1\0\0\0" * 100_000
    layer = ogr.Layer("a", "EPSG:4326", [], [1], np.array([deep], dtype=object), [])
    monkeypatch.setattr(ogr, "read_layers", lambda path, most: [layer])
    assert "row 0 nests geometries more than 32 deep" in hostile_refusal(geopackage(tmp_path / "areas.gpkg"))
