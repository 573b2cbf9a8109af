"""What every moving polygon of the kernel keeps: it is where the oracle has it, and no bound is ever passed.

Anywhere that is accepted, of any size from nothing to thousands of kilometres, rigid or changing, on legs of a
microsecond to 9,998 years. Bounds are held against dense samples: what lies between samples is bounded by the same
means, for a mean of velocities (a difference of positions) is as large as one of them. That they are of use as well is
`test_bounds_are_near_what_they_bound`; unit tests of the motions hold them to tighter factors.
"""

from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from implementations import MotionRow, Moving, every_motion, extremes, for_every_motion, largest_size_m, moving

from conflictdb.kernel.movement import Movement

# A vertex is a sum of about ten terms that are rounded to 1e-16 of a turn (4e7 m) each, or of the several turns that a
# haven may go around a pole; and so is the oracle's.
TURN_M: Final = 4e7
EARTH_M: Final = 6.37e6
PLANE_ROUNDING: Final = 3e-15
# Long steps along a parallel are as much off as the parallel's length by the last digits of its latitude.
LATITUDE_ROUNDING: Final = 1e-15
# And places on the earth, from latitudes and directions that are rounded to 1e-16.
EARTH_ROUNDING_M: Final = 1.5e-7


def rounding_m(haven: Moving) -> float:
    """What places in the plane are rounded to, plane metres."""
    furthest = np.abs(haven.positions).max()
    if haven.row.has_seam:
        # Whole turns around the pole are taken off a place after its way along the parallel was rounded.
        furthest = max(furthest, haven.scale * largest_size_m(haven.track))
    own = PLANE_ROUNDING * max(TURN_M, furthest) + (EARTH_ROUNDING_M + tip_rounding_m(haven)) * haven.scale
    return float(own + LATITUDE_ROUNDING * furthest * haven.scale)


def tip_rounding_m(haven: Moving) -> float:
    """What sharp corners of havens that grow are rounded to, metres on the earth.

    A corner runs f times as fast as the sides grow, with 2 / f^2 = 1 + the cosine between their normals, which is
    rounded to 1.1e-16 here and in the oracle.
    """
    grown_m = haven.track.grow_mps * haven.leg_s
    tip_m = float(np.hypot(*(haven.pieces.shape_to_xy - haven.pieces.shape_xy).T).max())
    return 1.1e-16 * (tip_m / grown_m) ** 2 * tip_m if grown_m > 0.0 else 0.0


def at_most(found: float, bound: float) -> None:
    assert found <= bound, f"{found:g} is {found / bound - 1.0 if bound else np.inf:g} of it more than {bound:g}"


def far_from(one: np.ndarray, other: np.ndarray) -> float:
    """How far vertices (2, v, n) are from those of (n, w, 2), in any order."""
    apart = one.transpose(2, 1, 0)[:, :, None] - other[:, None]
    distance = np.hypot(apart[..., 0], apart[..., 1])
    return float(max(distance.min(axis=1).max(), distance.min(axis=2).max()))


def left(xy: np.ndarray) -> float:
    """How far any of the vertices (2, v, SAMPLES) leaves the hull of the first and the last."""
    # Squares of less are no numbers, and their distances neither.
    xy = np.where(np.abs(xy) < 1e-150, 0.0, xy)
    hull = shapely.convex_hull(shapely.multipoints(np.concatenate([xy[..., 0], xy[..., -1]], axis=1).T))
    return float(shapely.distance(hull, shapely.points(xy.reshape(2, -1).T)).max())


@for_every_motion(moving, fixed=extremes)
def test_vertices_are_where_the_oracle_has_them(row: MotionRow, haven: Moving) -> None:
    expected = row.oracle.haven(haven.track, 0, haven.fractions)
    found, turn_m = haven.positions, row.plane.turn_m
    turns = (found[0].mean() - expected[..., 0].mean()) / turn_m if turn_m else 0.0
    # Some vertices may count more than once in one of them, so that the middles do not say which turn is meant.
    homes = [found - np.array([[[turn * turn_m]], [[0.0]]]) for turn in {np.floor(turns), np.ceil(turns)}]
    off = min(far_from(home, expected) for home in homes)
    # What is off to the north or south is so to the east or west, too, by as much of the way along its parallel.
    turned = row.oracle.rounding_m(haven.track) * (1.0 + np.abs(haven.positions).max() / EARTH_M)
    at_most(off, rounding_m(haven) + haven.scale * turned)


@for_every_motion(moving, fixed=extremes)
def test_the_reference_runs_straight_and_time_fraction_says_when_it_is_where(row: MotionRow, haven: Moving) -> None:
    samples, share = haven.samples, np.linspace(0.0, 1.0, len(haven.seconds))
    low, high = np.full(len(share), haven.t0), np.full(len(share), haven.t1)
    at = samples.reference(low + samples.time_fraction(low, high, share) * (high - low))
    start, end = samples.reference(low), samples.reference(high)
    at_most(np.abs(at - (start + share * (end - start))).max(), rounding_m(haven))


@for_every_motion(moving, fixed=extremes)
def test_no_vertex_accelerates_more_than_bounded(row: MotionRow, haven: Moving) -> None:
    """What mean velocities change by from one step to the next is a mean of accelerations times a step."""
    change = np.hypot(*np.diff(haven.velocities, axis=2)).max()
    at_most(change, haven.bounds.acceleration[0] * haven.step_s + 4.0 * rounding_m(haven) / haven.step_s)


