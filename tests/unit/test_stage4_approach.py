"""The closest approach: exact answers on the equator of the sphere, and brute force."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import layouts
import numpy as np
import oracle
import oracle_circle
import pytest
import scenes
import shapely
from kernel_planes import christoffel
from mixed_scenes import plain_scene
from oracle_motion import Globe
from pyproj import Geod
from scenes import FLATTENING, RADIUS_M, T0_US

from conflictdb import Conflict, solve
from conflictdb.earth.geodesy import earth_of
from conflictdb.earth.gnomonic import Gnomonic
from conflictdb.earth.mercator import Mercator
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import Area, EarthModel, Motion, Scene, Track
from conflictdb.model.results import Verdict

RADIUS = RADIUS_M[EarthModel.SPHERE]
DEGREE = np.radians(RADIUS)
SCENE = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0, nearest_m=5_000.0)
DIAMOND = scenes.area("A", shapely.Polygon([(0.5, 0.02), (0.55, 0.07), (0.5, 0.12), (0.45, 0.07)]))
T0 = datetime.fromtimestamp(T0_US // 1_000_000, UTC)
# Distances that differ by less than 1e-7 m are equal: of a passage at 1 km and 3 m/s that is 5 milliseconds.
INSTANT_S = 6e-3


def ship(key: str, start: float, end: float, lat: float, half_m: tuple[float, float] = (100.0, 50.0)) -> Track:
    """An hour's way along a parallel, with a haven of this half length and half width."""
    along, across = half_m
    return scenes.track(key, [(start, lat), (end, lat)], [0, 3600], along, along, across, across)


def only(areas: list[Area], tracks: list[Track], scene: Scene = SCENE) -> Conflict:
    (found,) = solve(tracks, areas, scene)
    return found


def at_s(found: Conflict) -> float:
    assert found.closest_at is not None
    return (found.closest_at - T0) / timedelta(seconds=1)


def great_circle_m(a_deg: tuple[float, float], b_deg: tuple[float, float]) -> float:
    (l1, p1), (l2, p2) = np.radians(a_deg), np.radians(b_deg)
    half = np.sin((p2 - p1) / 2) ** 2 + np.cos(p1) * np.cos(p2) * np.sin((l2 - l1) / 2) ** 2
    return float(2 * RADIUS * np.arcsin(np.sqrt(half)))


def sound(found: Conflict, distance_m: float) -> None:
    """The distance is right within its bound, a millimetre, and it is that of the points."""
    assert found.closest_m is not None
    assert found.closest_error_m is not None
    assert found.closest_a_deg is not None
    assert found.closest_b_deg is not None
    assert found.closest_m == pytest.approx(distance_m, abs=1e-4)
    assert 0.0 <= found.closest_error_m <= 1e-3
    assert great_circle_m(found.closest_a_deg, found.closest_b_deg) == pytest.approx(distance_m, abs=1e-4)


def test_head_on_ships_are_closest_when_their_bows_are_abreast() -> None:
    found = only([], [ship("a", 0.0, 0.1, 0.0), ship("b", 0.1, 0.0, 0.01)])
    assert (found.verdict, found.periods, found.first_contact_deg) == (Verdict.NEAR, (), None)
    sound(found, 0.01 * DEGREE - 100.0)
    bows = 100.0 / DEGREE * (1.0 + 1.0 / np.cos(np.radians(0.01)))
    assert at_s(found) == pytest.approx((0.1 - bows) / (0.2 / 3600), abs=INSTANT_S)


def test_parallel_ships_are_closest_from_the_start() -> None:
    found = only([], [ship("a", 0.0, 0.1, 0.0), ship("b", 0.0, 0.1, 0.01)])
    sound(found, 0.01 * DEGREE - 100.0)
    assert at_s(found) == 0.0


