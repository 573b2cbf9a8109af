"""Read and write the metadata of GeoParquet (1.0, 1.1): geometry columns, their encoding and reference system.

Without metadata a column `geometry` of WKB is used.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.arrow.columns import lists, numbers
from conflictdb.arrays.arrow.forms import Array
from conflictdb.errors import InvalidInput
from conflictdb.formats import wkb
from conflictdb.formats.reference import ToDegrees, of_name

VERSION: Final = "1.1.0"
METADATA_KEY: Final = b"geo"
GEOMETRY: Final = "geometry"
COVERING: Final = "bbox"
PLANAR: Final = "planar"
SIDES: Final = ("xmin", "ymin", "xmax", "ymax")
# Longitude and latitude on WGS84 in PROJJSON: GeoParquet's default.
CRS84: Final[Mapping[str, Any]] = {
    "$schema": "https://proj.org/schemas/v0.7/projjson.schema.json",
    "type": "GeographicCRS",
    "name": "WGS 84 (CRS84)",
    "datum_ensemble": {
        "name": "World Geodetic System 1984 ensemble",
        "members": [
            {"name": "World Geodetic System 1984 (Transit)", "id": {"authority": "EPSG", "code": 1166}},
            {"name": "World Geodetic System 1984 (G730)", "id": {"authority": "EPSG", "code": 1152}},
            {"name": "World Geodetic System 1984 (G873)", "id": {"authority": "EPSG", "code": 1153}},
            {"name": "World Geodetic System 1984 (G1150)", "id": {"authority": "EPSG", "code": 1154}},
            {"name": "World Geodetic System 1984 (G1674)", "id": {"authority": "EPSG", "code": 1155}},
            {"name": "World Geodetic System 1984 (G1762)", "id": {"authority": "EPSG", "code": 1156}},
            {"name": "World Geodetic System 1984 (G2139)", "id": {"authority": "EPSG", "code": 1309}},
        ],
        "ellipsoid": {"name": "WGS 84", "semi_major_axis": 6378137, "inverse_flattening": 298.257223563},
        "accuracy": "2.0",
        "id": {"authority": "EPSG", "code": 6326},
    },
    "coordinate_system": {
        "subtype": "ellipsoidal",
        "axis": [
            {"name": "Geodetic longitude", "abbreviation": "Lon", "direction": "east", "unit": "degree"},
            {"name": "Geodetic latitude", "abbreviation": "Lat", "direction": "north", "unit": "degree"},
        ],
    },
    "scope": "Not known.",
    "area": "World.",
    "bbox": {"south_latitude": -90, "west_longitude": -180, "north_latitude": 90, "east_longitude": 180},
    "id": {"authority": "OGC", "code": "CRS84"},
}
# Encodings of GeoArrow: the kind of geometry, and the nesting depth of its coordinate lists.
_NATIVE: Final = {
    "point": (shapely.GeometryType.POINT, 0),
    "linestring": (shapely.GeometryType.LINESTRING, 1),
    "polygon": (shapely.GeometryType.POLYGON, 2),
    "multipoint": (shapely.GeometryType.MULTIPOINT, 1),
    "multilinestring": (shapely.GeometryType.MULTILINESTRING, 2),
    "multipolygon": (shapely.GeometryType.MULTIPOLYGON, 3),
}


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of a file.

    geometry : name of the geometry column, None if it has none
    encoding : WKB, or one of GeoArrow
    to_degrees : conversion of coordinates to longitude and latitude
    aside : ignored columns: boxes, and further geometries
    is_sure : whether the file names its reference system
    edges : as the file names them; ignored, since edges follow the motion of the scene
    epoch : of the coordinates, a year, not applied; None: the file names none
    """

    geometry: str | None
    encoding: str
    to_degrees: ToDegrees
    aside: frozenset[str]
    is_sure: bool
    edges: str = PLANAR
    epoch: float | None = None

    @classmethod
    def of(cls, schema: "pa.Schema") -> "Layout":
        """Parse the metadata of a schema; raises InvalidInput if they are invalid or name an unknown CRS."""
        text = (schema.metadata or {}).get(METADATA_KEY)
        if text is None:
            return cls(GEOMETRY if GEOMETRY in schema.names else None, "WKB", None, frozenset(), is_sure=False)
        try:
            geo = json.loads(text)
            primary = geo["primary_column"]
            column, columns = geo["columns"][primary], dict(geo["columns"])
        except (ValueError, KeyError, TypeError, RecursionError):
            raise InvalidInput("file", "metadata geo", "must be the JSON that GeoParquet says it is") from None
        if primary not in schema.names or not isinstance(column, dict):
            raise InvalidInput("file", "metadata geo", f"names a geometry column that is not there: {primary!r:.60}")
        encoding = column.get("encoding")
        if encoding != "WKB" and encoding not in _NATIVE:
            known = ", ".join(("WKB", *_NATIVE))
            raise InvalidInput("file", "metadata geo", f"encoding must be one of {known}; got {encoding!r:.60}")
        edges, epoch = column.get("edges", PLANAR), column.get("epoch")
        if not isinstance(edges, str):
            raise InvalidInput("file", "metadata geo", f"edges must be a text; got {edges!r:.60}")
        if epoch is not None and (isinstance(epoch, bool) or not isinstance(epoch, int | float)):
            raise InvalidInput("file", "metadata geo", f"epoch must be a year, a number; got {epoch!r:.60}")
        crs = column.get("crs", CRS84)
        return cls(
            geometry=primary,
            encoding=encoding,
            to_degrees=None if crs is None else of_name("file", _name_of(crs)),
            aside=frozenset(name for name in columns if name != primary) | _covering(column),
            is_sure=crs is not None,
            edges=edges,
            epoch=epoch,
        )

    def in_degrees(self, column: Array, first_row: int) -> Array:
        """Return a column of WKB in longitude and latitude, the same column if it already is; raises InvalidInput.

        first_row : number of the first row in messages
        """
        to_degrees = self.to_degrees
        if to_degrees is None and self.encoding == "WKB":
            return column
        shapes = self.shapes(column, first_row)
        if to_degrees is not None:
            shapes = shapely.transform(shapes, to_degrees)
        return pa.array(shapely.to_wkb(shapes, flavor="iso"), pa.binary())

    def shapes(self, column: Array, first_row: int) -> NDArray[np.object_]:
        """Return the geometries of a column (n,), None where there is none; raises InvalidInput for invalid ones.

        first_row : number of the first row in messages
        """
        try:
            if self.encoding != "WKB":
                return _native(column, *_NATIVE[self.encoding])
            return wkb.decoded(column.to_pylist(), first_row)
        except (
            shapely.errors.GEOSException,
            TypeError,
            ValueError,
            KeyError,
            AttributeError,
            pa.ArrowException,
        ) as error:
            rule = f"holds what is no geometry in {self.encoding}: {error}"
            raise InvalidInput("file", f"column {self.geometry}", rule) from error


