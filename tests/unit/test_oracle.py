"""The oracle itself, compared with reference data, with 50 digits and with answers worked out by hand."""

import csv
from pathlib import Path

import numpy as np
import oracle
import pytest
import recorded
import scenes
import shapely
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from mpmath import mp, mpf
from oracle_distance import edges_of, least_m
from precise import PreciseGlobe, precise_legs, refine, separation
from pyproj import Geod
from reference import data
from scipy.spatial.distance import cdist

from conflictdb.model.plans import Area, EarthModel, Scene, Track, rectangle_outline_m


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_lengths_agree_with_the_rhumb_reference() -> None:
    table = rows(data("rhumb", "rhumb_inverse_wgs84.csv"))
    columns = {"s12_m_mpmath40": EarthModel.WGS84, "s12_m_sphere_R6371008.771415_RhumbSolve": EarthModel.SPHERE}
    for column, earth in columns.items():
        globe = oracle.Globe.of(earth)
        for row in table:
            turn = (float(row["lon2"]) - float(row["lon1"]) + 180.0) % 360.0 - 180.0
            length = np.hypot(*globe.between(float(row["lat1"]), float(row["lat2"]), turn))
            assert length == pytest.approx(float(row[column]), rel=1e-11)


def test_positions_agree_with_the_rhumb_reference() -> None:
    table = rows(data("rhumb", "rhumb_direct_wgs84.csv"))
    globe = oracle.Globe.of(EarthModel.WGS84)
    column = {name: np.array([float(row[name]) for row in table]) for name in table[0] if name != "kind"}
    bearing = np.radians(column["azi12"])
    lon, lat = globe.step(
        np.radians(column["lon1"]),
        np.radians(column["lat1"]),
        column["s12_m"] * np.cos(bearing),
        column["s12_m"] * np.sin(bearing),
    )
    east = np.radians((np.degrees(lon) - column["lon2_RhumbSolve"] + 180.0) % 360.0 - 180.0) * globe.across_m(lat)
    north = (lat - np.radians(column["lat2_RhumbSolve"])) * globe.along_m(lat)
    assert np.hypot(east, north).max() < 1e-7


@pytest.mark.parametrize("grow_mps", [0.0, 3.7])
@pytest.mark.parametrize("earth", EarthModel)
def test_haven_agrees_with_fifty_digits(earth: EarthModel, grow_mps: float) -> None:
    globe = oracle.Globe.of(earth)
    cases = [(0, 0, 10, 0), (-20, 60, -35, 60 + 1e-9), (170, -50, -170, 20), (5, 80, 5, 84), (5, 30, 5 + 1e-8, 30)]
    for lon1, lat1, lon2, lat2 in cases:
        line = np.array([(lon1, lat1), (lon2, lat2)], dtype=float)
        track = Track("T", line, np.array([0, 10**10]), rectangle_outline_m(90e3, 40e3, 20e3, 70e3), grow_mps=grow_mps)
        with mp.workdps(30):
            precise = precise_legs(PreciseGlobe.of(earth), track)[0].ring(PreciseGlobe.of(earth), mpf(3333))
            fraction = np.array([0.3333])
            leg = oracle.legs(globe, track)[0]
            lon, lat = leg.vertices(globe, leg.outline_m, fraction)
            for k, (x, y) in enumerate(precise):
                error = mp.hypot(x - mpf(globe.a * lon[0, k]), y - mpf(globe.a * globe.isometric(lat[0, k])))
                assert error < 1e-7  # 1e-16 of the plane's coordinates, times the scale at 84 degrees


@pytest.mark.parametrize("known", scenes.known_scenes(), ids=lambda k: k.scene.name)
def test_known_answers(known: scenes.Known) -> None:
    found = oracle.meetings(known.scene, known.areas, known.tracks, care_m=20.0)
    for pair, expected in known.expected.items():
        intervals = found[pair].intervals_us
        assert len(intervals) == len(expected), pair
        for (start, end), (expected_start, expected_end) in zip(intervals, expected, strict=True):
            for got, want in ((start, expected_start), (end, expected_end)):
                if want is None:
                    assert np.isinf(got), pair
                else:
                    assert (got - scenes.T0_US) / 1e6 == pytest.approx(want, abs=1e-6), pair
    others = [pair for pair, m in found.items() if m.touches and pair not in known.expected]
    assert set(others) <= known.undecided


def test_least_separation_of_parallel_tracks_in_metres() -> None:
    """Side by side at 60 degrees, 2 km apart on the earth, twice as far in the plane."""
    globe = oracle.Globe.of(EarthModel.WGS84)
    north = np.degrees(globe.latitude_of_meridian(globe.meridian_m(np.radians(60.0)) + 4000.0))
    tracks = [
        scenes.track(key, [(0, lat), (3, lat)], [0, 7200], 1e3, 1e3, 1e3, 1e3)
        for key, lat in (("S", 60.0), ("N", north))
    ]
    found = oracle.meeting(Scene("s"), *tracks, care_m=1e4)
    assert not found.touches
    assert found.least_m == pytest.approx(2000.0, abs=1e-2)


