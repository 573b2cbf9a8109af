"""Conflicts and closest approaches as JSON, CSV and GeoJSON.

Members are the columns of the views `conflicts` and `approaches`, in their order; what only a database knows is null,
and an empty cell, without one.
"""

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from io import StringIO
from json.encoder import encode_basestring
from math import isfinite
from typing import Final

from conflictdb.io.instants import format_moment
from conflictdb.io.json_text import dumped, harmless
from conflictdb.results import Approach, Conflict, Period, Position, SceneState, Verdict

# What ends a line decides which cells are quoted: a key may hold a line break of either kind.
_LINE_END: Final = "\r\n"
# What makes a spreadsheet calculate a cell (also in full width), and the apostrophe that says it shall not.
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠", "'")  # noqa: RUF001


COLUMNS: Final = (
    *("scene", "a_key", "a_kind", "b_key", "b_kind", "periods", "first_contact", "last_contact", "verdict", "region"),
    *("first_contact_point", "method", "time_error_s", "is_current", "run_id", "found_at"),
    *("closest_at", "closest_m", "closest_error_m", "closest_a_point", "closest_b_point"),
    *("scene_is_current", "conflict_id", "opened_at", "changed_at"),
    *("acknowledged_by", "acknowledged_at", "acknowledged_for", "acknowledged_until"),
)
APPROACH_COLUMNS: Final = (
    *("scene", "a_key", "a_kind", "b_key", "b_kind", "closest_at", "closest_m", "closest_error_m", "a_point"),
    *("b_point", "verdict", "is_current", "run_id", "found_at", "scene_is_current", "method", "time_error_s"),
)
# What a cell of CSV shows without the quotes of JSON.
_TEXTS: Final = (
    *("a_kind", "b_kind", "first_contact", "last_contact", "verdict", "method", "found_at", "closest_at"),
    *("opened_at", "changed_at", "acknowledged_at", "acknowledged_until"),
)
_REGION: Final = COLUMNS.index("region")
_PERIODS: Final = COLUMNS.index("periods")
_BY: Final = COLUMNS.index("acknowledged_by")
_WHY: Final = COLUMNS.index("acknowledged_for")
_NULL: Final = "null"
_UNACKNOWLEDGED: Final = (_NULL,) * 4
_TRUTH: Final = {None: _NULL, False: "false", True: "true"}


@dataclass(frozen=True, slots=True)
class MoreColumn:
    """A column after those of the view.

    name : in files; in the header of a table in capitals
    value : of a pair: a text, or texts, which are a list in JSON
    """

    name: str
    value: Callable[[Conflict], str | list[str]]

    def text(self, one: Conflict) -> str:
        """Return its value as a table shows it."""
        value = self.value(one)
        return value if isinstance(value, str) else ", ".join(value)


def columns_of(kind: type[Conflict] | type[Approach]) -> tuple[str, ...]:
    """Return the columns of conflicts, or of closest approaches."""
    return APPROACH_COLUMNS if kind is Approach else COLUMNS


def as_json(conflicts: Iterable[Conflict | Approach], more: Sequence[MoreColumn] = ()) -> Iterator[str]:
    """Yield the lines of one JSON array, one object per pair; unbounded ends of periods are null."""
    conflict_line, approach_line = _object([*COLUMNS, *(column.name for column in more)]), _object(APPROACH_COLUMNS)
    yield "["
    separator = "\n  "
    for one in conflicts:
        line = approach_line % _approach_texts(one) if isinstance(one, Approach) else conflict_line % _texts(one, more)
        yield separator + harmless(line)
        separator = ",\n  "
    yield "]\n" if separator == "\n  " else "\n]\n"


def as_csv(
    conflicts: Iterable[Conflict | Approach], columns: Sequence[str], more: Sequence[MoreColumn] = ()
) -> Iterator[str]:
    """Yield the lines of a CSV file with a header: COLUMNS of conflicts, APPROACH_COLUMNS of closest approaches.

    Periods are ISO 8601 intervals, start/end, separated by spaces; an unbounded end is two dots. Geometries are
    GeoJSON. Texts of users that a spreadsheet could take for a formula begin with an apostrophe: see `cell`.
    """
    buffer = StringIO()
    writer = csv.writer(buffer, lineterminator=_LINE_END)
    quoted = [columns.index(name) for name in _TEXTS if name in columns]
    scene, a_key, b_key = (columns.index(name) for name in ("scene", "a_key", "b_key"))

    def written(row: Sequence[str]) -> str:
        buffer.seek(0)
        buffer.truncate()
        writer.writerow(row)
        return buffer.getvalue().removesuffix(_LINE_END) + "\n"

    yield written([*columns, *(column.name for column in more)])
    for one in conflicts:
        row = list(_approach_texts(one) if isinstance(one, Approach) else _texts(one, more))
        for k in quoted:
            if row[k] != _NULL:
                row[k] = row[k][1:-1]
        for k in range(len(columns), len(row)):
            row[k] = cell(json.loads(row[k])) if row[k].startswith('"') else row[k]
        if isinstance(one, Conflict):
            row[_PERIODS] = interval_text(one.periods)
        row = ["" if text == _NULL else text for text in row]
        if isinstance(one, Conflict) and one.acknowledged_by is not None:
            row[_BY], row[_WHY] = cell(one.acknowledged_by), cell(one.acknowledged_for or "")
        row[scene], row[a_key], row[b_key] = cell(one.scene), cell(one.a_key), cell(one.b_key)
        yield written(row)


