"""Delays of the tracks of a stored scene: read what they may meet, and compute in memory."""

from dataclasses import replace
from typing import Any

import numpy as np
import psycopg

from conflictdb import in_memory
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.db import store
from conflictdb.earth.registry import plane_of
from conflictdb.model import inputs
from conflictdb.model.results import Delays
from conflictdb.stages.margins import widened
from conflictdb.stages.pieces.covers import pieces_of


def delays(
    conn: psycopg.Connection[Any],
    scene: str,
    key: str | None,
    within_s: float,
    now: inputs.Instant | None = None,
    clear_within_m: float | None = None,
) -> list[Delays]:
    """Return the delays of a track, or of each track, from one state of the objects.

    Of a track of a scene whose pieces are current, only objects are read whose boxes it may meet within the horizon, or
    come near to.
    Raises InvalidInput if the scene or the track does not exist.
    """
    with store.snapshot(conn):
        is_current = store.scene_state(conn, scene).is_current
        keys = (
            [*_near(conn, scene, key, within_s, clear_within_m or 0.0), key] if key is not None and is_current else None
        )
        settings, areas, tracks = store.read_scene(conn, scene, keys)
    return in_memory.delays(tracks, areas, settings, key, within_s, now, clear_within_m)


def _near(conn: psycopg.Connection[Any], scene: str, key: str, within_s: float, clear_within_m: float) -> list[str]:
    """Return the keys of the objects whose boxes a track may meet if it departs at another time within the horizon.

    clear_within_m : also those that come within this, beyond the required separation
    """
    settings, _, tracks = store.read_scene(conn, scene, [key])
    wide = widened(settings, settings.separation_m + clear_within_m) if clear_within_m else settings
    pieces = pieces_of(wide, plane_of(settings), AreaBatch.of([]), TrackBatch.of(tracks))
    horizon_us = round(1e6 * within_s)
    at_any_time = replace(
        pieces,
        start_us=pieces.start_us - horizon_us,
        end_us=pieces.end_us + horizon_us,
        end_inclusive=np.ones(len(pieces), np.bool_),
    )
    return store.keys_meeting(conn, store.scene_id(conn, scene), at_any_time, key)
