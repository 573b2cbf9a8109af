"""Stages 3 and 4 on pairs of pieces, and their merging into one row per pair of objects; arrays in, arrays out."""

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field, fields, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts, Contacts
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.methods import METHODS
from conflictdb.model import FOR_EVER_US, SINCE_EVER_US, Scene
from conflictdb.motion.contract import Plane, likeness, shapes_of
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.covers import is_covered
from conflictdb.pieces.cutting import planar
from conflictdb.pipeline.processes import computed
from conflictdb.results import Kind, Verdict
from conflictdb.stage3_projection import shared_span, windows
from conflictdb.stage4.closest_approach import Approaches, approaches
from conflictdb.stage4.constants import TOUCH_M
from conflictdb.stage4.contacts import (
    CONFLICT,
    GRAZING,
    UNRESOLVED,
    Effort,
    contacts,
    meeting_points,
    still_pairs,
)

# Told how many pairs are settled, and of how many.
Progress = Callable[[int, int], None]

# Given numbers of areas, returns their footprints (degrees).
Footprints = Callable[[NDArray[np.int64]], NDArray[np.object_]]


@dataclass(slots=True)
class Funnel:
    """How many pairs of pieces the stages left, the seconds they took, and what stage 4 did.

    projected_pairs : that stage 3 was run on
    window_pairs : with a time when they could meet, areas included
    solved_pairs : given to stage 4
    met_pairs : reported
    """

    projected_pairs: int = 0
    window_pairs: int = 0
    solved_pairs: int = 0
    met_pairs: int = 0
    stage3_s: float = 0.0
    stage4_s: float = 0.0
    effort: Effort = field(default_factory=Effort)


