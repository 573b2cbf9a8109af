"""Provide the candidate pairs of a scene of the database: stage 1 and the pieces of its rows.

If many objects changed and the boxes of all rows fit the memory, rows are joined here. Otherwise the database joins
them through its index. If few pieces are involved, it also runs stage 2.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, replace
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb import store
from conflictdb.arrays.object_numbers import kinds_and_ids
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import Bundles, PieceRows, Pieces
from conflictdb.core.memory_budget import DEFAULT_MEMORY, MemoryBudget
from conflictdb.core.near import Chunk, Question
from conflictdb.core.object_pairs import chunks_of_objects, object_numbers
from conflictdb.core.separations import NEVER, Separations
from conflictdb.kernel.boxes import RowBoxes, box_pairs, near_order
from conflictdb.kernel.bundles import bundled_pairs
from conflictdb.model.plans import Area, Track

# Read bundles by id; also return the rank of each piece in object order.
Read = Callable[[NDArray[np.int64]], tuple[Bundles, NDArray[np.int64]]]

# Pairs of pieces compared per pair requested: about one in forty overlaps.
_LOOKED_AT: Final = 16
# Up to this many pairs of pieces of overlapping rows, stage 2 runs in the database, which then sends fewer pieces. In a
# sea of 5,000 objects a changed track has 200 pairs (median), which take 0.5 ms there; 96 % of the tracks are below.
MOST_COMPARED: Final = 1_000
# More than an object has parts: a number for a row and a part of it.
_MOST_PARTS: Final = 2**32
# Object number of a plan beside a scene; the database counts from 1.
PLAN: Final = 0
# FewStored reads at most this fraction of the pairs that would fit: rows may contain many pieces.
_SHARE_OF_FEW: Final = 8


class Stored:
    """The changed pieces of a scene of the database and all they may meet, as a source of pairs.

    meanwhile : called after each read of pieces, when the database is idle until they are solved
    separations : of the scene; None: all pairs are compared
    waited_s : seconds of waiting for pieces to be stored
    """

    waited_s: float = 0.0

    def __init__(
        self,
        conn: psycopg.Connection[Any],
        scene_id: int,
        memory: MemoryBudget = DEFAULT_MEMORY,
        meanwhile: Callable[[], None] = lambda: None,
        separations: Separations | None = None,
    ) -> None:
        self._conn, self.scene_id, self._memory, self._meanwhile = conn, scene_id, memory, meanwhile
        self._separations = separations

    def pairs(self, question: Question) -> Iterator[Chunk]:
        """Implement `PairSource`; join boxes here if `store.boxes` returns them, else in the database.

        It returns them if many objects changed and they fit the memory (`_row_boxes`, sql/20_stage1_broad_phase.sql).
        """
        within_us = question.within_us
        rows = store.boxes(self._conn, self.scene_id, self._memory.boxes)
        if not len(rows):
            for found in store.candidates(self._conn, self.scene_id, self._memory.pairs):
                for chunk in pairs_of_rows(found, self._read, self._memory, within_us):
                    yield chunk._replace(share=None)
            return
        ids, pieces, boxes, marks = rows.ids, rows.pieces, rows.boxes, rows.marks
        memory = self._memory.beside(len(ids))
        if self._separations is not None:
            boxes = replace(boxes, type=self._separations.types(kinds_and_ids(boxes.object)[0], rows.class_number))
        del rows
        is_in_parts = marks is not None or pieces.sum() > memory.pieces
        bundles, place = (None, None) if is_in_parts else self._read(ids)
        at_once = memory.row_pairs(len(ids))
        joined_rows = joined(ids, pieces, boxes, at_once, within_us, self._compared, marks)
        del ids, pieces, boxes, marks

        def chunks_of(found: store.Candidates) -> Iterator[Chunk]:
            if bundles is None or place is None:
                return pairs_of_rows(found, self._read, memory, within_us)
            return pairs_of_bundles(bundles, place, found.a, found.b, memory.pairs_at_once, within_us)

        yield from with_shares((chunks_of(found), found.share) for found in joined_rows)

    @property
    def _compared(self) -> NDArray[np.bool_] | None:
        """Whether objects of two types are compared (`may_meet`)."""
        return None if self._separations is None else self._separations.of_types != NEVER

    def _read(self, ids: NDArray[np.int64]) -> tuple[Bundles, NDArray[np.int64]]:
        found = store.bundles(self._conn, self.scene_id, ids)
        self._meanwhile()
        return found

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        """Implement `PairSource`."""
        return store.footprints(self._conn, area_ids)

    def plans(self, track_ids: NDArray[np.int64]) -> TrackBatch:
        """Implement `PairSource`."""
        return store.seen_tracks(self._conn, self.scene_id, track_ids.tolist())


class FewStored(Stored):
    """The pieces of few changed objects, which it stores, and all they may meet.

    srid : of the scene's plane
    most_compared : pairs of pieces up to which the database runs stage 2
    """

    def __init__(
        self,
        conn: psycopg.Connection[Any],
        scene_id: int,
        memory: MemoryBudget,
        srid: int,
        pieces: Pieces,
        most_compared: int = MOST_COMPARED,
        separations: Separations | None = None,
    ) -> None:
        super().__init__(conn, scene_id, memory, separations=separations)
        self._srid, self._pieces, self._most_compared = srid, pieces, most_compared

    def pairs(self, question: Question) -> Iterator[Chunk]:
        """Store the pieces, and yield their pairs."""
        if not len(self._pieces):
            return
        # One more than fits shows that there are too many.
        most = self._memory.pairs // _SHARE_OF_FEW + 1
        met = store.put_pieces(self._conn, self.scene_id, self._srid, self._pieces, most, self._most_compared)
        if met.parts is not None:
            chunk = pairs_of_parts(met.bundles, met.place, met.a, met.b, met.parts)
            yield chunk._replace(candidate_pairs=met.candidate_pairs, stage2_s=met.stage2_s)
        elif len(met.a) < most:
            yield from pairs_of_bundles(met.bundles, met.place, met.a, met.b, self._memory.pairs, question.within_us)
        else:
            del met
            yield from super().pairs(question)


class StoredWithPlan(Stored):
    """The pieces of one plan, which is not stored, and those of a scene that they may meet, as a source of pairs.

    One statement finds the pairs, by the index and the rule that all pairs of the database go through.

    replaced : the key of an object that is left out
    most_compared : pairs of pieces up to which the database runs stage 2
    """

    def __init__(
        self,
        conn: psycopg.Connection[Any],
        scene_id: int,
        plan: Area | Track,
        replaced: str | None,
        pieces: Pieces,
        memory: MemoryBudget,
        most_compared: int = MOST_COMPARED,
    ) -> None:
        super().__init__(conn, scene_id, memory)
        self._most_compared = most_compared
        self._plan, self._replaced, self._pieces = plan, replaced, pieces

    def pairs(self, question: Question) -> Iterator[Chunk]:
        """Yield the pairs of the plan with the scene."""
        within_us = question.within_us
        longer = self._pieces.longer(within_us, within_us)
        near, parts = store.pieces_meeting(self._conn, self.scene_id, longer, self._replaced, self._most_compared)
        if not len(near):
            return
        if parts is not None:
            yield pairs_of_parts(*self._with_plan(np.unique(near.b)), near.a, near.b, parts)
        else:
            yield from pairs_of_rows(near, self._with_plan, self._memory, within_us)

    def _with_plan(self, ids: NDArray[np.int64]) -> tuple[Bundles, NDArray[np.int64]]:
        """Return rows of the scene, and the plan's pieces, numbered -1, -2, ..., ranked first of their kind."""
        others, place = store.bundles(self._conn, self.scene_id, ids[ids >= 0])
        n = len(self._pieces)
        plan = replace(self._pieces, piece_id=-1 - np.arange(n))
        every = Bundles.concatenate([Bundles.of_each(plan), others])
        order = np.lexsort((np.append(np.arange(n) - n, place), every.pieces.kind))
        places = np.empty(len(order), np.int64)
        places[order] = np.arange(len(order))
        return every, places

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        """Implement `PairSource`."""
        found = super().footprints(area_ids)
        if isinstance(self._plan, Area):
            found[area_ids == PLAN] = self._plan.footprint
        return found

    def plans(self, track_ids: NDArray[np.int64]) -> TrackBatch:
        """Implement `PairSource`."""
        found = store.some_tracks(self._conn, self.scene_id, track_ids[track_ids != PLAN].tolist())
        if isinstance(self._plan, Area) or self._plan.tolerances is None:
            return found
        return found.followed_by(replace(TrackBatch.of([self._plan]), track_id=np.array([PLAN])))


