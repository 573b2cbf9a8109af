"""Writing of files: whole or not at all, compressed if the name ends in .gz."""

import gzip
import os
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from pathlib import Path
from typing import IO, Final, cast

from conflictdb.errors import InvalidInput
from conflictdb.io.conflict_text import as_csv, as_geojson, as_json, columns_of
from conflictdb.results import Approach, Conflict, Listing, Stream

_FORMATS: Final = (".geojson", ".json", ".csv")


def write(results: Iterable[Conflict | Approach], path: str | Path) -> None:
    """Write conflicts or closest approaches, of a database or of `solve`, as GeoJSON, JSON or CSV.

    Members and columns are those of the views `conflicts` and `approaches`; what only a database knows is null without
    one; a CSV file of nothing has the columns of conflicts, unless it is an empty answer of `Database.approaches`. The
    file appears when it is complete; if it cannot be written, an older one stays.

    Parameters
    ----------
    results : iterable of Conflict, or of Approach
        Those of a database tell GeoJSON whether they are complete. They are written as they come.
    path : str or Path
        The file; its name ends in .geojson, .json or .csv, and then in .gz if it shall be compressed.

    Raises
    ------
    InvalidInput
        The name tells no format, or `results` is or holds something else, or both kinds; no file has been written.
    OSError
        The file cannot be written.
    """
    path = Path(path)
    suffix = (path.with_suffix("") if _is_packed(path) else path).suffix.lower()
    if suffix not in _FORMATS:
        raise InvalidInput("write", "path", f"must end in {', '.join(_FORMATS)}, or one of them and .gz", str(path))
    rule = "must be conflicts, or closest approaches, and not both"
    if not isinstance(results, Iterable):
        raise InvalidInput(
            "write", "results", f"{rule}, in a list or the like; got {type(results).__name__}", str(path)
        )
    told = results if isinstance(results, Listing | Stream) else None
    rows = iter(results)
    first = list(islice(rows, 1))
    kind = told.kind if told is not None else Approach if first and isinstance(first[0], Approach) else Conflict
    each = _each(chain(first, rows), kind, InvalidInput("write", "results", rule, str(path)))
    if suffix == ".csv":
        lines = as_csv(each, columns_of(kind))
    elif suffix == ".json":
        lines = as_json(each)
    else:
        lines = as_geojson(each, [told.state] if told is not None else [])
    write_lines(path, lines)


def _each(
    rows: Iterable[Conflict | Approach], kind: type[Conflict] | type[Approach], refusal: InvalidInput
) -> Iterator[Conflict | Approach]:
    for row in rows:
        if not isinstance(row, kind):
            raise refusal
        yield row


def write_lines(path: str | Path, lines: Iterable[str]) -> None:
    """Write a file of some lines; it appears when it is complete, and if it cannot be written, an older one stays."""
    path = Path(path)
    file = Path(os.path.realpath(path)) if path.is_symlink() else path  # a link stays one
    part = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        if file.exists() and not file.is_file():  # a pipe or a device cannot be replaced
            _write(file, "wb", lines, is_packed=_is_packed(path))
        else:
            _write(part, "xb", lines, is_packed=_is_packed(path))
            part.replace(file)
    except OSError as error:
        part.unlink(missing_ok=True)
        # Of the name that the caller knows.
        raise type(error)(error.errno, error.strerror, str(path)) from error
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def _is_packed(path: Path) -> bool:
    return path.suffix.lower() == ".gz"  # as `read` tells it


def _write(path: Path, mode: str, lines: Iterable[str], *, is_packed: bool) -> None:
    with path.open(mode) as raw:
        if is_packed:
            with gzip.GzipFile(filename="", fileobj=cast("IO[bytes]", raw), mode="wb", mtime=0) as packed:
                packed.writelines(line.encode() for line in lines)
        else:
            raw.writelines(line.encode() for line in lines)
