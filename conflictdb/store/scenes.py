"""List, set, rename, copy and remove scenes; list, rename and remove objects."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import psycopg
from psycopg.types.json import Jsonb

from conflictdb.errors import InvalidInput
from conflictdb.model.results import Kind
from conflictdb.model.rules import Rule, members_of, rule_of
from conflictdb.model.scene import Scene
from conflictdb.model.settings import SETTINGS, SettingType
from conflictdb.store.connection import call, call_by_name, call_many, require_writable, transaction


@dataclass(frozen=True, slots=True)
class ObjectSummary:
    """An object of a scene, without its geometry; None: unbounded.

    start_at, end_at : when it is there, UTC
    floor_m, ceiling_m : metres above mean sea level
    schedule : as written, JSON; None: no schedule
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
    schedule: Any = None


@dataclass(frozen=True, slots=True)
class SceneStatus:
    """A scene and its state.

    areas, tracks, conflicts : their numbers
    pending : objects that changed since the last detection
    run_id, finished_at, error : the last detection; None if there was none (error: None unless it failed)
    is_current : whether nothing changed since the last detection that succeeded
    branch_of : name of the parent of a branch; None for any other scene
    """

    scene_id: int
    scene: Scene
    areas: int
    tracks: int
    pending: int
    conflicts: int
    run_id: int | None
    finished_at: datetime | None
    error: str | None
    is_current: bool
    branch_of: str | None


def set_scene(conn: psycopg.Connection[Any], scene: Scene) -> int:
    """Create a scene or change its settings, in one transaction; return its id."""
    require_writable(conn)
    with transaction(conn):
        return int(call(conn, "_put_scene", scene.name, settings_of(scene))[0])


def scene_id(conn: psycopg.Connection[Any], name: str) -> int:
    """Return the id of a scene.

    Raises InvalidInput for an unknown scene, naming the known ones, and for a branch, which most questions cannot read.
    """
    with transaction(conn):
        return int(call(conn, "_scene_id", name)[0])


def scene_or_branch_id(conn: psycopg.Connection[Any], name: str) -> int:
    """As `scene_id`, also of a branch."""
    with transaction(conn):
        return int(call(conn, "_scene_or_branch", name)[0])


def list_scenes(conn: psycopg.Connection[Any]) -> list[SceneStatus]:
    """Return every scene, by name."""
    with transaction(conn):
        return [SceneStatus(row[0], scene_of(row[1]), *row[2:]) for row in call_many(conn, "_scenes")]


def waiting_scenes(conn: psycopg.Connection[Any]) -> dict[str, float]:
    """Return the scenes that changed since their last detection and their waiting times, seconds; longest first."""
    with transaction(conn):
        return dict(call_many(conn, "_waiting_scenes"))


def scene_settings(conn: psycopg.Connection[Any], name: str) -> Scene | None:
    """Return the settings of a scene; None if it does not exist."""
    with transaction(conn):
        return next((scene_of(settings) for (settings,) in call_many(conn, "_scene_named", name)), None)


def is_scene(conn: psycopg.Connection[Any], scene_id: int) -> bool:
    """Return whether a scene with that id exists."""
    with transaction(conn):
        return bool(call_many(conn, "_scene", scene_id))


def read_settings(conn: psycopg.Connection[Any], scene_id: int) -> Scene:
    """Return the settings of the scene with that id, as the transaction sees them."""
    return scene_of(call(conn, "_scene", scene_id)[0])


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


def settings_of(scene: Scene) -> Jsonb:
    """Return rules and settings of a scene, these by the columns of its row; those that are None are left out."""
    columns: dict[str, Any] = {"rules": [members_of(rule) for rule in scene.rules]}
    for setting in SETTINGS:
        value = getattr(scene, setting.name)
        if value is not None:
            columns.update(zip(setting.columns, value if setting.type is SettingType.PLACE else (value,), strict=True))
    return Jsonb(columns)


def scene_of(columns: Mapping[str, Any]) -> Scene:
    """Build a scene from its name and the settings in its row (_settings_of)."""
    settings: dict[str, Any] = {}
    for setting in SETTINGS:
        values = [columns[name] for name in setting.columns]
        settings[setting.name] = values[0] if len(values) == 1 else None if None in values else tuple(values)
    rules = [rule_of(members, "rules") for members in columns["rules"]]
    return Scene(columns["name"], **settings, rules=rules)
