"""Cost of stage 4 per pair of pieces that reaches it: the exact method, its parts, and the published program.

    ./.venv/bin/python benchmarks/stage4.py [--scenes 40] [--tracks 60] [--programs 40]

Full batches (tracks of a workload with rectangular havens) and mixed ones (areas and tracks of every shape), WGS84,
tolerance 0. Times are processor time, microseconds a pair, the least of several rounds. *whole* is from pieces to
contacts, *kernel* the kernel alone. *500 m* and *5 km* are the same with a separation, *~1 m* to *~1000 m* with a
tolerance. *uniform* is on the same tracks along the equator (the closed form). *SLSQP* is the published program on a
few pairs in conflict, and as many that are not. *prepare* is per piece, not per pair. *threads* is the speed-up by two
threads, by the clock, for as many pairs as a detection solves at once, the same pairs repeatedly.
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
from layouts import HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE, Workload
from mixed_scenes import plain_scene
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.published.encounters import Encounters
from conflictdb.core.published.nonlinear_program import extreme_contact
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.core.stage2_intersection import intersections
from conflictdb.core.stage4.constants import PAIRS_AT_ONCE
from conflictdb.core.stage4.contact_search import contacts
from conflictdb.earth.registry import Setup
from conflictdb.kernel import Questions, Work
from conflictdb.model.plans import EarthModel, Scene, Track

ROUNDS = 5
TOLERANCES_M = (1, 10, 100, 1000)


@dataclass(frozen=True)
class Load:
    """Pairs of pieces, at least one of them of a track."""

    scene: Scene
    pieces: Pieces
    pairs: Pairs
    start_us: NDArray[np.int64]
    span_s: Floats

    def prepared(self) -> kernel.KernelScene:
        """Return the pieces as the kernel takes them."""
        return kernel.KernelScene(Setup.of(self.scene).plane.kernel_plane, self.pieces, self.pairs.a, self.pairs.b)

    def questions(self, times: int = 1) -> Questions:
        """Return the kernel's questions about all pairs, `times` times over."""
        zero = np.zeros(len(self.pairs))
        columns = self.pairs.a, self.pairs.b, self.start_us, zero, self.span_s, zero + np.inf
        return Questions(*(np.tile(column, times) for column in columns))

    def solved(self, prepared: kernel.KernelScene, separation_m: float = 0.0, tolerance_m: float = 0.0) -> Contacts:
        """Ask the kernel about all pairs."""
        return kernel.contacts(prepared, self.questions(), separation_m, tolerance_m, Work())

    def contacts(self) -> None:
        """Find all contacts, from pieces on."""
        nought = np.zeros(len(self.pairs))
        contacts(Setup.of(self.scene), self.prepared(), self.pairs, nought, self.span_s)

    def ask_program(self, rows: NDArray[np.int64]) -> None:
        """Ask the published nonlinear program for both ends of some pairs."""
        plane, prepared = Setup.of(self.scene).plane, self.prepared()
        for row in rows:
            some = np.array([row])
            pair = Encounters.of(plane, 0.0, prepared, self.pairs, some, self.start_us[some])
            for latest in (False, True):
                extreme_contact(pair, 0.0, float(self.span_s[row]), latest=latest)


def along_the_equator(track: Track) -> Track:
    """Return the track with all its waypoints on the equator."""
    return replace(track, positions_deg=track.positions_deg * np.array([1.0, 0.0]))


