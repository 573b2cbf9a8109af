"""Derive havens that contain every voyage within the tolerances of a track.

On a leg, a voyage that departs during [d-, d+], arrives during [a-, a+] and is as fast as v1 to v2 has gone between
x_lo(t) = max(v1 (t - d+), X - v2 (a+ - t), 0) and x_hi(t) = min(v2 (t - d-), X - v1 (a- - t), X), X the length of the
leg. The haven of the leg is the rectangle from x_lo to x_hi and between the cross-track limits, grown by the ship's
outline: a ribbon. x_lo and x_hi are piecewise linear, so that between their breakpoints the outline of a ribbon changes
steadily. At a waypoint a ribbon ends and another begins, both at one time; a polygon that stands still there contains
the turn.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.objects import Activations, TrackBatch
from conflictdb.arrays.ragged import offsets, stacked
from conflictdb.earth.geodesy import MEAN_RADIUS_M, shorter_way_deg
from conflictdb.earth.plane import Plane
from conflictdb.model.tolerances import Tolerances, tolerances_of

_Ints = NDArray[np.int64]

# A leg is cut where its straight sides would leave the parallel of the leg by more than this share of the distance.
_BULGE: Final = 0.002
# Shorter movements of a reference point have no reliable heading: it stands still, metres.
_LEAST_WAY_M: Final = 0.05
# More than rounding displaces a vertex, metres: of positions, of headings, of breakpoints to microseconds.
_ROUNDING_M: Final = 0.02
# Degrees of an arc between two corners of a turn.
_STEP_DEG: Final = 10.0
_SHORTEST_US: Final = 1


@dataclass(frozen=True, slots=True)
class _Ribbon:
    """A part of the haven of a track, as a track: positions (n, 2), times (n,), outlines (n, m, 2), heights (2, 2)."""

    positions_deg: Floats
    times_us: _Ints
    outlines_m: Floats
    floor_m: Floats
    ceiling_m: Floats


# Earliest and latest begin and end of a step, seconds after the plan departs.
Span = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Step:
    """A part of a voyage: along a leg from one distance to another, or a turn or stop at a waypoint (leg -1).

    shortest_s, longest_s : how long it may take
    """

    leg: int
    waypoint: int
    begin_m: float
    end_m: float
    shortest_s: float
    longest_s: float

    @property
    def way_m(self) -> float:
        """The length of the part of a leg."""
        return self.end_m - self.begin_m

    @property
    def speeds_mps(self) -> tuple[float, float]:
        """The least and the most mean speed."""
        return self.way_m / self.longest_s, self.way_m / max(self.shortest_s, 1e-9)

    def gone_m(self, t: Floats, span: Span) -> tuple[Floats, Floats]:
        """Return the least and the most way (n,) that a voyage may have gone from the step's begin at times t (n,)."""
        slowest, fastest = self.speeds_mps
        begin_first, begin_last, end_first, end_last = span
        low = np.maximum(np.maximum(slowest * (t - begin_last), self.way_m - fastest * (end_last - t)), 0.0)
        high = np.minimum(np.minimum(fastest * (t - begin_first), self.way_m - slowest * (end_first - t)), self.way_m)
        return low, high


@dataclass(frozen=True, slots=True)
class Passage:
    """How voyages within the tolerances of a track may go on.

    positions_deg : (n, 2) of waypoints, longitudes unwrapped
    length_m, first_deg, last_deg : (n - 1,) of legs: length, bearing at the start and at the end
    steps : (m,) in order
    earliest_s, latest_s : (m + 1,) when a voyage may be between them, seconds after the plan departs
    """

    positions_deg: Floats
    length_m: Floats
    first_deg: Floats
    last_deg: Floats
    limits: Tolerances
    steps: list[Step]
    earliest_s: Floats
    latest_s: Floats

    @classmethod
    def of(cls, plane: Plane, track: TrackBatch) -> "Passage":
        """Return the passage of a track, the only one of a batch; without tolerances it is the plan."""
        times_us = track.times_us
        # Ways that cross the antimeridian are the shorter ones; only whole turns are added.
        lon = track.positions_deg[:, 0]
        gone = lon[0] + np.append(0.0, np.cumsum(shorter_way_deg(np.diff(lon))))
        positions = np.column_stack([lon + 360.0 * np.round((gone - lon) / 360.0), track.positions_deg[:, 1]])
        courses = plane.courses(positions[:-1], positions[1:])
        limits = tolerances_of("track", track.tolerances[0] or {}, times_us)
        steps = list(_steps(limits, positions, *courses, times_us))
        return cls(positions, *courses, limits, steps, *_windows(steps, limits, int(times_us[0])))

    def span(self, i: int) -> Span:
        """Return earliest and latest begin and end of a step."""
        begin, end = self.earliest_s[i : i + 2].tolist(), self.latest_s[i : i + 2].tolist()
        return begin[0], end[0], begin[1], end[1]


