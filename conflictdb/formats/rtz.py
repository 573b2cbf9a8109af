"""Read routes of ECDIS: RTZ 1.0, 1.1 and 1.2 (IEC 61174, annex S).

A file holds one route, which becomes one track. A leg belongs to the waypoint to which it leads. Attributes that a leg
does not have are those of the default waypoint; without one it is a loxodrome. Cross-track limits and turn radii are
nautical miles, speeds knots.
"""

from collections.abc import Iterator, Sequence
from typing import Any, Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.areas_of_files import Gathered
from conflictdb.formats.contents import Contents, Remark
from conflictdb.formats.fields import Fields
from conflictdb.formats.file_objects import DATUM, FileContext, track_members
from conflictdb.formats.json_text import parse
from conflictdb.formats.names import look_alike
from conflictdb.formats.routes import A_POINT, Route, Waypoint, agreed, agreed_speed, limit_m
from conflictdb.formats.rtz_writing import EXTENSION
from conflictdb.formats.standards import Standard
from conflictdb.formats.values_of_xml import duration_us, number_of, time_of
from conflictdb.formats.xml_text import Element
from conflictdb.model.plans import Scene

STANDARD: Final = Standard(
    "RTZ",
    read={
        "eta etd stay": "times",
        "etaWindowBefore etaWindowAfter etdWindowBefore etdWindowAfter": "windows of departure and arrival",
        "speed": "speeds of legs",
        "speedWindow": "bounds of speeds",
        "portsideXTD starboardXTD radius": "tolerances",
    },
    unread={
        "speedMin speedMax": "limits of the ship on a leg",
        "draughtForward draughtAft staticUKC dynamicUKC masthead safetyContour safetyDepth": "depths and heights",
        "validityPeriodStart validityPeriodStop": "when the route may be used",
        "vesselSpeedMax vesselSpeedMin vesselServiceMax vesselServiceMin": "limits of the ship",
        "vesselMaxRoll vesselMaxWave vesselMaxWind": "limits of the weather",
        "actionPoint/radius timeToAct minutesToAct": "reminders",
    },
    aside={
        "windSpeed windDirection currentSpeed currentDirection windLoss waveLoss": "weather",
        "extension": "of other programs",
    },
)
VERSIONS: Final = ("1.0", "1.1", "1.2")
# The second one is of the reference routes of the Norwegian Coastal Administration.
_NAMESPACES: Final = ("http://www.cirm.org/RTZ/", "https://cirm.org/rtz-xml-schemas")
_GEOMETRY: Final = {"Loxodrome": False, "Orthodrome": True}
# The schema of version 1.0 misspells it.
_ELEMENTS: Final = ("scheduleElement", "sheduleElement")

# Attributes of a scheduleElement, and others that resemble them.
_READ: Final = (
    *("waypointId", "eta", "etd", "stay", "speed", "speedWindow"),
    *(f"{name}Window{side}" for name in ("eta", "etd") for side in ("Before", "After")),
)
_UNREAD: Final = ("windSpeed", "windDirection", "currentSpeed", "currentDirection")


def is_rtz(root: Element) -> bool:
    """Return whether an XML document is an RTZ route, of any version."""
    return root.name == "route" and root.namespace.startswith(_NAMESPACES)


def read_rtz(
    root: Element, source: str, *, stem: str, max_speed_kn: float, layers: Sequence[str] = (), skip_invalid: bool
) -> Contents:
    """Return the track of a route; raises InvalidInput.

    layers : the name or id of the schedule to read, if the route has several
    """
    found = Gathered(source)
    remarks: list[Remark] = []
    members: dict[str, Any] = {}
    info = root.child("routeInfo")
    name = (info.get("routeName") if info is not None else None) or stem
    who = f"route {name!r}"
    with found.refusals:
        version = root.get("version")
        if version not in VERSIONS:
            raise InvalidInput(who, "version", f"must be one of {', '.join(VERSIONS)}; got {version!r:.40}")
        members = _members(who, root)
        points = dict(_waypoints(who, root, reads_limits=not members))
        _schedule(who, root, points, layers)
        properties = {} if info is None else {key: one for key, one in info.attributes.items() if key != "routeName"}
        route = Route(name, list(points.values()), dict(properties), members)
        found.add_route(name, who, route, max_speed_kn)
        remarks = [] if members else [Remark(source, "file", A_POINT)]
    contents = found.contents(skip_invalid=skip_invalid)
    contents.remarks = remarks
    contents.derived = [] if members else [track.key for track in contents.tracks]
    return contents


def _members(who: str, root: Element) -> dict[str, Any]:
    """Return the members of a track that `rtz_writing` wrote; an empty dictionary for other routes."""
    for outer in root.each("extensions"):
        for extension in outer.each("extension"):
            if {name: extension.get(name) for name in EXTENSION} == EXTENSION:
                value = parse(extension.attributes.get("track", ""))
                if not isinstance(value, dict):
                    raise InvalidInput(who, f"extension in line {extension.line}", "must be an object of members")
                stated = {DATUM: extension.get(DATUM)} if extension.get(DATUM) and DATUM not in value else {}
                fields = Fields(who, value | stated)
                members = track_members(fields, FileContext(Scene("file")))
                fields.raise_found()
                properties = {name: one for name, one in members["properties"].items() if name not in stated}
                return members | {"properties": properties}
    return {}


