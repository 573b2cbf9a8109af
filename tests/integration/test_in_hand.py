"""A detection of all objects solves from the pieces in hand: the same answer, nothing half stored, nothing outdated."""

import gc
import weakref
from collections.abc import Callable
from typing import Any

import psycopg
import pytest
from made_scenes import sea
from mixed_scenes import mixed_scene
from scene_features import FEATURES

from conflictdb import Area, Scene, Track, store
from conflictdb.core import memory_budget
from conflictdb.core.memory_budget import LEAST_MEMORY_MB, MemoryBudget
from conflictdb.earth.registry import centred
from conflictdb.errors import StoreError
from conflictdb.jobs import detect, in_hand
from conflictdb.store import copy_binary

Conn = psycopg.Connection[Any]
Objects = tuple[Scene, list[Area], list[Track]]
ANSWER = (
    "SELECT c.a_key, c.b_key, to_jsonb(c) - ARRAY['conflict_id', 'a_id', 'b_id', 'a_version', 'b_version', 'run_id', "
    "'found_at', 'scene_id', 'opened_at', 'changed_at', 'opened_run_id', 'changed_run_id', 'digest'] "
    "FROM conflictdb.conflict c ORDER BY 1, 2"
)


def sea_of(objects: int) -> Objects:
    parts = list(sea(objects, 1))
    return Scene("sea"), [a for areas, _ in parts for a in areas], [t for _, tracks in parts for t in tracks]


def load(conn: Conn, objects: Objects) -> str:
    scene, areas, tracks = objects
    store.replace_scene(conn, centred(scene, areas, tracks), areas, tracks, merge=False)
    return scene.name


def rows(conn: Conn, query: str = ANSWER) -> list[tuple[Any, ...]]:
    found = conn.execute(query.encode()).fetchall()
    conn.rollback()
    return found


