"""Write conflicts computed outside the database into a scene, with the routine that detection uses.

All in one transaction that holds the scene's lock. The conflicts hold for the object states that they were computed
from. A digest of each object's contents decides whether its state is the same.

The write-back replaces pairs and clears marks only for objects in the same state. Objects that changed since, are new
or were removed keep their marks and rows for the next detection. An object outside the computed set is marked if an
object inside had a mark, because that pair was never compared.
"""

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb import store
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.polygons import Polygons
from conflictdb.core.memory_budget import MEMORY_MB, MemoryBudget
from conflictdb.errors import InvalidInput
from conflictdb.jobs.detect import refresh_pieces
from conflictdb.jobs.difference_rows import refresh_differences
from conflictdb.model.plans import Scene

_NOT_THESE: Final = (
    "are none of those that the conflicts were computed from, as they were then: export the scene, and compute again"
)


@dataclass(frozen=True, slots=True)
class WrittenBack(store.RunOutcome):
    """The result of a write-back; its counts of conflicts are those of a `Run`.

    objects : objects of the scene in the state that the conflicts were computed from
    behind : objects that changed since (in the scene or in a file), are new, were removed or left out; their pairs stay
        pending
    """

    objects: int
    behind: int
    total_s: float


def write_back(
    conn: psycopg.Connection[Any],
    scene: str,
    settings: Scene,
    computed: store.ObjectStates,
    conflicts: Iterator[tuple[Conflicts, Polygons]],
    *,
    lock_timeout_s: float | None = None,
    say: store.Say = print,
    memory_mb: int = MEMORY_MB,
) -> WrittenBack:
    """Write conflicts computed outside into a scene; idempotent.

    Parameters
    ----------
    conn : psycopg connection without an open transaction
    settings, computed : settings and object states that the conflicts were computed from, complete
    conflicts : batches of conflicts, by object numbers, with their regions
    lock_timeout_s, say, memory_mb : see `detect`

    Raises
    ------
    InvalidInput
        The scene has other settings, or no object in the computed state; nothing was written.
    LockTimeout
        A lock was not free within `lock_timeout_s`; nothing was written.
    StoreError
        The database failed; nothing was changed.
    """
    started = time.perf_counter()
    store.require_idle(conn, "a write-back")
    store.require_writable(conn)
    with store.waiting_at_most(conn, store.longest_wait_s(lock_timeout_s)):
        scene_id = store.scene_id(conn, scene)
    record = store.RunRecord(method="", settings={}, started_at=datetime.now(UTC))
    try:
        store.begin_locked(conn, scene_id, scene, lock_timeout_s, say)
        _check_settings(scene, store.read_settings(conn, scene_id), settings)
        current = store.object_states(conn, scene_id)
        same = _same(scene, current, computed)
        pending = store.pending(conn, scene_id)
        setup, record, _ = refresh_pieces(conn, scene_id, pending, record, MemoryBudget.of(memory_mb), is_first=False)
        store.cover(conn, scene_id, same)
        staged = store.begin_write(conn, scene_id, record)
        staged.known.leave(same)
        for found, region in _each(conflicts, computed, same):
            for part in store.differing(staged, found):
                store.stage(conn, staged, part, region.take(part.rows))
        refresh_differences(conn, scene_id, setup, None, MemoryBudget.of(memory_mb))
        kept = {**record.settings, "is_written_back": True}
        outcome = store.end_write(conn, staged, replace(record, settings=kept))
        with store.translated():
            conn.commit()
    except BaseException:
        conn.rollback()
        with store.naming_grants(conn):
            raise
    return WrittenBack(
        **asdict(outcome),
        objects=len(same),
        behind=len(np.union1d(current.number, computed.number)) - len(same),
        total_s=time.perf_counter() - started,
    )


def _check_settings(scene: str, known: Scene, given: Scene) -> None:
    for name in known.differing(given):
        now, then = getattr(known, name), getattr(given, name)
        rule = f"is {now!s}, but the conflicts were computed with {then!s}: they would say something untrue"
        raise InvalidInput(f"scene {scene!r}", name, rule)


def _same(scene: str, current: store.ObjectStates, computed: store.ObjectStates) -> NDArray[np.int64]:
    """Return the numbers of the objects in the computed state, increasing; raises InvalidInput if there are none."""
    who = f"scene {scene!r}"
    if not len(computed):
        raise InvalidInput(who, "objects", _NOT_THESE)
    if (np.diff(computed.number) == 0).any():
        raise InvalidInput(who, "objects", "are listed twice by what was computed")
    row = computed.rows(current.number)
    is_same = (computed.version[row] == current.version) & (computed.digest[row] == current.digest)
    same = np.flatnonzero((row >= 0) & is_same)
    other = np.flatnonzero(current.key[same] != computed.key[row[same]])
    if other.size:
        here, there = current.key[same[other[0]]], computed.key[row[same[other[0]]]]
        rule = f"are of another database: {there!r} there has the number that {here!r} has here"
        raise InvalidInput(who, "objects", rule)
    if not same.size:
        raise InvalidInput(who, "objects", _NOT_THESE)
    return np.asarray(current.number[same])


def _each(
    conflicts: Iterator[tuple[Conflicts, Polygons]], computed: store.ObjectStates, same: NDArray[np.int64]
) -> Iterator[tuple[Conflicts, Polygons]]:
    """Yield the conflicts between objects in the computed state; raises InvalidInput for objects not in the set."""
    seen: set[tuple[int, int]] = set()
    for found, region in conflicts:
        members = []
        for kind, ids, version in (
            (found.a_kind, found.a_id, found.a_version),
            (found.b_kind, found.b_id, found.b_version),
        ):
            number = numbers_of(kind, ids)
            row = computed.rows(number)
            if ((row < 0) | (computed.version[row] != version)).any():
                raise InvalidInput("conflicts", "objects", "are not all of those that they say they were computed from")
            members.append(number)
        pairs = list(zip(np.minimum(*members).tolist(), np.maximum(*members).tolist(), strict=True))
        known = len(seen)
        seen.update(pairs)
        if len(seen) < known + len(pairs):
            raise InvalidInput("conflicts", "objects", "are twice in them: two answers for one pair")
        kept = np.flatnonzero(np.isin(members[0], same) & np.isin(members[1], same))
        yield found.take(kept), region.take(kept)
