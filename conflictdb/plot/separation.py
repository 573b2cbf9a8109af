"""How far apart two objects are from instant to instant, and between which bounds that is known."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.stage4.closest_approach import approaches
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import MAX_DISTANCE_M
from conflictdb.model.results import Kind
from conflictdb.plot.sketch import Sketch

# Pairs of pieces that are measured at all instants together: more would take seconds.
_MOST_PAIRS: Final = 200_000


@dataclass(frozen=True, slots=True)
class Separation:
    """Signed separation at n instants: metres between two objects, or less than zero, how deep they are in each other.

    at_us : (n,) microseconds since 1970
    low_m, high_m : (n,) bounds of it, on the earth; NaN if unknown. For objects that overlap it is the least
        way that separates their deepest convex parts: by as much they overlap at least.
    """

    at_us: NDArray[np.int64]
    low_m: Floats
    high_m: Floats


def separation(sketch: Sketch, a: int, b: int, at_us: NDArray[np.int64]) -> Separation:
    """Return the signed separation of two objects at instants (n,); fewer of them where the objects have many parts."""
    pieces = sketch.pieces
    rows, others = sketch.rows(a), sketch.rows(b)
    parts = max(1, len(rows) if not sketch.is_track(a) else 1) * max(1, len(others) if not sketch.is_track(b) else 1)
    at_us = at_us[:: max(1, -(-parts * len(at_us) // _MOST_PAIRS))]
    instant, pair_a, pair_b = [], [], []
    for k, at in enumerate(at_us):
        here, there = (one[(pieces.start_us[one] <= at) & (at <= pieces.end_us[one])] for one in (rows, others))
        one, other = np.repeat(here, len(there)), np.tile(there, len(here))
        instant.append(np.full(len(one), k))
        pair_a.append(one)
        pair_b.append(other)
    group, at_a, at_b = np.concatenate(instant), np.concatenate(pair_a), np.concatenate(pair_b)
    low, high = np.full(len(at_us), np.nan), np.full(len(at_us), np.nan)
    if not len(group):
        return Separation(at_us, low, high)
    n = len(group)
    near = _near(sketch, PieceRows(at_a), PieceRows(at_b))
    prepared = kernel.KernelScene(sketch.setup.plane.kernel_plane, near)
    first, second = PieceRows(np.arange(n)), PieceRows(np.arange(n, 2 * n))
    start_us, _ = near.shared_span(first, second)
    still = (near.kind[first] == Kind.AREA.code) & (near.kind[second] == Kind.AREA.code)
    gone_s = np.where(still, 0, at_us[group] - np.where(still, at_us[group], start_us)) / 1e6
    nowhere = np.full(len(at_us), float(MAX_DISTANCE_M))
    found = approaches(prepared, first, second, gone_s, gone_s, group, nowhere, np.zeros(len(at_us)), kernel.Work())
    is_known = np.isin(np.arange(len(at_us)), group) & np.isfinite(found.distance_m)
    low[is_known] = (found.distance_m - found.error_m)[is_known]
    high[is_known] = (found.distance_m + found.error_m)[is_known]
    touching = np.flatnonzero((is_known & (found.distance_m == 0.0))[group])
    deep_low, deep_high = _depth(
        sketch, prepared, PieceRows(first[touching]), PieceRows(second[touching]), at_us[group[touching]]
    )
    # The deepest overlap of two parts decides.
    np.minimum.at(low, group[touching], -deep_high)
    overlap = np.zeros(len(at_us))
    np.maximum.at(overlap, group[touching], deep_low)
    high = np.where(overlap > 0.0, -overlap, high)
    return Separation(at_us, low, high)


def _near(sketch: Sketch, a: PieceRows, b: PieceRows) -> Pieces:
    """Return pieces a and after them b, each as often as it is named, b turned to where it is nearest to a."""
    found = sketch.pieces.take(np.concatenate([a, b]))
    turn_m = sketch.setup.plane.turn_m
    if turn_m == 0.0:
        return found
    middle = np.array(
        [found.hull_xy[i:j, 0].mean() for i, j in zip(found.hull_offset, found.hull_offset[1:], strict=False)]
    )
    turn = np.round((middle[: len(a)] - middle[len(a) :]) / turn_m).astype(found.turn.dtype)
    return replace(found, turn=np.concatenate([np.zeros_like(turn), turn]))


def _depth(
    sketch: Sketch, prepared: kernel.KernelScene, a: PieceRows, b: PieceRows, at_us: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """Return (low, high): how deep convex pieces are in each other at instants, metres on the earth; 0: apart."""
    if not len(a):
        return np.empty(0), np.empty(0)
    both = []
    for rows in (a, b):
        zero_us = np.where(prepared.pieces.kind[rows] == Kind.TRACK.code, prepared.pieces.start_us[rows], at_us)
        both.append(Movement.of(prepared, rows, zero_us).positions((at_us - zero_us) / 1e6))
    depth = np.full(len(a), np.inf)
    for corners in both:
        edge = np.roll(corners, -1, axis=1) - corners
        length = np.hypot(*edge)
        for k in range(corners.shape[1]):
            across = np.stack([edge[1, k], -edge[0, k]]) / np.where(length[k] > 0.0, length[k], 1.0)
            reach = [np.einsum("kn,kvn->vn", across, one) for one in both]
            for one, other in (reach, reach[::-1]):
                overlap = one.max(axis=0) - other.min(axis=0)
                depth = np.where(length[k] > 0.0, np.minimum(depth, overlap), depth)
    depth = np.where(np.isfinite(depth), np.maximum(depth, 0.0), 0.0)
    # The overlap lies in the smaller one.
    extent = [np.ptp(one, axis=1).max(axis=0) for one in both]
    slots = max(one.shape[1] for one in both)
    padded = [np.pad(one, ((0, 0), (0, slots - one.shape[1]), (0, 0)), mode="edge") for one in both]
    smaller = np.where(extent[0] < extent[1], padded[0], padded[1])
    return depth / sketch.setup.plane.largest_scale(smaller), depth / sketch.setup.plane.smallest_scale(smaller)
