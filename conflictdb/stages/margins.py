"""The least distances of tracks from everything else, as planned."""

from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.model.methods import Method
from conflictdb.model.plans import MAX_DISTANCE_M, Scene
from conflictdb.stages.climbs import overlap_at_one_time
from conflictdb.stages.object_pairs import object_numbers
from conflictdb.stages.pieces.covers import is_covered, pieces_of
from conflictdb.stages.stage1_broad_phase import hulls_of, pairs_together
from conflictdb.stages.stage4.closest_approach import Approaches, approaches

# Distances are computed to this, metres.
_AIM_M: Final = 1e-3
# Tracks whose pairs are solved at once: their pairs fit into memory.
_AT_ONCE: Final = 200


def widened(scene: Scene, within_m: float) -> Scene:
    """Return settings whose pieces meet all pieces of a scene that come within a distance."""
    # Hulls are padded by half of their reach, those of the scene perhaps by nothing.
    reach_m = max(2.0 * within_m, scene.nearest_m)
    return replace(scene, method=Method.EXACT, nearest_m=min(reach_m, MAX_DISTANCE_M))


def least_distances(setup: Setup, pieces: Pieces, tracks: TrackBatch, within_m: float) -> tuple[Floats, Floats]:
    """Return how close tracks (n,) come to any other object that shares their time and heights, and the errors, metres.

    The true distance is within the error. Beyond `within_m` it is infinite; where it could not be computed it is 0, and
    the error infinite.

    setup : which the pieces were made with
    pieces : of all objects
    """
    tree, number = shapely.STRtree(hulls_of(pieces)), object_numbers(pieces)
    mine = pieces_of(setup.under(widened(setup.scene, within_m)), AreaBatch.of([]), tracks)
    order = np.argsort(tracks.track_id)
    owner = order[np.searchsorted(tracks.track_id, mine.object_id, sorter=order)]
    parts = [
        _of_some(setup.plane, tree, number, pieces, mine.take(rows), owner[rows] - first, within_m)
        for first in range(0, max(len(tracks), 1), _AT_ONCE)
        for rows in [np.flatnonzero((first <= owner) & (owner < first + _AT_ONCE))]
    ]
    distance_m, error_m = (np.concatenate(some)[: len(tracks)] for some in zip(*parts, strict=True))
    return distance_m, error_m


def _of_some(
    plane: Plane,
    tree: shapely.STRtree,
    number: NDArray[np.int64],
    pieces: Pieces,
    mine: Pieces,
    owner: NDArray[np.int64],
    within_m: float,
) -> tuple[Floats, Floats]:
    """Return least distances of tracks by the number (n,) of the owner of each of their pieces, and the errors."""
    row, other = tree.query(hulls_of(mine))
    others = object_numbers(mine)[row] != number[other]
    others &= (mine.owner_number[row] != pieces.owner_number[other]) | (mine.owner_number[row] == 0)
    both = Pieces.concatenate([mine, pieces])
    a, b = pairs_together(both, PieceRows(row[others]), PieceRows(len(mine) + other[others]))
    near = ~kernel.apart(both.hull_xy, both.hull_offset, a, b)
    a, b = PieceRows(a[near]), PieceRows(b[near])
    covered = is_covered(both, a, b)
    found = _closest(plane, both, PieceRows(a[~covered]), PieceRows(b[~covered]), owner[a[~covered]], within_m)
    is_unknown = np.isnan(found.distance_m)
    is_unknown[owner[a[covered]]] = True
    distance_m = np.where(is_unknown, 0.0, found.distance_m)
    return distance_m, np.where(is_unknown, np.inf, np.where(np.isinf(distance_m), 0.0, found.error_m))


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
