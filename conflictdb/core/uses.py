"""Uses of one place by two pieces within the separation in time: of areas, and as contacts at one time.

An area is at its place all the time: widening its span by T leaves an ordinary question. `as_contacts` puts uses in the
form of contacts at one time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.pieces.covers import is_covered
from conflictdb.earth.plane import Plane
from conflictdb.kernel.meeting import meetings
from conflictdb.kernel.time_uses import OF_AREA_A, OF_AREA_B, OF_SPANS, USE, complete
from conflictdb.model.methods import METHODS
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Scene
from conflictdb.model.results import Kind

_Ints = NDArray[np.int64]

# Least share of a period that a piece stretched to it has (see `_stretched`), and the longest leg then, microseconds.
_LEAST_SHARE: Final = 1e-3
_LONGEST_US: Final = 1e18


@dataclass(frozen=True, slots=True)
class Uses:
    """m times during which two pieces use one place within the separation in time.

    pair : (m,) row of the pair of pieces
    of : (m,) USE: times of a and of b, error, verdict, and what is lacking
    """

    pair: _Ints
    of: NDArray[Any]

    def __len__(self) -> int:
        return len(self.pair)

    @classmethod
    def concatenate(cls, parts: Sequence["Uses"]) -> Self:
        """Return the rows of all parts, in the order of pairs; at least one part."""
        pair, of = np.concatenate([one.pair for one in parts]), np.concatenate([one.of for one in parts])
        order = np.argsort(pair, kind="stable")
        return cls(pair[order], of[order])

    def times_us(self, member: str) -> tuple[_Ints, _Ints]:
        """Return when a, or b, is at a place that the other uses: start and end (m,)."""
        return self.of[f"{member}_start_us"], self.of[f"{member}_end_us"]

    def periods_us(self) -> tuple[_Ints, _Ints]:
        """Return the first and the last instant (m,) of either piece."""
        (a_start, a_end), (b_start, b_end) = self.times_us("a"), self.times_us("b")
        return np.minimum(a_start, b_start), np.maximum(a_end, b_end)

    @property
    def first_deg(self) -> Floats:
        """Return longitude and latitude (m, 2) of where they begin; NaN if it is unknown."""
        return np.stack([self.of["first_lon_deg"], self.of["first_lat_deg"]], axis=1)

    @property
    def lacking_s(self) -> tuple[Floats, Floats]:
        """Return the seconds that are lacking, and by how much less they may be (m,); NaN if it is unknown."""
        return self.of["lacking_s"], self.of["lacking_error_s"]


def with_wide_areas(pieces: Pieces, within_us: int) -> Pieces:
    """Return pieces with the spans of areas widened by a number of microseconds at both ends."""
    by_us = np.where(pieces.kind == Kind.AREA.code, within_us, 0)
    return pieces.longer(by_us, by_us)


def uses_of_contacts(
    scene: Scene,
    pieces: Pieces,
    prepared: kernel.KernelScene,
    pairs: Pairs,
    contacts: Contacts,
    threads: int,
    *,
    is_whole: bool,
) -> Uses:
    """Return contacts of pieces with wide areas as uses of one place.

    pieces : with their own spans
    prepared : the pieces with wide areas, from which the contacts are
    is_whole : whether they last while both pieces do, as those of areas, and undecided ones; else of tracks with areas
    """
    a, b = PieceRows(pairs.a[contacts.pair]), PieceRows(pairs.b[contacts.pair])
    of = np.zeros(len(contacts), USE)
    for name in ("error_s", "verdict", "touches"):
        of[name] = getattr(contacts, name)
    place_deg = _first_deg(scene, prepared, a, b, contacts, threads)
    of["first_lon_deg"], of["first_lat_deg"] = place_deg.T
    of_area = np.where(pieces.kind[a] == Kind.AREA.code, OF_AREA_A, OF_AREA_B)
    known = np.full(len(of), OF_SPANS) if is_whole else of_area
    times_s = contacts.start_s, contacts.end_s
    return Uses(contacts.pair, complete(of, spans_us(pieces, a, b), scene.time_separation_us, known, times_s))


def spans_us(pieces: Pieces, a: PieceRows, b: PieceRows) -> tuple[_Ints, _Ints, _Ints, _Ints]:
    """Return start and end (n,) of pieces a, and of b."""
    return pieces.start_us[a], pieces.end_us[a], pieces.start_us[b], pieces.end_us[b]


def as_contacts(plane: Plane, pieces: Pieces, pairs: Pairs, uses: Uses) -> tuple[kernel.KernelScene, Pairs, Contacts]:
    """Return uses (m,) as contacts at one time: of m pairs of pieces, each as long as its period.

    The first piece of a pair is where the piece a is during its use, as an area or along the same part of its leg; the
    second is so for b. So both sweep the same places as the plans, at other times.
    """
    m, (start, end) = len(uses), uses.periods_us()
    made = [
        _stretched(pieces.take(member[uses.pair]), *times, start, end)
        for member, times in ((pairs.a, uses.times_us("a")), (pairs.b, uses.times_us("b")))
    ]
    both = Pieces.concatenate(made)
    a, b = PieceRows(np.arange(m)), PieceRows(np.arange(m, 2 * m))
    length_s = _length_us(start, end) / 1e6
    of = uses.of
    verdict, touches = of["verdict"].astype(np.int8), of["touches"] != 0
    contacts = Contacts(np.arange(m), np.zeros(m), length_s, of["error_s"].copy(), verdict, touches)
    prepared = kernel.KernelScene(plane.kernel_plane, both, a, b)
    return prepared, Pairs(a, b, np.empty((0, 2)), np.zeros(m + 1, np.int64)), contacts


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


def _length_us(start_us: _Ints, end_us: _Ints) -> Floats:
    """Return the time from starts to ends (n,), microseconds; infinite where one of them is."""
    is_endless = (start_us == MINUS_INFINITY_US) | (end_us == INFINITY_US)
    is_never = (start_us == INFINITY_US) | (end_us == MINUS_INFINITY_US)
    known = ~is_endless & ~is_never
    length = np.where(known, end_us, 0) - np.where(known, start_us, 0)
    return np.where(is_never, -np.inf, np.where(is_endless, np.inf, length))
