"""Why two objects are in conflict, or are not: what the database keeps, and how close they come where it does not."""

from dataclasses import replace
from typing import Any, Final

import psycopg

from conflictdb.db import store
from conflictdb.in_memory import solve
from conflictdb.io.instants import format_moment
from conflictdb.methods import Method
from conflictdb.results import Conflict, Explanation, Position

# Half the way around the earth: nothing is further apart.
_FURTHEST_M: Final = 20_000_000.0


def explain(conn: psycopg.Connection[Any], scene: str, a_key: str, b_key: str) -> Explanation:
    """Return why two objects are in conflict, or are not; InvalidInput if the scene or one of them is not known.

    Where no closest approach is kept it is found out, of the pair alone. In the caller's transaction, if one is open:
    with others at work, it should see one state of the database.
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
    """Return two objects of a scene as a pair that is in conflict or near; None if they are never there together."""
    settings, areas, tracks = store.read_scene(conn, scene, keys)
    return next(iter(solve(tracks, areas, replace(settings, method=Method.EXACT, nearest_m=_FURTHEST_M))), None)


def _coordinates(position_deg: Position | None) -> list[float] | None:
    return None if position_deg is None else list(position_deg)
