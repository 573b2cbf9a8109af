"""The Mercator plane of rhumb lines: its scale, the lengths and courses of legs, and true distances on the earth.

Rhumb lines are straight there. Havens on them are in `rhumb`.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb import rhumb
from conflictdb.batches import Pieces
from conflictdb.geodesy import Earth, Floats, direction_of
from conflictdb.model import MAX_RHUMB_LATITUDE_DEG

# A haven's vertices may lie this much nearer to the pole than waypoints may, degrees.
MAX_HAVEN_LATITUDE_DEG: Final = 89.5
# The radius of the conformal sphere varies by 0.7 % from equator to pole, and great circles on it are taken for
# geodesics: over 100 km that overstates a distance by less than this share.
GEODESIC_SHARE: Final = 1e-8
# Rhumb lines curve, so that two edges may be nearest between their ends: that is seen to save less than a share of
# 0.003 (distance * tan(latitude) / radius)^4; rounded up seven times.
EDGE_SHARE: Final = 0.02
# Steps that find the nearest place on an edge: each leaves (distance * tan(latitude) / radius)^2 / 2 of the error.
NEAREST_STEPS: Final = 4
# Where distance * tan(latitude) / radius is beyond this, the nearest place is only bounded.
MAX_TURN: Final = 0.3
# What numpy holds at once when distances between all vertices and edges are taken, numbers.
BLOCK_NUMBERS: Final = 500_000


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

        A rhumb line has at most the geodesic curvature tan(latitude) / R: over a distance d the shortest way saves a
        share (d tan / R)^2 / 24 of it; a way over the pole at most a third. Rounded up.
        """
        turn = distance_m * self._tangent(scale) / self.earth.rectifying_m
        return np.asarray(distance_m / (1.0 - np.minimum(turn**2 / 4.0, 0.5)) * scale)

    def drift(self, distance_m: Floats | float, scale: Floats, speed: Floats) -> Floats:
        return np.asarray(distance_m * self._tangent(scale) / self.earth.rectifying_m * speed)

    def slant(self, scale: Floats) -> Floats:
        return np.zeros(len(scale))

    def understated_m(self, distance_m: float, scale: Floats) -> Floats:
        turn = distance_m * self._tangent(scale) / self.earth.rectifying_m
        return 2.0 * distance_m * _unsure(turn)

    def distance_m(self, a: Floats, b: Floats) -> Floats:
        found = np.empty(a.shape[2])
        step = max(1, BLOCK_NUMBERS // (a.shape[1] * b.shape[1]))
        for first in range(0, a.shape[2], step):
            block = slice(first, first + step)
            one, other = a[:, :, block] / self.earth.radius_m, b[:, :, block] / self.earth.radius_m
            found[block] = np.minimum(self._from_vertices(one, other), self._from_vertices(other, one))
        return found

    def variety(self, pieces: Pieces) -> NDArray[np.int64]:
        return rhumb.variety(self.earth, pieces)

    def shapes(
        self, pieces: Pieces, rows: NDArray[np.int64], zero_us: NDArray[np.int64], origin: Floats
    ) -> rhumb.RhumbShapes:
        # What is the same for every pair that a piece is in is computed once.
        own, row = np.unique(rows, return_inverse=True)
        into_leg_s = (zero_us - pieces.leg_start_us[rows]) / 1e6
        return rhumb.shapes_on_legs(self.earth, pieces.take(own)).take(row).counted_from(into_leg_s, origin)

    def _scale(self, y_m: Floats) -> Floats:
        return self.earth.plane_scale(y_m / self.earth.radius_m)

    def _tangent(self, scale: Floats) -> Floats:
        """Return at least the tangent of the (conformal) latitude that has this scale."""
        widest = max(self.earth.conformal_radius_m(np.array([0.0, 30.0]))) / self.earth.radius_m
        return np.asarray(np.sqrt(np.maximum((scale * widest) ** 2 - 1.0, 0.0)))

    def _from_vertices(self, points: Floats, polygon: Floats) -> Floats:
        """Return (n,) the least distance of vertices from edges of another polygon, radians of longitude and psi.

        On the sphere, between points of the Mercator plane, sin^2(d / 2) = (sin^2(dlon / 2) + sinh^2(dpsi / 2))
        sech psi1 sech psi2, exactly. Along an edge it is least at the fixed point of a step from the plane's foot.
        """
        start = polygon[:, None, :, :]
        edge = np.roll(polygon, -1, axis=1)[:, None, :, :] - start
        length = np.hypot(edge[0], edge[1])
        unit = edge / np.where(length > 0.0, length, 1.0)
        way = points[:, :, None, :] - start
        foot = way[0] * unit[0] + way[1] * unit[1]
        off = way[0] * unit[1] - way[1] * unit[0]
        along = np.clip(foot, 0.0, length)
        for _ in range(NEAREST_STEPS):
            square = off**2 + (along - foot) ** 2
            along = np.clip(foot + 0.5 * square * unit[1] * np.tanh(start[1] + along * unit[1]), 0.0, length)
        psi, psi_foot = np.broadcast_arrays(points[1][:, None, :], start[1] + along * unit[1])
        lon_apart = way[0] - along * unit[0]
        psi_apart = way[1] - along * unit[1]
        half = np.sqrt(np.sin(0.5 * lon_apart) ** 2 + np.sinh(0.5 * psi_apart) ** 2)
        half = np.minimum(half / np.sqrt(np.cosh(psi) * np.cosh(psi_foot)), 1.0)
        angle = 2.0 * np.arcsin(half)
        # Simpson's rule for the radius along the great circle, whose middle has this latitude.
        middle = np.arctanh(0.5 * (np.tanh(psi) + np.tanh(psi_foot)) / np.sqrt(1.0 - half**2))
        radius = self.earth.conformal_radius_m
        mean = (radius(psi) + 4.0 * radius(middle) + radius(psi_foot)) / 6.0
        turn = angle * np.sinh(np.maximum(np.abs(psi), np.abs(psi_foot)))
        return np.asarray((mean * angle * (1.0 - _unsure(turn))).min(axis=(0, 1)))


def _unsure(turn: Floats) -> Floats:
    """Return the share of a distance that is taken off to be sure, turn = distance * tan(latitude) / radius."""
    return np.where(turn > MAX_TURN, np.minimum(turn**2 / 4.0, 0.5), GEODESIC_SHARE + EDGE_SHARE * turn**4)
