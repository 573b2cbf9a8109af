"""Load scenes, areas and tracks into the database and read them, in sets, exact to the last bit."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, NamedTuple, TypeVar, cast

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.column_numbers import measures
from conflictdb.arrays.objects import Activations, TrackBatch, outer_spans
from conflictdb.arrays.ragged import offsets, stacked
from conflictdb.errors import InvalidInput
from conflictdb.formats.contents import Phase, unwatched
from conflictdb.model import many
from conflictdb.model.activations import Spans
from conflictdb.model.inputs import EPOCH, MICROSECOND, all_certain, certain
from conflictdb.model.plan_columns import AREA, HEIGHT_LIMITS, TRACK, Form, PlanColumn, bytes_columns, columns_of
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, StoredArea, StoredTrack, Track
from conflictdb.model.rules import KINDS
from conflictdb.store import copy_binary
from conflictdb.store.connection import call, call_many, require_writable, transaction
from conflictdb.store.scenes import read_settings, scene_or_branch_id, settings_of

_Plan = TypeVar("_Plan", Area, Track)
_PLAIN = (Form.TEXT, Form.WORD, Form.DOCUMENT)


def fixed_columns(kind: str) -> list[tuple[str, str]]:
    """Return the numbers of plans in rows of `_read_areas` or `_read_tracks`, NaN for none."""
    return [(one.name, "f8") for one in columns_of(kind, Form.NUMBER)]


def string_columns(kind: str) -> list[str]:
    """Return the other plain columns of plans in these rows, without bytes for none."""
    return [one.name for one in columns_of(kind, *_PLAIN)]


_Encoder = Callable[[Sequence[Any]], copy_binary.Column]


class _RowCodec(NamedTuple):
    """A column of the form OWN, of plans as rows, and of the bytes of one row; None: all rows are read at once."""

    encode: _Encoder
    decode: Callable[[bytes], Any] | None = None


# Areas, and tracks, that are encoded at once: bounds memory.
_SENT_AT_ONCE = 10_000
# The columns of routines that return objects: numbers and instants, then all others, as bytes.
_AREA_HEAD: Final = [("area_id", "i8"), ("version", "i8"), ("start", "i8"), ("end", "i8")]
_TRACK_HEAD: Final = [("track_id", "i8"), ("version", "i8")]
AREA_COLUMNS = [*_AREA_HEAD, *((one.name, "f8") for one in measures(AREA))]
TRACK_COLUMNS = [*_TRACK_HEAD, *((one.name, "f8") for one in measures(TRACK))]
AREA_STRINGS, TRACK_STRINGS = ([one.name for one in bytes_columns(kind)] for kind in KINDS)
# Follow all other columns in rows of tracks.
TOLERANCES = ["tolerances"]
# Those of _read_areas and _read_tracks.
_READ_AREAS = [*_AREA_HEAD, *fixed_columns(AREA)], [*AREA_STRINGS, "key", "properties", *string_columns(AREA)]
_READ_TRACKS = [*_TRACK_HEAD, *fixed_columns(TRACK)], [*TRACK_STRINGS, "key", "properties", *string_columns(TRACK)]
_Rows = tuple[dict[str, NDArray[Any]], dict[str, list[bytes]]]


@dataclass(frozen=True, slots=True)
class LoadCounts:
    """How many objects of a scene a load added, updated, removed and found unchanged."""

    added: int
    updated: int
    removed: int
    unchanged: int


def replace_scene(
    conn: psycopg.Connection[Any],
    scene: Scene,
    areas: Sequence[Area],
    tracks: Sequence[Track],
    *,
    merge: bool,
    phase: Phase = unwatched,
) -> LoadCounts:
    """Update a scene to the given settings and objects, in one transaction.

    Equal objects stay unchanged. Without `merge`, objects that are not given are removed. Raises InvalidInput, and
    changes nothing, if an object cannot be stored.

    phase : called with the name of each phase and the amounts done and to do
    """

    def parts() -> Iterator[tuple[Sequence[Area], Sequence[Track]]]:
        for first in range(0, max(len(areas), len(tracks), 1), _SENT_AT_ONCE):
            some = slice(first, first + _SENT_AT_ONCE)
            phase("sending objects", min(first, len(areas)) + min(first, len(tracks)), len(areas) + len(tracks))
            yield areas[some], tracks[some]

    return replace_scene_by_parts(conn, scene, parts(), merge=merge, phase=phase)


def replace_scene_by_parts(
    conn: psycopg.Connection[Any],
    scene: Scene,
    parts: Iterable[tuple[Sequence[Area], Sequence[Track]]],
    *,
    merge: bool,
    phase: Phase = unwatched,
) -> LoadCounts:
    """Update a scene as `replace_scene` does, from batches of areas and tracks; errors of `parts` roll back."""
    require_writable(conn)
    with transaction(conn):
        call(conn, "_begin_load")
        for areas, tracks in parts:
            copy_binary.send(conn, "pg_temp.staged_area", _staged(AREA, areas))
            copy_binary.send(conn, "pg_temp.staged_track", _staged(TRACK, tracks))
        phase("storing objects", 0, 0)
        *counts, number, stored, page = call(conn, "_load", scene.name, settings_of(scene), merge)
        while page is not None:
            phase("storing objects", stored, max(stored, counts[0]))
            more, page = call(conn, "_add_staged", number, page)
            stored += more
    return LoadCounts(*counts)


def put_plans(
    conn: psycopg.Connection[Any], scene: str, removed: Sequence[str], areas: Sequence[Area], tracks: Sequence[Track]
) -> None:
    """Remove some objects of a scene by key and put others, few at a time, as `replace_scene` with `merge` does."""
    put_rows(conn, scene, removed, plan_rows(areas, tracks), None)


def put_rows(
    conn: psycopg.Connection[Any], scene: str, removed: Sequence[str], rows: str, known: Sequence[str] | None
) -> None:
    """Do as `put_plans`, with the JSON of `plan_rows`.

    known : keys of the stored objects that plans may replace (None: of all); raises InvalidInput for others
    """
    call(conn, "_put_plans", scene, list(removed), rows, True, None if known is None else list(known))


def plan_rows(areas: Sequence[Area], tracks: Sequence[Track]) -> str:
    """Return plans as the JSON array of objects that the routine `_put_plans` reads."""
    rows = []
    given: list[tuple[str, Sequence[Any]]] = [(AREA, areas), (TRACK, tracks)]
    for kind, plans in given:
        columns = _staged(kind, plans)
        shapes = [one.name for one in columns_of(kind, Form.OWN) if one.sql == "geometry"]
        for k, one in enumerate(plans):
            row: dict[str, Any] = {"key": one.key, "properties": dict(one.properties)}
            row |= {column.name: getattr(one, column.field) for column in columns_of(kind, *_PLAIN, Form.NUMBER)}
            for name in shapes:
                column = cast("copy_binary.Ragged", columns[name])
                row[name] = column.data[column.offset[k] : column.offset[k + 1]].tobytes().hex() or None
            rows.append(row | (_track_fields(one) if isinstance(one, Track) else _area_fields(one)))
    return json.dumps(rows)


def _track_fields(track: Track) -> dict[str, Any]:
    heights = {one.of_legs: getattr(track, one.of_legs) for one in HEIGHT_LIMITS}
    fields: dict[str, Any] = {
        name: None if given is None else [x if math.isfinite(x) else None for x in given.tolist()]
        for name, given in heights.items()
    }
    if track.departures_us is not None and track.schedule is None:
        fields["departures"] = [(EPOCH + us * MICROSECOND).isoformat() for us in track.departures_us]
    return fields


def _area_fields(area: Area) -> dict[str, Any]:
    if area.spans_us is not None and area.schedule is None:
        return {"activations": "{" + ",".join(map(_range, area.spans_us)) + "}"}
    return {"active_span": _range((area.start_us, area.end_us))}


def _range(span_us: tuple[int | None, int | None]) -> str:
    """Return a span as text of a tstzrange, with whole microseconds."""
    ends = ("" if us is None else (EPOCH + us * MICROSECOND).isoformat() for us in span_us)
    return "[" + ",".join(ends) + ")"


def read_scene(
    conn: psycopg.Connection[Any], name: str, keys: Sequence[str] | None = None
) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene and its objects as they were loaded, in load order; InvalidInput if the scene does not exist.

    keys : keys of the objects to read; None: all
    """
    among = None if keys is None else list(keys)
    with transaction(conn):
        number = scene_or_branch_id(conn, name)
        areas = areas_of(*copy_binary.receive(conn, "_read_areas", [number, among], *_READ_AREAS))
        tracks = tracks_of(*copy_binary.receive(conn, "_read_tracks", [number, among], *_READ_TRACKS))
        return read_settings(conn, number), areas, tracks


