"""One detection of a scene works at a time, in two transactions, and whatever comes in between the answer is right."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from commands import runner
from patience import WAIT_S
from psycopg.pq import TransactionStatus
from scenes import T0_US
from verdicts import Pair, Reported, by_pair, solved

from conflictdb import store
from conflictdb.cli.codes import FAILED
from conflictdb.core.pieces.bundling import bundles_of
from conflictdb.core.pieces.cutting import area_pieces
from conflictdb.core.run import run_scene
from conflictdb.earth.registry import Setup
from conflictdb.errors import LockTimeout, StoreError
from conflictdb.jobs import detect
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m
from conflictdb.store import connection, few, locking

Conn = psycopg.Connection[Any]

# The cheapest method: these tests are about the objects and settings that an answer belongs to.
SCENE = Scene("s", method=Method.SCREEN)
# Tracks pass through the area, and C 2 km north of it: it is in conflict with A by a separation only.
AREA = Area("A", shapely.MultiPolygon([shapely.box(4.0, 56.98, 4.1, 57.02)]))
OUTLINE = rectangle_outline_m(100.0, 100.0, 100.0, 100.0)


def track(key: str, lat: float, late_us: int = 0) -> Track:
    times = np.array([T0_US, T0_US + 3_600_000_000]) + late_us
    return Track(key, np.array([[3.9, lat], [4.2, lat]]), times, OUTLINE)


TRACKS = [track("B", 57.0), track("C", 57.04)]


def begin(conn: Conn, scene_id: int, lock_timeout_s: float | None = 0.0, say: store.Say = print) -> int:
    return store.begin_locked(conn, scene_id, SCENE.name, lock_timeout_s, say)


@pytest.fixture
def scene_id(conn: Conn) -> int:
    store.replace_scene(conn, SCENE, [AREA], TRACKS, merge=False)
    return store.scene_id(conn, SCENE.name)


@pytest.fixture
def other(dsn: str) -> Iterator[Conn]:
    with store.connect(dsn) as conn:
        conn.execute("SELECT set_config('application_name', 'the other', false)")
        conn.commit()
        yield conn


def test_one_detection_of_a_scene_at_a_time(conn: Conn, other: Conn, scene_id: int) -> None:
    """The second detection's error names the first; another scene is free; the lock ends with the transaction."""
    other_scene = store.set_scene(conn, Scene("another"))
    number = begin(other, scene_id)
    with pytest.raises(
        LockTimeout, match=f"scene 's' is at work: process {other.info.backend_pid} .*'the other', since"
    ):
        begin(conn, scene_id)
    assert conn.info.transaction_status == TransactionStatus.IDLE
    begin(conn, other_scene)
    conn.rollback()
    other.rollback()
    assert begin(conn, scene_id) == number, "what was rolled back does not count"
    conn.commit()
    assert begin(other, scene_id) == number + 1
    other.rollback()


def test_a_detection_that_waits_says_for_whom_and_goes_on(
    conn: Conn, other: Conn, scene_id: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locking, "SAY_AFTER_S", 0.1)
    begin(other, scene_id)
    said: list[str] = []

    def say(text: str) -> None:
        said.append(text)
        threading.Timer(0.5, other.rollback).start()

    run = detect.detect(conn, SCENE.name, jobs=1, say=say)
    assert run.conflicts == 1
    assert said == [said[0]], "once, as long as it is the same one"
    assert f"process {other.info.backend_pid} of the server" in said[0]


def test_a_detection_waits_no_longer_than_it_is_told(conn: Conn, other: Conn, scene_id: int) -> None:
    begin(other, scene_id)
    with pytest.raises(LockTimeout, match=r"waited 0.3 s: another detection of scene 's' is at work: process"):
        detect.detect(conn, SCENE.name, jobs=1, lock_timeout_s=0.3)
    other.rollback()
    assert store.runs(conn, SCENE.name, 9) == [], "waiting is no run"
    other.execute("LOCK conflictdb.conflict")
    with pytest.raises(LockTimeout, match="lock timeout"):
        detect.detect(conn, SCENE.name, jobs=1, lock_timeout_s=0.3)
    other.rollback()
    assert detect.detect(conn, SCENE.name, jobs=1, lock_timeout_s=0.3).opened == 1


