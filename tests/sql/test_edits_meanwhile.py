"""Edits that are committed while a detection runs leave nothing out, also of branches and schedules."""

import threading
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import psycopg
import pytest
from patience import WAIT_S

from conflictdb import store
from conflictdb.jobs import detect

Conn = psycopg.Connection[Any]

DAILY = """
INSERT INTO conflictdb.area (scene_id, key, footprint, schedule)
SELECT scene_id, 'S', ST_SetSRID(ST_Multi(ST_MakeEnvelope(0, 50, 1, 51)), 4326), '[{"periods": [["08:00", "16:00"]]}]'
FROM conflictdb.scene WHERE name = 's'
"""
# Of two days, long after the horizon.
FAR = """
SELECT conflictdb.put_track(%s, 'V', conflictdb.track_path('SRID=4326;LINESTRING(-1 50.5, 2 50.5)',
    ARRAY[date_trunc('day', now()) + interval '400 days', date_trunc('day', now()) + interval '402 days']),
    conflictdb.rectangle_outline(9, 9, 5, 5))
"""


@pytest.fixture
def other(dsn: str) -> Iterator[Conn]:
    """Return another session, which edits."""
    with closing(psycopg.connect(dsn)) as session:
        yield session


def put(conn: Conn, scene: str, key: str, west: float) -> None:
    conn.execute(
        "SELECT conflictdb.put_area(%s, %s, ST_SetSRID(ST_Multi(ST_MakeEnvelope(%s, 50, %s, 51)), 4326))",
        [scene, key, west, west + 1],
    )
    conn.commit()


def conflicts(conn: Conn, scene: str) -> list[tuple[Any, ...]]:
    """Return the conflicts of a scene, detected until it is current."""
    query = "SELECT is_current FROM conflictdb.scenes WHERE scene = %s"
    turns = 0
    while conn.execute(query.encode(), [scene]).fetchone() != (True,):
        conn.commit()
        detect.detect(conn, scene, jobs=1)
        turns += 1
        assert turns < 5
    found = conn.execute("SELECT a_key, b_key FROM conflictdb.conflicts WHERE scene = %s", [scene]).fetchall()
    conn.commit()
    return found


def before_second_look(monkeypatch: pytest.MonkeyPatch, conn: Conn, edit: Any) -> None:
    """Edit after the parent was detected, before a session begins to detect the branch b."""
    begin = store.begin_detection

    def begin_detection(c: Conn, scene: str, *rest: Any) -> store.Begun:
        if c is conn and scene == "b" and rest[-1] is None:
            edit()
        return begin(c, scene, *rest)

    monkeypatch.setattr(store, "begin_detection", begin_detection)


