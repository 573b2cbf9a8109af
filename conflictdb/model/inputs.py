"""Convert usual input types to those of the model: instants, positions, outlines and footprints.

An instant is an aware datetime (or pandas Timestamp), a datetime64, which is UTC, or an integer number of microseconds
since 1970. Positions, outlines and footprints are arrays, lists of pairs, or shapely geometries; a third number of a
position, a height, is ignored.
"""

import sys
from collections.abc import Collection, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, Final, Protocol, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput

EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
MICROSECOND: Final = timedelta(microseconds=1)


class Arrayed(Protocol):
    """An object that converts itself to an array, such as a Series or an index of pandas."""

    def __array__(self) -> NDArray[Any]:
        """Return the array."""


Instant: TypeAlias = datetime | np.datetime64 | int
Instants: TypeAlias = Sequence[Instant] | NDArray[np.datetime64] | NDArray[np.integer[Any]] | Arrayed
Pairs: TypeAlias = Sequence[Sequence[float]] | NDArray[np.floating[Any]] | NDArray[np.integer[Any]] | Arrayed
Positions: TypeAlias = Pairs | shapely.LineString
Outline: TypeAlias = Pairs | shapely.Polygon
Outlines: TypeAlias = Sequence[Outline] | NDArray[np.floating[Any]]
Heights: TypeAlias = Sequence[float] | NDArray[np.floating[Any]] | NDArray[np.integer[Any]] | Arrayed
Footprint: TypeAlias = Pairs | shapely.Polygon | shapely.MultiPolygon

INSTANT_RULE: Final = "must be an aware datetime, a datetime64 (UTC), or a whole number of microseconds since 1970"

_LONGEST_S: Final = 1e9  # 31 years of waiting, as on the command line: more is a wrong unit
_MOST_DAYS: Final = 999_999.0

_FARTHEST_M: Final = 1e6  # farther away nothing is near

# Integers in these ranges are in the years 2001 to 2128 as seconds or milliseconds, but in the first weeks of 1970 as
# microseconds.
_LOW, _HIGH = 10**9, 5 * 10**9
_MISTAKEN_UNITS: Final = tuple(
    (unit, factor, _LOW * factor, _HIGH * factor) for unit, factor in (("seconds", 1), ("milliseconds", 1_000))
)


def instants_us(who: str, field: str, given: Instants) -> NDArray[np.int64]:
    """Return (n,) int64 microseconds since 1970, truncated; raises InvalidInput."""
    values: Any = given
    if not isinstance(values, np.ndarray):
        # A Series of pandas converts to an array of datetime64 or of Timestamps.
        values = np.asarray(values) if hasattr(values, "__array__") else _listed(who, field, values)
    if isinstance(values, np.ndarray) and values.ndim == 1 and values.dtype.kind == "M":
        if np.isnat(values).any():
            raise InvalidInput(who, f"{field}[{int(np.isnat(values).argmax())}]", f"{INSTANT_RULE}; got NaT")
        return np.asarray(values.astype("datetime64[us]").astype(np.int64))
    if isinstance(values, np.ndarray) and values.ndim == 1 and values.dtype.kind in "iu":
        whole = np.asarray(values, dtype=np.int64)
    else:
        each = [
            value if type(value) is int else _instant_us(who, f"{field}[{i}]", value) for i, value in enumerate(values)
        ]
        try:
            whole = np.array(each, dtype=np.int64)
        except OverflowError:
            largest = max(each, key=abs)
            raise InvalidInput(who, field, f"must be of the years 1 to 9999; got {str(largest)[:60]}") from None
        if not all(_is_whole(value) for value in values):
            return whole
    if whole.size:
        _check_unit(who, field, int(whole.min()), int(whole.max()))
    return whole


def span_us(who: str, start: Instant | None, end: Instant | None) -> tuple[int | None, int | None]:
    """Return the ends of a span in microseconds since 1970, None if unbounded; raises InvalidInput."""
    start_us = None if start is None else _instant_us(who, "start", start)
    end_us = None if end is None else _instant_us(who, "end", end)
    first_us, last_us = end_us if start_us is None else start_us, start_us if end_us is None else end_us
    if first_us is not None and last_us is not None and all(one is None or _is_whole(one) for one in (start, end)):
        field = "end" if start is None else "start"
        _check_unit(who, field, min(first_us, last_us), max(first_us, last_us))
    return start_us, end_us


