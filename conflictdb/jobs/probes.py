"""Probe planned areas and tracks: find their conflicts by the stages of a detection, without writing.

A plan is cut into pieces as the scene's objects are, and joined with the pieces of the last detection. SQL users leave
a request, which a worker answers (`answer`), scene by scene; requests of all kinds are answered here.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta
from typing import Any, Final

import psycopg

from conflictdb import store
from conflictdb.core.conflicts_between import bounded, conflicts_between
from conflictdb.core.members import Members, by_kind
from conflictdb.core.memory_budget import MEMORY_MB, MemoryBudget
from conflictdb.core.run import run_scene
from conflictdb.core.to_results import to_results
from conflictdb.core.world import World, is_within, occupy
from conflictdb.errors import ConflictDBError, InvalidInput, LockTimeout
from conflictdb.formats.scene_file import plans_text, read_plans
from conflictdb.jobs.admission import admit
from conflictdb.jobs.members_near import read_members_near, state_for, world_of
from conflictdb.jobs.sources import PLAN, StoredWithPlan
from conflictdb.jobs.track_delays import delays
from conflictdb.memory.delay_options import DelayOptions
from conflictdb.model.inputs import certain
from conflictdb.model.plans import LINES, Area, Track, check_datums, check_legs
from conflictdb.model.results import Conflict, Kind, Listing

_log = logging.getLogger(__name__)

# Longest wait for another admission of a scene, seconds: scenes must not wait for each other.
_WAITS_FOR_ADMISSION_S: Final = 0.05
# Seconds that a worker answers before it checks for detections again, so that probes do not delay editors.
_ANSWERING_S: Final = 1.0


def probe(
    conn: psycopg.Connection[Any],
    scene: str,
    plans: Sequence[Area | Track],
    *,
    jobs: int = 1,
    memory_mb: int = MEMORY_MB,
) -> Listing[Conflict]:
    """Return the conflicts of plans with the scene and with each other, on one state of the database.

    Objects of the scene with the key of a plan are left out: the plans replace them together. One plan is compared with
    the pieces of the last detection if the scene is current; others, in a constant number of round trips, with all
    objects as they are stored.

    Raises InvalidInput if the scene does not exist, its plane cannot contain a plan or the plans have more than
    MOST_REPLIES conflicts, StoreError if a transaction is open.
    """
    store.begin_snapshot(conn)
    try:
        return _found(conn, scene, plans, jobs, MemoryBudget.of(memory_mb))
    finally:
        with store.translated():
            conn.rollback()


def _found(
    conn: psycopg.Connection[Any], scene: str, plans: Sequence[Area | Track], jobs: int, memory: MemoryBudget
) -> Listing[Conflict]:
    """Return the conflicts of plans, on the snapshot of the open transaction."""
    number = store.scene_id(conn, scene)
    settings = store.read_settings(conn, number)
    state, window = state_for(conn, settings, number, plans)
    world, span = world_of(conn, number, settings, plans)
    if len(plans) == 1 and state.is_current and is_within(span, window):
        found = _probed_alone(conn, number, world, plans[0], jobs, memory)
    else:
        mine = Members.of_plans(world, plans)
        replaced = store.replaced_objects(conn, number, [plan.key for plan in plans], None)
        others = read_members_near(conn, number, world, span, mine, replaced)
        found = conflicts_between(world.setup, mine, others, among=True)
    return Listing(state, found, Conflict)


def ask(
    conn: psycopg.Connection[Any], scene: str, plans: Sequence[Area | Track], timeout: timedelta
) -> Listing[Conflict]:
    """Return the result of `probe`, computed by a worker.

    Raises the errors of `probe`, and NotCurrent if no worker answers in time.
    """
    store.require_idle(conn, "a question to a worker")
    until_s = time.monotonic() + timeout.total_seconds()
    with store.transaction(conn):
        scene_id = store.scene_id(conn, scene)
        settings = store.read_settings(conn, scene_id)
        state, _ = state_for(conn, settings, scene_id, plans)
    check_datums(settings, plans)
    check_legs(LINES[settings.motion], [one for one in plans if isinstance(one, Track)])
    number = store.request_probe(conn, scene, plans_text(plans))
    left = timedelta(seconds=max(until_s - time.monotonic(), 0.001))
    found, was_current = store.wait_for_probe(conn, settings, plans, number, left)
    if state.is_current and not was_current:
        state = replace(state, is_current=False, remark="it changed before a worker answered")
    return Listing(state, found, Conflict)


def answer(conn: psycopg.Connection[Any], *, jobs: int = 1, memory_mb: int = MEMORY_MB) -> bool:
    """Answer requests, taking turns between scenes; return whether some are left after a second.

    conn : without an open transaction
    """
    until_s = time.monotonic() + _ANSWERING_S
    passed_over: list[int] = []
    while time.monotonic() < until_s:
        if not _answer_one(conn, jobs, MemoryBudget.of(memory_mb), passed_over):
            return False
    return True


def _answer_one(conn: psycopg.Connection[Any], jobs: int, memory: MemoryBudget, passed_over: list[int]) -> bool:
    """Answer the next request; return whether there was one.

    passed_over : requests that wait for another session, which this appends to
    """
    with store.transaction(conn):  # counts, even if this process is killed meanwhile
        claimed = store.claim_probe(conn, passed_over)
    if claimed is None:
        return False
    try:
        store.begin_snapshot(conn)
        if store.hold_probe(conn, *claimed):
            _answer_held(conn, claimed.probe_id, jobs, memory, passed_over)
        with store.translated():
            conn.commit()
    except Exception as error:  # a faulty plan must not stop the others
        if conn.closed:
            raise
        conn.rollback()
        with store.transaction(conn):
            if isinstance(error, InvalidInput):
                store.refuse_probe(conn, claimed.probe_id, str(error))
            else:
                _log.warning("request %d failed: %s", claimed.probe_id, error)
                store.probe_failed(conn, claimed.probe_id, str(error))
    return True


def _answer_held(
    conn: psycopg.Connection[Any], probe_id: int, jobs: int, memory: MemoryBudget, passed_over: list[int]
) -> None:
    """Answer a request that the open transaction holds, or release it if another session is in the way."""
    try:
        with store.transaction(conn):
            _answer_request(conn, store.read_request(conn, probe_id), jobs, memory)
    except ConflictDBError as error:
        if isinstance(error, LockTimeout):
            passed_over.append(probe_id)
        # Another session admitted plans.
        elif not isinstance(error.__cause__, psycopg.errors.SerializationFailure):
            raise
        store.release_probe(conn, probe_id)


def _answer_request(conn: psycopg.Connection[Any], request: store.Request, jobs: int, memory: MemoryBudget) -> None:
    options = request.options
    if request.kind == "delays":
        now, start, end = (
            certain(None if (at := options.get(name)) is None else int(at)) for name in ("now_us", "from_us", "to_us")
        )
        asked = DelayOptions.of(
            options["horizon_s"],
            now,
            margin_s=options.get("margin_s") or 0.0,
            margin_m=options.get("margin_m") or 0.0,
            start=start,
            end=end,
            best=options.get("best"),
        )
        (found,) = delays(conn, request.scene, options["key"], asked)
        store.answer_delays(conn, request.probe_id, found)
        return
    assert request.plans is not None  # noqa: S101
    settings = store.read_settings(conn, store.scene_id(conn, request.scene))
    plans = read_plans(request.plans, settings, request.max_speed_kn)
    if request.kind == "admit":
        admission = admit(
            conn,
            request.scene,
            plans,
            options.get("owner"),
            allow_known=bool(options.get("allow_known")),
            replace=options.get("replace") or (),
            lock_timeout_s=_WAITS_FOR_ADMISSION_S,
        )
        store.answer_admission(conn, request.probe_id, admission)
        return
    met = _found(conn, request.scene, plans, jobs, memory)
    beyond = (met.state.is_beyond_horizon and met.state.remark) or ""
    store.answer_probe(conn, request.probe_id, {one.key for one in plans}, met, beyond)


def _probed_alone(
    conn: psycopg.Connection[Any], scene_id: int, world: World, plan: Area | Track, jobs: int, memory: MemoryBudget
) -> list[Conflict]:
    """Return the conflicts of a plan with the pieces of the last detection, but those of its namesake."""
    scene = world.setup.scene
    occupied = occupy(world, *by_kind([plan]))
    cut: Area | Track = (occupied.areas or occupied.tracks)[0]
    source = StoredWithPlan(conn, scene_id, cut, plan.key, occupied.pieces, memory)
    found = bounded(part for part, _ in run_scene(world.setup, source, jobs=jobs))
    if not len(found):
        return []
    named = store.names_of(conn, scene_id, found)
    plan_kind = Kind.AREA if isinstance(plan, Area) else Kind.TRACK
    return to_results(scene, {**named, (plan_kind.code, PLAN): (plan.key, plan.name)}, found)