def read_sample(conn: psycopg.Connection[Any], name: str, most: int) -> tuple[list[Area], list[Track]]:
    """Return at most `most` areas and tracks each, spread over a scene; none if it does not exist."""
    with transaction(conn):
        if not call_many(conn, "_scene_named", name):
            return [], []
        _, areas, tracks = read_scene(conn, name, call(conn, "_sampled_keys", scene_or_branch_id(conn, name), most)[0])
        return areas, tracks


@dataclass(frozen=True, slots=True)
class Numbered:
    """A batch of a scene's objects, areas or tracks, with ids and versions (n,)."""

    areas: list[Area]
    tracks: list[Track]
    object_id: NDArray[np.int64]
    version: NDArray[np.int64]


def each_object(conn: psycopg.Connection[Any], scene_id: int) -> Iterator[Numbered]:
    """Yield the objects of a scene in batches, areas first; the connection is busy until the last batch."""
    for columns, strings in each_area_row(conn, scene_id):
        yield Numbered(areas_of(columns, strings), [], columns["area_id"], columns["version"])
    for columns, strings in each_track_row(conn, scene_id):
        yield Numbered([], tracks_of(columns, strings), columns["track_id"], columns["version"])


def each_area_row(conn: psycopg.Connection[Any], scene_id: int) -> Iterator[_Rows]:
    """Yield the rows of `_read_areas` of a scene, undecoded."""
    return copy_binary.receive_each(conn, "_read_areas", [scene_id, None], *_READ_AREAS)