def with_ribbons(plane: Plane, tracks: TrackBatch) -> TrackBatch:
    """Return tracks (n,) with each that has tolerances replaced by its ribbons, rows with the same number."""
    has_some = np.array([one is not None for one in tracks.tolerances], np.bool_)
    if not has_some.any():
        return tracks
    rows, ribbons = [], []
    for row in np.flatnonzero(has_some).tolist():
        for ribbon in _ribbons(plane, tracks.take(np.array([row]))):
            rows.append(row)
            ribbons.append(ribbon)
    plain, of = np.flatnonzero(~has_some), np.array(rows, np.int64)
    legs = [len(one.times_us) - 1 for one in ribbons]
    derived = TrackBatch(
        track_id=tracks.track_id[of],
        version=tracks.version[of],
        waypoint_offset=offsets([len(one.times_us) for one in ribbons]),
        positions_deg=stacked([one.positions_deg for one in ribbons]),
        times_us=np.concatenate([one.times_us for one in ribbons]),
        outline_offset=offsets([one.outlines_m.shape[1] for one in ribbons]),
        outline_m=stacked([one.outlines_m[0] for one in ribbons]),
        floor_m=np.concatenate([np.tile(one.floor_m, (n, 1)) for one, n in zip(ribbons, legs, strict=True)]),
        ceiling_m=np.concatenate([np.tile(one.ceiling_m, (n, 1)) for one, n in zip(ribbons, legs, strict=True)]),
        grow_mps=np.zeros(len(of)),
        outlines_offset=offsets([one.outlines_m[..., 0].size for one in ribbons]),
        outlines_m=stacked([one.outlines_m.reshape(-1, 2) for one in ribbons]),
        tolerances=np.full(len(of), None, object),
        numbers=tracks.numbers[of],
        departs=Activations.once(np.array([one.times_us[0] for one in ribbons], np.int64)),
    )
    return tracks.take(plain).followed_by(derived).take(np.argsort(np.concatenate([plain, of]), kind="stable"))


def _ribbons(plane: Plane, track: TrackBatch) -> Iterator[_Ribbon]:
    """Yield the ribbons of a track, the only one of a batch."""
    times_us, outline_m = track.times_us, track.outline_m
    passage = Passage.of(plane, track)
    limits, positions, length_m = passage.limits, passage.positions_deg, passage.length_m
    floor_m, ceiling_m = track.floor_m, track.ceiling_m
    for i, step in enumerate(passage.steps):
        span = passage.span(i)
        near = (
            [step.leg] if step.leg >= 0 else [k for k in (step.waypoint - 1, step.waypoint) if 0 <= k < len(length_m)]
        )
        band = np.full(2, floor_m[near].min()), np.full(2, ceiling_m[near].max())
        if step.leg >= 0:
            k = step.leg
            leg = positions[k], positions[k + 1], float(length_m[k])
            sides = float(limits.port_m[k]), float(limits.starboard_m[k])
            yield _along(plane, leg, step, span, int(times_us[0]), outline_m, sides, *band)
        else:
            headings = _headings_at(step.waypoint, length_m, passage.first_deg, passage.last_deg)
            radius_m = 0.5 * (step.end_m - step.begin_m)
            sides = float(limits.port_m[near].max()), float(limits.starboard_m[near].max())
            polygon = _turned(outline_m, headings, radius_m, *sides, abs(float(positions[step.waypoint, 1])))
            first = int(times_us[0]) + int(np.floor(1e6 * span[0]))
            last = max(int(times_us[0]) + int(np.ceil(1e6 * span[3])), first + _SHORTEST_US)
            place = np.stack([positions[step.waypoint]] * 2)
            yield _Ribbon(place, np.array([first, last]), np.stack([polygon] * 2), *band)


