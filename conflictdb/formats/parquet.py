"""Read areas and tracks from Parquet files: GeoParquet, files of `export`, and plain columns of positions.

Needs the extra `parquet`. A file of the Arrow form OBJECTS, from any writer, is read as exactly these objects. In other
files, columns have the names and meanings of scene files: see docs/reference/files.md.
"""

import csv
import json
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import StringIO
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.arrow.forms import METADATA_KEY, metadata_of
from conflictdb.arrays.arrow.object_rows import OBJECTS, to_objects
from conflictdb.errors import InvalidInput, Refusals
from conflictdb.formats import file_objects
from conflictdb.formats.arrow_values import check_wkb, leaves, plain
from conflictdb.formats.contents import (
    TOO_LARGE,
    Contents,
    Parts,
    Remark,
    Skipped,
    check_columns,
    given_twice,
    left_out,
    name_of,
    row_id,
    rows_apart,
)
from conflictdb.formats.features import (
    LINES,
    POINTS,
    TIMES_OR_SPEED,
    area_of_circle,
    area_of_polygon,
    track_of_line,
    unusable,
)
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.fields import number_as_key
from conflictdb.formats.geoparquet import COVERING, GEOMETRY, PLANAR, Layout
from conflictdb.formats.geoparquet import METADATA_KEY as METADATA_GEO
from conflictdb.formats.hints import renamed
from conflictdb.formats.instants import format_instant
from conflictdb.formats.json_text import check_storable, check_text
from conflictdb.formats.names import RENAME_COLUMN
from conflictdb.formats.parquet_process import decoded
from conflictdb.formats.positions import COLUMNS, read_positions
from conflictdb.formats.rings import LongSides
from conflictdb.formats.scene_file import scene_of
from conflictdb.formats.standards import altitudes
from conflictdb.formats.time_columns import is_time_like, without_times
from conflictdb.formats.track_times import MAX_DURATION_S, TrackAtSpeed, timed
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Kind
from conflictdb.model.speed_limits import MAX_SPEED_KN

# Limit on a file in Arrow format; as objects it takes five times that memory, JSON thirty times.
MAX_PARQUET_MB: Final = 400.0
_INDEX: Final = "__index_level_0__"  # of pandas
_UNSURE: Final = "does not say its reference system: taken for longitude and latitude on WGS84"


# Returns the first row with an object's key, given the present row.
First = Callable[[str, int], int]


@dataclass(slots=True)
class _Found:
    """The objects of a part.

    stem : begins the ids of rows without one; `derived` has the first of these
    others : rows of unusable geometry, by type, over all parts
    time_like : the columns of lines among them that look like times
    high : rows with a third coordinate
    """

    refusals: Refusals
    first: First
    settings: Scene | None
    fastest_kn: float
    stem: str = ""
    derived: list[str] = field(default_factory=list)
    source: str = ""
    remarks: list[Remark] = field(default_factory=list)
    items: list[Area | Track | TrackAtSpeed] = field(default_factory=list)
    others: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    time_like: dict[str, None] = field(default_factory=dict)
    high: int = 0

    def add(self, row: int, item: Area | Track | TrackAtSpeed) -> None:
        """Add the object of a row; refuse an id that an earlier row has."""
        first = self.first(item.key, row)
        with self.refusals:
            if first != row:
                raise given_twice(name_of(item), rows_apart(first, row))
            self.items.append(item)

    def parts(self, reads: Iterator[None]) -> Iterator[tuple[list[Area], list[Track]]]:
        """Yield the objects that each read has added."""
        for _ in reads:
            items, self.items = self.items, []
            yield timed(items, self.settings or Scene("file"), self.fastest_kn, self.refusals)


def read_parquet(
    path: Path,
    stem: str,
    max_file_mb: float | None,
    max_speed_kn: float | None,
    *,
    skip_invalid: bool,
) -> Contents:
    """Return the areas and tracks of a Parquet file, or of the parts in a directory; raises InvalidInput.

    max_file_mb, max_speed_kn, skip_invalid : see `conflictdb.formats.read`
    stem : name of the scene if the file has settings without a name
    """
    first: dict[str, int] = {}
    most_mb = MAX_PARQUET_MB if max_file_mb is None else max_file_mb
    most = most_mb, most_mb
    areas: list[Area] = []
    tracks: list[Track] = []
    with parquet_parts(path, stem, most, max_speed_kn, first.setdefault) as parts:
        for some_areas, some_tracks in parts.each:
            areas += some_areas
            tracks += some_tracks
    if not skip_invalid:
        parts.refusals.raise_found()
    contents = Contents(parts.settings, areas, tracks, [*left_out(str(path), parts.refusals), *parts.skipped])
    contents.remarks = parts.remarks
    contents.derived = parts.derived
    return contents


