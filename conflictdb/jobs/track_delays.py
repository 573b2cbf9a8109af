"""Delays and speeds of the tracks of a stored scene: read what they may meet (`plans_near`), and compute in memory.

`difference_rows` keeps the stored delays current.
"""

import math
from typing import Any

import psycopg

from conflictdb import store
from conflictdb.core.near import Question
from conflictdb.jobs.plans_near import read_if_moved
from conflictdb.memory import questions
from conflictdb.model import inputs
from conflictdb.model.plans import Track
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
        question = Question(earlier_us=most_us, later_us=most_us)
        settings, areas, tracks = read_if_moved(conn, scene, key, lambda _: question, clear_within_m or 0.0)
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
        settings, areas, tracks = read_if_moved(conn, scene, key, question)
        window = store.stored_window(conn, store.scene_or_branch_id(conn, scene))
    return questions.speeds_over(window, tracks, areas, settings, key, slowest, fastest, leg=leg)
