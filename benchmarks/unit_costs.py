"""Where the time goes: the cost of each unit of work, and its lower limit.

    ./.venv/bin/python benchmarks/unit_costs.py [--box 5000] [--sea 20000] [--turns 3] [--dsn DSN]
        [--document docs/explanation/performance.md] [--folder docs/explanation/performance]

A unit is a piece, a candidate, a pair that is solved, a row. Its cost is the time of its stage divided by the number of
units. Its limit is the time of the indispensable part alone, for the same number of units:

    piece           COPY of the same rows into a table without an index; and the arithmetic, objects to pieces in memory
    candidate       the join by the GiST index, counting only
    hulls tested    shapely's ST_Intersects of the same hulls
    solved pair     the kernel's answer to the same pairs of pieces
    new row         COPY of the same rows into a table without an index; and of them and their events into tables with
                    the indexes and checks that theirs have
    unchanged row   COPY of the rows out of the database
    row listed, row of SELECT *     the same

Microseconds of processor time, client and server together (measured.py), the least of the turns, one thread; scenes of
made_scenes.py. Both columns are measured in the same minutes, so that other load of the machine affects both.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import psycopg
import shapely
from growth import count_pieces, fill
from measured import WARM, detect, fresh_database, processor_clock, versions, write_csv
from stage4 import Load
from tables import markdown, show

import conflictdb
from conflictdb import store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import PairRows
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.stage1_broad_phase import candidates, hulls_of
from conflictdb.core.stage2_intersection import intersections
from conflictdb.earth.registry import Setup
from conflictdb.model.results import Kind

# As the routine of stage 1 does it: by the index, whatever the planner believes.
_BY_INDEX: Final = """
SET LOCAL enable_hashjoin = off; SET LOCAL enable_mergejoin = off; SET LOCAL enable_material = off;
SET LOCAL enable_seqscan = off;
"""
_JOIN: Final = """
SELECT count(*) FROM conflictdb.piece a JOIN conflictdb.piece b ON b.hull && a.hull AND b.span && a.span
WHERE a.scene_id + 0 = {0} AND b.scene_id = a.scene_id + 0
  AND (a.object_kind, a.object_id) < (b.object_kind, b.object_id)
"""


def measure(dsn: str, series: str, objects: int, turns: int) -> list[dict[str, Any]]:
    """Return the rows of one scene."""
    with conflictdb.connect(dsn) as db:
        detect(db, WARM, jobs=1)
        new, same = [], []
        for turn in range(turns):
            name = f"{series} {objects} {turn}"
            fill(db, series, objects, name)
            new.append(detect(db, name, jobs=1))
            same.append(detect(db, name, jobs=1))
        run, pieces = new[-1], count_pieces(dsn, name)
        least_s = {stage: min(getattr(one, stage) for one in new) for stage in ("pieces_s", "stage1_s", "stage2_s")}
        least_s |= {stage: min(getattr(one, stage) for one in new) for stage in ("stage4_s", "write_s")}
        memory = in_memory(db, name, turns)
        copied = copies(db.connection, name, turns)
        listed_s = least(turns, db.connection, lambda: db.scene(name).conflicts())
        everything = f"SELECT * FROM conflictdb.conflicts WHERE scene = '{name}'"
        selected_s = least(turns, db.connection, lambda: copied_out(db.connection, everything))
    again_s = min(one.write_s for one in same)
    kept_s = copied["rows kept"] + copied["events kept"]
    units = (
        ("piece", pieces, least_s["pieces_s"], "COPY alone", copied["pieces in"]),
        ("piece", pieces, least_s["pieces_s"], "arithmetic alone", memory["pieces"]),
        ("candidate", run.candidate_pairs, least_s["stage1_s"], "join alone", copied["join"]),
        ("hulls tested", run.candidate_pairs, least_s["stage2_s"], "shapely.intersects", memory["hulls"]),
        ("solved pair", run.solved_pairs, least_s["stage4_s"], "kernel alone", memory["kernel"]),
        ("new row", run.conflicts, least_s["write_s"], "COPY alone", copied["rows in"]),
        ("new row", run.conflicts, least_s["write_s"], "COPY, indexes, event", kept_s),
        ("unchanged row", run.conflicts, again_s, "COPY out alone", copied["rows out"]),
        ("row listed", run.conflicts, listed_s, "COPY out alone", copied["rows out"]),
        ("row of SELECT *", run.conflicts, selected_s, "COPY out alone", copied["rows out"]),
    )
    return [
        {
            "scene": f"{series} {objects}",
            "unit": unit,
            "count": count,
            "seconds": seconds,
            "us": 1e6 * seconds / max(count, 1),
            "limit": limit,
            "limit_us": 1e6 * limit_s / max(count, 1),
        }
        for unit, count, seconds, limit, limit_s in units
    ]


def least(turns: int, conn: psycopg.Connection[Any], work: Callable[[], object]) -> float:
    """Return the least processor seconds that some work takes here and in a connection's backend."""
    clock = processor_clock(conn) or time.perf_counter
    seconds = []
    for _ in range(turns):
        began = clock()
        work()
        seconds.append(clock() - began)
    return min(seconds)


