"""Directions that prove pairs apart, and the boxes of docs/reference/proof.md."""

import ctypes
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.kernel.header import record
from conflictdb.kernel.kernel_scene import HeldPairs, HeldWork, KernelScene, Work
from conflictdb.kernel.library import address, check, library, shared, taken
from conflictdb.kernel.movement import HeldRows, Movement

_Ints = NDArray[np.int64]
# KernelDirection.
_DIRECTION: Final = record("KernelDirection")


@dataclass(frozen=True, slots=True)
class Directions:
    """Steps of proofs that n pairs are apart, in order of pair and time.

    pair : (m,) row of the pair
    until_s : (m,) seconds from the pair's zero; each step begins where the one before ends, the first at low_s
    angle : (m,) of the direction that keeps the pair apart, from a to b, radians; NaN: not proven
    """

    pair: _Ints
    until_s: Floats
    angle: Floats

    def __len__(self) -> int:
        return len(self.pair)


def directions(
    scene: KernelScene,
    a: _Ints,
    b: _Ints,
    zero_us: _Ints,
    low_s: Floats,
    high_s: Floats,
    separation_m: float,
    work: Work,
    threads: int = 1,
) -> Directions:
    """Return proofs that pairs a, b (n,) are farther apart than separation_m during [low_s, high_s].

    work : work counters, increased
    """
    pairs = HeldPairs.arrays(a, b, zero_us, low_s, high_s)

    def solve(rows: slice) -> tuple[NDArray[Any], HeldWork]:
        held, found, count, done = HeldPairs.of(pairs, rows), ctypes.c_void_p(), ctypes.c_int64(), HeldWork()
        results = (ctypes.byref(given) for given in (found, count, done))
        check(library().kernel_directions(scene.handle, ctypes.byref(held), separation_m, *results))
        items = taken(found, count, _DIRECTION)
        items["pair"] += rows.start
        return items, done

    parts = shared(solve, len(a), threads, vertices=scene.vertices(a, b))
    work.evaluations += sum(done.evaluations for _, done in parts)
    items = np.concatenate([np.empty(0, _DIRECTION), *(items for items, _ in parts)])
    return Directions(*(items[name].copy() for name in ("pair", "until_s", "angle")))


def proof_boxes(movement: Movement, t0: Floats, t1: Floats, separation_m: float) -> Floats:
    """Return boxes (n, 4) that contain pieces during [t0, t1], (n,) both: two that do not meet are apart; NaN: unknown.

    min x, min y, max x, max y, plane metres from the origins
    """
    t0, t1 = (np.ascontiguousarray(t, np.float64) for t in (t0, t1))
    found = np.empty((len(movement.piece), 4))
    rows = HeldRows.of(movement)
    given = address(t0), address(t1), separation_m, address(found)
    check(library().kernel_proof_boxes(movement.scene.handle, ctypes.byref(rows), *given))
    return found
