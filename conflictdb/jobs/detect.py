"""Detect the conflicts of a scene of the database, through all four stages.

If few objects changed, one transaction does everything. Otherwise there are two. The first refreshes the pieces of the
changed objects; if these are all objects, their pairs are solved meanwhile (`in_hand`). The second sees one state of
the database: it recomputes the pairs with a changed member, replaces their conflicts, records the run and clears the
marks that the pieces cover. A crash therefore leaves the conflicts either all old or all new; marks made meanwhile
stay.

Each transaction holds the scene's lock until it ends. Another detection may run between the two. The lock counts how
often it was taken: if the second transaction does not directly follow the first, it rebuilds the pieces.
"""

import logging
import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from itertools import chain
from typing import Any, Final, TypeAlias

import psycopg

from conflictdb import store
from conflictdb.arrays.gathered import GatheredBundles
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Bundles
from conflictdb.core.funnel import Funnel, Progress
from conflictdb.core.memory_budget import MEMORY_MB, MemoryBudget
from conflictdb.core.pieces.bundling import bundles_of
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.run import run_scene
from conflictdb.core.separations import Separations
from conflictdb.earth.registry import Setup
from conflictdb.errors import ConflictDBError, LockTimeout, StoreError
from conflictdb.jobs import expansion, follow_attached
from conflictdb.jobs.difference_rows import refresh_differences
from conflictdb.jobs.in_hand import Hand, InHand, Outdated, Storing
from conflictdb.jobs.sources import FewStored, Stored
from conflictdb.kernel.waiting import ThreadWork, cancel_thread, run_in_thread
from conflictdb.model.methods import Method
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind
from conflictdb.model.rules import members_of

_log = logging.getLogger(__name__)

# Called with the name of a phase, and the amounts done and to do; 0: unknown.
Phase: TypeAlias = Callable[[str, int, int], object]


def _silent(name: str, done: int, of: int) -> None:
    """Report no phase."""


# Up to this many changed objects are detected in one transaction: rebuilding their pieces after a failure is cheap.
FEW_OBJECTS: Final = 100
# Changed objects in the first batch; the size of later batches follows from the pieces.
_FIRST_OBJECTS: Final = 2_000


@dataclass(frozen=True, slots=True)
class Run(store.RunOutcome):
    """The result of a detection.

    run_id : its row in the table `run`
    opened, changed, closed : conflicts that are new, have other periods or another verdict, or are gone
    conflicts, unresolved : of the scene now, also those this run had no reason to look at
    candidate_pairs, intersecting_pairs, projected_pairs, window_pairs, solved_pairs, met_pairs : pairs of pieces after
        stage 1, after stage 2, that stage 3 worked on, after stage 3, that stage 4 decided, and reported
    pieces_s, stage1_s, stage2_s, stage3_s, stage4_s, total_s : seconds; of stage 3 with method exact, those of the
        pairs that were decided in closed form
    """

    method: Method
    candidate_pairs: int
    intersecting_pairs: int
    projected_pairs: int
    window_pairs: int
    solved_pairs: int
    met_pairs: int
    pieces_s: float
    stage1_s: float
    stage2_s: float
    stage3_s: float
    stage4_s: float
    total_s: float

    def _repr_html_(self) -> str:
        from conflictdb.model import notebook

        counts = ("conflicts", "unresolved", "opened", "changed", "closed")
        stages = ("candidate_pairs", "intersecting_pairs", "window_pairs", "met_pairs")
        return notebook.facts_html(
            [
                ("run", f"{self.run_id}, method {self.method}"),
                *((name, f"{getattr(self, name):,}") for name in counts),
                *((name.replace("_", " "), f"{getattr(self, name):,}") for name in stages),
                ("seconds", f"{self.total_s:.3f}"),
            ]
        )


class _NothingPending(Exception):
    """No object of the scene waits for a detection."""


