"""The first and the last time at which two tracks use one place within the separation in time, by bisection.

`kernel.differences` proves for a part of a track's time that it comes to no place of the other within that time, or
that it does.
"""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.earth.plane import Plane
from conflictdb.kernel.differences import DifferenceState, Shifts, differences
from conflictdb.kernel.movement import Movement
from conflictdb.model.results import Kind

_Ints = NDArray[np.int64]

# More than times of pieces are rounded by, microseconds.
ROUNDING_US: Final = 0.1
# Ends are found to this, seconds. Smaller: more steps, which cost more the nearer they are to the end.
_AIM_S: Final = 1e-3
# So far on either side of guesses a bisection goes first, seconds: rounding, curved sweeps, havens that change.
_ASIDE_S: Final = 4e-4, 0.05, 2.0
# Factor between the times, or distances, within which a contact next to a bound is looked for.
LADDER: Final = 10.0


def ends_of(
    prepared: kernel.KernelScene,
    shifts: Shifts,
    guesses_s: Floats,
    reach_m: float,
    within_us: int,
    work: kernel.Work,
    threads: int,
) -> tuple[Floats, Floats]:
    """Return the first and last times of contact within T, of a and of b (4, n), and their error (n,); seconds.

    By bisection: `kernel.differences` proves that they do not meet before a time of a, or up to it they do.

    guesses_s : (k, 4, n) where these times may be; they change the work, not the proof
    """
    n = len(shifts)
    every = shifts.take(np.tile(np.arange(n), 4))
    end = np.repeat(np.arange(4), n)
    starts, stops = (
        np.where(end < 2, getattr(every, f"a_{name}_s"), getattr(every, f"b_{name}_s")) for name in ("start", "end")
    )
    length = stops - starts
    between_us = every.b_zero_us - every.a_zero_us
    guesses = guesses_s.reshape(len(guesses_s), 4 * n)
    guesses = np.where(end % 2 == 0, guesses - starts, stops - guesses)
    places = np.sort(np.concatenate([guesses + sign * aside for aside in _ASIDE_S for sign in (-1, 1)]), axis=0)

    def asked(rows: _Ints, gone_s: Floats) -> NDArray[Any]:
        """Return what differences are met during so much of the time from its start, or before its end."""
        return differences(prepared, _narrowed(every.take(rows), end[rows], gone_s), reach_m, work, threads)

    low, high, rows = np.zeros(4 * n), length.copy(), np.arange(4 * n)
    is_apart = asked(rows, low)["state"] == DifferenceState.NONE
    high[~is_apart] = 0.0
    while (rows := rows[(high - low)[rows] > _AIM_S]).size:
        is_near = (low[rows] < places[:, rows]) & (places[:, rows] < high[rows])
        first, count = is_near.argmax(axis=0), is_near.sum(axis=0)
        guess = places[np.minimum(first + count // 2, len(places) - 1), rows]
        middle = np.where(count > 0, guess, 0.5 * (low + high)[rows])
        apart = asked(rows, middle)["state"] == DifferenceState.NONE
        low[rows[apart]] = middle[apart]
        high[rows[~apart]] = middle[~apart]
    error, rows, step = length - low, np.arange(4 * n), 0.0
    while rows.size:
        until = np.minimum(high[rows] + step, length[rows])
        found = asked(rows, until)
        first, last = (1e6 * found[f"inner_{name}"] + between_us[rows] for name in ("low", "high"))
        is_met = np.maximum(first, ROUNDING_US - within_us) <= np.minimum(last, within_us - ROUNDING_US)
        is_met |= until >= length[rows]
        error[rows[is_met]] = (until - low[rows])[is_met]
        rows, step = rows[~is_met], max(LADDER * step, _AIM_S)
    at = np.where(end % 2 == 0, starts + low, stops - low).reshape(4, n)
    return at, error.reshape(4, n).max(axis=0, initial=0.0)


def guessed_ends(
    plane: Plane,
    prepared: kernel.KernelScene,
    shifts: Shifts,
    reach_m: float,
    within_us: int,
    work: kernel.Work,
    threads: int,
) -> Floats:
    """Return where the ends of contact within T may be (3, 4, n), seconds; NaN if unknown.

    They are where a piece meets all that the other sweeps, or where it meets the other shifted by T.
    """
    pieces, n = prepared.pieces, len(shifts)
    found = np.full((3, 4, n), np.nan)
    if not n:
        return found
    a, b = PieceRows(shifts.a), PieceRows(shifts.b)
    swept = Pieces.concatenate([pieces.take(a), pieces.take(b), _swept(prepared, b), _swept(prepared, a)])
    one, other = PieceRows(np.arange(2 * n)), PieceRows(np.arange(2 * n, 4 * n))
    scene = kernel.KernelScene(plane.kernel_plane, swept, one, other)
    first, last = _contact_s(scene, one, other, swept.start_us[one], swept.end_us[one], reach_m, work, threads)
    found[0] = first[:n], last[:n], first[n:], last[n:]
    for k, by_us in ((1, within_us), (2, -within_us)):
        scene, one, other = shifted(plane, pieces, shifts, np.full(n, by_us))
        first, last = _contact_s(scene, one, other, *scene.pieces.shared_span(one, other), reach_m, work, threads)
        start, _ = scene.pieces.shared_span(one, other)
        for member, zero in ((0, shifts.a_zero_us), (2, shifts.b_zero_us - by_us)):
            found[k, member], found[k, member + 1] = ((start - zero) / 1e6 + at for at in (first, last))
    return found


def shifted(
    plane: Plane, pieces: Pieces, shifts: Shifts, by_us: _Ints
) -> tuple[kernel.KernelScene, PieceRows, PieceRows]:
    """Return pairs of tracks (n,) as pieces of a scene of their own, b earlier by so many microseconds."""
    n = len(shifts)
    own = pieces.take(shifts.b)
    names = "start_us", "end_us", "leg_start_us", "leg_end_us"
    moved = replace(own, **{name: getattr(own, name) - by_us for name in names})
    a, b = PieceRows(np.arange(n)), PieceRows(np.arange(n, 2 * n))
    both = Pieces.concatenate([pieces.take(shifts.a), moved])
    return kernel.KernelScene(plane.kernel_plane, both, a, b), a, b


def _contact_s(
    scene: kernel.KernelScene,
    a: PieceRows,
    b: PieceRows,
    start_us: _Ints,
    end_us: _Ints,
    reach_m: float,
    work: kernel.Work,
    threads: int,
) -> tuple[Floats, Floats]:
    """Return the first and the last contact of pairs (n,) during a time, seconds from its start; NaN without one."""
    first, last = np.full(len(a), np.inf), np.full(len(a), -np.inf)
    rows = np.flatnonzero(start_us <= end_us)
    if rows.size:
        lasts_s = (end_us - start_us)[rows] / 1e6
        always = np.full(len(rows), np.inf)
        asked = kernel.Questions(a[rows], b[rows], start_us[rows], np.zeros(len(rows)), lasts_s, always)
        found = kernel.contacts(scene, asked, reach_m, 0.0, work, threads)
        np.minimum.at(first, rows[found.pair], found.start_s)
        np.maximum.at(last, rows[found.pair], found.end_s)
    is_met = first <= last
    return np.where(is_met, first, np.nan), np.where(is_met, last, np.nan)


def _swept(prepared: kernel.KernelScene, rows: PieceRows) -> Pieces:
    """Return the hulls of pieces of tracks at both ends of their slices, as areas (n,) that are there all the time."""
    pieces = prepared.pieces
    own = pieces.take(rows)
    moving = Movement.of(prepared, rows, own.start_us)
    xy = [moving.positions(at) for at in (np.zeros(len(rows)), (own.end_us - own.start_us) / 1e6)]
    corners = np.concatenate(xy, axis=1).transpose(2, 1, 0)
    hulls = shapely.convex_hull(shapely.multipoints(corners))
    # The hull of a point track is a point or a line: it has no ring, and all of its vertices count.
    rings = shapely.get_exterior_ring(shapely.orient_polygons(hulls))
    has_ring = ~shapely.is_missing(rings)
    ring, owner = shapely.get_coordinates(np.where(has_ring, rings, hulls), return_index=True)
    is_last = np.ones(len(owner), np.bool_)
    is_last[:-1] = owner[1:] != owner[:-1]
    is_open = ~(is_last & has_ring[owner])
    offset = np.searchsorted(owner[is_open], np.arange(len(rows) + 1))
    zeros = np.zeros(len(rows), np.int64)
    return replace(
        own,
        kind=np.full(len(rows), Kind.AREA.code, np.int8),
        turn=np.zeros(len(rows), np.int16),
        shape_xy=ring[is_open],
        shape_to_xy=ring[is_open],
        shape_offset=offset,
        leg_start_us=zeros,
        leg_end_us=zeros,
    )


def _narrowed(shifts: Shifts, end: _Ints, gone_s: Floats) -> Shifts:
    """Return pairs with a part of one time: so many seconds from the start (0: of a, 2: of b) or to the end (1, 3)."""
    times = {name: getattr(shifts, name).copy() for name in ("a_start_s", "a_end_s", "b_start_s", "b_end_s")}
    for k, (member, is_last) in enumerate((("a", False), ("a", True), ("b", False), ("b", True))):
        rows = np.flatnonzero(end == k)
        start, stop = times[f"{member}_start_s"], times[f"{member}_end_s"]
        if is_last:
            start[rows] = np.maximum(stop[rows] - gone_s[rows], start[rows])
        else:
            stop[rows] = np.minimum(start[rows] + gone_s[rows], stop[rows])
    return replace(shifts, **times)