def test_overtaking_ship_is_closest_when_its_bow_reaches_the_stern() -> None:
    found = only([], [ship("a", 0.0, 0.2, 0.0), ship("b", 0.05, 0.15, 0.01)])
    sound(found, 0.01 * DEGREE - 100.0)
    way = 0.05 - 100.0 / DEGREE * (1.0 + 1.0 / np.cos(np.radians(0.01)))
    assert at_s(found) == pytest.approx(way / (0.1 / 3600), abs=INSTANT_S)


def test_vessel_that_passes_a_corner() -> None:
    found = only([DIAMOND], [ship("b", 0.0, 1.0, 0.0, (0.0, 0.0))])
    sound(found, 0.02 * DEGREE)
    assert at_s(found) == pytest.approx(1800.0, abs=INSTANT_S)
    assert found.closest_a_deg == pytest.approx((0.5, 0.02), abs=1e-6)
    assert found.closest_b_deg == pytest.approx((0.5, 0.0), abs=1e-6)


def test_closest_at_the_end_of_the_time_that_both_share() -> None:
    found = only([DIAMOND], [ship("b", 0.0, 0.49, 0.0, (0.0, 0.0))])
    sound(found, great_circle_m((0.49, 0.0), (0.5, 0.02)))
    assert at_s(found) == pytest.approx(3600.0, abs=INSTANT_S)


def test_of_two_passages_as_close_the_first_counts() -> None:
    there_and_back = scenes.track("b", [(0.0, 0.0), (1.0, 0.0), (0.0, 0.0)], [0, 3600, 7200], 0, 0, 0, 0)
    found = only([DIAMOND], [there_and_back])
    sound(found, 0.02 * DEGREE)
    assert at_s(found) == pytest.approx(1800.0, abs=INSTANT_S)


def test_closer_than_the_separation_wanted_but_never_touching() -> None:
    scene = replace(SCENE, separation_m=3000.0, nearest_m=0.0)
    found = only([DIAMOND], [ship("b", 0.0, 1.0, 0.0, (0.0, 0.0))], scene)
    assert found.verdict is Verdict.CONFLICT
    sound(found, 0.02 * DEGREE)
    assert at_s(found) == pytest.approx(1800.0, abs=INSTANT_S)


@pytest.mark.parametrize("separation_m", [0.0, 2000.0])
def test_pair_that_touches_is_closest_at_the_first_touch(separation_m: float) -> None:
    """However early it comes closer than the required separation."""
    box = scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))
    found = only([box], [ship("b", 0.0, 1.0, 0.0)], replace(SCENE, separation_m=separation_m))
    assert found.verdict is Verdict.CONFLICT
    assert (found.closest_m, found.closest_error_m) == (0.0, 0.0)
    assert at_s(found) == pytest.approx((0.5 - 100.0 / DEGREE) * 3600, abs=1e-5)
    assert found.closest_a_deg == found.closest_b_deg
    assert found.closest_a_deg == pytest.approx((0.5, 0.0), abs=1e-3)
    if separation_m == 0.0:
        assert found.closest_at == found.first_contact
        assert found.closest_a_deg == found.first_contact_deg


def test_first_of_two_touches_counts_also_where_the_separation_holds_in_between() -> None:
    teeth = [scenes.area(key, shapely.box(w, -0.1, w + 0.01, 0.1)) for key, w in (("A", 0.5), ("B", 0.53))]
    comb = Area("A", shapely.MultiPolygon([part for tooth in teeth for part in tooth.footprint.geoms]))
    found = only([comb], [ship("b", 1.0, 0.0, 0.0)], replace(SCENE, separation_m=5000.0))
    assert found.closest_m == 0.0
    assert at_s(found) == pytest.approx((1.0 - 0.54 - 100.0 / DEGREE) * 3600, abs=1e-5)


def test_pairs_further_apart_than_asked_are_not_reported() -> None:
    pair = [ship("a", 0.0, 0.1, 0.0), ship("b", 0.1, 0.0, 0.01)]
    assert solve(pair, [], replace(SCENE, nearest_m=1000.0)) == []
    assert solve(pair, [], replace(SCENE, nearest_m=0.0)) == []
    assert len(solve(pair, [], replace(SCENE, nearest_m=1020.0))) == 1


