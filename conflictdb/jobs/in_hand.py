"""Detect a scene whose objects all changed from the pieces in hand, while another thread stores them.

The first transaction reads and cuts all objects before it stores anything. Then a thread stores the pieces, commits and
begins the second transaction, while this one joins boxes and solves the first pairs. The answer is written only if
nothing changed between the two snapshots. Otherwise the pairs are solved again from stored pieces.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb import store
from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import Bundles
from conflictdb.core.memory_budget import MemoryBudget
from conflictdb.core.near import Chunk, Question
from conflictdb.core.separations import Separations
from conflictdb.jobs.sources import Stored, joined, pairs_of_bundles, with_shares
from conflictdb.kernel.boxes import RowBoxes, boxes_of
from conflictdb.kernel.waiting import ThreadWork, run_in_thread


class Outdated(Exception):
    """An object, a setting or another detection changed the scene since its pieces were cut."""


@dataclass(frozen=True, slots=True)
class Hand:
    """All pieces of a scene, as they are stored.

    bundles : each piece has the number of its bundle as its id
    place : (n,) the rank of each piece in the order of kind, key, part and turn, as `store.bundles` returns it
    """

    bundles: Bundles
    place: NDArray[np.int64]

    @classmethod
    def of(cls, bundles: Bundles, objects: NDArray[np.int64]) -> "Hand":
        """Return the pieces of all objects, whose numbers (m,) are in the order of kind and key."""
        pieces = bundles.pieces
        by_number = np.argsort(objects)
        rank = by_number[np.searchsorted(objects, numbers_of(pieces.kind, pieces.object_id), sorter=by_number)]
        place = np.empty(len(pieces), np.int64)
        place[np.lexsort((-pieces.turn, pieces.part, rank))] = np.arange(len(pieces))
        row = np.repeat(np.arange(len(bundles)), np.diff(bundles.offset))
        return cls(Bundles(replace(pieces, piece_id=row), bundles.offset), place)


class Storing:
    """The end of the first transaction and the begin of the second, in a thread of its own."""

    def __init__(self, conn: psycopg.Connection[Any], work: Callable[["Storing"], store.Staged]) -> None:
        self._is_stopped = False
        self._work: ThreadWork[store.Staged] = run_in_thread(conn, lambda: work(self))

    def stop(self) -> None:
        """Store no further part; its statement is canceled by `cancel_thread`."""
        self._is_stopped = True

    def go_on(self) -> None:
        """Raise Outdated after `stop`; called between statements."""
        if self._is_stopped:
            raise Outdated

    def result(self) -> store.Staged:
        """Wait until the second transaction has begun; raises Outdated if the pieces are not those of its snapshot."""
        return self._work.result()


class InHand(Stored):
    """All pieces of a scene, as a source of pairs.

    storing : uses the connection first
    """

    def __init__(
        self,
        conn: psycopg.Connection[Any],
        scene_id: int,
        memory: MemoryBudget,
        hand: Hand,
        storing: Storing,
        separations: Separations,
    ) -> None:
        super().__init__(conn, scene_id, memory.beside_hand(hand.bundles.pieces.nbytes), separations=separations)
        self._hand, self._storing = hand, storing

    def staged(self) -> store.Staged:
        """Wait for the second transaction; return its write-back."""
        clock = time.perf_counter()
        found = self._storing.result()
        self.waited_s += time.perf_counter() - clock
        return found

    def pairs(self, question: Question) -> Iterator[Chunk]:
        """Implement `PairSource`."""
        bundles, place = self._hand.bundles, self._hand.place
        ids, boxes = _boxes_of_rows(bundles)
        memory = self._memory.beside(len(ids))
        within_us = question.within_us
        if self._separations is not None:
            first = bundles.offset[:-1][ids]
            kinds, classes = bundles.pieces.kind[first], bundles.pieces.class_number[first]
            boxes = replace(boxes, type=self._separations.types(kinds, classes))
        at_once = memory.row_pairs(len(ids))
        joined_rows = joined(ids, np.diff(bundles.offset)[ids], boxes, at_once, within_us, self._compared)
        yield from with_shares(
            (pairs_of_bundles(bundles, place, found.a, found.b, memory.pairs_at_once, within_us), found.share)
            for found in joined_rows
        )

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        """Implement `PairSource`."""
        self._storing.result()
        return super().footprints(area_ids)

    def plans(self, track_ids: NDArray[np.int64]) -> TrackBatch:
        """Implement `PairSource`."""
        self._storing.result()
        return super().plans(track_ids)


def _boxes_of_rows(bundles: Bundles) -> tuple[NDArray[np.int64], RowBoxes]:
    """Return the numbers of all bundles that have an instant, and their boxes, as `store.boxes` does."""
    pieces, first, last = bundles.pieces, bundles.offset[:-1], bundles.offset[1:] - 1
    start_us, end_us = pieces.start_us[first], pieces.end_us[last]
    ids = np.flatnonzero((start_us < end_us) | ((start_us == end_us) & pieces.end_inclusive[last]))
    every = boxes_of(pieces)
    low, high = np.minimum.reduceat(every[:, :2], first), np.maximum.reduceat(every[:, 2:], first)
    of = first[ids]
    return ids, RowBoxes(
        boxes=np.concatenate([low, high], axis=1)[ids],
        floor_m=pieces.floor_m[of],
        ceiling_m=pieces.ceiling_m[of],
        start_us=start_us[ids],
        end_us=end_us[ids],
        object=numbers_of(pieces.kind[of], pieces.object_id[of]),
        is_copy=pieces.turn[of].astype(bool),
        numbers=pieces.numbers[of],
    )