def joined(
    ids: NDArray[np.int64],
    pieces: NDArray[np.integer[Any]],
    boxes: RowBoxes,
    at_once: int,
    within_us: int = 0,
    compared: NDArray[np.bool_] | None = None,
    marks: store.Marks | None = None,
) -> Iterator[store.Candidates]:
    """Yield the result of `store.candidates` for rows of pieces, joined here.

    The arrays of the rows are sorted in place, as a million of them are not to be in memory twice.

    marks : of the rows; None: all pairs are marked
    """
    order = near_order(boxes)
    columns = [ids, pieces, *(column for one in fields(boxes) if (column := getattr(boxes, one.name)) is not None)]
    for column in columns:
        column[:] = column[order]
    if marks is not None:
        marks = marks.take(order)
    del order, columns
    # Order by the place of the first object, so that pairs of a chunk share pieces.
    _, first, number = np.unique(boxes.object, return_index=True, return_inverse=True)
    place = np.empty(len(first), np.int64)
    place[np.argsort(first)] = np.arange(len(first))
    place_of_row, objects_count = place[number], len(place)
    del first, number, place
    found: store.Candidates | None = None
    for a, b, _ in box_pairs(boxes, np.argsort(place_of_row, kind="stable"), at_once, within_us, compared):
        share = float(place_of_row[a].max() + 1) / objects_count
        if marks is not None:
            dirty = marks.are_dirty(a, b)
            a, b = a[dirty], b[dirty]
        if not len(a):
            continue
        if found is not None:
            yield found
        objects = place_of_row[a] * objects_count + place_of_row[b]
        together = np.argsort(objects, kind="stable")
        a, b = a[together], b[together]
        a_pieces, b_pieces = pieces[a].astype(np.int64), pieces[b].astype(np.int64)
        found = store.Candidates(ids[a], ids[b], a_pieces, b_pieces, objects[together], share)
    if found is not None:
        # Further objects may have no pairs.
        yield replace(found, share=1.0)