def each_track_row(conn: psycopg.Connection[Any], scene_id: int) -> Iterator[_Rows]:
    """Yield the rows of `_read_tracks` of a scene, undecoded."""
    return copy_binary.receive_each(conn, "_read_tracks", [scene_id, None], *_READ_TRACKS)


def changing_heights(
    conn: psycopg.Connection[Any], scene_id: int
) -> Iterator[tuple[str, NDArray[np.float64] | None, NDArray[np.float64] | None]]:
    """Yield key, floors and ceilings (metres, infinite: no limit) of the tracks of a scene whose heights change."""
    for _, strings in each_track_row(conn, scene_id):
        for key, floors, ceilings in zip(strings["key"], strings["floors_m"], strings["ceilings_m"], strict=True):
            if floors or ceilings:
                yield key.decode(), decode_heights(floors, -np.inf), decode_heights(ceilings, np.inf)


def areas_of(columns: Mapping[str, NDArray[Any]], strings: Mapping[str, Sequence[bytes]]) -> list[Area]:
    """Decode areas from rows of `_read_areas`."""
    start, end = (copy_binary.microseconds(columns[name]).tolist() for name in ("start", "end"))
    keys = [one.decode() for one in strings["key"]]
    footprints = np.empty(len(keys), np.object_)
    footprints[:] = shapely.from_wkb(strings["footprint"])
    members = [
        {
            **plain,
            "start_us": None if start[i] == MINUS_INFINITY_US else start[i],
            "end_us": None if end[i] == INFINITY_US else end[i],
        }
        for i, plain in enumerate(_fields(AREA, columns, strings))
    ]
    made = many.areas(keys, footprints, members)
    for i, own in enumerate(members):
        # By itself: for its errors, and because a schedule makes another type.
        if strings["schedule"][i] or made[i] is None:
            times = {"start_us": _certain(start[i]), "end_us": _certain(end[i])}
            kind = StoredArea if strings["schedule"][i] else Area
            made[i] = kind(key=keys[i], footprint=footprints[i], **(own | times))
    return cast("list[Area]", made)


