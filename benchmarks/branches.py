"""Branches: the time to create one, to detect it after one edit, and to compare it with its parent.

    ./.venv/bin/python benchmarks/branches.py [--objects 5000 50000] [--changes 50] [--dsn DSN]

A sea of constant density (made_scenes.py) is detected, and branches are made of it. Each change moves one track of the
branch by a hundredth of a degree. Medians by the clock, and processor seconds of client and server together
(measured.py). At the end, the space of the rows that a branch has of its own.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import psycopg
from made_scenes import sea
from measured import fresh_database, load, processor_clock, versions

import conflictdb
from conflictdb import Scene

SCENE = "sea"
MOVED = """
SELECT conflictdb.put_track(%(branch)s, t.key, ST_Translate(t.path, 0, 0.01), t.outline)
FROM conflictdb.track t JOIN conflictdb.scene s USING (scene_id) WHERE s.name = %(scene)s AND t.key = %(key)s
"""
OWN = """
SELECT (SELECT count(*) FROM conflictdb.track t WHERE t.scene_id = s.scene_id),
       (SELECT count(*) FROM conflictdb.piece p WHERE p.scene_id = s.scene_id),
       (SELECT count(*) FROM conflictdb.conflict c WHERE c.scene_id = s.scene_id)
FROM conflictdb.scene s WHERE s.name = %s
"""


def measure(dsn: str, objects: int, times: int) -> None:
    """Make branches of a sea, edit and compare one, and print the times."""
    with conflictdb.connect(dsn) as db:
        load(db, Scene(SCENE), sea(objects, 1))
        scene, clock = db.scene(SCENE), processor_clock(db.connection) or time.process_time
        scene.detect()
        query = "SELECT t.key FROM conflictdb.track t ORDER BY md5(t.key) LIMIT %s"
        keys = [key for (key,) in db.connection.execute(query, [times]).fetchall()]
        db.connection.commit()
        spent: dict[str, list[tuple[float, float]]] = {}

        def timed(what: str, work: Callable[[], object]) -> None:
            began, began_work = time.perf_counter(), clock()
            work()
            spent.setdefault(what, []).append((time.perf_counter() - began, clock() - began_work))

        for nth in range(5):
            timed("create", lambda nth=nth: scene.branch(f"branch {nth}"))
        branch = db.scene("branch 0")
        for key in keys:
            db.connection.execute(MOVED, {"branch": branch.name, "scene": SCENE, "key": key})
            db.connection.commit()
            timed("detect after one edit", branch.detect)
            timed("diff", branch.diff)
        timed("list conflicts", branch.conflicts)
        timed("list conflicts of the parent", scene.conflicts)
        for what, ran in spent.items():
            by_clock, worked = (1e3 * statistics.median(one) for one in zip(*ran, strict=True))
            print(f"{objects:>7,} objects, {what:<28} {by_clock:8.1f} ms {worked:8.1f} ms of processors", flush=True)
        rows = db.connection.execute(OWN, [branch.name]).fetchone()
        print(f"{objects:>7,} objects, {len(keys)} edits: own tracks, pieces, conflicts {rows}", flush=True)


def main() -> None:
    """Measure seas of some sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server that databases may be made on (default: the embedded one)")
    parser.add_argument("--objects", type=int, nargs="*", default=[5_000, 50_000])
    parser.add_argument("--changes", type=int, default=50)
    args = parser.parse_args()
    for objects in args.objects:
        with fresh_database(args.dsn) as dsn:
            if objects == args.objects[0]:
                with psycopg.connect(dsn) as conn:
                    print(versions(conn))
            measure(dsn, objects, args.changes)


if __name__ == "__main__":
    main()
