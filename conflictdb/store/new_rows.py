"""Write many conflicts of pairs without a row: complete the rows here and COPY them into their tables.

Takes half the time of the statement with arrays (_write_run), which handles rows that change existing ones.
"""

import json
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.polygons import Polygons
from conflictdb.model.results import Verdict
from conflictdb.store import copy_binary
from conflictdb.store.conflict_encoding import columns_of
from conflictdb.store.connection import call
from conflictdb.store.parameters import Array

# Greater than every version.
_NEVER: Final = 2**63 - 1
# A payload has less than 8000 bytes. A longer event than this is sent as its number only (_notify_events).
_PAYLOAD_BYTES: Final = 7_900
_EVENT_BYTES: Final = 1_000
# The columns of a conflict that its event repeats.
_OF_EVENT: Final = [
    "scene_id", "run_id", "conflict_id", "a_kind", "a_key", "b_kind", "b_key", "periods", "verdict", "time_error_s",
    "closest_at", "closest_m", "closest_error_m",
]  # fmt: skip


@dataclass(slots=True)
class NewRows:
    """The ids and names that complete rows of new conflicts.

    at_us : when the run began to write, microseconds since 1970
    scene : its name; None if listeners must not know it
    conflict_ids, event_ids : (n,) reserved ids
    objects : (m,) numbers of all objects in these conflicts, increasing (_object_number)
    keys, keys_json : (m,) their keys, plain and as JSON
    first_versions : (m,) the first version with that number; greater than every version if the object was removed
    taken : how many of the ids are used
    """

    scene_id: int
    run_id: int
    at_us: int
    method: str
    scene: str | None
    conflict_ids: NDArray[np.int64]
    event_ids: NDArray[np.int64]
    objects: NDArray[np.int64]
    keys: NDArray[np.object_]
    keys_json: NDArray[np.object_]
    first_versions: NDArray[np.int64]
    taken: int = 0


@dataclass(frozen=True, slots=True)
class Finished:
    """Encoded rows for COPY.

    conflicts, events : names of columns, and the rows
    opened, unresolved : their numbers
    notifications : payloads
    """

    run_id: int
    conflicts: tuple[list[str], list[bytes]]
    events: tuple[list[str], list[bytes]]
    opened: int
    unresolved: int
    notifications: Array


def begin_new(
    conn: psycopg.Connection[Any],
    scene_id: int,
    run_id: int | None,
    run: str,
    method: str,
    objects: NDArray[np.int64],
    count: int,
) -> NewRows | None:
    """Reserve ids for `count` rows of new conflicts among some objects; a run begins if there is none yet.

    objects : their numbers, increasing (_object_number)

    Returns None, without effect, where row-level security forbids COPY.
    """
    object_array = copy_binary.array([copy_binary.fixed(objects, "i8")], "bigint")
    run_id, at_us, scene, conflict_ids, event_ids, keys, first_versions = call(
        conn, "_begin_new_rows", scene_id, run_id, run, count, object_array
    )
    if run_id is None:
        return None
    names = ["" if key is None else key for key in keys]
    return NewRows(
        scene_id,
        run_id,
        at_us,
        method,
        scene,
        copy_binary.int8_array(conflict_ids),
        copy_binary.int8_array(event_ids),
        objects,
        np.array([name.encode() for name in names], dtype=object),
        np.array([json.dumps(name, ensure_ascii=False).encode() for name in names], dtype=object),
        np.array([_NEVER if first is None else first for first in first_versions], np.int64),
    )


