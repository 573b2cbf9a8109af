"""What stage 1 leaves of a scene: the pairs of pieces whose boxes meet, some at a time, and the pieces.

In the second transaction of a detection: `candidates`, and `pieces` of some of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Pieces
from conflictdb.db.store import copy_binary
from conflictdb.db.store.connection import call_each
from conflictdb.db.store.objects import decode_rings

PIECE_COLUMNS = [
    ("piece_id", "i8"), ("rank", "i8"), ("kind", "i2"), ("object_id", "i8"), ("version", "i8"), ("part", "i4"),
    ("turn", "i2"), ("start", "i8"), ("end", "i8"), ("end_inclusive", "b1"), ("floor_m", "f8"), ("ceiling_m", "f8"),
    ("leg_start", "i8"), ("leg_end", "i8"), ("start_lon_deg", "f8"), ("start_lat_deg", "f8"), ("end_lon_deg", "f8"),
    ("end_lat_deg", "f8"), ("bearing_deg", "f8"),
]  # fmt: skip
PIECE_STRINGS = ["hull", "shape", "shape_to"]


@dataclass(frozen=True, slots=True)
class Candidates:
    """n pairs of pieces whose boxes meet: ids of the pieces a, b (n,)."""

    a: NDArray[np.int64]
    b: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.a)


def candidates(conn: psycopg.Connection[Any], scene_id: int, at_once: int) -> Iterator[Candidates]:
    """Yield the candidates of changed objects, each pair with the first of these: so many at once, or a few more.

    All pairs of the same two objects come together. Raises StoreError outside of a snapshot.
    """
    for a, b in call_each(conn, "_candidates", scene_id, at_once, rows_at_once=2):
        yield Candidates(copy_binary.int8_array(a), copy_binary.int8_array(b))


def pieces(conn: psycopg.Connection[Any], scene_id: int, piece_ids: NDArray[np.int64]) -> Pieces:
    """Return some pieces of a scene; their order follows kind, key, part and turn, not the database's numbering."""
    columns, strings = copy_binary.receive(
        conn, "_pieces", [scene_id, piece_ids.tolist()], PIECE_COLUMNS, PIECE_STRINGS
    )
    return decoded(columns, strings).take(np.argsort(columns["rank"]))


def decoded(columns: dict[str, NDArray[Any]], strings: dict[str, list[bytes]]) -> Pieces:
    """Return pieces of the columns of their rows (_pieces), in their order."""
    hulls, shapes, changed = (strings[name] for name in PIECE_STRINGS)
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
