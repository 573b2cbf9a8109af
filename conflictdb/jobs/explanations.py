"""Explain why two objects are in conflict or not; compute delays, and the closest approach if it is not stored."""

import json
from dataclasses import replace
from typing import Any

import psycopg

from conflictdb import store
from conflictdb.memory.questions import counts, delays, solve
from conflictdb.model.departure_text import departure_text
from conflictdb.model.methods import Method
from conflictdb.model.results import Conflict, Explanation, Position, format_moment
from conflictdb.model.settings import MOST_M


def explain(conn: psycopg.Connection[Any], scene: str, a_key: str, b_key: str) -> Explanation:
    """Return why two objects are in conflict or not; InvalidInput if the scene or one of them does not exist.

    The database stores neither whether stage 3 decided, nor delays, nor, by default, the closest approach of other
    pairs: they are computed from the pair alone. Runs in the caller's transaction if one is open; beside concurrent
    writers it should be a snapshot.
    """
    facts = store.explain_conflict(conn, scene, a_key, b_key)
    if facts["is_current"] and (facts["decided_by"] or {}).get("stage") == 4 and facts["run"]["method"] == Method.EXACT:
        _say_closed_forms(conn, scene, facts)
    if facts["closest"] is None and facts["verdict"] != "unknown" and not facts["are_never_together"]:
        is_compared = (facts["decided_by"] or {}).get("by") not in ("owner", "rule")
        found = _closest(conn, scene, facts["a"]["key"], facts["b"]["key"], is_compared=is_compared)
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
    text = [store.explained_text(conn, facts)]
    settings, areas, tracks = store.read_scene(conn, scene, (facts["a"]["key"], facts["b"]["key"]))
    each = delays(tracks, areas, settings)
    facts["delays"] = [one.as_json() for one in each]
    if each:
        text += ["  if only one of these two departs at another time:"]
        # Keys as JSON strings, as in the other lines.
        text += [f"    {departure_text(one, areas, _named)}" for one in each]
    return Explanation(facts, "\n".join(text))


def _named(key: str) -> str:
    return json.dumps(key, ensure_ascii=False)


def _say_closed_forms(conn: psycopg.Connection[Any], scene: str, facts: dict[str, Any]) -> None:
    """Say in the facts of a pair what stage 3 decided: the pairs of its pieces in closed form."""
    counted = counts(*store.read_scene(conn, scene, (facts["a"]["key"], facts["b"]["key"])))
    closed = counted.effort.exact.closed_forms
    if closed:
        facts["stages"][2]["says"] = f"{closed} of {counted.intersecting_pairs} pairs of pieces decided in closed form"
        # How near they come is found by stage 4.
        if closed == counted.intersecting_pairs and facts["verdict"] != "near":
            facts["decided_by"]["stage"] = 3
            facts["stages"][3]["says"] = "not asked: nothing was left"


def _closest(conn: psycopg.Connection[Any], scene: str, *keys: str, is_compared: bool) -> Conflict | None:
    """Return two objects of a scene as a pair in conflict or near; None if they never exist at the same time.

    is_compared : False for two of one owner, or allowed by a rule; they have a closest approach, too
    """
    settings, areas, tracks = store.read_scene(conn, scene, keys)
    if not is_compared:
        settings = replace(settings, rules=())
        areas = [replace(one, owner=None) for one in areas]
        tracks = [replace(one, owner=None, max_speed_kn=float("inf")) for one in tracks]
    return next(iter(solve(tracks, areas, replace(settings, method=Method.EXACT, nearest_m=MOST_M))), None)


def _coordinates(position_deg: Position | None) -> list[float] | None:
    return None if position_deg is None else list(position_deg)