def tracks_of(columns: Mapping[str, NDArray[Any]], strings: Mapping[str, Sequence[bytes]]) -> list[Track]:
    """Decode tracks from rows of `_read_tracks`."""
    positions, times, way = decode_paths(strings["path"])
    outline, ring = decode_rings(strings["outline"])
    changing, change = decode_outlines(strings["outlines"], way)
    keys = [one.decode() for one in strings["key"]]
    members, alone = list(_fields(TRACK, columns, strings)), []
    for i, own in enumerate(members):
        if change[i] < change[i + 1]:
            own["outlines_m"] = changing[change[i] : change[i + 1]].reshape(way[i + 1] - way[i], -1, 2)
        if strings["schedule"][i] or "outlines_m" in own:
            alone.append(i)
    made = many.tracks(keys, positions, way, times, outline, ring, members)
    for i in sorted({*alone, *(i for i, one in enumerate(made) if one is None)}):
        own = members[i]
        given = own.get("outlines_m")
        made[i] = (StoredTrack if strings["schedule"][i] else Track)(
            key=keys[i],
            positions_deg=positions[way[i] : way[i + 1]],
            times_us=all_certain(times[way[i] : way[i + 1]]),
            outline_m=outline[ring[i] : ring[i + 1]] if given is None else given[0],
            max_speed_kn=math.inf,
            **own,
        )
    return cast("list[Track]", made)


def _fields(
    kind: str, columns: Mapping[str, NDArray[Any]], strings: Mapping[str, Sequence[bytes]]
) -> Iterator[dict[str, Any]]:
    """Yield the columns of each row that have values of their own as fields of `Area` or `Track`, but absent ones."""
    given = [one for one in columns_of(kind) if _is_of_row(one)]
    names, absent = [one.field for one in given], [one.absent for one in given]
    for row in zip(*(values_of_rows(one, columns, strings) for one in given), strict=True):
        yield {
            name: own
            for name, own, none in zip(names, row, absent, strict=True)
            if own is not None and (none is None or own != none)
        }


def _is_of_row(column: PlanColumn) -> bool:
    """Return whether each row has its value, in one column."""
    own = _OWN.get(column.name)
    return column.form is not Form.OWN or column.sql == "jsonb" or (own is not None and own.decode is not None)


def values_of_rows(
    column: PlanColumn, columns: Mapping[str, NDArray[Any]], strings: Mapping[str, Sequence[bytes]]
) -> list[Any]:
    """Return the values of a column in rows of `_read_areas` or `_read_tracks`, one for each row; None for none."""
    own = _OWN.get(column.name)
    if own is not None and own.decode is not None:
        return [own.decode(sent) if sent else None for sent in strings[column.name]]
    if column.form is Form.NUMBER:
        return [column.absent if math.isnan(value) else value for value in columns[column.name].tolist()]
    if column.form is Form.WORD:
        return [sent.decode() or None for sent in strings[column.name]]
    return [json.loads(sent) if sent else None for sent in strings[column.name]]


def _certain(at_us: int) -> np.datetime64 | None:
    return None if at_us in (MINUS_INFINITY_US, INFINITY_US) else certain(at_us)


def _decoded_spans(sent: bytes) -> Any:
    return [[_certain(one) for one in pair] for pair in decode_instants(sent).reshape(-1, 2).tolist()]


def decode_instants(sent: bytes) -> NDArray[np.int64]:
    """Return instants (microseconds) from array_send format."""
    return copy_binary.microseconds(copy_binary.int8_array(sent))


def decode_activations(sent: Sequence[bytes], once: NDArray[np.int64]) -> Activations:
    """Return spans or departures from array_send format; no bytes: that of `once`; a zero byte: unknown ones."""
    is_unknown = np.array([one == b"\0" for one in sent], np.bool_)
    shape = (-1, *once.shape[1:])
    given = [decode_instants(one).reshape(shape).tolist() if len(one) > 1 else None for one in sent]
    return replace(Activations.of(given, once), is_unknown=is_unknown)


