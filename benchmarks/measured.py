"""Whole detections, measured: a fresh database, a fresh process, memory of client and server, medians, CSV.

Machines are shared, so the clock of a run is replaced: it counts processor time of this process and its backend in the
server, without waits. The time by the clock is measured, too. Where the server's processes cannot be seen (another
machine, another system than Linux) all seconds are those of the clock.
"""

import csv
import os
import platform
import resource
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, fields
from multiprocessing import get_context
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self
from unittest.mock import patch

import numpy as np
import psycopg
import scipy
import shapely
from psycopg import sql
from psycopg.conninfo import make_conninfo

import conflictdb
from conflictdb import Area, Scene, Track, store
from conflictdb.embedded import embedded
from conflictdb.jobs import schema

WARM: Final = "strait"  # a scene of the package: warms up whatever is slow the first time
STAGES: Final = ("pieces_s", "stage1_s", "stage2_s", "stage3_s", "stage4_s", "write_s")
# Changes of one object that are detected one by one.
CHANGES: Final = 15
_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
_SAMPLE_S: Final = 0.1
# A sampler looks for at most a fiftieth of its time.
_REST: Final = 50


@dataclass(frozen=True)
class Detection:
    """Counts and times of one detection; see `conflictdb.Run`.

    pieces_s : this and the next to write_s: processor seconds
    write_s : time outside the other stages: conflicts replaced, the run recorded
    total_s : by the clock
    cpu_s, client_s : processor seconds in all, and of this process; cpu_s is None if those of the server are unknown
    """

    candidate_pairs: int
    intersecting_pairs: int
    window_pairs: int
    solved_pairs: int
    conflicts: int
    pieces_s: float
    stage1_s: float
    stage2_s: float
    stage3_s: float
    stage4_s: float
    write_s: float
    total_s: float
    cpu_s: float | None
    client_s: float


@contextmanager
def fresh_database(target: str | None) -> Iterator[str]:
    """Yield the DSN of a new database with the schema and a small scene, on that server or the embedded one.

    It is dropped at the end. The user must be allowed to create databases and extensions.
    """
    name = f"conflictdb_benchmark_{os.getpid()}"
    with ExitStack() as uses:
        # The everyday user of the embedded database may not create databases.
        dsn = target or uses.enter_context(embedded()).admin_dsn
        with psycopg.connect(dsn, autocommit=True) as conn:
            conn.execute(sql.SQL("CREATE DATABASE {}").format(sql.Identifier(name)))
            try:
                own = make_conninfo(dsn, dbname=name)
                schema.upgrade(own)
                with conflictdb.connect(own) as fresh:
                    fresh.load_demo()
                yield own
            finally:
                conn.execute(sql.SQL("DROP DATABASE {} WITH (FORCE)").format(sql.Identifier(name)))


def load(db: conflictdb.Database, scene: Scene, parts: Iterable[tuple[Sequence[Area], Sequence[Track]]]) -> None:
    """Replace a scene by objects that come in parts, and let the server take stock of them as autovacuum would."""
    store.replace_scene_by_parts(db.connection, scene, parts, merge=False)
    db.connection.autocommit = True
    db.connection.execute("VACUUM ANALYZE")
    db.connection.autocommit = False


def detect(db: conflictdb.Database, scene: str, *, full: bool = True, **settings: Any) -> Detection:
    """Detect a scene, and return its counts and times."""
    clock = processor_clock(db.connection)
    began, began_client = time.monotonic(), time.process_time()
    with patch("time.perf_counter", clock or time.perf_counter):
        run = db.scene(scene).detect(full=full, **settings)
    known = asdict(run)
    known["write_s"] = run.total_s - sum(known[stage] for stage in STAGES[:-1])
    known["cpu_s"] = run.total_s if clock else None
    known["client_s"] = time.process_time() - began_client
    known["total_s"] = time.monotonic() - began
    return Detection(**{column.name: known[column.name] for column in fields(Detection)})


def change_one(db: conflictdb.Database, scene: str, times: int, **settings: Any) -> list[Detection]:
    """Repeat: change another track of a scene, commit and detect; return the detections."""
    query = (
        "SELECT track_id FROM conflictdb.track JOIN conflictdb.scene USING (scene_id) WHERE scene.name = %s "
        "ORDER BY track_id LIMIT %s"
    )
    found = []
    for (track_id,) in db.connection.execute(query, [scene, times]).fetchall():
        db.connection.execute("UPDATE conflictdb.track SET floor_m = -1000 WHERE track_id = %s", [track_id])
        db.connection.commit()
        found.append(detect(db, scene, full=False, **settings))
    return found


@dataclass(frozen=True)
class Alone:
    """Times and memory of a process that only detects one scene.

    new : all rows to write
    same : the same again in full; None if not requested
    changed : the median of detections after one change each, right after that
    client_mb, server_mb : peak memory of the process, and of the server meanwhile; None if it cannot be read
    """

    new: Detection
    same: Detection | None
    changed: Detection
    client_mb: float
    server_mb: float | None


def detect_alone(dsn: str, scene: str, *, again: bool, **settings: Any) -> Alone:
    """Detect a scene in a process of its own, after a small one: all rows new, the same again, after changes."""
    with psycopg.connect(dsn) as conn, ServerMemory(server_pid(conn)) as server:
        conn.rollback()
        new, same, changed, client_mb = in_fresh_process(_detections, dsn, scene, again, settings)
    return Alone(new, same, changed, client_mb, server.peak_mb)


