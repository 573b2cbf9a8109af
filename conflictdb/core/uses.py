"""Uses of one place by two pieces within the separation in time: of areas, and as contacts at one time.

An area is at its place all the time: widening its span by T leaves an ordinary question. `as_contacts` puts uses in the
form of contacts at one time, so that merging and regions need no other code.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Conflicts, Contacts
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces, later
from conflictdb.core.merge import instants
from conflictdb.core.object_pairs import numbered, object_keys, ordered_members
from conflictdb.core.pieces.covers import is_covered
from conflictdb.earth.plane import Plane
from conflictdb.kernel.meeting import meetings
from conflictdb.model.methods import METHODS
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Scene
from conflictdb.model.results import Kind, Verdict

_Ints = NDArray[np.int64]

# Least share of a period that a piece stretched to it has (see `_stretched`), and the longest leg then, microseconds.
_LEAST_SHARE: Final = 1e-3
_LONGEST_US: Final = 1e18


@dataclass(frozen=True, slots=True)
class Uses:
    """m times during which two pieces use one place within the separation in time.

    pair : (m,) row of the pair of pieces
    a_start_us, a_end_us, b_start_us, b_end_us : (m,) when each is at a place that the other uses within that time, as
        outer bounds; MINUS_INFINITY_US and INFINITY_US where unbounded
    error_s : (m,) bound on how far each end is outside of the true one
    verdict, touches : (m,) as of `Contacts`
    lacking_s, lacking_error_s : (m,) at most this much of the separation is missed, and how much less it may be; NaN if
        it is unknown
    first_deg : (m, 2) where it begins, longitude and latitude; NaN if it is unknown
    """

    pair: _Ints
    a_start_us: _Ints
    a_end_us: _Ints
    b_start_us: _Ints
    b_end_us: _Ints
    error_s: Floats
    verdict: NDArray[np.int8]
    touches: NDArray[np.bool_]
    lacking_s: Floats
    lacking_error_s: Floats
    first_deg: Floats

    def __len__(self) -> int:
        return len(self.pair)

    @classmethod
    def concatenate(cls, parts: Sequence["Uses"]) -> Self:
        """Return the rows of all parts, in the order of pairs; at least one part."""
        columns = [np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(cls)]
        order = np.argsort(columns[0], kind="stable")
        return cls(*(column[order] for column in columns))

    def take(self, rows: _Ints) -> "Uses":
        """Return the uses of some rows."""
        return Uses(*(getattr(self, column.name)[rows] for column in fields(self)))

    def periods_us(self) -> tuple[_Ints, _Ints]:
        """Return the first and the last instant (m,) of either piece."""
        return np.minimum(self.a_start_us, self.b_start_us), np.maximum(self.a_end_us, self.b_end_us)


def with_wide_areas(pieces: Pieces, within_us: int) -> Pieces:
    """Return pieces with the spans of areas widened by so many microseconds at both ends."""
    by_us = np.where(pieces.kind == Kind.AREA.code, within_us, 0)
    return pieces.longer(by_us, by_us)


def uses_by_spans(
    scene: Scene, pieces: Pieces, prepared: kernel.KernelScene, pairs: Pairs, contacts: Contacts, threads: int
) -> Uses:
    """Return pairs of pieces whose contacts last while their spans do: areas, and undecided pairs.

    pieces : with their own spans
    prepared : the pieces with wide areas
    contacts : their verdicts; the times are not read
    """
    a, b = PieceRows(pairs.a[contacts.pair]), PieceRows(pairs.b[contacts.pair])
    times = _near_in_time(pieces, a, b, scene.time_separation_us)
    gap_s = _gap_us((pieces.start_us[a], pieces.end_us[a]), (pieces.start_us[b], pieces.end_us[b])) / 1e6
    is_open = contacts.verdict == Verdict.UNRESOLVED.code
    return Uses(
        contacts.pair,
        *times[0],
        *times[1],
        np.where(is_open, _error_of_whole(times), 0.0),
        contacts.verdict,
        contacts.touches,
        np.where(is_open, np.nan, scene.time_separation_s - gap_s),
        np.where(is_open, np.nan, 0.0),
        _first_deg(scene, prepared, a, b, contacts, threads),
    )


def with_ordered_times(pieces: Pieces, pairs: Pairs, within_us: int, uses: Uses) -> Uses:
    """Return uses (m,) of which those that end before they start are unresolved while both pieces are there.

    pieces : with their own spans
    """
    is_ordered = (uses.a_start_us <= uses.a_end_us) & (uses.b_start_us <= uses.b_end_us) & (uses.error_s >= 0.0)
    rows = np.flatnonzero(~is_ordered)
    if not rows.size:
        return uses
    pair = uses.pair[rows]
    whole = _near_in_time(pieces, PieceRows(pairs.a[pair]), PieceRows(pairs.b[pair]), within_us)
    columns = {one.name: getattr(uses, one.name).copy() for one in fields(uses)}
    for name, times in zip(("a", "b"), whole, strict=True):
        columns[f"{name}_start_us"][rows], columns[f"{name}_end_us"][rows] = times
    columns["error_s"][rows] = _error_of_whole(whole)
    columns["verdict"][rows], columns["touches"][rows] = Verdict.UNRESOLVED.code, True
    for name in ("lacking_s", "lacking_error_s", "first_deg"):
        columns[name][rows] = np.nan
    return Uses(**columns)


def uses_of_areas(
    scene: Scene, pieces: Pieces, prepared: kernel.KernelScene, pairs: Pairs, contacts: Contacts, threads: int
) -> Uses:
    """Return contacts of tracks with areas whose spans were widened, as uses of one place.

    pieces : with their own spans
    prepared : the pieces with wide areas, from which the contacts are
    """
    a, b = PieceRows(pairs.a[contacts.pair]), PieceRows(pairs.b[contacts.pair])
    first, last = instants(contacts, *prepared.pieces.shared_span(a, b))
    within_us = scene.time_separation_us
    is_area = pieces.kind[a] == Kind.AREA.code
    area = PieceRows(np.where(is_area, a, b))
    span = pieces.start_us[area], pieces.end_us[area]
    there = np.maximum(span[0], first - within_us), np.minimum(span[1], last + within_us)
    gap_s = _gap_us(span, (first, last)) / 1e6
    is_open = contacts.verdict == Verdict.UNRESOLVED.code
    lacking_s = scene.time_separation_s - gap_s
    return Uses(
        contacts.pair,
        np.where(is_area, there[0], first),
        np.where(is_area, there[1], last),
        np.where(is_area, first, there[0]),
        np.where(is_area, last, there[1]),
        contacts.error_s,
        contacts.verdict,
        contacts.touches,
        np.where(is_open, np.nan, lacking_s),
        np.where(is_open, np.nan, np.minimum(contacts.error_s, lacking_s)),
        _first_deg(scene, prepared, a, b, contacts, threads),
    )


def as_contacts(plane: Plane, pieces: Pieces, pairs: Pairs, uses: Uses) -> tuple[kernel.KernelScene, Pairs, Contacts]:
    """Return uses (m,) as contacts at one time: of m pairs of pieces, each as long as its period.

    The first piece of a pair is where the piece a is during its use, as an area or along the same part of its leg; the
    second is so for b. So both sweep the same places as the plans, at other times.
    """
    m, (start, end) = len(uses), uses.periods_us()
    made = [
        _stretched(pieces.take(member[uses.pair]), *times, start, end)
        for member, times in ((pairs.a, (uses.a_start_us, uses.a_end_us)), (pairs.b, (uses.b_start_us, uses.b_end_us)))
    ]
    both = Pieces.concatenate(made)
    a, b = PieceRows(np.arange(m)), PieceRows(np.arange(m, 2 * m))
    length_s = _length_us(start, end) / 1e6
    contacts = Contacts(np.arange(m), np.zeros(m), length_s, uses.error_s, uses.verdict, uses.touches)
    prepared = kernel.KernelScene(plane.kernel_plane, both, a, b)
    return prepared, Pairs(a, b, np.empty((0, 2)), np.zeros(m + 1, np.int64)), contacts


def with_lacking(conflicts: Conflicts, prepared: kernel.KernelScene, pairs: Pairs, uses: Uses) -> Conflicts:
    """Return conflicts (n,) with the seconds that are lacking: the most of their uses (m,).

    prepared, pairs : of the uses, as contacts
    """
    a, b, _ = ordered_members(prepared.pieces, pairs.a, pairs.b)
    group, n = numbered(object_keys(prepared.pieces, a, b))
    meet = np.zeros(n, np.bool_)
    meet[group[uses.touches]] = True
    counts = np.flatnonzero((uses.touches | ~meet[group]) & ~np.isnan(uses.lacking_s))
    most, sure = np.full(n, -1.0), np.zeros(n)
    np.maximum.at(most, group[counts], uses.lacking_s[counts])
    np.maximum.at(sure, group[counts], (uses.lacking_s - uses.lacking_error_s)[counts])
    is_known = (most >= 0.0) & (conflicts.verdict != Verdict.UNRESOLVED.code)
    error_s = np.where(is_known, most - np.minimum(sure, most), 0.0)
    return replace(
        conflicts,
        lacking_s=np.where(is_known, most, np.nan),
        time_error_s=np.maximum(conflicts.time_error_s, error_s),
    )


def _first_deg(
    scene: Scene, prepared: kernel.KernelScene, a: PieceRows, b: PieceRows, contacts: Contacts, threads: int
) -> Floats:
    """Return where contacts (m,) of pieces with wide areas begin; NaN at covers, and if the method does not tell."""
    found = np.full((len(contacts), 2), np.nan)
    if METHODS[scene.method].solver is not None:
        seen = np.flatnonzero(~is_covered(prepared.pieces, a, b))
        start_us, _ = prepared.pieces.shared_span(a, b)
        at_s = np.where(np.isfinite(contacts.start_s), contacts.start_s, 0.0)
        found[seen] = meetings(prepared, a[seen], b[seen], start_us[seen], at_s[seen], threads)
    return found


def _stretched(pieces: Pieces, first_us: _Ints, last_us: _Ints, start_us: _Ints, end_us: _Ints) -> Pieces:
    """Return pieces (m,) that are from start to end where they are from their first to their last instant."""
    is_track = pieces.kind == Kind.TRACK.code
    first, last, start, end = (np.where(is_track, one, 0) for one in (first_us, last_us, start_us, end_us))
    length, leg = (end - start).astype(np.float64), (pieces.leg_end_us - pieces.leg_start_us).astype(np.float64)
    # Not so short that instants of the leg leave 64 bits.
    least = np.minimum(leg, np.ceil(length * np.maximum(_LEAST_SHARE, leg / _LONGEST_US))).astype(np.int64)
    first = np.maximum(np.minimum(first, last - least), np.where(is_track, pieces.leg_start_us, 0))
    last = np.minimum(np.maximum(last, first + least), np.where(is_track, pieces.leg_end_us, 0))
    first = np.minimum(first, np.maximum(last - least, np.where(is_track, pieces.leg_start_us, 0)))
    share = np.where(last > first, length / np.maximum(last - first, 1), 1.0)
    before = np.ceil((first - pieces.leg_start_us) * share)
    after = np.maximum(np.ceil((pieces.leg_end_us - first) * share), length)
    return replace(
        pieces,
        start_us=start_us,
        end_us=end_us,
        leg_start_us=np.where(is_track, start - np.where(is_track, before, 0.0).astype(np.int64), pieces.leg_start_us),
        leg_end_us=np.where(is_track, start + np.where(is_track, after, 0.0).astype(np.int64), pieces.leg_end_us),
    )


def _near_in_time(pieces: Pieces, a: PieceRows, b: PieceRows, within_us: int) -> list[tuple[_Ints, _Ints]]:
    """Return when a, and when b, is within `within_us` of the time of the other: start and end (m,)."""
    return [
        (
            np.maximum(pieces.start_us[one], later(pieces.start_us[other], -within_us)),
            np.minimum(pieces.end_us[one], later(pieces.end_us[other], within_us)),
        )
        for one, other in ((a, b), (b, a))
    ]


def _error_of_whole(times: list[tuple[_Ints, _Ints]]) -> Floats:
    """Return the error bound (m,) of periods about which nothing is known, seconds: their length; 0 if it is infinite.

    times : of both pieces, as of `_near_in_time`
    """
    length_s = _length_us(np.minimum(times[0][0], times[1][0]), np.maximum(times[0][1], times[1][1])) / 1e6
    return np.where(np.isfinite(length_s), length_s, 0.0)


def _gap_us(one: tuple[_Ints, _Ints], other: tuple[_Ints, _Ints]) -> Floats:
    """Return the time between two spans (n,), microseconds; 0 if they meet."""
    before, after = _length_us(one[1], other[0]), _length_us(other[1], one[0])
    return np.maximum(0.0, np.maximum(before, after))


def _length_us(start_us: _Ints, end_us: _Ints) -> Floats:
    """Return the time from starts to ends (n,), microseconds; infinite where one of them is."""
    is_endless = (start_us == MINUS_INFINITY_US) | (end_us == INFINITY_US)
    is_never = (start_us == INFINITY_US) | (end_us == MINUS_INFINITY_US)
    known = ~is_endless & ~is_never
    length = np.where(known, end_us, 0) - np.where(known, start_us, 0)
    return np.where(is_never, -np.inf, np.where(is_endless, np.inf, length))
