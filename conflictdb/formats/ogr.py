"""Read areas and tracks from files that the OGR library opens (GeoPackage, Shapefile, KML, GPX, …), through pyogrio.

Needs the extra `ogr`: ``pip install 'conflictdb[ogr]'``. Every polygon of every layer, or of the selected layers,
becomes an area. A line becomes a track if its layer has a column of times or a speed (OGR drops the M values). The
track points of GPX become tracks as positions do. A line of KML with a begin and an end (gx:Track) is refused. All
other points and lines are left out and listed.

Columns named like members of scene files, in upper or lower case, are read as these members, lists as JSON; all others
are kept as properties. Without an id column the id is the name of a feature of KML if it is unique, else the number of
the feature, after the name of its layer if there are several. Other reference systems are transformed vertex by vertex
to longitude and latitude; edges are then straight in the scene's plane.

The OGR library runs in a confined process: see `confined` and `ogr_child`.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.formats import file_objects, wkb
from conflictdb.formats.confined import Program
from conflictdb.formats.contents import (
    Contents,
    FileRefusals,
    Remark,
    Skipped,
    check_columns,
    given_twice,
    left_out,
    name_of,
)
from conflictdb.formats.features import LINES, POINTS, TIMES_OR_SPEED, area_of_polygon, track_of_line, unusable
from conflictdb.formats.fields import MAX_KEY_BYTES
from conflictdb.formats.fixes import Fixes, tracks_of
from conflictdb.formats.hints import renamed
from conflictdb.formats.instants import parse_instant
from conflictdb.formats.names import RENAME_COLUMN
from conflictdb.formats.reference import EXTRA, of_name
from conflictdb.formats.time_columns import is_time_like, without_times
from conflictdb.formats.track_times import TrackAtSpeed, timed
from conflictdb.model.plans import Area, Scene, Track

# Some of the columns that OGR gives the features of KML.
_KML_FIELDS: Final = frozenset({"begin", "end", "altitudeMode", "tessellate", "extrude"})
_KML_TRACK: Final = (
    "are missing: a line with a begin and an end, as a gx:Track has, whose times of each point the OGR library does "
    "not give; write it as GPX, or as a line with a column times"
)
_GPX_POINTS: Final = "track_points"
_POINT_BYTES: Final = 21  # of a point in WKB
_GPX_LAYERS: Final = frozenset({"waypoints", "routes", "tracks", "route_points", _GPX_POINTS})
# No service listens here, so addresses in a file lead nowhere.
_NOWHERE: Final = "http://127.0.0.1:9"
PROGRAM: Final = Program(
    "ogr_child.py",
    "cannot be read by OGR",
    # Sixty times the needs of a large honest file; by default a minute and 4 GB.
    seconds_per_mb=1.0,
    memory_per_mb=64 << 20,
    settings={
        "GDAL_DRIVER_PATH": "disable",  # no plugins
        "GDAL_HTTP_PROXY": _NOWHERE,
        "GDAL_HTTPS_PROXY": _NOWHERE,
        "GDAL_HTTP_TIMEOUT": "1",
        "GDAL_HTTP_MAX_RETRY": "0",
        "CPL_VSIL_CURL_ALLOWED_EXTENSIONS": "{none}",
        "OGR_SQLITE_LOAD_EXTENSIONS": "",
        "PROJ_NETWORK": "OFF",
        "PROJ_CURL_ENABLED": "NO",
        "http_proxy": _NOWHERE,
        "https_proxy": _NOWHERE,
        "all_proxy": _NOWHERE,
    },
)


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer of a file.

    crs : its reference system, None if unknown
    fields : names of its columns
    numbers : of its features
    shapes : geometries as WKB, two-dimensional; None for a feature without
    columns : values by column, as JSON values; None is missing
    """

    name: str
    crs: str | None
    fields: list[str]
    numbers: list[int]
    shapes: NDArray[np.object_]
    columns: list[list[Any]]

    @classmethod
    def of(cls, layer: Mapping[str, Any]) -> "Layer":
        """Return a layer as `ogr_child` writes it."""
        shapes = np.empty(len(layer["shapes"]), dtype=object)
        shapes[:] = [None if shape is None else bytes.fromhex(shape) for shape in layer["shapes"]]
        return cls(layer["name"], layer["crs"], layer["fields"], layer["numbers"], shapes, layer["columns"])

    @property
    def by_field(self) -> dict[str, list[Any]]:
        """The columns by their names."""
        return dict(zip(self.fields, self.columns, strict=True))


