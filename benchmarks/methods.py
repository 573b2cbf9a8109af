"""What the methods cost and how wide their answers are: screen, window and nlp on the same scenes, side by side.

    ./.venv/bin/python benchmarks/methods.py [--objects 100] [--seeds 3]

In memory, one process; the methods take turns on each scene. Slack is how much earlier a safe period starts, or later
it ends, than the certified one of method nlp, over the pairs of objects with a track that do meet.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
from workloads import HIGH_LATITUDE, LONG_LEGS, PAPER, throw

from conflictdb import Method, Verdict, solve
from conflictdb.model import Kind

WIDTHS = (15, 8, 9, 9, 9, 22, 22, 9)
HEADS = ("workload", "method", "reported", "of which", "seconds", "slack, median / 95 %", "slack, worst", "x nlp")


def main() -> None:
    """Measure and print one row per workload and method."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=100, help="areas, and as many tracks, per scene")
    parser.add_argument("--seeds", type=int, default=3, help="scenes per workload")
    args = parser.parse_args()
    print(" ".join(f"{head:>{width}}" for head, width in zip(HEADS, WIDTHS, strict=True)))
    for workload in (PAPER, HIGH_LATITUDE, LONG_LEGS):
        seconds: dict[Method, list[float]] = {method: [] for method in Method}
        slack: dict[Method, list[float]] = {method: [] for method in Method}
        reported = dict.fromkeys(Method, 0)
        false = dict.fromkeys(Method, 0)
        for seed in range(args.seeds):
            scene, areas, tracks = throw(workload, seed, args.objects, args.objects)
            answers = {}
            for method in Method:
                started = time.perf_counter()
                found = solve(tracks, areas, replace(scene, method=method))
                seconds[method].append(time.perf_counter() - started)
                answers[method] = {(c.a_key, c.b_key): c for c in found if c.b_kind == Kind.TRACK}
                reported[method] += len(answers[method])
            exact = answers[Method.NLP]
            for method in Method:
                false[method] += sum(pair not in exact for pair in answers[method])
                for pair, true in exact.items():
                    if true.verdict != Verdict.CONFLICT:
                        continue
                    safe = answers[method][pair].periods_us  # a KeyError here would be a miss
                    slack[method] += [
                        (true.periods_us[0][0] - safe[0][0]) / 1e6,
                        (safe[-1][1] - true.periods_us[-1][1]) / 1e6,
                    ]
        for method in Method:
            middle, most = np.quantile(slack[method], [0.5, 0.95])
            ratio = median(a / b for a, b in zip(seconds[method], seconds[Method.NLP], strict=True))
            cells = (
                workload.name,
                method.value,
                f"{reported[method]:,}",
                f"{false[method]:,} no",
                f"{median(seconds[method]):.2f}",
                f"{middle:.0f} s / {most:.0f} s",
                f"{max(slack[method]):.0f} s",
                f"{ratio:.3f}",
            )
            print(" ".join(f"{cell:>{width}}" for cell, width in zip(cells, WIDTHS, strict=True)))


if __name__ == "__main__":
    main()
