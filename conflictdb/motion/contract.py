"""Where the polygon of a piece is at an instant, and the plane it moves in: what every stage works on.

Tracks and edges of a scene are straight in its `Plane`, which makes the `Shapes` of its tracks. A further earth or kind
of motion is one more `Plane` (see `mercator` and `gnomonic`), named in `registry`.

Arrays hold the pair or piece in their last axis: arithmetic then runs along contiguous memory, however few vertices
there are.
"""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb import kernel
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.results import Kind

# Plane coordinates reach 4e7 m, where float64 has a spacing of 7.5e-9 m; a vertex is a sum of about ten such terms.
ROUNDING_ALLOWANCE_M: Final = 1e-6


Rows = NDArray[np.int64] | slice


class Shapes(Protocol):
    """n convex polygons of v vertices each, as functions of time (seconds; each row has its own zero and origin)."""

    @property
    def vertex_count(self) -> int:
        """Vertices per polygon."""

    @property
    def is_convex(self) -> bool:
        """Whether the vertices are known to be in convex position in the plane (else their hull is meant)."""

    def take(self, rows: Rows) -> "Shapes":
        """Return the shapes of some rows; views of a slice."""

    def positions(self, t: Floats) -> Floats:
        """Return the vertices at times t (n,), (2, v, n) plane metres from the row's origin."""

    def velocities(self, t: Floats) -> Floats:
        """Return the vertices' velocities at times t (n,), (2, v, n) plane metres per second."""

    def max_acceleration(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) bounds on the second derivative of every vertex during [t0, t1], plane metres per s^2."""

    def velocity(self, t: Floats) -> Floats:
        """Return one velocity for each whole polygon at times t (n,), (2, n) plane metres per second."""

    def velocity_spread(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) bounds on |v_i(t) - velocity(middle)| over all vertices i and t in [t0, t1], plane m/s."""


class Havens(Shapes, Protocol):
    """Shapes that ride along straight lines of the plane."""

    def reference(self, t: Floats) -> Floats:
        """Return the reference points at times t (n,), (2, n) plane metres from the row's origin."""

    def chord_deviation(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) how far outside of the hull of its ends a vertex may be during [t0, t1], plane metres."""

    def largest_scale(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) the largest scale (see `Plane`) that any vertex or step reaches during [t0, t1]."""

    def time_fraction(self, t0: Floats, t1: Floats, plane_fraction: Floats) -> Floats:
        """Return (n,) the fraction of the time from t0 to t1 gone at a fraction of the way in the plane."""


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

    def shape_variant(self, pieces: Pieces) -> NDArray[np.int64]:
        """Return (n,) a number for the formula of each piece's shape: pieces in one array have the same."""

    def shapes(self, pieces: Pieces, rows: NDArray[np.int64], zero_us: NDArray[np.int64], origin: Floats) -> Havens:
        """Return the havens of some track pieces; row i counts time from zero_us[i], metres from origin[:, i]."""


@dataclass(frozen=True, slots=True)
class StaticShapes:
    """Polygons that stand still; xy : (2, v, n) plane metres."""

    xy: Floats

    @property
    def vertex_count(self) -> int:
        return int(self.xy.shape[1])

    @property
    def is_convex(self) -> bool:
        return True

    def take(self, rows: Rows) -> "StaticShapes":
        return StaticShapes(self.xy[:, :, rows])

    def positions(self, t: Floats) -> Floats:
        return self.xy

    def velocities(self, t: Floats) -> Floats:
        return np.zeros_like(self.xy)

    def max_acceleration(self, t0: Floats, t1: Floats) -> Floats:
        return np.zeros(self.xy.shape[2])

    def velocity(self, t: Floats) -> Floats:
        return np.zeros((2, self.xy.shape[2]))

    def velocity_spread(self, t0: Floats, t1: Floats) -> Floats:
        return np.zeros(self.xy.shape[2])


def vertex_slots(pieces: Pieces) -> NDArray[np.int64]:
    """Return (n,) in how many vertices each piece's shape is held: pieces of equal slots can share an array.

    Points and lines have one and two slots, polygons the next power of two. So the numbers computed for a piece do not
    depend on the other pieces of the batch.
    """
    return _slots(np.diff(pieces.shape_offset))


def _slots(count: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.where(count <= 2, count, 2 ** np.ceil(np.log2(np.maximum(count, 1))).astype(np.int64))


def shape_class(plane: Plane, pieces: Pieces) -> NDArray[np.int64]:
    """Return (n,) numbers that are equal for pieces whose shapes can share an array."""
    return 2 * (vertex_slots(pieces) * 64 + plane.shape_variant(pieces)) + pieces.kind


def shape_vertices(pieces: Pieces, rows: NDArray[np.int64], *, at_end: bool = False) -> Floats:
    """Return the shapes of some pieces of equal slots, (2, v, n); shorter ones repeat their last vertex.

    at_end : at the end of the leg, not at its start
    """
    first = pieces.shape_offset[rows]
    count = pieces.shape_offset[rows + 1] - first
    slots = int(_slots(count).max(initial=1))
    index = first + np.minimum(np.arange(slots)[:, None], count - 1)
    xy = pieces.shape_to_xy if at_end else pieces.shape_xy
    return np.stack([xy[index, 0], xy[index, 1]])


def shapes_of(
    plane: Plane, pieces: Pieces, rows: NDArray[np.int64], zero_us: NDArray[np.int64], origin: Floats | None = None
) -> Shapes:
    """Return the shapes of pieces that are all of one kind.

    Row i counts its time from instant zero_us[i], and its coordinates from origin[:, i] (the plane's own if None).
    """
    origin = np.zeros((2, len(rows))) if origin is None else origin
    if len(rows) and pieces.kind[rows[0]] == Kind.TRACK.code:
        return plane.shapes(pieces, rows, zero_us, origin)
    xy = shape_vertices(pieces, rows)
    xy[0] += plane.turn_m * pieces.turn[rows]
    return StaticShapes(xy - origin[:, None, :])


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
