"""Data frames: input of `solve` from geopandas, and conflicts as frames."""

import json
import subprocess
import sys
import warnings
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta, tzinfo
from decimal import Decimal
from pathlib import Path
from typing import Any
from uuid import UUID
from zoneinfo import ZoneInfo

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely
from patience import WAIT_S

from conflictdb import ConflictDBError, InvalidInput, Results, Scene, read, solve
from conflictdb.formats import from_frames
from conflictdb.formats.conflict_text import APPROACH_COLUMNS, COLUMNS
from conflictdb.formats.frame_values import TimeZone
from conflictdb.formats.instants import parse_instant
from conflictdb.model.plans import Area, Track
from conflictdb.model.results import Approach, Conflict, interval_text

STRAIT = Path(__file__).resolve().parents[2] / "conflictdb/scenes/strait.geojson"
HAVEN = {"fore_m": 60, "aft_m": 40, "port_m": 10, "starboard_m": 10}


def utc(instant_us: int | None) -> Any:
    return pd.NaT if instant_us is None else pd.Timestamp(instant_us, unit="us", tz="UTC")


def frame_of_areas(areas: list[Area]) -> geopandas.GeoDataFrame:
    return geopandas.GeoDataFrame(
        {
            "name": [area.name for area in areas],
            "start": [utc(area.start_us) for area in areas],
            "end": [utc(area.end_us) for area in areas],
            "floor_m": [area.floor_m for area in areas],
            "ceiling_m": [area.ceiling_m for area in areas],
        },
        index=[area.key for area in areas],
        geometry=[area.footprint for area in areas],
        crs=4326,
    )


def frame_of_tracks(tracks: list[Track]) -> geopandas.GeoDataFrame:
    return geopandas.GeoDataFrame(
        {
            "id": [track.key for track in tracks],
            "name": [track.name for track in tracks],
            "times": [[utc(int(t)) for t in track.times_us] for track in tracks],
            "outline_m": [track.outline_m for track in tracks],
            "grow_mps": [track.grow_mps for track in tracks],
            "floor_m": [track.floor_m for track in tracks],
            "ceiling_m": [track.ceiling_m for track in tracks],
        },
        geometry=[shapely.LineString(track.positions_deg) for track in tracks],
        crs=4326,
    )


def one_track(**columns: Any) -> geopandas.GeoDataFrame:
    """Return a track of an hour, an absent column for each that is None."""
    times = pd.to_datetime(["2026-06-01 08:00", "2026-06-01 09:00"]).tz_localize("UTC")
    values = {"id": ["T"], "times": [list(times)], **{name: [value] for name, value in HAVEN.items()}, **columns}
    given = {name: value for name, value in values.items() if value is not None}
    return geopandas.GeoDataFrame(given, geometry=[shapely.LineString([(9.0, 57.8), (9.2, 57.8)])], crs=4326)


def one_area(**columns: Any) -> geopandas.GeoDataFrame:
    return geopandas.GeoDataFrame({"id": ["A"], **columns}, geometry=[shapely.box(9.1, 57.7, 9.3, 57.9)], crs=4326)


def test_frames_of_objects_are_solved_as_the_objects() -> None:
    """The areas and tracks of the shipped scene, and a column that says nothing here, give the same rows."""
    scene, areas, tracks, _ = read(STRAIT)
    assert scene is not None
    found = solve(frame_of_tracks(tracks).assign(remark="mine"), frame_of_areas(areas), scene)
    assert found == solve(tracks, areas, scene)
    assert len(found) > 5


def test_projected_frames_are_transformed() -> None:
    """Metres of UTM become degrees: the same pairs, and the same times up to the rounding of the transformation."""
    (in_degrees,) = solve(one_track(), one_area())
    (in_metres,) = solve(one_track().to_crs(32632), one_area().to_crs(32632))
    assert in_degrees.first_contact is not None
    assert in_metres.first_contact is not None
    assert abs(in_degrees.first_contact - in_metres.first_contact).total_seconds() < 1e-3