@contextmanager
def parquet_parts(
    path: Path, stem: str, most_mb: tuple[float, float], max_speed_kn: float | None, first: First
) -> Iterator[Parts]:
    """Yield the result of `read_parquet` in parts; a file of rows per waypoint is a single part.

    most_mb : limits in Arrow format: of a file, and of a file that is a single part
    first : returns the first row that has a key
    """
    source = str(path)
    fastest_kn = MAX_SPEED_KN if max_speed_kn is None else max_speed_kn
    with decoded(path, most_mb[0]) as rows:
        schema = rows.schema
        check_columns("file", list(leaves("", schema)))
        metadata = metadata_of("file", schema)
        settings = scene_of(metadata["scene"], stem) if metadata.get("scene") is not None else None
        parts = Parts(settings, iter(()))
        found = _Found(parts.refusals, first, settings, fastest_kn, stem, parts.derived, source, parts.remarks)
        layout = Layout.of(schema)
        is_own = metadata.get("form") == OBJECTS.name
        if is_own or _fits(schema):
            if layout.geometry not in (None, GEOMETRY):
                rule = f"primary_column must be {GEOMETRY}, as the other columns are; got {layout.geometry!r:.60}"
                raise InvalidInput("file", "metadata geo", rule)
            parts.remarks += _remarks(source, layout, is_sure=is_own and METADATA_GEO not in (schema.metadata or {}))
            parts.each = found.parts(_read_form(found, rows.batches, metadata, layout))
        else:
            parts.remarks += _remarks(source, layout, is_sure=False)
            first_rows, batches = _from_first_rows(rows.batches)
            if _are_positions(first_rows, layout):
                text = _csv_text(_bounded(batches, most_mb[1]), layout)
                contents = read_positions(text, source, max_speed_kn=max_speed_kn)
                parts.remarks[:0] = contents.remarks
                parts.skipped += contents.skipped
                parts.each = iter([(contents.areas, contents.tracks)])
            elif layout.geometry is None:
                rule = "there is none: no metadata of GeoParquet, no column geometry, no lon and lat with a time; got "
                raise InvalidInput("file", "geometry", rule + ", ".join(schema.names[:20]))
            else:
                objects = found.parts(_read_rows(found, batches, layout))
                parts.each = chain(objects, _unusable_rows(found, source, parts.skipped))
        yield parts


def _remarks(source: str, layout: Layout, *, is_sure: bool) -> Iterator[Remark]:
    """Yield remarks on the metadata of GeoParquet.

    is_sure : coordinates are known to be longitude and latitude
    """
    if layout.geometry is None:
        return
    if not (is_sure or layout.is_sure):
        yield Remark(source, "file", _UNSURE)
    if layout.edges != PLANAR:
        edges = "great circles" if layout.edges == "spherical" else repr(layout.edges[:60])
        yield Remark(source, "file", f"says that edges are {edges}; here they are what the motion of the scene says")
    if layout.epoch is not None:
        text = f"says that its coordinates are of epoch {layout.epoch:g}; they are used as they are"
        yield Remark(source, "file", text)


def _bounded(batches: "Iterator[pa.RecordBatch]", most_mb: float) -> "Iterator[pa.RecordBatch]":
    """Yield batches; raises InvalidInput above the memory limit."""
    size = 0
    for batch in batches:
        size += batch.nbytes
        if size > most_mb * 1e6:
            rule = f"holds more than {most_mb:g} MB of rows per waypoint{TOO_LARGE}"
            raise InvalidInput("file", "", rule)
        yield batch


def _read_rows(found: _Found, batches: "Iterator[pa.RecordBatch]", layout: Layout) -> Iterator[None]:
    """Read rows, one object each, in batches."""
    sides = LongSides() if found.settings is None and layout.edges == PLANAR else None
    setting = file_objects.FileContext.of_settings(
        found.settings, "file", (), layout.to_degrees, RENAME_COLUMN, long_sides=sides
    )
    row = 0
    for batch in batches:
        _add_rows(found, batch, row, layout, setting)
        row += batch.num_rows
        yield
    found.remarks += [] if sides is None else sides.remarks(found.source)
    found.remarks += altitudes(found.source, found.high)


