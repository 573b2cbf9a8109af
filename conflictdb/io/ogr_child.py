"""Reads one file with the OGR library in a process of its own, and writes what it holds to stdout as JSON.

OGR knows formats that read other files, open databases, fetch addresses or run what they hold, and a small archive can
hold gigabytes. So this process knows few formats, has an environment of its own, cannot write files, and may use only
so much memory and time; `ogr_process` starts it, gives it its limits and reads what it says. It imports nothing of the
package, which takes longer than reading a file.

    ogr_child.py PATH MOST_BYTES MOST_MEMORY_BYTES MOST_SECONDS
    ogr_child.py FORMATS    the formats to leave out, which OGR takes from its environment when it is loaded
"""

import json
import resource
import sys
from typing import Any, Final

# Formats that hold all they have in themselves (a Shapefile and an S-57 chart: in the files that lie beside them under
# the same name). Not VRT, GML, GDALG, databases and services, which may refer to anything.
FORMATS: Final = frozenset(
    {"ESRI Shapefile", "FlatGeobuf", "GPKG", "GPX", "KML", "LIBKML", "MapInfo File", "OpenFileGDB", "S57"}
)


def main(path: str, most_bytes: int, most_memory_bytes: int, most_seconds: int) -> dict[str, Any]:
    """Return the layers of a file that have geometries, or why there are none: ``refused``."""
    for what, most in (
        (resource.RLIMIT_AS, most_memory_bytes),
        (resource.RLIMIT_CPU, most_seconds),
        (resource.RLIMIT_FSIZE, 0),  # of regular files; a pipe is none
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, most))
    import pyogrio

    others = set(pyogrio.list_drivers()) - FORMATS
    if others:
        return {"refused": f"knows formats that it should not: {', '.join(sorted(others))}"}
    layers = []
    size = 0
    try:
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
            size += sum(len(value) for column in layer["columns"] for value in column if isinstance(value, str))
            if size > most_bytes:
                return {"too_large": True}
            layers.append(layer)
    except MemoryError:
        return {"too_large": True}
    except Exception as error:  # whatever it is, this file cannot be read
        return {"refused": str(error)}
    return {"layers": layers}


def _plain(value: Any) -> Any:
    """Return a value of a column as JSON can hold it; NaN is how missing numbers come."""
    if hasattr(value, "tolist"):  # of numpy
        value = value.tolist()
    if isinstance(value, list):
        return [_plain(member) for member in value]
    if isinstance(value, bytes):
        return value.hex()
    return None if isinstance(value, float) and value != value else value


def others() -> list[str]:
    """Return the formats that OGR knows here beyond those it shall know: what GDAL_SKIP takes."""
    import pyogrio

    return sorted(set(pyogrio.list_drivers()) - FORMATS)


if __name__ == "__main__":
    path, *limits = sys.argv[1:]
    json.dump(main(path, *map(int, limits)) if limits else others(), sys.stdout)
