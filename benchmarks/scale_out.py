"""A scene on Spark with one processor, with two, on a cluster of two executors, and by `detect` in PostgreSQL.

    ./.venv/bin/python benchmarks/scale_out.py [--legs 100000 1000000] [--dsn DSN] [--jobs 2]
        [--document docs/explanation/performance.md] [--folder docs/explanation/performance]

Scenes are the *sea* of quick_sea.py, with the same density at any size, in a file of GeoParquet. Each run is a process
of its own, with a Java of its own. `local[1]` is bound to one processor, which Java and Python share, `local[2]` to
two. The cluster is a master and two workers of one processor each, which communicate over the loopback; the driver has
no processor of its own. `detect` has the scene in a new database, and writes all rows. All must find the same number of
conflicts.

Seconds are by the clock: run it on an otherwise idle machine. Those of Spark come from its event log. *pieces* is
reading, checking and cutting objects, *join* stages 1 and 2, *solve* stages 3 and 4 with merging and writing the files.
*between* is the time without a running task, and for `detect` the time to write. *before* is starting Spark, or loading
the database. Loading includes reading and checking objects, which Spark does within *pieces*. Memory is the peak of one
process, disk the peak of Spark's own directory, 115 MB of it jars; the disk of the cluster is not measured.
"""

import argparse
import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow.parquet as pq
import quick_sea
from measured import WARM, fresh_database, in_fresh_process, load, versions, write_csv
from sparked import EXECUTOR_MEMORY, Watched, events, logged, operators
from tables import markdown, show

import conflictdb
from conflictdb import Scene
from conflictdb.arrays.arrow.object_rows import OBJECTS, to_objects

SEED: Final = 1
SCENE: Final = Scene("sea")
PARTS: Final = ("pieces", "join", "solve")
ALONE, TOGETHER, CLUSTER, DATABASE = "local[1]", "local[2]", "2 executors", "PostgreSQL"
# The same everywhere, so that all runs do the same work: four for each of two processors, and each of limited size.
PARTITIONS: Final = 8
LEGS_OF_A_PARTITION: Final = 12_500
# Machines that the model is of: processors, and bytes a second that the network brings each (10 Gbit).
PROCESSORS: Final = 8
NETWORK: Final = 1.25e9
MACHINES: Final = (1, 2, 4, 8, 16)
MOST_MACHINES: Final = 1_000


@dataclass(frozen=True)
class Taken:
    """Times of one way to detect a scene, seconds by the clock.

    before_s : to start Spark, or to load the database
    task_s : of all tasks together, except single tasks of a stage
    single_s : of stages of one task
    """

    before_s: float
    pieces_s: float
    join_s: float
    solve_s: float
    between_s: float
    total_s: float
    conflicts: int
    task_s: float | None = None
    single_s: float | None = None
    shuffled_mb: float | None = None
    spilled_mb: float | None = None
    java_mb: float | None = None
    worker_mb: float | None = None
    disk_mb: float | None = None


def on_spark(master: str, processors: int, path: str, partitions: int, directory: str) -> tuple[Taken, str]:
    """Detect the scene in a file on Spark; all processes started by this one share the given processors.

    Return its times and memory, and the version of Spark.
    """
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:processors])
    output, began = Path(directory, "conflicts"), time.time()
    # Executors of a cluster belong to the process that started the cluster, not to this one.
    with Watched(os.getppid(), Path(directory)) as held, logged(master, Path(directory)) as spark:
        from conflictdb.spark.files import read_objects, write_conflicts
        from conflictdb.spark.on_cluster import detect_on_spark

        started = time.time()
        found = detect_on_spark(spark, read_objects(spark, [path]), SCENE, partitions=partitions)
        write_conflicts(found, str(output))
        ended, version = time.time(), f"Spark {spark.version}"
    conflicts = sum(pq.read_metadata(part).num_rows for part in output.glob("*.parquet"))
    taken = times_of(events(Path(directory)), started, ended) | {"java_mb": held.java_mb, "worker_mb": held.worker_mb}
    if master.startswith("local"):
        taken["disk_mb"] = held.disk_mb
    return Taken(started - began, **taken, total_s=ended - started, conflicts=conflicts), version


