"""Stage 4: when exactly do two pieces interfere.

For each pair and its window: (1) what is proven clear is left out; (2) the first and the last contact are sought by the
linear program where the motion is uniform, else by the nonlinear one, and bracketed on the true motion; (3) what lies
outside of them is proven clear, or the search goes on there; (4) gaps in between are looked for, and reported only when
proven; (5) a pair whose least separation is within the tolerance of zero is marked as grazing. What cannot be settled
is `unresolved`: it stays in the answer with the time in which it might happen.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import stage4_lp, stage4_nlp
from conflictdb.batches import Contacts, Pairs, Pieces
from conflictdb.geodesy import Floats
from conflictdb.model import Scene, Verdict
from conflictdb.motion import Plane, likeness
from conflictdb.planes import plane_of
from conflictdb.proofs import SHORTEST_INTERVAL_S, Leaf, Leaves, crossing, deepest, not_clear
from conflictdb.separation import TOUCH_M, Encounters

_VERDICTS: Final = list(Verdict)
CONFLICT: Final = _VERDICTS.index(Verdict.CONFLICT)
GRAZING: Final = _VERDICTS.index(Verdict.GRAZING)
UNRESOLVED: Final = _VERDICTS.index(Verdict.UNRESOLVED)

# Pairs settled together: enough to fill the arrays, few enough to keep them in memory.
PAIRS_AT_ONCE: Final = 20_000
# Instants within a contact at which gaps and depth are looked for.
SAMPLES: Final = 17
# A guess of the solver is bracketed within these steps, seconds; failing that, within the whole window.
BRACKETS_S: Final = (1e-3, 0.1, 10.0)
# How often the search moves to an earlier contact that the solver passed over.
MAX_ROUNDS: Final = 16
# A contact that begins this close to an instant that no longer belongs to the span is not in it: timestamps end there.
END_RESOLUTION_S: Final = 5e-7

Progress = Callable[[int], None]


@dataclass(slots=True)
class Effort:
    """What the solvers did: calls of each program, and calls that found nothing although a contact was there."""

    lp_calls: int = 0
    nlp_calls: int = 0
    failed_calls: int = 0

    def add(self, other: "Effort") -> None:
        """Count another effort in."""
        self.lp_calls += other.lp_calls
        self.nlp_calls += other.nlp_calls
        self.failed_calls += other.failed_calls


def contacts(
    scene: Scene, pieces: Pieces, pairs: Pairs, first_s: Floats, last_s: Floats, progress: Progress | None = None
) -> tuple[Contacts, Effort]:
    """Return when the pairs interfere within their windows, and what it took.

    first_s, last_s : (n,) the windows of stage 3, seconds after the start of the pairs' shared spans; both pieces of
        a pair must not be unbounded in time together (pairs of areas are `still_pairs`).
    progress : called with the number of pairs settled since the last call
    """
    plane = plane_of(scene)
    effort = Effort()
    found = [_nothing()]
    for rows in _alike(plane, pieces, pairs, np.flatnonzero(first_s <= last_s)):
        zero = np.maximum(pieces.start_us[pairs.a[rows]], pieces.start_us[pairs.b[rows]])
        encounters = Encounters.of(plane, scene.separation_m, pieces, pairs, rows, zero)
        end = np.minimum(pieces.end_us[pairs.a[rows]], pieces.end_us[pairs.b[rows]])
        span = (end - zero) / 1e6
        low, high = np.clip(first_s[rows], 0.0, span), np.clip(last_s[rows], 0.0, span)
        belongs = _end_belongs(pieces, pairs, rows, end)
        settled = _Group(encounters, scene.tolerance_m, low, high, np.where(belongs, np.inf, span), effort).settle()
        found.append(settled.of_pairs(rows))
        if progress:
            progress(len(rows))
    return Contacts.concatenate(found), effort


def still_pairs(scene: Scene, pieces: Pieces, pairs: Pairs) -> NDArray[np.int8]:
    """Return (n,) the verdict on pairs of areas, -1 where they are apart; no time is involved."""
    plane = plane_of(scene)
    verdict = np.full(len(pairs), -1, np.int8)
    for rows in _alike(plane, pieces, pairs, np.arange(len(pairs))):
        encounters = Encounters.of(plane, scene.separation_m, pieces, pairs, rows, np.zeros(len(rows), np.int64))
        excess = encounters.excess(np.arange(len(rows)), np.zeros(len(rows)))
        margin = max(scene.tolerance_m, TOUCH_M)
        verdict[rows] = np.select([excess > margin, excess >= -margin], [-1, GRAZING], CONFLICT)
    return verdict


def meeting_points(scene: Scene, pieces: Pieces, pairs: Pairs, at_s: Floats) -> Floats:
    """Return (n, 2) longitude and latitude, degrees, of where each pair meets at an instant of its shared span.

    Where the polygons touch it is the point of touch, where they overlap a point of both.
    """
    plane = plane_of(scene)
    places = np.full((len(pairs), 2), np.nan)
    for rows in _alike(plane, pieces, pairs, np.arange(len(pairs))):
        zero = np.maximum(pieces.start_us[pairs.a[rows]], pieces.start_us[pairs.b[rows]])
        encounters = Encounters.of(plane, scene.separation_m, pieces, pairs, rows, zero)
        found = encounters.nearest(np.arange(len(rows)), at_s[rows])
        point = 0.5 * (found.point_a + found.point_b)
        overlap = np.flatnonzero(found.gap <= 0.0)
        if overlap.size:
            inside = encounters.take(overlap)
            a, b = (_hulls(shapes.positions(at_s[rows][overlap])) for shapes in (inside.a, inside.b))
            common = shapely.intersection(a, b)
            held = ~shapely.is_empty(common)
            middle = shapely.get_coordinates(shapely.centroid(common[held]))
            point[overlap[held]] = middle + inside.origin[:, held].T
        lon, lat = plane.from_plane(point[:, 0], point[:, 1])
        places[rows] = np.stack([np.mod(lon + 180.0, 360.0) - 180.0, lat], axis=1)
    return places


def _hulls(polygons: Floats) -> NDArray[np.object_]:
    """Return the convex hulls (n,) of vertices (2, v, n)."""
    return np.asarray(shapely.convex_hull(shapely.multipoints(np.moveaxis(polygons, 0, 2).swapaxes(0, 1))))


def _alike(plane: Plane, pieces: Pieces, pairs: Pairs, rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return batches of rows whose pieces can share arrays."""
    if not len(rows):
        return []
    sort = likeness(plane, pieces)
    keys = np.stack([sort[pairs.a[rows]], sort[pairs.b[rows]]])
    _, group = np.unique(keys, axis=1, return_inverse=True)
    batches = []
    for g in range(int(group.max()) + 1):
        same = rows[group == g]
        batches += [same[first : first + PAIRS_AT_ONCE] for first in range(0, len(same), PAIRS_AT_ONCE)]
    return batches


