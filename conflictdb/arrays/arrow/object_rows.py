"""Convert areas and tracks to and from Arrow: one row each, with the names of scene files, as in GeoParquet files.

docs/reference/arrow.md lists the columns. Instants are to the microsecond, in UTC.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from operator import attrgetter
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.arrow.columns import instants, lists, measures, numbers, of_lists, of_numbers
from conflictdb.arrays.arrow.forms import INSTANT, Array, ArrowForm, Batch
from conflictdb.arrays.ragged import offsets, stacked
from conflictdb.errors import InvalidInput
from conflictdb.model.inputs import all_certain, certain
from conflictdb.model.plan_columns import AREA, HEIGHT_LIMITS, PLAN_COLUMNS, TRACK, Form, PlanColumn, columns_of
from conflictdb.model.plans import Area, StoredArea, StoredTrack, Track
from conflictdb.model.results import Kind
from conflictdb.model.rules import KINDS

_METRES: Final = pa.list_(pa.float64())
_INSTANTS: Final = pa.list_(INSTANT)
_RING: Final = pa.list_(_METRES)
# The fields of `Area` and `Track` in columns of the form OWN, by name of the column.
_FIELDS: Final = {
    kind: {name: field for one in columns_of(kind, Form.OWN) for field, name in zip(one.python, one.arrow, strict=True)}
    for kind in KINDS
}
# Returns the values of all rows of one kind, from columns and the name of one.
_Decoder = Callable[[Mapping[str, Array], str], Iterable[Any]]
# The classes of plans of files, and of plans of a database.
_CLASSES: Final[dict[str, Any]] = {
    AREA: (Area, StoredArea),
    TRACK: [partial(of_kind, max_speed_kn=np.inf) for of_kind in (Track, StoredTrack)],
}
_PLAIN: Final = tuple(one for one in PLAN_COLUMNS if one.form is not Form.OWN)
_NAME: Final = "objects"
_WHO: Final = f"Arrow form {_NAME!r}"


def of_objects(
    areas: Sequence[Area],
    tracks: Sequence[Track],
    object_ids: NDArray[np.int64] | None = None,
    versions: NDArray[np.int64] | None = None,
) -> "pa.RecordBatch":
    """Return areas, then tracks, as a batch of the form OBJECTS.

    object_ids, versions : (n,) of all objects, if known
    """
    items: list[Area | Track] = [*areas, *tracks]
    n = len(items)
    return OBJECTS.batch(
        {
            "id": pa.array([item.key for item in items], pa.string()),
            "kind": pa.array([Kind.AREA.value] * len(areas) + [Kind.TRACK.value] * len(tracks), pa.string()),
            "object_id": pa.nulls(n, pa.int64()) if object_ids is None else of_numbers(object_ids),
            "version": pa.nulls(n, pa.int64()) if versions is None else of_numbers(versions),
            **{name: own.encode(_given(name, areas, tracks)) for name, own in _OWN.items()},
            **{one.arrow[0]: _of_plain(one, [*areas], [*tracks]) for one in _PLAIN},
        }
    )


def _given(name: str, areas: Sequence[Area], tracks: Sequence[Track]) -> list[Any]:
    """Return the values of areas, then of tracks, in a column of the form OWN, None for those without."""
    found: list[Any] = []
    for kind, plans in ((AREA, areas), (TRACK, tracks)):
        field = _FIELDS[kind].get(name)
        found += [None] * len(plans) if field is None else map(_OWN[name].value or attrgetter(field), plans)
    return found


def _of_plain(column: PlanColumn, areas: Sequence[Area], tracks: Sequence[Track]) -> Array:
    """Return the values of areas, then of tracks, null for those without."""
    values: list[Any] = []
    for kind, plans in ((AREA, areas), (TRACK, tracks)):
        given = [getattr(one, column.field) if kind in column.kinds else None for one in plans]
        values += [None if value == column.absent else value for value in given]
    if column.form is Form.NUMBER:
        return pa.array(values, pa.float64())
    if column.form is Form.DOCUMENT:
        values = [None if value is None else json.dumps(value) for value in values]
    return pa.array(values, pa.string())


def to_objects(given: Batch, *, are_stored: bool = False) -> tuple[list[Area], list[Track]]:
    """Return the areas and tracks of a batch or table of the form OBJECTS, fully checked.

    are_stored : they are of a database; their schedules are not checked

    Raises InvalidInput for a table that does not fit, and for the first refused object.
    """
    columns = OBJECTS.columns(given)
    is_track = _is_track(columns["kind"])
    of_areas, of_tracks = (_taken(columns, np.flatnonzero(one)) for one in (~is_track, is_track))
    return _plans(AREA, of_areas, are_stored), _plans(TRACK, of_tracks, are_stored)


def _plans(kind: str, columns: Mapping[str, Array], are_stored: bool) -> list[Any]:
    """Return the plans of rows of one kind."""
    fields = {field: (_OWN[name].decode or _SHAPES[kind])(columns, name) for name, field in _FIELDS[kind].items()}
    return [
        _CLASSES[kind][are_stored](key=key, **dict(zip(fields, row, strict=True)), **plain)
        for key, plain, *row in zip(columns["id"].to_pylist(), _plain(kind, columns), *fields.values(), strict=True)
    ]


def _plain(kind: str, columns: Mapping[str, Array]) -> list[dict[str, Any]]:
    """Return the plain columns of each row as fields of `Area` or `Track`."""
    found: list[dict[str, Any]] = [{} for _ in range(len(columns["id"]))]
    for one in _PLAIN:
        if kind not in one.kinds:
            continue
        values = columns[one.arrow[0]].to_pylist()
        if one.form is Form.DOCUMENT:
            values = _parsed(kind, columns, one, values)
        for row, value in zip(found, values, strict=True):
            row[one.field] = one.absent if value is None else value
    return found


def _parsed(kind: str, columns: Mapping[str, Array], column: PlanColumn, texts: Sequence[str | None]) -> list[Any]:
    found = []
    for key, text in zip(columns["id"].to_pylist(), texts, strict=True):
        try:
            found.append(None if text is None else json.loads(text))
        except (ValueError, RecursionError):
            raise InvalidInput(f"{kind} {key!r}", column.arrow[0], f"must be JSON; got {text!r:.60}") from None
    return found


def _is_track(kind: Array) -> NDArray[np.bool_]:
    """Return which objects are tracks; raises InvalidInput for other kinds than area and track."""
    of = numbers(kind)
    is_track = np.asarray(of == Kind.TRACK.value, np.bool_)
    strange = np.flatnonzero(~is_track & (of != Kind.AREA.value))
    if strange.size:
        raise InvalidInput(_WHO, "kind", f"must be 'area' or 'track'; got {of[strange[0]]!r:.60}")
    return is_track


def _taken(columns: Mapping[str, Array], rows: NDArray[np.int64]) -> Mapping[str, Array]:
    if rows.size == len(columns["id"]):
        return columns
    return {name: column.take(pa.array(rows)) for name, column in columns.items()}


def _shapes(columns: Mapping[str, Array]) -> NDArray[np.object_]:
    try:
        with np.errstate(invalid="ignore"):  # NaN coordinates are refused later, with their object
            shapes = shapely.from_wkb(_as_objects(columns["geometry"].to_pylist()))
    except shapely.errors.GEOSException as error:
        raise InvalidInput(_WHO, "geometry", f"must be WKB: {error}") from error
    return np.asarray(shapes, dtype=object)


def _footprints(columns: Mapping[str, Array], _: str) -> NDArray[np.object_]:
    """Return the geometries of areas, polygons as MultiPolygons."""
    shapes = _shapes(columns)
    single = np.flatnonzero(shapely.get_type_id(shapes) == shapely.GeometryType.POLYGON)
    if single.size:
        shapes[single] = shapely.multipolygons(shapes[single], indices=np.arange(single.size))
    return shapes


def _courses(columns: Mapping[str, Array], _: str) -> list[NDArray[np.float64]]:
    """Return the waypoints of each track, (w, 2) longitude and latitude; checks the number of times."""
    shapes = _shapes(columns)
    if not (shapely.get_type_id(shapes) == shapely.GeometryType.LINESTRING).all():
        raise InvalidInput(_WHO, "geometry", "of a track must be a LineString")
    count = np.asarray(shapely.get_num_points(shapes), np.int64)
    given = np.diff(lists(columns["times"])[1])
    if not np.array_equal(count, given):
        i = int(np.flatnonzero(count != given)[0])
        rule = f"must be one per waypoint: {count[i]} waypoints, {given[i]} times"
        raise InvalidInput(f"track {columns['id'][i].as_py()!r}", "times", rule)
    return _split(np.asarray(shapely.get_coordinates(shapes)), offsets(count))


def _split(values: NDArray[Any], offset: NDArray[np.int64]) -> list[NDArray[Any]]:
    return [values[start:end] for start, end in pairwise(offset.tolist())]


def _times(columns: Mapping[str, Array], name: str) -> list[Any]:
    """Return the instants of the waypoints of each track (w,); raises InvalidInput for nulls."""
    items, offset = lists(columns[name])
    if items.null_count:
        i = int(np.searchsorted(offset, items.is_null().index(True).as_py(), side="right")) - 1
        raise InvalidInput(f"track {columns['id'][i].as_py()!r}", name, "must not hold nulls: one per waypoint")
    return [all_certain(one) for one in _split(instants(items), offset)]


def _rings(column: Array, name: str) -> list[NDArray[np.float64]]:
    """Return the vertices (k, 2) of each ring of a column; a null has no vertices."""
    vertices, offset = lists(column)
    values, ends = lists(vertices)
    if (np.diff(ends) != 2).any() or values.null_count:
        raise InvalidInput(_WHO, name, "must be a ring of [starboard, forward] metres")
    return _split(numbers(values).reshape(-1, 2), offset)


def _outline(columns: Mapping[str, Array], name: str) -> list[NDArray[np.float64]]:
    """Return the outline of each track; of one that changes, the first."""
    whole = _rings(columns[name], name)
    return [one if several is None else several[0] for one, several in zip(whole, _outlines(columns), strict=True)]


def _outlines(columns: Mapping[str, Array], name: str = "outlines_m") -> list[list[NDArray[np.float64]] | None]:
    """Return the outlines of each track at its waypoints, None for one that has none."""
    rings, offset = lists(columns[name])
    outlines = _rings(rings, name)
    return [outlines[start:end] or None for start, end in pairwise(offset.tolist())]


def _heights(columns: Mapping[str, Array], name: str, *, unbounded: float) -> list[NDArray[np.float64] | None]:
    """Return the heights of each track's legs; None for a track without."""
    given, offset = lists(columns[name])
    each = _split(measures(given, unbounded), offset)
    return [one if is_known else None for one, is_known in zip(each, columns[name].is_valid().to_pylist(), strict=True)]


