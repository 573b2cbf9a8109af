"""Compare the estimates of `advise` with full detections: pairs, conflicts and seconds, and the ratios behind.

    ./run server start; ./.venv/bin/python benchmarks/advice.py [--dsn DSN] [--objects 40 300 1500] [--repeat 3]

Random scenes of N areas and N tracks, in a window that grows with N. Before every detection runs one by another method,
so that every row changes. The result is the median of processor seconds of client and server. Below each scene: the
time of the database per row, in units of the time to make a piece in memory, like the constants of
`conflictdb.client.advise`. A row of a conflict includes the regions that the kernel leaves to the database. The scenes
stay in the database, named `advice 40` and so on.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from layouts import LOW_LATITUDE
from measured import detect, medians
from mixed_scenes import plain_scene

import conflictdb
from conflictdb import Method, store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.client.estimates import Trial
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.registry import Setup

METHODS = (Method.SCREEN, Method.EXACT)
ROW = "{:>12} {:>8} {:>10} {:>10} {:>10} {:>10} {:>10} {:>9} {:>9} {:>7}"
DEGREES_PER_ROOT = 2.5 / 40**0.5  # degrees of the window for the root of the number of areas


def main() -> None:
    """Foretell, detect, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="database to use; default: the embedded one")
    parser.add_argument("--objects", type=int, nargs="+", default=[40, 300, 1500], help="areas, and as many tracks")
    parser.add_argument("--repeat", type=int, default=3, help="detections per method; the median counts")
    args = parser.parse_args()
    heads = (
        "scene",
        "method",
        "candidates",
        "foretold",
        "conflicts",
        "foretold",
        "95 %",
        "seconds",
        "foretold",
        "ratio",
    )
    print(ROW.format(*heads))
    with conflictdb.connect(args.dsn) as db:
        for n in args.objects:
            workload = replace(LOW_LATITUDE, window=DEGREES_PER_ROOT * n**0.5, latitudes=(0.0, 5.0))
            scene, areas, tracks = plain_scene(workload, 1, n, n)
            scene = replace(scene, name=f"advice {n}")
            store.replace_scene(db.connection, scene, areas, tracks, merge=False)
            compare(db, scene, areas, tracks, args.repeat)


def compare(db, scene, areas, tracks, repeat) -> None:
    """Print one row per method, and the ratios."""
    foretold = {one.setting: one for one in db.scene(scene.name).advise().estimates}
    units, made_s = {}, []
    for method, other in zip(METHODS, (METHODS[-1], *METHODS[:-1]), strict=True):
        runs = []
        for _ in range(repeat):
            started = time.perf_counter()
            pieces = pieces_of(Setup.of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
            made_s.append((time.perf_counter() - started) / len(pieces))
            detect(db, scene.name, method=other, jobs=1)
            runs.append(detect(db, scene.name, method=method, jobs=1))
        run, one = medians(runs), foretold[Trial(method, scene.tolerance_m)]
        seconds = run.cpu_s or run.total_s
        print(
            ROW.format(
                scene.name,
                method.value,
                run.candidate_pairs,
                f"{one.candidate_pairs:.0f}",
                run.conflicts,
                f"{one.conflicts.value:.0f}",
                f"{one.conflicts.low:.0f}-{one.conflicts.high:.0f}",
                f"{seconds:.2f}",
                f"{one.seconds:.2f}",
                f"{one.seconds / seconds:.2f}",
            ),
            flush=True,
        )
        unit = median(made_s)
        units[method] = {
            "per piece": (run.pieces_s + run.stage1_s) / len(pieces) / unit - 1.0,
            "test per candidate": run.stage2_s / run.candidate_pairs / unit,
            "write per conflict": run.write_s / run.conflicts / unit,
        }
    for method, ratios in units.items():
        print(f"    {method.value:>8}: " + ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items()))


if __name__ == "__main__":
    main()
