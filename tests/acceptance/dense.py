"""Random pairs of pieces of every workload, compared with dense samples of their motion (`support/sampling.c`).

    python tests/acceptance/dense.py --pairs 10000000 [--seed 1] [--workload "low latitude"] [--objects 120]

No sample may overlap outside of the contacts reported for its pair, nor be apart within a certain one. Pairs that the
broad phase dismissed are sampled, too. Prints a line per workload and every contradiction, and exits 1 if there is any.
"""

import argparse
import sys
import time
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support"), str(Path(__file__).resolve().parents[2])]

import numpy as np
from layouts import WORKLOADS, Workload
from mixed_scenes import plain_scene
from sampling import Sampled, sampled
from staged import Staged

from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.model.plans import EarthModel, Scene
from conflictdb.model.results import Kind, Verdict

TOLERANCES_M = (1.0, 0.0, 1.0, 100.0)
# Sampled pairs that the broad phase dismissed, per candidate pair.
DISMISSED = 0.5


@dataclass
class Count:
    """Counts of a check: candidate pairs, dismissed pairs, and answers."""

    pairs: int = 0
    dismissed: int = 0
    conflicts: int = 0
    grazing: int = 0
    unresolved: int = 0
    sampled: Sampled = field(default_factory=Sampled)

    def add(self, other: "Count") -> None:
        for name in ("pairs", "dismissed", "conflicts", "grazing", "unresolved"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.sampled.add(other.sampled)

    def __str__(self) -> str:
        return (
            f"{self.pairs} pairs ({self.dismissed} more that the broad phase dismissed), {self.conflicts} contacts, "
            f"{self.grazing} grazing, {self.unresolved} unresolved; {self.sampled.samples} samples, "
            f"{self.sampled.overlapping} of them overlap, {self.sampled.wrong} contradict"
        )


def check(workload: Workload, seed: int, objects: int) -> Count:
    """Throw one scene, solve its pairs of pieces with a track, and sample them."""
    rng = np.random.default_rng(seed)
    scene, pieces, near, found = solved(workload, seed, objects)
    far = _dismissed(pieces, near, rng, int(DISMISSED * len(near)))
    total = Count(len(near), len(far))
    for verdict, name in (
        (Verdict.CONFLICT, "conflicts"),
        (Verdict.GRAZING, "grazing"),
        (Verdict.UNRESOLVED, "unresolved"),
    ):
        setattr(total, name, int((found.verdict == verdict.code).sum()))
    for pairs, answers in ((near, found), (far, Contacts.none())):
        total.sampled.add(sampled(scene, pieces, pairs, answers, rng))
    return total


def solved(workload: Workload, seed: int, objects: int) -> tuple[Scene, Pieces, Pairs, Contacts]:
    """A scene, its pieces, its candidate pairs with a track, and their contacts."""
    earth, tolerance_m = list(EarthModel)[seed % 2], TOLERANCES_M[seed // 2 % len(TOLERANCES_M)]
    scene, areas, tracks = plain_scene(workload, seed, objects, objects, earth, tolerance_m)
    staged = Staged.of(scene, areas, tracks)
    staged = replace(staged, pairs=_moving(staged.pieces, staged.pairs))
    return scene, staged.pieces, staged.pairs, staged.contacts()[0]


def _moving(pieces: Pieces, pairs: Pairs) -> Pairs:
    """The pairs with a track."""
    moves = pieces.kind == Kind.TRACK.code
    return pairs.take(PairRows(np.flatnonzero(moves[pairs.a] | moves[pairs.b])))


def _dismissed(pieces: Pieces, near: Pairs, rng: np.random.Generator, most: int) -> Pairs:
    """At most `most` pairs with a track that share time and are not candidates."""
    a, b = np.sort(rng.integers(len(pieces), size=(2, 4 * most)), axis=0)
    known = np.isin(a * len(pieces) + b, np.minimum(near.a, near.b) * len(pieces) + np.maximum(near.a, near.b))
    other = (pieces.kind[a] != pieces.kind[b]) | (pieces.object_id[a] != pieces.object_id[b])
    other &= (pieces.turn[a] == 0) | (pieces.turn[b] == 0)
    start, end = pieces.shared_span(PieceRows(a), PieceRows(b))
    rows = np.flatnonzero(~known & other & (start < end))[:most]
    pairs = Pairs(PieceRows(a[rows]), PieceRows(b[rows]), np.empty((0, 2)), np.zeros(len(rows) + 1, np.int64))
    return _moving(pieces, pairs)


def main() -> int:
    """Sample as many pairs as the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=100_000, help="in all, default 100000")
    parser.add_argument("--seed", type=int, default=1, help="of the first scene, default 1")
    parser.add_argument("--objects", type=int, default=120, help="areas, and as many tracks, per scene")
    parser.add_argument("--workload", action="append", choices=[w.name for w in WORKLOADS])
    options = parser.parse_args()
    chosen = [w for w in WORKLOADS if not options.workload or w.name in options.workload]
    every = Count()
    for workload in chosen:
        total, began = Count(), time.process_time()
        for seed in count(options.seed):
            one = check(workload, seed, options.objects)
            for line in one.sampled.problems:
                sys.stdout.write(f"  {workload.name}, seed {seed}: {line}\n")
            total.add(one)
            if total.pairs * len(chosen) >= options.pairs:
                break
        sys.stdout.write(f"{workload.name}: {total}; {time.process_time() - began:.0f} s\n")
        sys.stdout.flush()
        every.add(total)
    sys.stdout.write(f"all: {every}\n")
    return int(every.sampled.wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
