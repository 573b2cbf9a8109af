"""Compare a detection with separation rules of five classes with one separation: processor seconds, side by side.

tests/unit/test_rules.py compares each pair with a detection that has its settings alone. Prints a table.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from ruled import random_rules, sea

from conflictdb import Scene, solve

OBJECTS, SEEDS, ROUNDS = 2_000, 3, 3
SEPARATIONS_M = (500.0, 2_000.0, 5_000.0)


def measured(seed: int) -> dict[str, float]:
    """Return seconds and conflicts of one random scene."""
    rng = np.random.default_rng(seed)
    tracks, areas = sea(rng, OBJECTS, 3.0)
    tracks = [replace(one, max_speed_kn=np.inf) for one in tracks]
    # Without times, whose solver differs.
    rules = [replace(one, time_s=None) for one in random_rules(rng)]
    scene = Scene("rules", separation_m=500.0, rules=rules)
    scenes = {"rules": scene} | {f"{metres:g} m": Scene("one", separation_m=metres) for metres in SEPARATIONS_M}
    seconds = dict.fromkeys(scenes, np.inf)
    found = {}
    for _ in range(ROUNDS):
        for name, one in scenes.items():
            began = time.process_time()
            found[name] = solve(tracks, areas, one)
            seconds[name] = min(seconds[name], time.process_time() - began)
    row: dict[str, float] = {"seed": seed, "rules": len(rules)}
    for name in scenes:
        row |= {f"{name}: conflicts": len(found[name]), f"{name}: s": round(seconds[name], 3)}
    return row


def main() -> None:
    """Print the table."""
    rows = [measured(seed) for seed in range(SEEDS)]
    lines = [",".join(rows[0]), *(",".join(f"{value:g}" for value in row.values()) for row in rows)]
    print("\n".join(lines))


if __name__ == "__main__":
    main()
