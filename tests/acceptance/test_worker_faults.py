"""Two workers at work while processes, connections and the server are ended at random moments.

Whatever happens: no committed change is lost, no conflict is missing or duplicated, and the scene becomes current again
by itself. Each round makes a change, ends something a random time later, and compares the next current answer with that
of `solve`.
"""

import os
import random
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import psycopg
import pytest
import shapely
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from own_server import OwnServer, own_server
from patience import WAIT_S, patient_command
from psycopg.conninfo import make_conninfo
from verdicts import by_pair, solved

from conflictdb import store
from conflictdb.errors import ConflictDBError
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Scene, Track

WORKERS = 2
# A detection of one change begins and ends within this time after the change, on the whole.
LONGEST_S = 0.25
# Short, but long enough for the work of a worker outside of a detection; on a slow machine it is doubled until it is.
LIMIT_MS = 300
DOUBLED_AFTER_S = 5.0
LIMITS = ("statement_timeout", "lock_timeout", "idle_in_transaction_session_timeout")
# Room for a server with one scene, and for part of its write-ahead log.
DISK_MB = 400


@dataclass
class Site:
    """A server, a scene on it, and workers that keep it current.

    areas : as they were last acknowledged, by key
    """

    server: OwnServer
    log: Path
    rng: random.Random
    scene: Scene
    areas: dict[str, Area]
    tracks: list[Track]
    workers: "list[subprocess.Popen[bytes]]" = field(default_factory=list)

    def start_worker(self) -> None:
        words = ["--dsn", self.server.dsn, "worker", "--jobs", "1", "--every", "2s"]
        with self.log.open("ab") as log:
            self.workers.append(subprocess.Popen(patient_command(*words), stdout=log, stderr=subprocess.STDOUT))

    def replace_worker(self) -> None:
        """Start a worker when the backend of the former worker is gone, and wait until it is connected."""
        with psycopg.connect(self.server.dsn, autocommit=True) as conn:
            self.backends(conn)
            self.start_worker()
            self.backends(conn)

    def moved(self, but: str = "") -> Area:
        """Return a random area, except that of a given key, at another place."""
        area = self.areas[self.rng.choice(sorted(self.areas.keys() - {but}))]
        by = self.rng.uniform(-0.1, 0.1)
        return replace(area, footprint=shapely.transform(area.footprint, lambda lonlat: lonlat + by))

    def change(self, but: str = "") -> None:
        """Move one area, another than that of a key; it is committed, whatever limits sessions have by default."""
        moved = self.moved(but)
        with store.connect(make_conninfo(self.server.dsn, options=" ".join(f"-c {name}=0" for name in LIMITS))) as conn:
            store.replace_scene(conn, self.scene, [moved], [], merge=True)
        self.areas[moved.key] = moved

    def await_current(self) -> None:
        """Wait until workers have seen to all that is committed."""
        with psycopg.connect(self.server.dsn, autocommit=True) as conn:
            conn.execute("SELECT conflictdb.wait_until_current('s', %s)", [timedelta(seconds=WAIT_S)])

    def backends(self, conn: psycopg.Connection[Any]) -> list[int]:
        """Return the backends that serve workers, as soon as exactly the present workers are connected.

        A worker whose first connection fails ends, as it should; one that has stamped connects again.
        """
        end = time.monotonic() + WAIT_S
        query = "SELECT pid FROM conflictdb.worker_stamp JOIN pg_stat_activity USING (pid)"
        while len(found := conn.execute(query).fetchall()) != len(self.workers):
            assert [worker.poll() for worker in self.workers] == [None] * len(self.workers), self.log.read_text()
            assert time.monotonic() < end
            conn.execute("SELECT pg_stat_clear_snapshot(), pg_sleep(0.05)")
        return [pid for (pid,) in found]

    def check(self) -> None:
        """Wait until the scene is current; compare it with the acknowledged changes, and its conflicts with `solve`."""
        self.await_current()
        with psycopg.connect(self.server.dsn, autocommit=True) as conn:
            assert conn.execute("SELECT * FROM conflictdb.queue").fetchall() == []
            twice = """SELECT object_kind, object_id, part, turn, span FROM conflictdb.piece
                       GROUP BY 1, 2, 3, 4, 5 HAVING count(*) > 1"""
            assert conn.execute(twice.encode()).fetchall() == []
        with store.connect(self.server.dsn) as conn:
            scene, areas, tracks = store.read_scene(conn, "s")
            assert {area.key: area.footprint for area in areas} == {k: a.footprint for k, a in self.areas.items()}
            rows = store.conflicts(conn, "s")
        found, expected = by_pair(rows), solved(scene, areas, tracks)
        assert len(found) == len(rows)
        assert found.keys() == expected.keys()
        for pair, answer in expected.items():
            assert found[pair] == replace(answer, time_error_s=found[pair].time_error_s)
        assert all(row.is_current for row in rows)

    def check_in_full(self) -> None:
        """Nothing is found by a detection in full that was not there."""
        with store.connect(self.server.dsn) as conn:
            run = detect(conn, "s", full=True, jobs=1)
        assert (run.opened, run.changed, run.closed) == (0, 0, 0)
        assert run.conflicts > 0