def moment(who: str, field: str, given: Instant) -> datetime:
    """Return an instant as an aware datetime, truncated to microseconds; raises InvalidInput."""
    instant_us = _instant_us(who, field, given)
    if _is_whole(given):
        _check_unit(who, field, instant_us, instant_us)
    try:
        return EPOCH + instant_us * MICROSECOND
    except OverflowError:
        raise InvalidInput(who, field, f"must be of the years 1 to 9999; got {given!r:.60}") from None


def certain(instant_us: int | None) -> np.datetime64 | None:
    """Return microseconds since 1970 as an instant with its unit, so that no unit check applies; None for None."""
    return None if instant_us is None else np.datetime64(instant_us, "us")


def all_certain(instants_us: NDArray[np.int64]) -> NDArray[np.datetime64]:
    """Return microseconds since 1970 as instants with their unit, so that no unit check applies."""
    return instants_us.view("datetime64[us]")


def positions_deg(who: str, given: Positions) -> NDArray[np.float64]:
    """Return (n, 2) float64 longitude and latitude of waypoints; raises InvalidInput."""
    if isinstance(given, shapely.LineString):
        return np.asarray(shapely.get_coordinates(given))
    return _pairs(who, "geometry", given, "pairs of longitude and latitude, or a LineString")


def outline_m(who: str, field: str, given: Outline) -> NDArray[np.float64]:
    """Return an outline as (m, 2) float64, not closed; raises InvalidInput."""
    if isinstance(given, shapely.Polygon):
        if given.interiors:
            raise InvalidInput(who, field, "must have no holes")
        return np.asarray(shapely.get_coordinates(given)[:-1])
    return _pairs(who, field, given, "a ring of [starboard, forward] metres")


def outlines_m(who: str, given: Outlines) -> NDArray[np.float64]:
    """Return outlines as (n, m, 2) float64; raises InvalidInput."""
    if isinstance(given, np.ndarray):
        return np.asarray(given, dtype=np.float64)
    rings = [outline_m(who, f"outlines_m[{k}]", ring) for k, ring in enumerate(_listed(who, "outlines_m", given))]
    if len({len(ring) for ring in rings}) != 1:
        raise InvalidInput(who, "outlines_m", "must be rings of [starboard, forward] metres with equal vertex counts")
    return np.stack(rings)


def footprint(who: str, given: Footprint) -> Any:
    """Return a MultiPolygon from a Polygon or the vertices of a ring; other geometries are returned unchanged."""
    if isinstance(given, shapely.Polygon):
        return shapely.MultiPolygon([given])
    if isinstance(given, shapely.Geometry):
        return given
    rule = "a Polygon, a MultiPolygon, or the vertices of a ring"
    ring = _pairs(who, "geometry", given, rule)
    if len(ring) < 3:
        raise InvalidInput(who, "geometry", f"must be {rule}, three at least; got {len(ring)}")
    try:
        return shapely.MultiPolygon([shapely.Polygon(ring)])
    except shapely.GEOSException:  # a ring that begins with NaN is not closed
        raise InvalidInput(who, "geometry", f"must be {rule}, of finite numbers") from None


def is_number(given: object) -> bool:
    """Whether a value is a number, of Python or of numpy, and no truth value."""
    return isinstance(given, int | float | np.number) and not isinstance(given, bool)


def metres(who: str, field: str, given: float | None) -> float | None:
    """Return a finite number of metres, or None; raises InvalidInput."""
    if given is None:
        return None
    if not is_number(given) or not abs(given) <= sys.float_info.max:
        raise InvalidInput(who, field, f"must be a finite number of metres, or absent; got {given!r:.60}")
    return float(given)


def speed_limit_kn(who: str, field: str, given: float) -> float:
    """Return a speed limit in knots, which may be infinite; raises InvalidInput."""
    if not is_number(given) or not (0.0 < given <= sys.float_info.max or given == np.inf):
        raise InvalidInput(who, field, f"must be a number of knots above 0; got {given!r:.60}")
    return float(given)


def seconds(who: str, field: str, given: float) -> float:
    """Return a waiting time in seconds; raises InvalidInput."""
    if not is_number(given) or not 0.0 <= given <= _LONGEST_S:
        raise InvalidInput(who, field, f"must be a number of seconds, 0 to {_LONGEST_S:g}; got {given!r:.60}")
    return float(given)


