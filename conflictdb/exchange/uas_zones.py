"""Read UAS geographical zones: ED-269 (JSON) and ED-318 (GeoJSON), as national feeds publish them.

EUROCAE ED-269 (2020) and ED-318 (2023). Each volume of a zone becomes an area. Members of volumes and of times that the
standards do not know refuse the zone; other members are kept as properties.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import shapely

from conflictdb.errors import InvalidInput
from conflictdb.formats.areas_of_files import Active, Gathered, Volume, Zone
from conflictdb.formats.contents import Contents
from conflictdb.formats.fields import Fields, finite, instant
from conflictdb.formats.file_heights import height_m
from conflictdb.formats.file_objects import read_aside
from conflictdb.formats.geometry import AREA_TYPES, multipolygon, point
from conflictdb.formats.names import look_alike
from conflictdb.formats.standards import Standard

_PERIODS: Final = "startDateTime endDateTime permanent schedule dailyPeriod day startTime endTime startEvent endEvent"
ED269: Final = Standard(
    "ED-269",
    read={
        "lowerLimit upperLimit lowerVerticalReference upperVerticalReference uomDimensions": "heights",
        "radius": "circles",
        _PERIODS: "times and schedule",
    },
    unread={"intervalBefore": "how long before one must ask", "validFrom validTo": "when the list is valid"},
    aside={"creationDateTime updateDateTime": "when the record was made"},
)
ED318: Final = Standard(
    "ED-318",
    read={
        "lower upper lowerReference upperReference uom": "heights",
        "radius": "circles",
        _PERIODS: "times and schedule",
    },
    unread={"intervalBefore": "how long before one must ask", "validFrom validTo": "when the list is valid"},
    aside={
        "issued creationDateTime updateDateTime": "when the list or a record was made",
        "conflictdb": "of an export, read",
    },
)
_OF_ED318: Final = frozenset({"identifier", "country", "type", "variant"})
_OF_ED269: Final = frozenset({"identifier", "country", "restriction", "geometry"})
# A zone of ED-318 has at least one of these members.
_SIGNS_OF_ED318: Final = _OF_ED318 | {"limitedApplicability", "zoneAuthority"}
_FIRST: Final = 100  # zones that are looked at
_VOLUME: Final = frozenset(
    {
        *("uomDimensions", "lowerLimit", "lowerVerticalReference", "upperLimit", "upperVerticalReference"),
        "horizontalProjection",
    }
)
# Codes of zones: classes that rules may name.
CODES: Final = frozenset(
    {"PROHIBITED", "REQ_AUTHORIZATION", "REQ_AUTHORISATION", "CONDITIONAL", "NO_RESTRICTION", "USPACE"}
)
# The member of `extendedProperties` that `uas_zones_writing` writes, and how long a name the standard allows.
EXTENSION: Final = "conflictdb"
LONGEST_NAME: Final = 200
_LAYER: Final = frozenset({"upper", "upperReference", "lower", "lowerReference", "uom"})
_WHEN: Final = frozenset({"applicability", "limitedApplicability"})
_TIMES: Final = frozenset({"startDateTime", "endDateTime", "schedule", "dailyPeriod", "permanent"})
_NUMBER: Final = re.compile(r"\s*-?[0-9]+(\.[0-9]*)?\s*", re.ASCII)
_FEET: Final = {"M": 1.0, "m": 1.0, "FT": 0.3048, "ft": 0.3048}


def is_ed318(document: Any) -> bool:
    """Return whether a JSON document is a collection of zones of ED-318."""
    return any(map(_is_ed318, _first_of(document, "features"))) and "scene" not in document


def is_ed269(document: Any) -> bool:
    """Return whether a JSON document is a list of zones of ED-269."""
    return any(_is_ed269(one) for name in ("features", "UASZoneList") for one in _first_of(document, name))


def _first_of(document: Any, name: str) -> Iterator[Mapping[str, Any]]:
    """Yield the first objects of a list."""
    members = document.get(name) if isinstance(document, dict) else None
    if isinstance(members, list):
        yield from (one for one in members[:_FIRST] if isinstance(one, dict))


def _is_ed318(feature: Mapping[str, Any]) -> bool:
    properties, geometry = feature.get("properties"), feature.get("geometry")
    if not isinstance(properties, dict):
        return False
    has_volume = isinstance(geometry, dict) and not {"layer", "extent"}.isdisjoint(geometry)
    signs = properties.keys() & _SIGNS_OF_ED318
    return signs >= _OF_ED318 or (len(signs) >= 3 and (has_volume or not signs <= _OF_ED318))


def _is_ed269(zone: Mapping[str, Any]) -> bool:
    return isinstance(zone.get("geometry"), list) or len(zone.keys() & _OF_ED269) >= 3


def read_ed318(document: Any, source: str, *, stem: str, skip_invalid: bool) -> Contents:
    """Return the areas of a feed of ED-318; raises InvalidInput with all errors."""
    found = Gathered(source)
    for i, feature in enumerate(document["features"]):
        where = f"features[{i}]"
        with found.refusals:
            properties = _object(where, "properties", _object(where, "", feature).get("properties"))
            key = _identifier(where, properties)
            who = f"zone {key!r}"
            volumes = list(_layers(who, "geometry", feature.get("geometry"), found))
            active = _actives(who, "limitedApplicability", properties)
            rest = {name: one for name, one in properties.items() if name not in ("identifier", "name")}
            rest.pop("limitedApplicability", None)
            kind = _class(who, "type", rest)
            zone = Zone(key, volumes, _text(properties.get("name")), active, rest, kind)
            found.add_zone(where, _extended(who, zone, rest.get("extendedProperties")))
    return found.contents(skip_invalid=skip_invalid)


def read_ed269(document: Any, source: str, *, stem: str, skip_invalid: bool) -> Contents:
    """Return the areas of a feed of ED-269; raises InvalidInput with all errors."""
    found = Gathered(source)
    name = "features" if "features" in document else "UASZoneList"
    for i, zone in enumerate(document[name]):
        where = f"{name}[{i}]"
        with found.refusals:
            key = _identifier(where, _object(where, "", zone))
            who = f"zone {key!r}"
            volumes = [
                _projection(who, f"geometry[{k}]", _object(who, f"geometry[{k}]", one), found)
                for k, one in enumerate(_list(who, "geometry", zone.get("geometry")))
            ]
            active = _actives(who, "applicability", zone)
            rest = {one: zone[one] for one in zone if one not in ("identifier", "name", "geometry", "applicability")}
            kind = _class(who, "restriction", rest)
            found.add_zone(where, Zone(key, volumes, _text(zone.get("name")), active, rest, kind))
    return found.contents(skip_invalid=skip_invalid)


def _extended(who: str, zone: Zone, extended: Any) -> Zone:
    """Return a zone with what `uas_zones_writing` wrote among its extended properties; raises InvalidInput."""
    own = extended.get(EXTENSION) if isinstance(extended, dict) else None
    if own is None:
        return zone
    fields = Fields(who, _object(who, f"extendedProperties.{EXTENSION}", own))
    others = {name: one for name, one in extended.items() if name != EXTENSION}
    properties = {name: one for name, one in zone.properties.items() if name != "extendedProperties" or others}
    properties |= {"extendedProperties": others} if others else {}
    properties |= _object(who, f"extendedProperties.{EXTENSION}.properties", fields.get("properties") or {})
    more = read_aside(fields)
    if "class" in own:
        zone = replace(zone, object_class=more.pop("object_class", None))
    name, owner = more.pop("name", None) or zone.name, more.pop("owner", None)
    found = replace(zone, name=name, owner=owner, properties=properties, more=more)
    fields.raise_found()
    return found


def _identifier(where: str, zone: Mapping[str, Any]) -> str:
    key = zone.get("identifier")
    if not isinstance(key, str) or not key:
        raise InvalidInput(where, "identifier", f"must be a non-empty string; got {key!r:.60}")
    return key


def _text(name: Any) -> str | None:
    """Return a name: a text, or that in English, else the first, of texts in several languages."""
    if isinstance(name, list):
        texts = [one for one in name if isinstance(one, dict) and isinstance(one.get("text"), str)]
        english = [one for one in texts if str(one.get("lang", "")).startswith("en")]
        name = next((one["text"] for one in [*english, *texts]), None)
    return name if isinstance(name, str) and name else None


def _class(who: str, field: str, zone: Mapping[str, Any]) -> str:
    """Return the class of a zone that separation rules may name."""
    value = zone.get(field)
    if not isinstance(value, str) or not value:
        raise InvalidInput(who, field, f"must be a non-empty string, such as PROHIBITED; got {value!r:.40}")
    if value not in CODES and value.upper() in CODES:
        raise InvalidInput(who, field, f"must be in upper case: {value.upper()}; got {value!r:.40}")
    return value


def _layers(who: str, field: str, geometry: Any, found: Gathered) -> Iterator[Volume]:
    """Yield the volumes of a geometry of ED-318: GeoJSON with a `layer`, and with an `extent` of circles."""
    geometry = _object(who, field, geometry)
    kind = geometry.get("type")
    if kind == "GeometryCollection":
        _known(who, field, geometry, {"type", "geometries", "bbox"})
        for k, one in enumerate(_list(who, f"{field}.geometries", geometry.get("geometries"))):
            yield from _layers(who, f"{field}.geometries[{k}]", one, found)
        return
    layer = {} if geometry.get("layer") is None else _object(who, f"{field}.layer", geometry["layer"])
    _known(who, f"{field}.layer", layer, _LAYER)
    unit = layer.get("uom") or "m"
    heights = {
        side: _height(who, f"{field}.layer.{side}", layer.get(side), unit, layer.get(f"{side}Reference"), side)
        for side in ("lower", "upper")
    }
    if kind in AREA_TYPES:
        _known(who, field, geometry, {"type", "coordinates", "layer", "bbox"})
        footprint = multipolygon(who, geometry, field)
    elif kind == "Point":
        _known(who, field, geometry, {"type", "coordinates", "layer", "extent", "bbox"})
        extent = _object(who, f"{field}.extent", geometry.get("extent"))
        _known(who, f"{field}.extent", extent, {"subType", "radius"})
        if extent.get("subType") != "Circle":
            raise InvalidInput(who, f"{field}.extent", f"must be of subType Circle; got {extent.get('subType')!r:.40}")
        place = point(who, geometry.get("coordinates"), f"{field}.coordinates")[0]
        # Lengths of ED-318 other than heights are metres.
        radius_m = finite(who, f"{field}.extent.radius", extent.get("radius"))
        footprint = found.circle(who, float(place[0]), float(place[1]), radius_m, f"{field}.extent.radius")
    else:
        rule = f"must be one of {', '.join(AREA_TYPES)}, a Point with an extent, or a GeometryCollection of these"
        raise InvalidInput(who, field, f"{rule}; got {kind!r:.40}")
    yield Volume(footprint, heights["lower"], heights["upper"])


def _projection(who: str, field: str, volume: Mapping[str, Any], found: Gathered) -> Volume:
    """Return a volume of ED-269."""
    _known(who, field, volume, _VOLUME)
    unit = volume.get("uomDimensions")
    if not isinstance(unit, str) or unit not in _FEET:
        raise InvalidInput(who, f"{field}.uomDimensions", f"must be M or FT; got {unit!r:.40}")
    heights = {
        side: _height(
            who,
            f"{field}.{side}Limit",
            _number(volume.get(f"{side}Limit")),
            unit,
            volume.get(f"{side}VerticalReference"),
            side,
        )
        for side in ("lower", "upper")
    }
    plan = _object(who, f"{field}.horizontalProjection", volume.get("horizontalProjection"))
    footprint: shapely.MultiPolygon
    if plan.get("type") == "Circle":
        _known(who, f"{field}.horizontalProjection", plan, {"type", "center", "radius"})
        place = point(who, plan.get("center"), f"{field}.horizontalProjection.center")[0]
        where = f"{field}.horizontalProjection.radius"
        radius = finite(who, where, plan.get("radius"))
        footprint = found.circle(who, float(place[0]), float(place[1]), radius * _FEET[unit], where)
    elif plan.get("type") == "Polygon":
        _known(who, f"{field}.horizontalProjection", plan, {"type", "coordinates"})
        footprint = multipolygon(who, dict(plan), f"{field}.horizontalProjection")
    else:
        rule = f"must be a Circle or a Polygon; got {plan.get('type')!r:.40}"
        raise InvalidInput(who, f"{field}.horizontalProjection", rule)
    return Volume(footprint, heights["lower"], heights["upper"])


def _number(value: Any) -> Any:
    """Return the number of a text such as "120"; other values unchanged."""
    return float(value) if isinstance(value, str) and _NUMBER.fullmatch(value) else value


def _height(who: str, field: str, value: Any, unit: Any, reference: Any, side: str) -> float | None:
    """Return a height in metres above mean sea level; one that is missing is unbounded."""
    if value is None:
        return None
    if not isinstance(unit, str) or not isinstance(reference, str):
        raise InvalidInput(who, field, f"needs a unit and a reference; got {unit!r:.40} and {reference!r:.40}")
    return height_m(who, field, finite(who, field, value), unit, reference, is_floor=side == "lower")


def _actives(who: str, field: str, zone: Mapping[str, Any]) -> list[Active]:
    """Return when a zone is active; an empty list is always."""
    other = next((name for name in zone if name != field and (name in _WHEN or look_alike(name, (field,)))), None)
    if other is not None:
        raise InvalidInput(who, other, f"is not known here; did you mean {field}?")
    periods = zone.get(field)
    if periods is None:
        return []
    found = []
    for i, period in enumerate(_list(who, field, periods)):
        one = _object(who, f"{field}[{i}]", period)
        _known(who, f"{field}[{i}]", one, _TIMES)
        if one.get("permanent") not in [None, "YES", "NO"]:
            raise InvalidInput(who, f"{field}[{i}].permanent", f"must be YES or NO; got {one['permanent']!r:.40}")
        start, end = (
            None
            if one.get(name) is None
            else instant(who, f"{field}[{i}].{name}", one[name], is_end=name == "endDateTime")
            for name in ("startDateTime", "endDateTime")
        )
        if one.get("permanent") == "YES" and (start is not None or end is not None):
            rule = "is YES, but a start or an end is given: leave one of them out"
            raise InvalidInput(who, f"{field}[{i}].permanent", rule)
        given = [
            daily
            for name in ("schedule", "dailyPeriod")
            if any(map(_says, daily := _list(who, f"{field}[{i}].{name}", one.get(name) or [])))
        ]
        if len(given) > 1:
            raise InvalidInput(who, f"{field}[{i}].dailyPeriod", "must not be given together with schedule")
        found.append(Active(start, end, {"ed318": given[0]} if given else None))
    return found


def _says(daily: Any) -> bool:
    """Return whether a daily period of ED-269 says anything."""
    return not isinstance(daily, dict) or any(daily.values())


def _object(who: str, field: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InvalidInput(who, field, f"must be an object; got {value!r:.60}")
    return value


def _list(who: str, field: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise InvalidInput(who, field, f"must be a list; got {value!r:.60}")
    return value


def _known(who: str, field: str, value: Mapping[str, Any], names: "set[str] | frozenset[str]") -> None:
    """Raise InvalidInput for a member that is not known."""
    unknown = sorted(value.keys() - names)
    if unknown:
        raise InvalidInput(who, f"{field}.{unknown[0]}", f"is not known here; known are {', '.join(sorted(names))}")
