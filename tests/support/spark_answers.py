"""Answers of Spark, and the expected ones: all tests share one program that runs Spark.

    python spark_answers.py

reads requests, one JSON object a line, and answers each with a line. `master`, `directory` run every `*.job` of a
directory, a pickled Job, in a Spark session, and write the conflicts of each into the same directory. `commands` are
run, and the answer is their exit codes and output; they share one session, also with jobs of its master. With
`is_alone` they have a session of their own. With `kills_worker` the first Python worker that appears is killed
meanwhile.
"""

import importlib
import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr, suppress
from dataclasses import dataclass
from functools import cache
from io import StringIO
from pathlib import Path
from threading import Thread
from typing import Any, TextIO
from unittest.mock import patch

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from conflictdb.arrays.arrow.found import of_found
from conflictdb.arrays.arrow.object_rows import of_objects
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core.near import Memory
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.run import run_scene
from conflictdb.earth.registry import Setup, centred
from conflictdb.embedded.options import Settings
from conflictdb.errors import EngineMissing
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Kind
from conflictdb.spark import engine, work_units

_ROOT = Path(__file__).parents[2]
# Java makes no best code of what runs for seconds, and verifies no classes of Spark; nobody looks at pages of Spark.
SHORT_LIVED = (
    "-XX:TieredStopAtLevel=1 -XX:+UseSerialGC -XX:+UnlockDiagnosticVMOptions -XX:-BytecodeVerificationRemote "
    "-XX:ReservedCodeCacheSize=240m -Dspark.ui.enabled=false"
)
_LOGGED = "-Dspark.eventLog.enabled=true"
_MASTER = "local[2]"
_EVERY_S = 0.05
_LONGEST_S = 120.0
# Pairs for which a cell is divided, so that small scenes have crowds.
_FEW_PAIRS = 100
# Java that is interrupted earlier ends by itself; Spark is ready after more than a second.
_STARTED_S = 0.5


@dataclass(frozen=True)
class Job:
    """A scene, its number of partitions, whether some cell is crowded, and whether an executor is killed meanwhile."""

    name: str
    scene: Scene
    areas: Sequence[Area]
    tracks: Sequence[Track]
    partitions: int
    is_crowded: bool = False
    kills: bool = False


