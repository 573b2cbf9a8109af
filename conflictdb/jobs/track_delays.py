"""Delays and speeds of the tracks of a stored scene: read what they may meet, and compute in memory.

`difference_rows` keeps the stored delays current.
"""

import math
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
from conflictdb.memory import questions
from conflictdb.model import inputs
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Delays, Speeds


def delays(
    conn: psycopg.Connection[Any],
    scene: str,
    key: str | None,
    within_s: float,
    now: inputs.Instant | None = None,
    clear_within_m: float | None = None,
    waypoint: int | None = None,
) -> list[Delays]:
    """Return the delays of a track, or of each track, from one state of the objects, or of the stored differences.

    Raises InvalidInput if the scene or the track does not exist.
    """
    with store.snapshot(conn):
        if waypoint is None and clear_within_m is None:
            horizon_us, now_us = questions.horizon_and_now(within_s, now)
            known = store.stored_delays(conn, store.scene_or_branch_id(conn, scene), key, horizon_us, now_us)
            if known:
                return known
        most_us = round(1e6 * within_s)
        question = Question(earlier_us=most_us, later_us=most_us, within_m=clear_within_m or 0.0)
        settings, areas, tracks = _read(conn, scene, key, lambda _: question)
        window = store.stored_window(conn, store.scene_or_branch_id(conn, scene))
    return questions.delays_over(window, tracks, areas, settings, key, within_s, now, clear_within_m, waypoint)


def speeds(
    conn: psycopg.Connection[Any], scene: str, key: str | None, slowest: float, fastest: float, leg: int | None
) -> list[Speeds]:
    """Return the speeds of a track, or of each track, from one state of the objects; raises as `delays`."""
    slowest, fastest = questions.limits(slowest, fastest)

    def question(track: Track) -> Question:
        lasts_us = int(track.times_us[-1] - track.times_us[0])
        return Question(
            earlier_us=math.ceil(lasts_us * (1.0 - 1.0 / fastest)) + 1,
            later_us=math.ceil(lasts_us * (1.0 / slowest - 1.0)) + 1,
        )

    with store.snapshot(conn):
        settings, areas, tracks = _read(conn, scene, key, question)
        window = store.stored_window(conn, store.scene_or_branch_id(conn, scene))
    return questions.speeds_over(window, tracks, areas, settings, key, slowest, fastest, leg=leg)


def read_departing(
    conn: psycopg.Connection[Any], scene: str, key: str, within_s: float, *, at_any_height: bool = False
) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene, a track, and what it may meet if it departs up to `within_s` earlier or later.

    at_any_height : also what is at other heights

    Without the track the scene has none of this key. Raises InvalidInput if the scene does not exist.
    """
    most_us = round(1e6 * within_s)
    question = Question(earlier_us=most_us, later_us=most_us, any_height=at_any_height)
    return _read(conn, scene, key, lambda _: question)


def read_near(
    conn: psycopg.Connection[Any], scene: str, key: str, within_m: float
) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene, an object, and the others within a distance of it, metres, at its times and heights.

    Without the object the scene has none of this key. Raises InvalidInput if the scene does not exist.
    """
    with store.snapshot(conn):
        keys = None
        if store.scene_state(conn, scene).is_current:
            _, areas, tracks = store.read_scene(conn, scene, [key])
            question = Question(within_m=within_m)
            plans: list[Area | Track] = [*areas, *tracks]
            keys = [one for plan in plans for one in _around(conn, scene, plan, question)] + [key]
        return store.read_scene(conn, scene, keys)


def read_around(conn: psycopg.Connection[Any], scene: str, track: Track) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene and what a track, stored or not, may meet; raises InvalidInput if the scene does not exist."""
    with store.snapshot(conn):
        is_current = store.scene_state(conn, scene).is_current
        keys = _around(conn, scene, track, Question()) if is_current else None
        return store.read_scene(conn, scene, keys)


def _read(
    conn: psycopg.Connection[Any], scene: str, key: str | None, question: Callable[[Track], Question]
) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene and its objects, or those that a track may meet if it is at other times.

    Of a track of a scene whose pieces are current, only objects are read whose boxes it may meet, or come near to.
    """
    with store.snapshot(conn):
        is_current = store.scene_state(conn, scene).is_current
        keys = None
        if key is not None and is_current:
            _, _, tracks = store.read_scene(conn, scene, [key])
            keys = [one for track in tracks for one in _around(conn, scene, track, question(track))] + [key]
        return store.read_scene(conn, scene, keys)


def _around(conn: psycopg.Connection[Any], scene: str, plan: Area | Track, question: Question) -> list[str]:
    """Return the keys of the objects whose boxes a plan may meet, or come near to, in all layers of a scene.

    Where that is beyond the time over which schedules are expanded, also all objects with a schedule near it.
    """
    number = store.scene_or_branch_id(conn, scene)
    settings = store.read_settings(conn, number)
    parent = store.parent_name(conn, number)
    layers = [number] if parent is None else [number, store.scene_id(conn, parent)]
    pieces = _reaching(settings, plan, question)
    keys = [one for layer in layers for one in store.keys_meeting(conn, layer, pieces, plan.key)]
    span, window = touched([plan], settings, Reach.either(question.within_us)), store.stored_window(conn, number)
    if has_schedules([plan]) or not is_within(span, window):
        # It may have no voyage in the window.
        pieces = _reaching(settings, plan, question, once=True)
        keys += [one for layer in layers for one in store.scheduled_keys_near(conn, layer, pieces)]
    return keys


def _reaching(settings: Scene, plan: Area | Track, question: Question, *, once: bool = False) -> Pieces:
    """Return pieces of a plan whose boxes meet those of all that it may meet, or come near to, as asked."""
    within_m = question.within_m
    wide = widened(settings, settings.largest_separation_m + within_m) if within_m else settings
    areas, tracks = ([plan], []) if isinstance(plan, Area) else ([], [plan])
    pieces = pieces_of(Setup.of(wide), AreaBatch.of(areas), TrackBatch.of(tracks, once=once))
    horizon_us = question.within_us + settings.longest_time_us
    pieces = replace(pieces.longer(horizon_us, horizon_us), end_inclusive=np.ones(len(pieces), np.bool_))
    if not question.any_height:
        return pieces
    all_m = np.full(len(pieces), np.inf)
    return replace(pieces, floor_m=-all_m, ceiling_m=all_m, climb_m=level_m(-all_m, all_m))
