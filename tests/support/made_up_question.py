"""A question that nobody has, as a developer would add it: the surroundings of a plan.

Its conflicts, and those of all plans that it is in conflict with.
"""

from collections.abc import Collection, Sequence

import numpy as np

from conflictdb.arrays.answers import Conflicts
from conflictdb.core.near import Memory, Question
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
    numbers = {number for number, (key, _) in occupied.named().items() if key in keys}
    pieces = zip(occupied.pieces.kind.tolist(), occupied.pieces.object_id.tolist(), strict=True)
    mine = np.flatnonzero([number in numbers for number in pieces])
    question = Question.of(world.setup.scene)._replace(mine=mine)
    parts = run_scene(world.setup, Memory(occupied.pieces, occupied.batches), question=question)
    return to_results(world.setup.scene, occupied.named(), Conflicts.concatenate([found for found, _ in parts]))
