"""Write the differences that a scene stores, in the transaction of a detection; look delays up in them.

forget_differences; for each chunk of objects: rows_to_compare, bundles, write_differences
"""

from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.object_numbers import kinds_and_ids
from conflictdb.core.delays import Differences, FirstStops, Leeway
from conflictdb.core.forbidden import delays_of
from conflictdb.core.pair_differences import PairDifferences
from conflictdb.model.results import Delays
from conflictdb.store import copy_binary
from conflictdb.store.connection import call, call_many

_Ints = NDArray[np.int64]


def forget_differences(conn: psycopg.Connection[Any], scene_id: int, changed: list[int] | None) -> _Ints:
    """Delete the differences of changed objects; return their numbers, neighbours together.

    changed : their numbers, if these are few; None: all objects whose marks are covered
    """
    return copy_binary.int8_array(call(conn, "_forget_differences", scene_id, changed)[0])


def rows_to_compare(
    conn: psycopg.Connection[Any], scene_id: int, objects: _Ints, horizon_us: int
) -> tuple[_Ints, int, int]:
    """Return the rows of all pieces of objects, and of those that they may meet, by their ids, for `near.Memory`.

    Also return the number of pieces, and of pairs of pieces whose rows meet.

    horizon_us : how much earlier or later one of two objects may be
    """
    piece_ids, pieces, compared = call(conn, "_rows_to_compare", scene_id, objects.tolist(), horizon_us)
    return copy_binary.int8_array(piece_ids), int(pieces), int(compared)


def first_stops(conn: psycopg.Connection[Any], scene_id: int, objects: _Ints) -> FirstStops:
    """Return the tracks, of some objects by number, whose first leg stands still."""
    rows = call_many(conn, "_first_stops", scene_id, objects.tolist())
    number = np.repeat(np.array([row[0] for row in rows], np.int64), [len(row[1]) for row in rows])
    return FirstStops(number, np.array([one for row in rows for one in row[1]], np.int64))


def write_differences(conn: psycopg.Connection[Any], scene_id: int, found: PairDifferences) -> None:
    """Write differences of pairs of objects."""
    kind, other_id = kinds_and_ids(found.other)
    columns: list[tuple[copy_binary.Column, str]] = [
        (copy_binary.fixed(kinds_and_ids(found.track)[1], "i8"), "bigint"),
        (copy_binary.fixed(kind, "i2"), "smallint"),
        (copy_binary.fixed(other_id, "i8"), "bigint"),
        (copy_binary.multiranges(found.forbidden_us, found.forbidden_offset), "int8multirange"),
        (copy_binary.multiranges(found.proven_us, found.proven_offset), "int8multirange"),
    ]
    call(conn, "_write_differences", scene_id, *(copy_binary.array([column], of) for column, of in columns))


def stored_delays(
    conn: psycopg.Connection[Any], scene_id: int, key: str | None, horizon_us: int, now_us: int | None
) -> list[Delays] | None:
    """Return the delays of a track, or of each track, as `questions.delays` does, from stored differences.

    None if they are not complete, or not within this horizon. Unknown tracks are left out.
    """
    rows = call_many(conn, "_stored_differences", scene_id, key, horizon_us)
    if any(row[0] is None for row in rows):
        return None
    found = []
    for track, starts_us, leaves_us, others, low_us, high_us, is_proven in rows:
        keys = dict(enumerate(sorted(set(others))))
        number = {other: n for n, other in keys.items()}
        differences = Differences.of_intervals(
            np.array([number[other] for other in others], np.int64),
            np.array(low_us, np.int64),
            np.array(high_us, np.int64),
            np.array(is_proven, np.bool_),
        )
        leeway = Leeway.between(starts_us, leaves_us, horizon_us, now_us)
        found.append(delays_of(track, keys, differences, horizon_us, leeway))
    return found
