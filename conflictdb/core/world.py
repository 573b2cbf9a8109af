"""Prepare a question once: which times it may touch, the plane, the activations of schedules, the pieces.

`touched` gives the times. `World.of` checks plans and fixes the plane and the time over which schedules are expanded.
`occupy` cuts plans into pieces, `near` returns their pairs, and `run` the conflicts of these.
"""

import time
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.pieces.cutting import check_plane
from conflictdb.earth.registry import Setup, centred
from conflictdb.errors import IncompleteWarning, UnknownScheduleWarning
from conflictdb.model.plans import (
    INFINITY_US,
    MAX_INSTANT_US,
    MIN_INSTANT_US,
    MINUS_INFINITY_US,
    Area,
    Scene,
    Track,
    check_datums,
    check_keys,
    has_unknown_times,
    is_idle,
)
from conflictdb.model.recurring_plans import (
    Window,
    expanded_area,
    expanded_track,
    idle_text,
    spans_of,
    unknown_text,
    window_over,
)
from conflictdb.model.results import Kind
from conflictdb.model.tolerances import tolerances_of

_NO_AREAS: Final = AreaBatch.of([])
_NO_TRACKS: Final = TrackBatch.of([])


class Reach(NamedTuple):
    """How far a question moves plans from their planned times.

    earlier_us, later_us : the most that a plan is earlier or later anywhere: delays, waits, longer ways
    slowest : the least speed, a factor of the planned one, at most 1
    """

    earlier_us: int = 0
    later_us: int = 0
    slowest: float = 1.0

    @classmethod
    def either(cls, most_us: int) -> Self:
        """Return that of plans that are up to `most_us` earlier or later."""
        return cls(most_us, most_us)


AS_PLANNED: Final = Reach()


def touched(plans: Iterable[Area | Track], scene: Scene, reach: Reach = AS_PLANNED) -> Window | None:
    """Return the time [start, end) in which plans may touch anything, microseconds; None if they have no time.

    From the first departure to the last arrival of tracks within their tolerances, and from start to end of areas; as
    much earlier and later as `reach` allows, and by the scene's largest separation in time. Plans with a schedule count
    nothing: they touch all times for which schedules are expanded. Areas without a start or end give MINUS_INFINITY_US
    or INFINITY_US.
    """
    start_us, end_us = INFINITY_US, MINUS_INFINITY_US
    for plan in plans:
        if plan.schedule is None:
            first_us, last_us = _area_span(plan) if isinstance(plan, Area) else _track_span(plan, reach.slowest)
            if first_us <= last_us:
                start_us, end_us = min(start_us, first_us), max(end_us, last_us)
    if start_us > end_us:
        return None
    within_us = scene.longest_time_us
    return _shifted(start_us, -reach.earlier_us - within_us), _shifted(end_us, reach.later_us + within_us + 1)


def hull(*spans: Window | None) -> Window | None:
    """Return the time from the first start to the last end."""
    known = [span for span in spans if span is not None]
    if len(known) < 2:
        return known[0] if known else None
    starts, ends = zip(*known, strict=True)
    return min(starts), max(ends)


def _area_span(area: Area) -> Window:
    """Return the first start and the last end of an area; an area that is never active begins after it ends."""
    spans = spans_of(area)
    if not spans:
        return INFINITY_US, MINUS_INFINITY_US
    start, end = spans[0][0], spans[-1][1]
    return MINUS_INFINITY_US if start is None else start, INFINITY_US if end is None else end


def _track_span(track: Track, slowest: float) -> Window:
    """Return the first departure and the last arrival of a track; one that never sails departs after it arrives."""
    departs, first_us, last_us = track.departures_us, int(track.times_us[0]), int(track.times_us[-1])
    sails_us = first_us
    if departs is not None:
        if not departs:
            return INFINITY_US, MINUS_INFINITY_US
        first_us, sails_us, last_us = departs[0], departs[-1], departs[-1] + last_us - first_us
    if track.tolerances is not None:
        limits = tolerances_of(f"track {track.key!r}", track.tolerances, track.times_us)
        first_us = min(first_us, int(limits.departure_us[0]))
        last_us = max(last_us, limits.latest_arrival_us(track.positions_deg, track.times_us))
    if slowest < 1.0:
        last_us = sails_us + int(np.ceil((last_us - sails_us) / slowest)) + 1
    return first_us, last_us


def _shifted(at_us: int, by_us: int) -> int:
    """Return an instant later, within the years of schedules; infinite ones stay."""
    if MINUS_INFINITY_US < at_us < INFINITY_US:
        return min(max(at_us + by_us, MIN_INSTANT_US), MAX_INSTANT_US)
    return at_us


def has_schedules(plans: Iterable[Area | Track]) -> bool:
    """Return whether a plan has a schedule."""
    return any(plan.schedule is not None for plan in plans)


