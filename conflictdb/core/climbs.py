"""Times at which the heights of two pieces overlap, if either climbs (kernel/narrow/heights.c)."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.kernel.differences import Shifts
from conflictdb.kernel.height_overlaps import height_overlaps, level_times

_Ints = NDArray[np.int64]


def overlap_at_one_time(pieces: Pieces, a: PieceRows, b: PieceRows) -> tuple[Floats, Floats, Floats]:
    """Return when the heights of pairs (n,) overlap: first and last, seconds after the start of the shared span.

    Also return the errors of both: see `kernel.height_overlaps`.
    """
    if pieces.climbs().any():
        return height_overlaps(pieces, a, b)
    return np.full(len(a), -np.inf), np.full(len(a), np.inf), np.zeros(len(a))


def sharing_heights(pieces: Pieces, pairs: Pairs) -> Pairs:
    """Return the pairs whose heights overlap at some instant of their shared time."""
    if not pieces.climbs().any():
        return pairs
    first, last, _ = overlap_at_one_time(pieces, pairs.a, pairs.b)
    return pairs.take(PairRows(np.flatnonzero(first <= last)))


def with_heights(pieces: Pieces, shifts: Shifts) -> tuple[_Ints, Shifts, Floats]:
    """Return pairs of pieces with times of their own, cut to the times when their heights may overlap.

    Returns the rows (m,) of the remaining pairs, the pairs, and the errors (m,) of the ends of these times, seconds
    (`level_times`).
    """
    if not pieces.climbs().any():
        return np.arange(len(shifts)), shifts, np.zeros(len(shifts))
    times, doubt_s = level_times(pieces, shifts)
    left = np.flatnonzero((times["a_start_s"] <= times["a_end_s"]) & (times["b_start_s"] <= times["b_end_s"]))
    return left, replace(shifts, **times).take(left), doubt_s[left]


def bands_at(pieces: Pieces, rows: PieceRows, at_us: _Ints) -> tuple[Floats, Floats]:
    """Return the floor and the ceiling (n,) of pieces at an instant each."""
    start_us, end_us = pieces.leg_start_us[rows], pieces.leg_end_us[rows]
    share = (at_us - start_us) / np.maximum(end_us - start_us, 1)
    climb = pieces.climb_m[rows]
    level = climb[:, [0, 2]] == climb[:, [1, 3]]  # also infinite heights
    with np.errstate(invalid="ignore"):
        way = climb[:, [0, 2]] + (climb[:, [1, 3]] - climb[:, [0, 2]]) * share[:, None]
    floor, ceiling = np.where(level, climb[:, [0, 2]], way).T
    return floor, ceiling
