"""Areas from anything that the OGR library opens (GeoPackage, Shapefile, KML, …), through pyogrio.

Needs the extra `ogr`: ``pip install 'conflictdb[ogr]'``. Every polygon of every layer becomes an area; the columns
``id``, ``name``, ``start`` (or ``begin``), ``end``, ``floor_m`` and ``ceiling_m``, in upper or lower case, are read as
in scene files, all others are kept as properties. Without an id column the number of the feature is the id, after the
name of its layer if there are several. Other reference systems are transformed vertex by vertex to longitude and
latitude; edges are then straight in the scene's plane.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.io.contents import Contents, left_out
from conflictdb.io.fields import Fields
from conflictdb.io.fields import key as checked_key
from conflictdb.io.names import RENAME_COLUMN
from conflictdb.io.objects import area_members
from conflictdb.model import Area

COLUMNS: Final = ("id", "name", "start", "end", "floor_m", "ceiling_m")
ALIASES: Final = {"begin": "start"}  # of KML
LONGITUDE_LATITUDE: Final = frozenset({"EPSG:4326", "EPSG:4979", "OGC:CRS84"})
EXTRA: Final = "needs the extra 'ogr': pip install 'conflictdb[ogr]'"
_POLYGONS: Final = frozenset({shapely.GeometryType.POLYGON, shapely.GeometryType.MULTIPOLYGON})


def read_areas(path: Path, *, skip_invalid: bool = False) -> Contents:
    """Return the areas of a file that OGR opens; raises InvalidInput, also if pyogrio is not installed.

    skip_invalid : leave out areas that are refused
    """
    try:
        import pyogrio
    except ImportError:
        raise InvalidInput("file", "", f"is of a format that {EXTRA}") from None
    contents = Contents(None, [], [], [])
    refusals = Refusals()
    seen: dict[str, str] = {}
    try:
        layers = [str(name) for name, geometry_type in pyogrio.list_layers(path) if geometry_type is not None]
        if not layers:
            raise InvalidInput("file", "", "holds no layer with geometries")
        for layer in layers:
            read = pyogrio.raw.read(path, layer=layer, force_2d=True, return_fids=True, datetime_as_string=True)
            prefix = f"{layer}." if len(layers) > 1 else ""
            for where, area in _areas(layer, prefix, refusals, *read):
                first = seen.setdefault(area.key, where)
                with refusals:
                    if first != where:
                        rule = f"is given twice, by {first} and {where}; ids must be unique in the scene"
                        raise InvalidInput(f"area {area.key!r}", "id", rule)
                    contents.areas.append(area)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, pyogrio.errors.FeatureError) as error:
        raise InvalidInput("file", "", f"cannot be read by OGR: {error}") from error
    if not skip_invalid:
        refusals.settle()
    contents.skipped.extend(left_out(str(path), refusals))
    return contents


def _areas(
    layer: str, prefix: str, refusals: Refusals, meta: Mapping[str, Any], numbers: Any, wkb: Any, columns: Any
) -> Iterator[tuple[str, Area]]:
    """Yield where each area is in the file, and the area; what is refused is among the refusals."""
    try:
        shapes = shapely.from_wkb(wkb)
    except shapely.errors.GEOSException as error:
        raise InvalidInput(f"layer {layer!r}", "geometry", f"holds what is no simple geometry: {error}") from error
    shapes = _to_longitude_latitude(layer, shapes, meta["crs"])
    names = [_column(str(name)) for name in meta["fields"]]
    for i, number in enumerate(numbers):
        where = f"feature {number} of layer {layer!r}"
        values = {name: _plain(column[i]) for name, column in zip(names, columns, strict=True)}
        with refusals:
            yield where, _area(where, f"{prefix}{number}", values, shapes[i])


def _area(where: str, number: str, values: dict[str, Any], shape: Any) -> Area:
    """Return the area of a feature; `number` is its key if it has none."""
    key = values.pop("id", None)
    if isinstance(key, float | int) and not isinstance(key, bool):
        key = str(int(key)) if float(key).is_integer() else repr(key)
    if key is None or key == "":
        key = number
    key = checked_key(where, "id", key)
    fields = Fields(f"area {key!r}", values)
    with fields.refusals:
        if shape is None or shape.is_empty:
            raise InvalidInput(where, "geometry", "must be a non-empty Polygon or MultiPolygon; there is none")
        if shapely.get_type_id(shape) not in _POLYGONS:
            raise InvalidInput(where, "geometry", f"must be a Polygon or MultiPolygon; got a {shape.geom_type}")
    members = area_members(fields, remedy=RENAME_COLUMN)
    fields.settle()
    return Area(key, shape if isinstance(shape, shapely.MultiPolygon) else shapely.MultiPolygon([shape]), **members)


def _column(name: str) -> str:
    lower = ALIASES.get(name.lower(), name.lower())
    return lower if lower in COLUMNS else name


def _to_longitude_latitude(layer: str, shapes: Any, crs: str | None) -> Any:
    who = f"layer {layer!r}"
    if crs is None:
        rule = "is unknown: the file must say its reference system (a Shapefile needs its .prj)"
        raise InvalidInput(who, "reference system", rule)
    if crs in LONGITUDE_LATITUDE:
        return shapes
    try:
        import pyproj
    except ImportError:
        raise InvalidInput(who, "reference system", f"is {crs:.60}; to transform it {EXTRA}") from None
    try:
        transformer = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise InvalidInput(who, "reference system", f"is not known to PROJ: {crs:.60}") from error
    return shapely.transform(shapes, lambda xy: np.column_stack(transformer.transform(xy[:, 0], xy[:, 1])))


def _plain(value: Any) -> Any:
    """Return a value of a column as JSON can hold it; NaN is how missing numbers come."""
    if isinstance(value, np.ndarray):
        return [_plain(member) for member in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bytes):
        return value.hex()
    return None if isinstance(value, float) and np.isnan(value) else value
