"""Stage 4, closest approach (CPA): when, where and how close two objects come, metres on the earth, by the kernel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows
from conflictdb.kernel.approach import Closest, closest
from conflictdb.model.plans import MINUS_INFINITY_US
from conflictdb.model.results import Kind


@dataclass(frozen=True, slots=True)
class Approaches(Closest):
    """The closest approach of n pairs of objects; `at_s` counts from the start of the shared span.

    at_us : (n,) int64, the same in microseconds since 1970; MINUS_INFINITY_US for areas that are always there
    """

    at_us: NDArray[np.int64]


def approaches(
    prepared: kernel.KernelScene,
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
    """Return the closest approaches of pairs of objects during parts of their shared time.

    Both ends of a time count, also an exclusive one: the distance there is the limit of the distances before.

    prepared : the pieces of the pairs
    a, b : (n,) the pieces of each pair
    first_s, last_s : (n,) the times, seconds after the start of the shared span; clipped to it
    group : (n,) the pair of objects of each pair of pieces
    wanted_m : (g,) limit of each pair of objects: larger distances are not computed, metres
    aim_m : (g,) error bound to reach, metres; 0: as small as possible
    work : counts the work
    threads : of the kernel
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
    answers = found.at_s, found.distance_m, found.error_m, found.a_deg, found.b_deg
    return Approaches(pair, *answers, at_us)
