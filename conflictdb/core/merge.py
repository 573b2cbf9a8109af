"""Merge contacts of pieces into one row per pair of objects: its verdict, its periods and their error bound.

The kernel bounds the errors of contacts (kernel/narrow/search.c, certain.c); `_period_errors` those of periods. An
overlap that is shallow in each part of an area, but deep in the whole, becomes a conflict here.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Conflicts, Contacts
from conflictdb.arrays.distinct import distinct
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.core.conflict_regions import Meetings
from conflictdb.core.object_pairs import members, numbered, object_keys, ordered_members
from conflictdb.core.pieces.covers import is_covered
from conflictdb.core.whole_areas import Footprints, deep_in_whole_areas
from conflictdb.earth.registry import Setup
from conflictdb.kernel.meeting import meetings
from conflictdb.kernel.whole import Depth
from conflictdb.model.methods import METHODS
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Scene
from conflictdb.model.results import Kind, Verdict


def merged_by_object(
    setup: Setup,
    prepared: kernel.KernelScene,
    pairs: Pairs,
    contacts: Contacts,
    footprints: Footprints,
    threads: int = 1,
    first_deg: Floats | None = None,
) -> tuple[Conflicts, Meetings]:
    """Return one row per pair of objects with a contact, and their places.

    Only pairs that meet have a closest approach yet.

    prepared : the pieces of the pairs
    footprints : called for whole areas if contacts are shallow in all parts of one
    threads : of the kernel; the answer does not depend on it
    first_deg : (m, 2) longitude and latitude of where contacts begin; None: they are computed
    """
    pieces = prepared.pieces
    a, b = PieceRows(pairs.a[contacts.pair]), PieceRows(pairs.b[contacts.pair])
    contacts, start, end = _ordered_times(contacts, *pieces.shared_span(a, b))
    a, b, _ = ordered_members(pieces, a, b)
    group_of, n = numbered(object_keys(pieces, a, b))
    # The periods of objects that meet exclude times at which other pieces of theirs only come close.
    meet = np.zeros(n, np.bool_)
    meet[group_of[contacts.touches]] = True
    reported = np.flatnonzero(contacts.touches | ~meet[group_of] | (contacts.verdict == Verdict.UNRESOLVED.code))
    order = reported[np.lexsort((end[reported], start[reported], group_of[reported]))]
    group = group_of[order]
    bounds = np.searchsorted(group, np.arange(n + 1))
    earliest = order[bounds[:-1]]
    period_us, period_offset, time_error_s = _periods(group, start[order], end[order], contacts.error_s[order], n)

    has_conflict, has_open = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    has_conflict[group[contacts.verdict[order] == Verdict.CONFLICT.code]] = True
    has_open[group[contacts.verdict[order] == Verdict.UNRESOLVED.code]] = True
    may_be_shallow = ~has_conflict & ~has_open & meet
    if may_be_shallow.any():
        may_be_shallow &= _has_parts(pieces, a, b, group_of, n)
    shallow = np.flatnonzero(may_be_shallow)
    of_shallow, rows = ragged_rows(bounds, shallow)
    owner, rows = np.repeat(shallow, np.diff(of_shallow)), order[rows]
    owner, rows = owner[contacts.touches[rows]], rows[contacts.touches[rows]]
    for mine, depth in isolated(
        np.arange(len(rows)),
        lambda mine: deep_in_whole_areas(setup, prepared, pairs, contacts.take(rows[mine]), footprints),
        lambda mine: np.full(len(mine), Depth.UNKNOWN, np.int8),
        "contact",
    ):
        has_conflict[owner[mine[depth == Depth.DEEP]]] = True
        has_open[owner[mine[depth == Depth.UNKNOWN]]] = True

    verdict = np.full(n, Verdict.GRAZING.code, np.int8)
    verdict[has_open] = Verdict.UNRESOLVED.code
    verdict[has_conflict] = Verdict.CONFLICT.code
    if first_deg is None:
        first_contact_deg = _first_contacts(setup.scene, prepared, pairs, contacts, earliest, threads)
    else:
        first_contact_deg = first_deg[earliest]
    # Objects that certainly meet are closest at their first contact.
    doubtful = contacts.touches & ~(contacts.error_s < contacts.end_s - contacts.start_s)
    is_certain = meet & ~has_open
    is_certain[group_of[doubtful]] = False
    is_known = (
        (has_conflict | is_certain)
        & (setup.scene.separation_m == 0.0)
        & (METHODS[setup.scene.method].solver is not None)
    )
    is_known &= setup.scene.time_separation_s == 0.0  # else they may meet at different times only
    nothing = np.where(is_known, 0.0, np.nan)
    place = np.where(is_known[:, None], first_contact_deg, np.nan)
    conflicts = Conflicts.of_members(
        members(pieces, PieceRows(a[earliest])),
        members(pieces, PieceRows(b[earliest])),
        (period_us, period_offset),
        verdict,
        first_contact_deg=first_contact_deg,
        time_error_s=time_error_s,
        closest_us=np.where(is_known, period_us[period_offset[:-1], 0], MINUS_INFINITY_US),
        closest_m=nothing,
        closest_error_m=nothing,
        closest_a_deg=place,
        closest_b_deg=place,
    )
    # In the order of the pair, which is that of keys, not of numbers.
    one, other = (PieceRows(member[contacts.pair[order]]) for member in (pairs.a, pairs.b))
    times = contacts.start_s[order], contacts.end_s[order]
    return conflicts, Meetings(setup, prepared, one, other, *times, bounds, meet, first_contact_deg, threads)


def _has_parts(pieces: Pieces, a: PieceRows, b: PieceRows, group: NDArray[np.int64], n: int) -> NDArray[np.bool_]:
    """Return (n,) whether contacts of a group are with several parts of one area.

    An overlap that is deeper in an area than in each part comes within the tolerance of two parts: both have a contact.

    a, b : (m,) the pieces of each contact
    group : (m,) its pair of objects
    """
    several = np.zeros(n, np.bool_)
    for member in (a, b):
        contact = np.flatnonzero(pieces.kind[member] == Kind.AREA.code)
        parts = np.unique(group[contact] * len(pieces) + member[contact])
        several |= np.bincount(parts // max(len(pieces), 1), minlength=n) > 1
    return several


def _first_contacts(
    scene: Scene,
    prepared: kernel.KernelScene,
    pairs: Pairs,
    contacts: Contacts,
    earliest: NDArray[np.int64],
    threads: int,
) -> Floats:
    """Return (n, 2) longitude and latitude of where contacts begin; NaN if the method does not compute it."""
    points = np.full((len(earliest), 2), np.nan)
    if METHODS[scene.method].solver is not None:
        pair = contacts.pair[earliest]
        a, b, at = PieceRows(pairs.a[pair]), PieceRows(pairs.b[pair]), contacts.start_s[earliest]
        start_us, _ = prepared.pieces.shared_span(a, b)
        at = np.where(np.isfinite(at), at, 0.0)
        seen = np.flatnonzero(~is_covered(prepared.pieces, a, b))
        points[seen] = meetings(prepared, a[seen], b[seen], start_us[seen], at[seen], threads)
    return points


def _periods(
    group: NDArray[np.int64], start: NDArray[np.int64], end: NDArray[np.int64], error: Floats, n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return the periods of n groups: period_us (p, 2), period_offset (n + 1,), and their time_error_s (n,).

    group, start, end, error : (m,) the contacts, sorted by group, start and end
    """
    # The latest end so far within each group: ranks let one running maximum serve all groups.
    values, rank = distinct(end)
    reached = values[np.maximum.accumulate(group * len(values) + rank) - group * len(values)] if len(end) else end
    opens = np.ones(len(group), np.bool_)
    opens[1:] = (group[1:] != group[:-1]) | (start[1:] > reached[:-1])
    period = np.cumsum(opens) - 1
    period_start = start[opens]
    period_end = reached[np.append(np.flatnonzero(opens)[1:], len(opens)) - 1] if len(opens) else end
    period_error = _period_errors(period, start, end, error, period_start, period_end)
    owner = group[opens]
    time_error_s = np.zeros(n)
    np.maximum.at(time_error_s, owner, period_error)
    period_offset = np.searchsorted(owner, np.arange(n + 1)).astype(np.int64)
    return np.stack([period_start, period_end], axis=1), period_offset, time_error_s


