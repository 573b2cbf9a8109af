"""Read ASTM F3548-21 operational intents (and constraints): JSON with a list of four-dimensional volumes.

Each volume becomes an area. Edges of polygons are shortest lines, which rhumb lines follow within half a metre.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely

from conflictdb.errors import InvalidInput
from conflictdb.formats.areas_of_files import Active, Gathered, Volume, Zone, along_shortest_lines
from conflictdb.formats.contents import Contents
from conflictdb.formats.fields import Fields, finite, instant
from conflictdb.formats.file_heights import height_m
from conflictdb.formats.file_objects import read_aside
from conflictdb.formats.names import look_alike
from conflictdb.formats.standards import Standard

STANDARD: Final = Standard(
    "ASTM F3548",
    read={"time_start time_end": "times", "altitude_lower altitude_upper": "heights", "radius": "circles"},
    aside={
        "reference/time_start reference/time_end": "the time of all volumes together; each has its own",
        "subscription": "of who is told",
        "conflictdb": "of an export, read",
    },
)
# Lists of volumes in operational intents, in their details, and in requests for them and for constraints.
_LISTS: Final = ("volumes", "off_nominal_volumes", "extents")
# The member of a reference that `volumes_writing` writes: name, class, owner and properties of the object.
EXTENSION: Final = "conflictdb"
_OUTLINES: Final = ("outline_polygon", "outline_circle")
_VOLUME: Final = frozenset({*_OUTLINES, "altitude_lower", "altitude_upper"})
_AROUND: Final = frozenset({"volume", "time_start", "time_end"})


def is_intent(document: Any) -> bool:
    """Return whether a JSON document is an operational intent, a list of these, or a list of volumes."""
    first = document[0] if isinstance(document, list) and document else document
    if not isinstance(first, dict):
        return False
    if _is_volume(first) or "operational_intent" in first or first.keys() >= {"reference", "details"}:
        return True
    return any(_has_volumes(one) for _, one in _intents("", first))


def _has_volumes(intent: Any) -> bool:
    details = intent.get("details", intent) if isinstance(intent, dict) else None
    return isinstance(details, dict) and any(_is_list_of_volumes(details.get(name)) for name in _LISTS)


def _intents(where: str, one: Any) -> Iterator[tuple[str, Any]]:
    """Yield the operational intents in an answer of the standard's interfaces, each with its place."""
    if isinstance(one, dict):
        for name in ("operational_intent", "constraint"):
            if isinstance(one.get(name), dict):
                yield from _intents(f"{where}.{name}", one[name])
                return
        for name in ("operational_intents", "constraints"):
            if isinstance(one.get(name), list):
                for k, member in enumerate(one[name]):
                    yield from _intents(f"{where}.{name}[{k}]", member)
                return
    yield where, one


