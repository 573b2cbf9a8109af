"""Conflicts and closest approaches as JSON, CSV and GeoJSON.

Members are the columns of the views `conflicts` and `approaches`, in their order; what only a database knows is null,
and an empty cell, without one.
"""

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from itertools import chain
from json.encoder import encode_basestring
from math import isfinite
from operator import attrgetter
from typing import Any, Final

from conflictdb.formats.json_text import dumped, harmless
from conflictdb.model import record
from conflictdb.model.results import Approach, Conflict, Period, Position, SceneState, format_moment, interval_text

# The line end decides which cells are quoted: a key may contain a line break of either kind.
_LINE_END: Final = "\r\n"
# First characters of cells that a spreadsheet calculates (also in full width), and the apostrophe that prevents it.
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠", "'")  # noqa: RUF001


COLUMNS: Final = tuple(column.name for column in record.COLUMNS)
APPROACH_COLUMNS: Final = tuple(column.name for column in record.APPROACH_COLUMNS)
_NULL: Final = "null"


@dataclass(frozen=True, slots=True)
class MoreColumn:
    """A column after those of the view.

    name : in files; in the header of a table in capitals
    value : of a pair: a text, or texts, which are a list in JSON
    shown : the text in a table, if it differs
    is_last : in a table, whether it stands after the columns of the view
    """

    name: str
    value: Callable[[Conflict], str | list[str]]
    shown: Callable[[Conflict], str] | None = None
    is_last: bool = False

    def text(self, one: Conflict) -> str:
        """Return its value as a table shows it."""
        value = self.value(one) if self.shown is None else self.shown(one)
        return value if isinstance(value, str) else ", ".join(value)


def columns_of(kind: type[Conflict] | type[Approach]) -> tuple[str, ...]:
    """Return the columns of conflicts, or of closest approaches."""
    return APPROACH_COLUMNS if kind is Approach else COLUMNS


def as_json(conflicts: Iterable[Conflict | Approach], more: Sequence[MoreColumn] = ()) -> Iterator[str]:
    """Yield the lines of one JSON array, one object per pair; unbounded ends of periods are null."""
    yield "["
    separator = "\n  "
    for one in conflicts:
        yield separator + harmless(_form(one).json(one, more))
        separator = ",\n  "
    yield "]\n" if separator == "\n  " else "\n]\n"


def as_csv(
    conflicts: Iterable[Conflict | Approach], columns: Sequence[str], more: Sequence[MoreColumn] = ()
) -> Iterator[str]:
    """Yield the lines of a CSV file with a header: COLUMNS of conflicts, APPROACH_COLUMNS of closest approaches.

    Periods are ISO 8601 intervals, start/end, separated by spaces; an unbounded end is two dots. Geometries are
    GeoJSON. Texts of users that a spreadsheet could take for a formula begin with an apostrophe: see `cell`.
    """
    writer = csv.writer(_Echo(), lineterminator=_LINE_END)
    header = [*columns, *(column.name for column in more)]
    for row in chain([header], (_form(one).cells(one, more) for one in conflicts)):
        yield f"{writer.writerow(row).removesuffix(_LINE_END)}\n"


class _Echo:
    """A file whose `write` returns the text."""

    def write(self, text: str) -> str:
        """Return the text."""
        return text


def cell(text: str) -> str:
    """Return a text that users gave as a cell that no spreadsheet takes for a formula.

    One that begins with a character of `_FORMULA`, or with an apostrophe, gets an apostrophe in front.
    """
    return f"'{text}" if text.startswith(_FORMULA) else text


def as_geojson(
    conflicts: Iterable[Conflict | Approach], states: Sequence[SceneState] = (), more: Sequence[MoreColumn] = ()
) -> Iterator[str]:
    """Yield the lines of a FeatureCollection: where each pair is, and the rest.

    That is a conflict's region, else its first contact; of a closest approach the line between the nearest points. The
    foreign member `scenes` says of each scene of a database whether this is all.
    """
    names = ("scene", "is_current", "objects", "pending", "last_run_at", "last_error", "detected_at", "compared_at")
    scenes = [{name: _plain(getattr(state, name)) for name in names} for state in states]
    member = f'\n  "scenes": {dumped(scenes)},' if scenes else ""
    yield f'{{ "type": "FeatureCollection",{member}\n  "features": ['
    separator = "\n"
    for one in conflicts:
        if isinstance(one, Approach):
            geometry = _between(one.a_deg, one.b_deg)
            properties = _APPROACH.json(one)
        else:
            geometry = one.region or _point(one.first_contact_deg)
            if geometry == _NULL and one.closest_a_deg and one.closest_b_deg:
                geometry = _between(one.closest_a_deg, one.closest_b_deg)
            properties = _PROPERTIES.json(one, more)
        yield separator + harmless(f'    {{"type": "Feature", "geometry": {geometry}, "properties": {properties}}}')
        separator = ",\n"
    yield " ] }\n"


