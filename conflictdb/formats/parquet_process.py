"""Decode Parquet files in a confined process: see `confined` and `parquet_child`."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa

from conflictdb.errors import InvalidInput
from conflictdb.formats.confined import ConfinedProgram, Running
from conflictdb.formats.contents import PARQUET

_PARQUET: Final = ConfinedProgram(
    "parquet_child.py",
    "cannot be read as Parquet",
    # Many times the needs of an honest file.
    seconds_per_mb=0.5,
    memory_per_mb=8 << 20,
    settings={"ARROW_DEFAULT_MEMORY_POOL": "system"},  # other pools reserve address space that they do not use
)


@dataclass(frozen=True, slots=True)
class Rows:
    """The rows of a file: their schema, and batches, which can be read once."""

    schema: "pa.Schema"
    batches: "Iterator[pa.RecordBatch]"


@contextmanager
def decoded(path: Path, max_file_mb: float) -> Iterator[Rows]:
    """Yield the rows of a Parquet file, or of the parts in a directory, as they are decoded.

    Raises InvalidInput, also during iteration, if it cannot be read, has more than `max_file_mb` of Arrow, or exceeds
    the limits of memory or time.
    """
    with _PARQUET.running([str(part) for part in _parts(path)], max_file_mb) as running:
        try:
            reader = pa.ipc.open_stream(running.stream)
        except (pa.ArrowException, OSError) as error:
            raise running.refusal() from error
        yield Rows(reader.schema, _each(reader, running))


def _each(reader: "pa.RecordBatchReader", running: Running) -> "Iterator[pa.RecordBatch]":
    try:
        for batch in reader:
            batch.validate(full=True)
            yield batch
    except (pa.ArrowException, OSError) as error:
        raise running.refusal() from error
    running.check_end()


def _parts(path: Path) -> list[Path]:
    """Return a file, or the parts of a directory as Spark writes them; raises InvalidInput for neither."""
    if not path.exists():
        raise InvalidInput("file", "", "does not exist")
    if path.is_dir():
        shown = [one for one in path.iterdir() if one.name[0] not in "._"]
        within = sorted(one.name for one in shown if one.is_dir())
        if within:
            rule = (
                f"is partitioned into directories ({', '.join(within[:3])}, …), which are not read: give each of them"
            )
            raise InvalidInput("file", "", rule)
        found = sorted(one for one in shown if one.suffix.lower() in PARQUET)
        if not found:
            raise InvalidInput("file", "", "is a directory without parts that end in .parquet")
        path = path.absolute()
        return [path / one.name for one in found]
    if not path.is_file():
        raise InvalidInput("file", "", "must be a file, or a directory of parts")
    return [path.absolute()]
