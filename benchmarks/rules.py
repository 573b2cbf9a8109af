"""Compare a detection with separation rules of five classes with one separation: processor seconds, side by side.

tests/unit/test_rules.py compares each pair with a detection that has its settings alone. Prints a table, then a second
one: a stored scene of 50,000 objects, detected, and detected again after one rule was changed.
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

OBJECTS, SEEDS, ROUNDS = 2_000, 3, 3
STORED = 50_000
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


def changed(count: int) -> list[dict[str, object]]:
    """Return what a detection of a stored scene does, and one after a rule between two of its classes changed."""
    rng = np.random.default_rng(0)
    tracks, areas = sea(rng, count, 3.0 * np.sqrt(count / OBJECTS))
    tracks = [replace(one, max_speed_kn=np.inf) for one in tracks]
    rules = [replace(one, time_s=None) for one in random_rules(rng)]
    asked = ("candidate_pairs", "solved_pairs", "conflicts", *STAGES, "cpu_s")
    rows = []
    with fresh_database(None) as dsn, conflictdb.connect(dsn) as db:
        load(db, Scene("rules", separation_m=500.0, rules=rules), [(areas, tracks)])
        for name, call in (
            ("all", None),
            ("nothing changed", None),
            ("drone with submarine", "SELECT conflictdb.put_rule('rules', 'drone', 'submarine', 3000)"),
            ("any with drone", "SELECT conflictdb.put_rule('rules', NULL, 'drone', 3000)"),
        ):
            if call is not None:
                db.connection.execute(call)
                db.connection.commit()
            run = detect(db, "rules", full=not rows)
            rows.append({"detection": name} | {column: getattr(run, column) for column in asked})
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
