"""How deep pairs of objects undercut their required separation, and when most: the worst instant of a conflict."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

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
from conflictdb.kernel.meeting import deepest
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, Track
from conflictdb.model.results import Kind


@dataclass(frozen=True, slots=True)
class DeepestContact:
    """How deep two objects undercut their required separation, of their deepest convex parts.

    depth_m : the required separation minus the least signed distance, metres; two objects that overlap by their
        shallowest escape
    at_us : when that is, microseconds since 1970; None if it does not change
    separation_m : the required separation, metres
    """

    depth_m: float
    at_us: int | None
    separation_m: float = 0.0


def depths(
    scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], only: Iterable[tuple[str, str]] | None = None
) -> dict[tuple[str, str], DeepestContact]:
    """Return the depth of each pair of objects that undercuts its separation, by keys: the area first, then by key.

    Pairs without a known distance are left out, and all pairs with a separation in time.

    only : pairs of keys to compute, None for all
    """
    areas = sorted(areas, key=lambda area: area.key.encode())
    tracks = sorted(tracks, key=lambda track: track.key.encode())
    world = World.of(scene, areas, tracks)
    setup, pieces = world.setup, occupy(world, areas, tracks, is_lenient=True, warns=True).pieces
    keys = {Kind.AREA.code: [one.key for one in areas], Kind.TRACK.code: [one.key for one in tracks]}
    of_pieces = Memory(pieces).rows(Question())
    if only is not None:
        in_order = [*keys[Kind.AREA.code], *keys[Kind.TRACK.code]]
        is_asked = _is_among(only, pieces, *of_pieces, in_order, len(areas))
        of_pieces = PieceRows(of_pieces[0][is_asked]), PieceRows(of_pieces[1][is_asked])
    found: dict[tuple[str, str], DeepestContact] = {}
    for settings, own, *pair in Separations.of(setup.scene).split(pieces, *of_pieces):
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
            when_us = None if at_us[k] < 0 else int(at_us[k])
            found.setdefault((key[0], key[1]), DeepestContact(float(depth_m[k]), when_us, settings.separation_m))
    return found


def _is_among(
    only: Iterable[tuple[str, str]], pieces: Pieces, a: PieceRows, b: PieceRows, keys: Sequence[str], areas: int
) -> NDArray[np.bool_]:
    """Return whether pieces a and b (n,) are of a pair of objects in `only`; keys of areas, then of tracks."""
    number = {key: n for n, key in enumerate(keys)}
    pairs = [sorted((number[one], number[other])) for one, other in only if one in number and other in number]
    of = pieces.object_id + np.where(pieces.kind == Kind.TRACK.code, areas, 0)
    low, high = np.minimum(of[a], of[b]), np.maximum(of[a], of[b])
    return np.isin(low * len(keys) + high, [low * len(keys) + high for low, high in pairs])


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
        least_m, when_s = deepest(prepared, one, other, zero_us[known], low_s[known], high_s[known])
        depth_m[known] = -least_m
        moves = is_bounded[known]
        at_us[known[moves]] = zero_us[known[moves]] + np.round(1e6 * when_s[moves]).astype(np.int64)
    return depth_m, at_us
