"""The plane of a scene: its tracks and edges are straight there, and the kernel moves polygons in it.

To add an earth or motion, write another `Plane` (see `mercator` and `gnomonic`), name it in `registry`, and add a case
to the kernel (docs/explanation/kernel.md).
"""

from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import Pieces
from conflictdb.model.results import Kind

# Plane coordinates reach 4e7 m, where float64 has a spacing of 7.5e-9 m; a vertex is a sum of about ten such terms.
ROUNDING_ALLOWANCE_M: Final = 1e-6


class Plane(Protocol):
    """A plane in which the tracks and edges of a scene are straight; metres inside, degrees in its interface."""

    @property
    def turn_m(self) -> float:
        """Plane metres of one turn of longitude; 0 where the plane has no seam."""

    @property
    def is_conformal(self) -> bool:
        """Whether angles in the plane equal those on the earth."""

    @property
    def kernel_plane(self) -> kernel.KernelPlane:
        """The plane's parameters for the kernel."""

    def to_plane(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return plane x and y of longitudes and latitudes."""

    def project(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Return `to_plane` and `holds` at once."""

    def from_plane(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[Floats, Floats]:
        """Return longitudes (not wrapped) and latitudes of plane x and y."""

    @property
    def lines(self) -> str:
        """The name of straight lines on the earth, for errors."""

    @property
    def limit(self) -> str:
        """The limits of the plane (of `holds`) and the remedy, for errors."""

    @property
    def haven_limit(self) -> str:
        """The same for havens (of `holds_havens`)."""

    def holds(self, lon_deg: Floats, lat_deg: Floats) -> NDArray[np.bool_]:
        """Return (n,) whether corners of areas and waypoints are within the plane's limits."""

    def holds_havens(self, pieces: Pieces) -> NDArray[np.bool_]:
        """Return (n,) whether the havens of track pieces stay in the plane during the whole leg."""

    def courses(self, start_deg: Floats, end_deg: Floats) -> tuple[Floats, Floats, Floats]:
        """Return lengths (metres) and bearings (degrees) at the start and end of legs.

        start_deg, end_deg : (n, 2) longitude and latitude; longitudes are unwrapped from start to end. A leg without
            movement has length 0.
        """

    def largest_scale(self, points: Floats) -> Floats:
        """Return (n,) the largest plane metres per metre on the earth, any direction, in hulls of points (2, v, n)."""

    def smallest_scale(self, points: Floats) -> Floats:
        """Return (n,) the smallest plane metres per metre on the earth (>= 1) in the hulls of points (2, v, n)."""

    def span_m(self, distance_m: Floats | float, scale: Floats) -> Floats:
        """Return an upper bound on the plane metres between two places `distance_m` apart on the earth.

        scale : the larger of the scales at both

        Half of the bound at the scale of one place plus half at that of the other is also a bound.
        """

    def distance_error_m(self, distance_m: Floats | float) -> Floats:
        """Return the largest excess of the true distance over the kernel's, for a distance of this length."""


def origins(plane: Plane, pieces: Pieces, rows: NDArray[np.int64]) -> Floats:
    """Return (2, n) a plane point at or near each piece; coordinates relative to it keep their digits."""
    x, y = pieces.shape_xy[pieces.shape_offset[rows]].T
    leg_x, leg_y = plane.to_plane(pieces.leg_start_deg[rows, 0], pieces.leg_start_deg[rows, 1])
    moves = pieces.kind[rows] == Kind.TRACK.code
    return np.stack([np.where(moves, leg_x, x) + plane.turn_m * pieces.turn[rows], np.where(moves, leg_y, y)])


def padding_m(plane: Plane, largest_scale: Floats, wanted_m: float) -> Floats:
    """Return (n,) the padding with which hulls of pieces within wanted_m metres of each other intersect.

    Each hull is padded by half of the distance, at the largest scale of its piece. Both halves together cover the
    distance between the pieces, because the scale is convex along it.
    """
    return np.asarray(0.5 * plane.span_m(wanted_m, largest_scale) + ROUNDING_ALLOWANCE_M)
