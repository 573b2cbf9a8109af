"""GeoParquet: a scene reads back to the bit, files of other tools are read, and the rest is one clear error."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import plan_files
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pyproj
import pytest
import shapely
from draws import draws
from full_plans import lost
from mixed_scenes import mixed_scene, odd_scene
from scene_features import Feature

from conflictdb import FileHints, InvalidInput, solve
from conflictdb.arrays.arrow.object_rows import of_objects
from conflictdb.formats import parquet, read, write
from conflictdb.formats.geoparquet import CRS84
from conflictdb.formats.parquet_process import Rows
from conflictdb.formats.parquet_writing import write_objects
from conflictdb.formats.reading import read_parts
from conflictdb.model.plans import Area, Scene, Track

SQUARE = shapely.box(9.0, 54.0, 9.5, 54.25)
LINE = shapely.LineString([(9.0, 54.0), (9.5, 54.5)])
US = pa.timestamp("us", "UTC")
EIGHT, TEN = 1_780_300_800_000_000, 1_780_308_000_000_000  # 2026-06-01, UTC

# These tests read as users do: in a process of its own.
APART = (
    "test_parts_in_a_directory_are_one_file",
    "test_parts_that_do_not_belong_together_are_refused",
    "test_what_was_cut_off_or_is_something_else_is_refused",
    "test_what_unpacks_to_too_much_is_refused",
    "test_columns_may_be_of_types_that_stand_for_the_same",
    "test_a_null_is_told_with_its_row",
)
# A ring with a vertex that is nowhere: closed all the same.
WITH_NAN = SQUARE.wkb[:29] + np.array([np.nan, 54.1]).tobytes() + SQUARE.wkb[45:]


@pytest.fixture(autouse=True)
def _in_this_process(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Decode files in this process, but where it matters that another one does: that takes a second each."""

    @contextmanager
    def decoded(path: Path, most_mb: float) -> Iterator[Rows]:
        with pq.ParquetFile(path) as file:
            yield Rows(file.schema_arrow, file.iter_batches(3))

    if request.node.originalname not in APART:
        monkeypatch.setattr(parquet, "decoded", decoded)


def geo(**column: Any) -> dict[str, Any]:
    """Metadata of GeoParquet in longitude and latitude, except given members."""
    return {"primary_column": "geometry", "columns": {"geometry": {"encoding": "WKB", **column}}}


def written(path: Path, columns: dict[str, Any], metadata: dict[str, Any] | None = None) -> Path:
    """Write columns, geometries as WKB, with this metadata of GeoParquet."""
    table = pa.table({name: wkb(column) if name == "geometry" else column for name, column in columns.items()})
    metadata = geo() if metadata is None else metadata
    pq.write_table(table.replace_schema_metadata({"geo": json.dumps(metadata)} if metadata else {}), path)
    return path


def saved(path: Path, areas: list[Area], tracks: list[Track], scene: Scene = Scene("s")) -> Path:  # noqa: B008
    """Write a scene, areas and tracks apart."""
    with path.open("wb") as stream:
        write_objects(stream, scene, [of_objects(areas, []), of_objects([], tracks)])
    return path


def wkb(shapes: Any) -> pa.Array:
    if isinstance(shapes, pa.Array):
        return shapes
    return pa.array([None if one is None else shapely.to_wkb(one, flavor="iso") for one in shapes], pa.binary())


def refusal(path: Path, **options: Any) -> str:
    return str(plan_files.refusal(path, **options)).removeprefix(f"{path}: ")


@draws("scenes", 10, 1000)
def test_a_scene_comes_back_as_it_was(tmp_path: Path, scenes: int) -> None:
    for seed in range(scenes):
        scene, areas, tracks = odd_scene(seed)
        contents = read(saved(tmp_path / "scene.parquet", areas, tracks, scene), max_speed_kn=np.inf)
        assert contents.scene == scene, seed
        for one, other in zip([*areas, *tracks], [*contents.areas, *contents.tracks], strict=True):
            assert lost(one, other) == [], seed


