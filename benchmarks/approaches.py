"""Cost of a closest approach per pair of objects, and of a first contact point per contact.

    ./.venv/bin/python benchmarks/approaches.py [--scenes 10] [--objects 12]

Areas and tracks of every shape, in equal numbers, in scenes of random workloads. *candidates* are pairs of objects
whose hulls of pieces come within 50 km (in harbours 1 km) of each other. Times are processor time of one thread,
microseconds, the least of several rounds. *median*, *mean* and *90 %* are of the candidates that come within that
distance without touching (*near*). *touch* is the median of candidates that touch, *far* of candidates that are further
away. *place* is per first contact point of a pair of pieces. *error* and *worst* are the median and the largest error
of the distance that the search leaves, millimetres. *threads* is the speed-up by two threads, by the clock.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from layouts import GROWING, HARBOUR, HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE, OCEAN, Workload
from mixed_scenes import plain_scene
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.object_pairs import object_keys
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.core.stage2_intersection import intersections
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.kernel.approach import Closest, closest
from conflictdb.kernel.meeting import meetings
from conflictdb.model.plans import EarthModel, Motion

ROUNDS = 5
# Repetitions of the first contact points, so that the clock resolves their time.
TIMES = 100
# Copies of the candidates, so that two threads have enough work.
CROWD = 4


@dataclass(frozen=True)
class Load:
    """Pairs of pieces, grouped by their objects: those of group k are [offset[k], offset[k + 1])."""

    scene: kernel.KernelScene
    plane: Plane
    a: PieceRows
    b: PieceRows
    start_us: NDArray[np.int64]
    span_s: Floats
    offset: NDArray[np.int64]

    @classmethod
    def of(cls, workload: Workload, scenes: int, objects: int, earth: EarthModel, nearest_m: float) -> "Load":
        """Return the candidates of some scenes, side by side."""
        parts, firsts, seconds, groups, count, number = [], [], [], [], 0, 0
        for seed in range(scenes):
            scene, areas, tracks = plain_scene(workload, seed, objects, objects, earth)
            scene = replace(scene, nearest_m=nearest_m)
            setup = Setup.of(scene)
            pieces = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of(tracks))
            found = intersections(pieces, *candidates(pieces), regions=False)
            found = found.take(np.flatnonzero((pieces.kind[found.a] == 1) | (pieces.kind[found.b] == 1)))
            _, group = np.unique(object_keys(pieces, found.a, found.b), axis=1, return_inverse=True)
            order = np.argsort(group, kind="stable")
            parts.append(pieces)
            firsts.append(found.a[order] + count)
            seconds.append(found.b[order] + count)
            groups.append(group[order] + number)
            count, number = count + len(pieces), number + int(group.max(initial=-1)) + 1
        pieces = Pieces.concatenate(parts)
        a, b = PieceRows(np.concatenate(firsts)), PieceRows(np.concatenate(seconds))
        start, end = pieces.shared_span(a, b)
        offset = np.searchsorted(np.concatenate(groups), np.arange(number + 1))
        prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces, a, b)
        return cls(prepared, setup.plane, a, b, start, (end - start) / 1e6, offset)

    def closest(self, nearest_m: float, first: int, last: int, times: int = 1, threads: int = 1) -> Closest:
        """Return the closest approaches of candidates [first, last)."""
        rows = slice(int(self.offset[first]), int(self.offset[last]))
        columns = [column[rows] for column in (self.a, self.b, self.start_us, self.span_s)]
        a, b, start, span = (np.tile(column, times) for column in columns)
        size = np.tile(np.diff(self.offset[first : last + 1]), times)
        offset, wanted = np.concatenate([[0], np.cumsum(size)]), np.full(len(size), nearest_m)
        return closest(
            self.scene,
            a,
            b,
            start,
            np.zeros(len(a)),
            span,
            offset,
            wanted,
            np.zeros(len(wanted)),
            kernel.Work(),
            threads,
        )


def spent(work: Callable[[], object], clock: Callable[[], float] = time.process_time) -> float:
    """Return the least seconds that some work takes."""
    least = np.inf
    for _ in range(ROUNDS):
        before = clock()
        work()
        least = min(least, clock() - before)
    return float(least)


def each_us(load: Load, nearest_m: float) -> Floats:
    """Return (g,) microseconds of each candidate by itself, less those of a call that finds nothing to do."""
    nothing_s = spent(lambda: load.closest(nearest_m, 0, 0))
    groups = range(len(load.offset) - 1)
    seconds = [spent(partial(load.closest, nearest_m, k, k + 1)) for k in groups]
    return np.maximum(1e6 * (np.array(seconds) - nothing_s), 0.0)


def place_us(load: Load, found: Closest) -> float:
    """Return the microseconds of a first contact point, of those candidates that touch."""
    touch = np.flatnonzero(found.distance_m == 0.0)
    rows = np.tile(found.pair[touch], TIMES)
    columns = load.a[rows], load.b[rows], load.start_us[rows], np.tile(found.at_s[touch], TIMES)
    return 1e6 * spent(lambda: meetings(load.scene, *columns)) / max(len(rows), 1)


def row(load: Load, nearest_m: float) -> str:
    """Return the results for a load, as the columns of the table."""
    count = len(load.offset) - 1
    found, each = load.closest(nearest_m, 0, count), each_us(load, nearest_m)
    is_far, touch = np.isinf(found.distance_m), found.distance_m == 0.0
    near = ~is_far & ~touch
    left_mm = 1e3 * (found.error_m[near] - load.plane.distance_error_m(found.distance_m[near]))
    costs = (
        np.median(each[near]),
        each[near].mean(),
        np.quantile(each[near], 0.9),
        *map(np.median, (each[touch], each[is_far])),
    )
    one, two = (clock_s(load, nearest_m, threads) for threads in (1, 2))
    return (
        f"{count:>10,} {near.sum():>5,} "
        + " ".join(f"{value:>7.0f}" for value in costs)
        + f" {place_us(load, found):>7.2f} {np.median(left_mm):>7.3f} {left_mm.max():>7.2f} {one / two:>7.2f}"
    )


def clock_s(load: Load, nearest_m: float, threads: int) -> float:
    """Return the seconds by the clock for all candidates, several times over."""
    count = len(load.offset) - 1
    return spent(lambda: load.closest(nearest_m, 0, count, CROWD, threads), time.perf_counter)


def main() -> None:
    """Measure and print one row per workload and earth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=10)
    parser.add_argument("--objects", type=int, default=12, help="areas, and as many tracks, per scene")
    args = parser.parse_args()
    names = ("median", "mean", "90 %", "touch", "far", "place", "error", "worst", "threads")
    print(f"{'workload':>14} {'earth':>6} {'candidates':>10} {'near':>5} " + " ".join(f"{name:>7}" for name in names))
    for workload in (LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS, GROWING, HARBOUR, OCEAN):
        earths = [EarthModel.SPHERE] if workload.motion is Motion.GREAT_CIRCLE else list(EarthModel)
        nearest_m = 1e3 if workload is HARBOUR else 5e4
        for earth in earths:
            # Scenes of great circles have planes of their own: one scene, with more in it.
            many = (1, 3 * args.objects) if workload.motion is Motion.GREAT_CIRCLE else (args.scenes, args.objects)
            load = Load.of(workload, *many, earth, nearest_m)
            print(f"{workload.name:>14} {earth.value:>6} {row(load, nearest_m)}", flush=True)


if __name__ == "__main__":
    main()
