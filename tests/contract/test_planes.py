"""The contract of every plane (`motion.contract.Plane`): valid places, scales, and distances.

Bounds are compared with geodesics (pyproj) between any valid places: side by side or on the other side of the earth,
across the seam, at the rim.
"""

from typing import Final

import kernel_planes
import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st
from implementations import MOTIONS, MotionRow, Place, every_motion, for_every_motion, near, places_apart

from conflictdb.earth.plane import ROUNDING_ALLOWANCE_M, padding_m
from conflictdb.earth.registry import PLANES
from conflictdb.model.plans import Motion

# Rounding error of coordinates in the plane, metres on the earth.
ROUNDING_M: Final = 5e-8
# Rounding error of a difference of distances over a step and back.
STEP_M: Final = 30.0
RATE_ROUNDING: Final = 2 * ROUNDING_M / STEP_M
# Further apart, the geodesic may jump to another way with the next step, and distances do not change evenly.
FURTHEST_M: Final = 18_000_000.0
# The last digit of a scale of 1; it is even about where it is least, so that the way from there has half the digits.
SCALE_ROUNDING: Final = 1e-15
WAY_ROUNDING: Final = 3e-8

bearings = st.floats(0, 360) | st.sampled_from([0.0, 90.0, 180.0, 270.0])
sizes = st.floats(0, 6.6).map(lambda power: 10.0**power)


def of_places(row: MotionRow) -> st.SearchStrategy[Place]:
    return row.places


def scale_at(row: MotionRow, place: Place, bearing: float) -> float:
    """Plane metres per metre on the earth at a place, on the way that has this bearing."""
    ends = [row.geod.fwd(*place, bearing + turn, 1.0)[:2] for turn in (0.0, 180.0)]
    (x1, y1), (x2, y2) = (row.xy(near(place, end)).ravel() for end in ends)
    return float(np.hypot(x2 - x1, y2 - y1)) / 2.0


def test_every_motion_has_a_plane_and_is_held_to_this_contract() -> None:
    assert set(PLANES) == set(Motion) == {row.scene.motion for row in MOTIONS.values()}


@for_every_motion(of_places)
def test_plane_and_back(row: MotionRow, place: Place) -> None:
    xy = row.xy(place).ravel()
    scale = row.plane.largest_scale(xy.reshape(2, 1, 1)).item()
    assert np.hypot(*(xy - row.oracle.project(*np.array(place)[:, None])[0])) <= 3e-8 + ROUNDING_M * scale
    lon, lat = row.plane.from_plane(*xy)
    assert row.geod.inv(*place, float(lon), float(lat))[2] <= ROUNDING_M
    assert not row.has_seam or lon == pytest.approx(place[0], abs=1e-12)
    x, y, holds = row.plane.project(*np.array(place)[:, None])
    assert [*x, *y, *holds] == [*xy, row.plane.holds(*np.array(place)[:, None])]


@for_every_motion(of_places)
def test_a_turn_of_longitude(row: MotionRow, place: Place) -> None:
    """Leads to the same place of a plane without a seam, and a turn further in a plane with a seam."""
    assert (row.plane.turn_m > 0.0) == row.has_seam
    one, other = row.xy(place), row.xy((place[0] - 360.0, place[1]))
    np.testing.assert_allclose(one - other, [[row.plane.turn_m], [0.0]], atol=1e-7)


@for_every_motion(of_places, lambda row: bearings)
def test_places_are_accepted_up_to_the_limit(row: MotionRow, place: Place, bearing: float) -> None:
    lon, lat = np.array(place)[:, None]
    assert row.plane.holds(lon, lat).all()
    far = np.array(row.geod.fwd(*place, bearing, 1e7)[:2])[:, None]
    for lon, lat in (far, np.array(place)[:, None]):
        beyond = float(row.beyond_deg(lon, lat)[0])
        if abs(beyond) > 1e-8:
            assert row.plane.holds(lon, lat)[0] == (beyond < 0.0)


@every_motion
def test_nothing_is_accepted_that_is_no_place(row: MotionRow) -> None:
    nan = np.array([np.nan])
    assert not row.plane.holds(nan, nan).any()
    assert not row.plane.project(nan, nan)[2].any()
    assert all((row.plane.lines, row.plane.limit, row.plane.haven_limit))


