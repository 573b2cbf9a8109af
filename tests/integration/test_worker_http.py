"""The worker's HTTP endpoints: whether it does its work, and metrics for Prometheus."""

import json
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import suppress
from http.client import HTTPMessage
from typing import Any

import psycopg
import pytest
from commands import STRAIT, runner
from patience import WAIT_S, patient_command
from ports import free_port
from prometheus_client.parser import text_string_to_metric_families

from conflictdb import connect, store
from conflictdb.cli import main
from conflictdb.cli.watch import Metrics, served
from conflictdb.errors import ConflictDBError
from conflictdb.jobs.worker import Worker, WorkerState

HERE = "127.0.0.1"


def get(port: int, path: str, host: str = HERE) -> tuple[int, str, HTTPMessage]:
    try:
        with urllib.request.urlopen(f"http://{host}:{port}{path}", timeout=WAIT_S) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode(), error.headers


def numbers(text: str) -> dict[tuple[str, ...], float]:
    """Return the samples of a page of metrics, by name and the values of labels in the order of their names."""
    samples = (sample for family in text_string_to_metric_families(text) for sample in family.samples)
    return {(sample.name, *dict(sorted(sample.labels.items())).values()): sample.value for sample in samples}


@pytest.mark.parametrize(
    ("is_connected", "idle_s", "scene", "code", "status"),
    [
        (True, 0.0, None, 200, "ok"),
        (False, 0.0, None, 503, "no database"),
        (True, 1e4, None, 503, "stuck"),
        (True, 1e4, "large \N{BELL}", 200, "ok"),
    ],
)
def test_health_tells_whether_it_does_its_work(
    is_connected: bool, idle_s: float, scene: str | None, code: int, status: str
) -> None:
    """A detection may take as long as it takes."""
    state = WorkerState(is_connected=is_connected, looked_at_s=time.monotonic() - idle_s, scene=scene)
    with served((HERE, 0), state, Metrics(state), 60.0) as port:
        found, text, headers = get(port, "/healthz")
        assert (found, headers["Content-Type"], headers["Content-Length"]) == (code, "application/json", str(len(text)))
        assert (json.loads(text)["status"], json.loads(text)["detects"]) == (status, state.scene)
        assert get(port, "/")[0] == 404


