"""A scene in memory after stages 1 and 2: the input of tests of the later stages."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scenes import box

from conflictdb.arrays.answers import Conflicts, Contacts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.arrays.ragged import offsets
from conflictdb.core.funnel import Funnel
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.run import run_stages
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.core.stage2_intersection import intersections
from conflictdb.core.stage4.contact_search import contacts
from conflictdb.core.stage4.effort import Effort
from conflictdb.earth.registry import Setup
from conflictdb.kernel import KernelScene
from conflictdb.model.plans import Area, Scene, Track


def still(*rings: Any) -> Pieces:
    """Return areas with these corners, plane metres, counter-clockwise; their hulls are at another place."""
    areas = [box(f"A{k}", k, 0.0, k + 0.5, 0.5) for k in range(len(rings))]
    pieces = Staged.of(Scene("s"), areas, []).pieces
    shape = np.array([corner for ring in rings for corner in ring], np.float64).reshape(-1, 2)
    return replace(pieces, shape_xy=shape, shape_to_xy=shape, shape_offset=offsets([len(ring) for ring in rings]))


@dataclass(frozen=True)
class Staged:
    """The pieces of a scene, whose objects are numbered as they were given, and the pairs that pass stage 2.

    prepared : the pieces, for the kernel
    footprint : (n,) of the areas
    """

    setup: Setup
    pieces: Pieces
    pairs: Pairs
    prepared: KernelScene
    footprint: NDArray[np.object_]

    @classmethod
    def of(cls, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], *, regions: bool = False) -> "Staged":
        setup, batch = Setup.of(scene), AreaBatch.of(areas)
        pieces = pieces_of(setup, batch, TrackBatch.of(tracks))
        pairs = intersections(pieces, *candidates(pieces), regions=regions)
        return cls(setup, pieces, pairs, KernelScene(setup.plane.kernel_plane, pieces), batch.footprint)

    def spans(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return when the shared span of each pair begins, microseconds, and its length, seconds."""
        start, end = self.pieces.shared_span(self.pairs.a, self.pairs.b)
        return start, (end - start) / 1e6

    def contacts(self) -> tuple[Contacts, Effort]:
        """Return the contacts of all pairs during their shared spans."""
        whole = np.zeros(len(self.pairs)), self.spans()[1]
        return contacts(self.setup, self.prepared, self.pairs, *whole)

    def run(self, **how: Any) -> tuple[Conflicts, Funnel]:
        """Return the conflicts, by stages 3 and 4."""
        return run_stages(self.setup, self.pieces, self.pairs, lambda ids: self.footprint[ids], **how)
