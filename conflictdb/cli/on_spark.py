"""`spark`: detect scenes that outgrow one machine, on Apache Spark."""

import argparse
import math
import os
import shlex
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import conflict_table
from conflictdb.cli.meter import shown
from conflictdb.cli.output import note, out, remark, warnings_as_remarks
from conflictdb.cli.parser import check
from conflictdb.cli.session import database
from conflictdb.cli.tables import show_table
from conflictdb.client.database import DEMO_SCENE
from conflictdb.embedded.options import Settings
from conflictdb.errors import ConflictDBError, StoreError
from conflictdb.formats.contents import without_objects
from conflictdb.formats.reading import read
from conflictdb.memory.questions import solve
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind
from conflictdb.model.settings import NUMBERS, given
from conflictdb.model.speed_limits import MAX_SPEED_KN
from conflictdb.spark import engine

if TYPE_CHECKING:
    from pyspark.sql import DataFrame, SparkSession

_LEFT_OUT: Final = frozenset({"region", "a_id", "a_version", "b_id", "b_version"})


def detect(args: argparse.Namespace) -> int:
    """Find the conflicts of the objects in GeoParquet files, or of a scene of the database, and write them to files."""
    checks = [
        (not args.input and not args.scene, "say --scene, of the database, or --input, of files"),
        (args.max_speed_kn is not None and not args.input, "--max-speed-kn is for files"),
    ]
    check(args, checks)
    # The database has checked its own.
    fastest_kn = math.inf if not args.input else MAX_SPEED_KN if args.max_speed_kn is None else args.max_speed_kn
    with _given(args) as (spark, scene, objects):
        from conflictdb.spark.files import write_conflicts, write_states
        from conflictdb.spark.on_cluster import detected

        with _shown_progress(spark) as begin:
            begin("cutting objects")
            memory_mb, partitions = args.memory_mb, args.partitions
            with warnings_as_remarks():
                found = detected(
                    spark, objects, scene, partitions=partitions, memory_mb=memory_mb, max_speed_kn=fastest_kn
                )
            begin("joining and solving")
            write_conflicts(found.conflicts, args.output, overwrite=args.overwrite)
            begin("counting")
            pairs = spark.read.schema("a_key string").parquet(args.output).count()
            write_states(found.objects, scene, args.output, pairs)
        note(f"{scene.name}: {pairs:,} pairs in {args.output}")
    return DONE


@contextmanager
def _given(args: argparse.Namespace) -> Iterator["tuple[SparkSession, Scene, DataFrame]"]:
    """Yield a session of Spark, and settings and objects from files or from the scene of the database.

    Raises InvalidInput, before anything is computed, if the output cannot be written.
    """
    if args.input:
        with _session(args) as spark:
            from conflictdb.spark.files import read_scene, require_output

            require_output(spark, args.output, overwrite=args.overwrite)
            settings, objects = read_scene(spark, args.input, remark)
            require_output(spark, args.output, objects, overwrite=args.overwrite)
            if objects.isEmpty():
                raise without_objects("file", ", ".join(args.input), ())
            scene = _with_options(args, settings or Scene(args.scene or "spark"))
            if settings is None:
                remark(f"the input does not say the settings of its scene: {_settings_text(scene)}")
            yield spark, scene, objects
        return
    with database(args) as db:
        engine.coordinates()  # reports missing packages before anything is read
        from conflictdb.spark.jdbc import is_reached_by_network, scene_objects

        by_network = is_reached_by_network(db.connection)
        with _session(args, reads_database=by_network) as spark:
            from conflictdb.spark.files import read_scene, require_output

            require_output(spark, args.output, overwrite=args.overwrite)
            if by_network:
                with scene_objects(spark, db.connection, args.scene) as (scene, objects):
                    yield spark, _with_options(args, scene), objects
                return
            _require_here(spark, args.scene)
            with tempfile.TemporaryDirectory() as directory:
                path = str(Path(directory, "objects.parquet"))
                db.scene(args.scene).export(path)
                settings, objects = read_scene(spark, [path])
                yield spark, _with_options(args, settings or Scene(args.scene)), objects


