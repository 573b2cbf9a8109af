"""Make many areas and tracks at once from arrays, by the rules of `Area` and `Track`.

Checks of whole arrays take a tenth of the time of checks object by object. They accept nothing that `Area` and `Track`
refuse. They leave out, as None, refused objects and those that need a closer look: for the error, or the object, the
caller makes them one by one.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, Final, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.model.plans import (
    HAVEN_SLACK,
    MAX_HAVEN_CORNERS,
    MAX_HAVEN_M,
    MAX_INSTANT_US,
    MAX_LATITUDE_DEG,
    MAX_LONGITUDE_DEG,
    MAX_POINTS,
    MIN_INSTANT_US,
    Area,
    Track,
)

_One = TypeVar("_One", Area, Track)

_AREA: Final = tuple(field.name for field in fields(Area))
_STEADY: Final = (0.0, None, None, None)  # a haven that neither grows nor changes, heights of no leg
_ONCE: Final = (None, None)  # neither several activations nor a schedule
_AS_PLANNED: Final = (None, *_ONCE, None)  # no tolerances either, and lines as in the scene
_TRACK: Final = tuple(field.name for field in fields(Track))


def areas(
    keys: Sequence[str],
    footprints: NDArray[np.object_],
    names: Sequence[str | None],
    spans_us: Sequence[tuple[int | None, int | None]],
    heights_m: Sequence[tuple[float | None, float | None]],
    properties: Sequence[Mapping[str, Any]],
    ruled: Sequence[tuple[str | None, str | None]],
) -> list[Area | None]:
    """Return areas with these keys (not empty), MultiPolygons without empty parts, and other members.

    ruled : class and owner of each, checked
    """
    lonlat, owner = shapely.get_coordinates(footprints, return_index=True)
    is_fit = _all_of(_on_earth(lonlat), owner, len(keys)) & (np.bincount(owner, minlength=len(keys)) <= MAX_POINTS)
    bounds = shapely.bounds(footprints)
    with np.errstate(invalid="ignore"):
        is_fit &= bounds[:, 2] - bounds[:, 0] <= 360.0
    is_fit[is_fit] = shapely.is_valid(footprints[is_fit])
    return [
        _made(Area, _AREA, (key, footprint, name, *span, *heights, rest, *of, *_ONCE))
        if fits and _is_span(*span) and _are_heights(*heights)
        else None
        for key, footprint, name, span, heights, rest, of, fits in zip(
            keys, footprints.tolist(), names, spans_us, heights_m, properties, ruled, is_fit.tolist(), strict=True
        )
    ]


def tracks(
    keys: Sequence[str],
    positions_deg: NDArray[np.float64],
    way: NDArray[np.int64],
    times_us: NDArray[np.int64],
    outline_m: NDArray[np.float64],
    ring: NDArray[np.int64],
    names: Sequence[str | None],
    heights_m: Sequence[tuple[float | None, float | None]],
    properties: Sequence[Mapping[str, Any]],
    ruled: Sequence[tuple[str | None, str | None]],
) -> list[Track | None]:
    """Return tracks with these keys (not empty), constant havens and heights, of any speed.

    positions_deg, times_us : (w, 2) and (w,) of all tracks; track i has the waypoints [way[i], way[i + 1])
    outline_m : (v, 2) of all tracks; track i has the corners [ring[i], ring[i + 1]), at least one
    ruled : class and owner of each, checked
    """
    n = len(keys)
    owner = np.repeat(np.arange(n), np.diff(way))
    is_sound = _on_earth(positions_deg) & (times_us >= MIN_INSTANT_US) & (times_us <= MAX_INSTANT_US)
    # The first waypoint of a track follows another one.
    is_sound[1:] &= (times_us[1:] > times_us[:-1]) | (owner[1:] != owner[:-1])
    is_fit = _all_of(is_sound, owner, n) & (np.diff(way) >= 2) & (np.diff(way) <= MAX_POINTS)
    is_fit &= _are_convex(outline_m, ring) & (np.diff(ring) <= MAX_HAVEN_CORNERS)
    ways, rings = way.tolist(), ring.tolist()
    return [
        _made(
            Track,
            _TRACK,
            (
                key,
                positions_deg[i:j],
                times_us[i:j],
                outline_m[start:end],
                name,
                *heights,
                rest,
                *_STEADY,
                *of,
                *_AS_PLANNED,
            ),
        )
        if fits and _are_heights(*heights)
        else None
        for key, i, j, start, end, name, heights, rest, of, fits in zip(
            keys, ways, ways[1:], rings, rings[1:], names, heights_m, properties, ruled, is_fit.tolist(), strict=False
        )
    ]


def _made(kind: type[_One], names: tuple[str, ...], values: tuple[Any, ...]) -> _One:
    """Return an object whose values are checked already."""
    one = object.__new__(kind)
    for name, value in zip(names, values, strict=True):
        object.__setattr__(one, name, value)
    return one


def _all_of(is_sound: NDArray[np.bool_], owner: NDArray[np.int64], n: int) -> NDArray[np.bool_]:
    """Return (n,) whether all places of an object are sound; `owner` is the object of each."""
    fit = np.ones(n, np.bool_)
    fit[owner[~is_sound]] = False
    return fit


def _on_earth(lonlat: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (n,) whether longitudes and latitudes are in range; False for NaN."""
    return np.asarray((np.abs(lonlat) <= (MAX_LONGITUDE_DEG, MAX_LATITUDE_DEG)).all(axis=1))


def _are_convex(outline_m: NDArray[np.float64], ring: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (n,) whether rings certainly are on earth and convex: all corners turn one way, and once round."""
    start, last = ring[:-1], ring[1:] - 1
    after = np.arange(1, len(outline_m) + 1)
    after[last] = start
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.maximum.reduceat(np.abs(outline_m).max(axis=1), start)
        (u, v), slack = (outline_m[after] - outline_m).T, HAVEN_SLACK * size**2
        turn = u * v[after] - v * u[after]
        heading = np.arctan2(v, u)
        step = heading[after] - heading
        turned = np.add.reduceat(step - math.tau * np.round(step / math.tau), start)
        is_one_way = (np.minimum.reduceat(turn, start) > slack) | (np.maximum.reduceat(turn, start) < -slack)
        return np.asarray((size <= MAX_HAVEN_M) & ((last - start < 2) | is_one_way & (np.abs(turned) < 1.5 * math.tau)))


def _is_span(start_us: int | None, end_us: int | None) -> bool:
    return (
        (start_us is None or MIN_INSTANT_US <= start_us <= MAX_INSTANT_US)
        and (end_us is None or MIN_INSTANT_US <= end_us <= MAX_INSTANT_US)
        and (start_us is None or end_us is None or start_us < end_us)
    )


def _are_heights(floor_m: float | None, ceiling_m: float | None) -> bool:
    return (
        (floor_m is None or math.isfinite(floor_m))
        and (ceiling_m is None or math.isfinite(ceiling_m))
        and (floor_m is None or ceiling_m is None or floor_m < ceiling_m)
    )
