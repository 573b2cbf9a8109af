"""List, inspect and check files wherever Spark reads and writes, through its driver's Hadoop file systems."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any, Final
from urllib.parse import unquote

import pyarrow as pa
from py4j.protocol import Py4JError
from pyarrow import parquet
from pyspark.errors import PySparkException
from pyspark.sql import DataFrame, DataFrameReader, SparkSession

from conflictdb.errors import InvalidInput
from conflictdb.spark.engine import cause_of

# Footers read concurrently: each takes one to three round trips of an object store.
_AT_ONCE: Final = 16
_MAGIC: Final = b"PAR1"
# Length of a footer, and magic number.
_TAIL_BYTES: Final = 8
# Many times the size of an honest footer; the driver reads it into memory.
_MOST_FOOTER_BYTES: Final = 64_000_000
# Prefixes of hidden files, and escapes for globs.
_HIDDEN: Final = ("_", ".")
_GLOB: Final = str.maketrans({letter: f"\\{letter}" for letter in "{}[]*?\\"})


def parquet_reader(spark: SparkSession) -> DataFrameReader:
    """Return a reader of Parquet that skips no file, whatever the session's options."""
    return spark.read.option("ignoreCorruptFiles", "false").option("ignoreMissingFiles", "false")


def listed(spark: SparkSession, paths: Sequence[str]) -> DataFrame:
    """List the files that Spark would read for paths, URIs and globs, without opening them.

    Raises InvalidInput if there is none, or if the storage cannot be read.
    """
    with _refused(", ".join(paths), "cannot be read by Spark"):
        found = parquet_reader(spark).schema("id string").parquet(*paths)
        if not found.inputFiles():
            raise InvalidInput(", ".join(paths), "", "holds no file that Spark can read")
        return found


def schemas_of(spark: SparkSession, files: Sequence[str]) -> dict[str, "pa.Schema"]:
    """Return the schemas of Parquet files by URI, from their footers.

    Raises InvalidInput for a file whose footer cannot be read.
    """
    with ThreadPoolExecutor(_AT_ONCE) as readers:
        return dict(zip(files, readers.map(partial(_schema, spark), files), strict=True))


def _schema(spark: SparkSession, file: str) -> "pa.Schema":
    with _refused(shown(file), "is no Parquet of conflictdb: its footer cannot be read"):
        path = _path(spark, file)
        system = path.getFileSystem(_configuration(spark))
        size = system.getFileStatus(path).getLen()
        stream = system.open(path)
        try:
            tail = _last(stream, size, _TAIL_BYTES)
            length = int.from_bytes(tail[:4], "little")
            if tail[4:] != _MAGIC or length > min(size - _TAIL_BYTES, _MOST_FOOTER_BYTES):
                raise InvalidInput(shown(file), "", "is no Parquet of conflictdb: it does not end as Parquet does")
            footer = _last(stream, size, length + _TAIL_BYTES)
        finally:
            stream.close()
        return parquet.read_schema(pa.BufferReader(_MAGIC + footer))


def _last(stream: Any, size: int, count: int) -> bytes:
    stream.seek(max(0, size - count))
    return bytes(stream.readNBytes(min(size, count)))


def plain_path(spark: SparkSession, file: str) -> str:
    """Return the path of a listed file in Spark's form: not URI-encoded, with glob characters escaped."""
    return str(_path(spark, file).toString()).translate(_GLOB)


def shown(file: str) -> str:
    """Return the URI of a listed file for messages; a path for local files."""
    local = file.removeprefix("file:")
    return file if local == file else "/" + unquote(local).lstrip("/")


def require_new(spark: SparkSession, path: str, ours: Sequence[str], inputs: Sequence[str], *, overwrite: bool) -> None:
    """Raise InvalidInput if a directory exists and may not be replaced.

    ours : prefixes of names in a replaceable directory
    inputs : listed files, which must not be in it
    """
    with _refused(path, "cannot be written"):
        target = _java(spark).org.apache.hadoop.fs.Path(path)
        system = target.getFileSystem(_configuration(spark))
        target = system.makeQualified(target)
        if not system.exists(target):
            return
        if not overwrite:
            raise InvalidInput(path, "", "already exists: name another directory, or give --overwrite to replace it")
        if not system.getFileStatus(target).isDirectory():
            raise InvalidInput(path, "", "is a file: --overwrite replaces directories that `spark detect` wrote")
        names = (str(one.getPath().getName()) for one in system.listStatus(target))
        if strange := sorted(name for name in names if not name.startswith((".", *ours))):
            rule = f"holds {strange[0]!r:.60}, which `spark detect` did not write: remove the directory yourself"
            raise InvalidInput(path, "", rule)
        within = f"{target.toUri().getPath().rstrip('/')}/"
        if any(_path(spark, one).toUri().getPath().startswith(within) for one in inputs):
            raise InvalidInput(path, "", "holds input: what is read cannot be overwritten")


def _path(spark: SparkSession, file: str) -> Any:
    java = _java(spark)
    return java.org.apache.hadoop.fs.Path(java.java.net.URI(file))


def _java(spark: SparkSession) -> Any:
    return spark.sparkContext._jvm


def _configuration(spark: SparkSession) -> Any:
    return spark.sparkContext._jsc.hadoopConfiguration()


@contextmanager
def _refused(who: str, what: str) -> Iterator[None]:
    try:
        yield
    except (Py4JError, PySparkException, pa.ArrowException, OSError) as error:
        raise InvalidInput(who, "", f"{what}: {cause_of(error)}") from error
