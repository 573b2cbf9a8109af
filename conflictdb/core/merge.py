"""Merge contacts of pieces into one row per pair of objects: its verdict, its periods and their error bound.

The kernel bounds the errors of contacts (kernel/narrow/search.c, certain.c) and of periods (merge.c). An overlap that
is shallow in each part of an area, but deep in the whole, becomes a conflict here.
"""

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Conflicts, Contacts
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.core.conflict_regions import Meetings
from conflictdb.core.object_pairs import members, numbered, object_keys, ordered_members
from conflictdb.core.pieces.covers import is_covered
from conflictdb.core.whole_areas import Footprints, deep_in_whole_areas
from conflictdb.earth.registry import Setup
from conflictdb.kernel import merging
from conflictdb.kernel.meeting import meetings
from conflictdb.kernel.whole import Depth
from conflictdb.model.methods import METHODS
from conflictdb.model.plans import MINUS_INFINITY_US, Scene
from conflictdb.model.results import Kind, Verdict


def merged(
    setup: Setup,
    prepared: kernel.KernelScene,
    pairs: Pairs,
    contacts: Contacts,
    footprints: Footprints,
    threads: int = 1,
    first_deg: Floats | None = None,
    lacking_s: tuple[Floats, Floats] | None = None,
) -> tuple[Conflicts, Meetings]:
    """Return one row per pair of objects with a contact, and their places.

    Only pairs that meet have a closest approach yet.

    prepared : the pieces of the pairs
    footprints : called for whole areas if contacts are shallow in all parts of one
    threads : of the kernel
    first_deg : (m, 2) longitude and latitude of where contacts begin; None: they are computed
    lacking_s : seconds (m,) of the separation in time that are lacking, and their errors; None: none is required
    """
    pieces = prepared.pieces
    a, b = PieceRows(pairs.a[contacts.pair]), PieceRows(pairs.b[contacts.pair])
    shared_us = pieces.shared_span(a, b)
    a, b, _ = ordered_members(pieces, a, b)
    group_of, n = numbered(object_keys(pieces, a, b))
    found = merging.merged(contacts, group_of, n, shared_us, lacking_s)
    contacts, order, bounds, meet = found.contacts, found.order, found.order_offset, found.meets
    earliest = order[bounds[:-1]]
    has_conflict, has_open = found.verdict == Verdict.CONFLICT.code, found.is_open.copy()
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
    is_lacking = ~np.isnan(found.lacking_s) & (verdict != Verdict.UNRESOLVED.code)
    time_error_s = np.maximum(found.time_error_s, np.where(is_lacking, found.lacking_error_s, 0.0))
    nothing = np.where(is_known, 0.0, np.nan)
    place = np.where(is_known[:, None], first_contact_deg, np.nan)
    conflicts = Conflicts.of_members(
        members(pieces, PieceRows(a[earliest])),
        members(pieces, PieceRows(b[earliest])),
        (found.period_us, found.period_offset),
        verdict,
        first_contact_deg=first_contact_deg,
        time_error_s=time_error_s,
        lacking_s=np.where(is_lacking, found.lacking_s, np.nan),
        closest_us=np.where(is_known, found.period_us[found.period_offset[:-1], 0], MINUS_INFINITY_US),
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