def answer_of_one_machine(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> pa.Table:
    """The conflicts in the form FOUND, in the order of their keys, as `solve` finds them, and where they are."""
    scene = centred(scene, areas, tracks)
    areas, tracks = (sorted(some, key=lambda one: one.key.encode()) for some in (areas, tracks))
    batches = AreaBatch.of(areas), TrackBatch.of(tracks)
    source = Memory(pieces_of(Setup.of(scene), *batches), batches)
    keys = {Kind.AREA.code: [one.key for one in areas], Kind.TRACK.code: [one.key for one in tracks]}
    parts = []
    for found, _ in run_scene(Setup.of(scene), source):
        pairs = ((found.a_kind, found.a_id), (found.b_kind, found.b_id))
        named = [[keys[kind][i] for kind, i in zip(*pair, strict=True)] for pair in pairs]
        parts.append(of_found(scene, found, found.where(np.arange(len(found))), *named))
    answer = in_order(pa.Table.from_batches(parts))
    names = {one.key: one.name for one in (*areas, *tracks)}
    for side in ("a", "b"):
        of_side = pa.array([names[key] for key in answer[f"{side}_key"].to_pylist()], pa.string())
        answer = answer.set_column(answer.schema.get_field_index(f"{side}_name"), f"{side}_name", of_side)
    return answer


def in_order(found: pa.Table) -> pa.Table:
    """Conflicts in the order of their keys, without the numbers of their objects, which differ."""
    return found.drop_columns(["a_id", "b_id"]).sort_by([(name, "ascending") for name in ("a_kind", "a_key", "b_key")])


class Spark:
    """The program, while it runs; the first request skips its test where Spark does not run."""

    def __init__(self, process: "subprocess.Popen[str]", said: TextIO, events: Path) -> None:
        self._process, self._said, self._events = process, said, events

    def found(self, jobs: Sequence[Job], directory: Path, master: str = _MASTER) -> dict[str, pa.Table]:
        """Return the conflicts of Spark, by the names of jobs."""
        for job in jobs:
            (directory / f"{job.name}.job").write_bytes(pickle.dumps(job))
        self._ask(directory=str(directory), master=master)
        return {job.name: in_order(pq.read_table(directory / f"{job.name}.found")) for job in jobs}

    def run(
        self, commands: Sequence[Sequence[str]], *, is_alone: bool = False, kills_worker: bool = False
    ) -> list[tuple[int, str]]:
        """Return exit codes of commands of the command line, and their output."""
        answer = self._ask(commands=commands, is_alone=is_alone or kills_worker, kills_worker=kills_worker)
        return [(code, text) for code, text in answer["said"]]

    def logs(self) -> list[str]:
        """Return what Spark has logged of its jobs, for all tests."""
        return [path.read_text() for path in self._events.iterdir()]

    def _ask(self, **request: object) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        self._said.seek(0)
        assert line, self._said.read()
        answer = json.loads(line)
        if "missing" in answer:
            pytest.skip(f"not run on Spark: {answer['missing']}")
        assert "failed" not in answer, answer["failed"]
        return answer


@contextmanager
def running_spark() -> Iterator[Spark]:
    """Run the program until the end of the block."""
    _add_extra()
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with (
        tempfile.TemporaryDirectory() as events,
        tempfile.TemporaryFile("w+") as said,
        subprocess.Popen(
            [sys.executable, __file__],
            env=environ | {"JAVA_TOOL_OPTIONS": f"{SHORT_LIVED} {_LOGGED} -Dspark.eventLog.dir=file:{events}"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
        ) as process,
    ):
        yield Spark(process, said, Path(events))


def need_pyspark() -> None:
    """Skip the test where the library of Spark is not here and cannot be fetched."""
    _add_extra()
    importlib.invalidate_caches()
    pytest.importorskip("pyspark", reason="not run: pyspark is not here (`./run spark` adds it)")


@cache
def _add_extra() -> None:
    """Have ./run add Spark to the environment that it made, if this is one and there is Java."""
    if Path(sys.prefix, "made-from").exists():
        environ = {**os.environ, "CONFLICTDB_VENV": sys.prefix}
        subprocess.run([_ROOT / "run", "spark", "--help"], env=environ, capture_output=True, check=False)


def _main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of Java is no answer
    patch.object(work_units, "_LEAST_PAIRS", _FEW_PAIRS).start()
    missing = _begin()
    for line in sys.stdin:
        try:
            answer = {"missing": missing} if missing else _answer(**json.loads(line))
        except Exception:
            answer = {"failed": traceback.format_exc()}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
    _stop()


def _begin() -> str | None:
    """Start Java with all jars, also the driver of databases; return missing ones."""
    try:
        with _kept(), engine.session(_MASTER, _cache(), os.environ, is_quiet=False, reads_database=True):
            return None
    except (EngineMissing, ImportError) as error:
        return str(error)


def _answer(
    *,
    directory: str = "",
    master: str = "",
    commands: Sequence[Sequence[str]] = (),
    is_alone: bool = False,
    kills_worker: bool = False,
) -> dict[str, object]:
    if directory:
        _take(Path(directory), master)
        return {}
    if is_alone:
        _stop()
    killed: list[int] = []
    killer = Thread(target=_kill, args=(_python_workers, killed))
    if kills_worker:
        killer.start()
    said = [_run(command) for command in commands]
    if kills_worker:
        killer.join()
        assert killed, "there was no worker to kill"
    return {"said": said}


def _run(command: Sequence[str]) -> tuple[int, str]:
    """Run a command, and keep its session for the next."""
    from conflictdb.cli import main

    with _kept(), redirect_stderr(StringIO()) as errors:
        return main([*command, "--master", _MASTER]), errors.getvalue()


@contextmanager
def _kept() -> Iterator[None]:
    """Keep the session that begins in the block."""
    from pyspark.sql import SparkSession

    with patch.object(SparkSession, "stop"):
        yield


def _stop() -> None:
    """End the session that commands share."""
    from pyspark.sql import SparkSession

    if (session := SparkSession.getActiveSession()) is not None:
        session.stop()


def _cache() -> Path:
    return Settings.from_environment().cache / "spark"


def _take(directory: Path, master: str) -> None:
    """Take the jobs of a directory through a session: that of commands, or one of another master."""
    if master != _MASTER:
        _stop()
    keeps = _kept() if master == _MASTER else nullcontext()
    with keeps, engine.session(master, _cache(), os.environ, is_quiet=False) as spark:
        from conflictdb.spark import joining
        from conflictdb.spark.files import read_objects, write_conflicts
        from conflictdb.spark.on_cluster import detect_on_spark

        for path in sorted(directory.glob("*.job")):
            job: Job = pickle.loads(path.read_bytes())  # noqa: S301 what the test wrote
            objects = str(path.with_suffix(".objects"))
            pq.write_table(pa.Table.from_batches([of_objects(job.areas, job.tracks)]), objects)
            with _recorded(joining, "cells_of") as cells:
                found = detect_on_spark(spark, read_objects(spark, [objects]), job.scene, partitions=job.partitions)
            assert not job.is_crowded or cells[0].blocks.max() > 1, "no cell is dealt into blocks"
            killed: list[int] = []
            tracker = spark.sparkContext.statusTracker()
            killer = Thread(target=_kill_an_executor, args=(tracker, job.partitions, killed))
            if job.kills:
                killer.start()
            write_conflicts(found, str(path.with_suffix(".found")))
            if job.kills:
                killer.join()
                assert killed, "there was no executor to kill"


@contextmanager
def _recorded(module: Any, name: str) -> Iterator[list[Any]]:
    """Yield a list to which each call of a function adds its result."""
    function, results = getattr(module, name), []

    def called(*arguments: Any) -> Any:
        results.append(function(*arguments))
        return results[-1]

    with patch.object(module, name, called):
        yield results


def _kill_an_executor(tracker: Any, partitions: int, killed: list[int]) -> None:
    """Kill one executor of this program's, once tasks of a shuffled stage have ended."""
    until_s = time.monotonic() + _LONGEST_S
    while not any(
        (stage := tracker.getStageInfo(number)) and stage.numTasks == partitions and stage.numCompletedTasks
        for number in tracker.getActiveStageIds()
    ):
        if time.monotonic() > until_s:
            return
        time.sleep(_EVERY_S)
    _kill(_executors, killed)


def _kill(which: Callable[[int], list[int]], killed: list[int]) -> None:
    """Kill the first process of a kind that this one has, once there is one."""
    until_s = time.monotonic() + _LONGEST_S
    while not (found := which(os.getpid())):
        if time.monotonic() > until_s:
            return
        time.sleep(_EVERY_S)
    os.kill(found[0], signal.SIGKILL)
    killed.append(found[0])


def _executors(pid: int) -> list[int]:
    return [one for one, (_, command) in _descendants(pid).items() if "CoarseGrainedExecutorBackend" in command]


def _python_workers(pid: int) -> list[int]:
    """Return the processes of Python that the daemon of workers has forked."""
    of = _descendants(pid)
    daemons = {one for one, (_, command) in of.items() if "-m\0conflictdb.spark.worker_daemon" in command}
    return [one for one in daemons if of[one][0] in daemons]


def await_workers(process: "subprocess.Popen[str]") -> bool:
    """Return whether a program of Spark comes to have workers of Python."""
    while not (has_workers := bool(_python_workers(process.pid))) and process.poll() is None:
        time.sleep(_EVERY_S)
    return has_workers


def await_java(process: "subprocess.Popen[str]") -> bool:
    """Return whether a program comes to start the Java that runs Spark, which is not ready yet."""
    while not (has_java := _has_java(process.pid)) and process.poll() is None:
        time.sleep(_EVERY_S / 10)
    time.sleep(_STARTED_S)
    return has_java


def _has_java(pid: int) -> bool:
    commands = [command.split("\0") for _, command in _descendants(pid).values()]
    # Another Java makes its command.
    return any(Path(one[0]).name == "java" and "org.apache.spark.launcher.Main" not in one for one in commands)


def await_end_of_group(group: int) -> None:
    """Wait until no process of a group is left."""
    end = time.monotonic() + _LONGEST_S
    with suppress(ProcessLookupError):
        while time.monotonic() < end:
            os.killpg(group, 0)
            time.sleep(_EVERY_S)
        os.killpg(group, signal.SIGKILL)
        raise AssertionError(f"processes of group {group} are left")


def _descendants(pid: int) -> dict[int, tuple[int, str]]:
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
    _main()
