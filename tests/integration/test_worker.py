"""A worker keeps scenes current, survives a scene that fails and a lost connection, and stops on a signal."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any

import psycopg
import pytest
from commands import STRAIT, runner
from patience import WAIT_S, killed_after, patient_command, until
from psycopg.conninfo import conninfo_to_dict

from conflictdb import connect, store
from conflictdb.errors import LockTimeout, StoreError
from conflictdb.jobs import detect
from conflictdb.jobs.worker import Worker, _pauses
from conflictdb.model.plans import Scene


def load(dsn: str, scene: str) -> None:
    with connect(dsn) as db:
        db.load(STRAIT, scene)


def pending(dsn: str) -> dict[str, int]:
    with connect(dsn) as db:
        return {status.scene.name: status.pending for status in db.scenes()}


@contextmanager
def program(dsn: str, *words: str) -> Iterator["subprocess.Popen[str]"]:
    worker = subprocess.Popen(
        patient_command("--dsn", dsn, "worker", *words),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield worker
    finally:
        worker.kill()
        worker.communicate()


def test_once_detects_what_is_pending_and_nothing_else(dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    run = runner(dsn, capsys)
    assert (run("worker", "--once").code, run("worker", "--once").out) == (0, "")
    load(dsn, "one")
    load(dsn, "two")
    lines = run("worker", "--once", "--jobs", "1").out.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["one", "two"]
    assert all(": 7 conflicts, 7 new " in line for line in lines)
    assert run("worker", "--once").out == ""
    assert pending(dsn) == {"one": 0, "two": 0}


def test_once_and_every_exclude_each_other(dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert runner(dsn, capsys)("worker", "--once", "--every", "5s").code == 2


def test_one_scene_that_fails_does_not_stop_the_others(
    dsn: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    load(dsn, "bad")
    load(dsn, "good")
    whole = detect.detect_pending

    def sometimes(conn: Any, scene: str, **options: Any) -> detect.Run | None:
        if scene == "bad":
            conn.execute("SELECT 1")
            raise ValueError("no luck")
        return whole(conn, scene, **options)

    monkeypatch.setattr("conflictdb.jobs.detect.detect_pending", sometimes)
    done = runner(dsn, capsys)("worker", "--once")
    assert (done.code, done.err) == (1, "conflictdb: bad: failed: no luck\n")
    assert done.out.startswith("good: 7 conflicts")
    assert pending(dsn) == {"bad": 11, "good": 0}


def test_a_log_for_programs_is_a_json_object_a_line(
    dsn: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a scene fails, whatever it is called."""
    load(dsn, "bad \N{RIGHT-TO-LEFT OVERRIDE}\n")
    load(dsn, "good")
    whole = detect.detect_pending

    def sometimes(conn: Any, scene: str, **options: Any) -> detect.Run | None:
        if scene != "good":
            raise ValueError("no luck")
        return whole(conn, scene, **options)

    monkeypatch.setattr("conflictdb.jobs.detect.detect_pending", sometimes)
    done = runner(dsn, capsys)("worker", "--once", "--log", "json")
    assert (done.code, done.err, "\N{RIGHT-TO-LEFT OVERRIDE}" in done.out) == (1, "", False)
    failed, good = map(json.loads, done.out.splitlines())
    assert (failed["event"], failed["scene"], failed["error"]) == (
        "failed",
        "bad \N{RIGHT-TO-LEFT OVERRIDE}\n",
        "no luck",
    )
    assert (good["event"], good["scene"], good["conflicts"], good["opened"]) == ("run", "good", 7, 7)
    assert good["at"].endswith("Z")


