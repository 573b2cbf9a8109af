"""The rules of shapes, times and heights of plans, each stated once: on arrays of many plans; one is an array of one.

A rule says which plans break it, and of each of these the field and a sentence. `Area`, `Track` and `many` use them.
The database has the same rules (sql/12_checks.sql).
"""

import math
import sys
from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model.scene import MAX_LATITUDE_DEG

Floats: TypeAlias = NDArray[np.float64]
Offsets: TypeAlias = NDArray[np.int64]
Flags: TypeAlias = NDArray[np.bool_]
# Returns the field of a plan and the sentence of the rule that it breaks.
Say: TypeAlias = Callable[[int], tuple[str, str]]

MAX_LONGITUDE_DEG: Final = 360.0  # unwrapped coordinates may leave +-180, but not by more than half a turn
# Half round the equator; no haven reaches further from its reference point.
MAX_HAVEN_M: Final = 20_037_508
# What two of them take grows with the square of this, to half a second (kernel.h: KERNEL_MOST_VERTICES).
MAX_HAVEN_CORNERS: Final = 10_000
# Rounding of its coordinates turns a straight corner by this much at most, times the square of the largest coordinate.
HAVEN_SLACK: Final = 8.0 * sys.float_info.epsilon
# More than an area has vertices, or a track waypoints, that anybody drew: about what a file of the size that is read
# holds. Databases may have lower limits (sql/12_checks.sql, _check_size).
MAX_POINTS: Final = 1_000_000
# Range of instants (years 0001 to 9999): timestamps, ISO 8601 and Python can all express it.
MIN_INSTANT_US: Final = -62_135_596_800_000_000
MAX_INSTANT_US: Final = 253_402_300_799_999_999
# Of a ring that goes round a pole.
POLE_RULE: Final = (
    "; it goes round a pole: close it along latitude 90, as in […, [180, 85], [180, 90], [-180, 90], [-180, 85], …], "
    "in a scene with motion great_circle"
)
_MOST_DEG: Final = np.array([MAX_LONGITUDE_DEG, MAX_LATITUDE_DEG])
_MULTIPOLYGON: Final = int(shapely.GeometryType.MULTIPOLYGON)
# Of a height.
FINITE: Final = "must be a finite number of metres, or absent"
_IN_CALENDAR: Final = "must lie in the years 1 to 9999"


class Broken:
    """Which of n plans break a group of rules, and of each the first rule that it breaks.

    offset : (n + 1,) of the places of the plans, of rules of places
    """

    def __init__(self, n: int, offset: Offsets | None = None) -> None:
        self.is_sound: Flags = np.ones(n, np.bool_)
        self._offset = offset
        self._said: dict[int, tuple[str, str]] = {}

    def add(self, is_broken: Flags, say: Say) -> None:
        """Add a rule, which some plans (n,) break."""
        if np.count_nonzero(is_broken):
            broken = is_broken & self.is_sound
            self.is_sound &= ~broken
            for row in np.flatnonzero(broken).tolist():
                self._said[row] = say(row)

    def add_places(self, is_broken: Flags, say: Say) -> None:
        """Add a rule that is broken at some places, or some numbers of them, (w,) or (w, k)."""
        if np.count_nonzero(is_broken):
            assert self._offset is not None  # noqa: S101
            places = np.flatnonzero(is_broken if is_broken.ndim == 1 else is_broken.any(axis=1))
            rows = np.zeros(len(self.is_sound), np.bool_)
            rows[np.searchsorted(self._offset, places, side="right") - 1] = True
            self.add(rows, say)

    def and_then(self, other: "Broken") -> "Broken":
        """Return which plans break a rule of these, or of others."""
        self.is_sound &= other.is_sound
        self._said = {**other._said, **self._said}
        return self

    def raise_for(self, row: int, who: str) -> None:
        """Raise the InvalidInput for a plan that breaks a rule."""
        if row in self._said:
            raise InvalidInput(who, *self._said[row])


def footprints(given: NDArray[np.object_]) -> Broken:
    """Return which footprints break a rule.

    given : (n,) MultiPolygons of longitude and latitude, degrees, or other values, which break one
    """
    count = shapely.get_num_coordinates(given)
    offset = _offsets(count)
    broken = Broken(len(given), offset)
    is_other = (shapely.get_type_id(given) != _MULTIPOLYGON) | (count == 0)
    broken.add(is_other, lambda _: ("geometry", "must be a non-empty Polygon or MultiPolygon"))
    several = np.flatnonzero(shapely.get_num_geometries(given) > 1)
    if several.size:
        parts, of_part = shapely.get_parts(given[several], return_index=True)
        is_hollow = np.zeros(len(given), np.bool_)
        is_hollow[several[of_part[shapely.get_num_coordinates(parts) == 0]]] = True
        broken.add(is_hollow, lambda _: ("geometry", "must have no empty parts"))
    _add_size(broken, "geometry", count, "vertices")
    lonlat = shapely.get_coordinates(given)
    _add_coordinates(broken, lonlat, offset)
    west, _, east, _ = shapely.bounds(given).T
    with np.errstate(invalid="ignore"):  # of infinite coordinates
        width = east - west
        broken.add(
            width > 360.0, lambda i: ("geometry", f"must not be wider than 360 degrees; it is {width[i]:g} wide")
        )
    is_valid = shapely.is_valid(given, where=broken.is_sound, out=np.ones(len(given), np.bool_))
    broken.add(~is_valid, lambda i: ("geometry", _why_invalid(given[i])))
    return broken


