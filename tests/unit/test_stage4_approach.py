"""The closest approach: exact answers on the equator of the sphere, and brute force."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
import scenes
import shapely
import workloads
from scenes import RADIUS_M, T0_US

from conflictdb import Interference, solve
from conflictdb.model import Area, EarthModel, Scene, Track, Verdict

RADIUS = RADIUS_M[EarthModel.SPHERE]
DEGREE = np.radians(RADIUS)
SCENE = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0, nearest_m=5_000.0)
DIAMOND = scenes.area("A", shapely.Polygon([(0.5, 0.02), (0.55, 0.07), (0.5, 0.12), (0.45, 0.07)]))
# Distances that differ by less than 1e-7 m are equal: of a passage at 1 km and 3 m/s that is 5 milliseconds.
INSTANT_S = 6e-3


def ship(key: str, start: float, end: float, lat: float, half_m: tuple[float, float] = (100.0, 50.0)) -> Track:
    """An hour's way along a parallel, with a haven of this half length and half width."""
    along, across = half_m
    return scenes.track(key, [(start, lat), (end, lat)], [0, 3600], along, along, across, across)


def only(areas: list[Area], tracks: list[Track], scene: Scene = SCENE) -> Interference:
    (found,) = solve(tracks, areas, scene)
    return found


def at_s(found: Interference) -> float:
    assert found.closest_us is not None
    return (found.closest_us - T0_US) / 1e6


def great_circle_m(a_deg: tuple[float, float], b_deg: tuple[float, float]) -> float:
    (l1, p1), (l2, p2) = np.radians(a_deg), np.radians(b_deg)
    half = np.sin((p2 - p1) / 2) ** 2 + np.cos(p1) * np.cos(p2) * np.sin((l2 - l1) / 2) ** 2
    return float(2 * RADIUS * np.arcsin(np.sqrt(half)))


def sound(found: Interference, distance_m: float) -> None:
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
    assert (found.verdict, found.periods_us, found.first_contact_deg) == (Verdict.NEAR, (), None)
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
    """However early it comes closer than the separation wanted."""
    box = scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))
    found = only([box], [ship("b", 0.0, 1.0, 0.0)], replace(SCENE, separation_m=separation_m))
    assert found.verdict is Verdict.CONFLICT
    assert (found.closest_m, found.closest_error_m) == (0.0, 0.0)
    assert at_s(found) == pytest.approx((0.5 - 100.0 / DEGREE) * 3600, abs=1e-5)
    assert found.closest_a_deg == found.closest_b_deg
    assert found.closest_a_deg == pytest.approx((0.5, 0.0), abs=1e-3)
    if separation_m == 0.0:
        assert found.closest_us == found.periods_us[0][0]
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


@pytest.mark.parametrize("method", ["screen", "window"])
def test_methods_that_do_not_solve_tell_no_approach(method: str) -> None:
    pair = [ship("a", 0.0, 0.1, 0.0), ship("b", 0.1, 0.0, 0.0)]
    found = only([], pair, replace(SCENE, method=method))
    assert (found.closest_us, found.closest_m, found.closest_a_deg) == (None, None, None)
    assert solve([pair[0], ship("b", 0.1, 0.0, 0.02)], [], replace(SCENE, method=method)) == []


def test_method_nlp_tells_the_same_approach() -> None:
    pair = [ship("a", 0.0, 0.1, 0.0), ship("b", 0.1, 0.0, 0.01)]
    assert only([], pair, replace(SCENE, method="nlp")) == only([], pair)


def test_areas_stand_still() -> None:
    west = scenes.area("A", shapely.box(0.0, -0.01, 0.1, 0.01))
    east = scenes.area("B", shapely.box(0.12, -0.01, 0.2, 0.01), 600.0, 1200.0)
    found = only([west, east], [])
    # The shortest way is where meridians are closest: as far from the equator as both reach.
    sound(found, great_circle_m((0.1, 0.01), (0.12, 0.01)))
    assert at_s(found) == 600.0
    assert found.closest_a_deg == pytest.approx((0.1, 0.0), abs=0.0101)
    assert only([west, replace(east, start_us=None, end_us=None)], []).closest_us is None


def test_across_the_antimeridian() -> None:
    found = only([], [ship("a", 179.95, -179.95, 0.0), ship("b", -179.95, 179.95, 0.01)])
    sound(found, 0.01 * DEGREE - 100.0)
    assert found.closest_a_deg is not None
    assert abs(abs(found.closest_a_deg[0]) - 180.0) < 1e-3


slow = pytest.mark.slow  # the oracle looks closely at all that comes near


@pytest.mark.parametrize(
    ("workload", "seed", "objects", "near_m"),
    [
        (workloads.HIGH_LATITUDE, 3, 3, 50e3),
        pytest.param(workloads.PAPER, 3, 3, 50e3, marks=slow),
        *(
            pytest.param(workload, seed, 4, near_m, marks=slow)
            for workload, near_m in ((workloads.EQUATOR, 50e3), (workloads.SEAM, 50e3), (workloads.HARBOUR, 1e3))
            for seed in range(1, 5)
        ),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_random_scenes_against_brute_force(
    workload: workloads.Workload, seed: int, objects: int, near_m: float
) -> None:
    """None is missed, and the least distance lies within the stated bound."""
    scene, areas, tracks = workloads.throw(workload, seed, objects, objects)
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
