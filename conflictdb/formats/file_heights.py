"""Heights as other formats write them: a number, a unit and a reference.

Heights of a scene are metres above mean sea level. A height above ground, above the ellipsoid or of constant pressure
cannot be compared with them. It is refused, or unbounded if the hints say so: more conflicts may be reported then, and
none is missed.
"""

from typing import Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.hints import heights_may_be_unbounded

FEET_M: Final = 0.3048  # exact
_UNITS: Final = {"m": 1.0, "ft": FEET_M, "fl": 100.0 * FEET_M, "km": 1000.0}
_MEAN_SEA_LEVEL: Final = frozenset({"AMSL", "MSL"})
_GROUND: Final = frozenset({"AGL", "SFC", "GND"})
# What other references measure from.
_OTHER: Final = {
    **dict.fromkeys(sorted(_GROUND), "the ground"),
    **dict.fromkeys(("WGS84", "W84"), "the ellipsoid"),
    "STD": "a surface of constant pressure",
}
# "No upper limit" in feeds of zones.
UNLIMITED: Final = 99_999.0
_HINT: Final = "--unbounded-heights takes such an object at all heights"


def height_m(who: str, field: str, value: float, unit: str, reference: str, *, is_floor: bool) -> float | None:
    """Return a height in metres above mean sea level, None if it is unbounded; raises InvalidInput.

    unit : m, ft or FL, in upper or lower case
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
    if reference in _MEAN_SEA_LEVEL:
        return value * scale
    if reference not in _OTHER:
        raise InvalidInput(who, field, f"has the reference {reference!r:.40}; known are AMSL, {', '.join(_OTHER)}")
    from_ground_up = is_floor and value <= 0.0 and reference in _GROUND
    if from_ground_up or heights_may_be_unbounded():
        return None
    rule = f"is measured from {_OTHER[reference]}, and cannot be compared with heights above mean sea level"
    raise InvalidInput(who, field, f"{rule}: {_HINT}")
