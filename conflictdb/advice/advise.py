"""Advise on settings: estimate the cost and the error of each setting for a scene, from a sample of that scene.

Nothing is written; only the scene's objects are read. The sample is drawn in two steps:

1. *Objects.* A random subset, if all would take more than seconds. Each pair of objects is in it with equal chance, so
a count of pairs scales by the ratio of all pairs to the subset's.
2. *Pairs of objects*, without repetition and with equal chance, from those that stage 1 leaves at the scene's
tolerance, or at 10 m. Larger tolerances have a smaller sample of their own: in a dense scene many times as many pairs
come within 1000 m, and most of them never meet. The unit is a pair of objects, because users see pairs of objects with
periods. Sampling objects alone would fail: of a few hundred random objects of a large scene hardly two come near each
other.

Each setting then cuts the drawn objects into pieces and takes the drawn pairs through stages 1 to 4, as
`in_memory.solve` does. Counts and shares have 95 % intervals, also at 0 and 1. The reference answer is method `exact`
at tolerance 0 on the scene's own earth, on the same pairs.

Seconds are processor time on this machine for a full detection that changes every row, as after a change of method. The
pieces, the regions of stage 2, stages 3 and 4 and the regions of conflicts are timed. The database's part (joins, rows
in and out, regions that the kernel leaves to it) is set in proportion to the time for pieces, by the ratios below.
`benchmarks/advice.py` compares both with detections.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import inputs
from conflictdb.advice.estimates import (
    Answer,
    Cost,
    Count,
    Estimate,
    Setting,
    Share,
    duration,
    errors_of,
    extrapolated_s,
    recommendation,
)
from conflictdb.advice.sample import SECONDS, Affordable, Frame, Objects
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.errors import InvalidInput
from conflictdb.methods import METHODS, Method, Tried
from conflictdb.model import Area, EarthModel, Scene, Track
from conflictdb.motion.registry import centred, plane_of
from conflictdb.pipeline.run import Funnel, run_stages
from conflictdb.results import Verdict
from conflictdb.stage1_broad_phase import candidates
from conflictdb.stage2_intersection import intersections

__all__ = ["Advice", "Estimate", "Setting", "advise"]

# Tolerances tried besides the scene's own, metres: from none to the accuracy of a glance at a chart.
TOLERANCES_M: Final = (0.0, 1.0, 10.0, 1000.0)
# Default number of drawn pairs of objects: shares within 2 %, and an answer within seconds.
SAMPLE: Final = 500
# Tolerances up to this, or the scene's own, share one sample; larger ones have their own, smaller by this factor.
NEARBY_M: Final = 10.0
FAR_SHARE: Final = 5
# Average number of pairs of pieces in a sample: one pair of areas with coastlines has thousands.
PIECE_PAIRS: Final = 3_000
FAR_PIECE_PAIRS: Final = 1_000
# The same for method nlp, which takes 10 ms a pair, and its least number of pairs of objects.
NLP_PIECE_PAIRS: Final = 60
NLP_LEAST: Final = 5
# Copies of the sample that show the cost of one more pair in full batches, and their time budget, seconds.
LEAST_COPIES: Final = 2
MOST_COPIES: Final = 8
COPIES_S: Final = 1.0

# Cost of the database, in units of the seconds for one piece in memory: from full detections of 600 to 5,000 objects
# with PostgreSQL 15 that changed every row (benchmarks/advice.py). Another scene or disk may halve or double it.
DATABASE_PER_PIECE: Final = 2.4  # its row in, the marks
JOIN_PER_PIECE: Final = 2.3  # stage 1; its pairs and pieces out
TEST_PER_CANDIDATE: Final = 0.04  # stage 2
WRITE_PER_CONFLICT: Final = 4.5
# For a conflict without a region of the kernel, mostly where swept hulls meet and the objects do not: methods that
# decide nothing report many such pairs, and the database computes the region from the hulls.
REGION_PER_CONFLICT: Final = 100.0
FIXED_S: Final = 0.03  # transactions, statistics, temporary tables

_SHORTEST_S: Final = 1e-9  # divisor where the clock shows no time

# Called with the number of settings measured, and of all settings.
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Advice:
    """The cost and error of each setting for a scene, with a recommendation.

    scene : its settings
    seed : of the draws; the same seed draws the same sample
    objects, objects_looked_at : of the scene, and of the subset searched for pairs
    nearby_m : tolerance at which stage 1 finds near pairs
    pairs : near pairs of objects in the whole scene, estimated
    sampled_pairs, nlp_pairs : pairs drawn, and those of them tried with method nlp; larger tolerances have pairs of
        their own, see `Estimate.sampled_pairs`
    undecided_pairs : drawn pairs that the reference leaves unresolved
    estimates : by method, earth and tolerance; empty if there is nothing to detect
    recommendation : one or two sentences
    """

    scene: Scene
    seed: int
    objects: int
    objects_looked_at: int
    nearby_m: float
    pairs: Count
    sampled_pairs: int
    nlp_pairs: int
    undecided_pairs: int
    estimates: tuple[Estimate, ...]
    recommendation: str


def advise(
    scene: Scene,
    areas: Sequence[Area],
    tracks: Sequence[Track],
    *,
    sample: int = SAMPLE,
    seed: int = 0,
    progress: Progress | None = None,
    affordable: Affordable = SECONDS,
) -> Advice:
    """Return the estimated cost and error of each setting for a scene.

    sample : pairs of objects to draw, at least 1; fewer are drawn if they have very many pieces
    seed : 0 or more; the same objects and seed give the same sample and the same counts, but not the same seconds
    affordable : limits on the search for pairs
    """
    inputs.count("advise", "sample", sample, 1)
    inputs.count("advise", "seed", seed, 0)
    objects = Objects.of(areas, tracks)
    if not len(objects):
        why = "the scene holds no objects: there is nothing to detect."
        return _nothing(scene, seed, objects, 0, Count(0.0, 0.0, 0.0), why)
    scene = centred(scene, areas, tracks)
    settings = _settings(scene)
    nearby_m = max(scene.tolerance_m, NEARBY_M)
    rng = np.random.default_rng(seed)
    # Method exact has the largest reach of all, where the scene asks for closest approaches.
    widest = replace(scene, method=Method.EXACT, tolerance_m=nearby_m)
    draw = _Draw.of(Frame.of(widest, objects, affordable, rng), sample, PIECE_PAIRS, rng)
    if not len(draw.keys):
        frame = draw.frame
        return _nothing(scene, seed, objects, len(frame.looked_at), frame.pairs_whole, _nobody_meets(objects, frame))
    nlp = min(len(draw.keys), max(NLP_LEAST, int(NLP_PIECE_PAIRS / draw.frame.pieces_per_pair)))
    measure = _Measure(scene, objects, draw)
    far_m = max(setting.tolerance_m for setting in settings)
    far = measure
    if far_m > nearby_m:
        few = -(-sample // FAR_SHARE)
        frame_far = Frame.of(replace(widest, tolerance_m=far_m), objects, affordable, rng)
        draw_far = _Draw.of(frame_far, few, FAR_PIECE_PAIRS, rng)
        far = _Measure(scene, objects, draw_far)
    estimates = []
    for done, setting in enumerate(settings):
        if progress:
            progress(done, len(settings))
        by = measure if setting.tolerance_m <= nearby_m else far
        estimates.append(by.estimate(setting, nlp if METHODS[setting.method].tried is Tried.SPARINGLY else None))
    if progress:
        progress(len(settings), len(settings))
    return Advice(
        scene=scene,
        seed=seed,
        objects=len(objects),
        objects_looked_at=len(draw.frame.looked_at),
        nearby_m=nearby_m,
        pairs=draw.frame.pairs_whole,
        sampled_pairs=len(draw.keys),
        nlp_pairs=nlp,
        undecided_pairs=measure.undecided,
        estimates=tuple(estimates),
        recommendation=recommendation(estimates, scene.method, scene.earth, scene.tolerance_m),
    )


def _nothing(scene: Scene, seed: int, objects: Objects, looked_at: int, pairs: Count, why: str) -> Advice:
    return Advice(scene, seed, len(objects), looked_at, NEARBY_M, pairs, 0, 0, 0, (), why)


def _nobody_meets(objects: Objects, frame: Frame) -> str:
    whom = f"the {len(objects)} objects"
    if len(frame.looked_at) < len(objects):
        whom = f"{len(frame.looked_at)} of {whom}, drawn at random,"
    costs = duration(frame.piece_s * (1.0 + DATABASE_PER_PIECE + JOIN_PER_PIECE) * frame.pieces_whole + FIXED_S)
    return (
        f"no two of {whom} come near each other in space, time and height: every setting gives the same answer, "
        f"for about {costs}; stay with exact."
    )


def _settings(scene: Scene) -> list[Setting]:
    """Return the settings to try: method by tolerance on the scene's earth; the other earth at the scene's tolerance.

    Slow methods are tried only at the scene's tolerance: their answers are those of another method.
    """
    tolerances = sorted({scene.tolerance_m, *TOLERANCES_M})
    widely = [method for method in Method if METHODS[method].tried is Tried.WIDELY]
    tried = [
        Setting(method, scene.earth, tolerance_m)
        for method in Method
        for tolerance_m in (tolerances if method in widely else [scene.tolerance_m])
    ]
    for earth in EarthModel:
        try:
            replace(scene, earth=earth)
        except InvalidInput:  # the motion excludes that earth
            continue
        if earth != scene.earth:
            tried += [Setting(method, earth, scene.tolerance_m) for method in widely]
    return tried


@dataclass(frozen=True, slots=True)
class _Draw:
    """Pairs of objects drawn from a frame: (n,) keys, in the order of drawing; any first k are a sample too."""

    frame: Frame
    keys: NDArray[np.int64]

    @classmethod
    def of(cls, frame: Frame, sample: int, piece_pairs: int, rng: np.random.Generator) -> "_Draw":
        """Draw `sample` pairs, or all, or fewer to keep pairs of pieces at `piece_pairs` on average."""
        # Use the mean over all pairs: stopping at a drawn pair with many pieces would favour pairs with few.
        n = min(sample, max(1, int(piece_pairs / frame.pieces_per_pair))) if len(frame.pairs) else 0
        return cls(frame, frame.pairs[rng.permutation(len(frame.pairs))[:n]])


class _Measure:
    """Runs drawn pairs of objects through the stages, setting by setting."""

    def __init__(self, scene: Scene, objects: Objects, draw: _Draw) -> None:
        self._scene, self._objects, self._frame, self._drawn = scene, objects, draw.frame, draw.keys
        self._rank = np.argsort(draw.keys)
        self._candidates: dict[tuple[EarthModel, float], tuple[Pieces, PieceRows, PieceRows]] = {}
        self._truth_is = Setting(Method.EXACT, scene.earth, 0.0)
        self._truth = self._answer(self._run(self._truth_is, len(draw.keys), is_timed=False)[0])

    @property
    def undecided(self) -> int:
        """The number of drawn pairs that the reference leaves unresolved."""
        return int(self._truth.is_unresolved.sum())

    def estimate(self, setting: Setting, n: int | None = None) -> Estimate:
        """Return the cost and error of a setting, from the drawn pairs or the first n of them."""
        n = len(self._drawn) if n is None else n
        reports, done = self._run(setting, n)
        found = self._answer(reports)
        truth = self._truth.among(self._drawn[:n])
        wrong = errors_of(found, truth)
        candidate, intersecting, solved = (
            self._frame.total(of_pair, self._drawn, self._frame.pieces_per_pair)
            for of_pair in (done.candidates, done.met, done.solved)
        )
        conflicts, without_region = (
            self._frame.total(np.isin(self._drawn[:n], pairs), self._drawn[:n], 1.0)
            for pairs in (found.pair, done.without_region)
        )
        of_reported = self._frame.sampling(n, found.pair).share
        of_meeting = self._frame.sampling(n, truth.pair[~truth.is_unresolved]).share
        # The reference has no errors against itself, and on the scene's own earth it is proven that no pair is missed.
        false_share = Share.certain if setting == self._truth_is else of_reported
        missed_share = Share.certain if setting.earth == self._truth_is.earth else of_meeting
        made_s, pieces = self._frame.piece_s, self._frame.pieces_whole
        pairs = intersecting.value
        region_s = done.region_s * pairs / max(done.handled, 1)
        return Estimate(
            setting=setting,
            sampled_pairs=n,
            candidate_pairs=candidate,
            intersecting_pairs=intersecting,
            solved_pairs=solved,
            conflicts=conflicts,
            cost=Cost(
                pieces_s=made_s * (1.0 + DATABASE_PER_PIECE) * pieces,
                stage1_s=made_s * JOIN_PER_PIECE * pieces,
                stage2_s=made_s * TEST_PER_CANDIDATE * candidate.value + region_s,
                stage3_s=extrapolated_s(done.once.stage3_s, done.more.stage3_s, done.copies, done.handled, pairs),
                stage4_s=extrapolated_s(done.once.stage4_s, done.more.stage4_s, done.copies, done.handled, pairs),
                write_s=made_s * WRITE_PER_CONFLICT * conflicts.value
                + made_s * REGION_PER_CONFLICT * without_region.value
                + FIXED_S,
            ),
            wrong=wrong,
            false_share=false_share(wrong.false_pairs, wrong.reported),
            unresolved_share=of_reported(wrong.unresolved, wrong.reported),
            missed_share=missed_share(wrong.missed_pairs, wrong.meeting_pairs),
        )

    def _run(self, setting: Setting, n: int, *, is_timed: bool = True) -> tuple[Conflicts, "_Pass"]:
        """Run a setting on the first n drawn pairs; return its conflicts and its counts and times."""
        scene = replace(self._scene, method=setting.method, earth=setting.earth, tolerance_m=setting.tolerance_m)
        pieces, a, b = self._stage1(scene)
        drawn = self._number(pieces, a, b)
        regions = METHODS[scene.method].needs_regions
        met = intersections(pieces, a, b, regions=False)
        met_of = np.bincount(self._number(pieces, met.a, met.b), minlength=len(self._drawn))
        some = np.flatnonzero(drawn < n)
        started = time.process_time()
        pairs = intersections(pieces, PieceRows(a[some]), PieceRows(b[some]), regions=regions)
        region_s = time.process_time() - started if regions else 0.0
        conflicts, once, has_region = self._run_stages(scene, pieces, pairs)
        # Batches of a sample are half empty. Copies of it, as separate objects, fill them as in the whole scene.
        copies, more = 1, once
        if is_timed and METHODS[scene.method].tried is Tried.WIDELY and len(self._frame.pairs) * self._frame.scale > n:
            copies = int(COPIES_S / max(once.stage3_s + once.stage4_s, _SHORTEST_S))
            copies = min(max(copies, LEAST_COPIES), MOST_COPIES)
            _, more, _ = self._run_stages(scene, *_copied(pieces, pairs, copies, len(self._objects)))
        return conflicts, _Pass(
            candidates=np.bincount(drawn, minlength=len(self._drawn)),
            met=met_of,
            solved=met_of.astype(np.float64) * (once.solved_pairs / max(len(pairs), 1)),
            handled=len(pairs),
            region_s=region_s,
            once=once,
            copies=copies,
            more=more,
            without_region=self._objects.keys_of(conflicts)[~has_region],
        )

    def _run_stages(self, scene: Scene, pieces: Pieces, pairs: Pairs) -> tuple[Conflicts, Funnel, NDArray[np.bool_]]:
        """Return the conflicts of pairs, the counts, and which conflicts have a region or need none.

        Seconds of stages 3 and 4 are processor time; stage 4 includes the regions.
        """
        footprint = self._objects.footprint
        started = time.process_time()
        conflicts, funnel = run_stages(
            scene, plane_of(scene), pieces, pairs, lambda numbers: footprint[numbers % len(self._objects)]
        )
        region = conflicts.where(np.arange(len(conflicts)))
        has_region = (np.diff(region.offset) > 0) | (conflicts.verdict == Verdict.NEAR.code)
        # The funnel has wall-clock times: use only their proportion.
        pace = (time.process_time() - started) / max(funnel.stage3_s + funnel.stage4_s, _SHORTEST_S)
        funnel = replace(funnel, stage3_s=pace * funnel.stage3_s, stage4_s=pace * funnel.stage4_s)
        return conflicts, funnel, has_region

    def _stage1(self, scene: Scene) -> tuple[Pieces, PieceRows, PieceRows]:
        """Return the pieces of the drawn objects and their candidates; cached for methods of the same reach."""
        which = (scene.earth, scene.reach_m)
        if which not in self._candidates:
            pieces = self._objects.pieces(scene, self._objects.members(self._drawn))
            a, b = candidates(pieces)
            is_drawn = np.isin(self._objects.pair_keys(pieces, a, b), self._drawn)
            self._candidates[which] = (pieces, PieceRows(a[is_drawn]), PieceRows(b[is_drawn]))
        return self._candidates[which]

    def _number(self, pieces: Pieces, a: PieceRows, b: PieceRows) -> NDArray[np.int64]:
        """Return the draw number of the pair of objects of each pair of pieces."""
        keys = self._objects.pair_keys(pieces, a, b)
        return self._rank[np.searchsorted(self._drawn, keys, sorter=self._rank)]

    def _answer(self, conflicts: Conflicts) -> Answer:
        return Answer.of(conflicts, self._objects.keys_of(conflicts))


@dataclass(frozen=True, slots=True)
class _Pass:
    """The counts and times of one run of a setting.

    candidates, met, solved : (n,) pairs of pieces after stages 1 and 2, and given to stage 4, for each drawn pair
    handled : pairs of pieces after stage 2 in this run
    region_s : processor time of their regions
    once, more : funnel of these pairs, and of `copies` copies of them, in processor time
    without_region : keys of the reported pairs of objects whose region the kernel leaves to the database
    """

    candidates: NDArray[np.int64]
    met: NDArray[np.int64]
    solved: Floats
    handled: int
    region_s: float
    once: Funnel
    copies: int
    more: Funnel
    without_region: NDArray[np.int64]


def _copied(pieces: Pieces, pairs: Pairs, copies: int, objects: int) -> tuple[Pieces, Pairs]:
    """Repeat pieces and pairs `copies` times, with new object numbers in each copy."""
    everything = Pieces.concatenate(
        [replace(pieces, object_id=pieces.object_id + copy * objects) for copy in range(copies)]
    )
    again = pairs.take(PairRows(np.tile(np.arange(len(pairs)), copies)))
    away = np.repeat(np.arange(copies) * len(pieces), len(pairs))
    return everything, replace(again, a=PieceRows(again.a + away), b=PieceRows(again.b + away))