@for_every_motion(places_apart)
def test_courses(row: MotionRow, places: tuple[Place, Place]) -> None:
    """Lengths and bearings as the oracle has them."""
    start, end = places
    if not row.has_seam:
        end = near(start, end)
    length, first, last = (value[0] for value in row.plane.courses(*(np.array([at]) for at in (start, end))))
    expected = row.oracle.course(start, end)
    assert length == pytest.approx(expected[0], rel=1e-9, abs=1e-7)
    # Opposite places have several shortest ways, and places side by side too few digits for a course.
    if 1.0 < length < FURTHEST_M and max(abs(start[1]), abs(end[1])) < 89.9999:
        for found, true in ((first, expected[1]), (last, expected[2])):
            turned = (found - true + 180.0) % 360.0 - 180.0
            assert abs(np.radians(turned)) * min(length, 1e5) <= 1e-5


@for_every_motion(of_places)
def test_there_is_no_way_from_a_place_to_itself(row: MotionRow, place: Place) -> None:
    at = np.array([place])
    assert row.plane.courses(at, at)[0][0] == 0.0
    if not row.has_seam:
        # The longitude of this place has lost a digit.
        assert row.plane.courses(at, at + np.array([[360.0, 0.0]]))[0][0] <= ROUNDING_M


@for_every_motion(of_places, lambda row: st.lists(bearings, min_size=1, max_size=8))
def test_scales_are_the_largest_and_the_smallest_in_any_direction(
    row: MotionRow, place: Place, directions: list[float]
) -> None:
    assume(abs(place[1]) < 89.999)  # where pyproj's bearings are of use
    point = row.xy(place)[:, :, None]
    largest, smallest = float(row.plane.largest_scale(point)[0]), float(row.plane.smallest_scale(point)[0])
    assert 1.0 - SCALE_ROUNDING <= smallest <= largest
    found = [scale_at(row, place, bearing) for bearing in (*directions, *np.linspace(0.0, 178.0, 90))]
    # A degree off the direction where it is largest, it is less by a share of 1.5e-4 at most.
    slack = 1e-6
    assert smallest * (1.0 - slack) <= min(found) <= smallest * (1.0 + 1e-3)
    assert largest * (1.0 - 1e-3) <= max(found) <= largest * (1.0 + slack)
    if row.plane.is_conformal:
        assert max(found) - min(found) <= 2.0 * slack * largest


@for_every_motion(of_places, lambda row: st.lists(st.tuples(bearings, sizes), min_size=1, max_size=4))
def test_scales_of_a_polygon_are_those_of_all_its_points(
    row: MotionRow, place: Place, corners: list[tuple[float, float]]
) -> None:
    others = [near(place, row.geod.fwd(*place, bearing, size)[:2]) for bearing, size in corners]
    points = row.xy(place, *(at for at in others if row.beyond_deg(*np.array(at)) <= 0.0))
    mix = np.random.default_rng(1).dirichlet(np.full(points.shape[1], 0.5), 40).T
    inside = np.concatenate([points, points @ mix], axis=1)[:, None, :]
    largest, smallest = (scale(points[:, :, None])[0] for scale in (row.plane.largest_scale, row.plane.smallest_scale))
    # The scale is convex along straight lines: a corner has the largest.
    assert row.plane.largest_scale(inside).max() <= largest * (1.0 + 1e-12)
    assert largest <= row.plane.largest_scale(points[:, None, :]).max() * (1.0 + 1e-12)
    assert 1.0 - SCALE_ROUNDING <= smallest <= row.plane.smallest_scale(inside).min() * (1.0 + 1e-12)


@for_every_motion(places_apart)
def test_distances_and_spans_bound_each_other(row: MotionRow, places: tuple[Place, Place]) -> None:
    """`span_m`, also half of it at the scale of each end, `plane_least_m`, and the padding of hulls."""
    one, other = places[0], near(*places) if row.has_seam else places[1]
    a, b = row.xy(one), row.xy(other)
    distance, span = row.geod.inv(*one, *other)[2], float(np.hypot(*(b - a))[0])
    plane, scales = row.plane, [row.plane.largest_scale(xy[:, :, None]) for xy in (a, b)]
    scale = np.maximum(*scales)
    rounding = 3e-8 + ROUNDING_M * float(scale[0])
    assert span <= plane.span_m(distance, scale)[0] + rounding
    assert kernel_planes.span_m(plane, distance, scale[0]) == pytest.approx(plane.span_m(distance, scale)[0], rel=1e-12)
    assert span <= 0.5 * sum(plane.span_m(distance, s)[0] for s in scales) + rounding
    # On the other side of the earth an arcsine is taken next to 1, where it has half the digits: up to 0.1 m.
    half = 0.5 * distance / row.geod.a
    assert kernel_planes.least_m(plane, span, scale[0]) <= distance + ROUNDING_M + row.geod.a * 4e-16 / max(
        np.cos(half), 3e-8
    )
    pads = [padding_m(plane, s, distance)[0] for s in scales]
    assert span <= sum(pads)
    assert min(pads) >= ROUNDING_ALLOWANCE_M


