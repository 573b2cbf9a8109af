"""What stage 4 costs per pair of pieces that reaches it: the exact method, its parts, and the published program.

    ./.venv/bin/python benchmarks/stage4.py [--scenes 40] [--tracks 60] [--programs 40]

Tracks of the paper's workload with rectangular havens, tolerance 0, one process. Every figure is processor time, the
least of several rounds in which all take turns: *exact* with everything it takes from pieces to contacts, *first step*
the certified windows alone (with the motion at both ends), *uniform* the exact method on pairs that move uniformly (the
same tracks laid along the equator), *closed form* of that the formula alone, from polygons and velocities, *SLSQP* the
published program on a few of the pairs that are in conflict, and as many that are not.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from numpy.typing import NDArray
from workloads import HIGH_LATITUDE, LONG_LEGS, PAPER, Workload, throw

from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.model import EarthModel, Scene, Track
from conflictdb.motion.contract import shape_class
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.cutting import track_pieces
from conflictdb.stage1_broad_phase import candidates
from conflictdb.stage2_intersection import intersections
from conflictdb.stage3_projection import shared_span
from conflictdb.stage4.constants import TOUCH_M
from conflictdb.stage4.contacts import contacts
from conflictdb.stage4.distance import edge_gaps
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.exact.solver import BLOCK, Work, solve_exactly
from conflictdb.stage4.exact.touching import Touching, closed_form
from conflictdb.stage4.outcomes import Outcome
from conflictdb.stage4.published.nonlinear_program import extreme_contact

ROUNDS = 5


class FirstStep(Touching):
    """The certified window of every pair, and no more."""

    most_windows: ClassVar[int] = 1

    def _depth(self, pairs: Encounters, t: Floats, smallest: Floats) -> Floats:
        return np.ones(len(t))


@dataclass(frozen=True)
class Load:
    """Pairs of pieces whose shapes share arrays."""

    scene: Scene
    pieces: Pieces
    pairs: Pairs
    start_us: NDArray[np.int64]
    span_s: Floats

    def encounters(self) -> Encounters:
        """Return the pairs as encounters."""
        rows = np.arange(len(self.pairs))
        return Encounters.of(plane_of(self.scene), 0.0, self.pieces, self.pairs, rows, self.start_us)


def along_the_equator(track: Track) -> Track:
    """Return the track with all its waypoints on the equator."""
    return replace(track, positions_deg=track.positions_deg * np.array([1.0, 0.0]))


def load(workload: Workload, earth: EarthModel, scenes: int, tracks: int, *, equatorial: bool) -> Load:
    """Return the largest group of like pairs of some scenes."""
    parts, firsts, seconds, count = [], [], [], 0
    scene = Scene("stage 4", earth=earth, tolerance_m=0.0)
    for seed in range(scenes):
        _, _, thrown = throw(replace(workload, odd_share=0.0), seed, 0, tracks, earth)
        if equatorial:
            thrown = [along_the_equator(track) for track in thrown]
        pieces = track_pieces(scene, plane_of(scene), TrackBatch.of(thrown))
        found = intersections(pieces, *candidates(pieces), regions=False)
        parts.append(pieces)
        firsts.append(found.a + count)
        seconds.append(found.b + count)
        count += len(pieces)
    pieces = Pieces.concatenate(parts)
    a, b = np.concatenate(firsts), np.concatenate(seconds)
    classes = shape_class(plane_of(scene), pieces)
    key = classes[a] * (classes.max() + 1) + classes[b]
    kinds, counts = np.unique(key, return_counts=True)
    rows = np.flatnonzero(key == kinds[counts.argmax()])
    pairs = Pairs(a[rows], b[rows], np.empty((0, 2)), np.zeros(len(rows) + 1, np.int64))
    start, end = shared_span(pieces, pairs)
    return Load(scene, pieces, pairs, start, (end - start) / 1e6)


def spent(work: Callable[[], object]) -> float:
    """Return the seconds of processor time that some work takes."""
    before = time.process_time()
    work()
    return time.process_time() - before


def exact(loaded: Load) -> None:
    """Settle all pairs, from pieces to contacts."""
    contacts(
        loaded.scene, plane_of(loaded.scene), loaded.pieces, loaded.pairs, np.zeros(len(loaded.pairs)), loaded.span_s
    )


def first_step(pairs: Encounters, span_s: Floats) -> None:
    """Certify a window for every pair."""
    for first in range(0, len(pairs), BLOCK):
        rows = np.arange(first, min(first + BLOCK, len(pairs)))
        FirstStep(pairs.take(rows), np.zeros(len(rows)), span_s[rows], TOUCH_M, Work()).settle()


def formula(pairs: Encounters, span_s: Floats) -> Callable[[], None]:
    """Return the closed form of pairs whose polygons and velocities are known."""
    blocks = []
    for first in range(0, len(pairs), BLOCK):
        some, span = pairs.take(slice(first, first + BLOCK)), span_s[first : first + BLOCK]
        a, b = some.a.positions(0.5 * span), some.b.positions(0.5 * span)
        velocity = some.b.velocity(0.5 * span) - some.a.velocity(0.5 * span)
        blocks.append((some, a, b, velocity, 0.5 * span, np.full(len(span), 2.0 * TOUCH_M)))

    def work() -> None:
        for some, a, b, velocity, half, slack in blocks:
            closed_form(edge_gaps(some, a, b), velocity, -half, half, slack, slack)

    return work


def program(pairs: Encounters, rows: NDArray[np.int64], span_s: Floats) -> None:
    """Ask the published nonlinear program for both ends of each pair."""
    for row in rows.tolist():
        pair = pairs.take(np.array([row]))
        for latest in (False, True):
            extreme_contact(pair, 0.0, float(span_s[row]), latest=latest)


def main() -> None:
    """Measure and print one row per workload and earth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--tracks", type=int, default=60, help="tracks per scene")
    parser.add_argument("--programs", type=int, default=40, help="pairs that the program is asked about")
    args = parser.parse_args()
    print(
        f"{'workload':>15} {'earth':>7} {'pairs':>7} {'meet':>5} {'exact':>9} {'first step':>10} {'uniform':>8} "
        f"{'closed form':>11} {'SLSQP':>9} {'SLSQP/exact':>11} {'windows':>8} {'evaluations':>11} {'undecided':>11} "
        "  (us a pair)"
    )
    for workload in (PAPER, HIGH_LATITUDE, LONG_LEGS):
        for earth in EarthModel:
            loaded = load(workload, earth, args.scenes, args.tracks, equatorial=False)
            uniform = load(workload, earth, args.scenes, args.tracks, equatorial=True)
            pairs, level = loaded.encounters(), uniform.encounters()
            work = Work()
            solution = solve_exactly(pairs, np.zeros(len(pairs)), loaded.span_s, TOUCH_M, work)
            rng = np.random.default_rng(0)
            half = args.programs // 2
            chosen = np.concatenate(
                [
                    rng.permutation(np.flatnonzero(solution.ended(Outcome.CONTACT)))[:half],
                    rng.permutation(np.flatnonzero(solution.ended(Outcome.SEPARATED)))[:half],
                ]
            )
            level_work = Work()
            solve_exactly(level, np.zeros(len(level)), uniform.span_s, TOUCH_M, level_work)
            if level_work.closed_forms != len(level):
                raise SystemExit(
                    f"only {level_work.closed_forms} of {len(level)} equatorial pairs took the closed form"
                )
            least = np.full(5, np.inf)
            for _ in range(ROUNDS):
                rounds = (
                    spent(lambda loaded=loaded: exact(loaded)) / len(pairs),
                    spent(lambda pairs=pairs, loaded=loaded: first_step(pairs, loaded.span_s)) / len(pairs),
                    spent(
                        lambda level=level, uniform=uniform: solve_exactly(
                            level, np.zeros(len(level)), uniform.span_s, TOUCH_M, Work()
                        )
                    )
                    / len(level),
                    spent(formula(level, uniform.span_s)) / len(level),
                    spent(lambda pairs=pairs, loaded=loaded, chosen=chosen: program(pairs, chosen, loaded.span_s))
                    / max(len(chosen), 1),
                )
                least = np.minimum(least, rounds)
            whole, first, level_us, closed, slsqp = 1e6 * least
            print(
                f"{workload.name:>15} {earth:>7} {len(pairs):>7,} {solution.ended(Outcome.CONTACT).mean():>5.0%} "
                f"{whole:>9.2f} {first:>10.2f} {level_us:>8.2f} {closed:>11.2f} {slsqp:>9,.0f} {slsqp / whole:>11,.0f} "
                f"{work.windows / len(pairs):>8.2f} {work.evaluations / len(pairs):>11.2f} "
                f"{solution.ended(Outcome.UNDECIDED).mean():>11.3%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
