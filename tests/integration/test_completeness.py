"""Lists of a scene that waits for detection say so, in every format and in Python, and can be waited for."""

import csv
import json
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from io import StringIO
from typing import Any

import psycopg
import pytest
from commands import STRAIT, Run, runner

import conflictdb
from conflictdb.db import store
from conflictdb.errors import IncompleteWarning, InvalidInput, NotCurrent, StoreError

FORMATS = ("table", "json", "csv", "geojson")
# Over the ferry's way, so that it has conflicts which nobody has computed yet.
PUT = "SELECT conflictdb.put_area('strait', 'NEW', ST_Envelope(path)) FROM conflictdb.track WHERE key = 'FERRY'"
DOES_IT = "(`conflictdb detect --scene strait` does it)"


@pytest.fixture
def run(dsn: str, capsys: pytest.CaptureFixture[str]) -> Run:
    return runner(dsn, capsys)


@pytest.fixture
def change(dsn: str) -> Callable[[str], None]:
    def change(statement: str) -> None:
        with psycopg.connect(dsn) as conn:
            conn.execute(statement.encode())

    return change


@pytest.mark.parametrize("command", ["conflicts", "approaches"])
def test_a_scene_that_was_never_detected_is_not_an_empty_one(run: Run, command: str) -> None:
    run("load", STRAIT)
    for form in FORMATS:
        done = run(command, "--scene", "strait", "--format", form)
        assert done.code == 0
        wanted = f"conflictdb: strait: not complete: never detected: 11 objects wait for detection {DOES_IT}\n"
        assert done.err == wanted
    assert run(command, "--scene", "strait", "--format", "json").out == "[]\n"
    assert run(command, "--scene", "strait").out in ("no conflict is known\n", "no closest approach is known\n")
    document = json.loads(run(command, "--scene", "strait", "--format", "geojson").out)
    assert document["features"] == []
    assert document["scenes"] == [
        {"scene": "strait", "is_current": False, "objects": 11, "pending": 11, "last_run_at": None, "last_error": None}
    ]


@pytest.mark.parametrize("command", ["conflicts", "approaches"])
def test_rows_beside_a_change_say_that_they_may_not_be_all(
    run: Run, change: Callable[[str], None], command: str
) -> None:
    run("detect", STRAIT)
    change(PUT)
    rows = json.loads(run(command, "--scene", "strait", "--format", "json").out)
    assert len(rows) == 7
    assert {(row["is_current"], row["scene_is_current"]) for row in rows} == {(True, False)}
    table = list(csv.DictReader(StringIO(run(command, "--scene", "strait", "--format", "csv").out)))
    assert {row["scene_is_current"] for row in table} == {"false"}
    for form in FORMATS:
        done = run(command, "--scene", "strait", "--format", form)
        assert done.err == f"conflictdb: strait: not complete: 1 object waits for detection {DOES_IT}\n"
    document = json.loads(run(command, "--scene", "strait", "--format", "geojson").out)
    assert (document["scenes"][0]["is_current"], document["scenes"][0]["pending"]) == (False, 1)
    assert json.loads(run("status", "--format", "json").out)["scenes"][0]["is_current"] is False

    assert run("detect", "--scene", "strait").err == ""
    done = run(command, "--scene", "strait", "--format", "json")
    assert done.err == ""
    assert {row["scene_is_current"] for row in json.loads(done.out)} == {True}
    assert len(json.loads(done.out)) > 7
    assert json.loads(run("status", "--format", "json").out)["scenes"][0]["is_current"] is True


def test_a_detection_that_failed_is_remarked(run: Run, dsn: str) -> None:
    run("detect", STRAIT)
    with store.connect(dsn) as conn:
        record = store.RunRecord("exact", {}, datetime.now(UTC))
        store.record_failure(conn, store.scene_id(conn, "strait"), record, "ValueError: no")
    assert run("conflicts", "--scene", "strait").err == (
        "conflictdb: strait: the last detection failed: ValueError: no\n"
    )


def test_waiting_for_a_worker(run: Run, dsn: str) -> None:
    run("load", STRAIT)
    done = run("conflicts", "--scene", "strait", "--wait", "200ms", "--format", "json")
    assert (done.code, done.out) == (1, "")
    assert "is not current after" in done.err
    assert "never detected: 11 objects wait for detection" in done.err
    assert "worker" in done.err

    def work() -> None:
        with conflictdb.connect(dsn) as db:
            db.detect("strait")

    with ThreadPoolExecutor(1) as pool:
        working = pool.submit(work)
        done = run("conflicts", "--scene", "strait", "--wait", "1m", "--format", "json")
        working.result(60)
    assert (done.code, done.err, len(json.loads(done.out))) == (0, "", 7)
    assert run("approaches", "--scene", "strait", "--wait", "1s").code == 0
    assert run("conflicts", "--scene", "strait", "--wait", "soon").code == 2


def test_python_knows_whether_a_list_is_complete(dsn: str, change: Callable[[str], None]) -> None:
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        for call in (db.conflicts, db.approaches):
            with pytest.warns(IncompleteWarning, match="scene 'strait': never detected: 11 objects wait") as told:
                found: Any = call("strait")
            assert told[0].filename == __file__
            assert (found, found.is_current, found.state.pending) == ([], False, 11)
        with pytest.raises(NotCurrent, match="is not current after"):
            db.wait_until_current("strait", timeout_s=0.1)
        db.detect("strait")
        db.wait_until_current("strait", timeout_s=0.1)
        found = db.conflicts("strait")
        assert (len(found), found.is_current, found.state.remark) == (7, True, None)
        change(PUT)
        with pytest.warns(IncompleteWarning, match="1 object waits"):
            found = db.conflicts("strait")
        assert (len(found), found.is_current, found[0].is_current, found[0].scene_is_current) == (7, False, True, False)
        with pytest.raises(InvalidInput, match="'nowhere'"):
            db.wait_until_current("nowhere")


def test_python_does_not_wait_where_it_cannot_see_anything(dsn: str) -> None:
    with psycopg.connect(dsn) as connection, conflictdb.connect(connection) as db:
        db.load(STRAIT)
        connection.commit()
        connection.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        with pytest.raises(StoreError, match="REPEATABLE READ"):
            db.wait_until_current("strait")


def test_a_list_is_never_called_complete_that_a_detection_overtook(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The state is read first: what is detected between the two makes the list better than is said of it."""
    order: list[str] = []
    for name in ("call", "call_each"):
        routine = getattr(store.reading, name)
        monkeypatch.setattr(
            store.reading, name, lambda conn, what, *more, r=routine: (order.append(what), r(conn, what, *more))[1]
        )
    with conflictdb.connect(dsn) as db, warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteWarning)
        db.load(STRAIT)
        db.conflicts("strait")
        db.approaches("strait")
    assert order == ["_scene_state", "_conflicts", "_scene_state", "_approaches"]