def _unusable_rows(found: _Found, source: str, skipped: list[Skipped]) -> Iterator[tuple[list[Area], list[Track]]]:
    """List the rows left out by geometry; yields nothing."""
    skipped.extend(unusable(source, "file", "rows", found.others, without_times(found.time_like)))
    yield from ()


def _fits(schema: "pa.Schema") -> bool:
    if not set(schema.names) <= {*OBJECTS.schema.names, COVERING}:
        return False
    try:
        OBJECTS.columns(schema.empty_table())
    except InvalidInput:
        return False
    return True


def _read_form(
    found: _Found, batches: "Iterator[pa.RecordBatch]", metadata: dict[str, Any], layout: Layout
) -> Iterator[None]:
    """Read the objects of a file of the form OBJECTS, in batches."""
    row = 0
    known = {METADATA_KEY: json.dumps({k: v for k, v in metadata.items() if k != "scene"})}
    for batch in batches:
        batch = batch.replace_schema_metadata(known)
        columns = OBJECTS.columns(batch, row)  # an error here concerns all rows
        check_wkb(GEOMETRY, columns[GEOMETRY], row)
        degrees = layout.in_degrees(columns[GEOMETRY], row)
        if degrees is not columns[GEOMETRY]:
            batch = batch.set_column(batch.schema.get_field_index(GEOMETRY), GEOMETRY, degrees)
        try:
            _add_checked(found, batch, row)
        except InvalidInput:
            for i in range(batch.num_rows):  # to report all errors, each with its row
                with found.refusals:
                    _add_checked(found, batch.slice(i, 1), row + i)
        row += batch.num_rows
        yield


def _add_checked(found: _Found, batch: "pa.RecordBatch", row: int) -> None:
    """Add the objects of a batch whose first row has number `row`; raises InvalidInput for the first error."""
    areas, tracks = to_objects(batch)
    items: list[Area | Track] = [*areas, *tracks]
    is_track = np.array(batch.column("kind").to_pylist()) == Kind.TRACK.value
    for item in items:
        who = name_of(item)
        checked_key(who, "id", item.key)
        if item.name is not None:
            check_text(who, "name", item.name)
        if item.properties:
            check_storable(who, "", item.properties)
    for i, item in zip(np.argsort(is_track, kind="stable").tolist(), items, strict=True):
        found.add(row + i, item)


def _from_first_rows(batches: "Iterator[pa.RecordBatch]") -> "tuple[pa.RecordBatch | None, Iterator[pa.RecordBatch]]":
    """Return the first non-empty batch, and all batches from it on."""
    for batch in batches:
        if batch.num_rows:
            return batch, chain([batch], batches)
    return None, iter(())


def _add_rows(
    found: _Found, batch: "pa.RecordBatch", row: int, layout: Layout, setting: file_objects.FileContext
) -> None:
    """Add the objects of a batch whose first row has number `row`."""
    shapes = layout.shapes(batch.column(layout.geometry), row)
    names, columns = _values(batch, {layout.geometry, *layout.aside})
    has_times = not TIMES_OR_SPEED.isdisjoint(name.lower() for name in names)
    measured = shapely.has_m(shapes)
    found.high += int((shapely.has_z(shapes) & ~np.isin(shapely.get_type_id(shapes), list(POINTS))).sum())
    for i, shape in enumerate(shapes):
        where = f"row {row + i}"
        values = {name: column[i] for name, column in zip(names, columns, strict=True)}
        index = values.pop(_INDEX, row + i)
        number = index if isinstance(index, str) else row_id(found.stem, number_as_key(index))
        if not found.derived and all(values.get(name) is None for name in names if name.lower() == "id"):
            found.derived.append(number)
        kind = None if shape is None else shapely.get_type_id(shape)
        is_track = kind in LINES and (has_times or bool(measured[i]))
        is_circle = kind == shapely.GeometryType.POINT and any(name.lower() == "radius_m" for name in names)
        if kind in POINTS | LINES and not is_track and not is_circle:
            found.others[shape.geom_type].append(row + i)
            if kind in LINES:
                found.time_like.update(dict.fromkeys(n for n, value in values.items() if is_time_like(n, value)))
            continue
        with found.refusals:
            _check_kind(where, values, is_track=is_track)
            if is_circle:
                found.add(row + i, area_of_circle(where, number, values, shape, setting))
            elif is_track:
                if measured[i] and all(values.get(name) is None for name in names if name.lower() in TIMES_OR_SPEED):
                    values = {**values, "times": _times_of(where, shape)}
                found.add(row + i, track_of_line(where, number, values, shape, setting))
            else:
                found.add(row + i, area_of_polygon(where, number, values, shape, setting))