def times_of(events: Iterable[dict[str, Any]], began: float, ended: float) -> dict[str, float]:
    """Return seconds by parts, task_s, single_s and megabytes, as Spark's log of events has them."""
    spans: dict[str, list[tuple[float, float]]] = {part: [] for part in PARTS}
    tasks: dict[int, float] = {}
    single_s = shuffled = spilled = 0.0
    alone = set()
    for event in events:
        if event["Event"] == "SparkListenerStageCompleted":
            stage = event["Stage Info"]
            span = stage["Submission Time"] / 1e3, stage["Completion Time"] / 1e3
            spans[_part(stage)].append(span)
            if stage["Number of Tasks"] == 1:
                alone.add(stage["Stage ID"])
                single_s += span[1] - span[0]
        else:
            metrics, info, stage_id = event["Task Metrics"], event["Task Info"], event["Stage ID"]
            taken = (info["Finish Time"] - info["Launch Time"]) / 1e3
            tasks[stage_id] = tasks.get(stage_id, 0.0) + taken
            shuffled += metrics["Shuffle Write Metrics"]["Shuffle Bytes Written"]
            spilled += metrics["Disk Bytes Spilled"]
    within = {f"{part}_s": _together(spans[part]) for part in PARTS}
    every = _together([span for part in PARTS for span in spans[part]])
    return within | {
        "between_s": ended - began - every,
        "task_s": sum(taken for stage, taken in tasks.items() if stage not in alone),
        "single_s": single_s,
        "shuffled_mb": shuffled / 1e6,
        "spilled_mb": spilled / 1e6,
    }


def _part(stage: dict[str, Any]) -> str:
    """Return which part a stage of Spark is of, by the operators in it."""
    names = operators(stage)
    if "WriteFiles" in names:
        return "solve"
    # Pieces are cached where they are made, dealt out by an explode, and joined by workers.
    is_join = "Generate" in names or ("PythonMapInArrow" in names and "mapPartitionsInternal" not in names)
    return "join" if is_join else "pieces"


def _together(spans: Sequence[tuple[float, float]]) -> float:
    """Return the length of the union of some spans."""
    total, until = 0.0, -float("inf")
    for start, end in sorted(spans):
        total += max(0.0, end - max(start, until))
        until = max(until, end)
    return total


@contextmanager
def cluster(directory: Path) -> Iterator[str]:
    """Yield the address of a standalone cluster of two workers on the loopback; it ends with the block."""
    import pyspark

    home = Path(pyspark.__file__).parent
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"spark://127.0.0.1:{free.getsockname()[1]}"
    common = ["--host", "127.0.0.1", "--webui-port", "0"]
    worker = [*common, "--cores", "1", "--memory", EXECUTOR_MEMORY, "--work-dir", str(directory), address]
    commands = [
        ["org.apache.spark.deploy.master.Master", *common, "--port", address.rpartition(":")[2]],
        *[["org.apache.spark.deploy.worker.Worker", *worker]] * 2,
    ]
    with ExitStack() as started, (directory / "said").open("w") as said:
        for command in commands:
            process = subprocess.Popen(
                [str(home / "bin" / "spark-class"), *command],
                env={**os.environ, "SPARK_HOME": str(home)},
                stdout=said,
                stderr=said,
            )
            started.callback(process.wait)
            started.callback(process.terminate)
        yield address


def in_postgresql(dsn: str, path: str, jobs: int) -> tuple[Taken, str]:
    """Detect the scene in a file in a database; return its times and memory, and the versions of all software."""
    with conflictdb.connect(dsn) as db:
        db.scene(WARM).detect()
        began = time.time()
        file = pq.ParquetFile(path)
        load(db, SCENE, map(to_objects, file.iter_batches(quick_sea.AT_ONCE, columns=OBJECTS.schema.names)))
        loaded = time.time()
        run = db.scene(SCENE.name).detect(full=True, jobs=jobs)
        join_s, solve_s = run.stage1_s + run.stage2_s, run.stage3_s + run.stage4_s
        total_s = time.time() - loaded
        between_s = total_s - run.pieces_s - join_s - solve_s
        taken = Taken(loaded - began, run.pieces_s, join_s, solve_s, between_s, total_s, run.conflicts)
        return taken, versions(db.connection)


