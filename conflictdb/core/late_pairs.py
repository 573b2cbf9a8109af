"""When and where pairs of plans meet if each is late by a time of its own: by copies of their pieces, in one batch."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import PieceRows, Pieces, later
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.core.conflicts_between import conflicts_of
from conflictdb.core.members import Members
from conflictdb.core.near import Question, Together
from conflictdb.core.stage1_broad_phase import pairs_together, rows_of
from conflictdb.earth.registry import Setup
from conflictdb.kernel.boxes import BoxTree
from conflictdb.model.plans import INFINITY_US, MAX_INSTANT_US, MIN_INSTANT_US, MINUS_INFINITY_US
from conflictdb.model.results import Conflict, Kind

_Ints = NDArray[np.int64]


class LatePairs(NamedTuple):
    """n pairs of plans (a, b), no two of the same keys; a_us, b_us: (n,) how late each is, microseconds."""

    a: _Ints
    b: _Ints
    a_us: _Ints
    b_us: _Ints

    @classmethod
    def of(cls, rows: Sequence[tuple[int, int, int, int]]) -> "LatePairs":
        """Return pairs from rows (a, b, a_us, b_us)."""
        return cls(*np.array(rows, np.int64).reshape(-1, 4).T)


def conflicts_if_late(setup: Setup, plans: Members, pairs: LatePairs) -> list[Conflict | None]:
    """Return the conflict of each pair (n,), without its closest approach.

    None without one, and for plans that are shifted out of the calendar.

    pairs : places in `plans.each`
    """
    order = np.argsort(plans.of, kind="stable")
    bounds = np.searchsorted(plans.of[order], np.arange(len(plans.each) + 1))
    first, second = (
        _copies(plans, order, bounds, members, late_us, side)
        for side, (members, late_us) in enumerate(((pairs.a, pairs.a_us), (pairs.b, pairs.b_us)))
    )
    question = Question.of(setup.scene)
    both = Pieces.concatenate([first.pieces, second.pieces])
    # Pairs take the place of times: a copy meets only the other one of its pair.
    alone = (
        replace(rows_of(one.pieces), start_us=2 * one.of, end_us=2 * one.of + 1, end_inclusive=None)
        for one in (second, first)
    )
    tree = BoxTree(next(alone))
    row, other = tree.pairs(next(alone))
    a, b = pairs_together(both, PieceRows(row), PieceRows(len(first.pieces) + other), question.within_us)
    met = Together(first)
    met.add(second.pieces, second.of, second.each.__getitem__, a, b - len(first.pieces))
    found = {frozenset((one.a_key, one.b_key)): one for one in conflicts_of(setup, met, has_approaches=False)}
    keys = zip(first.each, second.each, strict=True)
    return [found.get(frozenset((one.key, another.key))) for one, another in keys]


def _copies(plans: Members, order: _Ints, bounds: _Ints, members: _Ints, late_us: _Ints, side: int) -> Members:
    """Return a copy of a plan for each pair, late by a time; without pieces, if it leaves the calendar.

    side : 0 or 1: plans on different sides of a pair are different objects
    """
    offset, index = ragged_rows(bounds, members)
    of = np.repeat(np.arange(len(members)), np.diff(offset))
    pieces, by_us = plans.pieces.take(order[index]), late_us[of]
    moves = pieces.kind == Kind.TRACK.code
    pieces = replace(
        pieces,
        object_id=2 * of + side,
        start_us=later(pieces.start_us, by_us),
        end_us=later(pieces.end_us, by_us),
        leg_start_us=np.where(moves, later(pieces.leg_start_us, by_us), pieces.leg_start_us),
        leg_end_us=np.where(moves, later(pieces.leg_end_us, by_us), pieces.leg_end_us),
    )
    leaves = (pieces.start_us < MIN_INSTANT_US) & (pieces.start_us != MINUS_INFINITY_US)
    leaves |= (pieces.end_us > MAX_INSTANT_US) & (pieces.end_us != INFINITY_US)
    kept = np.flatnonzero(~np.isin(of, of[leaves]))
    # Nobody reads how certain these conflicts are, for which plans are read.
    each = [plans.each[member]._replace(plan=None) for member in members.tolist()]
    return Members(pieces.take(kept), of[kept], each)
