"""Every way in, against defects of the input: refused, or remarked; never taken silently.

The table of docs/reference/files.md, "All ways in", has a row for each way and a column for each defect.
"""

import json
import math
import re
import warnings
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import psycopg
import pytest
from commands import STRAIT, Run, runner

import conflictdb
from conflictdb import Area, InvalidInput, Track
from conflictdb.formats import ogr, scene_text, write_lines

geopandas = pytest.importorskip("geopandas")
shapely = pytest.importorskip("shapely")

DEGREES = [(9.0, 57.0), (10.0, 57.0), (10.0, 58.0), (9.0, 58.0), (9.0, 57.0)]
METRES = [(1e6, 7.7e6), (1.1e6, 7.7e6), (1.1e6, 7.8e6), (1e6, 7.8e6), (1e6, 7.7e6)]
GPX = '<?xml version="1.0"?><gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">{}</gpx>'
POINTS = '<{0} lat="57" lon="9"/><{0} lat="57.1" lon="9"/>'

NO_OBJECTS = "holds no area and no track: nothing is changed"
NOT_READ = "valid_from look like times and are not read"
# The refusal for each defect of each file.
FILES = {
    "empty.geojson": "the file ends too early",
    "empty.csv": "column id: is missing",
    "empty.gpx": "no element found",
    "empty.gpkg": "cannot be read by OGR",
    "empty.parquet": "cannot be read as Parquet",
    "system.geojson": r"latitude must lie within \+-90 degrees",
    "system.csv": r"longitude must lie within \+-360 degrees",
    "system.gpkg": "reference system: is unknown",
    "system.parquet": r"latitude must lie within \+-90 degrees",
    "none.geojson": NO_OBJECTS,
    "none.csv": NO_OBJECTS,
    "none.gpx": NO_OBJECTS,
    "route.gpx": NO_OBJECTS,
    "none.gpkg": NO_OBJECTS,
    "none.parquet": NO_OBJECTS,
    "times.geojson": "start_time: is not known; did you mean start",
    "times.csv": "column time: is missing",
    "times.gpx": NO_OBJECTS,
    "speed.csv": NO_OBJECTS,
    "speed.geojson": "is travelled at .* kn, beyond 2000 kn",
}
REMARKED = {"valid.geojson": NOT_READ, "valid.gpkg": NOT_READ, "valid.parquet": NOT_READ}


def feature(geometry: dict[str, Any], **properties: Any) -> str:
    one = {"type": "Feature", "id": "A", "geometry": geometry, "properties": properties}
    return json.dumps({"type": "FeatureCollection", "features": [one]})