def test_separation_wanted_is_measured_on_the_earth() -> None:
    """A haven that comes north along a meridian is within 5 km of an area 5 km before it touches it."""
    earth = EarthModel.WGS84
    low, high, edge = (scenes.meridian_m(earth, x) for x in (70.0, 72.0, 71.0))
    speed = (high - low) / 36000
    zone = scenes.area("A", shapely.box(-3, 71, 3, 71.2))
    moving = scenes.track("T", [(0, 70), (0, 72)], [0, 36000], 1e3, 1e3, 0.0, 0.0)
    found = oracle.meeting(Scene("s", earth=earth, separation_m=5000.0), zone, moving)
    start = found.intervals_us[0][0]
    # The nearest point of the parallel is the one due north, and the geodesic there is a meridian.
    assert (start - scenes.T0_US) / 1e6 == pytest.approx((edge - 5000 - 1000 - low) / speed, abs=0.01)


def dense(globe: oracle.Globe, edges: np.ndarray, count: int) -> np.ndarray:
    """Points all along edges in the plane, (2, n), longitude and latitude in degrees."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    xy = (edges[:, None, 0] + share * (edges[:, 1] - edges[:, 0])[:, None]).reshape(-1, 2) / globe.a
    return np.degrees([xy[:, 0], globe.latitude_of_isometric(xy[:, 1])])


def nearest_by_chord(globe: oracle.Globe, one: np.ndarray, two: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pairs of points whose chord is within 1 % of the least.

    The shortest geodesic is among them: up to 1,500 km a geodesic is less than 1 % longer than its chord.
    """
    chord = cdist(*(in_space(globe, *np.radians(points)) for points in (one, two)))
    assert chord.min() < 1.4e6
    i, j = np.nonzero(chord <= 1.01 * chord.min())
    return one[:, i], two[:, j]


