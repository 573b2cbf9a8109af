"""Compute in the Mercator plane, where rhumb lines are straight: scale, lengths and courses, distances on the earth."""

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth import rhumb_distance
from conflictdb.earth.geodesy import Earth, direction_of
from conflictdb.model.plans import MAX_RHUMB_LATITUDE_DEG

# Latitude limit of a haven's vertices, nearer to the pole than that of waypoints, degrees.
MAX_HAVEN_LATITUDE_DEG: Final = 89.5


@cache
def _kernel_plane(earth: Earth) -> kernel.KernelPlane:
    """Return the plane of a figure of the earth."""
    kind = kernel.KernelPlane.MERCATOR
    plane = kernel.KernelPlane(kind, max(len(earth.to_rectifying), len(earth.to_conformal)), earth.radius_m)
    plane.rectifying_m, plane.eccentricity = earth.rectifying_m, earth.eccentricity
    plane.oblateness = earth.oblateness
    for name in ("to_rectifying", "to_conformal", "conformal_radius"):
        series = getattr(earth, name)
        getattr(plane, name)[: len(series)] = series
    return plane


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
    def kernel_plane(self) -> kernel.KernelPlane:
        return _kernel_plane(self.earth)

    def to_plane(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        return self.earth.to_plane(lon_deg, lat_deg)

    def project(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        return *self.to_plane(lon_deg, lat_deg), self.holds(lon_deg, lat_deg)

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
        # Latitudes are linear in time, also for growing havens.
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
        acosh(s)) elsewhere: see the formula of `rhumb_distance`. The bounds used here are larger and convex in ln s, so
        that half of the need of each end is enough. The radius of the conformal sphere changes by at most oblateness *
        theta along the path.
        """
        radius = self.earth.radius_m
        theta = distance_m / radius
        change = 1.0 + self._most_change(theta)
        s = scale * change * np.sin(np.minimum(0.5 * theta, 0.5 * np.pi))
        beyond = np.pi + (3.0 * np.pi - 4.0) * np.log(np.maximum(s, 1.0))
        return np.asarray(radius * np.where(s < 1.0, 2.0 * s + (np.pi - 2.0) * s**3, beyond))

    def distance_error_m(self, distance_m: Floats | float) -> Floats:
        return rhumb_distance.error_m(self.earth, distance_m)

    def _scale(self, y_m: Floats) -> Floats:
        return self.earth.plane_scale(y_m / self.earth.radius_m)

    def _most_change(self, theta: Floats | float) -> Floats:
        """Return the largest relative change of the conformal sphere's radius over a distance of theta radians."""
        return np.asarray(1.01 * self.earth.oblateness * np.minimum(theta, 1.0))
