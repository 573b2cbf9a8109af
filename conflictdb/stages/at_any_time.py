"""Stages 1 and 2 for plans whose times may change: pairs of pieces that are at one place, whenever that is."""

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.model.plans import Scene
from conflictdb.stages.object_pairs import object_numbers
from conflictdb.stages.separations import Separations
from conflictdb.stages.stage1_broad_phase import hulls_of

_Ints = NDArray[np.int64]

# In place of infinity: beyond all differences of instants.
FOREVER_US: Final = 2**61
# Pieces of tracks whose candidates are looked up at once: their pairs fit into memory.
_AT_ONCE: Final = 20_000


@dataclass(frozen=True, slots=True)
class AnyTime:
    """The pieces (n) of a scene, indexed by place alone.

    number : (n,) of their objects (`object_numbers`)
    start_us, end_us : (n,) their spans, finite
    only : only pairs with these settings, of these separations, are returned; None: all pairs
    """

    pieces: Pieces
    number: _Ints
    start_us: _Ints
    end_us: _Ints
    hulls: NDArray[np.object_]
    tree: shapely.STRtree
    only: tuple[Separations, Scene] | None = None

    @classmethod
    def of(cls, pieces: Pieces) -> Self:
        """Index pieces."""
        hulls = hulls_of(pieces)
        # Unbounded spans, too, fit into 64 bits when they are subtracted.
        start_us, end_us = np.maximum(pieces.start_us, -FOREVER_US), np.minimum(pieces.end_us, FOREVER_US)
        return cls(pieces, object_numbers(pieces), start_us, end_us, hulls, shapely.STRtree(hulls))

    def parts(self, scene: Scene) -> "list[tuple[Scene, AnyTime]]":
        """Return the settings of a scene's pairs, and these pieces for the pairs that have them."""
        if self.only is not None or not (scene.rules or self.pieces.owner_number.any()):
            return [(scene, self)]
        separations = Separations.of(scene)
        return [
            (one, replace(self, pieces=separations.of_settings(one, self.pieces), only=(separations, one)))
            for one in separations.settings
        ]

    def pairs_within(
        self, mine: _Ints, horizon_us: int | _Ints, *, is_once: bool = False
    ) -> tuple[PieceRows, PieceRows]:
        """Return `pairs` of pieces of which a may be earlier or later by up to the horizon, one or (m,)."""
        return self.pairs(mine, self.start_us[mine] - horizon_us, self.end_us[mine] + horizon_us, is_once=is_once)

    def pairs(
        self, mine: _Ints, earliest_us: _Ints, latest_us: _Ints, *, is_once: bool = False
    ) -> tuple[PieceRows, PieceRows]:
        """Return pairs of pieces (a, b) whose hulls meet if a, one of `mine` (m,), is there at another time.

        earliest_us, latest_us : (m,) the least start and the largest end that any change gives it
        is_once : leave out the mirror images of pairs of which both are mine
        """
        pieces, number = self.pieces, self.number
        is_mine = np.zeros(len(pieces), np.bool_)
        is_mine[mine] = is_once
        nothing = np.empty(0, np.int64)
        found = [(nothing, nothing)]
        for first in range(0, len(mine), _AT_ONCE):
            rows = mine[first : first + _AT_ONCE]
            row, b = self.tree.query(self.hulls[rows])
            a, row = rows[row], first + row
            keep = (number[a] != number[b]) & (~is_mine[b] | (number[a] < number[b]))
            keep &= (pieces.turn[a] == 0) | (pieces.turn[b] == 0)
            keep &= (pieces.floor_m[a] < pieces.ceiling_m[b]) & (pieces.floor_m[b] < pieces.ceiling_m[a])
            keep &= (self.start_us[b] <= latest_us[row]) & (self.end_us[b] >= earliest_us[row])
            a, b = PieceRows(a[keep]), PieceRows(b[keep])
            if self.only is not None:
                few = self.only[0].have(self.only[1], pieces, a, b)
                a, b = PieceRows(a[few]), PieceRows(b[few])
            met = ~kernel.apart(pieces.hull_xy, pieces.hull_offset, a, b)
            found.append((a[met], b[met]))
        a, b = (np.concatenate(some) for some in zip(*found, strict=True))
        return PieceRows(a), PieceRows(b)
