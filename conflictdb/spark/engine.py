"""Check the requirements of Spark with Sedona, and open sessions.

Spark is a Java program controlled from Python. It needs Java 17, the packages of the extra `spark`, and two jars of
Sedona, which are fetched once by their Maven coordinates or come with the cluster.
"""

import fcntl
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping, MutableMapping
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from threading import current_thread, main_thread
from traceback import walk_tb
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final
from weakref import WeakSet

from conflictdb.errors import ConflictDBError, EngineMissing, InvalidInput
from conflictdb.spark.interrupts import interrupts_between_calls

if TYPE_CHECKING:
    from pyspark.sql import SparkSession

# Jars for the versions of Sedona's Python package and Spark; Sedona's transforms need the GeoTools wrapper.
_SEDONA: Final = "org.apache.sedona:sedona-spark-shaded-3.5_2.12:{version}"
_TOOLS: Final = "org.datasyslab:geotools-wrapper:1.8.1-33.1"
# The JDBC driver of PostgreSQL, and its class name for Spark.
_JDBC: Final = "org.postgresql:postgresql:42.7.14"
DRIVER: Final = "org.postgresql.Driver"
# Spark 3.5 starts with other versions too, but fails later.
_JAVA: Final = 17
# Fetch the jars alone: they are self-contained, so their project descriptions are not needed.
_SETTINGS_OF_IVY: Final = """<ivysettings><settings defaultResolver="central"/>
<resolvers><ibiblio name="central" m2compatible="true" usepoms="false"/></resolvers></ivysettings>"""
_DRIVER_MEMORY: Final = "2g"
# Forks the Python workers of this machine.
_DAEMON: Final = "conflictdb.spark.worker_daemon"
# Attempts per task on this machine, as on a cluster: a worker may be killed.
_TRIES: Final = 4
# Options that are lists of jars.
_JARS: Final = ("spark.jars", "spark.jars.packages")
# Sedona's serialisation, and instants in UTC, in files in a form that other readers know.
_OPTIONS: Final[dict[str, Any]] = {
    "spark.serializer": "org.apache.spark.serializer.KryoSerializer",
    "spark.kryo.registrator": "org.apache.sedona.core.serde.SedonaKryoRegistrator",
    "spark.sql.session.timeZone": "UTC",
    "spark.sql.parquet.outputTimestampType": "TIMESTAMP_MICROS",
}
# Lines of Java's output in an error.
_TOLD_LINES: Final = 3
# Sedona reports each start, with the versions of the system and of Java, to its makers, unless this property is true.
_NO_REPORT: Final = "SCARF_NO_ANALYTICS"
# Sessions that have Sedona's functions: to register them again takes 50 ms.
_WITH_SEDONA: Final["WeakSet[SparkSession]"] = WeakSet()


def coordinates(*, reads_database: bool = False) -> list[str]:
    """Return the Maven coordinates of Sedona's jars, for ``spark-submit --packages``.

    reads_database : add the JDBC driver

    Raises EngineMissing where the Python packages are missing.
    """
    _require_packages()
    return [_SEDONA.format(version=version("apache-sedona")), _TOOLS, *([_JDBC] if reads_database else [])]


def _require_packages() -> None:
    for name in ("pyspark", "apache-sedona", "pandas", "pyarrow"):
        try:
            version(name)
        except PackageNotFoundError:
            raise EngineMissing(f"Spark needs {name}: pip install 'conflictdb[spark]'") from None


def _require_java(home: str | None) -> None:
    java = shutil.which("java", path=str(Path(home, "bin"))) if home else shutil.which("java")
    remedy = f"install Java {_JAVA} (Debian and Ubuntu: sudo apt-get install openjdk-{_JAVA}-jre-headless)"
    if java is None:
        where = f"JAVA_HOME is {home}, where there is none" if home else "there is none on PATH, and no JAVA_HOME"
        raise EngineMissing(f"Spark needs Java: {where}; {remedy}, or set JAVA_HOME")
    major = _java_version(java).split(".")[0]
    if not major.isdigit() or int(major) != _JAVA:
        found = f"{java} is {major or 'none'}"
        raise EngineMissing(f"Spark 3.5 with Sedona needs Java {_JAVA}; {found}: {remedy}, and set JAVA_HOME")


def _java_version(java: str) -> str:
    """Return the version of a Java; "" if it fails."""
    with suppress(OSError):
        released = (Path(java).resolve().parents[1] / "release").read_text(errors="replace")
        if match := re.search(r'^JAVA_VERSION="(.+?)"', released, re.MULTILINE):
            return match[1]
    done = subprocess.run([java, "-version"], capture_output=True, text=True, check=False)
    quoted = (word.strip('"') for word in done.stderr.split() if word.startswith('"'))
    return "" if done.returncode else next(quoted, "")