def _steps(
    limits: Tolerances,
    positions: Floats,
    length_m: Floats,
    first_deg: Floats,
    last_deg: Floats,
    times_us: _Ints,
) -> Iterator[Step]:
    """Yield the parts of a voyage in order: legs, cut so that their sides are nearly straight, turns, and stops."""
    legs = len(length_m)
    planned_s = np.diff(times_us) / 1e6
    # Where the arc of a turn leaves the legs, and its angle.
    cut_m, turn = np.zeros(legs + 1), np.zeros(legs + 1)
    for w in range(1, legs):
        if length_m[w - 1] > 0.0 and length_m[w] > 0.0:
            turn[w] = abs(np.radians((first_deg[w] - last_deg[w - 1] + 180.0) % 360.0 - 180.0))
            most_m = 0.5 * min(length_m[w - 1], length_m[w])
            cut_m[w] = min(limits.turn_radius_m[w - 1] * np.tan(0.5 * min(turn[w], 3.0)), most_m)
    for k in range(legs):
        if length_m[k] < 2.0 * _LEAST_WAY_M:
            yield Step(-1, k, 0.0, 2.0 * float(length_m[k]), float(planned_s[k]), float(planned_s[k]))
            continue
        speed = length_m[k] / planned_s[k]
        slowest = np.fmin(limits.min_speed_mps[k], speed) if np.isfinite(limits.min_speed_mps[k]) else speed
        fastest = np.fmax(limits.max_speed_mps[k], speed) if np.isfinite(limits.max_speed_mps[k]) else speed
        lat = np.radians(min(np.abs(positions[k : k + 2, 1]).max(), 89.0))
        most_m = MEAN_RADIUS_M * np.sqrt(8.0 * _BULGE / (1.0 + 2.0 * np.tan(lat) ** 2))
        begin, end = cut_m[k], length_m[k] - cut_m[k + 1]
        if end > begin:
            parts = int(np.ceil((end - begin) / most_m))
            ends = np.linspace(begin, end, parts + 1)
            for one, other in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
                longest = (other - one) / slowest if slowest > 0.0 else np.inf
                yield Step(k, k + 1, one, other, (other - one) / fastest, longest)
        if k + 1 < legs and turn[k + 1] > 0.0:
            radius_m, arc_m = cut_m[k + 1], 0.0
            if radius_m > 0.0:
                arc_m = radius_m / np.tan(0.5 * min(turn[k + 1], 3.0)) * turn[k + 1]
            after = _speeds(limits, k + 1, length_m[k + 1] / planned_s[k + 1])
            low, high = min(slowest, after[0]), max(fastest, after[1])
            # Along the arc, or round the corner: whatever is shorter or longer.
            shortest = min(arc_m, 2.0 * radius_m) / high
            longest = max(arc_m, 2.0 * radius_m) / low if low > 0.0 else np.inf if radius_m > 0.0 else 0.0
            yield Step(-1, k + 1, -radius_m, radius_m, shortest, longest)


def _speeds(limits: Tolerances, leg: int, planned: float) -> tuple[float, float]:
    low, high = limits.min_speed_mps[leg], limits.max_speed_mps[leg]
    return float(np.fmin(low, planned) if np.isfinite(low) else planned), float(np.fmax(high, planned))


def _windows(steps: list[Step], limits: Tolerances, zero_us: int) -> tuple[Floats, Floats]:
    """Return when a voyage may be between its steps, earliest and latest (m + 1,), seconds after the plan departs."""
    earliest, latest = np.full(len(steps) + 1, -np.inf), np.full(len(steps) + 1, np.inf)
    earliest[0], latest[0] = (limits.departure_us - zero_us) / 1e6
    if limits.arrival_us is not None:
        earliest[-1], latest[-1] = (limits.arrival_us - zero_us) / 1e6
    for i, step in enumerate(steps):
        earliest[i + 1] = max(earliest[i + 1], earliest[i] + step.shortest_s)
        latest[i + 1] = min(latest[i + 1], latest[i] + step.longest_s)
    for i, step in reversed(list(enumerate(steps))):
        earliest[i] = max(earliest[i], earliest[i + 1] - step.longest_s)
        latest[i] = min(latest[i], latest[i + 1] - step.shortest_s)
    if not np.isfinite(latest).all():
        raise ValueError("a voyage may take for ever: min_speed_kn is 0, and there is no arrival_window")
    return earliest, np.maximum(latest, earliest)


