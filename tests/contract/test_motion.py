"""Every moving polygon of the kernel: it is at the oracle's place, and stays within its bounds.

Legs anywhere valid, of any size from zero to thousands of kilometres, rigid or changing, of a microsecond to 9,998
years. Bounds are compared with dense samples. They also bound the motion between samples, since a mean velocity (a
difference of positions) is at most the largest velocity. `test_bounds_are_near_what_they_bound` checks that bounds are
tight; unit tests of the motions use tighter factors.
"""

from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from implementations import MotionRow, Moving, every_motion, extremes, for_every_motion, largest_size_m, moving

from conflictdb.kernel.movement import Movement

# A vertex is a sum of about ten terms, each rounded to 1e-16 of a turn (4e7 m). A haven may go around a pole for
# several turns, which count then. The oracle has the same error.
TURN_M: Final = 4e7
EARTH_M: Final = 6.37e6
PLANE_ROUNDING: Final = 3e-15
# Long steps along a parallel are as much off as the parallel's length by the last digits of its latitude.
LATITUDE_ROUNDING: Final = 1e-15
# And places on the earth, from latitudes and directions that are rounded to 1e-16.
EARTH_ROUNDING_M: Final = 1.5e-7


def rounding_m(haven: Moving) -> float:
    """Rounding error of places in the plane, plane metres."""
    furthest = np.abs(haven.positions).max()
    if haven.row.has_seam:
        # Whole turns around the pole are taken off a place after its way along the parallel was rounded.
        furthest = max(furthest, haven.scale * largest_size_m(haven.track))
    own = PLANE_ROUNDING * max(TURN_M, furthest) + (EARTH_ROUNDING_M + tip_rounding_m(haven)) * haven.scale
    return float(own + LATITUDE_ROUNDING * furthest * haven.scale)


def tip_rounding_m(haven: Moving) -> float:
    """Rounding error of sharp corners of growing havens, metres on the earth.

    A corner moves f times as fast as the sides, with 2 / f^2 = 1 + the cosine between their normals. This cosine is
    rounded to 1.1e-16, here and in the oracle.
    """
    grown_m = haven.track.grow_mps * haven.leg_s
    tip_m = float(np.hypot(*(haven.pieces.shape_to_xy - haven.pieces.shape_xy).T).max())
    return 1.1e-16 * (tip_m / grown_m) ** 2 * tip_m if grown_m > 0.0 else 0.0


def at_most(found: float, bound: float) -> None:
    assert found <= bound, f"{found:g} is {found / bound - 1.0 if bound else np.inf:g} of it more than {bound:g}"


def far_from(one: np.ndarray, other: np.ndarray) -> float:
    """Largest distance of vertices (2, v, n) from those of (n, w, 2), in any order."""
    apart = one.transpose(2, 1, 0)[:, :, None] - other[:, None]
    distance = np.hypot(apart[..., 0], apart[..., 1])
    return float(max(distance.min(axis=1).max(), distance.min(axis=2).max()))


def left(xy: np.ndarray) -> float:
    """Largest distance of any vertex (2, v, SAMPLES) from the hull of its first and last places."""
    # Squares of smaller numbers underflow, and distances with them.
    xy = np.where(np.abs(xy) < 1e-150, 0.0, xy)
    hull = shapely.convex_hull(shapely.multipoints(np.concatenate([xy[..., 0], xy[..., -1]], axis=1).T))
    return float(shapely.distance(hull, shapely.points(xy.reshape(2, -1).T)).max())


@for_every_motion(moving, fixed=extremes)
def test_vertices_are_where_the_oracle_has_them(row: MotionRow, haven: Moving) -> None:
    expected = row.oracle.haven(haven.track, 0, haven.fractions)
    found, turn_m = haven.positions, row.plane.turn_m
    turns = (found[0].mean() - expected[..., 0].mean()) / turn_m if turn_m else 0.0
    # A repeated vertex may have another count in either polygon, so the means do not determine the turn.
    homes = [found - np.array([[[turn * turn_m]], [[0.0]]]) for turn in {np.floor(turns), np.ceil(turns)}]
    off = min(far_from(home, expected) for home in homes)
    # An error to the north or south implies one to the east or west, in proportion to the way along the parallel.
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
    """The change of mean velocity over a step is a mean of accelerations times the step."""
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
    """For the vertices at both ends, and for their offsets from the reference point at both ends."""
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
    # The rounding error of each of both vectors counts times the length of the other.
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


# Largest ratio of a bound to the exact value on whole ordinary legs: the measured ratio and a third.
USEFUL: Final = {"acceleration": 6.0, "spread": 6.0, "scale": 1.001, "deviation": 7.0}


@every_motion
def test_bounds_are_near_what_they_bound(row: MotionRow) -> None:
    """A bound that grows costs time and widens the reported intervals; no other test notices."""
    rigid, growing, _, aside, *_ = (haven for (haven,) in extremes(row))
    for haven in (rigid, growing):
        reached = np.hypot(*np.diff(haven.velocities, axis=2)).max() / haven.step_s
        at_most(haven.bounds.acceleration[0], USEFUL["acceleration"] * reached)
        reached = np.hypot(*(haven.velocities - haven.bounds.velocity[:, None])).max()
        at_most(haven.bounds.spread[0], USEFUL["spread"] * reached)
        at_most(haven.bounds.scale[0], USEFUL["scale"] * haven.scale)
        assert haven.is_convex
    # For a vertex far off the leg: vertices of polygons about the leg seldom leave the hull at all.
    at_most(aside.bounds.deviation[0], USEFUL["deviation"] * left(aside.positions))
