"""Lists of a scene that waits for detection say so, in every format and in Python, and can be waited for."""

import csv
import json
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from io import StringIO
from pathlib import Path
from typing import Any

import psycopg
import pytest
from commands import STRAIT, Run
from patience import WAIT_S

import conflictdb
from conflictdb import store
from conflictdb.errors import IncompleteWarning, InvalidInput, NotCurrent, StoreError

FORMATS = ("table", "json", "csv", "geojson")
# Over the ferry's way, so that it has conflicts which are not computed yet.
PUT = "SELECT conflictdb.put_area('strait', 'NEW', ST_Envelope(path)) FROM conflictdb.track WHERE key = 'FERRY'"
DOES_IT = "(`conflictdb detect --scene strait` does it)"


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
        assert done.code == 7  # an uncomputed list is not an empty list
        wanted = f"conflictdb: strait: not complete: never detected: 11 objects wait for detection {DOES_IT}\n"
        assert done.err == wanted
    assert run(command, "--scene", "strait", "--format", "json").out == "[]\n"
    assert run(command, "--scene", "strait").out in ("no conflict is known\n", "no closest approach is known\n")
    document = json.loads(run(command, "--scene", "strait", "--format", "geojson").out)
    assert document["features"] == []
    assert document["scenes"] == [
        {
            "scene": "strait",
            "is_current": False,
            "objects": 11,
            "pending": 11,
            "last_run_at": None,
            "last_error": None,
            "detected_at": None,
            "compared_at": None,
        }
    ]
    run("detect", "--scene", "strait")
    for form in FORMATS:
        assert run(command, "--scene", "strait", "--format", form).code == 0


