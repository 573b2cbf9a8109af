"""Read the plans of a stored scene that a plan, stored or not, may meet, as objects: a question then runs in memory.

`read_members_near` reads their pieces instead, for probes and admission.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import psycopg

from conflictdb import store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces, level_m
from conflictdb.core.margins import widened
from conflictdb.core.near import Question
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.world import Reach, has_schedules, is_within, touched
from conflictdb.earth.registry import Setup
from conflictdb.model.margin import NO_MARGIN, Margin
from conflictdb.model.plans import Area, Scene, Track


def read_departing(
    conn: psycopg.Connection[Any],
    scene: str,
    key: str,
    within_s: float,
    within_m: float = 0.0,
    *,
    at_any_height: bool = False,
) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene, a track, and what it may meet if it departs up to `within_s` earlier or later.

    within_m : also what it may come within this of, beyond the separations, metres
    at_any_height : also what is at other heights

    Without the track the scene has none of this key. Raises InvalidInput if the scene does not exist.
    """
    most_us = round(1e6 * within_s)
    question = Question(earlier_us=most_us, later_us=most_us, any_height=at_any_height)
    return read_if_moved(conn, scene, key, lambda _: question, within_m)


def read_near(
    conn: psycopg.Connection[Any], scene: str, key: str, within_m: float
) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene, an object, and the others within a distance of it, metres, at its times and heights.

    Without the object the scene has none of this key. Raises InvalidInput if the scene does not exist.
    """

    def keys() -> list[str]:
        _, areas, tracks = store.read_scene(conn, scene, [key])
        plans: list[Area | Track] = [*areas, *tracks]
        return [one for plan in plans for one in _around(conn, scene, plan, Question(), within_m)] + [key]

    return _read(conn, scene, keys)


def read_around(
    conn: psycopg.Connection[Any], scene: str, plan: Area | Track, margin: Margin = NO_MARGIN
) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene and what a plan, stored or not, may meet with a margin.

    Raises InvalidInput if the scene does not exist.
    """
    question = Question(earlier_us=margin.time_us, later_us=margin.time_us)
    return _read(conn, scene, lambda: _around(conn, scene, plan, question, margin.distance_m))


def read_if_moved(
    conn: psycopg.Connection[Any],
    scene: str,
    key: str | None,
    question: Callable[[Area | Track], Question],
    within_m: float = 0.0,
) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene and what an object may meet, or come within a distance of, if it is at other times; None: all.

    All objects, if the pieces of the scene are not current. Raises InvalidInput if the scene does not exist.
    """

    def keys() -> list[str] | None:
        if key is None:
            return None
        _, areas, tracks = store.read_scene(conn, scene, [key])
        plans: list[Area | Track] = [*areas, *tracks]
        return [one for plan in plans for one in _around(conn, scene, plan, question(plan), within_m)] + [key]

    return _read(conn, scene, keys)


def _read(
    conn: psycopg.Connection[Any], scene: str, keys: Callable[[], list[str] | None]
) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene and the objects of some keys, None: all; also all if its pieces are not current."""
    with store.snapshot(conn):
        return store.read_scene(conn, scene, keys() if store.scene_state(conn, scene).is_current else None)


def _around(
    conn: psycopg.Connection[Any], scene: str, plan: Area | Track, question: Question, within_m: float = 0.0
) -> list[str]:
    """Return the keys of the objects whose boxes a plan may meet, or come near to, in all layers of a scene.

    Beyond the time over which schedules are expanded, also all objects with a schedule near it.
    """
    number = store.scene_or_branch_id(conn, scene)
    settings = store.read_settings(conn, number)
    parent = store.parent_name(conn, number)
    layers = [number] if parent is None else [number, store.scene_id(conn, parent)]
    pieces = _reaching(settings, plan, question, within_m)
    keys = [one for layer in layers for one in store.keys_meeting(conn, layer, pieces, plan.key)]
    span, window = touched([plan], settings, Reach.either(question.within_us)), store.stored_window(conn, number)
    if has_schedules([plan]) or not is_within(span, window):
        # It may have no voyage in the window.
        pieces = _reaching(settings, plan, question, within_m, once=True)
        keys += [one for layer in layers for one in store.scheduled_keys_near(conn, layer, pieces)]
    return keys


def _reaching(
    settings: Scene, plan: Area | Track, question: Question, within_m: float, *, once: bool = False
) -> Pieces:
    """Return pieces of a plan whose boxes meet those of all that it may meet, or come near to, as asked."""
    wide = widened(settings, settings.largest_separation_m + within_m) if within_m else settings
    areas, tracks = ([plan], []) if isinstance(plan, Area) else ([], [plan])
    pieces = pieces_of(Setup.of(wide), AreaBatch.of(areas), TrackBatch.of(tracks, once=once))
    horizon_us = question.within_us + settings.longest_time_us
    pieces = replace(pieces.longer(horizon_us, horizon_us), end_inclusive=np.ones(len(pieces), np.bool_))
    if not question.any_height:
        return pieces
    all_m = np.full(len(pieces), np.inf)
    return replace(pieces, floor_m=-all_m, ceiling_m=all_m, climb_m=level_m(-all_m, all_m))
