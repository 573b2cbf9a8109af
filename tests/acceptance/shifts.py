"""Shifted copies of tracks of every workload, detected; more shifts than a test run can afford.

    python tests/acceptance/shifts.py --seeds 100:200 [--workload "low latitude"] [--waits]

Each seed is 40 scenes. Prints a line per workload and seed: shifts, shifts within 10 us of a reported end, and
disagreements between delays and detection; exits 1 if there is any.
"""

import argparse
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support"), str(Path(__file__).resolve().parents[2])]

from layouts import WORKLOADS
from test_delays import checked


def main() -> int:
    """Compare the shifts that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="100:101", help="first:after, default 100:101")
    parser.add_argument("--workload", action="append", choices=[workload.name for workload in WORKLOADS])
    parser.add_argument("--waits", action="store_true", help="tracks wait at their first waypoint")
    options = parser.parse_args()
    first, after = map(int, options.seeds.split(":"))
    total, total_near, wrong = 0, 0, 0
    for seed in range(first, after):
        for workload in WORKLOADS:
            if options.workload and workload.name not in options.workload:
                continue
            began = time.process_time()
            try:
                count, near_ends = checked(workload, 40, 4, seed, waits=options.waits)
            except AssertionError as error:
                wrong += 1
                sys.stdout.write(f"  {workload.name}, seed {seed}: {error}\n")
                continue
            total, total_near = total + count, total_near + near_ends
            took_s = time.process_time() - began
            sys.stdout.write(f"{workload.name}, seed {seed}: {count} shifts, {near_ends} near an end; {took_s:.0f} s\n")
            sys.stdout.flush()
    sys.stdout.write(f"{total} shifts, {total_near} within 10 us of an end; {wrong} workloads with a disagreement\n")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