@pytest.mark.parametrize(
    ("tracks", "areas", "said"),
    [
        (one_track().set_crs(None, allow_override=True), [], "tracks: has no reference system"),
        ([], one_area().set_crs(None, allow_override=True), "areas: has no reference system"),
        (one_track().set_crs('LOCAL_CS["mine"]', allow_override=True), [], "tracks: crs: is not known to PROJ"),
        (pd.DataFrame({"id": ["T"]}), [], "solve: tracks: must be a GeoDataFrame"),
        (geopandas.GeoDataFrame({"id": ["T"]}), [], "tracks: has no geometry column"),
        (one_track(fore_m=None), [], "track 'T': fore_m: is missing"),
        (one_track(grow_mp=[0.1]), [], "track 'T': grow_mp: is not known; did you mean grow_mps?"),
        (one_track(times=None), [], "track 'T': times: is missing"),
        (one_track(times=[[pd.Timestamp("2026-06-01 08:00")] * 2]), [], "tracks.iloc[0]: times[0]: has no time zone"),
        ([], one_area(start=[pd.Timestamp("2026-06-01")]), "areas.iloc[0]: start: has no time zone"),
        ([], one_area(floor_ft=[3.0]), "area 'A': floor_ft: is not known; did you mean floor_m?"),
        ([], one_area(end=[7]), "area 'A': end: must be a date and time"),
        (one_area(), one_track(), "tracks.iloc[0]: geometry: must be a LineString; got a Polygon"),
        ([], pd.concat([one_area(), one_area()]), "object 'A': key: occurs more than once"),
    ],
)
def test_frame_that_cannot_be_meant_is_refused(tracks: Any, areas: Any, said: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        solve(tracks, areas)
    assert said in str(refused.value)


def test_places_that_a_system_does_not_reach_are_refused() -> None:
    """PROJ returns infinity outside of a system, which is not a valid place."""
    beyond = one_area().set_crs(32632, allow_override=True)
    beyond.geometry = [shapely.box(1e9, 1e9, 1e9 + 1, 1e9 + 1)]
    with pytest.raises(InvalidInput, match="area 'A': geometry"):
        solve([], beyond)


def test_haven_is_of_tracks_that_have_none() -> None:
    """A row's own size comes first; an invalid size is refused."""
    bare = one_track(**dict.fromkeys(HAVEN))
    wide = {**HAVEN, "fore_m": 1000}
    area = one_area()
    assert solve(bare, area, haven=HAVEN) == solve(one_track(), area) == solve(one_track(), area, haven=wide)
    assert solve(bare, area, haven=wide) != solve(one_track(), area)
    with pytest.raises(InvalidInput, match=r"solve: haven\['length_m'\]: is not known"):
        solve(bare, area, haven={"length_m": 7})
    with pytest.raises(InvalidInput, match="solve: haven: is for tracks of frames"):
        solve([], area, haven=HAVEN)


def test_instants_without_zone_take_the_one_that_is_given() -> None:
    """Wall clocks of a zone, except hours that occur twice, or not at all."""
    area = one_area(start=[pd.Timestamp("2026-06-01 08:40")])
    (found,) = solve(one_track(), area, time_zone="UTC")
    assert found.first_contact == pd.Timestamp("2026-06-01 08:40", tz="UTC")
    early = one_area(start=[pd.Timestamp("2026-06-01 10:40")])
    assert solve(one_track(), early, time_zone=ZoneInfo("Europe/Oslo")) == [found]
    for wall_clock in ("2026-10-25 02:30", "2026-03-29 02:30"):
        with pytest.raises(InvalidInput, match="start: is there twice, or not at all, in Europe/Oslo"):
            solve([], one_area(start=[pd.Timestamp(wall_clock)]), time_zone="Europe/Oslo")
    old = type(
        "Oslo", (tzinfo,), {"zone": "Europe/Oslo", "utcoffset": lambda *_: timedelta(minutes=43)}
    )()  # as pytz is
    assert solve(one_track(), early, time_zone=old) == [found]
    for zone in ("Nowhere/None", 1):
        with pytest.raises(InvalidInput, match="solve: time_zone: must be the name of a zone"):
            solve([], early, time_zone=zone)  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="solve: time_zone: is for frames"):
        solve([], [], time_zone="UTC")


