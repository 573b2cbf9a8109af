"""Advice: what each setting would cost for a scene and how wrong it would be, measured on a sample of that scene.

Nothing is written, and nothing of the database is asked but the objects themselves. The sample is drawn in two steps:

1. *Objects.* A random subset, only where all would be too many to handle in seconds: whatever lies in it is a pair with
   equal chance, so a count among them scales by the ratio of the pairs of objects.
2. *Pairs of objects*, without repetition and with equal chance, from those that stage 1 would not tell apart at the
   widest of the tolerances. Whole pairs, not pairs of pieces: what users see, and what is right or wrong, is a pair of
   objects with its periods. Objects alone would not do: of a few hundred random objects of a large scene hardly two
   come near each other.

Each setting then makes the pieces of the drawn objects and takes the drawn pairs through stages 1 to 4, as
`memory.solve` does. Counts carry their standard error. The truth that answers are held against is method `exact` at
tolerance 0 on the scene's own earth, on the same pairs.

Seconds are those of this machine at this moment. Stages 3 and 4, the pieces and the regions of stage 2 are timed; what
only a database does (its joins, rows in and out) is set in proportion to the making of pieces, by the ratios below.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.batches import AreaBatch, Conflicts, Pieces, TrackBatch
from conflictdb.errors import InvalidInput
from conflictdb.estimates import (
    Answer,
    Cost,
    Count,
    Estimate,
    Setting,
    duration,
    extrapolated_s,
    object_error,
    recommendation,
    share_error,
    whole,
    wrongness,
)
from conflictdb.geodesy import Floats
from conflictdb.memory import candidates, hulls_of, intersections
from conflictdb.model import Area, EarthModel, Kind, Method, Scene, Track
from conflictdb.pieces import area_pieces, track_pieces
from conflictdb.settle import needs_regions, settle

__all__ = ["Advice", "Estimate", "Setting", "advise"]

# Tolerances that are tried besides the scene's own, metres: from none to what a glance at a chart is worth.
TOLERANCES_M: Final = (0.0, 1.0, 10.0, 1000.0)
# Pairs of objects that are drawn unless said otherwise: shares within 2 %, and an answer within seconds.
SAMPLE: Final = 500
# Pairs of pieces that a sample may hold on average: one pair of areas with coasts has thousands.
PIECE_PAIRS: Final = 4_000
# The same for method nlp, which takes 10 ms a pair, and the least number of pairs of objects all the same.
NLP_PIECE_PAIRS: Final = 60
NLP_LEAST: Final = 10
# Objects that show how many can be handled, and the pieces and meetings of boxes in the plane that can be.
PROBE: Final = 400
PIECES: Final = 12_000
MEETINGS: Final = 3_000_000
# Share of the sample that a first run takes (see `estimates.extrapolated_s`).
SMALL_SHARE: Final = 0.1

# What the database adds, in units of the seconds that making one piece takes in memory: medians of full detections of
# 80 to 3,000 objects on one machine with PostgreSQL 15; seconds of another scene or disk may be twice that, or half.
DATABASE_PER_PIECE: Final = 0.6  # its row in and its marks
JOIN_PER_PIECE: Final = 0.27  # stage 1
TEST_PER_CANDIDATE: Final = 0.13  # stage 2, and its pairs and pieces out
WRITE_PER_CONFLICT: Final = 1.2
REGION_RATIO: Final = 1.5  # a region there against one in memory: the same library, but its bytes travel
FIXED_S: Final = 0.03  # transactions, statistics, temporary tables

# Told how many settings are measured, and of how many.
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Advice:
    """What each setting would cost for a scene, how wrong it would be, and what follows.

    scene : its settings
    seed : of the draws; the same seed draws the same sample
    objects, objects_looked_at : of the scene, and of these the ones among which pairs were looked for
    pairs : pairs of objects of the whole scene that come near each other (stage 1 at the widest tolerance), estimated
    sampled_pairs, nlp_pairs : pairs of objects drawn, and of these the ones that method nlp was tried on
    undecided_pairs : drawn pairs that the truth itself leaves unresolved
    estimates : by method, earth and tolerance; empty where there is nothing to detect
    recommendation : one or two sentences
    """

    scene: Scene
    seed: int
    objects: int
    objects_looked_at: int
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
) -> Advice:
    """Return what each setting would cost for a scene and how wrong it would be.

    sample : pairs of objects to draw, 1 or more; fewer where they have very many pieces
    seed : 0 or more; the same objects and seed give the same sample and the same counts, but not the same seconds
    """
    for name, value, least in (("sample", sample, 1), ("seed", seed, 0)):
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise InvalidInput("advise", name, f"must be a whole number, {least} or more; got {value!r}")
    objects = _Objects.of(areas, tracks)
    if not len(objects):
        return _nothing(scene, seed, objects, 0, "the scene holds no objects: there is nothing to detect.")
    rng = np.random.default_rng(seed)
    frame = _Frame.of(replace(scene, tolerance_m=max(scene.tolerance_m, *TOLERANCES_M)), objects, rng)
    if not len(frame.pairs):
        return _nothing(scene, seed, objects, len(frame.looked_at), _nobody_meets(objects, frame))

    mean = len(frame.owner) / len(frame.pairs)
    n = min(sample, len(frame.pairs), max(1, int(PIECE_PAIRS / mean)))
    nlp = min(n, max(NLP_LEAST, int(NLP_PIECE_PAIRS / mean)))
    drawn = frame.pairs[rng.permutation(len(frame.pairs))[:n]]
    measure = _Measure(scene, objects, frame, drawn)
    settings = _settings(scene)
    estimates = []
    for done, setting in enumerate(settings):
        if progress:
            progress(done, len(settings))
        estimates.append(measure.estimate(setting, nlp if setting.method == Method.NLP else n))
    if progress:
        progress(len(settings), len(settings))
    return Advice(
        scene=scene,
        seed=seed,
        objects=len(objects),
        objects_looked_at=len(frame.looked_at),
        pairs=whole(np.ones(len(frame.pairs)), len(frame.pairs), frame.scale, frame.object_error),
        sampled_pairs=n,
        nlp_pairs=nlp,
        undecided_pairs=measure.undecided,
        estimates=tuple(estimates),
        recommendation=recommendation(estimates, scene.method, scene.earth, scene.tolerance_m),
    )


def _nothing(scene: Scene, seed: int, objects: "_Objects", looked_at: int, why: str) -> Advice:
    return Advice(scene, seed, len(objects), looked_at, Count(0.0, 0.0), 0, 0, 0, (), why)


def _nobody_meets(objects: "_Objects", frame: "_Frame") -> str:
    whom = f"the {len(objects)} objects"
    if len(frame.looked_at) < len(objects):
        whom = f"{len(frame.looked_at)} of {whom}, drawn at random,"
    costs = duration(frame.piece_s * (1.0 + DATABASE_PER_PIECE + JOIN_PER_PIECE) * frame.pieces_whole + FIXED_S)
    return (
        f"no two of {whom} come near each other in space, time and height: every setting gives the same answer, "
        f"for about {costs}; stay with exact."
    )


def _settings(scene: Scene) -> list[Setting]:
    """Return what is tried: method by tolerance on the scene's earth, and the other earth at the scene's tolerance.

    Method nlp only with the scene's own: it is dear, and its answers are certified to be those of exact.
    """
    tolerances = sorted({scene.tolerance_m, *TOLERANCES_M})
    tried = [
        Setting(method, scene.earth, tolerance_m)
        for method in Method
        for tolerance_m in (tolerances if method != Method.NLP else [scene.tolerance_m])
    ]
    for earth in EarthModel:
        try:
            replace(scene, earth=earth)
        except InvalidInput:  # the motion does not go with it
            continue
        if earth != scene.earth:
            tried += [Setting(method, earth, scene.tolerance_m) for method in Method if method != Method.NLP]
    return tried


@dataclass(frozen=True, slots=True)
class _Objects:
    """All objects of a scene, numbered: areas first, then tracks, each by key, so that their order does not matter."""

    areas: Sequence[Area]
    tracks: Sequence[Track]
    footprint: NDArray[np.object_]

    @classmethod
    def of(cls, areas: Sequence[Area], tracks: Sequence[Track]) -> "_Objects":
        areas = sorted(areas, key=lambda area: area.key.encode())
        tracks = sorted(tracks, key=lambda track: track.key.encode())
        return cls(areas, tracks, AreaBatch.of(areas).footprint)

    def __len__(self) -> int:
        return len(self.areas) + len(self.tracks)

    def pieces(self, scene: Scene, numbers: NDArray[np.int64]) -> Pieces:
        """Return the pieces of some objects."""
        still = numbers[numbers < len(self.areas)]
        moving = numbers[numbers >= len(self.areas)] - len(self.areas)
        areas = replace(AreaBatch.of([self.areas[i] for i in still.tolist()]), area_id=still)
        tracks = replace(TrackBatch.of([self.tracks[i] for i in moving.tolist()]), track_id=moving)
        return Pieces.concatenate([area_pieces(scene, areas), track_pieces(scene, tracks)])

    def pair_keys(self, pieces: Pieces, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return one number for the pair of objects of each pair of pieces."""
        return self._keys(pieces.kind[a], pieces.object_id[a], pieces.kind[b], pieces.object_id[b])

    def keys_of(self, conflicts: Conflicts) -> NDArray[np.int64]:
        """Return the same number for the pair of each conflict."""
        return self._keys(conflicts.a_kind, conflicts.a_id, conflicts.b_kind, conflicts.b_id)

    def _keys(
        self, a_kind: NDArray[np.int8], a: NDArray[np.int64], b_kind: NDArray[np.int8], b: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        one, other = (
            number + np.where(kind == Kind.TRACK, len(self.areas), 0) for kind, number in ((a_kind, a), (b_kind, b))
        )
        return np.minimum(one, other) * len(self) + np.maximum(one, other)

    def members(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the objects that occur in pairs."""
        return np.unique(np.concatenate([keys // len(self), keys % len(self)]))


@dataclass(frozen=True, slots=True)
class _Frame:
    """The pairs that samples are drawn from.

    looked_at : (m,) numbers of the objects among which pairs were looked for
    pairs : (f,) keys of pairs of objects, increasing
    owner : (p,) row in `pairs` of each pair of pieces
    scale : pairs of all objects for one of those looked at
    object_error : relative standard error of counts that are scaled by it
    piece_s : seconds that making one piece takes
    pieces_whole : pieces of the whole scene, estimated
    """

    looked_at: NDArray[np.int64]
    pairs: NDArray[np.int64]
    owner: NDArray[np.int64]
    scale: float
    object_error: float
    piece_s: float
    pieces_whole: float

    @classmethod
    def of(cls, widest: Scene, objects: _Objects, rng: np.random.Generator) -> "_Frame":
        order = rng.permutation(len(objects))
        looked_at = order[: _affordable(widest, objects, order[:PROBE])] if len(objects) > PROBE else order
        started = time.perf_counter()
        pieces = objects.pieces(widest, np.sort(looked_at))
        piece_s = (time.perf_counter() - started) / len(pieces)
        pairs, owner = np.unique(objects.pair_keys(pieces, *candidates(pieces)), return_inverse=True)
        m, n = len(looked_at), len(objects)
        members = np.stack([pairs // n, pairs % n])[:, owner]
        degree = np.bincount(members.ravel(), minlength=n)[looked_at]
        scale = n * (n - 1) / (m * (m - 1)) if m > 1 else 1.0
        error = object_error(degree.astype(np.float64), n)
        return cls(looked_at, pairs, owner, scale, error, piece_s, len(pieces) * n / m)


def _affordable(widest: Scene, objects: _Objects, probe: NDArray[np.int64]) -> int:
    """Return among how many objects pairs can be looked for, judged by a few of them."""
    pieces = objects.pieces(widest, np.sort(probe))
    hulls = hulls_of(pieces)
    meetings = len(shapely.STRtree(hulls).query(hulls)[0])
    by_pieces = PIECES * len(probe) / len(pieces)
    by_meetings = len(probe) * float(np.sqrt(MEETINGS / meetings))
    return min(len(objects), max(2, int(min(by_pieces, by_meetings))))


class _Measure:
    """Takes drawn pairs of objects through the stages, setting by setting.

    drawn : (n,) keys of pairs of objects, in the order they were drawn: any first k of them are a sample too
    """

    def __init__(self, scene: Scene, objects: _Objects, frame: _Frame, drawn: NDArray[np.int64]) -> None:
        self._scene, self._objects, self._frame, self._drawn = scene, objects, frame, drawn
        self._rank = np.argsort(drawn)
        self._candidates: dict[tuple[EarthModel, float], tuple[Pieces, NDArray[np.int64], NDArray[np.int64]]] = {}
        self._truth = self._answer(self._settle(Setting(Method.EXACT, scene.earth, 0.0), len(drawn))[0])

    @property
    def undecided(self) -> int:
        """How many of the drawn pairs the truth leaves unresolved."""
        return int(self._truth.is_unresolved.sum())

    def estimate(self, setting: Setting, n: int) -> Estimate:
        """Return what a setting costs, and how wrong it is, by the first n of the drawn pairs."""
        # The first run also warms up.
        small = self._settle(setting, max(1, int(SMALL_SHARE * n)))[1]
        reports, large = self._settle(setting, n)
        found = self._answer(reports)
        wrong = wrongness(found, self._truth.among(self._drawn[:n]))
        reported = np.isin(self._drawn[:n], found.pair)
        candidate, intersecting, solved, conflicts = (
            self._whole(of_pair) for of_pair in (large.candidates, large.met, large.solved, reported)
        )
        return Estimate(
            setting=setting,
            sampled_pairs=n,
            candidate_pairs=candidate,
            intersecting_pairs=intersecting,
            solved_pairs=solved,
            conflicts=conflicts,
            cost=self._cost(small, large, candidate.value, intersecting.value, conflicts.value),
            wrong=wrong,
            false_share_error=share_error(wrong.false_share, wrong.reported, n, len(self._frame.pairs)),
        )

    def _cost(
        self, small: "_Pass", large: "_Pass", candidate_pairs: float, intersecting_pairs: float, conflicts: float
    ) -> Cost:
        """Return the seconds of a detection of the whole scene, which has so many pairs and conflicts."""
        made = self._frame.piece_s
        stage3_s, stage4_s = (
            extrapolated_s(few_s, small.handled, many_s, large.handled, intersecting_pairs)
            for few_s, many_s in ((small.stage3_s, large.stage3_s), (small.stage4_s, large.stage4_s))
        )
        region_s = REGION_RATIO * large.region_s * intersecting_pairs / max(large.handled, 1)
        return Cost(
            pieces_s=made * (1.0 + DATABASE_PER_PIECE) * self._frame.pieces_whole,
            stage1_s=made * JOIN_PER_PIECE * self._frame.pieces_whole,
            stage2_s=made * TEST_PER_CANDIDATE * candidate_pairs + region_s,
            stage3_s=stage3_s,
            stage4_s=stage4_s,
            write_s=made * WRITE_PER_CONFLICT * conflicts + FIXED_S,
        )

    def _whole(self, of_pair: NDArray[Any]) -> Count:
        frame = self._frame
        return whole(of_pair.astype(np.float64), len(frame.pairs), frame.scale, frame.object_error)

    def _settle(self, setting: Setting, n: int) -> tuple[Conflicts, "_Pass"]:
        """Return what a setting makes of the first n drawn pairs, and what that took."""
        scene = replace(self._scene, method=setting.method, earth=setting.earth, tolerance_m=setting.tolerance_m)
        pieces, a, b = self._stage1(scene)
        drawn = self._number(pieces, a, b)
        regions = needs_regions(scene.method)
        met = intersections(pieces, a, b, regions=False)
        met_of = np.bincount(self._number(pieces, met.a, met.b), minlength=len(self._drawn))
        some = np.flatnonzero(drawn < n)
        started = time.perf_counter()
        pairs = intersections(pieces, a[some], b[some], regions=regions)
        region_s = time.perf_counter() - started if regions else 0.0
        conflicts, funnel = settle(scene, pieces, pairs, lambda numbers: self._objects.footprint[numbers])
        return conflicts, _Pass(
            candidates=np.bincount(drawn, minlength=len(self._drawn)),
            met=met_of,
            solved=met_of.astype(np.float64) * (funnel.solved_pairs / max(len(pairs), 1)),
            handled=len(pairs),
            region_s=region_s,
            stage3_s=funnel.stage3_s,
            stage4_s=funnel.stage4_s,
        )

    def _stage1(self, scene: Scene) -> tuple[Pieces, NDArray[np.int64], NDArray[np.int64]]:
        """Return the pieces of the drawn objects and their candidates, made once for all methods."""
        which = (scene.earth, scene.tolerance_m)
        if which not in self._candidates:
            pieces = self._objects.pieces(scene, self._objects.members(self._drawn))
            a, b = candidates(pieces)
            wanted = np.isin(self._objects.pair_keys(pieces, a, b), self._drawn)
            self._candidates[which] = (pieces, a[wanted], b[wanted])
        return self._candidates[which]

    def _number(self, pieces: Pieces, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return as which number the pair of objects of each pair of pieces was drawn."""
        keys = self._objects.pair_keys(pieces, a, b)
        return self._rank[np.searchsorted(self._drawn, keys, sorter=self._rank)]

    def _answer(self, conflicts: Conflicts) -> Answer:
        return Answer.of(conflicts, self._objects.keys_of(conflicts))


@dataclass(frozen=True, slots=True)
class _Pass:
    """What one run of a setting counted and took.

    candidates, met, solved : (n,) pairs of pieces after stages 1 and 2, and given to stage 4, of every drawn pair
    handled : pairs of pieces of those it ran on, after stage 2
    region_s, stage3_s, stage4_s : seconds it took for these
    """

    candidates: NDArray[np.int64]
    met: NDArray[np.int64]
    solved: Floats
    handled: int
    region_s: float
    stage3_s: float
    stage4_s: float
