"""Great circles for the oracle: everything as vectors in space, in long double, then sampled as polygons.

Shares nothing with the package but the classes of a scene. Polygons are put on a plane that touches the sphere near the
two objects at hand, not at the scene's centre: great circles are straight on any such plane.

Motion (all that is assumed):

- A leg is the shorter great circle at constant speed; a haven vertex (starboard, forward) is so far ahead of the
  reference point on it, and then so far to starboard on the great circle that crosses it there.
- Edges of areas are the shorter great circles, and sides of havens those between its vertices.
- A loiter keeps the heading at the end of the leg before it, else that at the start of the next moving leg, else north.

Units: metres, unit vectors; degrees and microseconds where objects are read.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from oracle import SAME_INSTANT_S, Floats, Meeting, _merged, apart_in_height, contacts, is_closed
from oracle_motion import outlines

from conflictdb.model.plans import Area, Scene, Track

RADIUS_M: Final = 6371008.771415
NEVER: Final = Meeting(epoch_us=0, intervals=(), least_m=np.inf, at_s=np.nan)


def space(lonlat_deg: Floats) -> Floats:
    """Unit vectors (..., 3) towards places (..., 2), long double."""
    lon, lat = np.moveaxis(np.asarray(lonlat_deg).astype(np.longdouble), -1, 0) * np.arctan(np.longdouble(1.0)) / 45
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


@dataclass(frozen=True)
class Leg:
    """Where the reference point starts and which way it goes (unit vectors), and how far (radians)."""

    start_us: int
    end_us: int
    start: Floats
    heading: Floats
    angle: float
    outline_m: Floats
    growth_m: Floats

    def vertices(self, fraction: Floats) -> Floats:
        """Unit vectors (n, m, 3) of the haven's vertices at n fractions of the leg."""
        starboard = np.cross(self.heading, self.start)
        outlines_m = self.outline_m.astype(np.longdouble) + fraction[:, None, None] * self.growth_m
        across, ahead = np.moveaxis(outlines_m, -1, 0)[..., None] / RADIUS_M
        at = fraction[:, None, None] * self.angle + ahead
        on_track = np.cos(at) * self.start + np.sin(at) * self.heading
        return np.cos(across) * on_track + np.sin(across) * starboard


def legs(track: Track) -> list[Leg]:
    places = space(track.positions_deg)
    norths = space(track.positions_deg + np.array([0.0, 90.0]))
    headings: list[Floats | None] = []
    angles = []
    for a, b in pairwise(places):
        pole = np.cross(a, b)
        sine = np.sqrt((pole**2).sum())
        moves = sine > 1e-17
        headings.append(np.cross(pole, a) / sine if moves else None)
        angles.append(np.arctan2(sine, a @ b) if moves else np.longdouble(0.0))
    kept = next((h for h in headings if h is not None), None)
    found, havens = [], outlines(track)
    for i, (heading, angle) in enumerate(zip(headings, angles, strict=True)):
        now = heading if heading is not None else (norths[i] if kept is None else kept)
        start_us, end_us, change = int(track.times_us[i]), int(track.times_us[i + 1]), havens[i + 1] - havens[i]
        found.append(Leg(start_us, end_us, places[i], now, angle, havens[i], change))
        if heading is not None:
            kept = np.cos(angle) * heading - np.sin(angle) * places[i]
    return found


