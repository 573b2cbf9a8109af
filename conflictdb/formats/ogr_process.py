"""Open files with the OGR library in a confined process: see `confined` and `ogr_child`."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.formats.confined import Program
from conflictdb.formats.reference import EXTRA

# No service listens here, so addresses in a file lead nowhere.
_NOWHERE: Final = "http://127.0.0.1:9"
_OGR: Final = Program(
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


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer of a file.

    crs : its reference system, None if unknown
    fields : names of its columns
    numbers : of its features
    shapes : geometries as WKB, two-dimensional; None for a feature without
    columns : values by column, as JSON values; None is missing
    """

    name: str
    crs: str | None
    fields: list[str]
    numbers: list[int]
    shapes: NDArray[np.object_]
    columns: list[list[Any]]


def read_layers(path: Path, max_file_mb: float) -> list[Layer]:
    """Return the layers of a file that have geometries.

    Raises
    ------
    InvalidInput
        It cannot be read, exceeds `max_file_mb` or the limits of time and memory; or pyogrio is missing.
    """
    if find_spec("pyogrio") is None:
        raise InvalidInput("file", "", f"is of a format that {EXTRA}")
    program = replace(_OGR, settings={**_OGR.settings, "GDAL_SKIP": ",".join(_others())})
    with program.running([str(path.absolute())], max_file_mb) as running:
        answer: list[Mapping[str, Any]] = json.loads(running.answer())
    return [_layer(one) for one in answer]


@cache
def _others() -> tuple[str, ...]:
    """Return the OGR formats to disable."""
    try:
        with _OGR.running([], 0.0) as running:
            return tuple(json.loads(running.answer()))
    except InvalidInput as refused:
        raise InvalidInput("file", "", f"is of a format that {EXTRA}; it does not start: {refused.rule}") from None


def _layer(one: Mapping[str, Any]) -> Layer:
    shapes = np.empty(len(one["shapes"]), dtype=object)
    shapes[:] = [None if shape is None else bytes.fromhex(shape) for shape in one["shapes"]]
    return Layer(one["name"], one["crs"], one["fields"], one["numbers"], shapes, one["columns"])
