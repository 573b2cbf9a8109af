"""Run a scene through the four stages by its method, chunk by chunk: stage 1 at its source, the others here."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Conflicts, Contacts
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.polygons import Polygons
from conflictdb.core.certainty import with_certainty
from conflictdb.core.climbs import overlap_at_one_time, sharing_heights
from conflictdb.core.closest_approaches import with_closest_approaches
from conflictdb.core.conflict_regions import Meetings
from conflictdb.core.funnel import Funnel, Progress
from conflictdb.core.merge import merged
from conflictdb.core.near import PairSource, Question
from conflictdb.core.object_pairs import company_of
from conflictdb.core.pieces.covers import is_covered
from conflictdb.core.published.stage3_projection import windows
from conflictdb.core.separations import Separations
from conflictdb.core.stage2_intersection import intersections
from conflictdb.core.stage4.contact_search import contacts, static_verdicts
from conflictdb.core.uses import Uses, as_contacts, uses_of_contacts, with_wide_areas
from conflictdb.core.uses_of_tracks import uses_of_tracks
from conflictdb.core.whole_areas import Footprints
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.model.methods import METHODS
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US
from conflictdb.model.results import Kind, Verdict

# First and last time at which the heights of pairs (n,) overlap, and errors (`overlap_at_one_time`).
_Heights: TypeAlias = tuple[Floats, Floats, Floats]

_SHORTEST_S: Final = 1e-9  # divisor if the clock shows no time


def run_scene(
    setup: Setup,
    source: PairSource,
    *,
    question: Question | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
    has_approaches: bool = True,
) -> Iterator[tuple[Conflicts, Funnel]]:
    """Yield the conflicts among the pieces of a source and the counts, for each chunk of its pairs.

    setup : of the scene and of its pieces
    question : which pairs; None: those of a detection
    jobs, progress, has_approaches : see `run_stages`
    """
    decided = 0
    separations = Separations.of(setup.scene)
    chunks = source.pairs(Question.of(setup.scene) if question is None else question)
    while True:
        clock = time.perf_counter()
        chunk = next(chunks, None)
        if chunk is None:
            return
        pieces, a, b, candidate_pairs, stage2_s, share = chunk
        counted = Funnel(candidate_pairs=len(a) if candidate_pairs is None else candidate_pairs, stage2_s=stage2_s)
        counted.stage1_s = time.perf_counter() - clock - stage2_s
        parts = separations.split(pieces, a, b)
        while True:
            clock = time.perf_counter()
            part = next(parts, None)
            if part is None:
                break
            settings, own, one, other = part
            own_setup = setup.under(settings)
            pairs = intersections(own, one, other, regions=METHODS[setup.scene.method].needs_regions)
            counted.stage2_s += time.perf_counter() - clock
            found, funnel = run_stages(
                own_setup,
                own,
                pairs,
                source.footprints,
                jobs=jobs,
                progress=_after(decided, share, progress),
                has_approaches=has_approaches,
            )
            clock = time.perf_counter()
            found = with_certainty(own_setup, own, found, source.plans)
            funnel.stage4_s += time.perf_counter() - clock
            funnel.intersecting_pairs, funnel.settings = len(pairs), settings
            funnel.add(counted)
            counted = Funnel()
            decided += funnel.solved_pairs + funnel.effort.exact.closed_forms
            # Free before the next pairs are allocated.
            del pairs, part, own, one, other
            yield found, funnel
            del found, funnel
        # Free before the next chunk is allocated.
        del chunk, pieces, a, b, parts


def _after(decided: int, share: float | None, progress: Progress | None) -> Progress | None:
    """Return a callback that adds `decided` earlier pairs, and extrapolates to all pairs from their share."""
    if progress is None:
        return None
    return lambda done, of: progress(decided + done, round((decided + of) / share) if share else 0)


def run_stages(
    setup: Setup,
    pieces: Pieces,
    pairs: Pairs,
    footprints: Footprints,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
    has_approaches: bool = True,
) -> tuple[Conflicts, Funnel]:
    """Return the conflicts of pairs of pieces that passed stage 2, by stages 3 and 4 of the scene's method.

    setup : of the scene and of its pieces
    footprints : called for whole areas if contacts are shallow in all parts of one
    jobs : threads of the kernel
    progress : called with the number of decided pairs, and of all pairs
    has_approaches : whether to find the closest approach of conflicts, and pairs that are only near
    """
    funnel = Funnel()
    started = time.perf_counter()
    method = METHODS[setup.scene.method]
    within_us = setup.scene.time_separation_us
    lasting = with_wide_areas(pieces, within_us) if within_us else pieces
    heights = overlap_at_one_time(lasting, pairs.a, pairs.b)
    if not within_us:
        sharing = PairRows(np.flatnonzero(heights[0] <= heights[1]))
        if len(sharing) < len(pairs):
            pairs, heights = pairs.take(sharing), _some(heights, sharing)
    if not len(pairs):
        return Conflicts.none(), funnel
    pairs = replace(pairs, company=company_of(pieces, pairs))
    covered = is_covered(pieces, pairs.a, pairs.b)
    static = (pieces.kind[pairs.a] == Kind.AREA.code) & (pieces.kind[pairs.b] == Kind.AREA.code)
    # With a separation in time pairs of tracks have a solver of their own, and areas are there for longer.
    of_tracks = ~static & ~covered & (pieces.kind[pairs.a] == pieces.kind[pairs.b]) & (within_us > 0)
    # Once, for all queries about the pairs.
    prepared = kernel.KernelScene(setup.plane.kernel_plane, lasting, pairs.a, pairs.b)
    parts = []
    for rows, decide in (
        (PairRows(np.flatnonzero(covered)), partial(_unresolved, pieces, heights)),
        (PairRows(np.flatnonzero(static & ~covered)), partial(_static_contacts, setup, prepared, heights)),
    ):
        if rows.size:
            parts.append(decide(pairs, rows))
    funnel.window_pairs = sum(map(len, parts))
    solved = Contacts.none()
    moving = PairRows(np.flatnonzero(~static & ~covered & ~of_tracks))
    if method.solver is None:
        moving, of_tracks = PairRows(np.flatnonzero(~static & ~covered)), of_tracks & False
        parts.append(_unresolved(pieces, heights, pairs, moving))
    elif moving.size:
        solved = _moving_contacts(setup, prepared, heights, pairs, moving, funnel, jobs, progress)
    if within_us:
        found = Contacts.concatenate(parts), solved
        tracks = PairRows(np.flatnonzero(of_tracks))
        conflicts, meetings = _merged_uses(setup, prepared, pieces, pairs, found, tracks, footprints, funnel, jobs)
        prepared, pairs = _at_one_time(setup.plane, pieces, pairs)
    else:
        every = Contacts.concatenate([*parts, solved])
        if not len(every) and not setup.scene.nearest_m:
            funnel.stage4_s = time.perf_counter() - started - funnel.stage3_s
            return Conflicts.none(), funnel
        funnel.met_pairs = int(np.count_nonzero(np.diff(every.pair, prepend=-1)))
        conflicts, meetings = merged(setup, prepared, pairs, every, footprints, jobs)
    if method.solver is not None and has_approaches:
        conflicts = with_closest_approaches(
            setup.scene, prepared, pairs, meetings, conflicts, funnel.effort.exact, jobs
        )
    funnel.stage4_s = time.perf_counter() - started - funnel.stage3_s

    if not setup.scene.has_regions:
        return conflicts, funnel

    def where(rows: NDArray[np.int64]) -> Polygons:
        began = time.perf_counter()
        found = meetings.regions(rows)
        funnel.stage4_s += time.perf_counter() - began
        return found

    return replace(conflicts, where=where), funnel


def _moving_contacts(
    setup: Setup,
    prepared: kernel.KernelScene,
    heights: _Heights,
    pairs: Pairs,
    moving: PairRows,
    funnel: Funnel,
    jobs: int,
    progress: Progress | None,
) -> Contacts:
    """Return the contacts of pairs with a moving piece, by stages 3 and 4; `funnel` counts their work."""
    clock = time.perf_counter()
    if METHODS[setup.scene.method].needs_regions:
        first, last = _windows(setup, prepared, pairs.take(moving))
        funnel.projected_pairs, funnel.stage3_s = len(moving), time.perf_counter() - clock
    else:
        # Stage 3 is the kernel's closed form, which finds the times of the pairs that it decides.
        first, last = _spans_s(prepared.pieces, pairs.take(moving))
    low, high, doubt_s = _some(heights, moving)
    first, last = np.maximum(first, low), np.minimum(last, high)
    possible = np.flatnonzero(first <= last)
    moving, first, last = PairRows(moving[possible]), first[possible], last[possible]
    tell = _counting(len(moving), progress)
    clock = time.perf_counter()
    found, funnel.effort = contacts(setup, prepared, pairs.take(moving), first, last, tell, threads=jobs)
    exact = funnel.effort.exact
    # The kernel adds up seconds over threads; their ratio is that of the elapsed times.
    funnel.stage3_s += (time.perf_counter() - clock) * exact.closed_form_s / max(exact.contacts_s, _SHORTEST_S)
    funnel.projected_pairs += exact.closed_forms
    funnel.window_pairs += len(moving) - exact.closed_apart
    funnel.solved_pairs = len(moving) - exact.closed_forms
    # A contact that begins or ends with the overlap of heights has its error.
    return replace(found, error_s=found.error_s + doubt_s[possible][found.pair]).of_pairs(moving)


def _merged_uses(
    setup: Setup,
    prepared: kernel.KernelScene,
    pieces: Pieces,
    pairs: Pairs,
    contacts: tuple[Contacts, Contacts],
    tracks: PairRows,
    footprints: Footprints,
    funnel: Funnel,
    jobs: int,
) -> tuple[Conflicts, Meetings]:
    """Return what `merged` does, of pairs that use one place within the separation in time.

    prepared : the pieces with wide areas; `pieces` have their own spans
    contacts : those that last while both are there, and those of tracks with areas
    tracks : the pairs of tracks to decide
    """
    work = kernel.Work()

    def uses_of(some: Contacts, *, is_whole: bool) -> Uses:
        return uses_of_contacts(setup.scene, pieces, prepared, pairs, some, jobs, is_whole=is_whole)

    def undecided(rows: NDArray[np.int64]) -> Uses:
        heights = overlap_at_one_time(prepared.pieces, pairs.a, pairs.b)
        return uses_of(_unresolved(prepared.pieces, heights, pairs, PairRows(rows)), is_whole=True)

    found_of_tracks = isolated(
        tracks,
        lambda rows: uses_of_tracks(setup, prepared, pairs, PairRows(rows), work, jobs),
        undecided,
        "pair of pieces",
    )
    uses = Uses.concatenate(
        [
            uses_of(contacts[0], is_whole=True),
            uses_of(contacts[1], is_whole=False),
            *(found for _, found in found_of_tracks),
        ]
    )
    # Without its closed forms: one pair may use several.
    funnel.effort.exact.windows += work.windows
    funnel.effort.exact.evaluations += work.evaluations
    funnel.solved_pairs += len(tracks)
    funnel.window_pairs += len(tracks)
    funnel.met_pairs = len(np.unique(uses.pair))
    prepared, pairs, found = as_contacts(setup.plane, pieces, pairs, uses)
    return merged(setup, prepared, pairs, found, footprints, jobs, uses.first_deg, uses.lacking_s)


def _at_one_time(plane: Plane, pieces: Pieces, pairs: Pairs) -> tuple[kernel.KernelScene, Pairs]:
    """Return the pairs that are there at the same time, and their pieces."""
    start, end = pieces.shared_span(pairs.a, pairs.b)
    pairs = sharing_heights(pieces, pairs.take(PairRows(np.flatnonzero(start <= end))))
    return kernel.KernelScene(plane.kernel_plane, pieces, pairs.a, pairs.b), pairs


def _counting(of: int, progress: Progress | None) -> Callable[[int], None] | None:
    """Return a callback that takes numbers of newly decided pairs and reports their sum; report 0 first."""
    if progress is None:
        return None
    decided = 0

    def advance(count: int) -> None:
        nonlocal decided
        decided += count
        progress(decided, of)

    advance(0)
    return advance


def _windows(setup: Setup, prepared: kernel.KernelScene, pairs: Pairs) -> tuple[Floats, Floats]:
    """Return the windows of the search for contacts, seconds, by stage 3, which projects regions."""
    first, last = np.zeros(len(pairs)), np.zeros(len(pairs))
    for rows, (low, high) in isolated(
        np.arange(len(pairs)),
        lambda rows: windows(setup, prepared, pairs.take(PairRows(rows))),
        lambda rows: _spans_s(prepared.pieces, pairs.take(PairRows(rows))),
        "pair of pieces",
    ):
        first[rows], last[rows] = low, high
    return first, last


def _spans_s(pieces: Pieces, pairs: Pairs) -> tuple[Floats, Floats]:
    """Return the whole shared spans of pairs, seconds after their start."""
    start, end = pieces.shared_span(pairs.a, pairs.b)
    return np.zeros(len(pairs)), (end - start) / 1e6


def _static_contacts(
    setup: Setup, prepared: kernel.KernelScene, heights: _Heights, pairs: Pairs, rows: PairRows
) -> Contacts:
    """Return the contacts of pairs of areas, for the time that both exist."""
    asked = pairs if rows.size == len(pairs) else pairs.take(rows)
    verdict, touches = static_verdicts(setup, prepared, asked)
    meets = np.flatnonzero(verdict >= 0)
    return _whole_spans(prepared.pieces, heights, pairs, PairRows(rows[meets]), verdict[meets], touches[meets])


def _unresolved(pieces: Pieces, heights: _Heights, pairs: Pairs, rows: PairRows) -> Contacts:
    """Return undecided pairs, with their shared time."""
    verdict, touches = np.full(len(rows), Verdict.UNRESOLVED.code, np.int8), np.ones(len(rows), np.bool_)
    return _whole_spans(pieces, heights, pairs, rows, verdict, touches)


def _whole_spans(
    pieces: Pieces,
    heights: _Heights,
    pairs: Pairs,
    rows: PairRows,
    verdict: NDArray[np.int8],
    touches: NDArray[np.bool_],
) -> Contacts:
    """Return the shared spans of some pairs as contacts: the exact time for areas, a safe one for a screening."""
    start, end = pieces.shared_span(*_members(pairs, rows))
    unbounded = (start == MINUS_INFINITY_US) | (end == INFINITY_US)
    width = np.where(unbounded, np.inf, (end - np.where(unbounded, 0, start)) / 1e6)
    # Areas that meet do so during all of their shared time; the place is unknown.
    first, last, _ = _some(heights, rows)
    # With a separation in time heights need not overlap at one time; nobody reads the times of these contacts.
    overlap = first <= last
    first, last = np.where(overlap, np.maximum(first, 0.0), 0.0), np.where(overlap, np.minimum(last, width), width)
    error = np.where((verdict == Verdict.UNRESOLVED.code) & np.isfinite(width), last - first, 0.0)
    return Contacts(rows, first, last, error, verdict, touches)


def _some(heights: _Heights, rows: PairRows) -> _Heights:
    first, last, error = (column[rows] for column in heights)
    return first, last, error


def _members(pairs: Pairs, rows: PairRows) -> tuple[PieceRows, PieceRows]:
    return PieceRows(pairs.a[rows]), PieceRows(pairs.b[rows])