def detect(
    conn: psycopg.Connection[Any],
    scene: str,
    *,
    full: bool = False,
    jobs: int | None = None,
    progress: Progress | None = None,
    phase: Phase | None = None,
    lock_timeout_s: float | None = None,
    say: store.Say = _log.warning,
    memory_mb: int = MEMORY_MB,
    few_objects: int = FEW_OBJECTS,
) -> Run:
    """Update the conflicts of a scene, with the scene's own settings, and return the run.

    First updates objects from the tables attached to the scene.

    Parameters
    ----------
    conn : psycopg connection without an open transaction
    full : recompute everything, also unchanged objects
    jobs : threads that stage 4 may use; None is one per processor
    progress : called now and then with the number of pairs that stage 4 has decided, and of all pairs
    phase : called at the beginning of each phase, and as it advances
    lock_timeout_s : longest wait, seconds, for another detection of the scene, or for any other lock; None: no limit
        for another detection, 300 s for any other lock; 0: no wait for another detection, 10 s for any other lock
    say : called with the holder of the lock after 5 s of waiting for another detection
    memory_mb : memory limit of this process, megabytes; a smaller limit means smaller chunks
    few_objects : up to this many changed objects are detected in one transaction; -1: always two transactions

    Raises
    ------
    InvalidInput
        The scene does not exist.
    LockTimeout
        A lock was not free within `lock_timeout_s`; nothing was done.
    StoreError
        The database failed; conflicts and marks are unchanged, and the failure is recorded as a run.
    """
    options = _Options(
        jobs or os.cpu_count() or 1,
        progress,
        lock_timeout_s,
        say,
        MemoryBudget.of(memory_mb),
        few_objects,
        phase=phase or _silent,
    )
    with store.translated(), store.waiting_at_most(conn, store.longest_wait_s(lock_timeout_s)):
        return _run(conn, scene, full, options)


def detect_pending(
    conn: psycopg.Connection[Any],
    scene: str,
    *,
    jobs: int | None = None,
    memory_mb: int = MEMORY_MB,
    few_objects: int = FEW_OBJECTS,
) -> Run | None:
    """Detect as `detect` does if something changed, without waiting for another detection of the scene.

    Returns None if nothing was pending. Raises LockTimeout, naming the holder, if another detection is running, or if
    another lock is not free within 10 s.
    """
    jobs = jobs or os.cpu_count() or 1
    options = _Options(jobs, None, 0.0, _log.debug, MemoryBudget.of(memory_mb), few_objects, only_pending=True)
    try:
        with store.translated(), store.waiting_at_most(conn, store.longest_wait_s(options.lock_timeout_s)):
            return _run(conn, scene, False, options)
    except _NothingPending:
        return None


@dataclass(frozen=True, slots=True)
class _Options:
    """The parameters of `detect`.

    only_pending : an empty detection records no run
    """

    jobs: int
    progress: Progress | None
    lock_timeout_s: float | None
    say: store.Say
    memory: MemoryBudget
    few_objects: int
    only_pending: bool = False
    phase: Phase = _silent


