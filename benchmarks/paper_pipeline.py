"""The paper's pipeline in Python, as a peer: boxes and intersections by shapely, stage 3, stage 4 by SLSQP.

Bienkowski, Sidoti, Pattipati, "Interference Identification for Time-Varying Polyhedra", IEEE Access 2021, on the
sphere. For areas with tracks stage 3 is the answer, as in the paper. Pairs of tracks go on to the program: the least
and the largest t for which weighted means of both polygons' vertices are one point, from one start in the middle of the
window. The extents of stage 3 are corrected (published.py): of 100 pairs of tracks whose hulls meet in 800 tracks, 64
have no window left as printed, and 45 when corrected. The motion is implemented here for one polygon and one instant;
swept hulls are input.
"""

from dataclasses import dataclass
from math import cos, radians, sin
from typing import Final

import numpy as np
import scipy.optimize
import shapely
from numpy.typing import NDArray
from published import published_windows

from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.earth.geodesy import MEAN_RADIUS_M, Earth
from conflictdb.model.results import Kind

Floats = NDArray[np.float64]
SECOND_US: Final = 1e6
# Violation of the constraints, as a share of the size of the polygons.
ACCURACY: Final = 1e-9
STEP: Final = 1e-6  # of the window, for the derivative of the vertices


@dataclass(frozen=True)
class Answers:
    """Reported pairs of pieces a, b (rows), and their first and last instants, microseconds."""

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    first_us: NDArray[np.int64]
    last_us: NDArray[np.int64]


@dataclass(frozen=True)
class Haven:
    """A haven (m, 2), metres to starboard and ahead, on a leg of constant bearing; radians, seconds since start_us."""

    outline: Floats
    lon: float
    lat: float
    bearing: float
    rate: float  # radians of the way in a second
    start_us: int

    @classmethod
    def of(cls, pieces: Pieces, row: int) -> "Haven":
        """Return the haven of a piece that is a whole leg."""
        outline = pieces.shape_xy[pieces.shape_offset[row] : pieces.shape_offset[row + 1]]
        (lon, lat), (lon2, lat2) = np.radians(pieces.leg_start_deg[row]), np.radians(pieces.leg_end_deg[row])
        bearing = radians(pieces.bearing_deg[row])
        ahead = np.hypot(lat2 - lat, (lon2 - lon) / float(_stretch(lat, np.array(lat2 - lat))))
        seconds = (pieces.leg_end_us[row] - pieces.leg_start_us[row]) / SECOND_US
        return cls(outline, lon, lat, bearing, ahead / seconds, int(pieces.leg_start_us[row]))

    def vertices(self, at_us: float) -> Floats:
        """Return the corners (m, 2) at an instant, metres of the Mercator plane."""
        gone = self.rate * (at_us - self.start_us) / SECOND_US
        sine, cosine = sin(self.bearing), cos(self.bearing)
        ahead = gone + self.outline[:, 1] / MEAN_RADIUS_M
        aside = self.outline[:, 0] / MEAN_RADIUS_M
        # Two steps, first along the bearing, then across it.
        reference = gone * cosine
        along = ahead * cosine
        lon = self.lon + gone * sine * _stretch(self.lat, np.array(reference))
        lon = lon + (ahead - gone) * sine * _stretch(self.lat + reference, along - reference)
        lon = lon + aside * cosine * _stretch(self.lat + along, -aside * sine)
        lat = self.lat + along - aside * sine
        return MEAN_RADIUS_M * np.stack([lon, np.arcsinh(np.tan(lat))], axis=1)


def _stretch(lat: float | Floats, more: Floats) -> Floats:
    """Return the change of isometric latitude per radian of latitude, on the way from one latitude to another."""
    same = np.abs(more) < 1e-12
    safe = np.where(same, 1.0, more)
    rises = 2.0 * np.arctanh(np.sin(0.5 * safe) / np.cos(lat + 0.5 * safe))
    return np.where(same, 1.0 / np.cos(lat), rises / safe)


def solve_pieces(earth: Earth, pieces: Pieces) -> Answers:
    """Return the paper's answer for whole legs and convex areas."""
    owner = np.repeat(np.arange(len(pieces)), np.diff(pieces.hull_offset))
    hulls = shapely.polygons(shapely.linearrings(pieces.hull_xy, indices=owner))
    a, b = shapely.STRtree(hulls).query(hulls)
    keep = (a < b) & (pieces.start_us[a] < pieces.end_us[b]) & (pieces.start_us[b] < pieces.end_us[a])
    a, b = a[keep], b[keep]
    region = shapely.intersection(hulls[a], hulls[b])
    met = ~shapely.is_empty(region)
    a, b, region = a[met], b[met], region[met]
    xy, pair = shapely.get_coordinates(region, return_index=True)
    offset = np.searchsorted(pair, np.arange(len(a) + 1)).astype(np.int64)
    pairs = Pairs(PieceRows(a), PieceRows(b), xy, offset)
    moves = pieces.kind == Kind.TRACK.code
    start, end = pieces.shared_span(pairs.a, pairs.b)
    first_us, last_us = start.copy(), end.copy()
    some = np.flatnonzero(moves[a] | moves[b])
    moving = pairs.take(some)
    first, last = published_windows(earth, pieces, moving, mended=True)
    first_us[some] = start[some] + (first * SECOND_US).astype(np.int64)
    last_us[some] = start[some] + (last * SECOND_US).astype(np.int64)
    found = first_us <= last_us
    both = moves[a] & moves[b] & found
    for row in np.flatnonzero(both).tolist():
        one, other = Haven.of(pieces, a[row]), Haven.of(pieces, b[row])
        ends = [extreme(one, other, first_us[row], last_us[row], latest=latest) for latest in (False, True)]
        found[row] = None not in ends
        if found[row]:
            first_us[row], last_us[row] = ends
    return Answers(a[found], b[found], first_us[found], last_us[found])


def extreme(one: Haven, other: Haven, first_us: int, last_us: int, *, latest: bool) -> int | None:
    """Return the first (or latest) instant at which two havens share a point, None if the solver finds none."""
    m, n = len(one.outline), len(other.outline)
    width = float(last_us - first_us)
    origin = one.vertices(first_us)[0]
    size = float(np.ptp(np.concatenate([one.vertices(first_us), other.vertices(first_us)]), axis=0).max())

    def corners(fraction: float) -> Floats:
        at = first_us + fraction * width
        return (np.concatenate([one.vertices(at), -other.vertices(at)]) - np.r_[[origin] * m, [-origin] * n]) / size

    sums = np.zeros((2, 1 + m + n))
    sums[0, 1 : 1 + m] = sums[1, 1 + m :] = 1.0

    def apart(z: Floats) -> Floats:
        return np.concatenate([z[1:] @ corners(z[0]), sums @ z - 1.0])

    def gradient(z: Floats) -> Floats:
        now = corners(z[0])
        moving = z[1:] @ (corners(z[0] + STEP) - now) / STEP
        return np.concatenate([np.concatenate([moving[:, None], now.T], axis=1), sums])

    sign = np.zeros(1 + m + n)
    sign[0] = -1.0 if latest else 1.0
    result = scipy.optimize.minimize(
        lambda z: sign[0] * z[0],
        np.concatenate([[0.5], np.full(m, 1.0 / m), np.full(n, 1.0 / n)]),
        jac=lambda z: sign,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * (1 + m + n),
        constraints=[{"type": "eq", "fun": apart, "jac": gradient}],
        options={"maxiter": 100, "ftol": ACCURACY},
    )
    return first_us + int(result.x[0] * width) if result.success else None
