"""Stages 2 to 4 on workers: candidate pairs of rows in, rows of conflicts out.

`meeting` joins the pieces inside two rows and compares hulls (stage 2). After a shuffle by objects, `solved` runs
`run_scene`, which compares the same hulls again, projects and solves (stages 3 and 4).

All pairs of pieces of two objects are adjacent, and a solved batch ends between two pairs of objects. The answer
therefore does not depend on partitions and batches.
"""

from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.arrow.found import FOUND, of_found
from conflictdb.arrays.packed import PART, TURN, WORD, begins_in, unpacked
from conflictdb.arrays.pieces import Bundles, PieceRows
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.kernel.bundles import bundled_pairs
from conflictdb.model import Scene
from conflictdb.motion.registry import plane_of
from conflictdb.pipeline.run import run_scene
from conflictdb.pipeline.source import Chunk
from conflictdb.spark.pieces import NO_NUMBER
from conflictdb.spark.pieces import SCHEMA as PIECES

# Limit on the bytes of rows built, or solved, at a time, besides the limit on their number.
_MOST_BYTES: Final = 128_000_000
_WORD_TYPE: Final = np.dtype("<i8")

# The output of stage 1: two rows of pieces, a before b in the order of kinds and keys.
JOINED: Final = pa.schema(
    [
        pa.field(f"{side}_{name}", PIECES.field(name).type)
        for side in "ab"
        for name in ("kind", "key", "pieces", "outline")
    ]
)
# Pairs of pieces with the keys of their objects. Outlines are those of the rows, only with the first pair of two rows.
PAIRS: Final = pa.schema([field.with_name(field.name.replace("pieces", "piece")) for field in JOINED])
SCHEMA: Final = FOUND.schema

# Returns the outlines (WKB, degrees) of areas by key, for pairs that do not carry them.
Outlines = Callable[[], Mapping[str, bytes]]


