"""Convert areas and tracks to and from Arrow: one row each, with the names of scene files, as in GeoParquet files.

docs/reference/arrow.md lists the columns. Instants are to the microsecond, in UTC.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.arrow.columns import instants, lists, measures, numbers, of_lists, of_numbers
from conflictdb.arrays.arrow.forms import INSTANT, Array, ArrowForm, Batch
from conflictdb.arrays.ragged import offsets, stacked
from conflictdb.errors import InvalidInput
from conflictdb.model.inputs import all_certain, certain
from conflictdb.model.plan_columns import AREA, PLAN_COLUMNS, TRACK, Form, PlanColumn
from conflictdb.model.plans import Area, StoredArea, StoredTrack, Track
from conflictdb.model.results import Kind

_METRES: Final = pa.list_(pa.float64())
_INSTANTS: Final = pa.list_(INSTANT)
_RING: Final = pa.list_(_METRES)
_Encoder = Callable[[Sequence[Area], Sequence[Track]], Array]
_PLAIN: Final = tuple(one for one in PLAN_COLUMNS if one.form is not Form.OWN)
_NAME: Final = "objects"
_WHO: Final = f"Arrow form {_NAME!r}"


def _geometries(areas: Sequence[Area], tracks: Sequence[Track]) -> Array:
    lines = _linestrings([track.positions_deg for track in tracks])
    shapes = np.concatenate([np.empty(0, object), _as_objects([area.footprint for area in areas]), lines])
    return pa.array(shapely.to_wkb(shapes, byte_order=1, include_srid=False), pa.binary())


def _of_properties(areas: Sequence[Area], tracks: Sequence[Track]) -> Array:
    items: list[Area | Track] = [*areas, *tracks]
    return pa.array([_document(item.properties) for item in items], pa.string())


def _of_areas(value: Callable[[Area], Any], encode: Callable[[list[Any]], Array]) -> _Encoder:
    """Return a function that encodes values of areas, null for tracks."""
    return lambda areas, tracks: encode([*map(value, areas), *(None for _ in tracks)])


def _of_tracks(value: Callable[[Track], Any], encode: Callable[[list[Any]], Array]) -> _Encoder:
    """Return a function that encodes values of tracks, null for areas."""
    return lambda areas, tracks: encode([*(None for _ in areas), *map(value, tracks)])


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
            **{name: encode(areas, tracks) for name, (_, encode) in _OWN.items()},
            **{one.arrow[0]: _of_plain(one, [*areas], [*tracks]) for one in _PLAIN},
        }
    )


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
    return list(_areas(of_areas, are_stored)), list(_tracks(of_tracks, are_stored))


def _areas(columns: Mapping[str, Array], are_stored: bool) -> list[Area]:
    start_us, end_us = (columns[name].view(pa.int64()).to_pylist() for name in ("start", "end"))
    of_kind = StoredArea if are_stored else Area
    return [
        of_kind(
            key, footprint, start_us=certain(start), end_us=certain(end), properties=properties, spans_us=spans, **plain
        )
        for key, footprint, start, end, properties, spans, plain in zip(
            columns["id"].to_pylist(),
            _footprints(columns),
            start_us,
            end_us,
            _documents(columns),
            _spans(columns),
            _plain(AREA, columns),
            strict=True,
        )
    ]


def _tracks(columns: Mapping[str, Array], are_stored: bool) -> list[Track]:
    course, way = _courses(columns)
    times_us = _times(columns)
    outline_m, ring = _rings(columns["outline_m"], "outline_m")
    rings, of_ring = lists(columns["outlines_m"])
    changing_m, corner = _rings(rings, "outlines_m")
    floors_m, ceilings_m = (_of_legs(columns[f"{name}s_m"]) for name in ("floor", "ceiling"))
    keys, documents, departures = columns["id"].to_pylist(), _documents(columns), _in_lists(columns, "departures")
    tracks = []
    for i, plain in enumerate(_plain(TRACK, columns)):
        outlines = [changing_m[corner[k] : corner[k + 1]] for k in range(of_ring[i], of_ring[i + 1])] or None
        tracks.append(
            (StoredTrack if are_stored else Track)(
                keys[i],
                course[way[i] : way[i + 1]],
                all_certain(times_us[way[i] : way[i + 1]]),
                outline_m[ring[i] : ring[i + 1]] if outlines is None else outlines[0],
                properties=documents[i],
                outlines_m=outlines,
                floors_m=floors_m(i, -np.inf),
                ceilings_m=ceilings_m(i, np.inf),
                departures_us=None if departures[i] is None else all_certain(np.array(departures[i], np.int64)),
                **plain,
                max_speed_kn=np.inf,
            )
        )
    return tracks


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


def _footprints(columns: Mapping[str, Array]) -> NDArray[np.object_]:
    """Return the geometries of areas, polygons as MultiPolygons."""
    shapes = _shapes(columns)
    single = np.flatnonzero(shapely.get_type_id(shapes) == shapely.GeometryType.POLYGON)
    if single.size:
        shapes[single] = shapely.multipolygons(shapes[single], indices=np.arange(single.size))
    return shapes


def _courses(columns: Mapping[str, Array]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the waypoints of tracks, (w, 2) longitude and latitude, and their offsets; checks the number of times."""
    shapes = _shapes(columns)
    if not (shapely.get_type_id(shapes) == shapely.GeometryType.LINESTRING).all():
        raise InvalidInput(_WHO, "geometry", "of a track must be a LineString")
    count = np.asarray(shapely.get_num_points(shapes), np.int64)
    given = np.diff(lists(columns["times"])[1])
    if not np.array_equal(count, given):
        i = int(np.flatnonzero(count != given)[0])
        rule = f"must be one per waypoint: {count[i]} waypoints, {given[i]} times"
        raise InvalidInput(f"track {columns['id'][i].as_py()!r}", "times", rule)
    return np.asarray(shapely.get_coordinates(shapes)), offsets(count)


