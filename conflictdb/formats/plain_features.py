"""Read plain features of a scene file many at once: areas and tracks with the members that this package writes.

All other features, and features with errors, are left out, as None: `scene_file` reads these one by one. It would read
the plain ones alike, in five times the time.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.ragged import offsets
from conflictdb.errors import InvalidInput
from conflictdb.formats.fields import finite, instant, number_as_key
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.file_objects import (
    AREA_ELSEWHERE,
    AREA_GUARDED,
    AREA_MEMBERS,
    DATUM,
    SIDES,
    TRACK_ELSEWHERE,
    TRACK_GUARDED,
    TRACK_MEMBERS,
    FileContext,
)
from conflictdb.formats.geometry import TRACK_TYPE
from conflictdb.formats.hints import are_applied
from conflictdb.formats.instants import parse_instant, parse_plain
from conflictdb.formats.json_text import check_storable, check_text
from conflictdb.formats.names import misnamed
from conflictdb.model import many
from conflictdb.model.plans import MIN_INSTANT_US, Area, Track, rectangle_outline_m
from conflictdb.model.rules import class_rule, word_rule

_FEATURE: Final = frozenset({"type", "id", "geometry", "properties"})
_GEOMETRY: Final = frozenset({"type", "coordinates"})
_SIDES: Final = tuple(f"{side}_m" for side in SIDES)
# Members that are left to `scene_file`.
_READ: Final = {"kind", "name", "floor_m", "ceiling_m", "class", "owner"}
_RARE: Final = {
    False: AREA_MEMBERS - _READ - {"start", "end"},
    True: TRACK_MEMBERS - _READ - {"times", "outline_m", *_SIDES},
}
# Sides with smaller ranges of longitude and latitude are rhumb lines and great circles, to a metre below 81 degrees.
_SMALL_DEG: Final = 0.025
_LEAST_RING: Final = 4  # positions, the last equal to the first


class _RareError(Exception):
    """A feature is not plain."""


@dataclass(frozen=True, slots=True)
class _Plain:
    """What areas and tracks have in common.

    row : place among the features
    shape : of a track its positions, of an area its polygons
    """

    row: int
    key: str
    shape: list[Any]
    name: str | None
    heights_m: tuple[float | None, float | None]
    rest: Mapping[str, Any]
    ruled: tuple[str | None, str | None]


@dataclass(frozen=True, slots=True)
class _PlainArea(_Plain):
    span_us: tuple[int | None, int | None]


@dataclass(frozen=True, slots=True)
class _PlainTrack(_Plain):
    times: list[str]
    outline: list[Any]


_One = TypeVar("_One", _PlainArea, _PlainTrack)
_Made = TypeVar("_Made", Area, Track)
_Make: TypeAlias = Callable[[Sequence[_One]], list[_Made | None] | None]


def objects(features: Sequence[Any], setting: FileContext) -> list[Area | Track | None]:
    """Return the objects of plain features, None for all others."""
    found: list[Area | Track | None] = [None] * len(features)
    if setting.to_degrees is not None or are_applied():
        return found
    features = [feature if setting.long_sides is None or _is_small(feature) else None for feature in features]
    areas: list[_PlainArea] = []
    tracks: list[_PlainTrack] = []
    for row, feature in enumerate(features):
        try:
            plain = _plain(row, feature, setting)
        except (_RareError, InvalidInput, ValueError):
            continue
        if isinstance(plain, _PlainTrack):
            tracks.append(plain)
        else:
            areas.append(plain)
    for area, made in zip(areas, _in_halves(areas, _areas), strict=True):
        found[area.row] = made
    for track, one in zip(tracks, _in_halves(tracks, _tracks), strict=True):
        found[track.row] = one
    return found


def _is_small(feature: Any) -> bool:
    """Return whether a feature is a line, or a polygon whose sides are too short to need vertices along them."""
    try:
        geometry = feature["geometry"]
        if geometry["type"] == TRACK_TYPE:
            return True
        polygons = [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]
        rings = chain.from_iterable(polygons)
        return all(
            abs(b[0] - a[0]) < _SMALL_DEG and abs(b[1] - a[1]) < _SMALL_DEG for ring in rings for a, b in pairwise(ring)
        )
    except (KeyError, TypeError, IndexError, ValueError):
        return False


def _plain(row: int, feature: Any, setting: FileContext) -> _PlainArea | _PlainTrack:
    _require(type(feature) is dict and feature.keys() == _FEATURE and feature["type"] == "Feature")
    geometry, properties = feature["geometry"], feature["properties"]
    _require(type(geometry) is dict and geometry.keys() == _GEOMETRY and type(properties) is dict)
    kind, shape = geometry["type"], geometry["coordinates"]
    key = checked_key("", "id", number_as_key(feature["id"]))
    is_track = kind == TRACK_TYPE
    if kind == "Polygon":
        shape = [shape]
    elif not is_track:
        _require(kind == "MultiPolygon")
    said = properties.get("kind")
    _require(type(shape) is list and (said is None or said == ("track" if is_track else "area")))
    name = properties.get("name")
    if name is not None:
        _require(type(name) is str)
        check_text("", "name", name)
    heights_m = _number(properties.get("floor_m")), _number(properties.get("ceiling_m"))
    _require(properties.get(DATUM) is None)
    ruled = _word("class", properties.get("class")), _word("owner", properties.get("owner"))
    members = TRACK_MEMBERS if is_track else AREA_MEMBERS
    rest: dict[str, Any] = {}
    if not properties.keys() <= members:
        known, elsewhere = (TRACK_GUARDED, TRACK_ELSEWHERE) if is_track else (AREA_GUARDED, AREA_ELSEWHERE)
        _require(next(misnamed("", properties, known, elsewhere, setting.foreign), None) is None)
        rest = {member: value for member, value in properties.items() if member not in members}
        check_storable("", "", rest)
    _require(all(properties[member] is None for member in _RARE[is_track] & properties.keys()))
    if not is_track:
        span_us = _instant(properties.get("start")), _instant(properties.get("end"))
        return _PlainArea(row, key, shape, name, heights_m, rest, ruled, span_us)
    times = properties.get("times")
    _require(type(times) is list and len(times) == len(shape) and set(map(type, times)) <= {str})
    return _PlainTrack(row, key, shape, name, heights_m, rest, ruled, times, _outline(properties))


def _outline(properties: Mapping[str, Any]) -> list[Any]:
    """Return the ring of a haven as the file gives it, or of four sides."""
    ring = properties.get("outline_m")
    sides = [_number(properties.get(name)) for name in _SIDES]
    if ring is not None:
        _require(type(ring) is list and sides == [None] * len(sides))
        return list(ring)
    given = [side for side in sides if side is not None and side >= 0.0]
    _require(len(given) == len(sides))
    return rectangle_outline_m(*given).tolist()


def _areas(plain: Sequence[_PlainArea]) -> list[Area | None] | None:
    """Return areas; None if one of them is no list of rings of positions."""
    polygons = _chained([area.shape for area in plain])
    rings = _chained(polygons)
    lonlat = _positions(rings, {2, 3})
    if lonlat is None:
        return None
    of_rings, of_polygons = offsets([len(ring) for ring in rings or ()]), offsets([len(one) for one in polygons or ()])
    is_ring = (np.diff(of_rings) >= _LEAST_RING) & (lonlat[of_rings[:-1]] == lonlat[of_rings[1:] - 1]).all(axis=1)
    if not is_ring.all():
        return None
    of_areas = offsets([len(area.shape) for area in plain])
    return many.areas(
        [area.key for area in plain],
        shapely.from_ragged_array(shapely.GeometryType.MULTIPOLYGON, lonlat, (of_rings, of_polygons, of_areas)),
        [area.name for area in plain],
        [area.span_us for area in plain],
        [area.heights_m for area in plain],
        [area.rest for area in plain],
        [area.ruled for area in plain],
    )


def _tracks(plain: Sequence[_PlainTrack]) -> list[Track | None] | None:
    """Return tracks; None if one of them has a position, time or corner that is none."""
    positions_deg = _positions([track.shape for track in plain], {2, 3})
    outline_m = _positions([track.outline for track in plain], {2})
    if positions_deg is None or outline_m is None:
        return None
    ring = offsets([len(track.outline) for track in plain])
    # A ring may repeat its first corner.
    first, last = ring[:-1], ring[1:] - 1
    is_closed = (last > first) & (outline_m[first] == outline_m[last]).all(axis=1)
    return many.tracks(
        [track.key for track in plain],
        positions_deg,
        offsets([len(track.shape) for track in plain]),
        _instants([time for track in plain for time in track.times]),
        np.delete(outline_m, last[is_closed], axis=0),
        offsets(np.diff(ring) - is_closed),
        [track.name for track in plain],
        [track.heights_m for track in plain],
        [track.rest for track in plain],
        [track.ruled for track in plain],
    )


def _in_halves(plain: Sequence[_One], make: "_Make[_One, _Made]") -> list[_Made | None]:
    """Return what `make` returns, None for each of the features for which it returns None."""
    if not plain:
        return []
    made = make(plain)
    if made is not None:
        return made
    half = len(plain) // 2
    return [None] if not half else _in_halves(plain[:half], make) + _in_halves(plain[half:], make)


def _instants(texts: list[str]) -> NDArray[np.int64]:
    """Return instants, microseconds since 1970; one that is none is before all years."""
    us, is_plain = parse_plain(texts)
    for i in np.flatnonzero(~is_plain).tolist():
        try:
            us[i] = parse_instant(texts[i])
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
    """Return the members of lists; None unless all lists have members, all of which are lists."""
    if lists is None or not all(lists):
        return None
    members = list(chain.from_iterable(lists))
    return members if set(map(type, members)) == {list} else None


def _number(value: Any) -> float | None:
    if value is None:
        return None
    _require(type(value) in (int, float))
    return finite("", "", value)


def _word(name: str, value: Any) -> str | None:
    if value is None:
        return None
    _require(type(value) is str)
    check_text("", name, value)
    _require((class_rule if name == "class" else word_rule)(value) is None)
    return str(value)


def _instant(value: Any) -> int | None:
    return None if value is None else instant("", "", value)


def _require(is_plain: bool) -> None:
    if not is_plain:
        raise _RareError
