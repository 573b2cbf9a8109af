"""How deep pairs of objects undercut their required separation, and when most: the worst instant of a conflict.

The signed separation of two pieces in uniform motion is convex in time, so that a few instants around the least of some
samples find the worst one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.climbs import overlap_at_one_time
from conflictdb.core.near import Memory, Question
from conflictdb.core.object_pairs import ordered_members
from conflictdb.core.pieces.covers import is_covered
from conflictdb.core.separations import Separations
from conflictdb.core.stage2_intersection import intersections
from conflictdb.core.world import World, occupy
from conflictdb.earth.plane import Plane
from conflictdb.kernel.meeting import distances
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, Track
from conflictdb.model.results import Kind

_SAMPLES: Final = 9  # of the shared time of two pieces
_STEPS: Final = 32  # a golden section each: the worst instant of an hour to a millisecond
_GOLDEN: Final = (5.0**0.5 - 1.0) / 2.0


@dataclass(frozen=True, slots=True)
class DeepestContact:
    """How deep two objects undercut their required separation, of their deepest convex parts.

    depth_m : the required separation minus the least signed distance, metres; two objects that overlap by their
        shallowest escape
    at_us : when that is, microseconds since 1970; None if it does not change
    """

    depth_m: float
    at_us: int | None


def depths(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> dict[tuple[str, str], DeepestContact]:
    """Return the depth of each pair of objects that undercuts its separation, by keys: the area first, then by key.

    Pairs without a known distance are left out, and all pairs with a separation in time.
    """
    areas = sorted(areas, key=lambda area: area.key.encode())
    tracks = sorted(tracks, key=lambda track: track.key.encode())
    world = World.of(scene, areas, tracks)
    setup, pieces = world.setup, occupy(world, areas, tracks, is_lenient=True, warns=True).pieces
    keys = {Kind.AREA.code: [one.key for one in areas], Kind.TRACK.code: [one.key for one in tracks]}
    found: dict[tuple[str, str], DeepestContact] = {}
    for settings, own, *pair in Separations.of(setup.scene).split(pieces, *Memory(pieces).rows(Question())):
        if settings.time_separation_us:
            continue
        pairs = intersections(own, *pair, regions=False)
        a, b, _ = ordered_members(own, pairs.a, pairs.b)
        depth_m, at_us = _of_pieces(setup.plane, own, a, b)
        depth_m += settings.separation_m
        for k in np.argsort(-depth_m, kind="stable").tolist():
            if not depth_m[k] >= 0.0:
                break
            key = tuple(keys[int(own.kind[row])][int(own.object_id[row])] for row in (a[k], b[k]))
            found.setdefault(
                (key[0], key[1]), DeepestContact(float(depth_m[k]), None if at_us[k] < 0 else int(at_us[k]))
            )
    return found


def _of_pieces(plane: Plane, pieces: Pieces, a: PieceRows, b: PieceRows) -> tuple[Floats, NDArray[np.int64]]:
    """Return how deep pieces (n,) are in each other at most, metres, below zero if they stay apart; and when.

    -inf if their distance is unknown, or their heights never overlap; -1 if the depth does not change.
    """
    start_us, end_us = pieces.shared_span(a, b)
    low_s, high_s, _ = overlap_at_one_time(pieces, a, b)
    is_still = (pieces.kind[a] == Kind.AREA.code) & (pieces.kind[b] == Kind.AREA.code)
    is_bounded = (start_us > MINUS_INFINITY_US) & (end_us < INFINITY_US) & ~is_still
    zero_us = np.where(is_bounded, start_us, 0)
    low_s = np.where(is_bounded, np.maximum(low_s, 0.0), 0.0)
    high_s = np.where(is_bounded, np.minimum(high_s, (end_us - zero_us) / 1e6), 0.0)
    is_known = (low_s <= high_s) & (start_us <= end_us) & (is_bounded | is_still) & ~is_covered(pieces, a, b)
    known = np.flatnonzero(is_known)
    depth_m, at_us = np.full(len(a), -np.inf), np.full(len(a), -1, np.int64)
    if known.size:
        one, other = a[known], b[known]
        prepared = kernel.KernelScene(plane.kernel_plane, pieces, one, other)

        def measured(at_s: Floats) -> Floats:
            found = distances(prepared, one, other, zero_us[known], at_s)
            return np.where(np.isnan(found), np.inf, found)

        least_m, when_s = _least(measured, low_s[known], high_s[known])
        depth_m[known] = -least_m
        moves = is_bounded[known]
        at_us[known[moves]] = zero_us[known[moves]] + np.round(1e6 * when_s[moves]).astype(np.int64)
    return depth_m, at_us


def _least(measured: Callable[[Floats], Floats], low_s: Floats, high_s: Floats) -> tuple[Floats, Floats]:
    """Return the least values (n,) of functions that fall and rise again from low_s to high_s, and where they are."""
    width_s = (high_s - low_s) / (_SAMPLES - 1)
    values = np.stack([measured(low_s + k * width_s) for k in range(_SAMPLES)])
    nearest = np.argmin(values, axis=0)
    least, when_s = values[nearest, np.arange(len(low_s))], low_s + nearest * width_s
    left, right = np.maximum(low_s, when_s - width_s), np.minimum(high_s, when_s + width_s)
    first, second = right - _GOLDEN * (right - left), left + _GOLDEN * (right - left)
    at_first, at_second = measured(first), measured(second)
    for _ in range(_STEPS):
        for at_s, value in ((first, at_first), (second, at_second)):
            is_less = value < least
            least, when_s = np.where(is_less, value, least), np.where(is_less, at_s, when_s)
        is_left = at_first < at_second
        left, right = np.where(is_left, left, first), np.where(is_left, second, right)
        asked_s = np.where(is_left, right - _GOLDEN * (right - left), left + _GOLDEN * (right - left))
        value = measured(asked_s)
        first, second = np.where(is_left, asked_s, second), np.where(is_left, first, asked_s)
        at_first, at_second = np.where(is_left, value, at_second), np.where(is_left, at_first, value)
    return least, when_s
