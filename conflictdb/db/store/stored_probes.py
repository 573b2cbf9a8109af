"""Probe plans: find the pieces of a scene that a plan may meet; read, send and answer requests."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Final, cast

import numpy as np
import psycopg
import shapely

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.object_numbers import kinds_and_ids
from conflictdb.arrays.pieces import Pieces
from conflictdb.arrays.ragged import offsets
from conflictdb.db.store import copy_binary
from conflictdb.db.store.connection import call, call_by_name, call_many, transaction
from conflictdb.db.store.listing import fields_of
from conflictdb.db.store.stored_objects import decode_paths, decode_rings
from conflictdb.db.store.stored_pairs import Candidates, Parts
from conflictdb.errors import InvalidInput
from conflictdb.model.inputs import all_certain, certain
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.record import MEASURED, ColumnType
from conflictdb.model.results import Conflict, Delays, Kind
from conflictdb.stages.stage1_broad_phase import hulls_of

# Columns of a conflict that are sent as they are; its points are sent as numbers.
_SENT: Final = tuple(column for column in MEASURED if column.type is not ColumnType.POINT)

# Key of a plan without one; never shown.
_NO_KEY = "plan"


@dataclass(frozen=True, slots=True)
class ProbeRequest:
    """A question about a plan, or about the delays of a track (with a horizon): a row of `probe_request`.

    footprint, path, outline : WKB
    """

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
    horizon_s: float | None
    scene: str


def pieces_meeting(
    conn: psycopg.Connection[Any], scene_id: int, pieces: Pieces, key: str | None, most_compared: int
) -> tuple[Candidates, Parts | None]:
    """Return the pairs of one object's pieces with those of a scene, after stage 2 if few pieces are involved.

    Returns ids of rows, and the parts of the pieces; None: stage 2 has not run, and the pairs are rows whose boxes
    overlap in space, time and height. Leaves out the object `key`. The given pieces, which are in no row, are numbered
    -1, -2, ....

    most_compared : the largest number of pairs of pieces for which stage 2 runs in the database
    """
    columns = (pieces.start_us, pieces.end_us, pieces.end_inclusive, pieces.floor_m, pieces.ceiling_m, pieces.turn)
    hulls = list(shapely.to_wkb(hulls_of(pieces)))
    rows = call_many(
        conn, "_pieces_meeting", scene_id, most_compared, key, hulls, *(column.tolist() for column in columns)
    )
    is_compared = not rows or rows[0][4] is not None
    found = np.array([row if is_compared else row[:4] for row in rows], dtype=np.int64).reshape(-1, 4 + is_compared)
    row, piece_id, count, number, *part = found[np.argsort(found[:, 3], kind="stable")].T
    near = Candidates(-1 - row, piece_id, np.ones_like(row), count, number)
    return near, (pieces.part[row].astype(np.int64), part[0]) if is_compared else None


def keys_meeting(conn: psycopg.Connection[Any], scene_id: int, pieces: Pieces, key: str) -> list[str]:
    """Return the keys of the objects of a scene whose boxes overlap those of the pieces, which belong to `key`."""
    if not len(pieces):
        return []
    near, _ = pieces_meeting(conn, scene_id, pieces, key, most_compared=0)
    kinds, ids = kinds_and_ids(np.unique(near.objects))
    return [found for _, _, found, _ in call_many(conn, "_keys_of", scene_id, kinds.tolist(), ids.tolist())]


def names_of(
    conn: psycopg.Connection[Any], scene_id: int, found: Conflicts
) -> dict[tuple[int, int], tuple[str, str | None]]:
    """Return keys and names of the objects of conflicts, by the code of their kind and their id."""
    kinds, ids = np.concatenate([found.a_kind, found.b_kind]), np.concatenate([found.a_id, found.b_id])
    members = sorted(set(zip(kinds.tolist(), ids.tolist(), strict=True)))
    kind, number = [kind for kind, _ in members], [number for _, number in members]
    return {
        (kind, number): (key, name) for kind, number, key, name in call_many(conn, "_keys_of", scene_id, kind, number)
    }


def next_probe(conn: psycopg.Connection[Any], passed_over: Sequence[int]) -> tuple[int, int] | None:
    """Return number and scene of the next request to answer, None if there is none; locks it in the transaction."""
    rows = call_many(conn, "_next_probe", list(passed_over))
    return (rows[0][0], rows[0][1]) if rows else None


def read_probe(conn: psycopg.Connection[Any], probe_id: int, scene_id: int) -> ProbeRequest:
    """Return a request."""
    kind, *rest = call(conn, "_probe_request", probe_id)
    return ProbeRequest(probe_id, scene_id, Kind.of_code(kind), *rest)


def plan_of(request: ProbeRequest) -> Area | Track:
    """Return the plan of a request; raises InvalidInput if it is not valid."""
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
        max_speed_kn=math.inf,
    )


def request_probes(conn: psycopg.Connection[Any], scene: str, plans: Sequence[Area | Track]) -> list[int]:
    """Send questions about plans to the workers and return their numbers; they see them once committed.

    Raises InvalidInput for a plan that is invalid, or that a question cannot express.
    """
    columns = [list(column) for column in zip(*map(_as_request, plans), strict=True)]
    with transaction(conn):
        (ids,) = call(conn, "_request_probes", scene, *columns)
    return list(ids)


def _as_request(plan: Area | Track) -> tuple[Any, ...]:
    """Return a plan as arguments of the SQL function _request_probe."""
    area, track = (plan, None) if isinstance(plan, Area) else (None, plan)
    path = outline = None
    if track is not None:
        seconds = track.times_us / 1e6
        fits = np.rint(seconds * 1e6) == track.times_us
        own = (track.outlines_m, track.floors_m, track.ceilings_m, track.tolerances)
        if any(one is not None for one in own) or not fits.all():
            rule = (
                "has a haven that changes its shape, heights of its legs, tolerances or times beyond the year 2242, "
                "which a worker cannot be asked about: probe without one"
            )
            raise InvalidInput(f"track {track.key!r}", "plan", rule)
        waypoints = np.column_stack([track.positions_deg, seconds])
        path = copy_binary.lines_m(waypoints, offsets([len(waypoints)])).data.tobytes()
        rings = copy_binary.closed_rings(track.outline_m, offsets([len(track.outline_m)]))
        outline = copy_binary.polygons(*rings, 0).data.tobytes()
    if plan.schedule is not None or (track.departures_us if track else cast("Area", plan).spans_us) is not None:
        rule = "has several activations, which a worker cannot be asked about: probe each on its own"
        raise InvalidInput(f"{'track' if track else 'area'} {plan.key!r}", "plan", rule)
    return (
        plan.key,
        (Kind.AREA if area else Kind.TRACK).code,
        shapely.to_wkb(area.footprint, byte_order=1) if area else None,
        area.start_us if area else None,
        area.end_us if area else None,
        path,
        outline,
        plan.floor_m,
        plan.ceiling_m,
        track.grow_mps if track else None,
    )


def wait_for_probes(
    conn: psycopg.Connection[Any], scene: Scene, plans: Sequence[Area | Track], ids: Sequence[int], timeout: timedelta
) -> list[list[Conflict]]:
    """Wait for the answers to questions about plans, all within one timeout; return the conflicts of each, by key.

    Raises NotCurrent on timeout, InvalidInput if a plan is invalid.
    """
    with transaction(conn):
        rows = call_by_name(conn, "_wait_for_probes", list(ids), timeout)
    of_plans: list[list[dict[str, Any]]] = [[] for _ in plans]
    for row in rows:
        of_plans[row.pop("n")].append(row)
    return [_conflicts_of(scene, plan, of_plan) for plan, of_plan in zip(plans, of_plans, strict=True)]


def _conflicts_of(scene: Scene, plan: Area | Track, rows: Sequence[dict[str, Any]]) -> list[Conflict]:
    mine = (Kind.AREA if isinstance(plan, Area) else Kind.TRACK), plan.key, plan.name
    answer = []
    for row in rows:
        other = Kind(row.pop("kind")), row.pop("key"), row.pop("name")
        pair = sorted([mine, other], key=lambda one: (one[0].code, one[1].encode()))
        row |= {"first_contact_lon_deg": row.pop("lon_deg"), "first_contact_lat_deg": row.pop("lat_deg")}
        answer.append(
            Conflict(
                scene=scene.name,
                a_key=pair[0][1],
                a_kind=pair[0][0],
                b_key=pair[1][1],
                b_kind=pair[1][0],
                method=scene.method,
                a_name=pair[0][2],
                b_name=pair[1][2],
                **fields_of(row),
            )
        )
    return sorted(answer, key=lambda one: (one.a_kind.code, one.a_key.encode(), one.b_key.encode()))


def answer_probe(
    conn: psycopg.Connection[Any], request: ProbeRequest, plan: Area | Track, found: Sequence[Conflict]
) -> None:
    """Write the conflicts found for a request."""
    rows = []
    for one in found:
        is_a = (one.a_key, one.a_kind) != (plan.key, request.kind)
        lon_deg, lat_deg = one.first_contact_deg or (None, None)
        rows.append(
            {
                "kind": (one.a_kind if is_a else one.b_kind).code,
                "key": one.a_key if is_a else one.b_key,
                "verdict": one.verdict,
                "periods": [[_sent(start), _sent(end)] for start, end in one.periods],
                "lon_deg": lon_deg,
                "lat_deg": lat_deg,
            }
            | {column.name: _sent(getattr(one, column.field)) for column in _SENT}
        )
    call(conn, "_answer_probe", request.probe_id, None, json.dumps(rows), None)


def answer_delays(conn: psycopg.Connection[Any], request: ProbeRequest, found: Delays) -> None:
    """Write the delays found for a request."""
    call(conn, "_answer_probe", request.probe_id, None, "[]", json.dumps(found.as_json()))


def refuse_probe(conn: psycopg.Connection[Any], probe_id: int, reason: str) -> None:
    """Write why a request cannot be answered."""
    call(conn, "_answer_probe", probe_id, reason, "[]", None)


def probe_failed(conn: psycopg.Connection[Any], probe_id: int, reason: str) -> None:
    """Count a failed attempt at a request; the third refuses it."""
    call(conn, "_probe_failed", probe_id, reason)


def _sent(value: Any) -> Any:
    return value.isoformat() if isinstance(value, datetime) else value