@for_every_motion(places_apart, lambda row: bearings)
def test_two_places_are_no_farther_apart_along_a_vector_than_both_halves(
    row: MotionRow, places: tuple[Place, Place], bearing: float
) -> None:
    """Halves of their distance; a place between has a half no larger than interpolated, as halves are convex."""
    one, other = places[0], near(*places) if row.has_seam else places[1]
    a, b = row.xy(one).ravel(), row.xy(other).ravel()
    distance = row.geod.inv(*one, *other)[2]
    scale = max(float(row.plane.largest_scale(xy.reshape(2, 1, 1))[0]) for xy in (a, b))
    rounding = 3e-8 + ROUNDING_M * scale
    for along in (
        np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing))]),
        (b - a) / max(float(np.hypot(*(b - a))), 1e-300),
    ):
        halves = [kernel_planes.half_m(row.plane, distance, at, along, scale) for at in (a, b)]
        assert along @ (b - a) <= sum(halves) + rounding
        for share in (0.25, 0.5, 0.75):
            between = kernel_planes.half_m(row.plane, distance, a + share * (b - a), along, scale)
            assert between <= (halves[0] + share * (halves[1] - halves[0])) * (1.0 + 1e-12)


# Relative error of the scale as a bound for nearby places.
NEARLY: Final = 0.01


@for_every_motion(of_places)
def test_bounds_on_spans_are_of_use(row: MotionRow, place: Place) -> None:
    """For places a kilometre apart they are a kilometre at that scale, up to a hundredth."""
    scale = row.plane.largest_scale(row.xy(place)[:, :, None])
    assert row.plane.span_m(1000.0, scale)[0] <= 1000.0 * scale[0] * (1.0 + NEARLY)
    assert kernel_planes.least_m(row.plane, 1000.0 * scale[0], scale[0]) >= 1000.0 * (1.0 - NEARLY)


def rate_and_bound(row: MotionRow, places: tuple[Place, Place], bearing: float) -> tuple[float, float, float]:
    """How fast a distance changes when both places move alike in the plane, plane m/s; its bound; its rounding."""
    plane = row.plane
    a, b = (row.xy(place) for place in places)
    v = np.array([[np.sin(np.radians(bearing))], [np.cos(np.radians(bearing))]])
    scales = [float(plane.largest_scale(xy[:, :, None])[0]) for xy in (a, b)]
    # A step of at least this many metres on the earth; where the scale varies it varies little along the step.
    step = STEP_M * max(scales)
    (before, middle, after) = (float(row.apart_m(a + way * v, b + way * v)[0]) for way in (-step, 0.0, step))
    points = np.concatenate([xy + way * v for xy in (a, b) for way in (-step, step)], axis=1)
    scale = plane.largest_scale(points[:, :, None])
    bound = kernel_planes.drift(plane, max(before, middle, after), scale[0], 1.0)
    rounding = RATE_ROUNDING + WAY_ROUNDING * middle / row.geod.a
    return abs(after - before) / (2.0 * step) * float(scale[0]), float(bound), rounding


@for_every_motion(places_apart, lambda row: bearings)
def test_distances_of_what_moves_alike_change_no_faster_than_bounded(
    row: MotionRow, places: tuple[Place, Place], bearing: float
) -> None:
    assume(row.geod.inv(*places[0], *places[1])[2] < FURTHEST_M)
    rate, bound, rounding = rate_and_bound(row, places, bearing)
    assert rate <= bound * (1.0 + 1e-6) + rounding