def in_space(globe: oracle.Globe, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    """Places on the ellipsoid as (n, 3), metres from the centre of the earth."""
    normal = globe.a / np.sqrt(1.0 - globe.e2 * np.sin(lat) ** 2)
    across = normal * np.cos(lat)
    return np.stack([across * np.cos(lon), across * np.sin(lon), (1.0 - globe.e2) * normal * np.sin(lat)], axis=1)


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("lat", [-84.0, -30.0, 0.0, 55.0, 75.0])
def test_distance_on_the_earth_agrees_with_dense_geodesics(earth: EarthModel, lat: float) -> None:
    """At most the least geodesic between many points on the boundaries, and at least this minus their spacing."""
    globe, rng = oracle.Globe.of(earth), np.random.default_rng(int(abs(lat)))
    geodesic = Geod(a=globe.a, es=globe.e2)
    wide = 1.0 / np.cos(np.radians(lat))
    for size in (0.01, 0.1, 1.0):
        corners = [
            (x * wide, 0.0) + np.array([(0.0, lat)]) + rng.uniform(-1, 1, (7, 2)) * (size * wide, size)
            for x in (0.0, rng.uniform(2.1, 4) * size)
        ]
        hulls = [shapely.MultiPolygon([shapely.MultiPoint(xy).convex_hull]) for xy in corners]
        edges = [edges_of(oracle.plane(globe, hull, 0.0)) for hull in hulls]
        found = float(least_m(globe, edges[0][None], edges[1][None])[0])
        one, two = (dense(globe, e, 120) for e in edges)
        one, two = nearest_by_chord(globe, one, two)
        brute = geodesic.inv(*one, *two)[2].min()
        spacing = max(shapely.length(shapely.linestrings(e)).max() for e in edges) / 119
        assert found <= brute * (1 + 1e-9)
        assert found >= brute - spacing**2 / brute


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize(("south", "north"), [(60.0, 62.0), (-85.0, -80.0), (-3.0, 1.0), (10.0, 10.5)])
def test_a_strip_between_meridians_is_narrowest_nearer_the_pole(earth: EarthModel, south: float, north: float) -> None:
    globe = oracle.Globe.of(earth)
    zones = [scenes.area("A", shapely.box(0, south, 1, north)), scenes.area("B", shapely.box(1.5, south, 2.5, north))]
    polar = max(south, north, key=abs)
    geodesic = Geod(a=globe.a, es=globe.e2).inv(1.0, polar, 1.5, polar)[2]
    for around in ([0, 1], [1, 0]):
        found = oracle.meeting(Scene("s", earth=earth), *(zones[k] for k in around), care_m=1e6)
        assert found.least_m == pytest.approx(geodesic, rel=1e-12)


@pytest.mark.parametrize("digits", [20, 60])
@pytest.mark.parametrize("earth", EarthModel)
def test_precise_meridian_distance_is_the_elliptic_integral(earth: EarthModel, digits: int) -> None:
    with mp.workdps(digits):
        globe = PreciseGlobe.of(earth)
        for lat in map(mpf, ("0", "1e-9", "0.3", "-0.9", "1.5", "-1.57")):
            sin, cos = mp.sin(lat), mp.cos(lat)
            share = mp.ellipe(lat, globe.e2) - globe.e2 * sin * cos / mp.sqrt(1 - globe.e2 * sin**2)
            assert abs(globe.meridian_m(lat) - globe.a * share) < mpf(10) ** (8 - digits)


def touching(workload_seed: int) -> tuple[Scene, dict[str, Area | Track], dict[tuple[str, str], oracle.Meeting]]:
    """A random scene, its objects, and the meetings of its tracks with anything."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, workload_seed, 6, 6)
    meetings = oracle.meetings(scene, areas, tracks, 20.0)
    known = {thing.key: thing for thing in (*areas, *tracks)}
    return scene, known, {pair: m for pair, m in meetings.items() if m.touches and pair[1][0] == "T"}


def test_ends_are_between_contact_and_none() -> None:
    """In 25 digits the objects are apart 1e-7 s outside of an end that the oracle found, and touch 1e-7 s inside."""
    scene, known, found = touching(2)
    within = mpf(10) ** -7
    seen = 0
    for (a, b), meeting in list(found.items())[:2]:
        with mp.workdps(25):
            for start, end in meeting.intervals:
                for at, outward in ((start, -within), (end, within)):
                    outside = separation(scene, known[a], known[b], at + outward, meeting.epoch_us)
                    assert outside > 0  # inf: after a span
                    assert separation(scene, known[a], known[b], at - outward, meeting.epoch_us) == 0
                    seen += outside < mp.inf
    assert seen >= 3


@pytest.mark.slow
@pytest.mark.parametrize("workload_seed", [1, 2, 3])
def test_ends_agree_with_fifty_digits(workload_seed: int) -> None:
    scene, known, found = touching(workload_seed)
    for (a, b), meeting in list(found.items())[:8]:
        sharpened = refine(scene, known[a], known[b], meeting)
        for (start, end), (sharp_start, sharp_end) in zip(meeting.intervals, sharpened, strict=True):
            assert abs(sharp_start - start) < 1e-7
            assert abs(sharp_end - end) < 1e-7


def test_fifty_digits_distance_agrees_with_shapely() -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 5, 4, 3, EarthModel.SPHERE)
    for area in areas:
        for track in tracks:
            at_s = 1000.0
            epoch_us = int(track.times_us[0])
            globe = oracle.Globe.of(scene.earth)
            (one,) = oracle.phases(globe, area, 0.0)
            two = oracle.phases(globe, track, 0.0)[0]
            plane_m = shapely.distance(one.footprint, two.place(epoch_us, np.array([at_s]))[0])
            with mp.workdps(20):
                assert separation(scene, area, track, mpf(at_s), epoch_us) == pytest.approx(plane_m, abs=1e-6)


def test_a_least_separation_within_rounding_is_seen_as_such() -> None:
    """Distances on the earth are known to 1e-5 m; those in the plane, which are no shorter, to 1e-8 m."""
    area = Area("area", shapely.box(0.0, 60.0, 1.0, 61.0))
    start = (-1e-12, 60.5)
    away = Track("track", [start, (-1.0, 60.5)], [0, 3_600_000_000], [(0.0, 0.0)])
    meeting = oracle.meeting(Scene("s"), area, away)
    assert meeting.least_m == pytest.approx(np.radians(1e-12) * 6378137.0, rel=0.01)


def test_a_crossing_on_a_leg_of_months_is_seen() -> None:
    """A point crosses a line that creeps along for a year: brute force samples there as densely as requested."""
    day_us, start, month = 86_400_000_000, np.array([58.0, -37.0]), 30
    line = Track(
        "line",
        np.array([[63.5, -37.5], [60.6, -35.9]]),
        np.array([0, 335 * day_us]),
        np.array([[0.0, 3e5], [0.0, -2e5]]),
    )
    point = Track("point", np.array([start, [64.0, -36.9]]), np.array([month, 270]) * day_us, np.zeros((1, 2)))
    found = oracle.meeting(Scene("creep", earth=EarthModel.SPHERE), line, point, care_m=2.0)
    assert found.least_m < 1e-6


def test_recorded_answers_are_of_this_oracle() -> None:
    """Else the suite computes all of them: `./run python tests/support/recorded.py` records them again."""
    assert recorded.is_current()
