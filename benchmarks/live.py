"""Positions against plans: how soon after a commit what follows from a position is stored.

    ./.venv/bin/python benchmarks/live.py [--plans 20000] [--rate 1000] [--seconds 60] [--target DSN]

A sea of plans under way; its ships report in turn, a tenth of a second's worth in each transaction. Most are where
their plan says; two in a hundred are 20 minutes late, or three miles off. One session inserts, another looks as a
worker does. Printed: positions, those a second that a look takes, alarms, and the time from commit to stored state.
"""

import argparse
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from made_scenes import sea
from measured import fresh_database, load

import conflictdb
from conflictdb import Scene, Track, store
from conflictdb.jobs.looks import Looks
from conflictdb.model.recurring_plans import later

LATE_US = 20 * 60 * 1_000_000
OFF_DEG = 0.05
STRAYING = 0.02
DELAYS_WITHIN_S = 1800.0


@dataclass
class Fed:
    """What was committed: how many positions, and when."""

    counts: list[int] = field(default_factory=list)
    at_s: list[float] = field(default_factory=list)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plans", type=int, default=20_000)
    parser.add_argument("--rate", type=int, default=1_000, help="positions a second")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--target", metavar="DSN")
    args = parser.parse_args()
    with fresh_database(args.target) as dsn, conflictdb.connect(dsn) as db:
        plans = under_way(args.plans)
        load(db, Scene("live", delays_within_s=DELAYS_WITHIN_S), [([], plans)])
        began_s = time.monotonic()
        run = db.scene("live").detect()
        print(f"{len(plans):,} plans, {run.conflicts:,} conflicts as planned, {time.monotonic() - began_s:.1f} s")
        print(watched(dsn, plans, args.rate, args.seconds))


def under_way(count: int) -> list[Track]:
    """Return tracks of the sea, each halfway now."""
    now_us = time.time_ns() // 1000
    tracks = [track for _, some in sea(2 * count, 50) for track in some][:count]
    return [later(one, now_us - int(one.times_us[0] + one.times_us[-1]) // 2) for one in tracks]


def watched(dsn: str, plans: list[Track], rate: int, seconds: float) -> str:
    """Feed positions and look at them; return the figures in a line."""
    fed, looks, looking_s, done = Fed(), Looks(), 0.0, 0
    delays_s: list[float] = []
    feed = threading.Thread(target=_feed, args=(dsn, plans, rate, seconds, fed))
    with store.connect(dsn) as conn:
        feed.start()
        while feed.is_alive() or done < sum(fed.counts):
            began_s = time.monotonic()
            read = looks.look(conn, time.time_ns() // 1000, is_silence_due=False)
            if not read:
                time.sleep(0.02)
                continue
            looking_s += time.monotonic() - began_s
            done += read
            while len(delays_s) < len(fed.counts) and sum(fed.counts[: len(delays_s) + 1]) <= done:
                delays_s.append(time.monotonic() - fed.at_s[len(delays_s)])
        feed.join()
        row = conn.execute("SELECT count(*), count(*) FILTER (WHERE verdict = 'must') FROM conflictdb.live_conflicts")
        alarms, must = row.fetchone() or (0, 0)
    half, most = np.percentile(delays_s, [50, 99])
    return (
        f"{done:,} positions, {done / looking_s:,.0f} a second of looking; {alarms:,} alarms, {must:,} must; "
        f"stored after {half:.2f} s (median), {most:.2f} s (99 %)"
    )


def _feed(dsn: str, plans: list[Track], rate: int, seconds: float, fed: Fed) -> None:
    """Insert positions at a rate."""
    rng = np.random.default_rng(50)
    strays = rng.random(len(plans)) < STRAYING
    is_off = rng.random(len(plans)) < 0.5
    batch, turn, began_s = max(1, rate // 10), 0, time.monotonic()
    with store.connect(dsn) as conn:
        while time.monotonic() - began_s < seconds:
            some = np.arange(turn, turn + batch) % len(plans)
            now_us = time.time_ns() // 1000
            late_us = np.where(strays & ~is_off, LATE_US, 0)[some]
            places = np.array([_at(plans[i], now_us - late) for i, late in zip(some, late_us.tolist(), strict=True)])
            places[:, 1] += np.where(strays & is_off, OFF_DEG, 0.0)[some]
            with store.transaction(conn):
                store.insert_positions(conn, "live", [plans[i].key for i in some], np.full(len(some), now_us), places)
            fed.at_s.append(time.monotonic())
            fed.counts.append(len(some))
            turn += batch
            time.sleep(max(0.0, began_s + turn / rate - time.monotonic()))


def _at(track: Track, at_us: int) -> tuple[float, float]:
    """Return about where a track is."""
    lon, lat = (np.interp(at_us, track.times_us, track.positions_deg[:, k]) for k in (0, 1))
    return float(lon), float(lat)


if __name__ == "__main__":
    main()
