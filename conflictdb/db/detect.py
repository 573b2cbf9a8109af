"""Detection: a scene of the database taken through the four stages.

The only module that knows both halves: the database, where stage 1 runs, and the arrays of the stages after it.

Where few objects changed, one transaction does all of it; else there are two. The first refreshes the pieces of the
objects that changed. The second sees one state of the database: it recomputes the pairs with a changed member, replaces
their conflicts, records the run and clears the marks that the pieces cover. So after a crash at any point either
nothing or all of it happened to the conflicts, and marks made meanwhile stay.

Each transaction holds the scene's lock, which ends with it. Another detection may come in between, whole or in part.
The lock counts how often it was taken: a second transaction that does not follow its first one makes the pieces anew.
"""

import logging
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from typing import Any, Final

import psycopg

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.db import attached, store
from conflictdb.db.sources import FewSource, SceneSource
from conflictdb.errors import ConflictDBError, LockTimeout, StoreError
from conflictdb.methods import Method
from conflictdb.model import Scene
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.pipeline.memory import MEMORY_MB, Memory
from conflictdb.pipeline.run import Funnel, Progress, run_scene
from conflictdb.results import Kind
from conflictdb.waiting import answer_of, begun_aside, end_aside

__all__ = ["Progress", "Run", "detect", "detect_pending", "refresh_pieces"]

_log = logging.getLogger(__name__)

# So many changed objects at most are detected by one transaction: making their pieces again, if it fails, costs little.
_FEW_OBJECTS: Final = 100
# Changed objects that are read first; then as many as their pieces leave room for.
_FIRST_OBJECTS: Final = 2_000


@dataclass(frozen=True, slots=True)
class Run:
    """What a detection did.

    run_id : its row in the table `run`
    candidate_pairs, intersecting_pairs, projected_pairs, window_pairs, solved_pairs, met_pairs : pairs of pieces after
        stage 1, after stage 2, that stage 3 worked on, after stage 3, that stage 4 decided, and reported
    conflicts, unresolved : of the scene now, also those this run had no reason to look at
    opened, changed, closed : conflicts that are new, have other periods or another verdict, or are gone
    pieces_s, stage1_s, stage2_s, stage3_s, stage4_s, total_s : seconds; of stage 3 with method exact, those of the
        pairs that were decided in closed form
    """

    run_id: int
    method: Method
    candidate_pairs: int
    intersecting_pairs: int
    projected_pairs: int
    window_pairs: int
    solved_pairs: int
    met_pairs: int
    conflicts: int
    unresolved: int
    opened: int
    changed: int
    closed: int
    pieces_s: float
    stage1_s: float
    stage2_s: float
    stage3_s: float
    stage4_s: float
    total_s: float


class _NothingPending(Exception):
    """No object of the scene waits for a detection."""


def detect(
    conn: psycopg.Connection[Any],
    scene: str,
    *,
    full: bool = False,
    jobs: int | None = None,
    progress: Progress | None = None,
    lock_timeout_s: float | None = None,
    say: store.Say = _log.warning,
    memory_mb: int = MEMORY_MB,
) -> Run:
    """Bring the conflicts of a scene up to date, with the scene's own settings, and return what was done.

    Objects are brought in step with the tables that are attached to the scene first.

    Parameters
    ----------
    conn : psycopg connection without an open transaction
    full : compute everything again, also what did not change
    jobs : threads that stage 4 may use; None is one per processor
    progress : told now and then how many pairs stage 4 has decided, and of how many
    lock_timeout_s : wait no longer than this, seconds, for another detection of the scene, or for any other lock; None
        waits for another detection as long as it takes, and 300 s for any other lock; 0 waits for no other detection,
        and 10 s for any other lock
    say : told after 5 s of waiting for another detection who that is
    memory_mb : of this process, megabytes, that the detection keeps below; with less it works in smaller parts

    Raises
    ------
    InvalidInput
        There is no such scene.
    LockTimeout
        Somebody else kept a lock for `lock_timeout_s`; nothing was done.
    StoreError
        The database failed; conflicts and marks are as they were, and the failure is recorded as a run.
    """
    way = _Way(jobs or os.cpu_count() or 1, progress, lock_timeout_s, say, Memory.of(memory_mb))
    with store.translated(), store.waiting_at_most(conn, store.longest_wait_s(lock_timeout_s)):
        return _run(conn, scene, full, way)


