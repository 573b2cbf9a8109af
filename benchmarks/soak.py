"""Delay of workers that keep a scene current while editors change it continuously.

    ./.venv/bin/python benchmarks/soak.py [--objects 20000] [--rate 50] [--editors 4] [--workers 2] [--minutes 3]

In a sea of constant density (made_scenes.py) each editor has its own pace and connection. It moves a track, moves an
area, gives a track other heights, or removes an area and puts it back later. Each edit is one call and one commit. Its
waiting time ends when a listener (NOTIFY) sees that its mark is gone. Then the tables are vacuumed, and the same number
of edits follows: the tables now have free space for edits, and those without history must not grow further. At the end
a detection in full must find no difference.
"""

import argparse
import json
import math
import os
import queue
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, Final

import numpy as np
import psycopg
from made_scenes import sea
from measured import fresh_database, load, versions, write_csv
from tables import markdown, show

import conflictdb
from conflictdb import Scene

SCENE: Final = "soak"
# Actions of editors, in turns: tracks are edited three times as often as areas are moved.
TRACK_MOVED: Final = """
SELECT conflictdb.put_track(%(scene)s, t.key, ST_Translate(t.path, 0, %(by)s), t.outline, t.floor_m, t.ceiling_m)
FROM conflictdb.track t JOIN conflictdb.scene s USING (scene_id) WHERE s.name = %(scene)s AND t.key = %(key)s
"""
TRACK_RAISED: Final = """
UPDATE conflictdb.track t SET ceiling_m = coalesce(t.ceiling_m, t.floor_m, 0) + 1 FROM conflictdb.scene s
WHERE s.scene_id = t.scene_id AND s.name = %(scene)s AND t.key = %(key)s
"""
AREA_MOVED: Final = """
UPDATE conflictdb.area a SET footprint = ST_Translate(a.footprint, 0, %(by)s) FROM conflictdb.scene s
WHERE s.scene_id = a.scene_id AND s.name = %(scene)s AND a.key = %(key)s
"""
AREA_KEPT: Final = """
SELECT ST_AsEWKB(a.footprint), a.active_span, a.floor_m, a.ceiling_m
FROM conflictdb.area a JOIN conflictdb.scene s USING (scene_id) WHERE s.name = %(scene)s AND a.key = %(key)s
"""
AREA_PUT: Final = "SELECT conflictdb.put_area(%s, %s, ST_GeomFromEWKB(%s), %s, %s, %s)"
# One edit leaves one mark; several marks of an edit are one transaction, so they are gone together.
MARK: Final = "SELECT currval(pg_get_serial_sequence('conflictdb.change', 'change_id'))"
KEYS: Final = """
SELECT o.key FROM conflictdb.{kind} o JOIN conflictdb.scene s USING (scene_id) WHERE s.name = %s ORDER BY md5(o.key)
"""
# All that is known of a conflict but which run found it so, and when.
CONFLICTS: Final = """
SELECT to_jsonb(c) - 'run_id' - 'found_at' FROM conflictdb.approaches c WHERE c.scene = %s ORDER BY c.a_key, c.b_key
"""
PERIODS: Final = """
SELECT c.a_key, c.b_key, c.verdict, c.periods::text, ST_AsBinary(c.region) FROM conflictdb.conflicts c
WHERE c.scene = %s ORDER BY c.a_key, c.b_key
"""
# History of conflicts, and runs. They grow until they are old enough to be pruned; even then the last event of each
# conflict stays, and its run.
HISTORY: Final = ("conflict_event", "run")
SIZES: Final = """
SELECT c.relname, pg_total_relation_size(c.oid) FROM pg_class c
WHERE c.relnamespace = 'conflictdb'::regnamespace AND c.relkind = 'r' ORDER BY c.relname
"""
STEP_DEG: Final = 0.01
PATIENCE_S: Final = 120.0
# Before the measured edits: workers plan their statements, and read the pages that all changes need.
WARM_UP_S: Final = 5.0
# A table that is smaller grew by nothing that matters: pages come in steps, and settle after more than one vacuum.
SMALL_BYTES: Final = 1_000_000