@contextmanager
def at_work(server: OwnServer, log: Path) -> Iterator[Site]:
    """Two workers, and a scene that they have detected."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 2, 16, 16)
    rng = random.Random(7)  # noqa: S311
    site = Site(server, log, rng, replace(scene, name="s"), {area.key: area for area in areas}, tracks)
    with store.connect(server.dsn) as conn:
        store.replace_scene(conn, site.scene, areas, tracks, merge=False)
    try:
        for _ in range(WORKERS):
            site.replace_worker()
        site.check()
        yield site
    finally:
        for worker in site.workers:
            worker.kill()
            worker.wait()


@pytest.fixture(scope="module")
def site(server_dsn: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Return a site of the module's own; the server for tests makes sure that its programs are installed."""
    with own_server() as server, at_work(server, tmp_path_factory.mktemp("workers") / "log") as site:
        yield site


def kill_worker(site: Site) -> None:
    victim = site.workers.pop(site.rng.randrange(len(site.workers)))
    victim.kill()
    victim.wait()
    site.replace_worker()


def end_worker(site: Site) -> None:
    victim = site.workers.pop(site.rng.randrange(len(site.workers)))
    victim.send_signal(signal.SIGTERM)
    assert victim.wait(WAIT_S) == 0
    site.replace_worker()


def kill_backend(site: Site) -> None:
    """The server ends all other sessions too, and recovers."""
    with psycopg.connect(site.server.dsn, autocommit=True) as conn:
        (pid, *_) = site.backends(conn)
        os.kill(pid, signal.SIGKILL)
        with pytest.raises(psycopg.OperationalError):
            conn.execute("SELECT pg_sleep(60)")
    site.server.await_answer()


def crash_server(site: Site) -> None:
    with psycopg.connect(site.server.dsn, autocommit=True) as conn:
        site.backends(conn)
    site.server.stop(signal.SIGQUIT)
    site.server.start()


def lose_connections(site: Site) -> None:
    with psycopg.connect(site.server.dsn, autocommit=True) as conn:
        for pid in site.backends(conn):
            conn.execute("SELECT pg_terminate_backend(%s)", [pid])


def limit_times(site: Site) -> None:
    """Sessions that begin now have short limits, and a lock keeps the detection for longer than these."""
    waits = "SELECT FROM pg_stat_activity WHERE application_name = %s AND wait_event_type = 'Lock'"
    with psycopg.connect(site.server.dsn, autocommit=True) as admin, psycopg.connect(site.server.dsn) as conn:
        limit_ms = LIMIT_MS

        def limit() -> None:
            for name in LIMITS:
                admin.execute(f"ALTER DATABASE conflictdb SET {name} = '{limit_ms}'".encode())

        try:
            limit()
            lose_connections(site)
            conn.execute("LOCK conflictdb.piece")
            site.change()
            began_s = doubled_s = time.monotonic()
            while not admin.execute(waits, [store.WORKER_NAME]).rowcount:
                assert time.monotonic() < began_s + WAIT_S, site.log.read_text()
                if time.monotonic() > doubled_s + DOUBLED_AFTER_S:
                    limit_ms, doubled_s = 2 * limit_ms, time.monotonic()
                    limit()
                time.sleep(0.05)
            time.sleep(2e-3 * limit_ms)
        finally:
            admin.execute("ALTER DATABASE conflictdb RESET ALL")