def pairs_of_rows(found: store.Candidates, read: Read, memory: MemoryBudget, within_us: int) -> Iterator[Chunk]:
    """Yield the pairs of pieces of pairs of rows that come within a time, in chunks that fit the memory."""

    def parts() -> Iterator[tuple[Iterator[Chunk], float]]:
        done = 0
        for some in _readable(found, memory.pieces):
            bundles, place = read(np.unique(np.concatenate([some.a, some.b])))
            done += len(some)
            yield pairs_of_bundles(bundles, place, some.a, some.b, memory.pairs_at_once, within_us), done / len(found)

    return with_shares(parts())


def with_shares(parts: Iterable[tuple[Iterator[Chunk], float | None]]) -> Iterator[Chunk]:
    """Yield the chunks of all parts with their shares of all pairs.

    parts : the chunks of each, with their shares of its pairs, and the share of all pairs that is found after it
    """
    before = 0.0
    for chunks, share in parts:
        after = share or 1.0
        for chunk in chunks:
            yield chunk._replace(share=before + (after - before) * (1.0 if chunk.share is None else chunk.share))
        before = after


def pairs_of_parts(
    bundles: Bundles, place: NDArray[np.int64], a: NDArray[np.int64], b: NDArray[np.int64], parts: store.Parts
) -> Chunk:
    """Return pairs of pieces that the database has found, by the ids of their rows and their parts."""
    ids, row = np.unique(bundles.pieces.piece_id, return_inverse=True)
    # Parts count from -1.
    number = row * _MOST_PARTS + bundles.pieces.part
    by_number = np.argsort(number)
    rows = (
        by_number[np.searchsorted(number, np.searchsorted(ids, of) * _MOST_PARTS + part, sorter=by_number)]
        for of, part in zip((a, b), parts, strict=True)
    )
    return _in_order(bundles.pieces, place, *rows)


