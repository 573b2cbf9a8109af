"""Read areas and tracks from files that the OGR library opens (GeoPackage, Shapefile, KML, …), through pyogrio.

Needs the extra `ogr`: ``pip install 'conflictdb[ogr]'``. docs/reference/files.md says which features
become areas and tracks, and how columns and ids are read.

The OGR library runs in a confined process: see `confined` and `ogr_child`.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.formats import file_objects, wkb
from conflictdb.formats.archives import check_archive
from conflictdb.formats.confined import ConfinedProgram
from conflictdb.formats.contents import (
    SAYS_NO_SIZES,
    Contents,
    FileRefusals,
    Remark,
    check_columns,
    given_twice,
    left_out,
    name_of,
    row_id,
)
from conflictdb.formats.features import LINES, POINTS, TIMES_OR_SPEED, area_of_polygon, track_of_line, unusable
from conflictdb.formats.fields import MAX_KEY_BYTES
from conflictdb.formats.fixes import Fixes, tracks_of
from conflictdb.formats.hints import renamed
from conflictdb.formats.instants import format_instant
from conflictdb.formats.kml_document import ALTITUDE_MODES, KmlDocument
from conflictdb.formats.kml_tracks import GxTracks
from conflictdb.formats.names import RENAME_COLUMN, SETTINGS, can_be
from conflictdb.formats.reference import EXTRA, of_name
from conflictdb.formats.rings import LongSides
from conflictdb.formats.standards import altitudes
from conflictdb.formats.time_columns import is_time_like, without_times
from conflictdb.formats.track_times import TrackAtSpeed, timed
from conflictdb.model.plans import Area, Scene, Track

# Some of the columns that OGR gives the features of KML.
_KML_FIELDS: Final = frozenset({"begin", "end", "altitudeMode", "tessellate", "extrude"})
# Names of known members as a Shapefile cuts them, and the names that they may be.
_CUT_TO: Final = 10
_MEMBERS: Final = file_objects.AREA_MEMBERS | file_objects.TRACK_MEMBERS | {file_objects.DATUM, *SETTINGS}
_CUT: Final = {
    name[:_CUT_TO]: [one for one in sorted(_MEMBERS) if len(one) > _CUT_TO and one.startswith(name[:_CUT_TO])]
    for name in _MEMBERS
    if len(name) > _CUT_TO and name[:_CUT_TO] not in _MEMBERS
}
# Members of a gx:Track that positions do not have: with one of them it is a plan.
_OF_PLANS: Final = file_objects.TRACK_MEMBERS - {"kind", "name"}
_KML_LINE: Final = (
    "are missing: a line with a begin and an end says no time of each point; write it as gx:Track, or as a line with a "
    "column times"
)
# No service listens here, so addresses in a file lead nowhere.
_NOWHERE: Final = "http://127.0.0.1:9"
PROGRAM: Final = ConfinedProgram(
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


_LAYER: Final = ("name", "crs", "fields", "numbers", "columns", "is_high")


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer of a file.

    crs : its reference system, None if unknown
    fields : names of its columns
    numbers : of its features
    shapes : geometries as WKB, two-dimensional; None for a feature without
    columns : values by column, as JSON values; None is missing
    is_high : whether its geometries have a third coordinate
    """

    name: str
    crs: str | None
    fields: list[str]
    numbers: list[int]
    shapes: NDArray[np.object_]
    columns: list[list[Any]]
    is_high: bool = False

    @classmethod
    def of(cls, layer: Mapping[str, Any]) -> "Layer":
        """Return a layer as `ogr_child` writes it."""
        shapes = np.empty(len(layer["shapes"]), dtype=object)
        shapes[:] = [None if shape is None else bytes.fromhex(shape) for shape in layer["shapes"]]
        return cls(shapes=shapes, **{name: layer[name] for name in _LAYER})


def read_objects(
    path: Path,
    max_file_mb: float,
    max_speed_kn: float,
    names: Sequence[str] = (),
    *,
    stem: str,
    skip_invalid: bool = False,
) -> Contents:
    """Return the areas and tracks of a file that OGR opens; raises InvalidInput, also without pyogrio.

    stem : begins the ids of features that have none

    max_file_mb, max_speed_kn : see `conflictdb.formats.read`
    names : layers to read; none: all
    skip_invalid : leave out refused objects
    """
    inside = check_archive(path, max_file_mb)
    is_kml = inside is not None or path.suffix.lower() == ".kml"
    document = KmlDocument(path, inside, max_file_mb) if is_kml else None
    with nullcontext(path) if document is None else document.for_ogr(path) as readable:
        layers = read_layers(readable, max_file_mb)
    if not layers:
        raise InvalidInput("file", "", "holds no layer with geometries")
    if document is None and any(set(layer.fields) >= _KML_FIELDS for layer in layers):
        raise InvalidInput("file", "", "is KML: its name must end with .kml or .kmz")
    known = [layer.name for layer in layers]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InvalidInput("file", "layer", f"there is no layer {unknown[0]!r}; the file has {', '.join(known)}")
    chosen = [replace(layer, fields=renamed(layer.fields)) for layer in layers if not names or layer.name in names]
    contents = Contents(None, [], [], [])
    refusals = FileRefusals()
    starts = {layer.name: _start(stem, layer.name, len(layers)) for layer in layers}
    names_of = _kml_keys(layers, starts)
    timed_lines = _TimedLines(document)
    _read_features(str(path), chosen, names_of, starts, max_speed_kn, contents, refusals, timed_lines)
    if timed_lines.lines:
        with refusals:
            timed_lines.read(str(path), max_speed_kn, contents, refusals)
    if document is not None:
        contents.remarks = [*contents.remarks, *document.remarks(str(path))]
    else:
        high = sum(len(layer.numbers) for layer in chosen if layer.is_high)
        contents.remarks = [*contents.remarks, *altitudes(str(path), high)]
    if not skip_invalid:
        refusals.raise_found()
    contents.skipped.extend(left_out(str(path), refusals))
    return contents


