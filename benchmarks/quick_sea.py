"""The sea of made_scenes.py, generated as arrays: the same density and kinds of objects, a million legs in seconds.

Objects are written directly in the Arrow form OBJECTS. They differ from those of `made_scenes.sea`: random numbers come
in another order. More than a million legs are several days of one sea, with the same density at any time. Each day has
tracks and areas of its own; areas without time limits are those of the first day.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import shapely
from layouts import METRES_PER_DEGREE, NMI
from made_scenes import DEGREES_PER_ROOT, SEA
from numpy.typing import NDArray
from scenes import T0_US

from conflictdb.arrays.arrow.columns import of_lists, of_numbers
from conflictdb.arrays.arrow.forms import INSTANT
from conflictdb.arrays.arrow.object_rows import OBJECTS
from conflictdb.arrays.ragged import offsets
from conflictdb.formats.parquet_writing import write_objects
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind

# A track has 1 to 3 legs with way, and after each of them, for this share, one at rest.
RESTS: Final = 0.15
MOST_LEGS: Final = 3
LEGS_PER_TRACK: Final = (1 + MOST_LEGS) / 2 * (1 + RESTS)
# Legs of a day: of more the sea would reach further than 60 degrees south and north.
MOST: Final = 1_000_000
AT_ONCE: Final = 20_000
# Two corners of a convex polygon are less than half a turn apart, seen from its middle.
_WIDEST_TURN: Final = 0.95 * np.pi
_HOUR_US: Final = 3.6e9
_DAY_US: Final = 24 * 3_600_000_000


def write(path: Path, scene: Scene, legs: int, seed: int) -> int:
    """Write a scene of about `legs` legs to GeoParquet, and return the number of its objects."""
    with path.open("wb") as stream:
        write_objects(stream, scene, batches(legs, seed))
    return int(pq.read_metadata(path).num_rows)


def batches(legs: int, seed: int) -> Iterator[pa.RecordBatch]:
    """Yield a scene of about `legs` legs, areas and tracks in turn, as many of both in the first day."""
    tracks, days = max(1, round(legs / LEGS_PER_TRACK)), max(1, math.ceil(legs / MOST))
    of_day = math.ceil(tracks / days)
    window = DEGREES_PER_ROOT * (2 * of_day) ** 0.5
    for day in range(days):
        end = min(tracks, (day + 1) * of_day)
        for first in range(day * of_day, end, AT_ONCE):
            rng, n = np.random.default_rng([seed, first]), min(AT_ONCE, end - first)
            keys = [f"{first + i}" for i in range(n)]
            yield _areas(rng, window, keys, day)
            yield _tracks(rng, window, keys, day)


def _somewhere(rng: np.random.Generator, window: float, n: int) -> NDArray[np.float64]:
    """Return longitudes and latitudes (n, 2), as dense everywhere."""
    lat = rng.uniform(-window / 2, window / 2, n)
    return np.stack([rng.uniform(-window / 2, window / 2, n) / np.cos(np.radians(lat)), lat], axis=1)


def _rings(rng: np.random.Generator, n: int, corners: int, around_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return convex rings (n, corners, 2), metres about their middles, counterclockwise and so long around."""
    angle = np.empty((n, corners))
    rows = np.arange(n)
    while rows.size:
        angle[rows] = np.sort(rng.uniform(0, 2 * np.pi, (rows.size, corners)), axis=1)
        gap = np.diff(angle[rows], axis=1, append=angle[rows, :1] + 2 * np.pi)
        rows = rows[gap.max(axis=1) > _WIDEST_TURN]
    x, y = np.cos(angle), rng.uniform(0.4, 1.0, (n, 1)) * np.sin(angle)
    turn = rng.uniform(0, 2 * np.pi, (n, 1))
    xy = np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)], axis=2)
    length = np.hypot(*np.moveaxis(xy - np.roll(xy, 1, axis=1), 2, 0)).sum(axis=1)
    return np.asarray(xy * (around_m / length)[:, None, None])


def _areas(rng: np.random.Generator, window: float, keys: list[str], day: int) -> pa.RecordBatch:
    n = len(keys)
    place, corners = _somewhere(rng, window, n), rng.integers(3, 11, n)
    around_m = rng.uniform(*SEA.around_area, n) * NMI
    kind = rng.choice(3, n, p=[1 - SEA.odd_share, SEA.odd_share / 2, SEA.odd_share / 2])
    shapes = np.empty(n, object)
    for count in range(3, 11):
        for odd in range(3):
            rows = np.flatnonzero((corners == count) & (kind == odd))
            xy, holes = _rings(rng, rows.size, count, around_m[rows]), None
            if odd == 1:  # every other corner drawn in
                between = (xy + np.roll(xy, -1, axis=1)) / 2 * rng.uniform(0.3, 0.8, (rows.size, count, 1))
                xy = np.stack([xy, between], axis=2).reshape(rows.size, 2 * count, 2)
            elif odd == 2:
                middle = xy.mean(axis=1, keepdims=True)
                holes = shapely.linearrings(_ground(place[rows], middle + 0.6 * (xy - middle)))[:, None]
            shapes[rows] = shapely.polygons(shapely.linearrings(_ground(place[rows], xy)), holes=holes)
    shapes = shapely.multipolygons(shapes, indices=np.arange(n))
    is_for_ever = rng.random(n) < 0.5
    start = T0_US + day * _DAY_US + (rng.uniform(*SEA.start_h, n) * _HOUR_US).astype(np.int64)
    end = start + (rng.uniform(0.5, 12.0, n) * _HOUR_US).astype(np.int64)
    active = {name: pa.array(at, mask=is_for_ever).view(INSTANT) for name, at in (("start", start), ("end", end))}
    batch = _batch(Kind.AREA, [f"A{key}" for key in keys], shapes, active)
    return batch.filter(pa.array(~is_for_ever)) if day else batch


