"""Reference systems of files: longitude and latitude on WGS84 as they are, all others transformed vertex by vertex.

Edges are then straight in the scene's plane, whatever they were in the file's.
"""

import re
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput

Floats = NDArray[np.float64]
# From coordinates (n, 2) of a file to longitude and latitude in degrees; None leaves them as they are.
ToDegrees = Callable[[Floats], Floats] | None

EXTRA: Final = "needs the extra 'ogr': pip install 'conflictdb[ogr]'"
_LONGITUDE_LATITUDE: Final = re.compile(
    r"(?:.*[:/])?(CRS84h?|EPSG[:/](?:[\d.]*[:/])?(?:4326|4979))|WGS ?84", re.IGNORECASE
)
_RULE: Final = "must name a reference system, or be left out: longitude and latitude on WGS84, as RFC 7946 says"


def of_name(who: str, name: str, field: str = "reference system") -> ToDegrees:
    """Return how coordinates of a named system become longitude and latitude; raises InvalidInput if it is unknown."""
    if _LONGITUDE_LATITUDE.fullmatch(name):
        return None
    try:
        import pyproj
    except ImportError:
        raise InvalidInput(who, field, f"is {name:.60}; to transform it {EXTRA}") from None
    try:
        transformer = pyproj.Transformer.from_crs(name, "EPSG:4326", always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise InvalidInput(who, field, f"is not known to PROJ: {name:.60}") from error

    def to_degrees(xy: Floats) -> Floats:
        return np.column_stack(transformer.transform(xy[:, 0], xy[:, 1]))

    return to_degrees


def of_member(who: str, holder: Mapping[str, Any], outer: ToDegrees) -> ToDegrees:
    """Return what the member `crs` of GeoJSON of 2008 says, `outer` where there is none; raises InvalidInput."""
    if "crs" not in holder:
        return outer
    crs = holder["crs"]
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if isinstance(properties, dict) and name is None and isinstance(properties.get("code"), int):
        name = f"EPSG:{properties['code']}"
    if not isinstance(name, str):
        raise InvalidInput(who, "crs", f"{_RULE}; got {crs!r:.60}")
    return of_name(who, name, "crs")
