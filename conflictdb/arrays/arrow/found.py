"""Convert conflicts to and from Arrow and GeoParquet for users: the columns are those of the view `conflicts`.

Columns that only a database fills are null without one. `a_id`, `a_version`, `b_id` and `b_version` are the numbers of
the objects and of the states that the conflict was computed from; they are needed to write back to a database.
"""

from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.arrow.columns import (
    instants,
    lists,
    measures,
    numbers,
    of_instants,
    of_lists,
    of_measures,
    of_numbers,
)
from conflictdb.arrays.arrow.forms import INSTANT, Array, ArrowForm, Batch
from conflictdb.arrays.polygons import Polygons
from conflictdb.errors import InvalidInput
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Scene
from conflictdb.model.record import COLUMNS, MEASURED, STATES, Column, ColumnType
from conflictdb.model.results import Certainty, Conflict, Kind, Position, Verdict

_PERIOD: Final = pa.struct([pa.field("start", INSTANT), pa.field("end", INSTANT)])
_TYPES: Final = {
    ColumnType.TEXT: pa.string(),
    ColumnType.NAME: pa.string(),
    ColumnType.INSTANT: INSTANT,
    ColumnType.PERIODS: pa.list_(_PERIOD),
    ColumnType.NUMBER: pa.float64(),
    ColumnType.WHOLE: pa.int64(),
    ColumnType.TRUTH: pa.bool_(),
    ColumnType.POINT: pa.binary(),
    ColumnType.REGION: pa.binary(),
}
# Whoever reads conflicts back knows these of the scene.
_MAY_LACK: Final = ("scene", "method")
_COLUMNS: Final = (*COLUMNS, *STATES)
GEOMETRIES: Final = tuple(one.name for one in _COLUMNS if one.type in (ColumnType.REGION, ColumnType.POINT))
FOUND: Final = ArrowForm.of(
    "found",
    1,
    [pa.field(one.name, _TYPES[one.type], nullable=not one.required or one.name in _MAY_LACK) for one in _COLUMNS],
)
# The input of computed conflicts: settings of the scene (JSON) and the number of pairs, the same in all rows, and the
# state of each object, with a digest of its data (`conflictdb.core.pieces.digests`).
COMPUTED: Final = ArrowForm.of(
    "computed",
    1,
    [
        pa.field("settings", pa.string(), nullable=False),
        pa.field("pairs", pa.int64(), nullable=False),
        pa.field("kind", pa.string(), nullable=False),
        pa.field("id", pa.string(), nullable=False),
        pa.field("object_id", pa.int64(), nullable=False),
        pa.field("version", pa.int64(), nullable=False),
        pa.field("digest", pa.int64(), nullable=False),
    ],
)
_WHO: Final = f"Arrow form {FOUND.name!r}"
_KINDS: Final = pa.array([Kind.of_code(code).value for code in range(len(Kind))])
_VERDICTS: Final = pa.array([Verdict.of_code(code).value for code in range(len(Verdict))])
_CERTAINTIES: Final = pa.array([name.value for name in sorted(Certainty, key=lambda one: one.code)])
# A point as WKB: little-endian, type 1, two doubles.
_POINT: Final = np.dtype([("order", "u1"), ("type", "<u4"), ("lon", "<f8"), ("lat", "<f8")])