def _run(conn: psycopg.Connection[Any], scene: str, full: bool, options: _Options) -> Run:
    started = time.perf_counter()
    store.require_idle(conn, "a detection")
    store.require_writable(conn)
    record = store.RunRecord(method="", settings={}, started_at=datetime.now(UTC))
    begun: store.Begun | None = None
    storing: Storing | None = None
    try:
        begun = _begin(conn, scene, full, options)
        scene_id = begun.scene_id
        if begun.few is not None:
            return _detect_few(conn, begun, begun.few, record, options, started)
        if full:
            store.cover_all(conn, scene_id)
        pending = _pending(conn, scene_id, options)
        is_first = pending.objects > options.few_objects
        setup, record, hand = refresh_pieces(
            conn, scene_id, pending, record, options.memory, is_first=is_first, is_full=full, phase=options.phase
        )
        is_current = True
        if hand is not None:
            storing = Storing(conn, partial(_store_hand, conn, scene, begun, hand, setup, record, options, full))
            in_hand = InHand(conn, scene_id, options.memory, hand, storing, Separations.of(setup.scene))
            del hand
            try:
                return _refresh_conflicts(conn, in_hand.staged, in_hand, setup, record, options, started)
            except Outdated as outdated:
                # The error of the thread stays with the connection: its frames have the pieces.
                outdated.with_traceback(None)
            del in_hand
            is_current = False
        elif is_first:
            is_current = _follow(conn, scene, begun, setup, options)
        if not is_current:
            pending = _pending(conn, scene_id, options)
            setup, record, _ = refresh_pieces(conn, scene_id, pending, record, options.memory, is_first=False)
        writing = _Background(conn, partial(store.begin_write, conn, scene_id, record))
        separations = Separations.of(setup.scene)
        source = Stored(conn, scene_id, options.memory, writing.start, separations)
        return _refresh_conflicts(conn, writing.result, source, setup, record, options, started)
    except BaseException as error:
        # The lock ends with the transaction. A lost connection cannot record a failure; the marks remain.
        is_removed = False
        if storing is not None:
            storing.stop()
        with suppress(psycopg.Error):
            cancel_thread(conn, conn.cancel_safe)
        with suppress(ConflictDBError, psycopg.Error):
            conn.rollback()
            if isinstance(error, Exception) and not isinstance(error, LockTimeout | _NothingPending):
                scene_id = store.scene_or_branch_id(conn, scene) if begun is None else begun.scene_id
                is_removed = not store.is_scene(conn, scene_id)
                if not is_removed:
                    store.record_failure(conn, scene_id, record, f"{type(error).__name__}: {error}")
        if is_removed:
            raise StoreError(f"scene {scene!r} was removed while it was detected") from error
        with store.naming_grants(conn):
            raise


def _begin(conn: psycopg.Connection[Any], scene: str, full: bool, options: _Options) -> store.Begun:
    """Follow attached tables, or detect the parent of a branch; expand schedules; begin the first transaction."""
    few = -1 if full else options.few_objects
    again: bool | None = not options.only_pending
    while True:
        begun = store.begin_detection(conn, scene, few, options.lock_timeout_s, options.say, again)
        if not begun.is_behind:
            return begun
        with store.translated():
            conn.rollback()
        parent = store.parent_name(conn, begun.scene_id)
        if parent is None:
            if again is not None:
                follow_attached.follow(conn, scene, again=again)
        else:
            # If its parent changes meanwhile, the branch stays pending.
            with suppress(_NothingPending):
                _run(conn, parent, False, replace(options, only_pending=True, progress=None, phase=_silent))
            store.follow_parent(conn, begun.scene_id)
        expansion.expand(conn, scene, options.say)
        again = None


def _detect_few(
    conn: psycopg.Connection[Any],
    begun: store.Begun,
    few: store.Few,
    record: store.RunRecord,
    options: _Options,
    started: float,
) -> Run:
    """Run a detection of few changed objects in the open transaction, and commit."""
    if options.only_pending and not few.numbers:
        raise _NothingPending
    clock = time.perf_counter()
    settings, scene_id = begun.settings, begun.scene_id
    setup = Setup.of(settings)
    areas = store.some_areas(conn, scene_id, few.area_ids) if few.area_ids else AreaBatch.of([])
    tracks = store.some_tracks(conn, scene_id, few.track_ids) if few.track_ids else TrackBatch.of([])
    pieces = pieces_of(setup, areas, tracks)
    record = replace(record, method=settings.method, settings=_recorded(settings))
    if few.known_objects is not None:
        record = replace(record, more_objects=len(areas) + len(tracks) - few.known_objects)
    record = replace(record, counted={"pieces_s": time.perf_counter() - clock})
    source = FewStored(conn, scene_id, options.memory, few.srid, pieces)
    staged = store.begin_write(conn, scene_id, record, few.numbers)
    return _refresh_conflicts(conn, lambda: staged, source, setup, record, options, started, few.numbers)


