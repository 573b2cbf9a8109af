"""How finely to cut track legs: the cost of slices, and the savings by their tight boxes.

    ./.venv/bin/python benchmarks/slicing.py [--areas 200] [--tracks 200]

For each workload, and each longest leg that is not sliced (in haven lengths): times of the stages that slices affect,
in one detection, medians over the runs. The numbers decide WHOLE_LEG_HAVENS in conflictdb/core/pieces/cutting.py.
*sparse* has some three candidates an object, the others a hundred.
"""

import argparse
import statistics
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from layouts import HARBOUR, HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE
from mixed_scenes import plain_scene

import conflictdb
from conflictdb.core.pieces import cutting
from conflictdb.formats import scene_text

WIDTHS = (14, 8, 8, 8, 8, 9, 7, 7, 7)
LENGTHS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 1e9)  # the last: one slice per leg
# Ships and closed areas of some miles, in a sea so wide that most meet no other object.
SPARSE = replace(
    LOW_LATITUDE,
    name="sparse",
    window=3.0,
    leg=(15.0, 40.0),
    around_area=(4.0, 12.0),
    around_haven=(0.4, 1.6),
    odd_share=0.6,
)


def main() -> None:
    """Measure and print one table per workload."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--areas", type=int, default=200)
    parser.add_argument("--tracks", type=int, default=200)
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    chosen = cutting.WHOLE_LEG_HAVENS
    for workload in (SPARSE, LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS, HARBOUR):
        scene, areas, tracks = plain_scene(workload, 1, args.areas, args.tracks)
        print(f"\n{workload.name}: {len(areas)} areas, {len(tracks)} tracks; seconds")
        heads = ("leg, havens", "pieces", "boxes", "hulls", "solved", "pieces s", "1-2 s", "3-4 s", "all s")
        print(" ".join(f"{head:>{width}}" for head, width in zip(heads, WIDTHS, strict=True)))
        with tempfile.TemporaryDirectory() as folder, conflictdb.connect() as db:
            path = Path(folder, "scene.geojson")
            path.write_text("".join(scene_text(scene, areas, tracks)))
            name = db.load(path, "slicing", replace=True).name
            for length in LENGTHS:
                cutting.WHOLE_LEG_HAVENS = length
                runs = [db.scene(name).detect(full=True, jobs=1) for _ in range(args.runs)]
                times = [
                    statistics.median(column)
                    for column in zip(
                        *((r.pieces_s, r.stage1_s + r.stage2_s, r.stage3_s + r.stage4_s, r.total_s) for r in runs),
                        strict=True,
                    )
                ]
                run, (pieces,) = runs[0], db.connection.execute("SELECT count(*) FROM conflictdb.piece").fetchone()
                db.connection.rollback()
                label = "one per leg" if length == LENGTHS[-1] else f"{length:g}"
                mark = " <- used" if length == chosen else ""
                print(
                    f"{label:>14} {pieces:>8,} {run.candidate_pairs:>8,} {run.intersecting_pairs:>8,} "
                    f"{run.solved_pairs:>8,} {times[0]:>9.2f} {times[1]:>7.2f} {times[2]:>7.2f} {times[3]:>7.2f}{mark}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
