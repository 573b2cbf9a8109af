"""Reads vector tiles, as GDAL does."""

import tempfile
from pathlib import Path
from typing import Any

import pyogrio
import shapely

Feature = tuple[dict[str, Any], shapely.Geometry]


def decode(tile: bytes) -> dict[str, list[Feature]]:
    """Return the features of each layer of a tile: fields, and geometry in units of the tile, y up from its foot."""
    if not tile:
        return {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "tile.mvt"
        file.write_bytes(tile)
        found = {}
        for layer, _ in pyogrio.list_layers(file):
            meta, _, shapes, columns = pyogrio.raw.read(file, layer=layer)
            found[layer] = [
                ({name: column[n] for name, column in zip(meta["fields"], columns, strict=True)}, shape)
                for n, shape in enumerate(shapely.from_wkb(shapes))
            ]
    return found
