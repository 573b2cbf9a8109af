"""Which pairs of pieces may meet: one question (`Question`), put to a source of pairs (`PairSource`).

Sources are `Memory`, `Together`, and `Stored` of `jobs.sources`.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any, Final, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.distinct import distinct
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.members import Member, Members
from conflictdb.core.memory_budget import DEFAULT_MEMORY
from conflictdb.core.object_pairs import chunks_of_objects, object_numbers
from conflictdb.core.separations import Separations
from conflictdb.core.stage1_broad_phase import batches, candidates, pairs_together, rows_of
from conflictdb.kernel.boxes import BoxTree, RowBoxes, boxes_of
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind

_Ints = NDArray[np.int64]

# In place of infinity: beyond all differences of instants.
FOREVER_US: Final = 2**61
# Pieces of tracks whose candidates are looked up at once: their pairs fit into memory.
_AT_ONCE: Final = 20_000
_NO_OBJECTS: Final = AreaBatch.of([]), TrackBatch.of([])


class Question(NamedTuple):
    """Which pairs of pieces are asked for; by default all that share time, heights and place.

    mine : (m,) rows of pieces: pairs with at least one of these; None: all pairs
    earlier_us, later_us : how much earlier or later one of two pieces, or one of `mine`, may be; also (m,)
    each_way : also the mirror images of pairs whose pieces are both mine
    any_height : pairs need not share heights

    It has no distance: hulls are padded for the separations of their settings, `margins.widened` for a larger distance.
    """

    mine: _Ints | None = None
    earlier_us: int | _Ints = 0
    later_us: int | _Ints = 0
    each_way: bool = False
    any_height: bool = False

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Return the question of a detection: within the largest separation in time."""
        most_us = scene.longest_time_us
        return cls(earlier_us=most_us, later_us=most_us)

    @classmethod
    def shifted(cls, mine: _Ints, most_us: int | _Ints, *, each_way: bool = False) -> Self:
        """Return that of pieces that are up to `most_us` earlier or later, one or (m,)."""
        return cls(mine, most_us, most_us, each_way)

    @property
    def within_us(self) -> int:
        """How far apart in time two pieces may be; of a question about any two."""
        return int(np.maximum(self.earlier_us, self.later_us))


class Chunk(NamedTuple):
    """Pieces, and pairs of them (a, b), as stage 1 leaves them.

    candidate_pairs : number of pairs that stage 1 left, if the source has run stage 2 since (a, b may still contain
        pairs whose hulls are at most a micrometre apart); None: count a, b
    stage2_s : seconds of the source's stage 2
    share : about which share of all pairs is found with this chunk; None: unknown
    """

    pieces: Pieces
    a: PieceRows
    b: PieceRows
    candidate_pairs: int | None = None
    stage2_s: float = 0.0
    share: float | None = 1.0


class PairSource(Protocol):
    """Stage 1 of a scene whose pieces exist: in a database, in memory or elsewhere."""

    def pairs(self, question: Question) -> Iterator[Chunk]:
        """Yield the pairs of pieces (a, b) that a question asks for, in chunks of pieces and pairs.

        Sources but `Memory` have their own pieces that are asked about, and read only the times of a question.

        All pairs of the same two objects are in one chunk. Otherwise chunks are of any size that fits the memory. Only
        answers stay in memory after a chunk. a is of the object with the smaller number, and seam copies are beside
        their originals: rounding depends on the order, and of contacts that begin together the first is reported.
        """

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        """Return the footprints (n,) of whole areas, shapely geometries in degrees; empty if an area was removed.

        Called while a chunk is solved.
        """

    def plans(self, track_ids: NDArray[np.int64]) -> TrackBatch:
        """Return tracks with tolerances by id, in any order, without those that were removed.

        Called while a chunk is solved.
        """


