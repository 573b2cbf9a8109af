"""Read files; the name of a file decides its format.

`read` returns the contents of a file or raises one InvalidInput that names the file and, for every error, the object,
the field and the rule. To add a format, write a module with a `Standard` and a function that returns `Contents`, and a
line in `_READERS`; for JSON or XML a row of `dialects` instead.

Files may be hostile. C libraries that parse files run in a confined process (`confined`: GDAL, Parquet). This process
parses only
- JSON and CSV, with Python's own parsers: linear time, nesting and cells bounded by Python, size by MAX_FILE_MB;
- XML, with Python's Expat, without document types (`xml_text`); NOTAM and OpenAir, by patterns of linear time;
- WKB, with GEOS, after a check of its structure (`wkb`);
- the text of reference systems, with PROJ, which bounds nesting itself; `reference` bounds the rest.
Numbers of columns, errors, objects and corners of circles are bounded too (`contents`, `positions`, `discs`).
"""

import codecs
import gzip
import math
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, Final, TypedDict

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.formats import places
from conflictdb.formats.contents import (
    NO_SIZES,
    PARQUET,
    SAYS_NO_SIZES,
    TOO_LARGE,
    Contents,
    Parts,
    Phase,
    Remark,
    name_of,
    unwatched,
)
from conflictdb.formats.file_objects import AREA_MEMBERS, TRACK_MEMBERS
from conflictdb.formats.fixes import Fixes
from conflictdb.formats.hints import FileHints, applied
from conflictdb.formats.outside import of_exchange
from conflictdb.formats.owners import Owners
from conflictdb.formats.positions import COLUMNS
from conflictdb.formats.rings import HalfTurns
from conflictdb.formats.scene_file import read_scene, scene_parts, without_collector
from conflictdb.formats.summary import Summary
from conflictdb.formats.time_columns import UnreadProperties
from conflictdb.formats.what_came import WhatCame
from conflictdb.model.plans import Area, Track, rectangle_outline_m
from conflictdb.model.speed_limits import MAX_SPEED_KN

# Limit on a file's unpacked size: JSON takes up to thirty times that memory. Some 150,000 simple objects fit, and a
# scene may have many files.
MAX_FILE_MB: Final = 64.0
# That of a file that is read in parts and not kept in memory.
MAX_PARTS_MB: Final = 4_000.0
_CHUNK_BYTES: Final = 1_000_000

# Names to which columns may be mapped.
_FIELDS: Final = AREA_MEMBERS | TRACK_MEMBERS | set().union(*COLUMNS.values()) | {"radius_m"}
_UTF_16: Final = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE, codecs.BOM_UTF32_BE)


class ReadOptions(TypedDict, total=False):
    """Options of `read`, for functions that pass them on."""

    max_speed_kn: float | None
    layers: Sequence[str]
    skip_invalid: bool
    max_file_mb: float | None
    hints: FileHints | None


def read(
    path: str | Path,
    *,
    max_speed_kn: float | None = None,
    layers: Sequence[str] = (),
    skip_invalid: bool = False,
    max_file_mb: float | None = None,
    hints: FileHints | None = None,
    phase: Phase = unwatched,
) -> Contents:
    """Return the contents of a file.

    Scene files, OGC Moving Features, UAS zones and operational intents (.geojson, .json, .mfjson), positions (.csv,
    .tsv), routes, airspaces and warnings in XML (.rtz, .s421, .xml, .gml), NOTAM (.txt, .notam), OpenAir (.txt,
    .openair, .air), each also compressed (.gz); GeoParquet (.parquet, .geoparquet), also as a directory of parts; areas
    and tracks of any other format that OGR opens.

    Parameters
    ----------
    path : str or Path
        The file; the scene has the name in the file, else the file's name.
    max_speed_kn : float, optional
        Legs faster than this, in knots, are refused; default 2,000. In files of positions such fixes are left out, see
        `conflictdb.formats.positions`.
    layers : sequence of str
        The layers to read of a file that OGR opens; by default all.
    skip_invalid : bool
        Leave out refused objects of scene files, GeoParquet and OGR files, and read the others; `skipped` lists them.
    max_file_mb : float, optional
        Limit on the unpacked size, in millions of bytes; default MAX_FILE_MB, and 400 for GeoParquet.
    hints : FileHints, optional
        Names of columns, time zone and havens that the file does not say.
    phase : callable, optional
        Called with the name of each phase of a scene file and the amounts done and to do.

    Raises
    ------
    InvalidInput
        If the file, an object or a field breaks a rule. Nothing of the file is used then.
    """
    path = Path(path)
    if hints is not None:
        _require_fields(hints)
    with _named(path), applied(hints):
        is_packed = path.suffix.lower() == ".gz"
        contents = _read(_File(path, is_packed, max_speed_kn, layers, skip_invalid, max_file_mb, phase))
    if hints is not None and hints.haven_m is not None:
        _give_havens(contents, rectangle_outline_m(*hints.haven_m))
    contents.remarks = [*contents.remarks, *_remarks(str(path), contents)]
    return contents


