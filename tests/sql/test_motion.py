"""haven_at follows the same motion as the solver, on both earths, at every bearing, across the seam."""

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from havens_of_kernel import haven_deg
from layouts import GROWING, HIGH_LATITUDE, LONG_LEGS, SEAM
from mixed_scenes import plain_scene
from oracle_motion import grown
from piecework import load

from conflictdb.model.plans import EarthModel, Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
T0_US = 1_772_323_200_000_000
HOUR_US = 3_600_000_000
# Difference of longitude and latitude between two computations: 1e-11 degrees is a micrometre.
CLOSE_DEG = 3e-11


def instant(us: int) -> datetime:
    return EPOCH + timedelta(microseconds=us)


def haven(conn: Conn, key: str, us: int) -> shapely.Geometry | None:
    row = conn.execute("SELECT conflictdb.haven_at('s', %s, %s)::text", [key, instant(us)]).fetchone()
    assert row is not None
    return None if row[0] is None else shapely.from_wkb(row[0])


def assert_same_polygon(found: shapely.Geometry | None, vertices: np.ndarray) -> None:
    assert found is not None
    polygon = shapely.Polygon(vertices)
    if polygon.bounds[0] < -180 or polygon.bounds[2] > 180:
        turn = 360.0 if polygon.bounds[0] < -180 else -360.0
        both = shapely.MultiPolygon([polygon, shapely.Polygon(vertices + np.array([turn, 0.0]))])
        polygon = shapely.union_all([part.intersection(shapely.box(-180, -90, 180, 90)) for part in both.geoms])
    assert shapely.hausdorff_distance(found, polygon) < CLOSE_DEG * 10
    assert found.bounds == pytest.approx(polygon.bounds, abs=CLOSE_DEG * 10)


@pytest.mark.parametrize("workload", [HIGH_LATITUDE, LONG_LEGS, SEAM, GROWING], ids=lambda w: w.name)
@pytest.mark.parametrize("earth", list(EarthModel))
def test_random_tracks_are_where_the_motion_model_says(conn: Conn, workload: Any, earth: EarthModel) -> None:
    _, _, tracks = plain_scene(workload, 21, 0, 12, earth)
    scene = Scene("s", earth=earth)
    load(conn, scene, [], tracks)
    for track in tracks:
        first, last = int(track.times_us[0]), int(track.times_us[-1])
        for us in np.linspace(first, last, 7, dtype=np.int64)[:-1]:
            assert_same_polygon(haven(conn, track.key, int(us)), haven_deg(scene, track, int(us)))