@for_every_motion(places_apart)
def test_distances_grow_fastest_near_the_way_in_the_plane(row: MotionRow, places: tuple[Place, Place]) -> None:
    """No further off than the kernel's `plane_slant`: the gradient of the distance from a place, by differences."""
    one, other = places[0], near(*places) if row.has_seam else places[1]
    distance = row.geod.inv(*one, *other)[2]
    assume(1e3 < distance < FURTHEST_M)
    angle, bound = turned_and_bound(row, one, other)
    assert angle <= bound * (1.0 + 1e-3) + 1e-6 + 4.0 * ROUNDING_M / (1e-3 * distance)


def turned_and_bound(row: MotionRow, one: Place, other: Place) -> tuple[float, float]:
    plane, a, b = row.plane, row.xy(one), row.xy(other)
    distance = row.geod.inv(*one, *other)[2]
    scale = max(float(plane.largest_scale(xy[:, :, None])[0]) for xy in (a, b))
    step = 1e-3 * distance
    gradient = np.array(
        [float(row.apart_m(a, b + step * way)[0] - row.apart_m(a, b - step * way)[0]) for way in np.eye(2)[:, :, None]]
    )
    way = (b - a).ravel()
    cosine = way @ gradient / np.hypot(*way) / np.hypot(*gradient)
    sine = (way[0] * gradient[1] - way[1] * gradient[0]) / np.hypot(*way) / np.hypot(*gradient)
    return abs(float(np.arctan2(sine, cosine))), kernel_planes.slant(plane, distance, scale)


def bent_and_bound(row: MotionRow, place: Place, bearing: float) -> tuple[float, float]:
    """Curvature on the earth, 1/m, of uniform motion along a straight line of the plane, and its bound."""
    plane, xy = row.plane, row.xy(place)
    scale = plane.largest_scale(xy[:, :, None])
    # On the earth: far enough for differences, near enough to be even.
    step = 3000.0 * np.array([[np.sin(np.radians(bearing))], [np.cos(np.radians(bearing))]])
    before, here, after = (in_space(row, xy + way * step) for way in (-1.0, 0.0, 1.0))
    up = outward(row, xy)
    change = after - 2.0 * here + before
    change = change - (change @ up) * up
    return float(np.linalg.norm(change) / np.linalg.norm(0.5 * (after - before)) ** 2), kernel_planes.christoffel(
        plane, scale[0]
    )


def in_space(row: MotionRow, xy: np.ndarray) -> np.ndarray:
    """Metres from the middle of the earth."""
    lon, lat = (np.radians(at.item()) for at in row.plane.from_plane(*xy))
    normal = row.geod.a / np.sqrt(1.0 - row.geod.es * np.sin(lat) ** 2)
    out = normal * np.cos(lat)
    return np.array([out * np.cos(lon), out * np.sin(lon), normal * (1.0 - row.geod.es) * np.sin(lat)])


def outward(row: MotionRow, xy: np.ndarray) -> np.ndarray:
    """The normal of the earth, a unit vector."""
    lon, lat = (np.radians(at.item()) for at in row.plane.from_plane(*xy))
    return np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


@for_every_motion(of_places, lambda row: bearings)
def test_straight_lines_bend_on_the_earth_no_more_than_bounded(row: MotionRow, place: Place, bearing: float) -> None:
    bent, bound = bent_and_bound(row, place, bearing)
    # Coordinates in space are rounded to 1e-9 m, and steps are some hundred metres or more, at the rim tens.
    scale = float(row.plane.largest_scale(row.xy(place)[:, :, None])[0])
    assert bent <= bound * (1.0 + 1e-3) + 1e-8 * (scale / 3000.0) ** 2 + WAY_ROUNDING / row.geod.a


@every_motion
def test_bounds_on_what_changes_are_of_use(row: MotionRow) -> None:
    """Over a fan of directions from a place in the middle they are nearly reached, `plane_slant` by half."""
    one = row.home
    rates, turns, bends = [], [], []
    for bearing in np.arange(0.0, 360.0, 15.0):
        other = near(one, row.geod.fwd(*one, bearing, 1e4)[:2])
        for way in np.arange(0.0, 180.0, 15.0):
            rate, bound, _ = rate_and_bound(row, (one, other), way)
            rates.append(rate / bound)
        turned, bound = turned_and_bound(row, one, other)
        turns.append(turned / bound)
        bent, bound = bent_and_bound(row, one, bearing)
        bends.append(bent / bound)
    # A rate is brought to the plane at a scale that is the largest in any direction.
    assert 0.8 < max(rates) <= 1.001
    assert 0.45 < max(turns) <= 1.001
    assert 0.9 < max(bends) <= 1.001
