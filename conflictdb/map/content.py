"""Pack a scene for the page: JSON, with conflicts and tracks in binary form."""

import json
import math
import struct
from dataclasses import dataclass
from typing import Any, Final

import psycopg

from conflictdb.db import store
from conflictdb.model.settings import SETTINGS, SettingType

_LENGTH: Final = struct.Struct("<I")
# A conflict in the numbers of routine _map_conflicts, without its periods, each of which is two 8-byte numbers.
_CONFLICT: Final = struct.Struct(">qhhddd4fi")
_PERIOD_BYTES: Final = 16

_AREA: Final = (
    "id", "key", "name", "floor_m", "ceiling_m", "start", "end", "spans", "west", "south", "east", "north", "lon", "lat",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Pair:
    """Two objects of a scene, by their keys."""

    a: str
    b: str


@dataclass(frozen=True, slots=True)
class Listed:
    """A conflict in the list: number, objects and first contact, degrees, None if unknown.

    is_current : False if one of the objects changed since
    """

    number: int
    pair: Pair
    is_current: bool
    first_contact_deg: tuple[float, float] | None


def settings(conn: psycopg.Connection[Any], scene: str) -> dict[str, Any]:
    """Return name, settings and state of a scene; InvalidInput if the scene does not exist."""
    with store.transaction(conn):
        own = store.read_settings(conn, store.scene_or_branch_id(conn, scene))
        state = store.scene_state(conn, scene)
    return {
        "scene": scene,
        **{one.name: getattr(own, one.name) for one in SETTINGS if one.type is not SettingType.PLACE},
        "objects": state.objects,
        "is_current": state.is_current,
        "remark": state.remark,
    }


def conflicts(conn: psycopg.Connection[Any], scene: str) -> bytes:
    """Pack the conflicts of a scene: length of a JSON head (little-endian), head, numbers (as _map_conflicts)."""
    head, numbers = store.map_conflicts(conn, scene)
    return b"".join([_LENGTH.pack(len(head)), head, numbers])


def listed(packed: bytes) -> list[Listed]:
    """Unpack the result of `conflicts`, in its order."""
    at = _LENGTH.size + _LENGTH.unpack_from(packed)[0]
    head = from_json(packed[_LENGTH.size : at])
    found = []
    for a, b in zip(head["a"], head["b"], strict=True):
        number, _, is_current, _, lon, lat, *_, periods = _CONFLICT.unpack_from(packed, at)
        at += _CONFLICT.size + _PERIOD_BYTES * periods
        found.append(Listed(number, Pair(a, b), bool(is_current), None if math.isnan(lon) else (lon, lat)))
    return found


def areas(conn: psycopg.Connection[Any], scene: str) -> dict[str, Any]:
    """Return the areas of a scene: column names, and rows."""
    return {"columns": _AREA, "rows": store.map_areas(conn, scene)}


def tracks(conn: psycopg.Connection[Any], scene: str) -> bytes:
    """Pack the tracks of a scene: length of a JSON head (little-endian), head, all geometries (WKB).

    For each track the head has id, key, name, floor_m, ceiling_m, grow_mps, departures and the lengths of path, outline
    and outlines; null for a missing one.
    """
    rows, blobs = [], []
    for number, key, name, floor_m, ceiling_m, path, outline, grow_mps, outlines, departures in store.map_tracks(
        conn, scene
    ):
        geometries = (path, outline, outlines)
        sizes = [None if one is None else len(one) for one in geometries]
        rows.append([number, key, name, floor_m, ceiling_m, grow_mps, departures, *sizes])
        blobs += [one for one in geometries if one is not None]
    head = to_json({"rows": rows})
    return b"".join([_LENGTH.pack(len(head)), head, *blobs])


def shapes(conn: psycopg.Connection[Any], scene: str, conflicts: list[Listed]) -> dict[str, Any]:
    """Return a FeatureCollection for each layer of a scene, with its conflicts from `listed`."""
    found: dict[str, list[Any]] = {"areas": [], "tracks": [], "conflicts": [], "first_contacts": []}
    is_current = {one.number: one.is_current for one in conflicts}
    for layer, number, key, shape in store.map_shapes(conn, scene):
        known = {"is_current": is_current[number]} if layer == "conflicts" else {"key": key}
        found[layer].append(_feature(number, known, json.loads(shape)))
    for one in conflicts:
        if one.first_contact_deg is not None:
            point = {"type": "Point", "coordinates": list(one.first_contact_deg)}
            found["first_contacts"].append(_feature(one.number, {"is_current": one.is_current}, point))
    return {layer: {"type": "FeatureCollection", "features": features} for layer, features in found.items()}


def _feature(number: int, properties: dict[str, Any], geometry: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "id": number, "properties": properties, "geometry": geometry}


def pair(conn: psycopg.Connection[Any], scene: str, asked: Pair) -> dict[str, Any]:
    """Return why two objects are in conflict or not, and the footprints of areas among them."""
    return {
        "explanation": store.explain_conflict(conn, scene, asked.a, asked.b),
        "footprints": {
            key: json.loads(shape)
            for layer, _, key, shape in store.map_shapes(conn, scene, [asked.a, asked.b])
            if layer == "areas"
        },
    }


def to_json(value: object) -> bytes:
    """Return a value as JSON; scenes contain no NaN or infinity."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def from_json(text: bytes) -> Any:
    """Return the value of a JSON text; raises ValueError for invalid or too deeply nested text."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("too deeply nested") from None
