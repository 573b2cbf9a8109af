"""Read OGC Moving Features JSON (19-045r3): moving points with instants; the haven comes from the properties.

Accepts features with a `temporalGeometry` of type MovingPoint, alone or in a collection, and a bare MovingPoint as
MobilityDB's asMFJSON writes it. Interpolation must be linear: constant speed on each leg, along the lines of the
scene's motion.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.formats import file_objects, reference
from conflictdb.formats.fields import Fields, finite, instant, instants
from conflictdb.formats.geometry import line
from conflictdb.formats.names import misnamed
from conflictdb.formats.standards import Standard
from conflictdb.model.inputs import all_certain
from conflictdb.model.plans import MAX_INSTANT_US, MIN_INSTANT_US, Track

STANDARD: Final = Standard(
    "OGC Moving Features",
    read={"datetimes": "times of a track", "properties": "members of a scene file"},
    unread={"temporalProperties": "values that change with time", "time": "the lifespan of the feature"},
    aside={"geometry": "a place of the feature", "bbox crs trs": "box and reference systems"},
)
_POINT = "MovingPoint"
_MEMBERS = ("coordinates", "datetimes", "interpolation", "interpolations", "sequences", "crs", "trs")
_MICROSECONDS_PER_MILLISECOND = 1000


def is_bare(document: Mapping[str, Any]) -> bool:
    """Return whether a JSON object is a bare temporal geometry."""
    return document.get("type") == _POINT


def as_feature(document: dict[str, Any], stem: str) -> dict[str, Any]:
    """Return a single feature or temporal geometry as a feature with an id, by default the name of the file."""
    if is_bare(document):
        return {"type": "Feature", "id": stem, "temporalGeometry": document, "properties": document.get("properties")}
    return {"id": stem, **document}


def track(
    key: str, feature: Mapping[str, Any], properties: Mapping[str, Any], setting: file_objects.FileContext
) -> Track:
    """Return the track of a feature with a temporalGeometry; raises InvalidInput with all errors."""
    fields = Fields(f"track {key!r}", properties)
    with fields.refusals:
        kind = fields.text("kind")
        if kind not in (None, "track"):
            raise fields.refusal("kind", f"must be 'track' for a moving feature; got {kind!r:.60}")
    for name in (*file_objects.TIMES, *file_objects.SPEED):
        with fields.refusals:
            if fields.has(name):
                raise fields.refusal(name, "must not be given together with temporalGeometry, which has the times")
    with fields.refusals:
        positions, times_us = _course(fields, feature["temporalGeometry"], setting)
    members = file_objects.track_members(fields, setting)
    fields.raise_found()
    return Track(key, positions, all_certain(times_us), **members, max_speed_kn=np.inf)


def _course(
    fields: Fields, moving: Any, setting: file_objects.FileContext
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the positions and instants of a temporal geometry."""
    where = "temporalGeometry"
    if not isinstance(moving, dict) or moving.get("type") != _POINT:
        kind = moving.get("type") if isinstance(moving, dict) else moving
        raise fields.refusal(f"{where}.type", f"must be {_POINT}; got {kind!r:.60}")
    fields.refusals.extend(misnamed(f"{fields.who}: {where}", moving, _MEMBERS, foreign=setting.foreign))
    check_trs(fields.who, moving)
    _check_interpolation(fields, where, moving)
    sequences = moving.get("sequences")
    if sequences is not None:
        if not isinstance(sequences, list) or len(sequences) != 1 or not isinstance(sequences[0], dict):
            rule = "must hold one sequence: a track has no gaps; give each sequence as a feature of its own"
            raise fields.refusal(f"{where}.sequences", rule)
        moving, where = sequences[0], f"{where}.sequences[0]"
    positions = line(fields.who, f"{where}.coordinates", moving.get("coordinates"))
    to_degrees = reference.of_member(fields.who, moving, setting.to_degrees, setting.systems)
    if to_degrees is not None:
        positions = to_degrees(positions)
    return positions, instants(fields.who, f"{where}.datetimes", moving.get("datetimes"), _instant)


def check_trs(who: str, holder: Mapping[str, Any]) -> None:
    """Refuse a temporal reference system other than ISO 8601 in the Gregorian calendar."""
    trs = holder.get("trs")
    if trs is not None and not any(known in repr(trs).lower() for known in ("iso8601", "gregorian")):
        raise InvalidInput(who, "trs", f"must be ISO 8601 in the Gregorian calendar, or be left out; got {trs!r:.60}")


def _check_interpolation(fields: Fields, where: str, moving: Mapping[str, Any]) -> None:
    for name in ("interpolation", "interpolations"):
        value = moving.get(name)
        if any(one not in (None, "Linear") for one in (value if isinstance(value, list) else [value])):
            rule = f"must be Linear: tracks move steadily between waypoints; got {value!r:.60}"
            raise fields.refusal(f"{where}.{name}", rule)


def _instant(who: str, where: str, value: Any) -> int:
    """Return an instant: an ISO 8601 string, or milliseconds since 1970."""
    if isinstance(value, str):
        return instant(who, where, value)
    instant_us = finite(who, where, value) * _MICROSECONDS_PER_MILLISECOND
    if not MIN_INSTANT_US <= instant_us <= MAX_INSTANT_US:
        raise InvalidInput(who, where, "must lie in the years 1 to 9999")
    return round(instant_us)
