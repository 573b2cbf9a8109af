"""Read what plans may meet in a stored scene, detected or not, with schedules expanded over the time of the question.

Pieces of schedules are stored only for the time over which a detection expanded them. If a question touches other
times, all objects with a schedule near the plans are read, expanded over its time and cut; so are objects that no
detection has expanded.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import psycopg

from conflictdb import store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core.members import Member, Members, by_kind
from conflictdb.core.world import World, has_schedules, horizon, is_beyond, touched
from conflictdb.errors import InvalidInput
from conflictdb.jobs.expansion import activations
from conflictdb.model.activations import INFINITY_US, MINUS_INFINITY_US
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.recurring_plans import Window
from conflictdb.model.results import Kind, SceneState


def world_of(
    conn: psycopg.Connection[Any], scene_id: int, settings: Scene, plans: Sequence[Area | Track]
) -> tuple[World, Window | None]:
    """Return the world of plans in a stored scene, and the time that they touch; raises InvalidInput.

    Plans with a schedule touch all of the time over which the scene's schedules are, or will be, expanded.
    """
    span = touched(plans, settings)
    known = expanded_for(conn, scene_id, settings, span) if has_schedules(plans) else None
    return World.of(settings, *by_kind(plans), known=known), known or span


def expanded_for(conn: psycopg.Connection[Any], scene_id: int, settings: Scene, span: Window | None) -> Window:
    """Return the time over which a question expands schedules: as far as the next detection does, and over its time."""
    known = store.horizon(conn, scene_id, is_asked=True)
    return horizon(settings, known.voyages, span, known=known.window)


def state_for(
    conn: psycopg.Connection[Any], settings: Scene, scene_id: int, plans: Sequence[Area | Track]
) -> tuple[SceneState, Window | None]:
    """Return the state of a scene for plans, and the window of its schedules; None: it has none.

    It is not current if a plan touches only times beyond the window.
    """
    state, window = store.scene_state(conn, settings.name), store.stored_window(conn, scene_id)
    if window is not None and any(is_beyond(touched([plan], settings), window) for plan in plans):
        state = _beyond(state, window)
    return state, window


def _beyond(state: SceneState, window: Window) -> SceneState:
    remark = "; ".join(filter(None, (state.remark, _expanded_text(window))))
    return replace(state, is_current=False, remark=remark, is_beyond_horizon=True)


def require_within(
    conn: psycopg.Connection[Any], scene_id: int, settings: Scene, plans: Sequence[Area | Track]
) -> None:
    """Raise InvalidInput for a plan without an end that touches only times beyond the window of schedules."""
    endless = [plan for plan in plans if _is_endless(touched([plan], settings))]
    window = store.stored_window(conn, scene_id) if endless else None
    if window is None:
        return
    for plan in endless:
        if is_beyond(touched([plan], settings), window):
            rule = f"is not known to be free: {_expanded_text(window)}: give an end, or the scene a larger horizon_days"
            raise InvalidInput(f"{'area' if isinstance(plan, Area) else 'track'} {plan.key!r}", "time", rule)


def _is_endless(span: Window | None) -> bool:
    return span is not None and (span[0] == MINUS_INFINITY_US) != (span[1] == INFINITY_US)


def _expanded_text(window: Window) -> str:
    first, last = (f"{np.datetime64(at_us, 'us').astype('datetime64[s]')}Z" for at_us in window)
    return f"schedules are expanded from {first} until {last} only (setting horizon_days)"


def read_members_near(
    conn: psycopg.Connection[Any],
    scene_id: int,
    world: World,
    span: Window | None,
    mine: Members,
    replaced: Collection[store.StoredObject],
) -> Members:
    """Return the objects that plans might meet, as they are stored, detected or not, but for those they replace.

    Which of their pieces meet is left to a source of pairs (`Together`): the database compares rows and rough pieces.

    span : the time that the plans touch
    """
    scene = world.setup.scene
    pieces = mine.pieces.longer(scene.longest_time_us, scene.longest_time_us)
    near = store.objects_near(conn, scene_id, scene, pieces, span)
    gone = {(one.kind, one.id) for one in replaced}
    return members(conn, scene_id, world, span, sorted(one for one in near if (one.kind, one.id) not in gone))


def members(
    conn: psycopg.Connection[Any],
    scene_id: int,
    world: World,
    span: Window | None,
    objects: Sequence[store.StoredObject],
) -> Members:
    """Return objects of a scene, cut; the schedules of those that are stale are expanded over the time of a question.

    An object whose schedule is not understood is covered.
    """
    if not objects:
        return Members.none()
    known = {(one.kind, one.id): Member(Kind.of_code(one.kind), one.key, one.name, None, one.owner) for one in objects}
    areas, tracks = store.read_objects(conn, scene_id, objects)
    stale = [one for one in objects if one.is_stale]
    if stale:
        window = span
        if window is None or window[0] == MINUS_INFINITY_US or window[1] == INFINITY_US:
            window = expanded_for(conn, scene_id, world.setup.scene, span)
        areas, tracks = _expanded(conn, scene_id, window, stale, areas, tracks)
    return Members.of_batches(world.setup, areas, tracks, known)


def _expanded(
    conn: psycopg.Connection[Any],
    scene_id: int,
    window: Window,
    stale: Sequence[store.StoredObject],
    areas: AreaBatch,
    tracks: TrackBatch,
) -> tuple[AreaBatch, TrackBatch]:
    """Return objects with the schedules of some expanded over a window."""
    ids = {kind: [one.id for one in stale if one.kind == kind.code] for kind in Kind}
    place = {
        kind: {number: row for row, number in enumerate(numbers.tolist())}
        for kind, numbers in ((Kind.AREA, areas.area_id), (Kind.TRACK, tracks.track_id))
    }
    found: dict[Kind, dict[int, Any]] = {kind: {} for kind in Kind}
    scheduled = store.scheduled(conn, scene_id, only_waiting=False, area_ids=ids[Kind.AREA], track_ids=ids[Kind.TRACK])
    for one in scheduled:
        instants_us, error = activations(one, window)
        if error is None and one.object_id in place[one.kind]:
            found[one.kind][place[one.kind][one.object_id]] = instants_us
    return (
        replace(areas, active=areas.active.but(found[Kind.AREA])) if found[Kind.AREA] else areas,
        replace(tracks, departs=tracks.departs.but(found[Kind.TRACK])) if found[Kind.TRACK] else tracks,
    )
