"""Compute great circles on the sphere, in the gnomonic plane about a centre, where they are straight.

A place V (a unit vector) is at (x, y) = R (E.V, N.V) / (C.V), with C the centre and E and N its east and north. All
vectors are in the frame (E, N, C).

The scale (plane metres per metre) at an angle c from the centre is sec(c)^2 outward and sec(c) across. It is convex
along every great circle, so a bound at both ends of a path is a bound on all of it.

Reference: J. P. Snyder, "Map Projections: A Working Manual", USGS Professional Paper 1395 (1987), section 22.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import MEAN_RADIUS_M, direction_of, great_circle_step, shorter_way_deg
from conflictdb.model.plans import MAX_FROM_CENTRE_DEG

# Distances follow from plane coordinates up to 1.1e7 m, each rounded by 2e-9 m. They are reduced by this, so that they
# are never too large.
_DISTANCE_ROUNDING_M: Final = 1e-8
# Cosine of the largest angle from the centre, with a margin for rounding, so that places exactly at the limit pass.
LEAST_UP: Final = float(np.cos(np.radians(MAX_FROM_CENTRE_DEG + 1e-9)))
# Largest extent of a changing haven, ahead or across, radians. A vertex further ahead could be more than a quarter turn
# from the centre although the leg is not, and invalidate the bounds of the kernel.
MAX_CHANGING_REACH: Final = float(np.radians(90.0 - MAX_FROM_CENTRE_DEG))


@dataclass(frozen=True, slots=True)
class Gnomonic:
    """The plane that touches the sphere of mean radius at a centre, degrees (see `motion.Plane`)."""

    centre_lon_deg: float
    centre_lat_deg: float

    @property
    def turn_m(self) -> float:
        """0: the plane has no seam."""
        return 0.0

    @property
    def is_conformal(self) -> bool:
        return False

    @property
    def kernel_plane(self) -> kernel.KernelPlane:
        plane = kernel.KernelPlane(kernel.KernelPlane.GNOMONIC, 0, MEAN_RADIUS_M, MEAN_RADIUS_M)
        plane.conformal_radius[0] = MEAN_RADIUS_M
        plane.centre_lon_deg, plane.centre_lat_deg = self.centre_lon_deg, self.centre_lat_deg
        return plane

    def to_plane(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return plane x and y in metres; NaN for points 90 degrees or more from the centre."""
        return _flat(self.vectors(lon_deg, lat_deg))

    def project(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        vectors = self.vectors(lon_deg, lat_deg)
        return *_flat(vectors), vectors[2] >= LEAST_UP

    def from_plane(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[Floats, Floats]:
        """Return longitudes within half a turn of the centre's and latitudes, degrees."""
        x = np.asarray(x_m, dtype=np.float64) / MEAN_RADIUS_M
        y = np.asarray(y_m, dtype=np.float64) / MEAN_RADIUS_M
        sine, cosine = _direction(self.centre_lat_deg)
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
        """Return (n,) whether every vertex keeps C.V (C the centre, V its unit vector) at `LEAST_UP` on the whole leg.

        With the leg's start A, heading B and starboard S, a vertex f ahead and s across is, after a distance theta
        along the leg, at V = cos(s) e + sin(s) S with e = cos(theta + f) A + sin(theta + f) B. For a constant haven C.V
        is a cosine, least at one of the ends. For a changing haven it may sag below its chord, since (C.V)'' = -a^2
        cos(s) C.e - s'^2 C.V - 2 a s' sin(s) C.d, with a the rate of theta + f and d the direction along the leg; only
        positive terms count. C.e is not negative within `MAX_CHANGING_REACH`; the second term is bounded as if C.V were
        -1.
        """
        of = np.repeat(np.arange(len(pieces)), np.diff(pieces.shape_offset))
        start, heading, angle = self._legs(pieces)
        starboard_up = heading[0] * start[1] - heading[1] * start[0]
        outlines = [shape / MEAN_RADIUS_M for shape in (pieces.shape_xy, pieces.shape_to_xy)]
        up = np.full(len(of), np.inf)
        for theta, (across, ahead) in zip((np.zeros(len(angle)), angle), (one.T for one in outlines), strict=True):
            along = theta[of] + ahead
            e_up = np.cos(along) * start[2, of] + np.sin(along) * heading[2, of]
            up = np.minimum(up, np.cos(across) * e_up + np.sin(across) * starboard_up[of])
        widest = np.maximum(*map(np.abs, outlines))
        across, ahead = (outlines[1] - outlines[0]).T
        up -= (2.0 * np.abs((angle[of] + ahead) * across) * np.sin(widest[:, 0]) + across**2) / 8.0
        first = pieces.shape_offset[:-1]
        reach = np.maximum.reduceat(widest.max(axis=1), first)
        fits = reach <= np.where(pieces.changed(), MAX_CHANGING_REACH, np.radians(MAX_FROM_CENTRE_DEG))
        return np.asarray(fits & (np.minimum.reduceat(up, first) >= LEAST_UP))

    def _legs(self, pieces: Pieces) -> tuple[Floats, Floats, Floats]:
        """Return unit vectors (3, n) of start and heading of each leg, the shorter way, and its length, radians.

        A leg without movement has the heading of its piece.
        """
        to_east, to_north, cosine = great_circle_step(*pieces.leg_start_deg.T, *pieces.leg_end_deg.T)
        sine = np.hypot(to_east, to_north)
        moves = sine > 0.0
        towards = np.where(moves, [to_east, to_north], direction_of(pieces.bearing_deg)) / np.where(moves, sine, 1.0)
        east, north = self.compass(*pieces.leg_start_deg.T)
        heading = towards[0] * east + towards[1] * north
        return self.vectors(*pieces.leg_start_deg.T), heading, np.where(moves, np.arctan2(sine, cosine), 0.0)

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
        """Return the largest outward scale from the centre, sec(c)^2 (see `motion.Plane`)."""
        return np.asarray(1.0 + (points[0] ** 2 + points[1] ** 2).max(axis=0) / MEAN_RADIUS_M**2)

    def smallest_scale(self, points: Floats) -> Floats:
        """Return the scale across the direction from the centre, sec(c), at the nearest possible point.

        The nearest point of the bounding box, less its diagonal to allow for motion between the points.
        """
        low, high = points.min(axis=1), points.max(axis=1)
        nearest = np.maximum(np.maximum(low, -high), 0.0)
        distance = np.hypot(nearest[0], nearest[1]) - np.hypot(high[0] - low[0], high[1] - low[1])
        return np.sqrt(1.0 + (np.maximum(distance, 0.0) / MEAN_RADIUS_M) ** 2)

    def span_m(self, distance_m: Floats | float, scale: Floats) -> Floats:
        """Return the plane metres of the shortest path, which is straight: the larger scale of its ends is a bound."""
        return np.asarray(distance_m * scale)

    def distance_error_m(self, distance_m: Floats | float) -> Floats:
        """Return the rounding error of a distance in closed form."""
        return np.asarray(2.0 * _DISTANCE_ROUNDING_M + 1e-12 * distance_m)

    def vectors(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> Floats:
        """Return unit vectors (3, ...) towards points, in the frame (E, N, C) of the centre."""
        lat = np.asarray(lat_deg, dtype=np.float64)
        turn = self._turn_deg(lon_deg)
        (sine, cosine), (sine_turn, cosine_turn) = direction_of(lat), direction_of(turn)
        sine0, cosine0 = _direction(self.centre_lat_deg)
        versine = 2.0 * np.sin(np.radians(0.5 * turn)) ** 2
        east = cosine * sine_turn
        north = np.sin(np.radians(lat - self.centre_lat_deg)) + sine0 * cosine * versine
        return np.stack(np.broadcast_arrays(east, north, sine0 * sine + cosine0 * cosine * cosine_turn))

    def compass(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return the unit vectors (3, ...) that point east and north at points (at a pole: along their meridian)."""
        (sine, cosine), (sine_turn, cosine_turn) = direction_of(lat_deg), direction_of(self._turn_deg(lon_deg))
        sine0, cosine0 = _direction(self.centre_lat_deg)
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
        """Return longitudes relative to the centre's; equivalent longitudes give the same number."""
        lon = np.asarray(lon_deg, dtype=np.float64)
        home = lon - 360.0 * np.round(lon / 360.0)  # exact
        return shorter_way_deg(np.where(home == -180.0, 180.0, home) - self.centre_lon_deg)


def _flat(vectors: Floats) -> tuple[Floats, Floats]:
    """Return the plane coordinates of unit vectors (3, ...); NaN for those that do not point up."""
    east, north, up = vectors
    height = np.where(up > 0.0, up, np.nan)
    return MEAN_RADIUS_M * east / height, MEAN_RADIUS_M * north / height


@lru_cache(maxsize=64)
def _direction(lat_deg: float) -> tuple[Floats, Floats]:
    """Return the sine and cosine of a centre's latitude."""
    return direction_of(lat_deg)
