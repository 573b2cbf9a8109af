"""Build tracks from routes: waypoints, legs and a schedule, as RTZ, S-421 and GPX describe them.

Times between two timed waypoints follow from the lengths of the legs, at constant speed. Loxodromes follow orthodromes
within half a metre, or a hundredth of the cross-track limits; the haven grows by that.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth import geodesy
from conflictdb.earth.shortest_lines import DEVIATION_M, NoShortestLineError, followed
from conflictdb.errors import InvalidInput
from conflictdb.formats.contents import SAYS_NO_SIZES
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.hints import departure, haven
from conflictdb.formats.instants import format_instant
from conflictdb.formats.track_times import MAX_DURATION_S
from conflictdb.model.plans import (
    MAX_INSTANT_US,
    MAX_LATITUDE_DEG,
    MAX_RHUMB_LATITUDE_DEG,
    METRES_PER_NMI,
    MIN_INSTANT_US,
    EarthModel,
    Motion,
    Track,
    rectangle_outline_m,
)
from conflictdb.model.speed_limits import MPS_PER_KNOT

# A remark on files of routes that give no haven.
A_POINT: Final = f"{SAYS_NO_SIZES}: the vessel is a point; --haven gives it a size"
# Beyond this a limit in nautical miles is probably one in metres.
MOST_XTD_NMI: Final = 10.0
# Two times of one event that differ by less are the same, rounded to seconds.
_SAME_US: Final = 1_000_000
_SAME_KN: Final = 0.010001
_BY_BOTH: Final = "by the manual and the calculated schedule"
_LEAST_SPEED_KN: Final = 1e-6  # of a stay


@dataclass(slots=True)
class Waypoint:
    """A waypoint, and the leg that leads to it.

    is_orthodrome : whether the leg is the shortest line; else it is a rhumb line
    port_m, starboard_m : limits of the distance from the leg; None: not given
    speed_kn : planned on the leg
    arrival_us, departure_us : planned
    stay_us : between arrival and departure
    radius_m : of the turn at the waypoint
    early_us, late_us : how much earlier and later the ship may be here
    speed_window_kn : how far the speed on the leg may differ from the planned one
    """

    name: str
    lon_deg: float
    lat_deg: float
    is_orthodrome: bool = False
    port_m: float | None = None
    starboard_m: float | None = None
    speed_kn: float | None = None
    arrival_us: int | None = None
    departure_us: int | None = None
    stay_us: int | None = None
    radius_m: float = 0.0
    early_us: int = 0
    late_us: int = 0
    speed_window_kn: float = 0.0


@dataclass(slots=True)
class Route:
    """A route; `name` is its key too.

    members : of the track that was written as this route, in place of the haven and the properties; if all legs are
        orthodromes, they are the legs of this track
    """

    name: str
    waypoints: Sequence[Waypoint]
    properties: dict[str, Any] = field(default_factory=dict)
    members: Mapping[str, Any] = field(default_factory=dict)

    @property
    def has_great_circles(self) -> bool:
        """Whether it was written from a track of great circles: its legs are not followed with rhumb lines."""
        return bool(self.members) and all(point.is_orthodrome for point in self.waypoints[1:])


@dataclass(frozen=True, slots=True)
class _Line:
    """The lines of a leg: positions (n, 2) after its start, and their lengths (n,) in metres."""

    positions_deg: NDArray[np.float64]
    lengths_m: NDArray[np.float64]

    @property
    def length_m(self) -> float:
        return float(self.lengths_m.sum())


def limit_m(who: str, field: str, nmi: float) -> float:
    """Return a cross-track limit in metres; raises InvalidInput for one that is probably not in nautical miles."""
    if not 0.0 <= nmi < np.inf:
        raise InvalidInput(who, field, f"must be a number of nautical miles, 0 or more; got {nmi:g}")
    if nmi > MOST_XTD_NMI:
        rule = f"is {nmi:g} nautical miles, more than {MOST_XTD_NMI:g}: probably metres, which would be"
        raise InvalidInput(who, field, f"{rule} {nmi / METRES_PER_NMI:.4g} nautical miles")
    return nmi * METRES_PER_NMI


def track_of(who: str, route: Route, max_speed_kn: float) -> Track:
    """Return the track of a route; raises InvalidInput.

    who : the route, as the user knows it
    """
    points = route.waypoints
    if len(points) < 2:
        raise InvalidInput(who, "waypoints", f"a route needs at least two waypoints; got {len(points)}")
    highest_deg = MAX_LATITUDE_DEG if route.has_great_circles else MAX_RHUMB_LATITUDE_DEG
    for point in points:
        if not (abs(point.lat_deg) <= highest_deg and abs(point.lon_deg) <= 180.0):
            rule = f"must lie within +-180 degrees of longitude and +-{highest_deg:g} of latitude"
            raise InvalidInput(who, point.name, f"{rule}; got {point.lon_deg:g}, {point.lat_deg:g}")
        if (point.port_m is None) != (point.starboard_m is None):
            given, missing = ("starboard", "port") if point.port_m is None else ("port", "starboard")
            rule = f"has a cross-track limit to {given} only: give that to {missing} too, which may be 0"
            raise InvalidInput(who, point.name, rule)
    deviation_m = _deviation_m(points)
    if route.has_great_circles:
        lines = [_great_circle(before, point) for before, point in pairwise(points)]
    else:
        lines = [_line(who, before, point, deviation_m) for before, point in pairwise(points)]
    arrivals, departures = _times(who, points, lines)
    positions: list[tuple[float, float]] = [(points[0].lon_deg, points[0].lat_deg)]
    times = [arrivals[0]]
    # The waypoint to which each leg of the track leads.
    leads_to: list[int] = []
    for i, line in enumerate(lines, 1):
        if departures[i - 1] > arrivals[i - 1]:
            positions.append(positions[-1])
            times.append(departures[i - 1])
            leads_to.append(i - 1)
        shares = np.cumsum(line.lengths_m) / (line.length_m or 1.0)
        begin, end = departures[i - 1], arrivals[i]
        times += [begin + round((end - begin) * float(share)) for share in shares[:-1]] + [end]
        positions += [(float(lon), float(lat)) for lon, lat in line.positions_deg]
        leads_to += [i] * len(line.lengths_m)
    if departures[-1] > arrivals[-1]:
        positions.append(positions[-1])
        times.append(departures[-1])
        leads_to.append(len(points) - 1)
    if not MIN_INSTANT_US <= min(times) <= max(times) <= MAX_INSTANT_US:
        raise InvalidInput(who, "times", "must lie in the years 1 to 9999")
    lonlat = np.array(positions, np.float64)
    if not route.has_great_circles:  # these take the shorter way round, and may go round a pole
        # Whole turns, so that a route over the antimeridian is continuous and keeps its digits.
        lonlat[1:, 0] -= 360.0 * np.cumsum(np.round(np.diff(lonlat[:, 0]) / 360.0))
    members: dict[str, Any] = {"outline_m": _haven(deviation_m), "name": route.name}
    members["tolerances"] = _tolerances(who, points, lonlat, times, leads_to) or None
    members |= {
        "properties": route.properties,
        "legs": _legs(route),
        **route.members,
    }
    return Track(
        checked_key(who, "id", route.name), lonlat, np.array(times, np.int64), **members, max_speed_kn=max_speed_kn
    )


def _legs(route: Route) -> Motion | None:
    """Return the lines of the track's legs; None: all are meridians or the equator, which are both, or follow both."""
    only = {
        point.is_orthodrome
        for before, point in pairwise(route.waypoints)
        if point.lon_deg != before.lon_deg and (point.lat_deg != 0.0 or before.lat_deg != 0.0)
    }
    if False in only:
        return Motion.RHUMB
    return Motion.GREAT_CIRCLE if only and route.has_great_circles else None