@pytest.mark.parametrize(
    "command",
    [
        ["conflicts"],
        ["approaches"],
        ["explain", "FERRY", "DIVING"],
        ["plot", "plot.svg"],
        ["report", "report.html"],
        ["probe", "--footprint", "POLYGON((9 57, 10 57, 10 58, 9 57))"],
    ],
    ids=lambda words: words[0],
)
def test_only_a_current_scene_will_do_if_asked(
    run: Run,
    change: Callable[[str], None],
    command: list[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """Never detected, changed since, current."""
    monkeypatch.chdir(tmp_path)
    run("load", STRAIT)
    for prepare, said in (
        (lambda: None, "never detected: 11 objects wait for detection"),
        (lambda: (run("detect", "--scene", "strait"), change(PUT)), "1 object waits for detection"),
    ):
        prepare()
        done = run(*command, "--scene", "strait", "--require-current")
        assert (done.code, done.out, done.err) == (7, "", f"conflictdb: strait: not complete: {said} {DOES_IT}\n")
        assert list(tmp_path.iterdir()) == []
    run("detect", "--scene", "strait")
    assert run(*command, "--scene", "strait", "--require-current").code == 0
    assert run("conflicts", "--scene", "strait", "--known-at", "2026-01-01T00:00Z", "--require-current").code == 2


def test_what_was_known_before_the_first_detection_is_not_nothing(run: Run, dsn: str) -> None:
    run("load", STRAIT)
    known_at = ("conflicts", "--scene", "strait", "--format", "json", "--known-at")
    done = run(*known_at, "2026-01-01T00:00Z")
    assert (done.code, done.out) == (4, "")
    assert "scene 'strait': instant: asks for conflicts of a scene that was never detected" in done.err
    run("detect", "--scene", "strait")
    done = run(*known_at, "2026-01-01T00:00Z")
    assert (done.code, done.out) == (4, "")
    assert "is before the first detection of the scene, which ended at" in done.err
    with conflictdb.connect(dsn) as db:
        ended = db.scene("strait").state().detected_at
        assert ended is not None
        assert len(db.scene("strait").conflicts_known_at(ended)) == 7
        with pytest.raises(InvalidInput, match="is before the first detection"):
            db.scene("strait").conflicts_known_at(ended - timedelta(microseconds=1))


def test_attached_changes_that_wait_are_pending(run: Run, dsn: str, change: Callable[[str], None]) -> None:
    """They count before a worker takes them over."""
    run("detect", STRAIT)
    change("CREATE TABLE op (id integer PRIMARY KEY, shape geometry(Polygon, 4326))")
    change("INSERT INTO op SELECT n, ST_MakeEnvelope(n, 0, n + 0.5, 1, 4326) FROM generate_series(1, 3) n")
    assert (
        run("admin", "attach", "area", "--scene", "strait", "--table", "op", "--map", "key=id,footprint=shape").code
        == 0
    )
    run("detect", "--scene", "strait")
    with conflictdb.connect(dsn) as db:
        assert db.scene("strait").state().pending == 0
        change("UPDATE op SET shape = ST_Translate(shape, 0, 1) WHERE id < 3")
        state = db.scene("strait").state()
        assert (state.pending, state.is_current, [one.pending for one in db.scenes()]) == (2, False, [2])
        db.scene("strait").follow()
        assert db.scene("strait").state().pending == 2
        db.scene("strait").detect()
        assert db.scene("strait").state().pending == 0


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
    assert (done.code, done.out) == (7, "")
    assert "is not current after" in done.err
    assert "never detected: 11 objects wait for detection" in done.err
    assert "worker" in done.err

    def work() -> None:
        with conflictdb.connect(dsn) as db:
            db.scene("strait").detect()

    with ThreadPoolExecutor(1) as pool:
        working = pool.submit(work)
        done = run("conflicts", "--scene", "strait", "--wait", f"{WAIT_S:g}s", "--format", "json")
        working.result(WAIT_S)
    assert (done.code, done.err, len(json.loads(done.out))) == (0, "", 7)
    assert run("approaches", "--scene", "strait", "--wait", "1s").code == 0
    assert run("conflicts", "--scene", "strait", "--wait", "soon").code == 2


def test_python_knows_whether_a_list_is_complete(dsn: str, change: Callable[[str], None]) -> None:
    with conflictdb.connect(dsn) as db:
        scene = db.load(STRAIT)
        for call in (scene.conflicts, scene.approaches):
            with pytest.warns(IncompleteWarning, match="scene 'strait': never detected: 11 objects wait") as warned:
                found: Any = call()
            assert warned[0].filename == __file__
            assert (found, found.is_current, found.state.pending) == ([], False, 11)
        with pytest.raises(NotCurrent, match="is not current after"):
            db.scene("strait").wait_until_current(timeout_s=0.1)
        db.scene("strait").detect()
        db.scene("strait").wait_until_current(timeout_s=0.1)
        found = db.scene("strait").conflicts()
        assert (len(found), found.is_current, found.state.remark) == (7, True, None)
        change(PUT)
        with pytest.warns(IncompleteWarning, match="1 object waits"):
            found = db.scene("strait").conflicts()
        assert (len(found), found.is_current, found[0].is_current, found[0].scene_is_current) == (7, False, True, False)
        with pytest.raises(InvalidInput, match="'nowhere'"):
            db.scene("nowhere").wait_until_current()


def test_python_does_not_wait_where_it_cannot_see_anything(dsn: str) -> None:
    with psycopg.connect(dsn) as connection, conflictdb.connect(connection) as db:
        db.load(STRAIT)
        connection.commit()
        connection.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        with pytest.raises(StoreError, match="REPEATABLE READ"):
            db.scene("strait").wait_until_current()


def test_a_list_is_never_called_complete_that_a_detection_overtook(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The state is read first: a detection between the two reads makes the list better than its state."""
    order: list[str] = []
    for name in ("call_by_name", "call_each_by_name"):
        routine = getattr(store.listing, name)
        monkeypatch.setattr(
            store.listing, name, lambda conn, what, *more, r=routine: (order.append(what), r(conn, what, *more))[1]
        )
    with conflictdb.connect(dsn) as db, warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteWarning)
        db.load(STRAIT)
        db.scene("strait").conflicts()
        db.scene("strait").approaches()
    assert order == ["_scene_state", "_conflicts", "_scene_state", "_approaches"]
