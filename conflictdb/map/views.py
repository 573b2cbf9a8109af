"""The scenes of a database that pages show, each with its changes and its cached tiles."""

import asyncio
from collections.abc import Callable
from threading import Lock
from typing import Any, Final

import psycopg

from conflictdb.errors import ConflictDBError
from conflictdb.map.scene_changes import Listener, SceneChanges

# Scenes that one server shows at once.
MOST_VIEWS: Final = 16
# Scenes without a page whose changes are still heard, so that a page which is opened again finds its tiles.
_MOST_SPARE: Final = 4
# Cached tiles of one state of a scene: some ten megabytes.
_MOST_TILES: Final = 1_000

TileKey = tuple[int, str, int, int, int]


class SceneView:
    """A scene that pages show.

    changes : its subscribers are pages
    """

    def __init__(self, name: str, changes: SceneChanges) -> None:
        self.name = name
        self.changes = changes
        self._tiles: dict[TileKey, bytes] = {}

    def tile(self, key: TileKey) -> bytes | None:
        """Return a cached tile; the key begins with the version of the scene."""
        return self._tiles.get(key)

    def keep(self, key: TileKey, tile: bytes) -> None:
        """Cache a tile, and forget those of other versions."""
        if len(self._tiles) >= _MOST_TILES or any(known[0] != key[0] for known in list(self._tiles)[:1]):
            self._tiles.clear()
        self._tiles[key] = tile


class SceneViews:
    """The views of scenes, made when they are first asked for; from any thread, after `start`."""

    def __init__(self, connect: Callable[[], psycopg.Connection[Any]]) -> None:
        self._views: dict[str, SceneView] = {}
        self._lock = Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._listener = Listener(connect, self._scenes)

    def start(self) -> None:
        """Begin; call it in the event loop."""
        self._loop = asyncio.get_running_loop()
        self._listener.start()

    def of(self, scene: str) -> SceneView:
        """Return the view of a scene, which need not exist; raises ConflictDBError if there are too many with pages."""
        with self._lock:
            view = self._views.pop(scene, None)
            if view is None:
                self._end_spare(_MOST_SPARE)
                if len(self._views) >= MOST_VIEWS:
                    self._end_spare(0)
                if len(self._views) >= MOST_VIEWS:
                    raise ConflictDBError(
                        f"pages show {MOST_VIEWS} scenes already, the most of one server: close those of one of them"
                    )
                view = SceneView(scene, SceneChanges(scene, self._loop, self._left))
            self._views[scene] = view
        return view

    def _left(self) -> None:
        with self._lock:
            self._end_spare(_MOST_SPARE)

    def _end_spare(self, most: int) -> None:
        """End views without a page but the last used ones."""
        spare = [one for one in self._views.values() if not one.changes.has_subscribers]
        for one in spare[: max(0, len(spare) - most)]:
            one.changes.end()
            del self._views[one.name]

    def _scenes(self) -> list[SceneChanges]:
        with self._lock:
            return [view.changes for view in self._views.values()]

    def end(self) -> None:
        """End all subscriptions; from any thread. May be called again."""
        self._listener.end()
        for changes in self._scenes():
            changes.end()