def _along(
    plane: Plane,
    leg: tuple[Floats, Floats, float],
    step: Step,
    span: Span,
    zero_us: int,
    outline_m: Floats,
    sides: tuple[float, float],
    floor_m: Floats,
    ceiling_m: Floats,
) -> _Ribbon:
    """Return the ribbon of a part of a leg.

    leg : its ends, degrees, and its length
    """
    begin_first, begin_last, end_first, end_last = span
    way = step.way_m
    slowest, fastest = step.speeds_mps
    bends = [begin_first, begin_last, end_first, end_last]
    # Where two of the three lines cross.
    lines_low = [(slowest, -slowest * begin_last), (fastest, way - fastest * end_last), (0.0, 0.0)]
    lines_high = [(fastest, -fastest * begin_first), (slowest, way - slowest * end_first), (0.0, way)]
    for lines in (lines_low, lines_high):
        for i in range(3):
            for j in range(i):
                if lines[i][0] != lines[j][0]:
                    bends.append((lines[j][1] - lines[i][1]) / (lines[i][0] - lines[j][0]))
    within = [min(max(t, begin_first), end_last) for t in bends]
    # Whole microseconds; the first and the last are rounded outward.
    us = np.unique(np.rint(1e6 * np.array(within)).astype(np.int64))
    us[0], us[-1] = np.floor(1e6 * begin_first), np.ceil(1e6 * end_last)
    us = np.unique(np.append(us, us[0] + _SHORTEST_US) if len(us) < 2 else us)
    t = np.clip(us / 1e6, begin_first, end_last)
    # A breakpoint that is rounded by half a microsecond is passed at the fastest speed.
    rounding = _ROUNDING_M + 1e-6 * fastest
    pad = rounding + _curvature_m(outline_m, sides, max(abs(leg[0][1]), abs(leg[1][1])))
    back, ahead = step.gone_m(t, span)
    back = np.minimum(back, ahead)
    middle = 0.5 * (back + ahead)
    for i in range(1, len(middle)):
        if abs(middle[i] - middle[i - 1]) < _LEAST_WAY_M:
            middle[i] = middle[i - 1]
    if np.ptp(middle) < _LEAST_WAY_M:  # it would have no heading
        middle = np.linspace(0.0, way, len(middle))
    positions = _places(plane, *leg, step.begin_m + middle)
    corners = [
        outline_m[None] + np.stack([np.full(len(t), side), along - middle], axis=1)[:, None]
        for side, along in (
            (sides[1] + pad, ahead + pad),
            (sides[1] + pad, back - pad),
            (-sides[0] - pad, back - pad),
            (-sides[0] - pad, ahead + pad),
        )
    ]
    return _Ribbon(
        positions, zero_us + us, _rectangle_hull(np.concatenate(corners, axis=1), outline_m), floor_m, ceiling_m
    )