def test_a_scene_that_failed_is_tried_again_soon(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a pause that grows, and then it is as if nothing had been; others do not wait for it."""
    load(dsn, "bad")
    load(dsn, "good")
    whole = detect.detect_pending
    failures: list[str] = []

    def sometimes(conn: Any, scene: str, **options: Any) -> detect.Run | None:
        if scene == "bad" and len(failures) < 3:
            failures.append(scene)
            raise StoreError("deadlock detected")
        return whole(conn, scene, **options)

    reports: list[tuple[str, object]] = []

    def report(scene: str, outcome: object, waited_s: float) -> None:
        reports.append((scene, outcome))
        if scene == "bad" and isinstance(outcome, detect.Run):
            raise KeyboardInterrupt

    monkeypatch.setattr("conflictdb.jobs.detect.detect_pending", sometimes)
    with pytest.raises(KeyboardInterrupt):
        Worker(lambda: store.connect(dsn), report, every_s=600.0, jobs=1, retry_s=0.02).run()
    assert [scene for scene, _ in reports] == ["bad", "good", "bad", "bad", "bad"]
    assert pending(dsn) == {"bad": 0, "good": 0}


def test_pauses_grow_to_a_limit_and_are_random() -> None:
    pauses = list(islice(_pauses(1.0, 60.0), 12))
    assert all(0.5 * most <= pause <= most for pause, most in zip(pauses, [1, 2, 4, 8, 16, 32, *[60] * 6], strict=True))
    assert len(set(pauses)) == 12


# Blocks for ever in compiled code, where no signal is heard, as in a network that does not answer.
DEAF = """
import ctypes, sys
from conflictdb.cli import main, worker_commands
def status(args):
    lock = ctypes.create_string_buffer(64)
    libc = ctypes.CDLL(None)
    libc.pthread_mutex_lock(lock)
    print("deaf", flush=True)
    libc.pthread_mutex_lock(lock)
worker_commands.status = status
sys.exit(main(["status"]))
"""


def test_sigterm_ends_what_does_not_hear_it() -> None:
    with subprocess.Popen([sys.executable, "-c", DEAF], stdout=subprocess.PIPE, text=True) as deaf:
        assert deaf.stdout is not None
        with killed_after(deaf, WAIT_S):
            assert deaf.stdout.readline() == "deaf\n"
        deaf.send_signal(signal.SIGTERM)
        assert deaf.wait(WAIT_S) == 143


@pytest.fixture
def heeded_interrupt() -> Iterator[None]:
    """Have programs started here heed SIGINT, also where the tests run in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeded_interrupt")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_change_wakes_the_worker_and_a_signal_ends_it(dsn: str, number: signal.Signals) -> None:
    with program(dsn, "--every", "1h") as worker:
        with connect(dsn) as db:
            until(lambda: db.status().worker_count == 1)
            load(dsn, "strait")
            until(lambda: pending(dsn) == {"strait": 0})
            with db.connection.transaction():
                db.connection.execute("UPDATE conflictdb.area SET ceiling_m = 9 WHERE key = 'DIVING'")
            until(lambda: pending(dsn) == {"strait": 0} and len(db.scene("strait").conflicts()) == 7)
        worker.send_signal(number)
        out, err = worker.communicate(timeout=WAIT_S)
        assert (worker.returncode, err) == (0, "")
        assert out.startswith("strait: 7 conflicts, 7 new (run ")


def test_a_signal_during_a_detection_leaves_everything_as_it_was(dsn: str) -> None:
    load(dsn, "strait")
    with psycopg.connect(dsn) as blocker, program(dsn) as worker:
        # The detection waits for this lock, as it would for a long computation.
        blocker.execute("LOCK conflictdb.piece")
        with connect(dsn) as db:
            until(lambda: db.status().worker_count == 1)
            until(lambda: is_waiting(dsn))
        worker.send_signal(signal.SIGTERM)
        worker.communicate(timeout=WAIT_S)
        assert worker.returncode == 0
    assert pending(dsn) == {"strait": 11}


def is_waiting(dsn: str) -> bool:
    with psycopg.connect(dsn) as conn:
        (waiting,) = conn.execute(
            "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND wait_event_type = 'Lock'"
        ).fetchone() or (0,)
    return bool(waiting)


def test_a_lost_connection_is_made_again(dsn: str) -> None:
    attempts: list[int] = []
    detected: list[str] = []

    def connection() -> psycopg.Connection[Any]:
        attempts.append(len(attempts))
        if attempts[-1] == 1:
            raise StoreError("still starting up")
        return store.connect(store.worker_dsn(dsn))

    def report(scene: str, outcome: object, waited_s: float) -> None:
        assert isinstance(outcome, detect.Run)
        detected.append(scene)
        if scene == "second":
            raise KeyboardInterrupt  # as a signal would

    def work() -> None:
        with suppress(KeyboardInterrupt):
            Worker(connection, report, every_s=600.0, jobs=1, retry_s=0.01).run()

    load(dsn, "first")
    thread = threading.Thread(target=work)
    thread.start()
    until(lambda: detected == ["first"])
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
            "WHERE datname = current_database() AND application_name = %s",
            (store.WORKER_NAME,),
        )
    load(dsn, "second")
    thread.join(WAIT_S)
    assert (detected, len(attempts)) == (["first", "second"], 3)