def read_layers(path: Path, max_file_mb: float, program: ConfinedProgram = PROGRAM) -> list[Layer]:
    """Return the layers of a file that have geometries.

    Raises
    ------
    InvalidInput
        It cannot be read, exceeds `max_file_mb` or the limits of time and memory; or pyogrio is missing.
    """
    if find_spec("pyogrio") is None:
        raise InvalidInput("file", "", f"is of a format that {EXTRA}")
    program = replace(program, settings={**program.settings, "GDAL_SKIP": ",".join(_formats_to_skip())})
    if path.suffix.lower() == ".zip":
        program = replace(program, cannot_read=f"{program.cannot_read} as it is: unzip it, and load the files in it")
    elif path.is_dir():
        program = replace(program, cannot_read=f"{program.cannot_read}; name the files in this directory instead")
    with program.running([str(path.absolute())], max_file_mb) as running:
        answer: list[Mapping[str, Any]] = json.loads(running.answer())
    return [Layer.of(one) for one in answer]


@cache
def _formats_to_skip() -> tuple[str, ...]:
    try:
        with PROGRAM.running([], 0.0) as running:
            return tuple(json.loads(running.answer()))
    except InvalidInput as refused:
        raise InvalidInput("file", "", f"is of a format that {EXTRA}; it does not start: {refused.rule}") from None


def _read_features(
    source: str,
    layers: Sequence[Layer],
    names: Mapping[tuple[str, int], str],
    starts: Mapping[str, str],
    max_speed_kn: float,
    contents: Contents,
    refusals: Refusals,
    timed_lines: "_TimedLines",
) -> None:
    """Add the areas and tracks of some layers; errors are added to the refusals.

    names : the keys of some features, by layer and number
    starts : of other keys, by layer
    """
    seen: dict[str, str] = {}
    derived: set[str] = set()
    items: list[Area | Track | TrackAtSpeed] = []
    scene, long_sides = Scene("file"), LongSides()
    for layer in layers:
        numbers = layer.numbers
        start = starts[layer.name]
        keys = [names.get((layer.name, number)) or row_id(start, number) for number in numbers]
        derived.update(keys)
        for where, item in _features(source, layer, keys, scene, contents, refusals, timed_lines, long_sides):
            first = seen.setdefault(item.key, where)
            with refusals:
                if first != where:
                    raise given_twice(name_of(item), f"{first} and {where}")
                items.append(item)
    contents.remarks = list(long_sides.remarks(source))
    contents.derived = [item.key for item in items if item.key in derived]
    areas, tracks = timed(items, scene, max_speed_kn, refusals)
    contents.areas.extend(areas)
    contents.tracks.extend(tracks)


def _features(
    source: str,
    layer: Layer,
    keys: Sequence[str],
    scene: Scene,
    contents: Contents,
    refusals: Refusals,
    timed_lines: "_TimedLines",
    long_sides: LongSides,
) -> Iterator[tuple[str, Area | Track | TrackAtSpeed]]:
    """Yield the place of each object in the file, and the object.

    keys : of features without an id
    """
    who = f"layer {layer.name!r:.100}"
    check_columns(who, layer.fields)
    layer = replace(layer, fields=_whole_names(who, layer))
    shapes = _shapes(who, layer)
    if layer.crs is None:
        rule = "is unknown: the file must say its reference system (a Shapefile needs its .prj)"
        raise InvalidInput(who, "reference system", rule)
    setting = file_objects.FileContext(scene, (), of_name(who, layer.crs), RENAME_COLUMN, long_sides=long_sides)
    has_times = not TIMES_OR_SPEED.isdisjoint(name.lower() for name in layer.fields)
    others: dict[str, list[int]] = defaultdict(list)
    has_modes = set(layer.fields) >= _KML_FIELDS
    time_like: dict[str, None] = {}
    for i, number in enumerate(layer.numbers):
        shape = shapes[i]
        where = f"feature {number} of {who}"
        values = {name: column[i] for name, column in zip(layer.fields, layer.columns, strict=True)}
        above = ALTITUDE_MODES.get(values["altitudeMode"]) if has_modes else None
        if above is not None and not any(values[name] for name in values if name.lower() == file_objects.DATUM):
            values = {file_objects.DATUM: above} | {
                n: one for n, one in values.items() if n.lower() != file_objects.DATUM
            }
        if has_modes and timed_lines.document is not None:
            values = timed_lines.document.exact(values)
        kind = None if shape is None else shapely.get_type_id(shape)
        is_track = kind in LINES and has_times
        if has_modes and kind in LINES and not is_track and values["begin"] is not None and values["end"] is not None:
            timed_lines.lines.append(_TimedLine(where, values.get("id") or keys[i], shape, values, setting))
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


