"""Great circles on the sphere, in the gnomonic plane about a centre, where they are straight.

A place V (a unit vector) is at (x, y) = R (E.V, N.V) / (C.V), with C the centre and E and N its east and north. All
vectors are held in the frame (E, N, C). `circles` are the havens that ride there.

The scale (plane metres per metre) at an angle c from the centre is sec(c)^2 outward and sec(c) across. It is convex
along every great circle: a bound at both ends of a way holds all along it.

Reference: J. P. Snyder, "Map Projections: A Working Manual", USGS Professional Paper 1395 (1987), section 22.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb import kernel
from conflictdb.arrays.pieces import Pieces
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.earth.geodesy import MEAN_RADIUS_M, Floats, direction_of, great_circle_step, shorter_way_deg
from conflictdb.model import MAX_FROM_CENTRE_DEG
from conflictdb.motion.contract import shape_class, shape_vertices
from conflictdb.motion.great_circles import (
    LEAST_UP,
    MAX_CHANGING_REACH,
    GreatCircles,
    GreatCircleShapes,
    great_circle_shapes,
)
from conflictdb.results import Kind

# Distances come from plane coordinates up to 1.1e7 m, each rounded by 2e-9 m. They are stated less by this, so that
# they are never too large.
_DISTANCE_ROUNDING_M: Final = 1e-8
# Sine of the least turn of a corner, so that rounding of its coordinates does not make it turn inwards.
_LEAST_TURN: Final = 1e-8
# A haven that changes and reaches further than this, radians, is not shown to stay convex in the plane.
_FLAT: Final = 0.5
# A corner is convex in the plane if it turns by so many times the angle that its sides curve by.
_CORNER_SLACK: Final = 4.0
# In `Gnomonic.shape_variant`: havens that change.
_CHANGES: Final = 2


@dataclass(frozen=True, slots=True)
class Gnomonic:
    """The plane that touches the sphere of mean radius at a centre, degrees (see `motion.Plane`)."""

    centre_lon_deg: float
    centre_lat_deg: float

    @property
    def turn_m(self) -> float:
        """There is no seam."""
        return 0.0

    @property
    def is_conformal(self) -> bool:
        return False

    @property
    def kernel_plane(self) -> kernel.Plane:
        return kernel.Plane.gnomonic(self.centre_lon_deg, self.centre_lat_deg)

    def to_plane(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return plane x and y in metres; NaN for points that are not within 90 degrees of the centre."""
        east, north, up = self.vectors(lon_deg, lat_deg)
        height = np.where(up > 0.0, up, np.nan)
        return MEAN_RADIUS_M * east / height, MEAN_RADIUS_M * north / height

    def from_plane(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[Floats, Floats]:
        """Return longitudes within half a turn of the centre's and latitudes, degrees."""
        x = np.asarray(x_m, dtype=np.float64) / MEAN_RADIUS_M
        y = np.asarray(y_m, dtype=np.float64) / MEAN_RADIUS_M
        sine, cosine = direction_of(self.centre_lat_deg)
        out, axis = cosine - y * sine, sine + y * cosine
        return self.centre_lon_deg + np.degrees(np.arctan2(x, out)), np.degrees(np.arctan2(axis, np.hypot(x, out)))

    @property
    def lines(self) -> str:
        return "great circles"

    @property
    def limit(self) -> str:
        return (
            f"reaches beyond {MAX_FROM_CENTRE_DEG:g} degrees from the scene's centre "
            f"({self.centre_lon_deg:g}, {self.centre_lat_deg:g}), where motion 'great_circle' ends: give the scene a "
            "'centre' in the middle of its objects, split it, or use motion 'rhumb'"
        )

    @property
    def haven_limit(self) -> str:
        return f"the haven {self.limit}"

    def holds(self, lon_deg: Floats, lat_deg: Floats) -> NDArray[np.bool_]:
        return np.asarray(self.vectors(lon_deg, lat_deg)[2] >= LEAST_UP)

    def holds_havens(self, pieces: Pieces) -> NDArray[np.bool_]:
        widest = np.maximum(np.abs(pieces.shape_xy), np.abs(pieces.shape_to_xy)).max(axis=1)
        reach = np.maximum.reduceat(widest, pieces.shape_offset[:-1]) / MEAN_RADIUS_M
        held = reach <= np.where(_changes(pieces), MAX_CHANGING_REACH, np.radians(MAX_FROM_CENTRE_DEG))
        classes = shape_class(self, pieces)
        for one in np.unique(classes[held]):
            rows = np.flatnonzero(held & (classes == one))
            shapes = self.shapes(pieces, rows, pieces.leg_start_us[rows], np.zeros((2, len(rows))))
            leg_s = (pieces.leg_end_us[rows] - pieces.leg_start_us[rows]) / 1e6
            held[rows] = shapes.least_up(np.zeros(len(rows)), leg_s).min(axis=0) >= LEAST_UP
        return np.asarray(held)

    def courses(self, start_deg: Floats, end_deg: Floats) -> tuple[Floats, Floats, Floats]:
        east, north, cosine = great_circle_step(*start_deg.T, *end_deg.T)
        back_east, back_north, _ = great_circle_step(*end_deg.T, *start_deg.T)
        length = MEAN_RADIUS_M * np.arctan2(np.hypot(east, north), cosine)
        still = (east == 0.0) & (north == 0.0)
        return (
            np.where(still, 0.0, length),
            np.degrees(np.arctan2(east, north)),
            np.degrees(np.arctan2(-back_east, -back_north)),
        )

    def largest_scale(self, points: Floats) -> Floats:
        """Return the scale outward from the centre, sec(c)^2, where it is largest (see `motion.Plane`)."""
        return np.asarray(1.0 + (points[0] ** 2 + points[1] ** 2).max(axis=0) / MEAN_RADIUS_M**2)

    def smallest_scale(self, points: Floats) -> Floats:
        """Return the scale across the way from the centre, sec(c), at the nearest point there may be.

        That of the box about the points, and nearer by its diagonal, for what moves between them.
        """
        low, high = points.min(axis=1), points.max(axis=1)
        nearest = np.maximum(np.maximum(low, -high), 0.0)
        distance = np.hypot(nearest[0], nearest[1]) - np.hypot(high[0] - low[0], high[1] - low[1])
        return np.sqrt(1.0 + (np.maximum(distance, 0.0) / MEAN_RADIUS_M) ** 2)

    def span_m(self, distance_m: Floats | float, scale: Floats) -> Floats:
        """Return the plane metres of the shortest way, which is straight: at most the scale at its ends all along."""
        return np.asarray(distance_m * scale)

    def distance_error_m(self, distance_m: Floats | float) -> Floats:
        """Return the rounding of a distance that has a closed form."""
        return np.asarray(2.0 * _DISTANCE_ROUNDING_M + 1e-12 * distance_m)

    def shape_variant(self, pieces: Pieces) -> NDArray[np.int64]:
        """Return (n,) 1 for havens that may not be convex, else 0; and _CHANGES more for those that change."""
        shape_variant = np.zeros(len(pieces), np.int64)
        rows = np.flatnonzero(pieces.kind == Kind.TRACK.code)
        if rows.size:
            offset, index = ragged_rows(pieces.shape_offset, rows)
            outline = pieces.shape_xy[index] / MEAN_RADIUS_M
            shape_variant[rows] = _may_dent(outline, offset)
            if pieces.changes:
                later, differs = pieces.shape_to_xy[index] / MEAN_RADIUS_M, _changes(pieces)[rows]
                dents = np.where(differs, _may_dent_on_the_way(outline, later, offset), shape_variant[rows])
                shape_variant[rows] = dents + np.where(differs, _CHANGES, 0)
        return shape_variant

    def shapes(
        self, pieces: Pieces, rows: NDArray[np.int64], zero_us: NDArray[np.int64], origin: Floats
    ) -> GreatCircleShapes:
        leg_start = pieces.leg_start_us[rows]
        legs = GreatCircles.between(self, pieces.leg_start_deg[rows], pieces.leg_end_deg[rows])
        variants = self.shape_variant(pieces.take(np.unique(rows)))
        outline_m = shape_vertices(pieces, rows)
        return great_circle_shapes(
            legs.headed(self, pieces.leg_start_deg[rows], pieces.bearing_deg[rows]),
            outline_m,
            (zero_us - leg_start) / 1e6,
            (pieces.leg_end_us[rows] - leg_start) / 1e6,
            origin,
            is_convex=not (variants % _CHANGES).any(),
            change_m=shape_vertices(pieces, rows, at_end=True) - outline_m if (variants >= _CHANGES).any() else None,
        )

    def vectors(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> Floats:
        """Return unit vectors (3, ...) towards points, in the frame (E, N, C) of the centre.

        Written with differences from the centre, so that a small scene has small coordinates with all their digits.
        """
        lat = np.asarray(lat_deg, dtype=np.float64)
        turn = self._turn_deg(lon_deg)
        (sine, cosine), (sine0, cosine0), (sine_turn, cosine_turn) = (
            direction_of(angle) for angle in (lat, self.centre_lat_deg, turn)
        )
        versine = 2.0 * np.sin(np.radians(0.5 * turn)) ** 2
        east = cosine * sine_turn
        north = np.sin(np.radians(lat - self.centre_lat_deg)) + sine0 * cosine * versine
        return np.stack(np.broadcast_arrays(east, north, sine0 * sine + cosine0 * cosine * cosine_turn))

    def compass(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return the unit vectors (3, ...) that point east and north at points (at a pole: on their meridian)."""
        (sine, cosine), (sine0, cosine0), (sine_turn, cosine_turn) = (
            direction_of(angle) for angle in (lat_deg, self.centre_lat_deg, self._turn_deg(lon_deg))
        )
        east = np.stack(np.broadcast_arrays(cosine_turn, sine0 * sine_turn, -cosine0 * sine_turn))
        north = np.stack(
            np.broadcast_arrays(
                -sine * sine_turn,
                sine0 * sine * cosine_turn + cosine0 * cosine,
                sine0 * cosine - cosine0 * sine * cosine_turn,
            )
        )
        return east, north

    def _turn_deg(self, lon_deg: ArrayLike) -> Floats:
        """Return longitudes east of the centre's; one meridian is one number, however it is written."""
        lon = np.asarray(lon_deg, dtype=np.float64)
        home = lon - 360.0 * np.round(lon / 360.0)  # exact
        return shorter_way_deg(np.where(home == -180.0, 180.0, home) - self.centre_lon_deg)


def _changes(pieces: Pieces) -> NDArray[np.bool_]:
    """Return (n,) whether a haven has another outline at the end of its leg."""
    if not pieces.changes:
        return np.zeros(len(pieces), np.bool_)
    differs = (pieces.shape_to_xy != pieces.shape_xy).any(axis=1)
    return np.asarray(np.logical_or.reduceat(differs, pieces.shape_offset[:-1]))


def _may_dent(outline: Floats, offset: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (n,) whether a corner of an outline (in radians, concatenated) might turn inwards in the plane.

    A haven that rides along is turned in space as a whole, and every gnomonic plane shows great circles as straight
    lines. So a corner turns the same way wherever the haven is, also in the plane that touches the sphere at its
    reference point.
    """
    after = np.arange(len(outline)) + 1
    after[offset[1:] - 1] = offset[:-1]
    ahead = outline[:, 1]
    flat = np.stack([np.tan(outline[:, 0]) / np.cos(ahead), np.tan(ahead)])
    side = flat[:, after] - flat
    length = np.hypot(side[0], side[1])
    turn = side[0] * side[1, after] - side[1] * side[0, after]
    dents = turn <= _LEAST_TURN * length * length[after]
    return np.asarray(np.logical_or.reduceat(dents, offset[:-1]) & (np.diff(offset) > 2))


def _may_dent_on_the_way(start: Floats, end: Floats, offset: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return `_may_dent` of outlines whose vertices move straight from start to end, counter-clockwise both.

    In the plane that touches the sphere at the reference point, x = tan(s) / cos(f) and y = tan(f): up to half a radian
    a side of length d is turned against another by less than 4 d tan(the haven's reach). A turn is a quadratic in time,
    which its Bernstein coefficients bound; a side is longest at one of the ends.
    """
    after = np.arange(len(start)) + 1
    after[offset[1:] - 1] = offset[:-1]
    side, last = start[after] - start, end[after] - end
    length = np.maximum(np.hypot(side[:, 0], side[:, 1]), np.hypot(last[:, 0], last[:, 1]))
    between = 0.5 * (_cross(side, last[after]) + _cross(last, side[after]))
    turn = np.minimum(np.minimum(_cross(side, side[after]), _cross(last, last[after])), between)
    reach = np.maximum(np.hypot(start[:, 0], start[:, 1]), np.hypot(end[:, 0], end[:, 1]))
    reach = np.maximum.reduceat(reach, offset[:-1])
    of = np.repeat(np.arange(len(offset) - 1), np.diff(offset))
    curving = _CORNER_SLACK * (length + length[after]) * np.tan(np.minimum(reach, _FLAT))[of]
    flat = (turn <= (curving + _LEAST_TURN) * length * length[after]) | (reach > _FLAT)[of]
    return np.asarray(np.logical_or.reduceat(flat, offset[:-1]) & (np.diff(offset) > 2))


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