def test_ships_in_each_others_wake_are_reported_only_as_near_as_asked() -> None:
    """They pass the same places, but never nearer than 0.05 degrees less their lengths."""
    pair = [ship("a", 0.0, 0.2, 0.0), ship("b", 0.05, 0.25, 0.0)]
    apart_m = 0.05 * DEGREE - 200.0
    assert solve(pair, [], replace(SCENE, nearest_m=1000.0)) == []
    assert solve(pair, [], replace(SCENE, nearest_m=apart_m - 0.01)) == []
    sound(only([], pair, replace(SCENE, nearest_m=apart_m + 0.01)), apart_m)


def test_less_than_a_metre_is_near() -> None:
    half_m = 0.5 * (0.01 * DEGREE - 0.3)
    pair = [ship(key, 0.0, 0.1, lat, (100.0, half_m)) for key, lat in (("a", 0.0), ("b", 0.01))]
    sound(only([], pair, replace(SCENE, nearest_m=0.5)), 0.3)
    assert solve(pair, [], replace(SCENE, nearest_m=0.2)) == []


def test_a_method_that_does_not_solve_tells_no_approach() -> None:
    pair = [ship("a", 0.0, 0.1, 0.0), ship("b", 0.1, 0.0, 0.0)]
    found = only([], pair, replace(SCENE, method="screen"))
    assert (found.closest_at, found.closest_m, found.closest_a_deg) == (None, None, None)
    assert solve([pair[0], ship("b", 0.1, 0.0, 0.02)], [], replace(SCENE, method="screen")) == []


def test_method_nlp_tells_the_same_approach() -> None:
    pair = [ship("a", 0.0, 0.1, 0.0), ship("b", 0.1, 0.0, 0.01)]
    found, expected = only([], pair, replace(SCENE, method="nlp")).approach, only([], pair).approach
    assert found is not None
    assert expected is not None
    assert replace(found, method=expected.method) == expected


def test_areas_stand_still() -> None:
    west = scenes.area("A", shapely.box(0.0, -0.01, 0.1, 0.01))
    east = scenes.area("B", shapely.box(0.12, -0.01, 0.2, 0.01), 600.0, 1200.0)
    found = only([west, east], [])
    # The shortest way is where meridians are closest: as far from the equator as both reach.
    sound(found, great_circle_m((0.1, 0.01), (0.12, 0.01)))
    assert at_s(found) == 600.0
    assert found.closest_a_deg == pytest.approx((0.1, 0.0), abs=0.0101)
    assert only([west, replace(east, start_us=None, end_us=None)], []).closest_at is None


def test_across_the_antimeridian() -> None:
    found = only([], [ship("a", 179.95, -179.95, 0.0), ship("b", -179.95, 179.95, 0.01)])
    sound(found, 0.01 * DEGREE - 100.0)
    assert found.closest_a_deg is not None
    assert abs(abs(found.closest_a_deg[0]) - 180.0) < 1e-3


