"""Expand schedules of areas and tracks to activations, as far as a horizon; `Schedule` expands one.

In memory: core/world.py. In a database: jobs/expansion.py, with `area_spans` and `track_departures`.
"""

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, Final, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model.activations import INFINITY_US, MINUS_INFINITY_US
from conflictdb.model.few_rules import departures
from conflictdb.model.inputs import all_certain, certain
from conflictdb.model.plan_rows import One
from conflictdb.model.plans import MAX_INSTANT_US, MIN_INSTANT_US, Area, Track
from conflictdb.model.tolerances import windows_later

Window = tuple[int, int]
_One = TypeVar("_One", Area, Track)

_DAY_US: Final = 86_400_000_000
_MOST_NAMED: Final = 3


def window_over(now_us: int, horizon_days: float, times: Iterable[Window], known: Window | None = None) -> Window:
    """Return the time [start, end) for which schedules are expanded: from today to the horizon, and over other times.

    times : [start, end) of all voyages, as far as they may touch anything
    known : the window so far, which the new one contains. Its end moves only when a tenth of the horizon has passed
    """
    today_us = now_us // _DAY_US * _DAY_US
    horizon_us = round(horizon_days * _DAY_US)
    ahead_us = today_us + _DAY_US + horizon_us
    starts, ends = [today_us if known is None else known[0]], [ahead_us if known is None else known[1]]
    if known is not None and known[1] < now_us + 0.9 * horizon_us:
        ends.append(ahead_us)
    for start_us, end_us in times:
        starts.append(start_us)
        ends.append(end_us)
    return max(min(starts), MIN_INSTANT_US), min(max(ends), MAX_INSTANT_US)


def later(one: _One, by_us: int) -> _One:
    """Return an area or track with all its activations later by some microseconds, without its schedule.

    The windows of a track are as much later.
    """
    if isinstance(one, Track):
        times: Any = all_certain(one.times_us + by_us)
        departs: Any = None if one.departures_us is None else all_certain(np.array(one.departures_us, np.int64) + by_us)
        tolerances = None if one.tolerances is None else windows_later(one.tolerances, by_us)
        return replace(
            one, times_us=times, departures_us=departs, schedule=None, tolerances=tolerances, max_speed_kn=np.inf
        )
    moved: Any = [[certain(None if at is None else at + by_us) for at in pair] for pair in spans_of(one)]
    if one.spans_us is None:
        return replace(one, start_us=moved[0][0], end_us=moved[0][1], schedule=None)
    return replace(one, start_us=None, end_us=None, spans_us=moved, schedule=None)


def spans_of(area: Area) -> tuple[tuple[int | None, int | None], ...]:
    """Return when an area is active, microseconds; its schedule is expanded."""
    return ((area.start_us, area.end_us),) if area.spans_us is None else area.spans_us


def require_one_voyage(who: str, field: str, tracks: Iterable[Track]) -> None:
    """Raise InvalidInput for a track with departures, which a question about one voyage does not understand."""
    for track in tracks:
        if track.departures_us is not None or track.schedule is not None:
            rule = f"is for one voyage: track {track.key!r} has departures of its own; store each voyage as a track"
            raise InvalidInput(who, field, rule)


def expanded_area(area: Area, window: Window) -> Area:
    """Return an area with the spans of its schedule in a window, cut by its start and end, or an area without one.

    A stored area whose schedule is not understood has none (`has_unknown_times`); of any other raises InvalidInput.
    """
    if area.schedule is None:
        return area
    try:
        spans = area_spans(f"area {area.key!r}", area.schedule, (area.start_us, area.end_us), area.footprint, window)
    except Exception:  # whatever a row contains must not stop other objects
        if not area.is_stored:
            raise
        return _made(area, spans_us=None)
    return _made(area, spans_us=tuple((start, end) for start, end in spans.tolist()))


def expanded_track(track: Track, window: Window) -> Track:
    """Return a track with the departures of its schedule whose voyages share time with a window, or one without.

    As `expanded_area` if the schedule is not understood.
    """
    if track.schedule is None:
        return track
    lasts_us = int(track.times_us[-1] - track.times_us[0])
    try:
        departs = track_departures(f"track {track.key!r}", track.schedule, lasts_us, track.positions_deg[0], window)
    except Exception:
        if not track.is_stored:
            raise
        return _made(track, departures_us=None)
    return _made(track, departures_us=tuple(departs.tolist()))


def unknown_text(who: Sequence[str]) -> str:
    """Return that the schedules of some stored objects, as `area 'A'`, are not understood."""
    return f"{_named(who)}: schedule is not understood, or not expanded; pairs with it are unresolved"


def _named(who: Sequence[str]) -> str:
    return ", ".join(who[:_MOST_NAMED]) + (f" and {len(who) - _MOST_NAMED:,} more" * (len(who) > _MOST_NAMED))


def idle_text(who: Sequence[str], window: Window) -> str:
    """Return that the schedules of some objects, as `area 'A'`, have no activation in a window."""
    start, end = (f"{np.datetime64(at_us, 'us').astype('datetime64[m]')}Z" for at_us in window)
    return f"{_named(who)}: no activation of the schedule from {start} until {end}, as far as schedules are expanded"


def area_spans(
    who: str, schedule: Any, outer_us: tuple[int | None, int | None], footprint: shapely.Geometry, window: Window
) -> NDArray[np.int64]:
    """Return the spans (n, 2) of an area's schedule; raises InvalidInput.

    outer_us : start and end of the area, None if unbounded
    """
    from conflictdb.model.schedules import schedule_of

    low = max(window[0], MINUS_INFINITY_US if outer_us[0] is None else outer_us[0])
    high = min(window[1], INFINITY_US if outer_us[1] is None else outer_us[1])
    if low >= high:
        schedule_of(who, schedule)
        return np.empty((0, 2), np.int64)
    return schedule_of(who, schedule).expand(low, high, _places(footprint))


def track_departures(
    who: str, schedule: Any, lasts_us: int, first_deg: NDArray[np.float64], window: Window
) -> NDArray[np.int64]:
    """Return the departures (n,) of a track's schedule; raises InvalidInput, also for voyages that overlap.

    lasts_us : how long a voyage takes
    first_deg : (2,) its first waypoint
    """
    from conflictdb.model.schedules import schedule_of

    low = max(window[0] - lasts_us, MIN_INSTANT_US)
    found = schedule_of(who, schedule).departures(low, min(window[1], MAX_INSTANT_US - lasts_us), first_deg[None])
    try:
        departures(found, One(len(found)), lasts_us).raise_for(0, who)
    except InvalidInput as error:
        raise InvalidInput(who, "schedule", error.rule.replace("is before", "has a departure before")) from None
    return found


def _places(footprint: shapely.Geometry) -> NDArray[np.float64]:
    """Return the middle of a footprint's box and its corners."""
    west, south, east, north = shapely.bounds(footprint)
    middle = 0.5 * (west + east), 0.5 * (south + north)
    return np.array([middle, (west, south), (west, north), (east, south), (east, north)])


def _made(one: _One, **expansion: Any) -> _One:
    """Return a copy of a checked object with its expansion."""
    made = copy(one)
    for name, value in expansion.items():
        object.__setattr__(made, name, value)
    return made
