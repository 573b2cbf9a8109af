"""Cost of a tolerance: method `exact` on random scenes, from pairs of pieces to a row per pair of objects.

    ./.venv/bin/python benchmarks/tolerance.py [--pairs 40000] [--document docs/explanation/accuracy.md]

As benchmarks/accuracy.py, on WGS84, with a batch of about --pairs pairs at tolerance 0. *whole* is the processor time
of stages 3 and 4 divided by that at tolerance 0. *a pair* is the same per pair of pieces that stages 1 and 2 leave at
that tolerance. Both are the least of several rounds, in which the tolerances take turns.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from accuracy import Scenes
from layouts import HARBOUR, HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE, Workload
from tables import markdown, show

from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.run import run_stages
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import EarthModel

WORKLOADS: Final = (LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS, HARBOUR)
TOLERANCES_M: Final = (0.0, 1.0, 10.0, 100.0, 1000.0)
OBJECTS: Final = 10
ROUNDS: Final = 7
FEW: Final = 8  # scenes from which the needed number is extrapolated


def without_regions(pieces: Pieces, pairs: Pairs) -> tuple[Pieces, Pairs]:
    """Return pairs as method `exact` is given them: where their hulls meet is not found out for it."""
    return pieces, replace(pairs, region_xy=np.empty((0, 2)), region_offset=np.zeros(len(pairs) + 1, np.int64))


def measured(workload: Workload, pairs: int) -> list[list[str]]:
    """Return a row for each tolerance."""
    few = Scenes.of(workload, EarthModel.WGS84, FEW, OBJECTS)
    scenes = Scenes.of(workload, EarthModel.WGS84, -(-pairs * FEW // len(few.batch(0.0)[1])), OBJECTS)
    batches = {tolerance_m: without_regions(*scenes.batch(tolerance_m)) for tolerance_m in TOLERANCES_M}
    least_s, close = dict.fromkeys(TOLERANCES_M, float("inf")), dict.fromkeys(TOLERANCES_M, 0)
    for number in range(ROUNDS):
        for tolerance_m in TOLERANCES_M if number % 2 else TOLERANCES_M[::-1]:
            scene = replace(scenes.scene, tolerance_m=tolerance_m)
            started = time.process_time()
            found, _ = run_stages(Setup.of(scene), *batches[tolerance_m], scenes.footprints)
            least_s[tolerance_m] = min(least_s[tolerance_m], time.process_time() - started)
            close[tolerance_m] = int((found.closest_m > 0.0).sum())
    counts = {tolerance_m: len(batch[1]) for tolerance_m, batch in batches.items()}
    return [
        [
            workload.name,
            f"{tolerance_m:g}",
            f"{counts[tolerance_m]:,}",
            f"{close[tolerance_m]:,}",
            f"{1e6 * least_s[tolerance_m] / counts[tolerance_m]:.1f}",
            f"{least_s[tolerance_m] / counts[tolerance_m] * counts[0.0] / least_s[0.0]:.2f}",
            f"{least_s[tolerance_m] / least_s[0.0]:.2f}",
        ]
        for tolerance_m in TOLERANCES_M
    ]


def main() -> None:
    """Measure, print the table, and write it to requested files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=40_000, help="pairs of pieces of a batch at tolerance 0")
    parser.add_argument("--document", type=Path, help="put the table into its place in this document")
    args = parser.parse_args()
    heads = ("workload", "tolerance, m", "pairs", "only close", "us a pair", "a pair", "whole")
    text = markdown(heads, [row for workload in WORKLOADS for row in measured(workload, args.pairs)])
    show(text, "tolerance", args.document)


if __name__ == "__main__":
    main()
