"""Keep all scenes current: detect changes as they happen.

Changes leave marks in the database; these marks are the queue. A worker has no state of its own: it may be killed at
any moment, and any number may run, on any number of machines. It listens for changes (NOTIFY), and also checks the
marks twice a second: of several concurrent writers only one notifies.
"""

import logging
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from random import SystemRandom
from typing import Any, Final

import psycopg

from conflictdb import store
from conflictdb.core.memory_budget import MEMORY_MB
from conflictdb.errors import ConflictDBError, LockTimeout, ReadOnlyDatabase, SchemaError, StoreError
from conflictdb.jobs import detect, probes, schema
from conflictdb.jobs.looks import Looks

_log = logging.getLogger(__name__)

EVERY_S: Final = 0.5
# Longest pause after a lost connection or a failed detection.
_LONGEST_PAUSE_S: Final = 60.0
# When to report who else detects a changed scene. With `once`, a person waits: report earlier (`say_after_s`).
_SAY_BUSY_AFTER_S: Final = 60.0
# Lower bound of the pause, however often attached tables are compared.
_LEAST_PAUSE_S: Final = 0.1
# Longest wait for a locked table in a look for changes.
_LOCK_WAIT_S: Final = 10.0
# How often to count conflicts.
_COUNT_EVERY_S: Final = 10.0
# How often to look for silent tracks, and to empty partitions of old positions.
_SILENCE_EVERY_S: Final = 10.0
_PRUNE_EVERY_S: Final = 600.0
# How often to seal edits.
_SEAL_EVERY_S: Final = 60.0

Connect = Callable[[], "psycopg.Connection[Any]"]
Report = Callable[[str, "detect.Run | Exception", float], None]


def _pauses(first_s: float, longest_s: float = _LONGEST_PAUSE_S) -> Iterator[float]:
    """Yield the pauses before further attempts, seconds, random."""
    pause_s = min(first_s, longest_s)
    while True:
        yield SystemRandom().uniform(0.5 * pause_s, pause_s)
        pause_s = min(2.0 * pause_s, longest_s)


@dataclass(slots=True)
class _Failing:
    """A scene whose detection failed: the next attempt (on the clock of `time.monotonic`), and later pauses."""

    again_at_s: float
    pauses: Iterator[float]


@dataclass(slots=True)
class _Busy:
    """A changed scene that another session is detecting: since when, the next attempt, and whether it was reported.

    Instants are on the clock of `time.monotonic`.
    """

    since_s: float
    again_at_s: float = 0.0
    is_said: bool = False


@dataclass(slots=True)
class WorkerState:
    """The present activity of a worker, for an observer in another thread.

    is_connected : whether its connection works, as far as it knows
    connections : how many it has made
    looked_at_s : when it last read the pending scenes, or was created, on the clock of `time.monotonic`
    waiting : number of pending scenes then
    longest_s : longest waiting time then, seconds
    scene : the scene being detected, None between detections
    conflicts : their numbers by scene, verdict, and whether they are acknowledged, if the worker counts them
    alarms : of all scenes, read with the numbers of conflicts
    since : by scene, since when it is current, or is not: when its first change that waits was made, or when the worker
        saw it first
    """

    is_connected: bool = False
    connections: int = 0
    looked_at_s: float = field(default_factory=time.monotonic)
    waiting: int = 0
    longest_s: float = 0.0
    scene: str | None = None
    conflicts: Mapping[tuple[str, str, bool], int] = field(default_factory=dict)
    alarms: Sequence[store.SceneAlarm] = ()
    since: Mapping[str, datetime] = field(default_factory=dict)

    def alarmed(self, alarms: Sequence[store.SceneAlarm]) -> None:
        """Take over alarms that were read now."""
        former = {one.scene: one.is_current for one in self.alarms}
        now = datetime.now(UTC)
        since = {one.scene: self.since[one.scene] if former.get(one.scene) == one.is_current else now for one in alarms}
        since |= {one.scene: one.waiting_since for one in alarms if not one.is_current and one.waiting_since}
        # Another thread reads both: it finds an instant for each scene of either.
        self.since = {**self.since, **since}
        self.alarms = alarms