def days(who: str, field: str, given: float) -> float:
    """Return a number of days; raises InvalidInput."""
    if not is_number(given) or not 0.0 <= given <= _MOST_DAYS:
        raise InvalidInput(who, field, f"must be a number of days, 0 to {_MOST_DAYS:,.0f}; got {given!r:.60}")
    return float(given)


def reach_m(who: str, field: str, given: float) -> float:
    """Return a distance to look as far as, in metres; raises InvalidInput."""
    if not is_number(given) or not 0.0 <= given <= _FARTHEST_M:
        raise InvalidInput(who, field, f"must be a number of metres, 0 to {_FARTHEST_M:,.0f}; got {given!r:.60}")
    return float(given)


def count(who: str, field: str, given: int, least: int) -> int:
    """Return an integer that is at least `least`; raises InvalidInput."""
    if not _is_whole(given) or given < least:
        raise InvalidInput(who, field, f"must be a whole number, {least} or more; got {given!r:.60}")
    return int(given)


def keys(who: str, field: str, given: Collection[str]) -> frozenset[str]:
    """Return keys of objects; raises InvalidInput."""
    if isinstance(given, str) or not isinstance(given, Collection) or not all(isinstance(one, str) for one in given):
        raise InvalidInput(who, field, f"must be a sequence of keys, which are texts; got {given!r:.60}")
    return frozenset(given)


def heights_m(who: str, field: str, given: Heights) -> NDArray[np.float64]:
    """Return heights of legs or waypoints as (n,) float64; raises InvalidInput."""
    array = np.asarray(given if hasattr(given, "__array__") else _listed(who, field, given))
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise InvalidInput(
            who, field, f"must be one number of metres, one per leg or one per waypoint; got {given!r:.60}"
        )
    return np.asarray(array, dtype=np.float64)


def _instant_us(who: str, field: str, given: Any) -> int:
    if type(given) is int:  # most are
        return given
    if isinstance(given, datetime):
        if given.utcoffset() is None:
            rule = "needs an offset from UTC, such as datetime(2026, 6, 1, 8, tzinfo=UTC)"
            raise InvalidInput(who, field, f"{rule}; got {given.isoformat()}")
        return int((given - EPOCH) // MICROSECOND)
    if isinstance(given, np.datetime64) and not np.isnat(given):
        return int(given.astype("datetime64[us]").astype(np.int64))
    if not _is_whole(given):
        raise InvalidInput(who, field, f"{INSTANT_RULE}; got {given!r:.60}")
    return int(given)


def _is_whole(given: Any) -> bool:
    return type(given) is int or (isinstance(given, int | np.integer) and not isinstance(given, bool))


def _check_unit(who: str, field: str, first: int, last: int) -> None:
    """Refuse integers that are probably seconds or milliseconds, not microseconds."""
    for unit, factor, low, high in _MISTAKEN_UNITS:
        if low <= first and last < high:
            would_be = (EPOCH + first * MICROSECOND).isoformat(timespec="seconds")
            rule = f"whole numbers are microseconds since 1970: {first} would be {would_be}"
            remedy = f"if these are {unit}, multiply by {1_000_000 // factor:,}; if not, give datetimes"
            raise InvalidInput(who, field, f"{rule}; {remedy}")


def _listed(who: str, field: str, given: Any) -> list[Any]:
    if isinstance(given, str | bytes) or not hasattr(given, "__iter__"):
        raise InvalidInput(who, field, f"must be a list or an array; got {given!r:.60}")
    return list(given)


def _pairs(who: str, field: str, given: Any, what: str) -> NDArray[np.float64]:
    if isinstance(given, np.ndarray) and given.dtype == np.float64 and given.ndim == 2 and given.shape[1] == 2:
        return given
    try:
        array = np.asarray(given if hasattr(given, "__array__") else list(given))
    except (TypeError, ValueError):  # not iterable, or of unequal lengths
        array = np.array(None)
    if array.dtype.kind not in "iuf" or array.ndim != 2 or array.shape[1] not in (2, 3):
        raise InvalidInput(who, field, f"must be {what}; got {given!r:.60}")
    return np.asarray(array[:, :2], dtype=np.float64)
