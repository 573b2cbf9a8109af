"""How finely to cut track legs: what slices cost and what their tight boxes save.

    ./.venv/bin/python benchmarks/slicing.py [--areas 200] [--tracks 200]

For each workload and slice length (in haven lengths), the median over the runs of one detection with method window: the
stages that slices touch. The numbers decide SLICE_LENGTH_HAVENS in conflictdb/pieces/cutting.py.
"""

import argparse
import statistics
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from workloads import HARBOUR, HIGH_LATITUDE, LONG_LEGS, PAPER, throw

import conflictdb
from conflictdb import Method
from conflictdb.io import scene_text
from conflictdb.pieces import cutting

WIDTHS = (14, 8, 8, 8, 9, 7, 7, 7)
LENGTHS = (0.5, 1.0, 2.0, 4.0, 8.0, 1e9)  # the last: one slice per leg


def main() -> None:
    """Measure and print one table per workload."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--areas", type=int, default=200)
    parser.add_argument("--tracks", type=int, default=200)
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    chosen = cutting.SLICE_LENGTH_HAVENS
    for workload in (PAPER, HIGH_LATITUDE, LONG_LEGS, HARBOUR):
        scene, areas, tracks = throw(workload, 1, args.areas, args.tracks)
        print(f"\n{workload.name}: {len(areas)} areas, {len(tracks)} tracks; seconds")
        heads = ("slice, havens", "boxes", "hulls", "windows", "pieces s", "1-2 s", "3-4 s", "all s")
        print(" ".join(f"{head:>{width}}" for head, width in zip(heads, WIDTHS, strict=True)))
        with tempfile.TemporaryDirectory() as folder, conflictdb.connect() as db:
            path = Path(folder, "scene.geojson")
            path.write_text("".join(scene_text(scene, areas, tracks)))
            name = db.load(path, "slicing")
            for length in LENGTHS:
                cutting.SLICE_LENGTH_HAVENS = length
                runs = [db.detect(name, method=Method.WINDOW, full=True, jobs=1) for _ in range(args.runs)]
                times = [
                    statistics.median(column)
                    for column in zip(
                        *((r.pieces_s, r.stage1_s + r.stage2_s, r.stage3_s + r.stage4_s, r.total_s) for r in runs),
                        strict=True,
                    )
                ]
                run = runs[0]
                label = "one per leg" if length == LENGTHS[-1] else f"{length:g}"
                mark = " <- used" if length == chosen else ""
                print(
                    f"{label:>14} {run.candidate_pairs:>8,} {run.intersecting_pairs:>8,} {run.window_pairs:>8,} "
                    f"{times[0]:>9.2f} {times[1]:>7.2f} {times[2]:>7.2f} {times[3]:>7.2f}{mark}"
                )


if __name__ == "__main__":
    main()
