"""Expand the schedules of a scene, before a detection looks for changes.

Areas become active during the spans of their schedules, tracks depart at their starts. The window reaches from today to
the scene's horizon, and over all voyages, so that no voyage is compared with a schedule that is not expanded. That of a
branch contains the window of its parent, and its parent's voyages. An object is marked only if its activations differ
from those it had. An object whose schedule is not understood may be active at any time of its span: its pairs are
unresolved, and other objects are detected.
"""

import json
import time
from typing import Any

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from conflictdb import store
from conflictdb.errors import InvalidInput
from conflictdb.model.recurring_plans import area_spans, idle_text, track_departures, window_over
from conflictdb.model.results import Kind


def expand(conn: psycopg.Connection[Any], scene: str, say: store.Say, now_us: int | None = None) -> None:
    """Expand the schedules of a scene that are not expanded, or not far enough, in one transaction.

    say : called with the object and the reason for each schedule that is not understood, and with the objects whose
        schedules have no activation
    now_us : today, microseconds; None: by the clock
    """
    with store.transaction(conn):
        scene_id = store.scene_or_branch_id(conn, scene)
        known = store.horizon(conn, scene_id)
        if known.is_waiting is None:
            if known.window is not None:
                store.store_window(conn, scene_id, None)
            return
        now_us = time.time_ns() // 1000 if now_us is None else now_us
        window = window_over(now_us, known.horizon_days, [] if known.voyages is None else [known.voyages], known.window)
        objects = store.scheduled(conn, scene_id, only_waiting=window == known.window)
        expanded = [activations(one, window) for one in objects]
        errors = [error for _, error in expanded]
        store.store_activations(conn, scene_id, objects, [instants_us for instants_us, _ in expanded], errors)
        if window != known.window:
            store.store_window(conn, scene_id, window)
    for error in errors:
        if error is not None:
            say(f"{error}; its pairs are unresolved")
    found = zip(objects, expanded, strict=True)
    idle = [f"{one.kind.value} {one.key!r}" for one, (instants, error) in found if error is None and not len(instants)]
    if idle:
        say(idle_text(idle, window))


def activations(one: store.Scheduled, window: tuple[int, int]) -> tuple[NDArray[np.int64], str | None]:
    """Return the activations of an object, or none and why its schedule is not understood."""
    start_us, end_us = one.span_us
    who = f"{one.kind.value} {one.key!r}"
    try:
        schedule = json.loads(one.schedule)
        if one.kind is Kind.AREA:
            return area_spans(who, schedule, one.span_us, one.box, window), None
        lasts_us = (end_us or 0) - (start_us or 0)
        first_deg = np.asarray(shapely.get_coordinates(one.box)[0])
        return track_departures(who, schedule, lasts_us, first_deg, window), None
    except InvalidInput as refused:
        error = str(refused)
    except Exception as failed:  # whatever a row contains must not stop other objects
        error = f"{who}: schedule: cannot be read: {type(failed).__name__}: {failed}"
    return np.empty(0, np.int64), error
