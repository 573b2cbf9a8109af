"""The contact set of a track and another object in the times of both: coordination space, for figures."""

from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.climbs import with_heights
from conflictdb.core.delays import shifts_of
from conflictdb.core.near import Memory, Question
from conflictdb.core.pieces.covers import is_covered
from conflictdb.earth.registry import Setup
from conflictdb.kernel.differences import DifferenceState, differences
from conflictdb.model.results import Kind

# Contact at a single instant stays a single slice, however often its time is halved.
_MOST_HALVINGS: Final = 12


def contact_set(
    setup: Setup, pieces: Pieces, track: int, horizon_us: int, origin_us: int, slices: int
) -> tuple[shapely.Geometry, shapely.Geometry]:
    """Return where a track at time u and another object at time v are in contact, as polygons of points (u, v).

    The first geometry contains every point of contact with v - u within the horizon. Each diagonal through the second
    contains one. Times are seconds after the origin.

    setup : which the pieces were made with
    pieces : of both objects alone
    track : the number of the track (`object_numbers`)
    slices : the least number of parts of the time in contact; in each the contact set is bounded by its differences
    """
    placed = Memory(pieces)
    mine = np.flatnonzero(placed.number == track)
    a, b = placed.rows(Question.shifted(mine, horizon_us))
    known = ~is_covered(pieces, a, b)
    a, b = PieceRows(a[known]), PieceRows(b[known])
    if not len(a):
        return shapely.MultiPolygon(), shapely.MultiPolygon()
    cut, first_us, last_us = shifts_of(pieces, a, b, horizon_us)
    prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces, a, b)
    rows, cut, doubt_s = with_heights(pieces, cut)
    is_certain = np.zeros(len(a), np.bool_)
    is_certain[rows] = np.isfinite(doubt_s)
    for halvings in range(_MOST_HALVINGS + 1):
        found = differences(prepared, cut, setup.scene.separation_m + setup.scene.tolerance_m, kernel.Work())
        met = np.flatnonzero(found["state"] != DifferenceState.NONE)
        found, cut, rows = found[met], cut.take(met), rows[met]
        if not 0 < len(met) < slices or halvings == _MOST_HALVINGS:
            break
        # Halve the times of the track; slices without contact are dropped.
        cut, rows = cut.take(np.repeat(np.arange(len(met)), 2)), np.repeat(rows, 2)
        cut.a_start_s[1::2] = cut.a_end_s[::2] = 0.5 * (cut.a_start_s[::2] + cut.a_end_s[::2])
    zero_s = (cut.a_zero_us - origin_us) / 1e6
    u = zero_s[:, None] + np.column_stack([cut.a_start_s, cut.a_end_s])
    still = pieces.kind[b[rows]] == Kind.AREA.code
    # An area is there from first to last; without an end it is drawn as far as the horizon reaches.
    least_us, most_us = pieces.start_us[mine].min() - horizon_us, pieces.end_us[mine].max() + horizon_us
    spans_us = np.clip(np.column_stack([first_us, last_us])[rows], least_us, most_us)
    v = (spans_us - origin_us) / 1e6
    v[:, 1] += cut.b_end_s
    later_s = np.where(still, 0.0, (cut.b_zero_us - cut.a_zero_us) / 1e6)
    polygons = []
    for name in ("outer", "inner"):
        low, high = found[f"{name}_low"], found[f"{name}_high"]
        some = np.flatnonzero((low <= high) & (is_certain[rows] | (name == "outer")))
        moving, standing = some[~still[some]], some[still[some]]
        bands = _bands(u[moving], v[moving], (later_s + low)[moving], (later_s + high)[moving])
        # Beside what stands still a difference is minus the time of the track.
        west = np.maximum(u[standing, 0], (zero_s - high)[standing])
        east = np.minimum(u[standing, 1], (zero_s - low)[standing])
        rectangles = shapely.box(west, v[standing, 0], east, v[standing, 1])
        polygons.append(shapely.union_all([*bands, *rectangles]))
    return polygons[0], polygons[1]


def _bands(u: Floats, v: Floats, low: Floats, high: Floats) -> NDArray[np.object_]:
    """Return rectangles of both times (n, 2), cut to the differences v - u from low to high (n,)."""
    if not len(u):
        return np.empty(0, object)
    corners = [(u[:, end], u[:, end] + d) for end, d in ((0, low), (1, low), (1, high), (0, high))]
    bands = shapely.polygons(np.stack([np.stack(corner, axis=1) for corner in corners], axis=1))
    return np.asarray(shapely.intersection(bands, shapely.box(u[:, 0], v[:, 0], u[:, 1], v[:, 1])))
