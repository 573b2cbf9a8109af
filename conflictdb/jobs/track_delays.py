"""Delays and speeds of the objects of a stored scene: read what they may meet (`plans_near`), and compute in memory.

`difference_rows` keeps the stored delays current.
"""

import math
from typing import Any

import psycopg

from conflictdb import store
from conflictdb.core.near import Question
from conflictdb.jobs.plans_near import read_if_moved
from conflictdb.memory import questions
from conflictdb.memory.delay_options import DelayOptions
from conflictdb.model.plans import Area, Track
from conflictdb.model.results import Delays, Speeds


def delays(conn: psycopg.Connection[Any], scene: str, key: str | None, options: DelayOptions) -> list[Delays]:
    """Return the delays of an object, or of each track, from one state of the objects, or of the stored differences.

    Raises InvalidInput if the scene or the object does not exist.
    """
    with store.snapshot(conn):
        number = store.scene_or_branch_id(conn, scene)
        if options.may_be_stored:
            known = store.stored_delays(conn, number, key, options.horizon_us, options.now_us)
            if known:
                return known
        margin = options.margin

        def question(plan: Area | Track) -> Question:
            departs_us = questions.departure_us(plan, options.waypoint)
            most_us = options.reach_us(plan, departs_us) + margin.time_us
            return Question(earlier_us=most_us, later_us=most_us)

        within_m = margin.distance_m + (options.clear_within_m or 0.0)
        settings, areas, tracks = read_if_moved(conn, scene, key, question, within_m)
        window = store.stored_window(conn, number)
    return questions.delays_over(window, tracks, areas, settings, key, options)


def speeds(
    conn: psycopg.Connection[Any], scene: str, key: str | None, slowest: float, fastest: float, leg: int | None
) -> list[Speeds]:
    """Return the speeds of a track, or of each track, from one state of the objects; raises as `delays`."""
    slowest, fastest = questions.limits(slowest, fastest)

    def question(track: Area | Track) -> Question:
        if isinstance(track, Area):  # refused later, by its key
            return Question()
        lasts_us = int(track.times_us[-1] - track.times_us[0])
        return Question(
            earlier_us=math.ceil(lasts_us * (1.0 - 1.0 / fastest)) + 1,
            later_us=math.ceil(lasts_us * (1.0 / slowest - 1.0)) + 1,
        )

    with store.snapshot(conn):
        settings, areas, tracks = read_if_moved(conn, scene, key, question)
        window = store.stored_window(conn, store.scene_or_branch_id(conn, scene))
    return questions.speeds_over(window, tracks, areas, settings, key, slowest, fastest, leg=leg)