def detect_pending(
    conn: psycopg.Connection[Any], scene: str, *, jobs: int | None = None, memory_mb: int = MEMORY_MB
) -> Run | None:
    """Do as `detect`, but never wait for another detection of the scene, and do nothing where nothing changed.

    Returns None if nothing was to do. Raises LockTimeout if another detection is at work, or if somebody keeps another
    lock for 10 s; it says who that is.
    """
    way = _Way(jobs or os.cpu_count() or 1, None, 0.0, _log.debug, Memory.of(memory_mb), only_pending=True)
    try:
        with store.translated(), store.waiting_at_most(conn, store.longest_wait_s(way.lock_timeout_s)):
            return _run(conn, scene, False, way)
    except _NothingPending:
        return None


@dataclass(frozen=True, slots=True)
class _Way:
    """How to go about a detection: the parameters of `detect`, and whether one that finds nothing to do is a run."""

    jobs: int
    progress: Progress | None
    lock_timeout_s: float | None
    say: store.Say
    memory: Memory
    only_pending: bool = False


def _run(conn: psycopg.Connection[Any], scene: str, full: bool, way: _Way) -> Run:
    started = time.perf_counter()
    store.require_idle(conn, "a detection")
    store.require_writable(conn)
    record = store.RunRecord(method="", settings={}, started_at=datetime.now(UTC))
    begun: store.Begun | None = None
    try:
        begun = _begin(conn, scene, full, way)
        scene_id = begun.scene_id
        if begun.few is not None:
            return _detect_few(conn, begun, begun.few, record, way, started)
        if full:
            store.cover_all(conn, scene_id)
        pending = _pending(conn, scene_id, way)
        is_first = pending.objects > _FEW_OBJECTS
        settings, record = refresh_pieces(conn, scene_id, pending, record, way.memory, is_first=is_first, is_full=full)
        if is_first:
            with store.translated():
                conn.commit()
            followed = store.begin_locked(conn, scene_id, scene, way.lock_timeout_s, way.say)
            if followed != begun.taken + 1 or store.read_settings(conn, scene_id) != settings:
                # Another detection came in between, or other settings: whatever is still marked becomes ours now.
                pending = _pending(conn, scene_id, way)
                settings, record = refresh_pieces(conn, scene_id, pending, record, way.memory, is_first=False)
        writing = _Aside(conn, partial(store.begin_write, conn, scene_id, record))
        source = SceneSource(conn, scene_id, way.memory, writing.start)
        return _refresh_conflicts(conn, writing.result, source, settings, record, way, started)
    except BaseException as error:
        # The lock goes with the transaction. A lost connection cannot record anything; the marks are still there.
        is_removed = False
        with suppress(psycopg.Error):
            end_aside(conn, conn.cancel_safe)
        with suppress(ConflictDBError, psycopg.Error):
            conn.rollback()
            if isinstance(error, Exception) and not isinstance(error, LockTimeout | _NothingPending):
                scene_id = store.scene_id(conn, scene) if begun is None else begun.scene_id
                is_removed = not store.is_scene(conn, scene_id)
                if not is_removed:
                    store.record_failure(conn, scene_id, record, f"{type(error).__name__}: {error}")
        if is_removed:
            raise StoreError(f"scene {scene!r} was removed while it was detected") from error
        with store.naming_grants(conn):
            raise


def _begin(conn: psycopg.Connection[Any], scene: str, full: bool, way: _Way) -> store.Begun:
    """Begin the first transaction; before that, objects are brought in step with tables that are attached."""
    few = -1 if full else _FEW_OBJECTS
    again: bool | None = not way.only_pending
    while True:
        begun = store.begin_detection(conn, scene, few, way.lock_timeout_s, way.say, again)
        if not begun.is_behind:
            return begun
        with store.translated():
            conn.rollback()
        attached.follow(conn, scene, again=again is True)
        again = None


def _detect_few(
    conn: psycopg.Connection[Any],
    begun: store.Begun,
    few: store.Few,
    record: store.RunRecord,
    way: _Way,
    started: float,
) -> Run:
    """Do all of a detection of few changed objects in the open transaction, and commit."""
    if way.only_pending and not few.numbers:
        raise _NothingPending
    clock = time.perf_counter()
    settings, scene_id = begun.settings, begun.scene_id
    areas = store.some_areas(conn, scene_id, few.area_ids) if few.area_ids else AreaBatch.of([])
    tracks = store.some_tracks(conn, scene_id, few.track_ids) if few.track_ids else TrackBatch.of([])
    pieces = pieces_of(settings, plane_of(settings), areas, tracks)
    record = replace(record, method=settings.method, settings=_told(settings))
    if few.known_objects is not None:
        record = replace(record, more_objects=len(areas) + len(tracks) - few.known_objects)
    record = replace(record, counted={"pieces_s": time.perf_counter() - clock})
    source = FewSource(conn, scene_id, way.memory, few.srid, pieces)
    staged = store.begin_write(conn, scene_id, record, few.numbers)
    return _refresh_conflicts(conn, lambda: staged, source, settings, record, way, started)


