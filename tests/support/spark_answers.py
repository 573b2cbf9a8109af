"""Answers of Spark, and what they must be: run as a program, beside the tests, for Spark is one of its own.

    python spark_answers.py DIRECTORY MASTER [reads-database]

takes every `*.job` of a directory, a pickled Job, through one session of Spark, and leaves the conflicts of each beside
it; then runs the commands of conflictdb in `commands.json`, and leaves what they end with and say in `said.json`. Exits
with 2 and one line where Spark does not run here.
"""

import json
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from conflictdb.arrays.arrow.found import of_found
from conflictdb.arrays.arrow.object_rows import of_objects
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.earth.registry import centred, plane_of
from conflictdb.errors import EngineMissing
from conflictdb.in_memory import _InMemory
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Kind
from conflictdb.stages.pieces.covers import pieces_of
from conflictdb.stages.run import run_scene

_ROOT = Path(__file__).parents[2]
_LONGEST_S = 7_200.0
# Java makes no best code of what runs for seconds.
_SHORT_LIVED = "-XX:TieredStopAtLevel=1 -XX:+UseSerialGC"


@dataclass(frozen=True)
class Job:
    """A scene, into how many partitions it is cut, and whether an executor is killed meanwhile."""

    name: str
    scene: Scene
    areas: Sequence[Area]
    tracks: Sequence[Track]
    partitions: int
    kills: bool = False


def answer_of_one_machine(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> pa.Table:
    """The conflicts in the form FOUND, in the order of their keys, as `solve` finds them, and where they are."""
    scene = centred(scene, areas, tracks)
    areas, tracks = (sorted(some, key=lambda one: one.key.encode()) for some in (areas, tracks))
    batch = AreaBatch.of(areas)
    source = _InMemory(pieces_of(scene, plane_of(scene), batch, TrackBatch.of(tracks)), batch.footprint)
    keys = {Kind.AREA.code: [one.key for one in areas], Kind.TRACK.code: [one.key for one in tracks]}
    parts = []
    for found, _ in run_scene(scene, plane_of(scene), source):
        pairs = ((found.a_kind, found.a_id), (found.b_kind, found.b_id))
        named = [[keys[kind][i] for kind, i in zip(*pair, strict=True)] for pair in pairs]
        parts.append(of_found(scene, found, found.where(np.arange(len(found))), *named))
    return in_order(pa.Table.from_batches(parts))


def in_order(found: pa.Table) -> pa.Table:
    """Conflicts in the order of their keys, without the numbers of their objects, which differ."""
    return found.drop_columns(["a_id", "b_id"]).sort_by([(name, "ascending") for name in ("a_kind", "a_key", "b_key")])


def answers(
    jobs: Sequence[Job],
    directory: Path,
    master: str,
    commands: Sequence[Sequence[str]] = (),
    *,
    reads_database: bool = False,
) -> dict[str, pa.Table]:
    """What Spark finds, by the names of jobs; skips the test where Spark does not run and cannot be fetched.

    commands : of the command line, run after that
    reads_database : whether one of them needs the driver of databases
    """
    _add_extra()
    (directory / "commands.json").write_text(json.dumps(commands))
    for job in jobs:
        (directory / f"{job.name}.job").write_bytes(pickle.dumps(job))
    command = [sys.executable, __file__, str(directory), master, *(["reads-database"] if reads_database else [])]
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "JAVA_TOOL_OPTIONS": _SHORT_LIVED}
    done = subprocess.run(command, env=environ, capture_output=True, text=True, timeout=_LONGEST_S, check=False)
    if done.returncode == 2:
        pytest.skip(f"not run on Spark: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    return {job.name: in_order(pq.read_table(directory / f"{job.name}.found")) for job in jobs}


def _add_extra() -> None:
    """Have ./run add Spark to the environment that it made, if this is one and there is Java."""
    if Path(sys.prefix, "made-from").exists():
        environ = {**os.environ, "CONFLICTDB_VENV": sys.prefix}
        subprocess.run([_ROOT / "run", "spark", "--help"], env=environ, capture_output=True, check=False)


def _main(directory: Path, master: str, *, reads_database: bool) -> int:
    from conflictdb.cli import main
    from conflictdb.server.options import Settings
    from conflictdb.spark import engine

    cache = Settings.from_environment().cache / "spark"
    try:
        with engine.session(master, cache, os.environ, is_quiet=False, reads_database=reads_database) as spark:
            from conflictdb.spark.files import read_objects, write_conflicts
            from conflictdb.spark.on_cluster import detect_on_spark

            for path in sorted(directory.glob("*.job")):
                job: Job = pickle.loads(path.read_bytes())  # noqa: S301 what the test wrote
                objects = str(path.with_suffix(".objects"))
                pq.write_table(pa.Table.from_batches([of_objects(job.areas, job.tracks)]), objects)
                found = detect_on_spark(spark, read_objects(spark, [objects]), job.scene, partitions=job.partitions)
                killer = Thread(target=_kill_an_executor, args=(spark.sparkContext.statusTracker(), job.partitions))
                if job.kills:
                    killer.start()
                write_conflicts(found, str(path.with_suffix(".found")))
                if job.kills:
                    killer.join()
                    path.with_suffix(".killed").touch()
    except EngineMissing as error:
        sys.stderr.write(f"{error}\n")
        return 2
    said = []
    for command in json.loads((directory / "commands.json").read_text()):
        with redirect_stderr(StringIO()) as errors:
            said.append((main([*command, "--master", "local[2]"]), errors.getvalue()))
    (directory / "said.json").write_text(json.dumps(said))
    return 0


def _kill_an_executor(tracker: Any, partitions: int) -> None:
    """Kill one executor of this program's, once tasks of a shuffled stage have ended; raises if there is none."""
    while not any(
        (stage := tracker.getStageInfo(number)) and stage.numTasks == partitions and stage.numCompletedTasks
        for number in tracker.getActiveStageIds()
    ):
        time.sleep(0.02)
    for pid, (_, command) in descendants(os.getpid()).items():
        if "CoarseGrainedExecutorBackend" in command:
            os.kill(pid, signal.SIGKILL)
            return
    raise AssertionError("there is no executor to kill")


def descendants(pid: int) -> dict[int, tuple[int, str]]:
    """Processes that one has started, and those started by them: the parent and the command of each."""
    parents = {int(path.name): _parent(path) for path in Path("/proc").iterdir() if path.name.isdigit()}
    found: dict[int, tuple[int, str]] = {}
    newest = {pid}
    while newest:
        newest = {one for one, parent in parents.items() if parent in newest} - set(found)
        found |= {one: (parents[one], _command(one)) for one in newest}
    return found


def _parent(process: Path) -> int:
    try:
        return int((process / "stat").read_text().rpartition(")")[2].split()[1])
    except OSError:  # it has ended
        return 0


def _command(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


if __name__ == "__main__":
    sys.exit(_main(Path(sys.argv[1]), sys.argv[2], reads_database="reads-database" in sys.argv[3:]))
