"""Write areas as UAS geographical zones: ED-318 (GeoJSON). Tracks are no zones.

The standard's `extendedProperties` have what its other members do not: a class that is no code of zones, the owner, a
long name, and further properties.
"""

from collections.abc import Iterator, Sequence
from typing import Any, Final

import shapely

from conflictdb.errors import InvalidInput
from conflictdb.exchange.uas_zones import CODES, EXTENSION, LONGEST_NAME
from conflictdb.formats.file_heights import refuse_flight_levels
from conflictdb.formats.file_objects import columns_aside
from conflictdb.formats.instants import format_instant
from conflictdb.formats.json_text import dumped
from conflictdb.formats.single_activations import spans_of
from conflictdb.model.plans import Area, Scene, Track, VerticalDatum

_LONGEST_KEY: Final = 7
_REFERENCES: Final = {VerticalDatum.MSL: "AMSL", VerticalDatum.WGS84: "WGS84"}
# What the standard requires of a zone; properties of the area replace it.
_DEFAULTS: Final[dict[str, Any]] = {
    "country": "XXX",  # unspecified, as in passports
    "type": "PROHIBITED",
    "variant": "COMMON",
    "zoneAuthority": [{"purpose": "INFORMATION"}],
}
_OPTIONAL: Final = frozenset(
    {
        *("restrictionConditions", "region", "reason", "otherReasonInfo", "regulationExemption", "message"),
        *("dataSource", "extendedProperties"),
    }
)


def ed318_lines(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    """Yield the lines of a feed of areas; raises InvalidInput for tracks, and for an id that is too long."""
    if tracks:
        rule = f"holds areas only; here are {len(tracks)} tracks, such as {tracks[0].key!r}: name the keys of the areas"
        raise InvalidInput("ED-318", "", rule)
    yield f'{{ "type": "FeatureCollection", "name": {dumped(scene.name)}, "features": ['
    separator = "\n"
    for area in areas:
        yield f"{separator}{dumped(_feature(scene, area))}"
        separator = ",\n"
    yield " ] }\n"


def _feature(scene: Scene, area: Area) -> dict[str, Any]:
    if len(area.key) > _LONGEST_KEY:
        rule = f"is longer than the {_LONGEST_KEY} characters of an identifier of ED-318"
        raise InvalidInput(f"area {area.key!r}", "id", rule)
    parts = shapely.get_parts(area.footprint)
    geometry = dict(shapely.geometry.mapping(parts[0] if len(parts) == 1 else area.footprint))
    layer: dict[str, Any] = {}
    for side, height in (("lower", area.floor_m), ("upper", area.ceiling_m)):
        if height is not None:
            refuse_flight_levels(scene, "ED-318")
            layer |= {side: height, f"{side}Reference": _REFERENCES[scene.vertical_datum]}
    if layer:
        geometry["layer"] = {**layer, "uom": "m"}
    own = {name: one for name, one in area.properties.items() if name in _DEFAULTS.keys() | _OPTIONAL}
    kind = {"type": area.object_class} if area.object_class in CODES else {}
    properties = {"identifier": area.key, **_DEFAULTS, **own, **kind}
    if area.name is not None:
        properties["name"] = [{"text": area.name[:LONGEST_NAME], "lang": "en-GB"}]
    if extension := _extension(area, properties["type"]):
        extended = own.get("extendedProperties")
        properties["extendedProperties"] = {**(extended if isinstance(extended, dict) else {}), EXTENSION: extension}
    periods = _periods(area)
    if periods != [{}]:
        properties["limitedApplicability"] = periods
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _extension(area: Area, kind: Any) -> dict[str, Any]:
    """Return what the standard has no member for; empty if there is nothing."""
    found: dict[str, Any] = {}
    if area.object_class != kind:
        found["class"] = area.object_class
    found |= {name: one for name, one in columns_aside(area).items() if name not in ("class", "name")}
    if area.name is not None and len(area.name) > LONGEST_NAME:
        found["name"] = area.name
    known = _DEFAULTS.keys() | _OPTIONAL
    rest = {name: one for name, one in area.properties.items() if name not in known}
    extended = area.properties.get("extendedProperties")
    if extended is not None and not isinstance(extended, dict):
        rest["extendedProperties"] = extended
    return found | ({"properties": rest} if rest else {})


def has_only_ed318(area: Area) -> bool:
    """Return whether all rules of an area's schedule are those of ED-318."""
    rules = area.schedule if isinstance(area.schedule, list) else [area.schedule]
    return area.schedule is not None and all(rule.keys() <= {"ed318", "from", "until"} for rule in rules)


def _periods(area: Area) -> list[dict[str, Any]]:
    """Return when a zone is active: with schedules of ED-318 as they were read, else its spans."""
    rules = area.schedule if isinstance(area.schedule, list) else [area.schedule]
    if has_only_ed318(area):
        return [
            _period(rule.get("from", _text(area.start_us)), rule.get("until", _text(area.end_us)))
            | ({"schedule": rule["ed318"]} if "ed318" in rule else {})
            for rule in rules
        ]
    return [_period(*map(_text, span)) for span in spans_of(area)]


def _period(start: str | None, end: str | None) -> dict[str, Any]:
    return {name: one for name, one in (("startDateTime", start), ("endDateTime", end)) if one is not None}


def _text(instant_us: int | None) -> str | None:
    return None if instant_us is None else format_instant(instant_us)