def test_what_is_written_is_geoparquet(tmp_path: Path) -> None:
    """By the schema of 1.1: WKB, with a box for each row that its metadata name, and one box of all rows."""
    mixed = mixed_scene(6, {Feature.GROWTH})
    path = saved(tmp_path / "scene.parquet", mixed.areas, mixed.tracks, mixed.scene)
    metadata = json.loads(pq.read_schema(path).metadata[b"geo"])
    column = metadata["columns"][metadata["primary_column"]]
    assert (metadata["version"], column["encoding"], column["crs"]) == ("1.1.0", "WKB", CRS84)
    assert column["geometry_types"] == ["LineString", "MultiPolygon"]
    frame = geopandas.read_parquet(path)
    assert frame.crs.to_authority() == ("OGC", "CRS84")
    assert np.allclose(column["bbox"], frame.total_bounds, rtol=0.0, atol=0.0)
    lon, lat = mixed.tracks[0].positions_deg[-1]
    inside = geopandas.read_parquet(path, bbox=(lon, lat, lon, lat))
    assert mixed.tracks[0].key in set(inside["id"])
    assert len(inside) < len(frame)


@pytest.mark.parametrize("name", ["conflicts.parquet", "conflicts.PARQUET"])
def test_conflicts_are_read_by_geopandas(tmp_path: Path, name: str) -> None:
    mixed = mixed_scene(6, {Feature.GROWTH})
    found = solve(mixed.tracks, mixed.areas, mixed.scene)
    write(found, tmp_path / name)
    frame = geopandas.read_parquet(tmp_path / name)
    assert list(frame["a_key"]) == [one.a_key for one in found]
    assert list(frame["verdict"]) == [one.verdict for one in found]
    assert [period[0]["start"] for period in frame["periods"]] == [one.periods[0][0] for one in found]
    assert frame.geometry.name == "region"
    assert frame["first_contact_point"].iloc[0].coords[0] == found[0].first_contact_deg
    write([], tmp_path / "none.parquet")
    assert len(geopandas.read_parquet(tmp_path / "none.parquet")) == 0


def test_closest_approaches_are_no_conflicts(tmp_path: Path) -> None:
    mixed = mixed_scene(6, {Feature.GROWTH})
    (one, *_) = [found.approach for found in solve(mixed.tracks, mixed.areas, mixed.scene) if found.approach]
    with pytest.raises(InvalidInput, match="only conflicts are written as GeoParquet"):
        write([one], tmp_path / "approaches.parquet")
    with pytest.raises(InvalidInput, match="must end in"):
        write([], tmp_path / "conflicts.parquet.gz")
    assert list(tmp_path.iterdir()) == []


def test_areas_of_geopandas_are_read(tmp_path: Path) -> None:
    """With instants as pandas stores them, a further property, an ignored index, in any reference system."""
    frame = geopandas.GeoDataFrame(
        {
            "id": ["A", "B"],
            "start": np.array([EIGHT, EIGHT], "datetime64[us]"),
            "END": np.array([TEN * 1000 + 400, 0], "datetime64[ns]"),
            "ceiling_m": [100.0, np.nan],
            "note": ["x", None],
        },
        geometry=[SQUARE, SQUARE],
        crs=4326,
    )
    frame["start"] = frame["start"].dt.tz_localize("Europe/Berlin").dt.tz_convert("UTC")
    frame["END"] = frame["END"].where(frame["id"] == "A").dt.tz_localize("UTC")
    frame.index = [5, 7]
    frame.to_parquet(tmp_path / "areas.parquet")
    frame.to_crs(32632).to_parquet(tmp_path / "utm.geoparquet", geometry_encoding="geoarrow")
    plain, utm = (read(tmp_path / name) for name in ("areas.parquet", "utm.geoparquet"))
    for contents in (plain, utm):
        a, b = contents.areas
        assert (a.start_us, a.end_us, a.ceiling_m) == (EIGHT - 7_200_000_000, TEN, 100.0)
        assert (b.start_us, b.end_us, b.ceiling_m) == (EIGHT - 7_200_000_000, None, None)
        assert dict(a.properties) == {"note": "x"}
        assert shapely.equals_exact(a.footprint, shapely.MultiPolygon([SQUARE]), 1e-9)
    assert shapely.equals_exact(plain.areas[0].footprint, shapely.MultiPolygon([SQUARE]), 0.0)


