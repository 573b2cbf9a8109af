"""The Mercator plane of rhumb lines: its scale, the lengths and courses of legs, and true distances on the earth.

Rhumb lines are straight there. Havens on them are in `rhumb`.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb import kernel
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth import rhumb_distance
from conflictdb.earth.geodesy import Earth, Floats, Sides, direction_of
from conflictdb.earth.rhumb_distance import BLOCK_NUMBERS, NEARBY
from conflictdb.model import MAX_RHUMB_LATITUDE_DEG
from conflictdb.motion import rhumb

# A haven's vertices may lie this much nearer to the pole than waypoints may, degrees.
MAX_HAVEN_LATITUDE_DEG: Final = 89.5


@dataclass(frozen=True, slots=True)
class Mercator:
    """The Mercator plane of a figure of the earth: x = a * longitude, y = a * psi(latitude)."""

    earth: Earth

    @property
    def turn_m(self) -> float:
        return float(2.0 * np.pi * self.earth.radius_m)

    @property
    def is_conformal(self) -> bool:
        return True

    @property
    def kernel_plane(self) -> kernel.Plane:
        return kernel.Plane.mercator(self.earth)

    def to_plane(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        return self.earth.to_plane(lon_deg, lat_deg)

    def from_plane(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[Floats, Floats]:
        return self.earth.from_plane(x_m, y_m)

    @property
    def lines(self) -> str:
        return "rhumb lines"

    @property
    def limit(self) -> str:
        return (
            f"latitude beyond {MAX_RHUMB_LATITUDE_DEG:g} degrees has no place in a scene with motion 'rhumb': the "
            "Mercator plane stretches without limit towards the poles; use motion 'great_circle'"
        )

    @property
    def haven_limit(self) -> str:
        return f"the haven reaches beyond {MAX_HAVEN_LATITUDE_DEG:g} degrees of latitude on one of its legs"

    def holds(self, lon_deg: Floats, lat_deg: Floats) -> NDArray[np.bool_]:
        return np.asarray(np.abs(lat_deg) <= MAX_RHUMB_LATITUDE_DEG)

    def holds_havens(self, pieces: Pieces) -> NDArray[np.bool_]:
        east, north = direction_of(pieces.bearing_deg)
        of_vertex = np.repeat(np.arange(len(pieces)), np.diff(pieces.shape_offset))
        highest = np.zeros(len(pieces))
        # Latitudes are linear in time, also of havens that grow.
        for ends, shape in ((pieces.leg_start_deg, pieces.shape_xy), (pieces.leg_end_deg, pieces.shape_to_xy)):
            outline = shape / self.earth.rectifying_m
            first = outline[:, 1] * north[of_vertex]
            second = first - outline[:, 0] * east[of_vertex]
            mu = self.earth.rectifying(np.radians(ends[:, 1]))[of_vertex]
            np.maximum.at(highest, of_vertex, np.maximum(np.abs(mu + first), np.abs(mu + second)))
        return np.asarray(np.degrees(highest) <= MAX_HAVEN_LATITUDE_DEG)

    def courses(self, start_deg: Floats, end_deg: Floats) -> tuple[Floats, Floats, Floats]:
        mu1, mu2 = (self.earth.rectifying(np.radians(ends[:, 1])) for ends in (start_deg, end_deg))
        east = np.radians(end_deg[:, 0] - start_deg[:, 0]) / self.earth.stretch(mu1, mu2)
        north = mu2 - mu1
        bearing = np.degrees(np.arctan2(east, north))
        return self.earth.rectifying_m * np.hypot(east, north), bearing, bearing

    def largest_scale(self, points: Floats) -> Floats:
        return self._scale(np.abs(points[1]).max(axis=0))

    def smallest_scale(self, points: Floats) -> Floats:
        return self._scale(np.maximum(np.maximum(points[1].min(axis=0), -points[1].max(axis=0)), 0.0))

    def span_m(self, distance_m: Floats | float, scale: Floats) -> Floats:
        """Return the plane metres of a distance on the earth.

        On the sphere, with s = cosh(psi) sin(theta / 2), that is at most 2 asin(s) where s < 1, and 2 hypot(pi / 2,
        acosh(s)) elsewhere: see the formula of `rhumb_distance`. The bounds taken here lie above these and are convex
        in ln s, so that half of what each end needs is enough. The radius of the conformal sphere changes by
        oblateness * theta on the way.
        """
        radius = self.earth.radius_m
        theta = distance_m / radius
        change = 1.0 + self._most_change(theta)
        s = scale * change * np.sin(np.minimum(0.5 * theta, 0.5 * np.pi))
        beyond = np.pi + (3.0 * np.pi - 4.0) * np.log(np.maximum(s, 1.0))
        return np.asarray(radius * np.where(s < 1.0, 2.0 * s + (np.pi - 2.0) * s**3, beyond))

    def least_m(self, span_m: Floats, scale: Floats) -> Floats:
        """Return the least distance of places this far apart in the plane: what `span_m` is from."""
        radius = self.earth.radius_m
        sine = np.sin(np.minimum(0.5 * span_m / radius, 0.5 * np.pi))
        theta = 2.0 * np.arcsin(np.minimum(sine / np.maximum(scale, 1.0), 1.0))
        return np.asarray(radius * theta / (1.0 + self._most_change(1.01 * theta)))

    def distortion_rate(self, distance_m: Floats | float, scale: Floats, speed: Floats) -> Floats:
        """Return the rate, plane m/s, at which distances may change for points that keep their plane distance.

        The shortest way pulls at its ends with 1 / scale, and on the way that changes by tanh(psi) / radius a metre.
        """
        sine = np.sin(self._highest(distance_m, scale))
        return np.asarray(distance_m / self.earth.radius_m * (1.0 + self._shrinks) * sine * scale * speed)

    def gradient_angle(self, distance_m: Floats | float, scale: Floats) -> Floats:
        """Return by how much the shortest way turns in the plane, radians: by tan(latitude) / radius a metre."""
        highest = self._highest(distance_m, scale)
        tangent = np.tan(np.minimum(highest, 0.5 * np.pi - 1e-9))
        return np.asarray(distance_m / self.earth.radius_m * (1.0 + self._shrinks) * tangent)

    def christoffel_bound(self, scale: Floats) -> Floats:
        """Return |grad ln(scale)|, 1/m: of a conformal metric ds = |dz| / scale it bounds the Christoffel symbols."""
        tangent = scale * np.sin(self._highest(0.0, scale))
        return np.asarray((1.0 + self._shrinks) * tangent / self.earth.radius_m)

    def distance_error_m(self, distance_m: Floats | float) -> Floats:
        return rhumb_distance.error_m(self.earth, distance_m)

    def distance_m(self, a: Floats, b: Floats, sides_a: Sides, sides_b: Sides) -> Floats:
        earth = self.earth
        found = np.empty(a.shape[2])
        step = max(1, BLOCK_NUMBERS // max(a.shape[1] * len(sides_b[0]), b.shape[1] * len(sides_a[0])))
        for first in range(0, a.shape[2], step):
            block = slice(first, first + step)
            one, other = a[:, :, block] / earth.radius_m, b[:, :, block] / earth.radius_m
            least = np.minimum(
                rhumb_distance.nearby_m(earth, one, other, sides_b), rhumb_distance.nearby_m(earth, other, one, sides_a)
            )
            # This is the least distance if all places that are as near lie nearby in the plane, and none across the
            # seam.
            corners = np.concatenate([one, other], axis=1)
            width = corners[0].max(axis=0) - corners[0].min(axis=0)
            span = self.span_m(least, earth.plane_scale(np.abs(corners[1]).max(axis=0)))
            far = np.flatnonzero((span > NEARBY * earth.radius_m) | (width > 2.0 * np.pi - NEARBY))
            if far.size:
                least[far] = rhumb_distance.anywhere_m(earth, one[:, :, far], other[:, :, far], sides_a, sides_b)
            found[block] = least
        return np.maximum(found - rhumb_distance.overestimate_m(earth, found), 0.0)

    def shape_variant(self, pieces: Pieces) -> NDArray[np.int64]:
        return rhumb.shape_variant(self.earth, pieces)

    def shapes(
        self, pieces: Pieces, rows: NDArray[np.int64], zero_us: NDArray[np.int64], origin: Floats
    ) -> rhumb.RhumbShapes:
        # A piece is in many pairs: what is the same in all of them is computed once.
        own, row = np.unique(rows, return_inverse=True)
        into_leg_s = (zero_us - pieces.leg_start_us[rows]) / 1e6
        return rhumb.shapes_on_legs(self.earth, pieces.take(own)).take(row).counted_from(into_leg_s, origin)

    def _scale(self, y_m: Floats) -> Floats:
        return self.earth.plane_scale(y_m / self.earth.radius_m)

    @property
    def _shrinks(self) -> float:
        """The most that the conformal sphere's radius adds to the scale and how it changes, as a share of tanh(psi)."""
        return 3.02 * self.earth.oblateness

    def _most_change(self, theta: Floats | float) -> Floats:
        """Return by what share the radius of the conformal sphere may change on a way of theta radians."""
        return np.asarray(1.01 * self.earth.oblateness * np.minimum(theta, 1.0))

    def _highest(self, distance_m: Floats | float, scale: Floats) -> Floats:
        """Return at least the highest conformal latitude, radians, of a shortest way whose ends have this scale."""
        highest = np.arccos(1.0 / np.maximum(scale, 1.0)) + 0.505 * distance_m / self.earth.radius_m
        return np.asarray(np.minimum(highest, 0.5 * np.pi))