@dataclass(frozen=True)
class Chart:
    """A plane that touches the sphere: rows are its east, its north and where it touches."""

    frame: Floats

    @classmethod
    def at(cls, lon_deg: float, lat_deg: float) -> "Chart":
        """The plane at a place, with x to the east and y to the north."""
        return cls(space(np.array([[lon_deg + 90.0, 0.0], [lon_deg, lat_deg + 90.0], [lon_deg, lat_deg]])))

    @classmethod
    def about(cls, places: Floats) -> "Chart":
        up = places.mean(axis=0)
        up = up / np.sqrt((up**2).sum())
        east = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
        east = east / np.sqrt((east**2).sum())
        return cls(np.stack([east, np.cross(up, east), up]))

    def plane(self, vectors: Floats) -> Floats:
        """Plane metres (..., 2) of unit vectors (..., 3)."""
        v = vectors @ self.frame.T
        assert (v[..., 2] > 0.05).all(), "too far from the middle of the pair for this chart"
        return (RADIUS_M * v[..., :2] / v[..., 2:]).astype(np.float64)

    def space(self, xy: Floats) -> Floats:
        """Unit vectors (..., 3), in the chart's own frame, of plane metres (..., 2)."""
        v = np.concatenate([xy / RADIUS_M, np.ones((*xy.shape[:-1], 1))], axis=-1)
        return v / np.linalg.norm(v, axis=-1, keepdims=True)

    def footprint(self, area: Area) -> shapely.Geometry:
        def project(lonlat: Floats) -> Floats:
            return self.plane(space(lonlat))

        parts = [shapely.buffer(shapely.transform(part, project), 0) for part in shapely.get_parts(area.footprint)]
        return shapely.union_all(parts) if len(parts) > 1 else parts[0]


@dataclass(frozen=True)
class Phase:
    """A stretch of time in which an object moves evenly; like `oracle.Phase`, on great circles."""

    start_us: float
    end_us: float
    leg: Leg | None
    chart: Chart
    footprint: shapely.Geometry | None

    def vertices(self, epoch_us: int, seconds: Floats) -> Floats:
        """Vertices (n, m, 2) in the plane, metres; areas: their bounds, which do not move."""
        if self.leg is None:
            x0, y0, x1, y1 = self.footprint.bounds
            return np.broadcast_to(np.array([[x0, y0], [x1, y1]]), (len(seconds), 2, 2))
        leg = self.leg
        gone = np.longdouble((epoch_us - leg.start_us) / 1e6) + seconds
        fraction = np.clip(gone / ((leg.end_us - leg.start_us) / 1e6), 0.0, 1.0)
        return self.chart.plane(leg.vertices(fraction))

    def place(self, epoch_us: int, seconds: Floats) -> NDArray[np.object_]:
        if self.leg is None:
            return np.full(len(seconds), self.footprint, dtype=object)
        return shapely.convex_hull(shapely.multipoints(self.vertices(epoch_us, seconds)))


def phases(chart: Chart, thing: Area | Track) -> list[Phase]:
    if isinstance(thing, Area):
        start = -np.inf if thing.start_us is None else thing.start_us
        end = np.inf if thing.end_us is None else thing.end_us
        footprint = chart.footprint(thing)
        shapely.prepare(footprint)
        return [Phase(start, end, None, chart, footprint)]
    return [Phase(leg.start_us, leg.end_us, leg, chart, None) for leg in legs(thing)]


def edges(geometry: shapely.Geometry) -> Floats:
    """Both ends of every edge, (k, 2, 2), plane metres; of a point, twice itself."""
    found = []
    for part in shapely.get_parts(geometry):
        rings = shapely.get_rings(part) if shapely.get_type_id(part) == 3 else [part]
        for ring in rings:
            xy = shapely.get_coordinates(ring)
            xy = np.concatenate([xy, xy]) if len(xy) == 1 else xy
            found.append(np.stack([xy[:-1], xy[1:]], axis=1))
    return np.concatenate(found)


def least_m(chart: Chart, one: shapely.Geometry, two: shapely.Geometry) -> float:
    """The least distance of two disjoint geometries on the sphere: every corner of one to every edge of the other."""
    best = np.inf
    for corners, sides in ((edges(one)[:, 0], edges(two)), (edges(two)[:, 0], edges(one))):
        p = chart.space(corners)[:, None, :]
        a, b = chart.space(sides[:, 0])[None], chart.space(sides[:, 1])[None]
        pole = np.cross(a, b)
        length = np.linalg.norm(pole, axis=-1, keepdims=True)
        pole = pole / np.where(length > 0.0, length, 1.0)
        beside = (
            ((np.cross(pole, a) * p).sum(-1) > 0.0) & ((np.cross(b, pole) * p).sum(-1) > 0.0) & (length[..., 0] > 0)
        )
        to_arc = np.arcsin(np.abs((pole * p).sum(-1)))
        to_end = 2.0 * np.arcsin(np.minimum(np.linalg.norm(p - a, axis=-1) / 2.0, 1.0))
        best = min(best, float(np.where(beside, to_arc, to_end).min()))
    return RADIUS_M * best


