"""A detection that is interrupted, terminated or killed leaves nothing behind: no process, no query, nothing half done.

The command is the real one, in a session of its own, as on a terminal. It is stopped while it waits for a lock of
another session, or while it computes.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from patience import WAIT_S, patient_command, until

from conflictdb import store
from conflictdb.jobs.detect import detect
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Scene, Track

# Promised: Ctrl-C is answered within 1 s, and nothing is left after 5 s. The detections stopped here would last for a
# minute or for ever, so a busy machine may take longer. The slow test prints its times (`-rP` shows them).
ANSWERED_S = 50.0
GONE_S = 50.0
PATIENCE_S = WAIT_S

HOUR_US = 3_600_000_000


def load(dsn: str, method: Method, area_count: int, track_count: int) -> None:
    """Store a scene in which all objects meet; 40 areas and 40 tracks keep `nlp` busy for a minute."""
    areas = [
        Area(f"A{i}", shapely.MultiPolygon([shapely.box(5.0 + 1e-4 * i, 57.0, 6.0, 58.0)])) for i in range(area_count)
    ]
    haven = np.array([[0.0, 100.0], [50.0, -50.0], [-50.0, -50.0]])
    times = np.array([0, HOUR_US])
    tracks = [
        Track(f"T{i}", np.array([[4.9, 57.1 + 0.01 * i], [6.1, 57.2 + 0.01 * i]]), times, haven)
        for i in range(track_count)
    ]
    with store.connect(dsn) as conn:
        store.replace_scene(conn, Scene("s", method=method), areas, tracks, merge=False)


@contextmanager
def detection(dsn: str, *options: str) -> Iterator["subprocess.Popen[str]"]:
    """Run the command with two solving threads; kill its remaining processes at the end."""
    heeded = signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background it is ignored, and inherited
    program = patient_command("--dsn", dsn, "detect", "--scene", "s", "--jobs", "2", *options)
    try:
        process = subprocess.Popen(
            program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
    finally:
        signal.signal(signal.SIGINT, heeded)
    try:
        yield process
    finally:
        for left in session(process.pid):
            os.kill(left, signal.SIGKILL)
        process.communicate()


def session(leader: int) -> set[int]:
    """Return the processes of a session that have not ended."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, of = path.read_text().rpartition(")")[2].split()[:4]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(of) == leader and state != "Z":
            found.add(int(path.parent.name))
    return found


def sessions(conn: psycopg.Connection[Any]) -> list[tuple[str | None, str]]:
    """Return the wait events of the command's sessions in this database, and their last statements."""
    rows = conn.execute(
        "SELECT wait_event_type, query FROM pg_stat_activity WHERE datname = current_database() "
        "AND backend_type = 'client backend' AND application_name NOT IN ('blocker', 'cleaner') "
        "AND pid <> pg_backend_pid()"
    ).fetchall()
    conn.commit()
    return rows


def end(process: "subprocess.Popen[str]", number: signal.Signals, conn: psycopg.Connection[Any]) -> list[float]:
    """Send a signal; return the time until the command and all of its processes and queries have ended."""
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as a terminal does
    else:
        process.send_signal(number)
    answered_s = until(lambda: process.poll() is not None, ANSWERED_S, f"{number.name} is answered")
    gone_s = until(lambda: not session(process.pid), GONE_S, "the processes end")
    gone_s += until(lambda: not sessions(conn), GONE_S, f"its sessions end: {sessions(conn)}")
    _, err = process.communicate()
    said = {signal.SIGINT: "conflictdb: interrupted\n", signal.SIGTERM: "conflictdb: terminated\n", signal.SIGKILL: ""}
    # Python ends by the signal itself if it was importing; to a shell that is the same code.
    assert (process.returncode if process.returncode > 0 else 128 - process.returncode) == 128 + number
    assert err == said[number]
    return [answered_s, answered_s + gone_s]


ENDS = [signal.SIGINT, signal.SIGTERM, signal.SIGKILL]