@dataclass(slots=True)
class Lags:
    """Waiting times of edits, from the commit until they were current.

    since : earlier edits do not count, as of `time.monotonic`
    waited_s : of those that are current
    edits : number of current edits, including those before `since`
    done : marks of edits with the instants of their commits, from all editors
    """

    since: float
    waited_s: list[float] = field(default_factory=list)
    edits: int = 0
    done: "queue.SimpleQueue[tuple[int, float]]" = field(default_factory=queue.SimpleQueue)
    _waiting: dict[int, float] = field(default_factory=dict)

    def look(self, conn: psycopg.Connection[Any]) -> bool:
        """See which edits are current by now; return whether all are."""
        # First: whatever is known here has committed before marks are read.
        while not self.done.empty():
            mark, committed_at = self.done.get()
            self._waiting[mark] = committed_at
        marked = {mark for (mark,) in conn.execute("SELECT change_id FROM conflictdb.change").fetchall()}
        now = time.monotonic()
        for mark in self._waiting.keys() - marked:
            self.edits += 1
            if (committed_at := self._waiting.pop(mark)) >= self.since:
                self.waited_s.append(now - committed_at)
        return not self._waiting and not marked


class Editor(threading.Thread):
    """Edits objects of its own at a pace, over a connection of its own."""

    def __init__(self, dsn: str, keys: dict[str, list[str]], every_s: float, until: float, lags: Lags) -> None:
        super().__init__()
        self.error: BaseException | None = None
        self.late_s = 0.0
        self._dsn, self._keys, self._every_s, self._until, self._lags = dsn, keys, every_s, until, lags
        self._turns: Counter[str] = Counter()
        self._removed: list[tuple[Any, ...]] = []

    def run(self) -> None:
        """Edit until the time is over; `error` is its failure, `late_s` its largest delay behind its pace."""
        try:
            with psycopg.connect(self._dsn) as conn:
                due = time.monotonic()
                for nth, edit in enumerate(self._edits(conn)):
                    due += self._every_s
                    if (left_s := due - time.monotonic()) > 0.0:
                        time.sleep(left_s)
                    elif nth > 0:
                        self.late_s = max(self.late_s, -left_s)
                    if due >= self._until:
                        return
                    edit()
                    (mark,) = conn.execute(MARK).fetchone() or (None,)
                    conn.commit()
                    self._lags.done.put((int(mark), time.monotonic()))
        except BaseException as error:
            self.error = error

    def _edits(self, conn: psycopg.Connection[Any]) -> Iterator[Any]:
        """Yield the next edits, for ever."""
        while True:
            yield lambda: self._edit(conn, TRACK_MOVED, "track")
            yield lambda: self._edit(conn, AREA_MOVED, "area")
            yield lambda: self._edit(conn, TRACK_RAISED, "track")
            yield lambda: self._edit(conn, TRACK_MOVED, "track")
            yield lambda: self._remove_or_put(conn)

    def _next(self, kind: str) -> dict[str, Any]:
        """Return the parameters of an edit: the next object; every second round moves it back."""
        rounds, nth = divmod(self._turns[kind], len(self._keys[kind]))
        self._turns[kind] += 1
        return {"scene": SCENE, "key": self._keys[kind][nth], "by": -STEP_DEG if rounds % 2 else STEP_DEG}

    def _edit(self, conn: psycopg.Connection[Any], edit: str, kind: str) -> None:
        changed = conn.execute(edit, self._next(kind)).rowcount
        if changed != 1:
            raise RuntimeError(f"{changed} rows edited, not 1")

    def _remove_or_put(self, conn: psycopg.Connection[Any]) -> None:
        if self._removed:
            conn.execute(AREA_PUT, self._removed.pop())
            return
        removed = self._next("removed")
        row = conn.execute(AREA_KEPT, removed).fetchone()
        if row is None:
            raise RuntimeError(f"no area {removed['key']!r}")
        self._removed.append((SCENE, removed["key"], *row))
        conn.execute("SELECT conflictdb.remove_object(%(scene)s, %(key)s)", removed)


