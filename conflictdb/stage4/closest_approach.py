"""Stage 4, closest approach (CPA): when, where and how close two objects come, metres on the earth, by the kernel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.pairs import PairRows
from conflictdb.arrays.pieces import PieceRows
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.approach import closest
from conflictdb.model import MINUS_INFINITY_US
from conflictdb.results import Kind


@dataclass(frozen=True, slots=True)
class Approaches:
    """The closest approach of n pairs of objects.

    pair, at_s : (n,) the pair of pieces that comes closest, and the seconds after the start of its shared span; -1
        where none is within what was asked, and where that is not known
    at_us : (n,) int64, the same in microseconds since 1970; MINUS_INFINITY_US for areas that are always there
    distance_m : (n,) metres on the earth, 0 where they touch; infinite where they are not within what was asked, NaN
        where that cannot be told, as a piece is of no numbers or the work of distances is used up
    error_m : (n,) bound on how far distance_m is from the least distance, either way, metres
    a_deg, b_deg : (n, 2) longitude (in [-180, 180)) and latitude of the nearest points, or where they touch; NaN where
        there are none
    """

    pair: PairRows
    at_s: Floats
    at_us: NDArray[np.int64]
    distance_m: Floats
    error_m: Floats
    a_deg: Floats
    b_deg: Floats


def approaches(
    prepared: kernel.Scene,
    a: PieceRows,
    b: PieceRows,
    first_s: Floats,
    last_s: Floats,
    group: NDArray[np.int64],
    wanted_m: Floats,
    aim_m: Floats,
    work: kernel.Work,
    threads: int = 1,
) -> Approaches:
    """Return how close pairs of objects come during times, of what they share.

    Both ends of a time count, also one that does not belong to it: the distance tends to what it is there.

    prepared : the pieces of the pairs
    a, b : (n,) the pieces of each pair
    first_s, last_s : (n,) the times, seconds after the start of what the pieces share; may end after that
    group : (n,) of which pair of objects each pair of pieces is
    wanted_m : (g,) for each pair of objects, the distance beyond which nothing needs to be known, metres
    aim_m : (g,) how well the distance needs to be known, metres; 0: as well as it can be
    work : counts what is done
    threads : of the kernel; the answer does not depend on it
    """
    pieces = prepared.pieces
    order = np.argsort(group, kind="stable")
    a, b = PieceRows(a[order]), PieceRows(b[order])
    start_us, end_us = pieces.shared_span(a, b)
    still = (pieces.kind[a] == Kind.AREA.code) & (pieces.kind[b] == Kind.AREA.code)
    span_s = np.where(still, 0, end_us - np.where(still, end_us, start_us)) / 1e6
    offset = np.searchsorted(group[order], np.arange(len(wanted_m) + 1))
    low_s, high_s = np.clip(first_s[order], 0.0, span_s), np.clip(last_s[order], 0.0, span_s)
    found = closest(prepared, a, b, start_us, low_s, high_s, offset, wanted_m, aim_m, work, threads)
    known = np.flatnonzero(found.pair >= 0)
    pair, at_us = np.full(len(wanted_m), -1), np.full(len(wanted_m), MINUS_INFINITY_US)
    pair[known] = order[found.pair[known]]
    at_us[known] = start_us[found.pair[known]] + np.rint(found.at_s[known] * 1e6).astype(np.int64)
    answers = found.distance_m, found.error_m, found.a_deg, found.b_deg
    return Approaches(PairRows(pair), found.at_s, at_us, *answers)
