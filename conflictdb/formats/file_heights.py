"""Heights as other formats write them: a number, a unit and a reference.

Heights of a scene are metres above its vertical datum. A height above the ground or another datum cannot be compared
with them. It is refused, or unbounded if the hints say so: more conflicts may be reported then, and none is missed.
"""

from typing import Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.hints import heights_may_be_unbounded, vertical_datum
from conflictdb.model.plans import Scene
from conflictdb.model.settings import VerticalDatum, datum_named

FEET_M: Final = 0.3048  # exact
_UNITS: Final = {"m": 1.0, "ft": FEET_M, "fl": 100.0 * FEET_M, "km": 1000.0}
_GROUND: Final = frozenset({"AGL", "SFC", "GND"})
_KNOWN: Final = ("AMSL", *sorted(_GROUND), "WGS84", "W84", "STD")
# "No upper limit" in feeds of zones.
UNLIMITED: Final = 99_999.0
_HINT: Final = "--unbounded-heights takes such an object at all heights"


def height_m(who: str, field: str, value: float, unit: str, reference: str, *, is_floor: bool) -> float | None:
    """Return a height in metres above the scene's vertical datum, None if it is unbounded; raises InvalidInput.

    unit : m, ft, km or FL, in upper or lower case
    reference : AMSL, AGL, WGS84, STD or another name of these
    """
    scale = _UNITS.get(unit.strip().lower())
    if scale is None:
        raise InvalidInput(who, field, f"has the unit {unit!r:.40}; known are m, ft and FL")
    reference = reference.strip().upper()
    if scale == _UNITS["fl"]:
        reference = "STD"
    if not is_floor and value == UNLIMITED:
        return None
    datum, own = datum_named(reference), vertical_datum()
    if datum is own:
        return value * scale
    if datum is None and reference not in _GROUND:
        raise InvalidInput(who, field, f"has the reference {reference!r:.40}; known are {', '.join(_KNOWN)}")
    from_ground_up = is_floor and value <= 0.0 and reference in _GROUND
    if from_ground_up or heights_may_be_unbounded():
        return None
    measured, remedy = "the ground", _HINT
    if datum is not None:
        measured, remedy = datum.phrase, f"{_HINT}, a scene with vertical_datum {datum} at its own"
    rule = f"is measured from {measured}, and cannot be compared with heights above {own.phrase}"
    raise InvalidInput(who, field, f"{rule}: {remedy}")


def refuse_flight_levels(scene: Scene, form: str) -> None:
    """Raise InvalidInput for a scene whose heights are flight levels, which a format does not have."""
    if scene.vertical_datum is VerticalDatum.FLIGHT_LEVEL:
        rule = f"is flight_level, and {form} has heights above mean sea level or the ellipsoid only: convert the scene"
        raise InvalidInput(f"scene {scene.name!r}", "vertical_datum", rule)
