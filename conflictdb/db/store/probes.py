"""Plans that somebody asks about: pieces of a scene that they may meet, requests, and answers to these."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, cast

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.pieces import Pieces
from conflictdb.db.store.connection import call, call_many
from conflictdb.db.store.objects import decode_paths, decode_rings
from conflictdb.inputs import all_certain, certain
from conflictdb.model import Area, Track
from conflictdb.results import Conflict, Kind
from conflictdb.stage1_broad_phase import hulls_of

# Of a plan without a key, which nobody sees.
_NO_KEY = "plan"


@dataclass(frozen=True, slots=True)
class Near:
    """n pairs of a piece that is not stored (row), and a piece of a scene (piece_id), of an object (number)."""

    row: NDArray[np.int64]
    piece_id: NDArray[np.int64]
    number: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class ProbeRequest:
    """A question of somebody: the row of `probe_request`; geometries as WKB."""

    probe_id: int
    scene_id: int
    kind: Kind
    key: str | None
    footprint: bytes | None
    start_us: int | None
    end_us: int | None
    path: bytes | None
    outline: bytes | None
    grow_mps: float
    floor_m: float | None
    ceiling_m: float | None


def pieces_meeting(conn: psycopg.Connection[Any], scene_id: int, pieces: Pieces, key: str | None) -> Near:
    """Return which pieces of a scene some others meet in space, time and height; not those of the object `key`."""
    columns = (pieces.start_us, pieces.end_us, pieces.end_inclusive, pieces.floor_m, pieces.ceiling_m, pieces.turn)
    hulls = list(shapely.to_wkb(hulls_of(pieces)))
    rows = call_many(conn, "_pieces_meeting", scene_id, key, hulls, *(column.tolist() for column in columns))
    row, piece_id, number = np.array(rows, dtype=np.int64).reshape(-1, 3).T
    return Near(row, piece_id, number)


def keys_of(conn: psycopg.Connection[Any], scene_id: int, found: Conflicts) -> dict[tuple[int, int], str]:
    """Return the keys of the objects of some conflicts, by the code of their kind and their number."""
    kinds, ids = np.concatenate([found.a_kind, found.b_kind]), np.concatenate([found.a_id, found.b_id])
    members = sorted(set(zip(kinds.tolist(), ids.tolist(), strict=True)))
    kind, number = [kind for kind, _ in members], [number for _, number in members]
    return {(kind, number): key for kind, number, key in call_many(conn, "_keys_of", scene_id, kind, number)}


def next_probe(conn: psycopg.Connection[Any]) -> ProbeRequest | None:
    """Return the request that is to be answered next, None if there is none; locked until the transaction ends."""
    rows = call_many(conn, "_next_probe")
    if not rows:
        return None
    probe_id, scene_id, kind, *rest = rows[0]
    return ProbeRequest(probe_id, scene_id, Kind.of_code(kind), *rest)


def plan_of(request: ProbeRequest) -> Area | Track:
    """Return the plan of a request; raises InvalidInput where there can be no such object."""
    key = request.key or _NO_KEY
    floor_m, ceiling_m = request.floor_m, request.ceiling_m
    if request.kind is Kind.AREA:
        footprint = cast("shapely.MultiPolygon", shapely.from_wkb(request.footprint))
        span = certain(request.start_us), certain(request.end_us)
        return Area(key, footprint, None, *span, floor_m=floor_m, ceiling_m=ceiling_m)
    positions, times, _ = decode_paths([request.path or b""])
    outline, _ = decode_rings([request.outline or b""])
    return Track(
        key,
        positions,
        all_certain(times),
        outline,
        floor_m=floor_m,
        ceiling_m=ceiling_m,
        grow_mps=request.grow_mps,
    )


def answer_probe(
    conn: psycopg.Connection[Any], request: ProbeRequest, plan: Area | Track, found: Sequence[Conflict]
) -> None:
    """Write what was found for a request."""
    rows = []
    for one in found:
        is_a = (one.a_key, one.a_kind) != (plan.key, request.kind)
        lon_deg, lat_deg = one.first_contact_deg or (None, None)
        rows.append(
            {
                "kind": (one.a_kind if is_a else one.b_kind).code,
                "key": one.a_key if is_a else one.b_key,
                "verdict": one.verdict,
                "periods": [[_text(start), _text(end)] for start, end in one.periods],
                "time_error_s": one.time_error_s,
                "lon_deg": lon_deg,
                "lat_deg": lat_deg,
                "closest_at": _text(one.closest_at),
                "closest_m": one.closest_m,
                "closest_error_m": one.closest_error_m,
            }
        )
    call(conn, "_answer_probe", request.probe_id, None, json.dumps(rows))


def refuse_probe(conn: psycopg.Connection[Any], request: ProbeRequest, reason: str) -> None:
    """Write why a request cannot be answered."""
    call(conn, "_answer_probe", request.probe_id, reason, "[]")


def _text(instant: datetime | None) -> str | None:
    return None if instant is None else instant.isoformat()
