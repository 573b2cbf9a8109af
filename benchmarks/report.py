"""What a detection found, in a few lines."""

from collections import Counter

import numpy as np

from conflictdb import Run
from conflictdb.database import Database


def report(db: Database, scene: str, run: Run) -> None:
    """Print the funnel, the times and what the conflicts look like."""
    print(
        f"pairs of pieces: boxes {run.candidate_pairs:,}, hulls {run.intersecting_pairs:,}, "
        f"windows {run.window_pairs:,}, reported {run.met_pairs:,}"
    )
    print(
        f"seconds: pieces {run.pieces_s:.1f}, stage 1 {run.stage1_s:.1f}, 2 {run.stage2_s:.1f}, "
        f"3 {run.stage3_s:.1f}, 4 {run.stage4_s:.1f}, total {run.total_s:.1f}"
    )
    found = db.conflicts(scene)
    verdicts, kinds = Counter(c.verdict for c in found), Counter(f"{c.a_kind}-{c.b_kind}" for c in found)
    print(f"conflicts: {len(found):,} pairs of objects; {dict(verdicts)}; {dict(kinds)}")
    moving = [c for c in found if c.b_kind == "track"]
    if moving:
        errors = [c.time_error_s for c in moving]
        minutes = [(c.last_contact - c.first_contact).total_seconds() / 60.0 for c in moving]
        print(f"time error bound, s: median {np.median(errors):.1e}, worst {max(errors):.1e}")
        print(f"from first to last contact, min: median {np.median(minutes):.1f}, longest {max(minutes):.1f}")
    busiest = Counter(key for c in moving for key in {c.a_key, c.b_key}).most_common(5)
    print("in most conflicts:", ", ".join(f"{key} ({count})" for key, count in busiest))
