"""Random scenes of every workload, compared with the oracle; more scenes than a test run can afford.

    python tests/acceptance/sweep.py --seeds 100:200 [--workload "low latitude"] [--objects 12] [--separation-m 500]
    python tests/acceptance/sweep.py --seeds 100:200 --workload wild

Prints one line per workload and every disagreement, and exits 1 if there is any. Runs without a database, through
`conflictdb.solve`.
"""

import argparse
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support"), str(Path(__file__).resolve().parents[2])]

from layouts import WORKLOADS, Workload
from mixed_scenes import plain_scene
from verdicts import Comparison, compared, solved
from wild import throw_wild

from conflictdb.model.plans import EarthModel

# Scenes of extremes by name, and the share of their havens that change.
WILD = {"wild": 0.0, "wild growing": 0.8}


def check(
    workload: Workload | str,
    seed: int,
    objects: int,
    earth: EarthModel,
    tolerance_m: float = 1.0,
    separation_m: float = 0.0,
) -> Comparison:
    """Throw one scene (a wild one if the workload is a name) and compare."""
    if isinstance(workload, str):
        scene, areas, tracks = throw_wild(seed, objects, WILD[workload])
    else:
        scene, areas, tracks = plain_scene(workload, seed, objects, objects, earth, tolerance_m, separation_m)
    return compared(scene, areas, tracks, solved(scene, areas, tracks))


def main() -> int:
    """Run the sweep that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:10", help="first:after, default 0:10")
    parser.add_argument("--objects", type=int, default=10, help="areas, and as many tracks, per scene")
    parser.add_argument("--workload", action="append", choices=[*(w.name for w in WORKLOADS), *WILD])
    parser.add_argument("--tolerance-m", type=float, default=1.0)
    parser.add_argument("--separation-m", type=float, default=0.0)
    options = parser.parse_args()
    first, after = map(int, options.seeds.split(":"))
    failed = False
    for workload in (*WORKLOADS, *WILD):
        name = workload if isinstance(workload, str) else workload.name
        if options.workload and name not in options.workload:
            continue
        total, began = Comparison(), time.monotonic()
        for seed in range(first, after):
            earth = list(EarthModel)[seed % 2]
            one = check(workload, seed, options.objects, earth, options.tolerance_m, options.separation_m)
            for line in one.wrong:
                sys.stdout.write(f"  {name}, seed {seed}, {earth}: {line}\n")
            total.add(one)
        failed |= bool(total.wrong)
        took = time.monotonic() - began
        sys.stdout.write(
            f"{name}: {total.pairs} pairs, {total.touching} touch, {total.reported} reported, "
            f"{total.grazing} grazing, {total.unresolved} unresolved, {len(total.wrong)} wrong; "
            f"worst end {total.worst_error_s:.2g} s off, widest bound {total.worst_bound_s:.2g} s; {took:.0f} s\n"
        )
        sys.stdout.flush()
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