@contextmanager
def worker(dsn: str) -> Iterator[tuple["subprocess.Popen[bytes]", IO[bytes]]]:
    """Run a worker that keeps a database current; yield it with its output."""
    command = [sys.executable, "-m", "conflictdb", "--dsn", dsn, "worker", "--log", "json"]
    with TemporaryFile() as said, subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT) as process:
        try:
            yield process, said
        finally:
            process.terminate()


@dataclass(frozen=True, slots=True)
class Soaked:
    """Results of editing for a while.

    waited_s : waiting time of each edit until it was current, without those of the beginning
    edits : number of edits, including those of the beginning
    late_s : largest delay of an editor behind its pace
    runs : number of detections by the workers
    errors : errors of editors and workers
    """

    waited_s: list[float]
    edits: int
    late_s: float
    runs: int
    errors: list[str]


def soak(dsn: str, rate: float, editors: int, workers: int, seconds: float, warm_up_s: float = WARM_UP_S) -> Soaked:
    """Edit the scene, with workers at work, and wait until all is current."""
    with ExitStack() as stack:
        listener = stack.enter_context(psycopg.connect(dsn, autocommit=True))
        listener.execute("LISTEN conflictdb")
        keys = {
            kind: [key for (key,) in listener.execute(KEYS.format(kind=kind).encode(), [SCENE]).fetchall()]
            for kind in ("area", "track")
        }
        started = [stack.enter_context(worker(dsn)) for _ in range(workers)]
        _await_workers(listener, workers)
        lags = Lags(time.monotonic() + warm_up_s)
        crew = _crew(dsn, keys, rate, editors, lags.since + seconds, lags)
        _watch(listener, crew, lags)
        errors = [f"{type(one.error).__name__}: {one.error}" for one in crew if one.error]
        errors += [f"a worker ended: {process.returncode}" for process, _ in started if process.poll() is not None]
        runs = 0
        for process, said in started:
            process.terminate()
            process.wait()
            said.seek(0)
            for line in said.read().decode().splitlines():
                event = json.loads(line) if line.startswith("{") else {"event": line}
                runs += event["event"] == "run"
                if event["event"] not in {"run", "conflictdb: working; Ctrl-C ends", "conflictdb: stopped"}:
                    errors.append(line)
        return Soaked(lags.waited_s, lags.edits, max(one.late_s for one in crew), runs, errors)


def _crew(dsn: str, keys: dict[str, list[str]], rate: float, editors: int, until: float, lags: Lags) -> list[Editor]:
    """Return editors at work, each of whom has objects of its own: no edit waits for another one."""
    crew = []
    for nth in range(editors):
        half = len(keys["area"]) // 2
        own = {
            "track": keys["track"][nth::editors],
            "area": keys["area"][:half][nth::editors],
            "removed": keys["area"][half:][nth::editors],
        }
        crew.append(Editor(dsn, own, editors / rate, until, lags))
        crew[-1].start()
    return crew


def _watch(listener: psycopg.Connection[Any], crew: list[Editor], lags: Lags) -> None:
    """Record the waiting times of edits, until editors have ended and all is current."""
    given_up_at = math.inf
    while time.monotonic() < given_up_at:
        for _ in listener.notifies(timeout=1.0, stop_after=1):
            pass
        is_current = lags.look(listener)
        if not any(editor.is_alive() for editor in crew):
            if is_current and lags.done.empty():
                return
            given_up_at = min(given_up_at, time.monotonic() + PATIENCE_S)
    raise TimeoutError("the workers do not come to an end")


def _await_workers(conn: psycopg.Connection[Any], workers: int) -> None:
    given_up_at = time.monotonic() + PATIENCE_S
    while conn.execute("SELECT (conflictdb_internal._service()).worker_count").fetchone() != (workers,):
        if time.monotonic() > given_up_at:
            raise TimeoutError("the workers do not begin")
        time.sleep(0.1)


def drift(db: conflictdb.Database) -> int:
    """Return the number of conflicts that a full detection changes, compared with those kept current."""

    def known() -> set[str]:
        found = [db.connection.execute(query.encode(), [SCENE]).fetchall() for query in (CONFLICTS, PERIODS)]
        db.connection.rollback()
        return {repr(row) for rows in found for row in rows}

    kept = known()
    db.scene(SCENE).detect(full=True)
    return len(kept ^ known())