def _period_errors(
    period: NDArray[np.int64],
    start: NDArray[np.int64],
    end: NDArray[np.int64],
    error: Floats,
    period_start: NDArray[np.int64],
    period_end: NDArray[np.int64],
) -> Floats:
    """Return (p,) the error bounds of periods: how much longer than the contact they may be at either end, seconds.

    Contact is certain from the first to the last certain instant of the contacts (m,) merged into a period. An
    uncertain contact leaves the end to its neighbours.

    period : (m,) the number of each contact's period, sorted
    """
    since_ever, for_ever = period_start == MINUS_INFINITY_US, period_end == INFINITY_US
    length = np.where(since_ever | for_ever, np.inf, (period_end - period_start) / 1e6)
    # Finite instants are infinitely far from an end at infinity.
    lead = np.where(since_ever[period], np.inf, (start - period_start[period]) / 1e6)
    tail = np.where(for_ever[period], np.inf, (period_end[period] - end) / 1e6)
    lead[start == period_start[period]] = 0.0
    tail[end == period_end[period]] = 0.0
    count = np.bincount(period, minlength=len(period_start))
    whole = np.where((start == MINUS_INFINITY_US) | (end == INFINITY_US), np.inf, (end - start) / 1e6)
    # The error of a contact that is its whole period is known, even if the contact is uncertain.
    sure = (whole > 2.0 * error) | (count[period] == 1)
    worst = [np.full(len(period_start), np.inf) for _ in (lead, tail)]
    for least, way in zip(worst, (lead, tail), strict=True):
        np.minimum.at(least, period[sure], (way + error)[sure])
    return np.asarray(np.minimum(np.maximum(*worst), length))


