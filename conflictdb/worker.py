"""Keeps all scenes current: detects again whatever changed, as soon as it changes.

The marks that changes leave in the database are the queue, so a worker has no state of its own: it may be killed at any
moment, and there may be as many as you like, on as many machines. It listens for changes (NOTIFY) and looks for marks
now and then, in case a notification was lost with its connection.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import psycopg

from conflictdb import detect, schema, store
from conflictdb.errors import ConflictDBError, SchemaError

_log = logging.getLogger(__name__)

EVERY_S: Final = 60.0
# After a lost connection: the first pause, doubled up to the longest.
_PAUSE_S: Final = 1.0
_LONGEST_PAUSE_S: Final = 60.0

Connect = Callable[[], "psycopg.Connection[Any]"]
Report = Callable[[str, "detect.Run | Exception"], None]


@dataclass(slots=True)
class Worker:
    """A worker; `run` works until it is interrupted.

    connect : opens a connection of its own
    report : told the outcome of each detection: the scene, and the run or the error
    every_s : looks for changes at least this often, seconds; a scene that failed is left alone this long
    jobs : processes to solve in, None for one per processor
    """

    connect: Connect
    report: Report
    every_s: float = EVERY_S
    jobs: int | None = None
    _failed_at: dict[str, float] = field(default_factory=dict)

    def once(self) -> bool:
        """Detect every scene that has pending changes; return whether all went well."""
        with self.connect() as connection:
            _check(connection)
            return self._round(connection)

    def run(self) -> None:
        """Keep scenes current until KeyboardInterrupt; survives the failure of a scene and the loss of the database.

        Raises
        ------
        SchemaError
            The schema is missing, or of another version than this program.
        ServerError, StoreError
            The first connection fails.
        """
        pause_s = _PAUSE_S
        connection = self.connect()
        while True:
            try:
                with connection:
                    _check(connection)
                    store.listen(connection)
                    pause_s = _PAUSE_S
                    while True:
                        self._round(connection)
                        store.wait_for_change(connection, self.every_s)
            except SchemaError:
                raise
            except ConflictDBError as error:
                _log.warning("lost the database, trying again: %s", error)
            connection, pause_s = self._reconnected(pause_s)

    def _reconnected(self, pause_s: float) -> tuple["psycopg.Connection[Any]", float]:
        while True:
            time.sleep(pause_s)
            pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)
            try:
                return self.connect(), pause_s
            except ConflictDBError as error:
                _log.warning("no database yet, trying again in %g s: %s", pause_s, error)

    def _round(self, connection: "psycopg.Connection[Any]") -> bool:
        """Detect every scene that has pending changes, unless it failed a moment ago; return whether all went well."""
        well = True
        with store.translated(), connection.transaction():
            pending = [status.scene.name for status in store.list_scenes(connection) if status.pending]
        for scene in pending:
            if time.monotonic() < self._failed_at.get(scene, -self.every_s) + self.every_s:
                continue
            self._failed_at.pop(scene, None)
            try:
                self.report(scene, detect.detect(connection, scene, jobs=self.jobs))
            except Exception as error:  # whatever is wrong with one scene, the others want to be current
                if connection.closed:
                    raise
                connection.rollback()
                well = False
                self._failed_at[scene] = time.monotonic()
                _log.debug("scene %r failed", scene, exc_info=error)
                self.report(scene, error)
        return well


def _check(connection: "psycopg.Connection[Any]") -> None:
    with store.translated(), connection.transaction():
        schema.check(connection)
