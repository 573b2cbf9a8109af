"""The contents of a file, and the objects left out."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Final, NamedTuple, Protocol, TypeAlias

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.model.load_summary import LoadSummary
from conflictdb.model.plans import Area, Scene, Track

# Called with the name of a phase, and the amounts done and to do; 0: unknown.
Phase: TypeAlias = Callable[[str, int, int], object]
# These begin remarks that tracks are points.
NO_SIZES: Final = "has no columns of sizes"
SAYS_NO_SIZES: Final = "says nothing of sizes"
# Endings of Parquet file names.
PARQUET: Final = frozenset({".parquet", ".geoparquet"})
# The remedy for a file above the size limit.
TOO_LARGE: Final = ": split it, or allow more with --max-file-mb"
# Columns of a file; every object has a value for each. PostgreSQL has at most 1,600, SQLite 2,000.
MAX_COLUMNS: Final = 2_000
# An error takes a kilobyte, and in a hostile file every third byte may be one.
MAX_MISTAKES: Final = 100_000


def unwatched(phase: str, done: int, of: int) -> None:
    """Report no phase."""


class FileRefusals(Refusals):
    """Refusals of a file or of one of its objects; too many of them end reading with an InvalidInput."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        is_kept = super().__exit__(kind, error, trace)
        self._raise_if_many()
        return is_kept

    def extend(self, found: Iterable[InvalidInput]) -> None:
        """Add refusals."""
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

    Plans with an error are refused as a whole, unless `skip_invalid` is set. Observations (AIS, ADS-B) always contain
    errors; unusable rows are left out and listed here.

    key : the object, as in the file
    reason : the broken rule
    lines : line numbers of the rows, counted from 1; empty for objects of files without rows
    is_whole : whether the whole object is left out
    """

    source: str
    key: str
    reason: str
    lines: tuple[int, ...]
    is_whole: bool

    @property
    def is_refused(self) -> bool:
        """Whether it is an invalid object of plans, not of observations."""
        return self.is_whole and not self.lines

    def __str__(self) -> str:
        return f"{self.source}: left out {self.key}: {self.reason}"


@dataclass(frozen=True, slots=True)
class Remark:
    """Valid input that is probably unintended.

    source : the file
    key : the object, as in a refusal: ``track 'T1'``; ``file`` for the whole file
    text : the observation and its likely meaning
    """

    source: str
    key: str
    text: str

    def __str__(self) -> str:
        return f"{self.source}: {self.key}: {self.text}"


@dataclass(slots=True)
class Parts:
    """A file that is read in parts, to bound memory.

    settings : of its scene, None if the file has none
    each : areas and tracks in batches; can be read once
    refusals, skipped, remarks, derived : those of the parts read so far; of the derived ids the first
    came : what they held, after the last part
    far_from : given areas and tracks of a scene, returns remarks on objects that are far from them, after the last part
    """

    settings: Scene | None
    each: Iterator[tuple[list[Area], list[Track]]]
    refusals: FileRefusals = field(default_factory=FileRefusals)
    skipped: list[Skipped] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    derived: list[str] = field(default_factory=list)
    came: LoadSummary = field(default_factory=LoadSummary)
    far_from: Callable[[Sequence[Area], Sequence[Track]], Iterable[Remark]] = lambda _areas, _tracks: ()


class _Keyed(Protocol):
    @property
    def key(self) -> str: ...


def name_of(item: _Keyed) -> str:
    """Return the name of an object in errors and remarks."""
    return f"{'area' if isinstance(item, Area) else 'track'} {item.key!r}"


def given_twice(item: str, where: str) -> InvalidInput:
    """Return the refusal of an object whose id an earlier object has.

    where : places of both, as text
    """
    return InvalidInput(item, "id", f"is given twice, by {where}; ids must be unique in the scene")


def row_id(stem: str, number: object) -> str:
    """Return the id of an object that has none: the name of its file, and the number of its row."""
    return f"{stem}.{number}"


def rows_apart(first: int, row: int) -> str:
    """Return the places of two rows that have the same id."""
    return f"rows {first} and {row} (from 0)"


def check_columns(who: str, names: Sequence[str]) -> None:
    """Raise InvalidInput for too many columns."""
    if len(names) > MAX_COLUMNS:
        rule = f"has {len(names):,} columns; at most {MAX_COLUMNS:,} are read: leave out those that say nothing here"
        raise InvalidInput(who, "columns", rule)


def left_out(source: str, refusals: Refusals) -> list[Skipped]:
    """Return refused objects as left out, one entry per error."""
    skipped = []
    for refused in refusals.found:
        reason = ": ".join(part for part in (refused.field, refused.rule) if part)
        skipped.append(Skipped(source, refused.key, reason, (), is_whole=True))
    return skipped


def without_objects(who: str, source: str, skipped: Iterable[Skipped], *, has_settings: bool = False) -> InvalidInput:
    """Return the refusal of a file, or files, without objects, with the reasons for objects left out.

    has_settings : the file has settings of a scene, so it may be meant to empty the scene
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
    remarks : remarks on the remaining objects; an attribute, not part of the tuple
    derived : ids that the file does not say: names, or numbers of rows; an attribute
    """

    remarks: Sequence[Remark] = ()
    derived: Sequence[str] = ()
