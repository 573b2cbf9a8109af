"""The rules of shapes, times and heights of plans, each stated once, on the values of many plans or of one (plan_rows).

A rule says which plans break it, and of each of these the field and a sentence. `Area`, `Track` and `many` use them.
The database has the same rules (sql/12_checks.sql).
"""

import math
import sys
from collections.abc import Callable
from typing import Any, Final, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.model.plan_rows import Broken, Flags, Many, Numbers, Rows, first_of, item, rows_of
from conflictdb.model.scene import MAX_LATITUDE_DEG

Floats: TypeAlias = NDArray[np.float64]

MAX_LONGITUDE_DEG: Final = 360.0  # unwrapped coordinates may leave +-180, but not by more than half a turn
# Half round the equator; no haven reaches further from its reference point.
MAX_HAVEN_M: Final = 20_037_508
# The time of a pair grows with the square of this, to half a second (kernel.h: KERNEL_MOST_VERTICES).
MAX_HAVEN_CORNERS: Final = 10_000
# Rounding of its coordinates turns a straight corner by this much at most, times the square of the largest coordinate.
HAVEN_SLACK: Final = 8.0 * sys.float_info.epsilon
# More than an area has vertices, or a track waypoints, that anybody drew: about what a file of the size that is read
# holds. Databases may have lower limits (sql/12_checks.sql, _check_size).
MAX_POINTS: Final = 1_000_000
# Range of instants (years 0001 to 9999): timestamps, ISO 8601 and Python can all express it.
MIN_INSTANT_US: Final = -62_135_596_800_000_000
MAX_INSTANT_US: Final = 253_402_300_799_999_999
# Added to the errors of a ring that goes round a pole.
POLE_RULE: Final = (
    "; it goes round a pole: close it along latitude 90, as in […, [180, 85], [180, 90], [-180, 90], [-180, 85], …], "
    "in a scene with motion great_circle"
)
_MOST_DEG: Final = np.array([MAX_LONGITUDE_DEG, MAX_LATITUDE_DEG])
_MULTIPOLYGON: Final = int(shapely.GeometryType.MULTIPOLYGON)
# Rule of heights.
FINITE: Final = "must be a finite number of metres, or absent"
IN_CALENDAR: Final = "must lie in the years 1 to 9999"


def footprints(given: Any) -> Broken:
    """Return which footprints break a rule.

    given : (n,) MultiPolygons of longitude and latitude, degrees, or other geometries, which break one; or one
    """
    count = shapely.get_num_coordinates(given)
    rows = rows_of(count)
    broken = rows.broken()
    is_other = (shapely.get_type_id(given) != _MULTIPOLYGON) | (count == 0)
    broken.add(is_other, lambda _: ("geometry", "must be a non-empty Polygon or MultiPolygon"))
    has_several = shapely.get_num_geometries(given) > 1
    if np.count_nonzero(has_several):
        broken.add(has_several & _have_empty_parts(given), lambda _: ("geometry", "must have no empty parts"))
    _add_size(broken, "geometry", count, "vertices")
    lonlat = shapely.get_coordinates(given)
    _add_coordinates(broken, lonlat, rows)

    def wide(i: int) -> tuple[str, str]:
        width = np.ptp(lonlat[rows.places(i), 0])
        return "geometry", f"must not be wider than 360 degrees; it is {width:g} wide"

    with np.errstate(invalid="ignore"):  # of infinite coordinates
        broken.add(rows.where(broken.is_sound, _are_wide, lonlat), wide)
        broken.add(~shapely.is_valid(given), lambda i: ("geometry", _why_invalid(item(given, i))))
    return broken


def out_of_calendar(at_us: Any) -> Any:
    """Return whether instants, or one, are outside the years 1 to 9999."""
    return (at_us < MIN_INSTANT_US) | (at_us > MAX_INSTANT_US)


