"""Expand the schedules of a scene, before a detection looks for changes.

Areas become active during the spans of their schedules, tracks depart at their starts. The window reaches from today to
the scene's horizon, and over all voyages, so that no voyage is compared with a schedule that is not expanded. An object
is marked only if its activations differ from those it had.
"""

import time
from typing import Any

import numpy as np
import psycopg
import shapely

from conflictdb.db import store
from conflictdb.model.horizon import area_spans, track_departures, window_over
from conflictdb.model.results import Kind


def expand(conn: psycopg.Connection[Any], scene: str, now_us: int | None = None) -> None:
    """Expand the schedules of a scene that are not expanded, or not far enough, in one transaction.

    now_us : today, microseconds; None: by the clock

    Raises InvalidInput, naming the object, for a schedule that is not understood; nothing is stored then.
    """
    with store.transaction(conn):
        scene_id = store.scene_id(conn, scene)
        known = store.horizon(conn, scene_id)
        if known.is_waiting is None:
            if known.window is not None:
                store.store_window(conn, scene_id, None)
            return
        now_us = time.time_ns() // 1000 if now_us is None else now_us
        window = window_over(now_us, known.horizon_days, [] if known.voyages is None else [known.voyages], known.window)
        objects = store.scheduled(conn, scene_id, only_waiting=window == known.window)
        expanded = [_expanded(one, window) for one in objects]
        store.store_activations(conn, scene_id, objects, expanded)
        if window != known.window:
            store.store_window(conn, scene_id, window)


def _expanded(one: store.Scheduled, window: tuple[int, int]) -> Any:
    start_us, end_us = one.span_us
    if one.kind is Kind.AREA:
        return area_spans(f"area {one.key!r}", one.schedule, one.span_us, one.box, window)
    lasts_us = (end_us or 0) - (start_us or 0)
    first_deg = np.asarray(shapely.get_coordinates(one.box)[0])
    return track_departures(f"track {one.key!r}", one.schedule, lasts_us, first_deg, window)