@pytest.fixture
def read_back(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The calls that read pieces, as they happen."""
    calls: list[str] = []
    for name in ("boxes", "bundles", "candidates"):
        routine = getattr(store, name)

        def counted(*arguments: Any, name: str = name, routine: Callable[..., Any] = routine, **named: Any) -> Any:
            calls.append(name)
            return routine(*arguments, **named)

        monkeypatch.setattr(store, name, counted)
    return calls


@pytest.mark.parametrize("seed", range(0, 2 * len(FEATURES), 5))
def test_a_scene_in_hand_has_the_answer_of_stored_pieces(
    conn: Conn, read_back: list[str], monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """To the bit: the database keeps the numbers of the answer, and a digest of all of them."""
    mixed = mixed_scene(seed)
    name = load(conn, (mixed.scene, mixed.areas, mixed.tracks))
    detect.detect(conn, name, jobs=1, few_objects=-1)
    assert not read_back
    in_hand_answer = rows(conn)
    monkeypatch.setattr(MemoryBudget, "hand_bytes", property(lambda _: -1))
    again = detect.detect(conn, name, jobs=1, full=True)
    assert read_back
    assert (again.opened, again.changed, again.closed) == (0, 0, 0)
    conn.execute("DELETE FROM conflictdb.scene")
    conn.commit()
    load(conn, (mixed.scene, mixed.areas, mixed.tracks))
    detect.detect(conn, name, jobs=1, few_objects=-1)
    assert rows(conn) == in_hand_answer


def test_no_piece_is_read_back_and_the_answer_does_not_depend_on_memory(conn: Conn, read_back: list[str]) -> None:
    """A first detection, and one in full, which writes no row."""
    name = load(conn, sea_of(600))
    detect.detect(conn, name, jobs=1, memory_mb=LEAST_MEMORY_MB)
    first = rows(conn)
    again = detect.detect(conn, name, jobs=2, full=True)
    assert not read_back
    assert (again.opened, again.changed, again.closed) == (0, 0, 0)
    assert rows(conn) == first


def test_some_changed_objects_are_not_all(conn: Conn, read_back: list[str]) -> None:
    scene, areas, tracks = sea_of(600)
    name = load(conn, (scene, areas, tracks))
    detect.detect(conn, name, jobs=1)
    conn.execute("UPDATE conflictdb.track SET floor_m = -1000 WHERE track_id % 2 = 0")
    conn.commit()
    detect.detect(conn, name, jobs=1)
    assert read_back


@pytest.fixture
def other(dsn: str) -> Any:
    with psycopg.connect(dsn, autocommit=True) as connection:
        yield connection


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE conflictdb.track SET floor_m = -1000, ceiling_m = -900 WHERE key = 'T0'",
        "DELETE FROM conflictdb.area WHERE key = 'A0'",
        "UPDATE conflictdb.scene SET separation_m = 5000",
    ],
)
def test_what_changes_meanwhile_is_in_the_answer_or_waits(
    conn: Conn, other: Conn, read_back: list[str], monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    """The pieces in hand are those of the first transaction; the second sees a change between the two."""
    scene, areas, tracks = sea_of(300)
    name = load(conn, (scene, areas, tracks))
    change = change.replace("'T0'", f"'{tracks[0].key}'").replace("'A0'", f"'{areas[0].key}'")
    begin = store.begin_locked

    def begin_late(*arguments: Any) -> int:
        if not other.closed:
            other.execute(change.encode())
            other.close()
        return begin(*arguments)

    monkeypatch.setattr(store, "begin_locked", begin_late)
    detect.detect(conn, name, jobs=1)
    assert other.closed
    assert read_back
    detect.detect(conn, name, jobs=1)
    (waiting,) = rows(conn, "SELECT count(*) FROM conflictdb.change")
    assert waiting == (0,)
    current = rows(conn)
    assert detect.detect(conn, name, jobs=1, full=True).opened == 0
    assert rows(conn) == current


@pytest.mark.parametrize("side", ["storing", "solving", "second transaction"])
def test_a_failure_of_either_side_leaves_everything_as_it_was(
    conn: Conn, monkeypatch: pytest.MonkeyPatch, side: str
) -> None:
    scene, areas, tracks = sea_of(300)
    name = load(conn, (scene, areas, tracks))
    detect.detect(conn, name, jobs=1)
    before = rows(conn)
    store.replace_scene(conn, scene, areas[:100], tracks[:120], merge=False)

    def fail(*_: object, **__: object) -> None:
        raise StoreError("it fails")

    with monkeypatch.context() as patched:
        module, routine = {
            "storing": (copy_binary, "send"),
            "solving": (in_hand, "pairs_of_bundles"),
            "second transaction": (store, "begin_write"),
        }[side]
        patched.setattr(module, routine, fail)
        with pytest.raises(StoreError, match="it fails"):
            detect.detect(conn, name, jobs=1, full=True)
    assert rows(conn) == before
    (failures,) = rows(conn, "SELECT count(*) FROM conflictdb.run WHERE error IS NOT NULL AND method = 'exact'")
    assert failures == (1,)
    detect.detect(conn, name, jobs=1)
    assert len(rows(conn)) < len(before)
    again = detect.detect(conn, name, jobs=1, full=True)
    assert (again.opened, again.changed, again.closed) == (0, 0, 0)


def test_outdated_pieces_are_freed_before_they_are_cut_again(
    conn: Conn, other: Conn, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The memory is planned for one set of pieces; also the error that ends the first attempt has none."""
    name = load(conn, sea_of(300))
    begin, refresh, of = store.begin_locked, detect.refresh_pieces, in_hand.Hand.of
    held: list[weakref.ref[Any]] = []
    freed: list[bool] = []

    def begin_late(*arguments: Any) -> int:
        other.execute("UPDATE conflictdb.scene SET separation_m = 5000")
        return begin(*arguments)

    def hand_of(*arguments: Any) -> in_hand.Hand:
        hand = of(*arguments)
        held.extend(map(weakref.ref, (hand.place, hand.bundles.offset)))
        return hand

    def refresh_again(*arguments: Any, **named: Any) -> Any:
        freed.extend(ref() is None for ref in held)
        return refresh(*arguments, **named)

    monkeypatch.setattr(store, "begin_locked", begin_late)
    monkeypatch.setattr(in_hand.Hand, "of", hand_of)
    monkeypatch.setattr(detect, "refresh_pieces", refresh_again)
    gc.collect()
    gc.disable()
    try:
        detect.detect(conn, name, jobs=1)
    finally:
        gc.enable()
    assert freed == [True, True]


def test_memory_is_that_of_the_pieces_in_hand_and_of_small_portions(
    conn: Conn, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A batch of pieces is freed before the next one is cut, and pairs are solved in portions."""
    name = load(conn, sea_of(600))
    batches: list[weakref.ref[Any]] = []
    chunks: list[int] = []
    cut, pairs = detect.bundles_of, in_hand.pairs_of_bundles

    def cut_and_watched(*arguments: Any) -> Any:
        assert [one for one in batches if one() is not None] == []
        found = cut(*arguments)
        batches.append(weakref.ref(found.pieces.hull_xy))
        return found

    def counted(*arguments: Any) -> Any:
        for chunk in pairs(*arguments):
            chunks.append(len(chunk.a))
            yield chunk

    monkeypatch.setattr(detect, "bundles_of", cut_and_watched)
    monkeypatch.setattr(in_hand, "pairs_of_bundles", counted)
    monkeypatch.setattr(detect, "_FIRST_OBJECTS", 30)
    monkeypatch.setattr(memory_budget, "_MOST_PIECES_AT_ONCE", 200)
    monkeypatch.setattr(memory_budget, "_MOST_PAIRS_AT_ONCE", 300)
    detect.detect(conn, name, jobs=1)
    in_portions = rows(conn)
    assert len(batches) > 4
    assert len(chunks) > 4
    # All pairs of two objects stay together.
    assert max(chunks) < 600
    monkeypatch.undo()
    again = detect.detect(conn, name, jobs=1, full=True)
    assert (again.opened, again.changed, again.closed) == (0, 0, 0)
    assert rows(conn) == in_portions


def test_a_stopped_thread_stores_no_further_block() -> None:
    """An interrupt between two blocks finds no statement to cancel."""
    started = []

    class Connection:
        pass

    def work(storing: in_hand.Storing) -> Any:
        started.append(storing)
        while True:
            storing.go_on()

    storing = in_hand.Storing(Connection(), work)  # type: ignore[arg-type]
    storing.stop()
    with pytest.raises(in_hand.Outdated):
        storing.result()
