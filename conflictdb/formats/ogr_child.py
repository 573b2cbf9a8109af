"""Read one file with the OGR library and write its layers as JSON: a program of `confined_child`.

    ogr_child.py PATH
    ogr_child.py    the formats to disable, which OGR reads from its environment when it is loaded

Some OGR formats read other files, open databases, fetch addresses or execute their contents; this process enables only
safe ones.
"""

import json
import sys
from typing import IO, Any, Final

# Self-contained formats (a Shapefile and an S-57 chart: with the files of the same name beside them). Not VRT, GML,
# GDALG, databases and services, which may refer to anything.
FORMATS: Final = frozenset(
    {"ESRI Shapefile", "FlatGeobuf", "GPKG", "GPX", "KML", "LIBKML", "MapInfo File", "OpenFileGDB", "S57"}
)
# pyogrio imports these where they are installed, for functions that are not called here: most of a second.
_NOT_NEEDED: Final = ("geopandas", "pandas", "pyarrow", "pyproj", "shapely")


def main(stream: IO[bytes], most_bytes: int, arguments: list[str]) -> None:
    """Write the layers of a file that have geometries; without arguments, the formats to disable.

    Those are the formats that OGR knows besides `FORMATS`, for GDAL_SKIP.
    """
    sys.modules.update(dict.fromkeys(_NOT_NEEDED))  # type: ignore[arg-type]  # None: not importable
    import pyogrio

    others = sorted(set(pyogrio.list_drivers()) - FORMATS)
    if not arguments:
        stream.write(json.dumps(others).encode())
        return
    if others:
        raise ValueError(f"knows formats that it should not: {', '.join(others)}")
    (path,) = arguments
    layers = []
    size = 0
    names = [str(name) for name, geometry_type in pyogrio.list_layers(path) if geometry_type is not None]
    for name in names:
        read = pyogrio.raw.read(path, layer=name, force_2d=True, return_fids=True, datetime_as_string=True)
        meta, numbers, shapes, columns = read
        layer = {
            "name": name,
            "crs": meta["crs"],
            "fields": [str(field) for field in meta["fields"]],
            "numbers": numbers.tolist(),
            "is_high": "Z" in str(meta["geometry_type"]) or "2.5D" in str(meta["geometry_type"]),
            "shapes": [None if shape is None else shape.hex() for shape in shapes],
            "columns": [[_plain(value) for value in column] for column in columns],
        }
        size += sum(len(shape) for shape in shapes if shape is not None)
        size += sum(_size(value) for column in layer["columns"] for value in column)
        if size > most_bytes:
            raise MemoryError
        layers.append(layer)
    stream.write(json.dumps(layers).encode())


def _size(value: Any) -> int:
    """Return the size of a column's value in bytes; non-texts count at least as a reference."""
    if isinstance(value, str):
        return len(value.encode("utf-8", "replace"))
    return 8 + (sum(map(_size, value)) if isinstance(value, list) else 0)


def _plain(value: Any) -> Any:
    """Return a value of a column as a JSON value; NaN marks missing numbers."""
    if hasattr(value, "tolist"):  # of numpy
        value = value.tolist()
    if isinstance(value, list):
        return [_plain(member) for member in value]
    if isinstance(value, bytes):
        return value.hex()
    return None if isinstance(value, float) and value != value else value
