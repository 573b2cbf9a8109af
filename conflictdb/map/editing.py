"""Probe a plan that a page moved, and store it: in its scene, or in a branch of it."""

import hashlib
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import psycopg

from conflictdb import store
from conflictdb.client import loading
from conflictdb.core.conflicts_between import conflicts_between
from conflictdb.core.members import Members
from conflictdb.core.moving_plans import dragged
from conflictdb.core.world import Reach, World
from conflictdb.errors import ConflictDBError, InvalidInput
from conflictdb.formats.scene_file import feature_of
from conflictdb.jobs import probes
from conflictdb.jobs.detect import detect
from conflictdb.jobs.plans_near import read_around
from conflictdb.map.content import to_json
from conflictdb.model.margin import NO_MARGIN, Margin
from conflictdb.model.plan_columns import HEIGHT_LIMITS
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.recurring_plans import later
from conflictdb.model.results import Conflict


@dataclass(frozen=True, slots=True)
class PlanMove:
    """A move of a plan.

    plan : digest of the plan that the page moved
    later_us, up_m : how much later a track departs, and how much higher it is
    waypoint : number from 0, longitude and latitude of a waypoint of a track, or None
    branch : name of a new branch for it; None: in the scene
    shift_deg : longitude and latitude of a place of an area, and where that place goes; None: nowhere
    starts_us, ends_us : how much later an area becomes active, and ends
    """

    key: str
    plan: str
    later_us: int
    up_m: float
    waypoint: tuple[int, float, float] | None
    branch: str | None
    shift_deg: tuple[float, ...] | None = None
    starts_us: int = 0
    ends_us: int = 0


def digest(plan: Area | Track) -> str:
    """Return a digest of all that a plan is, for `PlanMove.plan`."""
    return hashlib.sha256(to_json(feature_of(plan))).hexdigest()


def described(conn: psycopg.Connection[Any], scene: str, key: str) -> dict[str, Any]:
    """Return an object as a feature, and its digest for `PlanMove.plan`; InvalidInput if it is not known."""
    _, plan = _known(conn, scene, key)
    return {"feature": feature_of(plan), "plan": digest(plan)}


def _moved(settings: Scene, plan: Area | Track, move: PlanMove) -> Area | Track:
    """Return the plan of a scene as a page moved it; raises InvalidInput if that is no plan."""
    of_area = bool(move.shift_deg or move.starts_us or move.ends_us)
    of_track = bool(move.later_us or move.up_m or move.waypoint)
    if isinstance(plan, Track):
        if of_area:
            raise InvalidInput(
                f"track {plan.key!r}", "move", "must be of its times, heights or waypoints; got a move of an area"
            )
        return moved(plan, move)
    if of_track:
        raise InvalidInput(
            f"area {plan.key!r}", "move", "must be of its place, or of the ends of its times; got a move of a track"
        )
    return moved_area(plan, move, settings)


def moved_area(area: Area, move: PlanMove, settings: Scene) -> Area | Track:
    """Return an area elsewhere, as `probe --move` has it, active from and until other instants."""
    if move.starts_us or move.ends_us:
        if area.schedule is not None or area.spans_us is not None:
            raise InvalidInput(f"area {area.key!r}", "times", "are several, or a schedule: change these instead")
        start_us, end_us = (
            None if at is None else at + by for at, by in ((area.start_us, move.starts_us), (area.end_us, move.ends_us))
        )
        area = replace(area, start_us=start_us, end_us=end_us)
    if move.shift_deg is not None:
        return dragged(area, move.shift_deg[:2], move.shift_deg[2:], settings)
    return area


def moved(track: Track, move: PlanMove) -> Track:
    """Return the track as a page moved it; raises InvalidInput if that is no track."""
    if move.later_us:
        if track.schedule is not None:
            raise InvalidInput(f"track {track.key!r}", "schedule", "says when it departs: change it instead")
        track = later(track, move.later_us)
    if move.up_m:
        track = replace(track, **_higher(track, move.up_m), max_speed_kn=np.inf)
    if move.waypoint is not None:
        number, *place = move.waypoint
        if number >= len(track.positions_deg):
            raise InvalidInput(f"track {track.key!r}", "waypoint", f"must be below {len(track.positions_deg)}")
        places = np.array(track.positions_deg)
        places[number] = place
        track = replace(track, positions_deg=places, max_speed_kn=np.inf)
    return track


def _higher(track: Track, up_m: float) -> dict[str, Any]:
    """Return the heights of a track that is so much higher."""
    return {
        name: height + up_m
        for one in HEIGHT_LIMITS
        for name in (one.whole, one.of_legs)
        if (height := getattr(track, name)) is not None
    }