def spans(start_us: NDArray[np.int64], end_us: NDArray[np.int64], is_given: Flags) -> Broken:
    """Return which spans break a rule.

    start_us, end_us : (n,) microseconds, of any value where there is no bound
    is_given : (n, 2) whether there are a start and an end
    """
    broken = Broken(len(start_us))
    for name, at, there in (("start", start_us, is_given[:, 0]), ("end", end_us, is_given[:, 1])):
        outside = there & ((at < MIN_INSTANT_US) | (at > MAX_INSTANT_US))
        broken.add(outside, lambda _, name=name: (name, _IN_CALENDAR))  # type: ignore[misc]
    broken.add(is_given.all(axis=1) & (end_us <= start_us), lambda _: ("end", "must be later than start"))
    return broken


def heights(floor_m: Floats, ceiling_m: Floats, is_given: Flags) -> Broken:
    """Return which heights break a rule.

    floor_m, ceiling_m : (n,) metres, of any value where there is no limit
    is_given : (n, 2) whether there are a floor and a ceiling
    """
    broken = Broken(len(floor_m))
    for name, height, there in (("floor_m", floor_m, is_given[:, 0]), ("ceiling_m", ceiling_m, is_given[:, 1])):
        broken.add(there & ~np.isfinite(height), lambda _, name=name: (name, FINITE))  # type: ignore[misc]
    with np.errstate(invalid="ignore"):
        is_low = is_given.all(axis=1) & (ceiling_m <= floor_m)
    broken.add(is_low, lambda i: ("ceiling_m", f"must be above floor_m ({floor_m[i]:g}); got {ceiling_m[i]:g}"))
    return broken


def courses(positions_deg: Floats, way: Offsets, times_us: NDArray[np.int64], clock: Offsets) -> Broken:
    """Return which courses break a rule.

    positions_deg : (w, 2) longitude and latitude; track i has the waypoints [way[i], way[i + 1])
    times_us : (t,) microseconds; track i has the times [clock[i], clock[i + 1])
    """
    broken, of_times = Broken(len(way) - 1, way), Broken(len(clock) - 1, clock)
    points, times = way[1:] - way[:-1], clock[1:] - clock[:-1]
    broken.add(points < 2, lambda _: ("geometry", "a track needs at least two waypoints of longitude and latitude"))
    _add_size(broken, "geometry", points, "waypoints")
    _add_coordinates(broken, positions_deg, way)
    broken.add(
        points != times, lambda i: ("times", f"must be one per waypoint: {points[i]} waypoints, {times[i]} times")
    )
    of_times.add_places((times_us < MIN_INSTANT_US) | (times_us > MAX_INSTANT_US), lambda _: ("times", _IN_CALENDAR))
    is_late = np.zeros(len(times_us), np.bool_)
    np.less_equal(times_us[1:], times_us[:-1], out=is_late[:-1])
    # The first waypoint of a track follows another one.
    is_late[clock[1:][times > 0] - 1] = False

    def late(i: int) -> tuple[str, str]:
        k = int(np.flatnonzero(is_late[clock[i] : clock[i + 1]])[0])
        at, here = times_us[clock[i] + k : clock[i] + k + 2], positions_deg[way[i] + k : way[i] + k + 2]
        moved = at[0] == at[1] and bool(np.any(here[0] != here[1]))
        rule = "is at two places at the same time" if moved else "must be later than the time before it"
        return f"times[{k + 1}]", rule

    of_times.add_places(is_late, late)
    return broken.and_then(of_times)


def outlines(outline_m: Floats, ring: Offsets, field: Callable[[int], str]) -> Broken:
    """Return which havens break a rule.

    outline_m : (v, 2) starboard and forward, metres; haven i has the corners [ring[i], ring[i + 1])
    field : the name of the field of a haven
    """
    broken = Broken(len(ring) - 1, ring)
    corners = ring[1:] - ring[:-1]
    broken.add(corners < 1, lambda i: (field(i), "must be a ring of [starboard, forward] metres"))
    broken.add_places(~np.isfinite(outline_m), lambda i: (field(i), "must be finite numbers of metres"))
    rule = f"must lie within {MAX_HAVEN_M} m of the reference point: half round the earth"
    broken.add_places(np.abs(outline_m) > MAX_HAVEN_M, lambda i: (field(i), rule))
    broken.add(
        corners > MAX_HAVEN_CORNERS,
        lambda i: (field(i), f"must have at most {MAX_HAVEN_CORNERS} corners; got {corners[i]}"),
    )
    is_ring = broken.is_sound & (corners > 2)
    is_bent = np.zeros(len(corners), np.bool_)
    if np.count_nonzero(is_ring) == len(corners):
        is_bent = ~_are_convex(outline_m, ring)
    elif np.count_nonzero(is_ring):
        some = outline_m[np.repeat(is_ring, corners)]
        is_bent[is_ring] = ~_are_convex(some, _offsets(corners[is_ring]))
    broken.add(is_bent, lambda i: (field(i), "must be a convex ring; split it, or use its convex hull"))
    return broken