def far_pair(seed: int) -> tuple[Area, Track]:
    """An area and a haven, 50 to 500 km across, that pass at hundreds of kilometres between 40 and 70 degrees."""
    rng = np.random.default_rng(seed)
    lat = rng.uniform(45.0, 65.0)
    wide = 1.0 / np.cos(np.radians(lat))
    turns = np.arange(6) * np.pi / 3.0 + rng.uniform(0.0, 0.5, 6)
    size = rng.uniform(0.5, 2.2)
    corners = [(size * wide * np.cos(turn), lat + size * np.sin(turn)) for turn in turns]
    start = (wide * rng.uniform(6.0, 9.0), lat + rng.uniform(-5.0, -1.0))
    end = (wide * rng.uniform(6.0, 9.0), lat + rng.uniform(1.0, 5.0))
    haven = rng.uniform(25e3, 250e3, 4)
    return scenes.area("A", shapely.Polygon(corners)), scenes.track("b", [start, end], [0, 36_000], *haven)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("motion", "earth"), [("rhumb", "wgs84"), ("rhumb", "sphere"), ("great_circle", "sphere")], ids=str
)
def test_large_polygons_far_apart_are_known_to_a_millimetre(motion: str, earth: str, seed: int) -> None:
    """The error left by the search; at no instant are they nearer than the bound allows, by brute force."""
    area, track = far_pair(seed)
    centre = (5.0, 55.0) if motion == "great_circle" else None
    scene = Scene("s", motion=Motion(motion), earth=EarthModel(earth), tolerance_m=0.0, nearest_m=2e6, centre=centre)
    found = only([area], [track], scene)
    assert found.closest_m is not None
    assert found.closest_m > 50e3
    assert found.closest_error_m is not None
    assert found.closest_error_m <= 1e-3 + float(Setup.of(scene).plane.distance_error_m(found.closest_m)) + 1e-6

    if centre is not None:
        chart = oracle_circle.Chart.at(*centre)
        (a,), (b,) = (oracle_circle.phases(chart, thing) for thing in (area, track))
        gap = oracle_circle.Gap(a, b, T0_US, 0.0)
    else:
        globe = Globe.of(scene.earth)
        (a,), (b,) = (oracle.phases(globe, thing, 0.0) for thing in (area, track))
        gap = oracle.Gap(a, b, T0_US, 0.0, np.inf, on_earth=True)
    # A chord through the ellipsoid is not least exactly where a geodesic is.
    allowed_m = 1e-6 + (1e-18 * found.closest_m**3 if earth == "wgs84" else 0.0)
    then = at_s(found)
    around = then + np.concatenate([[0.0], np.outer([-1.0, 1.0], np.geomspace(1.0, 2e4, 8)).ravel()])
    seconds = np.concatenate([np.linspace(0.0, 36_000.0, 12), around[(around >= 0.0) & (around <= 36_000.0)]])
    true_m = gap(seconds)
    assert true_m.min() >= found.closest_m - found.closest_error_m - 1e-6
    assert gap(np.array([then]))[0] == pytest.approx(found.closest_m, abs=found.closest_error_m + allowed_m)


@pytest.mark.parametrize("name", ["wgs84", "sphere", "great_circle"])
def test_lines_of_the_plane_bend_no_more_than_stated(name: str) -> None:
    """The distance of two points that are even in the plane sags below its chord by no more than follows from it."""
    rng = np.random.default_rng(3)
    earth = EarthModel.SPHERE if name == "great_circle" else EarthModel(name)
    geod = Geod(a=RADIUS_M[earth], f=FLATTENING[earth])
    plane = Gnomonic(0.0, 0.0) if name == "great_circle" else Mercator(earth_of(earth))
    n = 5000
    size_m, furthest_m = 10 ** rng.uniform(2, 7, n), 7.5e6 if name == "great_circle" else 1.5e7
    a = rng.uniform(-1.0, 1.0, (2, n)) * furthest_m
    b = a + rng.uniform(-1.0, 1.0, (2, n)) * size_m
    a_step, b_step = (rng.uniform(-3e-3, 3e-3, (2, n)) * size_m for _ in range(2))
    a_step[:, ::3], a_step[:, 1::3] = b_step[:, ::3], 0.0
    # Where lines bend most: along a parallel, seen from its meridian; and straight at a place further from the centre.
    if name == "great_circle":
        a[:, 1::3] = b[:, 1::3] * rng.uniform(1.0, 3.0, len(a[0, 1::3]))
        b_step[:, 1::3] = 1e-3 * b[:, 1::3]
    else:
        a[:, 1::3] = b[:, 1::3] * np.stack([np.ones(len(a[0, 1::3])), rng.uniform(-0.5, 0.5, len(a[0, 1::3]))])
        b_step[1, 1::3] = 0.0

    def apart_m(part: float) -> np.ndarray:
        (lon1, lat1), (lon2, lat2) = (plane.from_plane(*(at + part * by)) for at, by in ((a, a_step), (b, b_step)))
        return np.asarray(geod.inv(lon1, lat1, lon2, lat2)[2])

    first, middle, last = (apart_m(part) for part in (-1.0, 0.0, 1.0))
    tracks = [np.stack([at - step, at + step], axis=1) for at, step in ((a, a_step), (b, b_step))]
    # Half of the way on the earth, and the change of speed on it.
    speeds = [0.51 * geod.inv(*plane.from_plane(*track[:, 0]), *plane.from_plane(*track[:, 1]))[2] for track in tracks]
    upward = (speeds[0] + speeds[1]) ** 2 / (middle - speeds[0] - speeds[1])
    for speed, track in zip(speeds, tracks, strict=True):
        upward += np.array([christoffel(plane, scale) for scale in plane.largest_scale(track)]) * speed**2
    sags = 0.5 * (first + last) - middle
    assert (sags <= 0.5 * upward + 1e-7).all()
    assert (sags / upward)[sags > 1e-3].max() > 0.45, "a bound that is of use"


