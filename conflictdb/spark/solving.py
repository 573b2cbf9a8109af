"""The stages on workers: pieces in units of space and time in, then pairs in groups of objects, rows of conflicts out.

`meeting` finds the pairs in each unit, and compares hulls (stages 1 and 2). After a shuffle by groups, `solved` runs
`run_scene`, which compares the same hulls again, projects and solves (stages 3 and 4).

All pairs of pieces of two objects are in one group, each once.
"""

from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.arrow.found import FOUND, of_found
from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.packed import PART, TURN, WORD, begins_in, unpacked
from conflictdb.arrays.pieces import Bundles, PieceRows
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.core.near import Chunk, Question
from conflictdb.core.object_pairs import chunks_of_objects, object_numbers
from conflictdb.core.run import run_scene
from conflictdb.earth.registry import Setup
from conflictdb.kernel.boxes import RowBoxes, box_pairs, near_order
from conflictdb.kernel.bundles import bundled_pairs
from conflictdb.model.plans import Scene
from conflictdb.spark.cut_objects import NO_NUMBER, read_plan
from conflictdb.spark.cut_objects import SCHEMA as PIECES
from conflictdb.spark.work_units import Cells, two_blocks

# Limit on the bytes of rows built at a time, and on the pairs of rows found at a time.
_MOST_BYTES: Final = 128_000_000
_PAIRS_AT_ONCE: Final = 200_000
# The id of a piece is the number of its unit above its number there.
_UNIT_BIT: Final = 32
_WORD_TYPE: Final = np.dtype("<i8")

# Rows of pieces in the units in which they are joined (`work_units`); `dealt` is a hash of the object's key.
_BOX: Final = ("west", "south", "east", "north")
_OF_ROW: Final = ("kind", "key", "turn", *_BOX, "start_us", "end_us", "floor_m", "ceiling_m", "pieces", "outline")
PLACED: Final = pa.schema(
    [pa.field("unit", pa.int32()), pa.field("dealt", pa.int32()), *(PIECES.field(name) for name in _OF_ROW)]
)
# Pieces in the groups in which their pairs are solved: `id` is that of a piece in its unit, `mates` those of the later
# members of its pairs. An area's outline comes with its first piece.
MET: Final = pa.schema(
    [
        pa.field("group", pa.int32()),
        PIECES.field("key"),
        pa.field("id", pa.int64()),
        pa.field("piece", pa.binary()),
        pa.field("mates", pa.binary()),
        PIECES.field("outline"),
    ]
)
SCHEMA: Final = FOUND.schema

# Returns the outlines (WKB, degrees) of areas by key, for pairs that do not carry them.
Outlines = Callable[[], Mapping[str, bytes]]


def meeting(
    batches: Iterable[pa.RecordBatch], cells: Cells, blocks: int, within_us: int = 0
) -> Iterator[pa.RecordBatch]:
    """Yield the pairs of pieces whose boxes and hulls overlap (stages 1 and 2), in bounded batches of the form MET.

    batches : of the form PLACED, sorted by unit
    cells : by which the pieces were placed
    blocks : number of blocks of all objects; each two, and each one, are a group
    within_us : the largest separation in time of the scene's pairs, microseconds
    """
    for table in _runs(batches, "unit"):
        unit = _Unit(table, blocks, within_us)
        cell, is_of_two = cells.of_unit(unit.number)
        block = unit.dealt % cells.blocks[cell]
        for a, b in unit.row_pairs():
            corner = np.maximum(unit.corner[a], unit.corner[b])
            counts = ((corner >= cells.low[cell]) & (corner < cells.high[cell])).all(axis=1)
            if is_of_two:
                counts &= block[a] != block[b]
            yield from unit.met(a[counts], b[counts])


