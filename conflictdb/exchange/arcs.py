"""Arcs of circles in the outlines of areas, and outlines of lines and arcs.

The polygon contains an arc that bulges outward, and exceeds its radius by at most a thousandth. An arc that bulges
inward becomes chords, which lie outside the area.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import shorter_way_deg
from conflictdb.earth.shortest_lines import LEAST_CURVED_M, places_at
from conflictdb.model.plans import EarthModel

Floats = NDArray[np.float64]

# A full circle has at least _LEAST_CORNERS corners: its sides deviate by less than half a thousandth of the radius.
# Sides are at most _MOST_APART_M long.
_LEAST_CORNERS: Final = 128
_MOST_APART_M: Final = 5_000.0
_HIGHEST: Final = float(np.radians(89.0))
# Ends of parts of an outline that are no further apart are one position.
_SAME_DEG: Final = 2e-5


@dataclass(frozen=True, slots=True)
class Arc:
    """An arc around a centre, from one azimuth to another, degrees clockwise from north.

    end_radius_m : the distance of its end from the centre; None: as that of its start. Of the two radii the arc has the
        one that makes the area larger
    """

    lon_deg: float
    lat_deg: float
    radius_m: float
    start_deg: float
    end_deg: float
    end_radius_m: float | None = None

    @property
    def count(self) -> int:
        """The number of its chords."""
        turn, radius_m = abs(self.end_deg - self.start_deg), max(self.radius_m, self.end_radius_m or 0.0)
        corners = max(_LEAST_CORNERS, int(np.ceil(2.0 * np.pi * radius_m / _MOST_APART_M)))
        return max(2, int(np.ceil(turn / 360.0 * corners)))

    def positions(self, *, is_outward: bool) -> Floats:
        """Return positions (n, 2); those of an arc that bulges outward lie on its tangents, others on it."""
        step = (self.end_deg - self.start_deg) / self.count
        azimuth: Floats = self.start_deg + step * np.arange(self.count + 1, dtype=np.float64)
        last_m = self.radius_m if self.end_radius_m is None else self.end_radius_m
        radius_m = (max if is_outward else min)(self.radius_m, last_m)
        if is_outward:
            azimuth = np.concatenate([azimuth[:1], azimuth[:-1] + 0.5 * step, azimuth[-1:]])
            half = np.radians(0.5 * abs(step))
            # A tangent as a rhumb line bends inward by this, as in `shortest_lines`.
            highest = min(abs(np.radians(self.lat_deg)) + radius_m / LEAST_CURVED_M, _HIGHEST)
            bend_m = 0.51 * (radius_m * np.tan(half)) ** 2 * np.tan(highest) / LEAST_CURVED_M
            radius_m = float((radius_m + bend_m) / np.cos(half))
        line = self._at(azimuth, radius_m)
        line[:1], line[-1:] = self._at(azimuth[:1], self.radius_m), self._at(azimuth[-1:], last_m)
        return line

    def _at(self, azimuth_deg: Floats, radius_m: float) -> Floats:
        azimuth = np.radians(azimuth_deg)
        return np.stack(places_at(self.lon_deg, self.lat_deg, radius_m, azimuth, EarthModel.WGS84), axis=1)


def outward(outline: Floats, parts: "Sequence[Floats | Arc]", *, is_hole: bool = False) -> dict[int, bool]:
    """Return whether the arcs of a ring bulge outward, by their place.

    outline : the ring (n, 2), whatever its arcs do
    """
    east, north = np.diff(outline[:, 0]), outline[:-1, 1] + outline[1:, 1]
    is_clockwise = float((east * north).sum()) > 0.0
    return {
        i: (part.end_deg > part.start_deg) == (is_clockwise != is_hole)
        for i, part in enumerate(parts)
        if isinstance(part, Arc)
    }


def joined(parts: "Sequence[Floats | Arc]", ways: Mapping[int, bool], check_gap: Callable[[float], object]) -> Floats:
    """Return the positions (n, 2) of parts one after the other, with continuous longitudes over the antimeridian.

    ways : whether arcs bulge outward, by their place
    check_gap : called with the distance between the end of a part and the begin of the next, degrees
    """
    lines: list[Floats] = []
    end: Floats | None = None
    for i, part in enumerate(parts):
        line = part.positions(is_outward=ways.get(i, False)) if isinstance(part, Arc) else part
        if end is not None:
            apart = float(np.abs(end - line[0]).max())
            check_gap(apart)
            line = line[1:] if apart <= _SAME_DEG else line
        lines.append(line)
        end = line[-1] if len(line) else end
    line = np.concatenate(lines) if lines else np.empty((0, 2))
    turns = np.diff(line[:, 0])
    if np.abs(turns).max(initial=0.0) > 180.0:  # over the antimeridian
        line[1:, 0] = line[0, 0] + np.cumsum(shorter_way_deg(turns))
    return line
