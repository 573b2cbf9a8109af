"""What stage 1 leaves of a scene: the pairs of pieces whose boxes meet, a range of objects at a time, and the pieces.

In the second transaction of a detection: `dirty_objects`, then `candidates` of ranges of these, and `pieces` of some.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Pieces
from conflictdb.db.store import copy_binary
from conflictdb.db.store.connection import call
from conflictdb.db.store.objects import decode_rings

# Whether all of a scene changed is asked where so many did: that of a few is found by looking at these alone.
_MANY: Final = 100

_CANDIDATE_COLUMNS = [("a", "i8"), ("b", "i8"), ("a_object", "i8"), ("b_object", "i8")]
_PIECE_COLUMNS = [
    ("piece_id", "i8"), ("rank", "i8"), ("kind", "i2"), ("object_id", "i8"), ("version", "i8"), ("part", "i4"),
    ("turn", "i2"), ("start", "i8"), ("end", "i8"), ("end_inclusive", "b1"), ("floor_m", "f8"), ("ceiling_m", "f8"),
    ("leg_start", "i8"), ("leg_end", "i8"), ("start_lon_deg", "f8"), ("start_lat_deg", "f8"), ("end_lon_deg", "f8"),
    ("end_lat_deg", "f8"), ("bearing_deg", "f8"),
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Dirty:
    """The changed objects of a scene by number (n,), increasing, and whether these are all that it has."""

    number: NDArray[np.int64]
    is_all: bool


@dataclass(frozen=True, slots=True)
class Candidates:
    """n pairs of pieces whose boxes meet: ids of the pieces a, b (n,), and numbers of their objects."""

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    a_object: NDArray[np.int64]
    b_object: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.a)


def dirty_objects(conn: psycopg.Connection[Any], scene_id: int) -> Dirty:
    """Return the objects whose pairs are to be found anew; raises StoreError outside of a snapshot."""
    columns, _ = copy_binary.receive(conn, "_dirty_objects", [scene_id], [("number", "i8")])
    number = columns["number"]
    return Dirty(number, len(number) > _MANY and bool(call(conn, "_is_all_dirty", scene_id)[0]))


def candidates(
    conn: psycopg.Connection[Any], scene_id: int, dirty: Dirty, rows: slice, most: int | None = None
) -> Candidates:
    """Return the candidates of some dirty objects, each pair with the first of its dirty objects; `most` at most."""
    first, last = (int(number) for number in dirty.number[rows][[0, -1]])
    arguments = [scene_id, first, last, dirty.is_all, most]
    columns, _ = copy_binary.receive(conn, "_candidates", arguments, _CANDIDATE_COLUMNS)
    return Candidates(*(columns[name] for name, _ in _CANDIDATE_COLUMNS))


def pieces(conn: psycopg.Connection[Any], scene_id: int, piece_ids: NDArray[np.int64]) -> Pieces:
    """Return some pieces of a scene; their order follows kind, key, part and turn, not the database's numbering."""
    strings = ["hull", "shape", "shape_to"]
    columns, wkb = copy_binary.receive(conn, "_pieces", [scene_id, piece_ids.tolist()], _PIECE_COLUMNS, strings)
    return _decoded(columns, *(wkb[name] for name in strings)).take(np.argsort(columns["rank"]))


def _decoded(
    columns: dict[str, NDArray[Any]], hulls: Sequence[bytes], shapes: Sequence[bytes], changed: Sequence[bytes]
) -> Pieces:
    if any(changed):
        start, ring = copy_binary.vertices(shapes, copy_binary.WKB_POLYGON)
        end, _ = copy_binary.vertices([b or a for a, b in zip(shapes, changed, strict=True)], copy_binary.WKB_POLYGON)
        # Opened together: what is a line or a point at one end only keeps all its vertices.
        both, shape_offset = copy_binary.open_rings(np.concatenate([start, end], axis=1), ring)
        shape_xy, shape_to_xy = (np.ascontiguousarray(half) for half in np.split(both, 2, axis=1))
    else:
        shape_xy, shape_offset = decode_rings(shapes)
        shape_to_xy = shape_xy
    hull_xy, hull_offset = copy_binary.vertices(hulls, copy_binary.WKB_POLYGON)
    return Pieces(
        piece_id=columns["piece_id"],
        kind=columns["kind"].astype(np.int8),
        object_id=columns["object_id"],
        version=columns["version"],
        part=columns["part"],
        turn=columns["turn"],
        start_us=copy_binary.microseconds(columns["start"]),
        end_us=copy_binary.microseconds(columns["end"]),
        end_inclusive=columns["end_inclusive"],
        floor_m=columns["floor_m"],
        ceiling_m=columns["ceiling_m"],
        hull_xy=hull_xy,
        hull_offset=hull_offset,
        shape_xy=shape_xy,
        shape_to_xy=shape_to_xy,
        shape_offset=shape_offset,
        leg_start_us=copy_binary.microseconds(columns["leg_start"]),
        leg_end_us=copy_binary.microseconds(columns["leg_end"]),
        leg_start_deg=np.stack([columns["start_lon_deg"], columns["start_lat_deg"]], axis=1),
        leg_end_deg=np.stack([columns["end_lon_deg"], columns["end_lat_deg"]], axis=1),
        bearing_deg=columns["bearing_deg"],
    )