class _Unit:
    """The rows of a unit.

    number : of the unit
    corner : (n, 3) least place and time of each row
    dealt : (n,) hash of each row's object
    """

    def __init__(self, rows: pa.Table, blocks: int, within_us: int) -> None:
        self._rows, self._blocks, self._within_us = rows, blocks, within_us
        self._column = {f.name: rows.column(f.name).to_numpy() for f in PLACED if pa.types.is_primitive(f.type)}
        self.number, self.dealt = int(self._column["unit"][0]), self._column["dealt"].astype(np.int64)
        self.corner = np.stack([self._column[name].astype(np.float64) for name in ("west", "south", "start_us")], 1)
        self._words, bounds = _words(rows, "pieces")
        begin, offset = begins_in(self._words, bounds[:-1], bounds[1:])
        self._bundles, self._ends = Bundles(unpacked(self._words, begin), offset), np.append(begin, bounds[-1])
        self._row = np.repeat(np.arange(len(rows)), np.diff(offset))

    def row_pairs(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Yield the pairs of rows whose boxes intersect, a before b in the order of kinds and keys."""
        of = self._column
        boxes = RowBoxes(
            boxes=np.stack([of[name] for name in _BOX], axis=1),
            floor_m=of["floor_m"],
            ceiling_m=of["ceiling_m"],
            start_us=of["start_us"],
            end_us=of["end_us"],
            object=numbers_of(of["kind"], _numbered(self._rows.column("key"))[1]),
            is_copy=of["turn"] != 0,
        )
        order = near_order(boxes)
        boxes = boxes.take(order)
        for a, b, _ in box_pairs(boxes, np.argsort(boxes.object, kind="stable"), _PAIRS_AT_ONCE):
            yield order[a], order[b]

    def met(self, a: NDArray[np.int64], b: NDArray[np.int64]) -> Iterator[pa.RecordBatch]:
        """Yield the pairs of pieces in rows a and b (m,) whose boxes and hulls overlap."""
        pieces = self._bundles.pieces
        pairs = bundled_pairs(self._bundles, a, b, self._within_us)
        meet = ~kernel.apart(pieces.hull_xy, pieces.hull_offset, *pairs)
        a, b = (side[meet] for side in pairs)
        block = (self.dealt % self._blocks)[self._row]
        group = two_blocks(np.minimum(block[a], block[b]), np.maximum(block[a], block[b]))
        # Sorted by group, then piece: each piece of a group once, with its later members.
        n = len(pieces)
        of_a, of_b = group * n + a, group * n + b
        order, members = np.argsort(of_a, kind="stable"), np.unique(np.append(of_a, of_b))
        first = np.append(np.searchsorted(of_a[order], members), len(a))
        mates, (group, piece) = b[order] + self._id, np.divmod(members, n)
        row = self._row[piece]
        is_first = (np.diff(group, prepend=-1) != 0) | (np.diff(row, prepend=-1) != 0)
        taken = WORD * np.cumsum(np.diff(self._ends)[piece] + np.diff(first))
        for some in np.split(np.arange(len(members)), np.flatnonzero(np.diff(taken // _MOST_BYTES)) + 1):
            columns = [
                pa.array(group[some].astype(np.int32)),
                self._rows.column("key").chunk(0).take(pa.array(row[some])),
                pa.array(piece[some] + self._id),
                _taken(self._words, self._ends, piece[some]),
                _taken(mates, first, some),
                self._rows.column("outline").chunk(0).take(pa.array(row[some], mask=~is_first[some])),
            ]
            yield pa.RecordBatch.from_arrays(columns, schema=MET)

    @property
    def _id(self) -> int:
        """The id of the first piece."""
        return self.number << _UNIT_BIT


def _taken(words: NDArray[np.int64], offset: NDArray[np.int64], rows: NDArray[np.int64]) -> pa.Array:
    """Return the words of some rows as bytes."""
    to, index = ragged_rows(offset, rows)
    buffers = [None, pa.py_buffer((to * WORD).astype(np.int32)), pa.py_buffer(words[index])]
    return pa.Array.from_buffers(pa.binary(), len(rows), buffers)


def solved(
    batches: Iterable[pa.RecordBatch], scene: Scene, outlines: Outlines, pairs_at_once: int
) -> Iterator[pa.RecordBatch]:
    """Yield the conflicts of pairs.

    batches : of the form MET, sorted by group
    """
    for table in _runs(batches, "group"):
        source = _Group(table, outlines, pairs_at_once)
        for found, _ in run_scene(Setup.of(scene), source):
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


def _runs(batches: Iterable[pa.RecordBatch], name: str) -> Iterator[pa.Table]:
    """Yield the rows of each value of a column, by which they are sorted."""
    queued: list[pa.RecordBatch] = []
    for batch in filter(len, batches):
        value = batch.column(name).to_numpy()
        ends = np.append(np.flatnonzero(np.diff(value)) + 1, len(value))
        for first, end in pairwise([0, *ends.tolist()]):
            if queued and queued[-1].column(name)[0].as_py() != value[first]:
                yield pa.Table.from_batches(queued).combine_chunks()
                queued = []
            queued.append(batch.slice(first, end - first))
    if queued:
        yield pa.Table.from_batches(queued).combine_chunks()


def _words(table: pa.Table, name: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the words of a column, and the bounds of each row (n + 1,)."""
    column = pa.concat_arrays([one.cast(pa.large_binary()) for one in table.column(name).chunks])
    _, bounds, data = column.buffers()
    bounds = np.frombuffer(bounds, np.int64)[column.offset : column.offset + len(column) + 1]
    return np.frombuffer(data, _WORD_TYPE, count=data.size // WORD), bounds // WORD


def _numbered(keys: pa.ChunkedArray) -> tuple[pa.Array, NDArray[np.int64]]:
    """Return the distinct keys in their order, and the number of each key (n,) in them."""
    coded = keys.combine_chunks().dictionary_encode()
    by_key = pc.sort_indices(coded.dictionary)
    number_of = np.empty(len(by_key), np.int64)
    number_of[np.asarray(by_key)] = np.arange(len(by_key))
    return coded.dictionary.take(by_key), number_of[np.asarray(coded.indices)]


class _Group:
    """A group as a source of pairs: pieces ordered by kind, key, part and turn, objects numbered by key.

    keys, numbers : of the objects, by their numbers here
    """

    def __init__(self, table: pa.Table, outlines: Outlines, pairs_at_once: int) -> None:
        self._outlines, self._table, self._at_once = outlines, table, pairs_at_once
        self.keys, number = _numbered(table.column("key"))
        words, bounds = _words(table, "piece")
        begin = bounds[:-1]
        first, row = _distinct(words, begin, number)
        pieces = unpacked(words, begin[first])
        self.numbers = np.empty(len(self.keys), np.int64)
        self.numbers[number[first]] = pieces.object_id
        self._pieces = replace(pieces, object_id=number[first])
        mates, bounds = _words(table, "mates")
        ids = table.column("id").to_numpy()
        by_id = np.argsort(ids)
        a = np.repeat(row, np.diff(bounds))
        b = row[by_id[np.searchsorted(ids[by_id], mates[bounds[0] : bounds[-1]])]]
        order = np.lexsort((b, a))
        self._a, self._b = a[order], b[order]

    def pairs(self, _: Question) -> Iterator[Chunk]:
        number = object_numbers(self._pieces)
        for rows in chunks_of_objects(number[self._a], number[self._b], self._at_once):
            yield Chunk(self._pieces, PieceRows(self._a[rows]), PieceRows(self._b[rows]))

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        return np.asarray(shapely.from_wkb(self._carried(area_ids)))

    def plans(self, track_ids: NDArray[np.int64]) -> TrackBatch:
        tracks = [read_plan(plan) for plan in self._carried(track_ids)]
        return replace(TrackBatch.of(tracks), track_id=track_ids)

    def _carried(self, ids: NDArray[np.int64]) -> list[bytes]:
        carried = self._table.filter(self._table.column("outline").is_valid())
        carried = dict(zip(*(carried.column(name).to_pylist() for name in ("key", "outline")), strict=True))
        known = ChainMap(carried, self._outlines())  # type: ignore[arg-type]  # read only
        return [known[key] for key in self.keys.take(pa.array(ids)).to_pylist()]


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
