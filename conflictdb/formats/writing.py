"""Write conflicts, and lines of any file: completely or not at all, compressed if the name ends in .gz."""

import gzip
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final, cast

from conflictdb.errors import InvalidInput
from conflictdb.formats.conflict_text import MoreColumn, as_csv, as_geojson, as_json, columns_of
from conflictdb.model.results import Approach, Conflict, Listing, SceneState, Stream

if TYPE_CHECKING:
    from conflictdb.formats.conflict_ics import Activation

_PARQUET: Final = ".parquet"
_FORMATS: Final = (".geojson", ".json", ".csv", ".gpx", ".ics", _PARQUET)
_OF_CONFLICTS: Final = {".gpx": "GPX", ".ics": "iCalendar", _PARQUET: "GeoParquet"}


def write(results: Iterable[Conflict | Approach], path: str | Path) -> None:
    """Write conflicts or closest approaches, of a database or of `solve`, to a file.

    Members and columns are those of the views `conflicts` and `approaches`; columns that only a database fills are null
    without one. A CSV file without rows has the columns of conflicts, unless it is an empty answer of
    `StoredScene.approaches`. The file appears when it is complete; if writing fails, an older file stays.

    Parameters
    ----------
    results : iterable of Conflict, or of Approach
        Results of a database also give GeoJSON their completeness. They are written as they arrive.
    path : str or Path
        The file; its name ends in .geojson, .json or .csv, with .gz added to compress it. Conflicts also as .gpx (a
        waypoint where each pair first touches), .ics (an event for each period), and .parquet, which needs the extra
        `parquet`.

    Raises
    ------
    InvalidInput
        The name has no known format, or `results` contains anything else, or both kinds; no file has been written.
    OSError
        The file cannot be written.
    """
    path = Path(path)
    suffix = (path.with_suffix("") if _is_packed(path) else path).suffix.lower()
    if suffix not in _FORMATS or (suffix == _PARQUET and _is_packed(path)):
        rule = f"must end in {', '.join(_FORMATS)} (one of them and .gz), or {_PARQUET}"
        raise InvalidInput("write", "path", rule, str(path))
    rule = "must be conflicts, or closest approaches, and not both"
    if not isinstance(results, Iterable):
        raise InvalidInput(
            "write", "results", f"{rule}, in a list or the like; got {type(results).__name__}", str(path)
        )
    listing = results if isinstance(results, Listing | Stream) else None
    rows = iter(results)
    first = list(islice(rows, 1))
    kind = listing.kind if listing is not None else Approach if first and isinstance(first[0], Approach) else Conflict
    each = _checked(chain(first, rows), kind, InvalidInput("write", "results", rule, str(path)))
    if kind is Approach and suffix in _OF_CONFLICTS:
        rule = f"are closest approaches: only conflicts are written as {_OF_CONFLICTS[suffix]}"
        raise InvalidInput("write", "results", rule, str(path))
    if suffix == _PARQUET:
        with whole_file(path) as stream:
            write_geoparquet(stream, cast("Iterator[Conflict]", each))
    else:
        write_lines(path, lines_of(each, suffix[1:], kind, () if listing is None else [listing.state]))


def lines_of(
    pairs: Iterable[Conflict | Approach],
    form: str,
    kind: type[Conflict] | type[Approach],
    states: Sequence[SceneState] = (),
    more: Sequence[MoreColumn] = (),
    leave_out: Callable[[Conflict], object] = lambda _: None,
    activations: "Sequence[Activation]" = (),
) -> Iterator[str]:
    """Return the lines of a file of conflicts or closest approaches.

    form : json, csv or geojson; of conflicts also gpx and ics
    states : of scenes of a database, for GeoJSON
    more : further columns, which gpx and ics do not have
    leave_out : called with conflicts that gpx and ics cannot show
    activations : of an area, which ics has, too
    """
    if form == "csv":
        return as_csv(pairs, columns_of(kind), more)
    if form == "json":
        return as_json(pairs, more)
    if form == "geojson":
        return as_geojson(pairs, states, more)
    conflicts = cast("Iterable[Conflict]", pairs)
    if form == "gpx":
        from conflictdb.formats.conflict_gpx import as_gpx  # no other form needs its libraries

        return as_gpx(conflicts, leave_out)
    from conflictdb.formats.conflict_ics import as_ics  # the same

    return as_ics(conflicts, leave_out, activations)


def write_geoparquet(stream: IO[bytes], conflicts: Iterable[Conflict]) -> None:
    """Write conflicts as GeoParquet, as they come; raises ConflictDBError, naming the extra, without pyarrow."""
    from conflictdb.arrays import arrow  # noqa: F401  names the extra where there is no pyarrow
    from conflictdb.formats.parquet_writing import write_conflicts  # needs pyarrow

    write_conflicts(stream, conflicts)


def _checked(
    rows: Iterable[Conflict | Approach], kind: type[Conflict] | type[Approach], refusal: InvalidInput
) -> Iterator[Conflict | Approach]:
    for row in rows:
        if not isinstance(row, kind):
            raise refusal
        yield row


@contextmanager
def whole_file(path: str | Path) -> Iterator[IO[bytes]]:
    """Yield a file to write; it appears when it is complete, and if writing fails, an older file stays.

    Raises OSError, with the caller's name of the file, if it cannot be written.
    """
    path = Path(path)
    file = Path(os.path.realpath(path)) if path.is_symlink() else path  # keep a link
    part = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        if file.exists() and not file.is_file():  # a pipe or a device cannot be replaced
            with file.open("wb") as raw:
                yield raw
        else:
            with part.open("xb") as raw:
                yield raw
            part.replace(file)
    except OSError as error:
        part.unlink(missing_ok=True)
        if error.errno is None:  # not from the system, but from the writer
            raise
        raise type(error)(error.errno, error.strerror, str(path)) from error
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_lines(path: str | Path, lines: Iterable[str]) -> None:
    """Write a file of lines; it appears when it is complete, and if writing fails, an older file stays."""
    with whole_file(path) as raw:
        if _is_packed(Path(path)):
            with gzip.GzipFile(filename="", fileobj=raw, mode="wb", mtime=0) as packed:
                packed.writelines(line.encode() for line in lines)
        else:
            raw.writelines(line.encode() for line in lines)


def _is_packed(path: Path) -> bool:
    return path.suffix.lower() == ".gz"  # as `read` decides
