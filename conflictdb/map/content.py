"""A scene as the page reads it: JSON, and tracks packed as their numbers."""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

import psycopg

from conflictdb.db import store
from conflictdb.io.instants import format_moment

_LENGTH: Final = struct.Struct("<I")

_CONFLICT: Final = (
    "id", "a", "b", "verdict", "starts", "ends", "error_s", "lon", "lat", "west", "south", "east", "north",
    "is_current", "acknowledged_by", "acknowledged_at", "acknowledged_for", "acknowledged_until",
)  # fmt: skip
_AREA: Final = ("id", "key", "name", "floor_m", "ceiling_m", "start", "end", "west", "south", "east", "north")


@dataclass(frozen=True, slots=True)
class Pair:
    """Two objects of a scene, by their keys."""

    a: str
    b: str


def overview(conn: psycopg.Connection[Any], scene: str) -> dict[str, Any]:
    """Return name, settings and state of a scene; InvalidInput if it is not known."""
    settings = store.read_settings(conn, store.scene_id(conn, scene))
    state = store.scene_state(conn, scene)
    return {
        "scene": scene,
        "motion": str(settings.motion),
        "earth": str(settings.earth),
        "method": str(settings.method),
        "tolerance_m": settings.tolerance_m,
        "separation_m": settings.separation_m,
        "objects": state.objects,
        "is_current": state.is_current,
        "remark": state.remark,
    }


def conflicts(conn: psycopg.Connection[Any], scene: str) -> dict[str, Any]:
    """Return the conflicts of a scene: names of columns, and rows."""
    return {"columns": _CONFLICT, "rows": [_plain(row) for row in store.map_conflicts(conn, scene)]}


def areas(conn: psycopg.Connection[Any], scene: str) -> dict[str, Any]:
    """Return the areas of a scene: names of columns, and rows."""
    return {"columns": _AREA, "rows": store.map_areas(conn, scene)}


def tracks(conn: psycopg.Connection[Any], scene: str) -> bytes:
    """Return the tracks of a scene: length of a JSON head (little-endian), that head, and all geometries (WKB).

    The head has for each track id, key, name, floor_m, ceiling_m, grow_mps and the lengths of path, outline and
    outlines; null where a track has none.
    """
    rows, blobs = [], []
    for number, key, name, floor_m, ceiling_m, path, outline, grow_mps, outlines in store.map_tracks(conn, scene):
        geometries = (path, outline, outlines)
        sizes = [None if one is None else len(one) for one in geometries]
        rows.append([number, key, name, floor_m, ceiling_m, grow_mps, *sizes])
        blobs += [one for one in geometries if one is not None]
    head = to_json({"rows": rows})
    return b"".join([_LENGTH.pack(len(head)), head, *blobs])


def pair(conn: psycopg.Connection[Any], scene: str, asked: Pair) -> dict[str, Any]:
    """Return why two objects are in conflict, or are not, and the shapes of those that are areas."""
    return {
        "explanation": store.explain_conflict(conn, scene, asked.a, asked.b),
        "footprints": {
            key: json.loads(shape)
            for layer, _, key, shape in store.map_shapes(conn, scene, [asked.a, asked.b])
            if layer == "areas"
        },
    }


def to_json(value: object) -> bytes:
    """Return a value as JSON; a scene holds no number that this has not."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def from_json(text: bytes) -> Any:
    """Return the value of a JSON text; raises ValueError for what is none."""
    return json.loads(text)


def _plain(row: Sequence[Any]) -> list[Any]:
    return [format_moment(value) if isinstance(value, datetime) else value for value in row]
