"""Brute force: when do two objects of a scene touch, and how close do they come?

Obvious, slow and independent: shares nothing with the package but the classes of a scene. Where the package uses
series in the third flattening, this uses the incomplete elliptic integral, Gauss-Legendre means and Newton's method;
where the package reasons about convex parts, this samples densely with shapely on the whole polygons.
`oracle_motion.py` is the motion, `oracle_distance.py` the distance on the earth, and
`precise.py` the same motion in 50 digits; `oracle_circle.py` does all of it for great circles.

Units: metres, radians inside, degrees and microseconds at the border; times in results are seconds after `epoch_us`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass
from functools import cached_property
from itertools import combinations
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from oracle_distance import edges_of, edges_of_hulls, least_m
from oracle_motion import Globe, Leg, legs
from recorded import recorded

from conflictdb.model.plans import Area, Motion, Scene, Track

Floats = NDArray[np.float64]

SPEED_MARGIN: Final = 2.0  # on the largest speed that is seen between samples
SPLIT: Final = 16  # parts that an undecided interval is cut into
SAMPLING_ROUNDS: Final = 3  # 16, then 256, then 4096 intervals per pair of legs, the last two only where undecided
ZOOM_ROUNDS: Final = 10  # each narrows a bracket 8 times or more
SAME_INSTANT_S: Final = 1e-7  # contacts closer than this are one
PLANE_PER_METRE: Final = 120.0  # at most, up to 89.5 degrees


@dataclass(frozen=True)
class Phase:
    """A stretch of time in which an object moves evenly: `place(seconds)` gives its polygons in the plane."""

    start_us: float
    end_us: float
    leg: Leg | None
    globe: Globe
    outline_m: Floats
    footprint: shapely.MultiPolygon | None
    origin_lon: float

    @property
    def moves(self) -> bool:
        leg = self.leg
        return leg is not None and (leg.north_m != 0.0 or leg.east_m != 0.0 or bool(leg.growth_m.any()))

    def vertices(self, epoch_us: int, seconds: Floats) -> Floats:
        """Vertices (n, m, 2) in the plane, metres; areas: their bounds, which do not move."""
        if self.leg is None:
            x0, y0, x1, y1 = self.footprint.bounds
            return np.broadcast_to(np.array([[x0, y0], [x1, y1]]), (len(seconds), 2, 2))
        leg = self.leg
        fraction = ((epoch_us - leg.start_us) / 1e6 + seconds) / ((leg.end_us - leg.start_us) / 1e6)
        lon, lat = leg.vertices(self.globe, self.outline_m, np.clip(fraction, 0.0, 1.0))
        return self.globe.a * np.stack([lon - self.origin_lon, self.globe.isometric(lat)], axis=-1)

    def place(self, epoch_us: int, seconds: Floats) -> NDArray[np.object_]:
        if self.leg is None:
            return np.full(len(seconds), self.footprint, dtype=object)
        return shapely.convex_hull(shapely.multipoints(self.vertices(epoch_us, seconds)))


def plane(globe: Globe, footprint: shapely.MultiPolygon, origin_lon: float) -> shapely.MultiPolygon:
    """An area in the plane, in metres east of a longitude (radians); edges are straight there."""

    def project(lonlat: Floats) -> Floats:
        lon, lat = np.radians(lonlat).T
        return globe.a * np.stack([lon - origin_lon, globe.isometric(lat)], axis=-1)

    return shapely.transform(footprint, project)


def phases(globe: Globe, thing: Area | Track, origin_lon: float) -> list[Phase]:
    if isinstance(thing, Area):
        start = -np.inf if thing.start_us is None else thing.start_us
        end = np.inf if thing.end_us is None else thing.end_us
        footprint = plane(globe, thing.footprint, origin_lon)
        shapely.prepare(footprint)
        return [Phase(start, end, None, globe, np.empty((0, 2)), footprint, origin_lon)]
    return [Phase(x.start_us, x.end_us, x, globe, x.outline_m, None, origin_lon) for x in legs(globe, thing)]


@dataclass(frozen=True)
class Meeting:
    """What brute force finds of a pair.

    intervals : closed intervals of contact, seconds after epoch_us, increasing and disjoint
    least_m : least separation on the earth, metres; 0 in contact; inf if more than was asked to be resolved
    at_s : when that is, seconds after epoch_us
    """

    epoch_us: int
    intervals: tuple[tuple[float, float], ...]
    least_m: float
    at_s: float

    @property
    def touches(self) -> bool:
        return bool(self.intervals)

    @cached_property
    def intervals_us(self) -> tuple[tuple[float, float], ...]:
        return tuple((self.epoch_us + 1e6 * a, self.epoch_us + 1e6 * b) for a, b in self.intervals)


NEVER: Final = Meeting(0, (), np.inf, np.nan)


class Gap:
    """The signed separation of two phases as a function of time, over their common span.

    Positive: distance, less `separation_m`; in the plane, or on the earth (where it is above `care_m`, only roughly).
    Negative: some measure of the overlap, only good for seeing where it ends.
    """

    def __init__(self, a: Phase, b: Phase, epoch_us: int, separation_m: float, care_m: float, on_earth: bool) -> None:
        self.a, self.b, self.epoch_us, self.separation_m = a, b, epoch_us, separation_m
        self.care_m, self.on_earth = care_m, on_earth

    def __call__(self, seconds: Floats) -> Floats:
        one, two = self.a.place(self.epoch_us, seconds), self.b.place(self.epoch_us, seconds)
        apart = ~shapely.intersects(one, two)
        gap = np.zeros(len(seconds))
        # A touch that rounding leaves apart by less than the last digit is still apart: keep the sign.
        gap[apart] = np.maximum(self._distance_m(one[apart], two[apart]), 1e-12) - self.separation_m
        common = shapely.intersection(one[~apart], two[~apart])
        gap[~apart] = -self.separation_m - np.sqrt(shapely.area(common)) - 1e-9 * shapely.length(common)
        return gap

    def _distance_m(self, one: NDArray[np.object_], two: NDArray[np.object_]) -> Floats:
        if not self.on_earth or not len(one):
            return shapely.distance(one, two)
        edges = [
            edges_of(phase.footprint)[None] if phase.leg is None else edges_of_hulls(polygons)
            for phase, polygons in ((self.a, one), (self.b, two))
        ]
        if len(edges[1]) < len(edges[0]):
            edges = edges[::-1]
        return least_m(self.a.globe, *edges, beyond_m=self.separation_m + self.care_m)


def lowest_between(gap: Gap, seconds: Floats, values: Floats) -> tuple[Floats, Floats]:
    """What the gap is nowhere below between times (n,), and how far both sides move: (n - 1,) metres.

    Over an interval the gap cannot fall below the mean of its ends less half of what both sides can move.
    """
    moved: Floats = np.zeros(len(seconds) - 1)
    for phase in (gap.a, gap.b):
        steps = np.diff(phase.vertices(gap.epoch_us, seconds), axis=0)
        moved += SPEED_MARGIN * np.hypot(steps[..., 0], steps[..., 1]).max(axis=1)
    return (values[1:] + values[:-1] - moved) / 2, moved


def sample(gap: Gap, end_s: float, care_m: float, rounds: int = SAMPLING_ROUNDS) -> tuple[Floats, Floats]:
    """Times and gaps, dense wherever the gap could be less than `care_m`."""
    seconds = np.linspace(0.0, end_s, SPLIT + 1)
    values = gap(seconds)
    for _ in range(rounds - 1):
        lowest, moved = lowest_between(gap, seconds, values)
        deep = np.maximum(values[1:], values[:-1]) < -moved
        cut = (lowest < care_m) & ~deep & (np.diff(seconds) > SAME_INSTANT_S)
        if not cut.any():
            break
        parts = np.arange(1, SPLIT) / SPLIT
        extra = (seconds[:-1][cut, None] + np.diff(seconds)[cut, None] * parts).ravel()
        seconds, values = np.concatenate([seconds, extra]), np.concatenate([values, gap(extra)])
        order = np.argsort(seconds, kind="stable")
        seconds, values = seconds[order], values[order]
    return seconds, values


def crossing(gap: Gap, outside: float, inside: float) -> float:
    """The instant where contact begins or ends, between one without and one with contact."""
    for _ in range(ZOOM_ROUNDS):
        grid = np.linspace(outside, inside, SPLIT + 1)
        first = int(np.argmax(gap(grid) <= 0.0))
        if first == 0:
            break
        outside, inside = float(grid[first - 1]), float(grid[first])
    return inside


def extreme(gap: Gap, left: float, right: float, sign: float) -> tuple[float, float]:
    """Where `sign * gap` is least between two instants, and the gap there."""
    at, value = left, np.inf
    for _ in range(ZOOM_ROUNDS):
        grid = np.linspace(left, right, SPLIT + 1)
        values = sign * gap(grid)
        best = int(np.argmin(values))
        if values[best] < value:
            at, value = float(grid[best]), float(values[best])
        left, right = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, SPLIT)])
    return at, sign * value


def closest(gap: Gap, end_s: float) -> tuple[float, float]:
    """The least gap, and when it is."""
    seconds, values = sample(gap, end_s, float(gap(np.linspace(0.0, end_s, SPLIT + 1)).min()), rounds=2)
    best, last = int(np.argmin(values)), len(seconds) - 1
    at, value = extreme(gap, float(seconds[max(best - 1, 0)]), float(seconds[min(best + 1, last)]), 1.0)
    return value, at


def contacts(gap: Gap, end_s: float, care_m: float) -> tuple[list[tuple[float, float]], float, float]:
    """Intervals of contact of two phases, the least gap, and when it is."""
    if end_s == 0.0:
        value = float(gap(np.zeros(1))[0])
        return ([(0.0, 0.0)] if value <= 0.0 else []), value, 0.0
    seconds, values = sample(gap, end_s, care_m)
    # Look into the lowest dip, every dip that might touch and each bump of a contact that might part. A convex dip that
    # touches between samples at least halves towards its lowest one; ripples of rounding do not. On legs that last for
    # months much may lie between two samples.
    lowest, extra = int(np.argmin(values)), []
    might = np.pad(lowest_between(gap, seconds, values)[0] <= care_m, 1)
    for i, value in enumerate(values):
        left, right = max(i - 1, 0), min(i + 1, len(seconds) - 1)
        beside = values[[left, right]]
        is_near = might[i] or might[i + 1] or value <= care_m
        low = is_near and 0.0 < value <= beside.min() and (value <= 0.75 * beside.max() or left == i or right == i)
        high = 0.0 >= value >= beside.max() and value > 0.9 * beside.min()
        if low or high or (i == lowest and value > 0.0 and is_near):
            extra.append(extreme(gap, seconds[left], seconds[right], -1.0 if high else 1.0))
    seconds = np.concatenate([seconds, [t for t, _ in extra]])
    values = np.concatenate([values, [v for _, v in extra]])
    order = np.argsort(seconds, kind="stable")
    seconds, values = seconds[order], values[order]

    touching = values <= 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], touching, [False]]).astype(int)))
    found = []
    for first, after in edges.reshape(-1, 2):
        start = seconds[0] if first == 0 else crossing(gap, seconds[first - 1], seconds[first])
        end = seconds[-1] if after == len(seconds) else crossing(gap, seconds[after], seconds[after - 1])
        found.append((float(start), float(end)))
    best = int(np.argmin(values))
    return found, float(values[best]), float(seconds[best])


def meeting(scene: Scene, a: Area | Track, b: Area | Track, care_m: float = 1000.0) -> Meeting:
    """When two objects touch (or come closer than the scene's separation), and how close they come.

    The least separation is resolved where it is below `care_m`: metres in the plane (up to 57 times as large at 89
    degrees) if no separation is wanted, else metres more than that on the earth.
    """
    settings: tuple[object, ...] = scene.motion, scene.earth, scene.separation_m, scene.vertical_separation_m
    if is_closed(scene):
        settings = (*settings, scene.intervals)
    epoch_us, intervals, least_m, at_s = recorded(
        (*settings, a, b, care_m), lambda: astuple(_meeting(scene, a, b, care_m))
    )
    return Meeting(epoch_us, tuple((start_s, end_s) for start_s, end_s in intervals), least_m, at_s)


def _meeting(scene: Scene, a: Area | Track, b: Area | Track, care_m: float) -> Meeting:
    if scene.motion is Motion.GREAT_CIRCLE:
        import oracle_circle  # which builds on this module

        return oracle_circle.meeting(scene, a, b, care_m)
    infinite = np.inf
    if apart_in_height(scene, a, b):
        return NEVER
    globe = Globe.of(scene.earth)
    origin = np.radians(float(_longitudes(a).mean()))
    mine, theirs = phases(globe, a, origin), phases(globe, b, origin)
    start_us = max(mine[0].start_us, theirs[0].start_us)
    end_us = min(mine[-1].end_us, theirs[-1].end_us)
    if start_us > end_us or (start_us == end_us and not is_closed(scene)):
        return NEVER
    epoch_us = int(start_us) if start_us > -infinite else 0

    found: list[tuple[float, float]] = []
    least = (infinite, np.nan)
    for p, q in ((p, q) for p in mine for q in theirs):
        low, high = max(p.start_us, q.start_us), min(p.end_us, q.end_us)
        if low > high or (low >= end_us and not is_closed(scene)):
            continue
        still = not p.moves and not q.moves
        zero_us = epoch_us if p.leg is None and q.leg is None else int(low)
        offset_s = (zero_us - epoch_us) / 1e6
        duration_s = 0.0 if still else (int(high) - int(low)) / 1e6
        on_earth = scene.separation_m > 0.0
        for other in _copies(p, q, care_m + PLANE_PER_METRE * scene.separation_m):
            gap = Gap(p, other, zero_us, scene.separation_m, care_m, on_earth)
            intervals, value, at = contacts(gap, duration_s, care_m)
            if still and intervals:
                intervals = [((low - zero_us) / 1e6, (high - zero_us) / 1e6)]
            found += [(s + offset_s, e + offset_s) for s, e in intervals]
            if value < care_m and not on_earth and not found:
                # No way is longer on the earth than in the plane; below 1e-5 m that is known better.
                value, at = min((value, at), closest(Gap(p, other, zero_us, 0.0, care_m, on_earth=True), duration_s))
            if value < care_m:
                least = min(least, (max(value + scene.separation_m, 0.0), at + offset_s))
    last_s = (end_us - epoch_us) / 1e6
    # The last instant of a half-open span does not belong to it.
    ends_s = last_s + 1.0 if is_closed(scene) else last_s - SAME_INSTANT_S
    merged = [(s, e) for s, e in _merged(found) if s < ends_s or s == -infinite]
    return Meeting(epoch_us, tuple(merged), *least)


def meetings(
    scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], care_m: float = 1000.0
) -> dict[tuple[str, str], Meeting]:
    """Every pair of a scene by keys, the area (else the smaller key) first."""
    pairs: Iterator[tuple[Area | Track, Area | Track]] = combinations(
        [*areas, *sorted(tracks, key=lambda t: t.key.encode())], 2
    )
    found = {}
    for a, b in pairs:
        if isinstance(a, Area) and isinstance(b, Area) and b.key.encode() < a.key.encode():
            a, b = b, a
        found[a.key, b.key] = meeting(scene, a, b, care_m)
    return found


def haven_at(scene: Scene, track: Track, instant_us: int, leg: int) -> Floats:
    """Vertices (m, 2) of a haven on one of its legs, longitude (unwrapped) and latitude in degrees."""
    globe = Globe.of(scene.earth)
    x = legs(globe, track)[leg]
    fraction = np.array([(instant_us - x.start_us) / (x.end_us - x.start_us)])
    lon, lat = x.vertices(globe, x.outline_m, fraction)
    return np.degrees(np.stack([lon[0], lat[0]], axis=-1))


def polygons_at(scene: Scene, thing: Area | Track, instant_us: int, near_lon: float) -> list[shapely.Geometry]:
    """The polygons of an object at an instant in the plane, in metres east of `near_lon`, the nearest whole turn."""
    globe = Globe.of(scene.earth)
    turn = 2 * np.pi * globe.a
    found = []
    for phase in phases(globe, thing, np.radians(near_lon)):
        if phase.start_us <= instant_us <= phase.end_us:
            polygon = phase.place(instant_us, np.zeros(1))[0]
            aside = np.round(polygon.centroid.x / turn) * turn
            for extra in (-turn, 0.0, turn):
                found.append(shapely.transform(polygon, lambda xy, by=extra - aside: xy + np.array([by, 0.0])))
    return found


def _copies(p: Phase, q: Phase, margin_m: float) -> Iterator[Phase]:
    """The second phase as it is and whole turns aside, as far as it could come within a margin of the first."""
    round_m = 2 * np.pi * p.globe.a
    boxes = []
    for phase in (p, q):
        if phase.leg is None:
            boxes.append((phase.footprint.bounds[0], phase.footprint.bounds[2]))
        else:
            x = phase.vertices(
                phase.leg.start_us, np.linspace(0, (phase.leg.end_us - phase.leg.start_us) / 1e6, SPLIT + 1)
            )[..., 0]
            reach = (x.max() - x.min()) / 4 + 1e5
            boxes.append((x.min() - reach, x.max() + reach))
    for turn in range(-3, 4):
        shift = turn * round_m
        if boxes[1][0] + shift - margin_m <= boxes[0][1] and boxes[0][0] <= boxes[1][1] + shift + margin_m:
            footprint = q.footprint
            if footprint is not None and turn:
                footprint = shapely.transform(footprint, _shifted(shift))
            yield Phase(q.start_us, q.end_us, q.leg, q.globe, q.outline_m, footprint, q.origin_lon - turn * 2 * np.pi)


def _shifted(shift_m: float) -> Callable[[Floats], Floats]:
    return lambda xy: xy + np.array([shift_m, 0.0])


def _merged(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    merged: list[tuple[float, float]] = []
    for start, end in sorted(intervals):
        if merged and start <= merged[-1][1] + SAME_INSTANT_S:
            merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
        else:
            merged.append((start, end))
    return merged


def is_closed(scene: Scene) -> bool:
    """Whether the last instant of a span and the ceiling of a band belong to an object."""
    return scene.intervals == "closed"


def apart_in_height(scene: Scene, a: Area | Track, b: Area | Track) -> bool:
    """Whether the height bands of two objects are as far apart as the scene wants, to the micrometre."""
    gap_m = max(_low(a), _low(b)) - min(_high(a), _high(b))
    more_m = round(gap_m - scene.vertical_separation_m, 6)
    return gap_m >= 0.0 and (more_m > 0.0 or (more_m == 0.0 and not is_closed(scene)))


def _low(thing: Area | Track) -> float:
    return -np.inf if thing.floor_m is None else thing.floor_m


def _high(thing: Area | Track) -> float:
    return np.inf if thing.ceiling_m is None else thing.ceiling_m


def _longitudes(thing: Area | Track) -> Floats:
    return shapely.get_coordinates(thing.footprint)[:, 0] if isinstance(thing, Area) else thing.positions_deg[:, 0]
