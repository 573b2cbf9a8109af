"""Add the closest approach to conflicts, and near pairs without conflict."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.core.climbs import overlap_at_one_time
from conflictdb.core.conflict_regions import Meetings
from conflictdb.core.object_pairs import members, numbered, object_keys, ordered_members
from conflictdb.core.pieces.covers import is_covered
from conflictdb.core.stage4.closest_approach import approaches
from conflictdb.core.stage4.constants import TOUCH_M
from conflictdb.core.stage4.contact_search import contacts
from conflictdb.kernel.meeting import meetings as meeting_places
from conflictdb.model.methods import Method
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind, Verdict


@dataclass(frozen=True, slots=True)
class _Queries:
    """Queries for the closest approach of pairs of pieces (n,).

    first_s, last_s : (n,) times, seconds after the start of the shared span
    group : (n,) the pair of objects of each, not decreasing
    """

    a: PieceRows
    b: PieceRows
    first_s: Floats
    last_s: Floats
    group: NDArray[np.int64]

    def take(self, rows: NDArray[np.int64]) -> "_Queries":
        times = self.first_s[rows], self.last_s[rows]
        return _Queries(PieceRows(self.a[rows]), PieceRows(self.b[rows]), *times, self.group[rows])

    def concatenated(self, more: "_Queries", groups: int) -> "_Queries":
        """Return both; the groups of `more` are numbered from `groups` on."""
        ours = self.a, self.b, self.first_s, self.last_s, self.group
        theirs = more.a, more.b, more.first_s, more.last_s, more.group + groups
        a, b, *times, group = (np.concatenate(both) for both in zip(ours, theirs, strict=True))
        return _Queries(PieceRows(a), PieceRows(b), times[0], times[1], group)


def with_closest_approaches(
    scene: Scene,
    prepared: kernel.KernelScene,
    pairs: Pairs,
    meetings: Meetings,
    conflicts: Conflicts,
    work: kernel.Work,
    threads: int = 1,
) -> Conflicts:
    """Return the conflicts with their closest approach, and the near pairs without conflict.

    prepared : the pieces of the pairs
    meetings : the contacts of the conflicts
    conflicts : the merged contacts
    work : counts the work
    threads : of the kernel
    """
    # With a separation in time conflicts may be of different times, and are close at none.
    is_late = scene.time_separation_s > 0.0
    is_open = (conflicts.verdict == Verdict.UNRESOLVED.code) | is_late
    is_known = conflicts.closest_m == 0.0
    decided = np.flatnonzero(~is_known & ~is_open)
    if scene.separation_m > 0.0:
        conflicts, decided = _with_touches(prepared, meetings, conflicts, decided, work, threads)
    is_asked = scene.nearest_m > 0.0 or (is_open & ~is_known).any()
    if not decided.size and not is_asked:
        return conflicts
    asked, rows, more = _during_contacts(meetings, decided), decided, 0
    if is_asked:
        others, undecided, more = _at_all_times(scene, prepared.pieces, pairs, conflicts, is_open & ~is_known)
        asked, rows = asked.concatenated(others, len(decided)), np.concatenate([decided, undecided])
    groups = len(rows) + more
    if not groups:
        return conflicts
    wanted, aim, elsewhere = np.full(groups, np.inf), np.zeros(groups), np.full(groups, np.inf)
    wanted[len(rows) :] = scene.nearest_m
    if is_late:
        wanted[: len(rows)] = scene.reach_m  # further away not all pieces are candidates
    # A distance within the tolerance needs no smaller error than that.
    aim[: len(decided)][conflicts.verdict[decided] == Verdict.GRAZING.code] = scene.tolerance_m
    times = asked.first_s, asked.last_s
    nearest = approaches(prepared, asked.a, asked.b, *times, asked.group, wanted, aim, work, threads)
    # Decided pairs are no nearer than this at all other times.
    elsewhere[: len(decided)] = scene.separation_m + np.where(meetings.meet[decided], 0.0, scene.tolerance_m)
    found_m = np.where(np.isinf(nearest.distance_m), 0.0, nearest.distance_m)
    _, _, swapped = ordered_members(prepared.pieces, PieceRows(asked.a[nearest.pair]), PieceRows(asked.b[nearest.pair]))
    found = {
        "closest_us": nearest.at_us,
        "closest_m": nearest.distance_m,
        "closest_error_m": np.maximum(nearest.error_m, found_m - elsewhere + TOUCH_M),
        "closest_a_deg": np.where(swapped[:, None], nearest.b_deg, nearest.a_deg),
        "closest_b_deg": np.where(swapped[:, None], nearest.a_deg, nearest.b_deg),
    }
    columns: dict[str, Any] = {name: getattr(conflicts, name).copy() for name in found}
    near = np.arange(len(rows)) if not is_late else np.flatnonzero(np.isfinite(nearest.distance_m[: len(rows)]))
    for name, column in columns.items():
        column[rows[near]] = found[name][near]
    complete = replace(conflicts, **columns)
    # Infinite: further apart than the limit.
    near = len(rows) + np.flatnonzero(~np.isinf(nearest.distance_m[len(rows) :]))
    if not near.size:
        return complete
    only_near = _without_contact(prepared.pieces, asked, near, np.isnan(nearest.distance_m[near]))
    columns = {name: column[near] for name, column in found.items()}
    return Conflicts.concatenate([complete, replace(only_near, **columns)])


def _with_touches(
    prepared: kernel.KernelScene,
    meetings: Meetings,
    conflicts: Conflicts,
    rows: NDArray[np.int64],
    work: kernel.Work,
    threads: int,
) -> tuple[Conflicts, NDArray[np.int64]]:
    """Return the conflicts with the closest approach of pairs that touch, and the other rows of `rows` (k,)."""
    scene = replace(meetings.setup.scene, method=Method.EXACT, separation_m=0.0, tolerance_m=0.0)
    asked = _during_contacts(meetings, rows)
    pieces = prepared.pieces
    moves = (pieces.kind[asked.a] == Kind.TRACK.code) | (pieces.kind[asked.b] == Kind.TRACK.code)
    asked = asked.take(np.flatnonzero(moves & ~is_covered(pieces, asked.a, asked.b)))
    if not len(asked.a):
        return conflicts, rows
    nowhere = np.empty((0, 2)), np.zeros(len(asked.a) + 1, np.int64)
    pairs = Pairs(asked.a, asked.b, *nowhere)
    found, effort = contacts(meetings.setup.under(scene), prepared, pairs, asked.first_s, asked.last_s, threads=threads)
    work.windows += effort.exact.windows
    work.evaluations += effort.exact.evaluations
    start_us, _ = pieces.shared_span(PieceRows(asked.a[found.pair]), PieceRows(asked.b[found.pair]))
    at_us = start_us + np.floor(1e6 * found.start_s).astype(np.int64)
    # The first of each pair of objects; what may be earlier and is not certain leaves the pair to the other search.
    order = np.lexsort((at_us, asked.group[found.pair]))
    first = order[np.flatnonzero(np.diff(asked.group[found.pair[order]], prepend=-1))]
    is_certain = found.touches & (found.verdict == Verdict.CONFLICT.code)
    is_certain &= found.error_s < found.end_s - found.start_s
    first = first[is_certain[first]]
    one, other = PieceRows(asked.a[found.pair[first]]), PieceRows(asked.b[found.pair[first]])
    touched = rows[asked.group[found.pair[first]]]
    place = meeting_places(prepared, one, other, start_us[first], found.start_s[first], threads)
    columns: dict[str, Any] = {
        "closest_us": at_us[first],
        "closest_m": 0.0,
        "closest_error_m": 0.0,
        "closest_a_deg": place,
        "closest_b_deg": place,
    }
    for name, values in columns.items():
        columns[name] = getattr(conflicts, name).copy()
        columns[name][touched] = values
    return replace(conflicts, **columns), np.setdiff1d(rows, touched)


def _during_contacts(meetings: Meetings, rows: NDArray[np.int64]) -> _Queries:
    """Return queries for pairs of objects (k,) during their contacts."""
    offset, contacts = ragged_rows(meetings.offset, rows)
    a, b = PieceRows(meetings.a[contacts]), PieceRows(meetings.b[contacts])
    group = np.repeat(np.arange(len(rows)), np.diff(offset))
    return _Queries(a, b, meetings.start_s[contacts], meetings.end_s[contacts], group)


def _at_all_times(
    scene: Scene, pieces: Pieces, pairs: Pairs, conflicts: Conflicts, is_asked: NDArray[np.bool_]
) -> tuple[_Queries, NDArray[np.int64], int]:
    """Return queries for some conflicts (n,) at all times, and for pairs without conflict if near pairs are reported.

    Also return the rows of these conflicts, which come first, and the number of the other pairs.
    """
    a, b, _ = ordered_members(pieces, pairs.a, pairs.b)
    seen = np.flatnonzero(~is_covered(pieces, a, b))
    known = np.stack([conflicts.a_kind, conflicts.a_id, conflicts.b_kind, conflicts.b_id])
    keys = object_keys(pieces, PieceRows(a[seen]), PieceRows(b[seen]))
    number, n = numbered(np.concatenate([known, keys], axis=1))
    # The conflicts in their order, then the others in that of their keys.
    place = len(conflicts) + np.arange(n)
    place[number[: len(conflicts)]] = np.arange(len(conflicts))
    place = place[number[len(conflicts) :]]
    wanted = np.append(is_asked, scene.nearest_m > 0.0)[np.minimum(place, len(conflicts))]
    asked, group = np.unique(place[wanted], return_inverse=True)
    order = np.argsort(group, kind="stable")
    rows, of_conflicts = seen[wanted][order], asked[asked < len(conflicts)]
    # The members in the order of their keys, as everywhere.
    members = PieceRows(pairs.a[rows]), PieceRows(pairs.b[rows])
    first, last, _ = overlap_at_one_time(pieces, *members)
    return _Queries(*members, np.maximum(first, 0.0), last, group[order]), of_conflicts, len(asked) - len(of_conflicts)


def _without_contact(
    pieces: Pieces, asked: _Queries, groups: NDArray[np.int64], is_lost: NDArray[np.bool_]
) -> Conflicts:
    """Return pairs of objects (k,) that come near each other without conflict, still without approaches.

    is_lost : (k,) whether the approach is unknown; these pairs are unresolved for all of their shared time
    """
    start, end = pieces.shared_span(asked.a, asked.b)
    first = np.searchsorted(asked.group, groups)
    begins = np.flatnonzero(np.diff(asked.group, prepend=-1))
    period_us = np.stack([np.minimum.reduceat(start, begins), np.maximum.reduceat(end, begins)], axis=1)
    a, b, _ = ordered_members(pieces, PieceRows(asked.a[first]), PieceRows(asked.b[first]))
    verdict = np.where(is_lost, Verdict.UNRESOLVED.code, Verdict.NEAR.code).astype(np.int8)
    periods = period_us[groups][is_lost], np.concatenate([np.zeros(1, np.int64), np.cumsum(is_lost)])
    return Conflicts.of_members(members(pieces, a), members(pieces, b), periods, verdict)
