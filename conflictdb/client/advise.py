"""Advise on settings: what each costs and loses, from pairs of a scene's objects that are solved with each of them.

Stage 1 finds all pairs of objects that come near each other: within the scene's tolerance, or 10 m. Some are drawn,
without repetition and with equal chance, and solved with each setting. The reference answer is method `exact` at
tolerance 0 on the same pairs.

Seconds are processor time on this machine for a full detection that changes every row, as after a change of method.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import PairRows
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.client.estimates import Count, Estimate, Proportion, Trial, duration, recommendation
from conflictdb.core.near import Chunk, Memory, Question
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.run import run_stages
from conflictdb.core.stage2_intersection import intersections
from conflictdb.core.world import World, warn_of_unknown
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.model import inputs
from conflictdb.model.methods import METHODS, Method
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Verdict

__all__ = ["Advice", "Estimate", "Trial", "advise"]

TRIED: Final = (Method.SCREEN, Method.EXACT)
TOLERANCES_M: Final = (0.0, 1.0, 10.0)  # besides the scene's own
REFERENCE: Final = Trial(Method.EXACT, 0.0)
# Default number of drawn pairs of objects: shares within 5 %, and an answer within seconds.
SAMPLE: Final = 500
# Average number of pairs of pieces in a sample: one pair of areas with coastlines has thousands.
PIECE_PAIRS: Final = 3_000
# The sample is repeated until it has as many pairs of pieces as the scene, or this many: fixed costs of a batch then
# weigh as in a detection.
BATCH: Final = 20_000
# Pieces are built this often, within this time, seconds; the shortest time counts.
TRIES: Final = 3
TRIES_S: Final = 0.5

# Cost of the database, in units of the seconds for one piece in memory: from full detections of 600 to 5,000 objects
# with PostgreSQL 15 that changed every row (benchmarks/advice.py). Another scene or disk may halve or double it.
DATABASE_PER_PIECE: Final = 4.7  # its row in, the marks; stage 1; its pairs and pieces out
TEST_PER_CANDIDATE: Final = 0.04  # stage 2
WRITE_PER_CONFLICT: Final = 4.5
# For a conflict whose region the kernel leaves open, as next to a pole: the database computes it from the hulls.
REGION_PER_CONFLICT: Final = 100.0
FIXED_S: Final = 0.03  # transactions, statistics, temporary tables

_ANSWER: Final = np.dtype([("first_us", "i8"), ("last_us", "i8"), ("error_s", "f8"), ("found", "?"), ("open", "?")])


@dataclass(frozen=True, slots=True)
class Advice:
    """The cost and error of each setting for a scene, with a recommendation.

    scene : its settings
    seed : of the draws; the same seed draws the same sample
    objects : of the scene
    pairs : pairs of objects that come near each other
    sampled_pairs : pairs drawn from them
    undecided_pairs : drawn pairs that the reference leaves unresolved
    estimates : by method and tolerance; empty if there is nothing to detect
    recommendation : one or two sentences
    """

    scene: Scene
    seed: int
    objects: int
    pairs: int
    sampled_pairs: int
    undecided_pairs: int
    estimates: tuple[Estimate, ...]
    recommendation: str

    def _repr_html_(self) -> str:
        from conflictdb.model import notebook

        header = ["method", "tolerance", "cost", "conflicts", "never meet", "unresolved"]
        rows = [
            [
                str(one.setting.method),
                f"{one.setting.tolerance_m:g} m",
                duration(one.seconds),
                f"{one.conflicts.value:,.0f}",
                str(one.false_share),
                str(one.unresolved_share),
            ]
            for one in self.estimates
        ]
        return f"<p>{notebook.text_of(self.recommendation)}</p>" + notebook.rows_html(header, rows)


def advise(
    scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], *, sample: int = SAMPLE, seed: int = 0
) -> Advice:
    """Return the estimated cost and error of each setting for a scene.

    sample : pairs of objects to draw, at least 1; fewer are drawn if they have very many pieces
    seed : 0 or more; the same objects and seed give the same sample and the same counts, but not the same seconds
    """
    inputs.count("advise", "sample", sample, 1)
    inputs.count("advise", "seed", seed, 0)
    count = len(areas) + len(tracks)
    if not count:
        return Advice(scene, seed, 0, 0, 0, 0, (), "the scene holds no objects: there is nothing to detect.")
    if scene.rules:
        raise InvalidInput("advise", "rules", "costs are not estimated with separation rules: remove them from a copy")
    warn_of_unknown([*areas, *tracks])
    setup = World.around(scene, areas, tracks).setup
    scene = setup.scene
    drawn = _Sample(setup, areas, tracks, sample, np.random.default_rng(seed))
    if not drawn.pairs:
        why = (
            f"no two of the {count} objects come near each other in space, time and height: every setting gives the "
            f"same answer, for about {duration(drawn.database_s(1.0 + DATABASE_PER_PIECE))}; stay with exact."
        )
        return Advice(scene, seed, count, 0, 0, 0, (), why)
    truth = drawn.solved(REFERENCE).answer
    tolerances = sorted({scene.tolerance_m, *TOLERANCES_M})
    estimates = [drawn.estimate(Trial(method, m), truth) for method in TRIED for m in tolerances]
    said, undecided = recommendation(estimates, scene.method, scene.tolerance_m), int(truth["open"].sum())
    return Advice(scene, seed, count, drawn.pairs, len(drawn.keys), undecided, tuple(estimates), said)


class _Solved(NamedTuple):
    """The drawn pairs, solved: pairs of pieces after stages 1 and 2; processor seconds; conflicts without a region.

    answer : (n,) of each drawn pair of objects: first start and last end of its periods, their error bound, whether it
        is reported, whether it is unresolved
    """

    candidates: int
    intersecting: int
    seconds: float
    without_region: int
    answer: NDArray[Any]


class _Sample:
    """Pairs of objects drawn from a scene.

    keys : (n,) of the drawn pairs, increasing: from the numbers of the two objects
    pairs : number of pairs of objects from which they are drawn
    """

    def __init__(
        self, setup: Setup, areas: Sequence[Area], tracks: Sequence[Track], most: int, rng: np.random.Generator
    ) -> None:
        """Draw `most` near pairs, or all, or fewer to keep pairs of pieces at PIECE_PAIRS on average."""
        # Numbered by key, areas first: the order of the objects does not matter.
        self._areas = AreaBatch.of(sorted(areas, key=lambda area: area.key.encode()))
        batch = TrackBatch.of(sorted(tracks, key=lambda track: track.key.encode()))
        self._tracks = replace(batch, track_id=batch.track_id + len(areas))
        self._setup, self._objects = setup, len(areas) + len(tracks)
        self._near: dict[float, tuple[Pieces, PieceRows, PieceRows]] = {}
        # Method exact has the largest reach of all, if the scene asks for closest approaches.
        tolerance_m = max(setup.scene.tolerance_m, *TOLERANCES_M)
        widest = setup.under(replace(setup.scene, method=Method.EXACT, tolerance_m=tolerance_m))
        spent_s: list[float] = []
        while len(spent_s) < TRIES and sum(spent_s) < TRIES_S:
            started = time.process_time()
            pieces = pieces_of(widest, self._areas, self._tracks)
            spent_s.append(time.process_time() - started)
        self._pieces, self._piece_s = len(pieces), min(spent_s) / len(pieces)
        self.keys, lots, self.pairs, piece_pairs = np.empty(0, np.int64), np.empty(0), 0, 0
        for near, _ in self._candidates(pieces):
            some = np.unique(near)
            self.pairs, piece_pairs = self.pairs + len(some), piece_pairs + len(near)
            # The pairs with the smallest of random numbers are a sample; memory does not grow with all pairs.
            self.keys, lots = np.append(self.keys, some), np.append(lots, rng.random(len(some)))
            kept = np.argsort(lots)[:most]
            self.keys, lots = self.keys[kept], lots[kept]
        # Use the mean over all pairs: stopping at a drawn pair with many pieces would favour pairs with few.
        self.keys = np.sort(self.keys[: max(1, PIECE_PAIRS * self.pairs // max(piece_pairs, 1))])

    def database_s(self, per_piece: float, other: float = 0.0) -> float:
        """Return seconds of the database for units of work: per piece of the scene, and others."""
        return FIXED_S + self._piece_s * (per_piece * self._pieces + other)

    def estimate(self, setting: Trial, truth: NDArray[Any]) -> Estimate:
        """Return the cost and error of a setting, against an answer of the reference."""
        done, n = self.solved(setting), len(self.keys)
        scale, fraction, found = self.pairs / n, n / self.pairs, done.answer
        reported = int(found["found"].sum())
        database_s = self.database_s(
            DATABASE_PER_PIECE,
            TEST_PER_CANDIDATE * scale * done.candidates
            + WRITE_PER_CONFLICT * scale * reported
            + REGION_PER_CONFLICT * scale * done.without_region,
        )
        share, too_long_s = Proportion.sampled(reported, n, fraction), _too_long_s(found, truth)
        # Pairs that the reference leaves open are not false. The reference has no errors against itself.
        false = int((found["found"] & ~truth["found"]).sum())
        return Estimate(
            setting=setting,
            seconds=self._piece_s * self._pieces + scale * done.seconds + database_s,
            database_s=database_s,
            candidate_pairs=scale * done.candidates,
            intersecting_pairs=scale * done.intersecting,
            conflicts=Count(scale * reported, self.pairs * share.low, self.pairs * share.high),
            false_share=Proportion.sampled(false, reported, 1.0 if setting == REFERENCE else fraction),
            unresolved_share=Proportion.sampled(int(found["open"].sum()), reported, fraction),
            too_long_median_s=float(np.median(too_long_s)) if len(too_long_s) else np.nan,
            too_long_worst_s=float(np.max(too_long_s)) if len(too_long_s) else np.nan,
            time_error_s=float(found["error_s"].max()),
        )

    def solved(self, setting: Trial) -> _Solved:
        """Solve the drawn pairs with a setting, as a detection does."""
        scene = replace(self._setup.scene, method=setting.method, tolerance_m=setting.tolerance_m)
        pieces, a, b = self._drawn(scene)
        pairs = intersections(pieces, a, b, regions=METHODS[scene.method].needs_regions)
        wanted = min(BATCH, len(pairs) * self.pairs // len(self.keys))
        copies = max(wanted // max(len(pairs), 1), 1)
        every = Pieces.concatenate(
            [replace(pieces, object_id=pieces.object_id + copy * self._objects) for copy in range(copies)]
        )
        again = pairs.take(PairRows(np.tile(np.arange(len(pairs)), copies)))
        away = np.repeat(np.arange(copies) * len(pieces), len(pairs))
        again = replace(again, a=PieceRows(again.a + away), b=PieceRows(again.b + away))
        started = time.process_time()
        conflicts, _ = run_stages(
            self._setup.under(scene), every, again, lambda ids: self._areas.footprint[ids % self._objects]
        )
        region = conflicts.where(np.arange(len(conflicts)))
        seconds = (time.process_time() - started) / copies
        without = (np.diff(region.offset) == 0) & (conflicts.verdict != Verdict.NEAR.code)
        without &= scene.has_regions
        first = np.flatnonzero(conflicts.a_id < self._objects)
        return _Solved(len(a), len(pairs), seconds, int(without[first].sum()), self._answer(conflicts.take(first)))

    def _drawn(self, scene: Scene) -> tuple[Pieces, PieceRows, PieceRows]:
        """Return the pieces of the drawn objects and the candidates; cached for methods of the same reach."""
        if scene.reach_m not in self._near:
            members = np.unique(np.append(self.keys // self._objects, self.keys % self._objects))
            first_track = np.searchsorted(members, len(self._areas))
            areas = self._areas.take(members[:first_track])
            tracks = self._tracks.take(members[first_track:] - len(self._areas))
            pieces = pieces_of(self._setup.under(scene), areas, tracks)
            rows = np.empty((2, 0), np.int64)
            for keys, chunk in self._candidates(pieces):
                pieces = chunk.pieces
                rows = np.append(rows, np.stack([chunk.a, chunk.b])[:, np.isin(keys, self.keys)], axis=1)
            self._near[scene.reach_m] = pieces, PieceRows(rows[0]), PieceRows(rows[1])
        return self._near[scene.reach_m]

    def _candidates(self, pieces: Pieces) -> Iterator[tuple[NDArray[np.int64], Chunk]]:
        """Yield the pairs of pieces that stage 1 leaves, with keys; all of the same two objects at once."""
        for chunk in Memory(pieces).pairs(Question.of(self._setup.scene)):
            of = chunk.pieces.object_id
            yield self._keys(of[chunk.a], of[chunk.b]), chunk

    def _keys(self, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.minimum(a, b) * self._objects + np.maximum(a, b)

    def _answer(self, conflicts: Conflicts) -> NDArray[Any]:
        # Pairs that are only near have no periods.
        rows = np.flatnonzero(np.diff(conflicts.period_offset) > 0)
        at = np.searchsorted(self.keys, self._keys(conflicts.a_id[rows], conflicts.b_id[rows]))
        answer = np.zeros(len(self.keys), _ANSWER)
        answer["first_us"][at] = conflicts.period_us[conflicts.period_offset[rows], 0]
        answer["last_us"][at] = conflicts.period_us[conflicts.period_offset[rows + 1] - 1, 1]
        answer["error_s"][at], answer["found"][at] = conflicts.time_error_s[rows], True
        answer["open"][at] = conflicts.verdict[rows] == Verdict.UNRESOLVED.code
        return answer


def _too_long_s(found: NDArray[Any], truth: NDArray[Any]) -> Floats:
    """Return (2 m,) how much too early the first period starts and the last one ends too late, of pairs that meet."""
    meets = found["found"] & truth["found"] & ~truth["open"]
    ends = [(truth["first_us"], found["first_us"]), (found["last_us"], truth["last_us"])]
    later, earlier = (np.concatenate([end[meets] for end in side]) for side in zip(*ends, strict=True))
    # Equal ends may be unbounded.
    return np.where(later == earlier, 0.0, np.maximum(later.astype(float) - earlier.astype(float), 0.0) / 1e6)
