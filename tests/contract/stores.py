"""Stores for conflicts, one row each: the implementations that `test_stores` runs on.

A new store is one row of STORES: a function that opens it with an empty scene.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, Protocol

import piecework
import psycopg

from conflictdb import store
from conflictdb.arrays.answers import Conflicts
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Conflict, Kind, Verdict


@dataclass(frozen=True)
class Member:
    """How arrays name an object: its kind (code), number and version."""

    kind: int
    number: int
    version: int


Answer = Callable[[dict[str, Member]], Conflicts]


class Store(Protocol):
    """A scene whose answers can be written back; each call sees the results of the previous ones."""

    def put(self, areas: Sequence[Area], tracks: Sequence[Track]) -> None:
        """Add or replace objects: pairs with a new or changed object are marked for computation."""

    def mark_all(self) -> None:
        """Have all pairs computed again."""

    def write(self, answer: Answer) -> tuple[int, int, int]:
        """Write the conflicts of the pairs to be computed, given the members by key: opened, changed, closed."""

    def crash(self, answer: Answer) -> None:
        """Write as `write` does, and die before the end of it."""

    def read(self) -> list[Conflict]:
        """Return all rows, pairs that are only near among them, in any order."""


@dataclass(frozen=True)
class Database:
    """A scene of the database: each call has a connection of its own."""

    dsn: str
    scene: Scene

    def put(self, areas: Sequence[Area], tracks: Sequence[Track]) -> None:
        with self._connect() as conn:
            store.replace_scene(conn, self.scene, list(areas), list(tracks), merge=True)

    def mark_all(self) -> None:
        with self._connect() as conn:
            piecework.mark_all(conn, store.scene_id(conn, self.scene.name))

    def write(self, answer: Answer) -> tuple[int, int, int]:
        with self._connect() as conn:
            outcome = self._write(conn, answer)
        return outcome.opened, outcome.changed, outcome.closed

    def crash(self, answer: Answer) -> None:
        conn = self._connect()
        self._write(conn, answer)
        conn.close()  # without a commit, as when the process is killed

    def read(self) -> list[Conflict]:
        with self._connect() as conn:
            near = [row for row in store.approaches(conn, self.scene.name) if row.verdict is Verdict.NEAR]
            return [*store.conflicts(conn, self.scene.name), *(row.as_near() for row in near)]

    def _connect(self) -> psycopg.Connection[Any]:
        return psycopg.connect(self.dsn, options="-c timezone=UTC")

    def _write(self, conn: psycopg.Connection[Any], answer: Answer) -> store.RunOutcome:
        scene_id = store.scene_id(conn, self.scene.name)
        conn.commit()
        piecework.refresh(conn, scene_id)
        store.begin_snapshot(conn)
        found = answer(self._members(conn))
        return piecework.write_run(conn, scene_id, store.RunRecord(self.scene.method, {}, datetime.now(UTC)), found)

    def _members(self, conn: psycopg.Connection[Any]) -> dict[str, Member]:
        areas = conn.execute("SELECT key, area_id, version FROM conflictdb.area").fetchall()
        tracks = conn.execute("SELECT key, track_id, version FROM conflictdb.track").fetchall()
        members = {key: Member(Kind.AREA.code, number, version) for key, number, version in areas}
        return members | {key: Member(Kind.TRACK.code, number, version) for key, number, version in tracks}


@contextmanager
def in_the_database(dsn: str, scene: Scene) -> Iterator[Store]:
    database = Database(dsn, scene)
    database.put([], [])
    yield database


STORES: Final[dict[str, Callable[[str, Scene], AbstractContextManager[Store]]]] = {"in the database": in_the_database}
