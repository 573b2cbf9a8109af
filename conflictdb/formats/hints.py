"""What users say about files of other programs: the names of columns, the time zone, the havens of points."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import datetime
from math import isfinite
from typing import Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from conflictdb.errors import InvalidInput
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import Scene
from conflictdb.model.settings import SETTINGS, VerticalDatum, checked

_SETTING: Final = next(setting for setting in SETTINGS if setting.name == "vertical_datum")


# Between positions: a day.
MAX_GAP_S: Final = 86_400.0


@dataclass(frozen=True, slots=True)
class FileHints:
    """How to read files of other programs; raises InvalidInput for an unknown zone and an invalid haven.

    columns : the column or property of the file for each field: {"start": "valid_from"}
    time_zone : of times without offset, such as Europe/Copenhagen; None: they are refused, and UTC in AIS files
    haven_m : how far the havens of tracks without a size reach, metres: ahead, astern, to port, to starboard; each
        fills in a side that is missing. None: tracks of formats without sizes are points, others are refused, and left
        out of positions
    unbounded_heights : heights above anything but the scene's vertical datum are unbounded; else refused
    departure, speed_kn : of routes that say no time, and no speed; an aware datetime, and knots
    max_gap_s : positions of an object are two tracks where nothing is known of it for longer, seconds
    vertical_datum : of the scene that a file without settings is read for; None: of the scene it is loaded into, or msl
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    time_zone: str | None = None
    haven_m: Sequence[float] | None = None
    unbounded_heights: bool = False
    departure: datetime | None = None
    speed_kn: float | None = None
    vertical_datum: VerticalDatum | str | None = None
    max_gap_s: float = MAX_GAP_S

    def __post_init__(self) -> None:
        if self.time_zone is not None:
            try:
                ZoneInfo(self.time_zone)
            except (ValueError, OSError, ZoneInfoNotFoundError):
                rule = f"must be a time zone such as Europe/Copenhagen; got {self.time_zone!r:.60}"
                raise InvalidInput("file", "time_zone", rule) from None
        haven = self.haven_m
        if haven is not None and (len(haven) != 4 or not all(isfinite(side) and side >= 0.0 for side in haven)):
            raise InvalidInput("file", "haven_m", f"must be four numbers of metres, 0 or more; got {haven!r:.60}")
        if not self.max_gap_s > 0.0:
            raise InvalidInput("file", "max_gap_s", f"must be a number of seconds above 0; got {self.max_gap_s!r:.60}")
        if self.vertical_datum is not None:
            object.__setattr__(self, "vertical_datum", checked("file", _SETTING, self.vertical_datum))
        if self.departure is not None and self.departure.tzinfo is None:
            raise InvalidInput("file", "departure", f"needs an offset from UTC; got {self.departure.isoformat()}")
        if self.speed_kn is not None and not (isfinite(self.speed_kn) and self.speed_kn > 0.0):
            raise InvalidInput("file", "speed_kn", f"must be a number of knots above 0; got {self.speed_kn!r:.60}")


@dataclass(slots=True)
class _Reading:
    """A file being read: the hints, their zone, the fields by column, and the columns found so far."""

    hints: FileHints
    zone: ZoneInfo | None
    fields: Mapping[str, str]
    found: set[str] = field(default_factory=set)


_READING: ContextVar[_Reading | None] = ContextVar("reading", default=None)
_SCENE: ContextVar[Callable[[], Scene]] = ContextVar("scene", default=lambda: Scene("file"))


@contextmanager
def for_scene(settings: Callable[[], Scene]) -> Iterator[None]:
    """Read files without settings for a scene; its settings are asked for if a file needs them."""
    token = _SCENE.set(settings)
    try:
        yield
    finally:
        _SCENE.reset(token)


def vertical_datum() -> VerticalDatum:
    """Return what the heights of the scene are above that a file is read for."""
    reading = _READING.get()
    given = None if reading is None else reading.hints.vertical_datum
    return scene_read_for().vertical_datum if given is None else VerticalDatum(given)


def scene_read_for() -> Scene:
    """Return the settings of the scene that a file without settings is read for."""
    return _SCENE.get()()


@contextmanager
def applied(hints: FileHints | None) -> Iterator[None]:
    """Read a file with hints; raises InvalidInput for a column that the file does not have."""
    if hints is None:
        yield
        return
    zone = None if hints.time_zone is None else ZoneInfo(hints.time_zone)
    reading = _Reading(hints, zone, {column: one for one, column in hints.columns.items()})
    token = _READING.set(reading)
    try:
        yield
    finally:
        _READING.reset(token)
    for column, one in reading.fields.items():
        if column not in reading.found:
            raise InvalidInput("file", f"column {column}", f"is mapped to {one}, but the file has no such column")


def are_applied() -> bool:
    """Return whether the file is read with hints."""
    return _READING.get() is not None


def heights_may_be_unbounded() -> bool:
    """Return whether heights above another vertical datum than the scene's are unbounded."""
    reading = _READING.get()
    return reading is not None and reading.hints.unbounded_heights


def departure() -> tuple[int | None, float | None]:
    """Return when routes depart that do not say it, microseconds since 1970, and at which speed, knots."""
    reading = _READING.get()
    if reading is None:
        return None, None
    start = reading.hints.departure
    return None if start is None else (start - EPOCH) // MICROSECOND, reading.hints.speed_kn


def haven() -> Sequence[float]:
    """Return how far havens without a size reach, metres: ahead, astern, to port, to starboard; default 0."""
    given = given_haven()
    return (0.0,) * 4 if given is None else given


def given_haven() -> Sequence[float] | None:
    """Return how far havens without a size reach, as `haven`; None if nothing is given."""
    reading = _READING.get()
    return None if reading is None else reading.hints.haven_m


def max_gap_s() -> float:
    """Return how long nothing may be known of an object between its positions, seconds."""
    reading = _READING.get()
    return MAX_GAP_S if reading is None else reading.hints.max_gap_s


def renamed(names: Sequence[str]) -> list[str]:
    """Return the names of columns or properties, as the hints map them; raises InvalidInput for a name given twice."""
    reading = _READING.get()
    if reading is None or reading.fields.keys().isdisjoint(names):
        return list(names)
    reading.found.update(reading.fields.keys() & set(names))
    new = [reading.fields.get(name, name) for name in names]
    for name in new:
        if new.count(name) > 1:
            raise InvalidInput("file", f"column {name}", f"is there already, and {reading.hints.columns[name]} too")
    return new


def with_offset(naive: datetime) -> datetime | None:
    """Return a time without offset in the zone of the hints, None without one; raises ValueError if it is ambiguous."""
    reading = _READING.get()
    if reading is None or reading.zone is None:
        return None
    early, late = (naive.replace(tzinfo=reading.zone, fold=fold) for fold in (0, 1))
    if early.utcoffset() != late.utcoffset():
        raise ValueError(f"{naive.isoformat()} occurs twice or never in {reading.zone}: it needs an offset")
    return early