class Memory:
    """All pieces (n,) of a scene, whose objects are numbered as in their batches.

    only : only pairs with these settings, of these separations, are returned; None: all pairs
    """

    def __init__(
        self,
        pieces: Pieces,
        batches: tuple[AreaBatch, TrackBatch] = _NO_OBJECTS,
        only: tuple[Separations, Scene] | None = None,
    ) -> None:
        self.pieces, self._batches, self._only = pieces, batches, only

    @cached_property
    def number(self) -> _Ints:
        """The objects of pieces (n,), by number (`object_numbers`)."""
        return object_numbers(self.pieces)

    @cached_property
    def _boxes(self) -> Floats:
        return boxes_of(self.pieces)

    @cached_property
    def _rows(self) -> RowBoxes:
        """The pieces, with their ends. Spans are finite: they fit into 64 bits when they are subtracted."""
        start_us, end_us = np.maximum(self.pieces.start_us, -FOREVER_US), np.minimum(self.pieces.end_us, FOREVER_US)
        rows = replace(RowBoxes.of(self.pieces, self._boxes), start_us=start_us, end_us=end_us, end_inclusive=None)
        if self._only is None:
            return rows
        return replace(rows, type=self._only[0].types(self.pieces.kind, self.pieces.class_number))

    @cached_property
    def _tree(self) -> BoxTree:
        return BoxTree(self._rows)

    def parts(self, scene: Scene) -> "list[tuple[Scene, Memory]]":
        """Return the settings of a scene's pairs, and these pieces for the pairs that have them."""
        if self._only is not None or not (scene.rules or self.pieces.excuses):
            return [(scene, self)]
        separations, parts = Separations.of(scene), []
        for one in separations.settings:
            part = Memory(separations.of_settings(one, self.pieces), self._batches, (separations, one))
            # Places, times and objects are the same.
            part.number, part._boxes = self.number, self._boxes
            parts.append((one, part))
        return parts

    def pairs(self, question: Question) -> Iterator[Chunk]:
        """Implement `PairSource`."""
        pieces, number, mine = self.pieces, self.number, question.mine
        order = np.arange(len(pieces))
        if pieces.turn.any():
            order = np.lexsort((-pieces.turn, pieces.part, number))
            pieces, number = pieces.take(order), number[order]
        at_once = DEFAULT_MEMORY.pairs
        found = batches(pieces, at_once, question.within_us) if mine is None else [self._in_order(question, order)]
        for a, b in found:
            for rows in chunks_of_objects(number[a], number[b], at_once):
                yield Chunk(pieces, PieceRows(a[rows]), PieceRows(b[rows]))

    def _in_order(self, question: Question, order: _Ints) -> tuple[PieceRows, PieceRows]:
        """Return the rows of pairs as `pairs` does, among the pieces in an order."""
        place = np.empty(len(order), np.int64)
        place[order] = np.arange(len(order))
        pieces = self.pieces
        if question.any_height:
            all_m = np.full(len(pieces), np.inf)
            pieces = pieces.having(floor_m=-all_m, ceiling_m=all_m)
        # `rows` finds pairs that share only an end, too.
        a, b = pairs_together(pieces, *self.rows(question), question.within_us)
        is_first = self.number[a] < self.number[b]
        a, b = PieceRows(place[np.where(is_first, a, b)]), PieceRows(place[np.where(is_first, b, a)])
        sorted_rows = np.lexsort((b, a))
        return PieceRows(a[sorted_rows]), PieceRows(b[sorted_rows])

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        """Implement `PairSource`."""
        return self._batches[0].footprint[area_ids]

    def plans(self, track_ids: NDArray[np.int64]) -> TrackBatch:
        """Implement `PairSource`."""
        return self._batches[1].take(track_ids)

    def rows(self, question: Question) -> tuple[PieceRows, PieceRows]:
        """Return all pairs of pieces (a, b) that a question asks for; a is one of mine, at another time perhaps.

        With `mine` they include pairs that share only the end of a span, in any order; `pairs` leaves these out.
        """
        if question.mine is None:
            return candidates(self.pieces, question.within_us)
        pieces, number, mine = self.pieces, self.number, question.mine
        moved = self._rows.take(mine)
        earliest_us, latest_us = moved.start_us - question.earlier_us, moved.end_us + question.later_us
        moved = replace(moved, start_us=earliest_us, end_us=latest_us)
        if question.any_height:
            all_m = np.full(len(mine), np.inf)
            moved = replace(moved, floor_m=-all_m, ceiling_m=all_m)
        is_mine = np.zeros(len(pieces), np.bool_)
        is_mine[mine] = not question.each_way
        compared = None if self._only is None else self._only[0].have(self._only[1])
        nothing = np.empty(0, np.int64)
        found = [(nothing, nothing)]
        for first in range(0, len(mine), _AT_ONCE):
            few = np.arange(first, min(first + _AT_ONCE, len(mine)))
            row, b = self._tree.pairs(moved.take(few), compared=compared)
            a = mine[first + row]
            keep = (number[a] != number[b]) & (~is_mine[b] | (number[a] < number[b]))
            a, b = PieceRows(a[keep]), PieceRows(b[keep])
            met = ~kernel.apart(pieces.hull_xy, pieces.hull_offset, a, b)
            found.append((a[met], b[met]))
        a, b = (np.concatenate(some) for some in zip(*found, strict=True))
        return PieceRows(a), PieceRows(b)

    def beside(self, given: Pieces, question: Question) -> tuple[Pieces, PieceRows, PieceRows]:
        """Return given pieces followed by these, and the pairs (a, b) of a given one with one of another object here.

        given : of objects with the numbers that they have here, padded for the distance that is asked about
        """
        row, other = self._tree.pairs(rows_of(given), question.within_us)
        others = object_numbers(given)[row] != self.number[other]
        both = Pieces.concatenate([given, self.pieces])
        a, b = PieceRows(row[others]), PieceRows(len(given) + other[others])
        a, b = pairs_together(both, a, b, question.within_us)
        met = ~kernel.apart(both.hull_xy, both.hull_offset, a, b)
        return both, PieceRows(a[met]), PieceRows(b[met])