def read_observed(
    path: str | Path, *, max_file_mb: float | None = None, hints: FileHints | None = None
) -> tuple[dict[str, Fixes], dict[tuple[str, str], list[int]]]:
    """Return the observed positions of a file (CSV, as of AIS, or tracks of GPX) by id, as they stand there.

    Also return the numbers of the rows that are left out, by id and reason. Raises InvalidInput as `read`.
    """
    path = Path(path)
    if hints is not None:
        _require_fields(hints)
    with _named(path), applied(hints):
        file = _File(path, path.suffix.lower() == ".gz", None, (), False, max_file_mb, unwatched)
        if _suffix(path) in (".gpx", ".xml"):
            from conflictdb.formats.gpx import gpx_fixes, is_gpx
            from conflictdb.formats.xml_text import parsed

            root = parsed(file.text())
            if not is_gpx(root):
                raise InvalidInput("file", "", "has no positions: give CSV, or GPX with tracks")
            return gpx_fixes(root, stem(path))
        if _suffix(path) not in (".csv", ".tsv"):
            raise InvalidInput("file", "", "has no positions: give CSV (.csv, .tsv), or GPX with tracks (.gpx)")
        from conflictdb.formats.positions import read_fixes

        return read_fixes(file.text())


def _require_fields(hints: FileHints) -> None:
    """Raise InvalidInput if a column is mapped to a field that no file has."""
    for name in hints.columns:
        if name not in _FIELDS:
            alike = get_close_matches(name, sorted(_FIELDS), 1)
            known = f"did you mean {alike[0]}?" if alike else f"fields are {', '.join(sorted(_FIELDS))}"
            raise InvalidInput("mapping", name, f"is not a field; {known}")


def _give_havens(contents: Contents, outline_m: NDArray[np.float64]) -> None:
    """Give tracks whose haven is a point an outline; the remark that they are points goes."""
    contents.tracks[:] = [
        replace(track, outline_m=outline_m, max_speed_kn=math.inf)
        if track.outlines_m is None and track.grow_mps == 0.0 and not track.outline_m.any()
        else track
        for track in contents.tracks
    ]
    contents.remarks = [one for one in contents.remarks if not one.text.startswith((NO_SIZES, SAYS_NO_SIZES))]


@contextmanager
def read_parts(
    path: str | Path,
    *,
    max_speed_kn: float | None = None,
    max_file_mb: float | None = None,
    late: Mapping[str, Any] | None = None,
    phase: Phase = unwatched,
) -> Iterator[Parts]:
    """Yield the result of `read` for a scene file or a GeoParquet file in parts, to bound memory.

    The caller raises the refusals, if any, after the last part. `max_file_mb` is 4,000 by default. Reading the parts
    raises a LateMembersError if the file is to be read again, with its members as `late`.
    """
    path = Path(path)
    with _named(path):
        summary = Summary()
        if _suffix(path) in _JSON:
            most_mb = MAX_PARTS_MB if max_file_mb is None else max_file_mb
            file = _File(path, path.suffix.lower() == ".gz", max_speed_kn, (), False, most_mb, phase)
            kept_mb = MAX_FILE_MB if max_file_mb is None else max_file_mb
            parts = scene_parts(
                file.chunks,
                stem(path),
                file.fastest_kn,
                summary,
                source=str(path),
                phase=phase,
                size_mb=file.size_mb,
                most=kept_mb * 1e6,
                late=late,
            )
            parts.each = _summed_up(parts.each, parts, summary, str(path))
            with without_collector():
                yield parts
            return
        from conflictdb.arrays import arrow  # noqa: F401  names the extra where there is no pyarrow
        from conflictdb.formats.parquet import MAX_PARQUET_MB, parquet_parts  # needs pyarrow

        most = (MAX_PARTS_MB, MAX_PARQUET_MB) if max_file_mb is None else (max_file_mb, max_file_mb)
        with parquet_parts(path, stem(path), most, max_speed_kn, summary.first) as parts:
            parts.each = _summed_up(parts.each, parts, summary, str(path))
            yield parts


