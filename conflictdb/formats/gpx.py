"""Read GPX: track points as observed positions, routes as plans.

Each segment of a track becomes a track, from its usable points. A route becomes a track if it has a planned departure:
see docs/reference/files.md. Its legs are rhumb lines.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence, Set
from itertools import pairwise
from typing import Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.areas_of_files import Gathered
from conflictdb.formats.contents import SAYS_NO_SIZES, Contents, Remark, Skipped, row_id
from conflictdb.formats.fixes import Fixes, tracks_of
from conflictdb.formats.hints import departure
from conflictdb.formats.instants import parse_instant
from conflictdb.formats.routes import Route, Waypoint
from conflictdb.formats.standards import Standard
from conflictdb.formats.values_of_xml import duration_us, number_of, time_of
from conflictdb.formats.xml_text import Element

STANDARD: Final = Standard(
    "GPX",
    read={
        "time": "times of a track; of a route if all its points have one",
        "planned_departure etd DepartureTime": "departures",
        "ArrivalTime StopDuration": "arrivals and stays (Garmin)",
        "planned_speed": "speeds of legs",
    },
    unread={
        "ele geoidheight": "heights of points",
        "speed": "speed at a point",
        "depth Depth": "depths of Garmin",
        "hdop vdop pdop ageofdgpsdata": "accuracy",
        "arrival_radius waypoint_range_rings Proximity": "distances of alarms",
    },
    aside={
        "metadata": "when the file was made",
        "wpt": "waypoints, left out by number",
        "start end": "names of places",
        "time_display scale_min_max": "drawing (OpenCPN)",
        "style line": "drawing",
    },
)
_OPENCPN: Final = "OpenCPN"
_LAYERS: Final = ("waypoints", "routes", "tracks", "route_points", "track_points")
_NO_SIZES: Final = f"{SAYS_NO_SIZES}: all tracks are points"


def is_gpx(root: Element) -> bool:
    """Return whether an XML document is GPX, of any version."""
    return root.name == "gpx"


def read_gpx(
    root: Element, source: str, *, stem: str, max_speed_kn: float, layers: Sequence[str], skip_invalid: bool
) -> Contents:
    """Return the tracks of a GPX file; raises InvalidInput.

    layers : of waypoints, routes and tracks; none: all
    """
    unknown = [name for name in layers if name not in _LAYERS]
    if unknown:
        rule = f"there is no layer {unknown[0]!r:.60}; the file has {', '.join(_LAYERS)}"
        raise InvalidInput("file", "layer", rule)
    found = Gathered(source)
    skipped: list[Skipped] = []
    waypoints = sum(1 for _ in root.each("wpt"))
    if waypoints and (not layers or "waypoints" in layers):
        reason = f"{waypoints} features are waypoints: no tracks"
        skipped.append(Skipped(source, "layer 'waypoints'", reason, (), is_whole=False))
    observed: list[tuple[str, Fixes]] = []
    missing: dict[tuple[str, str], list[int]] = defaultdict(list)
    if not layers or {"tracks", "track_points"} & set(layers):
        observed = list(_segments(root, stem, missing))
    if not layers or {"routes", "route_points"} & set(layers):
        routes = list(enumerate(root.each("rte"), 1))
        timed = [(nth, one) for nth, one in routes if _is_timed(root, one)]
        untimed = len(routes) - len(timed)
        names = _route_names(timed, stem, {key for key, _ in observed})
        for number, route in timed:
            name = route.value("name")
            key = name if name in names else row_id(stem, f"route {number}")
            with found.refusals:
                found.add_route(f"route {number}", f"route {key!r}", _planned(root, key, route), max_speed_kn)
        if untimed:
            reason = (
                f"{untimed} features are routes, which have no times: no tracks; --departure and --speed-kn give them"
            )
            skipped.append(Skipped(source, "layer 'routes'", reason, (), is_whole=False))
    tracks, rest, notes = tracks_of(source, observed, (), max_speed_kn, missing)
    contents = found.contents(skip_invalid=skip_invalid)
    contents.tracks.extend(tracks)
    contents.skipped.extend([*skipped, *rest])
    contents.derived = [track.key for track in contents.tracks]
    texts = [*((_NO_SIZES,) if contents.tracks else ()), *notes]
    contents.remarks = [Remark(source, "file", text) for text in texts]
    return contents


def gpx_fixes(root: Element, stem: str) -> tuple[dict[str, Fixes], dict[tuple[str, str], list[int]]]:
    """Return the fixes of the tracks of a GPX file by key, and the numbers of the points that are left out."""
    found: dict[str, Fixes] = {}
    missing: dict[tuple[str, str], list[int]] = defaultdict(list)
    for key, fixes in _segments(root, stem, missing, is_joined=True):
        own = found.setdefault(key, Fixes())
        own.times_us += fixes.times_us
        own.positions_deg += fixes.positions_deg
    return found, missing


def _segments(
    root: Element, stem: str, missing: dict[tuple[str, str], list[int]], *, is_joined: bool = False
) -> Iterator[tuple[str, Fixes]]:
    """Yield the key and the fixes of each segment of each track; points without a time are noted as missing.

    is_joined : segments have the key of their track
    """
    every = list(root.each("trk"))
    names = _track_names(root, stem, every)
    number = 0
    for nth, track in enumerate(every, 1):
        name = track.value("name")
        segments = _segments_of(track)
        for part, segment in enumerate(segments, 1):
            key = name if name in names else row_id(stem, nth)
            key += f".{part}" if len(segments) > 1 and not is_joined else ""
            fixes = Fixes(constant={"name": name})
            for point in segment.each("trkpt"):
                number += 1
                who = f"layer 'track_points', point {number}"
                when = point.value("time")
                if when is None:
                    missing[key, "no time"].append(number)
                    continue
                try:
                    fixes.times_us.append(parse_instant(when, naive_is_utc=True))
                except ValueError as error:
                    raise InvalidInput(who, "time", str(error)) from None
                fixes.positions_deg.append(_place(who, point))
                fixes.lines.append(number)
            yield key, fixes


def _segments_of(track: Element) -> list[Element]:
    return [one for one in track.each("trkseg") if one.child("trkpt") is not None]


def _track_names(root: Element, stem: str, tracks: Sequence[Element]) -> set[str]:
    """Return the names that are keys: those of one track, which are no number of a track and no key of a segment."""
    same = Counter(track.value("name") for track in tracks)
    taken = {row_id(stem, f"route {number}") for number, _ in enumerate(root.each("rte"), 1)}
    for nth, track in enumerate(tracks, 1):
        parts = len(_segments_of(track))
        starts = (row_id(stem, nth), track.value("name")) if parts > 1 else ()
        taken |= {row_id(stem, nth), *(f"{start}.{part}" for start in starts for part in range(1, parts + 1))}
    return {name for name, count in same.items() if name and count == 1 and name not in taken}


def _route_names(routes: Sequence[tuple[int, Element]], stem: str, keys: Set[str]) -> set[str]:
    """Return the names of numbered routes that are keys: those of one route, which are no number of a route.

    keys : of tracks, which no route has
    """
    same = Counter(route.value("name") for _, route in routes)
    taken = {row_id(stem, f"route {number}") for number, _ in routes} | keys
    return {name for name, count in same.items() if name and count == 1 and name not in taken}


def _place(who: str, point: Element) -> tuple[float, float]:
    return number_of(who, "lon", point.get("lon")), number_of(who, "lat", point.get("lat"))


def _departure(route: Element) -> str | None:
    """Return the planned departure of a route, of its first point, None if neither has one."""
    first = route.child("rtept")
    own = route.value("extensions", "planned_departure")
    return own or (None if first is None else _extended(first, "etd") or _of_trip(first, "DepartureTime"))


def _extended(point: Element, name: str) -> str | None:
    """Return an extension of a route point: an element, or an attribute of `rte_properties`, as OpenCPN writes it."""
    properties = point.child("extensions", "rte_properties")
    return point.value("extensions", name) or (None if properties is None else properties.get(name))


def _of_trip(point: Element, name: str) -> str | None:
    """Return a time of a route point as Garmin's trip planner writes it."""
    return point.value("extensions", "ViaPoint", name)


