"""Build areas and tracks from features: a shapely geometry, and columns named as in scene files."""

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, Final

import shapely

from conflictdb.errors import InvalidInput
from conflictdb.formats import file_objects
from conflictdb.formats.contents import Skipped
from conflictdb.formats.fields import Fields, number_as_key
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.geometry import CIRCLE_TYPE, TRACK_TYPE
from conflictdb.formats.hints import heights_may_be_unbounded, vertical_datum
from conflictdb.formats.track_times import TrackAtSpeed
from conflictdb.model.plan_columns import PLAN_COLUMNS, Form
from conflictdb.model.plans import Area, Track
from conflictdb.model.settings import datum_named

ALIASES: Final = {"begin": "start"}  # KML's name
POLYGONS: Final = frozenset({shapely.GeometryType.POLYGON, shapely.GeometryType.MULTIPOLYGON})
LINES: Final = frozenset({shapely.GeometryType.LINESTRING, shapely.GeometryType.MULTILINESTRING})
POINTS: Final = frozenset({shapely.GeometryType.POINT, shapely.GeometryType.MULTIPOINT})
# Columns whose text is JSON.
_DOCUMENTS: Final = {one.members[0] for one in PLAN_COLUMNS if one.is_member and one.form is Form.DOCUMENT}
# Columns, in lower case, that make lines tracks.
TIMES_OR_SPEED: Final = frozenset({"times", "datetimes", "speed_kn", "speed_mps"})
# Features left out by geometry that are listed by number.
_MOST_NAMED: Final = 10


def area_of_polygon(
    where: str, number: str, values: Mapping[str, Any], shape: Any, setting: file_objects.FileContext
) -> Area:
    """Return the area of a feature; `number` is its key if it has none. Raises InvalidInput with all errors."""
    key, values = _keyed(where, number, values, file_objects.AREA_MEMBERS)
    fields = Fields(f"area {key!r}", values)
    with fields.refusals:
        if shape is None or shape.is_empty:
            raise InvalidInput(where, "geometry", "must be a non-empty Polygon or MultiPolygon; there is none")
        if shapely.get_type_id(shape) not in POLYGONS:
            raise InvalidInput(where, "geometry", f"must be a Polygon or MultiPolygon; got a {shape.geom_type}")
    members = file_objects.area_members(fields, setting)
    fields.raise_found()
    footprint = shapely.multipolygons(shapely.get_parts(shapely.force_2d(shape)))
    return Area(key, file_objects.in_degrees(fields.who, footprint, setting), **members)


def area_of_circle(
    where: str, number: str, values: Mapping[str, Any], shape: Any, setting: file_objects.FileContext
) -> Area:
    """Return the area of a point with a radius; `number` is its key if it has none. Raises InvalidInput."""
    key, values = _keyed(where, number, values, file_objects.AREA_MEMBERS | {"radius_m"})
    geometry = {"type": CIRCLE_TYPE, "coordinates": shapely.get_coordinates(shape)[0].tolist()}
    return file_objects.area(key, geometry, Fields(f"area {key!r}", values), setting)


def track_of_line(
    where: str, number: str, values: Mapping[str, Any], shape: Any, setting: file_objects.FileContext
) -> Track | TrackAtSpeed:
    """Return the track of a feature; `number` is its key if it has none. Raises InvalidInput with all errors."""
    key, values = _keyed(where, number, values, file_objects.TRACK_MEMBERS)
    fields = Fields(f"track {key!r}", values)
    parts = shapely.get_parts(shape)
    geometry = {"type": TRACK_TYPE, "coordinates": shapely.get_coordinates(shape).tolist()}
    with fields.refusals:
        if len(parts) != 1:
            lines = [shapely.get_coordinates(part).tolist() for part in parts]
            geometry, values = file_objects.joined_track(fields.who, {**geometry, "coordinates": lines}, values)
            fields.values = values
    return file_objects.track(key, geometry, fields, setting)


def _keyed(where: str, number: str, values: Mapping[str, Any], members: frozenset[str]) -> tuple[str, dict[str, Any]]:
    """Return the key of a feature, and its columns named as in scene files."""
    values = _comparable(_known_names(values, members))
    key = number_as_key(values.pop("id", None))
    return checked_key(where, "id", number if key is None or key == "" else key), values


def _comparable(values: dict[str, Any]) -> dict[str, Any]:
    """Return the columns without heights above another datum than the scene's, if these may be unbounded."""
    stated = values.get(file_objects.DATUM)
    if stated is None or not heights_may_be_unbounded() or datum_named(stated) is vertical_datum():
        return values
    return {name: None if name in ("floor_m", "ceiling_m") else value for name, value in values.items()}


def _known_names(values: Mapping[str, Any], members: frozenset[str]) -> dict[str, Any]:
    """Return columns named as in scene files; lists and documents are parsed from JSON text."""
    known = {}
    for name, value in values.items():
        lower = ALIASES.get(name.lower(), name.lower())
        if lower not in members | {"id", file_objects.DATUM} or lower in known:
            known[name] = value
            continue
        if isinstance(value, str) and value.lstrip().startswith(("[", "{") if lower in _DOCUMENTS else "["):
            with suppress(ValueError, RecursionError):  # invalid JSON is refused later, as text
                value = json.loads(value)
        known[lower] = value
    return known


def unusable(source: str, who: str, what: str, numbers: Mapping[str, list[int]], no_times: str) -> Iterator[Skipped]:
    """Yield points and lines as left out, one entry per type of geometry.

    what : ``features`` or ``rows``
    numbers : of the features, by the type of their geometry
    no_times : why lines are no tracks
    """
    for kind, found in numbers.items():
        named = ", ".join(map(str, found[:_MOST_NAMED])) + (", …" if len(found) > _MOST_NAMED else "")
        reason = f"{no_times}: no tracks" if "Line" in kind else "no areas or tracks"
        yield Skipped(source, who, f"{len(found)} {what} are {kind}s, {reason} ({named})", (), is_whole=False)
