"""The plane that a scene lives in: its tracks and edges are straight there, and the kernel moves polygons in it.

A further earth or kind of motion is one more `Plane` (see `mercator` and `gnomonic`), named in `registry`, and one more
case in the kernel (docs/explanation/kernel.md).
"""

from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb import kernel
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.results import Kind

# Plane coordinates reach 4e7 m, where float64 has a spacing of 7.5e-9 m; a vertex is a sum of about ten such terms.
ROUNDING_ALLOWANCE_M: Final = 1e-6


class Plane(Protocol):
    """Where the tracks and edges of a scene are straight; coordinates in metres, degrees at the border."""

    @property
    def turn_m(self) -> float:
        """Plane metres of one turn of longitude; 0 where the plane has no seam."""

    @property
    def is_conformal(self) -> bool:
        """Whether angles in the plane are those on the earth."""

    @property
    def kernel_plane(self) -> kernel.Plane:
        """What the kernel needs to know of the plane."""

    def to_plane(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return plane x and y of longitudes and latitudes."""

    def from_plane(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[Floats, Floats]:
        """Return longitudes (not wrapped) and latitudes of plane x and y."""

    @property
    def lines(self) -> str:
        """What straight lines are on the earth, as errors call them."""

    @property
    def limit(self) -> str:
        """How far the plane goes and what to do beyond, as errors say it: what `holds` is about."""

    @property
    def haven_limit(self) -> str:
        """The same for havens: what `holds_havens` is about."""

    def holds(self, lon_deg: Floats, lat_deg: Floats) -> NDArray[np.bool_]:
        """Return (n,) whether corners of areas and waypoints may be there."""

    def holds_havens(self, pieces: Pieces) -> NDArray[np.bool_]:
        """Return (n,) whether the havens of track pieces stay in the plane during the whole leg."""

    def courses(self, start_deg: Floats, end_deg: Floats) -> tuple[Floats, Floats, Floats]:
        """Return lengths (metres) and bearings (degrees) at the start and end of legs.

        start_deg, end_deg : (n, 2) longitude and latitude; longitudes run on from start to end. Where there is no way
        to go the length is 0.
        """

    def largest_scale(self, points: Floats) -> Floats:
        """Return (n,) the most plane metres per metre on the earth, any way, in the hulls of points (2, v, n)."""

    def smallest_scale(self, points: Floats) -> Floats:
        """Return (n,) the fewest plane metres per metre on the earth (>= 1) in the hulls of points (2, v, n)."""

    def span_m(self, distance_m: Floats | float, scale: Floats) -> Floats:
        """Return an upper bound of the plane metres between two places this far apart on the earth.

        scale : the largest at either

        Half of the bound at the scale of one place, plus half at that of the other, is a bound, too.
        """

    def distance_error_m(self, distance_m: Floats | float) -> Floats:
        """Return by how much, at most, the true distance exceeds what the kernel finds where that is so long."""


def origins(plane: Plane, pieces: Pieces, rows: NDArray[np.int64]) -> Floats:
    """Return (2, n) a plane point at or near each piece: coordinates counted from there keep their digits."""
    x, y = pieces.shape_xy[pieces.shape_offset[rows]].T
    leg_x, leg_y = plane.to_plane(pieces.leg_start_deg[rows, 0], pieces.leg_start_deg[rows, 1])
    moves = pieces.kind[rows] == Kind.TRACK.code
    return np.stack([np.where(moves, leg_x, x) + plane.turn_m * pieces.turn[rows], np.where(moves, leg_y, y)])


def padding_m(plane: Plane, largest_scale: Floats, wanted_m: float) -> Floats:
    """Return (n,) how far hulls are padded, so that the hulls of pieces within wanted_m metres of each other meet.

    Each hull is padded by half of the distance, at the largest scale that its piece reaches. Both halves cover the way
    between the pieces, because the scale is convex along it.
    """
    return np.asarray(0.5 * plane.span_m(wanted_m, largest_scale) + ROUNDING_ALLOWANCE_M)
