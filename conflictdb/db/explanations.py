"""Explain why two objects are in conflict or not, and compute their closest approach if the database has none."""

from dataclasses import replace
from typing import Any, Final

import psycopg

from conflictdb.db import store
from conflictdb.in_memory import solve
from conflictdb.io.instants import format_moment
from conflictdb.methods import Method
from conflictdb.results import Conflict, Explanation, Position

# Half the circumference of the earth: an upper bound on distances.
_FURTHEST_M: Final = 20_000_000.0


def explain(conn: psycopg.Connection[Any], scene: str, a_key: str, b_key: str) -> Explanation:
    """Return why two objects are in conflict or not; InvalidInput if the scene or one of them does not exist.

    A closest approach that is not stored is computed from the pair alone. Runs in the caller's transaction if one is
    open; beside concurrent writers it should be a snapshot.
    """
    facts = store.explain_conflict(conn, scene, a_key, b_key)
    if facts["closest"] is None and facts["verdict"] != "unknown" and not facts["are_never_together"]:
        found = _closest(conn, scene, facts["a"]["key"], facts["b"]["key"])
        if found is None:
            facts["are_never_together"] = True
        elif found.closest_m is not None:
            facts["closest"] = {
                "at": format_moment(found.closest_at),
                "m": found.closest_m,
                "error_m": found.closest_error_m,
                "a": _coordinates(found.closest_a_deg),
                "b": _coordinates(found.closest_b_deg),
            }
    return Explanation(facts, store.explained_text(conn, facts))


def _closest(conn: psycopg.Connection[Any], scene: str, *keys: str) -> Conflict | None:
    """Return two objects of a scene as a pair in conflict or near; None if they never exist at the same time."""
    settings, areas, tracks = store.read_scene(conn, scene, keys)
    return next(iter(solve(tracks, areas, replace(settings, method=Method.EXACT, nearest_m=_FURTHEST_M))), None)


def _coordinates(position_deg: Position | None) -> list[float] | None:
    return None if position_deg is None else list(position_deg)
