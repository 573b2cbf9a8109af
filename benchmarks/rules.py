"""Compare a detection with separation rules of five classes with one separation: processor seconds, side by side.

Every pair of the scene with rules is checked against a detection with the settings of that pair alone. Writes
benchmarks/results/rules.csv.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from ruled import random_rules, sea, settings_of  # noqa: E402 - the path is set above

from conflictdb import Scene, solve  # noqa: E402

OBJECTS, SEEDS, ROUNDS = 2_000, 3, 3
SEPARATIONS_M = (500.0, 2_000.0, 5_000.0)


def measured(seed: int) -> dict[str, float]:
    """Return seconds, conflicts, and the numbers of missed and false ones, of one random scene."""
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
    # Each pair with its own settings: all pairs of one setting are solved together, without rules.
    of_pairs: dict[Scene, set[tuple[str, str]]] = {}
    objects = [*areas, *tracks]
    for i, one in enumerate(objects):
        for other in objects[i + 1 :]:
            if (own := settings_of(scene, one, other)) is not None:
                of_pairs.setdefault(own, set()).add((one.key, other.key))
    bare = [
        [replace(x, object_class=None, owner=None, **more) for x in some]
        for some, more in ((tracks, {"max_speed_kn": np.inf}), (areas, {}))
    ]
    expected = {
        (one.a_key, one.b_key)
        for own, pairs in of_pairs.items()
        for one in solve(*bare, own)
        if (one.a_key, one.b_key) in pairs
    }
    known = {(one.a_key, one.b_key) for one in found["rules"]}
    return row | {"missed": len(expected - known), "false": len(known - expected)}


def main() -> None:
    rows = [measured(seed) for seed in range(SEEDS)]
    lines = [",".join(rows[0]), *(",".join(f"{value:g}" for value in row.values()) for row in rows)]
    (Path(__file__).parent / "results" / "rules.csv").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
