"""Convert coordinates of other reference systems to longitude and latitude on WGS84, vertex by vertex.

Edges are then straight in the scene's plane, whatever they were in the file.

PROJ parses the text of a reference system in this process. Its parsers limit nesting; length, number and references to
files are limited here.
"""

import json
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.formats.json_text import check_text

Floats = NDArray[np.float64]
# Conversion of coordinates (n, 2) to longitude and latitude in degrees; None: they already are.
ToDegrees = Callable[[Floats], Floats] | None

EXTRA: Final = "needs the extra 'ogr': pip install 'conflictdb[ogr]'"
_LONGITUDE_LATITUDE: Final = re.compile(
    r"(?:.*[:/])?(CRS:?84h?|EPSG[:/](?:[\d.]*[:/])?(?:4326|4979))|WGS ?84", re.IGNORECASE
)
# Characters of a name, WKT or PROJJSON: PROJ's own longest is a third of it.
MAX_CHARACTERS: Final = 50_000
# Reference systems of one file. Each takes PROJ some 20 ms.
MAX_SYSTEMS: Final = 20
# A path or an address: PROJ would open grids and definitions there, or block on a pipe.
_ELSEWHERE: Final = re.compile(r"""(?:^|[=,"'@\s|])(?:~|\.{1,2})?/\S|["'@=,]\w+://(?!proj\.org/|www\.opengis\.net/)""")
_RULE: Final = "must name a reference system, or be left out: longitude and latitude on WGS84, as RFC 7946 says"


def of_name(who: str, name: str, field: str = "reference system") -> ToDegrees:
    """Return the conversion from a named reference system to longitude and latitude; raises InvalidInput if unknown."""
    if _LONGITUDE_LATITUDE.fullmatch(name):
        return None
    name = _harmless(who, name, field)
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


def _harmless(who: str, name: str, field: str) -> str:
    """Return the text of a reference system if PROJ may parse it; raises InvalidInput otherwise."""
    check_text(who, field, name)
    if len(name) > MAX_CHARACTERS:
        rule = f"has {len(name):,} characters; at most {MAX_CHARACTERS:,} are read: give its code, such as EPSG:25832"
        raise InvalidInput(who, field, rule)
    if name.lstrip().startswith("{"):
        try:
            name = json.dumps(json.loads(name), ensure_ascii=False)  # without escapes that hide a path
        except (ValueError, RecursionError):
            raise InvalidInput(who, field, f"is neither PROJJSON nor a name: {name:.60}") from None
    if _ELSEWHERE.search(name):
        raise InvalidInput(who, field, f"refers to a file or an address, which is not opened: {name:.60}")
    return name


# Reference systems named by a file: the conversion to degrees, or the error.
Systems = dict[str, ToDegrees | InvalidInput]


def of_member(who: str, holder: Mapping[str, Any], outer: ToDegrees, systems: Systems) -> ToDegrees:
    """Return the conversion for the member `crs` of GeoJSON 2008, `outer` if it is absent; raises InvalidInput.

    systems : those of the file looked up so far; this one is added
    """
    if "crs" not in holder:
        return outer
    crs = holder["crs"]
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if isinstance(properties, dict) and name is None and isinstance(properties.get("code"), int):
        name = f"EPSG:{properties['code']}"
    if not isinstance(name, str):
        raise InvalidInput(who, "crs", f"{_RULE}; got {crs!r:.60}")
    if name not in systems:
        if len(systems) == MAX_SYSTEMS:
            rule = f"is another one than {MAX_SYSTEMS} before it, the most that a file may name"
            raise InvalidInput(who, "crs", f"{rule}: transform it to longitude and latitude first")
        try:
            systems[name] = of_name(who, name, "crs")
        except InvalidInput as refused:
            systems[name] = refused
    found = systems[name]
    if isinstance(found, InvalidInput):
        raise InvalidInput(who, found.field, found.rule) from found.__cause__
    return found
