"""Sources of pairs, one row each: the implementations that `test_sources` runs on.

A new source is one row of SOURCES: a function that loads a scene into it and yields it, ready for stage 1, with the
keys of its objects.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Self, cast

import piecework
import psycopg

from conflictdb import store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core import near
from conflictdb.core.memory_budget import DEFAULT_MEMORY, MemoryBudget
from conflictdb.core.near import Chunk, PairSource, Question
from conflictdb.core.pieces.bundling import bundles_of
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.separations import Separations
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup, centred
from conflictdb.jobs.in_hand import Hand, InHand, Storing
from conflictdb.jobs.sources import FewStored, Stored
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Kind


class InMemory(near.Memory):
    """The source of pairs of `solve`, with the plane of its scene; objects are numbered in their order in the batch."""

    plane: Plane

    @classmethod
    def of(cls, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Self:
        scene = centred(scene, areas, tracks)
        batches, setup = (AreaBatch.of(areas), TrackBatch.of(tracks)), Setup.of(scene)
        source = cls(pieces_of(setup, *batches), batches)
        source.plane = setup.plane
        return source


@dataclass(frozen=True)
class Opened:
    """A scene in a source.

    key : of objects by kind (code) and number
    """

    source: PairSource
    scene: Scene
    key: dict[tuple[int, int], str]

    def chunks(self) -> Iterator[Chunk]:
        """Yield the pairs of a detection."""
        return self.source.pairs(Question.of(self.scene))


Open = Callable[[str, Scene, Sequence[Area], Sequence[Track]], AbstractContextManager[Opened]]


@contextmanager
def in_memory(dsn: str, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[Opened]:
    # Numbered by key, as `solve` has them: which of two comes first follows from their keys in each source.
    areas = sorted(areas, key=lambda area: area.key.encode())
    tracks = sorted(tracks, key=lambda track: track.key.encode())
    key = {(Kind.AREA.code, i): area.key for i, area in enumerate(areas)}
    key |= {(Kind.TRACK.code, i): track.key for i, track in enumerate(tracks)}
    yield Opened(InMemory.of(scene, areas, tracks), centred(scene, areas, tracks), key)


@contextmanager
def in_the_database(
    dsn: str, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], memory: MemoryBudget = DEFAULT_MEMORY
) -> Iterator[Opened]:
    with psycopg.connect(dsn, options="-c timezone=UTC") as conn:
        scene_id = piecework.load(conn, scene, list(areas), list(tracks))
        conn.commit()
        piecework.refresh(conn, scene_id)
        store.begin_snapshot(conn)
        key = {(0, number): name for number, name in conn.execute("SELECT area_id, key FROM conflictdb.area")}
        key |= {(1, number): name for number, name in conn.execute("SELECT track_id, key FROM conflictdb.track")}
        settings = store.read_settings(conn, scene_id)
        yield Opened(Stored(conn, scene_id, memory), settings, key)
        conn.rollback()


@contextmanager
def in_the_hand(
    dsn: str, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], memory: MemoryBudget = DEFAULT_MEMORY
) -> Iterator[Opened]:
    """All objects changed, and none is stored yet."""
    with psycopg.connect(dsn, options="-c timezone=UTC") as conn:
        scene_id = piecework.load(conn, scene, list(areas), list(tracks))
        conn.commit()
        store.begin_snapshot(conn)
        key = {(0, number): name for number, name in conn.execute("SELECT area_id, key FROM conflictdb.area")}
        key |= {(1, number): name for number, name in conn.execute("SELECT track_id, key FROM conflictdb.track")}
        settings = store.read_settings(conn, scene_id)
        batches = store.changed_areas(conn, scene_id), store.changed_tracks(conn, scene_id)
        order = store.order_of_all(conn, scene_id, len(key))
        assert order is not None
        hand = Hand.of(bundles_of(pieces_of(Setup.of(settings), *batches)), order)
        storing = Storing(conn, lambda _: cast(store.Staged, object()))
        yield Opened(InHand(conn, scene_id, memory, hand, storing, Separations.of(settings)), settings, key)
        conn.rollback()


@contextmanager
def of_few_changes(
    dsn: str, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], most_compared: int
) -> Iterator[Opened]:
    """All objects changed; stage 2 runs in the database for at most `most_compared` pairs of pieces."""
    with psycopg.connect(dsn, options="-c timezone=UTC") as conn:
        piecework.load(conn, scene, list(areas), list(tracks))
        conn.commit()
        yield few_changes(conn, scene.name, most_compared)
        conn.rollback()


def few_changes(conn: psycopg.Connection[Any], scene: str, most_compared: int) -> Opened:
    """Open the changed objects of a scene, in a transaction that stays open."""
    begun = store.begin_detection(conn, scene, 10_000, None, print, None)
    few, settings = begun.few, begun.settings
    assert few is not None
    areas = store.some_areas(conn, begun.scene_id, few.area_ids)
    tracks = store.some_tracks(conn, begun.scene_id, few.track_ids)
    pieces = pieces_of(Setup.of(settings), areas, tracks)
    key = {(0, number): name for number, name in conn.execute("SELECT area_id, key FROM conflictdb.area")}
    key |= {(1, number): name for number, name in conn.execute("SELECT track_id, key FROM conflictdb.track")}
    source = FewStored(conn, begun.scene_id, DEFAULT_MEMORY, few.srid, pieces, most_compared)
    return Opened(source, settings, key)


SOURCES: Final[dict[str, Open]] = {
    "in memory": in_memory,
    "in the database": in_the_database,
    "in hand": in_the_hand,
    "in hand, some at a time": partial(in_the_hand, memory=MemoryBudget(pairs=7, pieces=5, boxes=0)),
    "joined by the database": partial(in_the_database, memory=DEFAULT_MEMORY._replace(boxes=0)),
    "joined by the database, some at a time": partial(in_the_database, memory=MemoryBudget(pairs=7, pieces=5, boxes=0)),
    "few changes, stage 2 in the database": partial(of_few_changes, most_compared=10**9),
    "few changes, stage 2 at the client": partial(of_few_changes, most_compared=-1),
    "in the database, some at a time": partial(in_the_database, memory=MemoryBudget(pairs=7, pieces=5, boxes=10_000)),
}
