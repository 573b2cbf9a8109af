"""Stage 4, search: the contacts of any pair by branch and bound, with or without a program's guess where to look.

For each pair and its window:

1. Times at which the pair is proven apart are left out.
2. The first and the last contact are bracketed on the true motion: by an instant at which the pair is apart, and one at
   which it is in contact. For method `nlp` the linear program (uniform motion) or the nonlinear one says where to look.
3. The pair is proven apart before the first contact and after the last; where it is not, the search goes on there.
4. The contact is proven to hold throughout; where the pair is apart in between, it is cut in two.
5. A pair whose least clearance is within the margin of zero is `grazing`. A pair that stays undecided is `unresolved`:
   it is reported with the time in which it might meet.

The proofs and their literature are in `proofs`.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.answers import Contacts
from conflictdb.earth.geodesy import Floats
from conflictdb.results import Verdict
from conflictdb.stage4.constants import (
    CLEAR_M,
    END_RESOLUTION_S,
    GUESS_BRACKETS_S,
    MAX_ROUNDS,
    SHORTEST_INTERVAL_S,
    TOUCH_M,
)
from conflictdb.stage4.distance import clearance_m, clearance_of
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.proofs import Reason, Undecided, undecided_contact, undecided_separation
from conflictdb.stage4.published import linear_program, nonlinear_program
from conflictdb.stage4.roots import crossing

CONFLICT: Final = Verdict.CONFLICT.code
GRAZING: Final = Verdict.GRAZING.code
UNRESOLVED: Final = Verdict.UNRESOLVED.code


@dataclass(slots=True)
class Programs:
    """Calls of each program, and calls that found nothing although a contact was there."""

    lp_calls: int = 0
    nlp_calls: int = 0
    failed_calls: int = 0


def nothing() -> Contacts:
    """Return no contacts."""
    none = np.empty(0)
    return Contacts(np.empty(0, np.int64), none, none, none, np.empty(0, np.int8), np.empty(0, np.bool_))


def search(
    pairs: Encounters, tolerance_m: float, low: Floats, high: Floats, beyond_s: Floats, programs: Programs | None
) -> Contacts:
    """Return the contacts of like pairs within [low, high], seconds.

    beyond_s : (n,) the first instant that is no longer in the span; infinite where the last one is
    programs : counts the calls of the programs that are asked for a guess; none are if there is no counter
    """
    return _Search(pairs, tolerance_m, low, high, beyond_s, programs).solve()


class _Search:
    """Pairs of like shapes, searched together; rows number them."""

    def __init__(
        self,
        pairs: Encounters,
        tolerance_m: float,
        low: Floats,
        high: Floats,
        beyond_s: Floats,
        programs: Programs | None,
    ) -> None:
        self.pairs = pairs
        self.margin_m = max(tolerance_m, TOUCH_M)
        # Pairs with a clearance below minus this are certain to be in contact, although distances have an error.
        self.deep_m = self.margin_m if pairs.separation_m == 0.0 else max(self.margin_m, pairs.certainty_margin_m)
        self.low = low
        self.high = high
        self.beyond_s = beyond_s
        self.programs = programs
        self.found: list[Contacts] = [nothing()]

    def solve(self) -> Contacts:
        n = len(self.low)
        undecided = undecided_separation(self.pairs, np.arange(n), self.low, self.high, self.margin_m)
        # Where only closeness was found, look for contact within those intervals.
        touched = np.zeros(n, np.bool_)
        touched[undecided.row[undecided.reason == Reason.CONTACT]] = True
        near = ~touched[undecided.row]
        deeper = undecided_separation(self.pairs, undecided.row[near], undecided.start[near], undecided.end[near], 0.0)
        touched[deeper.row[deeper.reason == Reason.CONTACT]] = True
        witnesses = [intervals.reason == Reason.CONTACT for intervals in (undecided, deeper)]
        row = np.concatenate([undecided.row[witnesses[0]], deeper.row[witnesses[1]]])
        at = np.concatenate([undecided.at[witnesses[0]], deeper.at[witnesses[1]]])
        rows = np.flatnonzero(touched)
        if rows.size:
            earliest, last = np.full(n, np.inf), np.full(n, -np.inf)
            np.minimum.at(earliest, row, at)
            np.maximum.at(last, row, at)
            low, high = _hull(undecided, n)
            self._report_contacts(rows, low[rows], high[rows], earliest[rows], last[rows], undecided)
        # A pair that is neither proven apart nor seen in contact may touch for an instant. All others are only close.
        unproven = np.zeros(n, np.bool_)
        unproven[deeper.row] = True
        self._report_close(deeper, unproven & ~touched, touches=True)
        self._report_close(undecided, ~unproven & ~touched, touches=False)
        return Contacts.concatenate(self.found)

    def _report_close(self, undecided: Undecided, wanted: NDArray[np.bool_], *, touches: bool) -> None:
        """Report pairs that are not seen in contact but come within the margin, or touch if `touches`.

        They are grazing, or unresolved.
        """
        mine = wanted[undecided.row]
        if not mine.any():
            return
        rows = np.unique(undecided.row[mine])
        low, high = (ends[rows] for ends in _hull(undecided, len(wanted)))
        # An interval of a microsecond that is undecided lies within rounding of the margin: grazing. A longer one was
        # given up for want of work: grazing if its clearance is proven to be above minus the margin, else unresolved.
        given_up = (
            (undecided.reason == Reason.BORDER) & (undecided.end - undecided.start > 2.0 * SHORTEST_INTERVAL_S) & mine
        )
        deep = undecided_separation(
            self.pairs, undecided.row[given_up], undecided.start[given_up], undecided.end[given_up], -self.margin_m
        )
        unresolved = np.isin(rows, deep.row) | ~self._is_close(rows, undecided, mine)
        near = undecided.reason == Reason.NEAR
        earliest, last = np.full(len(wanted), np.inf), np.full(len(wanted), -np.inf)
        np.minimum.at(earliest, undecided.row[near], undecided.at[near])
        np.maximum.at(last, undecided.row[near], undecided.at[near])
        seen = np.isfinite(earliest[rows]) & ~unresolved
        error = high - low
        error[seen] = np.maximum(earliest[rows] - low, high - last[rows])[seen]
        verdict = np.where(unresolved, UNRESOLVED, GRAZING).astype(np.int8)
        self.found.append(Contacts(rows, low, high, error, verdict, np.full(len(rows), touches)))

    def _is_close(self, rows: NDArray[np.int64], undecided: Undecided, mine: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return whether rows certainly come within the margin, although distances have an error."""
        error_m = self.pairs.distance_error_m(self.pairs.separation_m + self.margin_m)
        if self.pairs.separation_m == 0.0 or not len(rows):
            return np.ones(len(rows), np.bool_)
        close = undecided_separation(
            self.pairs, undecided.row[mine], undecided.start[mine], undecided.end[mine], self.margin_m - error_m
        )
        return np.isin(rows, close.row[close.reason != Reason.BORDER])

    def _report_contacts(
        self, rows: NDArray[np.int64], low: Floats, high: Floats, first: Floats, last: Floats, undecided: Undecided
    ) -> None:
        """Report pairs that meet: first and last are instants of contact, [low, high] holds all of them."""
        pairs = self.pairs.take(rows)
        start, first = self._outer_end(pairs, low, first, latest=False)
        end, last = self._outer_end(pairs, high, last, latest=True)
        start_error, end_error = _uncertain_ends(pairs, start, end, first, last)
        grazes = clearance_m(pairs, np.arange(len(rows)), 0.5 * (start + end)) >= -self.deep_m
        shallow = np.flatnonzero(grazes)
        if shallow.size:
            deeper = undecided_separation(pairs, shallow, start[shallow], end[shallow], -self.deep_m)
            grazes[deeper.row[deeper.reason == Reason.CONTACT]] = False
        kept = self._is_within_span(rows, start, end)
        self._report_as_close(rows[~kept], undecided)
        parts = np.flatnonzero(kept)
        slot, start, end, error = self._cut_where_apart(
            pairs.take(parts), start[kept], end[kept], start_error[kept], end_error[kept]
        )
        # Where distances are not known to the tolerance, shallow contact may be none.
        shallow_verdict = GRAZING if self.deep_m == self.margin_m else UNRESOLVED
        verdict = np.where(grazes, shallow_verdict, CONFLICT).astype(np.int8)[parts[slot]]
        self.found.append(Contacts(rows[parts[slot]], start, end, error, verdict, np.ones(len(slot), np.bool_)))

    def _report_as_close(self, rows: NDArray[np.int64], undecided: Undecided) -> None:
        """Report pairs that meet only at the first instant after the span: within it they are close."""
        if rows.size and self.margin_m > TOUCH_M:
            self._report_close(undecided, np.isin(np.arange(len(self.low)), rows), touches=False)

    def _is_within_span(self, rows: NDArray[np.int64], start: Floats, end: Floats) -> NDArray[np.bool_]:
        """Return whether a contact is within the span, not only at the first instant after it."""
        belongs = np.ones(len(rows), np.bool_)
        onset = np.flatnonzero((start > 0.0) & (end >= self.beyond_s[rows]))
        if onset.size:
            # Only the beginning of a contact decides: one that lasts since the span began is within it.
            row = rows[onset]
            clearance = clearance_m(self.pairs, row, self.beyond_s[row])
            begins = crossing(clearance_of(self.pairs, row), start[onset], self.beyond_s[row], 0.0)[1]
            early = (clearance <= 0.0) & (begins < self.beyond_s[row] - END_RESOLUTION_S)
            belongs[onset] = early | (clearance < -self.pairs.certainty_margin_m)
        return belongs

    def _cut_where_apart(
        self, pairs: Encounters, start: Floats, end: Floats, start_error: Floats, end_error: Floats
    ) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
        """Return (slot, start, end, error) of contacts, cut where the pairs are apart; slots number the pairs.

        Each is proven to hold throughout, except where the pair only touches, within rounding.
        """
        done: list[tuple[NDArray[np.int64], Floats, Floats, Floats]] = []
        slot = np.arange(len(pairs))
        for _ in range(MAX_ROUNDS):
            some = pairs.take(slot)
            # The uncertain seconds at either end are stated as the error.
            first = start + start_error
            last = np.maximum(end - end_error, first)
            undecided = undecided_contact(some, np.arange(len(slot)), first, last)
            at = np.full(len(slot), np.nan)
            at[undecided.row[undecided.reason == Reason.NEAR]] = undecided.at[undecided.reason == Reason.NEAR]
            whole = np.isnan(at) | (last - first <= SHORTEST_INTERVAL_S)
            done.append((slot[whole], start[whole], end[whole], np.maximum(start_error, end_error)[whole]))
            cut = np.flatnonzero(~whole)
            slot, start, end = slot[cut], start[cut], end[cut]
            if not cut.size:
                break
            some, at = some.take(cut), at[cut]
            before, in_former = self._outer_end(some, at, first[cut], latest=True)
            after, in_latter = self._outer_end(some, at, last[cut], latest=False)
            earlier = _uncertain_ends(some, start, before, first[cut], in_former)
            later = _uncertain_ends(some, after, end, in_latter, last[cut])
            slot = np.concatenate([slot, slot])
            start, end = np.concatenate([start, after]), np.concatenate([before, end])
            start_error, end_error = (np.concatenate(both) for both in zip(earlier, later, strict=True))
        else:
            done.append((slot, start, end, end - start))
        slot, start, end, error = (np.concatenate(column) for column in zip(*done, strict=True))
        order = np.lexsort((start, slot))
        return slot[order], start[order], end[order], error[order]

    def _outer_end(self, pairs: Encounters, limit: Floats, witness: Floats, *, latest: bool) -> tuple[Floats, Floats]:
        """Return the first (or last) instant of contact on the outer side, seconds, and the outermost one seen before.

        limit : (n,) all contact lies between it and beyond the witness, an instant of contact.
        """
        outer, witness = limit.copy(), witness.copy()
        active = np.flatnonzero(clearance_m(pairs, np.arange(len(limit)), limit) > CLEAR_M)
        for _ in range(MAX_ROUNDS):
            if not active.size:
                break
            outside, inside = self._bracket(pairs, active, limit[active], witness[active], latest=latest)
            outer[active] = crossing(clearance_of(pairs, active), outside, inside, CLEAR_M)[0]
            ends = (outer[active], limit[active]) if latest else (limit[active], outer[active])
            rest = undecided_separation(pairs, active, *ends, 0.0)
            # An interval next to the contact that is within rounding of a touch belongs to the contact.
            border = rest.reason != Reason.CONTACT
            if latest:
                np.maximum.at(outer, rest.row[border], rest.end[border])
                np.maximum.at(witness, rest.row[~border], rest.at[~border])
            else:
                np.minimum.at(outer, rest.row[border], rest.start[border])
                np.minimum.at(witness, rest.row[~border], rest.at[~border])
            active = np.unique(rest.row[~border])
        # The rounds are used up, and each found a contact further out: all times up to the limit are reported.
        outer[active] = limit[active]
        return outer, witness

    def _bracket(
        self, pairs: Encounters, rows: NDArray[np.int64], limit: Floats, witness: Floats, *, latest: bool
    ) -> tuple[Floats, Floats]:
        """Return (outside, inside) around the programs' extreme contact; the whole way to the limit without one."""
        outside, inside = limit.copy(), witness.copy()
        if self.programs is None:
            return outside, inside
        low, high = (witness, limit) if latest else (limit, witness)
        guess = _guesses(pairs.take(rows), low, high, self.programs, latest=latest)
        known = np.flatnonzero(np.isfinite(guess))
        out = 1.0 if latest else -1.0
        for step in GUESS_BRACKETS_S:
            if not known.size:
                break
            row, at = rows[known], guess[known]
            outward = np.clip(at + out * step, low[known], high[known])
            inward = np.clip(at - out * step, low[known], high[known])
            good = (clearance_m(pairs, row, outward) > CLEAR_M) & (clearance_m(pairs, row, inward) <= TOUCH_M)
            outside[known[good]], inside[known[good]] = outward[good], inward[good]
            known = known[~good]
        return outside, inside