def _told(settings: Scene) -> dict[str, Any]:
    """Return settings as a run records them."""
    return {name: value for name, value in asdict(settings).items() if name != "name"}


def _pending(conn: psycopg.Connection[Any], scene_id: int, way: _Way) -> store.Pending:
    """Return what waits for a detection; raises _NothingPending where nothing does, and that is no run."""
    pending = store.pending(conn, scene_id)
    if way.only_pending and not pending.objects:
        raise _NothingPending
    return pending


def refresh_pieces(
    conn: psycopg.Connection[Any],
    scene_id: int,
    pending: store.Pending,
    record: store.RunRecord,
    memory: Memory,
    *,
    is_first: bool,
    is_full: bool = False,
) -> tuple[Scene, store.RunRecord]:
    """Make the pieces of the changed objects anew."""
    clock = time.perf_counter()
    settings = store.read_settings(conn, scene_id)
    made = _made_pieces(conn, scene_id, pending, settings, memory)
    store.replace_pieces(conn, scene_id, made, is_first=is_first, is_full=is_full)
    took_s = record.counted.get("pieces_s", 0.0) + time.perf_counter() - clock
    return settings, replace(record, method=settings.method, settings=_told(settings), counted={"pieces_s": took_s})


def _made_pieces(
    conn: psycopg.Connection[Any], scene_id: int, pending: store.Pending, scene: Scene, memory: Memory
) -> Iterator[Pieces]:
    """Yield the pieces of the changed objects of a scene, those of some objects at a time."""
    plane = plane_of(scene)
    no_areas, no_tracks = AreaBatch.of([]), TrackBatch.of([])
    for kind in (kind for kind, count in ((Kind.AREA, pending.areas), (Kind.TRACK, pending.tracks)) if count):
        most, last = _FIRST_OBJECTS, -(2**63)
        while True:
            if kind is Kind.AREA:
                areas = store.changed_areas(conn, scene_id, last, most)
                numbers, objects = areas.area_id, (areas, no_tracks)
            else:
                tracks = store.changed_tracks(conn, scene_id, last, most)
                numbers, objects = tracks.track_id, (no_areas, tracks)
            if len(numbers):
                pieces = pieces_of(scene, plane, *objects)
                yield pieces
            if len(numbers) < most:
                break
            last = int(numbers[-1])
            # As many as will have so many pieces, if they are like these.
            most = max(1, min(4 * most, most * memory.pieces // max(len(pieces), 1)))


class _Aside:
    """The beginning of a write-back, done by another thread while pairs are solved here."""

    def __init__(self, conn: psycopg.Connection[Any], work: Callable[[], store.Staged]) -> None:
        self._conn, self._work = conn, work
        self._begun: Future[store.Staged] | None = None

    def start(self) -> None:
        """Begin, unless that was done."""
        if self._begun is None:
            self._begun = begun_aside(self._conn, self._work)

    def result(self) -> store.Staged:
        """Return it; raises what the work did."""
        if self._begun is None:
            return self._work()
        return answer_of(self._begun)


def _refresh_conflicts(
    conn: psycopg.Connection[Any],
    begun: Callable[[], store.Staged],
    source: SceneSource,
    settings: Scene,
    record: store.RunRecord,
    way: _Way,
    started: float,
) -> Run:
    """Recompute the pairs with a changed member, on the snapshot of the open transaction, and commit."""
    funnel = Funnel(pieces_s=record.counted["pieces_s"])
    chunks = run_scene(settings, plane_of(settings), source, jobs=way.jobs, progress=way.progress)
    for found, of_chunk in chunks:
        staged = begun()
        for part in store.differing(staged, found):
            store.stage(conn, staged, part, found.where(part.rows))
        funnel.add(of_chunk)
        # Not kept while the next one is made.
        del found, of_chunk
    counted = funnel.counted()
    kept = {**record.settings, "projected_pairs": funnel.projected_pairs, **funnel.effort.counts()}
    outcome = store.end_write(conn, begun(), replace(record, settings=kept, counted=counted))
    with store.translated():
        conn.commit()
    return Run(
        **counted,
        run_id=outcome.run_id,
        method=settings.method,
        conflicts=outcome.conflicts,
        unresolved=outcome.unresolved,
        opened=outcome.opened,
        changed=outcome.changed,
        closed=outcome.closed,
        total_s=time.perf_counter() - started,
    )
