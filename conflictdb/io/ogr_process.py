"""Files opened by the OGR library, in a process that can do little else: see `ogr_child`."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.io.reference import EXTRA

_CHILD: Final = Path(__file__).with_name("ogr_child.py")
# What reading may use for each MB that the file may hold: sixty times what a large honest one takes, a minute and 4 GB
# in all by default.
_SECONDS_PER_MB: Final = 1.0
_MEMORY_PER_MB: Final = 64 << 20
# What Python and OGR need to be there at all.
_LEAST_SECONDS: Final = 30.0
_LEAST_MEMORY: Final = 2 << 30
# Nothing answers here: an address in a file leads nowhere.
_NOWHERE: Final = "http://127.0.0.1:9"
_SETTINGS: Final = {
    "GDAL_DRIVER_PATH": "disable",  # no plugins
    "GDAL_HTTP_PROXY": _NOWHERE,
    "GDAL_HTTPS_PROXY": _NOWHERE,
    "GDAL_HTTP_TIMEOUT": "1",
    "GDAL_HTTP_MAX_RETRY": "0",
    "CPL_VSIL_CURL_ALLOWED_EXTENSIONS": "{none}",
    "OGR_SQLITE_LOAD_EXTENSIONS": "",
    "PROJ_NETWORK": "OFF",
    "PROJ_CURL_ENABLED": "NO",
    "LC_ALL": "C.UTF-8",
    "OPENBLAS_NUM_THREADS": "1",  # each takes address space
    "http_proxy": _NOWHERE,
    "https_proxy": _NOWHERE,
    "all_proxy": _NOWHERE,
}


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer of a file.

    crs : its reference system, None if unknown
    fields : names of its columns
    numbers : of its features
    shapes : geometries as WKB, two-dimensional; None for a feature without
    columns : values by column, as JSON has them; None is missing
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
        It cannot be read, holds more than `max_file_mb`, takes too long or too much memory; or pyogrio is missing.
    """
    if find_spec("pyogrio") is None:
        raise InvalidInput("file", "", f"is of a format that {EXTRA}")
    seconds = max(_LEAST_SECONDS, _SECONDS_PER_MB * max_file_mb)
    memory = max(_LEAST_MEMORY, int(_MEMORY_PER_MB * max_file_mb))
    limits = [str(int(most)) for most in (max_file_mb * 1e6, memory, seconds)]
    too_much = (
        f"holds more than {max_file_mb:g} MB, or takes too much to read: split it, or allow more with --max-file-mb"
    )
    try:
        done = _run([str(path.absolute()), *limits], 2.0 * seconds, {"GDAL_SKIP": ",".join(_others())})
    except subprocess.TimeoutExpired:
        raise InvalidInput("file", "", too_much) from None
    if done.returncode != 0:  # killed by a limit, or by what the file made of OGR
        raise InvalidInput("file", "", too_much)
    answer: Mapping[str, Any] = json.loads(done.stdout)
    if "too_large" in answer:
        raise InvalidInput("file", "", too_much)
    if "refused" in answer:
        rule = " ".join(str(answer["refused"]).split())
        raise InvalidInput("file", "", f"cannot be read by OGR: {rule}")
    return [_layer(one) for one in answer["layers"]]


@cache
def _others() -> tuple[str, ...]:
    """Return the formats that OGR shall not know."""
    done = _run(["formats"], _LEAST_SECONDS, {})
    if done.returncode != 0:
        raise InvalidInput("file", "", f"is of a format that {EXTRA}; it does not start: {done.stderr.decode()[-300:]}")
    return tuple(json.loads(done.stdout))


def _run(arguments: list[str], timeout_s: float, settings: Mapping[str, str]) -> "subprocess.CompletedProcess[bytes]":
    return subprocess.run(
        # -P: what lies in the current directory is not imported
        [sys.executable, "-P", "-W", "ignore", str(_CHILD), *arguments],
        # Nothing of the caller's: no credentials, and no settings of GDAL's.
        env={"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **_SETTINGS, **settings},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=timeout_s,
        check=False,
    )


def _layer(one: Mapping[str, Any]) -> Layer:
    shapes = np.empty(len(one["shapes"]), dtype=object)
    shapes[:] = [None if shape is None else bytes.fromhex(shape) for shape in one["shapes"]]
    return Layer(one["name"], one["crs"], one["fields"], one["numbers"], shapes, one["columns"])
