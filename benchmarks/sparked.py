"""A Spark session that reports its stages from its event log, and the peak memory of its processes."""

import json
import math
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from measured import Sampler

from conflictdb.embedded.options import Settings
from conflictdb.spark import engine

if TYPE_CHECKING:
    from pyspark.sql import SparkSession

EXECUTOR_MEMORY: Final = "2g"
_SAMPLE_S: Final = 0.25
_DISK_S: Final = 5.0
# As `--memory-mb` counts.
_MB: Final = 2**20


@contextmanager
def logged(master: str, directory: Path) -> Iterator["SparkSession"]:
    """Yield a Spark session whose event log and temporary files are in a directory."""
    (directory / "events").mkdir()
    options = {
        "spark.eventLog.enabled": "true",
        "spark.eventLog.dir": (directory / "events").as_uri(),
        "spark.local.dir": str(directory / "local"),
        "spark.driver.host": "127.0.0.1",
        "spark.driver.bindAddress": "127.0.0.1",
        "spark.driver.memory": EXECUTOR_MEMORY,
        "spark.executor.memory": EXECUTOR_MEMORY,
        "spark.cores.max": "2",
        "spark.scheduler.minRegisteredResourcesRatio": "1.0",  # wait for both executors before work begins
    }
    (directory / "spark-defaults.conf").write_text("".join(f"{name} {value}\n" for name, value in options.items()))
    os.environ["SPARK_CONF_DIR"] = str(directory)
    with engine.session(master, Settings.from_environment().cache / "spark", os.environ, is_quiet=True) as spark:
        yield spark


def events(directory: Path) -> Iterator[dict[str, Any]]:
    """Yield the stages and tasks in the event log of a session that has ended."""
    (log,) = (directory / "events").iterdir()
    with log.open() as lines:
        for event in map(json.loads, lines):
            is_task = event["Event"] == "SparkListenerTaskEnd" and event.get("Task Metrics")
            if is_task or event["Event"] == "SparkListenerStageCompleted":
                yield event


def operators(stage: dict[str, Any]) -> set[str]:
    """Return the names of the operators in a stage."""
    return {json.loads(one["Scope"])["name"] if "Scope" in one else one["Name"] for one in stage["RDD Info"]}


class Watched(Sampler):
    """Samples memory of the Spark processes that a process has started, directly or not, and their disk space.

    java_mb, worker_mb : largest resident memory of a Java process, and of a Python worker
    disk_mb : largest size of a session's directory
    """

    def __init__(self, pid: int, directory: Path) -> None:
        super().__init__(_SAMPLE_S)
        self.java_mb = self.worker_mb = self.disk_mb = 0.0
        self._pid, self._local, self._looked = pid, directory / "local", -math.inf

    def _look(self) -> None:
        page_mb = os.sysconf("SC_PAGE_SIZE") / _MB
        for pid in _descendants(self._pid):
            with suppress(OSError):
                command = Path(f"/proc/{pid}/cmdline").read_text()
                held_mb = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * page_mb
                if "-m\0conflictdb.spark.worker_daemon" in command:
                    self.worker_mb = max(self.worker_mb, held_mb)
                elif "org.apache.spark" in command:
                    self.java_mb = max(self.java_mb, held_mb)
        if time.monotonic() - self._looked > _DISK_S:
            self._looked = time.monotonic()
            with suppress(OSError):  # files come and go
                sizes = [file.stat().st_size for file in self._local.rglob("*") if file.is_file()]
                self.disk_mb = max(self.disk_mb, sum(sizes) / _MB)


def _descendants(pid: int) -> set[int]:
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
    found: set[int] = set()
    newest = {pid}
    while newest:
        newest = {child for child, parent in parents.items() if parent in newest} - found
        found |= newest
    return found
