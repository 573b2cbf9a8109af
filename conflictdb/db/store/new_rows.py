"""Rows of pairs that have none yet, where they are many: finished here, and copied straight into their tables.

A statement that takes them as arrays (_write_run) costs twice as much. It is for those that change what is known.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.polygons import Polygons
from conflictdb.db.store import copy_binary
from conflictdb.db.store.conflict_columns import columns_of
from conflictdb.db.store.connection import call
from conflictdb.db.store.known_pairs import numbers
from conflictdb.results import Verdict

# Objects that are remembered: 200 bytes each, and 2 us to ask for one again.
_MOST_MEMBERS: Final = 100_000
# A payload has less than 8000 bytes. An event that is longer than this is told by its number alone (_notify_events).
_PAYLOAD_BYTES: Final = 7_900
_EVENT_BYTES: Final = 1_000
# What an event has of its conflict.
_OF_EVENT: Final = [
    "scene_id", "run_id", "conflict_id", "a_kind", "a_key", "b_kind", "b_key", "periods", "verdict", "time_error_s",
    "closest_at", "closest_m", "closest_error_m",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class NewRows:
    """Some conflicts that have no row yet.

    conflicts : (k,) the object of the smaller kind and number first
    digest : (k,) of each
    region : (k,) where each is; known, but of pairs that are only near
    """

    conflicts: Conflicts
    digest: NDArray[np.int64]
    region: Polygons


@dataclass(slots=True)
class Members:
    """Who the objects are, as the transaction sees them.

    known : by their numbers (_object_number): key, key as JSON, and the first version that is theirs; None: there is
        no such object
    """

    known: dict[int, tuple[bytes, bytes, int] | None] = field(default_factory=dict)

    def unknown(self, objects: Sequence[int]) -> list[int]:
        """Return those of some objects that must be asked for."""
        if len(self.known) > _MOST_MEMBERS:
            self.known.clear()
        return [number for number in objects if number not in self.known]

    def add(self, objects: Sequence[int], keys: Sequence[str | None], first_versions: Sequence[int]) -> None:
        """Remember objects."""
        for number, key, first in zip(objects, keys, first_versions, strict=True):
            told = None if key is None else (key.encode(), json.dumps(key, ensure_ascii=False).encode(), first)
            self.known[number] = told


def copy_new(
    conn: psycopg.Connection[Any],
    scene_id: int,
    run_id: int | None,
    run: str,
    method: str,
    members: Members,
    new: NewRows,
) -> int | None:
    """Write rows of new conflicts, and their events, and notify of these; returns the run, which begins without one.

    Returns None, and has done nothing, where row-level security lets nobody COPY. Pairs of which an object is there no
    longer drop out: that has a mark of its own. Its number may be another object's by now.
    """
    found = new.conflicts
    of = np.concatenate([numbers(found.a_kind, found.a_id), numbers(found.b_kind, found.b_id)])
    unique, member = np.unique(of, return_inverse=True)
    objects = unique.tolist()
    asked = members.unknown(objects)
    run_id, at_us, scene, conflict_ids, event_ids, keys, first_versions = call(
        conn, "_begin_new_rows", scene_id, run_id, run, len(found), asked
    )
    if run_id is None:
        return None
    members.add(asked, keys or [], first_versions or [])
    who = [members.known[number] or (b"", b"", None) for number in objects]
    key, told = (np.array([one[k] for one in who], dtype=object) for k in (0, 1))
    first = np.array([np.iinfo(np.int64).max if one[2] is None else one[2] for one in who])
    a, b = member[: len(found)], member[len(found) :]
    there = np.flatnonzero((first[a] <= found.a_version) & (first[b] <= found.b_version))
    # The area first, else the smaller key.
    turned = (found.a_kind == found.b_kind) & (key[b] < key[a])
    a, b = np.where(turned, b, a), np.where(turned, a, b)
    found, region, digest = found.turned(turned), new.region, new.digest
    if len(there) < len(found):
        a, b, found, region, digest = a[there], b[there], found.take(there), region.take(there), digest[there]
    began_at = copy_binary.instants(np.full(len(found), at_us))
    columns = columns_of(found, region) | {
        "scene_id": _same(scene_id, len(found)),
        "run_id": _same(run_id, len(found)),
        "a_key": copy_binary.Ragged.of(key[a].tolist()),
        "b_key": copy_binary.Ragged.of(key[b].tolist()),
        "method": np.tile(np.frombuffer(method.encode(), np.uint8), (len(found), 1)),
        "found_at": began_at,
        "digest": copy_binary.fixed(digest, "i8"),
        "conflict_id": copy_binary.fixed(copy_binary.int8_array(conflict_ids)[: len(found)], "i8"),
    }
    copy_binary.send(conn, "conflictdb.conflict", columns)
    # Pairs that are only near are no conflicts: they open none.
    opens = np.flatnonzero(found.verdict != Verdict.NEAR.code)
    event_id = copy_binary.int8_array(event_ids)[: len(opens)]
    events = {name: columns[name] for name in _OF_EVENT}
    if len(opens) < len(found):
        events = {name: copy_binary.taken(column, opens) for name, column in events.items()}
    events |= {
        "conflict_event_id": copy_binary.fixed(event_id, "i8"),
        "kind": np.tile(np.frombuffer(b"opened", np.uint8), (len(opens), 1)),
        "at": began_at[opens],
        "opened_at": began_at[opens],
    }
    copy_binary.send(conn, "conflictdb.conflict_event", events)
    unresolved = int(np.count_nonzero(found.verdict == Verdict.UNRESOLVED.code))
    payloads = _notifications(scene, run_id, event_id.tolist(), told[a[opens]].tolist(), told[b[opens]].tolist())
    notifications = copy_binary.array([copy_binary.Ragged.of(payloads)], "text")
    call(conn, "_end_new_rows", run_id, len(opens), unresolved, notifications)
    return int(run_id)


def _same(number: int, n: int) -> copy_binary.Bytes:
    return copy_binary.fixed(np.full(n, number), "i8")


def _notifications(
    scene: str | None, run_id: int, event_ids: list[int], a_keys: list[bytes], b_keys: list[bytes]
) -> list[bytes]:
    """Return what tells of new conflicts, as _notify_events does: as many payloads as that takes."""
    of = json.dumps({"scene": scene, "run": run_id, "kind": "opened"}, ensure_ascii=False)
    head = of[:-1].encode() + b', "events": ['
    if scene is None:
        events = [b"[%d]" % number for number in event_ids]
    else:
        events = [b"[%d, %b, %b]" % told for told in zip(event_ids, a_keys, b_keys, strict=True)]
    events = [
        told if len(told) <= _EVENT_BYTES - 2 else b"[%d]" % number
        for number, told in zip(event_ids, events, strict=True)
    ]
    # Between two: a comma and a space.
    room = max(_PAYLOAD_BYTES - _EVENT_BYTES - len(head), 1)
    chunk = np.cumsum([len(told) + 2 for told in events], dtype=np.int64) // room
    bounds = [0, *(np.flatnonzero(np.diff(chunk)) + 1).tolist(), len(events)]
    return [head + b", ".join(events[first:end]) + b"]}" for first, end in pairwise(bounds) if first < end]