def polygon(ring: list[tuple[float, float]], **properties: Any) -> str:
    return feature({"type": "Polygon", "coordinates": [ring]}, **properties)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory with all the files."""
    folder = tmp_path_factory.mktemp("ways")
    way = {"type": "LineString", "coordinates": [(9.0, 57.0), (20.0, 57.0)]}
    times = ["2026-03-01T00:00:00Z", "2026-03-01T00:01:00Z"]
    rows = "V,2026-03-01T00:00:00Z,{0}\nV,2026-03-01T00:01:00Z,{1}\n"
    texts = {
        **dict.fromkeys((name for name in FILES if name.startswith("empty")), ""),
        "system.geojson": polygon(METRES),
        "system.csv": "id,time,lat,lon\n" + rows.format("7700000,1000000", "7710000,1000000"),
        "none.geojson": '{"type": "FeatureCollection", "features": []}',
        "none.csv": "id,time,lat,lon\n",
        "none.gpx": GPX.format(""),
        "route.gpx": GPX.format(f"<rte><name>R</name>{POINTS.format('rtept')}</rte>"),
        "times.geojson": polygon(DEGREES, start_time=times[0]),
        "times.csv": "id,seen,lat,lon\n" + rows.format("57,9", "57.1,9"),
        "times.gpx": GPX.format(f"<trk><name>R</name><trkseg>{POINTS.format('trkpt')}</trkseg></trk>"),
        "speed.csv": "id,time,lat,lon\n" + rows.format("57,9", "57,20"),
        "speed.geojson": feature(way, times=times, **dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"), 5)),
        "valid.geojson": polygon(DEGREES, valid_from=times[0]),
    }
    for name, text in texts.items():
        (folder / name).write_text(text)

    def frame(crs: int | None, ring: list[tuple[float, float]] = DEGREES, **columns: Any) -> Any:
        return geopandas.GeoDataFrame({"id": ["A"], **columns}, geometry=[shapely.Polygon(ring)], crs=crs)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of files without a reference system, which is the point of some
        for name, one in {
            "system": frame(None, METRES),
            "none": frame(4326).iloc[:0],
            "valid": frame(4326, valid_from=times[:1]),
        }.items():
            one.to_parquet(folder / f"{name}.parquet")
            one.to_file(folder / f"{name}.gpkg")
    return folder


@pytest.fixture(scope="module")
def layers() -> dict[Path, list[ogr.Layer] | InvalidInput]:
    """Return the objects that the OGR library made of each file."""
    return {}


@pytest.fixture(autouse=True)
def _read_once(monkeypatch: pytest.MonkeyPatch, layers: dict[Path, list[ogr.Layer] | InvalidInput]) -> None:
    """Let the OGR library read each file once, for all ways: its process takes half a second to start."""

    def read_layers(path: Path, max_file_mb: float, read: Any = ogr.read_layers) -> list[ogr.Layer]:
        if path not in layers:
            try:
                layers[path] = read(path, max_file_mb)
            except InvalidInput as refused:
                layers[path] = refused
        found = layers[path]
        if isinstance(found, InvalidInput):
            raise found
        return found

    monkeypatch.setattr(ogr, "read_layers", read_layers)


@pytest.fixture
def run(dsn: str, capsys: pytest.CaptureFixture[str]) -> Run:
    run = runner(dsn, capsys)
    run("detect", STRAIT)
    return run


@pytest.fixture
def db(dsn: str) -> Iterator[conflictdb.Database]:
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect()
        yield db


@pytest.mark.parametrize("name", FILES)
def test_commands_and_python_refuse_the_file(run: Run, dsn: str, files: Path, name: str) -> None:
    """By load, detect, probe and db.load; the scene stays as it is, and current."""
    for command in ("load", "detect", "probe"):
        done = run(command, files / name, "--scene", "strait")
        assert (done.code, done.out) == (4, ""), command
        assert re.search(FILES[name], done.err), command
    with conflictdb.connect(dsn) as db:
        with pytest.raises(InvalidInput, match=FILES[name]):
            db.load(files / name, "strait")
        state = db.scene("strait").state()
        assert (state.objects, state.is_current) == (11, True)


@pytest.mark.parametrize("name", REMARKED)
def test_commands_and_python_remark_the_file(run: Run, dsn: str, files: Path, name: str) -> None:
    for command in ("load", "detect"):
        done = run(command, files / name, "--scene", f"by {command}")
        assert done.code == 0, command
        assert REMARKED[name] in done.err, command
    with conflictdb.connect(dsn) as db, pytest.warns(UserWarning, match=REMARKED[name]):
        db.load(files / name, "by Python")
    assert any(REMARKED[name] in str(one) for one in conflictdb.read(files / name).remarks)


@pytest.mark.parametrize("name", [name for name in FILES if FILES[name] is not NO_OBJECTS])
def test_reading_refuses_the_file(files: Path, name: str) -> None:
    with pytest.raises(InvalidInput, match=FILES[name]):
        conflictdb.read(files / name)


@pytest.mark.parametrize("name", [name for name in FILES if FILES[name] is NO_OBJECTS])
def test_reading_remarks_a_file_without_objects(files: Path, name: str) -> None:
    found = conflictdb.read(files / name)
    assert [*found.areas, *found.tracks] == []
    assert any("holds no objects" in str(one) for one in found.remarks)


T0, T1 = datetime(2026, 3, 1, tzinfo=UTC), datetime(2026, 3, 1, 0, 1, tzinfo=UTC)
MADE: dict[str, tuple[Callable[[], object], type[Exception], str]] = {
    "no waypoints": (lambda: Track("T", [(9, 57)], [T0], [(0, 0)]), InvalidInput, "needs at least two waypoints"),
    "no footprint": (lambda: Area("A", shapely.Polygon()), InvalidInput, "must be a non-empty Polygon"),
    "area in metres": (lambda: Area("A", METRES), InvalidInput, "latitude must lie within"),
    "track in metres": (lambda: Track("T", METRES[:2], [T0, T1], [(0, 0)]), InvalidInput, "latitude must lie within"),
    "area of an unknown time": (lambda: Area("A", DEGREES, valid_from=T0), TypeError, "valid_from"),  # type: ignore[call-arg]
    "track of unknown times": (lambda: Track("T", [(9, 57), (9, 58)], outline_m=[(0, 0)]), TypeError, "times_us"),  # type: ignore[call-arg]
    "naive time": (lambda: Area("A", DEGREES, start_us=datetime(2026, 3, 1)), InvalidInput, "offset"),
    "too fast": (
        lambda: Track("T", [(9, 57), (20, 57)], [T0, T1], [(0, 0)]),
        InvalidInput,
        r"track 'T': times\[1\]: the leg to this waypoint is travelled at 21,\d{3} kn, beyond 2000 kn",
    ),
}


@pytest.mark.parametrize("defect", MADE)
def test_objects_of_python_are_refused(defect: str) -> None:
    make, kind, said = MADE[defect]
    with pytest.raises(kind, match=said):
        make()


def test_a_track_may_be_fast_if_that_is_said(db: conflictdb.Database, tmp_path: Path) -> None:
    """It goes into the database and comes back, and under another name of the same limit again."""
    fast = Track("FAST", [(9, 57), (20, 57)], [T0, T1], [(0, 0)], max_speed_kn=math.inf)
    write_lines(tmp_path / "fast.geojson", scene_text(conflictdb.Scene("fast"), [], [fast]))
    with pytest.raises(InvalidInput, match="beyond 2000 kn"):
        db.load(tmp_path / "fast.geojson")
    db.load(tmp_path / "fast.geojson", max_speed_kn=math.inf)
    db.scene("fast").export(tmp_path / "again.geojson")
    assert len(conflictdb.read(tmp_path / "again.geojson", max_speed_kn=math.inf).tracks) == 1
    # The limit of the load was its own.
    with pytest.raises(psycopg.Error, match="beyond 2000 kn"):
        db.connection.execute(STATEMENTS["a track that is too fast"][0].encode())


ENVELOPE = "ST_MakeEnvelope(9, 57, 10, 58{})"
WAY = "ST_SetSRID('LINESTRING M (9 57 0, {} 57 60)'::geometry, 4326), conflictdb.rectangle_outline(5, 5, 5, 5)"
STATEMENTS = {
    "an empty footprint": (
        "SELECT conflictdb.put_area('strait', 'A', 'SRID=4326;POLYGON EMPTY')",
        "without empty parts",
    ),
    "no footprint": ("SELECT conflictdb.put_area('strait', 'A', NULL)", "must be"),
    "another system": (f"SELECT conflictdb.put_area('strait', 'A', {ENVELOPE.format(', 3857')})", "4326|SRID"),
    "no system": (f"SELECT conflictdb.put_area('strait', 'A', {ENVELOPE.format('')})", "4326|SRID"),
    "metres": (
        "SELECT conflictdb.put_area('strait', 'A', ST_MakeEnvelope(1e6, 7.7e6, 1.1e6, 7.8e6, 4326))",
        "latitude must lie within",
    ),
    "an unknown time field": (
        f"SELECT conflictdb.put_area('strait', 'A', {ENVELOPE.format(', 4326')}, valid_from => now())",
        "does not exist",
    ),
    "an unknown column": (
        f"INSERT INTO conflictdb.area (key, footprint, valid_from) SELECT 'A', {ENVELOPE.format(', 4326')}, now()",
        "does not exist",
    ),
    "a track without times": (
        "SELECT conflictdb.put_track('strait', 'T', 'SRID=4326;LINESTRING(9 5, 9 6)', 'POLYGON((0 0,1 1,1 0,0 0))')",
        "LineStringM|LINESTRINGM|M dimension",
    ),
    "a track that is too fast": (
        f"SELECT conflictdb.put_track('strait', 'T', {WAY.format(20)})",
        r"the leg to times\[1\] is travelled at 21\d{3} kn, beyond 2000 kn",
    ),
    "a question that is too fast": (
        f"SELECT conflictdb.request_track_probe('strait', {WAY.format(20)})",
        r"the leg to times\[1\] is travelled at 21\d{3} kn, beyond 2000 kn",
    ),
}


@pytest.mark.parametrize("defect", STATEMENTS)
def test_sql_refuses(db: conflictdb.Database, defect: str) -> None:
    statement, said = STATEMENTS[defect]
    with pytest.raises(psycopg.Error, match=said):
        db.connection.execute(statement.encode())


def test_the_limit_of_speed_is_a_setting_of_sql(db: conflictdb.Database) -> None:
    statement = STATEMENTS["a track that is too fast"][0].encode()
    with db.connection.transaction():
        db.connection.execute("SET LOCAL conflictdb.max_speed_kn = 30000")
        db.connection.execute(statement)
        # An update that keeps the path does not check its speed again.
        db.connection.execute("SET LOCAL conflictdb.max_speed_kn = 2000")
        db.connection.execute("UPDATE conflictdb.track SET name = 'fast', floor_m = 1 WHERE key = 'T'")


@pytest.mark.parametrize("wrong", ["fast", "-1", "NaN"])
def test_a_limit_of_speed_that_is_none_is_refused(db: conflictdb.Database, wrong: str) -> None:
    db.connection.execute(f"SET conflictdb.max_speed_kn = '{wrong}'".encode())
    with pytest.raises(psycopg.Error, match="must be a number of knots, or infinity"):
        db.connection.execute(STATEMENTS["a track that is too fast"][0].encode())


START = "start=valid_from"
ATTACHED = "CREATE TABLE plan (id text, shape geometry, valid_from timestamptz)"
ATTACH = ("admin", "attach", "area", "--scene", "plans", "--table", "plan", "--map")


@pytest.mark.parametrize(
    ("row", "mapped", "out", "err"),
    [
        (None, "key=id,footprint=shape,start=valid_from", "plans: 0 areas of public.plan", ""),
        (
            "'A', 'POLYGON EMPTY'",
            "key=id,footprint=ST_SetSRID(shape,4326),start=valid_from",
            "1 left out",
            "empty parts",
        ),
        ("'A', ST_MakeEnvelope(9, 57, 10, 58)", "key=id,footprint=shape,start=valid_from", "1 left out", "has no SRID"),
        (
            "'A', ST_MakeEnvelope(9, 57, 10, 58, 4326)",
            "key=id,footprint=shape",
            "plans: 1 area of public.plan",
            "areas are there at all times: the map gives no start, end or span; valid_from look like times",
        ),
    ],
    ids=["no objects", "empty", "system", "times"],
)
def test_attach_says_what_is_wrong(run: Run, dsn: str, row: str | None, mapped: str, out: str, err: str) -> None:
    with psycopg.connect(dsn) as conn:
        conn.execute(ATTACHED)
        if row is not None:
            conn.execute(f"INSERT INTO plan VALUES ({row}, now())".encode())
    done = run(*ATTACH, mapped)
    assert done.code == 0
    assert out in done.out
    assert err in done.err


def test_attach_in_python_warns_of_times_that_are_not_read(db: conflictdb.Database) -> None:
    db.connection.execute(ATTACHED)
    mapped = {"key": "id", "footprint": "shape"}
    with pytest.warns(UserWarning, match="valid_from look like times and are not read") as warned:
        db.scene("strait").attach("area", "plan", mapped)
    assert warned[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        db.scene("strait").preview_attachment("area", "plan", {**mapped, "start": "valid_from"}, again=True)


def test_one_reason_of_many_left_out_objects_is_one_warning(dsn: str, tmp_path: Path) -> None:
    square = {"type": "Polygon", "coordinates": [[[9, 57], [10, 57], [10, 58], [9, 58], [9, 57]]]}
    ends = ["2026-06-02T00:00:00Z", *["2026-05-01T00:00:00Z"] * 5]
    features = [
        {
            "type": "Feature",
            "id": f"A{i}",
            "geometry": square,
            "properties": {"start": "2026-06-01T00:00:00Z", "end": end},
        }
        for i, end in enumerate(ends)
    ]
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with conflictdb.connect(dsn) as db, pytest.warns(UserWarning, match="left out area 'A1'") as warned:
        db.load(tmp_path / "a.geojson", "s", skip_invalid=True)
    said = [str(one.message) for one in warned if "left out" in str(one.message)]
    assert len(said) == 1
    assert said[0].endswith("(and 4 more: 'A2', 'A3', 'A4', 'A5')")