def _with_options(args: argparse.Namespace, scene: Scene) -> Scene:
    return replace(scene, **given(args), **({} if args.scene is None else {"name": args.scene}))


def _settings_text(scene: Scene) -> str:
    parts = [str(scene.motion), str(scene.earth)]
    for name in NUMBERS:
        words, _, unit = name.rpartition("_")
        parts.append(f"{words.replace('_', ' ')} {getattr(scene, name):g} {unit}")
    return ", ".join(parts)


@contextmanager
def _shown_progress(spark: "SparkSession", every_s: float = 1.0) -> Iterator[Callable[[str], None]]:
    """Show Spark's finished tasks on a terminal; yields a function that sets the present activity."""
    began_s = time.monotonic()
    activity = "starting"
    tracker = spark.sparkContext.statusTracker()

    def begin(text: str) -> None:
        nonlocal activity
        activity = text

    def text() -> str:
        stages = []
        with suppress(Exception):  # Spark may be ending
            stages = [tracker.getStageInfo(number) for number in tracker.getActiveStageIds()]
        done = sum(one.numCompletedTasks for one in stages if one)
        tasks = sum(one.numTasks for one in stages if one)
        tasks_text = f", {done:,} of {tasks:,} tasks" if tasks else ""
        return f"Spark: {activity}{tasks_text}, {time.monotonic() - began_s:.0f} s"

    with shown(text, every_s):
        yield begin


def _require_here(spark: "SparkSession", scene: str) -> None:
    """Raise StoreError if executors may be on other machines, without access to the socket and the exported file."""
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
        done = db.scene(args.scene).write_back(args.file, lock_timeout_s=args.lock_timeout, say=remark)
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
    """Take the packaged scene through Spark, and compare its answer with that of one machine."""
    scene, areas, tracks, _ = read(str(files("conflictdb") / "scenes" / f"{DEMO_SCENE}.geojson"))
    scene = scene or Scene(DEMO_SCENE)
    with _session(args) as spark, tempfile.TemporaryDirectory() as directory:
        from pyarrow import Table, parquet

        from conflictdb.arrays.arrow.found import of_rows
        from conflictdb.arrays.arrow.object_rows import of_objects
        from conflictdb.spark.files import read_objects, write_conflicts
        from conflictdb.spark.on_cluster import detect_on_spark

        objects, conflicts = str(Path(directory, "objects.parquet")), str(Path(directory, "conflicts.parquet"))
        parquet.write_table(Table.from_batches([of_objects(areas, tracks)]), objects)
        write_conflicts(detect_on_spark(spark, read_objects(spark, [objects]), scene), conflicts)
        rows = sorted(parquet.read_table(conflicts).to_pylist(), key=_by_keys)
        where = f"Spark {spark.version}, {spark.sparkContext.master}"
    expected = solve(tracks, areas, scene)
    known = sorted(of_rows(expected).to_pylist(), key=_by_keys)
    show_table(conflict_table(expected))
    out()
    if [_compared(row) for row in rows] != [_compared(row) for row in known]:
        raise ConflictDBError(f"{where} found another answer than `solve`: {len(rows)} pairs, not {len(known)}")
    out(f"{where} found these {len(rows)} pairs too, and the same times, verdicts and distances to the last digit.")
    return DONE


def _by_keys(row: dict[str, Any]) -> tuple[bool, bytes, bytes]:
    return row["a_kind"] != Kind.AREA, row["a_key"].encode(), row["b_key"].encode()


def _compared(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row without region and object numbers, which `solve` does not return."""
    return {name: value for name, value in row.items() if name not in _LEFT_OUT}


@contextmanager
def _session(args: argparse.Namespace, *, reads_database: bool = False) -> Iterator["SparkSession"]:
    cache = Settings.from_environment().cache / "spark"
    note("Spark starts, in some ten seconds; the first time it fetches its jars (115 MB)")
    with engine.session(
        args.master,
        cache,
        os.environ,
        is_quiet=not args.debug,
        reads_database=reads_database,
        options=dict(args.conf or ()),
    ) as spark:
        yield spark
