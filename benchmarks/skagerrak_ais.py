"""An hour of ship traffic in the Skagerrak (AIS), each ship a rectangle of its own length and width (real_runs.py).

Ships: BSH, 2022-11-01 09:35-10:35 UTC. The loader reports by name the dirty rows that it leaves out.
"""

from collections import Counter

from data import real_input

import conflictdb

FASTEST_KN = 60.0


def load_hour(db: conflictdb.Database, scene: str) -> str:
    """Load the hour as a scene; return in a line its content and the number of omissions."""
    (loaded,) = db.load_files([real_input("ais-skagerrak", "ais.csv.gz")], scene, replace=True, max_speed_kn=FASTEST_KN)
    skipped = Counter(skip.reason for skip in loaded.skipped).most_common()
    return f"{loaded.counts.added} ships; left out: " + "; ".join(f"{reason} ({count})" for reason, count in skipped)