@dataclass(frozen=True, slots=True)
class World:
    """Where and when a question is decided.

    setup : settings with a centre, and the plane
    window : the time [start, end) over which `occupy` expands schedules; None: the plans have none
    """

    setup: Setup
    window: Window | None = None

    @classmethod
    def around(cls, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Self:
        """Return the world of objects that need no expansion; a centre that is needed follows from them."""
        return cls(Setup.of(centred(scene, areas, tracks)))

    @classmethod
    def of(
        cls,
        scene: Scene,
        areas: Sequence[Area],
        tracks: Sequence[Track],
        *,
        reach: Reach = AS_PLANNED,
        now_us: int | None = None,
        known: Window | None = None,
        moved: Sequence[Area] = (),
    ) -> Self:
        """Return the world of objects; schedules are expanded from today to the horizon, and over all voyages.

        reach : how far a question moves tracks
        now_us : today; None: by the clock
        known : the window so far, which the new one contains
        moved : areas that the question moves as far as the tracks
        """
        plans: list[Area | Track] = [*areas, *tracks]
        check_keys([plan.key for plan in plans])
        check_datums(scene, plans)
        window = known
        if has_schedules(plans):
            # Activations of a schedule move to the times of all others.
            beside = areas if has_schedules(moved) else moved
            window = horizon(scene, touched([*tracks, *beside], scene, reach), now_us=now_us, known=known)
        return cls(Setup.of(centred(scene, areas, tracks)), window)

    def expanded(self, areas: Sequence[Area], tracks: Sequence[Track]) -> tuple[list[Area], list[Track]]:
        """Return areas and tracks with the activations of their schedules in the window.

        Raises InvalidInput for a schedule that cannot be expanded, unless the object is stored: its times are unknown.
        """
        if self.window is None:
            return list(areas), list(tracks)
        window = self.window
        return [expanded_area(area, window) for area in areas], [expanded_track(track, window) for track in tracks]

    def fit(self, areas: Sequence[Area], tracks: Sequence[Track]) -> tuple[NDArray[np.object_], TrackBatch | None]:
        """Raise InvalidInput for the first object that does not fit the plane; return as `check_plane`."""
        return check_plane(self.setup.plane, areas, tracks)


def horizon(scene: Scene, *spans: Window | None, now_us: int | None = None, known: Window | None = None) -> Window:
    """Return the time over which the schedules of a scene are expanded: `window_over`, and times that are touched."""
    ends = [(end, end) for span in spans for end in span or () if MINUS_INFINITY_US < end < INFINITY_US]
    return window_over(time.time_ns() // 1000 if now_us is None else now_us, scene.horizon_days, ends, known)


def is_within(span: Window | None, window: Window | None) -> bool:
    """Return whether the bounded ends of what plans touch lie in the time over which schedules are expanded.

    span : as of `touched`; window : None: there are no schedules
    """
    if span is None or window is None:
        return True
    return all(window[0] <= end <= window[1] for end in span if MINUS_INFINITY_US < end < INFINITY_US)


def is_beyond(span: Window | None, window: Window) -> bool:
    """Return whether plans without an end, or without a start, touch only times without expanded schedules."""
    if span is None:
        return False
    (start, end), (first, last) = span, window
    return (end == INFINITY_US and start >= last) or (start == MINUS_INFINITY_US and end <= first)


class Occupied(NamedTuple):
    """Objects and their pieces, which number the objects of each kind from 0 in this order.

    areas, tracks : with the activations of their schedules
    batches : the same as arrays
    """

    areas: list[Area]
    tracks: list[Track]
    batches: tuple[AreaBatch, TrackBatch]
    pieces: Pieces

    def plans(self) -> list[Area | Track]:
        """Return areas and tracks."""
        return [*self.areas, *self.tracks]

    def named(self) -> dict[tuple[int, int], tuple[str, str | None]]:
        """Return keys and names, by the code of a kind and the number of an object."""
        named = {(Kind.AREA.code, n): (area.key, area.name) for n, area in enumerate(self.areas)}
        return named | {(Kind.TRACK.code, n): (track.key, track.name) for n, track in enumerate(self.tracks)}


def occupy(
    world: World, areas: Sequence[Area], tracks: Sequence[Track], *, is_lenient: bool = False, warns: bool = False
) -> Occupied:
    """Expand the schedules of objects and cut them into pieces.

    is_lenient : cover objects that do not fit the plane, as a detection does; else they raise InvalidInput
    warns : issue an IncompleteWarning for schedules without an activation

    Raises InvalidInput for a schedule that cannot be expanded. A stored object with one is covered wherever it may be,
    and named by an UnknownScheduleWarning.
    """
    areas, tracks = world.expanded(areas, tracks)
    warn_of_unknown([*areas, *tracks])
    if warns and world.window is not None:
        _warn_of_idle(areas, tracks, world.window)
    if is_lenient:
        batches = AreaBatch.of(areas), TrackBatch.of(tracks)
    else:
        flat, once = world.fit(areas, tracks)
        made = AreaBatch.of(areas, flat) if areas else _NO_AREAS
        batches = made, _NO_TRACKS if once is None else once.departing(tracks)
    return Occupied(areas, tracks, batches, pieces_of(world.setup, *batches))


def warn_of_unknown(plans: Sequence[Area | Track]) -> None:
    """Issue an UnknownScheduleWarning that names stored objects whose schedules are not understood."""
    if unknown := [_who(one) for one in plans if has_unknown_times(one)]:
        warnings.warn(unknown_text(unknown), UnknownScheduleWarning, stacklevel=4)


def _who(plan: Area | Track) -> str:
    return f"{'area' if isinstance(plan, Area) else 'track'} {plan.key!r}"


def _warn_of_idle(areas: Sequence[Area], tracks: Sequence[Track], window: Window) -> None:
    plans: list[Area | Track] = [*areas, *tracks]
    if idle := [_who(one) for one in plans if is_idle(one)]:
        warnings.warn(idle_text(idle, window), IncompleteWarning, stacklevel=4)