def settle(
    scene: Scene,
    pieces: Pieces,
    pairs: Pairs,
    footprints: Footprints,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[Conflicts, Funnel]:
    """Return what stages 3 and 4 make of pairs of pieces that passed stage 2, by the scene's method.

    footprints : asked for whole areas where contacts are shallow in all parts of one

    jobs : processes that stage 4 may use; the answer does not depend on it
    progress : told how many pairs are settled, and of how many
    """
    funnel = Funnel()
    started = time.perf_counter()
    pairs = replace(pairs, company=_company(pieces, pairs))
    covered = is_covered(pieces, pairs)
    still = (pieces.kind[pairs.a] == Kind.AREA.code) & (pieces.kind[pairs.b] == Kind.AREA.code)
    rows = np.flatnonzero(still & ~covered)
    verdict = still_pairs(scene, pieces, pairs.take(rows))
    meets = np.flatnonzero(verdict >= 0)
    found = [_whole_spans(pieces, pairs, rows[meets], verdict[meets])]
    unknown = np.flatnonzero(covered)
    found.append(_whole_spans(pieces, pairs, unknown, np.full(len(unknown), UNRESOLVED, np.int8)))
    funnel.window_pairs = len(meets) + len(unknown)

    moving = np.flatnonzero(~still & ~covered)
    if METHODS[scene.method].last_stage < 3:
        found.append(_whole_spans(pieces, pairs, moving, np.full(len(moving), UNRESOLVED, np.int8)))
    elif moving.size:
        some = pairs.take(moving)
        first, last = _windows(scene, pieces, some, funnel)
        possible = np.flatnonzero(first <= last)
        funnel.window_pairs += len(possible)
        funnel.stage3_s = time.perf_counter() - started
        started = time.perf_counter()
        if METHODS[scene.method].last_stage < 4:
            width = last[possible] - first[possible]
            verdict = np.full(len(possible), UNRESOLVED, np.int8)
            touches = np.ones(len(possible), np.bool_)
            found.append(Contacts(moving[possible], first[possible], last[possible], width, verdict, touches))
        else:
            solved, funnel.effort = _contacts(
                scene, pieces, some.take(possible), first[possible], last[possible], jobs, progress
            )
            funnel.solved_pairs = len(possible)
            found.append(solved.of_pairs(moving[possible]))
    all_found = Contacts.concatenate(found)
    funnel.met_pairs = len(np.unique(all_found.pair))
    conflicts = _by_object(scene, pieces, pairs, all_found, footprints)
    if METHODS[scene.method].solver is not None:
        conflicts = with_approaches(scene, pieces, pairs, conflicts)
    funnel.stage4_s = time.perf_counter() - started
    return conflicts, funnel


def _company(pieces: Pieces, pairs: Pairs) -> NDArray[np.int64]:
    """Return (n,) how many of the pairs are of the same two objects."""
    objects, number = np.unique(np.stack([pieces.kind, pieces.object_id]), axis=1, return_inverse=True)
    a, b = number[pairs.a], number[pairs.b]
    both = np.minimum(a, b) * objects.shape[1] + np.maximum(a, b)
    _, group, count = np.unique(both, return_inverse=True, return_counts=True)
    return np.asarray(count[group], np.int64)


def _windows(scene: Scene, pieces: Pieces, pairs: Pairs, funnel: Funnel) -> tuple[Floats, Floats]:
    """Return the windows of stage 3, seconds; the whole shared spans where it is not worth its cost."""
    if METHODS[scene.method].projects_regions:
        funnel.projected_pairs = len(pairs)
        first, last = np.zeros(len(pairs)), np.zeros(len(pairs))
        for rows, (low, high) in isolated(
            np.arange(len(pairs)),
            lambda rows: windows(scene, pieces, pairs.take(rows)),
            lambda rows: _spans_s(pieces, pairs.take(rows)),
            "pair of pieces",
        ):
            first[rows], last[rows] = low, high
        return first, last
    return _spans_s(pieces, pairs)


def _spans_s(pieces: Pieces, pairs: Pairs) -> tuple[Floats, Floats]:
    start, end = shared_span(pieces, pairs)
    return np.zeros(len(pairs)), (end - start) / 1e6


def _contacts(
    scene: Scene, pieces: Pieces, pairs: Pairs, first: Floats, last: Floats, jobs: int, progress: Progress | None
) -> tuple[Contacts, Effort]:
    """Return the contacts of pairs, in processes of their own where that pays."""
    settled = 0

    def advance(count: int) -> None:
        nonlocal settled
        settled += count
        if progress:
            progress(settled, len(pairs))

    advance(0)
    size = METHODS[scene.method].pairs_per_job
    jobs = min(jobs, -(-len(pairs) // size))
    if jobs <= 1:
        return contacts(scene, pieces, pairs, first, last, advance)
    effort, found = Effort(), []
    blocks = [np.arange(k, min(k + size, len(pairs))) for k in range(0, len(pairs), size)]
    tasks = ((scene, *_closed(pieces, pairs.take(rows)), first[rows], last[rows]) for rows in blocks)
    with closing(computed(contacts, tasks, jobs)) as answers:
        for number, (solved, spent) in answers:
            found.append(solved.of_pairs(blocks[number]))
            effort.add(spent)
            advance(len(blocks[number]))
    return Contacts.concatenate(found), effort


def _closed(pieces: Pieces, pairs: Pairs) -> tuple[Pieces, Pairs]:
    """Return the pairs with only the pieces that occur in them."""
    rows, number = np.unique(np.concatenate([pairs.a, pairs.b]), return_inverse=True)
    return pieces.take(rows), replace(pairs, a=number[: len(pairs)], b=number[len(pairs) :])


def _whole_spans(pieces: Pieces, pairs: Pairs, rows: NDArray[np.int64], verdict: NDArray[np.int8]) -> Contacts:
    """Return the shared spans of some pairs as contacts: the exact time for areas, a safe one for a screening."""
    start, end = shared_span(pieces, pairs.take(rows))
    unbounded = (start == SINCE_EVER_US) | (end == FOR_EVER_US)
    width = np.where(unbounded, np.inf, (end - np.where(unbounded, 0, start)) / 1e6)
    # Of areas it is where that is not known: if they meet, they do so while both are there.
    error = np.where((verdict == UNRESOLVED) & np.isfinite(width), width, 0.0)
    return Contacts(rows, np.zeros(len(rows)), width, error, verdict, np.ones(len(rows), np.bool_))


def _by_object(scene: Scene, pieces: Pieces, pairs: Pairs, found: Contacts, footprints: Footprints) -> Conflicts:
    """Return the contacts of pieces, merged into one row per pair of objects with its periods."""
    shared_start, shared_end = shared_span(pieces, pairs)
    a, b = pairs.a[found.pair], pairs.b[found.pair]
    swap = _is_swapped(pieces, a, b)
    a, b = np.where(swap, b, a), np.where(swap, a, b)
    start, end = _instants(found, shared_start[found.pair], shared_end[found.pair])
    keys = np.stack([pieces.kind[a], pieces.object_id[a], pieces.kind[b], pieces.object_id[b]])
    unique, group = np.unique(keys, axis=1, return_inverse=True)
    # Objects that meet are reported while they do: that other pieces of theirs come close is not news.
    meet = np.zeros(unique.shape[1], np.bool_)
    meet[group[found.touches]] = True
    told = np.flatnonzero(found.touches | ~meet[group] | (found.verdict == UNRESOLVED))
    order = told[np.lexsort((end[told], start[told], group[told]))]
    group, start, end = group[order], start[order], end[order]
    error, verdict = found.error_s[order], found.verdict[order]
    n = unique.shape[1]

    # The latest end so far within each group: ranks let one running maximum serve all groups.
    values, rank = np.unique(end, return_inverse=True)
    reached = values[np.maximum.accumulate(group * len(values) + rank) - group * len(values)] if len(end) else end
    opens = np.ones(len(group), np.bool_)
    opens[1:] = (group[1:] != group[:-1]) | (start[1:] > reached[:-1])
    period = np.cumsum(opens) - 1
    period_start = start[opens]
    period_end = reached[np.append(np.flatnonzero(opens)[1:], len(opens)) - 1] if len(opens) else end
    period_error = _period_errors(period, start, end, error, period_start, period_end)

    owner = group[opens]
    time_error = np.zeros(n)
    np.maximum.at(time_error, owner, period_error)
    has_conflict, has_open = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    has_conflict[group[verdict == CONFLICT]] = True
    has_open[group[verdict == UNRESOLVED]] = True

    bounds = np.searchsorted(group, np.arange(n + 1))
    first = bounds[:-1]
    shallow = np.flatnonzero(~has_conflict & ~has_open)
    contacts_of = [order[bounds[k] : bounds[k + 1]] for k in shallow.tolist()]
    contacts_of = [rows[found.touches[rows]] for rows in contacts_of]
    for k, (deep, is_unknown) in isolated(
        np.arange(len(shallow)),
        lambda k: (np.array(_deep(scene, pieces, pairs, found, [contacts_of[i] for i in k], footprints)), False),
        lambda k: (np.zeros(len(k), np.bool_), True),
        "pair of objects",
    ):
        has_conflict[shallow[k]], has_open[shallow[k]] = deep, is_unknown

    points = np.full((n, 2), np.nan)
    if METHODS[scene.method].solver is not None:
        at = np.where(np.isfinite(found.start_s), found.start_s, 0.0)[order][first]
        seen = np.flatnonzero(~is_covered(pieces, pairs.take(found.pair[order][first])))
        points[seen] = meeting_points(scene, pieces, pairs.take(found.pair[order][first][seen]), at[seen])
    member_a, member_b = a[order][first], b[order][first]
    return Conflicts(
        a_kind=pieces.kind[member_a],
        a_id=pieces.object_id[member_a],
        a_version=pieces.version[member_a],
        b_kind=pieces.kind[member_b],
        b_id=pieces.object_id[member_b],
        b_version=pieces.version[member_b],
        period_us=np.stack([period_start, period_end], axis=1),
        period_offset=np.searchsorted(owner, np.arange(n + 1)).astype(np.int64),
        verdict=np.select([has_conflict, has_open], [CONFLICT, UNRESOLVED], GRAZING).astype(np.int8),
        first_contact_deg=points,
        time_error_s=time_error,
        closest_us=np.full(n, SINCE_EVER_US),
        closest_m=np.full(n, np.nan),
        closest_error_m=np.full(n, np.nan),
        closest_a_deg=np.full((n, 2), np.nan),
        closest_b_deg=np.full((n, 2), np.nan),
    )


def _period_errors(
    period: NDArray[np.int64],
    start: NDArray[np.int64],
    end: NDArray[np.int64],
    error: Floats,
    period_start: NDArray[np.int64],
    period_end: NDArray[np.int64],
) -> Floats:
    """Return (p,) by how much, seconds, periods may be longer at either end than the contact that they hold.

    It is beyond doubt from the first to the last instant that is so in any of the contacts (m,) merged into a period:
    one that is in doubt altogether leaves the end to its neighbours.

    period : (m,) the number of each contact's period, sorted
    """
    since_ever, for_ever = period_start == SINCE_EVER_US, period_end == FOR_EVER_US
    length = np.where(since_ever | for_ever, np.inf, (period_end - period_start) / 1e6)
    # From an end at infinity all that does not reach it is infinitely far.
    lead = np.where(since_ever[period], np.inf, (start - period_start[period]) / 1e6)
    tail = np.where(for_ever[period], np.inf, (period_end[period] - end) / 1e6)
    lead[start == period_start[period]] = 0.0
    tail[end == period_end[period]] = 0.0
    count = np.bincount(period, minlength=len(period_start))
    whole = np.where((start == SINCE_EVER_US) | (end == FOR_EVER_US), np.inf, (end - start) / 1e6)
    # Of a contact that is all of its period the error is known, even where it is in doubt altogether.
    sure = (whole > 2.0 * error) | (count[period] == 1)
    worst = [np.full(len(period_start), np.inf) for _ in (lead, tail)]
    for least, way in zip(worst, (lead, tail), strict=True):
        np.minimum.at(least, period[sure], (way + error)[sure])
    return np.asarray(np.minimum(np.maximum(*worst), length))


def _is_swapped(pieces: Pieces, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether pieces a belong to the second object of a row of `Conflicts`."""
    return (pieces.kind[a] > pieces.kind[b]) | (
        (pieces.kind[a] == pieces.kind[b]) & (pieces.object_id[a] > pieces.object_id[b])
    )


def with_approaches(scene: Scene, pieces: Pieces, pairs: Pairs, conflicts: Conflicts) -> Conflicts:
    """Return the conflicts with their closest approach, and the pairs that come near without conflict."""
    pairs = pairs.take(np.flatnonzero(~is_covered(pieces, pairs)))
    # Objects that meet are closest when they first do.
    meets = (conflicts.verdict == CONFLICT) if scene.separation_m == 0.0 else np.zeros(len(conflicts), np.bool_)
    swap = _is_swapped(pieces, pairs.a, pairs.b)
    a, b = np.where(swap, pairs.b, pairs.a), np.where(swap, pairs.a, pairs.b)
    if scene.nearest_m == 0.0:
        some = np.flatnonzero(
            np.isin(pieces.object_id[a], conflicts.a_id[~meets]) & np.isin(pieces.object_id[b], conflicts.b_id[~meets])
        )
        pairs, swap, a, b = pairs.take(some), swap[some], a[some], b[some]
    known = np.stack([conflicts.a_kind, conflicts.a_id, conflicts.b_kind, conflicts.b_id])
    keys = np.stack([pieces.kind[a], pieces.object_id[a], pieces.kind[b], pieces.object_id[b]])
    unique, number = np.unique(np.concatenate([known, keys], axis=1), axis=1, return_inverse=True)
    known_number, number = number[: len(conflicts)], number[len(conflicts) :]

    closest_us = np.where(meets, conflicts.period_us[conflicts.period_offset[:-1], 0], SINCE_EVER_US)
    closest_m, error_m = np.where(meets, 0.0, np.nan), np.where(meets, 0.0, np.nan)
    first = np.where(meets[:, None], conflicts.first_contact_deg, np.nan)
    a_deg, b_deg = first.copy(), first.copy()

    wanted = np.full(unique.shape[1], scene.nearest_m if scene.nearest_m > 0.0 else -np.inf)
    wanted[known_number] = np.where(meets, -np.inf, np.inf)
    rows = np.flatnonzero(wanted[number] >= 0.0)
    asked, group = np.unique(number[rows], return_inverse=True)
    candidates = pairs.take(rows)
    found = _approaches(scene, pieces, candidates, group, wanted[asked])
    of_b = swap[rows[found.pair]] if len(asked) else np.zeros(0, np.bool_)
    touch = np.flatnonzero(found.distance_m == 0.0)
    where = meeting_points(scene, pieces, candidates.take(found.pair[touch]), found.at_s[touch])
    found.a_deg[touch] = found.b_deg[touch] = where
    found_a = np.where(of_b[:, None], found.b_deg, found.a_deg)
    found_b = np.where(of_b[:, None], found.a_deg, found.b_deg)

    place = np.full(unique.shape[1], -1)
    place[asked] = np.arange(len(asked))
    mine = np.flatnonzero(place[known_number] >= 0)
    theirs = place[known_number[mine]]
    closest_us[mine], closest_m[mine], error_m[mine] = (
        found.at_us[theirs],
        found.distance_m[theirs],
        found.error_m[theirs],
    )
    a_deg[mine], b_deg[mine] = found_a[theirs], found_b[theirs]

    is_known = np.zeros(unique.shape[1], np.bool_)
    is_known[known_number] = True
    # Infinite: further apart than asked. NaN: not to be found, so that they may come as near as anything.
    more = np.flatnonzero(~is_known[asked] & ~np.isinf(found.distance_m))
    lost = np.isnan(found.distance_m[more])
    pair = rows[np.unique(group, return_index=True)[1][more]]
    member_a, member_b = a[pair], b[pair]
    start, end = shared_span(pieces, candidates)
    first_us, last_us = np.full(len(asked), FOR_EVER_US), np.full(len(asked), SINCE_EVER_US)
    np.minimum.at(first_us, group, start)
    np.maximum.at(last_us, group, end)
    periods = np.stack([first_us[more], last_us[more]], axis=1)[lost]
    return Conflicts(
        a_kind=np.concatenate([conflicts.a_kind, pieces.kind[member_a]]),
        a_id=np.concatenate([conflicts.a_id, pieces.object_id[member_a]]),
        a_version=np.concatenate([conflicts.a_version, pieces.version[member_a]]),
        b_kind=np.concatenate([conflicts.b_kind, pieces.kind[member_b]]),
        b_id=np.concatenate([conflicts.b_id, pieces.object_id[member_b]]),
        b_version=np.concatenate([conflicts.b_version, pieces.version[member_b]]),
        period_us=np.concatenate([conflicts.period_us, periods]),
        period_offset=np.concatenate([conflicts.period_offset, len(conflicts.period_us) + np.cumsum(lost)]),
        verdict=np.concatenate([conflicts.verdict, np.where(lost, UNRESOLVED, Verdict.NEAR.code).astype(np.int8)]),
        first_contact_deg=np.concatenate([conflicts.first_contact_deg, np.full((len(more), 2), np.nan)]),
        time_error_s=np.concatenate([conflicts.time_error_s, np.zeros(len(more))]),
        closest_us=np.concatenate([closest_us, found.at_us[more]]),
        closest_m=np.concatenate([closest_m, found.distance_m[more]]),
        closest_error_m=np.concatenate([error_m, found.error_m[more]]),
        closest_a_deg=np.concatenate([a_deg, found_a[more]]),
        closest_b_deg=np.concatenate([b_deg, found_b[more]]),
    )


def _approaches(scene: Scene, pieces: Pieces, pairs: Pairs, group: NDArray[np.int64], wanted_m: Floats) -> Approaches:
    """Return the closest approach of pairs of objects, as `approaches` does; NaN where it cannot be found."""
    n = len(wanted_m)
    nowhere = np.full(n, np.nan)
    places = np.full((n, 2), np.nan)
    every = Approaches(
        np.zeros(n, np.int64), nowhere.copy(), np.full(n, SINCE_EVER_US), nowhere.copy(), nowhere, places, places.copy()
    )

    def search(groups: NDArray[np.int64]) -> Approaches | None:
        rows = np.flatnonzero(np.isin(group, groups))
        found = approaches(scene, pieces, pairs.take(rows), np.searchsorted(groups, group[rows]), wanted_m[groups])
        return replace(found, pair=np.where(found.pair < 0, found.pair, rows[found.pair]))

    for groups, found in isolated(np.arange(n), search, lambda groups: None, "pair of objects"):
        if found is not None:
            for column in fields(Approaches):
                getattr(every, column.name)[groups] = getattr(found, column.name)
    return every


def _deep(
    scene: Scene,
    pieces: Pieces,
    pairs: Pairs,
    found: Contacts,
    contacts_of: list[NDArray[np.int64]],
    footprints: Footprints,
) -> list[bool]:
    """Return which pairs of objects, whose contacts are shallow in every part of an area, are deep in the whole of it.

    An area is cut into parts that may be narrower than the tolerance, so that nothing is deep in any of them.

    contacts_of : for each pair of objects the numbers of its contacts
    """
    plane = plane_of(scene)
    rows = np.concatenate([np.empty(0, np.int64), *contacts_of])
    owner = np.repeat(np.arange(len(contacts_of)), [len(mine) for mine in contacts_of])
    members = pairs.a[found.pair[rows]], pairs.b[found.pair[rows]]
    every = np.concatenate(members)
    numbers = np.unique(pieces.object_id[every[pieces.kind[every] == Kind.AREA.code]])
    wholes = planar(plane, footprints(numbers)) if len(numbers) else np.empty(0, dtype=object)
    cores = np.array([_core(scene, plane, whole) for whole in wholes], dtype=object)
    shapely.prepare(cores)
    zero = np.maximum(*(pieces.start_us[member] for member in members))
    moves = np.isfinite(found.end_s[rows])
    first, last = (np.where(moves, ends[rows], 0.0) for ends in (found.start_s, found.end_s))
    is_deep = np.zeros(len(contacts_of), np.bool_)
    for share in (0.0, 0.5, 1.0):
        at = (1.0 - share) * first + share * last
        for area, other in (members, members[::-1]):
            some = np.flatnonzero((pieces.kind[area] == Kind.AREA.code) & ~is_deep[owner])
            mine = cores[np.searchsorted(numbers, pieces.object_id[area[some]])]
            reaches = _meet(mine, plane, _polygons(plane, pieces, other[some], at[some], zero[some]))
            is_deep[owner[some[reaches]]] = True
    return is_deep.tolist()


def _core(scene: Scene, plane: Plane, whole: shapely.Geometry) -> shapely.Geometry:
    """Return what of an area in the plane is deeper than the tolerance."""
    if whole.is_empty:
        return whole
    corners = np.array(whole.bounds).reshape(2, 2).T[:, :, None]
    margin = max(scene.tolerance_m, TOUCH_M) * float(plane.largest_scale(corners)[0])
    return shapely.buffer(whole, -margin, join_style="mitre")


def _meet(cores: NDArray[np.object_], plane: Plane, polygons: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Return (n,) whether geometries of the plane meet, a turn apart or not."""
    meet = np.zeros(len(cores), np.bool_)
    for turn in (-1, 0, 1) if plane.turn_m else (0,):
        away = np.array([turn * plane.turn_m, 0.0])
        meet |= shapely.intersects(cores, shapely.transform(polygons, lambda xy, away=away: xy + away))
    return meet


def _polygons(
    plane: Plane, pieces: Pieces, rows: NDArray[np.int64], at_s: Floats, zero_us: NDArray[np.int64]
) -> NDArray[np.object_]:
    """Return (n,) the polygons of pieces in the plane, at_s seconds after zero_us."""
    polygons = np.empty(len(rows), dtype=object)
    sort = likeness(plane, pieces)[rows]
    for one in np.unique(sort):
        some = np.flatnonzero(sort == one)
        xy = shapes_of(plane, pieces, rows[some], zero_us[some]).positions(at_s[some])
        indices = np.repeat(np.arange(len(some)), xy.shape[1])
        polygons[some] = shapely.convex_hull(shapely.multipoints(xy.transpose(2, 1, 0).reshape(-1, 2), indices=indices))
    return polygons


def _instants(
    found: Contacts, shared_start: NDArray[np.int64], shared_end: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the contacts' ends as instants, rounded outward to the microsecond within the shared span."""
    whole = (found.start_s <= 0.0) & np.isinf(found.end_s)
    first, last = found.start_s, np.where(whole, 0.0, found.end_s)
    # Seconds of centuries have no microseconds: out by what they are rounded to, but not beyond the span.
    offset = np.floor((first - 2.0 * np.spacing(np.abs(first))) * 1e6).astype(np.int64)
    start = np.where(whole | (first <= 0.0), shared_start, shared_start + offset)
    until = np.ceil((last + 2.0 * np.spacing(last)) * 1e6).astype(np.int64)
    span = np.where(whole, 0, shared_end - shared_start)
    end = np.where(
        whole | (last >= span / 1e6), shared_end, np.minimum(np.where(whole, 0, shared_start) + until, shared_end)
    )
    return np.maximum(start, shared_start), end