def _has_times(root: Element, route: Element) -> bool:
    """Return whether times of points are those of the voyage."""
    if (root.get("creator") or "").startswith(_OPENCPN) or _departure(route) is not None:
        return False
    return any(point.value("time") is not None for point in route.each("rtept"))


def _is_timed(root: Element, route: Element) -> bool:
    return _departure(route) is not None or departure()[0] is not None or _has_times(root, route)


def _utc(who: str, field: str, text: str | None) -> int | None:
    """Return a time of GPX, in UTC where it says no offset; raises InvalidInput."""
    try:
        return None if text is None else parse_instant(text, naive_is_utc=True)
    except ValueError as error:
        raise InvalidInput(who, field, str(error)) from None


def _planned(root: Element, key: str, route: Element) -> Route:
    """Return a route, with its key; raises InvalidInput.

    A speed of a point is that of the leg to it; without one the route's counts.
    """
    who = f"route {key!r}"
    speed = route.value("extensions", "planned_speed")
    speed_kn = None if speed is None else number_of(who, "planned_speed", speed)
    points: list[Waypoint] = []
    for number, point in enumerate(route.each("rtept"), 1):
        where = f"point {number}"
        own = _extended(point, "planned_speed")
        own_kn = 0.0 if own is None else number_of(who, f"{where}, planned_speed", own)
        lon, lat = _place(f"{who}, {where}", point)
        etd = _utc(who, f"{where}, etd", _extended(point, "etd") or _of_trip(point, "DepartureTime"))
        waypoint = Waypoint(where, lon, lat, speed_kn=own_kn if own_kn > 0.0 else speed_kn, departure_us=etd)
        waypoint.arrival_us = _utc(who, f"{where}, ArrivalTime", _of_trip(point, "ArrivalTime"))
        if (stay := _of_trip(point, "StopDuration")) is not None:
            waypoint.stay_us = duration_us(who, f"{where}, StopDuration", stay)
        points.append(waypoint)
    if _has_times(root, route):
        times_us = [_utc(who, f"point {i}, time", one.value("time")) for i, one in enumerate(route.each("rtept"), 1)]
        _check_rising(who, times_us)
        for waypoint, at_us in zip(points, times_us, strict=True):
            waypoint.arrival_us = at_us
    elif points and points[0].departure_us is None:
        points[0].departure_us = time_of(who, "planned_departure", _departure(route))
    return Route(key, points)


def _check_rising(who: str, times_us: Sequence[int | None]) -> None:
    """Raise InvalidInput unless all points have a time, each later than the one before."""
    for number, (before, at) in enumerate(pairwise([None, *times_us]), 1):
        if at is None or (before is not None and at <= before):
            fault = "has no time" if at is None else "must be later than that of the point before"
            rule = f"{fault}: the times of points are those of the route if all have one and they rise"
            raise InvalidInput(who, f"point {number}, time", f"{rule}; else leave them out, and give --departure")
