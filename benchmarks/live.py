"""Positions against plans: how soon after a commit what follows from a position is known, and what it costs.

    ./.venv/bin/python benchmarks/live.py [--plans 20000] [--rate 1000] [--seconds 60] [--target DSN]

A sea of plans under way; its ships report in turn, a tenth of a second's worth in each transaction. Meanwhile two in a
hundred become 20 minutes late, or go three miles off their plans. One process inserts positions, an editor moves a plan
a second, and a worker (`conflictdb worker`) does all the rest.

Printed: alarms, the time from the commit of the position to the notification of its alarm, and processor time a
position of the worker and its session.
"""

import argparse
import json
import os
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
import psycopg
from made_scenes import sea
from measured import fresh_database, load, seconds_of, worker
from numpy.typing import NDArray

import conflictdb
from conflictdb import Scene, Track, store
from conflictdb.model.recurring_plans import later

LATE_US = 20 * 60 * 1_000_000
OFF_DEG = 0.05
STRAYING = 0.02
DELAYS_WITHIN_S = 1800.0
# An alarm of the last position may come so much later, seconds.
LAST_S = 5.0


@dataclass
class Sea:
    """Ships, those that will stray and from when on, and when the last position of each was committed.

    late, off : (n,) whether a ship will be late, or off its plan
    from_s : (n,) when that begins, seconds after the begin
    """

    plans: list[Track]
    late: NDArray[np.bool_]
    off: NDArray[np.bool_]
    from_s: NDArray[np.float64]
    at_s: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, plans: list[Track], seconds: float) -> "Sea":
        """Return a sea in which some ships begin to stray within a time."""
        rng = np.random.default_rng(50)
        strays, is_off = rng.random(len(plans)) < STRAYING, rng.random(len(plans)) < 0.5
        return cls(plans, strays & ~is_off, strays & is_off, seconds * rng.random(len(plans)))

    def report(self, conn: psycopg.Connection[Any], some: NDArray[np.int64], after_s: float) -> None:
        """Insert positions of some ships, in a transaction, some seconds after the begin."""
        now_us, strays = time.time_ns() // 1000, self.from_s[some] <= after_s
        late_us = np.where(self.late[some] & strays, LATE_US, 0)
        places = np.array(
            [_at(self.plans[i], now_us - by_us) for i, by_us in zip(some.tolist(), late_us.tolist(), strict=True)]
        )
        places[:, 1] += np.where(self.off[some] & strays, OFF_DEG, 0.0)
        keys = [self.plans[i].key for i in some.tolist()]
        with store.transaction(conn):
            store.insert_positions(conn, "live", keys, np.full(len(some), now_us), places)
        self.at_s.update(dict.fromkeys(keys, time.monotonic()))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plans", type=int, default=20_000)
    parser.add_argument("--rate", type=int, default=1_000, help="positions a second")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--target", metavar="DSN")
    args = parser.parse_args()
    with fresh_database(args.target) as dsn:
        plans = under_way(args.plans)
        with conflictdb.connect(dsn) as db:
            load(db, Scene("live", delays_within_s=DELAYS_WITHIN_S), [([], plans)])
            began_s = time.monotonic()
            run = db.scene("live").detect()
            print(f"{len(plans):,} plans, {run.conflicts:,} conflicts as planned, {time.monotonic() - began_s:.1f} s")
        print(measured(dsn, Sea.of(plans, 0.8 * args.seconds), args.rate, args.seconds))


def under_way(count: int) -> list[Track]:
    """Return tracks of the sea, each halfway now."""
    now_us = time.time_ns() // 1000
    tracks = [track for _, some in sea(2 * count, 50) for track in some][:count]
    return [later(one, now_us - int(one.times_us[0] + one.times_us[-1]) // 2) for one in tracks]


def measured(dsn: str, ships: Sea, rate: int, seconds: float) -> str:
    """Feed positions to a worker; return the figures in lines."""
    done, waited_s = threading.Event(), list[float]()
    with store.connect(dsn) as conn, worker(dsn) as process:
        began_s = time.monotonic()
        ships.report(conn, np.arange(len(ships.plans)), -1.0)
        while _value(conn, "SELECT count(*) FROM conflictdb.live_state") < len(ships.plans):
            time.sleep(0.1)
        first = f"{len(ships.plans):,} positions at once: {time.monotonic() - began_s:.1f} s"
        session = _value(conn, "SELECT pid FROM pg_stat_activity WHERE application_name = 'conflictdb worker'")
        pids = {"the worker": process.pid, "its session": session}
        before_s = {name: seconds_of(pid) for name, pid in pids.items()}
        others = [
            threading.Thread(target=_listen, args=(dsn, ships, waited_s, done)),
            threading.Thread(target=_edit, args=(dsn, ships.plans, done)),
        ]
        for one in others:
            one.start()
        count, began_s = 0, time.monotonic()
        while (after_s := time.monotonic() - began_s) < seconds:
            batch = max(1, rate // 10)
            ships.report(conn, np.arange(count, count + batch) % len(ships.plans), after_s)
            count += batch
            time.sleep(max(0.0, began_s + count / rate - time.monotonic()))
        lasted_s = time.monotonic() - began_s
        time.sleep(LAST_S)
        done.set()
        for one in others:
            one.join()
        costs = {name: 1e6 * (seconds_of(pid) - before_s[name]) / count for name, pid in pids.items()}
        must = _value(conn, "SELECT count(*) FROM conflictdb.live_conflicts WHERE verdict = 'must'")
    half, most = np.percentile(waited_s, [50, 99])
    within = np.mean(np.array(waited_s) <= 1.0)
    lines = [
        first,
        f"{count:,} positions, {count / lasted_s:,.0f} a second, load {os.getloadavg()[0]:.1f}",
        "processor time a position: " + ", ".join(f"{cost_us:.0f} us of {name}" for name, cost_us in costs.items()),
        f"{len(waited_s):,} alarms, {must:,} must at the end",
        f"notified after {half:.2f} s (median), {most:.2f} s (99 %); {within:.1%} within a second",
    ]
    return "\n".join(lines)


def _value(conn: psycopg.Connection[Any], query: str) -> int:
    with store.transaction(conn):
        (value,) = conn.execute(query).fetchone() or (0,)
    return int(value)


def _listen(dsn: str, ships: Sea, waited_s: list[float], done: threading.Event) -> None:
    """Note how long after the commit of a position of a ship that strays its alarms begin."""
    strays = {ships.plans[i].key for i in np.flatnonzero(ships.late | ships.off).tolist()}
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute("LISTEN conflictdb_alarm")
        while not done.is_set():
            for note in conn.notifies(timeout=0.2):
                alarm, now_s = json.loads(note.payload), time.monotonic()
                known_s = [ships.at_s[key] for key in alarm["keys"] if key in strays]
                if alarm["kind"] == "begun" and known_s:
                    waited_s.append(now_s - max(known_s))


def _edit(dsn: str, plans: list[Track], done: threading.Event) -> None:
    """Move a plan by a minute, once a second."""
    rng = np.random.default_rng(51)
    with conflictdb.connect(dsn) as db:
        while not done.wait(1.0):
            db.scene("live").put(later(plans[int(rng.integers(len(plans)))], 60_000_000))


def _at(track: Track, at_us: int) -> tuple[float, float]:
    """Return about where a track is."""
    lon, lat = (np.interp(at_us, track.times_us, track.positions_deg[:, k]) for k in (0, 1))
    return float(lon), float(lat)


if __name__ == "__main__":
    main()