@pytest.mark.parametrize("earth", list(EarthModel))
@pytest.mark.parametrize("bearing", [0.0, 1e-12, 1e-6, 45.0, 90.0 - 1e-9, 90.0, 180.0, 270.0, -90.0 + 1e-12])
def test_no_bearing_is_special(conn: Conn, earth: EarthModel, bearing: float) -> None:
    step = 0.5 * np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing))])
    step[np.abs(step) < 1e-16] = 0.0
    positions = np.array([[10.0, 60.0], [10.0 + step[0], 60.0 + step[1]]])
    track = Track("T", positions, np.array([T0_US, T0_US + HOUR_US]), rectangle_outline_m(5000, 100, 300, 2000))
    scene = Scene("s", earth=earth)
    load(conn, scene, [], [track])
    for us in (T0_US, T0_US + HOUR_US // 3, T0_US + HOUR_US - 1):
        assert_same_polygon(haven(conn, "T", us), haven_deg(scene, track, us))


@pytest.mark.parametrize("earth", list(EarthModel))
def test_legs_from_near_one_pole_to_near_the_other_lose_no_digits(conn: Conn, earth: EarthModel) -> None:
    """By symmetry they cross the equator at half their longitude and time."""
    times = T0_US + HOUR_US * np.array([0, 10])
    tracks = [
        Track(f"to {lat}", np.array([[-179.0, -lat], [0.9, lat]]), times, np.zeros((1, 2)))
        for lat in np.linspace(88.0, 89.0, 21).tolist()
    ]
    load(conn, Scene("s", earth=earth), [], tracks)
    for track in tracks:
        place = haven(conn, track.key, T0_US + 5 * HOUR_US)
        assert place is not None
        assert place.coords[0] == pytest.approx((-89.05, 0.0), abs=6e-13)  # 6e-8 m


def test_time_is_half_open_and_a_waypoint_belongs_to_the_leg_it_starts(conn: Conn) -> None:
    positions = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    times = T0_US + HOUR_US * np.arange(3)
    load(conn, Scene("s"), [], [Track("T", positions, times, rectangle_outline_m(1000, 0, 0, 0))])
    assert haven(conn, "T", T0_US - 1) is None
    assert haven(conn, "T", T0_US + 2 * HOUR_US) is None
    east, north = haven(conn, "T", T0_US), haven(conn, "T", T0_US + HOUR_US)
    assert east is not None
    assert north is not None
    assert east.bounds[2] == pytest.approx(0.00898, abs=1e-5)
    assert north.bounds[3] == pytest.approx(0.00904, abs=1e-5)


def test_loiter_keeps_the_heading_it_came_with_else_the_one_it_leaves_with_else_north(conn: Conn) -> None:
    outline = np.array([[0.0, 0.0], [0.0, 1000.0]])
    times = T0_US + HOUR_US * np.arange(4)
    tracks = [
        Track("came", np.array([[0.0, 0.0], [1, 0], [1, 0], [1, 1]], dtype=float), times, outline),
        Track("leaves", np.array([[1.0, 0.0], [1, 0], [1, 0], [0, 0]], dtype=float), times, outline),
        Track("stays", np.array([[1.0, 0.0]] * 4), times, outline),
    ]
    load(conn, Scene("s"), [], tracks)
    tips = {}
    for track in tracks:
        line = haven(conn, track.key, T0_US + HOUR_US + HOUR_US // 2)
        assert isinstance(line, shapely.LineString)
        tips[track.key] = line.coords[1][0] - 1.0, line.coords[1][1]
    assert tips["came"] == pytest.approx((0.00898, 0), abs=1e-5)
    assert tips["leaves"] == pytest.approx((-0.00898, 0), abs=1e-5)
    assert tips["stays"] == pytest.approx((0, 0.00904), abs=1e-5)


def test_haven_without_size_is_a_point(conn: Conn) -> None:
    track = Track(
        "T",
        np.array([[179.0, 10.0], [-179.0, 10.0]]),
        np.array([T0_US, T0_US + 4]),
        np.zeros((1, 2)),
        max_speed_kn=np.inf,
    )
    load(conn, Scene("s"), [], [track])
    found = haven(conn, "T", T0_US + 3)
    assert isinstance(found, shapely.Point)
    assert found.coords[0] == pytest.approx((-179.5, 10.0), abs=1e-12)
    assert shapely.get_srid(found) == 4326


def test_a_haven_grows_from_the_first_waypoint_on(conn: Conn) -> None:
    """Every side moves outward at the speed: a point becomes a square, through all legs, loiters included."""
    positions = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    times = T0_US + HOUR_US * np.arange(4)
    load(conn, Scene("s"), [], [Track("T", positions, times, np.zeros((1, 2)), grow_mps=0.5)])
    start = haven(conn, "T", T0_US)
    assert start is not None
    assert start.area == 0.0
    late = haven(conn, "T", T0_US + 3 * HOUR_US - 1)
    assert late is not None
    half = 0.5 * 3 * 3600 / 111319.4908
    assert late.bounds[0] == pytest.approx(1.0 - half, abs=1e-9)
    assert late.bounds[2] == pytest.approx(1.0 + half, abs=1e-9)


@pytest.mark.parametrize(
    "outline",
    [
        "POLYGON((0 0,0 0,0 0,0 0))",
        "POLYGON((0 0,3 4,3 4,0 0))",
        "POLYGON((0 0,10 0,10 0,10 10,0 10,0 0))",
        "POLYGON((0 0,5 0,10 0,10 10,0 10,0 0))",
        "POLYGON((0 0,0 10,10 10,10 0,0 0))",
        "POLYGON((-3 1,4 -2,7 3,2 9,-3 1))",
    ],
)
def test_grown_outlines_are_those_of_the_motion_model(conn: Conn, outline: str) -> None:
    conn.execute("SELECT set_config('search_path', 'conflictdb, conflictdb_internal, public', false)")
    row = conn.execute("SELECT _grown_outline(%s, 2.5)::text", [outline]).fetchone()
    assert row is not None
    found = shapely.get_coordinates(shapely.from_wkb(row[0]))[:-1]
    ring = shapely.get_coordinates(shapely.from_wkt(outline))[:-1]
    np.testing.assert_allclose(found, grown(ring, 2.5), rtol=0, atol=1e-12)
