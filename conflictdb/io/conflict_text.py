"""Conflicts and closest approaches as JSON, CSV and GeoJSON.

Members are the columns of the views `conflicts` and `approaches`, in their order; what only a database knows is null,
and an empty cell, without one.
"""

import csv
import json
from collections.abc import Iterable, Iterator, Sequence
from io import StringIO
from typing import Any, Final

from conflictdb.io.instants import format_moment
from conflictdb.io.json_text import dumped
from conflictdb.results import Approach, Conflict, Period, Position, SceneState

# What ends a line decides which cells are quoted: a key may hold a line break of either kind.
_LINE_END: Final = "\r\n"
# Columns that hold what users gave.
_GIVEN: Final = ("scene", "a_key", "b_key")
# What makes a spreadsheet calculate a cell (also in full width), and the apostrophe that says it shall not.
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠", "'")  # noqa: RUF001


def as_json(conflicts: Iterable[Conflict | Approach]) -> Iterator[str]:
    """Yield the lines of one JSON array, one object per pair; unbounded ends of periods are null."""
    yield "["
    separator = "\n"
    for conflict in conflicts:
        yield f"{separator}  {_object(conflict)}"
        separator = ",\n"
    yield "]\n" if separator == "\n" else "\n]\n"


def _object(conflict: Conflict | Approach) -> str:
    """Return a conflict or a closest approach as JSON; a region is JSON already, not to be read again."""
    if isinstance(conflict, Approach) or conflict.region is None:
        return dumped(members(conflict))
    # No text has these quotes: within texts they are escaped.
    head, tail = dumped(members(conflict, with_region=False)).split('"region": null', 1)
    return f'{head}"region": {conflict.region}{tail}'


def as_csv(conflicts: Iterable[Conflict | Approach], columns: Sequence[str]) -> Iterator[str]:
    """Yield the lines of a CSV file with a header: COLUMNS of conflicts, APPROACH_COLUMNS of closest approaches.

    Periods are ISO 8601 intervals, start/end, separated by spaces; an unbounded end is two dots. Geometries are
    GeoJSON. Names and keys that a spreadsheet could take for a formula begin with an apostrophe: see `cell`.
    """
    buffer = StringIO()
    writer = csv.writer(buffer, lineterminator=_LINE_END)

    def written(row: Sequence[object]) -> str:
        buffer.seek(0)
        buffer.truncate()
        writer.writerow(row)
        return buffer.getvalue().removesuffix(_LINE_END) + "\n"

    yield written(columns)
    for conflict in conflicts:
        row = members(conflict)
        if isinstance(conflict, Conflict):
            row["periods"] = interval_text(conflict.periods)
        for name in [name for name in columns if isinstance(row[name], dict)]:
            row[name] = json.dumps(row[name], separators=(",", ":"))
        for name in ("is_current", "scene_is_current"):
            row[name] = "" if row[name] is None else str(row[name]).lower()
        row.update({name: cell(row[name]) for name in _GIVEN})
        yield written([row[column] for column in columns])


def cell(text: str) -> str:
    """Return a text that users gave as a cell that no spreadsheet takes for a formula.

    One that begins with a character of `_FORMULA`, or with an apostrophe, gets an apostrophe in front: to have the text
    again, take the first character of each such cell away if it is an apostrophe.
    """
    return f"'{text}" if text.startswith(_FORMULA) else text


def as_geojson(conflicts: Iterable[Conflict | Approach], states: Sequence[SceneState] = ()) -> Iterator[str]:
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
        }
        for state in states
    ]
    told = f'\n  "scenes": {dumped(scenes)},' if scenes else ""
    yield f'{{ "type": "FeatureCollection",{told}\n  "features": ['
    separator = "\n"
    for conflict in conflicts:
        properties = members(conflict)
        if isinstance(conflict, Approach):
            geometry = _between(conflict.a_deg, conflict.b_deg)
        else:
            region, point = properties.pop("region"), properties.pop("first_contact_point")
            properties["first_contact_point"] = point
            geometry = point if region is None else region
            if geometry is None and conflict.closest_a_deg and conflict.closest_b_deg:
                geometry = _between(conflict.closest_a_deg, conflict.closest_b_deg)
        feature = {"type": "Feature", "geometry": geometry, "properties": properties}
        yield f"{separator}    {dumped(feature)}"
        separator = ",\n"
    yield " ] }\n"