slow = pytest.mark.slow  # the oracle looks closely at all that comes near


@pytest.mark.parametrize(
    ("workload", "seed", "objects", "near_m"),
    [
        (layouts.HIGH_LATITUDE, 3, 3, 50e3),
        pytest.param(layouts.LOW_LATITUDE, 3, 3, 50e3, marks=slow),
        *(
            pytest.param(workload, seed, 4, near_m, marks=slow)
            for workload, near_m in ((layouts.EQUATOR, 50e3), (layouts.SEAM, 50e3), (layouts.HARBOUR, 1e3))
            for seed in range(1, 5)
        ),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_random_scenes_against_brute_force(workload: layouts.Workload, seed: int, objects: int, near_m: float) -> None:
    """None is missed, and the least distance lies within the stated bound."""
    scene, areas, tracks = plain_scene(workload, seed, objects, objects)
    scene = replace(scene, nearest_m=near_m)
    found = {(one.a_key, one.b_key): one for one in solve(tracks, areas, scene)}
    for pair, meeting in oracle.meetings(scene, areas, tracks, care_m=8.0 * near_m).items():
        if pair not in found:
            assert meeting.least_m > near_m - 2e-3
            continue
        one = found[pair]
        assert one.closest_m is not None
        assert one.closest_error_m is not None
        assert one.closest_error_m <= 1e-4 * one.closest_m + 0.01
        allowed = 2e-3 + 1e-6 * one.closest_m
        assert one.closest_m - one.closest_error_m - allowed <= meeting.least_m <= one.closest_m + allowed
    assert sum(one.verdict is Verdict.NEAR for one in found.values()) >= 2, "pairs that tell nothing"


@pytest.mark.parametrize("tolerance_m", [50.0, 200.0])
def test_what_is_near_to_the_tolerance_is_as_near_as_a_search_of_all_the_time_finds(
    tolerance_m: float,
) -> None:
    """Within the errors of both, also with a separation; distances of pairs apart are known to the tolerance."""
    compared = 0
    for seed, separation_m in ((0, 0.0), (1, 0.0), (2, 3.0 * tolerance_m)):
        scene, areas, tracks = plain_scene(layouts.HARBOUR, seed, 6, 6)
        near = replace(scene, tolerance_m=0.0, nearest_m=separation_m + 2.0 * tolerance_m)
        fine = {(one.a_key, one.b_key): one for one in solve(tracks, areas, near)}
        for one in solve(tracks, areas, replace(scene, tolerance_m=tolerance_m, separation_m=separation_m)):
            other = fine[one.a_key, one.b_key]
            assert one.closest_m is not None
            assert one.closest_error_m is not None
            assert other.closest_m is not None
            assert other.closest_error_m is not None
            within = one.closest_error_m + other.closest_error_m + 1e-6
            assert abs(one.closest_m - other.closest_m) <= within
            assert one.closest_error_m <= tolerance_m + 1e-3
            compared += one.closest_m > 0.0
    assert compared > 5
