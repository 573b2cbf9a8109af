"""The conflicts of given plans with others, as `solve` finds them."""

from collections.abc import Iterable
from typing import Final

from conflictdb.arrays.answers import Conflicts
from conflictdb.core.members import Members
from conflictdb.core.near import Question, Together
from conflictdb.core.run import run_scene
from conflictdb.core.to_results import to_results
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.model.results import Conflict

# Conflicts in one answer about given plans: 1,000 plans that all meet are refused after 2 s.
MOST_REPLIES: Final = 50_000
# Pairs of pieces that are compared before replies are counted.
_AT_ONCE: Final = 20_000


def conflicts_between(setup: Setup, mine: Members, others: Members, *, among: bool = False) -> list[Conflict]:
    """Return the conflicts of some objects with others of other owners.

    among : also those with each other

    Raises InvalidInput for more than MOST_REPLIES.
    """
    if not len(others.pieces) and not among:
        return []
    question, met = Question.of(setup.scene), Together(mine, _AT_ONCE)
    if among:
        met.add_among(question)
    met.add_members(others, question)
    return to_results(setup.scene, met.named, bounded(part for part, _ in run_scene(setup, met)))


def bounded(parts: Iterable[Conflicts]) -> Conflicts:
    """Return the conflicts of an answer about given plans; raises InvalidInput for more than MOST_REPLIES."""
    found, count = [], 0
    for part in parts:
        count += len(part)
        if count > MOST_REPLIES:
            rule = f"have more than {MOST_REPLIES:,} conflicts, the most that one answer may have"
            raise InvalidInput("plans", "", f"{rule}: ask about fewer plans at once")
        found.append(part)
    return Conflicts.concatenate(found) if found else Conflicts.none()


def conflicts_of(setup: Setup, met: Together, *, has_approaches: bool = True) -> list[Conflict]:
    """Return the conflicts of pairs that were collected, by the stages and in the order of `solve`.

    has_approaches : see `run_stages`
    """
    if not met.has_pairs:
        return []
    parts = [part for part, _ in run_scene(setup, met, has_approaches=has_approaches)]
    return to_results(setup.scene, met.named, Conflicts.concatenate(parts)) if parts else []