def _recorded(settings: Scene) -> dict[str, Any]:
    """Return settings as a run records them."""
    recorded = {name: value for name, value in asdict(settings).items() if name not in ("name", "rules")}
    return recorded | ({"rules": [members_of(rule) for rule in settings.rules]} if settings.rules else {})


def _pending(conn: psycopg.Connection[Any], scene_id: int, options: _Options) -> store.Pending:
    """Count pending objects; raises _NothingPending if there are none and an empty detection is no run."""
    pending = store.pending(conn, scene_id)
    if options.only_pending and not pending.objects:
        raise _NothingPending
    return pending


def _follow(conn: psycopg.Connection[Any], scene: str, begun: store.Begun, setup: Setup, options: _Options) -> bool:
    """Commit the first transaction and begin the second.

    Return whether it follows directly: no other detection ran in between, and the settings are the same.
    Otherwise all remaining marks are to be processed.
    """
    with store.translated():
        conn.commit()
    followed = store.begin_locked(conn, begun.scene_id, scene, options.lock_timeout_s, options.say)
    return followed == begun.taken + 1 and store.read_settings(conn, begun.scene_id) == setup.scene


def _store_hand(
    conn: psycopg.Connection[Any],
    scene: str,
    begun: store.Begun,
    hand: Hand,
    setup: Setup,
    record: store.RunRecord,
    options: _Options,
    is_full: bool,
    storing: Storing,
) -> store.Staged:
    """Store the pieces in hand, end the first transaction and begin the second; raises Outdated if anything changed."""
    store.replace_pieces(conn, begun.scene_id, [hand.bundles], is_full=is_full, go_on=storing.go_on)
    storing.go_on()
    if not _follow(conn, scene, begun, setup, options) or not store.are_covered(conn, begun.scene_id):
        raise Outdated
    return store.begin_write(conn, begun.scene_id, record)


def refresh_pieces(
    conn: psycopg.Connection[Any],
    scene_id: int,
    pending: store.Pending,
    record: store.RunRecord,
    memory: MemoryBudget,
    *,
    is_first: bool,
    is_full: bool = False,
    phase: Phase = _silent,
) -> tuple[Setup, store.RunRecord, Hand | None]:
    """Rebuild the pieces of the changed objects; return the setup of the scene, the updated record, and None.

    If `is_first`, and these are all pieces of the scene and fit the memory, they are not stored: they are returned.
    """
    clock = time.perf_counter()
    settings = store.read_settings(conn, scene_id)
    setup = Setup.of(settings)
    pieces = _changed_pieces(conn, scene_id, pending, setup, memory, phase)
    gathered: GatheredBundles | None = None
    hand = None
    if is_first:
        room, objects = memory.hand_bytes, 0
        for count, some in pieces:
            if gathered is None:
                gathered = GatheredBundles(some)
            else:
                gathered.add(some)
            objects += count
            room -= some.pieces.nbytes
            del some
            if room < 0:
                break
        else:
            hand = _in_hand(conn, scene_id, gathered, objects)
    if hand is None:
        # Each chunk is freed once it is sent.
        before = deque([] if gathered is None else [gathered.bundles()])
        del gathered
        chunks = chain((before.popleft() for _ in range(len(before))), (some for _, some in pieces))
        store.replace_pieces(conn, scene_id, chunks, is_first=is_first, is_full=is_full)
    took_s = record.counted.get("pieces_s", 0.0) + time.perf_counter() - clock
    record = replace(record, method=settings.method, settings=_recorded(settings), counted={"pieces_s": took_s})
    return setup, record, hand


def _in_hand(
    conn: psycopg.Connection[Any], scene_id: int, gathered: GatheredBundles | None, objects: int
) -> Hand | None:
    """Return the pieces of changed objects, if these are all objects of the scene; else return None."""
    order = None if gathered is None else store.order_of_all(conn, scene_id, objects)
    return None if gathered is None or order is None else Hand.of(gathered.bundles(), order)