def _rectangle_hull(points: Floats, outline_m: Floats) -> Floats:
    """Return the hulls (n, h, 2) of an outline at four corners of rectangles (n, 4 m, 2), vertices alike in all."""
    # The directions in which each vertex is extreme do not depend on the rectangle's size: take those of a large one.
    m, size = len(outline_m), 4.0 * max(float(np.abs(outline_m).max()), 1.0)
    example = np.concatenate([outline_m + size * np.array(sign) for sign in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    hull = shapely.convex_hull(shapely.multipoints(example))
    ring = shapely.get_coordinates(shapely.get_exterior_ring(hull))[:-1]
    index = [int(np.abs(example - vertex).sum(axis=1).argmin()) for vertex in ring]
    assert points.shape[1] == 4 * m  # noqa: S101
    return points[:, index]


def _curvature_m(outline_m: Floats, sides: tuple[float, float], lat_deg: float) -> float:
    """Return how far steps along and across a leg, in another order, may lead from a vertex on the earth, metres.

    The two ways enclose a parallelogram: on a sphere its area by the radius, times the tangent of the latitude, is the
    difference.
    """
    size = 2.0 * float(np.hypot(*outline_m.T).max())
    reach = size + max(sides)
    lat = np.radians(min(lat_deg + np.degrees(2.0 * reach / MEAN_RADIUS_M), 89.5))
    return float(size * reach * (1.0 + np.tan(lat)) / MEAN_RADIUS_M)


def _places(plane: Plane, start_deg: Floats, end_deg: Floats, length_m: float, along_m: Floats) -> Floats:
    """Return longitude and latitude (n, 2) of places on a leg, by distance from its start; ends exactly."""
    share = np.clip(along_m / length_m, 0.0, 1.0)
    (x0, x1), (y0, y1) = plane.to_plane(*np.stack([start_deg, end_deg]).T)
    # Legs are straight in the plane: find the share of the plane's way by bisection of lengths.
    low, high = np.zeros(len(share)), np.ones(len(share))
    starts = np.tile(start_deg, (len(share), 1))
    for _ in range(60):
        part = 0.5 * (low + high)
        places = np.stack(plane.from_plane(x0 + part * (x1 - x0), y0 + part * (y1 - y0)), axis=1)
        gone = plane.courses(starts, places)[0]
        is_short = gone < share * length_m
        low, high = np.where(is_short, part, low), np.where(is_short, high, part)
    places = np.stack(plane.from_plane(x0 + low * (x1 - x0), y0 + low * (y1 - y0)), axis=1)
    places[share == 0.0], places[share == 1.0] = start_deg, end_deg
    return places


def _headings_at(waypoint: int, length_m: Floats, first_deg: Floats, last_deg: Floats) -> tuple[float, float]:
    """Return the heading before a waypoint, and by how much it turns there, degrees; a stop keeps its heading."""
    before = [k for k in range(waypoint) if length_m[k] >= 2.0 * _LEAST_WAY_M]
    after = [k for k in range(waypoint, len(length_m)) if length_m[k] >= 2.0 * _LEAST_WAY_M]
    if not before and not after:
        return 0.0, 0.0
    if not before or not after:
        return float(last_deg[before[-1]] if before else first_deg[after[0]]), 0.0
    arrives, leaves = float(last_deg[before[-1]]), float(first_deg[after[0]])
    return arrives, (leaves - arrives + 180.0) % 360.0 - 180.0


def _turned(
    outline_m: Floats, headings: tuple[float, float], cut_m: float, port_m: float, starboard_m: float, lat_deg: float
) -> Floats:
    """Return a polygon (h, 2) of (east, north) metres about a waypoint that contains a turn there.

    It contains the ship at all headings of the turn, at all offsets within the limits, on both legs as far as the arc
    reaches, and between.
    """
    heading, turn = headings
    if abs(turn) > 179.0:  # either way round
        turn = 360.0
    count = max(int(np.ceil(abs(turn) / _STEP_DEG)), 1) + 1
    angles = np.radians(heading + np.linspace(0.0, turn, count))
    wider = 1.0 / np.cos(0.5 * np.radians(abs(turn) / (count - 1)))
    ahead = np.stack([np.sin(angles), np.cos(angles)], axis=1)
    right = np.stack([np.cos(angles), -np.sin(angles)], axis=1)
    ship = wider * (outline_m[None, :, :1] * right[:, None] + outline_m[None, :, 1:] * ahead[:, None]).reshape(-1, 2)
    aside = np.concatenate([wider * starboard_m * right, -wider * port_m * right, np.zeros((1, 2))])
    legs = np.array([[0.0, 0.0], *(-cut_m * ahead[:1]), *(cut_m * ahead[-1:])])
    points = _hull_points(_sums(_hull_points(ship), _hull_points(_sums(legs, aside))))
    reach = float(np.hypot(*points.T).max())
    lat = np.radians(min(lat_deg + np.degrees(2.0 * reach / MEAN_RADIUS_M), 89.5))
    pad = _ROUNDING_M + reach * reach * (1.0 + np.tan(lat)) / MEAN_RADIUS_M
    square = pad * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
    return _hull_points(_sums(points, square))


def _sums(one: Floats, other: Floats) -> Floats:
    return (one[:, None] + other[None]).reshape(-1, 2)


def _hull_points(points: Floats) -> Floats:
    hull = shapely.convex_hull(shapely.multipoints(points))
    xy = shapely.get_coordinates(hull)
    return xy[:-1] if hull.geom_type == "Polygon" else xy