def _guesses(pairs: Encounters, low: Floats, high: Floats, programs: Programs, *, latest: bool) -> Floats:
    """Return the programs' answers, NaN where they find none."""
    uniform = linear_program.is_uniform(pairs, low, high)
    answer = np.full(len(pairs), np.nan)
    for k in range(len(pairs)):
        program = linear_program if uniform[k] else nonlinear_program
        pair = pairs.take(np.array([k]))
        found = program.extreme_contact(pair, float(low[k]), float(high[k]), latest=latest)
        if found is None:
            programs.failed_calls += 1
        else:
            answer[k] = found
    programs.lp_calls += int(uniform.sum())
    programs.nlp_calls += int((~uniform).sum())
    return answer


def _uncertain_ends(
    pairs: Encounters, start: Floats, end: Floats, first: Floats, last: Floats
) -> tuple[Floats, Floats]:
    """Return (n,) how many seconds after its start, and before its end, a contact is certain.

    It is certain where clearance <= -certainty_margin_m: plane coordinates are rounded by less than TOUCH_M, and
    distances are too short by at most their error. If it is certain nowhere, both are its whole duration.

    first, last : (n,) further instants of contact that are tried, besides its ends, quarters and middle
    """
    every = np.arange(len(start))
    deep_m = np.full(len(start), -pairs.certainty_margin_m)
    found = []
    for outer, witness in ((start, first), (end, last)):
        uncertain_s = end - start
        quarters = [start + share * (end - start) for share in (0.5, 0.25, 0.75)]
        for deep in (outer, *quarters, witness):
            rows = np.flatnonzero((clearance_m(pairs, every, deep) <= deep_m) & (uncertain_s >= end - start))
            certain = crossing(clearance_of(pairs, rows), outer[rows], deep[rows], deep_m[rows])[1]
            uncertain_s[rows] = np.abs(certain - outer[rows])
        found.append(uncertain_s)
    return found[0], found[1]


def _hull(undecided: Undecided, n: int) -> tuple[Floats, Floats]:
    """Return (n,) the first start and the last end of each row's intervals."""
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    np.minimum.at(low, undecided.row, undecided.start)
    np.maximum.at(high, undecided.row, undecided.end)
    return low, high
