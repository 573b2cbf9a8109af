"""At which differences of departure two plans meet, at any speed of either: bounds for all speeds at once.

A plan that takes k times as long is at k u, seconds after its departure, where it was planned to be at u. So a and b,
at i and k times their times, meet if and only if the difference of their delays is the planned one plus k v - i u for
some (u, v) of their contact set (`kernel.differences`), which no speed changes. The most that k v - i u can be is a
convex function of i and k. So it is at most what chords between computed ratios i / k say, and at least what each
contact says that the kernel found. Ratios are added where these two differ, at the intersection of the lines of two
contacts (sandwich algorithm: G. Rote, Computing 48 (1992), doi:10.1007/BF02238642).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.earth.registry import Setup
from conflictdb.kernel.differences import DifferenceState, Shifts, differences
from conflictdb.model.results import Kind
from conflictdb.stages.at_any_time import FOREVER_US, AnyTime
from conflictdb.stages.climbs import with_heights
from conflictdb.stages.delays import solved_shifts
from conflictdb.stages.pieces.covers import is_covered

_Ints = NDArray[np.int64]

# Bounds from above and below may differ by this, seconds; the most rounds in which ratios are added, and ratios of a
# pair of pieces; and of all pairs, but for a few of each (60 us each).
_GAP_S: Final = 1e-5
_MOST_ROUNDS: Final = 24
_MOST_RATIOS: Final = 100
_MOST_IN_ALL: Final = 200_000
_LEAST_RATIOS: Final = 6
# Outer ends lie this far outside, and inner ones inside: more than instants are rounded by, and than the last instant
# of a plan, which does not belong to it.
_OUTSIDE_S: Final = 1e-6
_INSIDE_S: Final = 2e-6
# A ratio that is added is not nearer to a computed one than this share of what lies between two.
_NEAREST: Final = 1e-3


@dataclass(frozen=True, slots=True)
class Pace:
    """When a track departs as planned, and the limits of its changes.

    departs_us, lasts_s : the planned departure and duration
    late_s : the least and the largest delay
    times : the least and the largest factor of all its times since its departure
    """

    departs_us: int
    lasts_s: float
    late_s: tuple[float, float]
    times: tuple[float, float]


@dataclass(frozen=True, slots=True)
class ContactSetPart:
    """One part of the contact set of two objects, in n ratios of their factors of time.

    ratios : (n,) ascending
    low, high : (n,) all differences v - ratio u lie between these
    first, last : (n, 2) contacts (u, v) of a small and of a large difference; all differences between theirs are
        contact, at any ratio. NaN where nothing is proven
    doubt_s : the part of these at both ends that may not be, because of heights
    """

    ratios: Floats
    low: Floats
    high: Floats
    first: Floats
    last: Floats
    doubt_s: float


@dataclass(frozen=True, slots=True)
class Meeting:
    """The contacts of a track and another object.

    planned_s : the planned departure of the other object after that of the track
    lasts_s : how long both take; 0: an area
    """

    planned_s: float
    lasts_s: tuple[float, float]
    parts: list[ContactSetPart]

    def outer(self, i: Floats, k: Floats) -> tuple[Floats, Floats]:
        """Return bounds (parts, ...) of the differences of delays in contact, for factors of time (...) of both."""
        low, high = (
            np.stack([np.interp(i / k, part.ratios, getattr(part, name)) for part in self.parts])
            for name in ("low", "high")
        )
        return self.planned_s + k * low - _OUTSIDE_S, self.planned_s + k * high + _OUTSIDE_S

    def inner(self, i: Floats, k: Floats) -> tuple[Floats, Floats]:
        """Return intervals (parts, n, m) of differences of delays that are contact, linear in both factors (n, m).

        Empty intervals are [inf, -inf]. i, k : at the corners of n cells
        """
        low, high = np.full((2, len(self.parts), *i.shape), np.inf)
        high = -high
        ratio = i.mean(axis=1) / k.mean(axis=1)
        for n, part in enumerate(self.parts):
            after = np.clip(np.searchsorted(part.ratios, ratio), 1, max(len(part.ratios) - 1, 1))
            for at in (after - 1, np.minimum(after, len(part.ratios) - 1)):
                inside = _INSIDE_S + part.doubt_s * np.maximum(i, k)
                (first_u, first_v), (last_u, last_v) = part.first[at].T[..., None], part.last[at].T[..., None]
                own = (
                    self.planned_s + k * first_v - i * first_u + inside,
                    self.planned_s + k * last_v - i * last_u - inside,
                )
                # The computed ratio with the longer interval; NaN is none.
                better = (own[1] - own[0]).mean(axis=1) > (high[n] - low[n]).mean(axis=1)
                better &= (own[0] <= own[1]).all(axis=1)
                low[n][better], high[n][better] = own[0][better], own[1][better]
        return low, high


def meetings_of(
    setup: Setup, placed: AnyTime, paces: Mapping[int, Pace], threads: int = 1
) -> dict[tuple[int, int], Meeting]:
    """Return what tracks may meet, by the numbers of a track and of an area or a track of a larger number.

    setup : which the pieces were made with
    paces : of all tracks, by number
    """
    found: dict[tuple[int, int], list[ContactSetPart]] = {}
    for own, part in placed.parts(setup.scene):
        for pair, contacts in _contacts(setup.under(own), part, paces, threads):
            found.setdefault(pair, []).append(contacts)
    meetings = {}
    for (a, b), parts in found.items():
        planned_s = (paces[b].departs_us - paces[a].departs_us) / 1e6 if b in paces else 0.0
        meetings[a, b] = Meeting(planned_s, (paces[a].lasts_s, paces[b].lasts_s if b in paces else 0.0), parts)
    return meetings


def _contacts(
    setup: Setup, placed: AnyTime, paces: Mapping[int, Pace], threads: int
) -> list[tuple[tuple[int, int], ContactSetPart]]:
    pieces, number = placed.pieces, placed.number
    tracks = np.flatnonzero(pieces.kind == Kind.TRACK.code)
    own = [paces[one] for one in number[tracks].tolist()]
    departs_us, times = np.zeros(len(pieces), np.int64), np.ones((len(pieces), 2))
    departs_us[tracks] = [one.departs_us for one in own]
    times[tracks] = np.array([one.times for one in own]).reshape(-1, 2)
    late_us = 1e6 * np.array([one.late_s for one in own]).reshape(-1, 2)
    start_us, end_us = placed.start_us.copy(), placed.end_us.copy()
    since_us = start_us[tracks] - departs_us[tracks], end_us[tracks] - departs_us[tracks]
    start_us[tracks] = (
        departs_us[tracks] + np.floor(late_us[:, 0] + times[tracks, 0] * since_us[0]).astype(np.int64) - 1
    )
    end_us[tracks] = departs_us[tracks] + np.ceil(late_us[:, 1] + times[tracks, 1] * since_us[1]).astype(np.int64) + 1
    a, b = replace(placed, start_us=start_us, end_us=end_us).pairs_within(tracks, 0, is_once=True)
    still, covered = pieces.kind[b] == Kind.AREA.code, is_covered(pieces, a, b)
    zero_us = departs_us[a], np.where(still, departs_us[a], departs_us[b])
    times_s = [
        (np.clip(ends[members], -FOREVER_US, FOREVER_US) - zero) / 1e6
        for members, zero in ((a, zero_us[0]), (b, zero_us[1]))
        for ends in (pieces.start_us, pieces.end_us)
    ]
    ratios = times[a] / times[b][:, ::-1]
    every = np.full(len(a), np.inf)
    b_times_s = [np.where(still, 0.0, end_s) for end_s in times_s[2:]]
    shifts = Shifts(a, b, *zero_us, times_s[0], times_s[1], b_times_s[0], b_times_s[1], -every, every)
    prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces, a, b)
    reach_m = setup.scene.separation_m + setup.scene.tolerance_m
    made: list[tuple[tuple[int, int], ContactSetPart]] = []

    def pair_of(row: int) -> tuple[int, int]:
        return int(number[a[row]]), int(number[b[row]])

    # Two that move.
    rows = np.flatnonzero(~covered & ~still)
    left, own_shifts, doubt_s = with_heights(pieces, shifts.take(rows))
    row, own_shifts, found = solved_shifts(prepared, own_shifts, reach_m, threads)
    nodes = _Nodes(prepared, own_shifts, reach_m, threads, ratios[rows[left]][row])
    nodes.add_all(found)
    made += [
        (pair_of(one), nodes.contacts(n, doubt))
        for n, (one, doubt) in enumerate(zip(rows[left][row].tolist(), doubt_s[row].tolist(), strict=True))
        if n not in nodes.apart
    ]
    # A still object is met at some seconds of a, whenever it exists.
    rows = np.flatnonzero(~covered & still)
    left, own_shifts, doubt_s = with_heights(pieces, shifts.take(rows))
    row, _, found = solved_shifts(prepared, own_shifts, reach_m, threads)
    for one, doubt, each in zip(rows[left][row].tolist(), doubt_s[row].tolist(), found, strict=True):
        outer_s = -float(each["outer_high"]), -float(each["outer_low"])
        inner_s = -float(each["inner_high"]), -float(each["inner_low"])
        there_s = float(times_s[2][one]), float(times_s[3][one])
        made.append((pair_of(one), _of_times(ratios[one], outer_s, inner_s, there_s, doubt)))
    # Only the times of covers are known.
    for one in np.flatnonzero(covered).tolist():
        u, v = ((float(times_s[k][one]), float(times_s[k + 1][one])) for k in (0, 2))
        made.append((pair_of(one), _of_times(ratios[one], u, (np.inf, -np.inf), v, 0.0)))
    return made


def _of_times(
    ratios: Floats, u: tuple[float, float], u_inner: tuple[float, float], v: tuple[float, float], doubt_s: float
) -> ContactSetPart:
    """Return the contacts of a during seconds u, surely during u_inner, with an object that exists during v."""
    nodes = np.unique(ratios)
    first, last = (u_inner[1], v[0]), (u_inner[0], v[1])
    if not (u_inner[0] <= u_inner[1] and np.isfinite(doubt_s)):
        first = last = (np.nan, np.nan)
    count = (len(nodes), 1)
    return ContactSetPart(
        nodes, v[0] - nodes * u[1], v[1] - nodes * u[0], np.tile(first, count), np.tile(last, count), doubt_s
    )


class _Nodes:
    """The ratios computed for n pairs of pieces, and what the kernel returned.

    ratios : (n, 2) the least and the largest ratio of each
    apart : numbers of pairs that no ratio brings into contact
    """

    def __init__(
        self, prepared: kernel.KernelScene, shifts: Shifts, reach_m: float, threads: int, ratios: Floats
    ) -> None:
        self._solve, self._shifts, self._limits = (prepared, reach_m, threads), shifts, ratios
        self._most = min(max(_MOST_IN_ALL // max(len(shifts), 1), _LEAST_RATIOS), _MOST_RATIOS)
        self._of: list[list[tuple[float, Any]]] = [[] for _ in range(len(shifts))]
        self.apart: set[int] = set()

    def add_all(self, planned: NDArray[Any]) -> None:
        """Compute ratios, until bounds from both sides are near each other; planned: the answers at ratio 1."""
        every = np.arange(len(self._shifts))
        is_one = (self._limits == 1.0).all(axis=1)
        for row, one in enumerate(planned):
            self._of[row].append((1.0, one))
        some = every[~is_one]
        for side in (0, 1):
            far = some[self._limits[some, side] != 1.0]
            self._add(far, self._limits[far, side])
        for _ in range(_MOST_ROUNDS):
            asked = [(row, ratio) for row in some.tolist() for ratio in self._missing(row)]
            some = np.unique(np.array([row for row, _ in asked], np.int64))
            if not asked:
                break
            self._add(np.array([row for row, _ in asked]), np.array([ratio for _, ratio in asked]))

    def contacts(self, row: int, doubt_s: float) -> ContactSetPart:
        """Return what is known about a pair."""
        ratios, found = zip(*self._of[row], strict=True)
        every = np.array(found)
        ends = [np.column_stack([every[f"{end}_a_s"], every[f"{end}_b_s"]]) for end in ("low", "high")]
        for one in ends:
            one[every["state"] != DifferenceState.INNER] = np.nan
        return ContactSetPart(np.array(ratios), every["outer_low"], every["outer_high"], ends[0], ends[1], doubt_s)

    def _add(self, rows: _Ints, ratios: Floats) -> None:
        if not rows.size:
            return
        prepared, reach_m, threads = self._solve
        asked = replace(self._shifts.take(rows), weight=ratios)
        found = differences(prepared, asked, reach_m, kernel.Work(), threads)
        for row, ratio, one in zip(rows.tolist(), ratios.tolist(), found, strict=True):
            # A contact set that is empty is so at any ratio.
            if one["state"] == DifferenceState.NONE:
                self.apart.add(row)
            self._of[row].append((ratio, one))
            self._of[row].sort(key=lambda node: node[0])

    def _missing(self, row: int) -> list[float]:
        """Return the ratios to compute next."""
        nodes = self._of[row]
        missing: list[float] = []
        if row in self.apart or len(nodes) >= self._most:
            return missing
        for (r, one), (s, other) in pairwise(nodes):
            if not (one["state"] == other["state"] == DifferenceState.INNER):
                continue
            worst, at = 0.0, None
            for end, sign in (("low", -1.0), ("high", 1.0)):
                # No ratio helps where the kernel's own bounds are apart.
                open_s = max(sign * (each[f"outer_{end}"] - each[f"inner_{end}"]) for each in (one, other))
                lines = [(each[f"{end}_b_s"], each[f"{end}_a_s"]) for each in (one, other)]
                (v, u), (w, t) = lines
                middle = (w - v) / (t - u) if t != u else 0.5 * (r + s)
                middle = min(max(middle, r + _NEAREST * (s - r)), s - _NEAREST * (s - r))
                share = (middle - r) / (s - r)
                chord = one[f"outer_{end}"] + share * (other[f"outer_{end}"] - one[f"outer_{end}"])
                known = max(sign * (v - middle * u), sign * (w - middle * t))
                gap_s = sign * chord - known - 2.0 * open_s - _GAP_S
                if gap_s > worst:
                    worst, at = gap_s, middle
            if at is not None and r < at < s:
                missing.append(float(at))
        return missing
