"""A million objects by hand: make and load the scene, detect it, change one object, list one, probe one plan.

    ./.venv/bin/python benchmarks/million.py [--objects 1000000] [--memory-mb 512] [--dsn DSN]
        [--document docs/explanation/performance.md] [--folder docs/explanation/performance]

The scene is the repeated sea of made_scenes.py. One process makes and loads it, part by part in one transaction;
another uses it. Seconds are those of the processor, of client and server together, and by the clock. Memory is the peak
of the process, and the sum of the server's processes (PSS). The load of the machine is that of the last minute, after
each process.
"""

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import psycopg
from made_scenes import repeated_sea
from measured import (
    ServerMemory,
    fresh_database,
    in_fresh_process,
    load,
    peak_mb,
    processor_clock,
    server_pid,
    versions,
    write_csv,
)
from tables import markdown, show

import conflictdb
from conflictdb import Scene, Track, store

NAME: Final = "million"
SEED: Final = 1
TIMES: Final = 5  # of what takes milliseconds: the median

Row = dict[str, Any]


def timed(conn: psycopg.Connection[Any], step: str, work: Callable[[], object], times: int = 1) -> Row:
    """Return the median seconds of work, of the processors and by the clock."""
    processors = processor_clock(conn) or time.process_time
    took = []
    for _ in range(times):
        began, began_at = processors(), time.monotonic()
        work()
        took.append((processors() - began, time.monotonic() - began_at))
    cpu_s, clock_s = np.median(took, axis=0).tolist()
    return {"step": step, "cpu_s": cpu_s, "clock_s": clock_s}


def loaded(dsn: str, objects: int) -> Row:
    """Make and load the scene."""
    with conflictdb.connect(dsn) as db:
        row = timed(db.connection, "make and load", lambda: load(db, Scene(NAME), repeated_sea(objects, SEED)))
    return row | {"client_mb": peak_mb()}


def used(dsn: str, memory_mb: int) -> list[Row]:
    """Detect the scene, change one object, list it, probe it."""
    with conflictdb.connect(dsn) as db:
        conn, scene = db.connection, db.scene(NAME)
        rows = [timed(conn, "detect", lambda: scene.detect(memory_mb=memory_mb)) | {"client_mb": peak_mb()}]
        query = (
            "SELECT t.track_id, t.key FROM conflictdb.track t JOIN conflictdb.scene s USING (scene_id) "
            "WHERE s.name = %s LIMIT 1"
        )
        [(number, key)] = conn.execute(query, [NAME]).fetchall()
        conn.rollback()

        def change() -> None:
            conn.execute("UPDATE conflictdb.track SET floor_m = floor_m - 1 WHERE track_id = %s", [number])
            conn.commit()
            scene.detect()

        change()
        rows.append(timed(conn, "change one object and detect", change, TIMES))
        rows.append(timed(conn, "list the conflicts of one object", lambda: list(scene.conflicts(key=key)), TIMES))
        plan = _track(db, key)
        scene.probe(plan)
        rows.append(timed(conn, "probe one plan", lambda: scene.probe(plan), TIMES))
    return rows


def _track(db: conflictdb.Database, key: str) -> Track:
    """Return a stored track."""
    _, _, [track] = store.read_scene(db.connection, NAME, [key])
    return track


def table(rows: list[Row]) -> str:
    """Return the table in Markdown."""
    heads = ("step", "processor, s", "by the clock, s", "client, MB", "server, MB", "load")
    lines = [
        [
            row["step"],
            f"{row['cpu_s']:.3g}",
            f"{row['clock_s']:.3g}",
            *(f"{row[name]:,.0f}" if row.get(name) else "" for name in ("client_mb", "server_mb")),
            f"{row['load']:.1f}",
        ]
        for row in rows
    ]
    return markdown(heads, lines)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=1_000_000)
    parser.add_argument("--memory-mb", type=int, default=512)
    parser.add_argument("--dsn", help="server to make the database on (default: the embedded one)")
    parser.add_argument("--document", type=Path, help="put the table there")
    parser.add_argument("--folder", type=Path, help="write million.csv there")
    args = parser.parse_args()
    with fresh_database(args.dsn) as dsn:
        rows = []
        for work, arguments in ((loaded, (dsn, args.objects)), (used, (dsn, args.memory_mb))):
            with psycopg.connect(dsn) as conn, ServerMemory(server_pid(conn)) as server:
                conn.rollback()
                found = in_fresh_process(work, *arguments)
            some = found if isinstance(found, list) else [found]
            some[0]["server_mb"] = server.peak_mb
            rows += [row | {"load": os.getloadavg()[0]} for row in some]
            for row in rows[-len(some) :]:
                print(row, flush=True)
        with conflictdb.connect(dsn) as db:
            software = versions(db.connection)
    if args.folder:
        write_csv(args.folder / "million.csv", rows)
    show(f"{args.objects:,} objects.\n\n{table(rows)}\n\n{software}.", "million", args.document)


if __name__ == "__main__":
    main()