def test_speeds_make_times() -> None:
    """A start and a speed, as in scene files; faster than anything moves is refused."""
    at_speed = one_track(times=None, start=[pd.Timestamp("2026-06-01 08:00", tz="UTC")], speed_kn=[20.0])
    (found,) = solve(at_speed, one_area())
    assert found.verdict == "conflict"
    with pytest.raises(InvalidInput, match="track 'T': speed_kn: is 5,000 kn"):
        solve(at_speed.assign(speed_kn=5000.0), [])


def in_degrees(columns: set[str]) -> set[str]:
    """Return the columns of a GeoDataFrame: two for each point."""
    points = {name for name in columns if name.endswith("_point")}
    return columns - points | {name.replace("point", axis) for name in points for axis in ("lon_deg", "lat_deg")}


@pytest.mark.parametrize("suffix", ["gpkg", "geojson", "fgb", "parquet"])
def test_found_is_written_by_geopandas(tmp_path: Path, suffix: str) -> None:
    """Conflicts and closest approaches, also none; points and periods are read again."""
    scene, areas, tracks, _ = read(STRAIT)
    assert scene is not None
    always = [Area(key, shapely.box(20, 50, 21, 51)) for key in ("X", "Y")]
    found = solve(tracks, [*areas, *always], Scene(scene.name, nearest_m=20_000))
    near = Results([one.approach for one in found if one.approach], Approach)
    tables: list[Results[Any]] = [found, near, Results([], Conflict), Results([], Approach)]
    for nth, rows in enumerate(tables):
        frame = rows.to_geodataframe()
        file = tmp_path / f"{nth}.{suffix}"
        if suffix == "parquet":
            frame.to_parquet(file)
            written = geopandas.read_parquet(file)
        else:
            frame.to_file(file)
            written = geopandas.read_file(file)
        assert len(written) == len(rows)
        assert set(written.columns) == set(frame.columns) or (suffix == "geojson" and not rows)
        if rows:
            order = ["a_key", "b_key"]  # FlatGeobuf sorts rows by place
            frame, written = (one.sort_values(order, ignore_index=True) for one in (frame, written))
            assert written.geometry.geom_equals_exact(frame.geometry, 1e-6).all()
            for name in [name for name in frame.columns if name.endswith("_deg")]:
                degrees = written[name].to_numpy(dtype=float)  # GeoJSON: 17 digits, as GDAL rounds them
                assert np.allclose(degrees, frame[name], rtol=0.0, atol=1e-12, equal_nan=True), name
    frame = found.to_geodataframe()
    assert frame["periods"].tolist() == [interval_text(one.periods) for one in found]
    assert "../.." in frame["periods"].tolist()
    first = [one.first_contact_deg for one in found]
    lon, lat = frame["first_contact_lon_deg"], frame["first_contact_lat_deg"]
    assert [None if np.isnan(x) else (x, y) for x, y in zip(lon, lat, strict=True)] == first
    assert None in first


