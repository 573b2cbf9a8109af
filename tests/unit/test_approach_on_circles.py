"""The closest approach on great circles: the nearest points of the plane are not those of the earth."""

import numpy as np
import oracle_circle
import pytest
import scenes
import shapely
from draws import draws
from layouts import ARCTIC, GROWING_CIRCLES, OCEAN, Workload
from mixed_scenes import plain_scene

from conflictdb import solve
from conflictdb.earth.geodesy import MEAN_RADIUS_M as RADIUS_M
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import Area, Motion, Scene, Track
from conflictdb.model.results import Verdict

FAR = Scene("s", Motion.GREAT_CIRCLE, tolerance_m=0.0, nearest_m=50_000.0, centre=(0.0, 0.0))


def apart_m(a_deg: tuple[float, float], b_deg: tuple[float, float]) -> float:
    a, b = oracle_circle.space(np.array([a_deg, b_deg]))
    return float(2.0 * RADIUS_M * np.arcsin(np.linalg.norm(a - b) / 2.0))


@pytest.mark.parametrize("half_deg", [0.1, 1e-4, 1e-8])
def test_a_point_is_closest_to_the_foot_of_its_perpendicular_on_the_earth(half_deg: float) -> None:
    """On a slanted side 55 degrees out, where the plane stretches outward 1.7 times as much as across.

    Also a millimetre away, where a conformal plane would suffice.
    """
    size = half_deg / 2.0
    area = scenes.area("A", shapely.Polygon([(55.0, -half_deg), (55.0 + half_deg, 0.0), (55.0, half_deg)]))
    # Off the middle of the side from east to north, square to it.
    a, b = oracle_circle.space(np.array([(55.0 + half_deg, 0.0), (55.0, half_deg)]))
    pole = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    foot = (a + b) / np.linalg.norm(a + b)
    way = np.radians(size)
    place = np.cos(way) * foot + np.sin(way) * pole * np.sign(pole @ np.array([0.0, 0.0, 1.0]))
    point = (float(np.degrees(np.arctan2(place[1], place[0]))), float(np.degrees(np.arcsin(place[2]))))
    moored = scenes.track("T", [point, point], [0, 3600], 0.0, 0.0, 0.0, 0.0)
    (found,) = solve([moored], [area], FAR)
    assert found.verdict is Verdict.NEAR
    assert found.closest_m is not None
    assert found.closest_a_deg is not None
    assert found.closest_b_deg is not None
    distance = way * RADIUS_M
    assert found.closest_m == pytest.approx(distance, rel=1e-6, abs=2e-8)
    assert apart_m(found.closest_a_deg, found.closest_b_deg) == pytest.approx(distance, rel=1e-6, abs=5e-8)
    assert np.linalg.norm(oracle_circle.space(np.array(found.closest_a_deg)) - foot) * RADIUS_M < 1e-3 * distance + 1e-7
    # The nearest place in the plane is another one.
    plane = Setup.of(FAR).plane
    flat = np.stack(plane.to_plane(*np.array([(55.0 + half_deg, 0.0), (55.0, half_deg), point]).T), axis=1)
    line, at = shapely.LineString(flat[:2]), shapely.Point(flat[2])
    beside = line.interpolate(line.project(at))
    lon, lat = plane.from_plane(np.array([beside.x]), np.array([beside.y]))
    assert apart_m((float(lon[0]), float(lat[0])), point) > 1.02 * distance


@pytest.mark.parametrize("workload", [OCEAN, ARCTIC, GROWING_CIRCLES], ids=lambda one: one.name)
@draws("scenes", 1, 5)
def test_brute_force_comes_as_close_and_no_closer(workload: Workload, scenes: int) -> None:
    """Up to 100 km; reported points lie on both objects' ways, at the reported distance."""
    compared = 0
    for seed in range(3, 3 + scenes):
        scene, areas, tracks = plain_scene(workload, seed, 2, 3, tolerance_m=0.0)
        scene = Scene("s", scene.motion, centre=scene.centre, tolerance_m=0.0, nearest_m=1e5)
        things: dict[str, Area | Track] = {x.key: x for x in (*areas, *tracks)}
        for found in solve(tracks, areas, scene):
            if found.verdict is not Verdict.NEAR:
                continue
            assert found.closest_m is not None
            assert found.closest_error_m is not None
            assert found.closest_a_deg is not None
            assert found.closest_b_deg is not None
            meeting = oracle_circle.meeting(scene, things[found.a_key], things[found.b_key], care_m=2e5)
            assert not meeting.touches
            # Brute force never sees less than the least, and hardly more where it samples densely.
            assert found.closest_m - found.closest_error_m <= meeting.least_m + 1e-4
            assert found.closest_m <= meeting.least_m + 1e-3 + found.closest_error_m
            assert apart_m(found.closest_a_deg, found.closest_b_deg) == pytest.approx(found.closest_m, abs=1e-3)
            compared += 1
    assert compared > 0