def decode_paths(
    wkb: Sequence[bytes],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Return positions (degrees), instants (microseconds) and offsets of LineStringM paths, M in Unix seconds."""
    xym, offset = copy_binary.vertices(wkb, copy_binary.WKB_LINESTRING_M)
    return np.ascontiguousarray(xym[:, :2]), np.rint(xym[:, 2] * 1e6).astype(np.int64), offset


def decode_rings(wkb: Sequence[bytes]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the open rings of polygons, concatenated, and their offsets; points and lines as they were stored."""
    return copy_binary.open_rings(*copy_binary.vertices(wkb, copy_binary.WKB_POLYGON))


def decode_outlines(wkb: Sequence[bytes], way: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return outlines per waypoint (MultiPolygons, empty bytes for none) as open rings, concatenated, and offsets.

    way : (n + 1,) offsets of the waypoints of each track
    """
    present = np.flatnonzero([bool(item) for item in wkb])
    count = np.zeros(len(wkb), dtype=np.int64)
    rings: list[NDArray[np.float64]] = [np.empty((0, 2))]
    for i in present.tolist():
        closed = shapely.get_coordinates(shapely.from_wkb(wkb[i])).reshape(way[i + 1] - way[i], -1, 2)
        vertices = closed.shape[1] - 1
        if vertices == 3 and (closed[:, 1] == closed[:, 2]).all():
            vertices = 1 if (closed[:, 0] == closed[:, 1]).all() else 2
        rings.append(closed[:, :vertices].reshape(-1, 2))
        count[i] = len(rings[-1])
    return np.concatenate(rings), offsets(count)


def decode_heights(sent: bytes, unbounded: float) -> NDArray[np.float64] | None:
    """Return the heights of legs (metres) from array_send format, null for unbounded; None for no bytes."""
    if not sent:
        return None
    heights = copy_binary.float8_array(sent)
    return np.where(np.isnan(heights), unbounded, heights)


def decode_tolerances(sent: bytes) -> dict[str, Any] | None:
    """Return tolerances from JSON; None for no bytes."""
    return json.loads(sent) if sent else None


def _encoded_heights(heights: NDArray[np.float64] | None) -> bytes | None:
    """Encode the heights of legs as the text of an array, with all digits."""
    if heights is None:
        return None
    return ("{" + ",".join(repr(x) if math.isfinite(x) else "NULL" for x in heights.tolist()) + "}").encode()


def _encoded_outlines(outlines: NDArray[np.float64] | None) -> bytes | None:
    """Encode outlines (w, m, 2) as a MultiPolygon of closed rings."""
    if outlines is None:
        return None
    index = [*range(outlines.shape[1]), 0] if outlines.shape[1] > 2 else [0, -1, -1, 0]
    rings = shapely.polygons(np.ascontiguousarray(outlines[:, index]))
    return bytes(shapely.to_wkb(shapely.multipolygons(rings), byte_order=1))


def _staged(kind: str, plans: Sequence[Any]) -> dict[str, copy_binary.Column]:
    keys = [one.key for one in plans]
    found: dict[str, copy_binary.Column] = {"key": _texts(kind, keys, keys, "id")}
    if kind == AREA:
        found["span_start"], found["span_end"] = (copy_binary.instants(ends) for ends in outer_spans(plans).T)
    for column in columns_of(kind):
        values = [getattr(one, column.field) for one in plans]
        if column.name in _OWN:
            found[column.name] = _OWN[column.name].encode(plans)
        elif column.form is Form.NUMBER:
            found[column.name] = copy_binary.fixed([np.nan if value is None else value for value in values], "f8")
        elif column.sql == "jsonb":
            documents = _documents(kind, keys, [value or {} for value in values], column.members[0])
            found[column.name] = documents.but_null(np.array([value is None for value in values], np.bool_))
        elif column.form is not Form.OWN:
            found[column.name] = _texts(kind, keys, values, column.members[0])
    return found


def _footprints(areas: Sequence[Area]) -> copy_binary.Column:
    return copy_binary.Ragged.of(shapely.to_wkb([area.footprint for area in areas], byte_order=1).tolist())


def _paths(tracks: Sequence[Track]) -> copy_binary.Column:
    batch = TrackBatch.of(tracks, once=True)
    seconds = batch.times_us / 1e6
    lost = np.flatnonzero(np.rint(seconds * 1e6).astype(np.int64) != batch.times_us)
    if lost.size:
        i = int(np.searchsorted(batch.waypoint_offset, lost[0], side="right")) - 1
        raise InvalidInput(
            f"track {tracks[i].key!r}",
            f"times[{lost[0] - batch.waypoint_offset[i]}]",
            "cannot be kept to the microsecond: before November 1833 and after February 2106 it must be a whole second "
            "(give `times`, not a speed)",
        )
    return copy_binary.lines_m(np.concatenate([batch.positions_deg, seconds[:, None]], axis=1), batch.waypoint_offset)


def _havens(tracks: Sequence[Track]) -> copy_binary.Column:
    rings = stacked([track.outline_m for track in tracks]), offsets([len(track.outline_m) for track in tracks])
    return copy_binary.polygons(*copy_binary.closed_rings(*rings), 0)


def _each(field: str, encode: Callable[[Any], bytes | None]) -> _Encoder:
    return lambda plans: copy_binary.Ragged.of([encode(getattr(one, field)) for one in plans])


def _unless_scheduled(field: str, encode: Callable[[Sequence[Any]], copy_binary.Column]) -> _Encoder:
    """Return an encoder of activations: detections expand schedules."""
    return lambda plans: encode([None if one.schedule is not None else getattr(one, field) for one in plans])


def _multispans(spans: Sequence[Spans | None]) -> copy_binary.Ragged:
    bounds = [
        (MINUS_INFINITY_US if start is None else start, INFINITY_US if end is None else end)
        for one in spans
        for start, end in one or ()
    ]
    return copy_binary.half_open_multispans(
        np.array(bounds, np.int64).reshape(-1, 2),
        offsets([len(one or ()) for one in spans]),
        np.array([one is None for one in spans], np.bool_),
    )


def _instants(lists: Sequence[tuple[int, ...] | None]) -> copy_binary.Ragged:
    at_us = np.array([at for one in lists for at in one or ()], np.int64)
    arrays = copy_binary.arrays(copy_binary.instants(at_us), offsets([len(one or ()) for one in lists]), "timestamptz")
    return copy_binary.Ragged(arrays.data, arrays.offset, None).but_null(np.array([one is None for one in lists], bool))


# Columns of the form OWN but spans and properties.
_OWN: Final = {
    "footprint": _RowCodec(_footprints),
    "path": _RowCodec(_paths),
    "outline": _RowCodec(_havens),
    "outlines": _RowCodec(_each("outlines_m", _encoded_outlines)),
    **{
        one.of_legs: _RowCodec(_each(one.of_legs, _encoded_heights), partial(decode_heights, unbounded=one.unbounded))
        for one in HEIGHT_LIMITS
    },
    "activations": _RowCodec(_unless_scheduled("spans_us", _multispans), _decoded_spans),
    "departures": _RowCodec(
        _unless_scheduled("departures_us", _instants), lambda sent: all_certain(decode_instants(sent))
    ),
}


def _texts(kind: str, keys: Sequence[str], texts: Sequence[str | None], field: str) -> copy_binary.Ragged:
    encoded = [None if text is None else text.encode("utf-8", "surrogatepass") for text in texts]
    for i, text in enumerate(texts):
        if text is not None and not _is_storable(text):
            raise InvalidInput(f"{kind} {keys[i]!r}", field, "must be Unicode text without the character U+0000")
    return copy_binary.Ragged.of(encoded)


def _documents(
    kind: str, keys: Sequence[str], documents: Sequence[Any], field: str = "properties"
) -> copy_binary.Ragged:
    encoded: list[bytes | None] = []
    for key, document in zip(keys, documents, strict=True):
        if not document:
            encoded.append(b"\x01{}")
            continue
        try:
            text = json.dumps(document, ensure_ascii=False, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise InvalidInput(f"{kind} {key!r}", field, f"must be JSON: {error}") from error
        if not _is_storable(text) or ("\\u0000" in text and _has_null_character(document)):
            raise InvalidInput(f"{kind} {key!r}", field, "must be Unicode text without the character U+0000")
        encoded.append(b"\x01" + text.encode())  # version 1 of jsonb's binary form
    return copy_binary.Ragged.of(encoded)


def _is_storable(text: str) -> bool:
    """Return whether PostgreSQL can store a text: no U+0000, no unpaired surrogate."""
    return "\0" not in text and (text.isascii() or not any("\ud800" <= c <= "\udfff" for c in text))


def _has_null_character(value: object) -> bool:
    if isinstance(value, str):
        return "\0" in value
    if isinstance(value, Mapping):
        return any(_has_null_character(item) for pair in value.items() for item in pair)
    return isinstance(value, list | tuple) and any(_has_null_character(item) for item in value)