def read_objects(
    path: Path, max_file_mb: float, max_speed_kn: float, names: Sequence[str] = (), *, skip_invalid: bool = False
) -> Contents:
    """Return the areas and tracks of a file that OGR opens; raises InvalidInput, also without pyogrio.

    max_file_mb, max_speed_kn : see `conflictdb.formats.read`
    names : layers to read; none: all
    skip_invalid : leave out refused objects
    """
    layers = read_layers(path, max_file_mb)
    if not layers:
        raise InvalidInput("file", "", "holds no layer with geometries")
    known = [layer.name for layer in layers]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InvalidInput("file", "layer", f"there is no layer {unknown[0]!r}; the file has {', '.join(known)}")
    chosen = [replace(layer, fields=renamed(layer.fields)) for layer in layers if not names or layer.name in names]
    contents = Contents(None, [], [], [])
    refusals = FileRefusals()
    if _is_gpx(layers):
        _read_gpx(str(path), layers, chosen, max_speed_kn, contents)
    else:
        names_of = _kml_keys(layers)
        _read_features(str(path), chosen, names_of, len(layers) > 1, max_speed_kn, contents, refusals)
    if not skip_invalid:
        refusals.raise_found()
    contents.skipped.extend(left_out(str(path), refusals))
    return contents


def read_layers(path: Path, max_file_mb: float, program: Program = PROGRAM) -> list[Layer]:
    """Return the layers of a file that have geometries.

    Raises
    ------
    InvalidInput
        It cannot be read, exceeds `max_file_mb` or the limits of time and memory; or pyogrio is missing.
    """
    if find_spec("pyogrio") is None:
        raise InvalidInput("file", "", f"is of a format that {EXTRA}")
    program = replace(program, settings={**program.settings, "GDAL_SKIP": ",".join(_formats_to_skip())})
    with program.running([str(path.absolute())], max_file_mb) as running:
        answer: list[Mapping[str, Any]] = json.loads(running.answer())
    return [Layer.of(one) for one in answer]


@cache
def _formats_to_skip() -> tuple[str, ...]:
    """Return the OGR formats to disable."""
    try:
        with PROGRAM.running([], 0.0) as running:
            return tuple(json.loads(running.answer()))
    except InvalidInput as refused:
        raise InvalidInput("file", "", f"is of a format that {EXTRA}; it does not start: {refused.rule}") from None


def _read_features(
    source: str,
    layers: Sequence[Layer],
    names: Mapping[tuple[str, int], str],
    prefixed: bool,
    max_speed_kn: float,
    contents: Contents,
    refusals: Refusals,
) -> None:
    """Add the areas and tracks of some layers; errors are added to the refusals.

    names : the keys of some features, by layer and number
    prefixed : whether other keys begin with the name of the layer
    """
    seen: dict[str, str] = {}
    items: list[Area | Track | TrackAtSpeed] = []
    scene = Scene("file")
    for layer in layers:
        numbers = layer.numbers
        keys = [names.get((layer.name, number)) or _key(layer, number, prefixed=prefixed) for number in numbers]
        for where, item in _features(source, layer, keys, scene, contents, refusals):
            first = seen.setdefault(item.key, where)
            with refusals:
                if first != where:
                    raise given_twice(name_of(item), f"{first} and {where}")
                items.append(item)
    areas, tracks = timed(items, scene, max_speed_kn, refusals)
    contents.areas.extend(areas)
    contents.tracks.extend(tracks)


def _features(
    source: str, layer: Layer, keys: Sequence[str], scene: Scene, contents: Contents, refusals: Refusals
) -> Iterator[tuple[str, Area | Track | TrackAtSpeed]]:
    """Yield the place of each object in the file, and the object.

    keys : of features without an id
    """
    who = f"layer {layer.name!r:.100}"
    check_columns(who, layer.fields)
    shapes = _shapes(who, layer)
    if layer.crs is None:
        rule = "is unknown: the file must say its reference system (a Shapefile needs its .prj)"
        raise InvalidInput(who, "reference system", rule)
    setting = file_objects.Setting(scene, (), of_name(who, layer.crs), RENAME_COLUMN)
    has_times = not TIMES_OR_SPEED.isdisjoint(name.lower() for name in layer.fields)
    others: dict[str, list[int]] = defaultdict(list)
    is_kml = set(layer.fields) >= _KML_FIELDS
    time_like: dict[str, None] = {}
    for i, number in enumerate(layer.numbers):
        shape = shapes[i]
        where = f"feature {number} of {who}"
        values = {name: column[i] for name, column in zip(layer.fields, layer.columns, strict=True)}
        kind = None if shape is None else shapely.get_type_id(shape)
        is_track = kind in LINES and has_times
        if is_kml and kind in LINES and not is_track and values["begin"] is not None and values["end"] is not None:
            with refusals:
                raise InvalidInput(where, "times", _KML_TRACK)
            continue
        if kind in LINES and not is_track:
            time_like.update(dict.fromkeys(name for name, value in values.items() if is_time_like(name, value)))
        if kind in POINTS | LINES and not is_track:
            others[shape.geom_type].append(number)
            continue
        with refusals:
            if is_track:
                yield where, track_of_line(where, keys[i], values, shape, setting)
            else:
                yield where, area_of_polygon(where, keys[i], values, shape, setting)
    contents.skipped.extend(unusable(source, who, "features", others, without_times(time_like)))