def test_found_is_a_frame_with_the_columns_of_the_view() -> None:
    """Names and types, also of an empty frame; absent values are NaT or missing, and so are unbounded times."""
    scene, areas, tracks, _ = read(STRAIT)
    assert scene is not None
    found = solve(tracks, areas, Scene(scene.name, nearest_m=20_000))
    frame = found.to_geodataframe()
    assert set(found.to_dataframe().columns) == {*COLUMNS, "geometry"} - {"region"}
    assert set(frame.columns) == in_degrees({*COLUMNS, "geometry"} - {"region"})
    assert frame.crs == geopandas.GeoSeries(crs=4326).crs
    assert frame["a_key"].tolist() == [one.a_key for one in found]
    assert found.to_dataframe()["periods"].tolist() == [one.periods for one in found]
    for name in ("first_contact", "last_contact", "closest_at"):
        given = [None if one is pd.NaT else one for one in frame[name]]
        assert given == [getattr(one, name) for one in found], name
    assert None in [one.first_contact for one in found]
    assert frame["closest_m"].tolist() == [one.closest_m for one in found]
    assert frame.geometry.notna().all()
    nothing = Results([], Conflict).to_geodataframe()
    assert nothing.dtypes.to_dict() == frame.dtypes.to_dict()
    near = Results([one.approach for one in found if one.approach], Approach)
    assert set(near.to_dataframe().columns) == {*APPROACH_COLUMNS, "geometry"}
    assert set(near.to_geodataframe().columns) == in_degrees({*APPROACH_COLUMNS, "geometry"})
    assert Results([], Approach).to_geodataframe().dtypes.to_dict() == near.to_geodataframe().dtypes.to_dict()


def test_place_of_a_conflict_is_its_region_where_that_was_read() -> None:
    (found,) = solve(one_track(), one_area())
    assert found.first_contact_deg is not None
    region = '{"type": "LineString", "coordinates": [[1, 2], [3, 4]]}'
    whole = replace(found, region=region)
    frame = Results([found, whole], Conflict).to_dataframe()
    assert frame["geometry"].tolist() == [shapely.Point(found.first_contact_deg), shapely.LineString([(1, 2), (3, 4)])]


@pytest.mark.parametrize("missing", ["pandas", "geopandas"])
def test_missing_library_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    """Without geopandas a frame of pandas is still available."""
    monkeypatch.setitem(sys.modules, missing, None)
    nothing = Results([], Conflict)
    with pytest.raises(ConflictDBError, match=rf"needs {missing}: pip install 'conflictdb\[pandas\]'"):
        nothing.to_geodataframe()
    if missing == "geopandas":
        assert len(nothing.to_dataframe()) == 0