def _ordered_times(
    contacts: Contacts, shared_start: NDArray[np.int64], shared_end: NDArray[np.int64]
) -> tuple[Contacts, NDArray[np.int64], NDArray[np.int64]]:
    """Return contacts and their ends as instants; a contact that ends before it starts is unresolved.

    It then has the whole shared time, so that one pair that went wrong does not take away the answers of the others.
    NaN is in no order.
    """
    is_ordered = (contacts.start_s <= contacts.end_s) & (contacts.error_s >= 0.0) & (shared_start <= shared_end)
    if is_ordered.all():
        start, end = instants(contacts, shared_start, shared_end)
        is_ordered = start <= end
        if is_ordered.all():
            return contacts, start, end
    low, high = np.minimum(shared_start, shared_end), np.maximum(shared_start, shared_end)
    is_endless = (low == MINUS_INFINITY_US) | (high == INFINITY_US)
    length_s = np.where(is_endless, 0.0, (np.where(is_endless, 0, high) - np.where(is_endless, 0, low)) / 1e6)
    verdict = np.where(is_ordered, contacts.verdict, Verdict.UNRESOLVED.code).astype(np.int8)
    contacts = replace(
        contacts,
        start_s=np.where(is_ordered, contacts.start_s, 0.0),
        end_s=np.where(is_ordered, contacts.end_s, np.inf),
        error_s=np.where(is_ordered, contacts.error_s, length_s),
        verdict=verdict,
        touches=contacts.touches | ~is_ordered,
    )
    return _ordered_times(contacts, low, high)


def instants(
    contacts: Contacts, shared_start: NDArray[np.int64], shared_end: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the contacts' ends as instants, rounded outward to the microsecond within the shared span."""
    whole = (contacts.start_s <= 0.0) & np.isinf(contacts.end_s)
    first, last = contacts.start_s, np.where(whole, 0.0, contacts.end_s)
    # Seconds of centuries do not resolve microseconds: round outward by their spacing, but stay within the span.
    offset = np.floor((first - 2.0 * np.spacing(np.abs(first))) * 1e6).astype(np.int64)
    start = np.where(whole | (first <= 0.0), shared_start, shared_start + offset)
    until = np.ceil((last + 2.0 * np.spacing(last)) * 1e6).astype(np.int64)
    span = np.where(whole, 0, shared_end - shared_start)
    end = np.where(
        whole | (last >= span / 1e6), shared_end, np.minimum(np.where(whole, 0, shared_start) + until, shared_end)
    )
    return np.maximum(start, shared_start), end
