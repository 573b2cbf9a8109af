"""The conflicts of given plans with others, as `solve` finds them."""

from conflictdb.arrays.answers import Conflicts
from conflictdb.core.members import Members
from conflictdb.core.near import Together, boxes_within
from conflictdb.core.run import run_scene
from conflictdb.core.to_results import to_results
from conflictdb.earth.registry import Setup
from conflictdb.kernel.boxes import BoxTree
from conflictdb.model.results import Conflict


def conflicts_between(setup: Setup, mine: Members, others: Members, *, among: bool = False) -> list[Conflict]:
    """Return the conflicts of some objects with others of other owners.

    among : also those with each other
    """
    within_us = setup.scene.longest_time_us
    boxes, met = boxes_within(within_us, mine.pieces), Together(mine)
    if among:
        met.add_among(boxes)
    tree = BoxTree(boxes_within(within_us, others.pieces))
    met.add(others.pieces, others.of, others.each.__getitem__, *tree.pairs(boxes))
    return conflicts_of(setup, met)


def conflicts_of(setup: Setup, met: Together) -> list[Conflict]:
    """Return the conflicts of pairs that were collected, by the stages and in the order of `solve`."""
    parts = [part for part, _ in run_scene(setup, met)]
    return to_results(setup.scene, met.named, Conflicts.concatenate(parts)) if parts else []