def _name_of(crs: Any) -> str:
    """Return the code of a reference system in PROJJSON, or its text."""
    if isinstance(crs, str):
        return crs
    known = crs.get("id") if isinstance(crs, dict) else None
    if isinstance(known, dict) and "authority" in known and "code" in known:
        return f"{known['authority']}:{known['code']}"
    return json.dumps(crs)


def _covering(column: Mapping[str, Any]) -> frozenset[str]:
    """Return the names of the columns with the bounding boxes of geometries."""
    covering = column.get("covering")
    boxes = covering.get("bbox") if isinstance(covering, dict) else None
    paths = boxes.values() if isinstance(boxes, dict) else ()
    return frozenset(path[0] for path in paths if isinstance(path, list) and path and isinstance(path[0], str))


def _native(column: Array, kind: shapely.GeometryType, depth: int) -> NDArray[np.object_]:
    """Return the geometries of a column of GeoArrow with separate coordinates."""
    known = numbers(column.is_valid())
    inner, bounds = column.drop_null(), []
    while isinstance(inner, pa.ListArray | pa.LargeListArray):
        inner, offset = lists(inner)
        bounds.append(offset)
    if len(bounds) != depth or not pa.types.is_struct(inner.type):
        raise ValueError(f"its type must be {depth} lists of structs of x and y; got {column.type}")
    names = [field.name for field in inner.type]
    ordinates = [name for name in ("x", "y", "z") if name in names]
    coordinates = np.column_stack([numbers(inner.field(name)).astype(np.float64) for name in ordinates])
    shapes = np.full(len(column), None, dtype=object)
    if "m" in names and kind == shapely.GeometryType.LINESTRING:
        xym = np.column_stack([coordinates[:, :2], numbers(inner.field("m"))])
        shapes[known] = [shapely.from_wkb(_line_m(xym[i:j])) for i, j in zip(bounds[0], bounds[0][1:], strict=False)]
    else:
        shapes[known] = shapely.from_ragged_array(kind, coordinates, tuple(reversed(bounds)) or None)
    return shapes


def _line_m(xym: NDArray[np.float64]) -> bytes:
    return np.array([(1, 2002, len(xym))], "u1,<u4,<u4").tobytes() + xym.astype("<f8").tobytes()


def metadata(bounds: NDArray[np.float64], kinds: list[str], others: Mapping[str, list[str]], primary: str) -> bytes:
    """Return the metadata `geo` of a file being written.

    bounds : (4,) west, south, east, north of all geometries of the primary column; NaN if there is none
    kinds : types of its geometries
    others : types of the geometries of other columns
    """
    column: dict[str, Any] = {"encoding": "WKB", "geometry_types": kinds, "crs": CRS84}
    if np.isfinite(bounds).all():
        column["bbox"] = bounds.tolist()
    covering = {"covering": {"bbox": {side: [COVERING, side] for side in SIDES}}} if not others else {}
    columns = {primary: column | covering}
    columns |= {name: {"encoding": "WKB", "geometry_types": of, "crs": CRS84} for name, of in others.items()}
    return json.dumps({"version": VERSION, "primary_column": primary, "columns": columns}).encode()
