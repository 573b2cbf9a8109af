"""One change: the time from its commit until the conflicts are current.

    ./.venv/bin/python benchmarks/one_change.py [--objects 5000 50000] [--changes 50] [--events 0] [--dsn DSN]

In a sea of constant density (made_scenes.py) a track is moved by a hundredth of a degree, and the scene detected,
repeatedly: through the library on an open connection, before and right after a detection in full, and by a running
worker, up to its notification. Results are medians by the clock, and processor seconds of client and server together,
which vary less on a shared machine (measured.py); for the worker the clock alone. `--events N` first adds N events of
earlier detections, as after months of use.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any, Final

import psycopg
from made_scenes import sea
from measured import fresh_database, load, processor_clock, versions, worker

import conflictdb
from conflictdb import Scene

SCENE: Final = "one change"
MOVED: Final = """
SELECT conflictdb.put_track(%(scene)s, t.key, ST_Translate(t.path, 0, %(by)s), t.outline)
FROM conflictdb.track t JOIN conflictdb.scene s USING (scene_id) WHERE s.name = %(scene)s AND t.key = %(key)s
"""
EVENTS: Final = """
INSERT INTO conflictdb.conflict_event (scene_id, run_id, conflict_id, kind, at, opened_at, a_kind, a_key, b_kind, b_key,
                                       periods, verdict, time_error_s)
SELECT s.scene_id, 1, n, 'opened', now(), now(), 1, 'T' || n, 1, 'T' || n + 1, '{[2026-03-01,2026-03-02]}', 'conflict',
       0
FROM conflictdb.scene s, generate_series(1, %s) n
"""
STEP_DEG: Final = 0.01
# Before the measured changes: plans are made, and the pages read that all changes need.
WARM_UP: Final = 6
PATIENCE_S: Final = 60.0


class Changes:
    """Moves one track after the other, there and back."""

    def __init__(self, conn: psycopg.Connection[Any], count: int) -> None:
        self._conn, self._made = conn, 0
        rows = conn.execute(
            "SELECT t.key FROM conflictdb.track t JOIN conflictdb.scene s USING (scene_id) WHERE s.name = %s "
            "ORDER BY md5(t.key) LIMIT %s",
            [SCENE, count],
        )
        self._keys = [key for (key,) in rows.fetchall()]
        conn.commit()

    def make(self) -> None:
        """Make a change, and commit it."""
        rounds, nth = divmod(self._made, len(self._keys))
        by = -STEP_DEG if rounds % 2 else STEP_DEG
        self._conn.execute(MOVED, {"scene": SCENE, "by": by, "key": self._keys[nth]})
        self._conn.commit()
        self._made += 1


def medians_ms(changes: Changes, answer: Callable[[], object], times: int, clock: Callable[[], float]) -> str:
    """Return in words the median times of `answer`, over a number of changes."""
    clocks, spent = [], []
    for _ in range(times):
        changes.make()
        began, began_work = time.perf_counter(), clock()
        answer()
        clocks.append(1e3 * (time.perf_counter() - began))
        spent.append(1e3 * (clock() - began_work))
    worked = f"{statistics.median(spent):6.1f} ms of processors" if any(spent) else ""
    return f"{statistics.median(clocks):6.1f} ms (least {min(clocks):.1f}) {worked}"


def await_detection(listener: psycopg.Connection[Any]) -> None:
    """Wait until a detection has committed."""
    for _ in listener.notifies(timeout=PATIENCE_S, stop_after=1):
        return
    raise TimeoutError("the worker does nothing")


def measure(dsn: str, objects: int, times: int, events: int) -> None:
    """Load a scene, change it, and print the times of changes."""
    with conflictdb.connect(dsn) as db:
        load(db, Scene(SCENE), sea(objects, 1))
        db.connection.execute(EVENTS, [events])
        db.connection.execute("ANALYZE conflictdb.conflict_event")
        db.connection.commit()
        changes, clock = Changes(db.connection, times), processor_clock(db.connection) or time.process_time

        def detect() -> None:
            db.scene(SCENE).detect()

        db.scene(SCENE).detect()
        medians_ms(changes, detect, WARM_UP, clock)
        print(f"{objects:>7,} objects, library            {medians_ms(changes, detect, times, clock)}", flush=True)
        db.scene(SCENE).detect(full=True)
        print(f"{objects:>7,} objects, right after --full {medians_ms(changes, detect, times, clock)}", flush=True)
        with worker(dsn), psycopg.connect(dsn, autocommit=True) as listener:
            listener.execute("LISTEN conflictdb")
            changes.make()
            await_detection(listener)
            medians_ms(changes, lambda: await_detection(listener), WARM_UP, lambda: 0.0)
            medians = medians_ms(changes, lambda: await_detection(listener), times, lambda: 0.0)
            print(f"{objects:>7,} objects, worker             {medians}", flush=True)


def main() -> None:
    """Measure scenes of some sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server that databases may be made on (default: the embedded one)")
    parser.add_argument("--objects", type=int, nargs="*", default=[5_000, 50_000])
    parser.add_argument("--changes", type=int, default=50)
    parser.add_argument("--events", type=int, default=0)
    args = parser.parse_args()
    for objects in args.objects:
        with fresh_database(args.dsn) as dsn:
            if objects == args.objects[0]:
                with psycopg.connect(dsn) as conn:
                    print(versions(conn))
            measure(dsn, objects, args.changes, args.events)


if __name__ == "__main__":
    main()