def _check_kind(where: str, values: dict[str, Any], *, is_track: bool) -> None:
    kind = values.get("kind")
    if kind in ("area", "track") and (kind == "track") != is_track:
        rule = f"is {kind!r}, but the geometry is that of {'a track' if is_track else 'an area'}"
        raise InvalidInput(where, "kind", rule)


def _times_of(where: str, line: Any) -> list[str]:
    """Return the M of a line, seconds since 1970, as instants."""
    seconds = shapely.get_coordinates(line, include_m=True)[:, 2]
    if not (np.abs(seconds) < MAX_DURATION_S).all():
        rule = "has an M that is no number of seconds since 1970, in the years 1 to 9999"
        raise InvalidInput(where, "geometry", rule)
    try:
        return [format_instant(us) for us in np.rint(seconds * 1e6).astype(np.int64).tolist()]
    except OverflowError:
        raise InvalidInput(where, "geometry", "has an M that leaves the years 1 to 9999") from None


def _are_positions(first: "pa.RecordBatch | None", layout: Layout) -> bool:
    """Return whether rows are waypoints: with a time, and a point or lon and lat."""
    if first is None:
        return False
    lower = {name.lower() for name in renamed(first.schema.names)}
    if not lower.intersection(COLUMNS["time"]):
        return False
    if layout.geometry is None:
        return all(lower.intersection(COLUMNS[name]) for name in ("lon", "lat"))
    kinds = shapely.get_type_id(layout.shapes(first.column(layout.geometry), 0))
    return bool(np.isin(kinds, [shapely.GeometryType.POINT, shapely.GeometryType.MISSING]).all() and (kinds >= 0).any())


def _csv_text(batches: "Iterator[pa.RecordBatch]", layout: Layout) -> str:
    """Return positions as CSV text for `read_positions`; coordinates and instants keep all digits."""
    text = StringIO()
    writer = csv.writer(text)
    aside, row = {_INDEX, *layout.aside}, 0
    names: list[str] = []
    for batch in batches:
        places: list[list[Any]] = []
        if layout.geometry is not None:
            own = {name for name in batch.schema.names if name.lower() in (*COLUMNS["lon"], *COLUMNS["lat"])}
            aside |= {layout.geometry, *own}
            places = _places(layout, batch, row)
        names, columns = _values(batch, aside)
        if not row:
            writer.writerow([*names, *(("lon", "lat") if places else ())])
        is_id = [name.lower() in COLUMNS["id"] for name in names]
        texts = [[_csv_cell(value, is_id=of) for value in column] for of, column in zip(is_id, columns, strict=True)]
        writer.writerows(zip(*texts, *places, strict=True))
        row += batch.num_rows
    return text.getvalue()


def _places(layout: Layout, batch: "pa.RecordBatch", row: int) -> list[list[Any]]:
    shapes = layout.shapes(batch.column(layout.geometry), row)
    kinds = shapely.get_type_id(shapes)
    strange = np.flatnonzero(~np.isin(kinds, [shapely.GeometryType.POINT, shapely.GeometryType.MISSING]))
    if strange.size:
        i = int(strange[0])
        rule = f"must be a Point, as in the rows before, which are positions; got a {shapes[i].geom_type}"
        raise InvalidInput(f"row {row + i}", "geometry", rule)
    xy: NDArray[np.float64] = np.column_stack([shapely.get_x(shapes), shapely.get_y(shapes)])
    known = np.asarray(~np.isnan(xy).any(axis=1))
    if layout.to_degrees is not None:
        xy[known] = layout.to_degrees(xy[known])
    return [[repr(x) if ok else "" for x, ok in zip(side.tolist(), known.tolist(), strict=True)] for side in xy.T]


def _csv_cell(value: Any, *, is_id: bool) -> str:
    if value is None:
        return ""
    if is_id:
        value = number_as_key(value)
    return value if isinstance(value, str) else json.dumps(value)


def _values(batch: "pa.RecordBatch", aside: Collection[str | None]) -> tuple[list[str], list[list[Any]]]:
    """Return the names of columns, as the hints map them, and their JSON values, except columns in `aside`."""
    names = [name for name in batch.schema.names if name not in aside]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InvalidInput("file", f"column {twice}", "is there more than once")
    return renamed(names), [plain(name, batch.column(batch.schema.get_field_index(name))) for name in names]