def test_solving_objects_imports_no_frames() -> None:
    """Users without frames need not wait for their import."""
    script = (
        "import sys\nfrom conflictdb import solve\nassert solve([], []) == []\n"
        "print(sorted({'pandas', 'geopandas', 'movingpandas', 'geoalchemy2', 'pyproj'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=WAIT_S)
    assert done.stdout.splitlines()[-1] == "[]"


def test_numbers_of_numpy_are_ids() -> None:
    """A column of numbers, and an index of them, are the texts of the numbers."""
    by_index = one_area().drop(columns="id").set_index(np.array([7]))
    for areas in (one_area(id=[7]), one_area(id=[7.0]), by_index):
        (found,) = solve(one_track(), areas)
        assert found.a_key == "7"


TWO_PM = {"rrule": "DTSTART:20260601T080000Z\nRRULE:FREQ=DAILY;COUNT=2", "duration": "PT1M"}


def test_schedules_of_frames_are_those_of_objects() -> None:
    """As objects, as JSON text, and as structs of Arrow, whose rows have all members; they were dropped in silence."""
    (track,) = from_frames.tracks_of(one_track(schedule=[TWO_PM]), Scene("s"), {}, TimeZone(None))
    assert track.schedule == TWO_PM
    pyarrow = pytest.importorskip("pyarrow")
    other = {"periods": [["14:00", "15:00"]], "timezone": "Europe/Oslo"}
    both = pyarrow.array([TWO_PM, other])
    areas = pd.concat([one_area(), one_area(id=["B"])], ignore_index=True)
    structs = areas.assign(schedule=pd.Series(both, dtype=pd.ArrowDtype(both.type)))
    texts = areas.assign(schedule=[json.dumps(TWO_PM), json.dumps(other)])
    for frame in (structs, texts, areas.assign(schedule=[TWO_PM, other])):
        assert [one.schedule for one in from_frames.areas_of(frame, Scene("s"), TimeZone(None))] == [TWO_PM, other]


@pytest.mark.parametrize(
    ("column", "value", "kept"),
    [
        ("start", pd.Timestamp("2026-06-01T08:40", tz="UTC"), 1780303200000000),
        ("start", np.datetime64("NaT"), None),
        ("start", pd.NA, None),
        ("floor_m", Decimal("7.5"), 7.5),
        ("floor_m", Decimal("NaN"), None),
        ("floor_m", np.float32(0.5), 0.5),
        ("floor_m", np.array(7), 7.0),
        ("floor_m", np.ma.masked, None),
        ("object_class", Decimal("8.50"), "8.5"),
        ("owner", UUID(int=7), str(UUID(int=7))),
        ("key", Decimal(7), "7"),
        ("key", UUID(int=7), str(UUID(int=7))),
        ("spans_us", [[None, datetime(1970, 1, 1, 0, 0, 1, tzinfo=UTC)]], ((None, 1_000_000),)),
        ("spans_us", np.array([["1970-01-01T00:00:01", "NaT"]], "M8[s]"), ((1_000_000, None),)),
    ],
)
def test_values_of_areas_keep_their_meaning(column: str, value: Any, kept: Any) -> None:
    name = {"object_class": "class", "key": "id", "spans_us": "spans", "start": "start"}.get(column, column)
    frame = one_area(**{name: pd.Series([value], dtype=object)})
    (area,) = from_frames.areas_of(frame, Scene("s"), TimeZone("UTC"))
    assert getattr(area, {"start": "start_us"}.get(column, column)) == kept


def test_departures_and_windows_of_frames_are_instants() -> None:
    """Datetimes of a zone, of numpy, and in a Series; they were refused, or lost."""
    later = pd.Series(pd.to_datetime(["2026-06-02 08:00", "2026-06-03 08:00"]))
    (track,) = from_frames.tracks_of(one_track(departures=[later]), Scene("s"), {}, TimeZone("UTC"))
    assert track.departures_us is not None
    assert [pd.Timestamp(at, unit="us") for at in track.departures_us] == list(later)
    window = [pd.Timestamp("2026-06-01T07:50Z"), datetime(2026, 6, 1, 10, 10, tzinfo=ZoneInfo("Europe/Oslo"))]
    (late,) = from_frames.tracks_of(one_track(departure_window=[window]), Scene("s"), {}, TimeZone(None))
    assert late.tolerances == {"departure_window": ["2026-06-01T07:50:00Z", "2026-06-01T08:10:00Z"]}


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("start", pd.Period("2026-06")),
        ("start", pd.Timedelta("2h")),
        ("start", b"2026-06-01T08:00:00Z"),
        ("spans", [pd.Interval(1, 2)]),
        ("floor_m", timedelta(1)),
        ("floor_m", 1j),
        ("ceiling_m", {3.0}),
        ("class", {"ferry"}),
        ("schedule", {7: "periods"}),
        ("colour", object()),
        ("colour", {"of": [object()]}),
    ],
)
def test_values_that_would_be_lost_are_refused_by_column(column: str, value: Any) -> None:
    """They counted as missing: an area was active for ever, or at all heights."""
    frame = one_area(**{column: pd.Series([value], dtype=object)})
    with pytest.raises(InvalidInput, match=rf"areas.iloc\[0\]: {column}[.\[\]\w]*: (must|is)"):
        solve([], frame)


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        (Decimal("0.25"), 0.25),
        (pd.Timedelta("1D 2h"), "PT93600S"),
        (np.timedelta64(1500, "ms"), "PT1.5S"),
        (pd.Period("2026-06"), "2026-06"),
        (date(2026, 6, 1), "2026-06-01"),
        (pd.Timestamp("2026-06-01 08:00"), "2026-06-01T08:00:00"),
        ({"b", "a"}, ["a", "b"]),
        (b"\x01", "01"),
        (shapely.Point(1, 2), "POINT (1 2)"),
        ({"a": np.array([[1, 2]]), "b": None}, {"a": [[1, 2]], "b": None}),
        (pd.Interval(1, 2), "(1, 2]"),
        (pd.Categorical(["x"])[0], "x"),
        (range(2), [0, 1]),
    ],
)
def test_other_columns_are_kept_as_properties(value: Any, kept: Any) -> None:
    frame = one_area(colour=pd.Series([value], dtype=object))
    (area,) = from_frames.areas_of(frame, Scene("s"), TimeZone(None))
    assert area.properties == {"colour": kept}


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (one_area(tolerances=[{}]), "areas: tolerances: is a field of Area or Track"),
        (one_area(object_class=["ferry"]), "areas: object_class: is a field of Area or Track.*: class"),
        (one_area(start=["x"]).set_index(["id", "start"]), "areas: start: is in the index"),
        (one_area(end=["x"], at=["y"]).rename(columns={"at": "end"}), "areas: end: is the name of several columns"),
    ],
)
def test_columns_that_would_be_lost_are_refused(frame: Any, said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        solve([], frame)


def test_a_haven_fills_in_each_size_that_is_missing() -> None:
    """A row with some sides was refused, although a haven was given."""
    short = one_track(aft_m=[np.nan], grow_mps=[0.5])
    (track,) = from_frames.tracks_of(short, Scene("s"), {"fore_m": 1.0, "aft_m": 300.0}, TimeZone(None))
    assert track.outline_m[:, 1].min() == -300.0
    assert track.outline_m[:, 1].max() == HAVEN["fore_m"]
    bare = one_track(**dict.fromkeys(HAVEN), grow_mps=[0.5])
    (track,) = from_frames.tracks_of(bare, Scene("s"), HAVEN, TimeZone(None))
    assert track.grow_mps == 0.5


# Calls of MovingPandas to itself.
ITS_OWN = pytest.mark.filterwarnings("ignore:The inplace keyword")


@pytest.fixture(scope="module")
def movingpandas() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns about optional libraries
        return pytest.importorskip("movingpandas")


def fixes(zone: str | None = None) -> geopandas.GeoDataFrame:
    """Return two ships, one ahead of the other, a fix each ten minutes; wall clocks of a zone."""
    times = pd.date_range("2026-06-01 08:00", periods=7, freq="10min", tz=zone)
    rows = [
        (key, t, lat, lon + k / 60)
        for key, lon, lat in (("E", 9.0, 57.8), ("W", 9.05, 57.8))
        for k, t in enumerate(times)
    ]
    keys, when, lats, lons = zip(*rows, strict=True)
    points = geopandas.points_from_xy(lons, lats)
    return geopandas.GeoDataFrame({"ship": keys, "t": when, **HAVEN}, geometry=points, crs=4326).set_index("t")


@ITS_OWN
def test_trajectories_are_tracks(movingpandas: Any) -> None:
    """By their ids, at the fixes, in any system; one trajectory too. They meet the area that the fixes lead through."""
    area = one_area()
    collection = movingpandas.TrajectoryCollection(fixes(), "ship")
    found = solve(collection, area, time_zone="UTC")
    assert [(one.a_key, one.b_key) for one in found] == [("A", "W"), ("A", "E")][::-1]
    track = one_track(id=["E"]).assign(geometry=[shapely.LineString([(9.0 + k / 60, 57.8) for k in range(7)])])
    times = list(pd.date_range("2026-06-01 08:00", periods=7, freq="10min", tz="UTC"))
    track["times"] = pd.Series([times], index=track.index)
    assert solve(collection.trajectories[0], area, time_zone="UTC") == solve(track, area) == found[:1]
    projected = movingpandas.TrajectoryCollection(fixes().to_crs(32632), "ship")
    assert len(solve(projected, area, time_zone="UTC")) == 2


@ITS_OWN
def test_impossible_fixes_of_trajectories_are_left_out(movingpandas: Any) -> None:
    """As by the reader of positions, with a warning: AIS (a column mmsi) at 102.2 kn, others at 2,000 kn."""

    def answer(found: Any) -> list[Any]:
        return [(one.a_key, one.b_key, one.periods) for one in found]

    area = one_area()
    expected = solve(movingpandas.TrajectoryCollection(fixes(), "ship"), area, time_zone="UTC")
    raw = fixes()
    odd = raw.iloc[[2]].copy()
    odd.index = raw.index[[2]] + pd.Timedelta("1min")
    odd["geometry"] = [shapely.Point(60.0, 10.0)]  # 3,800 nautical miles away, for a minute
    wild = pd.concat([raw, odd]).sort_index()
    with pytest.warns(UserWarning, match=r"1 fixes that are not reached .* are left out: '.' \(1\)"):
        found = solve(movingpandas.TrajectoryCollection(wild, "ship"), area, time_zone="UTC")
    assert answer(found) == answer(expected)
    odd["geometry"] = [shapely.Point(9.6, 57.8)]  # some 1,100 kn, and 117 kn: not of AIS
    fast = pd.concat([raw, odd]).sort_index()
    assert answer(solve(movingpandas.TrajectoryCollection(fast, "ship"), area, time_zone="UTC")) != answer(expected)
    with pytest.warns(UserWarning, match="1 fixes that are not reached"):
        found = solve(movingpandas.TrajectoryCollection(fast.assign(mmsi=1), "ship"), area, time_zone="UTC")
    assert answer(found) == answer(expected)


@ITS_OWN
def test_trajectories_need_a_zone_a_size_and_a_system(movingpandas: Any) -> None:
    """A zone that MovingPandas removed is restored; naive times without a given zone are refused."""
    area = one_area()
    collection = movingpandas.TrajectoryCollection(fixes(), "ship")
    with pytest.raises(InvalidInput, match=r"trajectory 'E': times\[0\]: has no time zone"):
        solve(collection, area)
    with pytest.warns(UserWarning, match="Time zone information dropped"):
        zoned = movingpandas.TrajectoryCollection(fixes("Europe/Oslo"), "ship")
    assert solve(zoned, area) == solve(collection, area, time_zone="Europe/Oslo")
    clocks_set = fixes("UTC")
    clocks_set.index = pd.date_range("2026-10-25 00:40", periods=14, freq="10min", tz="UTC").tz_convert("Europe/Oslo")
    with pytest.warns(UserWarning, match="Time zone information dropped"):
        twice = movingpandas.TrajectoryCollection(clocks_set, "ship")
    with pytest.raises(InvalidInput, match="trajectory 'E': times: are there twice"):
        solve(twice, area)
    bare = movingpandas.TrajectoryCollection(fixes().drop(columns=list(HAVEN)), "ship")
    with pytest.raises(InvalidInput, match="track 'E': fore_m: is missing"):
        solve(bare, area, time_zone="UTC")
    assert solve(bare, area, haven=HAVEN, time_zone="UTC") == solve(collection, area, time_zone="UTC")
    changing = fixes().assign(fore_m=[60, 70] * 7, floor_m=[-5.0, -9.0] * 7, ceiling_m=[np.nan, 3.0] * 7)
    (first, _) = from_frames.tracks_of(
        movingpandas.TrajectoryCollection(changing, "ship"), Scene("s"), {}, TimeZone("UTC")
    )
    assert first.outlines_m is not None
    assert first.outlines_m[:, :, 1].max(axis=1).tolist() == [60.0, 70, 60, 70, 60, 70, 60]
    assert (first.floor_m, first.ceiling_m) == (-9.0, None)
    datums = fixes().assign(floor_m=1.0, vertical_datum=["wgs84", "msl"] * 7)
    with pytest.raises(InvalidInput, match="trajectory 'E': vertical_datum: differs between fixes"):
        solve(movingpandas.TrajectoryCollection(datums, "ship"), area, time_zone="UTC")
    classes = movingpandas.TrajectoryCollection(fixes().assign(**{"class": ["a", "b"] * 7}), "ship")
    with pytest.raises(InvalidInput, match="trajectory 'E': class: differs between fixes"):
        solve(classes, area, time_zone="UTC")
    with pytest.warns(UserWarning, match="CRS"):
        nowhere = movingpandas.TrajectoryCollection(fixes().set_crs(None, allow_override=True), "ship", crs=None)
    with pytest.raises(InvalidInput, match="trajectory 'E': has no reference system"):
        solve(nowhere, area, time_zone="UTC")


@ITS_OWN
def test_sizes_of_trajectories_are_those_of_each_fix(movingpandas: Any) -> None:
    """The largest of all fixes counted everywhere: a ship met an area before it was large enough."""

    def tracks(**columns: Any) -> Any:
        frame = fixes().iloc[:7].assign(**columns)
        given = movingpandas.TrajectoryCollection(frame.dropna(axis="columns", how="all"), "ship")
        return from_frames.tracks_of(given, Scene("s"), {**HAVEN, "port_m": 0.0}, TimeZone("UTC"))

    (one,) = tracks(fore_m=[60.0, 60, 60, 900, 900, np.nan, 60], port_m=np.nan, aft_m=0.0, starboard_m=0.0)
    assert one.outlines_m.max(axis=1)[:, 1].tolist() == [60, 60, 60, 900, 900, 900, 60]
    assert one.outlines_m.min(axis=1)[:, 0].tolist() == [0.0] * 7
    with pytest.warns(UserWarning, match="trajectory 'E': sizes differ between fixes, .* the largest counts"):
        (two,) = tracks(fore_m=[60.0, 60, 60, 900, 900, np.nan, 60], xtd_port_m=5.0)
    assert two.outline_m[:, 1].max() == 900.0


@ITS_OWN
def test_heights_of_trajectories_are_those_at_the_ends_of_each_leg(movingpandas: Any) -> None:
    """The band of all fixes on each leg met an area far above one."""
    heights = {"floor_m": [0.0, 0, 0, 90, 90, np.nan, 50], "ceiling_m": [9.0, 9, 9, 99, 99, 99, 99]}
    climbing = fixes().iloc[:7].assign(**heights)
    (track,) = from_frames.tracks_of(
        movingpandas.TrajectoryCollection(climbing, "ship"), Scene("s"), {}, TimeZone("UTC")
    )
    assert track.floors_m is not None
    assert track.ceilings_m is not None
    assert track.floors_m.tolist() == [0, 0, 0, 90, -np.inf, -np.inf]
    assert track.ceilings_m.tolist() == [9, 9, 99, 99, 99, 99]
    places = {"early": 9.025, "late": 9.0 + 3.5 / 60}
    boxes = [Area(key, shapely.box(lon - 1e-3, 57.79, lon + 1e-3, 57.81), floor_m=91.0) for key, lon in places.items()]
    collection = movingpandas.TrajectoryCollection(climbing, "ship")
    assert [one.a_key for one in solve(collection, boxes, time_zone="UTC")] == ["late"]


def test_dates_of_frames_are_whole_days_of_the_zone() -> None:
    """They were refused, also with a zone; an end contains its day, as in files."""
    frame = geopandas.GeoDataFrame(
        {"id": ["Z"], "start": [date(2026, 6, 1)], "end": [date(2026, 6, 2)]},
        geometry=[shapely.box(9.0, 57.0, 9.2, 57.2)],
        crs=4326,
    )
    (area,) = from_frames.areas_of(frame, Scene("s"), TimeZone("Europe/Copenhagen"))
    assert area.start_us == parse_instant("2026-05-31T22:00:00Z")
    assert area.end_us == parse_instant("2026-06-02T22:00:00Z")
    with pytest.raises(InvalidInput, match="end: has no time zone"):
        from_frames.areas_of(frame, Scene("s"), TimeZone(None))