def _haven(deviation_m: float) -> NDArray[np.float64]:
    """Return the outline of the vessel, grown by what the lines of legs deviate."""
    return rectangle_outline_m(*(float(side) + deviation_m for side in haven()))


def _tolerances(
    who: str,
    points: Sequence[Waypoint],
    lonlat: NDArray[np.float64],
    times_us: Sequence[int],
    leads_to: Sequence[int],
) -> dict[str, Any]:
    """Return how far voyages may differ from the plan, as members of a track; empty if nothing is said.

    A ship that may be early or late at waypoints is within the plan moved by the largest of these.

    leads_to : the waypoint to which each leg leads; a stay's is its own, with the wider limits of the legs around it
    """
    found: dict[str, Any] = {}
    is_stay = (lonlat[1:] == lonlat[:-1]).all(axis=1).tolist()
    for side in ("port_m", "starboard_m"):
        limits = [getattr(point, side) or 0.0 for point in points]
        wider = [max(one, after) for one, after in zip(limits, [*limits[1:], 0.0], strict=True)]
        if any(limits[1:]):
            found[f"xtd_{side}"] = [
                wider[of] if stays else limits[of] for of, stays in zip(leads_to, is_stay, strict=True)
            ]
    turns = [
        points[of].radius_m if of != after and not stays else 0.0
        for (of, after), stays in zip(pairwise(leads_to), map(any, pairwise(is_stay)), strict=True)
    ]
    if any(turns):
        found["turn_radius_m"] = turns
    early_us, late_us = max(point.early_us for point in points), max(point.late_us for point in points)
    if early_us or late_us:
        for name, at_us in (("departure_window", times_us[0]), ("arrival_window", times_us[-1])):
            found[name] = [format_instant(at_us - early_us), format_instant(at_us + late_us)]
    if any(point.speed_window_kn for point in points[1:]):
        earth = geodesy.earth_of(EarthModel.WGS84)
        length_m = geodesy.rhumb_distance(earth, *lonlat[:-1].T, *lonlat[1:].T)
        speed_kn = length_m / (np.diff(times_us) * 1e-6) / MPS_PER_KNOT
        window = np.array([points[of].speed_window_kn for of in leads_to])
        slowest_kn = np.maximum(speed_kn - window, 0.0)
        # A stay takes its time, whatever these bounds are.
        slowest_kn[is_stay] = _LEAST_SPEED_KN
        if not late_us and not early_us and (slowest_kn == 0.0).any():
            where = points[leads_to[int(np.argmin(slowest_kn))]].name
            rule = "is at least the planned speed: the ship might never arrive; give a window of the arrival, too"
            raise InvalidInput(who, f"{where}, speedWindow", rule)
        found["min_speed_kn"] = slowest_kn.tolist()
        found["max_speed_kn"] = np.maximum(speed_kn + window, _LEAST_SPEED_KN).tolist()
    return found