@contextmanager
def session(
    master: str | None,
    cache: Path,
    environ: MutableMapping[str, str],
    *,
    is_quiet: bool,
    reads_database: bool = False,
    options: Mapping[str, str] = MappingProxyType({}),
) -> "Iterator[SparkSession]":
    """Open a session with Sedona for the block; failures of Spark inside are a ConflictDBError.

    Raises EngineMissing, with the remedy, if Java, packages or jars are missing, and InvalidInput for options that
    would change answers.

    master : where Spark runs: ``local[4]``, ``spark://host:7077``; None: all processors of this machine, or the choice
        of spark-submit
    cache : directory of jars
    environ : environment of this program: shows whether spark-submit started it, and where Java is; PYSPARK_PYTHON is
        set for workers
    is_quiet : write Java's output to a file, and its end into errors
    reads_database : add the JDBC driver
    options : Spark options by name; they override its defaults, and their jars are added
    """
    for name, value in options.items():
        if value != _OPTIONS.get(name, value):
            raise InvalidInput(f"--conf {name}", "", f"must be {_OPTIONS[name]}: other values change answers")
    is_submitted = "PYSPARK_GATEWAY_PORT" in environ
    if not is_submitted:
        _require_java(environ.get("JAVA_HOME"))
    packages = coordinates(reads_database=reads_database)
    from pyspark.errors import PySparkRuntimeError
    from pyspark.sql import SparkSession

    builder = SparkSession.builder.appName("conflictdb").config(map=_OPTIONS)
    if not is_submitted:
        environ.setdefault("PYSPARK_PYTHON", sys.executable)  # the default interpreter of workers
        alone = _alone(master or options.get("spark.master", "local[*]"), _said_elsewhere(environ))
        builder = builder.config(map=alone)
    else:
        builder = builder.config(map=dict(options))
        if master is not None:
            builder = builder.master(master)
    heard = signal.getsignal(signal.SIGINT)
    with tempfile.TemporaryFile("w+") as said:
        try:
            with ExitStack() as fetched:
                if not is_submitted:
                    jars = fetched.enter_context(_jars(cache, packages))
                    builder = builder.config(map=_with_jars(jars, options))
                fetched.enter_context(_printed_to(said.fileno() if is_quiet and not is_submitted else None))
                spark = builder.getOrCreate()
        except PySparkRuntimeError as error:
            said.seek(0)
            lines = [line.strip() for line in said if line.strip() and not line.startswith(("\t", ":: "))]
            raise EngineMissing(
                f"Spark did not start. If its jars cannot be fetched from Maven Central ({', '.join(packages)}), put "
                f"them into {cache / 'jars'}. It said: {' / '.join(lines[-_TOLD_LINES:])}"
            ) from error
        except BaseException as error:  # an interrupt, above all
            _end_starting_java(error)
            raise
        if current_thread() is main_thread():  # pyspark's own handler would call Java within a call of Java
            signal.signal(signal.SIGINT, heard)
        try:
            with (
                interrupts_between_calls(spark.sparkContext.cancelAllJobs),
                errors_in_one_line(ConflictDBError, "Spark did not finish"),
            ):
                yield with_sedona(spark)
        finally:
            spark.stop()


def _end_starting_java(error: BaseException) -> None:
    """End a Java that pyspark was waiting for.

    pyspark removes the directory in which Java is about to write its address; Java then fails, and never ends.
    """
    for frame, _ in walk_tb(error.__traceback__):
        if frame.f_globals.get("__name__") == "pyspark.java_gateway":
            java = frame.f_locals.get("proc")
            if isinstance(java, subprocess.Popen):
                java.kill()
                java.wait()


@contextmanager
def errors_in_one_line(kind: type[ConflictDBError], what: str) -> Iterator[None]:
    """Convert errors of Spark (no disk or memory, a lost executor or connection) to one line."""
    from py4j.protocol import Py4JError
    from pyspark.errors import PySparkException

    try:
        yield
    except (Py4JError, PySparkException) as error:
        raise kind(f"{what}: {cause_of(error)}") from error


def cause_of(error: Exception) -> str:
    """Return the first cause of an error in one line; where a worker failed, the worker's error."""
    cause, message = getattr(error, "java_exception", None), str(error)
    while cause is not None:
        said = cause.getMessage()  # None for an exception without a message
        message, cause = message if said is None else str(said), cause.getCause()
    lines = [line.strip() for line in message.splitlines() if line.strip()] or [type(error).__name__]
    return lines[-1] if any("Traceback" in line for line in lines) else lines[0]