class Gap:
    """The signed separation of two phases as a function of time, like `oracle.Gap`; on the sphere where apart."""

    def __init__(self, a: Phase, b: Phase, epoch_us: int, separation_m: float) -> None:
        self.a, self.b, self.epoch_us, self.separation_m = a, b, epoch_us, separation_m

    def __call__(self, seconds: Floats) -> Floats:
        one, two = self.a.place(self.epoch_us, seconds), self.b.place(self.epoch_us, seconds)
        apart = ~shapely.intersects(one, two)
        gap = np.zeros(len(seconds))
        for i in np.flatnonzero(apart):
            # A touch that rounding leaves apart by less than the last digit is still apart: keep the sign.
            gap[i] = max(least_m(self.a.chart, one[i], two[i]), 1e-12) - self.separation_m
        common = shapely.intersection(one[~apart], two[~apart])
        gap[~apart] = -self.separation_m - np.sqrt(shapely.area(common)) - 1e-9 * shapely.length(common)
        return gap


def meeting(scene: Scene, a: Area | Track, b: Area | Track, care_m: float = 1000.0) -> Meeting:
    """What `oracle.meeting` says, on great circles."""
    if apart_in_height(scene, a, b):
        return NEVER
    middles = [space(_places(thing)).mean(axis=0) for thing in (a, b)]
    chart = Chart.about(np.stack(middles))
    mine, theirs = phases(chart, a), phases(chart, b)
    start_us, end_us = max(mine[0].start_us, theirs[0].start_us), min(mine[-1].end_us, theirs[-1].end_us)
    if start_us > end_us or (start_us == end_us and not is_closed(scene)):
        return NEVER
    epoch_us = int(start_us) if start_us > -np.inf else 0
    found: list[tuple[float, float]] = []
    least = (np.inf, np.nan)
    for p, q in ((p, q) for p in mine for q in theirs):
        low, high = max(p.start_us, q.start_us), min(p.end_us, q.end_us)
        if low > high or (low >= end_us and not is_closed(scene)):
            continue
        still = p.leg is None and q.leg is None
        zero_us = epoch_us if still else int(low)
        offset_s = (zero_us - epoch_us) / 1e6
        duration_s = 0.0 if still else (int(high) - int(low)) / 1e6
        intervals, value, at = contacts(Gap(p, q, zero_us, scene.separation_m), duration_s, care_m)
        if still and intervals:
            intervals = [((low - epoch_us) / 1e6, (high - epoch_us) / 1e6)]
        found += [(s + offset_s, e + offset_s) for s, e in intervals]
        least = min(least, (max(value + scene.separation_m, 0.0), at + offset_s))
    last_s = (end_us - epoch_us) / 1e6
    ends_s = last_s + 1.0 if is_closed(scene) else last_s - SAME_INSTANT_S
    merged = tuple((s, e) for s, e in _merged(found) if s < ends_s or s == -np.inf)
    return Meeting(epoch_us=epoch_us, intervals=merged, least_m=least[0], at_s=least[1])


def haven_at(track: Track, instant_us: int, leg: int) -> Floats:
    """Unit vectors (m, 3) towards the vertices of a haven on one of its legs."""
    x = legs(track)[leg]
    return x.vertices(np.array([(instant_us - x.start_us) / (x.end_us - x.start_us)]))[0]


def _places(thing: Area | Track) -> Floats:
    return shapely.get_coordinates(thing.footprint) if isinstance(thing, Area) else thing.positions_deg