def with_m(*seconds: float) -> Any:
    places = shapely.get_coordinates(LINE)
    text = ", ".join(f"{x!r} {y!r} {m!r}" for (x, y), m in zip(places.tolist(), seconds, strict=True))
    return shapely.from_wkt(f"LINESTRING M ({text})")


@pytest.mark.parametrize(
    "columns",
    [
        {"geometry": [with_m(EIGHT / 1e6, TEN / 1e6)]},
        {"geometry": [LINE], "times": pa.array([[EIGHT, TEN]], pa.list_(US))},
        {"geometry": [LINE], "times": pa.array([[EIGHT * 1000, TEN * 1000]], pa.large_list(pa.timestamp("ns", "UTC")))},
        {"geometry": [LINE], "times": ['["2026-06-01T08:00:00Z", "2026-06-01T12:00:00+02:00"]']},
        {"geometry": [shapely.force_3d(LINE, 7.0)], "Times": pa.array([[EIGHT, TEN]], pa.list_(US))},
        {"geometry": [with_m(1.0, 2.0)], "times": pa.array([[EIGHT, TEN]], pa.list_(US))},
    ],
    ids=["M", "instants", "nanoseconds", "texts", "Z", "times before M"],
)
def test_lines_are_tracks(tmp_path: Path, columns: dict[str, Any]) -> None:
    sides = {f"{side}_m": [10.0] for side in ("fore", "aft", "port", "starboard")}
    contents = read(written(tmp_path / "track.parquet", {"id": [7], **columns, **sides}))
    times = np.array([EIGHT, TEN], "datetime64[us]")
    assert lost(contents.tracks[0], Track("7", LINE, times, [(10, 10), (10, -10), (-10, -10), (-10, 10)])) == []


def test_outlines_and_heights_of_legs_are_lists(tmp_path: Path) -> None:
    """Under the names of scene files, as lists of lists."""
    columns = {
        "id": ["T"],
        "geometry": [LINE],
        "times": pa.array([[EIGHT, TEN]], pa.list_(US)),
        "outline_m": [[[0.0, 5.0], [3.0, -5.0], [-3.0, -5.0]]],
        "floor_m": [[None]],
        "ceiling_m": [[50.0]],
    }
    (track,) = read(written(tmp_path / "track.parquet", columns)).tracks
    assert track.outline_m.tolist() == [[0.0, 5.0], [3.0, -5.0], [-3.0, -5.0]]
    assert (track.floor_m, track.ceiling_m) == (None, 50.0)


def fixes(geometry: bool) -> dict[str, Any]:
    """Two waypoints each of two tracks, mixed, with a size and the given changes."""
    places = [(9.0, 54.0), (10.0, 55.0), (9.5, 54.5), (10.5, 55.5)]
    columns: dict[str, Any] = {
        "id": [1, 2, 1, 2],
        "time": pa.array([EIGHT, EIGHT, TEN, TEN], US),
        "length_m": [100.0, 50.0, 100.0, 50.0],
        "width_m": [20.0, 10.0, 20.0, 10.0],
        "sog": [1.0, 2.0, 3.0, 4.0],
        "flag": ["DE", "DK", "DE", "DK"],
    }
    if geometry:
        return {**columns, "geometry": [shapely.Point(place) for place in places]}
    return {**columns, "lon": [x for x, _ in places], "lat": [y for _, y in places]}


@pytest.mark.parametrize("geometry", [True, False], ids=["points", "lon and lat"])
def test_rows_per_waypoint_are_positions(tmp_path: Path, geometry: bool) -> None:
    path = written(tmp_path / "fixes.parquet", fixes(geometry), None if geometry else {})
    first, second = read(path).tracks
    assert (first.key, second.key) == ("1", "2")
    assert first.positions_deg.tolist() == [[9.0, 54.0], [9.5, 54.5]]
    assert first.times_us.tolist() == [EIGHT, TEN]
    assert np.ptp(first.outline_m, axis=0).tolist() == [20.0, 100.0]
    assert dict(first.properties) == {"flag": "DE"}


