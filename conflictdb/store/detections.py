"""Read and write the input of a detection: marks and pieces (transaction 1), whole areas (transaction 2).

Both transactions hold the scene's lock and see one snapshot each (`locking.begin_locked`); the caller commits. Order of
calls:

    begin_locked; read_settings, changed_areas, changed_tracks, replace_pieces; commit
    begin_locked; the calls of `stored_pairs`, `known_pairs` and `write_rows`; commit
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.column_numbers import NUMBERED
from conflictdb.arrays.objects import AreaBatch, TrackBatch, leg_heights
from conflictdb.arrays.pieces import Bundles
from conflictdb.model.plan_columns import HEIGHT_LIMITS, HeightLimit
from conflictdb.model.results import Kind
from conflictdb.store import copy_binary
from conflictdb.store.connection import call, call_many
from conflictdb.store.stored_bundles import by_place, columns
from conflictdb.store.stored_objects import (
    AREA_COLUMNS,
    AREA_STRINGS,
    TOLERANCES,
    TRACK_COLUMNS,
    TRACK_STRINGS,
    decode_activations,
    decode_heights,
    decode_outlines,
    decode_paths,
    decode_rings,
    decode_tolerances,
)

# Pieces encoded at once: some megabytes, and many per COPY.
_PIECES_SENT: Final = 8_192
# The columns of _area_row and _track_row, besides strings.
AREA_ROW: Final = [*AREA_COLUMNS, *((f"{one.name}_number", "i8") for one in NUMBERED[Kind.AREA])]
TRACK_ROW: Final = [*TRACK_COLUMNS, *((f"{one.name}_number", "i8") for one in NUMBERED[Kind.TRACK])]
# Smaller than every object id.
_FIRST: Final = -(2**63)


def cover_all(conn: psycopg.Connection[Any], scene_id: int) -> None:
    """Mark every object of a scene as changed, with pieces that follow in this transaction."""
    call(conn, "_cover_all", scene_id)


@dataclass(frozen=True, slots=True)
class Pending:
    """The numbers of marks of areas and of tracks that wait for a detection; each counts up to a thousand."""

    areas: int
    tracks: int

    @property
    def objects(self) -> int:
        """Upper bound on the number of waiting objects."""
        return self.areas + self.tracks


def pending(conn: psycopg.Connection[Any], scene_id: int) -> Pending:
    """Return how many objects of a scene wait for a detection."""
    return Pending(*call(conn, "_pending", scene_id))


def changed_areas(
    conn: psycopg.Connection[Any], scene_id: int, after: int = _FIRST, most: int | None = None
) -> AreaBatch:
    """Return the areas of a scene that changed since the last detection: at most `most`, with ids above `after`."""
    sent = copy_binary.receive(conn, "_changed_areas", [scene_id, after, most], AREA_ROW, AREA_STRINGS)
    return area_batch(*sent)


def area_batch(columns: dict[str, NDArray[Any]], strings: dict[str, list[bytes]]) -> AreaBatch:
    """Decode areas from the columns of their rows (_area_row)."""
    footprint = np.empty(len(columns["area_id"]), dtype=object)
    footprint[:] = shapely.from_wkb(strings["footprint"])
    heights: dict[str, Any] = {one.whole: _height(columns, one) for one in HEIGHT_LIMITS}
    return AreaBatch(
        columns["area_id"],
        columns["version"],
        footprint,
        decode_activations(
            strings["activations"],
            np.stack([copy_binary.microseconds(columns[name]) for name in ("start", "end")], axis=1),
        ),
        numbers=_numbers(Kind.AREA, columns),
        **heights,
    )


def _numbers(kind: Kind, columns: Mapping[str, NDArray[Any]]) -> NDArray[np.int64]:
    """Return the numbers (n, k) of NUMBERED in rows."""
    return np.column_stack([columns[f"{one.name}_number"] for one in NUMBERED[kind]])


def _height(columns: Mapping[str, NDArray[Any]], limit: HeightLimit) -> NDArray[np.float64]:
    """Return a height of rows, which have NaN for no limit."""
    return np.where(np.isnan(columns[limit.whole]), limit.unbounded, columns[limit.whole])


def footprints(conn: psycopg.Connection[Any], area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
    """Return the footprints of areas (degrees), in the order of the ids; empty for areas removed meanwhile."""
    known = dict(call_many(conn, "_footprints", area_ids.tolist()))
    found = np.empty(len(area_ids), dtype=object)
    found[:] = [shapely.from_wkb(known[i]) if i in known else shapely.MultiPolygon() for i in area_ids.tolist()]
    return found


def changed_tracks(
    conn: psycopg.Connection[Any], scene_id: int, after: int = _FIRST, most: int | None = None
) -> TrackBatch:
    """Return the tracks of a scene that changed since the last detection: at most `most`, with ids above `after`."""
    sent = copy_binary.receive(
        conn, "_changed_tracks", [scene_id, after, most], TRACK_ROW, [*TRACK_STRINGS, *TOLERANCES]
    )
    return track_batch(*sent)


def track_batch(columns: dict[str, NDArray[Any]], strings: dict[str, list[bytes]]) -> TrackBatch:
    """Decode tracks from the columns of their rows (_track_row)."""
    positions_deg, times_us, waypoint_offset = decode_paths(strings["path"])
    outline_m, outline_offset = decode_rings(strings["outline"])
    outlines_m, outlines_offset = decode_outlines(strings["outlines"], waypoint_offset)
    tolerances = np.empty(len(columns["track_id"]), dtype=object)
    tolerances[:] = [decode_tolerances(one) for one in strings["tolerances"]]
    legs = np.diff(waypoint_offset) - 1
    heights: dict[str, Any] = {
        one.whole: leg_heights(
            _height(columns, one), [decode_heights(sent, one.unbounded) for sent in strings[one.of_legs]], legs
        )
        for one in HEIGHT_LIMITS
    }
    return TrackBatch(
        track_id=columns["track_id"],
        version=columns["version"],
        waypoint_offset=waypoint_offset,
        outline_offset=outline_offset,
        outlines_offset=outlines_offset,
        grow_mps=columns["grow_mps"],
        numbers=_numbers(Kind.TRACK, columns),
        positions_deg=positions_deg,
        times_us=times_us,
        departs=decode_activations(strings["departures"], times_us[waypoint_offset[:-1]]),
        outline_m=outline_m,
        outlines_m=outlines_m,
        tolerances=tolerances,
        **heights,
    )


def order_of_all(conn: psycopg.Connection[Any], scene_id: int, objects: int) -> NDArray[np.int64] | None:
    """Return the numbers of all objects of a scene in the order of kind and key.

    None for a branch, for a scene of more than `objects`, and if an object has no mark for all of its pairs.
    """
    (sent,) = call(conn, "_order_of_all", scene_id, objects)
    return None if sent is None else copy_binary.int8_array(sent)


def are_covered(conn: psycopg.Connection[Any], scene_id: int) -> bool:
    """Return whether the pieces of a scene include every change that the open snapshot sees."""
    return bool(call(conn, "_are_covered", scene_id)[0])


def replace_pieces(
    conn: psycopg.Connection[Any],
    scene_id: int,
    chunks: Iterable[Bundles],
    *,
    is_first: bool = True,
    is_full: bool = False,
    go_on: Callable[[], None] = lambda: None,
) -> None:
    """Replace the pieces of all changed and removed objects of a scene, and record that their marks are covered.

    chunks : the pieces (`bundles_of`), consumed one chunk at a time
    is_first : false in the second transaction of a detection
    is_full : the pieces are those of all objects of the scene, changed or not; equal pieces stay unchanged
    go_on : called before each block is sent; may raise
    """
    srid, is_compared = call(conn, "_begin_pieces", scene_id, is_first, is_full)
    table = "pg_temp.made_piece" if is_compared else "conflictdb.piece"
    count = 0
    for bundles in chunks:
        count += len(bundles)
        for rows in by_place(bundles, _PIECES_SENT):
            go_on()
            copy_binary.send(conn, table, columns(bundles.take(rows), scene_id, srid))
        del bundles
    if is_compared:
        (count,) = call(conn, "_compare_pieces", scene_id)
    call(conn, "_end_pieces", scene_id, count)
