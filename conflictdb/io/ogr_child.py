"""Reads one file with the OGR library, and writes what it holds as JSON: a program of `confined_child`.

    ogr_child.py PATH
    ogr_child.py    the formats to leave out, which OGR takes from its environment when it is loaded

OGR knows formats that read other files, open databases, fetch addresses or run what they hold, so this process knows
few of them.
"""

import json
from typing import IO, Any, Final

# Formats that hold all they have in themselves (a Shapefile and an S-57 chart: in the files that lie beside them under
# the same name). Not VRT, GML, GDALG, databases and services, which may refer to anything.
FORMATS: Final = frozenset(
    {"ESRI Shapefile", "FlatGeobuf", "GPKG", "GPX", "KML", "LIBKML", "MapInfo File", "OpenFileGDB", "S57"}
)


def main(stream: IO[bytes], most_bytes: int, arguments: list[str]) -> None:
    """Write the layers of a file that have geometries; without arguments the formats that are left out.

    OGR knows these here beyond `FORMATS`: what GDAL_SKIP takes.
    """
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
    """Return the bytes of a value of a column; what is no text takes at least a reference."""
    if isinstance(value, str):
        return len(value.encode("utf-8", "replace"))
    return 8 + (sum(map(_size, value)) if isinstance(value, list) else 0)


def _plain(value: Any) -> Any:
    """Return a value of a column as JSON can hold it; NaN is how missing numbers come."""
    if hasattr(value, "tolist"):  # of numpy
        value = value.tolist()
    if isinstance(value, list):
        return [_plain(member) for member in value]
    if isinstance(value, bytes):
        return value.hex()
    return None if isinstance(value, float) and value != value else value