def test_points_are_circles_with_a_radius_and_left_out_without(tmp_path: Path) -> None:
    columns = {"id": ["C"], "geometry": [shapely.Point(9.0, 54.0)], "radius_m": [1000.0]}
    (circle,) = read(written(tmp_path / "circles.parquet", columns)).areas
    assert circle.footprint.contains(shapely.Point(9.015, 54.0))
    columns = {"id": ["P", "L", "A"], "geometry": [shapely.Point(9.0, 54.0), LINE, SQUARE]}
    contents = read(written(tmp_path / "others.parquet", columns))
    assert [area.key for area in contents.areas] == ["A"]
    assert [one.reason for one in contents.skipped] == [
        "1 rows are Points, no areas or tracks (0)",
        "1 rows are LineStrings, without times: no tracks (1)",
    ]


def test_a_file_that_says_no_reference_system_is_remarked(tmp_path: Path) -> None:
    """As Sedona and DuckDB may write it; coordinates in metres are refused all the same."""
    for metadata in (geo(crs=None), {}):
        path = written(tmp_path / "areas.parquet", {"id": ["A"], "geometry": [SQUARE]}, metadata)
        assert [one.text for one in read(path).remarks] == [
            "does not say its reference system: taken for longitude and latitude on WGS84"
        ]
        metres = shapely.box(500_000.0, 6_000_000.0, 501_000.0, 6_001_000.0)
        assert "latitude must lie within" in refusal(written(path, {"id": ["A"], "geometry": [metres]}, metadata))


def test_parts_in_a_directory_are_one_file(tmp_path: Path) -> None:
    """As Spark writes it, with other files that are no parts."""
    directory = tmp_path / "areas.parquet"
    directory.mkdir()
    for k in range(3):
        written(directory / f"part-{k}.snappy.parquet", {"id": [f"A{k}"], "geometry": [SQUARE]})
    (directory / "_SUCCESS").touch()
    (directory / ".part-0.crc.parquet").touch()
    assert [area.key for area in read(directory).areas] == ["A0", "A1", "A2"]
    written(directory / "part-3.parquet", {"id": ["A3"], "geometry": [SQUARE], "more": [1]})
    assert "part-3.parquet: has different columns than the parts before: more" in refusal(directory)
    written(directory / "part-3.parquet", {"geometry": [SQUARE], "id": ["A3"]})
    assert "has different columns than the parts before: in another order" in refusal(directory)
    (directory / "part-3.parquet").write_bytes(b"PAR1")
    assert "cannot be read as Parquet: part-3.parquet: " in refusal(directory)
    (tmp_path / "empty.parquet").mkdir()
    assert "directory without parts" in refusal(tmp_path / "empty.parquet")


def test_columns_may_be_of_types_that_stand_for_the_same(tmp_path: Path) -> None:
    """Texts of other kinds, coded ones, and instants in other units and zones, in a file of objects as they are."""
    area, track = Area("A", SQUARE, name="a"), Track("T", [(0, 0), (0.01, 0)], [0, 3_600_000_000], [(0, 0)])
    path = saved(tmp_path / "scene.parquet", [area], [track])
    whole = pq.read_table(path)
    coded, oslo = pa.dictionary(pa.int8(), pa.string()), pa.timestamp("ns", "Europe/Oslo")
    for types in (
        {"id": pa.large_string(), "geometry": pa.large_binary(), "times": pa.large_list(pa.timestamp("ms", "UTC"))},
        {"id": pa.string_view(), "geometry": pa.binary_view(), "times": pa.list_(oslo), "start": oslo},
        {"id": coded, "kind": coded, "name": coded},
    ):
        table = whole
        for name, of in types.items():
            table = table.set_column(table.schema.get_field_index(name), name, table[name].cast(of))
        pq.write_table(table.replace_schema_metadata(whole.schema.metadata), path)
        contents = read(path)
        assert [one.key for one in (*contents.areas, *contents.tracks)] == ["A", "T"]
        assert contents.tracks[0].times_us.tolist() == [0, 3_600_000_000]
        assert shapely.equals_exact(contents.areas[0].footprint, area.footprint)


