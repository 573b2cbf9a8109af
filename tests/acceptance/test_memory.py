"""Memory of a detection is bounded by its option, whatever the size of the scene, and the answer is complete."""

import subprocess
import sys

import shapely
from peaks import PRINT_PEAK
from psycopg import Connection

from conflictdb import store
from conflictdb.core.memory_budget import LEAST_MEMORY_MB, MemoryBudget
from conflictdb.model.plans import Area, Scene

AREAS = 700  # 244,650 pairs, all meet: several chunks at the least memory, hundreds of megabytes at once
PROGRAM = f"""
import sys
import conflictdb
with conflictdb.connect(sys.argv[1]) as db:
    run = db.scene("s").detect(full=True, memory_mb=int(sys.argv[2]))
print(run.candidate_pairs, run.conflicts)
{PRINT_PEAK}"""


def test_a_detection_keeps_below_the_memory_that_it_is_given(dsn: str, conn: Connection[tuple[object, ...]]) -> None:
    areas = [Area(f"A{i}", shapely.MultiPolygon([shapely.box(5.0 + 1e-4 * i, 57.0, 6.0, 58.0)])) for i in range(AREAS)]
    store.replace_scene(conn, Scene("s"), areas, [], merge=False)
    pairs = AREAS * (AREAS - 1) // 2
    assert pairs > 2 * MemoryBudget.of(LEAST_MEMORY_MB).pairs
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, dsn, str(LEAST_MEMORY_MB)], capture_output=True, text=True, check=True
    )
    *counts, peak = map(int, done.stdout.split())
    assert counts == [pairs, pairs]
    assert peak // 2**20 <= LEAST_MEMORY_MB
    # A unique index has each pair once.
    found = "SELECT count(*), bool_and(periods = '{(,)}' AND verdict = 'conflict') FROM conflictdb.conflict"
    assert conn.execute(found).fetchone() == (pairs, True)
