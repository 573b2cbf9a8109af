"""kill -9 in the middle of a detection, of it or of the server's process that serves it.

The old conflicts are still there, marks too, and the next run is right.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from own_server import OwnServer, own_server
from patience import WAIT_S, killed_after
from verdicts import Pair, Reported, by_pair, solved

from conflictdb import delays, store
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Conflict

# Differences of departures are stored up to this.
WITHIN_S = 7200.0

# Detects, reports its progress on standard output, then waits to be killed at the given place.
VICTIM = """
import os, sys, time
from conflictdb import store
from conflictdb.jobs.detect import detect

def stop(where):
    os.write(1, f"{where}\\n".encode())  # in one piece: another thread tells of its place, too
    if where == sys.argv[3]:
        time.sleep(600)

def stopping(name, *, after):
    routine = getattr(store, name)
    def run(*arguments, **named):
        if not after:
            stop(name)
        result = routine(*arguments, **named)
        if after:
            stop(name)
        return result
    setattr(store, name, run)

for name in (
    "begin_detection", "changed_areas", "replace_pieces", "begin_write", "bundles", "put_pieces", "stage",
    "rows_to_compare", "write_differences", "end_write"
):
    stopping(name, after=True)
with store.connect(sys.argv[1]) as conn:
    detect(conn, sys.argv[2], jobs=1, progress=lambda *_: stop("progress"), few_objects=int(sys.argv[4]))
"""
# Largest number of changed objects that count as few: none, for two transactions; all objects, for one.
TWO_TRANSACTIONS, ONE_TRANSACTION = -1, 100
EVERYWHERE = [
    ("changed_areas", TWO_TRANSACTIONS),
    ("replace_pieces", TWO_TRANSACTIONS),
    ("begin_write", TWO_TRANSACTIONS),
    ("bundles", TWO_TRANSACTIONS),
    ("progress", TWO_TRANSACTIONS),
    ("stage", TWO_TRANSACTIONS),
    ("rows_to_compare", TWO_TRANSACTIONS),
    ("write_differences", TWO_TRANSACTIONS),
    ("end_write", TWO_TRANSACTIONS),
    ("begin_detection", ONE_TRANSACTION),
    ("put_pieces", ONE_TRANSACTION),
    ("write_differences", ONE_TRANSACTION),
    ("end_write", ONE_TRANSACTION),
]
SELDOM = {"begin_detection", "changed_areas", "begin_write", "stage", "rows_to_compare"}
PLACES = [pytest.param(*at, marks=pytest.mark.slow) if at[0] in SELDOM else at for at in EVERYWHERE]


@pytest.fixture(scope="module")
def changed() -> tuple[Scene, list[Area], list[Track], list[Area], list[Track]]:
    """A scene, and the same after a third of it was replaced by something else."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 2, 8, 8)
    scene = replace(scene, delays_within_s=WITHIN_S)
    aside = np.array([0.3, 0.2])
    moved = [Track(t.key, t.positions_deg + aside, t.times_us + 3_600_000_000, t.outline_m) for t in tracks[:3]]
    return scene, areas, tracks, areas[4:], moved + tracks[3:]


def start_victim(
    dsn: str, scene: str, place: str, tmp_path: Path, few: int = TWO_TRANSACTIONS
) -> "subprocess.Popen[str]":
    script = tmp_path / "victim.py"
    script.write_text(VICTIM)
    return subprocess.Popen(
        [sys.executable, str(script), dsn, scene, place, str(few)], stdout=subprocess.PIPE, text=True
    )


def wait_until_at(victim: "subprocess.Popen[str]", place: str) -> None:
    assert victim.stdout is not None
    with killed_after(victim, WAIT_S):
        for line in victim.stdout:
            if line.strip() == place:
                return
    pytest.fail(f"the detection ended ({victim.wait()}) before it came to {place}, or did not within {WAIT_S:g} s")


def wait_until_alone(conn: psycopg.Connection[Any]) -> None:
    """Until the server has noticed that the other session is gone."""
    end = time.monotonic() + WAIT_S
    while time.monotonic() < end:
        query = (
            "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND pid <> pg_backend_pid() "
            "AND application_name <> 'cleaner'"
        )
        row = conn.execute(query).fetchone()
        conn.commit()
        if row == (0,):
            return
        time.sleep(0.05)
    pytest.fail("the session of the killed process is still there")


def differences(conn: psycopg.Connection[Any]) -> list[tuple[Any, ...]]:
    """The stored rows; objects keep their ids."""
    found = conn.execute("SELECT d::text FROM conflictdb.difference d ORDER BY 1").fetchall()
    conn.commit()
    return found


def view(conn: psycopg.Connection[Any], scene: Scene) -> dict[Pair, Reported]:
    return by_pair(store.conflicts(conn, scene.name))


def assert_equal(found: dict[Pair, Reported], expected: dict[Pair, Reported]) -> None:
    """The same answer; of the bounds, the last digits may differ with the order of a pair."""
    assert found.keys() == expected.keys()
    for pair, answer in expected.items():
        assert found[pair] == replace(answer, time_error_s=found[pair].time_error_s)
        assert found[pair].time_error_s == pytest.approx(answer.time_error_s, rel=1e-3, abs=1e-9)


def assert_same_but_for_what_changed(
    found: dict[Pair, Reported], before: dict[Pair, Reported], rows: Sequence[Conflict], removed: set[str]
) -> None:
    assert found == before, "the old conflicts are still there"
    stale = {(row.a_key, row.b_key) for row in rows if not row.is_current}
    assert all(pair in stale for pair in before if removed & set(pair)), "and say that they are not current"


