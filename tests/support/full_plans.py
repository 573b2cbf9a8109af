"""Areas and tracks with each of their fields set, and a comparison of all fields.

The fields are those of the classes; `AREA` and `TRACK` have a value for each of them. A new field needs a value here,
and is then compared at every border.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Final

import numpy as np
import shapely

from conflictdb.errors import ConflictDBError
from conflictdb.model.plans import Area, Motion, Scene, Track
from conflictdb.model.tolerances import windows_later

Plan = Area | Track
HOUR_US: Final = 3_600_000_000
T0_US: Final = 1_780_380_000_123_456  # 2026-06-02, not on a whole second
SCENE: Final = Scene("borders", motion=Motion.RHUMB)
_WAY: Final = np.array([[4.0, 57.0], [4.5, 57.2], [5.1, 57.1]])
_TIMES: Final = np.array([T0_US, T0_US + 2 * HOUR_US, T0_US + 5 * HOUR_US])
_SHIP: Final = np.array([[20.0, 60.5], [20.0, -55.25], [-15.0, -55.25], [-15.0, 60.5]])
_LATER: Final = (T0_US + 24 * HOUR_US, T0_US + 50 * HOUR_US)


def _instant(at_us: int) -> np.datetime64:
    return np.datetime64(at_us, "us")


_SPANS: Final = ((T0_US, T0_US + HOUR_US), (T0_US + 3 * HOUR_US, T0_US + 4 * HOUR_US))
_DAILY: Final = {
    "periods": [["08:00", "10:00"]],
    "timezone": "Europe/Zurich",
    "from": "2026-06-01",
    "until": "2099-06-20",
}
_PROPERTIES: Final = {"remark": "Ümlaut & <tag>", "count": 3, "nested": {"deep": [1, None, "x"]}, "nothing": None}
# A value of each field.
_AREA: Final[Mapping[str, Any]] = {
    "key": "Ä1 & co",
    "footprint": shapely.MultiPolygon(
        [
            shapely.Polygon(
                [(4.0, 57.0), (4.6, 57.0), (4.6, 57.3), (4.0, 57.3)],
                [[(4.1, 57.1), (4.2, 57.1), (4.2, 57.2), (4.1, 57.2)]],
            ),
            shapely.box(5.0, 57.0, 5.1, 57.1),
        ]
    ),
    "name": "Firing <area> & Süd",
    "start_us": _instant(T0_US),
    "end_us": _instant(T0_US + 9 * HOUR_US),
    "floor_m": -200.25,
    "ceiling_m": 812.5,
    "properties": _PROPERTIES,
    "object_class": "firing",
    "owner": "navy",
    "spans_us": [[_instant(at) for at in span] for span in _SPANS],
    "schedule": _DAILY,
}
_TRACK: Final[Mapping[str, Any]] = {
    "key": "Ä1 & co",
    "positions_deg": np.array([[4.1, 57.3], [4.5, 57.2], [5.0, 57.0]]),
    "times_us": np.array([_instant(T0_US + HOUR_US), _instant(T0_US + 2 * HOUR_US), _instant(T0_US + 4 * HOUR_US)]),
    "outline_m": np.array([[30.0, 0.5], [0.0, -90.0], [-30.0, 0.5], [0.0, 100.0]]),
    "name": "Ferry <1> & Süd",
    "floor_m": -12.5,
    "ceiling_m": 30.75,
    "properties": _PROPERTIES,
    "grow_mps": 0.0625,
    "outlines_m": np.array([_SHIP, 1.5 * _SHIP, 2.0 * _SHIP]),
    "floors_m": [-30.5, -np.inf],
    "ceilings_m": [0.0, 10.5, 40.25],
    "object_class": "ferry",
    "owner": "line",
    "tolerances": {
        "xtd_port_m": [150.0, 200.0],
        "xtd_starboard_m": 100.0,
        "min_speed_kn": 2.5,
        "max_speed_kn": [30.0, 25.0],
        "turn_radius_m": 300.0,
        "departure_window": ["2026-06-02T07:00:00+02:00", "2026-06-02T09:00:00Z"],
        "arrival_window": ["2026-06-02T10:00:00Z", "2026-06-02T15:00:00Z"],
    },
    "departures_us": [_instant(at) for at in _LATER],
    "schedule": _DAILY,
    "legs": Motion.RHUMB,
}
# Fields that another one needs.
_WITH: Final[Mapping[str, Mapping[str, Any]]] = {"outlines_m": {"outline_m": _SHIP}}


@dataclass(frozen=True)
class Specimen:
    """A plan with one field set beside those that it must have, or with several.

    fields : the names of these
    """

    fields: tuple[str, ...]
    plan: Plan

    @property
    def name(self) -> str:
        """Return the kind and the fields of the plan."""
        return f"{type(self.plan).__name__}: {', '.join(self.fields)}"


def area(**given: Any) -> Area:
    """Return a small area with these fields."""
    return Area(**{"key": "A1", "footprint": shapely.box(4.0, 57.0, 4.6, 57.3), **given})


def track(**given: Any) -> Track:
    """Return a short track with these fields."""
    needed = {"key": "T1", "positions_deg": _WAY, "times_us": _TIMES.astype("datetime64[us]"), "outline_m": _SHIP}
    return Track(**{**needed, **given})


def values_of(kind: type[Plan]) -> Mapping[str, Any]:
    """Return the value of each field of areas or tracks; fails for a field without a value, or an unknown one."""
    values = _AREA if kind is Area else _TRACK
    names = {one.name for one in fields(kind)}
    assert values.keys() == names, f"fields of {kind.__name__} without a value: {names ^ values.keys()}"
    return values


# Sets of fields that a plan can have together; each field is in one of them.
_TOGETHER: Final[Mapping[type[Plan], tuple[tuple[str, ...], ...]]] = {
    Area: (("spans_us",), ("start_us", "end_us", "schedule")),
    Track: (
        ("floor_m", "ceiling_m", "grow_mps", "departures_us", "outline_m"),
        ("floors_m", "ceilings_m", "outlines_m", "schedule"),
        ("floors_m", "ceiling_m", "tolerances", "outline_m"),
    ),
}


def specimens() -> list[Specimen]:
    """Return plans that have each field alone, and plans that have all fields that can be together."""
    found = []
    for kind, make in ((Area, area), (Track, track)):
        values = values_of(kind)
        excluding = {name for some in _TOGETHER[kind] for name in some}
        alone = [(name,) for name in values]
        full = [(*(name for name in values if name not in excluding), *some) for some in _TOGETHER[kind]]
        for names in (*alone, *full):
            given = {name: values[name] for name in names}
            for name in names:
                given |= _WITH.get(name, {})
            found.append(Specimen(names, make(**given)))
    return found


def lost(one: Plan, other: Plan | None) -> list[str]:
    """Return the names of the fields in which two plans differ, to the last bit; all of them if there is no other.

    The lines of legs are those of the scene, for which they were checked; not every border stores them. Windows of
    tolerances may have other offsets.
    """
    if not isinstance(other, Area if isinstance(one, Area) else Track):
        return [each.name for each in fields(one)]
    pairs = {each.name: (getattr(one, each.name), getattr(other, each.name, None)) for each in fields(one)}
    if None in pairs.get("legs", ()):
        del pairs["legs"]
    if all(pairs.get("tolerances", [None])):
        pairs["tolerances"] = tuple(windows_later(given, 0) for given in pairs["tolerances"])
    return [name for name, (mine, theirs) in pairs.items() if not _same(mine, theirs)]


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    if isinstance(one, shapely.Geometry) and isinstance(other, shapely.Geometry):
        return bool(shapely.to_wkb(one) == shapely.to_wkb(other))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return False
    return bool(one == other)


@dataclass(frozen=True)
class Border:
    """A way of a plan out of the product and back, or through a part of it.

    carry : returns the plan on the other side; raises InvalidInput or another error of the package
    refuses : a word of the message, by the field that is refused
    changes : fields that are others on the other side, as documented; and those that are others with them
    kinds : of plans; others are refused, by a word of the message, or cannot be
    is_slow : only plans with many fields cross it
    """

    carry: Callable[[Plan], Plan | None]
    refuses: Mapping[str, str] = field(default_factory=dict)
    changes: Mapping[str, Sequence[str]] = field(default_factory=dict)
    kinds: tuple[type[Plan], ...] = (Area, Track)
    other_kind: str = ""
    is_slow: bool = False

    def faults(self) -> Iterator[str]:
        """Yield what happens to fields and is not listed."""
        unused = {*self.refuses, *self.changes}
        for one in specimens():
            if self.is_slow and len(one.fields) == 1:
                continue
            if isinstance(one.plan, self.kinds):
                yield from self._faults(one, unused)
            elif self.other_kind:
                yield from self._unless_refused(one, self.other_kind)
        yield from (f"{name} is listed, and kept" for name in sorted(unused))

    def _faults(self, one: Specimen, unused: set[str]) -> Iterator[str]:
        refused = [name for name in one.fields if name in self.refuses]
        if refused:
            unused.difference_update(refused)
            yield from self._unless_refused(one, *(self.refuses[name] for name in refused))
            return
        try:
            found = lost(one.plan, self.carry(one.plan))
        except ConflictDBError as error:
            yield f"{one.name}: refused: {_brief(error)}"
            return
        changed = {name for name in self.changes if name in one.fields and name in found}
        unused.difference_update(changed)
        silent = [name for name in found if name not in changed.union(*(self.changes[name] for name in changed))]
        if silent:
            yield f"{one.name}: lost: {', '.join(silent)}"

    def _unless_refused(self, one: Specimen, *words: str) -> Iterator[str]:
        try:
            found = self.carry(one.plan)
        except ConflictDBError as error:
            if not any(word in str(error) for word in words):
                yield f"{one.name}: refused without its name: {_brief(error)}"
            return
        yield f"{one.name}: not refused; lost: {lost(one.plan, found)}"


def _brief(error: Exception) -> str:
    return str(error).splitlines()[0][-300:]