def finish_new(new: NewRows, found: Conflicts, digest: NDArray[np.int64], region: Polygons) -> Finished:
    """Return the encoded rows of new conflicts (k,) with their digests and regions (empty for near pairs only).

    Pairs with a removed object drop out: the removal has a mark of its own. Its number may belong to another object by
    now.
    """
    a, b = (
        np.searchsorted(new.objects, of)
        for of in (numbers_of(found.a_kind, found.a_id), numbers_of(found.b_kind, found.b_id))
    )
    there = np.flatnonzero((new.first_versions[a] <= found.a_version) & (new.first_versions[b] <= found.b_version))
    # The area comes first, else the smaller key.
    turned = (found.a_kind == found.b_kind) & (new.keys[b] < new.keys[a])
    a, b = np.where(turned, b, a), np.where(turned, a, b)
    found = found.turned(turned)
    if len(there) < len(found):
        a, b, found, region, digest = a[there], b[there], found.take(there), region.take(there), digest[there]
    n = len(found)
    some = slice(new.taken, new.taken + n)
    new.taken += n
    began_at = copy_binary.instants(np.full(n, new.at_us))
    columns = columns_of(found, region) | {
        "scene_id": copy_binary.fixed(np.full(n, new.scene_id), "i8"),
        "run_id": copy_binary.fixed(np.full(n, new.run_id), "i8"),
        "a_key": copy_binary.Ragged.of(new.keys[a].tolist()),
        "b_key": copy_binary.Ragged.of(new.keys[b].tolist()),
        "method": np.tile(np.frombuffer(new.method.encode(), np.uint8), (n, 1)),
        "found_at": began_at,
        "digest": copy_binary.fixed(digest, "i8"),
        "conflict_id": copy_binary.fixed(new.conflict_ids[some], "i8"),
    }
    # Near pairs are not conflicts and open none.
    opens = np.flatnonzero(found.verdict != Verdict.NEAR.code)
    event_ids = new.event_ids[some][opens]
    events = {name: columns[name] for name in _OF_EVENT}
    if len(opens) < n:
        events = {name: copy_binary.taken(column, opens) for name, column in events.items()}
    events |= {
        "conflict_event_id": copy_binary.fixed(event_ids, "i8"),
        "kind": np.tile(np.frombuffer(b"opened", np.uint8), (len(opens), 1)),
        "at": began_at[opens],
        "opened_at": began_at[opens],
    }
    payloads = _notifications(
        new.scene, new.run_id, event_ids.tolist(), new.keys_json[a[opens]].tolist(), new.keys_json[b[opens]].tolist()
    )
    return Finished(
        new.run_id,
        (list(columns), copy_binary.rows(columns)),
        (list(events), copy_binary.rows(events)),
        len(opens),
        int(np.count_nonzero(found.verdict == Verdict.UNRESOLVED.code)),
        copy_binary.array([copy_binary.Ragged.of(payloads)], "text"),
    )


def copy_new(conn: psycopg.Connection[Any], finished: Finished) -> int:
    """Write rows of new conflicts and their events, and notify listeners; return the run."""
    copy_binary.send_rows(conn, "conflictdb.conflict", *finished.conflicts)
    copy_binary.send_rows(conn, "conflictdb.conflict_event", *finished.events)
    call(conn, "_end_new_rows", finished.run_id, finished.opened, finished.unresolved, finished.notifications)
    return finished.run_id


def _notifications(
    scene: str | None, run_id: int, event_ids: list[int], a_keys: list[bytes], b_keys: list[bytes]
) -> list[bytes]:
    """Return what tells of new conflicts, as _notify_events does: as many payloads as that takes."""
    of = json.dumps({"scene": scene, "run": run_id, "kind": "opened"}, ensure_ascii=False)
    head = of[:-1].encode() + b', "events": ['
    if scene is None:
        events = [b"[%d]" % number for number in event_ids]
    else:
        events = [b"[%d, %b, %b]" % event for event in zip(event_ids, a_keys, b_keys, strict=True)]
    events = [
        event if len(event) <= _EVENT_BYTES - 2 else b"[%d]" % number
        for number, event in zip(event_ids, events, strict=True)
    ]
    # Two events are separated by a comma and a space.
    room = max(_PAYLOAD_BYTES - _EVENT_BYTES - len(head), 1)
    chunk = np.cumsum([len(event) + 2 for event in events], dtype=np.int64) // room
    bounds = [0, *(np.flatnonzero(np.diff(chunk)) + 1).tolist(), len(events)]
    return [head + b", ".join(events[first:end]) + b"]}" for first, end in pairwise(bounds) if first < end]