def measure(legs: int, target: str | None, jobs: int) -> tuple[list[dict[str, Any]], str]:
    """Return the rows of a scene, a way each, and versions; ends the program where they find different conflicts."""
    with tempfile.TemporaryDirectory() as held:
        directory = Path(held)
        path = directory / "sea.parquet"
        began = time.time()
        objects = quick_sea.write(path, SCENE, legs, SEED)
        print(f"{objects:,} objects made in {time.time() - began:.1f} s", flush=True)
        found: dict[str, Taken] = {}
        for way, processors in ((ALONE, 1), (TOGETHER, 2), (CLUSTER, 2)):
            own = directory / way
            own.mkdir()
            with cluster(own) if way == CLUSTER else ExitStack() as address:
                master = address if way == CLUSTER else way
                partitions = max(PARTITIONS, legs // LEGS_OF_A_PARTITION)
                found[way], spark = in_fresh_process(on_spark, master, processors, str(path), partitions, str(own))
            print(way, found[way], flush=True)
        with fresh_database(target) as dsn:
            found[DATABASE], software = in_fresh_process(in_postgresql, dsn, str(path), jobs)
        print(DATABASE, found[DATABASE], flush=True)
    if len({taken.conflicts for taken in found.values()}) > 1:
        raise SystemExit(f"conflicts differ: { {way: taken.conflicts for way, taken in found.items()} }")
    return [{"legs": legs, "objects": objects, "way": way, **asdict(taken)} for way, taken in found.items()], (
        f"{software.removesuffix('.')}, {spark}"
    )


def modelled_s(alone: dict[str, Any], machines: int, processors: int) -> float:
    """Return the time of a scene on some machines of some processors each, computed from its time on one processor.

    The time of stages of one task, and between tasks, stays the same. Tasks share the processors. Each machine receives
    its share of the shuffled data, minus the part that it has already.
    """
    network_s = alone["shuffled_mb"] * 1e6 / NETWORK * (machines - 1) / machines**2
    return float(alone["between_s"] + alone["single_s"] + alone["task_s"] / (machines * processors) + network_s)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return tables in Markdown: the measurements, and the model's prediction for the largest scene."""
    heads = ("legs", "way", "before, s", *PARTS, "between", "all, s", "times as fast", "efficiency")
    sizes = {"shuffled_mb": "shuffled", "disk_mb": "disk", "java_mb": "a Java", "worker_mb": "a worker, MB"}
    lines = []
    for row in rows:
        alone = next(one for one in rows if one["legs"] == row["legs"] and one["way"] == ALONE)
        faster = alone["total_s"] / row["total_s"]
        lines.append(
            [
                f"{row['legs']:,}",
                row["way"],
                *(f"{row[name]:.3g}" for name in ("before_s", *(f"{part}_s" for part in PARTS), "between_s")),
                f"{row['total_s']:.3g}",
                f"{faster:.2f}",
                f"{faster / 2:.0%}" if row["way"] in (TOGETHER, CLUSTER) else "",
                *("" if row[name] is None else f"{row[name]:,.0f}" for name in sizes),
            ]
        )
    largest = [row for row in rows if row["legs"] == rows[-1]["legs"]]
    ways = {row["way"]: row for row in largest}
    alone = ways[ALONE]
    note = (
        f"{alone['legs']:,} legs are {alone['objects']:,} objects; all ways found {alone['conflicts']:,} conflicts. "
        f"On one processor {alone['between_s']:.3g} s passed between tasks, {alone['single_s']:.3g} s in stages of one "
        f"task and {alone['task_s']:.3g} s in all others. By these the model foretells {modelled_s(alone, 1, 2):.3g} s "
        f"for two processors, where {ways[TOGETHER]['total_s']:.3g} and {ways[CLUSTER]['total_s']:.3g} s were "
        f"measured; on machines of {PROCESSORS} processors and {8 * NETWORK / 1e9:.0f} Gbit/s, which were not measured:"
    )
    modelled = [(n, modelled_s(alone, n, PROCESSORS)) for n in MACHINES]
    model = [
        [f"{n}", f"{taken:.3g}", f"{n * PROCESSORS * taken:,.0f}", f"{alone['total_s'] / taken / n / PROCESSORS:.0%}"]
        for n, taken in modelled
    ]
    costs = markdown(("machines", "foretold, s", "processor seconds paid", "efficiency"), model)
    return f"{markdown((*heads, *sizes.values()), lines)}\n\n{_winner(rows)}\n\n{note}\n\n{costs}"


def _winner(rows: Sequence[dict[str, Any]]) -> str:
    """Return the faster of PostgreSQL and Spark for each scene, and at how many machines Spark would be."""
    sentences = []
    for legs in dict.fromkeys(row["legs"] for row in rows):
        ways = {row["way"]: row for row in rows if row["legs"] == legs}
        spark_s, loaded_s = ways[TOGETHER]["total_s"], ways[DATABASE]["total_s"]
        with_loading_s = loaded_s + ways[DATABASE]["before_s"]
        counts = [n for n in range(1, MOST_MACHINES) if modelled_s(ways[ALONE], n, 2) < loaded_s]
        sentences.append(
            f"For {legs:,} legs PostgreSQL takes {loaded_s / spark_s:.0%} of the time of Spark on the same two "
            f"processors, {with_loading_s / spark_s:.0%} with the loading of its database; by the model below Spark "
            + (f"overtakes the loaded database with {counts[0]} machines of two." if counts else "never overtakes it.")
        )
    return " ".join(sentences)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--legs", type=int, nargs="+", default=[100_000], help="of scenes, up to a million")
    parser.add_argument("--dsn", help="server to make databases on (default: the embedded one)")
    parser.add_argument("--jobs", type=int, default=2, help="of `detect`")
    parser.add_argument("--folder", type=Path, help="write scale_out.csv there")
    parser.add_argument("--document", type=Path, help="put the tables there")
    args = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for legs in args.legs:
        some, software = measure(legs, args.dsn, args.jobs)
        rows += some
        if args.folder:
            write_csv(args.folder / "scale_out.csv", rows)
    text = f"{table(rows)}\n\n{software}."
    show(text, "scale out", args.document)


if __name__ == "__main__":
    main()
