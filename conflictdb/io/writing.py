"""Writing of files: whole or not at all, compressed if the name ends in .gz."""

import gzip
import os
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Final, cast

from conflictdb.errors import InvalidInput
from conflictdb.io.conflict_text import APPROACH_COLUMNS, COLUMNS, as_csv, as_geojson, as_json
from conflictdb.results import Approach, Conflict, Listing

_FORMATS: Final = (".geojson", ".json", ".csv")


def write(results: Iterable[Conflict | Approach], path: str | Path) -> None:
    """Write conflicts or closest approaches, of a database or of `solve`, as GeoJSON, JSON or CSV.

    Members and columns are those of the views `conflicts` and `approaches`; what only a database knows is null without
    one; a CSV file of no results has the columns of conflicts. The file appears when it is complete; if it cannot be
    written, an older one stays.

    Parameters
    ----------
    results : iterable of Conflict, or of Approach
        Those of `Database.conflicts` and `Database.approaches` tell GeoJSON whether they are complete.
    path : str or Path
        The file; its name ends in .geojson, .json or .csv, and then in .gz if it shall be compressed.

    Raises
    ------
    InvalidInput
        The name tells no format, or `results` is or holds something else, or both kinds; nothing has been written.
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
    rows = list(results)
    is_approaches = bool(rows) and all(isinstance(row, Approach) for row in rows)
    if not is_approaches and not all(isinstance(row, Conflict) for row in rows):
        raise InvalidInput("write", "results", rule, str(path))
    if suffix == ".csv":
        lines = as_csv(rows, APPROACH_COLUMNS if is_approaches else COLUMNS)
    elif suffix == ".json":
        lines = as_json(rows)
    else:
        lines = as_geojson(rows, [results.state] if isinstance(results, Listing) else [])
    write_lines(path, lines)


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
