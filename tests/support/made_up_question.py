"""A question that nobody has, as a developer would add it: the surroundings of a plan.

Its conflicts, and those of all plans that it is in conflict with.
"""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.near import Chunk, Memory, Question
from conflictdb.core.run import run_scene
from conflictdb.core.to_results import to_results
from conflictdb.core.world import Occupied, World, occupy
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Conflict


def surroundings(areas: Sequence[Area], tracks: Sequence[Track], scene: Scene, key: str) -> list[Conflict]:
    """Return the conflicts and near pairs of a plan, and of all plans in these."""
    world = World.of(scene, areas, tracks)
    occupied = occupy(world, areas, tracks)
    own = _conflicts_of(world, occupied, {key})
    return _conflicts_of(world, occupied, {key}.union(*((one.a_key, one.b_key) for one in own)))


def _conflicts_of(world: World, occupied: Occupied, keys: Collection[str]) -> list[Conflict]:
    mine = _pieces_of(occupied, keys)
    found = Conflicts.concatenate([some for some, _ in run_scene(world.setup, _Of(occupied, mine))])
    return to_results(world.setup.scene, occupied.named(), found)


def _pieces_of(occupied: Occupied, keys: Collection[str]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return the rows of the pieces of some plans."""
    pieces: Pieces = occupied.pieces
    wanted = {number for number, (key, _) in occupied.named().items() if key in keys}
    each = zip(pieces.kind.tolist(), pieces.object_id.tolist(), strict=True)
    return np.flatnonzero([number in wanted for number in each])


class _Of(Memory):
    """The pairs with one of some pieces."""

    def __init__(self, occupied: Occupied, mine: np.ndarray[tuple[int], np.dtype[np.int64]]) -> None:
        super().__init__(occupied.pieces, occupied.batches)
        self._mine = mine

    def pairs(self, question: Question) -> Iterator[Chunk]:
        return super().pairs(question._replace(mine=self._mine))
