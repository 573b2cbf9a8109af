"""The database on its own completeness: whether a scene's list is complete, and waiting until it is."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import psycopg
import pytest
import shapely
from patience import WAIT_S
from piecework import load

from conflictdb import store
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Motion, Scene

Conn = psycopg.Connection[Any]


def square(key: str, west: float) -> Area:
    return Area(key, shapely.MultiPolygon([shapely.box(west, 50, west + 1, 51)]))


AREAS = [square("A", 0.0), square("B", 0.5)]
PUT = "SELECT conflictdb.put_area('s', 'C', ST_MakeEnvelope(0.2, 50, 0.7, 51, 4326))"


def state(conn: Conn) -> tuple[Any, ...]:
    row = conn.execute("SELECT objects, pending, last_error, is_current FROM conflictdb.scenes WHERE scene = 's'")
    return row.fetchall()[0]


@pytest.fixture
def warned(conn: Conn) -> list[str]:
    """Return a list that collects the notices of the session."""
    messages: list[str] = []
    conn.add_notice_handler(lambda diagnostic: messages.append(str(diagnostic.message_primary)))
    return messages


def test_a_scene_is_current_when_all_that_it_holds_was_detected(conn: Conn) -> None:
    load(conn, Scene("s"), AREAS, [])
    assert state(conn) == (2, 2, None, False)
    detect_now(conn)
    assert state(conn) == (2, 0, None, True)
    for change in (
        PUT,
        "SELECT conflictdb.remove_object('s', 'C')",
        "UPDATE conflictdb.area SET floor_m = 5 WHERE key = 'A'",
        "SELECT conflictdb.create_scene('s', p_separation_m => 10)",
        "SELECT conflictdb.create_scene('s', p_method => 'screen')",
        "UPDATE conflictdb.scene SET tolerance_m = 3",
        "SELECT conflictdb.request_detection('s', true)",
    ):
        conn.execute(change.encode())
        conn.commit()
        assert state(conn)[1] > 0
        assert not state(conn)[3], change
        detect_now(conn)
        assert state(conn)[3], change
    conn.execute("UPDATE conflictdb.area SET name = 'no matter'")
    assert state(conn)[3]


def detect_now(conn: Conn) -> None:
    conn.commit()
    detect(conn, "s", jobs=1)


def test_a_scene_without_objects_is_current_and_one_never_detected_is_not(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    assert state(conn) == (0, 0, None, True)
    conn.execute(PUT)
    conn.execute("DELETE FROM conflictdb.change")  # however that came to be
    assert state(conn) == (1, 0, None, False)


def test_a_detection_that_failed_is_told_and_its_changes_still_wait(conn: Conn) -> None:
    number = load(conn, Scene("s"), AREAS, [])
    detect(conn, "s", jobs=1)
    conn.execute(PUT)
    conn.commit()
    record = store.RunRecord("exact", {}, conn.execute("SELECT now()").fetchall()[0][0])
    store.record_failure(conn, number, record, "ValueError: no")
    assert state(conn) == (3, 1, "ValueError: no", False)
    remark = "SELECT remark FROM conflictdb_internal._scene_state('s')"
    assert conn.execute(remark).fetchall() == [
        ("1 object waits for detection; the last detection failed: ValueError: no",)
    ]
    detect_now(conn)
    assert state(conn) == (3, 0, None, True)
    store.record_failure(conn, number, record, "ValueError: no")
    assert state(conn) == (3, 0, "ValueError: no", True)
    assert conn.execute(remark).fetchall() == [("the last detection failed: ValueError: no",)]


def test_every_row_says_whether_it_is_part_of_a_complete_list(conn: Conn) -> None:
    load(conn, Scene("s", nearest_m=1e5), [*AREAS, square("FAR", 1.6)], [])
    load(conn, Scene("other"), AREAS, [])
    detect(conn, "other", jobs=1)
    detect_now(conn)
    conn.execute(PUT)
    for view, rows in (("conflicts", 1), ("approaches", 3)):
        found = conn.execute(f"SELECT scene, is_current, scene_is_current FROM conflictdb.{view}".encode()).fetchall()
        assert found.count(("s", True, False)) == rows
        assert found.count(("other", True, True)) == len(found) - rows


QUESTIONS = (
    "conflicts_at('s', '2026-03-01')",
    "conflicts_of('s', 'A')",
    "approaches_of('s', 'A')",
    "conflicts_within('s', ST_MakeEnvelope(0, 50, 1, 51, 4326), '(,)')",
    "probe('s', ST_MakeEnvelope(0, 50, 1, 51, 4326))",
    "candidates('s')",
    "probe('s', ST_MakeEnvelope(80, 50, 81, 51, 4326))",
)


@pytest.mark.parametrize("motion", list(Motion))
def test_an_answer_that_may_not_be_complete_has_one_warning(conn: Conn, warned: list[str], motion: Motion) -> None:
    """Also for an empty answer, and for any query."""

    def ask() -> set[str]:
        heard = set()
        for question in QUESTIONS:
            for columns in ("*", "count(*)"):
                warned.clear()
                conn.execute(f"SELECT {columns} FROM conflictdb.{question}".encode())
                assert len(warned) <= 1
                heard.add("".join(warned))
        return heard

    load(conn, Scene("s", motion), AREAS, [])
    may_not = "the answer may not be complete"
    assert ask() == {f"scene 's': never detected: 2 objects wait for detection: {may_not}"}
    detect_now(conn)
    assert ask() == {""}
    conn.execute(PUT)
    assert ask() == {f"scene 's': 1 object waits for detection: {may_not}"}
    for question in QUESTIONS:
        with pytest.raises(psycopg.Error, match="is not in this database"), conn.transaction():
            conn.execute(f"SELECT * FROM conflictdb.{question}".replace("'s'", "'nowhere'").encode())


@pytest.fixture
def waiting(conn: Conn, dsn: str) -> Iterator[Any]:
    """Return a function that waits for the scene in a session of its own, and returns its result."""
    with ThreadPoolExecutor(1) as pool:

        def wait(timeout: str, before: str = "SELECT 1") -> Any:
            def call() -> str | None:
                with psycopg.connect(dsn) as session:
                    session.execute(before.encode())
                    try:
                        session.execute("SELECT conflictdb.wait_until_current('s', %s)", [timeout])
                    except psycopg.Error as error:
                        return f"{error.sqlstate} {error.diag.message_primary}"
                    return None

            return pool.submit(call)

        yield wait


def test_waiting_ends_when_the_scene_is_current(conn: Conn, waiting: Any) -> None:
    load(conn, Scene("s"), AREAS, [])
    waits = waiting(f"{WAIT_S:g} s")
    with pytest.raises(TimeoutError):
        waits.result(0.3)
    detect(conn, "s", jobs=1)
    assert waits.result(WAIT_S) is None
    assert waiting("0 s").result(WAIT_S) is None


def test_waiting_that_takes_too_long_says_what_waits(conn: Conn, waiting: Any) -> None:
    load(conn, Scene("s"), AREAS, [])
    outcome = (
        "ZC014 scene 's': is_current: is not current after 00:00:00.2: never detected: 2 objects wait for detection"
    )
    assert waiting("0.2 s").result(WAIT_S) == outcome


def test_waiting_for_a_scene_that_is_removed_ends(conn: Conn, waiting: Any) -> None:
    load(conn, Scene("s"), AREAS, [])
    waits = waiting(f"{WAIT_S:g} s")
    with pytest.raises(TimeoutError):
        waits.result(0.3)
    conn.execute("DELETE FROM conflictdb.scene")
    conn.commit()
    assert waits.result(WAIT_S).startswith("ZC010 scene 's': name: is not in this database")


@pytest.mark.parametrize("level", ["REPEATABLE READ", "SERIALIZABLE"])
def test_waiting_where_nothing_can_be_seen_is_refused(conn: Conn, waiting: Any, level: str) -> None:
    load(conn, Scene("s"), AREAS, [])
    begin = f"SET TRANSACTION ISOLATION LEVEL {level}"
    outcome = (
        f"ZC013 scene 's': transaction: is {level}: it sees one state of the database until it ends, and would wait"
    )
    assert waiting(f"{WAIT_S:g} s", begin).result(WAIT_S).startswith(outcome)
    detect(conn, "s", jobs=1)
    assert waiting(f"{WAIT_S:g} s", begin).result(WAIT_S) is None


def test_waiting_for_changes_that_are_not_committed_is_refused(conn: Conn, waiting: Any) -> None:
    load(conn, Scene("s"), AREAS, [])
    detect(conn, "s", jobs=1)
    assert (
        waiting(f"{WAIT_S:g} s", PUT)
        .result(WAIT_S)
        .startswith("ZC013 scene 's': transaction: has changed the scene itself")
    )