def _documents(columns: Mapping[str, Array], name: str) -> list[dict[str, Any]]:
    documents = []
    for key, text in zip(columns["id"].to_pylist(), columns[name].to_pylist(), strict=True):
        try:
            document = {} if text is None else json.loads(text)
        except (ValueError, RecursionError):
            document = None
        if not isinstance(document, dict):
            raise InvalidInput(f"object {key!r}", name, f"must be a JSON object; got {text!r:.60}")
        documents.append(document)
    return documents


def _in_lists(columns: Mapping[str, Array], name: str) -> list[list[int | None] | None]:
    """Return lists of instants in microseconds, None for null."""
    return list(columns[name].cast(pa.list_(pa.int64())).to_pylist())


def _at(columns: Mapping[str, Array], name: str) -> list[np.datetime64 | None]:
    return [certain(one) for one in columns[name].view(pa.int64()).to_pylist()]


def _departures(columns: Mapping[str, Array], name: str) -> list[Any]:
    given = _in_lists(columns, name)
    return [None if one is None else all_certain(np.array(one, np.int64)) for one in given]


def _spans(columns: Mapping[str, Array], name: str) -> list[list[list[np.datetime64 | None]] | None]:
    found: list[list[list[np.datetime64 | None]] | None] = []
    for key, ends in zip(columns["id"].to_pylist(), _in_lists(columns, name), strict=True):
        if ends is not None and len(ends) % 2:
            raise InvalidInput(f"area {key!r}", name, f"must be starts and ends in turn; got {len(ends)} instants")
        starts = range(0, len(ends or ()), 2)
        found.append(None if ends is None else [[certain(one) for one in ends[i : i + 2]] for i in starts])
    return found