def _times(columns: Mapping[str, Array]) -> NDArray[np.int64]:
    """Return the instants of all waypoints of tracks (w,); raises InvalidInput for nulls."""
    items, offset = lists(columns["times"])
    if items.null_count:
        i = int(np.searchsorted(offset, items.is_null().index(True).as_py(), side="right")) - 1
        raise InvalidInput(f"track {columns['id'][i].as_py()!r}", "times", "must not hold nulls: one per waypoint")
    return instants(items)


def _rings(column: Array, name: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices (k, 2) of a column of rings, and their offsets; a null has no vertices."""
    vertices, offset = lists(column)
    values, ends = lists(vertices)
    if (np.diff(ends) != 2).any() or values.null_count:
        raise InvalidInput(_WHO, name, "must be a ring of [starboard, forward] metres")
    return numbers(values).reshape(-1, 2), offset


def _of_legs(column: Array) -> Callable[[int, float], NDArray[np.float64] | None]:
    """Return a function that returns the heights of a track's legs by row; None for a track without."""
    given, offset = lists(column)
    is_known = numbers(column.is_valid())

    def heights(i: int, unbounded: float) -> NDArray[np.float64] | None:
        return measures(given[offset[i] : offset[i + 1]], unbounded) if is_known[i] else None

    return heights


def _documents(columns: Mapping[str, Array]) -> list[dict[str, Any]]:
    documents = []
    for key, text in zip(columns["id"].to_pylist(), columns["properties"].to_pylist(), strict=True):
        try:
            document = {} if text is None else json.loads(text)
        except (ValueError, RecursionError):
            document = None
        if not isinstance(document, dict):
            raise InvalidInput(f"object {key!r}", "properties", f"must be a JSON object; got {text!r:.60}")
        documents.append(document)
    return documents


def _in_lists(columns: Mapping[str, Array], name: str) -> list[list[int | None] | None]:
    """Return lists of instants in microseconds, None for null."""
    return list(columns[name].cast(pa.list_(pa.int64())).to_pylist())


def _spans(columns: Mapping[str, Array]) -> list[list[list[np.datetime64 | None]] | None]:
    found: list[list[list[np.datetime64 | None]] | None] = []
    for key, ends in zip(columns["id"].to_pylist(), _in_lists(columns, "spans"), strict=True):
        if ends is not None and len(ends) % 2:
            raise InvalidInput(f"area {key!r}", "spans", f"must be starts and ends in turn; got {len(ends)} instants")
        at = None if ends is None else [certain(one) for one in ends]
        found.append(None if at is None else [at[i : i + 2] for i in range(0, len(at), 2)])
    return found


def _only_outline(track: Track) -> NDArray[np.float64] | None:
    """Return the outline of a track that has no outline for each waypoint."""
    return track.outline_m if track.outlines_m is None else None


def _ends(area: Area) -> list[int | None] | None:
    return None if area.spans_us is None else [at for span in area.spans_us for at in span]


def _of_optional_instants(each_us: Sequence[int | None]) -> Array:
    return pa.array(each_us, pa.int64()).view(INSTANT)


def _of_instants(lists_us: Sequence[Sequence[int | None] | None]) -> Array:
    return pa.array(lists_us, pa.list_(pa.int64())).cast(_INSTANTS)


def _document(properties: Mapping[str, Any]) -> str | None:
    return json.dumps(dict(properties), ensure_ascii=False, allow_nan=False) if properties else None


def _as_objects(values: Sequence[Any]) -> NDArray[np.object_]:
    filled = np.empty(len(values), dtype=object)
    filled[:] = values
    return filled


def _linestrings(positions_deg: Sequence[NDArray[np.float64]]) -> NDArray[np.object_]:
    if not positions_deg:
        return np.empty(0, object)
    track_of = np.repeat(np.arange(len(positions_deg)), [len(one) for one in positions_deg])
    return np.asarray(shapely.linestrings(stacked(positions_deg), indices=track_of), dtype=object)


def _of_ragged(given: Sequence[NDArray[Any] | None], of: Any) -> Array:
    """Return arrays as a column of lists, None as null."""
    items = np.concatenate([np.empty(0, np.int64), *(one for one in given if one is not None)])
    return of_lists(of_numbers(items).view(of), _lengths(given), _missing(given))


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


# The columns of the form OWN: type, and values; the other forms have one of each.
_OWN: Final[dict[str, tuple[Any, _Encoder]]] = {
    "geometry": (pa.binary(), _geometries),
    "start": (INSTANT, _of_areas(lambda area: area.start_us, _of_optional_instants)),
    "end": (INSTANT, _of_areas(lambda area: area.end_us, _of_optional_instants)),
    "times": (_INSTANTS, _of_tracks(lambda track: track.times_us, lambda given: _of_ragged(given, INSTANT))),
    "outline_m": (
        _RING,
        _of_tracks(_only_outline, _of_rings),
    ),
    "outlines_m": (pa.list_(_RING), _of_tracks(lambda track: track.outlines_m, _of_outlines)),
    "floors_m": (_METRES, _of_tracks(lambda track: track.floors_m, _of_heights)),
    "ceilings_m": (_METRES, _of_tracks(lambda track: track.ceilings_m, _of_heights)),
    "properties": (pa.string(), _of_properties),
    "spans": (_INSTANTS, _of_areas(_ends, _of_instants)),
    "departures": (_INSTANTS, _of_tracks(lambda track: track.departures_us, _of_instants)),
}


def _fields() -> Iterator["pa.Field"]:
    yield pa.field("id", pa.string(), nullable=False)
    yield pa.field("kind", pa.string(), nullable=False)
    yield pa.field("object_id", pa.int64())
    yield pa.field("version", pa.int64())
    types = {name: of for name, (of, _) in _OWN.items()}
    types |= {one.arrow[0]: pa.float64() if one.form is Form.NUMBER else pa.string() for one in _PLAIN}
    for name in dict.fromkeys(name for one in PLAN_COLUMNS for name in one.arrow):
        yield pa.field(name, types[name], nullable=name != "geometry")


OBJECTS: Final = ArrowForm.of(_NAME, 1, list(_fields()))
