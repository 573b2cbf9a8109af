"""Real data: a day of flights over Switzerland against the drone zones, an hour of ship traffic in the Skagerrak.

    ./.venv/bin/python benchmarks/real_runs.py [--only swiss-day ais-hour ais-hour-500m] [--method exact] [--jobs 2]
        [--flights 200] [--dsn DSN] [--document docs/explanation/real-runs.md]

The data is in CONFLICTDB_DATA. The conflicts are compared with those of earlier releases: a difference is printed, and
ends the program with an error. Seconds of stages are processor seconds of client and server (measured.py).
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from measured import STAGES, WARM, Detection, detect, fresh_database, peak_mb, versions
from skagerrak_ais import load_hour
from swiss_flights import load_day
from tables import markdown, show

import conflictdb
from conflictdb import Method

# Conflicts of method exact, by verdict: the same in every release so far.
KNOWN: Final = {
    "swiss-day": {"conflict": 17_462, "grazing": 167},
    "ais-hour": {"conflict": 26, "grazing": 6},
    "ais-hour-500m": {"conflict": 981, "grazing": 2},
}
SEPARATION_M: Final = {"ais-hour-500m": 500.0}


@dataclass(frozen=True)
class RealRun:
    """Content, cost and conflicts of one scene of real data.

    holds : its content, in a line
    load_s : seconds by the clock, from files to rows
    new, same : the first detection, and the same again in full
    verdicts, kinds : conflicts by verdict and by the kinds of their objects
    bound_s : the median and the widest bound on times, seconds, of pairs with a track
    client_mb : peak memory of this process so far, MB
    """

    name: str
    holds: str
    load_s: float
    new: Detection
    same: Detection
    verdicts: dict[str, int]
    kinds: dict[str, int]
    bound_s: tuple[float, float]
    client_mb: float


def measure(db: conflictdb.Database, name: str, flights: int | None, **settings: Any) -> RealRun:
    """Load and detect one scene."""
    loaders: dict[str, Callable[[], str]] = {
        "swiss-day": lambda: load_day(db, name, flights),
        "ais-hour": lambda: load_hour(db, name),
        "ais-hour-500m": lambda: load_hour(db, name),
    }
    detect(db, WARM, **settings)
    began = time.monotonic()
    holds = loaders[name]()
    load_s = time.monotonic() - began
    settings["separation_m"] = SEPARATION_M.get(name, 0.0)
    new, same = (detect(db, name, **settings) for _ in range(2))
    found = db.scene(name).conflicts()
    bounds = [c.time_error_s for c in found if c.b_kind == "track"]
    return RealRun(
        name,
        holds,
        load_s,
        new,
        same,
        dict(Counter(str(c.verdict) for c in found).most_common()),
        dict(Counter(f"{c.a_kind}-{c.b_kind}" for c in found).most_common()),
        (float(np.median(bounds)), max(bounds)) if bounds else (0.0, 0.0),
        peak_mb(),
    )


def table(runs: list[RealRun]) -> str:
    """Return a table in Markdown, a column for each scene."""

    def counted(counts: dict[str, int]) -> str:
        return ", ".join(f"{count:,} `{name}`" for name, count in counts.items())

    rows: list[tuple[str, Callable[[RealRun], str]]] = [
        ("written and loaded, s", lambda run: f"{run.load_s:.1f}"),
        ("candidates", lambda run: f"{run.new.candidate_pairs:,}"),
        ("hulls meet", lambda run: f"{run.new.intersecting_pairs:,}"),
        ("pairs solved", lambda run: f"{run.new.solved_pairs:,}"),
        ("conflicts", lambda run: f"{run.new.conflicts:,}: {counted(run.verdicts)}"),
        ("between", lambda run: counted(run.kinds)),
        ("bound on times: median, widest", lambda run: f"{run.bound_s[0]:.1e} s, {run.bound_s[1]:.2g} s"),
        ("detected, s", lambda run: f"{run.new.total_s:.1f}"),
        ("processor, s", lambda run: "" if run.new.cpu_s is None else f"{run.new.cpu_s:.1f}"),
        *(
            (stage.removesuffix("_s"), lambda run, stage=stage: f"{getattr(run.new, stage):.2g}")  # type: ignore[misc]
            for stage in STAGES
        ),
        ("the same again, s", lambda run: f"{run.same.total_s:.1f}"),
        ("client, MB", lambda run: f"{run.client_mb:,.0f}"),
    ]
    return markdown(("", *(run.name for run in runs)), [[title, *map(of, runs)] for title, of in rows])


def main() -> None:
    """Measure, print, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server to make a database on (default: the embedded one)")
    parser.add_argument("--only", nargs="+", default=list(KNOWN), choices=list(KNOWN))
    parser.add_argument("--method", type=Method, default=Method.EXACT, choices=list(Method))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--flights", type=int, help="take only so many flights")
    parser.add_argument("--document", type=Path, help="put the table there")
    args = parser.parse_args()
    runs = []
    with fresh_database(args.dsn) as dsn, conflictdb.connect(dsn) as db:
        for name in args.only:
            runs.append(measure(db, name, args.flights, method=args.method, jobs=args.jobs))
            print(f"{name}: {runs[-1].holds}", flush=True)
        software = versions(db.connection)
    text = f"{table(runs)}\n\nMethod `{args.method}`. {software}."
    show(text, "real runs", args.document)
    if args.method is Method.EXACT and args.flights is None:
        other = [
            f"{run.name}: {run.verdicts}, known {KNOWN[run.name]}" for run in runs if run.verdicts != KNOWN[run.name]
        ]
        if other:
            sys.exit("not what was found before: " + "; ".join(other))


if __name__ == "__main__":
    main()