def spans(start_us: Numbers, end_us: Numbers, has_start: Flags, has_end: Flags, rows: Rows) -> Broken:
    """Return which spans break a rule.

    start_us, end_us : microseconds, of any value where there is no bound
    """
    broken = rows.broken()
    for name, at, there in (("start", start_us, has_start), ("end", end_us, has_end)):
        outside = there & out_of_calendar(at)
        broken.add(outside, lambda _, name=name: (name, IN_CALENDAR))  # type: ignore[misc]
    broken.add(has_start & has_end & (end_us <= start_us), lambda _: ("end", "must be later than start"))
    return broken


def heights(floor_m: Numbers, ceiling_m: Numbers, has_floor: Flags, has_ceiling: Flags, rows: Rows) -> Broken:
    """Return which heights break a rule.

    floor_m, ceiling_m : metres, of any value where there is no limit
    """
    broken = rows.broken()
    for name, height, there in (("floor_m", floor_m, has_floor), ("ceiling_m", ceiling_m, has_ceiling)):
        is_finite = there & (abs(height) < math.inf)
        broken.add(is_finite != there, lambda _, name=name: (name, FINITE))  # type: ignore[misc]
    is_low = has_floor & has_ceiling & (ceiling_m <= floor_m)

    def low(i: int) -> tuple[str, str]:
        return "ceiling_m", f"must be above floor_m ({item(floor_m, i):g}); got {item(ceiling_m, i):g}"

    broken.add(is_low, low)
    return broken


def courses(positions_deg: Floats, way: Rows, times_us: NDArray[np.int64], clock: Rows) -> Broken:
    """Return which courses break a rule.

    positions_deg : (w, 2) longitude and latitude of all waypoints
    times_us : (t,) microseconds of all times
    """
    broken = way.broken()
    points, times = way.count, clock.count
    broken.add(points < 2, lambda _: ("geometry", "a track needs at least two waypoints of longitude and latitude"))
    _add_size(broken, "geometry", points, "waypoints")
    _add_coordinates(broken, positions_deg, way)

    def unequal(i: int) -> tuple[str, str]:
        return "times", f"must be one per waypoint: {item(points, i)} waypoints, {item(times, i)} times"

    broken.add(points != times, unequal)
    broken.add(clock.any(out_of_calendar(times_us)), lambda _: ("times", IN_CALENDAR))
    is_late = clock.each_next(np.less_equal, times_us)

    def late(i: int) -> tuple[str, str]:
        k = first_of(is_late, clock, i)
        at, here = times_us[clock.places(i)][k : k + 2], positions_deg[way.places(i)][k : k + 2]
        moved = at[0] == at[1] and bool(np.any(here[0] != here[1]))
        rule = "is at two places at the same time" if moved else "must be later than the time before it"
        return f"times[{k + 1}]", rule

    broken.add(clock.any(is_late), late)
    return broken


def outlines(outline_m: Floats, ring: Rows, field: Callable[[int], str]) -> Broken:
    """Return which havens break a rule.

    outline_m : (v, 2) starboard and forward, metres, of all corners
    field : the name of the field of a haven
    """
    broken = ring.broken()
    corners = ring.count
    broken.add(corners < 1, lambda i: (field(i), "must be a ring of [starboard, forward] metres"))

    def far(i: int) -> tuple[str, str]:
        if not np.isfinite(outline_m[ring.places(i)]).all():
            return field(i), "must be finite numbers of metres"
        return field(i), f"must lie within {MAX_HAVEN_M} m of the reference point: half round the earth"

    broken.add(ring.any(~(np.abs(outline_m) <= MAX_HAVEN_M)), far)
    broken.add(
        corners > MAX_HAVEN_CORNERS,
        lambda i: (field(i), f"must have at most {MAX_HAVEN_CORNERS} corners; got {item(corners, i)}"),
    )
    is_bent = ring.where(broken.is_sound & (corners > 2), _are_bent, outline_m)
    broken.add(is_bent, lambda i: (field(i), "must be a convex ring; split it, or use its convex hull"))
    return broken


