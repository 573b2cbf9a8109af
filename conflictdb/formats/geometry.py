"""Convert GeoJSON geometries to arrays and polygons, checking each number.

A third number of a position (altitude, RFC 7946) is accepted and ignored, because heights of a scene are bands
(`floor_m`, `ceiling_m`) of whole objects or legs. This can only report more conflicts: without a band an object is at
all heights.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.formats.fields import finite

AREA_TYPES = ("Polygon", "MultiPolygon")
TRACK_TYPE = "LineString"
CIRCLE_TYPE = "Point"
CUT_TRACK_TYPE = "MultiLineString"
# Ends of two lines that are one place, degrees.
_SAME_DEG = 1e-9

T = TypeVar("T")


def geometry_type(who: str, geometry: Any) -> str:
    """Return the type of a GeoJSON geometry that can be an area or a track; refuse all others."""
    rule = f"must be a {', '.join(AREA_TYPES)} (an area) or a {TRACK_TYPE} (a track), or a {CIRCLE_TYPE} with radius_m"
    if geometry is None:
        raise InvalidInput(who, "geometry", f"{rule}; there is none")
    if not isinstance(geometry, dict):
        raise InvalidInput(who, "geometry", f"{rule}; got {geometry!r:.60}")
    kind = geometry.get("type")
    if kind not in (*AREA_TYPES, TRACK_TYPE, CUT_TRACK_TYPE, CIRCLE_TYPE):
        raise InvalidInput(who, "geometry", f"{rule}; got {kind!r:.60}")
    return str(kind)


def has_altitudes(geometry: Any) -> bool:
    """Return whether a GeoJSON geometry has a third number that is not 0, in its first ring or line."""
    value = geometry.get("coordinates") if isinstance(geometry, dict) else None
    while isinstance(value, list) and value and isinstance(value[0], list):
        if isinstance(value[0], list) and value[0] and not isinstance(value[0][0], list):
            if len(value[0]) < 3:
                return False
            return any(isinstance(one, list) and len(one) > 2 and one[2] not in (0, None) for one in value)
        value = value[0]
    return isinstance(value, list) and len(value) > 2 and value[2] not in (0, None)


def line(who: str, where: str, coordinates: Any) -> NDArray[np.float64]:
    """Return the (n, 2) longitudes and latitudes of a LineString in degrees, n >= 2."""
    positions = _positions(who, where, coordinates)
    if len(positions) < 2:
        raise InvalidInput(who, where, f"a track needs at least two waypoints; got {len(positions)}")
    return positions


def lines(who: str, where: str, coordinates: Any) -> list[NDArray[np.float64]]:
    """Return the positions (n, 2) of each line of a MultiLineString in degrees."""
    return _each(who, where, coordinates, "lines", line)


def joined(who: str, parts: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], list[int]]:
    """Return the positions (n, 2) of a track that is cut into lines at the antimeridian, and the lines' numbers.

    The second result is the number of positions of each line. Raises InvalidInput unless each line begins where the one
    before ends, or on the other side of the antimeridian.
    """
    found = [parts[0]]
    for k, part in enumerate(parts[1:], 1):
        gap = part[0] - found[-1][-1]
        turns = np.round(gap[0] / 360.0)
        if abs(gap[0] - 360.0 * turns) > _SAME_DEG or abs(gap[1]) > _SAME_DEG:
            rule = "must be one line: a track has no gaps; lines are joined if each begins where the one before ends"
            raise InvalidInput(
                who, "geometry", f"{rule}, also across the antimeridian; got {len(parts)} (see line {k})"
            )
        found.append(part - [360.0 * turns, 0.0])
    whole = np.concatenate([found[0], *(part[1:] for part in found[1:])])
    # One that begins in the west and crosses the antimeridian twice stays near +-180.
    return whole, [len(part) for part in parts]


def of_joined(who: str, name: str, value: Any, counts: Sequence[int]) -> Any:
    """Return a member of a cut track, one value per position or per leg, as that of the joined one.

    It may be a list of lists, one for each line, or a list for all lines, in which the last value of a line and the
    first of the next are of one place. Raises InvalidInput if these differ.
    """
    if not isinstance(value, list) or not value:
        return value
    total, legs = sum(counts), sum(counts) - len(counts)
    if all(isinstance(one, list) for one in value) and [len(one) for one in value] in (
        list(counts),
        [count - 1 for count in counts],
    ):
        value = [one for part in value for one in part]
    if len(value) != total or total == legs:
        return value
    kept, at = [], 0
    for k, count in enumerate(counts):
        if k and value[at] != value[at - 1]:
            rule = f"must be the same at the end of line {k - 1} and the begin of line {k}, which are one place"
            raise InvalidInput(who, name, f"{rule}; got {value[at - 1]!r:.40} and {value[at]!r:.40}")
        kept += value[at + (k > 0) : at + count]
        at += count
    return kept


def point(who: str, coordinates: Any, where: str = "geometry.coordinates") -> NDArray[np.float64]:
    """Return the (1, 2) longitude and latitude of a Point in degrees."""
    if not isinstance(coordinates, list) or len(coordinates) not in (2, 3):
        raise _no_position(who, where, coordinates)
    return np.array([[finite(who, f"{where}[{j}]", number) for j, number in enumerate(coordinates)][:2]])


def multipolygon(who: str, geometry: dict[str, Any], where: str = "geometry") -> shapely.MultiPolygon:
    """Return a Polygon or MultiPolygon of GeoJSON, in degrees; the model checks its validity."""
    where, coordinates = f"{where}.coordinates", geometry.get("coordinates")
    if geometry["type"] == "Polygon":
        return shapely.MultiPolygon([_polygon(who, where, coordinates)])
    return shapely.MultiPolygon(_each(who, where, coordinates, "polygons", _polygon))


def pairs(who: str, where: str, value: Any, meaning: str) -> NDArray[np.float64]:
    """Return a JSON list of pairs of numbers as (n, 2) float64; `meaning` describes a pair in errors."""
    if not isinstance(value, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in value):
        raise InvalidInput(who, where, f"must be a list of {meaning}")
    rows = [[finite(who, f"{where}[{i}][{j}]", x) for j, x in enumerate(pair)] for i, pair in enumerate(value)]
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def _polygon(who: str, where: str, coordinates: Any) -> shapely.Polygon:
    rings = _each(who, where, coordinates, "rings", _ring)
    return shapely.Polygon(rings[0], rings[1:])


def _ring(who: str, where: str, coordinates: Any) -> NDArray[np.float64]:
    ring = _positions(who, where, coordinates)
    if len(ring) < 4:
        raise InvalidInput(
            who, where, f"a ring needs at least four positions, the last equal to the first; got {len(ring)}"
        )
    if np.any(ring[0] != ring[-1]):
        raise InvalidInput(who, where, "a ring must be closed: its last position must equal its first")
    return ring


def _each(who: str, where: str, value: Any, what: str, read: Callable[[str, str, Any], T]) -> list[T]:
    if not isinstance(value, list):
        raise InvalidInput(who, where, f"must be a list of {what}; got {value!r:.60}")
    if not value:
        raise InvalidInput(who, where, "must not be empty")
    return [read(who, f"{where}[{i}]", member) for i, member in enumerate(value)]


def _positions(who: str, where: str, value: Any) -> NDArray[np.float64]:
    if not isinstance(value, list):
        raise InvalidInput(who, where, f"must be a list of positions; got {value!r:.60}")
    if not value:
        raise InvalidInput(who, where, "must not be empty")
    # Check the types of all numbers at once: numpy would convert true to 1 and "4" to 4.
    plain = all(type(p) is list and (len(p) == 2 or len(p) == 3) for p in value)
    if plain and {type(x) for p in value for x in p} <= {int, float}:
        try:
            positions = np.array([p[:2] for p in value], dtype=np.float64)
            spare = np.array([x for p in value for x in p[2:]], dtype=np.float64)
        except OverflowError:
            pass
        else:
            if np.isfinite(positions).all() and np.isfinite(spare).all():
                return positions
    return _first_fault(who, where, value)


def _no_position(who: str, where: str, position: Any) -> InvalidInput:
    rule = "must be a position: [longitude, latitude] (a third number, the altitude, is left aside)"
    return InvalidInput(who, where, f"{rule}; got {position!r:.60}")


def _first_fault(who: str, where: str, value: list[Any]) -> NDArray[np.float64]:
    """Raise InvalidInput for the first position that is not two or three finite numbers."""
    for i, position in enumerate(value):
        if not isinstance(position, list) or len(position) not in (2, 3):
            raise _no_position(who, f"{where}[{i}]", position)
        for j, number in enumerate(position):
            finite(who, f"{where}[{i}][{j}]", number)
    raise AssertionError(value)  # the caller found a fault