def of_found(
    scene: Scene, conflicts: Conflicts, region: Polygons, a_key: Sequence[str] | Array, b_key: Sequence[str] | Array
) -> "pa.RecordBatch":
    """Return conflicts of numbered objects with these keys as a batch of the form FOUND.

    a and b stay in their order: the caller puts the area, else the smaller key, first.

    region : their regions
    """
    n = len(conflicts)
    known: dict[str, Array] = {
        "scene": pa.array([scene.name] * n, pa.string()),
        "a_key": pa.array(a_key, pa.string()),
        "a_kind": _KINDS.take(of_numbers(conflicts.a_kind)),
        "b_key": pa.array(b_key, pa.string()),
        "b_kind": _KINDS.take(of_numbers(conflicts.b_kind)),
        "periods": _of_periods(conflicts.period_us, conflicts.period_offset),
        "verdict": _VERDICTS.take(of_numbers(conflicts.verdict)),
        "region": pa.array(shapely.to_wkb(region.geometries(), byte_order=1, include_srid=False), pa.binary()),
        "method": pa.array([scene.method.value] * n, pa.string()),
    }
    known |= {one.name: _OF_ARRAY[one.type](getattr(conflicts, one.array)) for one in (*MEASURED, *STATES)}
    for side, name in enumerate(("first_contact_lon_deg", "first_contact_lat_deg")):
        known[name] = of_measures(conflicts.first_contact_deg[:, side], np.nan)
    first, last = conflicts.period_offset[:-1], conflicts.period_offset[1:] - 1
    some = last >= first
    for name, side, rows, unbounded_us in (
        ("first_contact", 0, first, MINUS_INFINITY_US),
        ("last_contact", 1, last, INFINITY_US),
    ):
        ends = np.full(n, unbounded_us)
        ends[some] = conflicts.period_us[rows[some], side]
        known[name] = of_instants(ends, unbounded_us)
    return FOUND.batch({f.name: known[f.name] if f.name in known else pa.nulls(n, f.type) for f in FOUND.schema})


def to_conflicts(given: Batch) -> tuple[Conflicts, Polygons]:
    """Return the conflicts of numbered objects of a batch or table of the form FOUND, and their regions (n,).

    Raises InvalidInput if it does not fit the form, or numbers or versions are missing.
    """
    columns = FOUND.columns(given)
    for name in (one.name for one in STATES):
        if columns[name].null_count:
            rule = (
                "must be known: it says which state of which object this was found of; an object that was added to an "
                "exported file is in no database: put it there, export the scene, and compute again"
            )
            raise InvalidInput(_WHO, name, rule)
    starts_and_ends, offset = lists(columns["periods"])
    if starts_and_ends.null_count:
        raise InvalidInput(_WHO, "periods", "must not hold nulls")
    start, end = starts_and_ends.flatten()
    period_us = np.column_stack([instants(start, MINUS_INFINITY_US), instants(end, INFINITY_US)])
    measured: dict[str, Any] = {one.array: _array(one, columns[one.name]) for one in (*MEASURED, *STATES)}
    found = Conflicts(
        a_kind=_codes(columns, "a_kind", _KINDS),
        b_kind=_codes(columns, "b_kind", _KINDS),
        verdict=_codes(columns, "verdict", _VERDICTS),
        period_us=period_us,
        period_offset=offset,
        **measured,
    )
    shapes = shapely.set_srid(_geometries(columns["region"], "region"), 4326)
    return found, Polygons.of(shapes)


def of_rows(rows: Sequence[Conflict]) -> "pa.RecordBatch":
    """Return conflicts of a database or of `solve` as a batch of the form FOUND."""
    columns: dict[str, Array] = {}
    for one in _COLUMNS:
        values: list[Any] = [getattr(row, one.field) for row in rows]
        if one.type is ColumnType.PERIODS:
            values = [[{"start": _us(start), "end": _us(end)} for start, end in periods] for periods in values]
        elif one.type is ColumnType.REGION:
            shapes = shapely.from_geojson(np.array(values, dtype=object))
            values = list(shapely.to_wkb(shapes, byte_order=1, include_srid=False))
        elif one.type is ColumnType.POINT:
            values = [_point(value) for value in values]
        elif one.type is ColumnType.INSTANT:
            values = [_us(value) for value in values]
        columns[one.name] = pa.array(values, _TYPES[one.type])
    return FOUND.batch(columns)


def _us(instant: datetime | None) -> int | None:
    return None if instant is None else (instant - EPOCH) // MICROSECOND