def in_memory(db: conflictdb.Database, name: str, turns: int) -> dict[str, float]:
    """Return the seconds of the arithmetic alone: pieces, hulls of candidates, the kernel on pairs that move."""
    scene, areas, tracks = store.read_scene(db.connection, name)
    setup, batches = Setup.of(scene), (AreaBatch.of(areas), TrackBatch.of(tracks))
    pieces = pieces_of(setup, *batches)
    a, b = candidates(pieces)
    hulls = hulls_of(pieces)
    pairs = intersections(pieces, a, b, regions=False)
    moves = (pieces.kind[pairs.a] == Kind.TRACK.code) | (pieces.kind[pairs.b] == Kind.TRACK.code)
    pairs = pairs.take(PairRows(np.flatnonzero(moves)))
    start, end = pieces.shared_span(pairs.a, pairs.b)
    asked = Load(replace(scene, tolerance_m=0.0), pieces, pairs, start, (end - start) / 1e6)
    return {
        "pieces": least(turns, db.connection, lambda: pieces_of(setup, *batches)),
        "hulls": least(turns, db.connection, lambda: shapely.intersects(hulls[a], hulls[b])),
        "kernel": least(turns, db.connection, lambda: asked.solved(asked.prepared())),
    }


def copies(conn: psycopg.Connection[Any], name: str, turns: int) -> dict[str, float]:
    """Return the seconds of COPY alone, in and out, and of the join alone; leaves no transaction open."""
    scene_id = store.scene_id(conn, name)
    found = {}
    for table, title in (("piece", "pieces"), ("conflict", "rows"), ("conflict_event", "events")):
        query = f"SELECT * FROM conflictdb.{table} WHERE scene_id = {scene_id}"
        found[f"{title} out"] = least(turns, conn, lambda query=query: copied_out(conn, query))
        rows = copied_out(conn, query)
        conn.execute(f"CREATE TEMPORARY TABLE bare ON COMMIT DROP AS SELECT * FROM conflictdb.{table} LIMIT 0")
        found[f"{title} in"] = least(turns, conn, lambda rows=rows: _copied_in(conn, rows))
        conn.execute(f"DROP TABLE bare; CREATE TEMPORARY TABLE bare (LIKE conflictdb.{table} INCLUDING ALL)")
        found[f"{title} kept"] = least(turns, conn, lambda rows=rows: _copied_in(conn, rows))
        conn.rollback()
    conn.execute(_BY_INDEX)
    found["join"] = least(turns, conn, lambda: conn.execute(_JOIN.format(scene_id)).fetchone())
    conn.rollback()
    return found


def copied_out(conn: psycopg.Connection[Any], query: str) -> list[bytes]:
    """Return the rows of a query as COPY sends them."""
    with conn.cursor().copy(f"COPY ({query}) TO STDOUT (FORMAT binary)") as copy:
        return [bytes(block) for block in copy]


def _copied_in(conn: psycopg.Connection[Any], rows: list[bytes]) -> None:
    # In a subtransaction, for new files: an SP-GiST index that is emptied in place looks for pages that are gone.
    with conn.transaction():
        conn.execute("TRUNCATE bare")
        with conn.cursor().copy("COPY bare FROM STDIN (FORMAT binary)") as copy:
            for block in rows:
                copy.write(block)


def table(rows: list[dict[str, Any]]) -> str:
    """Return a table in Markdown, a scene after the other."""
    heads = ("scene", "unit", "how many", "s", "us a unit", "limit", "us", "times the limit")
    lines = [
        [
            row["scene"],
            row["unit"],
            f"{row['count']:,}",
            f"{row['seconds']:.2g}",
            f"{row['us']:.3g}",
            row["limit"],
            f"{row['limit_us']:.2g}",
            f"{row['us'] / row['limit_us']:.1f}" if row["limit_us"] else "",
        ]
        for row in rows
    ]
    return markdown(heads, lines)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server to make a database on (default: the embedded one)")
    parser.add_argument("--box", type=int, nargs="*", default=[5_000], help="objects at the paper's density")
    parser.add_argument("--sea", type=int, nargs="*", default=[20_000], help="objects at constant density")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--folder", type=Path, help="write unit-costs.csv there")
    parser.add_argument("--document", type=Path, help="put the table there")
    args = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with fresh_database(args.dsn) as dsn:
        for series, objects in [("box", n) for n in args.box] + [("sea", n) for n in args.sea]:
            rows += measure(dsn, series, objects, args.turns)
        with conflictdb.connect(dsn) as db:
            software = versions(db.connection)
    text = f"{table(rows)}\n\n{software}."
    show(text, "unit costs", args.document)
    if args.folder:
        write_csv(args.folder / "unit-costs.csv", rows)


if __name__ == "__main__":
    main()
