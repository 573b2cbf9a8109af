"""Changes of a scene, from the database's notifications to whoever has the page open."""

import asyncio
import json
import logging
import math
import time
from collections.abc import AsyncIterator, Callable
from threading import Event, Thread
from typing import Any, Final

import psycopg

from conflictdb.db import store
from conflictdb.errors import ConflictDBError, NotPermitted

_log = logging.getLogger(__name__)

# How soon an end is noticed, and a lost connection made again.
_PAUSE_S: Final = 0.5
# Changes that come together are told once.
_TOGETHER_S: Final = 0.1
# How often it is looked whether the scene may still be seen, which the database does not notify of.
_LOOK_S: Final = 1.0
# Without a word for so long, proxies and browsers take a connection for dead.
_SILENT_S: Final = 15.0

OBJECTS: Final = "objects"
CONFLICTS: Final = "conflicts"


class Changes:
    """Listens in a thread of its own, and tells each subscriber what changed: OBJECTS, CONFLICTS.

    version : grows with each change; what was read before is not of it
    """

    def __init__(self, scene: str, connect: Callable[[], psycopg.Connection[Any]]) -> None:
        self.version = 0
        self._scene = scene
        self._connect = connect
        self._ends = Event()
        self._is_seen = True
        self._writers_notify = True
        self._thread = Thread(target=self._listen, daemon=True, name="changes")
        self._subscribers: set[asyncio.Queue[str | None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    def start(self) -> None:
        """Begin to listen; from within the event loop."""
        self._loop = asyncio.get_running_loop()
        self._thread.start()

    def end(self) -> None:
        """Tell subscribers that nothing more comes; from any thread. May be called again."""
        self._ends.set()
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._ended)

    def _ended(self) -> None:
        for queue in self._subscribers:
            queue.put_nowait(None)

    async def each(self) -> AsyncIterator[str]:
        """Yield server-sent events until the end."""
        queue: asyncio.Queue[str | None] = asyncio.Queue()
        self._subscribers.add(queue)
        try:
            yield "retry: 1000\n\n"
            while not self._ends.is_set():
                try:
                    what = await asyncio.wait_for(queue.get(), _SILENT_S)
                except TimeoutError:
                    yield ": still here\n\n"
                    continue
                if what is None:
                    return
                yield f"event: {what}\ndata: {self.version}\n\n"
        finally:
            self._subscribers.discard(queue)

    def tell(self, what: str) -> None:
        """Tell subscribers of a change; from any thread."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._told, what)

    def _told(self, what: str) -> None:
        self.version += 1
        for queue in self._subscribers:
            queue.put_nowait(what)

    def _listen(self) -> None:
        is_first = True
        while not self._ends.is_set():
            try:
                with self._connect() as connection:
                    store.never_write(connection)
                    store.hear_changes(connection)
                    self._writers_notify = store.writers_notify(connection)
                    if is_first:
                        self._is_seen = self._sees(connection)
                    else:  # whatever happened meanwhile
                        self.tell(OBJECTS)
                    is_first = False
                    self._hear(connection)
            except (ConflictDBError, psycopg.Error) as error:
                _log.debug("listening: %s", error)
                self._ends.wait(_PAUSE_S)

    def _hear(self, connection: psycopg.Connection[Any]) -> None:
        looked_s = -math.inf
        while not self._ends.is_set():
            said = set(filter(None, map(self._meaning, store.changes(connection, _PAUSE_S))))
            if said:
                time.sleep(_TOGETHER_S)
                said |= set(filter(None, map(self._meaning, store.changes(connection, 0.0))))
            elif time.monotonic() - looked_s < _LOOK_S:
                continue
            looked_s = time.monotonic()
            # Who may not see the scene, or no longer, is told so once, and of none of its changes.
            was_seen, self._is_seen = self._is_seen, self._sees(connection)
            if self._is_seen != was_seen:
                self.tell(OBJECTS)
            elif said and self._is_seen:
                # What objects are new is asked together with their conflicts.
                self.tell(OBJECTS if OBJECTS in said else CONFLICTS)

    def _sees(self, connection: psycopg.Connection[Any]) -> bool:
        """Return whether the scene is there, for who asks."""
        try:
            return store.scene_settings(connection, self._scene) is not None
        except NotPermitted:
            return False

    def _meaning(self, payload: str) -> str | None:
        """Return what a notification means for the scene: of a run it names it, unless scenes are protected."""
        try:
            run = json.loads(payload) if payload else None
        except (ValueError, RecursionError):  # everybody may notify
            return None
        if not isinstance(run, dict):
            return OBJECTS
        # Where scenes are protected, it says of none which it is. Where writers do not notify, objects changed before a
        # run.
        return (CONFLICTS if self._writers_notify else OBJECTS) if run.get("scene") in (self._scene, None) else None
