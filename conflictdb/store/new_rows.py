"""Write many conflicts of pairs without a row: complete the rows here and COPY them into their tables."""

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
from conflictdb.arrays.ragged import offsets
from conflictdb.kernel.rows import Part, interleaved
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
    keys, keys_column : (m,) their keys
    named : (m + 1,) what an event adds for each object: its key as JSON; the last is empty
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
    keys_column: copy_binary.Ragged
    named: copy_binary.Ragged
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
    plain = [name.encode() for name in names]
    return NewRows(
        scene_id,
        run_id,
        at_us,
        method,
        scene,
        copy_binary.int8_array(conflict_ids),
        copy_binary.int8_array(event_ids),
        objects,
        np.array(plain, dtype=object),
        copy_binary.Ragged.of(plain),
        copy_binary.Ragged.of([*(b", " + json.dumps(name, ensure_ascii=False).encode() for name in names), b""]),
        np.array([_NEVER if first is None else first for first in first_versions], np.int64),
    )


def finish_new(new: NewRows, found: Conflicts, digest: NDArray[np.int64], region: Polygons) -> Finished:
    """Return the encoded rows of new conflicts (k,) with their digests and regions (empty: they have none).

    Pairs with a removed object drop out: the removal has a mark of its own.
    """
    a, b = (
        np.searchsorted(new.objects, of)
        for of in (numbers_of(found.a_kind, found.a_id), numbers_of(found.b_kind, found.b_id))
    )
    there = np.flatnonzero((new.first_versions[a] <= found.a_version) & (new.first_versions[b] <= found.b_version))
    # The area comes first, else the smaller key.
    turned = found.a_kind == found.b_kind
    turned[turned] = new.keys[b[turned]] < new.keys[a[turned]]
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
        "a_key": new.keys_column.take(a),
        "b_key": new.keys_column.take(b),
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
    payloads = _notifications(new, event_ids, a[opens], b[opens])
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
    new: NewRows, event_ids: NDArray[np.int64], a: NDArray[np.int64], b: NDArray[np.int64]
) -> list[bytes]:
    """Return what tells of new conflicts, as _notify_events does."""
    of = json.dumps({"scene": new.scene, "run": new.run_id, "kind": "opened"}, ensure_ascii=False)
    head = of[:-1].encode() + b', "events": ['
    digits, sizes = _decimal(event_ids), np.diff(new.named.offset)
    length = len("[]") + np.diff(digits.offset) + sizes[a] + sizes[b]
    is_short = (length > _EVENT_BYTES - 2) | (new.scene is None)
    nobody = len(new.objects)
    one, other = (new.named.take(np.where(is_short, nobody, of)) for of in (a, b))
    opening, closing = (np.tile(np.frombuffer(mark, np.uint8), (len(a), 1)) for mark in (b"[", b"], "))
    # Two events are separated by a comma and a space.
    names: list[Part] = [(column.data, column.offset) for column in (digits, one, other)]
    text = interleaved([opening, *names, closing]).tobytes()
    ends = np.cumsum(np.where(is_short, length - sizes[a] - sizes[b], length) + 2)
    room = max(_PAYLOAD_BYTES - _EVENT_BYTES - len(head), 1)
    bounds = [0, *ends[np.flatnonzero(np.diff(ends // room))].tolist(), *ends[-1:].tolist()]
    return [head + text[first : end - 2] + b"]}" for first, end in pairwise(bounds)]


def _decimal(numbers: NDArray[np.int64]) -> copy_binary.Ragged:
    """Return numbers (n,), none of them negative, as decimal text."""
    places = len(str(int(numbers.max(initial=0))))
    digits = numbers[:, None] // 10 ** np.arange(places - 1, -1, -1, dtype=np.int64)
    length = places - np.count_nonzero(digits[:, :-1] == 0, axis=1)
    is_there = np.arange(places) >= places - length[:, None]
    return copy_binary.Ragged((digits % 10 + ord("0")).astype(np.uint8)[is_there], offsets(length))
