"""Read what plans may meet, detected or not, while no other admission of the scene runs (sql/86).

begin_admission; replaced_objects; objects_near; some_areas, some_tracks; put_plans; commit.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final, NamedTuple

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray
from psycopg.pq import TransactionStatus

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.stage1_broad_phase import hulls_of
from conflictdb.errors import LockTimeout
from conflictdb.model.limits import Limits
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Kind
from conflictdb.store.connection import Holder, call, call_many, transaction
from conflictdb.store.few import some_areas, some_tracks
from conflictdb.store.scenes import scene_of

# On great circles the sides of a plan w wide rise above it by at most half of sec(w / 2) - 1 (_lies_near). A plan that
# is wider, or close to a pole, may reach any place.
_WIDE_DEG: Final = 90.0
_SPARE_DEG: Final = 0.001
_HIGHEST_DEG: Final = 85.0
_METRES_PER_DEGREE: Final = 110_000.0
_EVERYWHERE: Final = (-math.inf, -math.inf, math.inf, math.inf)


class StoredObject(NamedTuple):
    """An object of a scene, without its geometry.

    is_stale : whether its schedule must be expanded for the time of the question
    """

    kind: int
    id: int
    key: str
    name: str | None
    owner: str | None
    is_stale: bool = False


@contextmanager
def admission(
    conn: psycopg.Connection[Any], scene: str, lock_timeout_s: float | None
) -> Iterator[tuple[int, Scene, Limits]]:
    """Run the block in a transaction that holds the lock of admissions; yield id, settings and limits of the scene.

    An own transaction sees what was committed before each statement; the lock lasts until the outermost transaction
    ends. Raises LockTimeout, naming the holder, if the lock is not free within `lock_timeout_s` (None: the limit of the
    connection).
    """
    is_own = conn.info.transaction_status == TransactionStatus.IDLE
    begun = False
    try:
        with transaction(conn):
            if is_own:
                conn.execute(b"SET TRANSACTION ISOLATION LEVEL READ COMMITTED", prepare=False)
            number, settings, *limits = call(conn, "_begin_admission", scene, lock_timeout_s)
            begun = True
            yield int(number), scene_of(settings), Limits(*limits)
    except LockTimeout as timeout:
        if begun or conn.info.transaction_status == TransactionStatus.INERROR:
            raise
        with transaction(conn):
            number = call(conn, "_scene_id", scene)[0]
            holders = " and ".join(str(Holder(*row)) for row in call_many(conn, "_admission_holders", number))
        holders = holders or "it has just ended, or is a prepared transaction"
        raise LockTimeout(f"another admission of scene {scene!r} is at work: {holders}") from timeout.__cause__


def replaced_objects(
    conn: psycopg.Connection[Any], scene_id: int, keys: Sequence[str], owner: str | None
) -> list[StoredObject]:
    """Return the objects of a scene that have one of some keys, or an owner (None: no other objects)."""
    return [StoredObject(*row) for row in call_many(conn, "_replaced_objects", scene_id, list(keys), owner)]


def objects_near(
    conn: psycopg.Connection[Any],
    scene_id: int,
    scene: Scene,
    pieces: Pieces,
    plans: Sequence[Area | Track],
    span: tuple[int, int] | None,
) -> list[StoredObject]:
    """Return the objects that pieces might meet, as committed, detected or not.

    pieces : of `plans` and perhaps of others, with spans widened by the largest separation in time of the scene's pairs
    span : [start, end) that the plans may touch, MINUS_INFINITY_US and INFINITY_US where unbounded; None: no time
    """
    columns = (pieces.start_us, pieces.end_us, pieces.end_inclusive, pieces.floor_m, pieces.ceiling_m, pieces.turn)
    hulls = list(shapely.to_wkb(hulls_of(pieces)))
    given = [hulls, *(column.tolist() for column in columns), *_boxes_deg(scene, plans), *(span or (None, None))]
    return [StoredObject(*row) for row in call_many(conn, "_objects_near", scene_id, *given)]


def scheduled_keys_near(
    conn: psycopg.Connection[Any], scene_id: int, scene: Scene, plans: Sequence[Area | Track], near_m: float
) -> list[str]:
    """Return the keys of all objects with a schedule that may come near plans in space.

    near_m : metres, beyond the required separation
    """
    return [key for *_, key in call_many(conn, "_scheduled_near", scene_id, *_boxes_deg(scene, plans, near_m))]


def _boxes_deg(scene: Scene, plans: Sequence[Area | Track], near_m: float = 0.0) -> list[list[float]]:
    """Return west, south, east and north of what plans may come near to, each in a list."""
    reach_m = max(scene.reach_m, scene.tolerance_m + scene.largest_separation_m) + near_m
    boxes: list[list[float]] = np.array([_box_deg(plan, reach_m) for plan in plans]).T.tolist()
    return boxes


def read_objects(
    conn: psycopg.Connection[Any], scene_id: int, objects: Sequence[StoredObject]
) -> tuple[AreaBatch, TrackBatch]:
    """Return some objects of a scene as they are stored."""
    areas, tracks = ([one.id for one in objects if one.kind == kind.code] for kind in (Kind.AREA, Kind.TRACK))
    return (
        some_areas(conn, scene_id, areas) if areas else AreaBatch.of(()),
        some_tracks(conn, scene_id, tracks) if tracks else TrackBatch.of(()),
    )


def _box_deg(plan: Area | Track, reach_m: float) -> tuple[float, ...]:
    """Return west, south, east and north of all places that a plan may reach, degrees."""
    corners: NDArray[np.float64]
    if isinstance(plan, Area):
        corners = shapely.get_coordinates(plan.footprint)
    else:
        corners = plan.positions_deg
        if plan.grow_mps or plan.outlines_m is not None or plan.tolerances is not None:
            return _EVERYWHERE
        reach_m += float(np.hypot(*plan.outline_m.T).max())
    (west, south), (east, north) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    width = min(east - west, _WIDE_DEG)
    rise = 0.5 * math.degrees(1.0 / math.cos(math.radians(0.5 * width)) - 1.0)
    up = _SPARE_DEG + rise + reach_m / _METRES_PER_DEGREE
    highest = max(abs(south), abs(north)) + up
    if east - west > _WIDE_DEG or highest > _HIGHEST_DEG:
        return _EVERYWHERE
    across = up / math.cos(math.radians(highest))
    middle = 0.5 * (west + east)
    home = 360.0 * round(middle / 360.0)
    return west - across - home, south - up, east + across - home, north + up