def _whole_names(who: str, layer: Layer) -> list[str]:
    """Return the names of columns, those whole that a Shapefile cut; raises InvalidInput for one cut from several."""
    given = {name.lower() for name in layer.fields}
    names = []
    for name, column in zip(layer.fields, layer.columns, strict=True):
        meant = [one for one in _CUT.get(name.lower(), ()) if any(can_be(value, one) for value in column)]
        if len(meant) > 1:
            rule = f"is cut to {_CUT_TO} characters: it may be {' or '.join(meant)}. {RENAME_COLUMN}"
            raise InvalidInput(who, f"column {name}", rule)
        names.append(meant[0] if meant and meant[0] not in given else name)
    return names


def _start(stem: str, layer: str, layers: int) -> str:
    """Return the start of the keys of features without one: the name of the file, and of one of several layers."""
    return stem if layers == 1 or layer == stem else f"{stem}.{layer}"


def _kml_keys(layers: Sequence[Layer], starts: Mapping[str, str]) -> dict[tuple[str, int], str]:
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
    numbers = {row_id(starts[layer.name], number) for layer in layers for number in layer.numbers}
    same = Counter(names.values())
    return {
        of: name
        for of, name in names.items()
        if same[name] == 1 and name not in numbers and len(name.encode()) <= MAX_KEY_BYTES
    }


def _shapes(who: str, layer: Layer) -> NDArray[np.object_]:
    """Return the geometries of a layer; raises InvalidInput."""
    try:
        return wkb.decoded(layer.shapes)
    except (ValueError, shapely.errors.GEOSException) as error:
        raise InvalidInput(who, "geometry", f"holds what is no simple geometry: {error}") from error


@dataclass(frozen=True, slots=True)
class _TimedLine:
    """A line of KML with a begin and an end: its place in the file, its key, shape and columns."""

    where: str
    key: str
    shape: Any
    values: Mapping[str, Any]
    setting: file_objects.FileContext

    @property
    def members(self) -> set[str]:
        """The columns that say something, in lower case."""
        own = {name: value for name, value in self.values.items() if name not in ("id", *_KML_FIELDS)}
        return {name.lower() for name, value in own.items() if value is not None}

    def track(self, key: str, line: Any, times_us: Sequence[int]) -> Track | TrackAtSpeed:
        """Return the track of a gx:Track whose columns give its haven."""
        others = {name: one for name, one in self.values.items() if name not in ("id", *_KML_FIELDS)}
        times = [format_instant(at) for at in times_us]
        return track_of_line(self.where, key, {**others, "times": times}, line, self.setting)


@dataclass(slots=True)
class _TimedLines:
    """Lines of KML with a begin and an end, and the document."""

    document: KmlDocument | None
    lines: list[_TimedLine] = field(default_factory=list)

    def read(self, source: str, max_speed_kn: float, contents: Contents, refusals: Refusals) -> None:
        """Add the tracks of lines that are a gx:Track, and refuse all others."""
        known = None if self.document is None else GxTracks(self.document.root)
        observed: list[tuple[str, Fixes]] = []
        planned: list[Area | Track | TrackAtSpeed] = []
        for one in self.lines:
            parts = shapely.get_parts(one.shape)
            for part, line in enumerate(parts, 1):
                key = one.key if len(parts) == 1 else f"{one.key}.{part}"
                positions = shapely.get_coordinates(line)
                times_us = None if known is None else known.times_us(positions)
                with refusals:
                    if times_us is None:
                        raise InvalidInput(one.where, "times", _KML_LINE)
                    if _OF_PLANS.intersection(one.members):
                        planned.append(one.track(key, line, times_us))
                        continue
                    places = [(float(lon), float(lat)) for lon, lat in positions]
                    numbers = list(range(1, len(places) + 1))
                    observed.append((key, Fixes(numbers, times_us, places, constant={"name": one.key})))
        _, sized = timed(planned, Scene("file"), max_speed_kn, refusals)
        tracks, rest, notes = tracks_of(source, observed, (), max_speed_kn, defaultdict(list))
        contents.tracks.extend([*sized, *tracks])
        contents.skipped.extend(rest)
        contents.derived = [*contents.derived, *(one.key for one in self.lines if not one.values.get("id"))]
        texts = [*((f"{SAYS_NO_SIZES}: its gx:Tracks are points",) if tracks else ()), *notes]
        contents.remarks = [*contents.remarks, *(Remark(source, "file", text) for text in texts)]
