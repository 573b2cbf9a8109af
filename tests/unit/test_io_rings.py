"""Rings and lines as files have them: long sides, the antimeridian, the poles."""

import json
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

from conflictdb import Area, InvalidInput, Scene, Track, read
from conflictdb.earth import geodesy
from conflictdb.earth.registry import Setup, centred
from conflictdb.formats import object_lines, unwritten, write_lines
from conflictdb.formats.gather import gather
from conflictdb.model.plans import EarthModel, Motion

HOURS = [f"2026-06-01T1{hour}:00:00Z" for hour in range(4)]
POINT = {"fore_m": 0, "aft_m": 0, "port_m": 0, "starboard_m": 0}


def geojson(path: Path, coordinates: Any, kind: str = "Polygon", scene: Any = None, **properties: Any) -> Path:
    feature = {"type": "Feature", "id": "Z", "geometry": {"type": kind, "coordinates": coordinates}}
    more = {} if scene is None else {"scene": scene}
    path.write_text(
        json.dumps({"type": "FeatureCollection", "features": [{**feature, "properties": properties}], **more})
    )
    return path


TRIANGLE = [[0.0, 40.0], [30.0, 70.0], [0.0, 70.0], [0.0, 40.0]]


def written(path: Path, ring: Any) -> Path:
    if path.suffix == ".geojson":
        return geojson(path, [ring])
    if path.suffix == ".kml":
        text = " ".join(f"{lon},{lat}" for lon, lat in ring)
        shape = f"<outerBoundaryIs><LinearRing><coordinates>{text}</coordinates></LinearRing></outerBoundaryIs>"
        mark = f"<Placemark><Polygon>{shape}</Polygon></Placemark>"
        path.write_text(f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{mark}</Document></kml>')
        return path
    frame = geopandas.GeoDataFrame({"id": ["Z"]}, geometry=[shapely.Polygon(ring)], crs=4326)
    (frame.to_parquet if path.suffix == ".parquet" else frame.to_file)(path)
    return path


@pytest.mark.parametrize("name", ["a.geojson", "a.kml", "a.gpkg", "a.parquet"])
def test_long_sides_are_straight_in_longitude_and_latitude(name: str, tmp_path: Path) -> None:
    """RFC 7946, 3.1.1. As a rhumb line the side was 330 km away; now within a metre, with a remark."""
    contents = read(written(tmp_path / name, TRIANGLE))
    (area,) = contents.areas
    ring = shapely.get_coordinates(area.footprint)
    assert 50 < len(ring) <= 1_001
    side = ring[(ring[:, 0] > 0.0) & (ring[:, 1] < 70.0)]
    assert np.allclose(side[:, 1], 40.0 + side[:, 0], atol=1e-9)
    earth = geodesy.earth_of(EarthModel.WGS84)
    # Half way along each rhumb line, by the isometric latitude.
    psi = earth.isometric(earth.rectifying(np.radians(side[:, 1])))
    middle = np.degrees(earth.latitude(0.5 * (psi[1:] + psi[:-1])))
    apart_m = np.abs(middle - 40.0 - 0.5 * (side[1:, 0] + side[:-1, 0])) * 111_000.0
    assert apart_m.max() < 1.0
    assert any("straight in longitude and latitude by the standard" in one.text for one in contents.remarks)


def test_other_sides_stay_as_they_are(tmp_path: Path) -> None:
    """Short sides, parallels and meridians, those of own scene files, and those that would need too many vertices."""
    for ring in ([[0, 40], [30, 40], [30, 70], [0, 70], [0, 40]], [[0, 40], [0.02, 40.02], [0, 40.02], [0, 40]]):
        contents = read(geojson(tmp_path / "a.geojson", [ring]))
        assert shapely.count_coordinates(contents.areas[0].footprint) == len(ring)
        assert not any("straight" in one.text for one in contents.remarks)
    own = read(geojson(tmp_path / "a.geojson", [TRIANGLE], scene={"name": "s"}))
    assert shapely.count_coordinates(own.areas[0].footprint) == 4
    wide = read(geojson(tmp_path / "a.geojson", [[[0, -60], [170, 80], [0, 80], [0, -60]]]))
    assert shapely.count_coordinates(wide.areas[0].footprint) == 4
    (remark,) = [one.text for one in wide.remarks if "straight" in one.text]
    assert "they are taken as rhumb lines" in remark
    assert " m in area 'Z'" in remark


@pytest.mark.parametrize(("latitude", "rule"), [(1e308, "latitude must lie within"), (10**400, "too large")])
def test_sides_that_leave_all_degrees_are_refused_without_a_warning(tmp_path: Path, latitude: float, rule: str) -> None:
    with pytest.raises(InvalidInput, match=rule):
        read(geojson(tmp_path / "a.geojson", [[[0.0, 80.0], [0.01, 80.01], [0.01, latitude], [0.0, 80.0]]]))


def test_sides_of_more_than_half_a_turn_are_remarked(tmp_path: Path) -> None:
    ring = [[179, -18], [-179, -18], [-179, -17], [179, -17], [179, -18]]
    contents = read(geojson(tmp_path / "a.geojson", [ring]))
    assert any("sides of more than 180 degrees, such as 'Z'" in one.text for one in contents.remarks)
    assert any("cut there (RFC 7946, 3.1.9)" in one.text for one in contents.remarks)
    beyond = [[179, -18], [181, -18], [181, -17], [179, -17], [179, -18]]
    cap = [[-180, 85], [-90, 85], [0, 85], [90, 85], [180, 85], [180, 90], [-180, 90], [-180, 85]]
    scene = {"name": "s", "motion": "great_circle", "centre": [0, 89]}
    for sound, settings in ((beyond, None), (cap, scene)):
        remarks = read(geojson(tmp_path / "a.geojson", [sound], scene=settings)).remarks
        assert not any("180 degrees" in one.text for one in remarks)
    short = [cap[0], *cap[4:]]
    (remark,) = read(geojson(tmp_path / "a.geojson", [short], scene=scene)).remarks
    assert "1 areas around a pole, such as 'Z'" in remark.text
    assert "only the sides along latitude 90 may be so long" in remark.text
    with pytest.raises(InvalidInput, match="it goes round a pole: close it along latitude 90"):
        read(geojson(tmp_path / "a.geojson", [[[0, 85], [90, 85], [180, 85], [-90, 85], [0, 85]]], scene=scene))


PARTS = [[[178, -17.5], [180, -17.5]], [[-180, -17.5], [-178, -17.5]]]


def cut(path: Path, times: Any, lines: Any = PARTS, **more: Any) -> Track:
    if path.suffix == ".geojson":
        (track,) = read(geojson(path, lines, "MultiLineString", times=times, **POINT, **more)).tracks
        return track
    columns = {name: [json.dumps(one) if isinstance(one, list) else one] for name, one in (POINT | more).items()}
    shape = shapely.MultiLineString(lines)
    frame = geopandas.GeoDataFrame({**columns, "times": [json.dumps(times)]}, geometry=[shape], crs=4326)
    (frame.to_parquet if path.suffix == ".parquet" else frame.to_file)(path)
    (track,) = read(path).tracks
    return track


@pytest.mark.parametrize("name", ["a.geojson", "a.gpkg", "a.parquet"])
def test_a_track_that_is_cut_at_the_antimeridian_is_one_line(name: str, tmp_path: Path) -> None:
    nested, flat = [HOURS[:2], HOURS[1:3]], [HOURS[0], HOURS[1], HOURS[1], HOURS[2]]
    for times in (nested, flat, HOURS[:3]):
        track = cut(tmp_path / name, times, floor_m=[[1.0], [2.0]])
        assert track.positions_deg.tolist() == [[178, -17.5], [180, -17.5], [182, -17.5]]
        assert np.diff(track.times_us).tolist() == [3_600_000_000] * 2
        assert track.floors_m is not None
        assert track.floors_m.tolist() == [1.0, 2.0]
    with pytest.raises(InvalidInput, match="times: must be the same at the end of line 0 and the begin of line 1"):
        cut(tmp_path / name, [HOURS[:2], HOURS[2:4]])
    apart = [PARTS[0], [[-179, -17.5], [-178, -17.5]]]
    with pytest.raises(InvalidInput, match="must be one line: a track has no gaps; lines are joined if each begins"):
        cut(tmp_path / name, nested, apart)


def of_scene(path: Path, **settings: Any) -> Any:
    """The area of a file that is loaded into a scene."""
    (plan,) = gather([path], "S", settings_of=lambda name: Scene(name, **settings))
    return plan


@pytest.mark.parametrize("name", ["a.geojson", "a.kml", "a.gpkg", "a.parquet"])
def test_sides_of_foreign_files_in_scenes_of_great_circles(name: str, tmp_path: Path) -> None:
    """A side along 60 N of 30 degrees: a great circle leads up to 60.9 N. Own scene files keep their meaning."""
    ring = [[0.0, 50.0], [30.0, 50.0], [30.0, 60.0], [0.0, 60.0], [0.0, 50.0]]
    plan = of_scene(written(tmp_path / name, ring), motion=Motion.GREAT_CIRCLE, earth=EarthModel.SPHERE)
    found = shapely.get_coordinates(plan.areas[0].footprint)
    for lat in (50.0, 60.0):
        lon = np.sort(found[np.abs(found[:, 1] - lat) < 1e-9, 0])
        step = np.radians(np.diff(np.unique(lon)).max())
        rise = np.degrees(np.arctan(np.tan(np.radians(lat)) / np.cos(0.5 * step))) - lat
        assert 0.0 < rise * 111_000.0 < 1.0
    assert any("vertices are added along them, which exports have" in one.text for one in plan.remarks)
    assert len(shapely.get_coordinates(read(tmp_path / name).areas[0].footprint)) == 5  # rhumb lines follow them


@pytest.mark.parametrize(("tolerance_m", "most_m"), [(0.1, 1.0), (1.0, 1.0), (500.0, 500.0)])
def test_the_tolerance_of_the_scene_says_how_many_vertices(tolerance_m: float, most_m: float, tmp_path: Path) -> None:
    path = geojson(tmp_path / "a.geojson", [TRIANGLE])
    counts = {
        one: len(shapely.get_coordinates(of_scene(path, tolerance_m=one).areas[0].footprint))
        for one in (tolerance_m, most_m)
    }
    assert counts[tolerance_m] == counts[most_m]
    assert (counts[tolerance_m] < 60) == (tolerance_m == 500.0)


def test_settings_in_another_file_of_the_scene_count(tmp_path: Path) -> None:
    ring = [[0.0, 50.0], [30.0, 50.0], [30.0, 60.0], [0.0, 60.0], [0.0, 50.0]]
    first = geojson(tmp_path / "a.geojson", [ring])
    settings = {"name": "S", "motion": "great_circle", "earth": "sphere"}
    second = tmp_path / "s.geojson"
    second.write_text(json.dumps({"type": "FeatureCollection", "scene": settings, "features": []}))
    (plan,) = gather([first, second], "S")
    assert len(shapely.get_coordinates(plan.areas[0].footprint)) > 100


@pytest.mark.parametrize("motion", list(Motion))
@pytest.mark.parametrize(
    "ring", [[(5, 60), (9, 62), (9, 60)], [(-170, 80), (-150, 81), (-160, 79)], [(176, 70), (180, 72), (180, 69)]]
)
def test_long_sides_come_back_from_kml_as_the_lines_of_their_scene(tmp_path: Path, motion: Motion, ring: Any) -> None:
    """KML draws sides straight in degrees: the file has vertices along the scene's lines, and reading adds none."""
    scene = Scene("s", motion=motion, centre=(0.0, 75.0) if motion == Motion.GREAT_CIRCLE else None)
    area = Area("A", shapely.MultiPolygon([shapely.Polygon(ring)]))
    path = tmp_path / "sides.kml"
    write_lines(path, object_lines(path, scene, [area], []))
    contents = read(path)
    (found,) = contents.areas
    assert [str(one) for one in contents.remarks if "long sides" in str(one)] == []
    plane = Setup.of(centred(scene, [area], [])).plane
    given, back = (
        shapely.transform(one.footprint, lambda at: np.column_stack(plane.to_plane(*at.T))) for one in (area, found)
    )
    assert len(shapely.get_coordinates(back)) > 40
    assert shapely.hausdorff_distance(given, back) < 1e-6
    (said,) = [str(one) for one in unwritten(path, scene, [area], []) if "vertices" in str(one)]
    assert "1 area is written with added vertices" in said