def _are_convex(outline_m: Floats, ring: Offsets) -> Flags:
    """Return whether rings (n,) of at least three vertices turn one way only, and round once."""
    start, last = ring[:-1], ring[1:] - 1
    after = np.arange(1, len(outline_m) + 1)
    after[last] = start
    edge = outline_m[after] - outline_m
    (u, v), (u_next, v_next) = edge.T, edge[after].T
    turn = u * v_next - v * u_next
    size = np.abs(outline_m)
    slack = HAVEN_SLACK * np.maximum.reduceat(np.maximum(size[:, 0], size[:, 1]), start) ** 2
    least, most = np.minimum.reduceat(turn, start), np.maximum.reduceat(turn, start)
    # Most rings turn at each vertex, one way, and their sides head north of east again once.
    is_upward = (v < 0.0) & (v_next >= 0.0)
    is_plain = ((least > slack) | (most < -slack)) & (np.add.reduceat(is_upward.astype(np.int64), start) == 1)
    if np.count_nonzero(is_plain) == len(start):
        return is_plain
    is_left, is_right = most > slack, least < -slack
    way, heading = np.where(is_left, 1.0, -1.0), np.arctan2(v, u)
    moves = (u != 0.0) | (v != 0.0)
    if np.count_nonzero(moves) < len(moves):  # a vertex given twice has no heading
        count = np.add.reduceat(moves.astype(np.int64), start)
        heading, of = heading[moves], np.repeat(np.arange(len(start)), count)
        last = np.cumsum(count) - 1
        after = np.arange(1, len(heading) + 1)
        after[last[count > 0]] = (last - count + 1)[count > 0]
    else:
        of = np.arange(len(start)).repeat(ring[1:] - start)
    step = heading[after] - heading
    step = way[of] * (step - math.tau * np.rint(step / math.tau))
    step[step < -3.0] += math.tau  # back the way it came: both ways are as far
    return ~(is_left & is_right) & (np.bincount(of, step, len(start)) < 1.5 * math.tau)


def sizes(points: NDArray[np.int64], field: str, what: str) -> Broken:
    """Return which plans have more points (n,) in a field than any may have; what : they are called."""
    broken = Broken(len(points))
    _add_size(broken, field, points, what)
    return broken


def _add_size(broken: Broken, field: str, points: NDArray[np.int64], what: str) -> None:
    def say(i: int) -> tuple[str, str]:
        rule = f"must have at most {MAX_POINTS} {what}; got {points[i]}"
        return field, f"{rule} (simplify it, or split it into several objects)"

    broken.add(points > MAX_POINTS, say)


def _offsets(count: NDArray[np.int64]) -> Offsets:
    found = np.zeros(len(count) + 1, np.int64)
    np.add.accumulate(count, out=found[1:])
    return found


def _add_coordinates(broken: Broken, lonlat: Floats, offset: Offsets) -> None:
    """Add the rules of places (v, 2), degrees."""
    is_outside = ~(np.abs(lonlat) <= _MOST_DEG)
    if not np.count_nonzero(is_outside):
        return

    def worst(i: int, axis: int) -> float:
        return float(np.abs(lonlat[offset[i] : offset[i + 1], axis]).max())

    broken.add_places(~np.isfinite(lonlat), lambda _: ("geometry", "coordinates must be finite numbers"))
    hint = "(is it longitude first?)"
    broken.add_places(
        is_outside[:, 1],
        lambda i: ("geometry", f"latitude must lie within +-90 degrees; got {worst(i, 1):g} {hint}"),
    )
    broken.add_places(
        is_outside[:, 0], lambda i: ("geometry", f"longitude must lie within +-360 degrees; got {worst(i, 0):g}")
    )


def _why_invalid(footprint: shapely.MultiPolygon) -> str:
    pole = POLE_RULE if any(map(_goes_round, shapely.get_parts(footprint))) else ""
    return f"must be a valid polygon: {shapely.is_valid_reason(footprint)}{pole}"


def _goes_round(polygon: shapely.Polygon) -> bool:
    """Return whether the outer ring of a polygon goes round a pole, by the shorter way along each side."""
    lon = shapely.get_coordinates(polygon.exterior)[:, 0]
    return abs(float(np.sum(np.remainder(np.diff(lon) + 180.0, 360.0) - 180.0))) > 180.0