def load(workload: Workload, scenes: int, areas: int, tracks: int, *, equatorial: bool = False) -> Load:
    """Return the pairs of some scenes, side by side; without areas all havens are rectangles."""
    parts, firsts, seconds, count = [], [], [], 0
    scene = Scene("stage 4", earth=EarthModel.WGS84, tolerance_m=0.0)
    thrown_from = workload if areas else replace(workload, odd_share=0.0)
    for seed in range(scenes):
        _, standing, moving = plain_scene(thrown_from, seed, areas, tracks, EarthModel.WGS84)
        if equatorial:
            moving = [along_the_equator(track) for track in moving]
        pieces = pieces_of(Setup.of(scene), AreaBatch.of(standing), TrackBatch.of(moving))
        found = intersections(pieces, *candidates(pieces), regions=False)
        found = found.take(np.flatnonzero((pieces.kind[found.a] == 1) | (pieces.kind[found.b] == 1)))
        parts.append(pieces)
        firsts.append(found.a + count)
        seconds.append(found.b + count)
        count += len(pieces)
    pieces = Pieces.concatenate(parts)
    a, b = np.concatenate(firsts), np.concatenate(seconds)
    pairs = Pairs(a, b, np.empty((0, 2)), np.zeros(len(a) + 1, np.int64))
    start, end = pieces.shared_span(pairs.a, pairs.b)
    return Load(scene, pieces, pairs, start, (end - start) / 1e6)


def spent(work: Callable[[], object], clock: Callable[[], float] = time.process_time) -> float:
    """Return the seconds that some work takes."""
    before = clock()
    work()
    return clock() - before


def main() -> None:
    """Measure and print one row per batch and workload."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--tracks", type=int, default=60, help="tracks per scene of a full batch")
    parser.add_argument("--programs", type=int, default=40, help="pairs that the program is asked about")
    args = parser.parse_args()
    names = ["whole", "kernel", "500 m", "5 km", *(f"~{tolerance_m} m" for tolerance_m in TOLERANCES_M)]
    names += ["uniform", "SLSQP", "prepare", "threads"]
    print(f"{'batch':>6} {'workload':>15} {'pairs':>7} {'meet':>5} " + " ".join(f"{name:>8}" for name in names))
    for areas, tracks in ((0, args.tracks), (10, 10)):
        for workload in (LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS):
            given = load(workload, args.scenes, areas, tracks)
            uniform = load(workload, args.scenes, areas, tracks, equatorial=True)
            prepared, level = given.prepared(), uniform.prepared()
            met = np.unique(given.solved(prepared).pair)
            rng = np.random.default_rng(0)
            some = (met, np.setdiff1d(np.arange(len(given.pairs)), met))
            chosen = np.concatenate([rng.permutation(rows)[: args.programs // 2] for rows in some])
            works: list[tuple[Callable[[], object], int]] = [
                (given.contacts, len(given.pairs)),
                (lambda given=given, prepared=prepared: given.solved(prepared), len(given.pairs)),
                (lambda given=given, prepared=prepared: given.solved(prepared, 500.0), len(given.pairs)),
                (lambda given=given, prepared=prepared: given.solved(prepared, 5000.0), len(given.pairs)),
                *(
                    (partial(given.solved, prepared, tolerance_m=tolerance_m), len(given.pairs))
                    for tolerance_m in TOLERANCES_M
                ),
                (lambda uniform=uniform, level=level: uniform.solved(level), len(uniform.pairs)),
                (lambda given=given, chosen=chosen: given.ask_program(chosen), max(len(chosen), 1)),
                (given.prepared, len(np.unique(np.concatenate([given.pairs.a, given.pairs.b])))),
            ]
            least, clocks = np.full(len(works), np.inf), np.full(2, np.inf)
            many = given.questions(-(-PAIRS_AT_ONCE // len(given.pairs)))
            for _ in range(ROUNDS):
                least = np.minimum(least, [spent(work) / count for work, count in works])
                for k in (0, 1):
                    solve = partial(kernel.contacts, prepared, many, 0.0, 0.0, Work(), threads=k + 1)
                    clocks[k] = min(clocks[k], spent(solve, time.perf_counter))
            meet = len(met) / len(given.pairs)
            print(
                f"{'mixed' if areas else 'full':>6} {workload.name:>15} {len(given.pairs):>7,} {meet:>5.0%} "
                + " ".join(f"{value:>8.2f}" for value in (*(1e6 * least), clocks[0] / clocks[1])),
                flush=True,
            )


if __name__ == "__main__":
    main()
