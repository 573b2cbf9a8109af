"""How evenly Spark spreads crowded scenes over its partitions, and the memory of its workers meanwhile.

    ./.venv/bin/python benchmarks/skew_on_spark.py [--document docs/how-to/run-on-spark.md]

Scenes are a sea of 20,000 legs unchanged; with one area over everything without time limits; with 10,000 tracks in one
port; and with 1,000 versions of one of its tracks. There are 16 partitions on `local[2]`. Rows are the pieces that a
task receives, to join or with the pairs to solve: the largest task divided by the median, by the event log.
"""

import argparse
import os
import statistics
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import quick_sea
import shapely
from measured import in_fresh_process
from scenes import T0_US
from sparked import Watched, events, logged, operators
from tables import markdown, put_into

from conflictdb import Area, Scene, Track, rectangle_outline_m
from conflictdb.arrays.arrow.object_rows import of_objects, to_objects
from conflictdb.formats.parquet_writing import write_objects

SEED: Final = 1
LEGS: Final = 20_000
PARTITIONS: Final = 16
SHIPS: Final = 10_000
VERSIONS: Final = 1_000
DAY_US: Final = 24 * 3_600_000_000
# Half the side of the port, degrees.
PORT: Final = 0.1


def everything(objects: pa.RecordBatch) -> pa.RecordBatch:
    """One area over all objects, for ever."""
    west, south, east, north = shapely.total_bounds(shapely.from_wkb(objects["geometry"].to_numpy(False)))
    return of_objects([Area("ALL", shapely.MultiPolygon([shapely.box(west, south, east, north)]))], [])


def port(_: pa.RecordBatch) -> pa.RecordBatch:
    """Ships that move for an hour or two in one place, begun at any time of a day."""
    rng = np.random.default_rng(SEED)
    places = rng.uniform(-PORT, PORT, (SHIPS, 3, 2))
    times = T0_US + (rng.uniform(0, DAY_US, (SHIPS, 1)) + np.array([0.0, 0.02, 0.05]) * DAY_US).astype(np.int64)
    haven = rectangle_outline_m(60.0, 40.0, 15.0, 15.0)
    return of_objects([], [Track(f"S{i}", places[i], times[i], haven) for i in range(SHIPS)])


def versions(objects: pa.RecordBatch) -> pa.RecordBatch:
    """One track many times."""
    _, (track, *_) = to_objects(objects)
    return of_objects([], [replace(track, key=f"V{i}") for i in range(VERSIONS)])


SCENES: Final = {
    "the sea": None,
    "and one area over everything, for ever": everything,
    f"and {SHIPS:,} tracks in one port": port,
    f"and {VERSIONS:,} versions of one track": versions,
}


@dataclass(frozen=True)
class Spread:
    """Results of a scene: rows and seconds of all tasks of a stage, the most over the median of both, and megabytes."""

    joined: int
    join_rows: float
    join_s: float
    solved: int
    solve_rows: float
    solve_s: float
    total_s: float
    worker_mb: float
    java_mb: float


def spread_of(path: str, directory: str) -> Spread:
    """Return how the scene in a file spreads over partitions."""
    with Watched(os.getpid(), Path(directory)) as held, logged("local[2]", Path(directory)) as spark:
        from conflictdb.spark.files import read_objects, write_conflicts
        from conflictdb.spark.on_cluster import detect_on_spark

        found = detect_on_spark(spark, read_objects(spark, [path]), Scene("sea"), partitions=PARTITIONS)
        write_conflicts(found, str(Path(directory, "conflicts")))
    part_of, tasks = {}, []
    first, last = float("inf"), 0.0
    for event in events(Path(directory)):
        if event["Event"] == "SparkListenerStageCompleted":
            names, stage = operators(event["Stage Info"]), event["Stage Info"]["Stage ID"]
            if "WriteFiles" in names:
                part_of[stage] = "solve"
            elif "PythonMapInArrow" in names and "Exchange" in names:
                part_of[stage] = "join"  # the last of those that match so
        else:
            tasks.append(event)
        info = event.get("Task Info")
        if info:
            first, last = min(first, info["Launch Time"]), max(last, info["Finish Time"])
    numbers: dict[str, Any] = {}
    for part, done in (("join", "joined"), ("solve", "solved")):
        stage = max(number for number, of in part_of.items() if of == part)
        some = [task for task in tasks if task["Stage ID"] == stage]
        rows = [int(task["Task Metrics"]["Shuffle Read Metrics"]["Total Records Read"]) for task in some]
        numbers[done] = sum(rows)
        numbers[f"{part}_rows"] = _skew(rows)
        spans = [task["Task Info"]["Finish Time"] - task["Task Info"]["Launch Time"] for task in some]
        numbers[f"{part}_s"] = _skew(spans)
    return Spread(**numbers, total_s=(last - first) / 1e3, worker_mb=held.worker_mb, java_mb=held.java_mb)


def _skew(values: list[int]) -> float:
    return max(values) / max(statistics.median(values), 1)


def _batches(name: str) -> Iterator[pa.RecordBatch]:
    more = SCENES[name]
    for batch in quick_sea.batches(LEGS, SEED):
        yield batch
        if more and batch["kind"][0].as_py() == "track":
            yield more(batch)
            more = None


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--document", type=Path, help="put the table there")
    args = parser.parse_args()
    lines = []
    for name in SCENES:
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory, "scene.parquet")
            with path.open("wb") as stream:
                write_objects(stream, Scene("sea"), _batches(name))
            found: Spread = in_fresh_process(spread_of, str(path), directory)
        print(name, found, flush=True)
        lines.append(
            [
                name,
                f"{found.joined:,}",
                f"{found.join_rows:.2f}",
                f"{found.join_s:.2f}",
                f"{found.solved:,}",
                f"{found.solve_rows:.2f}",
                f"{found.solve_s:.2f}",
                f"{found.worker_mb:.0f}",
                f"{found.java_mb:,.0f}",
            ]
        )
    heads = ("scene", "rows joined", "skew", "seconds", "rows solved", "skew", "seconds", "a worker, MB", "Java, MB")
    text = markdown(heads, lines)
    print(text)
    if args.document:
        put_into(args.document, "skew on Spark", text)


if __name__ == "__main__":
    main()
