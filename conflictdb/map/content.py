"""Pack a scene for the page: JSON, with conflicts and tracks in binary form, which page/model.js unpacks.

`_map_conflicts` (sql/84_map_page.sql) writes the numbers of conflicts; `map.what_if` packs pieces.
"""

import base64
import json
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb import store
from conflictdb.core.depths import DeepestContact
from conflictdb.core.depths import depths as depths_of
from conflictdb.core.ranking import MOST_DEPTHS, Facts, is_certain, missing, rank
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.formats.writing import lines_of
from conflictdb.model.plans import Area, Track
from conflictdb.model.results import Certainty, Conflict, Verdict
from conflictdb.model.settings import SETTINGS, SettingType

_LENGTH: Final = struct.Struct("<I")
# A conflict in the numbers of routine _map_conflicts, without its periods, each of which is two 8-byte numbers.
_CONFLICT: Final = struct.Struct(">qhhddd4fi")
_PERIOD_BYTES: Final = 16
_FIRST: Final = struct.Struct(">d")

_AREA: Final = (
    "id", "key", "name", "floor_m", "ceiling_m", "start", "end", "spans",
    "west", "south", "east", "north", "lon", "lat",
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
    facts : what its rank reads
    """

    number: int
    pair: Pair
    is_current: bool
    first_contact_deg: tuple[float, float] | None
    facts: Facts


def settings(conn: psycopg.Connection[Any], scene: str) -> dict[str, Any]:
    """Return name, settings and state of a scene, and the plane of its kernel; InvalidInput if it does not exist."""
    with store.transaction(conn):
        own = store.read_settings(conn, store.scene_or_branch_id(conn, scene))
        state = store.scene_state(conn, scene)
        parent = store.parent_name(conn, store.scene_or_branch_id(conn, scene))
    return {
        "scene": scene,
        **{one.name: getattr(own, one.name) for one in SETTINGS if one.type is not SettingType.PLACE},
        "branch_of": parent,
        "plane": base64.b64encode(bytes(Setup.of(own).plane.kernel_plane)).decode(),
        "objects": state.objects,
        "is_current": state.is_current,
        "remark": state.remark,
    }


def scenes(conn: psycopg.Connection[Any]) -> list[dict[str, Any]]:
    """Return the scenes that the user may see, by name: name, number of conflicts, state, and of a branch its parent.

    is_detected : False if it has objects and was never detected; is_pending : whether objects changed since
    """
    with store.transaction(conn):
        return [
            {
                "scene": one.scene.name,
                "conflicts": one.conflicts,
                "is_detected": one.run_id is not None or one.pending == 0,
                "is_pending": one.pending > 0,
                "branch_of": one.branch_of,
            }
            for one in store.list_scenes(conn)
        ]


def known_at(conn: psycopg.Connection[Any], scene: str, at: datetime) -> dict[str, Any]:
    """Return the conflicts of a scene as known at an instant: keys, verdict, error and periods (Unix seconds).

    `refusal` says why they are not known, or is null.
    """
    store.scene_or_branch_id(conn, scene)  # raises if there is none
    try:
        found = store.conflicts_known_at(conn, scene, at)
    except InvalidInput as error:
        return {"refusal": error.rule, "conflicts": []}
    return {
        "refusal": None,
        "conflicts": [
            [one.a_key, one.b_key, str(one.verdict), one.time_error_s, [list(map(_unix, row)) for row in one.periods]]
            for one in found
        ],
    }


def _unix(at: datetime | None) -> float | None:
    return None if at is None else at.timestamp()


def conflicts(conn: psycopg.Connection[Any], scene: str) -> bytes:
    """Pack the conflicts of a scene: length of a JSON head (little-endian), head, numbers (as _map_conflicts)."""
    head, numbers = store.map_conflicts(conn, scene)
    return b"".join([_LENGTH.pack(len(head)), head, numbers])


def listed(packed: bytes) -> list[Listed]:
    """Unpack the result of `conflicts`, in its order."""
    at = _LENGTH.size + _LENGTH.unpack_from(packed)[0]
    head = from_json(packed[_LENGTH.size : at])
    possible = set(head["possible"])
    found = []
    for n, (a, b, moving) in enumerate(zip(head["a"], head["b"], head["moving"], strict=True)):
        number, verdict, is_current, _, lon, lat, *_, periods = _CONFLICT.unpack_from(packed, at)
        at += _CONFLICT.size
        first_s = _FIRST.unpack_from(packed, at)[0] if periods else -math.inf
        at += _PERIOD_BYTES * periods
        certain = is_certain(Verdict.of_code(verdict), Certainty.MAY if n in possible else None)
        facts = Facts(a, b, int(moving), certain, first_s)
        found.append(Listed(number, Pair(a, b), bool(is_current), None if math.isnan(lon) else (lon, lat), facts))
    return found


def depths(conn: psycopg.Connection[Any], scene: str) -> list[tuple[int, float | None, str | None, float | None]]:
    """Return the conflicts, the worst first (core/ranking.py): number, when it is deepest, words, and metres.

    Instants are Unix seconds; words and metres say how much of the separation is missing. They are null if they are not
    known: of outdated conflicts, and of all if there are more than MOST_DEPTHS.
    """
    known: dict[tuple[str, str], DeepestContact] = {}
    with store.snapshot(conn):
        found = listed(conflicts(conn, scene))
        some = [one for one in found if one.is_current]
        if 0 < len(some) <= MOST_DEPTHS:
            keys = sorted({key for one in some for key in (one.pair.a, one.pair.b)})
            pairs = {(one.pair.a, one.pair.b) for one in some}
            known = depths_of(*store.read_scene(conn, scene, keys), only=pairs)
    found.sort(key=lambda one: rank(one.facts, known))
    return [(one.number, *_deepest(one.facts, known.get((one.pair.a, one.pair.b)))) for one in found]


def _deepest(facts: Facts, found: DeepestContact | None) -> tuple[float | None, str | None, float | None]:
    if found is None:
        return None, None, None
    return None if found.at_us is None else found.at_us / 1e6, *missing(facts.moving, found)


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


def owners(conn: psycopg.Connection[Any], scene: str, key: str) -> dict[str, str]:
    """Return the owners, by key, of an object and of all that it is in conflict with."""
    with store.transaction(conn):
        found = store.each_conflict(conn, scene, store.Selection(key=key))
        keys = {key}.union(*((one.a_key, one.b_key) for one in found))
        return owned(*store.read_scene(conn, scene, sorted(keys))[1:])


def owned(areas: Sequence[Area], tracks: Sequence[Track]) -> dict[str, str]:
    """Return the owners of plans, by key."""
    plans: list[Area | Track] = [*areas, *tracks]
    return {plan.key: plan.owner for plan in plans if plan.owner is not None}


def table(conn: psycopg.Connection[Any], scene: str) -> str:
    """Return the conflicts of a scene as the CSV of the command line, earliest first."""
    return "".join(lines_of(store.conflicts(conn, scene), "csv", Conflict))


def heights(conn: psycopg.Connection[Any], scene: str) -> dict[str, list[list[float | None] | None]]:
    """Return floors and ceilings, metres per leg or per waypoint, of tracks whose heights change; None: no limit."""
    with store.transaction(conn):
        known = store.changing_heights(conn, store.scene_or_branch_id(conn, scene))
        return {key: [_limits(floors_m), _limits(ceilings_m)] for key, floors_m, ceilings_m in known}


def _limits(heights_m: NDArray[np.float64] | None) -> list[float | None] | None:
    return None if heights_m is None else [one if math.isfinite(one) else None for one in heights_m.tolist()]


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
    """Return why two objects are in conflict or not (null in a branch), and the footprints of areas among them."""
    is_branch = store.parent_name(conn, store.scene_or_branch_id(conn, scene)) is not None
    return {
        "explanation": None if is_branch else store.explain_conflict(conn, scene, asked.a, asked.b),
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
