"""Areas from files that the OGR library opens (GeoPackage, Shapefile, KML, …), through pyogrio.

Needs the extra `ogr`: ``pip install 'conflictdb[ogr]'``. Every polygon of every layer becomes an area; the columns
``id``, ``name``, ``start`` (or ``begin``), ``end``, ``floor_m`` and ``ceiling_m``, in upper or lower case, are read as
in scene files, all others are kept as properties. Without an id column the number of the feature is the id, after the
name of its layer if there are several. Other reference systems are transformed vertex by vertex to longitude and
latitude; edges are then straight in the scene's plane.
"""

from collections.abc import Iterator
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
from conflictdb.io.ogr_process import EXTRA, Layer, read_layers
from conflictdb.model import Area

COLUMNS: Final = ("id", "name", "start", "end", "floor_m", "ceiling_m")
ALIASES: Final = {"begin": "start"}  # of KML
LONGITUDE_LATITUDE: Final = frozenset({"EPSG:4326", "EPSG:4979", "OGC:CRS84"})
_POLYGONS: Final = frozenset({shapely.GeometryType.POLYGON, shapely.GeometryType.MULTIPOLYGON})


def read_areas(path: Path, max_file_mb: float, *, skip_invalid: bool = False) -> Contents:
    """Return the areas of a file that OGR opens; raises InvalidInput, also if pyogrio is not installed.

    max_file_mb : see `conflictdb.io.read`
    skip_invalid : leave out areas that are refused
    """
    contents = Contents(None, [], [], [])
    refusals = Refusals()
    seen: dict[str, str] = {}
    layers = read_layers(path, max_file_mb)
    if not layers:
        raise InvalidInput("file", "", "holds no layer with geometries")
    for layer in layers:
        prefix = f"{layer.name}." if len(layers) > 1 else ""
        for where, area in _areas(layer, prefix, refusals):
            first = seen.setdefault(area.key, where)
            with refusals:
                if first != where:
                    rule = f"is given twice, by {first} and {where}; ids must be unique in the scene"
                    raise InvalidInput(f"area {area.key!r}", "id", rule)
                contents.areas.append(area)
    if not skip_invalid:
        refusals.settle()
    contents.skipped.extend(left_out(str(path), refusals))
    return contents


def _areas(layer: Layer, prefix: str, refusals: Refusals) -> Iterator[tuple[str, Area]]:
    """Yield where each area is in the file, and the area; what is refused is among the refusals."""
    who = f"layer {layer.name!r}"
    try:
        shapes = shapely.from_wkb(layer.shapes)
    except shapely.errors.GEOSException as error:
        raise InvalidInput(who, "geometry", f"holds what is no simple geometry: {error}") from error
    shapes = _to_longitude_latitude(who, shapes, layer.crs)
    names = [_column(name) for name in layer.fields]
    for i, number in enumerate(layer.numbers):
        where = f"feature {number} of {who}"
        values = {name: column[i] for name, column in zip(names, layer.columns, strict=True)}
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


def _to_longitude_latitude(who: str, shapes: Any, crs: str | None) -> Any:
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
