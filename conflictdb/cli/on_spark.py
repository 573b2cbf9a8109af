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
from conflictdb.cli.parser import check
from conflictdb.cli.report import conflict_table
from conflictdb.cli.session import database
from conflictdb.database import DEMO_SCENE
from conflictdb.errors import ConflictDBError, StoreError
from conflictdb.in_memory import solve
from conflictdb.io.contents import without_objects
from conflictdb.io.reading import read
from conflictdb.model import Scene
from conflictdb.results import Kind
from conflictdb.server.settings import Settings
from conflictdb.spark import engine

if TYPE_CHECKING:
    from pyspark.sql import DataFrame, SparkSession

# Settings that a scene has unless they are given.
_SETTINGS: Final = ("motion", "earth", "centre", "method", "tolerance_m", "separation_m", "nearest_m")
_LEFT_OUT: Final = frozenset({"region", "a_id", "a_version", "b_id", "b_version"})


def detect(args: argparse.Namespace) -> int:
    """Find the conflicts of the objects in GeoParquet files, or of a scene of the database, and write them to files."""
    check(args, [(not args.input and not args.scene, "say --scene, of the database, or --input, of files")])
    with _given(args) as (spark, scene, objects):
        from conflictdb.spark.detection import detected
        from conflictdb.spark.files import write_conflicts, write_states

        given = {"name": args.scene} | {name: getattr(args, name) for name in _SETTINGS}
        scene = replace(scene, **{name: value for name, value in given.items() if value is not None})
        found = detected(spark, objects, scene, partitions=args.partitions, memory_mb=args.memory_mb)
        write_conflicts(found.conflicts, args.output)
        pairs = spark.read.parquet(args.output).count()
        write_states(found.objects, scene, args.output, pairs)
        note(f"{scene.name}: {pairs:,} pairs in {args.output}")
    return DONE


@contextmanager
def _given(args: argparse.Namespace) -> Iterator["tuple[SparkSession, Scene, DataFrame]"]:
    """Give a session of Spark, and settings and objects of files, or else of the scene of the database."""
    if args.input:
        with _session(args) as spark:
            from conflictdb.spark.files import read_objects, settings_in

            settings, objects = settings_in(args.input), read_objects(spark, args.input)
            if objects.isEmpty():
                raise without_objects("file", ", ".join(args.input), ())
            yield spark, settings or Scene(args.scene or "spark"), objects
        return
    with database(args) as db:
        engine.coordinates()  # says what is missing, before anything is read
        from conflictdb.spark.jdbc import is_reached_by_network, scene_objects

        if is_reached_by_network(db.connection):
            with _session(args, reads_database=True) as spark, scene_objects(spark, db.connection, args.scene) as given:
                yield spark, *given
            return
        with _session(args) as spark, tempfile.TemporaryDirectory() as directory:
            from conflictdb.spark.files import read_objects, settings_in

            _require_here(spark, args.scene)
            path = str(Path(directory, "objects.parquet"))
            db.export(args.scene, path)
            yield spark, settings_in([path]) or Scene(args.scene), read_objects(spark, [path])


def _require_here(spark: "SparkSession", scene: str) -> None:
    """Raise StoreError if executors are on other machines, where they see neither the socket nor what was exported."""
    master = str(spark.sparkContext.master)
    if not master.startswith("local"):
        raise StoreError(
            f"the database is reached by a socket of this machine, and executors of {master} may be on others: name a "
            f"host that they reach, or `conflictdb export --scene {shlex.quote(scene)} FILE.parquet` to where they "
            "read, and give it as --input"
        )


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
            f"{args.scene}: {done.behind:,} objects are not what was computed (they changed since it was exported, in "
            "the database or in the file, or were not in it), and wait for a detection "
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
def _session(args: argparse.Namespace, *, reads_database: bool = False) -> Iterator["SparkSession"]:
    cache = Settings.from_environment().cache / "spark"
    note("Spark starts, in some ten seconds; the first time it fetches its jars (115 MB)")
    with engine.session(
        args.master, cache, os.environ, is_quiet=not args.debug, reads_database=reads_database
    ) as spark:
        yield spark
