"""An hour of ship traffic in the Skagerrak (AIS), each ship a rectangle of its own length and width.

    ./.venv/bin/python benchmarks/skagerrak_ais.py [--method nlp] [--separation-m 500] [--jobs 2]

Ships: BSH, 2022-11-01 09:35-10:35 UTC. What the loader leaves out of the dirty rows is printed by name.
"""

import argparse
import time
from collections import Counter
from datetime import UTC, datetime

from data import real_input
from report import report

import conflictdb

FASTEST_KN = 60.0


def main() -> None:
    """Load, detect, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="database (default: the embedded one)")
    parser.add_argument("--method", default="exact", choices=[*map(str, conflictdb.Method)])
    parser.add_argument("--separation-m", type=float, default=0.0)
    parser.add_argument("--jobs", type=int)
    args = parser.parse_args()
    path = real_input("ais-skagerrak", "ais.csv.gz")
    with conflictdb.connect(args.dsn) as db:
        started = time.perf_counter()
        (loaded,) = db.load_files([path], "skagerrak", max_speed_kn=FASTEST_KN)
        (state,) = (status for status in db.scenes() if status.scene.name == "skagerrak")
        print(f"{state.tracks} ships loaded in {time.perf_counter() - started:.1f} s")
        for reason, count in Counter(skip.reason for skip in loaded.skipped).most_common():
            print(f"left out: {count} x {reason}")
        run = db.detect("skagerrak", method=args.method, separation_m=args.separation_m, full=True, jobs=args.jobs)
        print(f"{datetime.now(UTC):%Y-%m-%d}, method {args.method}, separation {args.separation_m:g} m")
        report(db, "skagerrak", run)
        for c in db.conflicts("skagerrak")[:12]:
            when = f"{c.first_contact:%H:%M:%S} to {c.last_contact:%H:%M:%S}"
            print(f"  {c.a_key} - {c.b_key}: {c.verdict}, {len(c.periods)} periods, {when}")


if __name__ == "__main__":
    main()
