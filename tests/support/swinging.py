"""Motion made for tests of the solvers: squares that swing towards walls, as often as one likes; answers by hand."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from conflictdb.earth.geodesy import Floats, earth_of
from conflictdb.model import EarthModel
from conflictdb.motion.contract import Rows, StaticShapes
from conflictdb.motion.mercator import Mercator
from conflictdb.stage4.encounters import Encounters

SWING_S: Final = 100.0
RATE: Final = 2.0 * np.pi / SWING_S


@dataclass(frozen=True)
class Swinging:
    """Squares (n,) that swing along the equator, furthest to the east at t = 0 and once every SWING_S.

    side_m : from the middle of a square to its side; middle_m, by_m : (n,) where they swing about, and how far
    """

    side_m: float
    middle_m: Floats
    by_m: Floats

    vertex_count = 4
    is_convex = True

    def take(self, rows: Rows) -> Self:
        return type(self)(self.side_m, self.middle_m[rows], self.by_m[rows])

    def positions(self, t: Floats) -> Floats:
        corners = self.side_m * np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0]])
        east = self.middle_m + self.by_m * np.cos(RATE * t)
        return np.asarray(corners[:, :, None] + np.stack([east, np.zeros_like(east)])[:, None, :])

    def velocities(self, t: Floats) -> Floats:
        return np.repeat(self.velocity(t)[:, None, :], 4, axis=1)

    def max_acceleration(self, t0: Floats, t1: Floats) -> Floats:
        return np.asarray(self.by_m * RATE**2)

    def velocity(self, t: Floats) -> Floats:
        east = -RATE * self.by_m * np.sin(RATE * t)
        return np.stack([east, np.zeros_like(east)])

    def velocity_spread(self, t0: Floats, t1: Floats) -> Floats:
        return np.asarray(0.5 * (t1 - t0) * self.max_acceleration(t0, t1))


def encounters(
    least_m: list[float], separation_m: float = 0.0, earth: EarthModel = EarthModel.SPHERE, by_m: float = 50.0
) -> Encounters:
    """Walls, and squares that swing so that they come so near, at 50 s, 150 s, ...; overlaps are below 0."""
    n, side_m = len(least_m), 1.0
    wall = np.array([[-300.0, 0.0, 0.0, -300.0], [-1.0, -1.0, 1.0, 1.0]])
    middle_m = np.array(least_m) + separation_m + side_m + by_m
    return Encounters(
        Mercator(earth_of(earth)),
        StaticShapes(np.repeat(wall[:, :, None], n, axis=2)),
        Swinging(side_m, middle_m, np.full(n, by_m)),
        np.zeros((2, n)),
        separation_m,
    )


def half_s(least_m: float, within_m: float = 0.0, by_m: float = 50.0) -> float:
    """Half the seconds for which a swing is that near."""
    return float(np.arccos(1.0 - (within_m - least_m) / by_m) / RATE)
