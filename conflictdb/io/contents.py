"""What a file holds, and what of it was left out."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Final, NamedTuple, Protocol

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.model import Area, Scene, Track

# How names of files of Parquet end.
PARQUET: Final = frozenset({".parquet", ".geoparquet"})
# Of a file that holds more than is allowed: what to do.
TOO_LARGE: Final = ": split it, or allow more with --max-file-mb"
# Columns of a file; every object has a value of each. PostgreSQL has 1,600 at most, SQLite 2,000.
MAX_COLUMNS: Final = 2_000
# A mistake takes a kilobyte, and of a hostile file every third byte may be one.
MAX_MISTAKES: Final = 100_000


class FileRefusals(Refusals):
    """Refusals of a file, or of an object of it: reading ends with an InvalidInput where they become too many."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        is_kept = super().__exit__(kind, error, trace)
        self._raise_if_many()
        return is_kept

    def extend(self, found: Iterable[InvalidInput]) -> None:
        """Keep further refusals."""
        for refused in found:
            self.found.append(refused)
            self._raise_if_many()

    def _raise_if_many(self) -> None:
        if len(self.found) > MAX_MISTAKES:
            found, self.found = self.found, []
            rule = f"has more than {MAX_MISTAKES:,} mistakes, and is not read any further; the first ones follow"
            raise InvalidInput("file", "", rule, also=found)


@dataclass(frozen=True, slots=True)
class Skipped:
    """An object of a file, or rows of it, that were left out, and why.

    Plans are refused as a whole when something is wrong with them, unless the rest is asked for; observations (AIS,
    ADS-B) are always a little dirty. What cannot be used is left out and named here.

    key : the object, as in the file
    reason : the rule that it breaks, or its rows do
    lines : of rows, their line numbers in the file, counted from 1; empty for an object of another file
    is_whole : whether the object is left out altogether
    """

    source: str
    key: str
    reason: str
    lines: tuple[int, ...]
    is_whole: bool

    @property
    def is_refused(self) -> bool:
        """Whether it is an object of plans that breaks a rule, and no observation."""
        return self.is_whole and not self.lines

    def __str__(self) -> str:
        return f"{self.source}: left out {self.key}: {self.reason}"


@dataclass(frozen=True, slots=True)
class Remark:
    """Something in a file that breaks no rule, but may not be what its author meant.

    source : the file
    key : the object, as in a refusal: ``track 'T1'``; ``file`` for all of it
    text : what is odd, and what it might mean
    """

    source: str
    key: str
    text: str

    def __str__(self) -> str:
        return f"{self.source}: {self.key}: {self.text}"


@dataclass(slots=True)
class Parts:
    """A file that is read part by part, so that nobody holds all of it.

    settings : of its scene, None if the file names none
    each : areas and tracks, some at a time; they can be read once
    refusals, skipped, remarks : what was found of the parts that were read
    """

    settings: Scene | None
    each: Iterator[tuple[list[Area], list[Track]]]
    refusals: FileRefusals = field(default_factory=FileRefusals)
    skipped: list[Skipped] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)


class _Keyed(Protocol):
    @property
    def key(self) -> str: ...


def name_of(item: _Keyed) -> str:
    """Return an area, or a track of any kind, as errors and remarks name it."""
    return f"{'area' if isinstance(item, Area) else 'track'} {item.key!r}"


def given_twice(item: str, where: str) -> InvalidInput:
    """Return the refusal of an object whose id an earlier one has; where both are, as a text."""
    return InvalidInput(item, "id", f"is given twice, by {where}; ids must be unique in the scene")


def rows_apart(first: int, row: int) -> str:
    """Return where two rows are that have the same id."""
    return f"rows {first} and {row} (from 0)"


def check_columns(who: str, names: Sequence[str]) -> None:
    """Raise InvalidInput for more columns than are read."""
    if len(names) > MAX_COLUMNS:
        rule = f"has {len(names):,} columns; at most {MAX_COLUMNS:,} are read: leave out those that say nothing here"
        raise InvalidInput(who, "columns", rule)


def left_out(source: str, refusals: Refusals) -> list[Skipped]:
    """Return the objects that are left out because they were refused, one entry for every mistake."""
    skipped = []
    for refused in refusals.found:
        reason = ": ".join(part for part in (refused.field, refused.rule) if part)
        skipped.append(Skipped(source, refused.key, reason, (), is_whole=True))
    return skipped


def without_objects(who: str, source: str, skipped: Iterable[Skipped], *, has_settings: bool = False) -> InvalidInput:
    """Return the refusal of a file, or files, without objects, with the reason for what was left out.

    has_settings : the file has settings of a scene, so that it may be meant to empty it
    """
    rule = "holds no area and no track: nothing is changed"
    if has_settings:
        rule += " (--replace empties the scene, where the file leaves nothing out)"
    also = []
    for one in skipped:
        rows = f"left out {len(one.lines)} row{'' if len(one.lines) == 1 else 's'}, " if one.lines else ""
        also.append(InvalidInput(one.key, "", rows + one.reason, one.source))
    return InvalidInput(who, "", rule, source, also)


class _Contents(NamedTuple):
    scene: Scene | None
    areas: list[Area]
    tracks: list[Track]
    skipped: list[Skipped]


class Contents(_Contents):
    """The objects of one file: ``scene, areas, tracks, skipped = read(path)``.

    scene : its settings, None if the file names no scene
    skipped : rows and objects that were left out
    remarks : beside the four, what is odd about the rest
    """

    remarks: Sequence[Remark] = ()