def test_a_branch_is_edited_while_a_worker_detects_its_parent(
    conn: Conn, other: Conn, dsn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That worker marks the objects of the branch that it sees: not those that came after its snapshot."""
    conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.create_branch('s', 'b')")
    put(conn, "b", "W", 90)
    detect.detect(conn, "b", jobs=1)
    put(conn, "s", "Y", 70)
    begun, go_on = threading.Event(), threading.Event()
    with closing(psycopg.connect(dsn)) as worker:
        end = store.end_write

        def end_write(c: Conn, *rest: Any) -> store.RunOutcome:
            if c is worker:
                begun.set()
                go_on.wait(WAIT_S)
            return end(c, *rest)

        monkeypatch.setattr(store, "end_write", end_write)
        working = threading.Thread(target=detect.detect, args=(worker, "s"), kwargs={"jobs": 1})

        def edit() -> None:
            put(other, "s", "P", 0.5)
            working.start()
            assert begun.wait(WAIT_S)
            put(other, "b", "X", 0)

        before_second_look(monkeypatch, conn, edit)
        detect.detect(conn, "b", jobs=1)
        go_on.set()
        working.join()
    assert conflicts(conn, "b") == [("P", "X")]


def test_a_far_voyage_enters_a_branch_while_its_parent_is_detected(
    conn: Conn, other: Conn, monkeypatch: pytest.MonkeyPatch
) -> None:
    conn.execute("SELECT conflictdb.create_scene('s', p_horizon_days => 30), conflictdb.create_branch('s', 'b')")
    conn.execute(DAILY.encode())
    put(conn, "b", "W", 90)
    detect.detect(conn, "b", jobs=1)
    put(conn, "s", "Y", 70)

    def edit() -> None:
        other.execute(FAR.encode(), ["b"])
        other.commit()

    before_second_look(monkeypatch, conn, edit)
    detect.detect(conn, "b", jobs=1)
    assert conflicts(conn, "b") == [("S", "V")]


def detect_while_a_far_voyage_comes(conn: Conn, other: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Detect scene s in two transactions; between them another session adds the far voyage and changes a setting."""
    begin = store.begin_locked

    def begin_locked(*arguments: Any) -> int:
        other.execute(FAR.encode(), ["s"])
        other.execute("SELECT conflictdb.create_scene('s', p_tolerance_m => 2)")
        other.commit()
        return begin(*arguments)

    monkeypatch.setattr(store, "begin_locked", begin_locked)
    detect.detect(conn, "s", jobs=1, few_objects=-1)
    monkeypatch.undo()


def test_a_far_voyage_and_settings_come_between_two_transactions(
    conn: Conn, other: Conn, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second transaction then takes all marks."""
    conn.execute("SELECT conflictdb.create_scene('s', p_horizon_days => 30)")
    conn.execute(DAILY.encode())
    put(conn, "s", "Y", 70)
    detect_while_a_far_voyage_comes(conn, other, monkeypatch)
    assert conflicts(conn, "s") == [("S", "V")]


def test_a_voyage_whose_delays_are_far_comes_between_two_transactions(
    conn: Conn, other: Conn, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ends before the schedules do, and its delays after that: the next detection expands them and stores these."""
    conn.execute("SELECT conflictdb.create_scene('s', p_horizon_days => 402, p_delays_within_s => 172800)")
    conn.execute(DAILY.encode())
    put(conn, "s", "Y", 70)
    detect_while_a_far_voyage_comes(conn, other, monkeypatch)
    detect.detect(conn, "s", jobs=1)
    query = "SELECT upper(expanded) >= date_trunc('day', now()) + interval '404 days' FROM conflictdb.scene"
    assert conn.execute(query).fetchone() == (True,)


@pytest.mark.parametrize("branch_first", [True, False])
@pytest.mark.parametrize("isolation", [psycopg.IsolationLevel.READ_COMMITTED, psycopg.IsolationLevel.REPEATABLE_READ])
@pytest.mark.parametrize(
    "change",
    [
        "SELECT conflictdb.create_scene('s', p_separation_m => 5000)",
        "SELECT conflictdb.put_rule('s', 'area', 'area', 5000)",
    ],
)
def test_a_branch_is_made_while_its_parent_changes(
    conn: Conn, other: Conn, change: str, isolation: psycopg.IsolationLevel, branch_first: bool
) -> None:
    """It has the new settings and rules, or one of the two sessions fails."""
    conn.execute("SELECT conflictdb.create_scene('s')")
    put(conn, "s", "A", 0)
    other.isolation_level = isolation
    other.execute("SELECT")  # its snapshot
    statements = ["SELECT conflictdb.create_branch('s', 'b')", change]
    first, second = statements if branch_first else reversed(statements)
    conn.execute(first.encode())
    failed: list[psycopg.Error] = []

    def edit() -> None:
        try:
            other.execute(second.encode())
            other.commit()
        except psycopg.errors.SerializationFailure as error:
            failed.append(error)
            other.rollback()

    editing = threading.Thread(target=edit)
    editing.start()
    editing.join(0.5)
    conn.commit()
    editing.join()
    if failed:
        assert isolation == psycopg.IsolationLevel.REPEATABLE_READ
        conn.execute(second.encode())
    put(conn, "b", "C", 1.01)
    assert conflicts(conn, "b") == [("A", "C")]


def test_a_branch_that_is_inserted_has_the_rules_of_its_parent(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.put_rule('s', 'area', 'area', 5000)")
    put(conn, "s", "A", 0)
    conn.execute("SET ROLE conflictdb_editor")
    conn.execute("INSERT INTO conflictdb.scene (name, parent_scene_id) SELECT 'b', scene_id FROM conflictdb.scene")
    put(conn, "b", "C", 1.01)
    conn.execute("RESET ROLE")
    assert conflicts(conn, "b") == [("A", "C")]


@pytest.mark.parametrize("role", ["origin", "replica"])
def test_a_restore_may_bring_a_branch_before_its_parent(conn: Conn, role: str) -> None:
    """The parent's row lies after that of the branch, once it was updated."""
    conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.create_branch('s', 'b')")
    conn.execute("UPDATE conflictdb.scene SET name = 't' WHERE name = 's'")
    with conn.cursor().copy("COPY (SELECT * FROM conflictdb.scene ORDER BY name) TO STDOUT") as copy:
        rows = b"".join(bytes(block) for block in copy)
    assert rows.index(b"\tb\t") < rows.index(b"\tt\t")
    conn.execute("DELETE FROM conflictdb.scene")
    conn.execute(f"SET LOCAL session_replication_role = {role}".encode())
    with conn.cursor().copy("COPY conflictdb.scene FROM STDIN") as copy:
        copy.write(rows)
    assert conn.execute("SELECT scene, branch_of FROM conflictdb.scenes ORDER BY 1").fetchall() == [
        ("b", "t"),
        ("t", None),
    ]
    conn.rollback()


@pytest.mark.parametrize(
    "edit",
    ["SELECT conflictdb.rename_scene('b', 'c')", "UPDATE conflictdb.scene SET history_kept = '1 day' WHERE name = 'b'"],
)
def test_a_branch_is_renamed_while_its_parent_is_detected(
    conn: Conn, other: Conn, monkeypatch: pytest.MonkeyPatch, edit: str
) -> None:
    """Its row has changed since the snapshot, but it is still a branch."""
    conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.create_branch('s', 'b')")
    put(conn, "b", "X", 0)
    put(conn, "s", "Y", 70)
    detect.detect(conn, "b", jobs=1)
    put(conn, "s", "P", 0.5)
    end = store.end_write

    def end_write(*arguments: Any) -> store.RunOutcome:
        other.execute(edit.encode())
        other.commit()
        return end(*arguments)

    monkeypatch.setattr(store, "end_write", end_write)
    detect.detect(conn, "s", jobs=1)
    monkeypatch.undo()
    (name,) = conn.execute("SELECT scene FROM conflictdb.scenes WHERE branch_of = 's'").fetchone() or (None,)
    conn.commit()
    assert conflicts(conn, str(name)) == [("P", "X")]


@pytest.mark.parametrize("branch_first", [True, False])
def test_a_branch_and_its_parent_get_one_key_at_once(conn: Conn, other: Conn, branch_first: bool) -> None:
    """The branch does not keep a conflict with the parent's object, which it no longer reads."""
    conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.create_branch('s', 'b')")
    put(conn, "b", "X", 0)
    conflicts(conn, "b")
    statement = b"SELECT conflictdb.put_area(%s, 'K', ST_SetSRID(ST_Multi(ST_MakeEnvelope(%s, 50, %s, 51)), 4326))"
    edits: list[list[Any]] = [["b", 20, 21], ["s", 0.5, 1.5]]
    first, second = edits if branch_first else reversed(edits)
    other.execute(statement, first)

    def edit() -> None:
        conn.execute(statement, second)
        conn.commit()
        detect.detect(conn, "b", jobs=1)

    editing = threading.Thread(target=edit)
    editing.start()
    editing.join(0.5)
    other.commit()
    editing.join()
    assert conflicts(conn, "b") == []
