"""Forward the database's notifications of changes of scenes to open pages."""

import asyncio
import json
import logging
import math
import time
from collections.abc import AsyncIterator, Callable
from threading import Event, Thread
from typing import Any, Final

import psycopg

from conflictdb import store
from conflictdb.errors import ConflictDBError, InvalidInput, NotPermitted

_log = logging.getLogger(__name__)

# Delay until an end is noticed, and before reconnecting.
_PAUSE_S: Final = 0.5
# SceneChanges within this time are sent as one.
_TOGETHER_S: Final = 0.1
# How often to check whether the scene is still visible: the database sends no notification of it.
_LOOK_S: Final = 1.0
# Proxies and browsers close connections silent for longer.
_SILENT_S: Final = 15.0

OBJECTS: Final = "objects"
CONFLICTS: Final = "conflicts"
LIVE: Final = "live"


class SceneChanges:
    """Sends each subscriber the kind of change of a scene: OBJECTS, CONFLICTS, LIVE. A `Listener` hears of them.

    version : grows with each change; data read before it are out of date. No two objects have one
    """

    def __init__(
        self, scene: str, loop: asyncio.AbstractEventLoop | None = None, left: Callable[[], object] = lambda: None
    ) -> None:
        """Take subscribers in an event loop; `left` is called when the last one has gone."""
        self.scene = scene
        # A page may know a version of a view of this scene that ended.
        self.version = time.time_ns() // 1_000_000
        self._left = left
        self._has_ended = False
        self._is_seen: bool | None = None  # None: not known yet
        self._parent: str | None = None
        self._subscribers: set[asyncio.Queue[str | None]] = set()
        self._loop = loop

    @property
    def has_subscribers(self) -> bool:
        """Whether a page hears of changes."""
        return bool(self._subscribers)

    def end(self) -> None:
        """End all subscriptions; from any thread. May be called again."""
        self._has_ended = True
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._ended)

    def _ended(self) -> None:
        for queue in self._subscribers:
            queue.put_nowait(None)

    async def each(self, known: int | None) -> AsyncIterator[str]:
        """Yield server-sent events until the end; at once, if the subscriber knows another version."""
        queue: asyncio.Queue[str | None] = asyncio.Queue()
        self._subscribers.add(queue)
        try:
            yield "retry: 1000\n\n"
            if known not in (None, self.version):
                yield self._event(OBJECTS)
            while not self._has_ended:
                try:
                    what = await asyncio.wait_for(queue.get(), _SILENT_S)
                except TimeoutError:
                    yield ": still here\n\n"
                    continue
                if what is None:
                    return
                yield self._event(what)
        finally:
            self._subscribers.discard(queue)
            if not self._subscribers:
                self._left()

    def _event(self, what: str) -> str:
        return f"event: {what}\ndata: {self.version}\n\n"

    def publish(self, what: str) -> None:
        """Send subscribers a change; from any thread."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._send, what)

    def _send(self, what: str) -> None:
        # An alarm changes no plan and no conflict: tiles stay as they are.
        self.version += what != LIVE
        for queue in self._subscribers:
            queue.put_nowait(what)

    def hear(
        self, connection: psycopg.Connection[Any], payloads: list[str], *, writers_notify: bool, is_due: bool
    ) -> None:
        """Publish the meaning of notifications, and of a scene that appears or goes.

        is_due : whether to check that the user still sees the scene, if no notification concerns it
        """
        if self._is_seen is None:
            self._is_seen = self._sees(connection)
        said = {self._meaning(payload, writers_notify=writers_notify) for payload in payloads} - {None}
        if not said and not is_due:
            return
        # A user who may not see the scene gets one OBJECTS event. Its changes are withheld.
        was_seen, self._is_seen = self._is_seen, self._sees(connection)
        if self._is_seen != was_seen:
            self.publish(OBJECTS)
        elif said and self._is_seen:
            if LIVE in said:
                self.publish(LIVE)
            # The page requests new objects together with their conflicts.
            if said - {LIVE}:
                self.publish(OBJECTS if OBJECTS in said else CONFLICTS)

    def miss(self, connection: psycopg.Connection[Any]) -> None:
        """Publish that changes may have been missed, unless the user saw nothing and sees nothing."""
        was_seen, self._is_seen = self._is_seen, self._sees(connection)
        if was_seen or self._is_seen:
            self.publish(OBJECTS)

    def _sees(self, connection: psycopg.Connection[Any]) -> bool:
        """Return whether the scene exists and the user may see it; read the name of its parent, too."""
        try:
            if store.scene_settings(connection, self.scene) is None:
                return False
            self._parent = store.parent_name(connection, store.scene_or_branch_id(connection, self.scene))
        except (InvalidInput, NotPermitted):  # dropped between both questions, or not shared
            return False
        return True

    def _meaning(self, payload: str, *, writers_notify: bool) -> str | None:
        """Return what a notification means for the scene, None if nothing."""
        try:
            run = json.loads(payload) if payload else None
        except (ValueError, RecursionError):  # any user may notify
            return None
        if not isinstance(run, dict):
            return OBJECTS
        # If scenes are protected, the notification of a run names none. If writers do not notify, objects changed
        # before the run. A branch shows the conflicts of its parent, too.
        concerns = run.get("scene") in (self.scene, self._parent, None)
        if "alarm" in run:
            return LIVE if concerns else None
        return (CONFLICTS if writers_notify else OBJECTS) if concerns else None


class Listener:
    """Listens for the changes of all scenes that pages show, in one thread and on one connection."""

    def __init__(
        self, connect: Callable[[], psycopg.Connection[Any]], scenes: Callable[[], list[SceneChanges]]
    ) -> None:
        self._connect = connect
        self._scenes = scenes
        self._ends = Event()
        self._thread = Thread(target=self.listen, daemon=True, name="changes")

    def start(self) -> None:
        """Start listening."""
        self._thread.start()

    def end(self) -> None:
        """End; from any thread. May be called again."""
        self._ends.set()

    def listen(self) -> None:
        """Listen until the end; connect again after each failure."""
        while not self._ends.is_set():
            try:
                with self._connect() as connection:
                    store.never_write(connection)
                    store.hear_changes(connection)
                    writers_notify = store.writers_notify(connection)
                    for scene in self._scenes():
                        scene.miss(connection)
                    self._hear(connection, writers_notify=writers_notify)
            except (ConflictDBError, psycopg.Error) as error:
                _log.debug("listening: %s", error)
                self._ends.wait(_PAUSE_S)

    def _hear(self, connection: psycopg.Connection[Any], *, writers_notify: bool) -> None:
        looked_s = -math.inf
        while not self._ends.is_set():
            said = list(store.changes(connection, _PAUSE_S))
            if said:
                time.sleep(_TOGETHER_S)
                said += store.changes(connection, 0.0)
            is_due = time.monotonic() - looked_s >= _LOOK_S
            looked_s = time.monotonic() if is_due else looked_s
            for scene in self._scenes():
                scene.hear(connection, said, writers_notify=writers_notify, is_due=is_due)