def test_an_error_that_is_no_lost_connection_is_none(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A row that cannot be read, say: the worker says so, goes on on the same connection, and comes to all else."""
    load(dsn, "one")
    look, failures = store.waiting_scenes, iter([1, 1])
    said: list[str] = []

    def fails(conn: Any) -> dict[str, float]:
        if next(failures, None):
            conn.execute("SELECT 1 / 0")
        return look(conn)

    monkeypatch.setattr(store, "waiting_scenes", fails)
    done = threading.Event()

    def report(scene: str, outcome: Any, waited_s: float) -> None:
        done.set()
        raise KeyboardInterrupt

    worker = Worker(lambda: store.connect(dsn), report, say=said.append)
    with pytest.raises(KeyboardInterrupt):
        worker.run()
    assert done.is_set()
    assert worker.state.connections == 1
    assert [line for line in said if "lost" in line] == []
    assert len([line for line in said if "cannot look for changes, trying again: division by zero" in line]) == 2


def test_a_worker_refuses_another_schema(empty_dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert runner(empty_dsn, capsys)("worker").code == 3


def test_several_workers_do_the_work_once(dsn: str, tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        load(dsn, name)
    environ = {**os.environ, "CONFLICTDB_DSN": dsn}
    workers = [
        subprocess.Popen([sys.executable, "-m", "conflictdb", "worker", "--once", "--jobs", "1"], env=environ)
        for _ in range(2)
    ]
    assert [worker.wait(WAIT_S) for worker in workers] == [0, 0]
    with connect(dsn) as db:
        found = {name: [(c.a_key, c.b_key, c.periods) for c in db.scene(name).conflicts()] for name in ("a", "b", "c")}
    assert found["a"] == found["b"] == found["c"]
    assert len(found["a"]) == 7
    assert json.dumps(pending(dsn)) == '{"a": 0, "b": 0, "c": 0}'


def worker(dsn: str, reports: list[tuple[str, object]], **more: Any) -> Worker:
    """Return a worker that records its reports."""
    return Worker(
        lambda: store.connect(dsn), lambda scene, outcome, _: reports.append((scene, outcome)), jobs=1, **more
    )


def test_a_worker_passes_over_what_another_detects(dsn: str) -> None:
    """It does the next scene, waits for the first, says who has it, and does what the other one left."""
    load(dsn, "first")
    load(dsn, "second")
    reports: list[tuple[str, object]] = []
    said: list[str] = []
    with store.connect(dsn) as other:
        store.begin_locked(other, store.scene_id(other, "first"), "first", 0.0, print)
        one = worker(dsn, reports, say=said.append, busy_s=0.05, say_after_s=0.1)
        thread = threading.Thread(target=one.once)
        thread.start()
        until(lambda: bool(said and reports))
        assert [scene for scene, _ in reports] == ["second"]
        other.rollback()
        thread.join(WAIT_S)
    assert [scene for scene, _ in reports] == ["second", "first"]
    assert all(isinstance(run, detect.Run) for _, run in reports)
    assert said == [said[0]]
    assert said[0].startswith("first: another detection of scene 'first' is at work: process ")


def test_a_scene_that_another_detects_is_not_asked_for_at_each_change(
    dsn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever tried again at each notification would take the processor from the one at work."""
    load(dsn, "first")
    whole, asked = detect.detect_pending, []

    def noted(conn: Any, scene: str, **options: Any) -> detect.Run | None:
        asked.append(scene)
        return whole(conn, scene, **options)

    monkeypatch.setattr("conflictdb.jobs.detect.detect_pending", noted)
    reports: list[tuple[str, object]] = []
    with store.connect(dsn) as other, store.connect(dsn) as conn:
        store.begin_locked(other, store.scene_id(other, "first"), "first", 0.0, print)
        one = worker(dsn, reports, busy_s=600.0)
        assert all(one._round(conn, WAIT_S) for _ in range(3))
        assert (asked, reports) == (["first"], [])
        load(dsn, "second")
        assert one._round(conn, WAIT_S)
    assert asked == ["first", "second"]


def test_changes_that_came_during_a_detection_wake_a_worker_once(dsn: str) -> None:
    with store.connect(dsn) as conn:
        assert store.listen(conn, lambda: store.connect(dsn))
        conn.execute("SELECT pg_notify('conflictdb_request', i::text) FROM generate_series(1, 20) i")
        conn.commit()
        assert store.wait_for_change(conn, WAIT_S)
        assert not store.wait_for_change(conn, 0.0)


def test_a_scene_that_another_keeps_for_too_long_has_failed(dsn: str) -> None:
    load(dsn, "kept")
    reports: list[tuple[str, object]] = []
    with store.connect(dsn) as other:
        store.begin_locked(other, store.scene_id(other, "kept"), "kept", 0.0, print)
        assert not worker(dsn, reports, lock_timeout_s=0.2, busy_s=0.05).once()
        ((scene, error),) = reports
        assert (scene, type(error)) == ("kept", LockTimeout)
        assert store.runs(other, "kept", 9) == []


def test_what_another_has_done_meanwhile_is_no_run(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it came before the first transaction or between the two."""
    for place, begin in enumerate((store.begin_detection, store.begin_locked), 1):
        calls: list[int] = []

        def meanwhile(conn: Any, *arguments: Any, begin: Any = begin, calls: list[int] = calls) -> Any:
            calls.append(1)
            if len(calls) == 1:
                with store.connect(dsn) as other:
                    detect.detect(other, "strait", jobs=1)
            return begin(conn, *arguments)

        with connect(dsn) as db:
            db.load(STRAIT, "strait")
            store.set_scene(db.connection, Scene("strait", tolerance_m=float(place)))
        with monkeypatch.context() as patch, store.connect(dsn) as conn:
            patch.setattr(store, begin.__name__, meanwhile)
            # Two transactions, however few objects changed.
            assert detect.detect_pending(conn, "strait", jobs=1, few_objects=-1) is None
            assert len(store.runs(conn, "strait", 9)) == place, "the other one's"
    assert pending(dsn) == {"strait": 0}


def test_a_scene_that_is_current_is_left_alone(dsn: str) -> None:
    with connect(dsn) as db:
        db.load(STRAIT, "strait")
        db.scene("strait").detect()
        assert detect.detect_pending(db.connection, "strait") is None
        assert len(store.runs(db.connection, "strait", 9)) == 1


def test_a_limit_of_idle_sessions_does_not_end_a_worker(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is idle until something changes: its session has no limit when it waits."""
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(f"ALTER DATABASE {conn.info.dbname} SET idle_session_timeout = '1h'".encode())
    limits: list[Any] = []

    def waits(connection: psycopg.Connection[Any], timeout_s: float) -> bool:
        limits.append(connection.execute("SHOW idle_session_timeout").fetchone())
        raise KeyboardInterrupt

    monkeypatch.setattr(store, "wait_for_change", waits)
    with store.connect(dsn) as usual:
        assert usual.execute("SHOW idle_session_timeout").fetchone() == ("1h",)
    with pytest.raises(KeyboardInterrupt):
        worker(dsn, []).run()
    assert limits == [("0",)]


def test_a_scene_that_always_waits_leaves_the_others_their_turn(dsn: str) -> None:
    """Whatever changes while a worker is busy: each scene that waits has its turn before one has a second."""
    for name in ("always", "b", "c"):
        load(dsn, name)
    turns: list[str] = []

    def report(scene: str, outcome: object, waited_s: float) -> None:
        assert isinstance(outcome, detect.Run), outcome
        turns.append(scene)
        if len(turns) == 6:
            raise KeyboardInterrupt
        changed = ["always"] if scene == "always" else []
        with psycopg.connect(dsn) as editor:
            for name in [*changed, *(["b"] if turns[-2:] == ["c", "always"] else [])]:
                editor.execute(
                    "UPDATE conflictdb.area a SET ceiling_m = 9 + %s FROM conflictdb.scene s "
                    "WHERE s.scene_id = a.scene_id AND s.name = %s AND a.key = 'DIVING'",
                    [len(turns), name],
                )

    with pytest.raises(KeyboardInterrupt):
        Worker(lambda: store.connect(dsn), report, every_s=600.0, jobs=1).run()
    assert turns == ["always", "b", "c", "always", "always", "b"]


def test_a_worker_notices_that_a_network_is_gone(dsn: str) -> None:
    """Connections set TCP options for it; the user's own options for that stay, and all other ones."""
    given = store.worker_dsn(f"{dsn} keepalives_idle=7 application_name=mine connect_timeout=3")
    found = conninfo_to_dict(given)
    assert conninfo_to_dict(dsn).items() <= found.items()
    assert found["application_name"] == store.WORKER_NAME
    assert (found["keepalives_idle"], found["connect_timeout"], found["tcp_user_timeout"]) == ("7", "3", "60000")
    store.connect(given).close()
    with pytest.raises(StoreError, match="missing"):
        store.worker_dsn("host")


def test_a_worker_seals_edits(dsn: str) -> None:
    load(dsn, "first")
    sealed = "SELECT sum(edits) = (SELECT count(*) FROM conflictdb.edit) FROM conflictdb.edit_seal"
    with psycopg.connect(dsn, autocommit=True) as conn:
        with program(dsn):
            until(lambda: conn.execute(sealed.encode()).fetchone() == (True,))
        assert conn.execute("SELECT first_wrong FROM conflictdb.verify_edits()").fetchone() == (None,)


def test_a_backlog_is_sealed_in_batches(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Detections do not wait for all of it."""
    monkeypatch.setattr("conflictdb.store.edits._MOST", 2)
    load(dsn, "first")
    with store.connect(dsn) as conn:
        for number in range(3):
            with conn.transaction():
                conn.execute("UPDATE conflictdb.area SET name = %s", [str(number)])
        edits = store.verify_edits(conn).unsealed
        assert [store.seal_some_edits(conn) for _ in range(edits // 2 + 1)] == [True] * (edits // 2) + [False]
        assert store.verify_edits(conn).unsealed == 0