def _only_outline(track: Track) -> NDArray[np.float64] | None:
    """Return the outline of a track that has no outline for each waypoint."""
    return track.outline_m if track.outlines_m is None else None


def _of_optional_instants(each_us: Sequence[int | None]) -> Array:
    return pa.array(each_us, pa.int64()).view(INSTANT)


def _of_instants(lists_us: Sequence[Sequence[int | None] | None]) -> Array:
    return pa.array(lists_us, pa.list_(pa.int64())).cast(_INSTANTS)


def _of_spans(given: Sequence[Any]) -> Array:
    return _of_instants([None if spans is None else [at for span in spans for at in span] for spans in given])


def _of_properties(given: Sequence[Mapping[str, Any]]) -> Array:
    texts = [json.dumps(dict(one), ensure_ascii=False, allow_nan=False) if one else None for one in given]
    return pa.array(texts, pa.string())


def _geometries(given: Sequence[Any]) -> Array:
    """Return the footprints of areas, then the paths of tracks, as WKB."""
    areas = [one for one in given if not isinstance(one, np.ndarray)]
    shapes = np.concatenate([_as_objects(areas), _linestrings(given[len(areas) :])])
    return pa.array(shapely.to_wkb(shapes, byte_order=1, include_srid=False), pa.binary())