def test_commands_say_for_whom_they_wait_and_take_a_limit(
    dsn: str, other: Conn, scene_id: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locking, "SAY_AFTER_S", 0.1)
    begin(other, scene_id)
    run = runner(dsn, capsys)
    clock_s, looks, holder = [0.0], count(), locking._holder

    def looked(*arguments: Any) -> str:
        clock_s[0] = 2.0 * next(looks)  # the limit is reached at the second look
        return holder(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(locking, "time", SimpleNamespace(monotonic=lambda: clock_s[0]))
        patched.setattr(locking, "_holder", looked)
        done = run("detect", "--scene", "s", "--jobs", "1", "--lock-timeout", "2s")
    said, failed = done.err.splitlines()
    assert done.code == FAILED
    assert said.startswith(f"conflictdb: waiting for another detection of scene 's': process {other.info.backend_pid} ")
    assert failed.startswith("conflictdb: waited 2 s: another detection of scene 's' is at work: process ")
    done = run("worker", "--once", "--lock-timeout", "500ms")
    assert done.code == FAILED
    assert done.err.startswith("conflictdb: s: failed: another detection of scene 's' is at work: process ")


def test_who_can_only_connect_cannot_keep_a_scene_from_being_detected(
    conn: Conn, dsn: str, scene_id: int, server_dsn: str
) -> None:
    """Any role can take advisory locks; only workers can lock rows of the table and the table itself."""
    detect.detect(conn, SCENE.name, jobs=1)
    with psycopg.connect(dsn) as attacker:
        attacker.execute("CREATE ROLE locks_stranger")
        try:
            attacker.execute("SET ROLE locks_stranger")
            attacker.execute("SELECT pg_advisory_lock(hashtextextended('conflictdb.scene.' || %s, 0))", [scene_id])
            for statement in (
                "SELECT FROM conflictdb.scene_lock FOR UPDATE",
                "SELECT FROM conflictdb.scene_lock FOR KEY SHARE",
                "LOCK conflictdb.scene_lock IN ACCESS SHARE MODE",
                "LOCK conflictdb.piece IN ACCESS SHARE MODE",
                "SELECT conflictdb_internal._take_scene(1, 0)",
            ):
                with pytest.raises(psycopg.errors.InsufficientPrivilege), attacker.transaction():
                    attacker.execute(statement.encode())
            assert detect.detect(conn, SCENE.name, full=True, jobs=1, lock_timeout_s=2.0).conflicts == 1
        finally:
            attacker.rollback()


@pytest.mark.parametrize("role", ["conflictdb_reader", "conflictdb_editor"])
def test_only_workers_lock_scenes(conn: Conn, other: Conn, scene_id: int, role: str) -> None:
    detect.detect(conn, SCENE.name, jobs=1)
    other.execute(f"SET ROLE {role}".encode())
    for statement in (
        "SELECT FROM conflictdb.scene_lock FOR KEY SHARE",
        "LOCK conflictdb.scene_lock IN ROW EXCLUSIVE MODE",
        "SELECT conflictdb_internal._take_scene(1, 0)",
    ):
        with pytest.raises(psycopg.errors.InsufficientPrivilege), other.transaction():
            other.execute(statement.encode())


def test_a_snapshot_from_before_the_end_of_another_detection_is_taken_anew(
    conn: Conn, other: Conn, scene_id: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The snapshot comes with the first statement, the lock later: in between another detection may work and end."""
    within: list[str] = []

    def slowly(connection: Conn, routine: str, *arguments: object) -> tuple[Any, ...]:
        if connection is conn and routine == "_begin_detection" and len(within) < 2:
            within.append(routine)
            store.replace_scene(other, SCENE, [AREA], [track("B", 57.0, 1_000_000), TRACKS[1]], merge=False)
            detect.detect(other, SCENE.name, jobs=1)
        return connection_call(connection, routine, *arguments)

    connection_call = connection.call
    monkeypatch.setattr(few, "call", slowly)
    run = detect.detect(conn, SCENE.name, jobs=1)
    assert within == ["_begin_detection"] * 2
    assert (run.candidate_pairs, run.opened, run.changed) == (0, 0, 0), "the other one has done it all"
    moved = [track("B", 57.0, 1_000_000), TRACKS[1]]
    assert by_pair(store.conflicts(conn, SCENE.name)) == solved(SCENE, [AREA], moved)


class Stepped:
    """A detection in a thread of its own that stops before each of its transactions."""

    def __init__(self, dsn: str) -> None:
        self.go, self.at_gate = threading.Semaphore(0), threading.Semaphore(0)
        self.error: BaseException | None = None
        self.conn: Conn | None = None
        self.thread = threading.Thread(target=self._work, args=(dsn,), daemon=True)

    def start(self) -> None:
        """Let it come to its first transaction."""
        self.thread.start()
        assert self.at_gate.acquire(timeout=WAIT_S)

    def _work(self, dsn: str) -> None:
        try:
            with store.connect(dsn) as self.conn:
                # Two transactions, however few objects changed.
                detect.detect(self.conn, SCENE.name, jobs=1, few_objects=-1)
        except BaseException as error:
            self.error = error
        finally:
            self.at_gate.release()

    def step(self) -> None:
        """Let it do its next transaction."""
        self.go.release()
        assert self.at_gate.acquire(timeout=WAIT_S)
        if self.error is not None:
            raise self.error


@pytest.fixture
def stepped(dsn: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, Stepped]:
    """Two detections, a and b, before their first transactions."""
    both = {name: Stepped(dsn) for name in "ab"}

    def gated(begin: Callable[..., Any]) -> Callable[..., Any]:
        def wait(*arguments: Any) -> Any:
            # Another thread may begin the second transaction.
            for one in (one for one in both.values() if one.conn is arguments[0]):
                one.at_gate.release()
                assert one.go.acquire(timeout=WAIT_S)
            return begin(*arguments)

        return wait

    for begin_one in (store.begin_detection, store.begin_locked):
        monkeypatch.setattr(store, begin_one.__name__, gated(begin_one))
    return both


Content = tuple[Scene, list[Area], list[Track]]
EDITS: list[Callable[[Content], Content]] = [
    lambda now: (now[0], now[1], [track("B", 57.0, 7_000_000), *now[2][1:]]),  # changed
    lambda now: (replace(now[0], separation_m=3000.0), now[1], now[2]),  # other settings: C is in conflict, too
    lambda now: (now[0], now[1], [*now[2], track("D", 56.99)]),  # added
    lambda now: (now[0], now[1], [one for one in now[2] if one.key != "B"]),  # removed
    lambda now: (replace(now[0], separation_m=0.0), now[1], now[2]),
]


@pytest.mark.parametrize("first_edit", [0, 1, 3, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 4))])
@pytest.mark.parametrize("order", ["aabb", "abab", "abba"])
def test_two_detections_interleaved_in_every_order_with_edits_between_all_transactions(
    dsn: str, conn: Conn, order: str, first_edit: int, stepped: dict[str, Stepped]
) -> None:
    """Conflicts that are current are right after each transaction, and all of them once nothing is left to do."""
    content: Content = (SCENE, [AREA], TRACKS)
    store.replace_scene(conn, *content, merge=False)
    detect.detect(conn, SCENE.name, jobs=1)
    for one in stepped.values():
        one.start()
    edits = iter(EDITS[first_edit:] + EDITS[:first_edit])
    for name in order:
        content = next(edits)(content)
        store.replace_scene(conn, *content, merge=False)
        stepped[name].step()
        assert_current_ones_are_right(conn, content)
    detect.detect_pending(conn, SCENE.name, jobs=1)
    found = store.conflicts(conn, SCENE.name)
    assert all(one.is_current for one in found)
    assert store.list_scenes(conn)[0].pending == 0
    assert by_pair(found) == solved(*content)


def assert_current_ones_are_right(conn: Conn, content: Content) -> None:
    """Conflicts marked current are right; if nothing waits, none is missing."""
    right = solved(*content)
    rows = store.conflicts(conn, SCENE.name)
    current: dict[Pair, Reported] = by_pair(row for row in rows if row.is_current)
    assert {pair: right.get(pair) for pair in current} == current
    if not store.list_scenes(conn)[0].pending:
        assert current == right


def test_limits_of_time_do_not_end_a_detection(
    conn: Conn, dsn: str, scene_id: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It solves while its transaction is idle, and its statements run as long as they need."""
    names = ["idle_in_transaction_session_timeout", "statement_timeout"]
    names += ["transaction_timeout"] * (conn.info.server_version >= 170000)
    within: list[list[Any]] = []

    def shown() -> list[Any]:
        return [slow.execute(f"SHOW {name}".encode()).fetchone() for name in names]

    def noted(*arguments: Any, **named: Any) -> Any:
        within.append(shown())
        return run_scene(*arguments, **named)

    monkeypatch.setattr(detect, "run_scene", noted)
    for name in names:
        conn.execute(f"ALTER DATABASE {conn.info.dbname} SET {name} = '1h'".encode())
    conn.commit()
    limited, free = [("1h",)] * len(names), [("0",)] * len(names)
    with store.connect(dsn) as slow:
        assert shown() == limited
        slow.rollback()
        assert detect.detect(slow, SCENE.name, jobs=1).conflicts == 1
        assert within == [free]
        assert shown() == limited, "for its transactions only"


def test_an_interrupted_detection_leaves_the_connection_without_its_lock(
    conn: Conn, other: Conn, scene_id: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(detect, "run_scene", interrupted)
        with pytest.raises(KeyboardInterrupt):
            detect.detect(conn, SCENE.name, jobs=1)
    assert conn.info.transaction_status == TransactionStatus.IDLE
    assert store.runs(conn, SCENE.name, 9) == []
    assert detect.detect(other, SCENE.name, jobs=1, lock_timeout_s=0.0).conflicts == 1


def test_detection_needs_a_connection_without_an_open_transaction(conn: Conn, scene_id: int) -> None:
    """And leaves the caller's transaction alone."""
    conn.commit()
    conn.execute("CREATE TEMPORARY TABLE mine (n integer)")
    with pytest.raises(StoreError, match="open transaction"):
        detect.detect(conn, SCENE.name, jobs=1)
    with pytest.raises(StoreError, match="open transaction"):
        store.begin_snapshot(conn)
    conn.execute("SELECT FROM mine")


def test_a_scene_waits_for_its_pieces_and_takes_them_along(conn: Conn, other: Conn, scene_id: int) -> None:
    """No foreign key checks every piece: the scene itself is kept while they are written, once."""
    begin(conn, scene_id)
    pieces = area_pieces(Setup.of(SCENE), store.changed_areas(conn, scene_id))
    store.replace_pieces(conn, scene_id, [bundles_of(pieces)])
    removal = "DELETE FROM conflictdb.scene WHERE scene_id = %s"
    other.execute("SET LOCAL lock_timeout = '200ms'")
    with pytest.raises(psycopg.errors.LockNotAvailable):
        other.execute(removal, [scene_id])
    other.rollback()
    conn.commit()
    assert conn.execute("SELECT count(*) FROM conflictdb.piece").fetchone() == (1,)
    conn.rollback()
    other.execute(removal, [scene_id])
    other.commit()
    assert conn.execute("SELECT count(*) FROM conflictdb.piece").fetchone() == (0,)


def test_pieces_of_a_scene_that_was_removed_are_refused(conn: Conn, other: Conn, scene_id: int) -> None:
    begin(conn, scene_id)
    other.execute("DELETE FROM conflictdb.scene WHERE scene_id = %s", [scene_id])
    other.commit()
    pieces = area_pieces(Setup.of(SCENE), store.changed_areas(conn, scene_id))
    with pytest.raises(StoreError, match="SQLSTATE 40001"):
        store.replace_pieces(conn, scene_id, [bundles_of(pieces)])


@pytest.mark.parametrize(
    ("place", "is_one_transaction"),
    [
        ("begin_detection", False),
        ("begin_locked", False),
        ("begin_write", False),
        ("end_write", False),
        ("begin_detection", True),
        ("put_pieces", True),
        ("end_write", True),
    ],
)
def test_a_scene_may_be_removed_while_it_is_detected(
    conn: Conn,
    other: Conn,
    scene_id: int,
    place: str,
    is_one_transaction: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At once, except while the detection writes, which then reports that the scene is gone."""
    another = store.set_scene(conn, Scene("another"))
    # Few changes are written from the beginning of their one transaction on.
    waits = is_one_transaction or place == "end_write"
    whole = getattr(store, place)
    removals: list[threading.Thread] = []

    def remove() -> None:
        other.execute("DELETE FROM conflictdb.scene WHERE scene_id = %s", [scene_id])
        other.commit()

    def meanwhile(*arguments: Any) -> Any:
        result = whole(*arguments)
        if not removals:
            removals.append(threading.Thread(target=remove))
            removals[0].start()
            removals[0].join(0.5 if waits else WAIT_S)
            assert removals[0].is_alive() == waits
        return result

    monkeypatch.setattr(store, place, meanwhile)
    few_objects = 100 if is_one_transaction else -1
    if waits:
        assert detect.detect(conn, SCENE.name, jobs=1, few_objects=few_objects).conflicts == 1
    else:
        with pytest.raises(StoreError, match="scene 's' was removed while it was detected"):
            detect.detect(conn, SCENE.name, jobs=1, few_objects=few_objects)
    removals[0].join(WAIT_S)
    for table in ("scene", "piece", "conflict", "change", "run"):
        rows = conn.execute(f"SELECT scene_id FROM conflictdb.{table} WHERE scene_id <> %s".encode(), [another])
        assert rows.fetchall() == [], table
    conn.commit()
    begin(conn, another)
    conn.commit()
    with conn.transaction():
        conn.execute("SET LOCAL ROLE conflictdb_editor")
        conn.execute("DELETE FROM conflictdb.scene")
    left = conn.execute("SELECT scene_id FROM conflictdb.scene_lock").fetchall()
    assert left == ([] if waits else [(scene_id,)]), "no lock stays but one that was held"