def _deviation_m(points: Sequence[Waypoint]) -> float:
    """Return how far lines may deviate from orthodromes: half a metre, or a hundredth of the narrowest limits."""
    limits = [min(point.port_m or 0.0, point.starboard_m or 0.0) for point in points[1:] if point.is_orthodrome]
    return max(DEVIATION_M, 0.01 * min(limits)) if limits else 0.0


def _line(who: str, before: Waypoint, point: Waypoint, deviation_m: float) -> _Line:
    ends = np.array([(before.lon_deg, before.lat_deg), (point.lon_deg, point.lat_deg)])
    if point.is_orthodrome:
        try:
            ends, _ = followed(ends, deviation_m)
        except NoShortestLineError:
            rule = "is opposite to the waypoint before it: several orthodromes are equally short"
            raise InvalidInput(who, point.name, rule) from None
    earth = geodesy.earth_of(EarthModel.WGS84)
    return _Line(ends[1:], geodesy.rhumb_distance(earth, *ends[:-1].T, *ends[1:].T))


def _great_circle(before: Waypoint, point: Waypoint) -> _Line:
    end = np.array([[point.lon_deg, point.lat_deg]])
    length_m = geodesy.great_circle_distance(before.lon_deg, before.lat_deg, *end.T)
    return _Line(end, np.asarray(length_m, np.float64))