def test_metrics_count_detections_and_failures(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever scenes are called."""
    bad = 'bad"\n'
    with connect(dsn) as db:
        db.load(STRAIT, "good")
        db.load(STRAIT, bad)
    reports: list[str] = []
    worker = Worker(lambda: store.connect(dsn), lambda scene, *_: reports.append(scene), jobs=1)
    metrics = Metrics(worker.state)
    worker.report = metrics.counted(worker.report)
    whole = store.put_pieces

    def sometimes(conn: psycopg.Connection[object], scene_id: int, *more: Any) -> Any:
        if scene_id == store.scene_id(conn, bad):
            raise ValueError("no luck")
        return whole(conn, scene_id, *more)

    monkeypatch.setattr(store, "put_pieces", sometimes)
    assert not worker.once()
    assert sorted(reports) == sorted(["good", bad])
    with served((HERE, 0), worker.state, metrics, 60.0) as port:
        _, text, headers = get(port, "/metrics")
    assert headers["Content-Type"].startswith("text/plain; version=")
    found = numbers(text)
    assert found["conflictdb_runs_total", "done", "good"] == found["conflictdb_runs_total", "failed", bad] == 1
    assert found["conflictdb_run_seconds_count",] == found["conflictdb_lag_seconds_count",] == 1
    assert found["conflictdb_lag_seconds_sum",] > found["conflictdb_run_seconds_sum",] > 0
    assert found["conflictdb_scenes_waiting",] == 2
    assert found["conflictdb_longest_wait_seconds",] > 0


def test_metrics_count_conflicts_by_scene_verdict_and_acknowledgement(dsn: str) -> None:
    with connect(dsn) as db:
        scene = db.load(STRAIT)
        scene.detect()
        scene.acknowledge("FERRY", "TOW", "seen")
        worker = Worker(lambda: store.connect(dsn), lambda *_: None, counts=True)
        metrics = Metrics(worker.state)
        assert not any(name == "conflictdb_conflicts" for name, *_ in numbers(metrics.text().decode()))
        with store.connect(store.worker_dsn(dsn)) as connection:
            worker._turn(connection, 0.01)
    found = numbers(metrics.text().decode())
    assert found["conflictdb_conflicts", "yes", "strait", "conflict"] == 1
    assert found["conflictdb_conflicts", "no", "strait", "conflict"] == 6


ATTACHED = """
CREATE SCHEMA mission; CREATE TABLE mission.ops AS SELECT 1 AS id, ST_MakeEnvelope(0, 0, 1, 1, 4326) AS shape;
INSERT INTO mission.ops VALUES (2, NULL);
SELECT conflictdb.create_scene('s'),
       conflictdb.attach('s', 'area', 'mission.ops', '{"key": "id", "footprint": "shape"}')
"""


def test_what_somebody_may_be_called_for_is_shown(dsn: str) -> None:
    """A broken attachment, rows that are left out, a failed run, changes that wait for another role."""
    with psycopg.connect(dsn) as conn:
        conn.execute(ATTACHED)
    state = WorkerState(is_connected=True)
    with connect(dsn) as db, served((HERE, 0), state, Metrics(state), 60.0) as port:

        def shown() -> tuple[dict[str, Any], dict[tuple[str, ...], float]]:
            state.alarmed(store.scene_alarms(db.connection))
            health = json.loads(get(port, "/healthz")[1])
            return health, numbers(get(port, "/metrics")[1])

        health, metrics = shown()
        assert not health["scenes"]["s"]["is_current"]
        assert metrics["conflictdb_longest_wait_seconds",] > 0, "of the attached table"
        assert metrics["conflictdb_current", "s"] == 0
        db.scene("s").detect()
        health, metrics = shown()
        since = metrics["conflictdb_current_since_seconds", "s"]
        assert (health["scenes"]["s"]["unmapped"], metrics["conflictdb_unmapped_rows", "s"]) == (1, 1)
        assert metrics["conflictdb_current", "s"] == 1
        assert metrics["conflictdb_longest_wait_seconds",] == metrics["conflictdb_last_run_failed", "s"] == 0
        assert metrics["conflictdb_attachment_broken", "s", "mission.ops"] == 0
        assert shown()[1]["conflictdb_current_since_seconds", "s"] == since
        db.connection.execute("DROP TABLE mission.ops")
        db.connection.execute("UPDATE conflictdb.run SET error = 'StoreError: no', conflicts = NULL")
        db.connection.commit()
        health, metrics = shown()
        assert health["status"] == "ok", "a restart mends nothing"
        assert "no longer exists" in health["scenes"]["s"]["tables"]["mission.ops"]
        assert health["scenes"]["s"]["last_error"] == "StoreError: no"
        assert metrics["conflictdb_attachment_broken", "s", "mission.ops"] == 1
        assert metrics["conflictdb_last_run_failed", "s"] == 1
        assert metrics["conflictdb_current", "s"] == 0
        assert metrics["conflictdb_current_since_seconds", "s"] >= since


def test_all_remarks_are_in_the_form_of_the_log(dsn: str, capfd: pytest.CaptureFixture[str]) -> None:
    """Also those that the package logs, as of a table that cannot be read."""
    with psycopg.connect(dsn) as conn:
        conn.execute(ATTACHED)
        conn.execute("ALTER TABLE mission.ops RENAME id TO nr")
    assert main(["--dsn", dsn, "worker", "--once", "--log", "json"]) == 0
    out, err = capfd.readouterr()
    events = [json.loads(line) for line in out.splitlines()]
    assert any(one["event"] == "remark" and "cannot be followed: column t.id" in one["text"] for one in events)
    assert err == ""


def test_who_says_nothing_keeps_nobody_waiting_and_a_port_in_use_is_told() -> None:
    state = WorkerState(is_connected=True)
    with served((HERE, 0), state, Metrics(state), 60.0) as port, socket.create_connection((HERE, port)):
        assert get(port, "/healthz")[0] == 200
        with (
            pytest.raises(ConflictDBError, match=f"cannot listen on {HERE}, port {port}"),
            served((HERE, port), state, Metrics(state), 60.0),
        ):
            pass


def test_the_option_is_an_address_of_this_machine_alone(
    dsn: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = runner(dsn, capsys)
    for wrong in ("", "x", ":1", "70000", "::1:80", "[::1]", "a:b:1"):
        done = run("worker", "--http", wrong)
        assert (done.code, "must be a port, or HOST:PORT" in done.err) == (2, True)
    assert run("worker", "--once", "--http", "0").code == 2
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "prometheus_client", None)
        done = run("worker", "--http", "0")
        assert (done.code, done.err) == (
            1,
            "conflictdb: --http needs prometheus_client: pip install 'conflictdb[metrics]'\n",
        )
    port = free_port()
    worker = subprocess.Popen(patient_command("--dsn", dsn, "worker", "--http", str(port)), stdout=subprocess.DEVNULL)
    try:
        end = time.monotonic() + WAIT_S
        while time.monotonic() < end:
            with suppress(urllib.error.URLError):
                if get(port, "/healthz")[0] == 200:
                    break
            time.sleep(0.05)
        assert numbers(get(port, "/metrics")[1])["conflictdb_connected",] == 1
        with pytest.raises(urllib.error.URLError):
            get(port, "/healthz", "127.0.0.2")  # as any other address of this machine
    finally:
        worker.terminate()
        assert worker.wait(WAIT_S) == 0