def _ground(place: NDArray[np.float64], xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return longitudes and latitudes (n, k, 2) of metres about places (n, 2)."""
    metres = np.stack([METRES_PER_DEGREE * np.cos(np.radians(place[:, 1])), np.full(len(place), METRES_PER_DEGREE)], 1)
    return place[:, None] + xy_m / metres[:, None]


def _tracks(rng: np.random.Generator, window: float, keys: list[str], day: int) -> pa.RecordBatch:
    n, legs = len(keys), 2 * MOST_LEGS
    place = _somewhere(rng, window, n)
    # Moving legs and rests in turn, (n, legs); a track has some of them.
    has_way = np.arange(MOST_LEGS) < rng.integers(1, MOST_LEGS + 1, (n, 1))
    has_leg = np.stack([has_way, has_way & (rng.random((n, MOST_LEGS)) < RESTS)], axis=2).reshape(n, legs)
    nmi = rng.uniform(*SEA.leg, (n, MOST_LEGS)) * has_way
    hours = np.stack([nmi / rng.uniform(*SEA.speed_kn, nmi.shape), rng.uniform(0.1, 2.0, nmi.shape)], axis=2)
    bearing = rng.uniform(0, 360, n)
    north, east = np.zeros((n, legs)), np.zeros((n, legs))
    lat = place[:, 1].copy()
    for leg in range(MOST_LEGS):
        quarter = rng.integers(4, size=n)
        is_exact = rng.random(n) < 0.15  # north, east, south or west
        bearing = np.where(is_exact, 90.0 * quarter, bearing + rng.uniform(-120, 120, n))
        way = nmi[:, leg] / 60
        north[:, 2 * leg] = np.where(is_exact & (quarter % 2 == 1), 0.0, way * np.cos(np.radians(bearing)))
        after = lat + north[:, 2 * leg]
        along = way * np.sin(np.radians(bearing)) / np.cos(np.radians((lat + after) / 2))
        east[:, 2 * leg] = np.where(is_exact & (quarter % 2 == 0), 0.0, along)
        lat = after
    points = place[:, None] + np.cumsum(np.stack([east, north], axis=2), axis=1)
    at_h = rng.uniform(*SEA.start_h, (n, 1))
    at_h = np.concatenate([at_h, at_h + np.cumsum(hours.reshape(n, legs) * has_leg, axis=1)], axis=1)
    is_there = np.concatenate([np.ones((n, 1), np.bool_), has_leg], axis=1)
    row, _ = np.nonzero(is_there)
    shapes = shapely.linestrings(np.concatenate([place[:, None], points], axis=1)[is_there], indices=row)
    times = of_numbers(T0_US + day * _DAY_US + (at_h[is_there] * _HOUR_US).astype(np.int64)).view(INSTANT)
    vertices, corners = _havens(rng, n)
    outline = of_lists(of_lists(vertices.reshape(-1), 2 * np.arange(len(vertices) + 1)), offsets(corners))
    moving = {"times": of_lists(times, offsets(is_there.sum(axis=1))), "outline_m": outline}
    return _batch(Kind.TRACK, [f"T{key}" for key in keys], shapes, moving)


def _havens(rng: np.random.Generator, n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the corners of all havens in turn, [starboard, forward] in metres, and the number of each (n,)."""
    around_m = rng.uniform(*SEA.around_haven, n) * NMI
    corners = np.where(rng.random(n) < SEA.odd_share, rng.integers(3, 8, n), 0)  # 0: a rectangle
    held = np.empty((n, 7, 2))
    for count in range(3, 8):
        rows = np.flatnonzero(corners == count)
        ring = _rings(rng, rows.size, count, around_m[rows])
        held[rows, :count] = np.where(rng.random((rows.size, 1, 1)) < 0.5, ring, ring[:, ::-1])
    rows = np.flatnonzero(corners == 0)
    length = rng.uniform(0.25, 0.45, rows.size) * around_m[rows]
    width = around_m[rows] / 2 - length
    aft, port = -length * rng.uniform(0.1, 0.9, rows.size), -width * rng.uniform(0.1, 0.9, rows.size)
    fore, starboard = aft + length, port + width
    held[rows, :4] = np.stack([starboard, fore, starboard, aft, port, aft, port, fore], axis=1).reshape(-1, 4, 2)
    corners[rows] = 4
    return held[np.arange(7) < corners[:, None]], corners


def _batch(kind: Kind, keys: list[str], shapes: NDArray[np.object_], known: dict[str, pa.Array]) -> pa.RecordBatch:
    columns = {field.name: pa.nulls(len(keys), field.type) for field in OBJECTS.schema}
    columns["id"], columns["kind"] = pa.array(keys, pa.string()), pa.array([kind.value] * len(keys), pa.string())
    columns["geometry"] = pa.array(shapely.to_wkb(shapes, byte_order=1), pa.binary())
    return OBJECTS.batch(columns | known)
