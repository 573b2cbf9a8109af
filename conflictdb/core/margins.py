"""By how much tracks exceed the required separations from everything else, as planned."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.climbs import overlap_at_one_time
from conflictdb.core.near import Memory, Question
from conflictdb.core.pieces.covers import is_covered, pieces_of
from conflictdb.core.separations import Separations
from conflictdb.core.stage1_broad_phase import pairs_together
from conflictdb.core.stage4.closest_approach import Approaches, approaches
from conflictdb.core.uses import with_wide_areas
from conflictdb.core.uses_of_tracks import least_reach
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.model.methods import Method
from conflictdb.model.plans import MAX_DISTANCE_M, Scene
from conflictdb.model.results import Kind

# Distances are computed to this, metres.
_AIM_M: Final = 1e-3
# Tracks whose pairs are solved at once: their pairs fit into memory.
_AT_ONCE: Final = 200


def widened(scene: Scene, within_m: float) -> Scene:
    """Return settings whose pieces meet all pieces of a scene that come within a distance."""
    # Hulls are padded by half of their reach, those of the scene perhaps by nothing.
    reach_m = max(2.0 * within_m, scene.nearest_m)
    return replace(scene, method=Method.EXACT, nearest_m=min(reach_m, MAX_DISTANCE_M))


def least_margins(setup: Setup, placed: Memory, tracks: TrackBatch, within_m: float) -> tuple[Floats, Floats]:
    """Return by how much tracks (n,) exceed the required separation of each pair, and the errors, metres.

    Pairs share time, or come within the separation in time, and heights. The true margin is within the error. Beyond
    `within_m` it is infinite; where it could not be computed, the error is infinite.

    setup : which the pieces were made with
    placed : all pieces of all objects
    """
    largest_m = setup.scene.largest_separation_m + within_m
    mine = pieces_of(setup.under(widened(setup.scene, largest_m)), AreaBatch.of([]), tracks)
    order = np.argsort(tracks.track_id)
    track_of = order[np.searchsorted(tracks.track_id, mine.object_id, sorter=order)]
    parts = [
        _of_some(setup, placed, mine.take(rows), track_of[rows] - first, within_m)
        for first in range(0, max(len(tracks), 1), _AT_ONCE)
        for rows in [np.flatnonzero((first <= track_of) & (track_of < first + _AT_ONCE))]
    ]
    margin_m, error_m = (np.concatenate(some)[: len(tracks)] for some in zip(*parts, strict=True))
    return margin_m, error_m


def _of_some(
    setup: Setup, placed: Memory, mine: Pieces, track_of: NDArray[np.int64], within_m: float
) -> tuple[Floats, Floats]:
    """Return least margins of tracks by the number (n,) of the track of each of their pieces, and the errors."""
    plane, separations = setup.plane, Separations.of(setup.scene)
    both, a, b = placed.beside(mine, Question.of(setup.scene))
    if (separations.of_types == 0).all():
        return _of_pairs(plane, separations.settings[0], both, a, b, track_of, within_m)
    types, found = separations.types(both.kind, both.class_number), []
    for settings in separations.settings:
        few = np.flatnonzero(separations.have(settings)[types[a], types[b]])
        own = separations.of_settings(settings, both)
        one, other = PieceRows(a[few]), PieceRows(b[few])
        one, other = pairs_together(own, one, other, settings.time_separation_us)
        found.append(_of_pairs(plane, settings, own, one, other, track_of, within_m))
    margins_m, errors_m = (np.array(some) for some in zip(*found, strict=True))
    least_m = margins_m.min(axis=0)
    lowest_m, highest_m = (margins_m - errors_m).min(axis=0), (margins_m + errors_m).min(axis=0)
    with np.errstate(invalid="ignore"):
        error_m = np.maximum(least_m - lowest_m, highest_m - least_m)
    return least_m, np.where(np.isinf(least_m), 0.0, error_m)


def _of_pairs(
    plane: Plane,
    settings: Scene,
    pieces: Pieces,
    a: PieceRows,
    b: PieceRows,
    track_of: NDArray[np.int64],
    within_m: float,
) -> tuple[Floats, Floats]:
    """Return least margins of tracks in pairs of one required separation, and the errors."""
    limit_m, within_us = settings.separation_m + within_m, settings.time_separation_us
    covered = is_covered(pieces, a, b)
    # A track and another one may be at one place at two times, an area is there for longer.
    of_tracks = ~covered & (pieces.kind[b] == Kind.TRACK.code) & (within_us > 0)
    one, other = (PieceRows(member[~covered & ~of_tracks]) for member in (a, b))
    lasting = with_wide_areas(pieces, within_us) if within_us else pieces
    found = _closest(plane, lasting, one, other, track_of[one], limit_m)
    is_unknown = np.isnan(found.distance_m)
    is_unknown[track_of[a[covered]]] = True
    distance_m = np.where(is_unknown, 0.0, found.distance_m)
    error_m = np.where(is_unknown, np.inf, np.where(np.isinf(distance_m), 0.0, found.error_m))
    if of_tracks.any():
        one, other = PieceRows(a[of_tracks]), PieceRows(b[of_tracks])
        low_m, high_m = distance_m - error_m, distance_m + error_m
        prepared = kernel.KernelScene(plane.kernel_plane, pieces, one, other)
        for track in np.unique(track_of[one]).tolist():
            rows = np.flatnonzero(track_of[one] == track)
            own = least_reach(prepared, PieceRows(one[rows]), PieceRows(other[rows]), within_us, limit_m, _AIM_M)
            low_m[track], high_m[track] = min(low_m[track], own[0]), min(high_m[track], own[1])
        is_open = np.isinf(high_m) & np.isfinite(low_m)
        with np.errstate(invalid="ignore"):
            distance_m = np.where(is_open, low_m, 0.5 * (low_m + high_m))
            error_m = np.where(is_open, np.inf, np.where(np.isinf(low_m), 0.0, 0.5 * (high_m - low_m)))
    return np.where(distance_m > limit_m, np.inf, distance_m - settings.separation_m), error_m


def _closest(
    plane: Plane, pieces: Pieces, a: PieceRows, b: PieceRows, track: NDArray[np.int64], within_m: float
) -> Approaches:
    first, last, _ = overlap_at_one_time(pieces, a, b)
    meet = np.flatnonzero(first <= last)
    a, b, track = PieceRows(a[meet]), PieceRows(b[meet]), track[meet]
    prepared = kernel.KernelScene(plane.kernel_plane, pieces, a, b)
    at_all_times = np.maximum(first[meet], 0.0), last[meet]
    limits = np.full(_AT_ONCE, within_m), np.full(_AT_ONCE, _AIM_M)
    return approaches(prepared, a, b, *at_all_times, track, *limits, kernel.Work())