def _are_bent(outline_m: Floats, ring: Rows) -> Flags:
    """Return whether rings of at least three vertices turn both ways, or more than once round."""
    edge = ring.following(outline_m) - outline_m
    after = ring.following(edge)
    v, v_next = edge[:, 1], after[:, 1]
    turn = edge[:, 0] * v_next - v * after[:, 0]
    slack = HAVEN_SLACK * ring.most(np.abs(outline_m)) ** 2
    least, most = ring.least(turn), ring.most(turn)
    # Most rings turn at each vertex, one way, and their sides head north of east again once.
    is_plain = ((least > slack) | (most < -slack)) & (ring.total((v < 0.0) & (v_next >= 0.0)) == 1)
    if np.count_nonzero(is_plain) == np.size(is_plain):
        return ~is_plain
    start = ring.offset[:-1]
    is_left, is_right = np.atleast_1d(most > slack), np.atleast_1d(least < -slack)
    u = edge[:, 0]
    way, heading = np.where(is_left, 1.0, -1.0), np.arctan2(v, u)
    moves = (u != 0.0) | (v != 0.0)
    count = np.add.reduceat(moves.astype(np.int64), start)
    # A vertex given twice has no heading.
    heading, of = heading[moves], np.repeat(np.arange(len(start)), count)
    step = Many.of(count).following(heading) - heading
    step = way[of] * (step - math.tau * np.rint(step / math.tau))
    step[step < -3.0] += math.tau  # back the way it came: both ways are as far
    return (is_left & is_right) | (np.bincount(of, step, len(start)) >= 1.5 * math.tau)


def sizes(points: Numbers, rows: Rows, field: str, what: str) -> Broken:
    """Return which plans have more points in a field than any may have; what : they are called."""
    broken = rows.broken()
    _add_size(broken, field, points, what)
    return broken


def _add_size(broken: Broken, field: str, points: Numbers, what: str) -> None:
    def say(i: int) -> tuple[str, str]:
        rule = f"must have at most {MAX_POINTS} {what}; got {item(points, i)}"
        return field, f"{rule} (simplify it, or split it into several objects)"

    broken.add(points > MAX_POINTS, say)


def _add_coordinates(broken: Broken, lonlat: Floats, rows: Rows) -> None:
    is_outside = ~(np.abs(lonlat) <= _MOST_DEG)
    if not np.count_nonzero(is_outside):
        return

    def worst(i: int, axis: int) -> float:
        return float(np.abs(lonlat[rows.places(i), axis]).max())

    broken.add(rows.any(~np.isfinite(lonlat)), lambda _: ("geometry", "coordinates must be finite numbers"))
    hint = "(is it longitude first?)"
    broken.add(
        rows.any(is_outside[:, 1]),
        lambda i: ("geometry", f"latitude must lie within +-90 degrees; got {worst(i, 1):g} {hint}"),
    )
    broken.add(
        rows.any(is_outside[:, 0]),
        lambda i: ("geometry", f"longitude must lie within +-360 degrees; got {worst(i, 0):g}"),
    )


def _are_wide(lonlat: Floats, rows: Rows) -> Flags:
    return rows.most(lonlat[:, 0]) - rows.least(lonlat[:, 0]) > 360.0


def _have_empty_parts(given: Any) -> Flags:
    some = np.atleast_1d(given)
    parts, of_part = shapely.get_parts(some, return_index=True)
    found = np.zeros(len(some), np.bool_)
    found[of_part[shapely.get_num_coordinates(parts) == 0]] = True
    return found


def _why_invalid(footprint: shapely.MultiPolygon) -> str:
    pole = POLE_RULE if any(map(_goes_round, shapely.get_parts(footprint))) else ""
    return f"must be a valid polygon: {shapely.is_valid_reason(footprint)}{pole}"


def _goes_round(polygon: shapely.Polygon) -> bool:
    """Return whether the outer ring of a polygon goes round a pole, by the shorter way along each side."""
    lon = shapely.get_coordinates(polygon.exterior)[:, 0]
    return abs(float(np.sum(np.remainder(np.diff(lon) + 180.0, 360.0) - 180.0))) > 180.0
