"""Probe a plan that a page moved, and store it: in its scene, or in a branch of it."""

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import psycopg

from conflictdb import store
from conflictdb.client import loading
from conflictdb.core.conflicts_between import conflicts_between
from conflictdb.core.members import Members
from conflictdb.core.world import Reach, World
from conflictdb.errors import ConflictDBError, InvalidInput
from conflictdb.formats.scene_file import feature_of
from conflictdb.jobs import probes
from conflictdb.jobs.detect import detect
from conflictdb.jobs.plans_near import read_around
from conflictdb.map.content import to_json
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.recurring_plans import later
from conflictdb.model.results import Conflict


@dataclass(frozen=True, slots=True)
class PlanMove:
    """A move of a track.

    plan : digest of the track that the page moved
    later_us, up_m : how much later it departs, and how much higher it is
    waypoint : number from 0, longitude and latitude of a waypoint, or None
    branch : name of a new branch for it; None: in the scene
    """

    key: str
    plan: str
    later_us: int
    up_m: float
    waypoint: tuple[int, float, float] | None
    branch: str | None


def digest(track: Track) -> str:
    """Return a digest of all that a track is, for `PlanMove.plan`."""
    return hashlib.sha256(to_json(feature_of(track))).hexdigest()


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
    heights: dict[str, Any] = {
        name: None if end is None else end + up_m for name in ("floor_m", "ceiling_m") for end in [getattr(track, name)]
    }
    for name in ("floors_m", "ceilings_m"):
        if (each := getattr(track, name)) is not None:
            heights[name] = each + up_m
    return heights


def probed(conn: psycopg.Connection[Any], scene: str, move: PlanMove) -> list[tuple[Any, ...]]:
    """Return the conflicts that a moved track would have: other key, verdict, error, and periods (Unix seconds).

    By the stages of a detection. Raises as `put`, and StoreError if a transaction is open; stores nothing.
    """
    track = _seen(conn, scene, move)
    if track.schedule is not None and move.later_us:
        track = _expanded(conn, scene, track, move.later_us)
    track = moved(track, move)
    is_branch = store.parent_name(conn, store.scene_or_branch_id(conn, scene)) is not None
    found = _met(*read_around(conn, scene, track), track) if is_branch else probes.probe(conn, scene, [track])
    return [
        (
            one.b_key if one.a_key == move.key else one.a_key,
            str(one.verdict),
            one.time_error_s,
            [[None if end is None else end.timestamp() for end in period] for period in one.periods],
        )
        for one in found
        if one.periods
    ]


def _expanded(conn: psycopg.Connection[Any], scene: str, track: Track, later_us: int) -> Track:
    """Return a track with the departures of its schedule instead of it, as far as the page expands it."""
    number = store.scene_or_branch_id(conn, scene)
    settings, known = store.read_settings(conn, number), store.stored_window(conn, number)
    world = World.of(settings, [], [track], reach=Reach.either(abs(later_us)), known=known)
    return later(world.expanded([], [track])[1][0], 0)


def _met(settings: Scene, areas: list[Area], tracks: list[Track], track: Track) -> list[Conflict]:
    """Return the conflicts of a track with objects, of which one may have its key."""
    tracks = [one for one in tracks if one.key != track.key]
    world = World.of(settings, areas, [*tracks, track])
    others: list[Area | Track] = [*areas, *tracks]
    if not others:
        return []
    return conflicts_between(world.setup, Members.of_plans(world, [track]), Members.of_plans(world, others))


def _seen(conn: psycopg.Connection[Any], scene: str, move: PlanMove) -> Track:
    """Return the track that a page moved; InvalidInput if it is not known, or another one by now."""
    _, _, tracks = store.read_scene(conn, scene, [move.key])
    if not tracks:
        raise InvalidInput(f"scene {scene!r}", "track", f"{move.key!r} is not known")
    if digest(tracks[0]) != move.plan:
        raise InvalidInput(f"track {move.key!r}", "plan", "was changed meanwhile: look at it again")
    return tracks[0]


def put(conn: psycopg.Connection[Any], scene: str, move: PlanMove) -> str:
    """Store a moved track, and detect its conflicts if the user may; return its digest.

    Raises InvalidInput if the track changed since, or is not known, and NotPermitted.
    """
    with store.transaction(conn):
        target = scene
        if move.branch is not None:
            store.create_branch(conn, scene, move.branch, None)
            target = move.branch
        loading.put(conn, target, [moved(_seen(conn, target, move), move)], None)
        _, _, (stored,) = store.read_scene(conn, target, [move.key])
    try:
        store.require_detecting(conn)
        detect(conn, target, jobs=1)
    except ConflictDBError:
        pass  # a worker does, or the page says that changes wait
    return digest(stored)