def test_a_null_is_told_with_its_row(tmp_path: Path) -> None:
    """Counted through all parts; of a list of instants with its track: none of them is taken for 1970."""
    directory = tmp_path / "scene.parquet"
    directory.mkdir()
    whole = pa.Table.from_batches(
        [of_objects([], [Track(f"T{k}", [(0, 0), (0.01, 0)], [5, 3_600_000_000], [(0, 0)]) for k in range(4)])]
    )
    nullable = pa.schema([field.with_nullable(True) for field in whole.schema], whole.schema.metadata)
    for name, value, message in (
        ("id", None, "id: must not be null; it is in row 3"),
        ("times", [None, 9], "track 'T3': times: must not hold nulls"),
    ):
        rows = whole.to_pylist()
        rows[3][name] = value
        for k in range(2):
            pq.write_table(pa.Table.from_pylist(rows[2 * k : 2 * k + 2], nullable), directory / f"part-{k}.parquet")
        assert message in refusal(directory)


def test_parts_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    """In another reference system, of a scene with other settings, and in directories of their own: none is misread."""
    directory = tmp_path / "areas.parquet"
    directory.mkdir()
    written(directory / "part-0.parquet", {"id": ["A"], "geometry": [SQUARE]})
    alike = geo(geometry_types=["Polygon"], bbox=[9.0, 54.0, 9.5, 54.25])
    written(directory / "part-1.geoparquet", {"id": ["B"], "geometry": [SQUARE]}, alike)
    assert [area.key for area in read(directory).areas] == ["A", "B"]
    other = geo(crs={"id": {"authority": "EPSG", "code": 25832}})
    written(directory / "part-1.geoparquet", {"id": ["B"], "geometry": [SQUARE]}, other)
    assert "part-1.geoparquet: says other things of itself" in refusal(directory)
    for k, scene in enumerate((Scene("s"), Scene("s", separation_m=500.0))):
        saved(directory / f"part-{k}.parquet", [Area(f"A{k}", SQUARE)], [], scene)
    (directory / "part-1.geoparquet").unlink()
    assert "other settings of the scene" in refusal(directory)
    (directory / "kind=area").mkdir()
    assert "partitioned into directories" in refusal(directory)


@pytest.mark.parametrize("form", [True, False])
def test_own_columns_are_in_the_reference_system_of_the_metadata(tmp_path: Path, form: bool) -> None:
    """Metres of EPSG 3857 are transformed, of areas and tracks, whether or not the file says its form."""
    track = Track("T", np.array([(9.0, 54.0), (9.5, 54.5)]), np.array([EIGHT, TEN]), np.array([[0.0, 0.0]]))
    path = saved(tmp_path / "own.parquet", [Area("A", SQUARE)], [track])
    table = pq.read_table(path)
    metres = pyproj.Transformer.from_crs(4326, 3857, always_xy=True)
    shapes = shapely.transform(
        shapely.from_wkb(table["geometry"].to_pylist()), lambda xy: np.column_stack(metres.transform(*xy.T))
    )
    metadata = geo(crs={"id": {"authority": "EPSG", "code": 3857}}, edges="spherical")
    table = table.set_column(table.schema.get_field_index("geometry"), "geometry", wkb(shapes))
    kept = table.schema.metadata if form else {}
    pq.write_table(table.replace_schema_metadata({**kept, b"geo": json.dumps(metadata)}), path)
    contents = read(path)
    assert np.allclose(contents.areas[0].footprint.bounds, SQUARE.bounds, rtol=0, atol=1e-9)
    assert np.allclose(contents.tracks[0].positions_deg, track.positions_deg, rtol=0, atol=1e-9)
    assert [one.text.split(";")[0] for one in contents.remarks] == ["says that edges are great circles"]