@dataclass(slots=True)
class Worker:
    """A worker; `run` works until it is interrupted.

    connect : opens a connection of its own
    report : called after each detection with the scene, the run or the error, and how long the oldest change had waited
        at its end, seconds
    every_s : looks for changes at least this often, seconds
    jobs : threads to solve in, None for one per processor
    lock_timeout_s : a changed scene that another session detects for longer has failed, seconds; None: never
    say : called with remarks: who blocks a scene, no notifications, a database lost and found
    memory_mb : see `detect`
    state : its present activity
    counts : whether it counts conflicts, every ten seconds
    retry_s : pause after a lost connection or a failed detection, seconds; doubled each time, up to a minute, or
        to `every_s` for a scene if that is longer
    busy_s : pause before it tries again a scene that another session detects, seconds
    unnotified_s : seconds between two looks for changes without a notification
    heard_within_s : waits this long for a test notification, where one may not arrive, seconds
    say_after_s : `once` reports who else detects a changed scene after this time, seconds
    """

    connect: Connect
    report: Report
    every_s: float = EVERY_S
    jobs: int | None = None
    lock_timeout_s: float | None = None
    say: store.Say = _log.warning
    memory_mb: int = MEMORY_MB
    state: WorkerState = field(default_factory=WorkerState)
    counts: bool = False
    retry_s: float = 1.0
    busy_s: float = 1.0
    unnotified_s: float = 0.25
    heard_within_s: float = store.HEARD_WITHIN_S
    say_after_s: float = store.SAY_AFTER_S
    _counted_at_s: float = -math.inf
    _sealed_at_s: float = -math.inf
    _failing: dict[str, _Failing] = field(default_factory=dict)
    _busy: dict[str, _Busy] = field(default_factory=dict)
    _has_requests: bool = False
    _looks: Looks = field(default_factory=Looks)
    _silence_at_s: float = -math.inf
    _pruned_at_s: float = -math.inf
    _deafness_is_said: bool = False
    _stamp: store.WorkerStamp = field(default_factory=store.WorkerStamp)

    def once(self) -> bool:
        """Detect every pending scene, or wait until other sessions did; return whether all succeeded."""
        well = True
        with self.connect() as connection, self._counted(connection):
            while True:
                well &= self._round(connection, self.say_after_s)
                for failing in self._failing.values():
                    failing.again_at_s = math.inf
                if not self._busy and not self._has_requests and not self._looks.is_behind:
                    store.seal_edits(connection)
                    return well
                if not self._has_requests and not self._looks.is_behind:
                    time.sleep(self.busy_s)

    def run(self) -> None:
        """Keep scenes current until KeyboardInterrupt; survives the failure of a scene and the loss of the database.

        Raises
        ------
        SchemaError
            The schema is missing, or of another version than this program.
        ReadOnlyDatabase
            The database is a hot standby, or has become one.
        ServerError, StoreError
            The first connection fails.
        """
        pauses = _pauses(self.retry_s)
        connection = self.connect()
        while True:
            self.state.is_connected, self.state.connections = True, self.state.connections + 1
            try:
                with connection, self._counted(connection):
                    every_s = self._listen(connection)
                    while True:
                        self._turn(connection, every_s)
                        pauses = _pauses(self.retry_s)
            except (SchemaError, ReadOnlyDatabase):
                raise
            except (ConflictDBError, psycopg.Error) as error:
                self.state.is_connected = False
                self.say(f"lost the database, connecting again: {_reason(error)}")
            connection = self._reconnected(pauses)
            self.say("connected again")

    @contextmanager
    def _counted(self, connection: "psycopg.Connection[Any]") -> Iterator[None]:
        """Check the database, and count as one of its workers inside."""
        _check(connection)
        self._stamp.begin(connection)
        try:
            yield
        finally:
            if not connection.closed:
                self._stamp.end(connection)

    def _turn(self, connection: "psycopg.Connection[Any]", every_s: float) -> None:
        """Detect changes, and wait for more; raises only if the connection is lost or cannot write this schema."""
        try:
            with store.waiting_at_most(connection, _LOCK_WAIT_S):
                self._stamp.renew(connection)
                self._round(connection, _SAY_BUSY_AFTER_S)
                if self.counts and time.monotonic() - self._counted_at_s >= _COUNT_EVERY_S:
                    self.state.conflicts = store.counted_conflicts(connection)
                    self.state.alarmed(store.scene_alarms(connection))
                    self._counted_at_s = time.monotonic()
                if time.monotonic() - self._sealed_at_s >= _SEAL_EVERY_S:
                    # A large backlog waits for changes to be detected.
                    more = store.seal_some_edits(connection)
                    self._sealed_at_s = -math.inf if more else time.monotonic()
                pause_s = self._pause_s(connection, every_s)
        except (SchemaError, ReadOnlyDatabase):
            raise
        except (ConflictDBError, psycopg.Error) as error:
            _recover(connection, error)
            self.say(f"cannot look for changes, trying again: {_reason(error)}")
            pause_s = self.busy_s
        store.wait_for_change(connection, pause_s)

    def _pause_s(self, connection: "psycopg.Connection[Any]", every_s: float) -> float:
        """Return the longest pause until the next look, seconds, from busy and failed scenes and tables to compare."""
        dues_s = [failing.again_at_s - time.monotonic() for failing in self._failing.values()]
        if (comparison_s := store.seconds_to_comparison(connection)) is not None:
            dues_s.append(comparison_s)
        if self._busy:
            dues_s.append(self.busy_s)
        if self._has_requests or self._looks.is_behind:
            return 0.0
        return min([every_s, *(max(due_s, _LEAST_PAUSE_S) for due_s in dues_s)])

    def _listen(self, connection: "psycopg.Connection[Any]") -> float:
        """Listen for changes; return how often to look for changes that are not notified, seconds."""
        unnotified_s = min(self.every_s, self.unnotified_s)
        if store.listen(connection, self.connect, self.heard_within_s):
            return self.every_s if store.writers_notify(connection) else unnotified_s
        if not self._deafness_is_said:
            self._deafness_is_said = True
            self.say(
                "notifications do not arrive on this connection, as through a pooler that gives every transaction "
                f"another session: looking for changes every {unnotified_s:g} s"
            )
        return unnotified_s

    def _reconnected(self, pauses: Iterator[float]) -> "psycopg.Connection[Any]":
        for pause_s in pauses:
            time.sleep(pause_s)
            try:
                return self.connect()
            except ConflictDBError as error:
                self.say(f"no database yet: {_reason(error)}")
        raise AssertionError("pauses do not end")

    def _round(self, connection: "psycopg.Connection[Any]", say_after_s: float) -> bool:
        """Detect every pending scene once, the longest waiting first; return whether all succeeded.

        Skips scenes that failed a moment ago; those that other sessions detect remain in `_busy`. Raises StoreError if
        the connection is lost.
        """
        self._answer(connection)
        well = self._look(connection)
        store.drop_orphans(connection)
        waiting = store.waiting_scenes(connection)
        looked_at_s = time.monotonic()
        self.state.looked_at_s, self.state.waiting = looked_at_s, len(waiting)
        self.state.longest_s = max(waiting.values(), default=0.0)
        self._busy = {scene: busy for scene, busy in self._busy.items() if scene in waiting}
        self._failing = {scene: failing for scene, failing in self._failing.items() if scene in waiting}
        for scene, waited_s in waiting.items():
            if scene in self._failing and time.monotonic() < self._failing[scene].again_at_s:
                continue
            if scene in self._busy and time.monotonic() < self._busy[scene].again_at_s:
                continue
            self._stamp.renew(connection)
            self.state.scene = scene
            changed_at_s = looked_at_s - waited_s
            try:
                run = detect.detect_pending(connection, scene, jobs=self.jobs, memory_mb=self.memory_mb)
            except LockTimeout as error:
                well &= self._passed_over(scene, error, say_after_s, changed_at_s)
            except Exception as error:  # a faulty scene must not stop the others
                _recover(connection, error)
                well = False
                self._failed(scene, error, changed_at_s)
            else:
                self._busy.pop(scene, None)
                self._failing.pop(scene, None)
                if run is not None:
                    self.report(scene, run, time.monotonic() - changed_at_s)
            finally:
                self.state.scene = None
            self._answer(connection)
            well &= self._look(connection)
        return well

    def _look(self, connection: "psycopg.Connection[Any]") -> bool:
        """Compare new positions with plans; at times look which tracks are silent, and empty old partitions.

        Return whether that succeeded. Raises StoreError if the connection is lost.
        """
        is_silence_due = time.monotonic() - self._silence_at_s >= _SILENCE_EVERY_S
        try:
            self._looks.look(connection, time.time_ns() // 1000, is_silence_due=is_silence_due)
            if is_silence_due and not self._looks.is_behind:
                self._silence_at_s = time.monotonic()
            if time.monotonic() - self._pruned_at_s >= _PRUNE_EVERY_S:
                self._pruned_at_s = time.monotonic()
                with store.transaction(connection):
                    store.prune_positions(connection)
        except (SchemaError, ReadOnlyDatabase):
            raise
        except Exception as error:  # faulty positions must not stop the scenes
            _recover(connection, error)
            self.say(f"cannot compare positions with plans, trying again: {_reason(error)}")
            return False
        return True

    def _answer(self, connection: "psycopg.Connection[Any]") -> None:
        """Answer requests (probes, delays) for a while, with the rights of this connection, not of who asked."""
        self._has_requests = probes.answer(connection, jobs=self.jobs or os.cpu_count() or 1, memory_mb=self.memory_mb)

    def _passed_over(self, scene: str, error: LockTimeout, say_after_s: float, changed_at_s: float) -> bool:
        """Record that another session detects a scene; return whether that is still within the limit."""
        busy = self._busy.setdefault(scene, _Busy(time.monotonic()))
        busy.again_at_s = time.monotonic() + self.busy_s
        waited_s = time.monotonic() - busy.since_s
        if self.lock_timeout_s is not None and waited_s >= self.lock_timeout_s:
            self._failed(scene, error, changed_at_s)
            return False
        if waited_s >= say_after_s and not busy.is_said:
            busy.is_said = True
            self.say(f"{scene}: {error}")
        return True

    def _failed(self, scene: str, error: Exception, changed_at_s: float) -> None:
        self._busy.pop(scene, None)
        failing = self._failing.setdefault(
            scene, _Failing(0.0, _pauses(self.retry_s, max(self.every_s, _LONGEST_PAUSE_S)))
        )
        failing.again_at_s = time.monotonic() + next(failing.pauses)
        _log.debug("scene %r failed", scene, exc_info=error)
        self.report(scene, error, time.monotonic() - changed_at_s)


def _check(connection: "psycopg.Connection[Any]") -> None:
    store.require_writable(connection)
    with store.transaction(connection):
        schema.check(connection)
    store.require_detecting(connection)


def _recover(connection: "psycopg.Connection[Any]", error: Exception) -> None:
    """Roll back after an error; raises StoreError if the connection is unusable."""
    # The first error says more than that of the rollback.
    with suppress(psycopg.Error):
        connection.rollback()
    if connection.closed:
        raise StoreError(_reason(error)) from error


def _reason(error: Exception) -> str:
    return str(error).strip().partition("\n")[0] or type(error).__name__