class Together:
    """Pieces of given plans with those of others: pairs that may meet, collected.

    at_once : pairs of pieces in a chunk
    named : key and name of each object, by kind and number, once there are pairs
    """

    def __init__(self, mine: Members, at_once: int = DEFAULT_MEMORY.pairs) -> None:
        self._at_once = at_once
        self._members = list(mine.each)
        self._pieces, self._of = [mine.pieces], [mine.of]
        self._a: list[NDArray[np.int64]] = []
        self._b: list[NDArray[np.int64]] = []
        self._count = len(mine.pieces)
        self._by_number: dict[Kind, list[Member]] = {}
        self.named: dict[tuple[int, int], tuple[str, str | None]] = {}

    @property
    def has_pairs(self) -> bool:
        """Whether two pieces may meet."""
        return any(len(rows) for rows in self._a)

    @cached_property
    def rows(self) -> RowBoxes:
        """The pieces of the first objects, as rows without types."""
        return rows_of(self._pieces[0])

    def add_among(self, question: Question) -> None:
        """Add pairs of the first objects with each other."""
        if len(self._members) > 1:
            first, second = BoxTree(self.rows).pairs(self.rows, question.within_us)
            once = self._of[0][first] < self._of[0][second]
            self._a.append(first[once])
            self._b.append(second[once])

    def add_members(self, others: Members, question: Question) -> None:
        """Add pairs of the first objects with others."""
        tree = BoxTree(rows_of(others.pieces))
        self.add(others.pieces, others.of, others.each.__getitem__, *tree.pairs(self.rows, question.within_us))

    def add(
        self,
        pieces: Pieces,
        of: NDArray[np.integer[Any]],
        describe: Callable[[int], Member],
        first: NDArray[np.int64],
        second: NDArray[np.int64],
    ) -> None:
        """Add pairs of pieces of the first objects and of others, whose numbers `of` returns."""
        if not len(second):
            return
        rows, place = distinct(second)
        numbers, of_row = distinct(of[rows])
        self._a.append(first)
        self._b.append(place + self._count)
        self._pieces.append(pieces.take(rows))
        self._of.append(of_row + len(self._members))
        self._members += [describe(k) for k in numbers.tolist()]
        self._count += len(rows)

    def pairs(self, question: Question) -> Iterator[Chunk]:
        """Implement `PairSource`: numbered by key, seam copies beside their originals, and the smaller number first.

        So does `solve`, whose answer may depend on it in the last digits.
        """
        if not self._a:
            return
        a, b, of = np.concatenate(self._a), np.concatenate(self._b), np.concatenate(self._of)
        others = of[a] != of[b]
        a, b = a[others], b[others]
        ids = np.empty(len(self._members), np.int64)
        self._by_number = {kind: [] for kind in Kind}
        for kind in Kind:
            rows = [k for k, one in enumerate(self._members) if one.kind is kind]
            for number, k in enumerate(sorted(rows, key=lambda k: self._members[k].key.encode())):
                one = self._members[k]
                ids[k], self.named[kind.code, number] = number, (one.key, one.name)
                self._by_number[kind].append(one)
        pieces = Pieces.concatenate(self._pieces).having(object_id=ids[of])
        numbers = object_numbers(pieces)
        order = np.lexsort((-pieces.turn, pieces.part, numbers))
        place = np.empty(len(order), np.int64)
        place[order] = np.arange(len(order))
        is_first = numbers[a] < numbers[b]
        pieces, a, b = pieces.take(order), place[np.where(is_first, a, b)], place[np.where(is_first, b, a)]
        numbers = numbers[order]
        order = np.lexsort((b, a))
        a, b = a[order], b[order]
        for some in chunks_of_objects(numbers[a], numbers[b], self._at_once):
            yield Chunk(pieces, PieceRows(a[some]), PieceRows(b[some]))

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        """Implement `PairSource`."""
        found = np.empty(len(area_ids), dtype=object)
        found[:] = [self._by_number[Kind.AREA][number].footprint for number in area_ids.tolist()]
        return found

    def plans(self, track_ids: NDArray[np.int64]) -> TrackBatch:
        """Implement `PairSource`."""
        found = _NO_OBJECTS[1]
        for number in track_ids.tolist():
            plan = self._by_number[Kind.TRACK][number].plan
            found = found if plan is None else found.followed_by(replace(plan(), track_id=np.array([number])))
        return found
