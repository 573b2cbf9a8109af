"""Make many areas and tracks at once from arrays, by the rules of `Area` and `Track`.

Refused objects are None: for the errors, the caller makes them one by one.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model import plan_rules
from conflictdb.model.few_rules import AREA_FEW, TRACK_FEW, FewColumns
from conflictdb.model.plan_columns import AREA, TRACK, PlanColumn, checked_columns
from conflictdb.model.plan_rows import Many
from conflictdb.model.plans import Area, Track

_Made = TypeVar("_Made", Area, Track)
# A shape that the arrays have, and properties of a plan that gives none.
_GIVEN: Final = {"key", "footprint", "positions_deg", "times_us", "outline_m", "properties"}


def _defaults(kind: type[Any]) -> dict[str, Any]:
    """Return the values of fields that a plan does not give."""
    return {one.name: None if one.default is MISSING else one.default for one in fields(kind)}


_AREA: Final = _defaults(Area)
_TRACK: Final = _defaults(Track)
_AREA_COLUMNS: Final = checked_columns(AREA)
_TRACK_COLUMNS: Final = checked_columns(TRACK)


def areas(
    keys: Sequence[str],
    footprints: NDArray[np.object_],
    members: Sequence[Mapping[str, Any]],
    kind: type[Area] = Area,
) -> list[Area | None]:
    """Return areas with these keys, not empty, and MultiPolygons.

    members : fields of each besides key and footprint, with numbers of the right types; start_us and end_us are
        microseconds
    """
    n = len(keys)
    is_sound = plan_rules.footprints(footprints).is_sound & _have_sound_columns(_AREA_COLUMNS, members)
    is_sound &= plan_rules.spans(*_bounds(members, "start_us", "end_us", np.int64), Many.each(n)).is_sound
    is_sound &= _have_sound_heights(members)
    made: list[Area | None] = [None] * n
    for i, shape in zip(np.flatnonzero(is_sound).tolist(), footprints[is_sound].tolist(), strict=True):
        own = members[i]
        made[i] = _made(kind, {**_AREA, "properties": {}, **own, "key": keys[i], "footprint": shape})
    _leave_out(made, members, AREA_FEW)
    return made


def tracks(
    keys: Sequence[str],
    positions_deg: NDArray[np.float64],
    way: NDArray[np.int64],
    times_us: NDArray[np.int64],
    outline_m: NDArray[np.float64],
    ring: NDArray[np.int64],
    members: Sequence[Mapping[str, Any]],
    kind: type[Track] = Track,
) -> list[Track | None]:
    """Return tracks with these keys, not empty, of any speed.

    positions_deg, times_us : (w, 2) and (w,) of all tracks; track i has the waypoints [way[i], way[i + 1])
    outline_m : (v, 2) of all tracks; track i has the corners [ring[i], ring[i + 1])
    members : fields of each besides key, positions, times and outline, with numbers of the right types
    """
    waypoints = Many(way)
    is_sound = plan_rules.courses(positions_deg, waypoints, times_us, waypoints).is_sound
    is_sound &= plan_rules.outlines(outline_m, Many(ring), lambda _: "outline_m").is_sound
    is_sound &= _have_sound_columns(_TRACK_COLUMNS, members) & _have_sound_heights(members)
    ways, rings = way.tolist(), ring.tolist()
    made: list[Track | None] = [None] * len(keys)
    for i in np.flatnonzero(is_sound).tolist():
        own, here = members[i], slice(ways[i], ways[i + 1])
        made[i] = _made(
            kind,
            {
                **_TRACK,
                "properties": {},
                **own,
                "key": keys[i],
                "positions_deg": positions_deg[here],
                "times_us": times_us[here],
                "outline_m": outline_m[rings[i] : rings[i + 1]],
            },
        )
    _leave_out(made, members, TRACK_FEW)
    return made


def _made(kind: type[_Made], values: Mapping[str, Any]) -> _Made:
    """Return an object whose values are not checked yet."""
    one = object.__new__(kind)
    keep = object.__setattr__
    for name, value in values.items():
        keep(one, name, value)
    return one


def _leave_out(made: list[_Made | None], members: Sequence[Mapping[str, Any]], columns: Sequence[FewColumns]) -> None:
    """Check the columns that few plans have; plans that break a rule become None."""
    fields = {name for few in columns for name in few.fields}
    some = [i for i, own in enumerate(members) if not fields.isdisjoint(own)]
    for few in columns:
        kept: dict[int, Any] = {}
        for i in some:
            one = made[i]
            if one is not None and few.is_of(one):
                try:
                    few.keep("", one)
                    kept[i] = one
                except InvalidInput:
                    made[i] = None
        if few.rules is not None and kept:
            is_sound = np.atleast_1d(few.rules(list(kept.values())).is_sound)
            for i in itertools.compress(list(kept), ~is_sound):
                made[i] = None
                del kept[i]
        if few.derive is not None:
            for one in kept.values():
                few.derive(one)


def _have_sound_columns(columns: Sequence[PlanColumn], members: Sequence[Mapping[str, Any]]) -> NDArray[np.bool_]:
    """Return (n,) whether the columns that need no other one break no rule."""
    is_sound = np.ones(len(members), np.bool_)
    for column in columns:
        if column.field in _GIVEN:
            continue
        rules = column.rules([own.get(column.field) for own in members])
        is_sound[list(rules)] = False
    return is_sound


def _have_sound_heights(members: Sequence[Mapping[str, Any]]) -> NDArray[np.bool_]:
    """Return (n,) whether heights of whole plans break no rule."""
    bounds = _bounds(members, "floor_m", "ceiling_m", np.float64)
    return np.asarray(plan_rules.heights(*bounds, Many.each(len(members))).is_sound)


def _bounds(
    members: Sequence[Mapping[str, Any]], first: str, last: str, dtype: type[Any]
) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return two bounds (n,) of each, 0 where there is none, and whether they are given (n,)."""
    given = [[own.get(name) for own in members] for name in (first, last)]
    lower, upper = (np.array([0 if one is None else one for one in column], dtype) for column in given)
    has_lower, has_upper = (np.array([one is not None for one in column], np.bool_) for column in given)
    return lower, upper, has_lower, has_upper
