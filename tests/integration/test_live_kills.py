"""Workers are killed while they look at positions: no position is lost, and no alarm begins or ends twice."""

import json
import multiprocessing
import os
import random
import signal
import time
from collections import defaultdict
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from itertools import takewhile
from typing import Any

import psycopg
import pytest
from patience import WAIT_S

from conflictdb import Scene, Track, store
from conflictdb.jobs import detect
from conflictdb.jobs.worker import Worker
from conflictdb.model.plans import rectangle_outline_m

FERRIES = 5


def plans(began: datetime) -> list[Track]:
    """Return ferries and tows: ferry n passes its crossing 10 minutes before tow n, a mile a minute."""

    def us(minute: float) -> int:
        return int((began + timedelta(minutes=minute)).timestamp() * 1e6)

    found = []
    for n in range(FERRIES):
        for key, ends, start in (
            (f"FERRY {n}", [(0.0, n), (1.0, n)], 0),
            (f"TOW {n}", [(0.5, n - 0.5), (0.5, n + 0.5)], 10),
        ):
            found.append(Track(key, ends, [us(start), us(start + 60)], rectangle_outline_m(500, 500, 500, 500)))
    return found


def work(dsn: str) -> None:
    """Run a worker until it is killed."""
    with suppress(Exception):
        Worker(connect=lambda: store.connect(dsn), report=lambda *_: None, heard_within_s=0.1).run()


@pytest.mark.parametrize("kills", [3, pytest.param(100, marks=pytest.mark.slow)])
def test_killed_workers_lose_no_position_and_repeat_no_alarm(dsn: str, kills: int) -> None:
    """Ferries are in turn 10 minutes late, which meets a tow, and on plan."""
    began = datetime.now(UTC).replace(microsecond=0) - timedelta(minutes=30)  # workers look at the clock
    chance, context = random.Random(50), multiprocessing.get_context("forkserver")  # noqa: S311
    context.set_forkserver_preload(["conflictdb.jobs.worker"])
    with store.connect(dsn) as feed, psycopg.connect(dsn, autocommit=True) as listener:
        store.replace_scene(feed, Scene("s", delays_within_s=3600), [], plans(began), merge=False)
        feed.commit()
        detect.detect(feed, "s", jobs=1)
        listener.execute("LISTEN conflictdb_alarm")
        last: dict[str, datetime] = {}
        count = 0

        def report(some: int) -> None:
            """Insert positions, one after the other."""
            nonlocal count
            for _ in range(some):
                key, minute = f"FERRY {count % FERRIES}", 22 + count / 500
                late = 10 if count // FERRIES % 4 >= 2 else 0
                last[key] = began + timedelta(minutes=minute)
                feed.execute(
                    "INSERT INTO conflictdb.position (scene, key, instant, place) "
                    "VALUES ('s', %s, %s, ST_SetSRID(ST_MakePoint(%s, %s), 4326))",
                    [key, last[key], (minute - late) / 60, count % FERRIES],
                )
                feed.commit()
                count += 1

        for _ in range(kills):
            process = context.Process(target=work, args=(dsn,))
            process.start()
            until_s = time.monotonic() + WAIT_S
            looked = _looks(feed)
            report(FERRIES)
            while _looks(feed) == looked and process.is_alive():  # it works
                assert time.monotonic() < until_s
                time.sleep(0.005)
            for _ in range(chance.randrange(4)):
                report(chance.randrange(1, FERRIES))
                time.sleep(chance.uniform(0.0, 0.02))
            assert process.pid is not None
            os.kill(process.pid, signal.SIGKILL)
            process.join()
        while count % FERRIES or (count - 1) // FERRIES % 4 < 2:  # all are late in the end
            report(1)
        process = context.Process(target=work, args=(dsn,))
        process.start()
        try:
            until_s = time.monotonic() + WAIT_S
            while _instants(feed) != last:
                assert time.monotonic() < until_s
                time.sleep(0.01)
        finally:
            process.kill()
            process.join()
        alarms: dict[Any, list[tuple[str, int]]] = defaultdict(list)
        feed.execute("NOTIFY conflictdb_alarm, 'end'")  # comes after all others
        feed.commit()
        for note in takewhile(lambda one: one.payload != "end", listener.notifies(timeout=WAIT_S)):
            said = json.loads(note.payload)
            alarms[tuple(said["keys"])].append((said["kind"], said["alarm"]))
    for events in alarms.values():
        kinds, numbers = [kind for kind, _ in events], [number for _, number in events]
        assert kinds == ["begun", "ended"] * (len(kinds) // 2) + ["begun"] * (len(kinds) % 2)
        assert numbers[::2][: len(numbers[1::2])] == numbers[1::2]
        assert len(set(numbers[::2])) == len(numbers[::2])
    assert sum(map(len, alarms.values())) >= kills


def _looks(conn: psycopg.Connection[Any]) -> Any:
    """Return what the last look saw."""
    with store.transaction(conn):
        return conn.execute("SELECT seen::text FROM conflictdb.position_look").fetchone()


def _instants(conn: psycopg.Connection[Any]) -> dict[str, datetime]:
    with store.transaction(conn):
        return dict(conn.execute("SELECT key, instant FROM conflictdb.live WHERE key LIKE 'FERRY%'").fetchall())
