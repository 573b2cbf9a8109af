"""Writes files that OGR opens, with pyogrio alone."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

pyogrio = pytest.importorskip("pyogrio", reason="the extra 'ogr' is not installed")


def write_layer(
    path: Path, shapes: list[Any], layer: str = "", crs: str | None = "EPSG:4326", kind: str = "Unknown", **columns: Any
) -> Path:
    """Write features as a layer, after those of an existing file; by default it has the name of the file."""
    pyogrio.raw.write(
        path,
        geometry=np.array([None if shape is None else shapely.to_wkb(shape) for shape in shapes], dtype=object),
        field_data=[
            np.array(column, object if isinstance(column[0], str | None) else None) for column in columns.values()
        ],
        fields=np.array(list(columns), dtype=object),
        geometry_type=kind,
        layer=layer or path.stem,
        crs=crs,
        append=path.exists(),
    )
    return path