def _point(position_deg: Position | None) -> bytes | None:
    return None if position_deg is None else bytes(shapely.to_wkb(shapely.Point(position_deg), byte_order=1))


def _of_periods(period_us: NDArray[np.int64], offset: NDArray[np.int64]) -> Array:
    ends = [of_instants(period_us[:, 0], MINUS_INFINITY_US), of_instants(period_us[:, 1], INFINITY_US)]
    return of_lists(pa.StructArray.from_arrays(ends, fields=list(_PERIOD)), offset)


def _of_points(places_deg: NDArray[np.float64]) -> Array:
    """Return places (n, 2) as a column of points in WKB, null if unknown."""
    points = np.empty(len(places_deg), _POINT)
    points["order"], points["type"] = 1, 1
    points["lon"], points["lat"] = places_deg.T
    is_known = ~np.isnan(places_deg[:, 0])
    held = pa.Array.from_buffers(pa.binary(_POINT.itemsize), len(points), [None, pa.py_buffer(points.tobytes())])
    return pc.if_else(pa.array(is_known), held.cast(pa.binary()), pa.scalar(None, pa.binary()))


def _array(column: Column, stored: Array) -> NDArray[Any]:
    """Return a column as the array that `Conflicts` has of it."""
    if column.type is ColumnType.POINT:
        return _places(stored, column.name)
    if column.type is ColumnType.INSTANT:
        return instants(stored, MINUS_INFINITY_US)
    if column.type is ColumnType.NAME:
        known = _codes({column.name: stored.drop_null()}, column.name, _CERTAINTIES)
        codes = np.full(len(stored), -1, np.int8)
        codes[np.asarray(stored.is_valid())] = known
        return codes
    return measures(stored, np.nan) if column.type is ColumnType.NUMBER else numbers(stored)


def _of_names(codes: NDArray[np.int8]) -> Array:
    """Return codes of certainties (n,) as a column of names, null for -1."""
    return _CERTAINTIES.take(pa.array(codes, mask=codes < 0))


def _places(column: Array, name: str) -> NDArray[np.float64]:
    """Return the places of a column of points, (n, 2) longitude and latitude; NaN for null."""
    points = _geometries(column, name)
    is_point = shapely.get_type_id(points) == shapely.GeometryType.POINT
    if not (is_point | shapely.is_missing(points)).all():
        raise InvalidInput(_WHO, name, "must be points, or null")
    return np.column_stack([shapely.get_x(points), shapely.get_y(points)])


def _geometries(column: Array, name: str) -> NDArray[np.object_]:
    held = np.empty(len(column), dtype=object)
    held[:] = column.to_pylist()
    try:
        return np.asarray(shapely.from_wkb(held), dtype=object)
    except shapely.errors.GEOSException as error:
        raise InvalidInput(_WHO, name, f"must be WKB: {error}") from error


def kinds(column: Array) -> NDArray[np.int8]:
    """Return the codes of the kinds in a column of names; raises InvalidInput for others."""
    return _codes({"kind": column}, "kind", _KINDS)


def _codes(columns: dict[str, Array], name: str, names: Array) -> NDArray[np.int8]:
    codes = pc.index_in(columns[name], names)
    if codes.null_count:
        strange = columns[name].filter(codes.is_null())[0].as_py()
        raise InvalidInput(_WHO, name, f"must be one of {', '.join(names.to_pylist())}; got {strange!r:.60}")
    return numbers(codes).astype(np.int8)


# Columns from the arrays of `Conflicts`.
_OF_ARRAY: Final[dict[ColumnType, Callable[[NDArray[Any]], Array]]] = {
    ColumnType.NUMBER: lambda values: of_measures(values, np.nan),
    ColumnType.INSTANT: lambda values_us: of_instants(values_us, MINUS_INFINITY_US),
    ColumnType.WHOLE: of_numbers,
    ColumnType.POINT: _of_points,
    ColumnType.NAME: _of_names,
}