def probed(conn: psycopg.Connection[Any], scene: str, move: PlanMove, margin: Margin = NO_MARGIN) -> dict[str, Any]:
    """Return the `conflicts` that a moved plan would have: other key, verdict, error, and periods (Unix seconds).

    Without conflicts, `nearer` has the keys of the objects within the margin of it. By the stages of a detection.
    Raises as `put`, and StoreError if a transaction is open; stores nothing.
    """
    settings, plan = _seen(conn, scene, move)
    if isinstance(plan, Track) and plan.schedule is not None and move.later_us:
        plan = _expanded(conn, scene, plan, move.later_us)
    plan = _moved(settings, plan, move)
    is_branch = store.parent_name(conn, store.scene_or_branch_id(conn, scene)) is not None
    found = _met(*read_around(conn, scene, plan), plan) if is_branch else probes.probe(conn, scene, [plan])
    conflicts = [
        (
            _other(one, plan),
            str(one.verdict),
            one.time_error_s,
            [[None if end is None else end.timestamp() for end in period] for period in one.periods],
        )
        for one in found
        if one.periods
    ]
    nearer = _within(conn, scene, plan, margin) if margin and not conflicts else []
    return {"conflicts": conflicts, "nearer": nearer}


def _within(conn: psycopg.Connection[Any], scene: str, plan: Area | Track, margin: Margin) -> list[str]:
    """Return the keys of the objects that a plan comes nearer to than the separations and a margin."""
    settings, areas, tracks = read_around(conn, scene, plan, margin)
    found = _met(margin.added_to(settings), areas, tracks, plan)
    return sorted(_other(one, plan) for one in found if one.periods)


def _other(conflict: Conflict, plan: Area | Track) -> str:
    return conflict.b_key if conflict.a_key == plan.key else conflict.a_key


def _expanded(conn: psycopg.Connection[Any], scene: str, track: Track, later_us: int) -> Track:
    """Return a track with the departures of its schedule instead of it, as far as the page expands it."""
    number = store.scene_or_branch_id(conn, scene)
    settings, known = store.read_settings(conn, number), store.stored_window(conn, number)
    world = World.of(settings, [], [track], reach=Reach.either(abs(later_us)), known=known)
    return later(world.expanded([], [track])[1][0], 0)


def _met(settings: Scene, areas: list[Area], tracks: list[Track], plan: Area | Track) -> list[Conflict]:
    """Return the conflicts of a plan with objects, of which one may have its key."""
    known: list[Area | Track] = [*areas, *tracks]
    others = [one for one in known if one.key != plan.key]
    if not others:
        return []
    every = [*others, plan]
    world = World.of(
        settings, [one for one in every if isinstance(one, Area)], [one for one in every if isinstance(one, Track)]
    )
    return conflicts_between(world.setup, Members.of_plans(world, [plan]), Members.of_plans(world, others))


def _known(conn: psycopg.Connection[Any], scene: str, key: str) -> tuple[Scene, Area | Track]:
    """Return the settings of a scene and an object; InvalidInput if it is not known."""
    settings, areas, tracks = store.read_scene(conn, scene, [key])
    plans: list[Area | Track] = [*areas, *tracks]
    if plans:
        return settings, plans[0]
    raise InvalidInput(f"scene {scene!r}", "object", f"{key!r} is not known")


def _seen(conn: psycopg.Connection[Any], scene: str, move: PlanMove) -> tuple[Scene, Area | Track]:
    """Return the settings of a scene and the plan that a page moved; InvalidInput if it is not known, or changed."""
    settings, plan = _known(conn, scene, move.key)
    if digest(plan) != move.plan:
        kind = "area" if isinstance(plan, Area) else "track"
        raise InvalidInput(f"{kind} {move.key!r}", "plan", "was changed meanwhile: look at it again")
    return settings, plan


# What may be done with a branch.
BRANCH_ENDS: Final = ("merge", "drop")


def end_branch(conn: psycopg.Connection[Any], branch: str, does: str) -> str:
    """Merge a branch into its parent, which is detected if the user may, or drop it; return the name of the parent.

    Raises InvalidInput if it is no branch, or objects were changed on both sides, and NotPermitted.
    """
    parent = store.parent_name(conn, store.scene_or_branch_id(conn, branch))
    if parent is None:
        raise InvalidInput(f"scene {branch!r}", "branch", "is no branch")
    if does == "drop":
        store.drop_branch(conn, branch)
    else:
        store.merge_branch(conn, branch)
        _detect(conn, parent)
    return parent


def _detect(conn: psycopg.Connection[Any], scene: str) -> None:
    try:
        store.require_detecting(conn)
        detect(conn, scene, jobs=1)
    except ConflictDBError:
        pass  # a worker does, or the page says that changes wait


def put(conn: psycopg.Connection[Any], scene: str, move: PlanMove) -> str:
    """Store a moved plan, and detect its conflicts if the user may; return its digest.

    Raises InvalidInput if the plan changed since, or is not known, and NotPermitted.
    """
    with store.transaction(conn):
        target = scene
        if move.branch is not None:
            store.create_branch(conn, scene, move.branch, None)
            target = move.branch
        loading.put(conn, target, [_moved(*_seen(conn, target, move), move)], None)
        _, stored = _known(conn, target, move.key)
    _detect(conn, target)
    return digest(stored)