@pytest.mark.parametrize("number", ENDS)
@pytest.mark.parametrize("table", ["piece", pytest.param("conflict", marks=pytest.mark.slow)])
def test_nothing_is_left_of_a_detection_that_waits_in_the_database(
    dsn: str, conn: psycopg.Connection[Any], table: str, number: signal.Signals
) -> None:
    """A statement that lasts for ever, here because of a lock, ends with the command; the next one finds all marks."""
    load(dsn, Method.EXACT, 2, 2)
    with psycopg.connect(dsn, application_name="blocker") as blocker:
        blocker.execute(f"LOCK conflictdb.{table}".encode())
        with detection(dsn) as process:
            until(lambda: [kind for kind, _ in sessions(conn)] == ["Lock"], PATIENCE_S, "it waits for the lock")
            end(process, number, conn)
    assert detect(conn, "s", jobs=2).conflicts >= 5


@pytest.mark.parametrize("number", ENDS)
def test_nothing_is_left_of_a_detection_whose_other_thread_waits_in_the_database(
    dsn: str, conn: psycopg.Connection[Any], number: signal.Signals
) -> None:
    """The thread that reads stored rows waits for a lock: its statement is cancelled before the transaction ends."""
    load(dsn, Method.EXACT, 2, 2)
    with psycopg.connect(dsn, application_name="blocker") as blocker:
        blocker.execute("LOCK conflictdb.conflict")
        with detection(dsn, "--full") as process:
            waits = [("Lock", True)]
            until(
                lambda: [(kind, "_known_conflicts" in query) for kind, query in sessions(conn)] == waits,
                PATIENCE_S,
                "it waits for the lock",
            )
            end(process, number, conn)


@pytest.mark.parametrize("number", ENDS)
def test_nothing_is_left_of_a_detection_that_solves(
    dsn: str, conn: psycopg.Connection[Any], number: signal.Signals
) -> None:
    """The command is one process, whatever --jobs says, and ends in the midst of stage 4."""
    load(dsn, Method.NLP, 40, 40)
    with detection(dsn) as process:
        until(lambda: any("_put_pieces(" in query for _, query in sessions(conn)), PATIENCE_S, "it solves")
        time.sleep(1.0)
        assert session(process.pid) == {process.pid}
        end(process, number, conn)
    assert conn.execute("SELECT count(*) FROM conflictdb.conflicts").fetchone() == (0,)


def test_a_detection_is_watched_on_any_connection(conn: psycopg.Connection[Any], dsn: str) -> None:
    """Also on a connection of the caller's, whose own settings stay; ours are watched from the beginning."""
    load(dsn, Method.EXACT, 1, 1)
    shown = "SHOW client_connection_check_interval"
    with store.connect(dsn) as own:
        assert own.execute(shown).fetchone() == ("1s",)
    before = conn.execute(shown).fetchone()
    conn.rollback()
    store.begin_locked(conn, store.scene_id(conn, "s"), "s", None, print)
    assert conn.execute(shown).fetchone() == ("1s",)
    conn.rollback()
    assert conn.execute(shown).fetchone() == before == ("0",)


@pytest.mark.slow
@pytest.mark.parametrize("method", [Method.NLP, Method.EXACT])
def test_nothing_is_left_wherever_it_is_stopped(dsn: str, conn: psycopg.Connection[Any], method: Method) -> None:
    """Fifty detections are stopped anywhere, by any signal; the next complete one is right."""
    rng = np.random.default_rng(3)
    counts = {Method.NLP: (40, 40), Method.EXACT: (600, 60)}
    load(dsn, method, *counts[method])
    times_s = []
    while len(times_s) < 50:
        with detection(dsn) as process:
            until(lambda: process.poll() is not None or sessions(conn), PATIENCE_S, "it connects")
            try:
                process.wait(rng.uniform(0.0, 10.0))
            except subprocess.TimeoutExpired:
                times_s.append(end(process, ENDS[rng.integers(len(ENDS))], conn))
            else:
                load(dsn, method, *counts[method])
    answered_s, gone_s = zip(*times_s, strict=True)
    sys.stdout.write(f"{method}: answered within {max(answered_s):.2f} s, nothing left after {max(gone_s):.2f} s\n")
    if method == Method.EXACT:
        detect(conn, "s", jobs=1)
        again = detect(conn, "s", jobs=1, full=True)
        assert again.conflicts > 600 * 599 / 2
        assert (again.opened, again.changed, again.closed) == (0, 0, 0)