def begin(conn: psycopg.Connection[Any], changed: Any) -> tuple[dict[Pair, Reported], int, list[tuple[Any, ...]]]:
    """Have a scene that was detected, and then changed.

    Returns its conflicts, how many runs there were, and the stored differences.
    """
    scene, areas, tracks, areas_after, tracks_after = changed
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    detect(conn, scene.name, jobs=1)
    before = view(conn, scene)
    assert_equal(before, solved(scene, areas, tracks))
    runs_before = len(store.runs(conn, scene.name, 1000))
    stored_before = differences(conn)
    assert stored_before
    store.replace_scene(conn, scene, areas_after, tracks_after, merge=False)
    conn.commit()
    return before, runs_before, stored_before


def assert_nothing_lost(
    conn: psycopg.Connection[Any],
    changed: Any,
    before: dict[Pair, Reported],
    runs_before: int,
    stored_before: list[tuple[Any, ...]],
) -> None:
    scene, areas, _, areas_after, tracks_after = changed
    gone = {area.key for area in areas} - {area.key for area in areas_after}
    assert_same_but_for_what_changed(view(conn, scene), before, store.conflicts(conn, scene.name), gone)
    assert len(store.runs(conn, scene.name, 1000)) == runs_before, "a killed run is not a run"
    assert differences(conn) == stored_before

    run = detect(conn, scene.name, jobs=1)
    after = view(conn, scene)
    assert_equal(after, solved(scene, areas_after, tracks_after))
    assert run.closed > 0
    assert all(row.is_current for row in store.conflicts(conn, scene.name))
    again = detect(conn, scene.name, jobs=1)
    assert (again.opened, again.changed, again.closed, again.candidate_pairs) == (0, 0, 0, 0)
    anew = detect(conn, scene.name, jobs=1, full=True)
    assert (anew.opened, anew.changed, anew.closed) == (0, 0, 0)
    assert view(conn, scene) == after, "what changed only, or everything: the same to the last digit"
    known = store.stored_delays(conn, store.scene_id(conn, scene.name), None, round(1e6 * WITHIN_S), None)
    assert known == delays(tracks_after, areas_after, scene, within_s=WITHIN_S)


@pytest.mark.parametrize(("place", "few"), PLACES)
def test_killed_detection_leaves_the_old_conflicts(
    dsn: str, conn: psycopg.Connection[Any], tmp_path: Path, place: str, few: int, changed: Any
) -> None:
    known = begin(conn, changed)
    victim = start_victim(dsn, changed[0].name, place, tmp_path, few)
    try:
        wait_until_at(victim, place)
    finally:
        victim.send_signal(signal.SIGKILL)
        victim.communicate()
    wait_until_alone(conn)
    assert_nothing_lost(conn, changed, *known)


@pytest.fixture(scope="module")
def mortal(server_dsn: str) -> Iterator[OwnServer]:
    """A server of the module's own; the server for tests makes sure that its programs are installed."""
    with own_server() as server:
        yield server


@pytest.mark.slow
@pytest.mark.parametrize(("place", "few"), EVERYWHERE)
def test_killed_backend_leaves_the_old_conflicts(
    mortal: OwnServer, tmp_path: Path, place: str, few: int, changed: Any
) -> None:
    """All sessions of the server end, and it recovers."""
    with store.connect(mortal.dsn) as conn:
        known = begin(conn, changed)
        victim = start_victim(mortal.dsn, changed[0].name, place, tmp_path, few)
        try:
            wait_until_at(victim, place)
            query = "SELECT pid FROM pg_stat_activity WHERE datname = current_database() AND pid <> pg_backend_pid()"
            for (pid,) in conn.execute(query).fetchall():
                os.kill(pid, signal.SIGKILL)
            with pytest.raises(psycopg.OperationalError):
                conn.execute("SELECT pg_sleep(60)")
        finally:
            victim.kill()
            victim.communicate()
    mortal.await_answer()
    with store.connect(mortal.dsn) as conn:
        assert_nothing_lost(conn, changed, *known)


def test_killed_detection_does_not_keep_others_waiting(
    dsn: str, conn: psycopg.Connection[Any], tmp_path: Path, changed: Any
) -> None:
    """The lock of a scene ends with its session: a second detection waits, and then goes on."""
    scene, areas, tracks, *_ = changed
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    conn.commit()
    victim = start_victim(dsn, scene.name, "begin_write", tmp_path)
    waiting = None
    try:
        wait_until_at(victim, "begin_write")
        waiting = start_victim(dsn, scene.name, "nowhere", tmp_path)
        with pytest.raises(subprocess.TimeoutExpired):
            waiting.wait(1.5)
    finally:
        victim.send_signal(signal.SIGKILL)
        victim.communicate()
        if waiting is not None:
            waiting.communicate(timeout=WAIT_S)
    assert waiting is not None
    assert waiting.returncode == 0
    assert_equal(view(conn, scene), solved(scene, areas, tracks))


def test_failed_detection_is_recorded_and_changes_nothing(
    conn: psycopg.Connection[Any], monkeypatch: pytest.MonkeyPatch, changed: Any
) -> None:
    scene, areas, tracks, areas_after, tracks_after = changed
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    detect(conn, scene.name, jobs=1)
    before = view(conn, scene)
    store.replace_scene(conn, scene, areas_after, tracks_after, merge=False)

    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("no more memory")

    with monkeypatch.context() as patch:
        patch.setattr(store, "end_write", broken)
        with pytest.raises(RuntimeError, match="no more memory"):
            detect(conn, scene.name, jobs=1)
    assert view(conn, scene) == before
    assert any(run.error and "no more memory" in run.error for run in store.runs(conn, scene.name, 100))
    detect(conn, scene.name, jobs=1)
    assert_equal(view(conn, scene), solved(scene, areas_after, tracks_after))