def with_sedona(spark: "SparkSession") -> "SparkSession":
    """Return a session with Sedona's functions and formats; raises EngineMissing without its jars."""
    if spark in _WITH_SEDONA:
        return spark
    java: Any = spark.sparkContext._jvm
    java.java.lang.System.setProperty(_NO_REPORT, "true")
    try:
        java.org.apache.sedona.spark.SedonaContext.create(spark._jsparkSession, "python")
    except TypeError:  # raised when a missing class is called
        raise EngineMissing(
            f"Spark runs without Sedona's jars: start it with --packages {','.join(coordinates())}"
        ) from None
    _WITH_SEDONA.add(spark)
    return spark


def with_driver(spark: "SparkSession") -> None:
    """Raise EngineMissing if a session lacks the JDBC driver."""
    try:
        getattr(spark.sparkContext._jvm, DRIVER)()
    except TypeError:  # raised when a missing class is called
        packages = ",".join(coordinates(reads_database=True))
        raise EngineMissing(
            f"Spark runs without the driver of PostgreSQL databases: start it with --packages {packages}"
        ) from None


def _alone(master: str, said: Collection[str]) -> dict[str, Any]:
    """Return the options of a session that is not started by spark-submit.

    said : names of options in the user's configuration of Spark
    """
    options: dict[str, Any] = {"spark.ui.enabled": "false", "spark.ui.showConsoleProgress": "false"}
    if match := re.fullmatch(r"local(?:\[\s*(\d+|\*)\s*\])?", master):  # without a number of attempts
        master = f"local[{match[1] or 1},{_TRIES}]"
    if master.startswith("local"):  # no other machine connects to it
        options |= {"spark.driver.bindAddress": "127.0.0.1", "spark.driver.host": "127.0.0.1"}
        options |= {"spark.driver.memory": _DRIVER_MEMORY, "spark.python.daemon.module": _DAEMON}
    return {name: value for name, value in options.items() if name not in said} | {"spark.master": master}


def _said_elsewhere(environ: Mapping[str, str]) -> set[str]:
    """Return the names of options in the user's own configuration of Spark."""
    said = {word.partition("=")[0] for word in shlex.split(environ.get("PYSPARK_SUBMIT_ARGS", ""))}
    if "--driver-memory" in said or environ.get("SPARK_DRIVER_MEMORY"):
        said.add("spark.driver.memory")
    directory = environ.get("SPARK_CONF_DIR") or str(Path(environ.get("SPARK_HOME") or _home(), "conf"))
    with suppress(OSError):
        lines = Path(directory, "spark-defaults.conf").read_text(errors="replace").splitlines()
        said |= {
            re.split(r"[\s=:]", line.strip(), maxsplit=1)[0] for line in lines if not line.lstrip().startswith("#")
        }
    return said


def _home() -> str:
    from pyspark import __file__ as module

    return str(Path(module).parent)


def _with_jars(jars: dict[str, Any], options: Mapping[str, str]) -> dict[str, Any]:
    """Return options except the master, with the jars that a session needs added to their own."""
    both = {name: f"{jars[name]},{options[name]}" for name in _JARS if jars.get(name) and options.get(name)}
    return jars | {name: value for name, value in options.items() if name != "spark.master"} | both


@contextmanager
def _jars(cache: Path, packages: list[str]) -> Iterator[dict[str, Any]]:
    """Yield the options for Spark's jars: files fetched before, else Maven coordinates, to be fetched in the block."""
    kept = [cache / "jars" / "{}_{}-{}.jar".format(*package.split(":")) for package in packages]
    found = {"spark.jars": ",".join(map(str, kept))}
    if all(jar.is_file() for jar in kept) and not os.access(cache, os.W_OK):  # nobody fetches into it
        yield found
        return
    cache.mkdir(parents=True, exist_ok=True)
    with (cache / "fetching.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if all(jar.is_file() for jar in kept):
            fcntl.flock(lock, fcntl.LOCK_UN)
            yield found
            return
        settings = cache / "ivysettings.xml"
        settings.write_text(_SETTINGS_OF_IVY)
        yield {
            "spark.jars.packages": ",".join(packages),
            "spark.jars.ivy": str(cache),
            "spark.jars.ivySettings": str(settings),
        }


@contextmanager
def _printed_to(file: int | None) -> Iterator[None]:
    """Redirect the output of programs started in the block to a file."""
    if file is None:
        yield
        return
    kept = [(stream, os.dup(stream)) for stream in (1, 2)]
    for stream, _ in kept:
        os.dup2(file, stream)
    try:
        yield
    finally:
        for stream, copy in kept:
            os.dup2(copy, stream)
            os.close(copy)
