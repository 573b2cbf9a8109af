"""The closest approach of pairs of objects that come near each other, added to their conflicts."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.answers import Conflicts, Contacts
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows
from conflictdb.earth.geodesy import Floats
from conflictdb.model import FOR_EVER_US, SINCE_EVER_US, Scene
from conflictdb.pieces.covers import is_covered
from conflictdb.pipeline.object_pairs import numbered, object_keys, ordered_members
from conflictdb.results import Verdict
from conflictdb.stage4.closest_approach import approaches
from conflictdb.stage4.constants import APPROACH_SHARE, TOUCH_M


def with_closest_approaches(
    scene: Scene,
    prepared: kernel.Scene,
    pairs: Pairs,
    contacts: Contacts,
    conflicts: Conflicts,
    work: kernel.Work,
    threads: int = 1,
) -> Conflicts:
    """Return the conflicts with their closest approach, and the pairs that come near without conflict.

    prepared : the pieces of the pairs
    contacts : all that were found of the pairs
    conflicts : what they were merged into
    work : counts what is done
    threads : of the kernel; the answer does not depend on it
    """
    pieces = prepared.pieces
    meets = conflicts.closest_m == 0.0
    if scene.nearest_m == 0.0 and meets.all():
        return conflicts
    first_s, last_s, touches = _contact_times(contacts, len(pairs))
    told, asked_of = np.arange(len(conflicts)), PairRows(np.arange(len(pairs)))
    if scene.nearest_m == 0.0:
        # At most the pairs of conflicts are asked for; where these are decided, those in contact.
        told = np.flatnonzero(~meets)
        if not (conflicts.verdict == Verdict.UNRESOLVED.code).any():
            asked_of = PairRows(np.flatnonzero(first_s <= last_s))
    a, b, swapped = ordered_members(pieces, PieceRows(pairs.a[asked_of]), PieceRows(pairs.b[asked_of]))
    likely = ~is_covered(pieces, a, b)
    if scene.nearest_m == 0.0:
        likely &= np.isin(pieces.object_id[a], conflicts.a_id[told])
        likely &= np.isin(pieces.object_id[b], conflicts.b_id[told])
    asked_of, a, b, swapped = PairRows(asked_of[likely]), PieceRows(a[likely]), PieceRows(b[likely]), swapped[likely]
    first_s, last_s, touches = first_s[asked_of], last_s[asked_of], touches[asked_of]
    known = np.stack([keys[told] for keys in (conflicts.a_kind, conflicts.a_id, conflicts.b_kind, conflicts.b_id)])
    number, n = numbered(np.concatenate([known, object_keys(pieces, a, b)], axis=1))
    known_number, number = number[: len(told)], number[len(told) :]

    wanted = np.full(n, scene.nearest_m if scene.nearest_m > 0.0 else -np.inf)
    wanted[known_number] = np.where(meets[told], -np.inf, np.inf)
    # What is decided is closest during a contact: else it is further apart than wanted, or by more than the tolerance.
    decided, aim = np.zeros(n, np.bool_), np.zeros(n)
    decided[known_number] = conflicts.verdict[told] != Verdict.UNRESOLVED.code
    aim[known_number[conflicts.verdict[told] == Verdict.GRAZING.code]] = APPROACH_SHARE * scene.tolerance_m
    during = decided[number]
    rows = PairRows(np.flatnonzero((wanted[number] >= 0.0) & (~during | (first_s <= last_s))))
    asked, group = np.unique(number[rows], return_inverse=True)
    # In the order of their keys, as everywhere.
    one, other = pairs.a[asked_of[rows]], pairs.b[asked_of[rows]]
    times = np.where(during, first_s, 0.0)[rows], np.where(during, last_s, np.inf)[rows]
    nearest = approaches(
        prepared, PieceRows(one), PieceRows(other), *times, group, wanted[asked], aim[asked], work, threads
    )
    # No nearer than this at all other times.
    elsewhere = np.where(decided[asked], scene.separation_m + scene.tolerance_m, np.inf)
    np.minimum.at(elsewhere, group, np.where(during & touches, scene.separation_m, np.inf)[rows])
    found_m = np.where(np.isinf(nearest.distance_m), 0.0, nearest.distance_m)
    error = np.maximum(nearest.error_m, found_m - elsewhere + TOUCH_M)
    of_b = swapped[rows[nearest.pair]]
    nearest_a_deg = np.where(of_b[:, None], nearest.b_deg, nearest.a_deg)
    nearest_b_deg = np.where(of_b[:, None], nearest.a_deg, nearest.b_deg)

    closest_us, closest_m = conflicts.closest_us.copy(), conflicts.closest_m.copy()
    error_m = conflicts.closest_error_m.copy()
    a_deg, b_deg = conflicts.closest_a_deg.copy(), conflicts.closest_b_deg.copy()
    place = np.full(n, -1)
    place[asked] = np.arange(len(asked))
    theirs = place[known_number]
    mine, theirs = told[theirs >= 0], theirs[theirs >= 0]
    closest_us[mine], closest_m[mine] = nearest.at_us[theirs], nearest.distance_m[theirs]
    error_m[mine] = error[theirs]
    a_deg[mine], b_deg[mine] = nearest_a_deg[theirs], nearest_b_deg[theirs]
    of_conflicts = replace(
        conflicts,
        closest_us=closest_us,
        closest_m=closest_m,
        closest_error_m=error_m,
        closest_a_deg=a_deg,
        closest_b_deg=b_deg,
    )

    is_known = np.zeros(n, np.bool_)
    is_known[known_number] = True
    # Infinite: further apart than asked. NaN: not to be found, so that they may come as near as anything.
    more = np.flatnonzero(~is_known[asked] & ~np.isinf(nearest.distance_m))
    if not more.size:
        return of_conflicts
    lost = np.isnan(nearest.distance_m[more])
    pair = PairRows(rows[np.unique(group, return_index=True)[1][more]])
    member_a, member_b = a[pair], b[pair]
    start, end = pieces.shared_span(PieceRows(a[rows]), PieceRows(b[rows]))
    first_us, last_us = np.full(len(asked), FOR_EVER_US), np.full(len(asked), SINCE_EVER_US)
    np.minimum.at(first_us, group, start)
    np.maximum.at(last_us, group, end)
    only_near = Conflicts(
        a_kind=pieces.kind[member_a],
        a_id=pieces.object_id[member_a],
        a_version=pieces.version[member_a],
        b_kind=pieces.kind[member_b],
        b_id=pieces.object_id[member_b],
        b_version=pieces.version[member_b],
        period_us=np.stack([first_us[more], last_us[more]], axis=1)[lost],
        period_offset=np.concatenate([np.zeros(1, np.int64), np.cumsum(lost)]),
        verdict=np.where(lost, Verdict.UNRESOLVED.code, Verdict.NEAR.code).astype(np.int8),
        first_contact_deg=np.full((len(more), 2), np.nan),
        time_error_s=np.zeros(len(more)),
        closest_us=nearest.at_us[more],
        closest_m=nearest.distance_m[more],
        closest_error_m=error[more],
        closest_a_deg=nearest_a_deg[more],
        closest_b_deg=nearest_b_deg[more],
    )
    return Conflicts.concatenate([of_conflicts, only_near])


def _contact_times(contacts: Contacts, n: int) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return when contacts of n pairs of pieces begin and end, seconds, (n,) each, and whether any of them touches.

    Without contacts the end is before the start.
    """
    first_s, last_s, touches = np.full(n, np.inf), np.full(n, -np.inf), np.zeros(n, np.bool_)
    np.minimum.at(first_s, contacts.pair, contacts.start_s)
    np.maximum.at(last_s, contacts.pair, contacts.end_s)
    touches[contacts.pair[contacts.touches]] = True
    return first_s, last_s, touches