def cell(text: str) -> str:
    """Return a text that users gave as a cell that no spreadsheet takes for a formula.

    One that begins with a character of `_FORMULA`, or with an apostrophe, gets an apostrophe in front: to have the text
    again, take the first character of each such cell away if it is an apostrophe.
    """
    return f"'{text}" if text.startswith(_FORMULA) else text


def as_geojson(
    conflicts: Iterable[Conflict | Approach], states: Sequence[SceneState] = (), more: Sequence[MoreColumn] = ()
) -> Iterator[str]:
    """Yield the lines of a FeatureCollection: where each pair is, and the rest.

    That is a conflict's region, else its first contact; of a closest approach the line between the nearest points. The
    foreign member `scenes` says of each scene of a database whether this is all.
    """
    scenes = [
        {
            "scene": state.scene,
            "is_current": state.is_current,
            "objects": state.objects,
            "pending": state.pending,
            "last_run_at": format_moment(state.last_run_at),
            "last_error": state.last_error,
            "detected_at": format_moment(state.detected_at),
        }
        for state in states
    ]
    told = f'\n  "scenes": {dumped(scenes)},' if scenes else ""
    yield f'{{ "type": "FeatureCollection",{told}\n  "features": ['
    conflict_line = _object([*(name for name in COLUMNS if name != "region"), *(column.name for column in more)])
    approach_line = _object(APPROACH_COLUMNS)
    separator = "\n"
    for one in conflicts:
        if isinstance(one, Approach):
            geometry = _between(one.a_deg, one.b_deg)
            properties = approach_line % _approach_texts(one)
        else:
            texts = _texts(one, more)
            geometry = texts[_REGION] if one.region is not None else _point(one.first_contact_deg)
            if geometry == _NULL and one.closest_a_deg and one.closest_b_deg:
                geometry = _between(one.closest_a_deg, one.closest_b_deg)
            properties = conflict_line % (texts[:_REGION] + texts[_REGION + 1 :])
        yield separator + harmless(f'    {{"type": "Feature", "geometry": {geometry}, "properties": {properties}}}')
        separator = ",\n"
    yield " ] }\n"


def interval_text(periods: Sequence[Period]) -> str:
    """Return periods as ISO 8601 intervals, separated by spaces; an unbounded end is two dots."""
    return " ".join("/".join(format_moment(end) or ".." for end in period) for period in periods)


def _object(columns: Sequence[str]) -> str:
    """Return a JSON object with a place for the text of each column."""
    return "{" + ", ".join(f'"{name}": %s' for name in columns) + "}"


def _texts(one: Conflict, more: Sequence[MoreColumn] = ()) -> tuple[str, ...]:
    """Return the columns of a conflict as JSON. By hand: a list of tens of thousands takes half as long."""
    periods = [(_moment(start), _moment(end)) for start, end in one.periods]
    found_at = _moment(one.found_at)
    return (
        encode_basestring(one.scene),
        encode_basestring(one.a_key),
        encode_basestring(one.a_kind),
        encode_basestring(one.b_key),
        encode_basestring(one.b_kind),
        f"[{', '.join([f'[{start}, {end}]' for start, end in periods])}]",
        periods[0][0] if periods else _NULL,
        periods[-1][1] if periods else _NULL,
        encode_basestring(one.verdict),
        _NULL if one.region is None else one.region,  # JSON already
        _point(one.first_contact_deg),
        encode_basestring(one.method),
        _number(one.time_error_s),
        _TRUTH[one.is_current],
        _NULL if one.run_id is None else str(one.run_id),
        found_at,
        _moment(one.closest_at),
        _number(one.closest_m),
        _number(one.closest_error_m),
        _point(one.closest_a_deg),
        _point(one.closest_b_deg),
        _TRUTH[one.scene_is_current],
        _NULL if one.conflict_id is None else str(one.conflict_id),
        _NULL if one.verdict is Verdict.NEAR else found_at,
        _moment(one.changed_at),
        *(_UNACKNOWLEDGED if one.acknowledged_by is None else _acknowledged(one)),
        *[dumped(column.value(one)) for column in more],
    )


def _acknowledged(one: Conflict) -> tuple[str, ...]:
    return (
        encode_basestring(one.acknowledged_by or ""),
        _moment(one.acknowledged_at),
        encode_basestring(one.acknowledged_for or ""),
        _moment(one.acknowledged_until),
    )


def _approach_texts(one: Approach) -> tuple[str, ...]:
    """Return the columns of a closest approach as JSON."""
    return (
        encode_basestring(one.scene),
        encode_basestring(one.a_key),
        encode_basestring(one.a_kind),
        encode_basestring(one.b_key),
        encode_basestring(one.b_kind),
        _moment(one.closest_at),
        _number(one.closest_m),
        _number(one.closest_error_m),
        _point(one.a_deg),
        _point(one.b_deg),
        encode_basestring(one.verdict),
        _TRUTH[one.is_current],
        _NULL if one.run_id is None else str(one.run_id),
        _moment(one.found_at),
        _TRUTH[one.scene_is_current],
        encode_basestring(one.method),
        _number(one.time_error_s),
    )


@lru_cache(maxsize=64)  # half of the moments of a list are those of the run, or the row's own again
def _moment(moment: datetime | None) -> str:
    return _NULL if moment is None else f'"{format_moment(moment)}"'


def _number(value: float | None) -> str:
    if value is None:
        return _NULL
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