def meeting(batches: Iterable[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
    """Yield the pairs of pieces in pairs of rows whose boxes and hulls overlap (stage 2), in bounded batches."""
    for batch in batches:
        if batch.num_rows:
            yield from _meeting(batch)


def _meeting(batch: pa.RecordBatch) -> Iterator[pa.RecordBatch]:
    words, bounds = _words(batch, "pieces")
    begin, offset = begins_in(words, bounds[:-1], bounds[1:])
    pieces, rows = unpacked(words, begin), np.arange(batch.num_rows)
    pairs = bundled_pairs(Bundles(pieces, offset), rows, rows + batch.num_rows)
    meet = ~kernel.apart(pieces.hull_xy, pieces.hull_offset, *pairs)
    a, b = (side[meet] for side in pairs)
    row = np.searchsorted(offset, a, side="right") - 1
    is_first = np.diff(row, prepend=-1) != 0
    ends = np.append(begin, bounds[-1])
    # A piece is repeated in each of its pairs: crowded rows grow many times.
    taken = WORD * np.cumsum(np.diff(ends)[a] + np.diff(ends)[b])
    cuts = np.flatnonzero(np.diff(taken // _MOST_BYTES)) + 1
    for some in np.split(np.arange(len(a)), cuts):
        of, of_first = pa.array(row[some]), pa.array(row[some], mask=~is_first[some])
        columns: list[pa.Array] = []
        for side, of_side in (("a", a), ("b", b)):
            kind, key = (batch.column(f"{side}_{name}").take(of) for name in ("kind", "key"))
            to, index = ragged_rows(ends, of_side[some])
            buffers = [None, pa.py_buffer((to * WORD).astype(np.int32)), pa.py_buffer(words[index])]
            piece = pa.Array.from_buffers(pa.binary(), len(some), buffers)
            columns += [kind, key, piece, batch.column(f"{side}_outline").take(of_first)]
        yield pa.RecordBatch.from_arrays(columns, schema=PAIRS)


def solved(
    batches: Iterable[pa.RecordBatch], scene: Scene, outlines: Outlines, pairs_at_once: int
) -> Iterator[pa.RecordBatch]:
    """Yield the conflicts of pairs that are sorted by their two keys."""
    for table in _whole(batches, pairs_at_once):
        source = _Batch(table, outlines)
        for found, _ in run_scene(scene, plane_of(scene), source):
            keys = [source.keys.take(pa.array(ids)) for ids in (found.a_id, found.b_id)]
            region = found.where(np.arange(len(found)))
            numbered = replace(found, a_id=source.numbers[found.a_id], b_id=source.numbers[found.b_id])
            yield _without_unknown_numbers(of_found(scene, numbered, region, *keys))


def _without_unknown_numbers(found: pa.RecordBatch) -> pa.RecordBatch:
    for name in ("a_id", "b_id"):
        column = found.column(name)
        known = pc.if_else(pc.equal(column, NO_NUMBER), None, column)
        found = found.set_column(found.schema.get_field_index(name), found.schema.field(name), known)
    return found


def _whole(batches: Iterable[pa.RecordBatch], at_once: int) -> Iterator[pa.Table]:
    """Yield rows in parts of about `at_once` rows or _MOST_BYTES; rows of the same two objects stay together."""
    queued: list[pa.RecordBatch] = []
    # Rows and bytes in `queued`, and the first row of its last pair of objects.
    rows = size = last = 0
    for batch in batches:
        if not batch.num_rows:
            continue
        begin = _last_begin(batch, queued[-1] if queued else None)
        last = last if begin is None else rows + begin
        queued.append(batch)
        rows, size = rows + batch.num_rows, size + batch.get_total_buffer_size()
        if last and (rows >= at_once or size >= _MOST_BYTES):
            table = pa.Table.from_batches(queued)
            yield table.slice(0, last)
            # Copy: a slice would keep the whole table in memory.
            queued = pa.Table.from_batches(table.slice(last).to_batches()).combine_chunks().to_batches()
            rows, size, last = rows - last, sum(one.get_total_buffer_size() for one in queued), 0
    if queued:
        yield pa.Table.from_batches(queued)


def _last_begin(batch: pa.RecordBatch, before: pa.RecordBatch | None) -> int | None:
    """Return the first row of a batch's last pair of objects; None if that pair began before the batch."""
    a, b = batch.column("a_key"), batch.column("b_key")
    differs = pc.or_(pc.not_equal(a[1:], a[:-1]), pc.not_equal(b[1:], b[:-1]))
    begins = np.flatnonzero(np.asarray(differs, np.bool_))
    if begins.size:
        return int(begins[-1]) + 1
    if before is None:
        return 0
    goes_on = all(batch.column(name)[0] == before.column(name)[-1] for name in ("a_key", "b_key"))
    return None if goes_on else 0


def _words(batch: pa.RecordBatch | pa.Table, name: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the words of a column of all a, then all b, and the bounds of each row (2 n + 1,)."""
    columns: list[pa.Array] = []
    for side in "ab":
        column = batch.column(f"{side}_{name}")
        columns += column.chunks if isinstance(column, pa.ChunkedArray) else [column]
    column = pa.concat_arrays([one.cast(pa.large_binary()) for one in columns])
    _, bounds, data = column.buffers()
    bounds = np.frombuffer(bounds, np.int64)[column.offset : column.offset + len(column) + 1]
    return np.frombuffer(data, _WORD_TYPE, count=data.size // WORD), bounds // WORD


class _Batch:
    """Rows of pairs as a source of pairs: pieces ordered by kind, key, part and turn, objects numbered by key.

    keys, numbers : of the objects, by their numbers here
    """

    def __init__(self, table: pa.Table, outlines: Outlines) -> None:
        self._outlines, self._table = outlines, table
        coded = pa.chunked_array([*table.column("a_key").chunks, *table.column("b_key").chunks]).combine_chunks()
        coded = coded.dictionary_encode()
        by_key = pc.sort_indices(coded.dictionary)
        self.keys = coded.dictionary.take(by_key)
        number_of = np.empty(len(by_key), np.int64)
        number_of[np.asarray(by_key)] = np.arange(len(by_key))
        number = number_of[np.asarray(coded.indices)]
        words, bounds = _words(table, "piece")
        begin = bounds[:-1]
        first, row = _distinct(words, begin, number)
        pieces = unpacked(words, begin[first])
        self.numbers = np.empty(len(by_key), np.int64)
        self.numbers[number[first]] = pieces.object_id
        self._pieces = replace(pieces, object_id=number[first])
        a, b = np.split(row, 2)
        order = np.lexsort((b, a))
        self._pairs = PieceRows(a[order]), PieceRows(b[order])

    def candidates(self) -> Iterator[Chunk]:
        yield Chunk(self._pieces, *self._pairs)

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        carried: dict[str, bytes] = {}
        for side in "ab":
            outline = self._table.column(f"{side}_outline")
            keys, outlines = (one.filter(outline.is_valid()) for one in (self._table.column(f"{side}_key"), outline))
            carried |= zip(keys.to_pylist(), outlines.to_pylist(), strict=True)
        known = ChainMap(carried, self._outlines())  # type: ignore[arg-type]  # read only
        return np.asarray(shapely.from_wkb([known[key] for key in self.keys.take(pa.array(area_ids)).to_pylist()]))


def _distinct(
    words: NDArray[np.int64], begin: NDArray[np.int64], number: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the distinct packed pieces, ordered by kind, key, part and turn, and the index of each piece (n,) in them.

    number : (n,) of the piece's object, in the order of keys
    """
    kind, part, turn = words[begin], words[begin + PART], words[begin + TURN]
    order = np.lexsort((-turn, part, number, kind))
    along = np.stack([kind, number, part, turn])[:, order]
    is_new = np.append(True, (along[:, 1:] != along[:, :-1]).any(axis=0))
    row = np.empty(len(order), np.int64)
    row[order] = np.cumsum(is_new) - 1
    return order[is_new], row
