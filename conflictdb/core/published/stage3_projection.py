"""Stage 3: the time window in which two pieces can meet, by projecting the region of stage 2 onto the tracks.

Every contact lies in the intersection of the two swept hulls. Along the track, each point of a haven lies between its
last and its foremost vertex. So while the haven is in the region, the reference point is within the haven's length of
it: that bounds the time. The answer is a superset of the true window: it never misses.

Reference: Bienkowski, Sidoti, Pattipati, IEEE Access 2021, section IV-C. Deviations: the published formula takes the
haven's extent behind off the start and its extent ahead off the end, and takes both as constant. Contact needs the
extent ahead off the start and the extent behind off the end, and in the Mercator plane the haven grows with latitude.
Here each extent is the larger of those at both ends of the slice, plus a bound on how far vertices leave their chords.
"""

from typing import Final

import numpy as np

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.earth.plane import ROUNDING_ALLOWANCE_M, padding_m
from conflictdb.earth.registry import Setup
from conflictdb.kernel.movement import Movement
from conflictdb.model.results import Kind

# Windows are widened by this share of the slice and this time at each end: more than float64 rounds.
_OUTWARD_SHARE: Final = 1e-11
_OUTWARD_S: Final = 1e-6
# A reference point that moves less than this in a slice gives no usable projection (plane metres).
_LEAST_WAY_M: Final = 1e-3


def windows(setup: Setup, prepared: kernel.KernelScene, pairs: Pairs) -> tuple[Floats, Floats]:
    """Return (first, last): seconds after the start of each pair's shared span between which they can meet, (n,) each.

    first > last where they cannot. For pairs of areas, and where a region is missing or a track hardly moves, the
    window is the whole shared span.

    prepared : the pieces of the pairs
    """
    pieces = prepared.pieces
    start, end = pieces.shared_span(pairs.a, pairs.b)
    first = np.zeros(len(pairs))
    last = np.where(pieces.kind[pairs.a] | pieces.kind[pairs.b], (end - start) / 1e6, np.inf)
    has_region = np.diff(pairs.region_offset) > 0
    for member in (pairs.a, pairs.b):
        rows = PairRows(np.flatnonzero(has_region & (pieces.kind[member] == Kind.TRACK.code)))
        if rows.size:
            tracks = PieceRows(member[rows])
            one, other = _track_window(setup, prepared, tracks, pairs, rows)
            gone = (pieces.start_us[tracks] - start[rows]) / 1e6
            first[rows] = np.maximum(first[rows], one + gone)
            last[rows] = np.minimum(last[rows], other + gone)
    return first, last


def _track_window(
    setup: Setup, prepared: kernel.KernelScene, member: PieceRows, pairs: Pairs, rows: PairRows
) -> tuple[Floats, Floats]:
    """Return (first, last) for the tracks `member` of the pairs `rows`, seconds after the start of the slice."""
    duration = (prepared.pieces.end_us[member] - prepared.pieces.start_us[member]) / 1e6
    nought = np.zeros(len(rows))
    tracks = Movement.of(prepared, member, prepared.pieces.start_us[member])
    start, end = tracks.reference(nought), tracks.reference(duration)
    way = end - start
    length = np.hypot(way[0], way[1])
    moves = length > _LEAST_WAY_M
    along = way / np.where(moves, length, 1.0)

    offsets = [
        np.einsum("kvn,kn->vn", tracks.positions(t) - at[:, None, :], along)
        for t, at in ((nought, start), (duration, end))
    ]
    # The regions are cut from padded hulls, and rounded by as much again.
    wanted_m = setup.scene.tolerance_m + setup.scene.separation_m
    bounds = tracks.bounds(nought, duration)
    slack = bounds.deviation + ROUNDING_ALLOWANCE_M + 2.0 * padding_m(setup.plane, bounds.scale, wanted_m)
    ahead = np.maximum(offsets[0].max(axis=0), offsets[1].max(axis=0)) + slack
    behind = np.minimum(offsets[0].min(axis=0), offsets[1].min(axis=0)) - slack

    offset, index = ragged_rows(pairs.region_offset, rows)
    of_vertex = np.repeat(np.arange(len(rows)), np.diff(offset))
    rho = np.einsum("nk,kn->n", pairs.region_xy[index] - start[:, of_vertex].T, along[:, of_vertex])
    nearest, furthest = np.minimum.reduceat(rho, offset[:-1]), np.maximum.reduceat(rho, offset[:-1])

    safe = np.where(moves, length, 1.0)
    low = np.where(moves, (nearest - ahead) / safe, 0.0)
    high = np.where(moves, (furthest - behind) / safe, 1.0)
    first, last = (tracks.time_fraction(nought, duration, np.clip(fraction, 0.0, 1.0)) for fraction in (low, high))
    # A region that the haven has left before the slice, or reaches after it, leaves an empty window.
    first, last = np.where(low > 1.0, np.inf, first), np.where(high < 0.0, -np.inf, last)
    outward = _OUTWARD_SHARE * duration + _OUTWARD_S
    return first * duration - outward, last * duration + outward
