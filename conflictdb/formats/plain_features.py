"""Read features of a scene file many at once: areas and tracks of all forms that this package writes.

Features with errors, and those that need a closer look, are left out, as None: `scene_file` reads these one by one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import chain
from math import isfinite
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.ragged import offsets
from conflictdb.errors import InvalidInput
from conflictdb.formats import file_objects
from conflictdb.formats.contents import row_id
from conflictdb.formats.fields import Fields, finite, number_as_key
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.file_objects import (
    AREA_ELSEWHERE,
    AREA_GUARDED,
    AREA_MEMBERS,
    DATUM,
    SIDES,
    SIZES,
    TIMES,
    TOLERANCES,
    TRACK_ELSEWHERE,
    TRACK_GUARDED,
    TRACK_MEMBERS,
    FileContext,
)
from conflictdb.formats.geometry import TRACK_TYPE
from conflictdb.formats.hints import are_applied
from conflictdb.formats.instants import parse_end, parse_instant, parse_plain
from conflictdb.formats.json_text import check_storable, check_text
from conflictdb.formats.names import SETTINGS as OF_SCENE
from conflictdb.formats.names import look_alike, misnamed
from conflictdb.formats.track_times import TrackAtSpeed
from conflictdb.model import many
from conflictdb.model.plan_columns import AREA, TRACK, Form, columns_of
from conflictdb.model.plan_rules import MIN_INSTANT_US
from conflictdb.model.plans import Area, Track, rectangle_outline_m

_FEATURE: Final = ({"type", "id", "geometry", "properties"}, {"type", "geometry", "properties"})
_GEOMETRY: Final = frozenset({"type", "coordinates"})
_SIDES: Final = tuple(f"{side}_m" for side in SIDES)
# Members of tracks that the reader of single features converts.
_RARE: Final = frozenset({"outlines_m", "departures", "schedule", *TOLERANCES, *SIZES} - {*_SIDES})
_LEAST_RING: Final = 4  # positions, the last equal to the first
# Texts of keys and words up to this length have no more bytes than a key may have.
_SHORT: Final = 200


class _RareError(Exception):
    """A feature is not plain."""


@dataclass(slots=True)
class _PlainFeature:
    """An area or a track whose shape is not converted yet.

    row : place among the features
    shape : of a track its positions, of an area its polygons
    own : its members of forms of their own, but those that are absent
    members : its fields but key, shape, times and outline
    """

    row: int
    key: str
    shape: list[Any]
    own: dict[str, Any] = field(default_factory=dict)
    members: dict[str, Any] = field(default_factory=dict)


_Made: TypeAlias = Area | Track | TrackAtSpeed
_One = TypeVar("_One", Area, Track, TrackAtSpeed)


def objects(
    features: Sequence[Any], setting: FileContext, first: int = 0, derived: list[str] | None = None
) -> list[_Made | None]:
    """Return the objects of plain features, None for all others.

    first : place in the file of the first of them
    derived : ids that are derived from places in the file are added to it
    """
    found: list[_Made | None] = [None] * len(features)
    if setting.to_degrees is not None or are_applied():
        return found
    areas: list[_PlainFeature] = []
    tracks: list[_PlainFeature] = []
    at_speed: list[_PlainFeature] = []
    without_id: set[int] = set()
    for row, feature in enumerate(features):
        try:
            plain = _plain(row, feature, setting, first, without_id)
        except (_RareError, InvalidInput, ValueError):
            continue
        kind = areas if "outline" not in plain.own else tracks if "times" in plain.own else at_speed
        kind.append(plain)
    groups: tuple[tuple[list[_PlainFeature], Callable[[Sequence[_PlainFeature]], list[Any] | None]], ...] = (
        (areas, partial(_areas, setting=setting)),
        (tracks, _tracks),
        (at_speed, _at_speed),
    )
    for some, make in groups:
        for one, made in zip(some, _in_halves(some, make), strict=True):
            found[one.row] = made
            if derived is not None and one.row in without_id and made is not None:
                derived.append(one.key)
    return found


def _text(value: Any) -> str:
    _require(type(value) is str)
    if not value.isascii() or "\0" in value:
        check_text("", "", value)
    return str(value)


def _word(value: Any) -> str | None:
    return _text(value) or None


def _number(value: Any) -> float:
    _require(type(value) is float or type(value) is int)
    return finite("", "", value)


def _document(value: Any) -> Any:
    check_storable("", "", value)
    return value


_READ: Final[dict[Form, Callable[[Any], Any]]] = {
    Form.TEXT: _text,
    Form.WORD: _word,
    Form.NUMBER: _number,
    Form.DOCUMENT: _document,
}


def _readers(kind: str, names: frozenset[str]) -> dict[str, tuple[str, Callable[[Any], Any]] | None]:
    """Return the field and the reader of each member of a plain form; None: of a form of its own."""
    found: dict[str, tuple[str, Callable[[Any], Any]] | None] = dict.fromkeys(names)
    for one in columns_of(kind):
        if one.is_member and one.name != "schedule":
            found[one.members[0]] = one.field, _READ[one.form]
    return found


# Members that may be lists, of one value for each leg.
_PER_LEG: Final = frozenset({"floor_m", "ceiling_m"})
_AREA_READERS: Final = _readers(AREA, AREA_MEMBERS)
_TRACK_READERS: Final = _readers(TRACK, TRACK_MEMBERS)


@lru_cache(maxsize=4096)
def _is_harmless(name: str, is_track: bool) -> bool:
    """Return whether a property of any value looks like no member."""
    known, elsewhere = (TRACK_GUARDED, TRACK_ELSEWHERE) if is_track else (AREA_GUARDED, AREA_ELSEWHERE)
    is_elsewhere = name in known or name in elsewhere or name.lower() in elsewhere
    return not is_elsewhere and look_alike(name, (*known, *OF_SCENE)) is None


def _plain(row: int, feature: Any, setting: FileContext, first: int, without_id: set[int]) -> _PlainFeature:
    _require(type(feature) is dict and feature.keys() in _FEATURE and feature["type"] == "Feature")
    geometry, properties = feature["geometry"], feature["properties"]
    _require(type(geometry) is dict and geometry.keys() == _GEOMETRY and type(properties) is dict)
    kind, shape = geometry["type"], geometry["coordinates"]
    is_track = kind == TRACK_TYPE
    if kind == "Polygon":
        shape = [shape]
    elif not is_track:
        _require(kind == "MultiPolygon")
    key = feature.get("id")
    if key is None:
        key = properties.get("id")
        _require(key is not None or (bool(setting.row_ids) and "id" not in map(str.lower, properties)))
        if key is None:
            key = row_id(setting.row_ids, first + row + 1)
            without_id.add(row)
        else:
            properties = {name: value for name, value in properties.items() if name != "id"}
            _require("id" not in map(str.lower, properties))
    if type(key) is not str or not key.isascii() or not 0 < len(key) <= _SHORT or "\0" in key:
        key = checked_key("", "id", number_as_key(key))
    said = properties.get("kind")
    _require(type(shape) is list and (said is None or said == (TRACK if is_track else AREA)))
    plain = _PlainFeature(row, key, shape)
    _read(plain, properties, is_track, setting)
    if is_track:
        _read_track(plain, properties)
    else:
        _read_area(plain, properties)
    return plain


def _read(plain: _PlainFeature, properties: Mapping[str, Any], is_track: bool, setting: FileContext) -> None:
    """Read the members of plain forms, and properties."""
    readers = _TRACK_READERS if is_track else _AREA_READERS
    own, members, rest = plain.own, plain.members, {}
    is_suspect = False
    for name, value in properties.items():
        if name not in readers:
            rest[name] = value
            if value is not None and not _is_harmless(name, is_track):
                is_suspect = True
        elif value is not None:
            reader = readers[name]
            if reader is None or (type(value) is list and name in _PER_LEG):
                own[name] = value
            else:
                members[reader[0]] = reader[1](value)
    if rest:
        if is_suspect:
            _require(rest.get(DATUM) is None)
            known, elsewhere = (TRACK_GUARDED, TRACK_ELSEWHERE) if is_track else (AREA_GUARDED, AREA_ELSEWHERE)
            _require(next(misnamed("", properties, known, elsewhere, setting.foreign), None) is None)
        for name, value in rest.items():
            _text(name)
            if type(value) is str:
                _text(value)
            elif type(value) is float:
                _require(isfinite(value))
            elif value is not None:
                check_storable("", "", value)
        members["properties"] = rest


def _read_area(plain: _PlainFeature, properties: Mapping[str, Any]) -> None:
    own = plain.own
    _require(own.keys() <= {"kind", "start", "end", "spans", "schedule"})
    if "spans" in own or "schedule" in own:
        _add_rare(plain, file_objects.activations, properties)


def _read_track(plain: _PlainFeature, properties: Mapping[str, Any]) -> None:
    own = plain.own
    given = [name for name in TIMES if name in own]
    if given:
        _require(len(given) == 1 and own.keys().isdisjoint(file_objects.SPEED))
        times = own["times"] = own[given[0]]
        _require(type(times) is list and len(times) == len(plain.shape) and set(map(type, times)) <= {str})
    else:
        _require(type(own.get("start")) is str)
        fields = Fields("", properties)
        own["speed"] = file_objects.speeds_mps(fields, len(plain.shape) - 1)
        own["start_us"] = parse_instant(own["start"])
    if own.keys().isdisjoint(_RARE) and type(own.get("floor_m")) is not list and type(own.get("ceiling_m")) is not list:
        own["outline"] = _outline(own)
    else:
        _add_rare(plain, file_objects.own_members, properties)
        own["outline"] = plain.members.pop("outline_m").tolist()


def _add_rare(plain: _PlainFeature, read: Callable[[Fields], dict[str, Any]], properties: Mapping[str, Any]) -> None:
    """Add fields that the reader of single features reads."""
    fields = Fields("", properties)
    found = read(fields)
    _require(not fields.refusals.found)
    plain.members.update((name, value) for name, value in found.items() if value is not None)


def _outline(own: Mapping[str, Any]) -> list[Any]:
    """Return the ring of a haven as the file gives it, or of four sides."""
    ring = own.get("outline_m")
    sides = [own[name] for name in _SIDES if name in own]
    if ring is not None:
        _require(type(ring) is list and not sides)
        return list(ring)
    _require(len(sides) == len(_SIDES))
    sizes = [_number(side) for side in sides]
    _require(min(sizes) >= 0.0)
    return rectangle_outline_m(*sizes).tolist()


def _areas(plain: Sequence[_PlainFeature], setting: FileContext) -> list[Area | None] | None:
    """Return areas; None if one of them is no list of rings of positions, or has a time that is none."""
    polygons = _chained([area.shape for area in plain])
    rings = _chained(polygons)
    lonlat = _positions(rings, {2, 3})
    if lonlat is None:
        return None
    of_rings, of_polygons = offsets([len(ring) for ring in rings or ()]), offsets([len(one) for one in polygons or ()])
    is_ring = (np.diff(of_rings) >= _LEAST_RING) & (lonlat[of_rings[:-1]] == lonlat[of_rings[1:] - 1]).all(axis=1)
    if not is_ring.all():
        return None
    for name, parse in (("start", parse_instant), ("end", parse_end)):
        given = [area for area in plain if name in area.own]
        texts = [area.own[name] for area in given]
        if not set(map(type, texts)) <= {str}:
            return None
        for area, at_us in zip(given, _instants(texts, parse).tolist(), strict=True):
            area.members[f"{name}_us"] = at_us
    of_areas = offsets([len(area.shape) for area in plain])
    keys = [area.key for area in plain]
    if setting.long_sides is not None:
        owner = np.searchsorted(of_polygons[of_areas[1:]], np.arange(len(of_rings) - 1), side="right")
        named = [f"area {key!r}" for key in keys]
        lonlat, of_rings = setting.long_sides.straight_rings(named, lonlat, of_rings, owner)
    return many.areas(
        keys,
        shapely.from_ragged_array(shapely.GeometryType.MULTIPOLYGON, lonlat, (of_rings, of_polygons, of_areas)),
        [area.members for area in plain],
    )


def _tracks(plain: Sequence[_PlainFeature]) -> list[Track | None] | None:
    """Return tracks; None if one of them has a position, time or corner that is none."""
    positions_deg = _positions([track.shape for track in plain], {2, 3})
    outlines = _havens(plain)
    if positions_deg is None or outlines is None:
        return None
    return many.tracks(
        [track.key for track in plain],
        positions_deg,
        offsets([len(track.shape) for track in plain]),
        _instants([time for track in plain for time in track.own["times"]], parse_instant),
        *outlines,
        [track.members for track in plain],
    )


def _at_speed(plain: Sequence[_PlainFeature]) -> list[TrackAtSpeed | None] | None:
    """Return tracks whose times follow from their speeds; None if one of them has a position or corner that is none."""
    positions_deg = _positions([track.shape for track in plain], {2, 3})
    outlines = _havens(plain)
    if positions_deg is None or outlines is None:
        return None
    found: list[TrackAtSpeed | None] = []
    way, ring = offsets([len(track.shape) for track in plain]).tolist(), outlines[1].tolist()
    for k, track in enumerate(plain):
        members = {**track.members, "outline_m": outlines[0][ring[k] : ring[k + 1]]}
        here = positions_deg[way[k] : way[k + 1]]
        speed, speed_mps = track.own["speed"]
        one = TrackAtSpeed(track.key, here, track.own["start_us"], speed, speed_mps, members)
        found.append(one if len(here) > 1 else None)
    return found


def _havens(plain: Sequence[_PlainFeature]) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Return the corners of havens (v, 2), and their offsets; None if one of them is none."""
    outline_m = _positions([track.own["outline"] for track in plain], {2})
    if outline_m is None:
        return None
    ring = offsets([len(track.own["outline"]) for track in plain])
    # A ring may repeat its first corner.
    first, last = ring[:-1], ring[1:] - 1
    is_closed = (last > first) & (outline_m[first] == outline_m[last]).all(axis=1)
    is_closed &= ["outlines_m" not in track.members for track in plain]
    return np.delete(outline_m, last[is_closed], axis=0), offsets(np.diff(ring) - is_closed)