@pytest.mark.parametrize(
    ("said", "remark"),
    [
        ({"crs": None}, "does not say its reference system"),
        ({"edges": "spherical"}, "edges are great circles"),
        ({"edges": "vincenty"}, "edges are 'vincenty'"),
        ({"epoch": 2021.47}, "coordinates are of epoch 2021.47"),
    ],
)
def test_metadata_of_own_columns_are_remarked_on_as_of_others(
    tmp_path: Path, said: dict[str, Any], remark: str
) -> None:
    for name, more in (("own.parquet", {"kind": ["area"]}), ("others.parquet", {"remark": ["x"]})):
        contents = read(written(tmp_path / name, {"id": ["A"], "geometry": [SQUARE], **more}, geo(**said)))
        assert contents.areas[0].footprint.bounds == SQUARE.bounds
        assert [remark in one.text for one in contents.remarks] == [True]


@pytest.mark.parametrize(
    ("said", "rule"),
    [
        ({"encoding": "TWKB"}, "encoding must be one of WKB"),
        ({"encoding": "polygon"}, "holds what is no geometry in polygon"),
        ({"crs": {"id": {"authority": "EPSG", "code": 999999}}}, "is not known to PROJ: EPSG:999999"),
        ({"edges": 7}, "edges must be a text; got 7"),
        ({"epoch": "now"}, "epoch must be a year, a number; got 'now'"),
    ],
)
def test_metadata_of_own_columns_are_refused_as_of_others(tmp_path: Path, said: dict[str, Any], rule: str) -> None:
    columns = {"id": ["A"], "kind": ["area"], "geometry": [SQUARE]}
    assert rule in refusal(written(tmp_path / "a.parquet", columns, geo(**said)))


def test_columns_that_look_like_times_are_named(tmp_path: Path) -> None:
    """Whether the file is read whole or part by part."""
    path = written(tmp_path / "a.parquet", {"id": ["A"], "geometry": [SQUARE], "valid_from": pa.array([EIGHT], US)})
    (remark,) = read(path).remarks
    assert "1 area without start or end: valid_from look like times and are not read" in remark.text
    with read_parts(path) as parts:
        assert len(list(parts.each)) == 1
        assert parts.remarks == [remark]


def test_names_of_columns_are_mapped(tmp_path: Path) -> None:
    """For areas and positions, as in other files; and lines without times name columns that look like them."""
    columns = {"id": ["A"], "geometry": [SQUARE], "valid_from": pa.array([EIGHT], US)}
    path = written(tmp_path / "a.parquet", columns)
    (area,) = read(path, hints=FileHints({"start": "valid_from"})).areas
    assert area.start_us == EIGHT
    with pytest.raises(InvalidInput, match="column valid_form: is mapped to start"):
        read(path, hints=FileHints({"start": "valid_form"}))
    rows = {"ship": ["T", "T"], "when": pa.array([EIGHT, TEN], US), "x": [9.0, 9.1], "y": [57.0, 57.0]}
    positions = written(tmp_path / "t.parquet", rows, {})
    with pytest.raises(InvalidInput):
        read(positions)
    (track,) = read(positions, hints=FileHints({"id": "ship", "time": "when", "lon": "x", "lat": "y"})).tracks
    assert (track.key, len(track.times_us)) == ("T", 2)
    line = shapely.LineString([(9, 57), (10, 58)])
    (skipped,) = read(written(tmp_path / "l.parquet", {"geometry": [line], "laid": pa.array([EIGHT], US)})).skipped
    assert "(laid look like times, but not of each point): no tracks" in skipped.reason


@pytest.mark.parametrize("crs", ["EPSG:4326", pyproj.CRS(4326).to_wkt(), 4326])
def test_a_reference_system_may_be_its_name_or_wkt(tmp_path: Path, crs: str | int) -> None:
    """As older writers give it."""
    path = written(tmp_path / "areas.parquet", {"id": ["A"], "geometry": [SQUARE]}, geo(crs=crs))
    assert read(path).areas[0].footprint.bounds == SQUARE.bounds


