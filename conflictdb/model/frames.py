"""Convert conflicts and closest approaches to data frames of pandas and geopandas, with the columns of the SQL views.

Needs the extra `pandas`: ``pip install 'conflictdb[pandas]'``.
"""

from collections.abc import Callable, Sequence
from datetime import datetime
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely

from conflictdb.errors import ConflictDBError
from conflictdb.model import record
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.results import interval_text

if TYPE_CHECKING:
    import geopandas
    import pandas as pd

    from conflictdb.model.results import Approach, Conflict

    Position = tuple[float, float]

# Longitude and latitude on WGS84, like all geometries of conflictdb.
CRS: Final = "EPSG:4326"
_POINT: Final = "_point"
_NO_INSTANT: Final = np.datetime64("NaT", "us")


def conflict_frame(rows: "Sequence[Conflict]") -> "pd.DataFrame":
    """Return conflicts as a frame, one row each; raises ConflictDBError without pandas.

    `geometry` is a conflict's region, where that was read, else its first contact, else the line between the nearest
    points.
    """
    return _frame(rows, [_GEOMETRY if one.type is record.ColumnType.REGION else one for one in record.COLUMNS], _place)


def approach_frame(rows: "Sequence[Approach]") -> "pd.DataFrame":
    """Return closest approaches as a frame, one row each; raises ConflictDBError without pandas.

    `geometry` is the line between the nearest points.
    """
    columns = record.APPROACH_COLUMNS
    names = [one.name for one in columns]
    point, rest = names.index("a_point"), names.index("verdict") + 1
    # The last columns are in the order of conflicts.
    ordered = [*columns[:point], _GEOMETRY, *columns[point:rest], *sorted(columns[rest:], key=record.COLUMNS.index)]
    return _frame(rows, ordered, lambda one: _between(one.a_deg, one.b_deg))


def with_geometry(frame: "pd.DataFrame") -> "geopandas.GeoDataFrame":
    """Return a frame of this module as a GeoDataFrame that every file format can store, in EPSG:4326.

    `geometry` is the only geometry column. Each other point becomes two columns of numbers, NaN where it is missing:
    `first_contact_point` becomes `first_contact_lon_deg` and `first_contact_lat_deg`. `periods` become text: ISO 8601
    intervals, separated by spaces; an unbounded end is two dots.

    Raises ConflictDBError without geopandas.
    """
    geopandas = _library("geopandas")
    columns: dict[str, Any] = {}
    for name in map(str, frame.columns):
        if name.endswith(_POINT):
            points = frame[name].to_numpy(dtype=np.object_)
            start = name.removesuffix(_POINT)
            columns |= {f"{start}_lon_deg": shapely.get_x(points), f"{start}_lat_deg": shapely.get_y(points)}
        else:
            columns[name] = _texts([interval_text(one) for one in frame[name]]) if name == "periods" else frame[name]
    return geopandas.GeoDataFrame(columns, index=frame.index, geometry="geometry", crs=CRS)


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise ConflictDBError(f"a data frame needs {name}: pip install 'conflictdb[pandas]'") from None


def _frame(rows: Sequence[Any], columns: Sequence[record.Column], place: Callable[[Any], Any]) -> "pd.DataFrame":
    """Return rows as a frame; `place` returns the geometry of a row."""
    pandas = _library("pandas")
    return pandas.DataFrame({one.name: _kept(one, rows, place) for one in columns})


def _kept(column: record.Column, rows: Sequence[Any], place: Callable[[Any], Any]) -> Any:
    if column is _GEOMETRY:
        return _objects([place(row) for row in rows])
    values = list(map(attrgetter(column.field), rows))
    if column.type is record.ColumnType.POINT:
        return _objects([_point(value) for value in values])
    if column.type in (record.ColumnType.TEXT, record.ColumnType.NAME):
        return _texts(values)
    return _KEPT[column.type](values)


def _texts(values: "list[str | None] | list[str]") -> Any:
    import pandas as pd

    return pd.Series([None if value is None else str(value) for value in values], dtype="str")


def _numbers(values: list[float | None]) -> Any:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _whole(values: list[int | None]) -> Any:
    import pandas as pd

    return pd.array(values, dtype="Int64")


def _truths(values: list[bool | None]) -> Any:
    import pandas as pd

    return pd.array(values, dtype="boolean")


def _instants(values: list[datetime | None]) -> Any:
    """Return instants to the microsecond, in UTC; NaT for None."""
    import pandas as pd

    since = [_NO_INSTANT if one is None else np.datetime64((one - EPOCH) // MICROSECOND, "us") for one in values]
    return pd.DatetimeIndex(np.array(since, dtype="datetime64[us]")).tz_localize("UTC")


def _objects(values: list[Any]) -> Any:
    kept = np.empty(len(values), dtype=np.object_)
    kept[:] = values
    return kept


def _place(one: "Conflict") -> Any:
    """Return the geometry of a conflict, as in its GeoJSON feature."""
    if one.region is not None:
        return shapely.from_geojson(one.region)
    if one.first_contact_deg is None and one.closest_a_deg and one.closest_b_deg:
        return _between(one.closest_a_deg, one.closest_b_deg)
    return _point(one.first_contact_deg)


def _point(position_deg: "Position | None") -> Any:
    return None if position_deg is None else shapely.Point(position_deg)


def _between(a_deg: "Position", b_deg: "Position") -> Any:
    """Return the line between two points, or the points if it would cross the antimeridian."""
    if a_deg == b_deg:
        return shapely.Point(a_deg)
    kind = shapely.LineString if abs(a_deg[0] - b_deg[0]) <= 180.0 else shapely.MultiPoint
    return kind([a_deg, b_deg])


_GEOMETRY: Final = record.Column("geometry", record.ColumnType.REGION, "Where it is.")
_KEPT: Final[dict[record.ColumnType, Callable[[list[Any]], Any]]] = {
    record.ColumnType.NUMBER: _numbers,
    record.ColumnType.WHOLE: _whole,
    record.ColumnType.TRUTH: _truths,
    record.ColumnType.INSTANT: _instants,
    record.ColumnType.PERIODS: _objects,
}
