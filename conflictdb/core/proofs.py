"""Find proofs of what a detection found, for a checker that knows nothing of this package (docs/reference/proof.md).

Pairs whose boxes meet are proven apart, outside of the periods that are reported of them, by directions of the kernel.
Conflicts are proven by instants at which the two are in contact, at both ends of each period, and deep enough at one.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.distinct import is_in
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.ragged import offsets, ragged_rows
from conflictdb.core.climbs import overlap_at_one_time
from conflictdb.core.near import Memory, Question
from conflictdb.core.object_pairs import ordered_members
from conflictdb.core.proof_pieces import Cuts, ProofPieces, proof_pieces
from conflictdb.core.separations import Separations
from conflictdb.core.world import Occupied
from conflictdb.earth.registry import Setup
from conflictdb.kernel.approach import closest
from conflictdb.kernel.directions import Directions, directions
from conflictdb.kernel.meeting import distances, meetings
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US
from conflictdb.model.results import Kind, Verdict

_Ints = NDArray[np.int64]

# Seconds after the begin of a period, and before its end, at which contact is looked for.
_LOOKS_S: Final = (0.0, 1e-6, 2e-6, 5e-6, 1e-5, 5e-5, 2e-4, 9e-4, 9e-3)
# Shares of an error bound.
_ERROR_SHARES: Final = (0.25, 0.5, 1.0)
# A contact is shown where polygons are nearer than this, metres: half of what a checker allows.
_CONTACT_M: Final = 5e-7
# Shares of a period at which its depth is looked at; the middle suffices if it is clearly deeper, metres.
_DEPTH_LOOKS: Final = np.linspace(0.0, 1.0, 17)
_CLEARLY_M: Final = 1e-3
# Deeper than the tolerance by this, metres.
_DEEPER_M: Final = 2e-6


class Reported(NamedTuple):
    """What was found about a pair: places of its objects; its verdict, periods (microseconds), error."""

    a: int
    b: int
    verdict: Verdict
    periods_us: Sequence[tuple[int, int]]
    time_error_s: float


class Delayed(NamedTuple):
    """A least delay, microseconds, of the track at a place; a delay that is smaller by the error is in contact."""

    of: int
    least_us: int
    error_us: int


@dataclass(frozen=True, slots=True)
class _Reports:
    """What was found about n pairs of objects, in order of their keys.

    objects : how many objects there are; key : (n,) of a pair, the smaller place times objects, plus the larger one
    is_conflict : (n,)
    offset : (n + 1,) the periods of each
    start_us, end_us : (m,)
    error_s : (n,)
    """

    objects: int
    key: _Ints
    is_conflict: NDArray[np.bool_]
    offset: _Ints
    start_us: _Ints
    end_us: _Ints
    error_s: Floats

    @classmethod
    def of(cls, reported: Sequence[Reported], objects: int) -> "_Reports":
        pairs = np.array([(one.a, one.b) for one in reported], np.int64).reshape(-1, 2)
        key = pairs.min(axis=1) * objects + pairs.max(axis=1)
        order = np.argsort(key)
        ordered = [reported[k] for k in order.tolist()]
        periods = np.array([period for one in ordered for period in one.periods_us], np.int64).reshape(-1, 2)
        return cls(
            objects,
            key[order],
            np.array([one.verdict is Verdict.CONFLICT for one in ordered], np.bool_),
            offsets([len(one.periods_us) for one in ordered]),
            periods[:, 0],
            periods[:, 1],
            np.array([one.time_error_s for one in ordered]),
        )

    def of_pairs(self, first: _Ints, second: _Ints) -> _Ints:
        """Return the row of each pair of objects (n,), the first the smaller; -1: nothing was reported."""
        key = first * self.objects + second
        at = np.searchsorted(self.key, key)
        return np.where(np.append(self.key, -1)[at] == key, at, -1)


@dataclass(slots=True)
class ProofCounts:
    """How much is proven so far.

    pairs : pairs of pieces whose boxes meet; steps : directions that prove them apart
    conflicts : of them, reported; unproven_pairs, unproven_conflicts : without proof
    delays, unproven_delays : least delays, and those without proof
    evaluations : of two polygons at an instant
    kernel_s : seconds of a processor that directions took
    """

    pairs: int = 0
    steps: int = 0
    conflicts: int = 0
    unproven_pairs: int = 0
    unproven_conflicts: int = 0
    delays: int = 0
    unproven_delays: int = 0
    evaluations: int = 0
    kernel_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Apart:
    """Steps of n pairs of pieces, numbered as `ProofPieces` are.

    a, b, turns : (n,) the pieces, and by how many turns b is moved against how both objects are written
    offset : (n + 1,) the steps of each pair
    until_s, angle : (m,) as of `Directions`, from the start of the shared time
    lasts_s : (n,) the shared time
    """

    a: _Ints
    b: _Ints
    turns: _Ints
    offset: _Ints
    until_s: Floats
    angle: Floats
    lasts_s: Floats


@dataclass(frozen=True, slots=True)
class ProvenContacts:
    """Contacts (n,) of two pieces at instants.

    kind : contact, deep, or late: of a track with a smaller delay than the least one
    a, b, turns : (n,) as of `Apart`
    at_s : (n,) seconds after the start of the shared time
    points_deg : (n, 2) a point in both, (n, 4) the nearest points of both, or (n, 0): not needed
    """

    kind: str
    a: _Ints
    b: _Ints
    turns: _Ints
    at_s: Floats
    points_deg: Floats

    def take(self, rows: _Ints) -> "ProvenContacts":
        """Return some of the contacts."""
        whole = self.a[rows], self.b[rows], self.turns[rows]
        return ProvenContacts(self.kind, *whole, self.at_s[rows], self.points_deg[rows])


@dataclass(slots=True)
class Proofs:
    """The proofs of a scene: how its objects are cut, and chunks of steps and of contacts, once and in order."""

    cuts: Cuts
    chunks: Iterator[tuple[Apart, list[ProvenContacts]]]
    counts: ProofCounts = field(default_factory=ProofCounts)


class Late(NamedTuple):
    """The same objects, each delayed track with a smaller delay, and with which others it is in contact then."""

    occupied: Occupied
    met: Sequence[Reported]


def proofs_of(
    setup: Setup,
    occupied: Occupied,
    reported: Sequence[Reported],
    jobs: int = 1,
    delays: Sequence[Delayed] = (),
    late: Late | None = None,
) -> Proofs:
    """Return the proofs of what was reported about the objects of a scene; near pairs are not reported.

    delays : the last tracks of `occupied` are these tracks, delayed
    """
    reach_m, areas = setup.scene.largest_separation_m, len(occupied.areas)
    made = proof_pieces(setup, occupied, reach_m)
    found = Proofs(made.cuts, iter(()))
    of = np.arange(areas + len(occupied.tracks))
    known = _Reports.of(reported, len(of))
    copies = range(len(of) - len(delays), len(of))
    of[copies] = [one.of for one in delays]
    objects = _Objects(areas, of, len(delays))
    found.counts.delays = found.counts.unproven_delays = len(delays)
    found.chunks = _chunks(setup, made, objects, known, found.counts, jobs)
    if late is not None:
        early = proof_pieces(setup, late.occupied, reach_m + setup.scene.tolerance_m)
        # The same cuts give the same numbers.
        if [early.cuts.cuts_us.get(k) for k in copies] == [made.cuts.cuts_us.get(k) for k in copies]:
            found.chunks = chain(
                found.chunks, _late(setup, early, objects, _Reports.of(late.met, len(of)), found.counts, jobs)
            )
    return found


@dataclass(frozen=True, slots=True)
class _Objects:
    """The objects of pieces.

    areas : how many are areas
    of : (n,) the place of each, of a delayed copy that of its track
    delayed : how many of the last ones are copies
    """

    areas: int
    of: _Ints
    delayed: int

    def places(self, pieces: Pieces) -> _Ints:
        """Return the place of the object of each piece."""
        return np.asarray(np.where(pieces.kind == Kind.AREA.code, 0, self.areas) + pieces.object_id)

    def compared(self, pieces: Pieces, a: PieceRows, b: PieceRows) -> tuple[PieceRows, PieceRows]:
        """Return pairs without those of a delayed copy with its own track, or with another copy."""
        if not self.delayed:
            return a, b
        place, first = self.places(pieces), len(self.of) - self.delayed
        one, other = place[a], place[b]
        rows = np.flatnonzero((self.of[one] != self.of[other]) & ((one < first) | (other < first)))
        return PieceRows(a[rows]), PieceRows(b[rows])


def _chunks(
    setup: Setup,
    made: ProofPieces,
    objects: _Objects,
    known: _Reports,
    counts: ProofCounts,
    jobs: int,
) -> Iterator[tuple[Apart, list[ProvenContacts]]]:
    for pairs in _pairs(setup, made, objects):
        yield _apart(pairs, known, counts, jobs), _contacts(pairs, known, counts, jobs)


def _pairs(setup: Setup, made: ProofPieces, objects: _Objects, within_m: float = 0.0) -> Iterator["_PiecePairs"]:
    """Yield pairs of pieces whose boxes meet, with required separations that are larger by within_m."""
    separations = Separations.of(setup.scene)
    for chunk in Memory(made.pieces).pairs(Question()):
        for settings, own, a, b in separations.split(chunk.pieces, chunk.a, chunk.b):
            a, b = objects.compared(own, a, b)
            if len(a) and not settings.time_separation_us:
                settings = replace(settings, separation_m=settings.separation_m + within_m)
                yield _PiecePairs.of(setup.under(settings), made, own, objects, a, b)


def _late(
    setup: Setup, made: ProofPieces, objects: _Objects, known: _Reports, counts: ProofCounts, jobs: int
) -> Iterator[tuple[Apart, list[ProvenContacts]]]:
    """Yield a contact of each delayed copy, without steps."""
    whole, real = np.empty(0, np.int64), np.empty(0)
    nothing = Apart(whole, whole, whole, np.zeros(1, np.int64), real, real, real)
    place = np.zeros(int(made.number.max(initial=0)) + 1, np.int64)
    place[made.number] = objects.places(made.pieces)
    proven = np.empty(0, np.int64)
    for pairs in _pairs(setup, made, objects, setup.scene.tolerance_m):
        found = _contacts(pairs, known, ProofCounts(), jobs)[0]
        copy, row = np.unique(np.maximum(place[found.a], place[found.b]), return_index=True)
        row = row[~np.isin(copy, proven)]
        proven = np.union1d(proven, copy)
        yield nothing, [replace(found.take(row), kind="late")]
    counts.unproven_delays -= len(proven)


@dataclass(frozen=True, slots=True)
class _PiecePairs:
    """n pairs of pieces a, b of a scene of the kernel.

    first, second : (n,) their objects
    zero_us, lasts_s : (n,) start and length of the shared time; of two areas 0
    low_s, high_s : (n,) when their heights overlap
    """

    setup: Setup
    made: ProofPieces
    scene: kernel.KernelScene
    a: PieceRows
    b: PieceRows
    first: _Ints
    second: _Ints
    is_static: NDArray[np.bool_]
    zero_us: _Ints
    lasts_s: Floats
    low_s: Floats
    high_s: Floats

    @classmethod
    def of(
        cls, setup: Setup, made: ProofPieces, pieces: Pieces, objects: _Objects, a: PieceRows, b: PieceRows
    ) -> "_PiecePairs":
        first_s, last_s, _ = overlap_at_one_time(pieces, a, b)
        together = np.flatnonzero(first_s <= last_s)
        a, b, first_s, last_s = PieceRows(a[together]), PieceRows(b[together]), first_s[together], last_s[together]
        a, b, _ = ordered_members(pieces, a, b)
        place = objects.places(pieces)
        is_static = (pieces.kind[a] == Kind.AREA.code) & (pieces.kind[b] == Kind.AREA.code)
        start_us, end_us = pieces.shared_span(a, b)
        lasts_s = np.where(is_static, 0, end_us - np.where(is_static, 0, start_us)) / 1e6
        lasts_s[is_static] = 0.0
        return cls(
            setup,
            made,
            kernel.KernelScene(setup.plane.kernel_plane, pieces, a, b),
            a,
            b,
            place[a],
            place[b],
            is_static,
            np.where(is_static, 0, start_us),
            lasts_s,
            np.maximum(first_s, 0.0),
            np.minimum(last_s, lasts_s),
        )

    def __len__(self) -> int:
        return len(self.a)

    def numbers(self) -> tuple[_Ints, _Ints, _Ints]:
        """Return the numbers of the pieces, and by how many turns b is moved against a (n,)."""
        a, b = (self.scene.pieces.piece_id[rows] for rows in (self.a, self.b))
        return self.made.number[a], self.made.number[b], self.made.turns[b] - self.made.turns[a]

    def seconds(self, rows: _Ints, at_us: _Ints) -> Floats:
        """Return instants (n,) in seconds of pairs."""
        is_ever = (at_us == MINUS_INFINITY_US) | (at_us == INFINITY_US)
        seconds = (np.where(is_ever, 0, at_us) - self.zero_us[rows]) / 1e6
        return np.asarray(np.where(is_ever, np.copysign(np.inf, at_us), seconds))

    def begin_us(self) -> _Ints:
        """Return when the shared time of each pair begins."""
        pieces = self.scene.pieces
        return np.asarray(np.maximum(pieces.start_us[self.a], pieces.start_us[self.b]))


def _apart(pairs: _PiecePairs, known: _Reports, counts: ProofCounts, jobs: int) -> Apart:
    """Return steps that prove pairs apart, outside of the periods that are reported of them."""
    report = known.of_pairs(pairs.first, pairs.second)
    is_reported = report >= 0
    plain, (row, low, high) = np.flatnonzero(~is_reported), _outside(pairs, known, report)
    row = np.concatenate([plain, row])
    low, high = np.concatenate([pairs.low_s[plain], low]), np.concatenate([pairs.high_s[plain], high])
    order = np.lexsort((low, row))
    row, low, high = row[order], low[order], high[order]
    work = kernel.Work()
    separation_m = pairs.setup.scene.separation_m
    given = pairs.a[row], pairs.b[row], pairs.zero_us[row], low, high
    began_s = time.process_time()
    found = directions(pairs.scene, *given, separation_m, work, jobs)
    counts.kernel_s += time.process_time() - began_s
    counts.pairs += len(pairs)
    counts.evaluations += work.evaluations
    counts.steps += int(np.count_nonzero(~np.isnan(found.angle)))
    failed = np.unique(found.pair[np.isnan(found.angle)])
    counts.unproven_pairs += int(np.count_nonzero(~is_reported[row[failed]]))
    return _joined(pairs, found, row, low, high)


def _outside(pairs: _PiecePairs, known: _Reports, report: _Ints) -> tuple[_Ints, Floats, Floats]:
    """Return rows of reported pairs, and times, seconds, that are in no period; report : (n,) of each pair or -1."""
    reported = np.flatnonzero((report >= 0) & ~pairs.is_static)
    # Times before, between and after the periods of each report.
    ends_us = np.insert(known.end_us, known.offset[:-1], MINUS_INFINITY_US)
    starts_us = np.insert(known.start_us, known.offset[1:], INFINITY_US)
    taken, gap = ragged_rows(known.offset + np.arange(len(known.offset)), report[reported])
    row = reported.repeat(np.diff(taken))
    after, before = pairs.seconds(row, ends_us[gap]), pairs.seconds(row, starts_us[gap])
    low, high = np.maximum(pairs.low_s[row], after), np.minimum(pairs.high_s[row], before)
    is_instant = pairs.low_s[row] == pairs.high_s[row]
    kept = np.flatnonzero(np.where(is_instant, (after < low) & (low < before), low < high))
    return row[kept], low[kept], high[kept]


def _joined(pairs: _PiecePairs, found: Directions, row: _Ints, low: Floats, high: Floats) -> Apart:
    """Return the steps of windows (w,) of pairs, with steps that prove nothing between them."""
    n = len(pairs)
    is_first, is_last = np.ones(len(row), np.bool_), np.ones(len(row), np.bool_)
    is_first[1:] = is_last[:-1] = row[1:] != row[:-1]
    before = np.where(is_first, 0.0, np.append(0.0, high[:-1])[: len(row)])
    gaps, ends = np.flatnonzero(low > before), np.flatnonzero(is_last & (high < pairs.lasts_s[row]))
    without = np.setdiff1d(np.arange(n), row)
    of = np.concatenate([row[found.pair], row[gaps], row[ends], without])
    until = np.concatenate([found.until_s, low[gaps], pairs.lasts_s[row[ends]], pairs.lasts_s[without]])
    angle = np.concatenate([found.angle, np.full(len(of) - len(found), np.nan)])
    order = np.lexsort((until, of))
    return Apart(*pairs.numbers(), offsets(np.bincount(of, minlength=n)), until[order], angle[order], pairs.lasts_s)


@dataclass(frozen=True, slots=True)
class _ConflictTimes:
    """Times (n,) of rows of pairs in periods of conflicts, ordered by report, period and row.

    report, period, row : (n,)
    low_s, high_s : (n,) the time
    start_s, end_s : (n,) ends of the period in seconds of the pair; of two areas 0
    """

    report: _Ints
    period: _Ints
    row: _Ints
    low_s: Floats
    high_s: Floats
    start_s: Floats
    end_s: Floats

    @classmethod
    def of(cls, pairs: _PiecePairs, known: _Reports, report: _Ints) -> "_ConflictTimes":
        """Return the times of conflicts; report : (n,) of each pair or -1."""
        rows = np.flatnonzero((report >= 0) & np.append(known.is_conflict, False)[report])
        taken, period = ragged_rows(known.offset, report[rows])
        row = rows.repeat(np.diff(taken))
        start_us, end_us, is_static = known.start_us[period], known.end_us[period], pairs.is_static[row]
        start_s, end_s = (np.where(is_static, 0.0, pairs.seconds(row, at_us)) for at_us in (start_us, end_us))
        low, high = np.maximum(pairs.low_s[row], start_s), np.minimum(pairs.high_s[row], end_s)
        low, high = np.where(is_static, 0.0, low), np.where(is_static, 0.0, high)
        begin_us = pairs.begin_us()[row]
        kept = np.flatnonzero(np.where(is_static, (start_us <= begin_us) & (begin_us <= end_us), low <= high))
        kept = kept[np.lexsort((row[kept], period[kept]))]
        whole = report[row[kept]], period[kept], row[kept]
        return cls(*whole, low[kept], high[kept], start_s[kept], end_s[kept])


def _contacts(pairs: _PiecePairs, known: _Reports, counts: ProofCounts, jobs: int) -> list[ProvenContacts]:
    """Return contacts at both ends of the periods of conflicts, and one deep enough of each conflict."""
    report = known.of_pairs(pairs.first, pairs.second)
    spans = _ConflictTimes.of(pairs, known, report)
    conflicts = np.unique(report[report >= 0])
    conflicts = conflicts[known.is_conflict[conflicts]]
    end, row, at_s = _at_ends(pairs, known, spans, jobs)
    shown = _with_points(pairs, "contact", row, at_s, jobs)
    rows_shown = np.flatnonzero(np.isfinite(shown.points_deg).all(axis=1))
    of, row, at_s = _deepest(pairs, spans, jobs)
    deep = _with_points(pairs, "deep", row, at_s, jobs)
    rows_deep = np.flatnonzero(np.isfinite(deep.points_deg).all(axis=1))
    # Each period has two ends.
    periods = np.diff(known.offset)
    of_period = np.arange(len(periods)).repeat(periods)
    ends = np.bincount(of_period[end[rows_shown] // 2], minlength=len(periods))
    is_proven = is_in(conflicts, of[rows_deep]) & (ends == 2 * periods)[conflicts]
    counts.conflicts += len(conflicts)
    counts.unproven_conflicts += int(np.count_nonzero(~is_proven))
    return [shown.take(rows_shown), deep.take(rows_deep)]


def _distances(pairs: _PiecePairs, row: _Ints, at_s: Floats, jobs: int) -> Floats:
    """Return the distances of rows of pairs at instants, as `distances` does."""
    return distances(pairs.scene, pairs.a[row], pairs.b[row], pairs.zero_us[row], at_s, jobs)


def _at_ends(pairs: _PiecePairs, known: _Reports, spans: _ConflictTimes, jobs: int) -> tuple[_Ints, _Ints, Floats]:
    """Return ends of periods, numbered start and end by turns, with a row in contact and the instant, seconds."""
    looks = np.concatenate(
        [np.tile(_LOOKS_S, (len(known.key), 1)), known.error_s[:, None] * _ERROR_SHARES + 1e-6], axis=1
    )
    looks.sort(axis=1)
    limit_m = pairs.setup.scene.separation_m + _CONTACT_M
    end = np.concatenate([2 * spans.period, 2 * spans.period + 1])
    row, report = np.tile(spans.row, 2), np.tile(spans.report, 2)
    low, high = np.tile(spans.low_s, 2), np.tile(spans.high_s, 2)
    from_s, sign = np.concatenate([spans.start_s, spans.end_s]), np.repeat([1.0, -1.0], len(spans.row))
    found: list[tuple[_Ints, _Ints, Floats]] = []
    left = np.arange(len(end))
    for look in range(looks.shape[1]):
        at_s = from_s[left] + sign[left] * looks[report[left], look]
        # Two areas are always as near.
        at_s[pairs.is_static[row[left]]] = 0.0
        rows = np.flatnonzero((low[left] <= at_s) & (at_s <= high[left]))
        trial, at_s = left[rows], at_s[rows]
        near = np.flatnonzero(_distances(pairs, row[trial], at_s, jobs) <= limit_m)
        ends, first = np.unique(end[trial[near]], return_index=True)
        found.append((ends, row[trial[near[first]]], at_s[near[first]]))
        left = left[~is_in(end[left], ends) & ~pairs.is_static[row[left]]]
    ends, rows, instants = (np.concatenate(columns) for columns in zip(*found, strict=True))
    order = np.argsort(ends)
    return ends[order], rows[order], instants[order]


def _deepest(pairs: _PiecePairs, spans: _ConflictTimes, jobs: int) -> tuple[_Ints, _Ints, Floats]:
    """Return reports, with a row that is deep enough in contact and the instant, seconds."""
    scene = pairs.setup.scene
    deep_m = scene.separation_m - scene.tolerance_m - _DEEPER_M
    found: list[tuple[_Ints, _Ints, Floats]] = []
    left = np.arange(len(spans.row))
    for shares, limit_m in ((_DEPTH_LOOKS[[8]], deep_m - _CLEARLY_M), (_DEPTH_LOOKS, deep_m)):
        each = left.repeat(len(shares))
        row, report, low = spans.row[each], spans.report[each], spans.low_s[each]
        at_s = low + np.tile(shares, len(left)) * (spans.high_s[each] - low)
        distance_m = _distances(pairs, row, at_s, jobs)
        order = np.lexsort((distance_m, report))
        reports, first = np.unique(report[order], return_index=True)
        best = order[first]
        is_deep = distance_m[best] < limit_m
        found.append((reports[is_deep], row[best[is_deep]], at_s[best[is_deep]]))
        left = left[~is_in(spans.report[left], reports[is_deep])]
    reports, rows, instants = (np.concatenate(columns) for columns in zip(*found, strict=True))
    return reports, rows, instants


def _with_points(pairs: _PiecePairs, kind: str, row: _Ints, at_s: Floats, jobs: int) -> ProvenContacts:
    """Return contacts at instants, with the points that show them."""
    scene, given = pairs.setup.scene, (pairs.scene, pairs.a[row], pairs.b[row], pairs.zero_us[row])
    is_apart = scene.separation_m > 0.0
    if kind == "deep" and not (is_apart and scene.separation_m >= scene.tolerance_m):
        points = np.empty((len(row), 0))
    elif is_apart:
        each = np.arange(len(row) + 1), np.full(len(row), np.inf), np.zeros(len(row))
        nearest = closest(*given, at_s, at_s, *each, kernel.Work(), jobs)
        points = np.concatenate([nearest.a_deg, nearest.b_deg], axis=1)
    else:
        points = meetings(*given, at_s, jobs)
    a, b, turns = pairs.numbers()
    return ProvenContacts(kind, a[row], b[row], turns[row], at_s, points)