def _plain(value: object) -> object:
    return format_moment(value) if isinstance(value, datetime) else value


@lru_cache(maxsize=64)  # half of the moments of a list are those of the run, or the row's own again
def _moment(moment: datetime) -> str:
    return format_moment(moment) or ""


def _quoted(moment: datetime) -> str:
    return f'"{_moment(moment)}"'


def _periods(periods: Sequence[Period]) -> str:
    ends = [[_NULL if end is None else _quoted(end) for end in period] for period in periods]
    return f"[{', '.join([f'[{start}, {end}]' for start, end in ends])}]"


def _truth(value: bool) -> str:
    return "true" if value else "false"


def _number(value: float) -> str:
    if not isfinite(value):
        raise ValueError(f"JSON has no number {value}")
    return repr(float(value))  # numpy's numbers say their type


def _point(position_deg: Position | None) -> str:
    return _NULL if position_deg is None else f'{{"type": "Point", "coordinates": {_coordinates(position_deg)}}}'


def _coordinates(position_deg: Position) -> str:
    lon_deg, lat_deg = position_deg
    return f"[{_number(lon_deg)}, {_number(lat_deg)}]"


def _between(a_deg: Position, b_deg: Position) -> str:
    """Return the line between two points; where it would cross the antimeridian, the points."""
    if a_deg == b_deg:
        return _point(a_deg)
    kind = "LineString" if abs(a_deg[0] - b_deg[0]) <= 180.0 else "MultiPoint"
    return f'{{"type": "{kind}", "coordinates": [{_coordinates(a_deg)}, {_coordinates(b_deg)}]}}'


# Form of a value, never None, in JSON, and in CSV where it differs.
_JSON: Final[dict[record.ColumnType, Callable[[Any], str]]] = {
    record.ColumnType.TEXT: encode_basestring,
    record.ColumnType.NAME: encode_basestring,
    record.ColumnType.INSTANT: _quoted,
    record.ColumnType.PERIODS: _periods,
    record.ColumnType.NUMBER: _number,
    record.ColumnType.WHOLE: str,
    record.ColumnType.TRUTH: _truth,
    record.ColumnType.POINT: _point,
    record.ColumnType.REGION: str,  # JSON already
}
_CSV: Final[dict[record.ColumnType, Callable[[Any], str]]] = _JSON | {
    record.ColumnType.TEXT: cell,
    record.ColumnType.NAME: str,
    record.ColumnType.INSTANT: _moment,
    record.ColumnType.PERIODS: interval_text,
}


class _Form:
    """Rows of a kind, as JSON and as cells of CSV."""

    def __init__(self, columns: Sequence[record.Column]) -> None:
        self._members = [f'"{column.name}": ' for column in columns]
        self._values = attrgetter(*(column.field for column in columns))
        self._json = [_JSON[column.type] for column in columns]
        self._csv = [_CSV[column.type] for column in columns]

    def json(self, one: Any, more: Sequence[MoreColumn] = ()) -> str:
        """Return a row as a JSON object."""
        rows = zip(self._members, self._json, self._values(one), strict=True)
        members = [member + (_NULL if value is None else text(value)) for member, text, value in rows]
        members += [f'"{column.name}": {dumped(column.value(one))}' for column in more]
        return f"{{{', '.join(members)}}}"

    def cells(self, one: Any, more: Sequence[MoreColumn] = ()) -> list[str]:
        """Return a row as unquoted cells; unknown values are empty."""
        row = ["" if value is None else text(value) for text, value in zip(self._csv, self._values(one), strict=True)]
        for column in more:
            value = column.value(one)
            row.append(cell(value) if isinstance(value, str) else dumped(value))
        return row


_CONFLICT: Final = _Form(record.COLUMNS)
_APPROACH: Final = _Form(record.APPROACH_COLUMNS)
_PROPERTIES: Final = _Form([column for column in record.COLUMNS if column.type is not record.ColumnType.REGION])


def _form(one: Conflict | Approach) -> _Form:
    return _APPROACH if isinstance(one, Approach) else _CONFLICT