def _summed_up(
    each: Iterator[tuple[list[Area], list[Track]]], parts: Parts, summary: Summary, source: str
) -> Iterator[tuple[list[Area], list[Track]]]:
    """Yield parts; after the last one add the errors and remarks that need all objects."""
    unread, owners, turns, legs = UnreadProperties(), Owners(), HalfTurns(), places.LongLegs()
    came = WhatCame(parts.settings)
    for areas, tracks in each:
        summary.add(areas, tracks)
        came.add(areas, tracks)
        unread.add([*areas, *tracks])
        turns.add(areas)
        owners.add([*areas, *tracks])
        legs.add(tracks)
        yield areas, tracks
    parts.came = came.summary()
    parts.far_from = partial(came.far_from, source=source, name=summary.name, now_us=time.time_ns() // 1000)
    parts.refusals.extend(summary.twice())
    parts.remarks += [
        *(() if len(summary) else (_empty(source),)),
        *unread.remarks(source),
        *owners.remarks(source),
        *turns.remarks(source),
        *summary.remarks(source),
        *came.remarks(source, summary.name, time.time_ns() // 1000),
        *(legs.remarks(source) if parts.settings is None else ()),
    ]


def _remarks(source: str, contents: Contents) -> Iterator[Remark]:
    if not contents.areas and not contents.tracks:
        yield _empty(source)
    unread = UnreadProperties()
    unread.add([*contents.areas, *contents.tracks])
    yield from unread.remarks(source)
    owners = Owners()
    owners.add([*contents.areas, *contents.tracks])
    yield from owners.remarks(source)
    turns = HalfTurns()
    turns.add(contents.areas)
    yield from turns.remarks(source)
    yield from places.remarks(source, contents.areas, contents.tracks)
    came = WhatCame(contents.scene)
    came.add(contents.areas, contents.tracks)
    items: list[Area | Track] = [*contents.areas, *contents.tracks]
    yield from came.remarks(source, lambda i: name_of(items[i]), time.time_ns() // 1000)
    if contents.scene is None:
        legs = places.LongLegs()
        legs.add(contents.tracks)
        yield from legs.remarks(source)


def _empty(source: str) -> Remark:
    return Remark(source, "file", "holds no objects")


@contextmanager
def _named(path: Path) -> Iterator[None]:
    try:
        yield
    except InvalidInput as refused:
        raise refused.at(str(path)) from refused.__cause__
    except RecursionError:  # also raised while formatting an error
        raise InvalidInput("file", "", "is nested too deeply", str(path)) from None
    except MemoryError:
        raise InvalidInput("file", "", "needs more memory than there is", str(path)) from None


@dataclass(frozen=True, slots=True)
class _File:
    """A file to read, and the options of `read`; see there."""

    path: Path
    is_packed: bool
    max_speed_kn: float | None
    layers: Sequence[str]
    skip_invalid: bool
    max_file_mb: float | None
    phase: Phase

    @property
    def fastest_kn(self) -> float:
        return MAX_SPEED_KN if self.max_speed_kn is None else self.max_speed_kn

    def text(self, *, may_have_layers: bool = False, is_latin_1: Callable[[str], bool] = lambda _: False) -> str:
        """Return its text; raises InvalidInput, also for layers of a format without any.

        is_latin_1 : whether a text that is not UTF-8 is of a format that may be in ISO 8859-1
        """
        if self.layers and not may_have_layers:
            raise InvalidInput("file", "layer", "has no layers: files that OGR opens may have some")
        data = b"".join(self._data())
        try:
            return data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            if is_latin_1(text := data.decode("latin-1")):
                return text
            raise _no_utf_8(error.start) from None

    def chunks(self) -> Iterator[str]:
        """Yield its text in parts, to bound memory; raises InvalidInput, also for layers."""
        if self.layers:
            raise InvalidInput("file", "layer", "has no layers: files that OGR opens may have some")
        decoder, fed = codecs.getincrementaldecoder("utf-8")(), 0
        for data in self._data():
            waiting = len(decoder.getstate()[0])
            given = data if fed else data.removeprefix(codecs.BOM_UTF8)
            try:
                text = decoder.decode(given)
            except UnicodeDecodeError as error:
                raise _no_utf_8(fed - waiting + error.start) from None
            fed += len(given)
            if text:
                yield text
        try:
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            raise _no_utf_8(fed - len(decoder.getstate()[0])) from None

    def _data(self) -> Iterator[bytes]:
        """Yield its bytes, unpacked, in parts; raises InvalidInput."""
        most_mb = MAX_FILE_MB if self.max_file_mb is None else self.max_file_mb
        left = int(most_mb * 1e6) + 1
        is_first = True
        try:
            # Never unpack more than the limit: a small archive can contain gigabytes, and a device has no end.
            with gzip.open(self.path) if self.is_packed else self.path.open("rb") as stream:
                while data := stream.read(min(left, _CHUNK_BYTES)):
                    left -= len(data)
                    if not left:
                        raise InvalidInput("file", "", f"holds more than {most_mb:g} MB{TOO_LARGE}")
                    if is_first and data.startswith(_UTF_16):
                        raise InvalidInput("file", "byte 0", "must be UTF-8 text; this is UTF-16, or UTF-32")
                    is_first = False
                    yield data
        except FileNotFoundError:
            raise InvalidInput("file", "", "does not exist") from None
        except (OSError, EOFError, zlib.error) as error:
            raise InvalidInput("file", "", f"cannot be read: {error}") from error

    @property
    def size_mb(self) -> int:
        """Its size in millions of bytes, for reports of progress; 0: unknown."""
        return 0 if self.is_packed or not self.path.is_file() else self.path.stat().st_size // 1_000_000


def _read(file: _File) -> Contents:
    with _named(file.path):
        return _READERS.get(_suffix(file.path), _read_ogr)(file)


def _suffix(path: Path) -> str:
    suffixes = [suffix.lower() for suffix in path.suffixes]
    is_packed = suffixes[-1:] == [".gz"]
    return suffixes[-2 if is_packed else -1] if len(suffixes) > is_packed else ""


def _read_json(file: _File) -> Contents:
    return read_scene(
        file.chunks,
        stem(file.path),
        file.fastest_kn,
        source=str(file.path),
        skip_invalid=file.skip_invalid,
        phase=file.phase,
        size_mb=file.size_mb,
    )


def _read_rows(file: _File) -> Contents:
    from conflictdb.formats.positions import read_positions

    return read_positions(file.text(), str(file.path), max_speed_kn=file.max_speed_kn)


def _read_parquet(file: _File) -> Contents:
    if file.layers:
        raise InvalidInput("file", "layer", "has no layers: files that OGR opens may have some")
    if file.is_packed:
        raise InvalidInput("file", "", "is compressed twice: Parquet is so already; unpack it")
    from conflictdb.arrays import arrow  # noqa: F401  names the extra where there is no pyarrow
    from conflictdb.formats.parquet import read_parquet  # needs pyarrow

    return read_parquet(file.path, stem(file.path), file.max_file_mb, file.max_speed_kn, skip_invalid=file.skip_invalid)


def _read_xml(file: _File) -> Contents:
    from conflictdb.formats.dialects import read_xml

    return read_xml(
        file.text(may_have_layers=True),
        str(file.path),
        stem=stem(file.path),
        max_speed_kn=file.fastest_kn,
        layers=file.layers,
        skip_invalid=file.skip_invalid,
    )


def _read_notam(file: _File) -> Contents:
    is_openair = of_exchange("openair", "is_openair")
    text = file.text(is_latin_1=is_openair)
    if is_openair(text):
        return _openair(file, text)
    contents: Contents = of_exchange("notam", "read_notam")(text, str(file.path), skip_invalid=file.skip_invalid)
    return contents


def _read_openair(file: _File) -> Contents:
    return _openair(file, file.text(is_latin_1=lambda _: True))


def _openair(file: _File, text: str) -> Contents:
    read_openair = of_exchange("openair", "read_openair")
    contents: Contents = read_openair(text, str(file.path), stem=stem(file.path), skip_invalid=file.skip_invalid)
    return contents


def _read_ogr(file: _File) -> Contents:
    if not file.path.exists():
        raise InvalidInput("file", "", "does not exist")
    from conflictdb.formats.ogr import read_objects

    most_mb = MAX_FILE_MB if file.max_file_mb is None else file.max_file_mb
    return read_objects(
        file.path, most_mb, file.fastest_kn, file.layers, stem=stem(file.path), skip_invalid=file.skip_invalid
    )


_JSON: Final = (".json", ".geojson", ".mfjson")
_READERS: Final[Mapping[str, Callable[[_File], Contents]]] = {
    **dict.fromkeys(_JSON, _read_json),
    **dict.fromkeys((".csv", ".tsv"), _read_rows),
    **dict.fromkeys(PARQUET, _read_parquet),
    **dict.fromkeys((".txt", ".notam"), _read_notam),
    **dict.fromkeys((".openair", ".air"), _read_openair),
    **dict.fromkeys((".rtz", ".xml", ".gml", ".s421", ".gpx"), _read_xml),
}

# Endings of formats that are neither JSON nor GeoParquet.
OTHER_ENDINGS: Final = _READERS.keys() - {*_JSON, *PARQUET}


def is_parquet(path: str | Path) -> bool:
    """Return whether a file is GeoParquet, by its name."""
    return Path(path).suffix.lower() in PARQUET


def has_parts(path: str | Path) -> bool:
    """Return whether `read_parts` reads a file, by its name."""
    return is_parquet(path) or _suffix(Path(path)) in _JSON


def stem(path: Path) -> str:
    """Return the name of a file without the suffixes of its format."""
    name = path.name
    for suffix in reversed(path.suffixes):
        if suffix.lower() == ".gz" or suffix.lower() in _READERS:
            name = name.removesuffix(suffix)
    return name if name != path.name else path.stem


def _no_utf_8(byte: int) -> InvalidInput:
    return InvalidInput("file", f"byte {byte}", "must be UTF-8 text")