def _detections(
    dsn: str, scene: str, again: bool, settings: dict[str, Any]
) -> tuple[Detection, Detection | None, Detection, float]:
    with conflictdb.connect(dsn) as db:
        detect(db, WARM, **settings)
        new = detect(db, scene, **settings)
        same = detect(db, scene, **settings) if again else None
        changed = medians(change_one(db, scene, CHANGES, **settings))
    return new, same, changed, peak_mb()


@contextmanager
def worker(dsn: str | None = None) -> Iterator["subprocess.Popen[bytes]"]:
    """Run a worker that keeps a database current, by default the embedded one; yield its process."""
    where = [] if dsn is None else ["--dsn", dsn]
    command = [sys.executable, "-m", "conflictdb", *where, "worker"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.terminate()


def in_fresh_process(work: Callable[..., Any], *arguments: Any) -> Any:
    """Return the result of a module's function in a new interpreter, which ends then."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def peak_mb() -> float:
    """Return the peak memory of this process, MB.

    On Linux from its own status: ru_maxrss includes the size of the process that started this program.
    """
    with suppress(OSError):
        status = Path("/proc/self/status").read_text().splitlines()
        return int(next(line for line in status if line.startswith("VmHWM:")).split()[1]) / 1e3
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)


def server_pid(conn: psycopg.Connection[Any]) -> int | None:
    """Return the process that all of a server's others come from, None where it cannot be seen: another machine's."""
    with suppress(OSError):
        return _parent(conn.info.backend_pid)
    return None


def backend_clock(conn: psycopg.Connection[Any]) -> Callable[[], float]:
    """Return a clock of the processor seconds of a connection's backend, on this machine."""
    running = Path(f"/proc/{conn.info.backend_pid}/schedstat")
    return lambda: int(running.read_text().split()[0]) / 1e9


def seconds_of(pid: int) -> float:
    """Return the processor seconds of a process on this machine."""
    ticks = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(map(int, ticks)) / _TICKS_PER_S


def processor_clock(conn: psycopg.Connection[Any]) -> Callable[[], float] | None:
    """Return a clock of the processor seconds of this process and a connection's backend, None where that is unknown.

    Processes that the backend started to help it count when they have ended; so do all others of the server that end.
    """
    server = server_pid(conn)
    if server is None:
        return None
    running, helpers = backend_clock(conn), Path(f"/proc/{server}/stat")

    def seconds() -> float:
        ticks = sum(int(text) for text in helpers.read_text().rpartition(")")[2].split()[13:15])
        return time.process_time() + running() + ticks / _TICKS_PER_S

    return seconds


def _parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def _children(pid: int) -> list[int]:
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):
                if _parent(int(entry.name)) == pid:
                    found.append(int(entry.name))
    return found


class Sampler:
    """Looks at something by a thread of its own, again and again while its block lasts."""

    def __init__(self, every_s: float) -> None:
        self._every_s, self._done = every_s, threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        while True:
            began = time.thread_time()
            self._look()
            # A look at a machine of many processes would take a seventh of a processor from what is measured.
            if self._done.wait(max(self._every_s, _REST * (time.thread_time() - began))):
                return

    def _look(self) -> None:
        raise NotImplementedError


class ServerMemory(Sampler):
    """Samples the memory of a server's processes together; shared memory is counted once (PSS).

    peak_mb : the largest sample; None if there was none
    """

    def __init__(self, pid: int | None) -> None:
        super().__init__(_SAMPLE_S)
        self.peak_mb: float | None = None
        self._pid = pid

    def _look(self) -> None:
        held_kb = 0
        for child in _children(self._pid) if self._pid is not None else ():
            with suppress(OSError):
                lines = Path(f"/proc/{child}/smaps_rollup").read_text().splitlines()
                held_kb += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
        if held_kb:
            self.peak_mb = max(self.peak_mb or 0.0, held_kb / 1e3)


def medians(found: Sequence[Detection]) -> Detection:
    """Return the medians of some detections, column by column; counts too."""
    columns: dict[str, Any] = {}
    for column in fields(Detection):
        known = [value for one in found if (value := getattr(one, column.name)) is not None]
        median = statistics.median(known) if known else None
        columns[column.name] = int(median) if median is not None and isinstance(known[0], int) else median
    return Detection(**columns)


def versions(conn: psycopg.Connection[Any]) -> str:
    """Return in a line the measured software and machine."""
    service = store.service(conn)
    conn.rollback()
    return (
        f"conflictdb {conflictdb.__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"scipy {scipy.__version__}, shapely {shapely.__version__} (GEOS {shapely.geos_version_string}), "
        f"PostgreSQL {service.server_version}, PostGIS {service.postgis_version}, {platform.system()} "
        f"{platform.machine()}, {os.cpu_count()} processors"
    )


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows that have the same columns, numbers with four digits that count."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: _short(value) for name, value in row.items()})


def _short(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value


def read_csv(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a CSV, numbers as numbers and empty cells as None."""
    with path.open(newline="") as file:
        return [{name: _value(text) for name, text in row.items()} for row in csv.DictReader(file)]


def _value(text: str) -> Any:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text or None