def members(conflict: Conflict | Approach, *, with_region: bool = True) -> dict[str, Any]:
    """Return a conflict or a closest approach as the members of one JSON object; without its region that is null."""
    if isinstance(conflict, Approach):
        return {
            "scene": conflict.scene,
            "a_key": conflict.a_key,
            "a_kind": conflict.a_kind,
            "b_key": conflict.b_key,
            "b_kind": conflict.b_kind,
            "closest_at": format_moment(conflict.closest_at),
            "closest_m": conflict.closest_m,
            "closest_error_m": conflict.closest_error_m,
            "a_point": _point(conflict.a_deg),
            "b_point": _point(conflict.b_deg),
            "verdict": conflict.verdict,
            "is_current": conflict.is_current,
            "run_id": conflict.run_id,
            "found_at": format_moment(conflict.found_at),
            "scene_is_current": conflict.scene_is_current,
        }
    return {
        "scene": conflict.scene,
        "a_key": conflict.a_key,
        "a_kind": conflict.a_kind,
        "b_key": conflict.b_key,
        "b_kind": conflict.b_kind,
        "periods": [[format_moment(start), format_moment(end)] for start, end in conflict.periods],
        "first_contact": format_moment(conflict.first_contact),
        "last_contact": format_moment(conflict.last_contact),
        "verdict": conflict.verdict,
        "region": json.loads(conflict.region) if with_region and conflict.region is not None else None,
        "first_contact_point": _point(conflict.first_contact_deg),
        "method": conflict.method,
        "time_error_s": conflict.time_error_s,
        "is_current": conflict.is_current,
        "run_id": conflict.run_id,
        "found_at": format_moment(conflict.found_at),
        "closest_at": format_moment(conflict.closest_at),
        "closest_m": conflict.closest_m,
        "closest_error_m": conflict.closest_error_m,
        "closest_a_point": _point(conflict.closest_a_deg),
        "closest_b_point": _point(conflict.closest_b_deg),
        "scene_is_current": conflict.scene_is_current,
    }


def interval_text(periods: Sequence[Period]) -> str:
    """Return periods as ISO 8601 intervals, separated by spaces; an unbounded end is two dots."""
    return " ".join("/".join(format_moment(end) or ".." for end in period) for period in periods)


def _point(position_deg: Position | None) -> dict[str, Any] | None:
    return None if position_deg is None else {"type": "Point", "coordinates": list(position_deg)}


def _between(a_deg: Position, b_deg: Position) -> dict[str, Any]:
    """Return the line between two points; where it would cross the antimeridian, the points."""
    if a_deg == b_deg:
        return {"type": "Point", "coordinates": list(a_deg)}
    kind = "LineString" if abs(a_deg[0] - b_deg[0]) <= 180.0 else "MultiPoint"
    return {"type": kind, "coordinates": [list(a_deg), list(b_deg)]}


COLUMNS = (
    *("scene", "a_key", "a_kind", "b_key", "b_kind", "periods", "first_contact", "last_contact", "verdict", "region"),
    *("first_contact_point", "method", "time_error_s", "is_current", "run_id", "found_at"),
    *("closest_at", "closest_m", "closest_error_m", "closest_a_point", "closest_b_point"),
    "scene_is_current",
)
APPROACH_COLUMNS = (
    *("scene", "a_key", "a_kind", "b_key", "b_kind", "closest_at", "closest_m", "closest_error_m", "a_point"),
    *("b_point", "verdict", "is_current", "run_id", "found_at", "scene_is_current"),
)
