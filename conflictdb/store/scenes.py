"""List objects; rename, copy and remove scenes and objects."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import psycopg

from conflictdb.errors import InvalidInput
from conflictdb.model.results import Kind
from conflictdb.model.rules import Rule
from conflictdb.store.connection import call, call_by_name, transaction


@dataclass(frozen=True, slots=True)
class ObjectSummary:
    """An object of a scene, without its geometry; None: unbounded.

    start_at, end_at : when it is there, UTC
    floor_m, ceiling_m : metres above mean sea level
    """

    key: str
    kind: Kind
    name: str | None
    start_at: datetime | None
    end_at: datetime | None
    floor_m: float | None
    ceiling_m: float | None
    object_class: str | None
    owner: str | None


def list_objects(conn: psycopg.Connection[Any], scene: str) -> list[ObjectSummary]:
    """Return the objects of a scene, by key; InvalidInput if it does not exist."""
    with transaction(conn):
        call(conn, "_scene_or_branch", scene)  # also for an empty scene
        rows = call_by_name(conn, "list_objects", scene)
    return [ObjectSummary(kind=Kind(row.pop("kind")), object_class=row.pop("class"), **row) for row in rows]


def rename_scene(conn: psycopg.Connection[Any], scene: str, name: str) -> None:
    """Rename a scene; InvalidInput if it does not exist, or the name is taken."""
    with transaction(conn):
        call(conn, "rename_scene", scene, name)


def copy_scene(conn: psycopg.Connection[Any], scene: str, name: str) -> None:
    """Copy settings and objects of a scene; InvalidInput if it does not exist, or the name is taken."""
    with transaction(conn):
        call(conn, "copy_scene", scene, name)


def remove_scene(conn: psycopg.Connection[Any], scene: str) -> None:
    """Remove a scene with its objects, conflicts and history; InvalidInput if it does not exist."""
    with transaction(conn):
        call(conn, "remove_scene", scene)


def rename_object(conn: psycopg.Connection[Any], scene: str, key: str, new_key: str) -> None:
    """Give an object another key; InvalidInput if it does not exist, or the key is taken."""
    with transaction(conn):
        call(conn, "rename_object", scene, key, new_key)


def remove_objects(conn: psycopg.Connection[Any], scene: str, keys: Sequence[str]) -> None:
    """Remove objects, all or none; InvalidInput if the scene or one of them does not exist."""
    with transaction(conn):
        for key in keys:
            if not call(conn, "remove_object", scene, key)[0]:
                raise InvalidInput(f"object {key!r}", "key", f"is no object of scene {scene!r}")


def put_rule(conn: psycopg.Connection[Any], scene: str, rule: Rule) -> None:
    """Add or replace a separation rule; InvalidInput if it is ambiguous, or the scene does not exist."""
    values = rule.separation_m, rule.vertical_m, rule.time_s, rule.allowed, rule.yields
    with transaction(conn):
        call(conn, "put_rule", scene, rule.a_class, rule.b_class, *values)


def remove_rule(conn: psycopg.Connection[Any], scene: str, a_class: str | None, b_class: str | None) -> bool:
    """Remove a separation rule; return whether there was one. InvalidInput if two others need it."""
    with transaction(conn):
        return bool(call(conn, "remove_rule", scene, a_class, b_class)[0])