@for_every_motion(moving, fixed=extremes)
def test_no_acceleration_is_further_from_that_of_the_reference_than_bounded(row: MotionRow, haven: Moving) -> None:
    change = np.diff(haven.velocities, axis=2) - haven.bounds.curve[:, None] * haven.step_s
    at_most(np.hypot(*change).max(), haven.bounds.variation[0] * haven.step_s + 4.0 * rounding_m(haven) / haven.step_s)


@for_every_motion(moving, fixed=extremes)
def test_no_velocity_is_further_from_that_of_the_whole_than_bounded(row: MotionRow, haven: Moving) -> None:
    spread = np.hypot(*(haven.velocities - haven.bounds.velocity[:, None])).max()
    at_most(spread, haven.bounds.spread[0] + 2.0 * rounding_m(haven) / haven.step_s)


@for_every_motion(moving, fixed=extremes)
def test_no_vertex_leaves_the_hull_of_the_ends_further_than_bounded(row: MotionRow, haven: Moving) -> None:
    """Of the vertices at both ends, and of their offsets from the reference point at both ends."""
    reference = haven.samples.reference(haven.seconds) + haven.origin
    for xy in (haven.positions - haven.positions[:, :1, :1], haven.positions - reference[:, None]):
        at_most(left(xy), haven.bounds.deviation[0] + 2 * rounding_m(haven))


@for_every_motion(moving, fixed=extremes)
def test_no_vertex_is_seen_at_a_larger_scale_than_bounded(row: MotionRow, haven: Moving) -> None:
    at_most(haven.scale, haven.bounds.scale[0] * (1.0 + 1e-9))


@for_every_motion(moving, fixed=extremes)
def test_polygons_that_are_said_to_be_convex_are(row: MotionRow, haven: Moving) -> None:
    """At all times all vertices lie to the left of every side."""
    if not haven.is_convex:
        return
    at = haven.positions
    side = np.roll(at, -1, axis=1) - at
    to_vertex = at[:, None] - at[:, :, None]
    ahead = side[0][:, None] * to_vertex[1] - side[1][:, None] * to_vertex[0]
    # What both ways are rounded to counts with the length of the other.
    longest = np.hypot(*side)[:, None] + np.hypot(*to_vertex)
    assert (ahead >= -2 * rounding_m(haven) * longest).all()


@for_every_motion(moving, fixed=extremes)
def test_what_is_accepted_stays_in_the_plane(row: MotionRow, haven: Moving) -> None:
    assert np.isfinite(haven.positions).all()
    lon, lat = row.plane.from_plane(*haven.positions)
    at_most(row.haven_beyond_deg(lon, lat).max(), 1e-8)


@for_every_motion(moving, fixed=extremes)
def test_a_piece_does_not_depend_on_its_company(row: MotionRow, haven: Moving) -> None:
    """To the bit: in a scene of its own, or among others, more than once and in another order."""
    t0, t1 = np.array([haven.t0]), np.array([haven.t1])
    own = haven.pieces.take(np.array([haven.piece]))
    alone = replace(haven, pieces=own, piece=0)
    rows = np.append(np.arange(len(haven.pieces))[::-1], haven.piece)
    slots = int(np.diff(haven.pieces.shape_offset).max())
    zero_us = np.full(len(rows), haven.pieces.start_us[haven.piece])
    among = Movement(haven.prepared, rows, zero_us, np.repeat(haven.origin, len(rows), axis=1), slots)
    mine = np.flatnonzero(rows == haven.piece)
    at = among.positions(np.repeat(t1, len(rows)))[:, : alone.movement.slots, mine]
    np.testing.assert_array_equal(at, np.repeat(alone.movement.positions(t1), len(mine), axis=2))
    found = among.bounds(np.repeat(t0, len(rows)), np.repeat(t1, len(rows)))
    for name in ("velocity", "acceleration", "spread", "deviation", "scale"):
        expected = getattr(alone.bounds, name)
        np.testing.assert_array_equal(getattr(found, name)[..., mine], np.repeat(expected, len(mine), axis=-1))


# How many times what it bounds a bound may be on whole ordinary legs: what it is there, and a third.
USEFUL: Final = {"acceleration": 6.0, "spread": 6.0, "scale": 1.001, "deviation": 7.0}


@every_motion
def test_bounds_are_near_what_they_bound(row: MotionRow) -> None:
    """A bound that grows costs time and widens what is reported, and nothing else tells."""
    rigid, growing, _, aside, *_ = (haven for (haven,) in extremes(row))
    for haven in (rigid, growing):
        reached = np.hypot(*np.diff(haven.velocities, axis=2)).max() / haven.step_s
        at_most(haven.bounds.acceleration[0], USEFUL["acceleration"] * reached)
        reached = np.hypot(*(haven.velocities - haven.bounds.velocity[:, None])).max()
        at_most(haven.bounds.spread[0], USEFUL["spread"] * reached)
        at_most(haven.bounds.scale[0], USEFUL["scale"] * haven.scale)
        assert haven.is_convex
    # Of a vertex far off the leg: those of polygons about it seldom leave the hull at all.
    at_most(aside.bounds.deviation[0], USEFUL["deviation"] * left(aside.positions))