def _as_objects(values: Sequence[Any]) -> NDArray[np.object_]:
    filled = np.empty(len(values), dtype=object)
    filled[:] = values
    return filled


def _linestrings(positions_deg: Sequence[NDArray[np.float64]]) -> NDArray[np.object_]:
    if not positions_deg:
        return np.empty(0, object)
    track_of = np.repeat(np.arange(len(positions_deg)), [len(one) for one in positions_deg])
    return np.asarray(shapely.linestrings(stacked(positions_deg), indices=track_of), dtype=object)


def _of_times(given: Sequence[NDArray[np.int64] | None]) -> Array:
    items = np.concatenate([np.empty(0, np.int64), *(one for one in given if one is not None)])
    return of_lists(of_numbers(items).view(INSTANT), _lengths(given), _missing(given))


def _of_heights(given: Sequence[NDArray[np.float64] | None]) -> Array:
    items = np.concatenate([np.empty(0), *(one for one in given if one is not None)])
    filled = pa.array(items, mask=np.isinf(items))
    return of_lists(filled, _lengths(given), _missing(given))


def _of_rings(given: Sequence[NDArray[np.float64] | None]) -> Array:
    vertices = stacked([one for one in given if one is not None])
    return of_lists(_of_vertices(vertices), _lengths(given), _missing(given))


def _of_outlines(given: Sequence[NDArray[np.float64] | None]) -> Array:
    known = [one for one in given if one is not None]
    vertices = stacked([one.reshape(-1, 2) for one in known])
    rings = of_lists(_of_vertices(vertices), offsets([one.shape[1] for one in known for _ in one]))
    return of_lists(rings, _lengths(given), _missing(given))


def _of_vertices(vertices: NDArray[np.float64]) -> Array:
    return of_lists(of_numbers(vertices.reshape(-1)), 2 * np.arange(len(vertices) + 1))


def _lengths(given: Sequence[NDArray[Any] | None]) -> NDArray[np.int64]:
    return offsets([0 if one is None else len(one) for one in given])


def _missing(given: Sequence[NDArray[Any] | None]) -> NDArray[np.bool_]:
    return np.array([one is None for one in given], np.bool_)


class _ArrowCodec(NamedTuple):
    """A column of the form OWN; the other forms have one codec each.

    encode : of values, None for none
    decode : None: that of _SHAPES
    value : of a plan; None: its field
    """

    type: Any
    encode: Callable[[Sequence[Any]], Array]
    decode: _Decoder | None
    value: Callable[[Any], Any] | None = None


_SHAPES: Final[dict[str, _Decoder]] = {AREA: _footprints, TRACK: _courses}
_OWN: Final = {
    "geometry": _ArrowCodec(pa.binary(), _geometries, None),
    "start": _ArrowCodec(INSTANT, _of_optional_instants, _at),
    "end": _ArrowCodec(INSTANT, _of_optional_instants, _at),
    "times": _ArrowCodec(_INSTANTS, _of_times, _times),
    "outline_m": _ArrowCodec(_RING, _of_rings, _outline, _only_outline),
    "outlines_m": _ArrowCodec(pa.list_(_RING), _of_outlines, _outlines),
    **{
        one.of_legs: _ArrowCodec(_METRES, _of_heights, partial(_heights, unbounded=one.unbounded))
        for one in HEIGHT_LIMITS
    },
    "properties": _ArrowCodec(pa.string(), _of_properties, _documents),
    "spans": _ArrowCodec(_INSTANTS, _of_spans, _spans),
    "departures": _ArrowCodec(_INSTANTS, _of_instants, _departures),
}


def _fields() -> Iterator["pa.Field"]:
    yield pa.field("id", pa.string(), nullable=False)
    yield pa.field("kind", pa.string(), nullable=False)
    yield pa.field("object_id", pa.int64())
    yield pa.field("version", pa.int64())
    types = {name: own.type for name, own in _OWN.items()}
    types |= {one.arrow[0]: pa.float64() if one.form is Form.NUMBER else pa.string() for one in _PLAIN}
    for name in dict.fromkeys(name for one in PLAN_COLUMNS for name in one.arrow):
        yield pa.field(name, types[name], nullable=name != "geometry")


OBJECTS: Final = ArrowForm.of(_NAME, 1, list(_fields()))
