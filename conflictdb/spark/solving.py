"""Stages 2 to 4 on workers: rows of pairs of pieces in, rows of conflicts out.

Of one pair of objects all pairs of pieces come one after the other; a batch that is solved ends where one ends. So its
answer does not depend on how rows are spread over partitions and batches.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.arrow.found import FOUND, of_found
from conflictdb.arrays.packed import PART, TURN, WORD, packed_hulls, unpacked
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.model import Scene
from conflictdb.motion.registry import plane_of
from conflictdb.pipeline.run import run_scene
from conflictdb.spark.pieces import NO_NUMBER
from conflictdb.spark.pieces import SCHEMA as PIECES

# Bytes of rows that are solved at once, beside their number: pieces of many vertices are few.
_MOST_BYTES: Final = 128_000_000
_WORD_TYPE: Final = np.dtype("<i8")

# Pairs of pieces, and the keys of their objects, a before b in the order of kinds and keys.
PAIRS: Final = pa.schema(
    [pa.field(f"{side}_{name}", PIECES.field(name).type) for side in "ab" for name in ("kind", "key", "piece")]
)
SCHEMA: Final = FOUND.schema

# Returns the outlines (WKB, degrees) of areas by their keys.
Outlines = Callable[[], dict[str, bytes]]


def meeting(batches: Iterable[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
    """Yield the rows whose hulls meet (stage 2)."""
    for batch in batches:
        if batch.num_rows:
            (words, begin), n = _words(batch), batch.num_rows
            hulls = packed_hulls(words, begin)
            rows = np.arange(n)
            yield batch.filter(pa.array(~kernel.apart(*hulls, PieceRows(rows), PieceRows(rows + n))))


def solved(
    batches: Iterable[pa.RecordBatch], scene: Scene, outlines: Outlines, pairs_at_once: int
) -> Iterator[pa.RecordBatch]:
    """Yield the conflicts of rows that are sorted by their two keys."""
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
    """Yield rows in parts of about so many, or of so many bytes; those of the same two objects stay together."""
    held: list[pa.RecordBatch] = []
    for batch in batches:
        held.append(batch)
        rows, size = (
            sum(of) for of in zip(*((one.num_rows, one.get_total_buffer_size()) for one in held), strict=True)
        )
        if rows < at_once and size < _MOST_BYTES:
            continue
        table = pa.Table.from_batches(held)
        last = _last_begin(table)
        if last:
            yield table.slice(0, last)
        # Copied: a slice would keep all of it in memory.
        held = pa.Table.from_batches(table.slice(last).to_batches()).combine_chunks().to_batches()
    if held:
        yield pa.Table.from_batches(held)


def _last_begin(table: pa.Table) -> int:
    """Return the row where the last pair of objects begins."""
    a, b = table.column("a_key"), table.column("b_key")
    differs = pc.or_(pc.not_equal(a.slice(1), a.slice(0, len(a) - 1)), pc.not_equal(b.slice(1), b.slice(0, len(b) - 1)))
    begins = np.flatnonzero(np.asarray(differs))
    return int(begins[-1]) + 1 if begins.size else 0


def _words(batch: pa.RecordBatch | pa.Table) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the words of the pieces of all a, then all b, of a batch, and where each piece begins (2 n,)."""
    columns: list[pa.Array] = []
    for name in ("a_piece", "b_piece"):
        column = batch.column(name)
        columns += column.chunks if isinstance(column, pa.ChunkedArray) else [column]
    column = pa.concat_arrays([one.cast(pa.large_binary()) for one in columns])
    _, bounds, data = column.buffers()
    begin = np.frombuffer(bounds, np.int64)[column.offset : column.offset + len(column)]
    return np.frombuffer(data, _WORD_TYPE, count=data.size // WORD), begin // WORD


class _Batch:
    """Rows of pairs as a source of pairs: pieces in the order of kinds, keys, parts and turns, numbered by their keys.

    keys, numbers : of the objects, by the numbers that they have here
    """

    def __init__(self, table: pa.Table, outlines: Outlines) -> None:
        self._outlines = outlines
        coded = pa.chunked_array([*table.column("a_key").chunks, *table.column("b_key").chunks]).combine_chunks()
        coded = coded.dictionary_encode()
        by_key = pc.sort_indices(coded.dictionary)
        self.keys = coded.dictionary.take(by_key)
        number_of = np.empty(len(by_key), np.int64)
        number_of[np.asarray(by_key)] = np.arange(len(by_key))
        number = number_of[np.asarray(coded.indices)]
        words, begin = _words(table)
        first, row = _distinct(words, begin, number)
        pieces = unpacked(words, begin[first])
        self.numbers = np.empty(len(by_key), np.int64)
        self.numbers[number[first]] = pieces.object_id
        self._pieces = replace(pieces, object_id=number[first])
        a, b = np.split(row, 2)
        order = np.lexsort((b, a))
        self._pairs = PieceRows(a[order]), PieceRows(b[order])

    def candidates(self) -> Iterator[tuple[Pieces, PieceRows, PieceRows]]:
        yield self._pieces, *self._pairs

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        known = self._outlines()
        return np.asarray(shapely.from_wkb([known[key] for key in self.keys.take(pa.array(area_ids)).to_pylist()]))


def _distinct(
    words: NDArray[np.int64], begin: NDArray[np.int64], number: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return one of each of the packed pieces, in the order of kinds, keys, parts and turns, and which each (n,) is.

    number : (n,) of the piece's object, in the order of keys
    """
    kind, part, turn = words[begin], words[begin + PART], words[begin + TURN]
    order = np.lexsort((-turn, part, number, kind))
    along = np.stack([kind, number, part, turn])[:, order]
    is_new = np.append(True, (along[:, 1:] != along[:, :-1]).any(axis=0))
    row = np.empty(len(order), np.int64)
    row[order] = np.cumsum(is_new) - 1
    return order[is_new], row
