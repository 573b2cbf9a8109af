"""Probe plans: find the pieces of a scene that a plan may meet; read, send and answer requests."""

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np
import psycopg
from psycopg.types.json import Jsonb

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.object_numbers import kinds_and_ids
from conflictdb.arrays.pieces import Pieces
from conflictdb.formats.conflict_text import as_json
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.record import MEASURED
from conflictdb.model.results import Admission, Conflict, Delays, Kind
from conflictdb.store.connection import call, call_by_name, call_many, transaction
from conflictdb.store.given_pieces import given
from conflictdb.store.listing import fields_of
from conflictdb.store.stored_pairs import Candidates, Parts


@dataclass(frozen=True, slots=True)
class Request:
    """A row of `probe_request`.

    kind : probe, delays or admit
    plans : a scene file without scene; None for delays
    max_speed_kn : of the tracks in plans, at most
    """

    probe_id: int
    kind: str
    scene: str
    plans: str | None
    options: dict[str, Any]
    max_speed_kn: float


def pieces_meeting(
    conn: psycopg.Connection[Any], scene_id: int, pieces: Pieces, key: str | None, most_compared: int
) -> tuple[Candidates, Parts | None]:
    """Return the pairs of one object's pieces with those of a scene, after stage 2 if few pieces are involved.

    Returns ids of rows, and the parts of the pieces; None: stage 2 has not run, and the pairs are rows whose boxes
    overlap in space, time and height. Leaves out the object `key`. The given pieces, which are in no row, are numbered
    -1, -2, ....

    most_compared : pairs of pieces up to which the database runs stage 2
    """
    rows = call_many(conn, "_pieces_meeting", scene_id, most_compared, key, *given(pieces))
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


class Claim(NamedTuple):
    """A request that a worker is about to answer; attempt : the number of this attempt, from 1."""

    probe_id: int
    attempt: int


def claim_probe(conn: psycopg.Connection[Any], passed_over: Sequence[int]) -> Claim | None:
    """Return the next request to answer, None if there is none; commit to count the attempt."""
    probe_id, attempt = call(conn, "_claim_probe", list(passed_over))
    return None if probe_id is None else Claim(probe_id, attempt)


def hold_probe(conn: psycopg.Connection[Any], probe_id: int, attempt: int) -> bool:
    """Lock a claimed request in the open transaction; return False if it is gone, or was claimed again."""
    return bool(call(conn, "_hold_probe", probe_id, attempt)[0])


def release_probe(conn: psycopg.Connection[Any], probe_id: int) -> None:
    """Take back an attempt at a request that the open transaction holds."""
    call(conn, "_release_probe", probe_id)


def read_request(conn: psycopg.Connection[Any], probe_id: int) -> Request:
    """Return a request; raises InvalidInput if its role may not make it any more."""
    return Request(probe_id, *call(conn, "_requested", probe_id))


def request_probe(conn: psycopg.Connection[Any], scene: str, plans: str) -> int:
    """Ask the workers about plans, the text of a scene file; return the number. They see it once it is committed."""
    with transaction(conn):
        return int(call(conn, "_request_probe", scene, plans)[0])


def wait_for_probe(
    conn: psycopg.Connection[Any], scene: Scene, plans: Sequence[Area | Track], probe_id: int, timeout: timedelta
) -> tuple[list[Conflict], bool]:
    """Wait for the answer to a question about plans; return their conflicts, by key, and whether the scene was current.

    Raises NotCurrent on timeout, InvalidInput if a plan is invalid.
    """
    with transaction(conn):
        (is_current,) = call(conn, "_await_answer", probe_id, timeout, "probe")
        rows = call_by_name(conn, "_wait_for_probe", probe_id, timeout)
    kinds = {one.key: Kind.AREA if isinstance(one, Area) else Kind.TRACK for one in plans}
    names = {one.key: one.name for one in plans}
    answer = []
    for row in rows:
        key = row.pop("plan_key")
        other = Kind.of_code(row.pop("kind")), row.pop("key"), row.pop("name")
        pair = sorted([(kinds[key], key, names[key]), other], key=lambda one: (one[0].code, one[1].encode()))
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
    answer.sort(key=lambda one: (one.a_kind.code, one.a_key.encode(), one.b_key.encode()))
    return answer, bool(is_current)


def answer_probe(
    conn: psycopg.Connection[Any], probe_id: int, keys: Collection[str], found: Sequence[Conflict], beyond: str
) -> None:
    """Write the conflicts found for a request.

    keys : of the plans
    beyond : why schedules may be missing; empty: they are not
    """
    rows = []
    for one in found:
        a, b = (one.a_key, one.a_kind, one.a_name), (one.b_key, one.b_kind, one.b_name)
        (plan_key, *_), (key, kind, name) = (a, b) if one.a_key in keys else (b, a)
        rows.append(
            {"plan_key": plan_key, "kind": kind.code, "key": key, "name": name, "verdict": one.verdict}
            | {column.name: _sent(getattr(one, column.field)) for column in MEASURED}
            | {"periods": [[_sent(end) for end in period] for period in one.periods]}
        )
    _answer(conn, probe_id, found=rows, answer={"beyond": beyond})


def answer_delays(conn: psycopg.Connection[Any], probe_id: int, found: Delays) -> None:
    """Write the delays found for a request."""
    _answer(conn, probe_id, answer=found.as_json())


def answer_admission(conn: psycopg.Connection[Any], probe_id: int, admission: Admission) -> None:
    """Write the answer to a request, in the transaction that put the plans."""
    rows = json.loads("".join(as_json(admission.conflicts)))
    conflicts = [row | {"is_new": one in admission.new} for row, one in zip(rows, admission.conflicts, strict=True)]
    _answer(conn, probe_id, answer={"admitted": admission.is_admitted, "conflicts": conflicts})


def refuse_probe(conn: psycopg.Connection[Any], probe_id: int, reason: str) -> None:
    """Write why a request cannot be answered."""
    _answer(conn, probe_id, error=reason)


def probe_failed(conn: psycopg.Connection[Any], probe_id: int, reason: str) -> None:
    """End a failed attempt at a request; the third refuses it."""
    call(conn, "_probe_failed", probe_id, reason)


def _answer(
    conn: psycopg.Connection[Any],
    probe_id: int,
    *,
    error: str | None = None,
    found: Sequence[dict[str, Any]] = (),
    answer: dict[str, Any] | None = None,
) -> None:
    call(conn, "_answer_request", probe_id, error, Jsonb(list(found)), None if answer is None else Jsonb(answer))


def _sent(value: Any) -> Any:
    return value.isoformat() if isinstance(value, datetime) else value