def sizes(conn: psycopg.Connection[Any]) -> dict[str, int]:
    """Return the size of each table with its indexes, bytes, after removal of dead rows."""
    conn.execute("VACUUM ANALYZE")
    return {str(table): int(size) for table, size in conn.execute(SIZES).fetchall()}


def measure(dsn: str, objects: int, rate: float, editors: int, workers: int, minutes: float) -> dict[str, Any]:
    """Load a scene, have it edited twice for a time, and return the results."""
    with conflictdb.connect(dsn) as db, psycopg.connect(dsn, autocommit=True) as conn:
        load(db, Scene(SCENE), sea(objects, 1))
        db.scene(SCENE).detect()
        load_before, new = os.getloadavg()[0], sizes(conn)
        first = soak(dsn, rate, editors, workers, 60.0 * minutes)
        before = sizes(conn)
        second = soak(dsn, rate, editors, workers, 60.0 * minutes)
        after = sizes(conn)
        waited_s = np.array(first.waited_s + second.waited_s)
        grown = {
            name: size / before[name] - 1.0
            for name, size in after.items()
            if size >= SMALL_BYTES and name not in HISTORY
        }
        return {
            "objects": objects,
            "editors": editors,
            "workers": workers,
            "minutes": 2.0 * minutes,
            "edits": len(waited_s),
            "edits_a_s": len(waited_s) / (120.0 * minutes),
            "runs": first.runs + second.runs,
            "median_s": float(np.median(waited_s)),
            "p99_s": float(np.quantile(waited_s, 0.99)),
            "longest_s": float(waited_s.max()),
            "late_s": max(first.late_s, second.late_s),
            "errors": len(first.errors + second.errors),
            "drift": drift(db),
            "grown": max(grown.values(), default=0.0),
            "grown_most": max(grown, key=lambda name: grown[name], default=""),
            "history_bytes": sum(after[name] - new[name] for name in HISTORY) / (first.edits + second.edits),
            "load": max(load_before, os.getloadavg()[0]),
            "messages": "; ".join(first.errors + second.errors),
        }


HEADS: Final = [
    *("objects", "editors", "workers", "minutes", "edits", "edits a s", "runs", "lag: median, s", "99 %, s"),
    *("longest, s", "errors", "drift", "grown most", "history, bytes an edit", "load"),
]


def table(rows: list[dict[str, Any]]) -> str:
    """Return the measurements, a row for each number of objects."""
    return markdown(
        HEADS,
        [
            [
                f"{row['objects']:,}",
                *(str(row["editors"]), str(row["workers"]), f"{row['minutes']:g}", f"{row['edits']:,}"),
                *(f"{row['edits_a_s']:.1f}", f"{row['runs']:,}"),
                *(f"{row[name]:.2f}" for name in ("median_s", "p99_s", "longest_s")),
                *(str(row["errors"]), str(row["drift"])),
                *(f"{row['grown_most']} {100.0 * row['grown']:+.1f} %", f"{row['history_bytes']:,.0f}"),
                f"{row['load']:.1f}",
            ]
            for row in rows
        ],
    )


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server to make a database on (default: the embedded one)")
    parser.add_argument("--objects", type=int, nargs="*", default=[20_000])
    parser.add_argument("--rate", type=float, default=50.0, help="edits a second, of all editors together")
    parser.add_argument("--editors", type=int, default=4)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=3.0, help="of editing, twice")
    parser.add_argument("--folder", type=Path, help="write soak.csv there")
    parser.add_argument("--document", type=Path, help="put the table there")
    args = parser.parse_args()
    rows = []
    for objects in args.objects:
        with fresh_database(args.dsn) as dsn:
            rows.append(measure(dsn, objects, args.rate, args.editors, args.workers, args.minutes))
            with psycopg.connect(dsn) as conn:
                software = versions(conn)
    text = f"{table(rows)}\n\n{software}."
    show(text, "soak", args.document)
    for row in rows:
        if row["messages"]:
            print(row["messages"], file=sys.stderr)
    if args.folder:
        write_csv(args.folder / "soak.csv", rows)


if __name__ == "__main__":
    main()
