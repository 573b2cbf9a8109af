"""Find proofs of what a detection found, for a checker that knows nothing of this package (docs/reference/proof.md).

Pairs whose boxes meet are proven apart, outside of the periods that are reported of them, by directions of the kernel.
Conflicts are proven by instants at which the two are in contact, at both ends of each period, and deep enough at one.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.distinct import is_in
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.ragged import offsets
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
# Of an error bound.
_ERROR_SHARES: Final = (0.25, 0.5, 1.0)
# A contact is shown where polygons are nearer than this, metres: half of what a checker allows.
_CONTACT_M: Final = 5e-7
# Shares of a period at which its depth is looked at.
_DEPTH_LOOKS: Final = np.linspace(0.0, 1.0, 17)
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


# By the places of both objects, the smaller first.
_Known: TypeAlias = Mapping[tuple[int, int], Reported]


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


class Contact(NamedTuple):
    """A contact of two pieces at an instant, seconds after the start of their shared time.

    kind : contact, deep, or late: of a track with a smaller delay than the least one
    a_deg, b_deg : a point in both, or the nearest points of both; None: not needed
    """

    kind: str
    a: int
    b: int
    turns: int
    at_s: float
    a_deg: tuple[float, float] | None = None
    b_deg: tuple[float, float] | None = None


@dataclass(slots=True)
class Proofs:
    """The proofs of a scene: how its objects are cut, and chunks of steps and of contacts, once and in order."""

    cuts: Cuts
    chunks: Iterator[tuple[Apart, list[Contact]]]
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
    known = _known(reported)
    of = np.arange(areas + len(occupied.tracks))
    copies = range(len(of) - len(delays), len(of))
    of[copies] = [one.of for one in delays]
    objects = _Objects(areas, of, len(delays))
    found.counts.delays = found.counts.unproven_delays = len(delays)
    found.chunks = _chunks(setup, made, objects, known, found.counts, jobs)
    if late is not None:
        early = proof_pieces(setup, late.occupied, reach_m + setup.scene.tolerance_m)
        # The same cuts give the same numbers.
        if [early.cuts.cuts_us.get(k) for k in copies] == [made.cuts.cuts_us.get(k) for k in copies]:
            found.chunks = chain(found.chunks, _late(setup, early, objects, _known(late.met), found.counts, jobs))
    return found


def _known(reported: Sequence[Reported]) -> _Known:
    return {(min(one.a, one.b), max(one.a, one.b)): one for one in reported}


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
    known: _Known,
    counts: ProofCounts,
    jobs: int,
) -> Iterator[tuple[Apart, list[Contact]]]:
    for pairs in _pairs(setup, made, objects):
        yield _apart(pairs, known, counts, jobs), list(_contacts(pairs, known, counts, jobs))


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
    setup: Setup, made: ProofPieces, objects: _Objects, known: _Known, counts: ProofCounts, jobs: int
) -> Iterator[tuple[Apart, list[Contact]]]:
    """Yield a contact of each delayed copy, without steps."""
    whole, real = np.empty(0, np.int64), np.empty(0)
    nothing = Apart(whole, whole, whole, np.zeros(1, np.int64), real, real, real)
    place = dict(zip(made.number.tolist(), objects.places(made.pieces).tolist(), strict=True))
    proven: dict[int, Contact] = {}
    for pairs in _pairs(setup, made, objects, setup.scene.tolerance_m):
        for one in _contacts(pairs, known, ProofCounts(), jobs):
            if one.kind == "contact":
                proven.setdefault(max(place[one.a], place[one.b]), one)
    counts.unproven_delays -= len(proven)
    yield nothing, [one._replace(kind="late") for one in proven.values()]


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

    def seconds(self, row: int, at_us: int) -> float:
        """Return an instant in seconds of a pair."""
        if at_us in (MINUS_INFINITY_US, INFINITY_US):
            return -np.inf if at_us == MINUS_INFINITY_US else np.inf
        return (at_us - int(self.zero_us[row])) / 1e6

    def is_during(self, row: int, start_us: int, end_us: int) -> bool:
        """Return whether the shared time of a pair begins within a period."""
        pieces = self.scene.pieces
        begin = max(int(pieces.start_us[self.a[row]]), int(pieces.start_us[self.b[row]]))
        return start_us <= begin <= end_us

    def of_reported(self, known: _Known) -> dict[tuple[int, int], list[int]]:
        """Return the rows of each reported pair of objects."""
        most = int(max(self.first.max(initial=0), self.second.max(initial=0))) + 1
        keys = np.array([a * most + b for a, b in known if a < most and b < most], np.int64)
        found: dict[tuple[int, int], list[int]] = {}
        for row in np.flatnonzero(is_in(self.first * most + self.second, keys)).tolist():
            found.setdefault((int(self.first[row]), int(self.second[row])), []).append(row)
        return found


def _apart(pairs: _PiecePairs, known: _Known, counts: ProofCounts, jobs: int) -> Apart:
    """Return steps that prove pairs apart, outside of the periods that are reported of them."""
    is_reported = np.zeros(len(pairs), np.bool_)
    windows: list[tuple[int, float, float]] = []
    for objects, rows in pairs.of_reported(known).items():
        is_reported[rows] = True
        for one in rows:
            windows += [(one, low, high) for low, high in _outside(pairs, one, known[objects].periods_us)]
    plain = np.flatnonzero(~is_reported)
    row = np.concatenate([plain, np.array([one[0] for one in windows], np.int64)])
    low, high = (
        np.concatenate([own[plain], np.array([one[k] for one in windows])])
        for k, own in ((1, pairs.low_s), (2, pairs.high_s))
    )
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


def _outside(pairs: _PiecePairs, row: int, periods_us: Sequence[tuple[int, int]]) -> Iterator[tuple[float, float]]:
    """Yield the times of a pair, seconds, that are in none of some periods."""
    if pairs.is_static[row]:
        return
    begin, end = float(pairs.low_s[row]), float(pairs.high_s[row])
    spans = [(pairs.seconds(row, start_us), pairs.seconds(row, end_us)) for start_us, end_us in periods_us]
    if begin == end:
        if not any(start <= begin <= last for start, last in spans):
            yield begin, end
        return
    for start, last in [*spans, (np.inf, np.inf)]:
        if start > begin:
            yield begin, min(start, end)
        begin = max(begin, last)
        if begin >= end:
            return


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


class _Trial(NamedTuple):
    """An instant at which a pair is searched for contact; of: the kind of proof that needs it."""

    of: tuple[int, int, str]
    row: int
    at_s: float


def _contacts(pairs: _PiecePairs, known: _Known, counts: ProofCounts, jobs: int) -> Iterator[Contact]:
    """Yield contacts at both ends of the periods of conflicts, and one deep enough of each conflict."""
    conflicts = [
        (known[objects], rows)
        for objects, rows in pairs.of_reported(known).items()
        if known[objects].verdict is Verdict.CONFLICT
    ]
    trials = [one for k, given in enumerate(conflicts) for one in _trials(pairs, k, *given)]
    row = np.array([one.row for one in trials], np.int64)
    at_s = np.array([one.at_s for one in trials])
    given = pairs.a[row], pairs.b[row], pairs.zero_us[row], at_s
    distance_m = distances(pairs.scene, PieceRows(given[0]), PieceRows(given[1]), *given[2:], jobs)
    scene = pairs.setup.scene
    chosen: dict[tuple[int, int, str], int] = {}
    for k, trial in enumerate(trials):
        best = chosen.get(trial.of)
        if trial.of[2] == "deep":
            if best is None or distance_m[k] < distance_m[best]:
                chosen[trial.of] = k
        elif best is None and distance_m[k] <= scene.separation_m + _CONTACT_M:
            chosen[trial.of] = k
    deep_m = scene.separation_m - scene.tolerance_m - _DEEPER_M
    chosen = {of: k for of, k in chosen.items() if of[2] != "deep" or distance_m[k] < deep_m}
    counts.conflicts += len(conflicts)
    for number, (one, _) in enumerate(conflicts):
        needed = [(number, period, side) for period in range(len(one.periods_us)) for side in ("start", "end")]
        counts.unproven_conflicts += not all(of in chosen for of in [*needed, (number, 0, "deep")])
    yield from _with_points(pairs, [(of[2], trials[k]) for of, k in chosen.items()], jobs)


def _trials(pairs: _PiecePairs, number: int, one: Reported, rows: Sequence[int]) -> Iterator[_Trial]:
    """Yield instants at which a conflict may be in contact, the nearest to the ends of its periods first."""
    looks = sorted({*_LOOKS_S, *(share * one.time_error_s + 1e-6 for share in _ERROR_SHARES)})
    for period, (start_us, end_us) in enumerate(one.periods_us):
        spans = []
        for row in rows:
            if pairs.is_static[row]:
                if pairs.is_during(row, start_us, end_us):
                    spans.append((row, 0.0, 0.0))
                continue
            low = max(float(pairs.low_s[row]), pairs.seconds(row, start_us))
            high = min(float(pairs.high_s[row]), pairs.seconds(row, end_us))
            if low <= high:
                spans.append((row, low, high))
        for look in looks:
            for row, low, high in spans:
                start, end = pairs.seconds(row, start_us) + look, pairs.seconds(row, end_us) - look
                start, end = (0.0, 0.0) if pairs.is_static[row] else (start, end)
                # The end of a period that lasts to the end of the heights' overlap, or of a slice.
                if low <= start <= high:
                    yield _Trial((number, period, "start"), row, start)
                if low <= end <= high:
                    yield _Trial((number, period, "end"), row, end)
        for row, low, high in spans:
            for share in _DEPTH_LOOKS if high > low else (0.0,):
                yield _Trial((number, 0, "deep"), row, low + float(share) * (high - low))


def _with_points(pairs: _PiecePairs, found: Sequence[tuple[str, _Trial]], jobs: int) -> Iterator[Contact]:
    """Yield contacts at instants, with the points that show them."""
    scene = pairs.setup.scene
    row = np.array([trial.row for _, trial in found], np.int64)
    at_s = np.array([trial.at_s for _, trial in found])
    a, b, zero_us = PieceRows(pairs.a[row]), PieceRows(pairs.b[row]), pairs.zero_us[row]
    numbers = [column[row].tolist() for column in pairs.numbers()]
    if scene.separation_m > 0.0:
        each = np.arange(len(row) + 1), np.full(len(row), np.inf), np.zeros(len(row))
        nearest = closest(pairs.scene, a, b, zero_us, at_s, at_s, *each, kernel.Work(), jobs)
        places = nearest.a_deg.tolist(), nearest.b_deg.tolist()
    else:
        one = meetings(pairs.scene, a, b, zero_us, at_s, jobs).tolist()
        places = one, one
    for k, (kind, trial) in enumerate(found):
        number = (numbers[0][k], numbers[1][k], numbers[2][k], trial.at_s)
        a_deg, b_deg = (tuple(side[k]) for side in places)
        if kind == "deep":
            is_near = scene.separation_m > 0.0 and scene.separation_m >= scene.tolerance_m
            yield Contact("deep", *number, *((a_deg, b_deg) if is_near else ()))
        else:
            yield Contact("contact", *number, a_deg, b_deg if scene.separation_m > 0.0 else None)