def _in_halves(
    plain: Sequence[_PlainFeature], make: Callable[[Sequence[_PlainFeature]], list[_One | None] | None]
) -> list[_One | None]:
    """Return what `make` returns, None for each of the features for which it returns None."""
    if not plain:
        return []
    made = make(plain)
    if made is not None:
        return made
    half = len(plain) // 2
    return [None] if not half else _in_halves(plain[:half], make) + _in_halves(plain[half:], make)


def _instants(texts: list[str], parse: Callable[[str], int]) -> NDArray[np.int64]:
    """Return instants, microseconds since 1970; one that is none is before all years."""
    us, is_plain = parse_plain(texts)
    for i in np.flatnonzero(~is_plain).tolist():
        try:
            us[i] = parse(texts[i])
        except ValueError:
            us[i] = MIN_INSTANT_US - 1
    return us


def _positions(lines: list[list[Any]] | None, widths: set[int]) -> NDArray[np.float64] | None:
    """Return the first two numbers of all positions of lines (n, 2); None unless all are as many finite numbers."""
    points = None if lines is None else _chained(lines)
    if points is None:
        return None
    width = set(map(len, points))
    numbers = list(chain.from_iterable(points))
    # By type: numpy would convert true to 1 and "4" to 4.
    if len(width) != 1 or not width <= widths or not set(map(type, numbers)) <= {int, float}:
        return None
    try:
        flat = np.array(numbers, np.float64)
    except OverflowError:
        return None
    return np.ascontiguousarray(flat.reshape(len(points), -1)[:, :2]) if np.isfinite(flat).all() else None


def _chained(lists: list[list[Any]] | None) -> list[list[Any]] | None:
    """Return the members of lists; None unless all lists have members, and all members are lists."""
    if lists is None or not all(lists):
        return None
    members = list(chain.from_iterable(lists))
    return members if set(map(type, members)) == {list} else None


def _require(is_plain: bool) -> None:
    if not is_plain:
        raise _RareError