def detect_twice(site: Site) -> None:
    """Two sessions detect all of the scene at once, while workers detect changes."""

    def once() -> None:
        with store.connect(site.server.dsn) as conn:
            detect(conn, "s", full=True, jobs=1, say=lambda _: None)

    with ThreadPoolExecutor(2) as pool:
        both = [pool.submit(once) for _ in range(2)]
        site.change()
        for one in both:
            one.result(WAIT_S)


def edit_for_long(site: Site) -> None:
    """An edit is not committed before workers have seen to later ones: neither waits for the other."""
    with psycopg.connect(site.server.dsn) as conn:
        moved = site.moved()
        conn.execute(
            "UPDATE conflictdb.area SET footprint = ST_GeomFromWKB(%s, 4326) WHERE key = %s",
            [shapely.to_wkb(moved.footprint), moved.key],
        )
        site.change(but=moved.key)
        site.await_current()
    site.areas[moved.key] = moved


def put_clock_back(site: Site) -> None:
    """All that was written, was written by a clock that was an hour ahead."""
    with psycopg.connect(site.server.dsn) as conn:
        conn.execute("UPDATE conflictdb.change SET changed_at = changed_at + interval '1 hour'")
        for column in ("started_at", "finished_at"):
            conn.execute(f"UPDATE conflictdb.run SET {column} = {column} + interval '1 hour'".encode())


FAULTS = [
    *(kill_worker, end_worker, kill_backend, crash_server, lose_connections),
    *(limit_times, put_clock_back, detect_twice, edit_for_long),
]


def rounds(site: Site, fault: Callable[[Site], None], count: int) -> None:
    for _ in range(count):
        site.change()
        time.sleep(site.rng.uniform(0.0, LONGEST_S))
        fault(site)
        site.check()
    site.check_in_full()


@pytest.mark.parametrize("fault", FAULTS)
def test_the_scene_becomes_current_again(site: Site, fault: Callable[[Site], None]) -> None:
    rounds(site, fault, 1)


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_the_scene_becomes_current_again_a_hundred_times(site: Site, fault: Callable[[Site], None]) -> None:
    rounds(site, fault, 100)


@pytest.fixture
def small_disk() -> Iterator[Path]:
    """Return a directory on a disk of its own, which soon is full."""
    place = Path(tempfile.mkdtemp(prefix="conflictdb-disk-"))
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m,mode=755", "tmpfs", place], capture_output=True, check=False
    )
    try:
        if mounted.returncode:
            pytest.skip(f"a full disk was not tried: no tmpfs can be mounted: {mounted.stderr.decode().strip()}")
        yield place
    finally:
        if not mounted.returncode:
            subprocess.run(["umount", place], check=True)
        place.rmdir()


def has_room(site: Site) -> bool:
    """Make a change; return whether there was room for it."""
    try:
        site.change()
    except ConflictDBError:
        return False
    return True


@pytest.mark.slow
def test_a_full_disk_loses_nothing(server_dsn: str, small_disk: Path, tmp_path: Path) -> None:
    """Changes and detections fail while it is full, and the server may end; when there is room again all goes on."""
    ballast = small_disk / "ballast"
    with own_server(small_disk) as server, at_work(server, tmp_path / "log") as site:
        for _ in range(5):
            with suppress(OSError), ballast.open("wb", buffering=0) as file:
                while True:
                    file.write(bytes(2**16))
            while has_room(site):
                pass
            time.sleep(site.rng.uniform(0.0, 4 * LONGEST_S))
            ballast.unlink()
            if not server.is_running():
                server.start()
            site.check()
        site.check_in_full()
