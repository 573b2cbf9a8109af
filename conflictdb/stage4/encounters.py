"""What a solver of stage 4 sees: pairs of moving polygons with a common clock and origin, and the separation wanted."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import Floats, Sides
from conflictdb.motion.contract import Plane, Rows, Shapes, origins, shape_classes, shapes_of, sides_of
from conflictdb.stage4.constants import BATCH_NUMBERS, PAIRS_AT_ONCE, SHORT_M, TOUCH_M


@dataclass(frozen=True, slots=True)
class Encounters:
    """n pairs of shapes with a common time zero and origin, and the separation wanted between them, metres.

    origin : (2, n) plane metres
    company : (n,) with how many pairs each shares the work, see `Pairs`
    """

    plane: Plane
    a: Shapes
    b: Shapes
    origin: Floats
    separation_m: float
    company: NDArray[np.int64] | None = None

    @classmethod
    def of(
        cls,
        plane: Plane,
        separation_m: float,
        pieces: Pieces,
        pairs: Pairs,
        rows: NDArray[np.int64],
        zero_us: NDArray[np.int64],
    ) -> "Encounters":
        """Return the encounters of some pairs of like pieces; row i counts its time from zero_us[i]."""
        origin = origins(plane, pieces, pairs.a[rows])
        a, b = (shapes_of(plane, pieces, member[rows], zero_us, origin) for member in (pairs.a, pairs.b))
        return cls(plane, a, b, origin, separation_m, None if pairs.company is None else pairs.company[rows])

    def __len__(self) -> int:
        return int(self.origin.shape[1])

    def take(self, rows: Rows) -> Self:
        """Return the encounters of some rows."""
        company = None if self.company is None else self.company[rows]
        a, b = self.a.take(rows), self.b.take(rows)
        return type(self)(self.plane, a, b, self.origin[:, rows], self.separation_m, company)

    def share(self, of: int, least: int, most: int) -> NDArray[np.int64]:
        """Return (n,) the share of each pair in what all pairs of pieces of two objects share, clipped."""
        company = np.ones(len(self), np.int64) if self.company is None else self.company
        return np.clip(of // company, least, most)

    def batches(self, n: int) -> list[slice]:
        """Return slices of n rows that keep the arrays of an evaluation within bounds."""
        step = max(1, BATCH_NUMBERS // (self.a.vertex_count + self.b.vertex_count))
        return [slice(first, first + step) for first in range(0, max(n, 1), step)]

    @property
    def certainty_margin_m(self) -> float:
        """A pair found with a clearance of minus this, or less, is certain to be in contact, metres on the earth."""
        return TOUCH_M + self.distance_error_m(self.separation_m)

    def distance_error_m(self, distance_m: float) -> float:
        """Return by how much the distance found may be less than the true one; 0 where it comes from the plane."""
        return float(self.plane.distance_error_m(distance_m)) if distance_m > short_m(self.plane) else 0.0

    @property
    def sides(self) -> tuple[Sides, Sides]:
        """Of a and of b, which vertices their sides run between."""
        a, b = (sides_of(shape.vertex_count, convex=shape.is_convex) for shape in (self.a, self.b))
        return a, b

    def scale(self, *polygons: Floats) -> tuple[Floats, Floats]:
        """Return (n,) the largest and smallest scale in the hulls of all vertices (2, v, n) of each of these pairs."""
        points = np.concatenate(polygons, axis=1) + self.origin[:, None, :]
        return self.plane.largest_scale(points), self.plane.smallest_scale(points)


def group_by_shape(plane: Plane, pieces: Pieces, pairs: Pairs, rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return batches of rows of pairs whose pieces can share arrays."""
    if not len(rows):
        return []
    _, group = np.unique(shape_classes(plane, pieces, pairs)[:, rows], axis=1, return_inverse=True)
    batches = []
    for g in range(int(group.max()) + 1):
        same = rows[group == g]
        batches += [same[first : first + PAIRS_AT_ONCE] for first in range(0, len(same), PAIRS_AT_ONCE)]
    return batches


def short_m(plane: Plane) -> float:
    """Return up to which distance, metres, the nearest points in the plane are also the nearest on the earth.

    That needs a conformal plane; in another it holds only of polygons that touch.
    """
    return SHORT_M if plane.is_conformal else TOUCH_M
