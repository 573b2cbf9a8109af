"""Read route plans of S-421 (IEC 63173-1), in GML.

A file holds one route, which becomes one track. Features refer to each other by id. Cross-track limits are metres,
speeds knots; a leg belongs to the waypoint to which it leads. Names begin with upper or lower case, by version.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from conflictdb.errors import InvalidInput
from conflictdb.exchange.gml import Geometries
from conflictdb.formats.areas_of_files import Gathered
from conflictdb.formats.contents import Contents, Remark
from conflictdb.formats.routes import A_POINT, Route, Waypoint, agreed, agreed_speed, limit_m
from conflictdb.formats.standards import Standard
from conflictdb.formats.values_of_xml import number_of, time_of
from conflictdb.formats.xml_text import Element

_ELEMENT, _LEG = "routeScheduleElement", "routeWaypointLeg"
STANDARD: Final = Standard(
    "S-421",
    read={
        f"{_ELEMENT}ETA {_ELEMENT}ETD": "times",
        " ".join(f"{_ELEMENT}{one}Window{side}" for one in ("ETA", "ETD") for side in ("Before", "After")): "windows",
        f"{_ELEMENT}PlanSOG": "speeds of legs",
        f"{_LEG}PortXTDL {_LEG}StarboardXTDL routeWaypointTurnRadius": "tolerances",
    },
    unread={
        f"{_ELEMENT}Stay {_ELEMENT}SpeedWindow {_ELEMENT}PlanSTW": "stays, and speeds through the water",
        f"{_LEG}SpeedMin {_LEG}SpeedMax": "limits of the ship on a leg",
        " ".join(
            f"{_LEG}{one}"
            for one in ("DraughtForward", "DraughtAft", "StaticUKC", "DynamicUKC", "Masthead", "SafetyContour")
        ): "depths and heights",
        f"{_LEG}SafetyDepth routeWaypointActionPointRadius": "depths and reminders",
        "routeInfoValidityPeriodStart routeInfoValidityPeriodStop": "when the route may be used",
        "routeInfoVesselSpeedMin routeInfoVesselSpeedMax": "limits of the ship",
    },
    aside={"boundedBy": "box of the file", "DataSetIdentificationInformation": "when the file was made"},
)
_NAMESPACE: Final = "http://www.iho.int/S421/"
_GEOMETRY: Final = {"1": False, "loxodrome": False, "2": True, "orthodrome": True}
# The standard allows up to 10 km.
_MOST_XTD_M: Final = 10_000.0
_MOST_MINUTES: Final = 366.0 * 1440.0
_INFO: Final = "routeInfo"


def is_s421(root: Element) -> bool:
    """Return whether an XML document is a route plan of S-421."""
    return root.name.lower() == "dataset" and root.namespace.startswith(_NAMESPACE)


def read_s421(
    root: Element, source: str, *, stem: str, max_speed_kn: float, layers: Sequence[str], skip_invalid: bool
) -> Contents:
    """Return the track of a route plan; raises InvalidInput.

    layers : the name or id of the schedule to read, if the route has several
    """
    found = Gathered(source)
    features = {
        feature.attributes["id"]: feature
        for member in _members(root)
        for feature in member.children
        if "id" in feature.attributes
    }
    info = next(_named(features.values(), _INFO), None)
    name = (None if info is None else info.value("routeInfoName")) or stem
    who = f"route {name!r}"
    with found.refusals:
        points = _waypoints(who, features, found)
        _schedule(who, features, points, layers)
        properties = (
            {}
            if info is None
            else {one.name: one.text for one in info.children if one.text and one.name != "routeInfoName"}
        )
        found.add_route(name, who, Route(name, list(points.values()), dict(properties)), max_speed_kn)
    contents = found.contents(skip_invalid=skip_invalid)
    contents.remarks = [Remark(source, "file", A_POINT)] if contents.tracks else []
    contents.derived = [track.key for track in contents.tracks]
    return contents


def _members(root: Element) -> Iterator[Element]:
    """Yield the elements that hold features: one for each, or one for all."""
    for child in root.children:
        if child.name in ("member", "imember", "members"):
            yield child


def _named(features: Iterable[Element], name: str) -> Iterator[Element]:
    """Yield the features of a type, whose name may begin with upper or lower case."""
    return (one for one in features if one.name.lower() == name.lower())


def _referred(who: str, features: Mapping[str, Element], element: Element, name: str) -> Iterator[Element]:
    """Yield the features to which the children of a name refer."""
    for child in element.children:
        if child.name.lower() != name.lower():
            continue
        href = child.attributes.get("href")
        if href is None:
            continue
        feature = features.get(href.removeprefix("#"))
        if feature is None:
            raise InvalidInput(who, f"{child.name} in line {child.line}", f"refers to {href:.60}, which is missing")
        yield feature


def _waypoints(who: str, features: Mapping[str, Element], found: Gathered) -> dict[str, Waypoint]:
    """Return the waypoints by id, in the order of the collection."""
    every = next(_named(features.values(), "routeWaypoints"), None)
    if every is None:
        raise InvalidInput(who, "routeWaypoints", "are missing")
    points: dict[str, Waypoint] = {}
    for element in _referred(who, features, every, "routeWaypoint"):
        number = element.value("routeWaypointID")
        if number is None or number in points:
            rule = "has no routeWaypointID" if number is None else f"has the id {number}, as an earlier one"
            raise InvalidInput(who, f"{element.name} in line {element.line}", rule)
        place = next(element.all("Point"), None)
        if place is None:
            raise InvalidInput(who, f"waypoint {number}", "has no Point")
        # Latitude comes first in all of S-100.
        lon, lat = Geometries(who, found, {}, latitude_first=True).point(place)
        points[number] = Waypoint(f"waypoint {number}", lon, lat)
        radius = element.value("routeWaypointTurnRadius")
        if radius is not None:
            where = f"waypoint {number}, routeWaypointTurnRadius"
            points[number].radius_m = limit_m(who, where, number_of(who, where, radius))
        leg = next(_referred(who, features, element, "routeWaypointLeg"), None)
        if leg is not None:
            _leg(who, points[number], leg)
    return points


def _leg(who: str, point: Waypoint, leg: Element) -> None:
    kind = (leg.value("routeWaypointLegGeometryType") or "1").lower()
    if kind not in _GEOMETRY:
        where = f"{point.name}, routeWaypointLegGeometryType"
        raise InvalidInput(who, where, f"must be loxodrome (1) or orthodrome (2); got {kind!r:.40}")
    point.is_orthodrome = _GEOMETRY[kind]
    for side in ("port", "starboard"):
        name = f"routeWaypointLeg{side.capitalize()}XTDL"
        text = leg.value(name)
        if text is None:
            continue
        limit = number_of(who, f"{point.name}, {name}", text)
        if not 0.0 <= limit <= _MOST_XTD_M:
            raise InvalidInput(who, f"{point.name}, {name}", f"must be metres, 0 to {_MOST_XTD_M:g}; got {limit:g}")
        setattr(point, f"{side}_m", limit)


def _schedule(who: str, features: Mapping[str, Element], points: Mapping[str, Waypoint], layers: Sequence[str]) -> None:
    """Give waypoints the times and speeds of the schedule: manual and calculated, not those that ports recommend."""
    schedules = list(_named(features.values(), "routeSchedule"))
    names = ", ".join(repr(one.value("routeScheduleName") or one.value("routeScheduleID")) for one in schedules)
    if layers:
        schedules = [
            one for one in schedules if {one.value("routeScheduleName"), one.value("routeScheduleID")} & set(layers)
        ]
        if not schedules:
            raise InvalidInput(who, "layer", f"there is no schedule {layers[0]!r:.60}; the file has {names}")
    if len(schedules) > 1:
        raise InvalidInput(who, "routeSchedule", f"has several: select one with --layer; the file has {names}")
    calls: dict[str, list[Element]] = {}
    for schedule in schedules:
        for part in ("routeScheduleCalculated", "routeScheduleManual"):
            for one in _referred(who, features, schedule, part):
                for element in _referred(who, features, one, "routeScheduleElement"):
                    number = element.value("routeWaypointId") or ""
                    if number not in points:
                        where = f"{element.name} in line {element.line}"
                        raise InvalidInput(who, where, f"has the routeWaypointId {number!r:.40}, which no waypoint has")
                    calls.setdefault(number, []).append(element)
    for number, elements in calls.items():
        _call(who, points[number], elements)


def _call(who: str, point: Waypoint, elements: Sequence[Element]) -> None:
    def times(name: str) -> int | None:
        where = f"{point.name}, {name}"
        return agreed(who, where, *(time_of(who, where, one.value(f"routeScheduleElement{name}")) for one in elements))

    point.arrival_us, point.departure_us = times("ETA"), times("ETD")
    where = f"{point.name}, PlanSOG"
    texts = (one.value("routeScheduleElementPlanSOG") for one in elements)
    speeds = [number_of(who, where, text) for text in texts if text is not None]
    point.speed_kn = agreed_speed(who, where, speeds, point.arrival_us)
    for element in elements:
        for name in ("ETDWindow", "ETAWindow"):
            for side, member in (("Before", "early_us"), ("After", "late_us")):
                text = element.value(f"routeScheduleElement{name}{side}")
                if text is not None:
                    minutes = number_of(who, f"{point.name}, {name}{side}", text)
                    if not 0.0 <= minutes <= _MOST_MINUTES:
                        rule = f"must be 0 to {_MOST_MINUTES:,.0f} minutes; got {minutes:g}"
                        raise InvalidInput(who, f"{point.name}, {name}{side}", rule)
                    setattr(point, member, max(getattr(point, member), round(60e6 * minutes)))
