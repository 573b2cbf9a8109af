"""Keep stored delays current: replace the differences of changed objects, in the transaction of a detection.

Pieces are read for some objects at a time, together with those of all objects that these may meet.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb import store
from conflictdb.arrays.pieces import Pieces
from conflictdb.core import near
from conflictdb.core.delays import differences_with
from conflictdb.core.memory_budget import MemoryBudget
from conflictdb.core.object_pairs import object_numbers
from conflictdb.core.pair_differences import PairDifferences
from conflictdb.earth.registry import Setup

_Ints = NDArray[np.int64]

# Objects in the first batch; the size of later batches follows from the pieces.
_FIRST_OBJECTS: Final = 500
# Pieces take half of the memory; about one in this number of pairs of pieces, whose rows meet, is solved.
_SHARE: Final = 2
_LOOKED_AT: Final = 16
_ROWS_AT_ONCE: Final = 5_000


def refresh_differences(
    conn: psycopg.Connection[Any],
    scene_id: int,
    setup: Setup,
    changed: list[int] | None,
    memory: MemoryBudget,
    *,
    jobs: int = 1,
    progress: Callable[[int, int], object] = lambda done, of: None,
) -> None:
    """Replace the stored differences of the changed objects of a scene, whose pieces are stored.

    changed : numbers of the changed objects, if these are few; None: all objects whose marks are covered
    progress : called with the numbers of objects done and to do
    """
    if not setup.scene.delays_within_s:
        return
    horizon_us = round(1e6 * setup.scene.delays_within_s)
    objects = store.forget_differences(conn, scene_id, changed)
    most, done = _FIRST_OBJECTS, 0
    while done < len(objects):
        progress(done, len(objects))
        some = objects[done : done + most]
        ids, pieces, compared = store.rows_to_compare(conn, scene_id, some, horizon_us + setup.scene.longest_time_us)
        load = max(_SHARE * pieces / memory.pieces, compared / (_LOOKED_AT * memory.pairs))
        if load > 1.0 and len(some) > 1:
            most = max(1, int(len(some) / (2.0 * load)))
            continue
        bundles, place = store.bundles(conn, scene_id, ids)
        pieces_by_key, numbers = _by_key(bundles.pieces.take(np.argsort(place)))
        del bundles
        of_key = object_numbers(pieces_by_key)
        _, row = np.unique(of_key, return_index=True)
        known, number_of = of_key[row], numbers[row]
        stops = store.first_stops(conn, scene_id, number_of)
        by_number = np.argsort(number_of)
        at = np.searchsorted(number_of, stops.track, sorter=by_number)
        stops = replace(stops, track=known[by_number[at]])
        found = differences_with(
            setup,
            near.Memory(pieces_by_key),
            np.unique(of_key[np.isin(numbers, some)]),
            horizon_us,
            jobs,
            waits=stops,
            but=np.unique(of_key[np.isin(numbers, objects[:done])]),
        )
        found = replace(
            found,
            track=number_of[np.searchsorted(known, found.track)],
            other=number_of[np.searchsorted(known, found.other)],
        )
        for part in PairDifferences.of_each(found, horizon_us, _ROWS_AT_ONCE):
            store.write_differences(conn, scene_id, part)
        done += len(some)
        most = max(1, min(4 * most, int(most / (2.0 * load)) if load else 4 * most))


def _by_key(pieces: Pieces) -> tuple[Pieces, _Ints]:
    """Return pieces, which are in the order of keys, with ids in this order, and the numbers (n,) of their objects."""
    numbers = object_numbers(pieces)
    place = np.cumsum(np.append(False, numbers[1:] != numbers[:-1])[: len(numbers)])
    return replace(pieces, object_id=place), numbers
