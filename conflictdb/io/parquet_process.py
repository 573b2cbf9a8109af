"""Parquet files decoded in a process that can do little else: see `parquet_child`."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa

from conflictdb.errors import InvalidInput

_CHILD: Final = Path(__file__).with_name("parquet_child.py")
# What decoding may use for each MB that the file may hold, many times what an honest one takes.
_SECONDS_PER_MB: Final = 0.5
_MEMORY_PER_MB: Final = 8 << 20
# What Python and Arrow need to be there at all.
_LEAST_SECONDS: Final = 30.0
_LEAST_MEMORY: Final = 2 << 30
_SETTINGS: Final = {
    "ARROW_DEFAULT_MEMORY_POOL": "system",  # the others take address space that they do not use
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "LC_ALL": "C.UTF-8",
}


@dataclass(frozen=True, slots=True)
class Rows:
    """The rows of a file: their columns, and batches, which are read once."""

    schema: "pa.Schema"
    batches: "Iterator[pa.RecordBatch]"


@contextmanager
def decoded(path: Path, max_file_mb: float) -> Iterator[Rows]:
    """Give the rows of a Parquet file, or of the parts in a directory, as they are decoded.

    Raises InvalidInput, also while they are read, if it cannot be read, holds more than `max_file_mb` of Arrow, or
    takes too much memory or time.
    """
    seconds = max(_LEAST_SECONDS, _SECONDS_PER_MB * max_file_mb)
    memory = max(_LEAST_MEMORY, int(_MEMORY_PER_MB * max_file_mb))
    limits = [str(int(most)) for most in (max_file_mb * 1e6, memory, seconds)]
    child = subprocess.Popen(
        # -P: what lies in the current directory is not imported
        [sys.executable, "-P", "-W", "ignore", str(_CHILD), *limits, *map(str, _parts(path))],
        # Nothing of the caller's: no credentials, and no settings of Arrow's.
        env={"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **_SETTINGS},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    with child:
        try:
            try:
                reader = pa.ipc.open_stream(child.stdout)
            except (pa.ArrowException, OSError) as error:
                raise _refusal(child, max_file_mb) from error
            yield Rows(reader.schema, _each(reader, child, max_file_mb))
        finally:
            child.kill()


def _each(
    reader: "pa.RecordBatchReader", child: "subprocess.Popen[bytes]", max_file_mb: float
) -> "Iterator[pa.RecordBatch]":
    try:
        for batch in reader:
            batch.validate(full=True)
            yield batch
    except (pa.ArrowException, OSError) as error:
        raise _refusal(child, max_file_mb) from error
    if child.wait() != 0:
        raise _refusal(child, max_file_mb)


def _refusal(child: "subprocess.Popen[bytes]", max_file_mb: float) -> InvalidInput:
    """Return why a file cannot be read, from what the child says: nothing if a limit ended it, or Arrow crashed."""
    assert child.stderr is not None  # noqa: S101
    try:
        wrong = json.loads(child.stderr.read())
    except ValueError:
        wrong = {}
    if "refused" in wrong:
        return InvalidInput("file", "", f"cannot be read as Parquet: {' '.join(str(wrong['refused']).split()):.500}")
    rule = f"holds more than {max_file_mb:g} MB, or takes too much to read: split it, or allow more with --max-file-mb"
    return InvalidInput("file", "", rule)


def _parts(path: Path) -> list[Path]:
    """Return a file, or the parts of one in a directory, as Spark writes them; raises InvalidInput for neither."""
    if not path.exists():
        raise InvalidInput("file", "", "does not exist")
    if path.is_dir():
        found = sorted(one for one in path.iterdir() if one.suffix == ".parquet" and one.name[0] not in "._")
        if not found:
            raise InvalidInput("file", "", "is a directory without parts that end in .parquet")
        path = path.absolute()
        return [path / one.name for one in found]
    if not path.is_file():
        raise InvalidInput("file", "", "must be a file, or a directory of parts")
    return [path.absolute()]
