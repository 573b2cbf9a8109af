"""Conflicts as JSON, CSV and GeoJSON. Members are the columns of the view `conflicts`, in its order."""

import csv
import json
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from io import StringIO
from typing import Any

from conflictdb.io.instants import format_moment
from conflictdb.store import Conflict

Period = tuple[datetime | None, datetime | None]


def as_json(conflicts: Iterable[Conflict]) -> Iterator[str]:
    """Yield the lines of one JSON array, one object per conflict; unbounded ends of periods are null."""
    yield "["
    separator = "\n"
    for conflict in conflicts:
        yield f"{separator}  {json.dumps(members(conflict), ensure_ascii=False, allow_nan=False)}"
        separator = ",\n"
    yield "]\n" if separator == "\n" else "\n]\n"


def as_csv(conflicts: Iterable[Conflict]) -> Iterator[str]:
    """Yield the lines of a CSV file with a header.

    Periods are ISO 8601 intervals, start/end, separated by spaces; an unbounded end is two dots. Geometries are
    GeoJSON.
    """
    buffer = StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for conflict in conflicts:
        row = members(conflict)
        row["periods"] = interval_text(conflict.periods)
        for name in ("region", "first_contact_point"):
            row[name] = None if row[name] is None else json.dumps(row[name], separators=(",", ":"))
        row["is_current"] = str(conflict.is_current).lower()
        writer.writerow([row[column] for column in COLUMNS])
        yield buffer.getvalue()
        buffer.seek(0)
        buffer.truncate()
    yield buffer.getvalue()


def as_geojson(conflicts: Iterable[Conflict]) -> Iterator[str]:
    """Yield the lines of a FeatureCollection: where each conflict is (region, else first contact), and the rest."""
    yield '{ "type": "FeatureCollection",\n  "features": ['
    separator = "\n"
    for conflict in conflicts:
        properties = members(conflict)
        region, point = properties.pop("region"), properties.pop("first_contact_point")
        feature = {
            "type": "Feature",
            "geometry": point if region is None else region,
            "properties": {**properties, "first_contact_point": point},
        }
        yield f"{separator}    {json.dumps(feature, ensure_ascii=False, allow_nan=False)}"
        separator = ",\n"
    yield " ] }\n"


def members(conflict: Conflict) -> dict[str, Any]:
    """Return a conflict as the members of one JSON object."""
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
        "region": None if conflict.region is None else json.loads(conflict.region),
        "first_contact_point": _point(conflict.first_contact_deg),
        "method": conflict.method,
        "time_error_s": conflict.time_error_s,
        "is_current": conflict.is_current,
        "run_id": conflict.run_id,
        "found_at": format_moment(conflict.found_at),
    }


def interval_text(periods: Sequence[Period]) -> str:
    """Return periods as ISO 8601 intervals, separated by spaces; an unbounded end is two dots."""
    return " ".join("/".join(format_moment(end) or ".." for end in period) for period in periods)


def _point(position_deg: tuple[float, float] | None) -> dict[str, Any] | None:
    return None if position_deg is None else {"type": "Point", "coordinates": list(position_deg)}


COLUMNS = (
    *("scene", "a_key", "a_kind", "b_key", "b_kind", "periods", "first_contact", "last_contact", "verdict", "region"),
    *("first_contact_point", "method", "time_error_s", "is_current", "run_id", "found_at"),
)