def _readable(found: store.Candidates, most: int) -> Iterator[store.Candidates]:
    """Yield pairs of rows that have at most `most` pieces, or belong to the same two objects."""
    _, first = np.unique(np.concatenate([found.a, found.b]), return_index=True)
    between = np.flatnonzero(found.objects[1:] != found.objects[:-1]) + 1
    if not between.size or np.concatenate([found.a_pieces, found.b_pieces])[first].sum() <= most:
        yield found
        return
    middle = int(between[np.argmin(np.abs(between - len(found) // 2))])
    yield from _readable(found.take(slice(0, middle)), most)
    yield from _readable(found.take(slice(middle, len(found))), most)


def pairs_of_bundles(
    bundles: Bundles,
    place: NDArray[np.int64],
    a: NDArray[np.int64],
    b: NDArray[np.int64],
    at_once: int,
    within_us: int,
) -> Iterator[Chunk]:
    """Yield the overlapping pairs of pieces of bundles, by id; all pairs of the same two objects in one chunk.

    Their shares are of these pairs.
    """
    pieces, size = bundles.pieces, np.diff(bundles.offset)
    first = bundles.offset[:-1]
    ids, number = pieces.piece_id[first], object_numbers(pieces)[first]
    by_id = np.argsort(ids)
    a, b = (by_id[np.searchsorted(ids, some, sorter=by_id)] for some in (a, b))
    # One number sorts in a third of the time of two.
    _, object_rank = np.unique(number, return_inverse=True)
    order = np.argsort(object_rank[a] * len(ids) + object_rank[b], kind="stable")
    a, b = a[order], b[order]
    looked_at = np.cumsum(size[a] * size[b])
    ends = np.append(np.flatnonzero((number[a][1:] != number[a][:-1]) | (number[b][1:] != number[b][:-1])) + 1, len(a))
    start, met, done, waiting = 0, 0, 0.0, []
    while start < len(a):
        before = int(looked_at[start - 1]) if start else 0
        fits = int(np.searchsorted(looked_at[ends - 1], before + _LOOKED_AT * at_once, side="right")) - 1
        end = int(ends[max(fits, int(np.searchsorted(ends, start, side="right")))])
        waiting.append(bundled_pairs(bundles, a[start:end], b[start:end], within_us))
        met, start = met + len(waiting[-1][0]), end
        if met >= at_once or start == len(a):
            rows_a, rows_b = (np.concatenate(some) for some in zip(*waiting, strict=True))
            numbers, left = object_numbers(pieces), len(rows_a)
            for rows in chunks_of_objects(numbers[rows_a], numbers[rows_b], at_once):
                done += (start - done) * len(rows) / max(left, 1)
                left -= len(rows)
                yield _in_order(pieces, place, rows_a[rows], rows_b[rows])._replace(share=done / len(a))
            met, waiting = 0, []


def _in_order(pieces: Pieces, place: NDArray[np.int64], a: NDArray[np.int64], b: NDArray[np.int64]) -> Chunk:
    """Return the pieces in pairs, ordered by rank, and the pairs in an order that follows from the ranks."""
    is_used = np.zeros(len(pieces), np.bool_)
    is_used[a] = is_used[b] = True
    used = np.flatnonzero(is_used)
    used = used[np.argsort(place[used])]
    row = np.empty(len(pieces), np.int64)
    row[used] = np.arange(len(used))
    a, b = np.minimum(row[a], row[b]), np.maximum(row[a], row[b])
    # No pair comes twice.
    order = np.argsort(a * len(pieces) + b)
    return Chunk(pieces.take(used), PieceRows(a[order]), PieceRows(b[order]))
