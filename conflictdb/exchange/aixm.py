"""Read airspaces and their activations: AIXM 5.1 and 5.1.1, and Digital NOTAM.

Each BASELINE, SNAPSHOT, PERMDELTA and TEMPDELTA of an airspace becomes a zone for its time; a delta without a geometry
has that of the latest baseline or PERMDELTA of the same file that is valid then. A baseline stays active while a
TEMPDELTA changes it: more may be reported, nothing is missed.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from math import inf
from typing import Any, Final

from conflictdb.errors import InvalidInput
from conflictdb.exchange.gml import Geometries
from conflictdb.exchange.timesheets import schedule_of_sheets
from conflictdb.formats.areas_of_files import Active, Gathered, Volume, Zone
from conflictdb.formats.contents import Contents, Skipped
from conflictdb.formats.file_heights import height_m
from conflictdb.formats.standards import Standard
from conflictdb.formats.values_of_xml import number_of, time_of
from conflictdb.formats.xml_text import Element

STANDARD: Final = Standard(
    "AIXM",
    read={
        "beginPosition endPosition timePosition": "valid time",
        "lowerLimit lowerLimitReference upperLimit upperLimitReference": "heights",
        "radius startAngle endAngle": "arcs and circles",
        "startTime endTime startDate endDate day dayTil startEvent endEvent timeReference": "schedule",
        "startTimeRelativeEvent endTimeRelativeEvent": "schedule",
        "daylightSavingAdjust excluded": "refused if they are YES",
    },
    unread={
        "maximumLimit maximumLimitReference minimumLimit minimumLimitReference": "bounds of limits above the ground",
        "levels": "heights of an activation: all heights of the volume count",
        "width": "of a corridor",
    },
    aside={"featureLifetime": "since when the record exists", "annotation": "notes"},
    within=("Airspace",),
)
_NAMESPACES: Final = ("http://www.aixm.aero/schema/5.1/message", "http://www.aixm.aero/schema/5.1.1/message")
_WHOLE: Final = ("BASELINE", "SNAPSHOT")
_DELTAS: Final = ("PERMDELTA", "TEMPDELTA")
_ACTIVE: Final = frozenset({"ACTIVE", "IN_USE", "INTERMITTENT", "LIMITED", "AVBL_FOR_ACTIVATION"})
_NOT_ACTIVE: Final = frozenset({"INACTIVE"})
_MOST_STATES: Final = 1_000
_NO_LIMIT: Final = {True: ("GND", "SFC", "FLOOR"), False: ("UNL", "CEILING")}


@dataclass(slots=True)
class _Airspace:
    """The time slices of one airspace."""

    key: str
    where: str
    slices: list[Element] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _AirspaceState:
    """A baseline or permanent change: the properties that it gives, and when it is valid, microseconds since 1970.

    error : why its valid time is not understood
    """

    slice: Element
    names: Set[str]
    start: float
    end: float
    error: InvalidInput | None = None


def is_aixm(root: Element) -> bool:
    """Return whether an XML document is a message of AIXM 5.1."""
    return root.name == "AIXMBasicMessage" and root.namespace in _NAMESPACES


def read_aixm(
    root: Element, source: str, *, stem: str, max_speed_kn: float, layers: Sequence[str], skip_invalid: bool
) -> Contents:
    """Return the areas of airspaces; raises InvalidInput with all errors."""
    del stem, max_speed_kn
    if layers:
        raise InvalidInput("file", "layer", "has no layers: files that OGR opens may have some")
    found = Gathered(source)
    skipped: list[Skipped] = []
    others: Counter[str] = Counter()
    points = {one.attributes["id"]: one for one in root.all("Point", "ElevatedPoint") if "id" in one.attributes}
    for airspace in _airspaces(root, others):
        if not airspace.slices:
            reason = "has no AirspaceTimeSlice: no area"
            skipped.append(Skipped(source, f"zone {airspace.key!r}", reason, (), is_whole=False))
        seen: Counter[str] = Counter()
        current = list(_current(airspace.slices))
        states = _states(current)
        for slice_ in current:
            kind = _interpretation(slice_)
            seen[kind] += 1
            key = airspace.key if kind in _WHOLE else f"{airspace.key}/{kind}"
            key = key if seen[kind] == 1 else f"{key}-{seen[kind]}"
            with found.refusals:
                zone = _zone(f"zone {key!r}", key, slice_, states, found, points)
                if zone is None:
                    skipped.append(Skipped(source, f"zone {key!r}", "is never active", (), is_whole=False))
                else:
                    found.add_zone(f"{slice_.name} in line {slice_.line}", zone)
    for name, count in others.items():
        skipped.append(Skipped(source, "file", f"{count} features are {name}s, no airspaces", (), is_whole=False))
    contents = found.contents(skip_invalid=skip_invalid)
    contents.skipped.extend(skipped)
    return contents


def _airspaces(root: Element, others: Counter[str]) -> Iterator[_Airspace]:
    """Yield the airspaces of a message; counts all other features."""
    known: dict[str, _Airspace] = {}
    names: Counter[str] = Counter()
    for member in root.each("hasMember"):
        for feature in member.children:
            if feature.name != "Airspace":
                others[feature.name] += 1
                continue
            slices = [one for outer in feature.each("timeSlice") for one in outer.each("AirspaceTimeSlice")]
            identity = feature.value("identifier") or (feature.get("id") or "").removeprefix("uuid.")
            if identity not in known:
                named = [one.value("designator") or one.value("name") for one in slices]
                key = next(filter(None, named), None) or identity
                names[key] += 1
                key = key if names[key] == 1 else f"{key} {identity}"
                known[identity] = _Airspace(key, f"Airspace in line {feature.line}")
            known[identity].slices += slices
    yield from known.values()


def _interpretation(slice_: Element) -> str:
    return slice_.value("interpretation") or "none"


def _current(slices: Sequence[Element]) -> Iterator[Element]:
    """Yield time slices without those that a correction replaces."""
    latest: dict[tuple[str, str], tuple[int, int]] = {}
    for i, one in enumerate(slices):
        of = _interpretation(one), one.value("sequenceNumber") or f"unnumbered {i}"
        correction = one.value("correctionNumber") or "0"
        number = int(correction) if correction.isascii() and correction.isdigit() and len(correction) < 10 else 0
        latest[of] = max(latest.get(of, (-1, -1)), (number, i))
    kept = {i for _, i in latest.values()}
    return (one for i, one in enumerate(slices) if i in kept)


def _components(slice_: Element) -> list[Element]:
    """Return the volumes of a time slice."""
    return [one for outer in slice_.each("geometryComponent") for one in outer.each("AirspaceGeometryComponent")]


def _zone(
    who: str,
    key: str,
    slice_: Element,
    states: Sequence[_AirspaceState],
    found: Gathered,
    points: Mapping[str, Element],
) -> Zone | None:
    """Return the zone of a time slice, None if it is never active.

    states : of the airspace
    points : of the message, by their ids
    """
    kind = _interpretation(slice_)
    if kind not in (*_WHOLE, *_DELTAS):
        rule = f"must be one of {', '.join((*_WHOLE, *_DELTAS))}; got {kind!r:.40}"
        raise InvalidInput(who, "interpretation", rule)
    span = _span(who, slice_)
    shapes = [slice_] if _components(slice_) else _valid(who, slice_, states, "geometryComponent")
    if not shapes:
        rule = "is missing: the file has no baseline of this airspace that is valid then; add it to the file"
        raise InvalidInput(who, "geometryComponent", rule)
    volumes, *others = [[_volume(who, one, found, points) for one in _components(shape)] for shape in shapes]
    if any(not _is_same(volumes, other) for other in others):
        known = ", ".join(f"line {shape.line}" for shape in shapes)
        rule = f"is missing, and several shapes of this airspace are valid then ({known}): add its own one"
        raise InvalidInput(who, "geometryComponent", rule)
    given = slice_
    if kind in _DELTAS and next(slice_.each("activation"), None) is None:
        # Of several, each may be active at another time: then it is active all the time.
        activations = _valid(who, slice_, states, "activation")
        given = activations[0] if len(activations) == 1 else slice_
    active = _active(who, given, span)
    if active is None:
        return None
    properties: dict[str, Any] = {}
    for name in ("type", "class", "localType", "controlType", "designator"):
        value = _value(who, slice_, states, name)
        if value is not None:
            properties[f"airspace_{name}"] = value
    named = _value(who, slice_, states, "name")
    return Zone(key, volumes, named, active, {"interpretation": kind, **properties}, properties.get("airspace_type"))


def _states(slices: Sequence[Element]) -> list[_AirspaceState]:
    """Return the baselines and permanent changes of an airspace."""
    states: list[_AirspaceState] = []
    for one in slices:
        if _interpretation(one) in (*_WHOLE, "PERMDELTA"):
            names = {child.name for child in one.children}
            names -= set() if _components(one) else {"geometryComponent"}
            try:
                start_us, end_us = _span("", one)
            except InvalidInput as error:
                states.append(_AirspaceState(one, names, -inf, inf, error))
            else:
                start, end = -inf if start_us is None else start_us, inf if end_us is None else end_us
                states.append(_AirspaceState(one, names, start, end))
    return states


def _valid(who: str, slice_: Element, states: Sequence[_AirspaceState], name: str) -> list[Element]:
    """Return the baselines and permanent changes with a property that are valid at the beginning of a time slice.

    Of several the latest counts; those are added that begin as late, or while a temporary change is valid.
    """
    if len(states) > _MOST_STATES:
        rule = f"are more than {_MOST_STATES:,} of one airspace: leave out those of other times"
        raise InvalidInput(who, "baselines and permanent changes", rule)
    start_us, end_us = _span(who, slice_)
    start, end = -inf if start_us is None else start_us, inf if end_us is None else end_us
    others = [one for one in states if one.slice is not slice_ and name in one.names]
    for one in others:
        if one.error is not None:
            raise InvalidInput(who, f"{one.error.field} of the slice in line {one.slice.line}", one.error.rule)
    before = [one for one in others if one.start <= start < one.end]
    latest = max((one.start for one in before), default=-inf)
    later = (one for one in others if start < one.start < end and _interpretation(slice_) == "TEMPDELTA")
    return [one.slice for one in (*(one for one in before if one.start == latest), *later)]


def _value(who: str, slice_: Element, states: Sequence[_AirspaceState], name: str) -> str | None:
    """Return a property of a time slice, or else the valid one of its airspace."""
    value = slice_.value(name)
    if value is None and _interpretation(slice_) in _DELTAS:
        value = next((one.value(name) for one in _valid(who, slice_, states, name)), None)
    return value


def _is_same(one: Sequence[Volume], other: Sequence[Volume]) -> bool:
    return len(one) == len(other) and all(
        bool(a.footprint.equals(b.footprint)) and (a.floor_m, a.ceiling_m) == (b.floor_m, b.ceiling_m)
        for a, b in zip(one, other, strict=True)
    )


def _span(who: str, slice_: Element) -> tuple[int | None, int | None]:
    """Return the valid time of a time slice, microseconds since 1970; None is unbounded."""
    period = slice_.child("validTime", "TimePeriod")
    if period is None:
        instant = slice_.child("validTime", "TimeInstant", "timePosition")
        if instant is None or _interpretation(slice_) != "SNAPSHOT":
            raise InvalidInput(who, "validTime", "is missing: it must be a TimePeriod")
        return None, None
    ends = []
    for name in ("beginPosition", "endPosition"):
        position = period.child(name)
        text = None if position is None else position.text or None
        if text is None and (position is None or position.get("indeterminatePosition") is None):
            raise InvalidInput(who, f"validTime, {name}", "must be a time, or indeterminate")
        ends.append(time_of(who, f"validTime, {name}", text, is_end=name == "endPosition"))
    return ends[0], ends[1]


def _active(who: str, slice_: Element, span: tuple[int | None, int | None]) -> list[Active] | None:
    """Return when an airspace is active within a span, None if never."""
    activations = [one for outer in slice_.each("activation") for one in outer.each("AirspaceActivation")]
    if not activations:
        return [Active(*span)]
    active: list[Active] = []
    for one in activations:
        status = one.value("status")
        if status in _NOT_ACTIVE:
            continue
        if status not in _ACTIVE:
            raise InvalidInput(who, f"status in line {one.line}", f"is not understood: {status!r:.40}")
        sheets = [sheet for outer in one.each("timeInterval") for sheet in outer.each("Timesheet")]
        active += [Active(*span, schedule) for schedule in schedule_of_sheets(who, sheets, span)] or [Active(*span)]
    return active or None


def _volume(who: str, component: Element, found: Gathered, points: Mapping[str, Element]) -> Volume:
    operation = component.value("operation") or "BASE"
    if operation not in ("BASE", "UNION"):
        rule = f"is {operation:.40}: only BASE and UNION are read, each as an area"
        raise InvalidInput(who, f"operation in line {component.line}", rule)
    volume = component.child("theAirspaceVolume", "AirspaceVolume")
    if volume is None:
        raise InvalidInput(who, f"{component.name} in line {component.line}", "has no AirspaceVolume")
    projection = volume.child("horizontalProjection")
    surface = None if projection is None or not projection.children else projection.children[0]
    if surface is None:
        elsewhere = volume.child("contributorAirspace") is not None
        rule = "is that of another airspace, which is not read here" if elsewhere else "is missing"
        raise InvalidInput(who, f"horizontalProjection in line {volume.line}", rule)
    footprint = Geometries(who, found, points).surfaces(surface)
    return Volume(footprint, _limit(who, volume, is_floor=True), _limit(who, volume, is_floor=False))


def _limit(who: str, volume: Element, *, is_floor: bool) -> float | None:
    """Return a vertical limit, metres above mean sea level; None is unbounded."""
    name = "lowerLimit" if is_floor else "upperLimit"
    limit = volume.child(name)
    if limit is None or not limit.text:
        return None
    if limit.text.upper() in _NO_LIMIT[is_floor]:
        return None
    where = f"{name} in line {limit.line}"
    unit = limit.get("uom")
    reference = volume.value(f"{name}Reference") or ("STD" if unit == "FL" else None)
    if unit is None or reference is None:
        raise InvalidInput(who, where, f"needs a unit and a reference; got {unit!r:.20} and {reference!r:.20}")
    return height_m(who, where, number_of(who, where, limit.text), unit, reference, is_floor=is_floor)