def _is_list_of_volumes(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and _is_volume(value[0])


def _is_volume(value: Any) -> bool:
    return isinstance(value, dict) and isinstance(value.get("volume"), dict)


def read_intents(document: Any, source: str, *, stem: str, skip_invalid: bool) -> Contents:
    """Return the areas of operational intents; raises InvalidInput with all errors.

    stem : key of an intent that has no id
    """
    found = Gathered(source)
    members = document if isinstance(document, list) else [document]
    if members and _is_volume(members[0]):
        members = [{"volumes": members}]
    several = len(members) > 1
    intents = [one for i, member in enumerate(members) for one in _intents(f"[{i}]" if several else "", member)]
    for i, (place, intent) in enumerate(intents):
        with found.refusals:
            _read_intent(place.lstrip(".") or "intent", intent, stem if len(intents) == 1 else f"{stem}/{i + 1}", found)
    return found.contents(skip_invalid=skip_invalid)


def _read_intent(place: str, intent: Any, default_key: str, found: Gathered) -> None:
    """Add the areas of an intent; raises InvalidInput for one without volumes."""
    details = intent.get("details", intent) if isinstance(intent, dict) else None
    if not isinstance(details, dict):
        raise InvalidInput(place, "details", f"must be an object with {', '.join(_LISTS)}; got {details!r:.60}")
    reference: Any = intent["reference"] if isinstance(intent.get("reference"), dict) else intent
    key = reference.get("id") or default_key
    for name, value in details.items():
        meant = look_alike(name, _LISTS)
        if name not in _LISTS and meant is not None and isinstance(value, list):
            raise InvalidInput(f"intent {key!r}", name, f"is not known to ASTM F3548; did you mean {meant}?")
    if not any(isinstance(details.get(name), list) for name in _LISTS):
        raise InvalidInput(f"intent {key!r}", "volumes", f"is missing: give a list of volumes as {', '.join(_LISTS)}")
    plan = _plan(f"intent {key!r}", key, _object(f"intent {key!r}", EXTENSION, reference.get(EXTENSION) or {}))
    number = 0
    rest = {name: one for name, one in reference.items() if name != "id" and not isinstance(one, list | dict)}
    if "priority" in details:
        rest["priority"] = details["priority"]
    for name in _LISTS:
        own = {**rest, **plan.properties, "list": name}
        for k, volume in enumerate(_volumes(f"intent {key!r}", name, details.get(name))):
            number += 1
            where = f"{name}[{k}] of intent {key!r}"
            with found.refusals:
                found.add_zone(where, _zone(where, f"{key}/{number}", volume, replace(plan, properties=own), found))


def _plan(who: str, key: str, extension: dict[str, Any]) -> Zone:
    """Return what `volumes_writing` wrote of an object besides its volumes."""
    fields = Fields(who, extension)
    more = read_aside(fields)
    plan = Zone(
        key,
        (),
        more.pop("name", None),
        properties=_object(who, f"{EXTENSION}.properties", fields.get("properties") or {}),
        object_class=more.pop("object_class", None),
        owner=more.pop("owner", None) or key,
        more=more,
    )
    fields.raise_found()
    return plan


def _object(who: str, field: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InvalidInput(who, field, f"must be an object; got {value!r:.60}")
    return value


def _volumes(who: str, name: str, value: Any) -> list[Any]:
    if value is not None and not isinstance(value, list):
        raise InvalidInput(who, name, f"must be a list of volumes; got {value!r:.60}")
    return value or []


def _zone(who: str, key: str, value: Any, plan: Zone, found: Gathered) -> Zone:
    if not _is_volume(value):
        raise InvalidInput(who, "", f"must be an object with a volume; got {value!r:.60}")
    _known(who, "", value, _AROUND)
    volume = value["volume"]
    _known(who, "volume", volume, _VOLUME)
    outlines = [name for name in _OUTLINES if volume.get(name) is not None]
    if len(outlines) != 1:
        raise InvalidInput(who, "volume", f"needs exactly one of {' and '.join(_OUTLINES)}")
    outline = volume[outlines[0]]
    footprint = _circle(who, outline, found) if outlines[0] == "outline_circle" else _polygon(who, outline)
    floor_m, ceiling_m = (_altitude(who, f"volume.altitude_{side}", volume) for side in ("lower", "upper"))
    start_us, end_us = (_time(who, name, value.get(name)) for name in ("time_start", "time_end"))
    return replace(plan, key=key, volumes=[Volume(footprint, floor_m, ceiling_m)], active=[Active(start_us, end_us)])


def _known(who: str, field: str, value: Mapping[str, Any], names: frozenset[str]) -> None:
    unknown = sorted(value.keys() - names)
    if unknown:
        raise InvalidInput(who, ".".join(filter(None, (field, unknown[0]))), "is not known to ASTM F3548")


def _position(who: str, field: str, value: Any) -> tuple[float, float]:
    """Return longitude and latitude, degrees."""
    if not isinstance(value, dict) or not value.keys() >= {"lng", "lat"}:
        raise InvalidInput(who, field, f"must be an object of lng and lat; got {value!r:.60}")
    return finite(who, f"{field}.lng", value["lng"]), finite(who, f"{field}.lat", value["lat"])


def _polygon(who: str, outline: Any) -> shapely.MultiPolygon:
    field = "volume.outline_polygon.vertices"
    vertices = outline.get("vertices") if isinstance(outline, dict) else None
    if not isinstance(vertices, list) or len(vertices) < 3:
        raise InvalidInput(who, field, f"must be a list of at least three vertices; got {vertices!r:.60}")
    ring = np.array([_position(who, f"{field}[{i}]", one) for i, one in enumerate(vertices)])
    if np.any(ring[0] != ring[-1]):
        ring = np.concatenate([ring, ring[:1]])
    return shapely.MultiPolygon([shapely.Polygon(along_shortest_lines(who, field, ring))])


def _circle(who: str, outline: Any, found: Gathered) -> shapely.MultiPolygon:
    field = "volume.outline_circle"
    radius = outline.get("radius") if isinstance(outline, dict) else None
    if not isinstance(radius, dict) or radius.get("units") != "M":
        raise InvalidInput(who, f"{field}.radius", f"must be an object of value and units, M; got {radius!r:.60}")
    lon, lat = _position(who, f"{field}.center", outline.get("center"))
    return found.circle(who, lon, lat, finite(who, f"{field}.radius.value", radius.get("value")))


def _altitude(who: str, field: str, volume: Mapping[str, Any]) -> float | None:
    value = volume.get(field.rpartition(".")[2])
    if value is None:
        return None
    if not isinstance(value, dict) or not all(isinstance(value.get(name), str) for name in ("units", "reference")):
        raise InvalidInput(who, field, f"must be an object of value, units and reference; got {value!r:.60}")
    number = finite(who, f"{field}.value", value.get("value"))
    return height_m(who, field, number, value["units"], value["reference"], is_floor=field.endswith("lower"))


def _time(who: str, field: str, value: Any) -> int | None:
    if value is None:
        return None
    if not isinstance(value, dict) or value.get("format") != "RFC3339":
        raise InvalidInput(who, field, f"must be an object of value and format, RFC3339; got {value!r:.60}")
    return instant(who, f"{field}.value", value.get("value"), is_end=field == "time_end")
