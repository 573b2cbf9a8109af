"""`spark`: scenes that outgrow one machine, on Apache Spark."""

import argparse
import os
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import note, out, remark
from conflictdb.cli.report import conflict_table
from conflictdb.cli.session import database
from conflictdb.database import DEMO_SCENE
from conflictdb.errors import ConflictDBError
from conflictdb.in_memory import solve
from conflictdb.io.reading import read
from conflictdb.model import Scene
from conflictdb.results import Kind
from conflictdb.server.settings import Settings
from conflictdb.spark import engine

if TYPE_CHECKING:
    from pyspark.sql import SparkSession

# Settings that a scene has unless they are given.
_SETTINGS: Final = ("motion", "earth", "centre", "method", "tolerance_m", "separation_m", "nearest_m")
_LEFT_OUT: Final = frozenset({"region", "a_id", "a_version", "b_id", "b_version"})


def detect(args: argparse.Namespace) -> int:
    """Find the conflicts of the objects in GeoParquet files, and write them into others."""
    with _session(args) as spark:
        from conflictdb.spark.detection import detect_on_spark
        from conflictdb.spark.files import read_objects, settings_in, write_conflicts, write_states

        scene = settings_in(args.input[0]) or Scene(args.scene or "spark")
        given = {"name": args.scene} | {name: getattr(args, name) for name in _SETTINGS}
        scene = replace(scene, **{name: value for name, value in given.items() if value is not None})
        objects = read_objects(spark, args.input)
        found = detect_on_spark(spark, objects, scene, partitions=args.partitions, memory_mb=args.memory_mb)
        write_conflicts(found, args.output)
        write_states(objects, scene, args.output)
        note(f"{scene.name}: {spark.read.parquet(args.output).count():,} pairs in {args.output}")
    return DONE


def write_back(args: argparse.Namespace) -> int:
    """Write conflicts that Spark computed into the scene of a database."""
    with database(args) as db:
        done = db.write_back(args.scene, args.file, lock_timeout_s=args.lock_timeout, say=remark)
    out(
        f"{args.scene}: run {done.run_id}, {done.total_s:.1f} s: {done.conflicts:,} conflicts, "
        f"{done.unresolved:,} unresolved; {done.opened:,} opened, {done.changed:,} changed, {done.closed:,} closed"
    )
    if done.behind:
        remark(
            f"{args.scene}: {done.behind:,} objects changed since it was exported, and wait for a detection "
            f"(`conflictdb detect --scene {shlex.quote(args.scene)}` does it)"
        )
    return DONE


def demo(args: argparse.Namespace) -> int:
    """Take the scene that comes with the program through Spark, and hold its answer against that of one machine."""
    scene, areas, tracks, _ = read(str(files("conflictdb") / "scenes" / f"{DEMO_SCENE}.geojson"))
    scene = scene or Scene(DEMO_SCENE)
    with _session(args) as spark, tempfile.TemporaryDirectory() as directory:
        from pyarrow import Table, parquet

        from conflictdb.arrays.arrow.found import of_rows
        from conflictdb.arrays.arrow.objects import of_objects
        from conflictdb.spark.detection import detect_on_spark
        from conflictdb.spark.files import read_objects, write_conflicts

        objects, conflicts = str(Path(directory, "objects.parquet")), str(Path(directory, "conflicts.parquet"))
        parquet.write_table(Table.from_batches([of_objects(areas, tracks)]), objects)
        write_conflicts(detect_on_spark(spark, read_objects(spark, [objects]), scene), conflicts)
        rows = sorted(parquet.read_table(conflicts).to_pylist(), key=_by_keys)
        where = f"Spark {spark.version}, {spark.sparkContext.master}"
    expected = solve(tracks, areas, scene)
    known = sorted(of_rows(expected).to_pylist(), key=_by_keys)
    out(conflict_table(expected))
    out()
    if [_told(row) for row in rows] != [_told(row) for row in known]:
        raise ConflictDBError(f"{where} found another answer than `solve`: {len(rows)} pairs, not {len(known)}")
    out(f"{where} found these {len(rows)} pairs too, and the same times, verdicts and distances to the last digit.")
    return DONE


def _by_keys(row: dict[str, Any]) -> tuple[bool, bytes, bytes]:
    return row["a_kind"] != Kind.AREA, row["a_key"].encode(), row["b_key"].encode()


def _told(row: dict[str, Any]) -> dict[str, Any]:
    """Return what was found of a pair, without where it is and the numbers of its objects, which `solve` leaves out."""
    return {name: value for name, value in row.items() if name not in _LEFT_OUT}


@contextmanager
def _session(args: argparse.Namespace) -> Iterator["SparkSession"]:
    cache = Settings.from_environment().cache / "spark"
    note("Spark starts, in some ten seconds; the first time it fetches its jars (115 MB)")
    with engine.session(args.master, cache, os.environ, is_quiet=not args.debug) as spark:
        yield spark
