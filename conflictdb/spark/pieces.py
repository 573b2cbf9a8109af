"""Objects cut into pieces, on workers: batches of the form OBJECTS in, rows of pieces out."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np
import pyarrow as pa
import shapely

from conflictdb.arrays.arrow.objects import to_objects
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.packed import WORD, packed
from conflictdb.arrays.pieces import Pieces
from conflictdb.errors import InvalidInput
from conflictdb.model import Scene
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.pieces.cutting import check_plane
from conflictdb.results import Kind

# Bytes of objects that are cut at once: their pieces take some ten times as much.
_AT_ONCE: Final = 4_000_000
# Number of an object that has none.
NO_NUMBER: Final = -1

# A piece: whose it is, its hull's box (metres of the plane), span and heights, and all of it (`arrays.packed`). An
# object that is refused is a row with nothing but that: JSON with key, field and rule.
SCHEMA: Final = pa.schema(
    [
        pa.field("kind", pa.int8()),
        pa.field("key", pa.string()),
        pa.field("turn", pa.int16()),
        pa.field("west", pa.float64()),
        pa.field("south", pa.float64()),
        pa.field("east", pa.float64()),
        pa.field("north", pa.float64()),
        pa.field("start_us", pa.int64()),
        pa.field("end_us", pa.int64()),
        pa.field("end_inclusive", pa.bool_()),
        pa.field("floor_m", pa.float64()),
        pa.field("ceiling_m", pa.float64()),
        pa.field("piece", pa.binary()),
        pa.field("refused", pa.string()),
    ]
)
# Areas: their outlines, WKB in degrees.
OUTLINES: Final = pa.schema([pa.field("key", pa.string()), pa.field("outline", pa.binary())])


def cut(batches: Iterable[pa.RecordBatch], scene: Scene) -> Iterator[pa.RecordBatch]:
    """Yield the pieces of objects; a batch with an object that is refused is one row that says so."""
    for batch in batches:
        rows = max(1, batch.num_rows * _AT_ONCE // max(batch.get_total_buffer_size(), 1))
        for first in range(0, batch.num_rows, rows):
            try:
                yield _pieces(batch.slice(first, rows), scene)
            except InvalidInput as refusal:
                yield _refused(refusal)


def _pieces(batch: pa.RecordBatch, scene: Scene) -> pa.RecordBatch:
    areas, tracks = to_objects(batch)
    plane = plane_of(scene)
    check_plane(plane, areas, tracks)
    keys = {Kind.AREA: [area.key for area in areas], Kind.TRACK: [track.key for track in tracks]}
    of_kind = {kind: np.flatnonzero(_column(batch, "kind", "").to_numpy(False) == kind.value) for kind in Kind}
    versions, numbers = (
        {kind: _column(batch, name, value).to_numpy(False)[rows] for kind, rows in of_kind.items()}
        for name, value in (("version", 1), ("object_id", NO_NUMBER))
    )
    pieces = pieces_of(
        scene,
        plane,
        replace(AreaBatch.of(areas), version=versions[Kind.AREA]),
        replace(TrackBatch.of(tracks), version=versions[Kind.TRACK]),
    )
    # Numbered within the batch while they are cut.
    of_tracks = pieces.kind == Kind.TRACK.code
    row = pieces.object_id + np.where(of_tracks, len(areas), 0)
    key = pa.array([*keys[Kind.AREA], *keys[Kind.TRACK]], pa.string()).take(pa.array(row))
    number = np.concatenate([numbers[Kind.AREA], numbers[Kind.TRACK]])[row]
    return rows_of(replace(pieces, object_id=number), key)


def rows_of(pieces: Pieces, key: pa.Array) -> pa.RecordBatch:
    """Return pieces as rows, whose objects have these keys (n,)."""
    words, offset = packed(pieces)
    low, high = (
        reduce.reduceat(pieces.hull_xy, pieces.hull_offset[:-1]) if len(pieces) else np.empty((0, 2))
        for reduce in (np.minimum, np.maximum)
    )
    buffers = [None, pa.py_buffer((offset * WORD).astype(np.int32)), pa.py_buffer(words)]
    columns = [
        pa.array(pieces.kind),
        key,
        pa.array(pieces.turn),
        *(pa.array(np.ascontiguousarray(side)) for side in (*low.T, *high.T)),
        pa.array(pieces.start_us),
        pa.array(pieces.end_us),
        pa.array(pieces.end_inclusive),
        pa.array(pieces.floor_m),
        pa.array(pieces.ceiling_m),
        pa.Array.from_buffers(pa.binary(), len(pieces), buffers),
        pa.nulls(len(pieces), pa.string()),
    ]
    return pa.RecordBatch.from_arrays(columns, schema=SCHEMA)


def _column(batch: pa.RecordBatch, name: str, missing: object) -> pa.Array:
    """Return a column of a batch, nulls (or all of it, where it is not there) as a value."""
    if batch.schema.get_field_index(name) < 0:
        return pa.array([missing] * batch.num_rows)
    return batch.column(name).fill_null(missing)


def _refused(refusal: InvalidInput) -> pa.RecordBatch:
    told = json.dumps([refusal.key, refusal.field, refusal.rule, refusal.source])
    columns = [pa.array([told] if name == "refused" else [None], SCHEMA.field(name).type) for name in SCHEMA.names]
    return pa.RecordBatch.from_arrays(columns, schema=SCHEMA)


def refusal_of(told: str) -> InvalidInput:
    """Return what a row says that is refused."""
    return InvalidInput(*json.loads(told))


def outlines(batches: Iterable[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
    """Yield the outlines of areas."""
    for batch in batches:
        areas, _ = to_objects(batch)
        keys = pa.array([area.key for area in areas], pa.string())
        held = shapely.to_wkb([area.footprint for area in areas])
        yield pa.RecordBatch.from_arrays([keys, pa.array(held, pa.binary())], schema=OUTLINES)