def _kml_keys(layers: Sequence[Layer]) -> dict[tuple[str, int], str]:
    """Return the names of features of KML that no other feature has as its name or number, by layer and number.

    layers : all of the file, so that keys do not depend on those that are read
    """
    names: dict[tuple[str, int], str] = {}
    for layer in (one for one in layers if set(one.fields) >= _KML_FIELDS):
        for name, column in zip(layer.fields, layer.columns, strict=True):
            if name.lower() == "name":
                given = zip(layer.numbers, column, strict=True)
                names |= {(layer.name, number): str(one) for number, one in given if one and str(one).strip()}
    if not names:
        return {}
    numbers = {_key(layer, number, prefixed=len(layers) > 1) for layer in layers for number in layer.numbers}
    same = Counter(names.values())
    return {
        of: name
        for of, name in names.items()
        if same[name] == 1 and name not in numbers and len(name.encode()) <= MAX_KEY_BYTES
    }


def _key(layer: Layer, number: int, *, prefixed: bool) -> str:
    """Return the key of a feature without another one."""
    return f"{layer.name}.{number}" if prefixed else str(number)


def _shapes(who: str, layer: Layer) -> NDArray[np.object_]:
    """Return the geometries of a layer; raises InvalidInput."""
    try:
        return wkb.decoded(layer.shapes)
    except (ValueError, shapely.errors.GEOSException) as error:
        raise InvalidInput(who, "geometry", f"holds what is no simple geometry: {error}") from error


def _is_gpx(layers: Sequence[Layer]) -> bool:
    """Return whether the layers are those of a GPX file, with the columns and geometries that OGR gives them."""
    by_name = {layer.name: layer for layer in layers}
    if set(by_name) != _GPX_LAYERS:
        return False
    points, tracks = by_name[_GPX_POINTS], by_name["tracks"]
    column = points.by_field
    kinds = (("time", str | None), ("track_fid", int), ("track_seg_id", int))
    titles = tracks.by_field.get("name", [0])
    return (
        all(name in column and all(isinstance(one, kind) for one in column[name]) for name, kind in kinds)
        and all(isinstance(one, str | None) for one in titles)
        and all(shape is not None and len(shape) == _POINT_BYTES for shape in points.shapes)
    )


def _read_gpx(
    source: str, layers: Sequence[Layer], chosen: Sequence[Layer], max_speed_kn: float, contents: Contents
) -> None:
    """Add the tracks of a GPX file from the usable points of each segment, as for other observed positions."""
    by_name = {layer.name: layer for layer in layers}
    for name, what in (("waypoints", "waypoints"), ("routes", "routes, which have no times")):
        count = len(by_name[name].numbers)
        if count and by_name[name] in chosen:
            reason = f"{count} features are {what}: no tracks"
            contents.skipped.append(Skipped(source, f"layer {name!r}", reason, (), is_whole=False))
    if not {"tracks", _GPX_POINTS} & {layer.name for layer in chosen}:
        return
    points, tracks = by_name[_GPX_POINTS], by_name["tracks"]
    column = points.by_field
    titles = dict(zip(tracks.numbers, tracks.by_field["name"], strict=True))
    places = shapely.get_coordinates(_shapes(f"layer {_GPX_POINTS!r}", points))
    keys = _gpx_keys(list(zip(column["track_fid"], column["track_seg_id"], strict=True)), titles)
    segments: dict[tuple[int, int], Fixes] = {}
    missing: dict[tuple[str, str], list[int]] = defaultdict(list)
    for i, when in enumerate(column["time"]):
        segment = column["track_fid"][i], column["track_seg_id"][i]
        own = segments.setdefault(segment, Fixes())
        if when is None:
            missing[keys[segment], "no time"].append(i + 1)
            continue
        try:
            own.times_us.append(parse_instant(when, naive_is_utc=True))
        except ValueError as error:
            raise InvalidInput(f"layer {_GPX_POINTS!r}", f"point {i + 1}, time", str(error)) from None
        own.positions_deg.append((float(places[i, 0]), float(places[i, 1])))
        own.lines.append(i + 1)
    for (number, _), own in segments.items():
        own.constant["name"] = titles.get(number)
    objects = ((keys[segment], own) for segment, own in segments.items())
    found, rest = tracks_of(source, objects, (), max_speed_kn, missing)
    contents.tracks.extend(found)
    contents.skipped.extend(rest)
    if contents.tracks:
        contents.remarks = [Remark(source, "file", "says nothing of sizes: all tracks are points")]


def _gpx_keys(segments: Sequence[tuple[int, int]], titles: Mapping[int, Any]) -> dict[tuple[int, int], str]:
    """Return the key of each segment: the track's name if unique, else its number; and the segment's number."""
    keys = {}
    different = dict.fromkeys(segments)
    parts = Counter(number for number, _ in different)
    same = Counter(titles.values())
    for number, part in different:
        title = titles.get(number)
        is_name = bool(title) and same[title] == 1
        segment = f".{part + 1}" if parts[number] > 1 else ""
        keys[number, part] = (str(title) if is_name else str(number + 1)) + segment
    return keys
