"""Where an area could be instead: the least shift along bearings with which it meets nothing.

Shifts are whole tenths of a unit. A detection of the moved copy (`Index.probe`) checks each one before it is returned.
"""

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from conflictdb.core.moving_plans import moved
from conflictdb.errors import InvalidInput
from conflictdb.memory import questions
from conflictdb.memory.index import Index
from conflictdb.model import inputs
from conflictdb.model.margin import Margin
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.proposals import NewPlace
from conflictdb.model.units import Units

# Shifts are coarser tenths if that would be more steps than this on a bearing.
_MOST_STEPS: Final = 100
BEARINGS_DEG: Final = tuple(45.0 * n for n in range(8))
_MOST_BEARINGS: Final = 360


@dataclass(frozen=True, slots=True)
class FreePlace:
    """The least shift of an area along a bearing.

    distance_m : metres, a whole number of steps; None: no shift up to the limit is free
    meets : the keys of what the area meets where it is planned (0 m), or with the farthest shift if none is free
    """

    bearing_deg: float
    distance_m: float | None
    meets: tuple[str, ...]


def checked(who: str, most_m: Any, bearings_deg: Any) -> tuple[float, tuple[float, ...]]:
    """Return a limit and bearings that people give; raises InvalidInput."""
    most_m = inputs.reach_m(who, "aside_m", most_m)
    given = BEARINGS_DEG if bearings_deg is None else tuple(bearings_deg)
    if not 0 < len(given) <= _MOST_BEARINGS:
        raise InvalidInput(who, "bearings_deg", f"must be 1 to {_MOST_BEARINGS} bearings; got {len(given)}")
    for one in given:
        if not (inputs.is_number(one) and -360.0 <= one <= 360.0):
            raise InvalidInput(who, "bearings_deg", f"must be from -360 to 360 degrees; got {one!r:.20}")
    return most_m, given


def places(
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene,
    key: str,
    most_m: Any,
    bearings_deg: Sequence[float] | None = None,
    *,
    margin_s: float = 0.0,
    margin_m: float = 0.0,
    units: Units = Units.NAUTICAL,
) -> list[FreePlace]:
    """Return the least free shift of an area along each bearing, while all others stay as planned.

    most_m : the farthest shift, metres
    bearings_deg : degrees clockwise from north; None: eight of them
    margin_s, margin_m : wanted on top of the required separations in time and in distance
    units : shifts are whole tenths of its larger unit

    Raises InvalidInput for a key that is not of an area, for an area or any other object that does not fit the plane,
    and for limits that are none.
    """
    most_m, bearings_deg = checked("places", most_m, bearings_deg)
    margin = Margin.of("places", margin_s, margin_m)
    world, known, others = questions.world_of("places", tracks, areas, margin.added_to(scene))
    scene = replace(world.setup.scene, method=Method.EXACT, nearest_m=0.0)
    plans: list[Area | Track] = [*others, *known]
    area = next((one for one in plans if isinstance(one, Area) and one.key == key), None)
    if area is None:
        problem = (
            "is a track, which goes aside in `resolve`" if any(one.key == key for one in plans) else "is not known"
        )
        raise InvalidInput(f"scene {scene.name!r}", "area", f"{key!r} {problem}")
    index = Index(scene)
    index.put([one for one in plans if one.key != key])
    return [_along(index, scene, area, most_m, bearing, units) for bearing in bearings_deg]


def nearest_place(index: Index, scene: Scene, area: Area, most_m: float, ends: float, units: Units) -> NewPlace | None:
    """Return the least free shift of an area that an index lacks, along one of eight bearings; None: none is found.

    ends : of the search, on the monotonic clock
    units : the shift is a whole number of tenths of its larger unit
    """
    step_m, count = _steps(most_m, units)
    for k in range(1, count + 1):
        for bearing in BEARINGS_DEG:
            if time.monotonic() > ends:
                return None
            if _met_at(index, scene, area, k * step_m, bearing) == ():
                return NewPlace(k * step_m, bearing)
    return None


def _along(index: Index, scene: Scene, area: Area, most_m: float, bearing: float, units: Units) -> FreePlace:
    step_m, count = _steps(most_m, units)
    met = farthest = _met(index, area)
    if not met:
        return FreePlace(bearing, 0.0, ())
    for k in range(1, count + 1):
        there = _met_at(index, scene, area, k * step_m, bearing)
        if there == ():
            return FreePlace(bearing, k * step_m, met)
        farthest = there or farthest
    return FreePlace(bearing, None, farthest)


def _steps(most_m: float, units: Units) -> tuple[float, int]:
    step_m = units.step_m * max(1, math.ceil(most_m / units.step_m / _MOST_STEPS))
    return step_m, int(most_m / step_m * (1.0 + 1e-12))


def _met_at(index: Index, scene: Scene, area: Area, distance_m: float, bearing: float) -> tuple[str, ...] | None:
    """Return the keys of what a moved copy meets; None if it cannot be there, beyond a pole or the plane."""
    try:
        return _met(index, moved(area, distance_m, bearing, scene))
    except InvalidInput:
        return None


def _met(index: Index, plan: Area | Track) -> tuple[str, ...]:
    """Return the keys of what a plan meets. Raises InvalidInput if it does not fit the plane."""
    keys = {one.b_key if one.a_key == plan.key else one.a_key for one in index.probe(plan)}
    return tuple(sorted(keys, key=str.encode))