def test_a_misspelt_column_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.parquet", {"id": ["A"], "geometry": [SQUARE], "floor_ft": [100.0]})
    assert "floor_ft: is not known; did you mean floor_m? Rename the column" in refusal(path)
    path = written(tmp_path / "b.parquet", {"id": ["A"], "geometry": [SQUARE], "begins": pa.array([EIGHT], US)})
    assert "begins: is not known; did you mean start?" in refusal(path)
    path = written(tmp_path / "c.parquet", {"id": ["A"], "geometry": [SQUARE], "separation_m": [100.0]})
    assert "separation_m: is a setting of the whole scene" in refusal(path)


def of_form(name: str, column: pa.Array) -> Callable[[Path], Path]:
    """Return a function that writes a scene of one area, with another array as one of the columns."""

    def write_it(path: Path) -> Path:
        table = pq.read_table(saved(path, [Area("A", SQUARE)], []))
        pq.write_table(table.set_column(table.schema.get_field_index(name), name, column), path)
        return path

    return write_it


def plain(metadata: dict[str, Any] | None = None, **columns: Any) -> Callable[[Path], Path]:
    return lambda path: written(path, {"id": ["A"], "geometry": [SQUARE], **columns}, metadata)


@pytest.mark.parametrize(
    ("make", "rule"),
    [
        (plain(geometry=[None]), "row 0: geometry: must be a non-empty Polygon or MultiPolygon"),
        (plain(geometry=pa.array([b"\x01\x06"])), "column geometry: holds what is no geometry in WKB"),
        (plain(geometry=pa.array(["POLYGON"])), "column geometry: holds what is no geometry in WKB"),
        (plain(geometry=pa.array([WITH_NAN])), "coordinates must be finite numbers"),
        (plain(geometry=[with_m(np.nan, 1.0)]), "has an M that is no number of seconds"),
        (plain(geometry=[with_m(1e300, 2e300)]), "has an M that is no number of seconds"),
        (plain(start=pa.array([EIGHT], pa.timestamp("us"))), "start: needs an offset from UTC"),
        (plain(start=pa.array([2**62], US)), "column start: holds instants outside of the years 1 to 9999"),
        (plain(start=pa.array([5])), "start: must be a date and time as a string; got 5"),
        (plain(floor_m=["high"]), "floor_m: must be a number; got 'high'"),
        (plain(note=["x"], kind=["track"]), "row 0: kind: is 'track', but the geometry is that of"),
        (plain(id=["A", "A"], geometry=[SQUARE, SQUARE]), "is given twice, by rows 0 and 1"),
        (lambda path: written(path, {"id": ["A"], "geom": [1]}, {}), "geometry: there is none"),
        (plain(**{**fixes(True), "time": ["now"] * 4}), "time: must be a date and time"),
        (plain(**{**fixes(True), "time": pa.array([EIGHT] * 4, pa.timestamp("us"))}), "time: needs an offset from UTC"),
        (plain(geo(encoding="WKT")), "encoding must be one of WKB, point"),
        (plain(geo(encoding="polygon")), "column geometry: holds what is no geometry in polygon"),
        (plain(geo(crs={"id": {"authority": "EPSG", "code": 999999}})), "is not known to PROJ: EPSG:999999"),
        (plain(geo(crs={"name": "mine"})), "is not known to PROJ"),
        (lambda path: written(path, {"id": ["A"]}, geo()), "not there"),
        (plain({"columns": []}), "must be the JSON that GeoParquet says it is"),
        (of_form("geometry", pa.array([shapely.Point(1, 2).wkb])), "area 'A': geometry: must be a non-empty Polygon"),
        (of_form("start", pa.array([EIGHT], pa.timestamp("us"))), "instants need a time zone"),
        (of_form("properties", pa.array(["[1]"])), "properties: must be a JSON object"),
        (of_form("properties", pa.array(['{"a": "\\u0000"}'])), "must not contain the character U+0000"),
        (of_form("id", pa.array(["A" * 2000])), "must be at most 1000 bytes long"),
        (of_form("version", pa.array([1.5])), "version: must be int64; got double"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, make: Callable[[Path], Path], rule: str) -> None:
    assert rule in refusal(make(tmp_path / "areas.parquet"))


def test_all_mistakes_of_a_scene_are_told_or_left_out(tmp_path: Path) -> None:
    areas = [Area(key, SQUARE) for key in "ABCD"]
    path = saved(tmp_path / "scene.parquet", areas, [])
    table = pq.read_table(path)
    ceiling = pc.if_else(pc.is_in(table["id"], pa.array(["B", "D"])), 0.0, None)
    table = table.set_column(table.schema.get_field_index("ceiling_m"), "ceiling_m", ceiling.cast(pa.float64()))
    floor = pa.array([0.0] * 4)
    pq.write_table(table.set_column(table.schema.get_field_index("floor_m"), "floor_m", floor), path)
    message = refusal(path)
    assert "area 'B': ceiling_m: must be above floor_m" in message
    assert "area 'D': ceiling_m" in message
    contents = read(path, skip_invalid=True)
    assert [area.key for area in contents.areas] == ["A", "C"]
    assert [one.key for one in contents.skipped] == ["area 'B'", "area 'D'"]


def test_what_was_cut_off_or_is_something_else_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path / "scene.parquet", [Area("A", SQUARE)], [])
    whole = path.read_bytes()
    for damaged in (whole[:-9], whole[:100], whole[:50] + b"\xff" * 50 + whole[100:], b"{}", b""):
        path.write_bytes(damaged)
        assert "file: cannot be read as Parquet" in refusal(path) or "Arrow" in refusal(path)
    path.write_bytes(whole)
    packed = tmp_path / "scene.parquet.gz"
    packed.write_bytes(whole)
    assert "is compressed twice" in refusal(packed)
    assert "has no layers" in refusal(path, layers=["x"])
    assert "does not exist" in refusal(tmp_path / "none.parquet")


CODED = pa.DictionaryArray.from_arrays(pa.array(np.zeros(300, np.int32)), pa.array(["x" * 100_000]))


@pytest.mark.parametrize(
    "note",
    [
        CODED,
        pa.ListArray.from_arrays(np.arange(301), CODED),
        pa.LargeListArray.from_arrays(np.arange(301), CODED),
        pa.StructArray.from_arrays([CODED], ["own"]),
        pa.ListArray.from_arrays(np.arange(301), pa.StructArray.from_arrays([CODED], ["own"])),
        pa.MapArray.from_arrays(np.arange(301), pa.array(["own"] * 300), CODED),
    ],
    ids=lambda note: str(note.type)[:30],
)
def test_what_unpacks_to_too_much_is_refused(tmp_path: Path, note: pa.Array) -> None:
    """Many equal rows are a file of some kilobytes, also where they are within others."""
    path = tmp_path / "bomb.parquet"
    pq.write_table(pa.table({"geometry": pa.repeat(SQUARE.wkb, 300), "note": note}), path, compression="zstd")
    assert path.stat().st_size < 20_000
    assert "holds more than 20 MB" in refusal(path, max_file_mb=20.0)


def test_rows_per_waypoint_are_held_and_bounded_also_by_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are one part, limited by memory; a given limit comes first."""
    n = 4
    columns = {"mmsi": ["1"] * n, "time": pa.array([EIGHT + i * 10**9 for i in range(n)], US), "lon": [9.0] * n}
    path = written(tmp_path / "ais.parquet", {**columns, "lat": [54.0 + 0.01 * i for i in range(n)]}, {})
    with read_parts(path) as parts:
        ((areas, tracks),) = parts.each
    assert (areas, [one.key for one in tracks]) == ([], ["1"])
    monkeypatch.setattr(parquet, "MAX_PARQUET_MB", 1e-5)
    with pytest.raises(InvalidInput, match="holds more than 1e-05 MB of rows per waypoint"), read_parts(path):
        pass
    with read_parts(path, max_file_mb=1.0) as parts:
        assert len(list(parts.each)) == 1
