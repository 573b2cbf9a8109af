"""Which departures of tracks bring them into conflict: stages 1 and 2 without time, then differences of departure.

A delay d of a track, in whole microseconds, is forbidden if the track, departing d later, comes within the scene's
separation and tolerance of anything that departs as planned, or of where that is within the separation in time, T: so
intervals reach T further at both ends. Outer intervals contain all forbidden delays; inner intervals contain forbidden
ones only.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, Literal, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.object_numbers import kinds_and_ids, numbers_of
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.climbs import with_heights
from conflictdb.core.memory_budget import DEFAULT_MEMORY
from conflictdb.core.near import FOREVER_US, Memory, Question
from conflictdb.core.pieces.covers import COVER, is_covered
from conflictdb.earth.geodesy import is_standing
from conflictdb.earth.registry import Setup
from conflictdb.kernel.differences import Shifts, difference_parts
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, Track
from conflictdb.model.recurring_plans import spans_of
from conflictdb.model.results import Kind

_Ints = NDArray[np.int64]
# An end of the time of a piece.
_End = Literal["start", "end"]

# More than times of pieces are rounded by, microseconds.
_ROUNDING_US: Final = 0.1
# Differences are asked for up to this much beyond the horizon, microseconds: more than they are rounded by.
_BEYOND_US: Final = 10
# An inner interval ends this many units inside of the proven one: at its end two objects may share only the last
# instant of a span, which does not belong to it.
LAST_INSTANT: Final = 1


@dataclass(frozen=True, slots=True)
class Spans:
    """n closed intervals of whole microseconds, in order and with a free microsecond between any two.

    low, high : (n,)
    """

    low: _Ints
    high: _Ints

    def __len__(self) -> int:
        return len(self.low)

    def contains(self, least: int, most: int) -> bool:
        """Return whether all values from least to most are in one interval."""
        k = int(np.searchsorted(self.low, least, side="right")) - 1
        return k >= 0 and bool(self.high[k] >= most)

    @classmethod
    def union(cls, low: _Ints, high: _Ints) -> Self:
        """Return the union of closed intervals (m,); empty ones (low > high) are left out."""
        order = np.argsort(low, kind="stable")
        order = order[low[order] <= high[order]]
        low, reached = low[order], np.maximum.accumulate(high[order])
        opens = np.ones(len(order), np.bool_)
        opens[1:] = low[1:] > reached[:-1] + 1
        first = np.flatnonzero(opens)
        return cls(low[first], reached[np.append(first[1:], len(reached)) - 1] if len(first) else reached)


@dataclass(frozen=True, slots=True)
class Differences:
    """Changes of n pieces of tracks that bring them into contact with a piece of another object, in whole units.

    Delays are in microseconds, speeds in millionths of a millionth of the planned one (`core.speeds`).

    track, other : (n,) numbers of the objects (`object_numbers`)
    low, high : (n,) outer intervals
    inner_low, inner_high : (n,) inner intervals, empty (low > high) where nothing is proven
    """

    track: _Ints
    other: _Ints
    low: _Ints
    high: _Ints
    inner_low: _Ints
    inner_high: _Ints

    def of_each_track(self) -> Iterator[tuple[int, "Differences"]]:
        """Yield the number of each track that has differences, and these."""
        order = np.argsort(self.track, kind="stable")
        numbers, first = np.unique(self.track[order], return_index=True)
        for number, rows in zip(numbers.tolist(), np.split(order, first[1:]), strict=False):
            yield number, self.take(rows)

    def take(self, rows: _Ints) -> "Differences":
        """Return some rows."""
        return Differences(*(getattr(self, one.name)[rows] for one in fields(self)))

    @classmethod
    def concatenate(cls, parts: Sequence["Differences"]) -> "Differences":
        """Return the rows of all parts; at least one part."""
        return cls(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(cls)))

    @classmethod
    def of_intervals(cls, other: _Ints, low: _Ints, high: _Ints, is_inner: NDArray[np.bool_]) -> Self:
        """Return the differences of one track from closed intervals (n,), outer and inner ones in rows of their own."""
        never = np.full(len(other), 2 * FOREVER_US)
        outer = np.where(is_inner, never, low), np.where(is_inner, -never, high)
        inner = np.where(is_inner, low, never), np.where(is_inner, high, -never)
        return cls(np.zeros(len(other), np.int64), other, *outer, *inner)

    def mirrored(self) -> "Differences":
        """Return the same delays as those of the other objects."""
        return Differences(self.other, self.track, -self.high, -self.low, -self.inner_high, -self.inner_low)

    def forbidden(self, least: int, most: int) -> tuple[Spans, Spans]:
        """Return the outer and the inner intervals of all rows, from least to most."""
        outer = _within(self.low, self.high, least, most)
        inner = _within(self.inner_low, self.inner_high, least - LAST_INSTANT, most + LAST_INSTANT)
        low, high = inner.low + LAST_INSTANT, inner.high - LAST_INSTANT
        return outer, Spans(low[low <= high], high[low <= high])

    def blocking(self, least: int, most: int) -> set[int]:
        """Return the numbers of the objects that forbid every change from least to most."""
        first, last = self.low <= least, self.high >= most
        alone = set(self.other[first & last].tolist())
        together = set(self.other[first].tolist()).intersection(self.other[last].tolist()) - alone
        # Most tracks have a free change, so that no objects forbid all of them together.
        if not together or not Spans.union(self.low, self.high).contains(least, most):
            return alone
        return alone | {other for other in together if self._blocks(other, least, most)}

    def _blocks(self, other: int, least: int, most: int) -> bool:
        rows = self.other == other
        return Spans.union(self.low[rows], self.high[rows]).contains(least, most)


def _within(low: _Ints, high: _Ints, least: int, most: int) -> Spans:
    return Spans.union(np.maximum(low, least), np.minimum(high, most))


@dataclass(frozen=True, slots=True)
class Leeway:
    """The delays of a track that are possible.

    waits : whether the first leg stands still, so that the track occupies its first waypoint until it departs
    has_departed : whether it left its first waypoint before now
    first_us, last_us : the least and the greatest delay, microseconds; 0 and 0 if it has departed
    departs_us : when it leaves as planned, microseconds since 1970; MINUS_INFINITY_US: an area without a start
    """

    waits: bool
    has_departed: bool
    first_us: int
    last_us: int
    departs_us: int

    @classmethod
    def of(cls, plan: Area | Track, horizon_us: int, now_us: int | None = None) -> Self:
        """Return the delays within the horizon that let a track depart at `now_us` or later; None: any.

        A track that waits at its first waypoint may leave it now; any other begins now at the earliest, and so does an
        area. An area that is never active has no departure.
        """
        if isinstance(plan, Area):
            begins_us = start_of(plan)
            return cls.between(begins_us, begins_us, horizon_us, now_us)
        track = plan
        stands = 0
        # The latitude of most tracks changes on the first leg.
        if track.positions_deg[0, 1] == track.positions_deg[1, 1]:
            moves = ~is_standing(track.positions_deg[:1], track.positions_deg[1:])
            stands = int(np.argmax(moves)) if moves.any() else len(moves)
        # The first voyage; all are delayed together.
        first_us = track.departures_us[0] if track.departures_us else int(track.times_us[0])
        leaves_us = first_us + int(track.times_us[stands] - track.times_us[0])
        return cls.between(first_us, leaves_us, horizon_us, now_us)

    @classmethod
    def between(cls, starts_us: int, leaves_us: int, horizon_us: int, now_us: int | None) -> Self:
        """Return the delays of a track that begins at `starts_us` and leaves its first waypoint at `leaves_us`."""
        waits = leaves_us > starts_us
        if now_us is None:
            return cls(waits, False, -horizon_us, horizon_us, leaves_us)
        if leaves_us < now_us:
            return cls(waits, True, 0, 0, leaves_us)
        departs_us = starts_us if now_us <= starts_us else leaves_us
        return cls(waits, False, max(-horizon_us, now_us - departs_us), horizon_us, leaves_us)

    @classmethod
    def at(cls, waypoint_us: int, horizon_us: int, now_us: int | None = None) -> Self:
        """Return the waits at a waypoint that a track reaches at `waypoint_us`, if it has not by now."""
        has_departed = now_us is not None and waypoint_us < now_us
        return cls(True, has_departed, 0, 0 if has_departed else horizon_us, waypoint_us)


def start_of(area: Area) -> int:
    """Return when an area with expanded schedules is active first, microseconds; never: MINUS_INFINITY_US."""
    spans = spans_of(area)
    start_us = spans[0][0] if spans else None
    return MINUS_INFINITY_US if start_us is None else start_us


@dataclass(frozen=True, slots=True)
class FirstStops:
    """The tracks whose first leg stands still: they wait there before they depart, on each voyage.

    track : (k,) their numbers (`object_numbers`), once for each later voyage and once for the first
    departs_us : (k,) when each of these voyages begins; of tracks with one voyage, its first piece says
    """

    track: _Ints
    departs_us: _Ints

    @classmethod
    def of(cls, tracks: TrackBatch) -> Self:
        """Return those of some tracks."""
        first = tracks.waypoint_offset[:-1]
        rows = np.flatnonzero(is_standing(tracks.positions_deg[first], tracks.positions_deg[first + 1]))
        departs = tracks.departs.take(rows)
        number = numbers_of(np.full(len(rows), Kind.TRACK.code), tracks.track_id[rows])
        return cls(np.repeat(number, np.diff(departs.offset)), departs.at_us)

    def first_pieces(self, pieces: Pieces, number: _Ints) -> NDArray[np.bool_]:
        """Return (n,) whether pieces, of objects (n,), are the first of one of these voyages."""
        mine = np.flatnonzero(np.isin(number, self.track) & (pieces.part != COVER))
        first_us = np.full(len(mine), INFINITY_US)
        _, track = np.unique(number[mine], return_inverse=True)
        np.minimum.at(first_us, track, pieces.start_us[mine])
        # With a window of departure, the first piece begins before the plan does.
        begins = pieces.start_us[mine] == first_us[track]
        begins |= _are_in(number[mine], pieces.start_us[mine], self.track, self.departs_us)
        found = np.zeros(len(pieces), np.bool_)
        found[mine] = begins
        return found


def _are_in(number: _Ints, at_us: _Ints, numbers: _Ints, all_us: _Ints) -> NDArray[np.bool_]:
    """Return (n,) whether pairs of a number and an instant are among others (k,)."""
    pairs = np.stack([np.concatenate([numbers, number]), np.concatenate([all_us, at_us])])
    _, rank = np.unique(pairs, axis=1, return_inverse=True)
    rank = rank.reshape(-1)
    return np.isin(rank[len(numbers) :], rank[: len(numbers)])


def differences_of(
    setup: Setup,
    placed: Memory,
    tracks: _Ints,
    horizon_us: int,
    threads: int = 1,
    *,
    waits: FirstStops | None,
    moves_areas: bool = False,
) -> Differences:
    """Return the delays within the horizon that bring some tracks into contact with other objects.

    setup : which the pieces were made with
    tracks : (m,) numbers of tracks (`object_numbers`)
    threads : of the kernel
    waits : the tracks that wait at their first waypoint before they depart; None: no track does
    moves_areas : whether some of `tracks` are areas, which have delays, too
    """
    every = differences_with(setup, placed, tracks, horizon_us, threads, waits=waits, moves_areas=moves_areas)
    return every.take(np.flatnonzero(np.isin(every.track, tracks)))


def differences_with(
    setup: Setup,
    placed: Memory,
    objects: _Ints,
    horizon_us: int,
    threads: int = 1,
    *,
    waits: FirstStops | None,
    but: _Ints | None = None,
    moves_areas: bool = False,
) -> Differences:
    """Return the delays within the horizon that bring tracks into contact with some objects, or these with others.

    Each row equals that of `differences_of` its track.

    placed : all pieces of the objects, and of those that they may meet
    objects : (m,) numbers of tracks and areas
    but : (k,) numbers of objects that are left out
    moves_areas : also return the delays of areas, which meet tracks and other areas
    """
    parts = placed.parts(setup.scene)
    if parts[0][1] is not placed:
        given = objects, horizon_us, threads
        found = [
            differences_with(setup.under(own), part, *given, waits=waits, but=but, moves_areas=moves_areas)
            for own, part in parts
        ]
        return Differences.concatenate(found)
    pieces, number = placed.pieces, placed.number
    reach_us = horizon_us + setup.scene.time_separation_us
    a, b = placed.rows(Question.shifted(np.flatnonzero(np.isin(number, objects)), reach_us))
    is_track = pieces.kind == Kind.TRACK.code
    kept = is_track[a] | is_track[b] | moves_areas
    if but is not None:
        kept &= ~np.isin(number[b], but)
    a, b = a[kept], b[kept]
    # The area second, else the larger number: the last digits of an answer depend on the order.
    turned = np.where(is_track[a] == is_track[b], number[b] < number[a], is_track[b])
    a, b = PieceRows(np.where(turned, b, a)), PieceRows(np.where(turned, a, b))
    stands = np.zeros(len(pieces), np.bool_) if waits is None else waits.first_pieces(pieces, number)
    waits_a, waits_b = stands[a], stands[b]
    still = PieceRows(np.concatenate([a[waits_a], b[waits_b]]))
    passing = PieceRows(np.concatenate([b[waits_a], a[waits_b]]))
    prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces, a, b)
    every = delays_of_pairs(setup.scene, prepared, number, a, b, horizon_us, threads=threads)
    moving = every
    if not moves_areas:
        moving = every.take(np.flatnonzero(kinds_and_ids(every.other)[0] == Kind.TRACK.code))
    every = Differences.concatenate(
        [
            every,
            moving.mirrored(),
            _while_waiting(
                delays_of_pairs(
                    setup.scene, prepared, number, still, passing, horizon_us, stays="start", threads=threads
                )
            ),
        ]
    )
    if waits is not None:
        # Nobody knows whether what could not be cut waits first.
        unknown = np.isin(every.track, number[is_track & (pieces.part == COVER)]) & (every.high >= 0)
        every = replace(every, high=np.where(unknown, 2 * FOREVER_US, every.high))
    return every.take(np.flatnonzero((every.low <= horizon_us) & (every.high >= -horizon_us)))


def waits_of(
    setup: Setup, placed: Memory, track: int, waypoint_us: int, horizon_us: int, threads: int = 1
) -> Differences:
    """Return the waits at a waypoint, up to the horizon, that bring a track into contact with other objects.

    The track waits as it is at the end of the leg before: its heading, haven and heights. At the first waypoint it
    waits as it is at the start of the next leg. At the instant of departure both count.

    track : its number
    waypoint_us : when it reaches it
    """
    parts = placed.parts(setup.scene)
    if parts[0][1] is not placed:
        given = track, waypoint_us, horizon_us, threads
        return Differences.concatenate([waits_of(setup.under(own), part, *given) for own, part in parts])
    pieces, number = placed.pieces, placed.number
    mine = np.flatnonzero((number == track) & (pieces.part != COVER))
    before, after = mine[pieces.end_us[mine] <= waypoint_us], mine[pieces.start_us[mine] >= waypoint_us]
    arriving, leaving = before[pieces.end_us[before] == waypoint_us], after[pieces.start_us[after] == waypoint_us]
    stays: _End = "end" if arriving.size else "start"
    stands = arriving if arriving.size else leaving
    within_us = setup.scene.time_separation_us
    planned = placed.rows(Question.shifted(before, within_us))
    moving, waiting = (placed.rows(Question.shifted(rows, horizon_us + within_us)) for rows in (after, stands))
    a, b = (np.concatenate(both) for both in zip(planned, moving, waiting, strict=True))
    prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces, a, b)
    every = Differences.concatenate(
        [
            of_covers(placed, np.array([track]), np.array([horizon_us + within_us])),
            as_planned(delays_of_pairs(setup.scene, prepared, number, *planned, 0, threads=threads)),
            delays_of_pairs(setup.scene, prepared, number, *moving, horizon_us, threads=threads),
            _while_waiting(
                delays_of_pairs(setup.scene, prepared, number, *waiting, horizon_us, stays=stays, threads=threads)
            ),
        ]
    )
    every = every.take(np.flatnonzero((every.low <= horizon_us) & (every.high >= 0)))
    return replace(every, low=np.maximum(every.low, 0), inner_low=np.maximum(every.inner_low, -LAST_INSTANT))


def of_covers(placed: Memory, tracks: _Ints, horizon_us: _Ints) -> Differences:
    """Return what tracks meet, perhaps, that could not be cut into pieces: it forbids every change.

    tracks : (m,) their numbers, ascending
    horizon_us : (m,) how much earlier or later each may be
    """
    rows = np.flatnonzero(np.isin(placed.number, tracks) & (placed.pieces.part == COVER))
    most_us = horizon_us[np.searchsorted(tracks, placed.number[rows])]
    a, b = placed.rows(Question.shifted(rows, most_us, each_way=True))
    forever, nothing = np.full(len(a), 2 * FOREVER_US), np.zeros(len(a), np.int64)
    return Differences(placed.number[a], placed.number[b], -forever, forever, nothing + 1, nothing)


def as_planned(found: Differences) -> Differences:
    """Return the conflicts of pieces that stay as planned, from their delays: what forbids every change."""
    met = found.take(np.flatnonzero((found.low <= 0) & (found.high >= 0)))
    is_known = (met.inner_low < 0) & (met.inner_high > 0)
    forever = np.full(len(met.low), 2 * FOREVER_US)
    return replace(
        met,
        low=-forever,
        high=forever,
        inner_low=np.where(is_known, -forever, 1),
        inner_high=np.where(is_known, forever, -1),
    )


def sorted_keys(keys: Mapping[int, str], numbers: Iterable[int]) -> tuple[str, ...]:
    """Return the keys of objects in order."""
    return tuple(sorted((keys[number] for number in numbers), key=str.encode))


def _while_waiting(found: Differences) -> Differences:
    """Return the delays at which tracks meet something while they wait.

    found : when each piece is met as it is while it waits, as delays; negative: before the wait begins
    """
    met = found.take(np.flatnonzero(found.high >= 0))
    is_known = met.inner_high > 0
    return replace(
        met,
        low=np.maximum(met.low, 0),
        high=np.full(len(met.low), 2 * FOREVER_US),
        inner_low=np.maximum(met.inner_low, 0),
        inner_high=np.where(is_known, 2 * FOREVER_US, -1),
    )


def delays_of_pairs(
    scene: Scene,
    prepared: kernel.KernelScene,
    number: _Ints,
    a: PieceRows,
    b: PieceRows,
    horizon_us: int,
    *,
    stays: _End | None = None,
    threads: int,
) -> Differences:
    """Return the delays within the horizon that bring pairs of pieces into contact, of those that some delay does.

    stays : a stays as it is at this end of its time; None: it has its whole time
    """
    parts = [
        _of_some_pairs(scene, prepared, number, PieceRows(a[rows]), PieceRows(b[rows]), horizon_us, stays, threads)
        for rows in batches(len(a))
    ]
    return Differences.concatenate(parts)


def batches(n: int) -> list[slice]:
    """Return slices of n pairs of pieces whose arrays fit into memory; at least one."""
    return [slice(k, k + DEFAULT_MEMORY.pairs) for k in range(0, max(n, 1), DEFAULT_MEMORY.pairs)]


def _of_some_pairs(
    scene: Scene,
    prepared: kernel.KernelScene,
    number: _Ints,
    a: PieceRows,
    b: PieceRows,
    horizon_us: int,
    stays: _End | None,
    threads: int,
) -> Differences:
    pieces = prepared.pieces
    within_us = scene.time_separation_us
    shifts, first, last = shifts_of(pieces, a, b, horizon_us + within_us, stays=stays)
    # An area is where it is at any time: its end comes to what begins, its start to what ends.
    still = pieces.kind[a] == Kind.AREA.code
    zero, last_zero = (np.where(still, ends, shifts.a_zero_us) for ends in (pieces.end_us[a], pieces.start_us[a]))
    covered = is_covered(pieces, a, b)
    solved = np.flatnonzero(~covered)
    left, own, doubt_s = with_heights(pieces, shifts.take(solved))
    reach_m = scene.separation_m + scene.tolerance_m
    rows, _, found = difference_parts(prepared, own, reach_m, kernel.Work(), threads)
    found["inner_low"] += doubt_s[rows]
    found["inner_high"] -= doubt_s[rows]
    rows = left[rows]
    # Only the times of covers are known.
    unknown = np.zeros(np.count_nonzero(covered), found.dtype)
    unknown["outer_low"], unknown["outer_high"] = -shifts.a_end_s[covered], shifts.b_end_s[covered]
    unknown["inner_low"], unknown["inner_high"] = np.inf, -np.inf
    rows, found = np.concatenate([solved[rows], np.flatnonzero(covered)]), np.concatenate([found, unknown])
    # An unproven interval stays unproven: a separation in time would widen it into a proof.
    nothing = found["inner_low"] > found["inner_high"]
    found["inner_low"][nothing], found["inner_high"][nothing] = np.inf, -np.inf
    # Nothing is rounded between areas, which have no time of their own.
    for name in ("outer_low", "outer_high", "inner_low", "inner_high"):
        found[name][still[rows] & np.isfinite(found[name])] = 0.0
    rounded_us = np.where(still[rows], 0.0, _ROUNDING_US)
    first, last, zero, last_zero = first[rows], last[rows], zero[rows], last_zero[rows]
    return Differences(
        number[a[rows]],
        number[b[rows]],
        _later(first, zero, np.floor(1e6 * found["outer_low"] - rounded_us) - within_us),
        _later(last, last_zero, np.ceil(1e6 * found["outer_high"] + rounded_us) + within_us),
        _later(first, zero, np.ceil(1e6 * found["inner_low"] + rounded_us) - within_us),
        _later(last, last_zero, np.floor(1e6 * found["inner_high"] - rounded_us) + within_us),
    )


def shifts_of(
    pieces: Pieces, a: PieceRows, b: PieceRows, horizon_us: int, *, stays: _End | None = None
) -> tuple[Shifts, _Ints, _Ints]:
    """Return pairs of pieces, each piece with a time of its own, and the first and last instant (n,) that b adds.

    Delays within the horizon are differences plus instant minus the zero of a. An area stands still at all instants of
    its span, a track only at its start. If a is an area, b is one, and their only difference is 0.

    stays : a stays as it is at this end of its time; None: it has its whole time
    """
    is_area, still = (pieces.kind[rows] == Kind.AREA.code for rows in (a, b))
    # An end counts from itself: heights and places at it are exact then.
    zero = np.where(is_area, 0, pieces.end_us[a] if stays == "end" else pieces.start_us[a])
    first, last = pieces.start_us[b], np.where(still, pieces.end_us[b], pieces.start_us[b])
    lasts_s = np.where(is_area | (stays is not None), 0, pieces.end_us[a] - zero) / 1e6
    b_lasts_s = np.where(still, 0, pieces.end_us[b] - np.where(still, pieces.end_us[b], first)) / 1e6
    nothing = np.zeros(len(a))
    least, most = (
        (sign * (horizon_us + _BEYOND_US) - _later(instant, zero, nothing)) / 1e6
        for sign, instant in ((-1, last), (1, first))
    )
    # Pairs of areas meet at any time, or never: the difference of their own times is 0.
    least, most = np.where(is_area, -1.0, least), np.where(is_area, 1.0, most)
    shifts = Shifts(a, b, zero, np.where(still, zero, first), nothing, lasts_s, nothing, b_lasts_s, least, most)
    return shifts, first, last


def _later(instant_us: _Ints, zero_us: _Ints, more_us: NDArray[np.float64]) -> _Ints:
    """Return instant minus zero plus more, microseconds; infinite where one of them is."""
    endless = _endless(instant_us) - np.where(_endless(instant_us) == 0.0, _endless(zero_us), 0.0)
    infinite = np.where(np.isinf(more_us), more_us, endless)
    known = infinite == 0.0
    exact = (
        np.where(known, instant_us, 0) - np.where(known, zero_us, 0) + np.where(known, more_us, 0.0).astype(np.int64)
    )
    return np.where(known, exact, np.where(infinite > 0.0, 2 * FOREVER_US, -2 * FOREVER_US))


def _endless(instant_us: _Ints) -> NDArray[np.float64]:
    """Return infinity for instants that are, and 0 for all others."""
    return np.where(instant_us == MINUS_INFINITY_US, -np.inf, np.where(instant_us == INFINITY_US, np.inf, 0.0))
