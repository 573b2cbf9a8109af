"""Method `exact`: what the kernel proves of pairs, as contacts with a verdict.

What it does not decide (grazing, several contacts, polygons without an inside) is left to `stage4.search`, which takes
any pair apart by branch and bound.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel import Outcome, Solution, Work
from conflictdb.model import Scene
from conflictdb.motion.contract import Plane
from conflictdb.results import Verdict
from conflictdb.stage4.constants import END_RESOLUTION_S, TOUCH_M
from conflictdb.stage4.encounters import Encounters

_Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Meetings:
    """n pairs of pieces, in time counted from the start of their shared spans, seconds.

    scene : the pieces as the kernel takes them
    pair : (n,) their rows in `pairs`
    low_s, high_s : (n,) when they may interfere
    beyond_s : (n,) the first instant that is no longer in the span; infinite where the last one is
    threads : of the kernel
    """

    plane: Plane
    pieces: Pieces
    scene: kernel.Scene
    pairs: Pairs
    pair: _Rows
    zero_us: _Rows
    low_s: Floats
    high_s: Floats
    beyond_s: Floats
    threads: int

    @classmethod
    def of(
        cls,
        plane: Plane,
        pieces: Pieces,
        scene: kernel.Scene,
        pairs: Pairs,
        rows: _Rows,
        low_s: Floats,
        high_s: Floats,
        threads: int = 1,
    ) -> Self:
        """Return some rows of pairs, with what of their windows (n,) lies in the shared spans."""
        a, b = pairs.a[rows], pairs.b[rows]
        zero = np.maximum(pieces.start_us[a], pieces.start_us[b])
        end = np.minimum(pieces.end_us[a], pieces.end_us[b])
        span = (end - zero) / 1e6
        belongs = np.ones(len(rows), np.bool_)
        for member in (a, b):
            belongs &= (pieces.end_us[member] > end) | pieces.end_inclusive[member]
        low_s, high_s = np.clip(low_s, 0.0, span), np.clip(high_s, 0.0, span)
        return cls(plane, pieces, scene, pairs, rows, zero, low_s, high_s, np.where(belongs, np.inf, span), threads)

    def __len__(self) -> int:
        return len(self.pair)

    def take(self, rows: _Rows) -> Self:
        """Return some of them."""
        arrays = {name: getattr(self, name)[rows] for name in ("pair", "zero_us", "low_s", "high_s", "beyond_s")}
        return replace(self, **arrays)

    def with_own_pieces(self) -> Self:
        """Return the same in a batch that holds their own pieces and pairs alone."""
        n = len(self)
        both = np.concatenate([self.pairs.a[self.pair], self.pairs.b[self.pair]])
        own, number = np.unique(both, return_inverse=True)
        company = None if self.pairs.company is None else self.pairs.company[self.pair]
        shape_class = None if self.pairs.shape_class is None else self.pairs.shape_class[:, self.pair]
        a, b = PieceRows(number[:n]), PieceRows(number[n:])
        pairs = Pairs(a, b, np.empty((0, 2)), np.zeros(n + 1, np.int64), company, shape_class)
        return replace(self, pieces=self.pieces.take(PieceRows(own)), pairs=pairs, pair=np.arange(n))

    def encounters(self, separation_m: float) -> Encounters:
        """Return them as encounters, which must be of like pieces."""
        return Encounters.of(self.plane, separation_m, self.pieces, self.pairs, self.pair, self.zero_us)

    def contacts(self, separation_m: float, margin_m: float, work: Work) -> Solution:
        """Return what is certain of them; margin_m >= TOUCH_M on the earth."""
        a, b = self.pairs.a[self.pair], self.pairs.b[self.pair]
        times = self.zero_us, self.low_s, self.high_s
        return self.scene.contacts(a, b, *times, separation_m, margin_m, work, self.threads)

    def during(self, found: Solution) -> Self:
        """Return them during the contacts that were found."""
        return replace(self, low_s=found.start_s, high_s=found.end_s)


def certain_contacts(scene: Scene, meetings: Meetings, work: Work) -> tuple[list[Contacts], _Rows]:
    """Return the contacts that are certain, of pairs numbered from 0, and the numbers of those of which nothing is."""
    margin_m = max(scene.tolerance_m, TOUCH_M)
    every = np.arange(len(meetings))
    solution = meetings.contacts(scene.separation_m, margin_m, work)
    deep = _meets_early(meetings, solution)
    found = [_known(solution, every, deep, Verdict.CONFLICT)]
    rest = np.flatnonzero(~deep & ~solution.ended(Outcome.SEPARATED))
    if margin_m == TOUCH_M or not rest.size:
        return found, rest
    # Too close to call, perhaps: do they meet at all, and how deep; if not, when are they within the tolerance?
    some = meetings.take(rest)
    solution = some.contacts(scene.separation_m, TOUCH_M, work)
    depth = np.full(len(rest), Outcome.UNDECIDED, np.int8)
    rows = np.flatnonzero(_meets_early(some, solution))
    depth[rows] = _depth(some.during(solution).take(rows), scene.separation_m, margin_m, work)
    found.append(_known(solution, rest, depth == Outcome.SEPARATED, Verdict.GRAZING))
    found.append(_known(solution, rest, depth == Outcome.CONTACT, Verdict.CONFLICT))
    rows = np.flatnonzero(solution.ended(Outcome.SEPARATED))
    near = some.take(rows).contacts(scene.separation_m + margin_m, TOUCH_M, work)
    close = _meets_early(some.take(rows), near)
    found.append(_known(near, rest[rows], close, Verdict.GRAZING, touches=False))
    done = depth != Outcome.UNDECIDED
    done[rows] = close | near.ended(Outcome.SEPARATED)
    return found, rest[~done]


def _meets_early(meetings: Meetings, solution: Solution) -> NDArray[np.bool_]:
    """Return (n,) which meet beyond doubt: what begins where the span ends may not belong to it."""
    is_early = solution.start_s < meetings.beyond_s - 2.0 * END_RESOLUTION_S
    return np.asarray(solution.ended(Outcome.CONTACT) & is_early)


def _depth(meetings: Meetings, separation_m: float, margin_m: float, work: Work) -> NDArray[np.int8]:
    """Return (n,) the outcome of asking whether pairs get nearer than wanted by more than a margin."""
    if separation_m > margin_m:
        return meetings.contacts(separation_m - margin_m, TOUCH_M, work).outcome
    if separation_m == 0.0:
        a, b = meetings.pairs.a[meetings.pair], meetings.pairs.b[meetings.pair]
        return meetings.scene.depths(a, b, meetings.zero_us, meetings.low_s, meetings.high_s, margin_m)
    return np.full(len(meetings), Outcome.UNDECIDED, np.int8)


def _known(
    solution: Solution, rows: _Rows, is_known: NDArray[np.bool_], verdict: Verdict, *, touches: bool = True
) -> Contacts:
    """Return what is known of pairs, numbered rows[k], as contacts."""
    known = np.flatnonzero(is_known)
    times = solution.start_s[known], solution.end_s[known], solution.error_s[known]
    verdicts = np.full(len(known), verdict.code, np.int8)
    return Contacts(rows[known], *times, verdicts, np.full(len(known), touches))