def _end_belongs(pieces: Pieces, pairs: Pairs, rows: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether the last instant of the shared span belongs to both pieces."""
    belongs = np.ones(len(rows), np.bool_)
    for member in (pairs.a[rows], pairs.b[rows]):
        belongs &= (pieces.end_us[member] > end) | pieces.end_inclusive[member]
    return belongs


def _nothing() -> Contacts:
    none = np.empty(0)
    return Contacts(np.empty(0, np.int64), none, none, none, np.empty(0, np.int8), np.empty(0, np.bool_))


def _hull(leaves: Leaves, n: int) -> tuple[Floats, Floats]:
    """Return (n,) the first start and the last end of each row's leaves."""
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    np.minimum.at(low, leaves.row, leaves.start)
    np.maximum.at(high, leaves.row, leaves.end)
    return low, high


class _Group:
    """Pairs of like shapes, settled together; rows number them."""

    def __init__(
        self, pairs: Encounters, tolerance_m: float, low: Floats, high: Floats, beyond_s: Floats, effort: Effort
    ) -> None:
        self.pairs = pairs
        self.margin_m = max(tolerance_m, TOUCH_M)
        self.low = low
        self.high = high
        self.beyond_s = beyond_s  # the first instant that is no longer in the span; infinite where the last one is
        self.effort = effort
        self.found: list[Contacts] = [_nothing()]

    def settle(self) -> Contacts:
        n = len(self.low)
        leaves = not_clear(self.pairs, np.arange(n), self.low, self.high, self.margin_m)
        # Where only closeness was found, look for contact within those leaves.
        touched = np.zeros(n, np.bool_)
        touched[leaves.row[leaves.kind == Leaf.CONTACT]] = True
        near = ~touched[leaves.row]
        deeper = not_clear(self.pairs, leaves.row[near], leaves.start[near], leaves.end[near], 0.0)
        touched[deeper.row[deeper.kind == Leaf.CONTACT]] = True
        witnesses = [leaf.kind == Leaf.CONTACT for leaf in (leaves, deeper)]
        row = np.concatenate([leaves.row[witnesses[0]], deeper.row[witnesses[1]]])
        at = np.concatenate([leaves.at[witnesses[0]], deeper.at[witnesses[1]]])
        rows = np.flatnonzero(touched)
        if rows.size:
            earliest, last = np.full(n, np.inf), np.full(n, -np.inf)
            np.minimum.at(earliest, row, at)
            np.maximum.at(last, row, at)
            low, high = _hull(leaves, n)
            self._contact(rows, low[rows], high[rows], earliest[rows], last[rows], leaves)
        # What could not be proven apart may be a touch, too short to be seen; the rest is only close.
        unproven = np.zeros(n, np.bool_)
        unproven[deeper.row] = True
        self._closeness(deeper, unproven & ~touched, touches=True)
        self._closeness(leaves, ~unproven & ~touched, touches=False)
        return Contacts.concatenate(self.found)

    def _closeness(self, leaves: Leaves, wanted: NDArray[np.bool_], *, touches: bool) -> None:
        """Report pairs that come within the margin (or touch, if `touches`), but are not seen to meet.

        They are grazing, or unresolved.
        """
        mine = wanted[leaves.row]
        if not mine.any():
            return
        rows = np.unique(leaves.row[mine])
        low, high = (ends[rows] for ends in _hull(leaves, len(wanted)))
        # An interval that could not be settled down to a microsecond is within rounding of the margin. One that was
        # given up earlier is as good if nothing in it is deeper than the margin; else it is unresolved.
        given_up = (leaves.kind == Leaf.BORDER) & (leaves.end - leaves.start > 2.0 * SHORTEST_INTERVAL_S) & mine
        deep = not_clear(self.pairs, leaves.row[given_up], leaves.start[given_up], leaves.end[given_up], -self.margin_m)
        unresolved = np.isin(rows, deep.row)
        near = leaves.kind == Leaf.NEAR
        earliest, last = np.full(len(wanted), np.inf), np.full(len(wanted), -np.inf)
        np.minimum.at(earliest, leaves.row[near], leaves.at[near])
        np.maximum.at(last, leaves.row[near], leaves.at[near])
        seen = np.isfinite(earliest[rows]) & ~unresolved
        error = high - low
        error[seen] = np.maximum(earliest[rows] - low, high - last[rows])[seen]
        verdict = np.where(unresolved, UNRESOLVED, GRAZING).astype(np.int8)
        self.found.append(Contacts(rows, low, high, error, verdict, np.full(len(rows), touches)))

    def _contact(
        self, rows: NDArray[np.int64], low: Floats, high: Floats, first: Floats, last: Floats, leaves: Leaves
    ) -> None:
        """Report pairs that meet: first and last are instants of contact, [low, high] holds all of them."""
        start, start_error = self._end(rows, low, first, latest=False)
        end, end_error = self._end(rows, high, last, latest=True)
        inside, depth = self._samples(rows, start, end)
        shallow = np.flatnonzero(depth.min(axis=1) >= -self.margin_m)
        least = depth.min(axis=1)
        if shallow.size:
            best = depth[shallow].argmin(axis=1)
            before = inside[shallow, np.maximum(best - 1, 0)]
            after = inside[shallow, np.minimum(best + 1, SAMPLES - 1)]
            least[shallow] = np.minimum(least[shallow], deepest(self.pairs, rows[shallow], before, after)[1])
        verdict = np.where(least >= -self.margin_m, GRAZING, CONFLICT).astype(np.int8)
        kept = self._belongs(rows, start, end)
        self._leave_to_closeness(rows[~kept], leaves)
        slot, gap_start, gap_end, gap_error = self._gaps(rows, inside, depth)
        error = np.maximum(start_error, end_error)
        np.maximum.at(error, slot, gap_error)
        # Every gap ends one contact and starts another.
        owner = np.concatenate([np.arange(len(rows)), slot])
        starts, ends = np.concatenate([start, gap_end]), np.concatenate([end, gap_start])
        starts, ends = starts[np.lexsort((starts, owner))], ends[np.lexsort((ends, owner))]
        owner = np.sort(owner)
        owner, starts, ends = owner[kept[owner]], starts[kept[owner]], ends[kept[owner]]
        touches = np.ones(len(owner), np.bool_)
        self.found.append(Contacts(rows[owner], starts, ends, error[owner], verdict[owner], touches))

    def _leave_to_closeness(self, rows: NDArray[np.int64], leaves: Leaves) -> None:
        """Report pairs whose only contact is at an instant outside of the span as what they are within it: close."""
        if rows.size and self.margin_m > TOUCH_M:
            self._closeness(leaves, np.isin(np.arange(len(self.low)), rows), touches=False)

    def _end(self, rows: NDArray[np.int64], limit: Floats, witness: Floats, *, latest: bool) -> tuple[Floats, Floats]:
        """Return the first (or last) instant of contact on the outer side, and the bound on its error, seconds.

        limit : (n,) all contact lies between it and beyond the witness, an instant of contact.
        """
        outer, error = limit.copy(), np.zeros(len(rows))
        witness = witness.copy()
        at_limit = self.pairs.excess(rows, limit)
        touching = np.flatnonzero(np.abs(at_limit) <= TOUCH_M)
        error[touching] = self._until_deep(rows[touching], limit[touching], witness[touching])
        active = np.flatnonzero(at_limit > TOUCH_M)
        for _ in range(MAX_ROUNDS):
            if not active.size:
                break
            row = rows[active]
            outside, inside = self._bracket(row, limit[active], witness[active], latest=latest)
            outer[active] = crossing(self.pairs, row, outside, inside, TOUCH_M)[0]
            error[active] = self._until_deep(row, outer[active], witness[active])
            ends = (outer[active], limit[active]) if latest else (limit[active], outer[active])
            rest = not_clear(self.pairs, np.arange(len(self.low))[row], *ends, 0.0)
            where = np.full(len(self.low), -1)
            where[row] = active
            slot = where[rest.row]
            # Within rounding of a touch, next to the contact: it belongs to it.
            border = rest.kind != Leaf.CONTACT
            edge = outer.copy()
            if latest:
                np.maximum.at(edge, slot[border], rest.end[border])
            else:
                np.minimum.at(edge, slot[border], rest.start[border])
            error += np.abs(edge - outer)
            outer = edge
            earlier = rest.kind == Leaf.CONTACT
            if latest:
                np.maximum.at(witness, slot[earlier], rest.at[earlier])
            else:
                np.minimum.at(witness, slot[earlier], rest.at[earlier])
            active = np.unique(slot[earlier])
        # Rounds used up with contacts still turning up further out: everything out to the limit counts.
        error[active] = np.abs(limit[active] - outer[active]) + error[active]
        outer[active] = limit[active]
        return outer, error

    def _until_deep(self, rows: NDArray[np.int64], outer: Floats, witness: Floats) -> Floats:
        """Return how far from `outer` the contact is beyond doubt: the plane is rounded by less than TOUCH_M."""
        settled = crossing(self.pairs, rows, outer, witness, -TOUCH_M)[1]
        sunk = self.pairs.excess(rows, witness) <= -TOUCH_M
        return np.asarray(np.abs(np.where(sunk, settled, witness) - outer))

    def _bracket(
        self, rows: NDArray[np.int64], limit: Floats, witness: Floats, *, latest: bool
    ) -> tuple[Floats, Floats]:
        """Return (outside, inside) around the solver's extreme contact; the whole way to the limit where it fails."""
        low, high = (witness, limit) if latest else (limit, witness)
        guess = self._solve(rows, low, high, latest=latest)
        outside, inside = limit.copy(), witness.copy()
        known = np.flatnonzero(np.isfinite(guess))
        out = 1.0 if latest else -1.0
        for step in BRACKETS_S:
            if not known.size:
                break
            row, at = rows[known], guess[known]
            outward = np.clip(at + out * step, low[known], high[known])
            inward = np.clip(at - out * step, low[known], high[known])
            good = (self.pairs.excess(row, outward) > TOUCH_M) & (self.pairs.excess(row, inward) <= TOUCH_M)
            outside[known[good]], inside[known[good]] = outward[good], inward[good]
            known = known[~good]
        return outside, inside

    def _solve(self, rows: NDArray[np.int64], low: Floats, high: Floats, *, latest: bool) -> Floats:
        """Return the programs' answers, NaN where they find none."""
        uniform = stage4_lp.is_uniform(self.pairs.take(rows), low, high)
        answer = np.full(len(rows), np.nan)
        for k, row in enumerate(rows.tolist()):
            program = stage4_lp if uniform[k] else stage4_nlp
            pair = self.pairs.take(np.array([row]))
            found = program.extreme_contact(pair, float(low[k]), float(high[k]), latest=latest)
            if found is None:
                self.effort.failed_calls += 1
            else:
                answer[k] = found
        self.effort.lp_calls += int(uniform.sum())
        self.effort.nlp_calls += int((~uniform).sum())
        return answer

    def _samples(self, rows: NDArray[np.int64], start: Floats, end: Floats) -> tuple[Floats, Floats]:
        """Return instants (n, SAMPLES) from start to end and the excess at each, metres."""
        at = start[:, None] + (end - start)[:, None] * np.linspace(0.0, 1.0, SAMPLES)
        depth = [self.pairs.excess(rows, at[:, k]) for k in range(SAMPLES)]
        return at, np.stack(depth, axis=1)

    def _belongs(self, rows: NDArray[np.int64], start: Floats, end: Floats) -> NDArray[np.bool_]:
        """Return whether a contact is within the span, not only at the first instant after it."""
        belongs = np.ones(len(rows), np.bool_)
        onset = np.flatnonzero((start > 0.0) & (end >= self.beyond_s[rows]))
        if onset.size:
            # Only an onset counts: what has been in touch since the span began is in it.
            row = rows[onset]
            sinks = self.pairs.excess(row, self.beyond_s[row]) <= 0.0
            begins = crossing(self.pairs, row, start[onset], self.beyond_s[row], 0.0)[1]
            belongs[onset] = sinks & (begins < self.beyond_s[row] - END_RESOLUTION_S)
        return belongs

    def _gaps(
        self, rows: NDArray[np.int64], at: Floats, depth: Floats
    ) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
        """Return (slot, start, end, error) of gaps within contacts that are proven clear; slots number the rows."""
        touches = depth <= TOUCH_M
        touches[:, [0, -1]] = True
        slots: list[int] = []
        instants: list[tuple[float, float, float]] = []
        for k in np.flatnonzero((depth > self.margin_m)[:, 1:-1].any(axis=1)).tolist():
            closed = np.flatnonzero(touches[k])
            for i, j in zip(closed[:-1].tolist(), closed[1:].tolist(), strict=True):
                widest = i + 1 + int(depth[k, i + 1 : j].argmax()) if j > i + 1 else i
                if j > i + 1 and depth[k, widest] > self.margin_m:
                    slots.append(k)
                    instants.append((at[k, i], at[k, widest], at[k, j]))
        if not slots:
            none = np.empty(0)
            return np.empty(0, np.int64), none, none, none
        slot = np.array(slots)
        left, middle, right = np.array(instants).T
        gapped = self.pairs.take(rows[slot])
        row = np.arange(len(slot))
        start, start_touch = crossing(gapped, row, middle, left, TOUCH_M)
        end, end_touch = crossing(gapped, row, middle, right, TOUCH_M)
        error = np.maximum(start - start_touch, end_touch - end)
        rest = not_clear(gapped, row, start, end, 0.0)
        # What is not proven clear at the very ends belongs to the contacts; anywhere else the gap is not reported.
        proven = np.ones(len(slot), np.bool_)
        np.logical_and.at(proven, rest.row, rest.kind == Leaf.BORDER)
        ends_before = rest.start <= middle[rest.row]
        np.maximum.at(start, rest.row[ends_before], rest.end[ends_before])
        np.minimum.at(end, rest.row[~ends_before], rest.start[~ends_before])
        proven &= start < end
        error = error + np.maximum(np.abs(start - start_touch), np.abs(end_touch - end))
        return slot[proven], start[proven], end[proven], error[proven]