def _times(who: str, points: Sequence[Waypoint], lines: Sequence[_Line]) -> tuple[list[int], list[int]]:
    """Return arrival and departure at each waypoint, microseconds since 1970."""
    start_us, speed_kn = departure()
    first = points[0].departure_us if points[0].departure_us is not None else points[0].arrival_us
    if first is None:
        first = start_us
    if first is None:
        raise InvalidInput(who, points[0].name, "has no departure time: give it in the file, or with --departure")
    arrivals: list[int | None] = [points[0].arrival_us if points[0].arrival_us is not None else first]
    departures: list[int | None] = [first]
    for point, line in zip(points[1:], lines, strict=True):
        arrival = _arrival(who, point, line, departures[-1], speed_kn)
        arrivals.append(arrival)
        departures.append(_departure(point, arrival))
    _fill(who, points, lines, arrivals, departures)
    return [int(one or 0) for one in arrivals], [int(one or 0) for one in departures]


def _arrival(who: str, point: Waypoint, line: _Line, before: int | None, speed_kn: float | None) -> int | None:
    if point.arrival_us is not None:
        return point.arrival_us
    if point.departure_us is not None and point.stay_us is not None:
        return point.departure_us - point.stay_us
    speed = point.speed_kn if point.speed_kn is not None else speed_kn
    if speed is not None and before is not None:
        if not speed > 0.0:
            raise InvalidInput(who, point.name, f"has a speed of {speed:g} knots: it must be above 0")
        seconds = line.length_m / (speed * MPS_PER_KNOT)
        if not seconds < MAX_DURATION_S:
            raise InvalidInput(who, point.name, "has so low a speed that the route would leave the years 1 to 9999")
        return before + round(1e6 * seconds)
    return point.departure_us


def _departure(point: Waypoint, arrival: int | None) -> int | None:
    if point.departure_us is not None:
        return point.departure_us
    return None if arrival is None else arrival + (point.stay_us or 0)


def _fill(
    who: str,
    points: Sequence[Waypoint],
    lines: Sequence[_Line],
    arrivals: list[int | None],
    departures: list[int | None],
) -> None:
    """Fill in times between two timed waypoints, at constant speed."""
    for first, last in _gaps(arrivals):
        if last == len(points):
            rule = "has neither an arrival time nor a speed: give one in the file, or with --departure and --speed-kn"
            raise InvalidInput(who, points[first].name, rule)
        begin, end = departures[first - 1], arrivals[last]
        assert begin is not None  # noqa: S101
        assert end is not None  # noqa: S101
        run = np.cumsum([line.length_m for line in lines[first - 1 : last]])
        for k in range(first, last):
            stay = points[k].stay_us
            if stay:
                rule = "has a stay, but no arrival time and no speed on its leg: give one of them"
                raise InvalidInput(who, points[k].name, rule)
            arrivals[k] = departures[k] = begin + round((end - begin) * float(run[k - first] / (run[-1] or 1.0)))


def _gaps(arrivals: Sequence[int | None]) -> Iterator[tuple[int, int]]:
    """Yield [first, last) of each run of waypoints without a time."""
    first = None
    for i, arrival in enumerate([*arrivals, 0]):
        if arrival is None and first is None:
            first = i
        if first is not None and (arrival is not None or i == len(arrivals)):
            yield first, i
            first = None


def agreed(who: str, field: str, *times_us: int | None) -> int | None:
    """Return the time, or duration, on which several sources agree to a second; raises InvalidInput if they do not."""
    given = [one for one in times_us if one is not None]
    if given and max(given) - min(given) > _SAME_US:
        raise InvalidInput(who, field, f"is given twice, {(max(given) - min(given)) / 1e6:g} s apart, {_BY_BOTH}")
    return given[0] if given else None


def agreed_speed(who: str, field: str, speeds_kn: Sequence[float], arrival_us: int | None) -> float | None:
    """Return the speed on which several sources agree to 0.01 knots; raises InvalidInput if they do not."""
    if speeds_kn and arrival_us is None and max(speeds_kn) - min(speeds_kn) > _SAME_KN:
        rule = f"is given twice, {min(speeds_kn):g} and {max(speeds_kn):g} knots, {_BY_BOTH}"
        raise InvalidInput(who, field, f"{rule}: leave one out")
    return speeds_kn[0] if speeds_kn else None