def _waypoints(who: str, root: Element, *, reads_limits: bool) -> Iterator[tuple[str, Waypoint]]:
    """Yield the waypoints by id, in their order.

    reads_limits : cross-track limits that `rtz_writing` wrote are the haven, which the members have
    """
    every = root.child("waypoints")
    if every is None:
        raise InvalidInput(who, "waypoints", "are missing")
    default = every.child("defaultWaypoint", "leg")
    usual = every.child("defaultWaypoint")
    radius = None if usual is None else usual.get("radius")
    ids: set[str] = set()
    for element in every.each("waypoint"):
        number = element.get("id")
        if number is None or number in ids:
            rule = "has no id" if number is None else f"has the id {number}, as an earlier one"
            raise InvalidInput(who, f"waypoint in line {element.line}", rule)
        ids.add(number)
        where = f"waypoint {number}"
        position = element.child("position")
        if position is None:
            raise InvalidInput(who, where, "has no position")
        lon, lat = (number_of(who, f"{where}, {one}", position.get(one)) for one in ("lon", "lat"))
        point = Waypoint(where, lon, lat)
        turn = element.get("radius") or radius
        if turn is not None:
            point.radius_m = limit_m(who, f"{where}, radius", number_of(who, f"{where}, radius", turn))
        if len(ids) > 1:
            _leg(who, point, element.child("leg"), default, reads_limits=reads_limits)
        yield number, point


def _leg(who: str, point: Waypoint, own: Element | None, default: Element | None, *, reads_limits: bool) -> None:
    given = {**(default.attributes if default is not None else {}), **(own.attributes if own is not None else {})}
    kind = given.get("geometryType", "Loxodrome")
    if kind not in _GEOMETRY:
        rule = f"must be one of {', '.join(_GEOMETRY)}; got {kind!r:.40}"
        raise InvalidInput(who, f"{point.name}, geometryType", rule)
    point.is_orthodrome = _GEOMETRY[kind]
    if not reads_limits:
        return
    sides = ("portsideXTD", "starboardXTD")
    for name in given:
        if "xtd" in name.lower() and name not in sides:
            raise InvalidInput(
                who, f"{point.name}, {name}", f"is not known: cross-track limits are {' and '.join(sides)}"
            )
    limits = {}
    for side in sides:
        where = f"{point.name}, {side}"
        limits[side] = limit_m(who, where, number_of(who, where, given[side])) if side in given else None
    point.port_m, point.starboard_m = limits["portsideXTD"], limits["starboardXTD"]


def _schedule(who: str, root: Element, points: dict[str, Waypoint], layers: Sequence[str]) -> None:
    every = root.child("schedules")
    schedules = [] if every is None else list(every.each("schedule"))
    if layers:
        chosen = [one for one in schedules if {one.get("id"), one.get("name")} & set(layers)]
        if not chosen:
            raise InvalidInput(who, "layer", f"there is no schedule {layers[0]!r:.60}; {_named(schedules)}")
        schedules = chosen
    if len(schedules) > 1:
        raise InvalidInput(who, "schedules", f"has several: select one with --layer; {_named(schedules)}")
    for schedule in schedules:
        parts = {
            part: {one.get("waypointId"): one for name in _ELEMENTS for one in found.each(name)}
            for part in ("calculated", "manual")
            if (found := schedule.child(part)) is not None
        }
        for number in dict.fromkeys(number for part in parts.values() for number in part):
            if number not in points:
                raise InvalidInput(who, "scheduleElement", f"has the waypointId {number!r:.40}, which no waypoint has")
            _call(who, points[number], [part[number] for part in parts.values() if number in part])


def _named(schedules: Sequence[Element]) -> str:
    return "the file has " + ", ".join(repr(one.get("name") or one.get("id")) for one in schedules)


def _check_names(who: str, where: str, element: Element) -> None:
    """Refuse an attribute of a schedule that resembles one that is read."""
    for name in element.attributes:
        meant = look_alike(name, _READ)
        if name not in (*_READ, *_UNREAD) and meant is not None:
            raise InvalidInput(who, f"{where}, {name}", f"is not known to RTZ; did you mean {meant}?")


def _call(who: str, point: Waypoint, elements: Sequence[Element]) -> None:
    """Give a waypoint what the calculated and the manual schedule say of it."""
    where = point.name

    def times(name: str) -> int | None:
        return agreed(who, f"{where}, {name}", *(time_of(who, f"{where}, {name}", one.get(name)) for one in elements))

    def given(name: str) -> list[str]:
        return [text for one in elements if (text := one.get(name)) is not None]

    point.arrival_us, point.departure_us = times("eta"), times("etd")
    point.stay_us = agreed(who, f"{where}, stay", *(duration_us(who, f"{where}, stay", one) for one in given("stay")))
    speeds = [number_of(who, f"{where}, speed", one) for one in given("speed")]
    point.speed_kn = agreed_speed(who, f"{where}, speed", speeds, point.arrival_us)
    for element in elements:
        _check_names(who, where, element)
        for name in ("etdWindow", "etaWindow"):
            early, late = (element.get(f"{name}{side}") for side in ("Before", "After"))
            if early is not None:
                point.early_us = max(point.early_us, duration_us(who, f"{where}, {name}Before", early))
            if late is not None:
                point.late_us = max(point.late_us, duration_us(who, f"{where}, {name}After", late))
        window = element.get("speedWindow")
        if window is not None:
            point.speed_window_kn = abs(number_of(who, f"{where}, speedWindow", window))
