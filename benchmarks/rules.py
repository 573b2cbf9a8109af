"""Compare a detection with separation rules of five classes with one separation that gives as many conflicts.

tests/unit/test_rules.py compares each pair with a detection that has its settings alone. Prints processor seconds, the
least of several rounds by turns, then a second table: a stored scene of 50,000 objects, detected, detected again after
one rule was changed; beside it, full detections of an equal scene.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from measured import STAGES, detect, fresh_database, load
from ruled import random_rules, sea

import conflictdb
from conflictdb import Scene, solve

OBJECTS, SEEDS, ROUNDS = 2_000, 5, 9
STORED = 50_000
# A separation with more conflicts than any rules, and the halvings that come within one conflict of theirs.
MOST_M, HALVINGS = 20_000.0, 14


def measured(seed: int) -> dict[str, float]:
    """Return seconds and conflicts of one random scene, by its rules and by one separation."""
    rng = np.random.default_rng(seed)
    tracks, areas = sea(rng, OBJECTS, 3.0)
    tracks = [replace(one, max_speed_kn=np.inf) for one in tracks]
    # Without times, whose solver differs.
    rules = [replace(one, time_s=None) for one in random_rules(rng)]
    scene = Scene("rules", separation_m=500.0, rules=rules)
    conflicts = len(solve(tracks, areas, scene))
    low_m, high_m = 0.0, MOST_M
    for _ in range(HALVINGS):
        middle_m = 0.5 * (low_m + high_m)
        enough = len(solve(tracks, areas, Scene("one", separation_m=middle_m))) >= conflicts
        low_m, high_m = (low_m, middle_m) if enough else (middle_m, high_m)
    scenes = (scene, Scene("one", separation_m=high_m))
    seconds, found = [np.inf, np.inf], [0, 0]
    for _ in range(ROUNDS):
        for i, one in enumerate(scenes):
            began = time.process_time()
            found[i] = len(solve(tracks, areas, one))
            seconds[i] = min(seconds[i], time.process_time() - began)
    return {
        "seed": seed,
        "rules": len(rules),
        "conflicts": found[0],
        "seconds": round(seconds[0], 4),
        "one separation, m": round(high_m, 1),
        "its conflicts": found[1],
        "its seconds": round(seconds[1], 4),
        "ratio": round(seconds[0] / seconds[1], 3),
    }


def changed(count: int) -> list[dict[str, object]]:
    """Return what a detection of a stored scene does after a rule between two of its classes changed.

    Beside it, what a full detection of an equal scene does after the same change.
    """
    rng = np.random.default_rng(0)
    tracks, areas = sea(rng, count, 3.0 * np.sqrt(count / OBJECTS))
    tracks = [replace(one, max_speed_kn=np.inf) for one in tracks]
    rules = [replace(one, time_s=None) for one in random_rules(rng)]
    asked = ("candidate_pairs", "solved_pairs", "conflicts", *STAGES, "cpu_s")
    rows = []
    with fresh_database(None) as dsn, conflictdb.connect(dsn) as db:
        for scene in ("pending", "full"):
            load(db, Scene(scene, separation_m=500.0, rules=rules), [(areas, tracks)])
        for sides in (None, ("drone", "submarine"), (None, "drone")):
            for scene in ("pending", "full"):
                if sides is not None:
                    db.connection.execute("SELECT conflictdb.put_rule(%s, %s, %s, 3000)", [scene, *sides])
                    db.connection.commit()
                run = detect(db, scene, full=scene == "full")
                name = f"{sides[0] or 'any'} with {sides[1]}" if sides else "all new"
                rows.append({"changed": name, "detection": scene} | {column: getattr(run, column) for column in asked})
    return rows


def main() -> None:
    """Print the tables."""
    rows = [measured(seed) for seed in range(SEEDS)]
    lines = [",".join(rows[0]), *(",".join(f"{value:g}" for value in row.values()) for row in rows)]
    print("\n".join(lines))
    for row in changed(STORED):
        print(",".join(f"{name}: {value}" for name, value in row.items()))


if __name__ == "__main__":
    main()
