"""Find the objects of a scene and their near pairs, from which samples are drawn.

If all objects would take more than seconds, pairs are sought in a random subset. Each pair of objects is in it with
equal chance, so a count of pairs scales by the ratio of all pairs to the subset's.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.advice.estimates import Count, Sampling, object_error, whole
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.model import Area, Scene, Track
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.results import Kind
from conflictdb.stage1_broad_phase import candidates, hulls_of


@dataclass(frozen=True, slots=True)
class Affordable:
    """Limits on the search for pairs.

    objects : largest scene to search completely; size of the probe that sets the subset of a larger one
    pieces, meetings : limits on the pieces of the subset, and on overlaps of their boxes in the plane
    """

    objects: int = 400
    pieces: int = 15_000
    meetings: int = 3_000_000


# All estimates of database time follow from the time per piece. Pieces are built this often, within this time, seconds;
# the shortest time counts.
TRIES: Final = 3
TRIES_S: Final = 0.5
# Limits for a few seconds of work.
SECONDS: Final = Affordable()


@dataclass(frozen=True, slots=True)
class Objects:
    """All objects of a scene, numbered by key, areas first, so that input order does not matter."""

    areas: Sequence[Area]
    tracks: Sequence[Track]
    footprint: NDArray[np.object_]

    @classmethod
    def of(cls, areas: Sequence[Area], tracks: Sequence[Track]) -> "Objects":
        """Return the objects of a scene, in any order."""
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
        return pieces_of(scene, plane_of(scene), areas, tracks)

    def pair_keys(self, pieces: Pieces, a: PieceRows, b: PieceRows) -> NDArray[np.int64]:
        """Return one number for the pair of objects of each pair of pieces."""
        return self._keys(pieces.kind[a], pieces.object_id[a], pieces.kind[b], pieces.object_id[b])

    def keys_of(self, conflicts: Conflicts) -> NDArray[np.int64]:
        """Return the same number for the pair of objects of each conflict."""
        return self._keys(conflicts.a_kind, conflicts.a_id, conflicts.b_kind, conflicts.b_id)

    def _keys(
        self, a_kind: NDArray[np.int8], a: NDArray[np.int64], b_kind: NDArray[np.int8], b: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        one, other = (
            number + np.where(kind == Kind.TRACK.code, len(self.areas), 0)
            for kind, number in ((a_kind, a), (b_kind, b))
        )
        return np.minimum(one, other) * len(self) + np.maximum(one, other)

    def members(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the objects in some pairs."""
        return np.unique(np.concatenate([keys // len(self), keys % len(self)]))


@dataclass(frozen=True, slots=True)
class Frame:
    """The pairs that samples are drawn from.

    objects : of the whole scene
    looked_at : (m,) numbers of the objects in the subset
    pairs : (f,) keys of pairs of objects, increasing
    owner : (p,) row in `pairs` of each pair of pieces
    scale : ratio of all pairs of objects to those of the subset
    object_error : relative standard error of counts scaled by it
    piece_s : processor seconds per piece
    pieces_whole : pieces of the whole scene, estimated
    """

    objects: int
    looked_at: NDArray[np.int64]
    pairs: NDArray[np.int64]
    owner: NDArray[np.int64]
    scale: float
    object_error: float
    piece_s: float
    pieces_whole: float

    @property
    def pieces_per_pair(self) -> float:
        """Pairs of pieces per pair of objects, on average; NaN without pairs."""
        return len(self.owner) / len(self.pairs) if len(self.pairs) else float("nan")

    @property
    def pairs_whole(self) -> Count:
        """Pairs of the whole scene, estimated."""
        m = len(self.looked_at)
        if not len(self.pairs) and 1 < m < self.objects:
            # None of the pairs of these objects was found; each object is in m - 1 of them.
            seen = m * (m - 1) // 2
            return whole(np.zeros(seen), seen * self.scale, Sampling(1.0 / self.scale, 2.0 * m - 3.0), 0.0, 1.0)
        counted = len(self.pairs)
        return whole(np.ones(counted), counted * self.scale, Sampling(1.0, 1.0), self.object_error, 1.0)

    def sampling(self, drawn: int, some: NDArray[np.int64]) -> Sampling:
        """Return the sampling of some pairs, given their keys, among `drawn` drawn ones.

        In a subset of the objects, pairs that share an object count as right or wrong together, which is the worst
        case. Among all objects pairs are drawn from a list, without further randomness.
        """
        effect = 1.0
        if len(some) and len(self.looked_at) < self.objects:
            degree = np.bincount(np.concatenate([some // self.objects, some % self.objects]))
            effect = float((degree**2).sum() - len(some)) / len(some)
        return Sampling(drawn / (len(self.pairs) * self.scale), effect)

    def total(self, of_pair: NDArray[Any], drawn: NDArray[np.int64], typical: float) -> Count:
        """Return the total over the whole scene, from a value for each of some pairs drawn at random."""
        sampling = self.sampling(len(drawn), drawn)
        return whole(of_pair.astype(np.float64), len(self.pairs) * self.scale, sampling, self.object_error, typical)

    @classmethod
    def of(cls, widest: Scene, objects: Objects, affordable: Affordable, rng: np.random.Generator) -> "Frame":
        """Return the near pairs at the settings `widest`, among an affordable subset of the objects."""
        order = rng.permutation(len(objects))
        looked_at = order
        if len(objects) > affordable.objects:
            looked_at = order[: _affordable_count(widest, objects, affordable, order[: affordable.objects])]
        pieces, piece_s = _timed_pieces(widest, objects, np.sort(looked_at))
        pairs, owner = np.unique(objects.pair_keys(pieces, *candidates(pieces)), return_inverse=True)
        m, n = len(looked_at), len(objects)
        members = np.stack([pairs // n, pairs % n])[:, owner]
        degree = np.bincount(members.ravel(), minlength=n)[looked_at]
        scale = n * (n - 1) / (m * (m - 1)) if m > 1 else 1.0
        error = object_error(degree.astype(np.float64), n)
        return cls(n, looked_at, pairs, owner, scale, error, piece_s, len(pieces) * n / m)


def _timed_pieces(widest: Scene, objects: Objects, numbers: NDArray[np.int64]) -> tuple[Pieces, float]:
    """Return the pieces of some objects, and the shortest time per piece over some tries, seconds."""
    least_s, spent_s = np.inf, 0.0
    for _ in range(TRIES):
        started = time.process_time()
        pieces = objects.pieces(widest, numbers)
        took_s = time.process_time() - started
        least_s, spent_s = min(least_s, took_s), spent_s + took_s
        if spent_s > TRIES_S:
            break
    return pieces, least_s / len(pieces)


def _affordable_count(widest: Scene, objects: Objects, affordable: Affordable, probe: NDArray[np.int64]) -> int:
    """Return the size of the subset to search, judged by a probe of objects."""
    pieces = objects.pieces(widest, np.sort(probe))
    hulls = hulls_of(pieces)
    meetings = len(shapely.STRtree(hulls).query(hulls)[0])
    by_pieces = affordable.pieces * len(probe) / len(pieces)
    by_meetings = len(probe) * float(np.sqrt(affordable.meetings / meetings))
    return min(len(objects), max(2, int(min(by_pieces, by_meetings))))