def _changed_pieces(
    conn: psycopg.Connection[Any],
    scene_id: int,
    pending: store.Pending,
    setup: Setup,
    memory: MemoryBudget,
    phase: Phase,
) -> Iterator[tuple[int, Bundles]]:
    """Yield the pieces of the changed objects of a scene, in batches, each with the number of its objects."""
    done = 0
    phase("preparing objects", done, 0)
    no_areas, no_tracks = AreaBatch.of([]), TrackBatch.of([])
    for kind in (kind for kind, count in ((Kind.AREA, pending.areas), (Kind.TRACK, pending.tracks)) if count):
        most, last = _FIRST_OBJECTS, -(2**63)
        while True:
            bundles = None  # free before the next batch is read
            if kind is Kind.AREA:
                objects = store.changed_areas(conn, scene_id, last, most), no_tracks
                numbers = objects[0].area_id
            else:
                objects = no_areas, store.changed_tracks(conn, scene_id, last, most)
                numbers = objects[1].track_id
            if len(numbers):
                pieces = pieces_of(setup, *objects)
                count, bundles = len(pieces), bundles_of(pieces)
                del objects, pieces
                yield len(numbers), bundles
                done += len(numbers)
                phase("preparing objects", done, 0)
            if len(numbers) < most:
                break
            last = int(numbers[-1])
            # Next batch size, extrapolated from this one.
            most = max(1, min(4 * most, most * memory.pieces_at_once // max(count, 1)))
    phase("indexing", 0, 0)


class _Background:
    """The start of a write-back, run by another thread while this one solves pairs."""

    def __init__(self, conn: psycopg.Connection[Any], work: Callable[[], store.Staged]) -> None:
        self._conn, self._work = conn, work
        self._begun: ThreadWork[store.Staged] | None = None

    def start(self) -> None:
        """Start the work unless it was started."""
        if self._begun is None:
            self._begun = run_in_thread(self._conn, self._work)

    def result(self) -> store.Staged:
        """Return the work's result or raise its error; does the work now if it was not started."""
        if self._begun is None:
            return self._work()
        return self._begun.result()


def _refresh_conflicts(
    conn: psycopg.Connection[Any],
    begun: Callable[[], store.Staged],
    source: Stored,
    setup: Setup,
    record: store.RunRecord,
    options: _Options,
    started: float,
    changed: list[int] | None = None,
) -> Run:
    """Recompute the pairs with a changed member, on the snapshot of the open transaction, and commit.

    changed : numbers of the changed objects, if these are few
    """
    funnel = Funnel(pieces_s=record.counted["pieces_s"])

    is_last = True

    def solving(done: int, of: int) -> None:
        nonlocal is_last
        is_last = done == of
        options.phase("solving pairs", done, of)
        if options.progress is not None:
            options.progress(done, of)

    is_watched = options.progress is not None or options.phase is not _silent
    options.phase("comparing objects", 0, 0)
    progress = solving if is_watched else None
    chunks = run_scene(setup, source, jobs=options.jobs, progress=progress)
    for found, of_chunk in chunks:
        # Between chunks the phase of solving goes on, with an estimate for the whole scene.
        writing = options.phase if is_last else _silent
        staged = begun()
        writing("writing conflicts", 0, len(found))
        for part in store.differing(staged, found, of_chunk.settings):
            store.stage(conn, staged, part, found.where(part.rows))
            writing("writing conflicts", int(part.rows[-1]) + 1, len(found))
        funnel.add(of_chunk)
        # Free before the next chunk is allocated.
        del found, of_chunk
    begun()
    funnel.pieces_s += source.waited_s
    refresh_differences(
        conn,
        source.scene_id,
        setup,
        changed,
        options.memory,
        jobs=options.jobs,
        progress=partial(options.phase, "computing delays"),
    )
    options.phase("writing conflicts", 0, 0)
    counted = funnel.counted()
    kept = {**record.settings, **funnel.without_column()}
    outcome = store.end_write(conn, begun(), replace(record, settings=kept, counted=counted))
    with store.translated():
        conn.commit()
    return Run(**counted, **asdict(outcome), method=setup.scene.method, total_s=time.perf_counter() - started)
